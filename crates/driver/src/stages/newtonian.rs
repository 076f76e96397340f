//! Newton's equations from the last state at rest: the growth of a complex pair (BO section IV).

use bytemuck::{Pod, Zeroable};

use gshear_dem::clock::StepPhase;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{Displacement, Snapshot};
use gshear_dem::system::System;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::MOST_STEPS;
use gshear_scene::unlikely::intervals_of_newtonian;
use gshear_scene::{QuasiStatic, RunStage, Scene};
use gshear_store::box_columns::NewtonianRow;
use gshear_store::collective::gathered;
use gshear_store::file_names::NEWTONIAN_PART;
use gshear_store::h5::Attribute;
use gshear_store::status::StageProgress;

use super::assembly::Assembly;
use super::eigenvalues::GlobalState;
use super::relax::square;
use super::strain;
use crate::files::{Files, Format, TimePoint};
use crate::header::{Header, NewtonianHeader, StrainProgress, TimeOrigin, UpToCheckpoint};
use crate::options::Outcome;
use crate::output_schedule::{NewtonianSchedule, OutputSchedule};
use crate::run::{Checkpoint, Run};
use crate::stage::{Save, Stage};

/// The stage that integrates Newton's equations of a box.
pub(super) struct NewtonianStage<'a, D: Dimension> {
    scene: &'a Scene,
    assembly: Assembly<'a, D>,
    motion: GrainMotion,
    files: Files,
    /// The progress of the strain steps before.
    progress: StrainProgress,
    step: u64,
    /// From where the time counts.
    origin: TimeOrigin,
    /// Steps of the stages before the strain steps.
    before: u64,
    schedule: NewtonianSchedule,
    /// Shear stress of the last row.
    latest: Option<f64>,
}

impl<'a, D: Dimension> NewtonianStage<'a, D> {
    /// The stage from its start, or as it was stopped, with the displacements up to there.
    pub fn new(
        run: &Run<'a>,
        quasi_static: &QuasiStatic,
        mut assembly: Assembly<'a, D>,
        header: NewtonianHeader,
        displacements: Option<Vec<Displacement>>,
    ) -> Result<Self> {
        let (exchange, scene, time_step) = (run.exchange, run.scene, assembly.system.step);
        let NewtonianHeader {
            step,
            origin,
            before,
            progress,
            ..
        } = header;
        let newtonian = scene.stages.newtonian.expect("a scene with this stage");
        let strain = strain::reached::<D>(quasi_static, &progress);
        let mut schedule = NewtonianSchedule::new(&newtonian, progress.pair.as_ref(), time_step);
        if schedule.steps() > MOST_STEPS {
            let rate = progress.pair.map_or(0.0, |pair| pair.omega_i);
            return Err(Failure::numbers(format!(
                "newtonian: {:.1e} steps are more than the {:.1e} that are counted: the complex pair grows at the rate {rate:.1e} only; give a smaller newtonian.growth_times",
                schedule.steps() as f64,
                MOST_STEPS as f64
            )));
        }
        if let Some(window) = run.options.replay {
            schedule = schedule.restricted_to(window);
        }
        run.terminal.newtonian(schedule.steps(), time_step);
        if let Some(warning) = intervals_of_newtonian(&newtonian, schedule.steps()) {
            run.terminal.warn(warning);
        }
        let format = Format {
            name: NEWTONIAN_PART,
            log_columns: &[],
            columns: &NewtonianRow::COLUMNS,
            attributes: attributes(scene, strain, &progress),
            height: None,
            analysed: None,
            spectra: (schedule.has_spectra()).then(|| origin.time(step, time_step)),
        };
        let files = Files::open(run, &mut assembly, format, UpToCheckpoint::new(step))?;
        let motion = if let Some(displacements) = &displacements {
            GrainMotion::resume(exchange, &mut assembly.system, displacements)
        } else {
            assembly.rebuild()?;
            GrainMotion::begin(&mut assembly.system)
        };
        Ok(Self {
            scene,
            assembly,
            motion,
            files,
            progress,
            step,
            origin,
            before,
            schedule,
            latest: None,
        })
    }

    /// Closes the files; a run that is done is marked as finished.
    pub fn finish(mut self, run: &Run<'_>, outcome: Result<Outcome>) -> Result<Outcome> {
        let (files, outcome) = self.files.unless_failed(run.exchange, outcome)?;
        if outcome == Outcome::Stopped {
            files.finish(run.exchange, outcome, &[])?;
            return Ok(outcome);
        }
        let digest = (self.assembly).digest(&self.progress.box_bytes(), self.step);
        let attributes = [("digest", Attribute::Text(digest.clone()))];
        files.finish(run.exchange, outcome, &attributes)?;
        run.terminal.moved(&digest, &run.options.out);
        Ok(outcome)
    }

    /// Measures a row of the time series and writes it. Collective.
    fn write_row(&mut self, exchange: &dyn Parallel, at: TimePoint) -> Result<()> {
        let observed = self.assembly.observe(self.scene.sample.grains);
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
        self.files.row(exchange, at, &row)
    }
}

impl<'a, D: Dimension> Stage<'a, D> for NewtonianStage<'a, D> {
    fn name(&self) -> &'static str {
        RunStage::Newtonian.name()
    }

    fn completed(&self) -> u64 {
        self.step
    }

    /// Newton's equations follow the strain steps.
    fn count(&self) -> Option<u64> {
        Some(self.before + self.progress.steps + self.step + 1)
    }

    fn files(&mut self) -> Option<&mut Files> {
        Some(&mut self.files)
    }

    fn is_done(&self) -> bool {
        self.step >= self.schedule.steps()
    }

    fn keeps_start(&self) -> bool {
        true
    }

    fn begin(&mut self) -> Result<()> {
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
        let exchange = run.exchange;
        let due = self.schedule.due(self.step);
        let at = TimePoint {
            step: self.step,
            time: self.origin.time(self.step, self.assembly.system.step),
        };
        if due.row {
            self.write_row(exchange, at)?;
        } else if due.frame {
            // The frame holds the forces of this measurement.
            self.assembly.observe(self.scene.sample.grains);
        }
        self.files.frame(&mut self.assembly, due, at, 0.0)?;
        if self.schedule.spectrum_due(self.step) {
            let state = GlobalState::moving(&mut self.assembly);
            let eigenvalues = state.eigenvalues(&self.assembly)?;
            self.files.spectrum(exchange, at.time, &eigenvalues)?;
        }
        self.assembly.system.clock.end(StepPhase::Output);
        Ok(())
    }

    fn save_due(&self) -> Save {
        Save::after(self.step, self.is_done())
    }

    fn state(&mut self, _: &mut Run<'_>) -> Result<Checkpoint> {
        Ok(Checkpoint {
            header: Header::Newtonian(NewtonianHeader {
                step: self.step,
                origin: self.origin,
                before: self.before,
                progress: self.progress,
                written: self.files.written(),
                lines: self.files.spectra_lines(),
            }),
            state: Snapshot {
                displacements: Some(self.motion.displacements.clone()),
                ..self.assembly.owned()
            },
            keep: self.scene.keep_checkpoints,
        })
    }

    fn progress(&self) -> StageProgress {
        StageProgress {
            stage: self.name().into(),
            step: self.step,
            steps: Some(self.schedule.steps()),
            shear_stress: self.latest,
            moving: Some(self.scene.sample.grains),
            ..StageProgress::default()
        }
    }
}

/// Attributes of `run.h5/newtonian`.
fn attributes(
    scene: &Scene,
    strain: f64,
    progress: &StrainProgress,
) -> Vec<(&'static str, Attribute)> {
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
pub(super) struct MotionTerms {
    pub id: u64,
    /// Mean of |Δr|² + R² |Δθ|² (BO eq. 10).
    pub msd: f64,
    pub kinetic_energy: f64,
}

impl GrainMotion {
    fn begin<D: Dimension>(system: &mut System<D>) -> Self {
        let grains = system.grains();
        let owned = 0..grains.owned;
        Self {
            displacements: owned
                .map(|g| Displacement::from(&grains.state(g)))
                .collect(),
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

    fn measure<D: Dimension>(
        &self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
    ) -> MotionTerms {
        let cell = system.cell;
        let grains = system.grains();
        let mut owned = Vec::with_capacity(self.displacements.len());
        for (g, displacement) in self.displacements.iter().enumerate() {
            let (fields, radius) = (grains.fields(g), grains.radius[g]);
            let [now, before] = [grains.image[g], displacement.image];
            let crossed = std::array::from_fn(|axis| now[axis] - before[axis]);
            let moved = cell.displacement::<D>(fields, &displacement.start, crossed);
            let velocity = square(&fields[D::VELOCITY..D::VELOCITY + D::AXES]);
            let spin = square(&fields[D::SPIN..D::SPIN + D::SPINS]);
            let motion = velocity + D::INERTIA * radius * radius * spin;
            owned.push(MotionTerms {
                id: displacement.id.into(),
                msd: square(&moved) + radius * radius * square(&displacement.angle),
                kinetic_energy: 0.5 * grains.mass[g] * motion,
            });
        }
        let all = gathered(exchange, &owned, |moved| moved.id);
        MotionTerms {
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
            ageing: None,
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
