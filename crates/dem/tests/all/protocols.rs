//! What a protocol imposes on walls, step by step: closed forms of a wall without contacts, and the
//! order in Δt of a layer between walls.

use std::f64::consts::TAU;

use bytemuck::Zeroable;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{GrainWalls, Piston, Servo, Slider, Top};
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::Contact;
use gshear_dem::laws::hooke::{Hooke, Springs};
use gshear_dem::protocol::{Along, Course, Imposed, Normal, Protocol};
use gshear_dem::state::{Cell, GrainState, Masses, body};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{Setup, System};
use gshear_dem::wave::Wave;

const RADIUS: f64 = 1e-3;
const DENSITY: f64 = 2500.0;
/// Grains along every periodic axis.
const SIDE: usize = 4;
/// Nearer than two radii: the layers overlap.
const SPACING: f64 = 1.96 * RADIUS;
const SPRINGS: Springs = Springs {
    normal_stiffness: 1e7,
    tangential_stiffness: 4e6,
    density: DENSITY,
    damping_ratio: 0.1,
    sliding_damping: 0.0,
};
/// Contacts stick.
const CONTACT: Contact = Contact {
    friction: 10.0,
    ..Contact::NONE
};

/// A square or cubic lattice between two walls.
struct Rig<D: Dimension> {
    system: System<D>,
    walls: GrainWalls,
    law: Hooke<D, true, false>,
}

impl<D: Dimension> Rig<D>
where
    Hooke<D, true, false>: PairForce<D>,
{
    /// Walls with so many layers of free grains between them; `gap` (m) separates the top from what
    /// is below it. The load is that under which the lattice is at rest.
    fn new(layers: usize, gap: f64, step: f64, protocol: Protocol) -> Self {
        Self::under(None, (layers, gap), step, protocol)
    }

    /// As `new`, with the load by a servo.
    fn under(
        servo: Option<Servo>,
        (layers, gap): (usize, f64),
        step: f64,
        protocol: Protocol,
    ) -> Self {
        let length = SIDE as f64 * SPACING;
        let width = match D::AXES {
            2 => f64::INFINITY,
            _ => length,
        };
        let setup = Setup::new(
            Cell::between_walls([length, width]),
            RADIUS,
            Masses::Density(DENSITY),
            step,
        )
        .with_skin(0.1);
        let height = (layers + 1) as f64 * SPACING + gap;
        let per_layer = SIDE.pow(D::UP as u32);
        let piston = Piston {
            height,
            velocity: 0.0,
            acceleration: 0.0,
            mass: per_layer as f64 * DENSITY * D::volume(RADIUS),
            load: rest_load::<D>(),
        };
        let slider = Slider::new(protocol, None);
        let mut walls = GrainWalls::new(Top::new(piston, slider, servo, true));
        let [along, top, bottom] = walls.motion.begin();
        let grain = |id: usize| {
            let layer = id / per_layer;
            let mut state = GrainState {
                id: id as u32,
                radius: RADIUS,
                ..GrainState::zeroed()
            };
            for axis in 0..D::UP {
                let place = (id / SIDE.pow(axis as u32) % SIDE) as f64;
                state.position[axis] = (place + 0.1) * SPACING;
            }
            state.position[D::UP] = layer as f64 * SPACING;
            if layer == 0 {
                (state.body, state.velocity[D::UP]) = (body::BOTTOM, bottom);
            } else if layer == layers + 1 {
                state.body = body::TOP;
                state.position[D::UP] += gap;
                (state.velocity[0], state.velocity[D::UP]) = (along, top);
            }
            state
        };
        let grains = (0..(layers + 2) * per_layer).map(grain).collect();
        let law = Hooke::new(&SPRINGS, &CONTACT);
        let mut system = System::new(&Solo, setup).expect("one rank");
        system
            .replace(&Solo, &law, &mut walls, grains, Vec::new())
            .expect("a list");
        initial_forces(&Solo, &mut system, &law, &mut walls, None).expect("sound");
        Self { system, walls, law }
    }

    fn advance(&mut self) {
        let request = StepRequest::default();
        advance(&Solo, &mut self.system, &self.law, &mut self.walls, request).expect("sound");
    }
}

/// The load that holds the lattice (N; N/m in 2D).
fn rest_load<D: Dimension>() -> f64 {
    let overlap = 2.0 * RADIUS - SPACING;
    SIDE.pow(D::UP as u32) as f64 * SPRINGS.normal_stiffness * overlap
}

fn constant(force: f64) -> Along {
    Along::Force(Course::constant(force))
}

/// Position along x and velocity of a top that touches nothing, after every step.
fn path<D: Dimension>(step: f64, parts: &[(Imposed, u64)]) -> Vec<[f64; 2]>
where
    Hooke<D, true, false>: PairForce<D>,
{
    let at_its_height = |&(of, steps): &(Imposed, u64)| {
        let normal = Some(Normal::Velocity(0.0));
        (Imposed { normal, ..of }, steps)
    };
    let protocol = Protocol::of(step, parts.iter().map(at_its_height));
    let steps = protocol.steps();
    let mut rig = Rig::<D>::new(0, 100.0 * RADIUS, step, protocol);
    let mut path = vec![[0.0, rig.walls.motion.slider.state.velocity]];
    for _ in 0..steps {
        rig.advance();
        let state = rig.walls.motion.slider.state;
        path.push([state.displacement, state.velocity]);
    }
    path
}

fn wall_mass<D: Dimension>() -> f64 {
    SIDE.pow(D::UP as u32) as f64 * DENSITY * D::volume(RADIUS)
}

const STEP: f64 = 1e-5;

/// Compares numbers up to the rounding of so many steps.
fn same(found: f64, expected: f64, scale: f64) {
    let rounding = 1e-12 * scale.abs();
    assert!(
        (found - expected).abs() <= rounding,
        "{found:e} {expected:e}"
    );
}

/// x = F t²/(2m) under a constant force, and under one that grows by c t the sum of the scheme,
/// F t²/(2m) + c (t³ - t Δt²)/(6m); the height falls likewise by the load.
fn a_free_wall_accelerates<D: Dimension>()
where
    Hooke<D, true, false>: PairForce<D>,
{
    const STEPS: u64 = 500;
    let mass = wall_mass::<D>();
    let force = 100.0 * mass;
    let all = STEPS as f64 * STEP;
    for end in [force, -2.0 * force] {
        let course = Course {
            from: force,
            to: end,
            wave: None,
        };
        let path = path::<D>(STEP, &[(Along::Force(course).into(), STEPS)]);
        let [a, rate] = [force / mass, (end - force) / all / mass];
        for (k, [x, v]) in path.iter().enumerate() {
            let t = k as f64 * STEP;
            let expected = 0.5 * a * t * t + rate * (t.powi(3) - t * STEP * STEP) / 6.0;
            same(*x, expected, a * all * all);
            same(*v, a * t + 0.5 * rate * t * t, a * all);
        }
    }

    let load = 200.0 * mass;
    let falling = Imposed {
        normal: Some(Normal::Load(Course::constant(load))),
        ..constant(force).into()
    };
    let mut rig = Rig::<D>::new(
        0,
        100.0 * RADIUS,
        STEP,
        Protocol::of(STEP, [(falling, STEPS)]),
    );
    let start = rig.walls.motion.piston.height;
    for k in 1..=STEPS {
        rig.advance();
        let t = k as f64 * STEP;
        let height = start - 0.5 * load / mass * t * t;
        same(rig.walls.motion.piston.height, height, start);
    }
    assert!(start - rig.walls.motion.piston.height > RADIUS);
}

#[test]
fn a_free_wall_of_disks_accelerates_by_its_force() {
    a_free_wall_accelerates::<Two>();
}

#[test]
fn a_free_wall_of_spheres_accelerates_by_its_force() {
    a_free_wall_accelerates::<Three>();
}

/// The scheme's own solution under A sin ωt with θ = ωΔt, from x(k+1) - 2x(k) + x(k-1) = a(k) Δt²:
/// x(k) = a Δt² (k cot(θ/2)/2 - sin(kθ)/(4 sin²(θ/2))).
#[test]
fn a_free_wall_oscillates_by_its_force() {
    let (amplitude, turns, steps) = (1.0, 1.0 / 80.0, 400);
    let course = Course {
        wave: Some(Wave {
            amplitude,
            frequency: turns,
        }),
        ..Course::constant(0.0)
    };
    let path = path::<Two>(STEP, &[(Along::Force(course).into(), steps)]);
    let unit = amplitude / wall_mass::<Two>() * STEP * STEP;
    let half = 0.5 * TAU * turns;
    for (k, [x, _]) in path.iter().enumerate() {
        let k = k as f64;
        let wave = (2.0 * half * k).sin() / (4.0 * half.sin().powi(2));
        let expected = unit * (0.5 * k / half.tan() - wave);
        same(*x, expected, unit * (steps * steps) as f64);
    }
    // Over whole cycles it drifts by a t/ω, up to the order of the scheme.
    let omega = TAU * turns / STEP;
    let drift = amplitude / wall_mass::<Two>() * (steps as f64 * STEP) / omega;
    assert!((path[steps as usize][0] / drift - 1.0).abs() < 2.0 * half * half);
}

/// Where a force jumps, either half of the step has its own force; a part with a velocity goes on
/// from where the forces left the wall, and a force from the velocity before it.
#[test]
fn parts_follow_each_other() {
    let mass = wall_mass::<Two>();
    let parts = [
        (Along::Velocity(0.2).into(), 10),
        (constant(4.0).into(), 20),
        (constant(-7.0).into(), 30),
        (Along::Velocity(0.1).into(), 10),
    ];
    let path = path::<Two>(STEP, &parts);
    let [h, a, b] = [STEP, 4.0 / mass, -7.0 / mass];
    let flight = |x: f64, v: f64, a: f64, t: f64| [x + v * t + 0.5 * a * t * t, v + a * t];
    let first = [0.2 * 10.0 * h, 0.2];
    let second = flight(first[0], first[1], a, 20.0 * h);
    let third = flight(second[0], second[1], b, 30.0 * h);
    for (k, expected) in [(10, first), (30, second), (60, third)] {
        same(path[k][0], expected[0], 0.2 * 60.0 * h);
        same(path[k][1], expected[1], 0.2);
    }
    same(path[70][0], third[0] + 0.1 * 10.0 * h, 0.2 * 60.0 * h);
    assert_eq!(path[70][1], 0.1);
}

/// The time that all layers below are followed for (s): some oscillations of a contact.
fn duration<D: Dimension>() -> f64 {
    14.0 * (DENSITY * D::volume(RADIUS) / SPRINGS.normal_stiffness).sqrt()
}

const COARSEST: u64 = 100;
const HALVINGS: usize = 4;

/// Positions and velocities of all grains at the end of a protocol that imposes this on two layers,
/// with Δt a power of two smaller.
fn end<D: Dimension>(
    servo: Option<Servo>,
    halvings: usize,
    imposed: &impl Fn(f64) -> Vec<(Imposed, f64)>,
) -> Vec<f64>
where
    Hooke<D, true, false>: PairForce<D>,
{
    let steps = COARSEST << halvings;
    let step = duration::<D>() / steps as f64;
    let parts = imposed(step).into_iter();
    let parts = parts.map(|(of, share)| (of, (share * steps as f64).round() as u64));
    let mut rig = Rig::<D>::under(servo, (2, 0.0), step, Protocol::of(step, parts));
    for _ in 0..steps {
        rig.advance();
    }
    let time = duration::<D>() / TAU;
    let mut state = vec![
        rig.walls.motion.piston.height,
        rig.walls.motion.slider.state.displacement,
    ];
    for grain in rig.system.grain_states() {
        assert_eq!(grain.image, [0; 3]);
        state.extend(grain.position);
        state.extend(grain.velocity.map(|v| v * time));
        state.extend(grain.angular_velocity.map(|w| w * RADIUS * time));
    }
    state
}

/// The differences between successive halvings of Δt fall by four.
fn is_second_order<D: Dimension>(name: &str, imposed: impl Fn(f64) -> Vec<(Imposed, f64)>)
where
    Hooke<D, true, false>: PairForce<D>,
{
    is_second_order_under::<D>(None, name, imposed);
}

/// The same with the load by a servo.
fn is_second_order_under<D: Dimension>(
    servo: Option<Servo>,
    name: &str,
    imposed: impl Fn(f64) -> Vec<(Imposed, f64)>,
) where
    Hooke<D, true, false>: PairForce<D>,
{
    let ends: Vec<_> = (0..=HALVINGS)
        .map(|h| end::<D>(servo, h, &imposed))
        .collect();
    let apart = |pair: &[Vec<f64>]| {
        let differences = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f64::max)
    };
    let errors: Vec<f64> = ends.windows(2).map(apart).collect();
    assert!(errors[0] > 1e-9 * RADIUS, "{name}: {errors:?}");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        println!("{name}: {:e}, order {order:.3}", pair[0]);
        assert!((1.9..=2.1).contains(&order), "{name}: {errors:?}");
    }
}

/// A sinusoid of so many cycles in the whole time.
fn wave<D: Dimension>(amplitude: f64, cycles: f64, step: f64) -> Wave {
    Wave {
        amplitude,
        frequency: cycles * step / duration::<D>(),
    }
}

fn oscillating_load<D: Dimension>(step: f64) -> Imposed {
    let load = rest_load::<D>();
    Imposed {
        normal: Some(Normal::Load(Course {
            from: load,
            to: 1.1 * load,
            wave: Some(wave::<D>(0.2 * load, 1.3, step)),
        })),
        ..Along::Velocity(0.0).into()
    }
}

fn cyclic_strain<D: Dimension>(step: f64) -> Imposed {
    Along::Oscillation(wave::<D>(0.02 * RADIUS, 0.7, step)).into()
}

fn of_every_part<D: Dimension>()
where
    Hooke<D, true, false>: PairForce<D>,
{
    let load = rest_load::<D>();
    is_second_order::<D>("vibrating load", |step| {
        vec![(oscillating_load::<D>(step), 1.0)]
    });
    is_second_order::<D>("cyclic strain", |step| {
        vec![(cyclic_strain::<D>(step), 1.0)]
    });
    is_second_order::<D>("cyclic strain at constant volume", |step| {
        let fixed = Imposed {
            normal: Some(Normal::Velocity(0.0)),
            ..cyclic_strain::<D>(step)
        };
        vec![(fixed, 1.0)]
    });
    is_second_order::<D>("vibrating bottom", |step| {
        let vibrating = Imposed {
            bottom: Some(wave::<D>(0.01 * RADIUS, 1.2, step)),
            ..Along::Velocity(0.0).into()
        };
        vec![(vibrating, 1.0)]
    });
    is_second_order::<D>("cyclic shear stress", |step| {
        let course = Course {
            from: 0.0,
            to: 0.1 * load,
            wave: Some(wave::<D>(0.1 * load, 1.6, step)),
        };
        vec![(Along::Force(course).into(), 1.0)]
    });
    // Steps of the load and of the shear stress.
    is_second_order::<D>("steps of both loads", |_| {
        let step_to = |load: f64, force: f64| Imposed {
            normal: Some(Normal::Load(Course::constant(load))),
            ..constant(force).into()
        };
        vec![
            (step_to(load, 0.05 * load), 0.5),
            (step_to(1.2 * load, -0.05 * load), 0.5),
        ]
    });
}

/// K (N/m; Pa in 2D) and C of a top wall on the bottom wall.
fn rigidity<D: Dimension>() -> [f64; 2] {
    let contacts = SIDE.pow(D::UP as u32) as f64;
    let (k, mass) = (SPRINGS.normal_stiffness, wall_mass::<D>() / contacts);
    let damping = 2.0 * SPRINGS.damping_ratio * (0.5 * k * mass).sqrt();
    [contacts * k, contacts * damping]
}

/// A servo that nothing holds falls at gain N, or at its greatest speed.
fn a_free_servo_falls<D: Dimension>()
where
    Hooke<D, true, false>: PairForce<D>,
{
    const STEPS: u64 = 100;
    let hold = || Protocol::new(STEP, [(0.0, STEPS)]);
    let gain = RADIUS / (1000.0 * STEP) / rest_load::<D>();
    for (fastest, speed) in [
        (f64::MAX, RADIUS / (1000.0 * STEP)),
        (RADIUS / (3000.0 * STEP), RADIUS / (3000.0 * STEP)),
    ] {
        let servo = Servo { gain, fastest };
        let mut rig = Rig::<D>::under(Some(servo), (0, RADIUS), STEP, hold());
        let start = rig.walls.motion.piston.height;
        for k in 1..=STEPS {
            rig.advance();
            let height = start - speed * (k as f64 * STEP);
            same(rig.walls.motion.piston.height, height, start);
            same(rig.walls.motion.piston.velocity, -speed, speed);
        }
    }
}

#[test]
fn a_free_servo_of_disks_falls_at_its_speed() {
    a_free_servo_falls::<Two>();
}

#[test]
fn a_free_servo_of_spheres_falls_at_its_speed() {
    a_free_servo_falls::<Three>();
}

/// How far the top fell on one free layer, over the overlap at rest, after every step under a load
/// that rises to 1.1 times that of the start.
fn fall<D: Dimension>(gain: f64, step: f64, steps: u64) -> Vec<f64>
where
    Hooke<D, true, false>: PairForce<D>,
{
    let load = rest_load::<D>();
    let ramp = Course {
        from: load,
        to: 1.1 * load,
        wave: None,
    };
    let imposed = Imposed {
        normal: Some(Normal::Load(ramp)),
        ..Along::Velocity(0.0).into()
    };
    let servo = Servo {
        gain,
        fastest: f64::MAX,
    };
    let protocol = Protocol::of(step, [(imposed, steps)]);
    let mut rig = Rig::<D>::under(Some(servo), (1, 0.0), step, protocol);
    let start = rig.walls.motion.piston.height;
    let mut fallen = vec![0.0];
    for _ in 0..steps {
        rig.advance();
        fallen.push((start - rig.walls.motion.piston.height) / (2.0 * RADIUS - SPACING));
    }
    fallen
}

/// The same by the Runge–Kutta method of fourth order: two springs and dampers with the free mass
/// between them, and v = gain (F - N) with the damper in F, solved for v. Lengths in overlaps at
/// rest.
fn fall_by_runge_kutta([k, c, mass]: [f64; 3], gain: f64, time: f64) -> f64 {
    // Of the free grains downwards and of the top: how far, and how fast the free ones.
    let rate = |t: f64, [grain, velocity, top]: [f64; 3]| {
        let of_top =
            gain * (0.1 * k * t / time - k * (top - grain) + c * velocity) / (1.0 + gain * c);
        let above = k * (top - grain) + c * (of_top - velocity);
        let below = k * grain + c * velocity;
        [velocity, (above - below) / mass, of_top]
    };
    let steps = 4000;
    let h = time / f64::from(steps);
    let mut y = [0.0; 3];
    let add = |y: [f64; 3], by: f64, d: [f64; 3]| std::array::from_fn(|i| y[i] + by * d[i]);
    for step in 0..steps {
        let t = f64::from(step) * h;
        let k1 = rate(t, y);
        let k2 = rate(t + 0.5 * h, add(y, 0.5 * h, k1));
        let k3 = rate(t + 0.5 * h, add(y, 0.5 * h, k2));
        let k4 = rate(t + h, add(y, h, k3));
        for i in 0..3 {
            y[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
    }
    y[2]
}

fn a_servo_follows_its_equation<D: Dimension>()
where
    Hooke<D, true, false>: PairForce<D>,
{
    let [k, c] = rigidity::<D>();
    let mass = wall_mass::<D>();
    let gain = 0.1 / c;
    let time = 1.5 / (gain * k);
    let expected = fall_by_runge_kutta([k, c, mass], gain, time);
    assert!((0.02..0.2).contains(&expected), "{expected}");
    let error = |steps: u64| {
        let fallen = fall::<D>(gain, time / steps as f64, steps);
        (fallen[steps as usize] - expected).abs()
    };
    let errors = [100, 200, 400, 800].map(error);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.9..=2.1).contains(&order), "{errors:?}");
    }
}

#[test]
fn a_servo_on_disks_follows_its_equation() {
    a_servo_follows_its_equation::<Two>();
}

#[test]
fn a_servo_on_spheres_follows_its_equation() {
    a_servo_follows_its_equation::<Three>();
}

/// gain (K Δt + 3 C) = 1 is the bound, of a wall far lighter than the grains below it.
#[test]
fn a_servo_is_stable_up_to_its_bound() {
    let [k, c] = rigidity::<Two>();
    for step in [0.02, 0.1] {
        let step = step * (wall_mass::<Two>() / k).sqrt();
        for (part, is_stable) in [(0.9, true), (1.1, false)] {
            let gain = part / (k * step + 3.0 * c);
            let fallen = fall::<Two>(gain, step, 100);
            let steps = fallen[90..].windows(3);
            let shakes = steps.map(|x| (x[0] - 2.0 * x[1] + x[2]).abs());
            let most = shakes.fold(0.0, f64::max);
            assert_eq!(most < 0.01, is_stable, "{step:e} {part} {most}");
        }
    }
}

fn of_a_servo<D: Dimension>()
where
    Hooke<D, true, false>: PairForce<D>,
{
    let [k, c] = rigidity::<D>();
    let load = rest_load::<D>();
    let servo = Some(Servo {
        gain: 0.1 / c,
        fastest: f64::MAX,
    });
    assert!(duration::<D>() * 0.1 * k / c > 1.0);
    is_second_order_under::<D>(servo, "vibrating load by a servo", |step| {
        vec![(oscillating_load::<D>(step), 1.0)]
    });
    // A ramp that ends in a constant load: a jump would be one of the velocity.
    is_second_order_under::<D>(servo, "ramp of the load by a servo", |_| {
        let part = |from: f64, to: f64| Imposed {
            normal: Some(Normal::Load(Course {
                from,
                to,
                wave: None,
            })),
            ..constant(0.05 * load).into()
        };
        vec![
            (part(load, 1.2 * load), 0.5),
            (part(1.2 * load, 1.2 * load), 0.5),
        ]
    });
}

#[test]
fn layers_of_disks_under_a_servo_are_second_order() {
    of_a_servo::<Two>();
}

#[test]
fn layers_of_spheres_under_a_servo_are_second_order() {
    of_a_servo::<Three>();
}

#[test]
fn layers_of_disks_are_second_order() {
    of_every_part::<Two>();
}

#[test]
fn layers_of_spheres_are_second_order() {
    of_every_part::<Three>();
}

/// Half the skin of the rig is a tenth of a radius. A wall that moves further in a step says what
/// to change; one that moves by less does not fail.
#[test]
fn a_wall_that_leaves_the_list_says_what_to_change() {
    let half = 0.1 * RADIUS;
    let first = |speed: f64| {
        let protocol = Protocol::new(STEP, [(speed, 10)]);
        let mut rig = Rig::<Two>::new(0, 100.0 * RADIUS, STEP, protocol);
        let request = StepRequest::default();
        advance(&Solo, &mut rig.system, &rig.law, &mut rig.walls, request)
    };
    assert_eq!(first(0.99 * half / STEP), Ok(false));
    let failure = first(1.01 * half / STEP).expect_err("too fast");
    assert_eq!(failure.exit_code(), 3);
    let words = failure.to_string();
    for part in [
        "step 1: grain ",
        " of a wall at (",
        "half the skin of the neighbour list (1.000e-4 m)",
        // It falls, too.
        "at 1.01",
        "a smaller time.step, or a greater bookkeeping.skin",
    ] {
        assert!(words.contains(part), "no {part:?} in {words}");
    }
}
