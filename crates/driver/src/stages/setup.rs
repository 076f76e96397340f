//! What a stage of any scene is made of: its system.

use gshear_dem::dimension::Dimension;
use gshear_dem::failure::Failure;
use gshear_dem::state::Cell;
use gshear_dem::system::{Setup, System};
use gshear_scene::{Boundary, Scene};

use crate::run::Run;

/// The system of the scene in a cell, without its grains.
pub(crate) fn system<D: Dimension>(
    run: &Run<'_>,
    scene: &Scene,
    cell: Cell,
) -> Result<System<D>, Failure> {
    let sample = &scene.sample;
    let (gravity, typical_force) = match &scene.boundary {
        Boundary::Walls(plane_shear) => {
            let load = &plane_shear.load;
            (load.gravity_components(), load.normal_force)
        }
        Boundary::Periodic(_) => {
            let radius = 0.5 * sample.mean_diameter;
            let overlap = 0.01 * sample.mean_diameter;
            let stiffness = scene.law.normal_stiffness(radius, radius, overlap);
            ([0.0; 2], stiffness * overlap)
        }
    };
    let setup = Setup {
        isa: run.isa,
        list: scene.bookkeeping.list,
        cell,
        largest_radius: sample.radius_max,
        mean_diameter: sample.mean_diameter,
        masses: scene.materials.masses.clone(),
        step: scene.time_step.step,
        gravity,
        typical_force,
        threads: run.options.threads,
    };
    let mut system = System::new(run.exchange, setup)?;
    if let Some(file) = scene.packing() {
        system.ids = file.ids.clone();
    }
    Ok(system)
}
