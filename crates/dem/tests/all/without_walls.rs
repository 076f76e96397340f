//! A cell whose images move: free flight, streaming and the stress of lattices, by closed forms and
//! an independent integration.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{Images, LateralLengths, LateralState, Slider, Top};
use gshear_dem::laws::hooke::Springs;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::protocol::{Along, Course, Imposed, Lateral, LateralAxis, Normal, Protocol};
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
    let changes = protocol.has_lateral();
    let mut images = Images::new(Top::new(piston, Slider::new(protocol, None), None, true));
    images.motion.begin();
    if changes {
        let state = LateralState::at_rest::<D>(&cell, &piston);
        let lengths = LateralLengths::new(state, &lengths[..D::UP], height, None);
        images.lateral = Some(lengths);
    }
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
        phase: 0.0,
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

/// While the lengths shrink at constant rates of strain and the images stream: with x = L s, w L is
/// constant for the velocity w less V y/h, and ds/dt = w/L + V y/(h L); y/h is constant. To second
/// order.
fn flight_while_all_lengths_change<D: LawSpace>() {
    let (velocity, shrinks, grows, time) = (1.7, 0.3, -0.2, 2.0_f64);
    let strains = [LateralAxis::Strain(shrinks), LateralAxis::Strain(grows)];
    let speed = [3.0, 2.0, 0.0];
    let errors = [200u32, 400].map(|steps| {
        let step = time / f64::from(steps);
        let imposed = Imposed {
            normal: Some(Normal::Velocity(0.5)),
            lateral: Some(Lateral::Axes(strains)),
            ..Along::Velocity(velocity).into()
        };
        let protocol = Protocol::of(step, [(imposed, u64::from(steps))]);
        let mut own = speed;
        own[D::UP] = 0.0;
        let grains = sparse::<D>(own);
        let mut rig = in_cell::<D>(
            elastic(1e6, 0.5, DENSITY),
            [12.0; 3],
            (step, protocol),
            (0.0, 1.0),
            grains.clone(),
        );
        (0..steps).for_each(|_| rig.step());
        let lateral = rig.walls.lateral.as_ref().expect("lengths that change");
        let axes = lateral.state.axes.clone();
        let mut error = 0.0_f64;
        for (axis, (piston, strain)) in axes.iter().zip([shrinks, grows]).enumerate() {
            let length = 12.0 * (-strain).exp();
            assert!((piston.height / length - 1.0).abs() < 1e-12);
            let rate = strain / time;
            // The integrals of 1/L and 1/L².
            let once = (1.0 / length - 1.0 / 12.0) / rate;
            let twice = (1.0 / (length * length) - 1.0 / 144.0) / (2.0 * rate);
            for (before, after) in grains.iter().zip(rig.system.grain_states()) {
                let part = before.position[D::UP] / 12.0;
                let stream = if axis == 0 { velocity * part } else { 0.0 };
                // In the first step the grains take the change of the stream.
                let gone = speed[axis] * 12.0 * twice + stream * once;
                let expected = before.position[axis] / 12.0 + gone;
                let images = after.image[axis] as f64;
                let mut x = after.position[axis] / length + images;
                if axis == 0 {
                    let turns = after.image[D::UP] as f64;
                    x += turns * lateral.state.unwrapped_offset / length;
                }
                error = error.max((x - expected).abs());
                let u = (after.velocity[axis] - stream) * length / (12.0 * speed[axis]);
                assert!((u - 1.0).abs() < 1e-11, "{u}");
            }
        }
        error
    });
    let [coarse, fine] = errors;
    assert!(
        fine < 1e-5 && coarse > 3.8 * fine && coarse > 1e-9,
        "{errors:?}"
    );
}

#[test]
fn free_grains_fly_while_all_lengths_change() {
    flight_while_all_lengths_change::<Two>();
    flight_while_all_lengths_change::<Three>();
}

/// What a lattice with columns and rows this far apart exerts on its sides, per row.
fn exerted_sideways(spacing: f64, apart: f64) -> [f64; 2] {
    let diagonal = (0.5 * spacing).hypot(apart);
    let [along, across] =
        [spacing, diagonal].map(|x| SPRINGS.normal_stiffness * (2.0 * RADIUS - x));
    let rows = SIDE as f64;
    let up = 2.0 * rows * across * apart / diagonal;
    // A contact in each row, and half of the way of two between rows.
    let sideways = rows * (along + across * (0.5 * spacing) / diagonal);
    [up, sideways]
}

/// Under stresses that differ, columns and rows of a lattice stay equally far apart, and length and
/// height move by m d²L/dt² = A (σ - P), with the areas at the start: against Runge and Kutta with
/// steps a hundred times shorter, to second order. Under the mean of the stresses both move alike.
fn swings(isotropic: bool) {
    let [length, height] = [SIDE as f64 * SPACING, SIDE as f64 * row()];
    let start = exerted_sideways(SPACING, row());
    let part = if isotropic { 0.5 } else { 0.8 };
    let pressures = [part * start[0] / length, 1.3 * start[1] / height];
    let (mass, time) = (3.0, if isotropic { 42.0 } else { 40.0 });
    let side = mass * (height / length) * (height / length);
    let rate = |_, [h, v, l, w]: [f64; 4]| {
        let n = SIDE as f64;
        let [up, sideways] = exerted_sideways(l / n, h / n);
        let stresses = [up / l, sideways / h];
        if isotropic {
            let mean = 0.5 * (stresses[0] + stresses[1]);
            return [v, (mean - pressures[0]) * length / mass, v * l / h, 0.0];
        }
        let rise = (stresses[0] - pressures[0]) * length / mass;
        [v, rise, w, (stresses[1] - pressures[1]) * height / side]
    };
    let begin = [height, 0.0, length, 0.0];
    let [h, _, l, _] = runge_kutta(begin, (400_000, time / 400_000.0), rate);
    let error = |steps: u64| {
        let step = time / steps as f64;
        let lateral = if isotropic {
            Lateral::Isotropic
        } else {
            let stress = LateralAxis::Stress(Course::constant(pressures[1]));
            Lateral::Axes([stress, LateralAxis::Fixed])
        };
        let imposed = Imposed {
            normal: Some(Normal::Load(Course::constant(pressures[0] * length))),
            lateral: Some(lateral),
            ..Along::Velocity(0.0).into()
        };
        let protocol = Protocol::of(step, [(imposed, steps)]);
        let mut rig = in_cell::<Two>(
            SPRINGS,
            [length, height, 1.0],
            (step, protocol),
            (pressures[0] * length, mass),
            lattice(0.0),
        );
        (0..steps).for_each(|_| rig.step());
        let now = rig.walls.lateral.as_ref().expect("lengths").state.axes[0];
        let [high, long] = [rig.walls.motion.piston.height, now.height];
        for (grain, first) in rig.system.grain_states().iter().zip(lattice(0.0)) {
            for (axis, ratio) in [long / length, high / height].into_iter().enumerate() {
                let moved = grain.position[axis] - first.position[axis] * ratio;
                assert!(moved.abs() < 1e-9, "{moved}");
            }
        }
        ((high - h).abs()).max((long - l).abs())
    };
    let [coarse, fine] = [1000, 2000].map(error);
    assert!((h - height).abs() > 0.01 * height && (l - length).abs() > 0.003 * length);
    assert!(
        fine < 1e-4 * height && coarse > 3.8 * fine,
        "{coarse} {fine}"
    );
}

#[test]
fn a_lattice_swings_under_its_stresses() {
    swings(false);
}

#[test]
fn a_lattice_swings_under_its_mean_stress() {
    swings(true);
}
