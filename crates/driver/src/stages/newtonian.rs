//! Newton's equations from the last state at rest: the growth of a complex pair (BO section IV).

use bytemuck::{Pod, Zeroable};

use gshear_dem::clock::StepPhase;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{Displacement, Snapshot};
use gshear_dem::system::System;
use gshear_dem::tuning::Tuned;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::{MOST_STEPS, ReplayWindow, STEPS_WITHOUT_A_PAIR};
use gshear_scene::unlikely::intervals_of_newtonian;
use gshear_scene::{PeriodicBox, Scene};
use gshear_store::box_columns::NewtonianRow;
use gshear_store::collective::{exists, gathered};
use gshear_store::file_names::{NEWTONIAN_PART, SPECTRA_FILE};
use gshear_store::h5::Attribute;
use gshear_store::run_reader::RunStage;

use super::assembly::Assembly;
use super::eigenvalues::GlobalState;
use super::spectra_file::SpectraFile;
use super::strain;
use crate::files::{Files, Format};
use crate::header::{Header, Pair, Progress, TimeOrigin, UpToCheckpoint};
use crate::options::Outcome;
use crate::run::{Checkpoint, LOOK, Run, Save, Stage};
use gshear_store::status::Standing;

/// The stage that integrates Newton's equations of a box.
pub(super) struct NewtonianStage<'a, D: Dimension> {
    scene: &'a Scene,
    assembly: Assembly<'a, D>,
    motion: GrainMotion,
    files: Files,
    spectra: Option<SpectraFile>,
    /// The progress of the strain steps before.
    progress: Progress,
    step: u64,
    /// From where the time counts.
    origin: TimeOrigin,
    due: Due,
    /// Shear stress of the last row.
    latest: Option<f64>,
}

/// Where the stage goes on.
pub(super) struct Resumed {
    /// Steps done.
    pub step: u64,
    /// From where their time counts.
    pub origin: TimeOrigin,
    /// The displacements up to there.
    pub displacements: Vec<Displacement>,
}

/// The steps at which output is due. An interval longer than the stage disables an output.
struct Due {
    /// Number of steps of the stage, or up to the end of the window.
    steps: u64,
    /// The last step of the stage, which is always written.
    last: u64,
    rows: u64,
    frames: u64,
    spectra: u64,
    dense: Option<Dense>,
    /// The window of a replay.
    window: Option<ReplayWindow>,
}

/// Number of steps of Δt `step` in the stage.
pub(crate) fn steps(of: &gshear_scene::Newtonian, pair: Option<&Pair>, step: f64) -> u64 {
    match pair {
        Some(pair) => (of.growth_times / pair.omega_i / step).ceil() as u64,
        None => (of.growth_times * STEPS_WITHOUT_A_PAIR).ceil() as u64,
    }
}

impl Due {
    fn new(of: &gshear_scene::Newtonian, pair: Option<&Pair>, step: f64) -> Self {
        let steps = steps(of, pair, step);
        let every = |count| (steps.checked_div(count)).map_or(u64::MAX, |every| every.max(1));
        let dense = pair.map(|pair| Dense::new(pair, steps, step));
        let frames = match (pair, every(of.frames)) {
            (Some(pair), wanted) if wanted != u64::MAX => strobe(pair, wanted, step),
            (_, wanted) => wanted,
        };
        // All rows lie at multiples of the interval of the dense rows, so that none falls between
        // two of them.
        let grid = dense.as_ref().map_or(1, |dense| dense.every);
        Self {
            steps,
            last: steps,
            rows: every(of.rows).div_ceil(grid).saturating_mul(grid),
            frames,
            spectra: every(of.spectra),
            dense,
            window: None,
        }
    }

    /// Restricts the stage to the end of a replay window, with frames in the window.
    fn of_window(mut self, window: ReplayWindow) -> Self {
        self.steps = self.steps.min(window.last);
        self.spectra = u64::MAX;
        self.window = Some(window);
        self
    }

    fn row(&self, step: u64) -> bool {
        let dense = self.dense.as_ref();
        step.is_multiple_of(self.rows)
            || dense.is_some_and(|dense| dense.due(step))
            || self.is_last(step, self.rows)
    }

    fn frame(&self, step: u64) -> bool {
        match self.window {
            Some(ReplayWindow { first, every, .. }) => {
                step >= first
                    && every.map_or_else(
                        || self.row(step),
                        |every| (step - first).is_multiple_of(every),
                    )
            }
            None => step.is_multiple_of(self.frames) || self.is_last(step, self.frames),
        }
    }

    /// Whether a step is the last of the stage, and an output of this interval is written.
    fn is_last(&self, step: u64, every: u64) -> bool {
        step == self.last && every != u64::MAX
    }

    fn spectrum(&self, step: u64) -> bool {
        self.spectra != u64::MAX && step.is_multiple_of(self.spectra)
    }
}

impl<'a, D: Dimension> NewtonianStage<'a, D> {
    /// The stage from its start, or as it was stopped.
    pub fn new(
        run: &Run<'a>,
        (periodic, of): (&PeriodicBox, &gshear_scene::Newtonian),
        mut assembly: Assembly<'a, D>,
        progress: Progress,
        resumed: Option<Resumed>,
    ) -> Result<Self> {
        let (exchange, scene, step) = (run.exchange, run.scene, assembly.system.step);
        let strain = strain::reached::<D>(periodic, &progress);
        let mut due = Due::new(of, progress.pair.as_ref(), step);
        if due.steps > MOST_STEPS {
            let rate = progress.pair.map_or(0.0, |pair| pair.omega_i);
            return Err(Failure::numbers(format!(
                "newtonian: {:.1e} steps are more than the {:.1e} that are counted: the complex pair grows at the rate {rate:.1e} only; give a smaller newtonian.growth_times",
                due.steps as f64, MOST_STEPS as f64
            )));
        }
        if let Some(window) = run.options.replay {
            due = due.of_window(window);
        }
        run.terminal.newtonian(due.steps, step);
        if let Some(warning) = intervals_of_newtonian(of, due.steps) {
            run.terminal.warn(warning);
        }
        let format = Format {
            name: NEWTONIAN_PART,
            columns: &NewtonianRow::COLUMNS,
            attributes: attributes(scene, strain, &progress),
            height: None,
        };
        let goes_on = resumed.as_ref().filter(|_| run.options.replay.is_none());
        let before = goes_on.map(|of| UpToCheckpoint::new(of.step));
        let origin = resumed
            .as_ref()
            .map_or_else(TimeOrigin::default, |of| of.origin);
        let files = Files::open(run, &mut assembly, &format, before)?;
        let spectra = if due.spectra == u64::MAX {
            None
        } else {
            let path = run.options.out.join(SPECTRA_FILE);
            // In another folder than the checkpoint's the file begins anew.
            let there = exists(exchange, &path)?;
            let last = before.filter(|_| there).and_then(|before| before.last);
            let last = last.map(|last| origin.time(last, step));
            Some(SpectraFile::open(exchange, &path, last)?)
        };
        let motion = if let Some(resumed) = &resumed {
            GrainMotion::resume(exchange, &mut assembly.system, &resumed.displacements)
        } else {
            assembly.rebuild()?;
            GrainMotion::begin(&mut assembly.system)
        };
        Ok(Self {
            scene,
            assembly,
            motion,
            files,
            spectra,
            progress,
            step: resumed.map_or(0, |of| of.step),
            origin,
            due,
            latest: None,
        })
    }

    /// Closes the files; a run that is done is marked as finished.
    pub fn finish(mut self, run: &Run<'_>, outcome: Result<Outcome>) -> Result<Outcome> {
        match outcome {
            Ok(Outcome::Done) => {}
            Ok(Outcome::Stopped) => {
                self.files.finish(run.exchange, &[])?;
                return outcome;
            }
            Err(failure) => {
                if let (Failure::Numbers(_), Some(spectra)) = (&failure, &mut self.spectra) {
                    spectra.flush(run.exchange)?;
                }
                return Err(self.files.fail(run.exchange, failure));
            }
        }
        let digest = (self.assembly).digest(&self.progress.box_bytes(), self.step);
        if let Some(spectra) = &mut self.spectra {
            spectra.flush(run.exchange)?;
        }
        let attributes = [("digest", Attribute::Text(digest.clone()))];
        self.files.finish(run.exchange, &attributes)?;
        run.terminal.moved(&digest, &run.options.out);
        outcome
    }
}

impl<D: Dimension> Stage for NewtonianStage<'_, D> {
    fn at(&self) -> (&'static str, u64) {
        (RunStage::Newtonian.name(), self.step)
    }

    /// Newton's equations follow the strain steps.
    fn count(&self) -> Option<u64> {
        Some(self.progress.steps + self.step + 1)
    }

    fn is_done(&self) -> bool {
        self.step >= self.due.steps
    }

    fn begin(&mut self, run: &mut Run<'_>) -> Result<()> {
        if self.scene.keep_checkpoints && run.options.replay.is_none() {
            // A window before the first checkpoint is replayed from the state at rest.
            self.flush(run)?;
            let checkpoint = self.state(run)?;
            run.save(&checkpoint)?;
        }
        self.assembly.initial_forces(&mut NoWalls, false)
    }

    fn step(&mut self, run: &mut Run<'_>, stop: bool) -> Result<bool> {
        let stop = stop || run.asked_to_stop();
        let stop = self.assembly.advance(&mut NoWalls, false, stop)?;
        self.motion.turn(run.exchange, &mut self.assembly.system);
        self.step += 1;
        Ok(stop)
    }

    fn record(&mut self, run: &mut Run<'_>) -> Result<()> {
        let (exchange, step) = (run.exchange, self.step);
        let time = self.origin.time(step, self.assembly.system.step);
        let (row, frame_due) = (self.due.row(step), self.due.frame(step));
        if row || frame_due {
            let observed = self.assembly.observe(self.scene.sample.grains);
            if row {
                let moved = (self.motion).measure(exchange, &mut self.assembly.system);
                let row = NewtonianRow {
                    msd: moved.msd,
                    kinetic_energy: moved.kinetic_energy,
                    elastic_energy: observed.elastic_energy,
                    shear_stress: observed.shear_stress,
                    pressure: observed.pressure,
                    contacts: observed.contacts as f64,
                    sliding_fraction: observed.sliding_fraction,
                };
                self.latest = Some(row.shear_stress);
                (self.files.trajectory).series(exchange, step, time, &row)?;
            }
            if frame_due {
                let (grains, contacts) = self.assembly.frame();
                let edges = self.assembly.system.cell.edges::<D>(0.0);
                let clock = (step, time);
                (self.files.trajectory).frame(exchange, clock, &edges, &grains, &contacts)?;
            }
        }
        if self.due.spectrum(step) {
            let found = GlobalState::moving(&mut self.assembly).eigenvalues(&self.assembly)?;
            if let Some(spectra) = &mut self.spectra {
                spectra.write(exchange, time, &found)?;
            }
        }
        self.assembly.system.clock.end(StepPhase::Output);
        Ok(())
    }

    fn tuned(&self) -> Option<Tuned> {
        self.assembly.system.tuning.tuned()
    }

    fn standing(&self) -> Standing {
        Standing {
            stage: RunStage::Newtonian.name().into(),
            step: self.step,
            steps: Some(self.due.steps),
            shear_stress: self.latest,
            moving: Some(self.scene.sample.grains),
            ..Standing::default()
        }
    }

    fn save_due(&self) -> Save {
        if self.due.window.is_some() {
            Save::No
        } else if self.is_done() {
            Save::Now
        } else if self.step.is_multiple_of(LOOK) {
            Save::IfOld
        } else {
            Save::No
        }
    }

    fn flush(&mut self, run: &mut Run<'_>) -> Result<()> {
        self.files.flush(run.exchange)?;
        match &mut self.spectra {
            Some(spectra) => spectra.flush(run.exchange),
            None => Ok(()),
        }
    }

    fn state(&mut self, _: &mut Run<'_>) -> Result<Checkpoint> {
        let written = self.files.written();
        let lines = self.spectra.as_ref().map_or(0, SpectraFile::rows);
        Ok(Checkpoint {
            header: Header::Newtonian {
                step: self.step,
                origin: self.origin,
                progress: self.progress,
                written,
                lines,
            },
            state: Snapshot {
                displacements: Some(self.motion.displacements.clone()),
                ..self.assembly.owned()
            },
            keep: self.scene.keep_checkpoints,
        })
    }
}

/// Attributes of `run.h5/newtonian`.
fn attributes(scene: &Scene, strain: f64, progress: &Progress) -> Vec<(&'static str, Attribute)> {
    let mut attributes = vec![
        ("mean_diameter", scene.sample.mean_diameter.into()),
        ("strain", strain.into()),
        ("image_offset", progress.offset.into()),
    ];
    if let Some(pair) = &progress.pair {
        attributes.extend([
            ("lambda_r", pair.lambda_r.into()),
            ("lambda_i", pair.lambda_i.into()),
            ("omega_r", pair.omega_r.into()),
            ("omega_i", pair.omega_i.into()),
        ]);
    }
    attributes
}

/// Steps between frames: about `wanted`, adjusted to whole periods of the pair plus 1/24 of a
/// period, so that the sequence of frames shows the oscillation in slow motion.
fn strobe(pair: &Pair, wanted: u64, step: f64) -> u64 {
    let period = std::f64::consts::TAU / pair.omega_r / step;
    let whole = (wanted as f64 / period).round();
    ((whole + 1.0 / 24.0) * period).round().max(1.0) as u64
}

/// Two intervals with rows dense enough to resolve the oscillation of the pair.
struct Dense {
    begins: [u64; 2],
    length: u64,
    every: u64,
}

impl Dense {
    /// Their starts as fractions of the stage; the number of periods of the mean square
    /// displacement, π/ω_r, in each; rows per period.
    const BEGINS: [f64; 2] = [0.5, 0.7];
    const PERIODS: f64 = 20.0;
    const ROWS: f64 = 16.0;

    fn new(pair: &Pair, steps: u64, step: f64) -> Self {
        let period = std::f64::consts::PI / pair.omega_r / step;
        let every = ((period / Self::ROWS) as u64).max(1);
        Self {
            begins: Self::BEGINS.map(|part| (part * steps as f64) as u64 / every * every),
            length: (Self::PERIODS * period) as u64,
            every,
        }
    }

    fn due(&self, step: u64) -> bool {
        let of = |begin: u64| {
            let since = step.checked_sub(begin);
            since.is_some_and(|since| since <= self.length && since % self.every == 0)
        };
        self.begins.into_iter().any(of)
    }
}

/// The displacements of the grains since the start of the stage.
struct GrainMotion {
    /// Displacements of the owned grains, in their order.
    displacements: Vec<Displacement>,
    /// Number of rebuilds of the list, at which grains migrate.
    rebuilds: u64,
}

/// Terms of a grain in the sums over all grains.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Moved {
    pub id: u64,
    /// Mean of |Δr|² + R² |Δθ|² (BO eq. 10).
    pub msd: f64,
    pub kinetic_energy: f64,
}

impl GrainMotion {
    fn begin<D: Dimension>(system: &mut System<D>) -> Self {
        let grains = system.grains();
        let of = |g| Displacement::from(&grains.state(g));
        Self {
            displacements: (0..grains.owned).map(of).collect(),
            rebuilds: system.list.rebuilds,
        }
    }

    /// Takes the displacements of all grains, in any distribution over the ranks.
    fn resume<D: Dimension>(
        exchange: &dyn Parallel,
        system: &mut System<D>,
        displacements: &[Displacement],
    ) -> Self {
        let all = gathered(exchange, displacements, |displacement| displacement.id);
        let grains = system.grains();
        let owned = grains.id[..grains.owned].iter();
        Self {
            displacements: owned.map(|&id| all[id as usize]).collect(),
            rebuilds: system.list.rebuilds,
        }
    }

    /// Adds the rotations of the last step.
    fn turn<D: Dimension>(&mut self, exchange: &dyn Parallel, system: &mut System<D>) {
        if self.rebuilds != system.list.rebuilds {
            *self = Self::resume(exchange, system, &self.displacements);
        }
        let step = system.step;
        let grains = system.grains();
        for (g, displacement) in self.displacements.iter_mut().enumerate() {
            let fields = grains.fields(g);
            for k in 0..D::SPINS {
                displacement.angle[k] += step * fields[D::HALF_SPIN + k];
            }
        }
    }

    fn measure<D: Dimension>(&self, exchange: &dyn Parallel, system: &mut System<D>) -> Moved {
        let cell = system.cell;
        let grains = system.grains();
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let moved = |(g, displacement): (usize, &Displacement)| {
            let (fields, radius) = (grains.fields(g), grains.radius[g]);
            let [now, before] = [grains.image[g], displacement.image];
            let crossed = std::array::from_fn(|axis| now[axis] - before[axis]);
            let moved = cell.displacement::<D>(fields, &displacement.start, crossed);
            let velocity = square(&fields[D::VELOCITY..D::VELOCITY + D::AXES]);
            let spin = square(&fields[D::SPIN..D::SPIN + D::SPINS]);
            let motion = velocity + D::INERTIA * radius * radius * spin;
            Moved {
                id: displacement.id.into(),
                msd: square(&moved) + radius * radius * square(&displacement.angle),
                kinetic_energy: 0.5 * grains.mass[g] * motion,
            }
        };
        let owned: Vec<Moved> = self.displacements.iter().enumerate().map(moved).collect();
        let all = gathered(exchange, &owned, |moved| moved.id);
        Moved {
            id: 0,
            msd: all.iter().map(|m| m.msd).sum::<f64>() / all.len() as f64,
            kinetic_energy: all.iter().map(|m| m.kinetic_energy).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use gshear_dem::dimension::Two;
    use gshear_dem::domain::Solo;
    use gshear_dem::laws::Contact;
    use gshear_dem::laws::hooke::{Hooke, Springs};
    use gshear_dem::state::{Cell, GrainState, Masses, Sheared};
    use gshear_dem::system::Setup;

    /// Grains that fly through the box are as far from their start as in free flight.
    #[test]
    fn displacements_go_on_over_the_edges() {
        let springs = Springs {
            normal_stiffness: 1e6,
            tangential_stiffness: 1e6,
            density: 2500.0,
            damping_ratio: 0.1,
            sliding_damping: 0.0,
        };
        let law = Hooke::<Two, false, false>::new(&springs, &Contact::default());
        let sheared = Sheared {
            offset: 3e-3,
            ..Sheared::upright(16e-3)
        };
        let (step, velocity) = (1e-5, [-0.31, 0.23]);
        let setup = Setup::new(
            Cell {
                periods: [20e-3, f64::INFINITY],
                sheared: Some(sheared),
            },
            1e-3,
            Masses::Density(2500.0),
            step,
        );
        let system = System::<Two>::new(&Solo, setup).expect("one rank");
        let mut assembly = Assembly::of(&Solo, &law, system);
        let grain = |id: u32| GrainState {
            id,
            radius: 1e-3,
            position: [3e-3 + 5e-3 * f64::from(id), 4e-3, 0.0],
            velocity: [velocity[0], velocity[1], 0.0],
            ..GrainState::zeroed()
        };
        let grains = (0..3).map(grain).collect();
        (assembly.replace(&mut NoWalls, grains, Vec::new())).expect("a list");
        (assembly.initial_forces(&mut NoWalls, false)).expect("sound forces");
        let mut motion = GrainMotion::begin(&mut assembly.system);
        let mut edges_crossed = 0;
        for k in 1..=10_000 {
            assembly.advance(&mut NoWalls, false, false).expect("sound");
            motion.turn(&Solo, &mut assembly.system);
            if k % 1000 == 0 {
                let time = step * f64::from(k);
                let expected = (velocity[0] * time).hypot(velocity[1] * time).powi(2);
                let found = motion.measure(&Solo, &mut assembly.system).msd;
                assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
                edges_crossed += assembly.system.grain_states()[0].image[0].abs();
            }
        }
        assert!(edges_crossed > 1);
    }
}
