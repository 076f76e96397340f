//! Bands of grains, and steps that follow each other through them, give the bits of single steps of
//! one band.

use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{Drive, GrainWalls, NoWalls, Piston, Slider, Top};
use gshear_dem::laws::LawSpace;
use gshear_dem::protocol::Protocol;
use gshear_dem::state::{Cell, body};
use gshear_dem::step::{StepRequest, advance};
use gshear_dem::system::{Setup, SweepSettings};

use crate::common::{Rig, gas, gas_law, setup};

const STEPS: u64 = 1500;

/// Grains of a band, and steps that follow each other.
const SWEEPS: [(usize, u64); 5] = [(1, 1), (1, 2), (1, 7), (40, 3), (40, 16)];

/// Advances by [`STEPS`]; returns the digest, and the greatest numbers of bands and of steps at
/// once.
fn run<D: LawSpace, W: Drive<D>>(
    mut rig: Rig<D, W>,
    state: impl Fn(&W) -> Vec<f64>,
) -> (String, usize, u64) {
    let (mut bands, mut at_once, mut left) = (0, 0, STEPS);
    while left > 0 {
        let request = StepRequest {
            most: left,
            ..StepRequest::default()
        };
        let (law, walls) = (rig.law.as_ref(), &mut rig.walls);
        let advanced = advance(&Solo, &mut rig.system, law, walls, request).expect("sound");
        left -= advanced.steps;
        at_once = at_once.max(advanced.steps);
        bands = bands.max(rig.system.contacts.bands.len());
    }
    assert_eq!(rig.system.steps, STEPS);
    assert!(rig.system.list.rebuilds > 3, "too few lists");
    assert!(rig.system.contacts.touching().count() > 10);
    let state = state(&rig.walls);
    (rig.digest(&state), bands, at_once)
}

fn with<D: LawSpace>(side: usize, band: usize, steps: u64) -> Setup {
    Setup {
        sweep: SweepSettings {
            band: Some(band),
            steps,
        },
        ..setup::<D>(side, 0.2, (0.1, 0))
    }
}

/// A gas whose lowest and highest layers are walls: the lower one vibrates, the upper one is loaded
/// and pulled by a spring.
fn between_walls<D: LawSpace>(side: usize, band: usize, steps: u64) -> Rig<D, GrainWalls> {
    let mut setup = with::<D>(side, band, steps);
    let Setup { cell, step, .. } = &mut setup;
    *cell = Cell::between_walls(cell.periods);
    let mut grains = gas::<D>(side, 0.5, 5);
    let heights = || grains.iter().map(|g| g.position[D::UP]);
    let [low, high] = [
        heights().fold(f64::INFINITY, f64::min),
        heights().fold(0.0, f64::max),
    ];
    let third = (high - low) / side as f64;
    for grain in &mut grains {
        let height = grain.position[D::UP];
        if height < low + third {
            grain.body = body::BOTTOM;
        } else if height > high - third {
            grain.body = body::TOP;
        }
        if grain.body != body::FREE {
            grain.velocity = [0.0; 3];
            grain.angular_velocity = [0.0; 3];
        }
    }
    let piston = Piston {
        height: high,
        velocity: 0.0,
        acceleration: 0.0,
        mass: 5.0,
        load: 1e-2,
    };
    let slider = Slider::new(Protocol::new(*step, [(0.1, u64::MAX >> 12)]), Some(0.1));
    let top = Top::new(piston, slider, None, true);
    Rig::new(
        setup,
        gas_law::<D>(),
        GrainWalls::new(top),
        (grains, Vec::new()),
    )
}

fn bits_are_those_of_one_band<D: LawSpace>(side: usize) {
    let walls = |band, steps| {
        run(between_walls::<D>(side, band, steps), |walls| {
            walls.motion.state().to_vec()
        })
    };
    let (expected, bands, at_once) = walls(usize::MAX, 1);
    assert_eq!((bands, at_once), (1, 1));
    for (band, steps) in SWEEPS {
        let (digest, bands, at_once) = walls(band, steps);
        assert!(bands > 3 && at_once == steps, "{bands} bands, {at_once}");
        assert_eq!(digest, expected, "bands of {band}, {steps} at once");
    }
    // In a cell that is periodic along all axes steps are single.
    let periodic = |band| {
        let grains = (gas::<D>(side, 0.5, 5), Vec::new());
        let rig = Rig::new(with::<D>(side, band, 8), gas_law::<D>(), NoWalls, grains);
        run(rig, |_| Vec::new())
    };
    let (expected, bands, _) = periodic(usize::MAX);
    assert_eq!(bands, 1);
    for band in [1, 40] {
        let (digest, bands, at_once) = periodic(band);
        assert!(bands > 2 && at_once == 1, "{bands} bands, {at_once}");
        assert_eq!(digest, expected, "bands of {band}");
    }
}

#[test]
fn steps_that_follow_each_other_give_the_bits_of_single_ones() {
    bits_are_those_of_one_band::<Two>(24);
    bits_are_those_of_one_band::<Three>(9);
}
