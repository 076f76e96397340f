//! Runs of scenes between walls: packing, then shear.

use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::{Accumulator, FixedPoint};
use gshear_dem::drive::Piston;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::{Contact, Law, LawSpace};
use gshear_dem::state::{GrainState, body};
use gshear_dem::system::{Setup, System};
use gshear_scene::sample::Lattice;
use gshear_scene::schedule::{inertial_time, mean_mass};
use gshear_scene::{Dimensions, Origin, PackingFile, Scene};

use super::pack::PackStage;
use super::shear::{From, ShearStage};
use crate::files::Written;
use crate::header::Header;
use crate::run::{Outcome, Run, StageState, Start};

/// Drag during the compression, and while the sample comes to rest, in inverse inertial times.
const DRAG_FALLING: f64 = 0.01;
pub(super) const DRAG_RESTING: f64 = 1.0;
/// κ from which the whole load is applied to the loose sample at once, for disks and for spheres.
/// At first few grains bear it, each about fifteen times its share in 2D and more in 3D. A softer
/// sample starts with the fraction of the load that gives the same overlaps.
const BEARS_ALL: [f64; 2] = [1e3, 1e4];

/// Runs the scene from `start` to its last step; collective.
///
/// # Errors
/// Numbers that fail, or a file that cannot be written.
pub fn run(run: &mut Run<'_>, scene: &Scene, start: Start) -> Result<Outcome, Failure> {
    run.terminal.header(run.exchange, scene, run.isa);
    match scene.dimension {
        Dimensions::Two => stages::<Two>(run, scene, start),
        Dimensions::Three => stages::<Three>(run, scene, start),
    }
}

fn stages<D: LawSpace>(run: &mut Run<'_>, scene: &Scene, start: Start) -> Result<Outcome, Failure> {
    let (header, state) = begin(run, scene, start)?;
    let (from, state) = match header {
        Header::Pack {
            step, piston, drag, ..
        } => {
            let laws = packing_laws::<D>(scene);
            let mut pack = PackStage::new(run, scene, laws, (step, piston, drag), state)?;
            if run.drive(&mut pack, step == 0)? == Outcome::Stopped {
                return Ok(Outcome::Stopped);
            }
            let (piston, state) = pack.finish(run);
            (first_of_shear(scene, piston), state)
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
    let mut shear = ShearStage::new(run, scene, law, from, state)?;
    let outcome = run.drive(&mut shear, begins)?;
    shear.finish(run, outcome == Outcome::Done)?;
    Ok(outcome)
}

/// The first stage of the run, and its state.
fn begin(run: &Run<'_>, scene: &Scene, start: Start) -> Result<(Header, StageState), Failure> {
    let (height, grains) = match (start, &scene.origin) {
        (Start::Checkpoint(snapshot), _) => {
            let header = Header::read(&snapshot)?;
            return Ok((header, StageState::restore(run.exchange, snapshot)));
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
    let mut piston = at_rest_on_top(scene, height);
    let header = if scene.pack.skip {
        piston.mass = mass_of_top(run, scene, &grains);
        piston.load = scene.load.normal_force;
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
            drag: DRAG_FALLING / inertial_time(scene) * first_load(scene).sqrt(),
            packing: None,
        }
    };
    let state = StageState {
        grains,
        ..StageState::default()
    };
    Ok((header, state))
}

/// The shear stage of the packed sample under this piston.
fn first_of_shear(scene: &Scene, piston: Piston) -> From {
    From {
        step: 0,
        height: height_between(scene, &piston),
        piston,
        slider: None,
        written: None,
        energy_budget: None,
    }
}

/// The laws of grains and of planes during the packing.
fn packing_laws<D: LawSpace>(scene: &Scene) -> [Box<dyn PairForce<D>>; 2] {
    let (sample, load) = (&scene.sample, &scene.load);
    let law = scene.law.while_packing(sample.mean_diameter, load.pressure);
    let smooth = Contact {
        friction: 0.0,
        rolling_friction: 0.0,
        ..scene.contact
    };
    // Without friction also no rolling resistance, which gives the densest packing.
    let contact = match scene.pack.friction > 0.0 {
        true => Contact {
            friction: scene.pack.friction,
            ..scene.contact
        },
        false => smooth,
    };
    [force(&law, contact), force(&law, smooth)]
}

/// The contact law of the scene.
pub(super) fn force<D: LawSpace>(law: &Law, contact: Contact) -> Box<dyn PairForce<D>> {
    D::pair_force(law, &contact).expect("a law of this dimension, as the scene was checked")
}

/// The system of the scene, without its grains.
pub(super) fn system<D: gshear_dem::dimension::Dimension>(
    run: &Run<'_>,
    scene: &Scene,
) -> Result<System<D>, Failure> {
    let sample = &scene.sample;
    let setup = Setup {
        isa: run.isa,
        list: scene.bookkeeping.list,
        cell: sample.cell(),
        largest_radius: sample.radius_max,
        mean_diameter: sample.mean_diameter,
        masses: scene.law.masses(),
        step: scene.time_step.step,
        gravity: scene.load.gravity,
        typical_force: scene.load.normal_force,
        threads: run.options.threads,
    };
    System::new(run.exchange, setup)
}

/// The axis of the walls' normals.
fn up(scene: &Scene) -> usize {
    scene.dimension.axes() - 1
}

/// The fraction of N with which the packing begins.
fn first_load(scene: &Scene) -> f64 {
    (scene.load.stiffness_number / BEARS_ALL[up(scene) - 1]).min(1.0)
}

/// A piston at rest at `height` (m).
fn at_rest_on_top(scene: &Scene, height: f64) -> Piston {
    let sample = &scene.sample;
    Piston {
        height,
        velocity: 0.0,
        acceleration: 0.0,
        // About the mass of the later wall.
        mass: mean_mass(scene) * sample.base() / sample.mean_section(),
        load: scene.load.normal_force * first_load(scene),
    }
}

/// Mass of the top wall (kg; kg/m in 2D), summed over the ranks; collective.
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

/// H (m): distance between the planes at which the walls were cut.
pub(super) fn height_between(scene: &Scene, piston: &Piston) -> f64 {
    piston.height - 2.0 * scene.sample.mean_diameter
}

/// The packing's file, for the header of a checkpoint.
pub(super) fn packing_file(scene: &Scene) -> Option<PackingFile> {
    match &scene.origin {
        Origin::Insertion(_) => None,
        Origin::Packing { file, .. } => Some(file.clone()),
    }
}
