//! A scene between walls: packed, then sheared.

use gshear_dem::domain::{Accumulator, FixedPoint};
use gshear_dem::drive::Piston;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::state::{GrainState, body};
use gshear_scene::sample::Lattice;
use gshear_scene::schedule::{inertial_time, mean_mass};
use gshear_scene::{Load, Origin, PlaneShear, Scene};

use super::pack::Pack;
use super::setup::force;
use super::shear::{From, Shear};
use crate::files::Written;
use crate::header::Header;
use crate::run::{Outcome, Run, Start, State};

/// Drag of the compression, and of the rest after it, in inverse inertial times.
const DRAG_FALLING: f64 = 0.01;
pub(super) const DRAG_RESTING: f64 = 1.0;
/// κ from which on the loose sample bears the whole load at once, of disks and of spheres. At first a
/// few grains carry all of it, some fifteen times their share, and more in space; a softer sample
/// begins with the part of the load that overlaps them no more.
const BEARS_ALL: [f64; 2] = [1e3, 1e4];

/// Runs the scene from `start` to its last step; collective.
///
/// # Errors
/// Numbers that fail, or a file that cannot be written.
pub fn run<D: LawSpace>(
    run: &mut Run<'_>,
    scene: &Scene,
    plane_shear: &PlaneShear,
    start: Start,
) -> Result<Outcome, Failure> {
    let (header, state) = begin(run, scene, plane_shear, start)?;
    let (from, state) = match header {
        Header::Pack {
            step, piston, drag, ..
        } => {
            let laws = packing_laws::<D>(scene, plane_shear);
            let begin = (step, piston, drag);
            let mut pack = Pack::new(run, scene, plane_shear, laws, begin, state)?;
            if run.drive(&mut pack, step == 0)? == Outcome::Stopped {
                return Ok(Outcome::Stopped);
            }
            let (piston, state) = pack.finish(run);
            let from = From {
                step: 0,
                height: height_between(scene, &piston),
                piston,
                slider: None,
                written: None,
                energy_budget: None,
            };
            (from, state)
        }
        Header::Shear {
            step,
            piston,
            slider,
            height,
            written,
            energy_budget,
            ..
        } => {
            let from = From {
                step,
                height,
                piston,
                slider,
                written: Some(written),
                energy_budget,
            };
            (from, state)
        }
        Header::Aqs { .. } | Header::Newtonian { .. } => {
            return Err(Failure::input(
                "the checkpoint is of a periodic box, and its scene has none",
            ));
        }
    };
    let law = force::<D>(&scene.law, scene.contact);
    let begins = from.step == 0;
    let mut shear = Shear::new(run, scene, plane_shear, law, from, state)?;
    let outcome = run.drive(&mut shear, begins)?;
    shear.finish(run, outcome == Outcome::Done)?;
    Ok(outcome)
}

/// The stage with which the run begins, and its state.
fn begin(
    run: &Run<'_>,
    scene: &Scene,
    plane_shear: &PlaneShear,
    start: Start,
) -> Result<(Header, State), Failure> {
    let load = &plane_shear.load;
    let (height, grains) = match (start, &plane_shear.origin) {
        (Start::Checkpoint(snapshot), _) => {
            let header = Header::read(&snapshot)?;
            return Ok((header, State::restore(run.exchange, snapshot)));
        }
        (Start::Grains(grains), Origin::Packing { file, .. }) => (file.height(), grains),
        (_, Origin::Packing { .. }) => unreachable!("a packing that was not read"),
        (_, Origin::Insertion(sizes)) => {
            let (rank, size) = (run.exchange.rank(), run.exchange.size());
            let grains = Lattice::new(&scene.sample, sizes).insert(scene.seed, rank, size);
            let top = grains.iter().map(|g| g.position[up(scene)] + g.radius);
            (run.exchange.maximum(top.fold(0.0, f64::max)), grains)
        }
    };
    let first_load = first_load(scene, load);
    let mut piston = Piston {
        height,
        velocity: 0.0,
        acceleration: 0.0,
        // About that of the wall to come.
        mass: mean_mass(scene) * scene.sample.base() / scene.sample.mean_section(),
        load: load.normal_force * first_load,
    };
    let header = if plane_shear.pack.skip {
        piston.mass = mass_of_top(run, scene, &grains);
        piston.load = load.normal_force;
        Header::Shear {
            step: 0,
            piston,
            slider: None,
            height: height_between(scene, &piston),
            written: Written::default(),
            energy_budget: None,
            packing: None,
        }
    } else {
        Header::Pack {
            step: 0,
            piston,
            drag: DRAG_FALLING / inertial_time(scene, load) * first_load.sqrt(),
            packing: None,
        }
    };
    let state = State {
        grains,
        ..State::default()
    };
    Ok((header, state))
}

/// The laws of the grains and of the planes while the sample is packed.
fn packing_laws<D: LawSpace>(
    scene: &Scene,
    plane_shear: &PlaneShear,
) -> [Box<dyn PairForce<D>>; 2] {
    let PlaneShear { load, pack, .. } = plane_shear;
    let diameter = scene.sample.mean_diameter;
    let law = scene.law.while_packing(diameter, load.pressure);
    let smooth = Contact {
        friction: 0.0,
        rolling_friction: 0.0,
        ..scene.contact
    };
    // Without friction there is no rolling resistance either: it packs densest.
    let contact = match pack.friction > 0.0 {
        true => Contact {
            friction: pack.friction,
            ..scene.contact
        },
        false => smooth,
    };
    [force(&law, contact), force(&law, smooth)]
}

/// The axis of the walls' normals.
fn up(scene: &Scene) -> usize {
    scene.dimension.axes() - 1
}

/// The part of N with which the packing begins.
fn first_load(scene: &Scene, load: &Load) -> f64 {
    (load.stiffness_number / BEARS_ALL[up(scene) - 1]).min(1.0)
}

/// Mass of the top wall (kg; kg/m in 2D), of which each rank has a part; collective.
pub(super) fn mass_of_top(run: &Run<'_>, scene: &Scene, grains: &[GrainState]) -> f64 {
    let masses = FixedPoint::new(mean_mass(scene));
    let mut mass = Accumulator::default();
    let of_grain = scene.law.masses();
    for g in grains.iter().filter(|g| g.body == body::TOP) {
        let volume = scene.dimension.volume(g.radius);
        masses.add(&mut mass, of_grain.of(volume));
    }
    let [mass] = masses.total(run.exchange, [mass]);
    mass
}

/// H (m), between the planes at which the walls end.
pub(super) fn height_between(scene: &Scene, piston: &Piston) -> f64 {
    piston.height - 2.0 * scene.sample.mean_diameter
}
