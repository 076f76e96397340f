//! The top of a packed sample: a wall, or the images above.

use gshear_dem::domain::{Accumulator, FixedPoint};
use gshear_dem::drive::Piston;
use gshear_dem::state::{GrainState, body};
use gshear_scene::schedule::mean_mass;
use gshear_scene::{PlaneShear, Scene};

use crate::run::Run;

/// Mass of the top (kg; kg/m in 2D), summed over the ranks; collective.
///
/// That of a wall is the mass of its grains. Images above a cell of height h get that of all grains
/// times (d̄/h)²: as the cell is stretched through all layers, its frequency is then about that of
/// a contact, which the time step resolves and the dampers of the contacts damp.
pub(super) fn mass_of_top(
    run: &Run<'_>,
    scene: &Scene,
    plane_shear: &PlaneShear,
    (grains, height): (&[GrainState], f64),
) -> f64 {
    if plane_shear.has_images() {
        let layer = scene.sample.mean_diameter / height;
        mass_of(run, scene, grains, body::FREE) * layer * layer
    } else {
        mass_of(run, scene, grains, body::TOP)
    }
}

/// Mass of all grains of a body (kg; kg/m in 2D), summed over the ranks; collective.
pub(super) fn mass_of(run: &Run<'_>, scene: &Scene, grains: &[GrainState], body: u32) -> f64 {
    let masses = FixedPoint::new(mean_mass(scene));
    let mut mass = Accumulator::default();
    for g in grains.iter().filter(|g| g.body == body) {
        let volume = scene.dimension.volume(g.radius);
        masses.add(&mut mass, scene.materials.masses.of(g.material, volume));
    }
    let [mass] = masses.total(run.exchange, [mass]);
    mass
}

/// H (m): distance between the planes at which the walls were cut.
pub(super) fn height_between(scene: &Scene, plane_shear: &PlaneShear, piston: &Piston) -> f64 {
    piston.height - 2.0 * plane_shear.wall_thickness(&scene.sample)
}
