//! What a protocol imposes on walls, step by step: closed forms of a wall without contacts, and the
//! order in Δt of a layer between walls.

use std::f64::consts::TAU;

use gshear_dem::budget::{EnergyBalance, EnergyBudget, SampleState};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{GrainWalls, Servo, Slider, Top};
use gshear_dem::laws::LawSpace;
use gshear_dem::laws::hooke::Springs;
use gshear_dem::protocol::{Along, Course, Imposed, Normal, Protocol, Vibration};
use gshear_dem::state::{Cell, Masses, body};
use gshear_dem::step::{Advanced, StepRequest, advance, initial_forces};
use gshear_dem::system::Setup;
use gshear_dem::wave::Wave;

use crate::common::{
    RADIUS, Rig, assert_order, dot, elastic, frictional, hooke, periods, piston, runge_kutta,
};

const DENSITY: f64 = 2500.0;
/// Grains along every periodic axis.
const SIDE: usize = 4;
/// Nearer than two radii: the layers overlap.
const SPACING: f64 = 1.96 * RADIUS;
const SPRINGS: Springs = Springs {
    damping_ratio: 0.1,
    ..elastic(1e7, 4e6, DENSITY)
};

/// A square or cubic lattice between two walls, with so many layers of free grains between them and
/// contacts that stick; `gap` (m) separates the top from what is below it. The load, by a servo if
/// there is one, is that under which the lattice is at rest.
fn between_walls<D: LawSpace>(
    servo: Option<Servo>,
    (layers, gap): (usize, f64),
    step: f64,
    protocol: Protocol,
) -> Rig<D, GrainWalls> {
    let length = SIDE as f64 * SPACING;
    let cell = Cell::between_walls(periods::<D>(length, length));
    let setup = Setup::new(cell, RADIUS, Masses::Density(DENSITY), step).with_skin(0.1);
    let height = (layers + 1) as f64 * SPACING + gap;
    let piston = piston(height, wall_mass::<D>(), rest_load::<D>());
    let slider = Slider::new(protocol, None);
    let mut walls = GrainWalls::new(Top::new(piston, slider, servo, true));
    let [top, bottom] = walls.motion.begin();
    let grains = crate::common::layers::<D>((SIDE, layers + 2), SPACING, |grain| {
        let [along, up] = match grain.body {
            body::BOTTOM => bottom,
            body::TOP => {
                grain.position[D::UP] += gap;
                top
            }
            _ => return,
        };
        (grain.velocity[0], grain.velocity[D::UP]) = (along, up);
    });
    let law = hooke(SPRINGS, &frictional(10.0));
    Rig::new(setup, law, walls, (grains, Vec::new()))
}

/// A top that touches nothing.
fn free_top<D: LawSpace>(step: f64, protocol: Protocol) -> Rig<D, GrainWalls> {
    between_walls(None, (0, 100.0 * RADIUS), step, protocol)
}

/// The load that holds the lattice (N; N/m in 2D).
fn rest_load<D: Dimension>() -> f64 {
    let overlap = 2.0 * RADIUS - SPACING;
    SIDE.pow(D::UP as u32) as f64 * SPRINGS.normal_stiffness * overlap
}

fn constant(force: f64) -> Along {
    Along::Force(Course::constant(force))
}

fn ramp(from: f64, to: f64) -> Course {
    Course {
        from,
        to,
        wave: None,
    }
}

fn with_normal(normal: Normal, along: impl Into<Imposed>) -> Imposed {
    Imposed {
        normal: Some(normal),
        ..along.into()
    }
}

/// Position along x and velocity of a top that touches nothing, after every step.
fn path<D: LawSpace>(step: f64, parts: &[(Imposed, u64)]) -> Vec<[f64; 2]> {
    let at_its_height =
        |&(of, steps): &(Imposed, u64)| (with_normal(Normal::Velocity(0.0), of), steps);
    let protocol = Protocol::of(step, parts.iter().map(at_its_height));
    let steps = protocol.steps();
    let mut rig = free_top::<D>(step, protocol);
    let mut path = vec![[0.0, rig.walls.motion.slider.state.velocity]];
    for _ in 0..steps {
        rig.step();
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
fn a_free_wall_accelerates<D: LawSpace>() {
    const STEPS: u64 = 500;
    let mass = wall_mass::<D>();
    let force = 100.0 * mass;
    let all = STEPS as f64 * STEP;
    for end in [force, -2.0 * force] {
        let course = ramp(force, end);
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
    let falling = with_normal(Normal::Load(Course::constant(load)), constant(force));
    let mut rig = free_top::<D>(STEP, Protocol::of(STEP, [(falling, STEPS)]));
    let start = rig.walls.motion.piston.height;
    for k in 1..=STEPS {
        rig.step();
        let t = k as f64 * STEP;
        let height = start - 0.5 * load / mass * t * t;
        same(rig.walls.motion.piston.height, height, start);
    }
    assert!(start - rig.walls.motion.piston.height > RADIUS);
}

#[test]
fn a_free_wall_accelerates_by_its_force() {
    a_free_wall_accelerates::<Two>();
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
            phase: 0.0,
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

/// A bottom that touches nothing is where its sinusoids say, also where it crosses the seam, and
/// stays where its part ends; its grains have the derivatives.
fn a_bottom_vibrates<D: LawSpace>() {
    const STEPS: u64 = 400;
    let sinusoid = |amplitude: f64, cycles: f64, phase: f64| Wave {
        amplitude,
        frequency: cycles / STEPS as f64,
        phase,
    };
    let bottom = Vibration {
        along: Some(sinusoid(1.5 * RADIUS, 2.75, 0.15)),
        normal: Some(sinusoid(0.5 * RADIUS, 1.25, 0.0)),
    };
    let vibrating = Imposed {
        bottom,
        ..with_normal(Normal::Velocity(0.0), Along::Velocity(0.0))
    };
    let at_rest = with_normal(Normal::Velocity(0.0), Along::Velocity(0.0));
    let protocol = Protocol::of(STEP, [(vibrating, STEPS), (at_rest, 10)]);
    let mut rig = free_top::<D>(STEP, protocol);
    let sines = |t: f64| {
        let moved = |wave: &Wave| {
            let turn = |t: f64| TAU * (wave.frequency * t / STEP + wave.phase);
            let rate = TAU * wave.frequency / STEP;
            let [begin, now] = [0.0, t].map(turn);
            let way = wave.amplitude * (now.sin() - begin.sin());
            (way, wave.amplitude * rate * now.cos())
        };
        let axes = [bottom.along, bottom.normal];
        axes.map(|wave| moved(&wave.expect("both vibrate")))
    };
    let of_bottom = |rig: &mut Rig<D, GrainWalls>| {
        let grains = rig.system.grain_states().into_iter();
        let mut grains: Vec<_> = grains.filter(|grain| grain.body == body::BOTTOM).collect();
        grains.sort_by_key(|grain| grain.id);
        grains
    };
    let start = of_bottom(&mut rig);
    assert_eq!(start.len(), SIDE.pow(D::UP as u32));
    let period = SIDE as f64 * SPACING;
    for k in 1..=STEPS + 10 {
        rig.step();
        let t = k.min(STEPS) as f64 * STEP;
        let [(along, along_rate), (up, up_rate)] = sines(t);
        let is_over = k > STEPS;
        for (grain, start) in of_bottom(&mut rig).iter().zip(&start) {
            let unwrapped = grain.position[0] + grain.image[0] as f64 * period;
            same(unwrapped - start.position[0], along, period);
            same(grain.position[D::UP] - start.position[D::UP], up, period);
            let rates = [along_rate, up_rate].map(|v| if is_over { 0.0 } else { v });
            same(grain.velocity[0], rates[0], RADIUS / STEP);
            same(grain.velocity[D::UP], rates[1], RADIUS / STEP);
        }
    }
    let images: Vec<_> = of_bottom(&mut rig).iter().map(|g| g.image[0]).collect();
    assert!(images.iter().any(|image| *image != 0), "{images:?}");
}

#[test]
fn a_bottom_vibrates_by_its_sinusoids() {
    a_bottom_vibrates::<Two>();
    a_bottom_vibrates::<Three>();
}

/// The energy budget at the end of a vibration of the bottom along x under a top at its place, with
/// Δt a power of two smaller.
fn budget_of_vibration<D: LawSpace>(halvings: usize) -> EnergyBalance {
    let steps = COARSEST << halvings;
    let step = duration::<D>() / steps as f64;
    let vibrating = Imposed {
        bottom: Vibration {
            along: Some(wave::<D>(0.02 * RADIUS, 1.7, step)),
            normal: None,
        },
        ..with_normal(Normal::Velocity(0.0), Along::Velocity(0.0))
    };
    let protocol = Protocol::of(step, [(vibrating, steps)]);
    let mut rig = between_walls::<D>(None, (2, 0.0), step, protocol);
    let mut budget = EnergyBudget::new(rig.system.grains().units, RADIUS);
    rig.system.budget = Some(budget.clone());
    let (law, samples) = (rig.law.as_ref(), Some(&mut rig.samples));
    initial_forces(&Solo, &mut rig.system, law, &mut rig.walls, samples).expect("sound");
    let mut balance = |rig: &mut Rig<D, GrainWalls>| {
        let free = rig.system.grain_states().into_iter();
        let kinetic = free.filter(|grain| grain.body == body::FREE).map(|grain| {
            let rim = grain.angular_velocity.map(|w| w * RADIUS);
            let mass = DENSITY * D::volume(RADIUS);
            0.5 * mass * (dot(grain.velocity, grain.velocity) + D::INERTIA * dot(rim, rim))
        });
        let kinetic = kinetic.sum();
        budget = rig.system.budget.take().expect("a budget");
        let sample = SampleState {
            contacts: &rig.system.contacts,
            overlap: &rig.samples.overlap,
            load: rest_load::<D>(),
            height: rig.walls.motion.piston.height,
            kinetic,
            potential: 0.0,
            gravity: [0.0; 2],
        };
        let balance = budget.balance(&Solo, rig.system.isa, rig.law.as_ref(), sample);
        rig.system.budget = Some(budget.clone());
        balance
    };
    balance(&mut rig);
    rig.advance(steps as usize);
    balance(&mut rig)
}

/// The work of a bottom that vibrates along x closes the budget, to second order in Δt.
fn budgets_are_closed<D: LawSpace>() {
    let of_vibration: Vec<_> = (0..=HALVINGS).map(budget_of_vibration::<D>).collect();
    let finest = &of_vibration[HALVINGS];
    assert!(
        finest.work_drive > 0.0 && finest.work_load == 0.0,
        "{finest:?}"
    );
    assert!(finest.dissipated.iter().sum::<f64>() > 0.1 * finest.work_drive);
    let residuals: Vec<_> = of_vibration.iter().map(|b| b.residual.abs()).collect();
    assert_order("the residual", &residuals, 1.9..=2.1);
}

#[test]
fn a_bottom_along_x_has_its_work_in_the_budget() {
    budgets_are_closed::<Two>();
    budgets_are_closed::<Three>();
}

/// The time that all layers below are followed for (s): some oscillations of a contact.
fn duration<D: Dimension>() -> f64 {
    14.0 * (DENSITY * D::volume(RADIUS) / SPRINGS.normal_stiffness).sqrt()
}

const COARSEST: u64 = 100;
const HALVINGS: usize = 4;

/// Positions and velocities of all grains at the end of a protocol that imposes this on two layers,
/// with Δt a power of two smaller.
fn end<D: LawSpace>(
    servo: Option<Servo>,
    halvings: usize,
    imposed: &impl Fn(f64) -> Vec<(Imposed, f64)>,
) -> Vec<f64> {
    let steps = COARSEST << halvings;
    let step = duration::<D>() / steps as f64;
    let parts = imposed(step).into_iter();
    let parts = parts.map(|(of, share)| (of, (share * steps as f64).round() as u64));
    let mut rig = between_walls::<D>(servo, (2, 0.0), step, Protocol::of(step, parts));
    (0..steps).for_each(|_| rig.step());
    let time = duration::<D>() / TAU;
    let motion = &rig.walls.motion;
    let mut state = vec![motion.piston.height, motion.slider.state.displacement];
    for grain in rig.system.grain_states() {
        assert_eq!(grain.image, [0; 3]);
        state.extend(grain.position);
        state.extend(grain.velocity.map(|v| v * time));
        state.extend(grain.angular_velocity.map(|w| w * RADIUS * time));
    }
    state
}

/// The differences between successive halvings of Δt fall by four.
fn is_second_order<D: LawSpace>(
    servo: Option<Servo>,
    name: &str,
    imposed: impl Fn(f64) -> Vec<(Imposed, f64)>,
) {
    let ends = (0..=HALVINGS).map(|h| end::<D>(servo, h, &imposed));
    let ends: Vec<_> = ends.collect();
    let apart = |pair: &[Vec<f64>]| {
        let differences = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f64::max)
    };
    let errors: Vec<f64> = ends.windows(2).map(apart).collect();
    assert!(errors[0] > 1e-9 * RADIUS, "{name}: {errors:?}");
    assert_order(name, &errors, 1.9..=2.1);
}

/// A sinusoid of so many cycles in the whole time.
fn wave<D: Dimension>(amplitude: f64, cycles: f64, step: f64) -> Wave {
    Wave {
        amplitude,
        frequency: cycles * step / duration::<D>(),
        phase: 0.0,
    }
}

fn oscillating_load<D: Dimension>(step: f64) -> Imposed {
    let load = rest_load::<D>();
    let course = Course {
        wave: Some(wave::<D>(0.2 * load, 1.3, step)),
        ..ramp(load, 1.1 * load)
    };
    with_normal(Normal::Load(course), Along::Velocity(0.0))
}

fn of_every_part<D: LawSpace>() {
    let load = rest_load::<D>();
    let cyclic_strain =
        |step: f64| Imposed::from(Along::Oscillation(wave::<D>(0.02 * RADIUS, 0.7, step)));
    let is_second_order = |name: &str, imposed: &dyn Fn(f64) -> Imposed| {
        is_second_order::<D>(None, name, |step| vec![(imposed(step), 1.0)]);
    };
    is_second_order("vibrating load", &oscillating_load::<D>);
    is_second_order("cyclic strain", &cyclic_strain);
    is_second_order("cyclic strain at constant volume", &|step| {
        with_normal(Normal::Velocity(0.0), cyclic_strain(step))
    });
    is_second_order("vibrating bottom", &|step| Imposed {
        bottom: Vibration {
            normal: Some(wave::<D>(0.01 * RADIUS, 1.2, step)),
            along: None,
        },
        ..Along::Velocity(0.0).into()
    });
    let along = |step: f64| {
        Some(Wave {
            phase: 0.1,
            ..wave::<D>(0.02 * RADIUS, 1.7, step)
        })
    };
    is_second_order("bottom that vibrates along x", &|step| Imposed {
        bottom: Vibration {
            along: along(step),
            normal: None,
        },
        ..Along::Velocity(0.0).into()
    });
    is_second_order("bottom that vibrates both ways under a pull", &|step| {
        Imposed {
            bottom: Vibration {
                along: along(step),
                normal: Some(wave::<D>(0.01 * RADIUS, 1.2, step)),
            },
            ..constant(0.05 * load).into()
        }
    });
    is_second_order("cyclic shear stress", &|step| {
        let course = Course {
            wave: Some(wave::<D>(0.1 * load, 1.6, step)),
            ..ramp(0.0, 0.1 * load)
        };
        Along::Force(course).into()
    });
    // Steps of the load and of the shear stress.
    let part = |load: f64, force: f64| {
        let load = Normal::Load(Course::constant(load));
        (with_normal(load, constant(force)), 0.5)
    };
    self::is_second_order::<D>(None, "steps of both loads", |_| {
        vec![part(load, 0.05 * load), part(1.2 * load, -0.05 * load)]
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
fn a_free_servo_falls<D: LawSpace>() {
    const STEPS: u64 = 100;
    let hold = || Protocol::new(STEP, [(0.0, STEPS)]);
    let gain = RADIUS / (1000.0 * STEP) / rest_load::<D>();
    for (fastest, speed) in [
        (f64::MAX, RADIUS / (1000.0 * STEP)),
        (RADIUS / (3000.0 * STEP), RADIUS / (3000.0 * STEP)),
    ] {
        let servo = Servo { gain, fastest };
        let mut rig = between_walls::<D>(Some(servo), (0, RADIUS), STEP, hold());
        let start = rig.walls.motion.piston.height;
        for k in 1..=STEPS {
            rig.step();
            let height = start - speed * (k as f64 * STEP);
            same(rig.walls.motion.piston.height, height, start);
            same(rig.walls.motion.piston.velocity, -speed, speed);
        }
    }
}

#[test]
fn a_free_servo_falls_at_its_speed() {
    a_free_servo_falls::<Two>();
    a_free_servo_falls::<Three>();
}

fn servo(gain: f64) -> Servo {
    let fastest = f64::MAX;
    Servo { gain, fastest }
}

/// How far the top fell on one free layer, over the overlap at rest, after every step under a load
/// that rises to 1.1 times that of the start.
fn fall<D: LawSpace>(gain: f64, step: f64, steps: u64) -> Vec<f64> {
    let load = rest_load::<D>();
    let imposed = with_normal(Normal::Load(ramp(load, 1.1 * load)), Along::Velocity(0.0));
    let protocol = Protocol::of(step, [(imposed, steps)]);
    let mut rig = between_walls::<D>(Some(servo(gain)), (1, 0.0), step, protocol);
    let start = rig.walls.motion.piston.height;
    let mut fallen = vec![0.0];
    for _ in 0..steps {
        rig.step();
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
    runge_kutta([0.0; 3], (steps, time / f64::from(steps)), rate)[2]
}

fn follows_its_equation<D: LawSpace>() {
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
    assert_order("a servo", &[100, 200, 400, 800].map(error), 1.9..=2.1);
}

#[test]
fn a_servo_follows_its_equation() {
    follows_its_equation::<Two>();
    follows_its_equation::<Three>();
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

fn of_a_servo<D: LawSpace>() {
    let [k, c] = rigidity::<D>();
    let load = rest_load::<D>();
    let servo = Some(servo(0.1 / c));
    assert!(duration::<D>() * 0.1 * k / c > 1.0);
    is_second_order::<D>(servo, "vibrating load by a servo", |step| {
        vec![(oscillating_load::<D>(step), 1.0)]
    });
    // A ramp that ends in a constant load: a jump would be one of the velocity.
    let part = |from: f64, to: f64| {
        let load = Normal::Load(ramp(from * load, to * load));
        (with_normal(load, constant(0.05 * rest_load::<D>())), 0.5)
    };
    is_second_order::<D>(servo, "ramp of the load by a servo", |_| {
        vec![part(1.0, 1.2), part(1.2, 1.2)]
    });
}

#[test]
fn layers_of_disks_are_second_order() {
    of_every_part::<Two>();
    of_a_servo::<Two>();
}

#[test]
fn layers_of_spheres_are_second_order() {
    of_every_part::<Three>();
    of_a_servo::<Three>();
}

/// Half the skin of the rig is a tenth of a radius. A wall that moves further in a step says what
/// to change; one that moves by less does not fail.
#[test]
fn a_wall_that_leaves_the_list_says_what_to_change() {
    let half = 0.1 * RADIUS;
    let first = |speed: f64| {
        let protocol = Protocol::new(STEP, [(speed, 10)]);
        let mut rig = free_top::<Two>(STEP, protocol);
        let (law, request) = (rig.law.as_ref(), StepRequest::default());
        advance(&Solo, &mut rig.system, law, &mut rig.walls, request)
    };
    let one = Advanced {
        steps: 1,
        stop: false,
    };
    assert_eq!(first(0.99 * half / STEP), Ok(one));
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
