//! The top of a packed sample: a wall, or the images above.

use gshear_dem::boundary::TopMass;
use gshear_dem::domain::{Accumulator, FixedPoint};
use gshear_dem::drive::Piston;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{GrainState, Snapshot, body};
use gshear_scene::schedule::mean_mass;
use gshear_scene::{PlaneShear, Scene};

use crate::run::Run;

/// Mass of the top (kg; kg/m in 2D), summed over the ranks; collective.
///
/// That of the scene, if it gives one, else that of its boundary.
pub(super) fn mass_of_top(
    run: &Run<'_>,
    scene: &Scene,
    plane_shear: &PlaneShear,
    grains: &[GrainState],
    height: f64,
) -> f64 {
    if let Some(mass) = plane_shear.load.wall_mass {
        return mass;
    }
    match plane_shear.boundary.top_mass {
        TopMass::OfItsGrains => mass_of(run, scene, grains, body::TOP),
        TopMass::OfALayer => mass_of_layer(scene),
        TopMass::OfTheCell => {
            let layer = scene.sample.mean_diameter / height;
            mass_of(run, scene, grains, body::FREE) * layer * layer
        }
    }
}

/// Mass of about one layer of grains (kg; kg/m in 2D).
pub(super) fn mass_of_layer(scene: &Scene) -> f64 {
    mean_mass(scene) * scene.sample.base() / scene.sample.mean_section()
}

/// Mass of all grains of a body (kg; kg/m in 2D), summed over the ranks; collective.
pub(super) fn mass_of(run: &Run<'_>, scene: &Scene, grains: &[GrainState], body: u32) -> f64 {
    let of_body = grains.iter().filter(|g| g.body == body);
    let masses = of_body.map(|g| {
        let volume = scene.dimension.volume(g.radius);
        scene.materials.masses.of(g.material, volume)
    });
    total(run, mean_mass(scene), masses)
}

/// Volume (m³; in 2D m²) of all grains, summed over the ranks; collective.
pub(super) fn volume_of_grains(run: &Run<'_>, scene: &Scene, grains: &[GrainState]) -> f64 {
    let volumes = grains.iter().map(|g| scene.dimension.volume(g.radius));
    total(run, scene.sample.mean_volume, volumes)
}

/// The sum over the ranks of terms of this magnitude, in any order; collective.
fn total(run: &Run<'_>, magnitude: f64, terms: impl Iterator<Item = f64>) -> f64 {
    let fixed = FixedPoint::new(magnitude);
    let mut sum = Accumulator::default();
    terms.for_each(|term| fixed.add(&mut sum, term));
    let [sum] = fixed.total(run.exchange, [sum]);
    sum
}

/// Stretches the cell of a packed sample to the solid fraction that the scene asks for, if it does,
/// and the grains with it. Collective.
pub(super) fn stretch(
    run: &Run<'_>,
    plane_shear: &PlaneShear,
    piston: &mut Piston,
    state: &mut Snapshot,
) -> Result<()> {
    let scene = run.scene;
    let Some(wanted) = plane_shear.load.solid_fraction else {
        return Ok(());
    };
    let volume = volume_of_grains(run, scene, &state.grains);
    let height = volume / (scene.sample.base() * wanted);
    if height < piston.height {
        return Err(Failure::numbers(format!(
            "the packed sample has a solid fraction of {:.6}, less than load.solid_fraction = {wanted}; give at most that, or pack it under a greater load",
            volume / (scene.sample.base() * piston.height)
        )));
    }
    let up = scene.dimension.axes() - 1;
    for g in &mut state.grains {
        // Rounding must not move a grain out of the cell.
        g.position[up] = (g.position[up] * (height / piston.height)).min(height.next_down());
    }
    state.contacts.clear();
    piston.height = height;
    Ok(())
}

/// H (m): distance between the planes at which the walls were cut; of a free surface to the plane
/// under which the sample was packed.
pub(super) fn height_between(scene: &Scene, plane_shear: &PlaneShear, piston: &Piston) -> f64 {
    piston.height - plane_shear.thickness_of_walls(&scene.sample)
}
