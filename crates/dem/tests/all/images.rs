//! Positions with their images move without jumps, where they cross the edges of the box and where
//! the offset of a sheared box returns.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::LawSpace;
use gshear_dem::state::{Cell, GrainState, Masses, Sheared};
use gshear_dem::system::{Setup, System};

use crate::common::{RADIUS, Rig, gas_law, periods};

/// Edges of the box (m), and the time step (s).
const EDGES: [f64; 3] = [20e-3, 16e-3, 12e-3];
const STEP: f64 = 1e-5;
const STEPS: u64 = 20_000;

/// Four grains that never touch each other, because they fly in different planes or one after the
/// other: in unwrapped coordinates each moves along a straight line, whatever the images do.
fn straight<D: LawSpace>(sheared: bool) {
    let height = EDGES[D::UP];
    let cell = Cell {
        periods: periods::<D>(EDGES[0], EDGES[1]),
        sheared: sheared.then_some(Sheared {
            offset: 0.3e-3,
            velocity: 0.37,
            half_velocity: 0.37,
            ..Sheared::upright(height)
        }),
    };
    let up = if sheared { 0.23 } else { 0.0 };
    // All rise together, so that they stay apart whatever the shear; two fly to the left.
    let grain = |id: usize| {
        let mut grain = GrainState {
            id: id as u32,
            radius: RADIUS,
            ..GrainState::zeroed()
        };
        grain.position[0] = 2e-3 + 1e-3 * id as f64;
        grain.position[D::UP] = (1.5 + 3.0 * id as f64) * RADIUS;
        grain.velocity[0] = if id < 2 { -0.31 } else { 0.17 };
        grain.velocity[D::UP] = up;
        if D::AXES == 3 {
            grain.position[1] = 5e-3;
            grain.velocity[1] = -0.11;
        }
        grain
    };
    let start: Vec<GrainState> = (0..4).map(grain).collect();
    let setup = Setup::new(cell, RADIUS, Masses::Density(2500.0), STEP);
    let mut rig = Rig::new(setup, gas_law::<D>(), NoWalls, (start.clone(), Vec::new()));
    let (mut farthest, mut above) = ([0i64; 3], 0);
    for k in 1..=STEPS {
        rig.step();
        if k % 7 != 0 && k != STEPS {
            continue;
        }
        let edges = rig.system.cell.edges::<D>(height);
        for grain in rig.system.grain_states() {
            let from = start[grain.id as usize];
            for axis in 0..D::AXES {
                let images = (0..D::AXES).map(|n| grain.image[n] as f64 * edges[n][axis]);
                let unwrapped = grain.position[axis] + images.sum::<f64>();
                let expected = from.position[axis] + k as f64 * STEP * from.velocity[axis];
                assert!(
                    (unwrapped - expected).abs() < 1e-12,
                    "step {k}, grain {}, axis {axis}: {unwrapped} for {expected}",
                    grain.id
                );
                farthest[axis] = farthest[axis].max(grain.image[axis].abs());
            }
            above += usize::from(grain.image[D::UP] > 0);
        }
    }
    assert!(farthest[0] > 1 && (D::AXES == 2 || farthest[1] > 0));
    // 74 mm of shear: the offset returns three times while grains are above.
    assert_eq!(above > 0, sheared);
}

#[test]
fn free_grains_fly_straight() {
    for sheared in [false, true] {
        straight::<Two>(sheared);
        straight::<Three>(sheared);
    }
}

/// A cell that is too low or too short for its grains is not refused for its one rank.
#[test]
fn a_cell_in_which_grains_touch_their_images_is_too_small() {
    for (length, height, is_small) in [(20.0, 4.0, true), (1.9, 20.0, true), (20.0, 4.2, false)] {
        let cell = Cell {
            periods: [length * RADIUS, f64::INFINITY],
            sheared: Some(Sheared::upright(height * RADIUS)),
        };
        let setup = Setup::new(cell, RADIUS, Masses::Density(2500.0), STEP);
        let said = System::<Two>::new(&Solo, setup)
            .err()
            .map(|failure| failure.to_string());
        let told = said.as_ref().map(|said| said.contains("cell is too small"));
        assert_eq!(told, is_small.then_some(true), "{said:?}");
    }
}
