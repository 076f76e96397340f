//! All laws: of second order in Δt where contacts stick, and where they slide and their direction
//! turns; objective: forces turn with a pair that turns as a rigid body; gross slip; ends.
//! Friction, rolling and twisting resistance of spheres.

use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Outside;
use gshear_dem::laws::ageing::Ageing;
use gshear_dem::laws::hertz::{self, Spheres};
use gshear_dem::laws::hooke::{self, Springs};
use gshear_dem::laws::mindlin::{self, MindlinSprings};
use gshear_dem::laws::tsuji::{self, TsujiSpheres};
use gshear_dem::laws::{Contact, Law, LawSpace};
use gshear_dem::state::{ContactState, Masses};
use gshear_dem::step::forces;

use crate::common::{
    Rig, Vector, assert_order, cross, dot, elastic, frictional, minus, norm, plus, undamped,
};

const RADII: [f64; 2] = [0.5, 0.7];
/// No histories, and no torques.
const FRESH: (Vector, [f64; 4]) = ([0.0; 3], [0.0; 4]);

/// In units in which a contact of δ = 0.02 has about the same stiffness under every law.
const SPRINGS: Springs = Springs {
    damping_ratio: 0.1,
    sliding_damping: 0.5,
    ..UNDAMPED
};
const UNDAMPED: Springs = elastic(1.0, 0.4, 1.5);

/// The laws between spheres, of which some are between disks.
fn laws(springs: Springs) -> [Law; 4] {
    let spheres = undamped(12.0, 0.3, 1.5);
    let damped = Spheres {
        normal_damping: 0.8,
        tangential_damping: 0.4,
        ..spheres
    };
    let tsuji = TsujiSpheres {
        spheres,
        restitution: 0.8,
        tangential_damping_ratio: 0.5,
    };
    let mindlin = MindlinSprings {
        normal_stiffness: 7.0,
        tangential_stiffness: 5.0,
        masses: Masses::Density(1.5),
    };
    [
        Law::of(&hooke::KIND, springs),
        Law::of(&hertz::KIND, damped),
        Law::of(&tsuji::KIND, tsuji),
        Law::of(&mindlin::KIND, mindlin),
    ]
}

/// Rolling and twisting resistance, in the same units.
const RESISTING: Contact = Contact {
    rolling_friction: 0.1,
    rolling_stiffness: Some(0.5),
    rolling_damping_ratio: 0.2,
    twisting_friction: 0.05,
    twisting_stiffness: Some(0.3),
    twisting_damping_ratio: 0.1,
    ..Contact::NONE
};

/// Contacts that stick, and resist rolling and twisting or do not.
fn sticking(resists: bool) -> Contact {
    let high = if resists { 1e3 } else { 0.0 };
    Contact {
        friction: 1e3,
        rolling_friction: high,
        twisting_friction: high,
        ..RESISTING
    }
}

/// Calls `check` with every law that is one of D dimensions, without and with rolling and twisting
/// resistance if it has them.
fn for_all_laws<D: LawSpace>(springs: Springs, check: impl Fn(&Law, bool)) {
    for law in laws(springs) {
        if D::pair_force(&law, &Contact::NONE).is_some() {
            check(&law, false);
            if D::AXES == 3 || law.kind().rolling {
                check(&law, true);
            }
        }
    }
}

/// Position, velocity and spin of each, and the histories of their contact.
fn couple<D: LawSpace>(
    radii: [f64; 2],
    law: &Law,
    contact: &Contact,
    step: f64,
    of: [[Vector; 3]; 2],
    (history, torques): (Vector, [f64; 4]),
) -> Rig<D> {
    let contacts = vec![ContactState {
        torques,
        // Of friction that grows with it.
        age: 0.1,
        ..ContactState::new(0, 1, history)
    }];
    let force = D::pair_force(law, contact).expect("a law of this dimension");
    Rig::couple(force, (law.masses(), step), radii, of, contacts)
}

/// n from the second to the first, and a direction across it.
fn directions<D: Dimension>() -> [Vector; 2] {
    match D::AXES {
        2 => [[0.96, 0.28, 0.0], [-0.28, 0.96, 0.0]],
        _ => [[2.0, 1.0, 2.0], [1.0, 2.0, -2.0]].map(|of| of.map(|x| x / 3.0)),
    }
}

/// Two grains pressed together with spins: they stick, or they slide from the first step on while
/// the direction of the slip turns. Differences to a run of 12,800 steps fall by four from 200
/// steps on, in velocities and spins.
fn is_of_second_order<D: LawSpace>(law: &Law, resists: bool, slides: bool) {
    let [n, _] = directions::<D>();
    let mut of = [
        [
            plus([0.0; 3], 0.98 * RADII[0], n),
            [-0.03, 0.05, 0.02],
            [0.3, -0.1, 0.2],
        ],
        [
            plus([0.0; 3], -0.98 * RADII[1], n),
            [0.02, -0.03, 0.05],
            [-0.2, 0.4, 0.1],
        ],
    ];
    for [_, velocity, spin] in &mut of {
        velocity[D::AXES..].fill(0.0);
        spin[..3 - D::SPINS].fill(0.0);
    }
    let [[_, v_i, spin_i], [_, v_j, spin_j]] = of;
    let arms: Vector = std::array::from_fn(|k| RADII[0] * spin_i[k] + RADII[1] * spin_j[k]);
    let apart = minus(v_i, v_j);
    let slip = plus(plus(apart, -dot(apart, n), n), 1.0, cross(n, arms));
    let turning = minus(spin_i, spin_j);
    let twisting = dot(turning, n);
    let [x, y, z] = plus(turning.map(|w| -w), twisting, n);
    // Beyond the limits, so that it slides; a force or a displacement.
    let sign = if law.kind().name == hooke::KIND.name {
        -1.0
    } else {
        1.0
    };
    let along = slip.map(|v| sign * v / norm(slip));
    let histories = match (slides, D::SPINS) {
        (false, _) => FRESH,
        (true, 1) => ([dot(along, [-n[1], n[0], 0.0]), 0.0, z], [0.0; 4]),
        (true, _) => (
            along,
            [x, y, z, -twisting].map(|t| t * f64::from(u8::from(resists))),
        ),
    };
    let contact = match (slides, resists) {
        (false, _) => sticking(resists),
        (true, false) => frictional(0.15),
        (true, true) => Contact {
            friction: 0.15,
            ..RESISTING
        },
    };
    let name = format!("{}, {} axes, {resists} {slides}", law.kind().name, D::AXES);
    let end = |steps: usize| {
        let mut pair = couple::<D>(RADII, law, &contact, 0.8 / steps as f64, of, histories);
        for _ in 0..steps {
            pair.advance(1);
            // Whether it is at the limits of friction, rolling and twisting.
            let limits = pair.system.contacts.limits[0].map(|lanes| lanes != 0);
            let at = slides && resists;
            assert_eq!(limits[..3], [slides, at, at && D::AXES == 3], "{name}");
        }
        pair.system.grains().state(0)
    };
    let reference = end(12800);
    let ends = [200, 400, 800].map(end);
    let velocity = ends.map(|end| norm(minus(end.velocity, reference.velocity)));
    let spin = ends.map(|end| norm(minus(end.angular_velocity, reference.angular_velocity)));
    let order = 1.85..=if slides { 2.5 } else { 2.4 };
    assert_order(&name, &velocity, order.clone());
    assert_order(&name, &spin, order);
}

#[test]
fn sticking_and_sliding_are_of_second_order() {
    for slides in [false, true] {
        for_all_laws::<Two>(SPRINGS, |law, resists| {
            is_of_second_order::<Two>(law, resists, slides);
        });
        for_all_laws::<Three>(SPRINGS, |law, resists| {
            is_of_second_order::<Three>(law, resists, slides);
        });
    }
}

/// Friction that grows with the age of the contact, while slip of twice the length that renews it
/// changes it by a tenth.
#[test]
fn sliding_with_age_is_of_second_order() {
    let ageing = Some(Ageing {
        growth: 0.5,
        time: 0.3,
        slip: Some(0.1),
    });
    let springs = Springs { ageing, ..SPRINGS };
    let spheres = Spheres {
        normal_damping: 0.8,
        tangential_damping: 0.4,
        ageing,
        ..undamped(12.0, 0.3, 1.5)
    };
    let hooke = Law::of(&hooke::KIND, springs);
    let hertz = Law::of(&hertz::KIND, spheres);
    for resists in [false, true] {
        is_of_second_order::<Two>(&hooke, resists, true);
        is_of_second_order::<Three>(&hooke, resists, true);
        is_of_second_order::<Three>(&hertz, resists, true);
    }
}

/// Sliding throughout, because v_t is ten times v_n and the springs have no damper: the impulse of
/// friction is μ times that of the normal force, and each grain takes R/I of it as spin, in
/// whatever direction.
fn gross_slip<D: LawSpace>(law: &Law) {
    const FRICTION: f64 = 0.15;
    let [n, t] = directions::<D>();
    // So slow that n turns by a milliradian while they touch.
    let speed = 1e-5;
    let velocity = plus(n.map(|n| speed * n), 10.0 * speed, t);
    let (distance, step) = (RADII[0] + RADII[1], 1e-3);
    let of = [
        [n.map(|n| distance * n), [0.0; 3], [0.0; 3]],
        [[0.0; 3], velocity, [0.0; 3]],
    ];
    let mut pair = couple::<D>(RADII, law, &frictional(FRICTION), step, of, FRESH);
    pair.advance(10);
    while pair.contact_force().is_some() {
        pair.advance(1);
    }
    let ends = pair.ends();
    let name = law.kind().name;
    // What the first has gained.
    let mass = |radius: f64| law.masses().of(0, D::volume(radius));
    let impulse = ends[0].velocity.map(|v| mass(RADII[0]) * v);
    let ratio = dot(impulse, t) / dot(impulse, n) / FRICTION;
    assert!((ratio - 1.0).abs() < 5e-3, "{name}: {ratio}");
    for grain in ends {
        let of_inertia = -grain.radius / (D::INERTIA * mass(grain.radius) * grain.radius.powi(2));
        let expected = cross(n, impulse).map(|j| of_inertia * j);
        let found = grain.angular_velocity;
        let error = norm(minus(found, expected)) / norm(expected);
        let aside = norm(cross(found, expected)) / norm(found) / norm(expected);
        assert!(
            error < 5e-3 && aside < 1e-3,
            "{name}: {found:?} is not {expected:?}"
        );
    }
}

#[test]
fn gross_slip_turns_the_grains() {
    for_all_laws::<Two>(UNDAMPED, |law, _| gross_slip::<Two>(law));
    for_all_laws::<Three>(UNDAMPED, |law, _| gross_slip::<Three>(law));
}

/// `v` turned about a unit vector.
fn turned(v: Vector, about: Vector, angle: f64) -> Vector {
    let (s, c) = angle.sin_cos();
    let aside = plus(v.map(|v| c * v), s, cross(about, v));
    plus(aside, (1.0 - c) * dot(about, v), about)
}

/// A loaded contact that is turned as a whole, with spins that leave no slip, keeps its forces,
/// turned along, to second order in the angle of a step: about an axis across n, and about n.
#[test]
fn forces_turn_with_their_pair() {
    const ANGLE: f64 = 4.0;
    let [n, across] = directions::<Three>();
    for_all_laws::<Three>(SPRINGS, |law, resists| {
        for axis in [across, n] {
            let history = [0.5e-2, 1e-2, 0.0];
            let history = plus(history, -dot(history, n), n);
            let [x, y, z] = history;
            let torques = if resists { [x, y, z, 1e-2] } else { [0.0; 4] };
            let error = |steps: usize| {
                let place = |k: usize, g: usize| {
                    let part = [0.98, -0.98][g] * RADII[g];
                    turned(n, axis, ANGLE * k as f64 / steps as f64).map(|n| part * n)
                };
                let of = [0, 1].map(|g| [place(0, g), [0.0; 3], [0.0; 3]]);
                let contact = sticking(resists);
                let mut pair = couple::<Three>(RADII, law, &contact, 1.0, of, (history, torques));
                // They roll on each other where they overlap.
                let rate = ANGLE / steps as f64 * if axis == n { 1.0 } else { 0.98 };
                let spin = axis.map(|a| rate * a);
                for k in 1..=steps {
                    for g in [0, 1] {
                        let v = minus(place(k, g), place(k - 1, g));
                        let r = pair.fields_mut(g as u32);
                        (0..3).for_each(|axis| r[axis] += v[axis]);
                        r[Three::HALF_VELOCITY..][..3].copy_from_slice(&v);
                        r[Three::VELOCITY..][..3].copy_from_slice(&v);
                        r[Three::HALF_SPIN..][..3].copy_from_slice(&spin);
                        r[Three::SPIN..][..3].copy_from_slice(&spin);
                    }
                    let (system, law) = (&mut pair.system, &*pair.law);
                    assert_eq!(forces(&Solo, system, law, &mut NoWalls, 1.0, None), None);
                }
                let found = pair.system.contact_states(&*pair.law)[0];
                let [x, y, z, twist] = found.torques;
                let expected = turned(history, axis, ANGLE);
                let mut error = norm(minus(found.history, expected));
                if resists {
                    error += norm(minus([x, y, z], expected)) + (twist - 1e-2).abs();
                }
                error / norm(history)
            };
            let name = format!("{} about {axis:?}", law.kind().name);
            let errors = [200, 400, 800].map(error);
            let most = if axis == n { 5e-5 } else { 2e-3 };
            assert!(errors[2] < most, "{name}: {errors:?}");
            assert_order(&name, &errors, 1.926..=2.5);
        }
    });
}

/// The mass of a sphere of the springs.
fn mass(radius: f64) -> f64 {
    SPRINGS.density * Three::volume(radius)
}

/// Two equal spheres, `distance` and `approach` of each other along n, with opposite spins.
fn opposite(n: Vector, [distance, approach]: [f64; 2], spin: Vector) -> [[Vector; 3]; 2] {
    [0.5, -0.5].map(|side| {
        [
            n.map(|n| side * distance * n),
            n.map(|n| -side * approach * n),
            spin.map(|w| side * w),
        ]
    })
}

/// The relative spin about an axis.
fn relative_spin(pair: &mut Rig<Three>, axis: Vector) -> f64 {
    let [a, b] = pair.ends();
    dot(minus(a.angular_velocity, b.angular_velocity), axis)
}

/// Two equal spheres that roll on each other, and twist, without slip: damped oscillators whose
/// period and decay are those of k_r, C_r and of k_w, C_w. They lie together from the start, or
/// come to touch within a step, when F_n begins as that of the damper.
#[test]
fn spheres_oscillate_against_each_other() {
    for approach in [0.0, 0.05] {
        oscillate(approach);
    }
}

/// `approach`: the velocity (in the units of the laws) with which they come together.
fn oscillate(approach: f64) {
    const RADIUS: f64 = 0.5;
    let [law, ..] = laws(SPRINGS);
    let mass = mass(RADIUS);
    let contact = Contact {
        friction: 10.0,
        rolling_friction: 1e3,
        twisting_friction: 1e3,
        // So stiff that the spheres hardly part meanwhile.
        rolling_stiffness: Some(500.0),
        twisting_stiffness: Some(300.0),
        ..RESISTING
    };
    let n = [0.0, 0.6, 0.8];
    for (axis, k, eta, inertia) in [([1.0, 0.0, 0.0], 500.0, 0.2, 1.4), (n, 300.0, 0.1, 0.4)] {
        // I φ'' = -k_r φ - C_r φ' of the relative angle φ with I = (2/5) mR²/2.
        let stiffness = k * RADIUS * RADIUS / 4.0;
        let damping = 2.0 * eta * (0.5 * inertia * mass * RADIUS * RADIUS * stiffness).sqrt();
        let moment = 0.2 * mass * RADIUS * RADIUS;
        let (rate, decay) = ((stiffness / moment).sqrt(), 0.5 * damping / moment);
        let turning = (rate * rate - decay * decay).sqrt();
        let (spin, end) = (1e-3, 3.0 / rate);
        let expected = |end: f64| {
            spin * (-decay * end).exp()
                * ((turning * end).cos() - decay / turning * (turning * end).sin())
        };
        let errors = [400, 800].map(|steps| {
            let step = end / steps as f64;
            // A part of a step before they touch, and as much more at the end.
            let before = if approach > 0.0 { 20.3 * step } else { 0.0 };
            let distance = if approach > 0.0 {
                2.0 * RADIUS + approach * before
            } else {
                1.98 * RADIUS
            };
            let of = opposite(n, [distance, approach], axis.map(|a| spin * a));
            let mut pair = couple::<Three>([RADIUS; 2], &law, &contact, step, of, FRESH);
            pair.advance(steps + 20);
            let touched = (steps + 20) as f64 * step - before;
            (relative_spin(&mut pair, axis) - expected(touched)).abs() / spin
        });
        assert!(errors[1] < 1e-5, "{approach}: {errors:?}");
        assert_order("oscillation", &errors, 1.81..=2.16);
    }
}

/// Two equal spheres meet head on while they twist, so fast that the dashpot of twisting is beyond
/// its limit, which begins as that of the damped F_n; later the limit is above it. Beside the law
/// as a differential equation.
#[test]
fn a_torque_beyond_its_limit_is_set_back_at_the_touch() {
    const RADIUS: f64 = 0.5;
    let [law, ..] = laws(SPRINGS);
    let contact = Contact {
        rolling_friction: 0.0,
        twisting_friction: 1.0,
        ..RESISTING
    };
    let (spin, approach, end) = (0.5, 0.05, 1.0);
    let mass = mass(RADIUS);
    let arm = 0.5 * RADIUS;
    let k_w = 0.3 * arm * arm;
    let of_pair = 0.2 * mass * RADIUS * RADIUS;
    let c_w = 2.0 * 0.1 * (of_pair * k_w).sqrt();
    let gamma = 2.0 * 0.1 * (0.5 * mass).sqrt();
    let (mut overlap, mut v, mut turning, mut spring) = (0.0, approach, spin, 0.0);
    let fine = 1e-6;
    let mut stuck = 0;
    for k in 0..(end / fine) as u32 {
        let normal: f64 = overlap + gamma * v;
        let limit = normal * arm;
        let trial: f64 = spring - c_w * turning;
        let torque = trial.clamp(-limit, limit);
        assert!(
            k > 0 || trial < -limit,
            "it is beyond the limit at the touch"
        );
        stuck += u32::from(torque == trial);
        spring = torque + c_w * turning - fine * k_w * turning;
        turning += fine * torque / of_pair;
        v -= fine * normal / (0.5 * mass);
        overlap += fine * v;
    }
    assert!(stuck > 10_000);

    let n = [0.0, 0.6, 0.8];
    for steps in [200, 400] {
        let step = end / steps as f64;
        let distance = 2.0 * RADIUS + approach * 20.3 * step;
        let of = opposite(n, [distance, approach], n.map(|n| spin * n));
        let mut pair = couple::<Three>([RADIUS; 2], &law, &contact, step, of, FRESH);
        // The end is between two steps.
        let [before, after] = [steps + 20, 1].map(|steps| {
            pair.advance(steps);
            relative_spin(&mut pair, n)
        });
        let error = (before + 0.3 * (after - before) - turning).abs() / spin;
        assert!(error < 1e-6, "{steps}: {error}");
    }
}

/// Two grains a little within the largest overlap of a law, then a little beyond it, and at one
/// place, where they are no pair that fills up a block.
fn ends_at_the_largest_overlap<D: LawSpace>(law: &Law, resists: bool) {
    let contact = if resists { RESISTING } else { Contact::NONE };
    let most = law.largest_overlap(RADII[0], RADII[1]);
    let distance = RADII[0] + RADII[1] - 0.999 * most;
    let of = [[[distance, 0.0, 0.0], [0.0; 3], [0.0; 3]], [[0.0; 3]; 3]];
    for closer in [0.002 * most, distance] {
        let mut pair = couple::<D>(RADII, law, &contact, 0.01, of, FRESH);
        pair.fields_mut(0)[0] -= closer;
        let (system, force) = (&mut pair.system, &*pair.law);
        let outside = forces(&Solo, system, force, &mut NoWalls, 0.0, None);
        let name = law.kind().name;
        assert!(
            matches!(outside, Some(Outside::Pair(..))),
            "{name} {closer}: {outside:?}"
        );
    }
}

#[test]
fn every_law_ends_at_its_largest_overlap() {
    for_all_laws::<Two>(SPRINGS, ends_at_the_largest_overlap::<Two>);
    for_all_laws::<Three>(SPRINGS, ends_at_the_largest_overlap::<Three>);
}
