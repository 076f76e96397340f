//! Athermal quasi-static deformation: strain steps, each brought to mechanical equilibrium, and the
//! birth of the first complex pair.

use gshear_dem::dimension::Dimension;
use gshear_dem::failure::Result;
use gshear_dem::state::{HeldState, Snapshot};
use gshear_dem::tuning::Tuned;
use gshear_scene::{Deformation, PeriodicBox, Scene};
use gshear_store::box_columns::AqsRow;
use gshear_store::file_names::RUN_FILE;
use gshear_store::h5::Attribute;
use gshear_store::run_reader::RunStage;

use super::assembly::{Assembly, RestState};
use super::box_state::Observed;
use super::eigenvalues::Eigenvalues;
use super::relax::{LONGEST, NOT_AT_REST, Relaxation};
use crate::files::{Files, Format};
use crate::header::{
    Birth, Equilibrium, Header, Progress, Search, Shape, Stretched, Unfinished, UpToCheckpoint,
    Work,
};
use crate::options::Outcome;
use crate::run::{Checkpoint, Run, Save, Stage};
use gshear_store::status::Standing;

/// The strain that the box has reached: γ of a shear, ε along the last axis of a biaxial box, and
/// of a compression the part by which the volume has decreased.
pub(super) fn reached<D: Dimension>(periodic: &PeriodicBox, progress: &Progress) -> f64 {
    let of_volume = |of: &Stretched| {
        let parts = of.lengths.iter().zip(of.initial).take(D::AXES);
        1.0 - parts.map(|(now, then)| now / then).product::<f64>()
    };
    match periodic.deformation {
        Deformation::Compression(_) => progress.stretched.as_ref().map_or(0.0, of_volume),
        _ => periodic.aqs.strain_step * progress.steps as f64,
    }
}

/// The stage of the strain steps.
pub(super) struct Strain<'a, D: Dimension> {
    pub(super) scene: &'a Scene,
    pub(super) periodic: &'a PeriodicBox,
    pub(super) assembly: Assembly<'a, D>,
    relaxation: Relaxation,
    files: Files,
    pub(super) progress: Progress,
    /// What goes on after the last strain step.
    work: Option<Work>,
    /// States to return to, the last one first: that before the strain step if the birth of a pair
    /// is looked for, those of the search, that before Newton's method.
    pub(super) held: Vec<RestState>,
    /// The relaxations of the state that has no row yet.
    unrecorded: Option<Equilibrium>,
    /// Whether a relaxation has taken all the steps that it may.
    ran_out: bool,
    /// Strain and shear stress of the last state.
    latest: Option<[f64; 2]>,
}

impl<'a, D: Dimension> Strain<'a, D> {
    pub fn new(
        run: &Run<'a>,
        periodic: &'a PeriodicBox,
        mut assembly: Assembly<'a, D>,
        (header, held): (Header, Vec<HeldState>),
    ) -> Result<Self> {
        let scene = run.scene;
        let Header::Aqs {
            progress,
            written,
            unfinished,
        } = header
        else {
            unreachable!("strain steps begin with their header")
        };
        let (shapes, work) =
            unfinished.map_or_else(Default::default, |of| (of.held, Some(of.work)));
        let held = shapes.iter().zip(held).map(|(shape, state)| RestState {
            cell: shape.cell::<D>(&scene.sample),
            state,
        });
        let format = Format {
            name: RUN_FILE,
            columns: &AqsRow::COLUMNS,
            attributes: vec![("mean_diameter", scene.sample.mean_diameter.into())],
            height: None,
        };
        let before = UpToCheckpoint {
            step: progress.steps,
            last: (written.rows > 0).then_some(progress.steps),
        };
        Ok(Self {
            files: Files::open(run, &mut assembly, &format, Some(before))?,
            relaxation: Relaxation::new(periodic.relax, &scene.sample),
            scene,
            periodic,
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
    pub fn finish(
        mut self,
        run: &Run<'_>,
        outcome: Result<Outcome>,
    ) -> Result<(Assembly<'a, D>, Progress, Outcome)> {
        let (exchange, progress) = (run.exchange, self.progress);
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(failure) => return Err(self.files.fail(exchange, failure)),
        };
        let complete = outcome == Outcome::Done;
        let digest = (self.assembly).digest(&progress.box_bytes(), progress.steps);
        let mut attributes = vec![
            ("digest", Attribute::from(digest.clone())),
            ("fell_back", progress.fell_back.into()),
        ];
        if let Some(birth) = &progress.birth {
            attributes.push(("birth_before", birth.before.into()));
            attributes.push(("birth_after", birth.after.into()));
        }
        let known = if complete { &attributes[..] } else { &[] };
        self.files.finish(exchange, known)?;
        if complete {
            run.terminal.strained(&progress, &digest);
        }
        Ok((self.assembly, progress, outcome))
    }

    /// Whether the pair ends the strain steps.
    fn has_grown(&self) -> bool {
        let until = self.periodic.aqs.until_imaginary;
        let great = |pair: crate::header::Pair| pair.lambda_i >= until;
        until > 0.0 && self.progress.pairs == 1 && self.progress.pair.is_some_and(great)
    }

    /// Begins a strain step. Returns what follows the relaxation; `None` if there is none.
    fn deform(&mut self) -> Result<Option<Search>> {
        let step = self.progress.steps + 1;
        match &self.periodic.deformation {
            Deformation::SimpleShear => {
                self.shear(self.periodic.aqs.strain_step)?;
                Ok(Some(Search::Rest))
            }
            Deformation::PureShear => self.pure_shear(step),
            Deformation::Biaxial => self.biaxial(step),
            Deformation::Compression(pressures) => {
                self.begin_to_press(pressures[step as usize - 1])
            }
        }
    }

    /// Shears by `by`.
    fn shear(&mut self, by: f64) -> Result<()> {
        let height = self.assembly.system.cell.sheared.map_or(0.0, |s| s.height);
        let longest = LONGEST * self.scene.sample.mean_diameter;
        let parts = (by * height / longest).ceil().max(1.0);
        for _ in 0..parts as u64 {
            self.assembly.system.list.widen(4.0 * longest);
            self.assembly.rebuild()?;
            let part = by / parts;
            let grains = self.assembly.system.grains();
            let affine = |g: usize| [[part * grains.fields(g)[D::UP], 0.0, 0.0], [0.0; 3]];
            let moves: Vec<_> = (0..grains.owned).map(affine).collect();
            let followed = self.assembly.displace(&moves, part * height);
            self.within_law(followed)?;
        }
        Ok(())
    }

    /// What follows a relaxation that is done, if not another one: `None`.
    fn search(&mut self, run: &Run<'_>, work: &Work) -> Result<Option<Search>> {
        match (work.search, self.periodic.pressure) {
            (Search::Rest, Some(pressure)) if work.prepares => self.begin_to_press(pressure),
            (Search::Rest, _) => Ok(None),
            (Search::Pressure(of), _) => self.press_on(of),
            (Search::Lateral(of), _) => self.correct(of),
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

    /// Begins the relaxation before `search`, or ends the strain step. `found`: what was done so
    /// far.
    fn relax(
        &mut self,
        (prepares, found): (bool, Equilibrium),
        search: Option<Search>,
    ) -> Result<()> {
        if let Some(search) = search {
            let (assembly, held) = (&mut self.assembly, &mut self.held);
            let relaxing = self.relaxation.begin(assembly, held);
            let relaxing = relaxing.map_err(|failure| self.of_strain_step(failure))?;
            self.work = Some(Work {
                prepares,
                found,
                relaxing,
                search,
            });
            return Ok(());
        }
        self.unrecorded = Some(found);
        self.progress.offset = self.assembly.system.cell.sheared.map_or(0.0, |s| s.offset);
        if prepares {
            self.begin_stretching();
            return Ok(());
        }
        let progress = &mut self.progress;
        progress.steps += 1;
        if let Some(stretched) = &mut progress.stretched {
            stretched.lengths = self.assembly.system.cell.lengths::<D>();
        }
        progress.fell_back += u64::from(found.fell_back);
        Ok(())
    }

    fn row(
        &mut self,
        observed: &Observed,
        found: &Equilibrium,
        eigenvalues: Option<&Eigenvalues>,
    ) -> AqsRow {
        let third = |value| if D::AXES == 3 { value } else { f64::NAN };
        let of = |value: fn(&Eigenvalues) -> f64| eigenvalues.map_or(f64::NAN, value);
        let imaginary = of(|e| e.greatest_imaginary().map_or(0.0, |value| value.im));
        let lengths = self.assembly.system.cell.lengths::<D>();
        AqsRow {
            strain: reached::<D>(self.periodic, &self.progress),
            image_offset: self.progress.offset,
            shear_stress: observed.shear_stress,
            pressure: observed.pressure,
            elastic_energy: observed.elastic_energy,
            contacts: observed.contacts as f64,
            coordination: observed.coordination,
            sliding_fraction: observed.sliding_fraction,
            residual: self.assembly.residual(0.0),
            factorisations: found.factorisations as f64,
            overdamped_steps: found.steps as f64,
            fell_back: f64::from(u8::from(found.fell_back)),
            pairs: of(|e| e.pairs() as f64),
            imaginary_least: -imaginary,
            imaginary_greatest: imaginary,
            pair_real: of(|e| e.greatest_imaginary().map_or(f64::NAN, |value| value.re)),
            least_real: of(Eigenvalues::least_real),
            zero_modes: of(|e| e.zeros() as f64),
            solid_fraction: self.solid_fraction(),
            length_x: lengths[0],
            length_y: lengths[1],
            length_z: third(lengths[2]),
            stress_xx: observed.normal_stress[0],
            stress_yy: observed.normal_stress[1],
            stress_zz: third(observed.normal_stress[2]),
        }
    }

    /// Begins the next step of the bisection of the strain of the birth, between these strains from
    /// the state before the last strain step on, or ends it.
    fn bisect(&mut self, run: &Run<'_>, low: f64, high: f64) -> Result<Option<Search>> {
        let aqs = self.periodic.aqs;
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

impl<D: Dimension> Stage for Strain<'_, D> {
    fn at(&self) -> (&'static str, u64) {
        (RunStage::Strain.name(), self.progress.steps)
    }

    fn is_done(&self) -> bool {
        let last = self.progress.steps >= self.periodic.aqs.steps || self.has_grown();
        last && self.work.is_none()
    }

    fn goes_on(&self) -> bool {
        self.work.is_some()
    }

    fn begin(&mut self, _: &mut Run<'_>) -> Result<()> {
        let none = Equilibrium::default();
        self.relax((true, none), Some(Search::Rest))
    }

    /// A part of a strain step.
    fn step(&mut self, run: &mut Run<'_>, _: bool) -> Result<bool> {
        if let Some(mut work) = self.work.take() {
            let parts = (&mut work.relaxing, &mut self.held);
            let at_rest = match self.relaxation.go_on(&mut self.assembly, parts) {
                Ok(at_rest) => at_rest,
                Err(failure) => {
                    self.ran_out = failure.to_string().starts_with(NOT_AT_REST);
                    self.work = Some(work);
                    return Err(self.of_strain_step(failure));
                }
            };
            if at_rest {
                let mut found = work.found;
                found += work.relaxing.found;
                let next = self.search(run, &work)?;
                if next.is_some() || !matches!(work.search, Search::Birth { .. }) {
                    self.relax((work.prepares, found), next)?;
                }
            } else {
                self.work = Some(work);
            }
        } else {
            if self.periodic.aqs.spectrum && self.progress.birth.is_none() {
                self.held.push(RestState::of(&mut self.assembly));
            }
            let next = self.deform()?;
            self.relax((false, Equilibrium::default()), next)?;
        }
        let last = self.work.is_none() && run.options.stop_at == Some(self.progress.steps);
        Ok(run.should_stop() || last)
    }

    /// Measures the packing after a strain step. If the step has led to the first complex pair,
    /// begins to bisect its birth.
    fn record(&mut self, run: &mut Run<'_>) -> Result<()> {
        let Some(found) = self.unrecorded.take() else {
            return Ok(());
        };
        let (exchange, aqs) = (run.exchange, self.periodic.aqs);
        let observed = self.assembly.observe(self.scene.sample.grains);
        let eigenvalues = aqs
            .spectrum
            .then(|| self.assembly.eigenvalues())
            .transpose()?;
        if let Some(found) = &eigenvalues {
            (self.progress.pairs, self.progress.pair) = (found.pairs(), found.fastest_pair());
        }
        let step = self.progress.steps;
        let row = self.row(&observed, &found, eigenvalues.as_ref());
        let trajectory = &mut self.files.trajectory;
        trajectory.series(exchange, step, row.strain, &row)?;
        trajectory.publish_rows(exchange)?;
        self.latest = Some([row.strain, row.shear_stress]);
        run.terminal.strain_step(step, &row);
        let every = aqs.frame_every;
        let is_last = step >= aqs.steps || self.has_grown();
        if every > 0 && (step.is_multiple_of(every) || is_last) {
            let (grains, contacts) = self.assembly.frame();
            let edges = self.assembly.system.cell.edges::<D>(0.0);
            let clock = (step, row.strain);
            (self.files.trajectory).frame(exchange, clock, &edges, &grains, &contacts)?;
        }
        if self.progress.birth.is_none() && self.progress.pairs > 0 && !self.held.is_empty() {
            self.held.push(RestState::of(&mut self.assembly));
            let first = self.bisect(run, 0.0, aqs.strain_step)?;
            if first.is_some() {
                self.relax((false, Equilibrium::default()), first)?;
            }
        }
        if self.work.is_none() {
            self.held.clear();
        }
        Ok(())
    }

    fn tuned(&self) -> Option<Tuned> {
        self.assembly.system.tuning.tuned()
    }

    fn standing(&self) -> Standing {
        Standing {
            stage: RunStage::Strain.name().into(),
            step: self.progress.steps,
            steps: Some(self.periodic.aqs.steps),
            strain: self.latest.map(|[strain, _]| strain),
            shear_stress: self.latest.map(|[_, stress]| stress),
            residual: Some(self.relaxation.residual)
                .filter(|residual| self.work.is_some() && residual.is_finite()),
            ..Standing::default()
        }
    }

    fn save_due(&self) -> Save {
        match self.is_done() {
            true => Save::Now,
            // Only those of whole strain steps are kept.
            false if self.scene.keep_checkpoints && self.work.is_some() => Save::No,
            false => Save::IfOld,
        }
    }

    fn flush(&mut self, run: &mut Run<'_>) -> Result<()> {
        self.files.flush(run.exchange)
    }

    /// That of whole strain steps.
    fn is_kept(&self) -> bool {
        self.work.is_none()
    }

    fn is_sound(&self) -> bool {
        self.ran_out
    }

    fn state(&mut self, _: &mut Run<'_>) -> Result<Checkpoint> {
        let shape = |state: &RestState| Shape::of::<D>(&state.cell);
        let unfinished = self.work.as_ref().map(|work| Unfinished {
            shape: Shape::of::<D>(&self.assembly.system.cell),
            held: self.held.iter().map(shape).collect(),
            work: work.clone(),
        });
        Ok(Checkpoint {
            header: Header::Aqs {
                progress: self.progress,
                written: self.files.written(),
                unfinished,
            },
            state: Snapshot {
                held: self.held.iter().map(RestState::owned).collect(),
                ..self.assembly.owned()
            },
            keep: self.scene.keep_checkpoints && self.work.is_none(),
        })
    }
}
