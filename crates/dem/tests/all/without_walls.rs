//! A cell whose images move: free flight, streaming and the stress of lattices, by closed forms and
//! an independent integration.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{Images, Slider, Top};
use gshear_dem::laws::hooke::Springs;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::protocol::{Along, Imposed, Normal, Protocol};
use gshear_dem::state::{Cell, GrainState, Masses, Sheared};
use gshear_dem::step::initial_forces;
use gshear_dem::system::Setup;
use gshear_dem::wave::Wave;

use crate::common::{Rig, elastic, hooke, periods, piston, runge_kutta};

const RADIUS: f64 = 0.5;
const DENSITY: f64 = 1.0;
const SPRINGS: Springs = elastic(1.0, 0.5, DENSITY);

/// Smooth grains in a cell whose images move by what is imposed, or under the load of a mass.
fn in_cell<D: LawSpace>(
    springs: Springs,
    lengths: [f64; 3],
    (step, protocol): (f64, Protocol),
    (load, mass): (f64, f64),
    grains: Vec<GrainState>,
) -> Rig<D, Images> {
    let height = lengths[D::UP];
    let cell = Cell {
        periods: periods::<D>(lengths[0], lengths[1]),
        sheared: Some(Sheared::upright(height)),
    };
    let setup = Setup::new(cell, RADIUS, Masses::Density(DENSITY), step).with_skin(0.3);
    let piston = piston(height, mass, load);
    let mut images = Images::new(Top::new(piston, Slider::new(protocol, None), None, true));
    images.motion.begin();
    let law = hooke(springs, &Contact::NONE);
    Rig::new(setup, law, images, (grains, Vec::new()))
}

/// Grains apart from each other.
fn sparse<D: Dimension>(velocity: [f64; 3]) -> Vec<GrainState> {
    let grain = |id: u32| {
        let mut grain = GrainState {
            id,
            radius: RADIUS,
            position: [2.0, 2.0, 0.0],
            velocity,
            ..GrainState::zeroed()
        };
        grain.position[D::UP] = 2.0 + 3.0 * f64::from(id);
        grain
    };
    (0..3).map(grain).collect()
}

/// With y = h s, m h ds/dt = m u falls as 1/h in free flight, so s = s_0 + u_0 h_0 (1/h_0 - 1/h)/W
/// for the constant velocity W of the height. The scheme has both to rounding, because 1/(h h') of
/// its steps add up to the integral of 1/h².
fn flight<D: LawSpace>() {
    let rate = 1.5;
    for steps in [200u32, 400] {
        let step = 2.0 / f64::from(steps);
        let mut velocity = [0.0; 3];
        velocity[D::UP] = 7.0;
        let imposed = Imposed {
            normal: Some(Normal::Velocity(rate)),
            ..Along::Velocity(0.0).into()
        };
        let protocol = Protocol::of(step, [(imposed, u64::from(steps))]);
        let grains = sparse::<D>(velocity);
        let mut rig = in_cell::<D>(
            elastic(1e6, 0.5, DENSITY),
            [12.0; 3],
            (step, protocol),
            (0.0, 1.0),
            grains.clone(),
        );
        (0..steps).for_each(|_| rig.step());
        let height = rig.walls.motion.piston.height;
        assert!((height - 15.0).abs() < 1e-12);
        for (before, after) in grains.iter().zip(rig.system.grain_states()) {
            let u = after.velocity[D::UP] * height / 12.0;
            assert!((u / 7.0 - 1.0).abs() < 1e-11, "{u}");
            let gone = 7.0 * 12.0 * (1.0 / 12.0 - 1.0 / height) / rate;
            let expected = before.position[D::UP] / 12.0 + gone;
            let found = after.position[D::UP] / height + after.image[D::UP] as f64;
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            assert!(after.image[D::UP] > 0);
        }
    }
}

#[test]
fn free_grains_fly_through_a_cell_that_grows() {
    flight::<Two>();
    flight::<Three>();
}

/// Grains without contacts stream: x moves by y/h times the displacement of the images, whether
/// these oscillate, jump or stand, to rounding.
#[test]
fn grains_stream_with_the_images() {
    let step = 1e-3;
    let wave = Wave {
        amplitude: 3.0,
        frequency: 1.0 / 400.0,
    };
    let parts = [
        (Along::Velocity(11.0).into(), 700),
        (Along::Oscillation(wave).into(), 1000),
        (Along::Velocity(-5.0).into(), 600),
        (Along::Velocity(0.0).into(), 100),
    ];
    let protocol = Protocol::of(step, parts);
    let grains = sparse::<Two>([0.0; 3]);
    let of_rig = (step, protocol.clone());
    let mut rig = in_cell::<Two>(SPRINGS, [12.0; 3], of_rig, (0.0, 1e9), grains.clone());
    for k in 1..=24 {
        (0..100).for_each(|_| rig.step());
        let moved = protocol.position(100 * k);
        for (before, after) in grains.iter().zip(rig.system.grain_states()) {
            let part = before.position[1] / 12.0;
            let x = after.position[0] + 12.0 * after.image[0] as f64;
            let expected = before.position[0] + part * moved;
            assert!((x - expected).abs() < 1e-10, "{k}: {x} {expected}");
            let velocity = part * protocol.full_velocity(100 * k);
            assert!((after.velocity[0] - velocity).abs() < 1e-11, "{k}");
            assert_eq!(after.position[1], before.position[1]);
        }
    }
}

const SIDE: usize = 8;
const SPACING: f64 = 0.98;

/// Distance of two rows (m) of a triangular lattice.
fn row() -> f64 {
    0.75_f64.sqrt() * SPACING
}

/// A triangular lattice of equal disks, sheared by γ.
fn lattice(gamma: f64) -> Vec<GrainState> {
    let grain = |id: usize| {
        let (line, column) = (id / SIDE, id % SIDE);
        let y = row() * (line as f64 + 0.5);
        let x = SPACING * (column as f64 + 0.25 + 0.5 * (line % 2) as f64) + gamma * y;
        GrainState {
            id: id as u32,
            radius: RADIUS,
            position: [x.rem_euclid(SIDE as f64 * SPACING), y, 0.0],
            ..GrainState::zeroed()
        }
    };
    (0..SIDE * SIDE).map(grain).collect()
}

/// What a lattice of rows this far apart exerts across them, up and along x: two contacts of each
/// disk with the row above.
fn exerted(apart: f64, gamma: f64) -> [f64; 2] {
    let mut force = [0.0; 2];
    for side in [0.5, -0.5] {
        let [x, y] = [side * SPACING + gamma * apart, apart];
        let length = x.hypot(y);
        let pushes = SPRINGS.normal_stiffness * (2.0 * RADIUS - length) / length;
        force[0] += SIDE as f64 * pushes * y;
        force[1] += SIDE as f64 * pushes * x;
    }
    force
}

#[test]
fn the_stress_is_that_of_the_lattice() {
    let height = SIDE as f64 * row();
    for gamma in [0.0, 0.01, -0.013] {
        let protocol = Protocol::new(1e-3, [(0.0, 10)]);
        let lengths = [SIDE as f64 * SPACING, height, 1.0];
        let mut rig = in_cell::<Two>(SPRINGS, lengths, (1e-3, protocol), (0.0, 1e9), lattice(0.0));
        // The offset first, then the grains that fit it.
        let (system, law, images) = (&mut rig.system, &*rig.law, &mut rig.walls);
        system.shear(gamma * height);
        let made = system.replace(&Solo, law, images, lattice(gamma), Vec::new());
        made.expect("a list");
        let samples = Some(&mut rig.samples);
        initial_forces(&Solo, system, law, images, samples).expect("sound");
        let [up, along] = exerted(row(), gamma);
        let felt = rig.walls.felt;
        assert!((felt.up / up - 1.0).abs() < 1e-11, "{felt:?} {up}");
        assert!((felt.along - along).abs() < 1e-11, "{felt:?} {along}");
        assert!((gamma == 0.0) == (felt.along.abs() < 1e-11));
    }
}

/// Under a load that changes, the rows of a lattice stay equally far apart, and the height moves by
/// m d²h/dt² = F(h) - N: against Runge and Kutta with steps a hundred times shorter, to second
/// order.
#[test]
fn a_lattice_swings_under_its_load() {
    let height = SIDE as f64 * row();
    let (load, mass, time) = (0.7 * exerted(row(), 0.0)[0], 3.0, 40.0);
    let acceleration = |h: f64| (exerted(h / SIDE as f64, 0.0)[0] - load) / mass;
    let rate = |_, [h, v]: [f64; 2]| [v, acceleration(h)];
    let [h, _] = runge_kutta([height, 0.0], (400_000, time / 400_000.0), rate);
    let error = |steps: u64| {
        let step = time / steps as f64;
        let protocol = Protocol::new(step, [(0.0, steps)]);
        let lengths = [SIDE as f64 * SPACING, height, 1.0];
        let mut rig = in_cell::<Two>(
            SPRINGS,
            lengths,
            (step, protocol),
            (load, mass),
            lattice(0.0),
        );
        (0..steps).for_each(|_| rig.step());
        let piston = rig.walls.motion.piston;
        for grain in rig.system.grain_states() {
            let line = (grain.id as usize / SIDE) as f64 + 0.5;
            let expected = line * piston.height / SIDE as f64;
            assert!((grain.position[1] - expected).abs() < 1e-9);
        }
        (piston.height - h).abs()
    };
    let [coarse, fine] = [1000, 2000].map(error);
    assert!((h - height).abs() > 0.01 * height);
    assert!(
        fine < 1e-4 * height && coarse > 3.8 * fine,
        "{coarse} {fine}"
    );
}
