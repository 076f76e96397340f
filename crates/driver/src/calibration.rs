//! Short measurements on this machine, of lattices of equal grains: the speed of the steps and the
//! time of a strain step, for what a run will take.

use std::cell::OnceCell;
use std::time::Instant;

use bytemuck::Zeroable;

use gshear_dem::dimension::{Three, Two};
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Result;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::LawSpace;
use gshear_dem::state::{Cell, GrainState, Sheared};
use gshear_mpi_exchange::Parallel;
use gshear_scene::{Deformation, Dimensions, Method, Sample, Scene};

use crate::estimate::{StrainStepTime, index};
use crate::launch::Task;
use crate::options::{Options, Verbosity};
use crate::run::Run;
use crate::stages::assembly::{Assembly, system};
use crate::stages::prepare::share_of;
use crate::stages::relax;

/// Speed of all ranks together (grain-steps/s), measured within a second; `None` if the law does
/// not hold on the lattice. Collective.
///
/// # Errors
/// More ranks than the sample has room for.
pub(crate) fn speed(
    exchange: &dyn Parallel,
    task: &Task,
    options: &Options,
) -> Result<Option<f64>> {
    measured(
        exchange,
        task,
        options,
        Measurement {
            disks: speed_on_a_lattice::<Two>,
            spheres: speed_on_a_lattice::<Three>,
        },
    )
}

/// Times of the strain steps of a box, roughly, measured within seconds; `None` for other
/// scenes, and if the equilibrium is not found by Newton's method. Collective.
///
/// # Errors
/// More ranks than the sample has room for.
pub(crate) fn strain_step(
    exchange: &dyn Parallel,
    task: &Task,
    options: &Options,
) -> Result<Option<StrainStepTime>> {
    match &task.scene.stages.strain {
        Some(quasi_static) if quasi_static.relax.method == Method::Newton => {
            let measurement = Measurement {
                disks: strain_step_on_lattices::<Two>,
                spheres: strain_step_on_lattices::<Three>,
            };
            measured(exchange, task, options, measurement)
        }
        _ => Ok(None),
    }
}

/// Grains of the lattice on a rank, at most; more are as fast.
const MOST_GRAINS: u32 = 100_000;
/// Time of the measurement (s), about.
const MEASURED: f64 = 0.4;

/// What is measured of a scene.
struct Measurement<T> {
    disks: fn(&Run<'_>) -> Result<T>,
    spheres: fn(&Run<'_>) -> Result<T>,
}

/// What a measurement finds, in a run that says nothing and writes nothing, on
/// all ranks; `None` if it failed on one, as where the law does not hold on the lattice. Refuses
/// more ranks than the sample has room for. Collective.
fn measured<T>(
    exchange: &dyn Parallel,
    task: &Task,
    options: &Options,
    measurement: Measurement<T>,
) -> Result<Option<T>> {
    let scene = &task.scene;
    let options = Options {
        verbosity: Verbosity::Quiet,
        ..options.clone()
    };
    let later = OnceCell::new();
    let run = Run::new(exchange, scene, &later, task.record.clone(), &options)?;
    let cell = scene.cell();
    let result = match scene.dimension {
        Dimensions::Two => {
            system::<Two>(&run, scene, cell)?;
            (measurement.disks)(&run)
        }
        Dimensions::Three => {
            system::<Three>(&run, scene, cell)?;
            (measurement.spheres)(&run)
        }
    };
    let failed = exchange.maximum(f64::from(u8::from(result.is_err()))) > 0.0;
    Ok(if failed { None } else { result.ok() })
}

/// A lattice of equal grains at rest.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    /// Grains along x, y and the last axis; one along y in two dimensions.
    grains: [u32; 3],
    /// Distances along these axes (m).
    spacing: [f64; 3],
}

impl Lattice {
    /// A lattice of about so many grains, each of which touches its neighbours along all axes.
    fn dense<D: LawSpace>(run: &Run<'_>, grains: u32) -> Self {
        let (exchange, scene) = (run.exchange, run.scene);
        let side = f64::from(grains).powf(1.0 / D::AXES as f64).round() as u32;
        // A grain must not meet its own images, nor a slab be narrower than the cutoff.
        let side = side.max(4);
        let along = side.max(3 * exchange.size() as u32);
        let touching = scene.sample.mean_diameter * (1.0 - overlap(scene));
        Self {
            grains: match D::AXES {
                2 => [along, 1, side],
                _ => [along, side, side],
            },
            spacing: [touching; 3],
        }
    }

    fn count(&self) -> u32 {
        self.grains.iter().product()
    }

    /// The lattice in a periodic cell, with its forces.
    fn assembly<'a, D: LawSpace>(
        &self,
        run: &Run<'a>,
        law: &'a dyn PairForce<D>,
    ) -> Result<Assembly<'a, D>> {
        let (exchange, scene) = (run.exchange, run.scene);
        let diameter = scene.sample.mean_diameter;
        let [_, across, up] = self.grains;
        let lengths: [f64; 3] =
            std::array::from_fn(|k| f64::from(self.grains[k]) * self.spacing[k]);
        let planar = D::AXES == 2;
        let cell = Cell {
            periods: [lengths[0], if planar { f64::INFINITY } else { lengths[1] }],
            sheared: Some(Sheared::upright(lengths[2])),
        };
        let equal = Scene {
            sample: Sample {
                radius_min: 0.5 * diameter,
                radius_max: 0.5 * diameter,
                ..scene.sample
            },
            ..scene.clone()
        };
        let mut grains = Vec::new();
        for id in share_of(self.count(), exchange.rank(), exchange.size()) {
            let at = [id / (across * up), id / up % across, id % up].map(|k| f64::from(k) + 0.5);
            let mut position = [0.0; 3];
            position[0] = at[0] * self.spacing[0];
            position[D::UP] = at[2] * self.spacing[2];
            if !planar {
                position[1] = at[1] * self.spacing[1];
            }
            grains.push(GrainState {
                id,
                position,
                radius: 0.5 * diameter,
                ..GrainState::zeroed()
            });
        }
        let mut assembly = Assembly::new(run, &equal, cell, law)?;
        // Nothing holds a periodic lattice: it would fall.
        assembly.system.gravity = [0.0; 2];
        assembly.replace(&mut NoWalls, grains, Vec::new())?;
        assembly.initial_forces(&mut NoWalls, false)?;
        Ok(assembly)
    }
}

/// Overlap over d̄ of the grains of a lattice.
fn overlap(scene: &Scene) -> f64 {
    match scene.shear() {
        Some(shear) => (1.0 / shear.load.stiffness_number).min(0.01),
        None => 0.01,
    }
}

/// Time in which all ranks have done this (s). Collective.
fn timed(exchange: &dyn Parallel, measured: impl FnOnce() -> Result<()>) -> Result<f64> {
    exchange.barrier();
    let begun = Instant::now();
    measured()?;
    Ok(exchange.maximum(begun.elapsed().as_secs_f64()))
}

/// Speed of all ranks together (grain-steps/s) on a lattice of equal grains, two or three of whose
/// neighbours each touch, as in a packing. Collective.
fn speed_on_a_lattice<D: LawSpace>(run: &Run<'_>) -> Result<f64> {
    let (exchange, scene) = (run.exchange, run.scene);
    let sample = &scene.sample;
    let diameter = sample.mean_diameter;
    let (touching, near) = (diameter * (1.0 - overlap(scene)), 1.001 * diameter);
    let count = sample
        .grains
        .min(MOST_GRAINS.saturating_mul(exchange.size() as u32));
    let along = ((sample.length / touching) as u32).max(8);
    let across = match D::AXES {
        2 => 1,
        _ => ((sample.width / near) as u32).max(4),
    };
    let up = (count / along / across).max(8);
    let lattice = Lattice {
        grains: [along, across, up],
        spacing: [touching, near, touching],
    };
    let law = scene.force::<D>();
    let mut assembly = lattice.assembly(run, law.as_ref())?;
    // The first steps fill the caches.
    timed_steps(&mut assembly, 3)?;
    let one = timed_steps(&mut assembly, 3)? / 3.0;
    let many = ((MEASURED / one) as u64).clamp(3, 1_000_000);
    let seconds = timed_steps(&mut assembly, many)?;
    Ok(f64::from(lattice.count()) * many as f64 / seconds)
}

/// Time of so many steps (s). Collective.
fn timed_steps<D: LawSpace>(assembly: &mut Assembly<'_, D>, steps: u64) -> Result<f64> {
    timed(assembly.exchange, || {
        for _ in 0..steps {
            assembly.advance(&mut NoWalls, false, false)?;
        }
        Ok(())
    })
}

/// Factorisations of K, each with its solves, in a relaxation by Newton's method.
const FACTORISATIONS: f64 = 2.0;
/// Relaxations in a strain step of simple or pure shear, of a biaxial box or another that controls
/// stresses, and of a compression.
const RELAXATIONS: [f64; 3] = [1.0, 4.0, 15.0];
/// Time of a measurement of Newton's method after which larger lattices are extrapolated to (s).
const LONG: f64 = 0.3;
/// Grains of the first lattice, and of that whose eigenvalues are found.
const FEW: u32 = 100;
/// Powers of the number of grains that the time of a factorisation grows by, of disks and of
/// spheres: nested dissection of a network in two and in three dimensions.
const FACTORISATION_POWER: [f64; 2] = [1.5, 2.0];

/// Times of a strain step and of its relaxations: those of their factorisations of K and, if the
/// scene asks for them, of all eigenvalues, of lattices in which every grain touches as many others
/// as in a packing. Collective.
fn strain_step_on_lattices<D: LawSpace>(run: &Run<'_>) -> Result<StrainStepTime> {
    let (exchange, scene) = (run.exchange, run.scene);
    let quasi_static = scene.stages.strain.as_ref();
    let quasi_static = quasi_static.expect("a scene with strain steps");
    let all = scene.sample.grains;
    let law = scene.force::<D>();
    let law = law.as_ref();
    let mut grains = all.min(FEW);
    let relaxation = loop {
        let lattice = Lattice::dense::<D>(run, grains);
        let mut assembly = lattice.assembly(run, law)?;
        let seconds = timed(exchange, || relax::factor_once(&mut assembly))?;
        let larger = f64::from(all) / f64::from(lattice.count());
        if grains == all || seconds > LONG {
            let power = FACTORISATION_POWER[index(scene)];
            break seconds * larger.max(1.0).powf(power);
        }
        grains = all.min(grains.saturating_mul(4));
    };
    let relaxations = match &quasi_static.deformation {
        Deformation::SimpleShear | Deformation::PureShear => RELAXATIONS[0],
        Deformation::Biaxial => RELAXATIONS[1],
        Deformation::Compression(_) => RELAXATIONS[2],
        Deformation::Protocol(parts) => {
            let mut all = 0.0;
            for part in parts {
                let is_controlled = part.controls().next().is_some();
                all += part.steps as f64 * RELAXATIONS[usize::from(is_controlled)];
            }
            all / quasi_static.aqs.steps.max(1) as f64
        }
    };
    let relaxation = FACTORISATIONS * relaxation;
    let mut step = relaxations * relaxation;
    if quasi_static.aqs.spectrum {
        let lattice = Lattice::dense::<D>(run, all.min(FEW));
        let mut assembly = lattice.assembly(run, law)?;
        let one = timed(exchange, || assembly.eigenvalues().map(drop))?;
        let larger = f64::from(all) / f64::from(lattice.count());
        step += one * larger.powi(3);
    }
    Ok(StrainStepTime { step, relaxation })
}
