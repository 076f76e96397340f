//! Shear at a rate: packing, if the sample comes loose, then shear.

use gshear_dem::drive::Piston;
use gshear_dem::failure::Result;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::{Contact, Law, LawSpace};
use gshear_dem::state::{GrainState, HeldState, Snapshot};
use gshear_scene::insertion::Lattice;
use gshear_scene::schedule::Schedule;
use gshear_scene::{Load, Origin, PlaneShear, RunStage, Scene, Sizes};
use gshear_store::checkpoint;

use super::pack::{PackStage, falling_drag};
use super::shear::{ShearStage, Sheared};
use super::top_wall::{height_between, mass_of_layer, mass_of_top, stretch};
use crate::header::{Header, PackHeader, ShearHeader, TimeOrigin, Written};
use crate::options::Outcome;
use crate::run::Run;
use crate::stage::Stage;
use crate::task::{LeftState, StageEnd, Start};

/// κ from which the whole load is applied to the loose sample at once, for disks and for spheres.
/// At first few grains bear it, each about fifteen times its share in 2D and more in 3D. A softer
/// sample starts with the fraction of the load that gives the same overlaps.
const BEARS_ALL: [f64; 2] = [1e3, 1e4];

/// Runs the shear from `start` to its last step; collective.
///
/// # Errors
/// Numbers that fail, or a file that cannot be written.
pub(super) fn run<D: LawSpace>(run: &mut Run<'_>, start: Start) -> Result<StageEnd> {
    let plane_shear = run.scene.plane_shear("the scene")?;
    let (header, state) = begin(run, plane_shear, start)?;
    let (from, state) = match header {
        Header::Pack(header) => match packed::<D>(run, plane_shear, header, state)? {
            Some(packed) => packed,
            None => return Ok(StageEnd::Stopped),
        },
        Header::Shear(header) => (header, state),
        Header::Prepare(_) | Header::Strain(_) | Header::Newtonian(_) => {
            unreachable!("a checkpoint of this stage, as was checked")
        }
    };
    let law = run.scene.force::<D>();
    let (begins, before) = (from.step == 0, from.before);
    let mut shear = ShearStage::new(run, plane_shear, law.as_ref(), from, state)?;
    let outcome = run.drive(&mut shear, begins);
    let Sheared {
        mut assembly,
        steps,
        outcome,
    } = shear.finish(run, outcome)?;
    if outcome == Outcome::Stopped {
        return Ok(StageEnd::Stopped);
    }
    let stage = RunStage::Shear;
    if run.scene.stages.after(stage).is_empty() {
        return Ok(StageEnd::Last);
    }
    Ok(StageEnd::Left(Box::new(LeftState {
        stage,
        steps,
        counted: before + steps,
        cell: assembly.system.cell,
        state: assembly.snapshot(),
    })))
}

/// The shear of the packed sample, and its state; `None` if the run was stopped before. Where the
/// loose sample leaves the contact law, it begins again under a lower load.
fn packed<D: LawSpace>(
    run: &mut Run<'_>,
    plane_shear: &PlaneShear,
    mut header: PackHeader,
    mut state: Snapshot,
) -> Result<Option<(ShearHeader, Snapshot)>> {
    let scene = run.scene;
    loop {
        let begins = header.step == 0;
        let [law, plane] = packing_laws::<D>(scene, plane_shear);
        let mut pack = PackStage::new(run, plane_shear, law.as_ref(), plane, header, state)?;
        let failure = match run.drive(&mut pack, begins) {
            Ok(Outcome::Done) => {
                let (mut piston, mut state) = pack.finish(run);
                stretch(run, plane_shear, &mut piston, &mut state)?;
                let header = sheared_from(scene, plane_shear, piston);
                return Ok(Some((header, state)));
            }
            Ok(Outcome::Stopped) => return Ok(None),
            Err(failure) => failure,
        };
        let (Some(starts), Origin::Insertion(sizes)) = (pack.next_start(), &plane_shear.origin)
        else {
            return Err(failure);
        };
        run.terminal.packs_again(pack.completed());
        let (height, grains) = inserted(run, sizes);
        header = falling(scene, plane_shear, height, starts);
        state = of_grains(grains);
    }
}

/// The height (m) of the inserted grains, and this rank's part of them.
fn inserted(run: &Run<'_>, sizes: &Sizes) -> (f64, Vec<GrainState>) {
    let (scene, rank, size) = (run.scene, run.exchange.rank(), run.exchange.size());
    let mut grains = Lattice::new(scene.seed, &scene.sample, sizes).insert(rank, size);
    (scene.materials).give(scene.seed, scene.sample.radius_max, &mut grains);
    let top = grains.iter().map(|g| g.position[up(scene)] + g.radius);
    (run.exchange.maximum(top.fold(0.0, f64::max)), grains)
}

/// The first stage of the run, and its state.
fn begin(run: &Run<'_>, plane_shear: &PlaneShear, start: Start) -> Result<(Header, Snapshot)> {
    let scene = run.scene;
    let (height, state) = match (start, &plane_shear.origin) {
        (Start::Checkpoint(mut saved, before), _) => {
            checkpoint::to_both_holders(run.exchange, &mut saved.state);
            if let Some(before) = &before {
                take_changes(run, before, &mut saved.header, &saved.state.grains)?;
            }
            return Ok((saved.header, saved.state));
        }
        (Start::StageBefore(left), _) => return Ok(after_strain(run, plane_shear, *left)),
        (Start::Packing(state), Origin::Packing(file)) => (file.height(), state),
        (_, Origin::Insertion(sizes)) => {
            let (height, grains) = inserted(run, sizes);
            (
                height,
                HeldState {
                    grains,
                    contacts: Vec::new(),
                },
            )
        }
        (_, Origin::Packing(_) | Origin::StageBefore { .. }) => {
            unreachable!("grains that were not read")
        }
    };
    let mut header = falling(scene, plane_shear, height, 0);
    let HeldState { grains, contacts } = state;
    let mut state = Snapshot {
        contacts,
        ..of_grains(grains)
    };
    let header = if plane_shear.pack.skip {
        header.piston.mass = mass_of_top(run, scene, plane_shear, &state.grains, height);
        header.piston.load = plane_shear.load.normal_force;
        stretch(run, plane_shear, &mut header.piston, &mut state)?;
        Header::Shear(sheared_from(scene, plane_shear, header.piston))
    } else {
        Header::Pack(header)
    };
    Ok((header, state))
}

/// The shear of a sample that strain steps have left in its cell. Collective.
fn after_strain(run: &Run<'_>, plane_shear: &PlaneShear, left: LeftState) -> (Header, Snapshot) {
    let LeftState {
        counted,
        cell,
        state,
        ..
    } = left;
    let scene = run.scene;
    let sheared = cell.sheared.expect("strain steps are those of a cell");
    let height = sheared.height;
    let piston = Piston {
        height,
        velocity: 0.0,
        acceleration: 0.0,
        mass: mass_of_top(run, scene, plane_shear, &state.grains, height),
        load: plane_shear.load.normal_force,
    };
    let width = if scene.sample.width.is_finite() {
        scene.sample.width
    } else {
        1.0
    };
    let header = ShearHeader {
        before: counted,
        left_in: Some([scene.sample.length, width, height]),
        images: Some([sheared.offset, 0.0]),
        ..sheared_from(scene, plane_shear, piston)
    };
    (Header::Shear(header), state)
}

/// Gives a branch what its changes mean for the top: its mass, by the densities, and where its
/// drive is, if it has no spring any more. The energy budget begins anew with other contacts or
/// masses. Collective.
fn take_changes(
    run: &Run<'_>,
    before: &Scene,
    header: &mut Header,
    grains: &[GrainState],
) -> Result<()> {
    let now = run.scene;
    let (former, walls) = (before.plane_shear("")?, now.plane_shear("")?);
    let is_heavier = before.materials.masses != now.materials.masses;
    match header {
        Header::Pack(pack) if is_heavier => {
            pack.piston.mass *= mass_of_layer(now) / mass_of_layer(before);
        }
        Header::Shear(shear) => {
            if before.materials != now.materials {
                shear.energy_budget = None;
            }
            let mut slider = shear.slider;
            if is_heavier || former.load.wall_mass != walls.load.wall_mass {
                let height = shear.height;
                let times = mass_of_top(run, now, walls, grains, height)
                    / mass_of_top(run, before, former, grains, height);
                shear.piston.mass *= times;
                shear.piston.acceleration /= times;
                if let Some(slider) = &mut slider {
                    slider.acceleration /= times;
                }
                let lateral = shear.lateral.iter_mut();
                for axis in lateral.flat_map(|lateral| &mut lateral.axes) {
                    axis.mass *= times;
                    axis.acceleration /= times;
                }
            }
            if let Some(slider) = &mut slider
                && former.shear.spring.is_some()
                && walls.shear.spring.is_none()
            {
                let schedule = Schedule::new(now, walls, shear.height);
                let protocol = shear.with_ends(schedule).protocol;
                slider.pulled = slider.displacement - protocol.position(slider.step);
            }
            shear.slider = slider;
        }
        _ => {}
    }
    Ok(())
}

fn of_grains(grains: Vec<GrainState>) -> Snapshot {
    Snapshot {
        grains,
        ..Snapshot::default()
    }
}

/// The packing of grains up to this height (m), after so many `starts` of it.
fn falling(scene: &Scene, plane_shear: &PlaneShear, height: f64, starts: u32) -> PackHeader {
    let load = &plane_shear.load;
    let first_load = first_load(scene, load) * 0.25f64.powi(starts as i32);
    PackHeader {
        step: 0,
        piston: Piston {
            height,
            velocity: 0.0,
            acceleration: 0.0,
            // About the mass of the later wall.
            mass: mass_of_layer(scene),
            load: load.normal_force * first_load,
        },
        drag: falling_drag(scene, load, first_load),
        starts,
    }
}

/// The shear of a sample with this top, from its first step.
fn sheared_from(scene: &Scene, plane_shear: &PlaneShear, piston: Piston) -> ShearHeader {
    let offset = scene.cell().sheared.map_or(0.0, |sheared| sheared.offset);
    let stream = scene.packing().map_or(0.0, |file| file.stream);
    ShearHeader {
        step: 0,
        origin: TimeOrigin::default(),
        before: 0,
        left_in: None,
        images: (plane_shear.boundary.is_periodic()).then_some([offset, stream]),
        height: height_between(scene, plane_shear, &piston),
        piston,
        slider: None,
        lateral: None,
        ends: Vec::new(),
        checks: None,
        written: Written::default(),
        energy_budget: None,
    }
}

/// The laws of grains and of planes during the packing.
fn packing_laws<D: LawSpace>(
    scene: &Scene,
    plane_shear: &PlaneShear,
) -> [Box<dyn PairForce<D>>; 2] {
    let PlaneShear { load, pack, .. } = plane_shear;
    let diameter = scene.sample.mean_diameter;
    [pack.friction, 0.0].map(|friction| {
        scene.force_with(|law: &Law, contact: &Contact| {
            let law = law.while_packing(diameter, load.pressure);
            (law, with_friction(contact, friction))
        })
    })
}

/// The contact with this coefficient of friction.
fn with_friction(contact: &Contact, friction: f64) -> Contact {
    // Without friction also no rolling resistance, which gives the densest packing.
    if friction == 0.0 {
        return contact.smooth();
    }
    Contact {
        friction,
        adhesion: None,
        ..contact.clone()
    }
}

/// The axis of the walls' normals.
fn up(scene: &Scene) -> usize {
    scene.dimension.axes() - 1
}

/// The fraction of N with which the packing begins.
fn first_load(scene: &Scene, load: &Load) -> f64 {
    (load.stiffness_number / BEARS_ALL[up(scene) - 1]).min(1.0)
}
