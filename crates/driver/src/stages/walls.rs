//! Runs of scenes between walls: packing, then shear.

use gshear_dem::drive::Piston;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::state::GrainState;
use gshear_scene::insertion::Lattice;
use gshear_scene::schedule::mean_mass;
use gshear_scene::{Load, Origin, PlaneShear, Scene, Sizes};

use super::pack::{Begin, PackStage, falling_drag};
use super::setup::force;
use super::shear::{From, ShearStage};
use super::top_wall::{height_between, mass_of_top};
use crate::header::Header;
use crate::options::Outcome;
use crate::run::{Run, Stage, StageState, Start};
use crate::written::Written;

/// κ from which the whole load is applied to the loose sample at once, for disks and for spheres.
/// At first few grains bear it, each about fifteen times its share in 2D and more in 3D. A softer
/// sample starts with the fraction of the load that gives the same overlaps.
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
        Header::Pack { .. } => {
            let Some((piston, state)) = packed::<D>(run, scene, plane_shear, header, state)? else {
                return Ok(Outcome::Stopped);
            };
            let from = From {
                step: 0,
                height: height_between(scene, plane_shear, &piston),
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
    let mut shear = ShearStage::new(run, scene, plane_shear, law, from, state)?;
    let outcome = run.drive(&mut shear, begins);
    shear.finish(run, outcome)
}

/// The top and the state of the packed sample; `None` if the run was stopped before. Where the loose
/// sample leaves the contact law, it begins again under a lower load.
fn packed<D: LawSpace>(
    run: &mut Run<'_>,
    scene: &Scene,
    plane_shear: &PlaneShear,
    mut header: Header,
    mut state: StageState,
) -> Result<Option<(Piston, StageState)>, Failure> {
    while let Header::Pack {
        step,
        piston,
        drag,
        starts,
        ..
    } = header
    {
        let laws = packing_laws::<D>(scene, plane_shear);
        let begin = Begin {
            step,
            piston,
            drag,
            starts,
        };
        let mut pack = PackStage::new(run, scene, plane_shear, laws, begin, state)?;
        let failure = match run.drive(&mut pack, step == 0) {
            Ok(Outcome::Done) => return Ok(Some(pack.finish(run))),
            Ok(Outcome::Stopped) => return Ok(None),
            Err(failure) => failure,
        };
        let (Some(starts), Origin::Insertion(sizes)) = (pack.next_start(), &plane_shear.origin)
        else {
            return Err(failure);
        };
        run.terminal.packs_again(pack.steps());
        let (height, grains) = inserted(run, scene, sizes);
        (header, state) = loose(run, scene, plane_shear, (height, grains), starts);
    }
    unreachable!("a packing begins with its header")
}

/// The height (m) of the inserted grains, and this rank's part of them.
fn inserted(run: &Run<'_>, scene: &Scene, sizes: &Sizes) -> (f64, Vec<GrainState>) {
    let (rank, size) = (run.exchange.rank(), run.exchange.size());
    let grains = Lattice::new(&scene.sample, sizes).insert(scene.seed, rank, size);
    let top = grains.iter().map(|g| g.position[up(scene)] + g.radius);
    (run.exchange.maximum(top.fold(0.0, f64::max)), grains)
}

/// The first stage of the run, and its state.
fn begin(
    run: &Run<'_>,
    scene: &Scene,
    plane_shear: &PlaneShear,
    start: Start,
) -> Result<(Header, StageState), Failure> {
    let (height, grains) = match (start, &plane_shear.origin) {
        (Start::Checkpoint(snapshot), _) => {
            let header = Header::read(&snapshot)?;
            return Ok((header, StageState::restore(run.exchange, snapshot)));
        }
        (Start::Grains(grains), Origin::Packing { file, .. }) => (file.height(), grains),
        (_, Origin::Packing { .. }) => unreachable!("a packing that was not read"),
        (_, Origin::Insertion(sizes)) => inserted(run, scene, sizes),
    };
    Ok(loose(run, scene, plane_shear, (height, grains), 0))
}

/// The first stage of grains up to this height (m), after so many `starts` of their packing.
fn loose(
    run: &Run<'_>,
    scene: &Scene,
    plane_shear: &PlaneShear,
    (height, grains): (f64, Vec<GrainState>),
    starts: u32,
) -> (Header, StageState) {
    let load = &plane_shear.load;
    let first_load = first_load(scene, load) * 0.25f64.powi(starts as i32);
    let mut piston = Piston {
        height,
        velocity: 0.0,
        acceleration: 0.0,
        // About the mass of the later wall.
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
            height: height_between(scene, plane_shear, &piston),
            written: Written::default(),
            energy_budget: None,
            packing: None,
        }
    } else {
        Header::Pack {
            step: 0,
            piston,
            drag: falling_drag(scene, load, first_load),
            starts,
            packing: None,
        }
    };
    let state = StageState {
        grains,
        ..StageState::default()
    };
    (header, state)
}

/// The laws of grains and of planes during the packing.
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
    // Without friction also no rolling resistance, which gives the densest packing.
    let contact = if pack.friction > 0.0 {
        Contact {
            friction: pack.friction,
            ..scene.contact
        }
    } else {
        smooth
    };
    [force(&law, contact), force(&law, smooth)]
}

/// The axis of the walls' normals.
fn up(scene: &Scene) -> usize {
    scene.dimension.axes() - 1
}

/// The fraction of N with which the packing begins.
fn first_load(scene: &Scene, load: &Load) -> f64 {
    (load.stiffness_number / BEARS_ALL[up(scene) - 1]).min(1.0)
}
