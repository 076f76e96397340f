//! Athermal quasi-static deformation: strain steps, each brought to mechanical equilibrium, and the
//! birth of the first complex pair.

use gshear_dem::contact::portable_ln;
use gshear_dem::dimension::Dimension;
use gshear_dem::failure::Result;
use gshear_dem::state::{HeldState, Snapshot};
use gshear_scene::{Deformation, Origin, QuasiStatic, RunStage, Scene, StrainPart};
use gshear_store::box_columns::{AqsRow, StrainProtocolRow, strain_columns};
use gshear_store::file_names::part_of;
use gshear_store::h5::Attribute;

use super::assembly::{Assembly, RestState};
use super::box_state::Observed;
use super::eigenvalues::Eigenvalues;
use super::relax::{LONGEST, NOT_AT_REST, Relaxation};
use super::top_wall::volume_of_grains;
use crate::files::{Files, Format, TimePoint};
use crate::header::{
    Birth, Header, RelaxationStatistics, Search, Shape, StrainHeader, StrainProgress, Stretched,
    Unfinished, UpToCheckpoint, Work,
};
use crate::options::Outcome;
use crate::output_schedule::{OutputSchedule, StrainSchedule};
use crate::run::{Checkpoint, Run};
use crate::stage::{Save, Stage};
use gshear_store::status::StageProgress;

/// The strain that the box has reached: γ of a shear, ε along the last axis of a biaxial box, the
/// relative decrease of the volume in a compression, the accumulated strain of a protocol.
pub(super) fn reached<D: Dimension>(quasi_static: &QuasiStatic, progress: &StrainProgress) -> f64 {
    match (&quasi_static.deformation, &progress.stretched) {
        (Deformation::Compression(_), Some(stretched)) => stretched.volume_strain::<D>(),
        (Deformation::Protocol(_), Some(stretched)) => stretched.accumulated_strain,
        (Deformation::Compression(_) | Deformation::Protocol(_), None) => 0.0,
        _ => quasi_static.aqs.strain_step * progress.steps as f64,
    }
}

/// The stage of the strain steps.
pub(super) struct Strain<'a, D: Dimension> {
    pub(super) scene: &'a Scene,
    pub(super) quasi_static: &'a QuasiStatic,
    pub(super) assembly: Assembly<'a, D>,
    relaxation: Relaxation,
    files: Files,
    schedule: StrainSchedule,
    /// The solid fraction in a cell of a known volume.
    pub(super) at_start: SolidFraction,
    /// Steps of the stages before.
    before: u64,
    pub(super) progress: StrainProgress,
    /// What goes on after the last strain step.
    work: Option<Work>,
    /// States to return to, the last one first: that before the strain step if the birth of a pair
    /// is looked for, those of the search, that before Newton's method.
    pub(super) held: Vec<RestState>,
    /// The relaxations of the state that has no row yet.
    unrecorded: Option<RelaxationStatistics>,
    /// Whether a relaxation has taken all the steps that it may.
    ran_out: bool,
    /// Strain and shear stress of the last state.
    latest: Option<[f64; 2]>,
}

/// A solid fraction, and the volume of the cell that has it.
pub(super) struct SolidFraction {
    pub value: f64,
    pub volume: f64,
}

/// A cell after its strain steps, or those before a stop.
pub(super) struct Strained<'a, D: Dimension> {
    pub assembly: Assembly<'a, D>,
    pub progress: StrainProgress,
    pub outcome: Outcome,
}

impl<'a, D: Dimension> Strain<'a, D> {
    /// The strain steps from their start, or as they were stopped, with the states that are held.
    pub fn new(
        run: &Run<'a>,
        quasi_static: &'a QuasiStatic,
        mut assembly: Assembly<'a, D>,
        header: StrainHeader,
        held: Vec<HeldState>,
    ) -> Result<Self> {
        let scene = run.scene;
        let StrainHeader {
            before,
            progress,
            written,
            unfinished,
        } = header;
        let (shapes, work) = match unfinished {
            Some(unfinished) => (unfinished.held, Some(unfinished.work)),
            None => (Vec::new(), None),
        };
        let held = shapes.iter().zip(held).map(|(shape, state)| RestState {
            cell: shape.cell::<D>(&scene.sample),
            state,
        });
        let format = Format {
            name: part_of(&scene.stages, RunStage::Strain),
            log_columns: &[],
            columns: strain_columns(quasi_static.deformation.is_protocol()),
            attributes: vec![("mean_diameter", scene.sample.mean_diameter.into())],
            height: None,
            analysed: None,
            spectra: None,
        };
        let checkpoint = UpToCheckpoint {
            step: progress.steps,
            last: (written.rows > 0).then_some(progress.steps),
        };
        let at_start = match &quasi_static.origin {
            Origin::StageBefore { .. } => SolidFraction {
                value: volume_of_grains(run, scene, &assembly.system.grain_states()),
                volume: 1.0,
            },
            Origin::Insertion(_) | Origin::Packing(_) => SolidFraction {
                value: quasi_static.solid_fraction,
                volume: quasi_static.lengths(&scene.sample).iter().product(),
            },
        };
        Ok(Self {
            files: Files::open(run, &mut assembly, format, checkpoint)?,
            at_start,
            before,
            relaxation: Relaxation::new(quasi_static.relax, &scene.sample),
            schedule: StrainSchedule::new(&quasi_static.aqs),
            scene,
            quasi_static,
            assembly,
            progress,
            work,
            held: held.collect(),
            unrecorded: None,
            ran_out: false,
            latest: None,
        })
    }

    /// Closes the file; strain steps that are done are marked as finished.
    pub fn finish(mut self, run: &Run<'_>, outcome: Result<Outcome>) -> Result<Strained<'a, D>> {
        let (exchange, progress) = (run.exchange, self.progress);
        let (files, outcome) = self.files.unless_failed(exchange, outcome)?;
        let digest = (self.assembly).digest(&progress.box_bytes(), progress.steps);
        let mut attributes = vec![
            ("digest", Attribute::from(digest.clone())),
            ("fell_back", progress.fell_back.into()),
        ];
        if let Some(birth) = &progress.birth {
            attributes.push(("birth_before", birth.before.into()));
            attributes.push(("birth_after", birth.after.into()));
        }
        files.finish(exchange, outcome, &attributes)?;
        if outcome == Outcome::Done {
            run.terminal.strained(&progress, &digest);
        }
        Ok(Strained {
            assembly: self.assembly,
            progress,
            outcome,
        })
    }

    /// Whether the pair ends the strain steps.
    fn has_grown(&self) -> bool {
        let until = self.quasi_static.aqs.until_imaginary;
        let pair = self.progress.pair;
        until > 0.0 && self.progress.pairs == 1 && pair.is_some_and(|pair| pair.lambda_i >= until)
    }

    /// Whether no strain step comes after the last one.
    fn is_at_last_step(&self) -> bool {
        self.progress.steps >= self.schedule.steps() || self.has_grown()
    }

    /// Begins a strain step. Returns what follows the relaxation; `None` if there is none.
    fn deform(&mut self) -> Result<Option<Search>> {
        let step = self.progress.steps + 1;
        match &self.quasi_static.deformation {
            Deformation::SimpleShear => {
                self.shear(self.quasi_static.aqs.strain_step)?;
                Ok(Some(Search::Rest))
            }
            Deformation::PureShear => self.pure_shear(step),
            Deformation::Biaxial => self.biaxial(step),
            Deformation::Compression(pressures) => {
                self.begin_to_press(pressures[step as usize - 1])
            }
            Deformation::Protocol(parts) => self.protocol(parts, step),
        }
    }

    /// Shears by `by`.
    pub(super) fn shear(&mut self, by: f64) -> Result<()> {
        let height = self.assembly.system.cell.sheared.map_or(0.0, |s| s.height);
        let longest = LONGEST * self.scene.sample.mean_diameter;
        let parts = (by.abs() * height / longest).ceil().max(1.0);
        for _ in 0..parts as u64 {
            self.assembly.system.list.widen(4.0 * longest);
            self.assembly.rebuild()?;
            let part = by / parts;
            let grains = self.assembly.system.grains();
            let heights = (0..grains.owned).map(|g| grains.fields(g)[D::UP]);
            let moves: Vec<_> = heights
                .map(|height| [[part * height, 0.0, 0.0], [0.0; 3]])
                .collect();
            let outcome = self.assembly.displace(&moves, part * height);
            self.within_law(outcome)?;
        }
        Ok(())
    }

    /// What follows a relaxation that is done, if not another one: `None`.
    fn search(&mut self, run: &Run<'_>, work: &Work) -> Result<Option<Search>> {
        match (work.search, self.quasi_static.pressure) {
            (Search::Rest, Some(pressure)) if work.prepares => self.begin_to_press(pressure),
            (Search::Rest, _) => Ok(None),
            (Search::Pressure(pressing), _) => self.press_on(pressing),
            (Search::Stresses(correction), _) => self.correct(correction),
            (Search::Birth { low, high }, _) => {
                let middle = 0.5 * (low + high);
                if self.assembly.eigenvalues()?.pairs() > 0 {
                    return self.bisect(run, low, middle);
                }
                self.held[0] = RestState::of(&mut self.assembly);
                self.bisect(run, middle, high)
            }
        }
    }

    /// Begins the relaxation before `search`, or ends the strain step or, if it `prepares`, what
    /// comes before the first one. `found`: the relaxations so far.
    fn relax(
        &mut self,
        prepares: bool,
        statistics: RelaxationStatistics,
        search: Option<Search>,
    ) -> Result<()> {
        if let Some(search) = search {
            let (assembly, held) = (&mut self.assembly, &mut self.held);
            let relaxing = self.relaxation.begin(assembly, held);
            let relaxing = relaxing.map_err(|failure| self.of_strain_step(failure))?;
            self.work = Some(Work {
                prepares,
                statistics,
                relaxing,
                search,
            });
            return Ok(());
        }
        self.unrecorded = Some(statistics);
        self.progress.offset = self.assembly.system.cell.sheared.map_or(0.0, |s| s.offset);
        if prepares {
            self.begin_stretching();
            return Ok(());
        }
        let progress = &mut self.progress;
        progress.steps += 1;
        if let Some(stretched) = &mut progress.stretched {
            let lengths = self.assembly.system.cell.lengths::<D>();
            if let Deformation::Protocol(parts) = &self.quasi_static.deformation {
                let [before, after] = [progress.steps - 1, progress.steps]
                    .map(|steps| StrainPart::shear_after(parts, steps));
                let mut greatest = (after - before).abs();
                for (now, then) in lengths.iter().zip(stretched.lengths) {
                    greatest = greatest.max(portable_ln(now / then).abs());
                }
                stretched.accumulated_strain += greatest;
            }
            stretched.lengths = lengths;
        }
        progress.fell_back += u64::from(statistics.fell_back);
        Ok(())
    }

    fn row(
        &mut self,
        observed: &Observed,
        statistics: &RelaxationStatistics,
        eigenvalues: Option<&Eigenvalues>,
    ) -> AqsRow {
        let (mut length_z, mut stress_zz) = (f64::NAN, f64::NAN);
        let lengths = self.assembly.system.cell.lengths::<D>();
        if D::AXES == 3 {
            (length_z, stress_zz) = (lengths[2], observed.normal_stress[2]);
        }
        let spectrum = match eigenvalues {
            Some(eigenvalues) => SpectrumColumns::new(eigenvalues),
            None => SpectrumColumns::UNKNOWN,
        };
        AqsRow {
            strain: reached::<D>(self.quasi_static, &self.progress),
            image_offset: self.progress.offset,
            shear_stress: observed.shear_stress,
            pressure: observed.pressure,
            elastic_energy: observed.elastic_energy,
            contacts: observed.contacts as f64,
            coordination: observed.coordination,
            sliding_fraction: observed.sliding_fraction,
            residual: self.assembly.residual(0.0),
            factorisations: statistics.factorisations as f64,
            overdamped_steps: statistics.steps as f64,
            fell_back: f64::from(u8::from(statistics.fell_back)),
            pairs: spectrum.pairs,
            imaginary_least: -spectrum.imaginary,
            imaginary_greatest: spectrum.imaginary,
            pair_real: spectrum.pair_real,
            least_real: spectrum.least_real,
            zero_modes: spectrum.zero_modes,
            solid_fraction: self.solid_fraction(),
            length_x: lengths[0],
            length_y: lengths[1],
            length_z,
            stress_xx: observed.normal_stress[0],
            stress_yy: observed.normal_stress[1],
            stress_zz,
        }
    }

    /// The part of a protocol, and the strains that it has reached; `None` of another deformation.
    fn row_of_protocol(&self) -> Option<StrainProtocolRow> {
        let Deformation::Protocol(parts) = &self.quasi_static.deformation else {
            return None;
        };
        let Stretched {
            lengths, initial, ..
        } = self.stretched();
        let strain: [f64; 3] =
            std::array::from_fn(|axis| -portable_ln(lengths[axis] / initial[axis]));
        let steps = self.progress.steps;
        let mut part = 0;
        if let Some((n, within)) = StrainPart::of_step(parts, steps)
            && within > 0
        {
            part = n + 1;
        }
        Some(StrainProtocolRow {
            part: part as f64,
            shear_strain: StrainPart::shear_after(parts, steps),
            strain_xx: strain[0],
            strain_yy: strain[1],
            strain_zz: if D::AXES == 3 { strain[2] } else { f64::NAN },
            volume_strain: strain[..D::AXES].iter().sum(),
        })
    }

    /// Begins the next step of the bisection of the strain of the birth, between these strains from
    /// the state before the last strain step on, or ends it.
    fn bisect(&mut self, run: &Run<'_>, low: f64, high: f64) -> Result<Option<Search>> {
        let aqs = self.quasi_static.aqs;
        if high - low > aqs.birth_precision {
            let before = self.held[0].clone();
            before.put_back(&mut self.assembly)?;
            self.shear(0.5 * (low + high) - low)?;
            return Ok(Some(Search::Birth { low, high }));
        }
        let start = aqs.strain_step * (self.progress.steps - 1) as f64;
        let birth = Birth {
            before: start + low,
            after: start + high,
        };
        self.progress.birth = Some(birth);
        run.terminal.born(&birth);
        if let Some(after) = self.held.pop() {
            after.put_back(&mut self.assembly)?;
        }
        self.held.clear();
        Ok(None)
    }
}

/// Columns of the time series by the eigenvalues.
struct SpectrumColumns {
    pairs: f64,
    /// Greatest |Im λ|, and Re λ of its pair.
    imaginary: f64,
    pair_real: f64,
    least_real: f64,
    zero_modes: f64,
}

impl SpectrumColumns {
    /// Without eigenvalues.
    const UNKNOWN: Self = Self {
        pairs: f64::NAN,
        imaginary: f64::NAN,
        pair_real: f64::NAN,
        least_real: f64::NAN,
        zero_modes: f64::NAN,
    };

    fn new(eigenvalues: &Eigenvalues) -> Self {
        let greatest = eigenvalues.greatest_imaginary();
        Self {
            pairs: eigenvalues.pairs() as f64,
            imaginary: greatest.map_or(0.0, |value| value.im),
            pair_real: greatest.map_or(f64::NAN, |value| value.re),
            least_real: eigenvalues.least_real(),
            zero_modes: eigenvalues.zeros() as f64,
        }
    }
}

impl<'a, D: Dimension> Stage<'a, D> for Strain<'a, D> {
    fn name(&self) -> &'static str {
        RunStage::Strain.name()
    }

    fn completed(&self) -> u64 {
        self.progress.steps
    }

    fn files(&mut self) -> Option<&mut Files> {
        Some(&mut self.files)
    }

    fn is_done(&self) -> bool {
        self.work.is_none() && self.is_at_last_step()
    }

    fn is_within_step(&self) -> bool {
        self.work.is_some()
    }

    fn begin(&mut self) -> Result<()> {
        self.relax(true, RelaxationStatistics::default(), Some(Search::Rest))
    }

    /// A part of a strain step.
    fn step(&mut self, run: &mut Run<'_>, _: bool) -> Result<bool> {
        if let Some(mut work) = self.work.take() {
            let (assembly, held) = (&mut self.assembly, &mut self.held);
            let at_rest = match self.relaxation.go_on(assembly, &mut work.relaxing, held) {
                Ok(at_rest) => at_rest,
                Err(failure) => {
                    self.ran_out = failure.to_string().starts_with(NOT_AT_REST);
                    self.work = Some(work);
                    return Err(self.of_strain_step(failure));
                }
            };
            if at_rest {
                let mut statistics = work.statistics;
                statistics += work.relaxing.statistics;
                let next = self.search(run, &work)?;
                if next.is_some() || !matches!(work.search, Search::Birth { .. }) {
                    self.relax(work.prepares, statistics, next)?;
                }
            } else {
                self.work = Some(work);
            }
        } else {
            if self.quasi_static.aqs.spectrum && self.progress.birth.is_none() {
                self.held.push(RestState::of(&mut self.assembly));
            }
            let next = self.deform()?;
            self.relax(false, RelaxationStatistics::default(), next)?;
        }
        let counted = self.before + self.progress.steps;
        let last = self.work.is_none() && run.options.stop_at == Some(counted);
        Ok(run.should_stop() || last)
    }

    /// Measures the packing after a strain step. If the step has led to the first complex pair,
    /// begins to bisect its birth.
    fn record(&mut self, run: &mut Run<'_>) -> Result<()> {
        let Some(statistics) = self.unrecorded.take() else {
            return Ok(());
        };
        let (exchange, step) = (run.exchange, self.progress.steps);
        let observed = self.assembly.observe(self.scene.sample.grains);
        let mut eigenvalues = None;
        if self.schedule.spectrum_due(step) {
            let spectrum = self.assembly.eigenvalues()?;
            self.progress.pairs = spectrum.pairs();
            self.progress.pair = spectrum.fastest_pair();
            eigenvalues = Some(spectrum);
        }
        let due = if self.is_at_last_step() {
            self.schedule.due_at_end(step)
        } else {
            self.schedule.due(step)
        };
        let row = self.row(&observed, &statistics, eigenvalues.as_ref());
        let at = TimePoint {
            step,
            time: row.strain,
        };
        let mut values = row.columns().to_vec();
        if let Some(row) = self.row_of_protocol() {
            values.extend(row.columns());
        }
        self.files.row(exchange, at, &values)?;
        self.files.publish_rows(exchange)?;
        self.latest = Some([row.strain, row.shear_stress]);
        run.terminal.strain_step(step, &row);
        self.files.frame(&mut self.assembly, due, at, 0.0)?;
        if self.progress.birth.is_none() && self.progress.pairs > 0 && !self.held.is_empty() {
            self.held.push(RestState::of(&mut self.assembly));
            let first = self.bisect(run, 0.0, self.quasi_static.aqs.strain_step)?;
            if first.is_some() {
                self.relax(false, RelaxationStatistics::default(), first)?;
            }
        }
        if self.work.is_none() {
            self.held.clear();
        }
        Ok(())
    }

    fn save_due(&self) -> Save {
        if self.is_done() {
            Save::Now
        } else if self.scene.keep_checkpoints && self.work.is_some() {
            // Only those of whole strain steps are kept.
            Save::No
        } else {
            Save::IfOld
        }
    }

    /// That of whole strain steps.
    fn is_kept(&self) -> bool {
        self.work.is_none()
    }

    fn is_sound(&self) -> bool {
        self.ran_out
    }

    fn state(&mut self, _: &mut Run<'_>) -> Result<Checkpoint> {
        let held = self.held.iter();
        let shapes = held.map(|state| Shape::of::<D>(&state.cell)).collect();
        let unfinished = self.work.as_ref().map(|work| Unfinished {
            shape: Shape::of::<D>(&self.assembly.system.cell),
            held: shapes,
            work: work.clone(),
        });
        Ok(Checkpoint {
            header: Header::Strain(StrainHeader {
                before: self.before,
                progress: self.progress,
                written: self.files.written(),
                unfinished,
            }),
            state: Snapshot {
                held: self.held.iter().map(RestState::owned).collect(),
                ..self.assembly.owned()
            },
            keep: self.scene.keep_checkpoints && self.work.is_none(),
        })
    }

    fn progress(&self) -> StageProgress {
        let residual = self.relaxation.residual;
        let relaxes = self.work.is_some() && residual.is_finite();
        StageProgress {
            stage: self.name().into(),
            step: self.progress.steps,
            steps: Some(self.schedule.steps()),
            strain: self.latest.map(|[strain, _]| strain),
            shear_stress: self.latest.map(|[_, stress]| stress),
            residual: relaxes.then_some(residual),
            ..StageProgress::default()
        }
    }
}
