//! Errors against run time, for Δt from beyond the limit of stability down: an impact, an
//! oscillation, a sample, its energy; by the program, and with the dampers of LAMMPS.

use std::fmt::Write;
use std::time::Instant;

use gshear_dem::contact::ContactLaw;
use gshear_dem::contact::stiffness::Stiffness;
use gshear_dem::dimension::Two;
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::lee_hurley::{LeeHurley, Material};

use crate::energy::imbalance;
use crate::reference::World;
use crate::sample::Sample;
use crate::scenes::{self, LOOKS, Scene};
use crate::scheme::{Damped, Dampers};

/// The longest Δt over τ = √(m/k); the others are halves of it, and halves of those.
const LONGEST: f64 = 0.4;
/// The default Δt over τ.
pub const DEFAULT: f64 = 0.1;

/// One run, or the mean of several.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Δt/τ.
    pub step: f64,
    pub error: f64,
}

/// A case by one scheme.
pub struct Curve {
    pub case: &'static str,
    pub what: &'static str,
    pub dampers: Dampers,
    /// Time of a step (s) over the number of grains.
    cost: f64,
    pub points: Vec<Point>,
}

impl Curve {
    /// Run time (s) over grains and simulated τ.
    pub fn time(&self, point: &Point) -> f64 {
        self.cost / point.step
    }

    /// Slope of the logarithms of error and Δt, from the default Δt down, by least squares.
    pub fn order(&self) -> f64 {
        let points = self.points.iter().filter(|p| p.step <= DEFAULT);
        let logs: Vec<_> = points.map(|p| [p.step.ln(), p.error.ln()]).collect();
        let mean = |k: usize| logs.iter().map(|p| p[k]).sum::<f64>() / logs.len() as f64;
        let [x, y] = [mean(0), mean(1)];
        let covariance: f64 = logs.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
        let variance: f64 = logs.iter().map(|p| (p[0] - x).powi(2)).sum();
        covariance / variance
    }
}

pub fn measure() -> Vec<Curve> {
    let mut curves = impact();
    curves.extend(oscillation());
    curves.extend(sample());
    curves
}

/// The k-th Δt over τ.
fn rung(k: u32) -> f64 {
    LONGEST / f64::from(1u32 << k)
}

/// A whole oblique impact: errors of velocity and spin after it, root mean square over the phases
/// of the touch in the step.
fn impact() -> Vec<Curve> {
    const PHASES: usize = 16;
    let mut scene = scenes::whole_impact(0.1, 0.5);
    scene.duration = 6.4 * scene.time_scale();
    let error = |steps: usize, dampers: Dampers| {
        let squares = (0..PHASES).map(|phase| {
            let mut scene = scene.clone();
            let late = scene.duration / steps as f64 * phase as f64 / PHASES as f64;
            let moving = &mut scene.grains[1];
            for c in 0..2 {
                moving.position[c] -= late * moving.velocity[c];
            }
            let looks = run(&scene, steps, dampers);
            let [_, velocity, spin, _, _] = after(&scene, &scene.reference(400), &looks);
            velocity.max(spin).powi(2)
        });
        (squares.sum::<f64>() / PHASES as f64).sqrt()
    };
    curves(
        &scene,
        [
            "impact",
            "Oblique impact of two grains: velocity and spin after it",
        ],
        |k, dampers| error(16 << k, dampers),
    )
}

/// A case of few grains by both schemes; `error` at the k-th Δt.
fn curves(scene: &Scene, [case, what]: Case, error: impl Fn(u32, Dampers) -> f64) -> Vec<Curve> {
    const RUNGS: u32 = 10;
    let one = |(dampers, cost)| Curve {
        case,
        what,
        dampers,
        cost,
        points: (0..RUNGS)
            .map(|k| Point {
                step: rung(k),
                error: error(k, dampers),
            })
            .collect(),
    };
    Dampers::BOTH
        .into_iter()
        .zip(costs_of(scene))
        .map(one)
        .collect()
}

/// Errors at the last look alone.
fn after(scene: &Scene, reference: &(World, Vec<Vec<f64>>), looks: &[Vec<f64>]) -> scenes::Errors {
    let (world, expected) = reference;
    let last = [expected[LOOKS - 1].clone()];
    scene.errors(&(world.clone(), last.to_vec()), &looks[LOOKS - 1..])
}

/// A damped oscillation of a loaded, sticking grain: greatest error of all fields.
fn oscillation() -> Vec<Curve> {
    let scene = scenes::oscillation();
    let reference = scene.reference(800);
    assert_eq!(reference.0.switches, [], "the oscillation slides or parts");
    let error = |k: u32, dampers: Dampers| {
        let errors = scene.errors(&reference, &run(&scene, 64 << k, dampers));
        errors.into_iter().fold(0.0, f64::max)
    };
    let what = "Damped oscillation of a loaded contact: worst of x, v, ω, F_{t}, M";
    curves(&scene, ["oscillation", what], error)
}

fn run(scene: &Scene, steps: usize, dampers: Dampers) -> Vec<Vec<f64>> {
    let walls = NoWalls;
    scene.driven(steps, &mut Damped { walls, dampers })
}

/// Time of a step (s) over the number of grains, by either scheme.
fn costs_of(scene: &Scene) -> [f64; 2] {
    const STEPS: usize = 50_000;
    let time = |dampers| {
        let start = Instant::now();
        run(scene, STEPS, dampers);
        start.elapsed().as_secs_f64() / (STEPS * scene.grains.len()) as f64
    };
    let [full, half] = Dampers::BOTH;
    least([&|| time(full), &|| time(half)])
}

/// Span of the sample in τ: so short that it has not forgotten where it came from.
const SPAN: f64 = 102.4;
const RUNGS: u32 = 8;
/// The reference's Δt is that of the last rung over 16.
const FINEST: u32 = RUNGS + 3;

/// 1,000 sheared disks against the program at a much shorter Δt, and the balance of their energy:
/// with the whole law, without rolling torques, and with normal springs alone.
fn sample() -> Vec<Curve> {
    let sample = Sample::prepare();
    let (material, contact) = (sample.material(), sample.scene.contact.clone());
    let undamped = Material {
        damping_ratio: 0.0,
        sliding_damping: 0.0,
        ..material
    };
    let whole = LeeHurley::<true, true>::new(&material, &contact);
    let without_rolling = LeeHurley::<true, false>::new(&material, &contact);
    let springs = LeeHurley::<false, false>::new(&undamped, &contact);
    let [full, half] = Dampers::BOTH;
    let costs = least([
        &|| cost(&sample, whole, full),
        &|| cost(&sample, whole, half),
        &|| cost(&sample, without_rolling, full),
        &|| cost(&sample, without_rolling, half),
        &|| cost(&sample, springs, full),
    ]);
    let both = |k: usize| [(full, costs[k]), (half, costs[k + 1])];
    let mut curves = differences(&sample, whole, &both(0), WHOLE);
    let rest = differences(&sample, without_rolling, &both(2), WITHOUT_ROLLING);
    curves.extend(rest);
    for scheme in both(2) {
        curves.push(energy(&sample, without_rolling, scheme, BALANCE));
    }
    // No dampers, so one scheme.
    let scheme = (full, costs[4]);
    curves.extend(differences(&sample, springs, &[scheme], ELASTIC));
    curves.push(energy(&sample, springs, scheme, ELASTIC_BALANCE));
    curves
}

/// The least of each over many rounds, taken in turn, since what else the machine does comes and
/// goes.
fn least<const K: usize>(times: [&dyn Fn() -> f64; K]) -> [f64; K] {
    const ROUNDS: usize = 10;
    let mut least = [f64::INFINITY; K];
    for _ in 0..ROUNDS {
        for (least, time) in least.iter_mut().zip(times) {
            *least = least.min(time());
        }
    }
    least
}

/// Time of a step (s) over the number of grains, at the default Δt.
fn cost<C: ContactLaw<Space = Two> + Stiffness>(sample: &Sample, law: C, dampers: Dampers) -> f64 {
    const STEPS: usize = 2000;
    let step = DEFAULT * sample.contact_time();
    let time = sample.start(law, step, dampers).go(STEPS);
    time.expect("the default Δt is stable") / (STEPS as f64 * sample.grains())
}

/// Name and description of a case.
type Case = [&'static str; 2];

const WHOLE: [Case; 2] = [
    [
        "positions",
        "1,000 disks sheared for 102 τ: positions (r.m.s.)",
    ],
    [
        "velocities",
        "1,000 disks sheared for 102 τ: velocities (r.m.s.)",
    ],
];
const WITHOUT_ROLLING: [Case; 2] = [
    [
        "positions without rolling",
        "The same without rolling torques: positions (r.m.s.)",
    ],
    [
        "velocities without rolling",
        "The same without rolling torques: velocities (r.m.s.)",
    ],
];
const BALANCE: Case = [
    "energy without rolling",
    "The same without rolling torques: balance of energy",
];
const ELASTIC: [Case; 2] = [
    [
        "elastic positions",
        "With normal springs alone: positions (r.m.s.)",
    ],
    [
        "elastic velocities",
        "With normal springs alone: velocities",
    ],
];
const ELASTIC_BALANCE: Case = [
    "elastic energy",
    "With normal springs alone: balance of energy",
];

fn steps(k: u32) -> usize {
    ((SPAN / LONGEST).round() as usize) << k
}

/// Of positions and velocities, against the program at the finest Δt.
fn differences<C: ContactLaw<Space = Two> + Stiffness>(
    sample: &Sample,
    law: C,
    schemes: &[(Dampers, f64)],
    cases: [Case; 2],
) -> Vec<Curve> {
    let span = SPAN * sample.contact_time();
    let end = |k: u32, dampers: Dampers| {
        let mut moving = sample.start(law, span / steps(k) as f64, dampers);
        moving.go(steps(k))?;
        Some(moving.system.grain_states())
    };
    let right = end(FINEST, Dampers::FullStep).expect("the shortest Δt is stable");
    let mut curves = Vec::new();
    for &(dampers, cost) in schemes {
        let mut points = [Vec::new(), Vec::new()];
        for k in 0..RUNGS {
            // A Δt that is not stable has no point.
            let Some(state) = end(k, dampers) else {
                continue;
            };
            let errors = sample.difference(&state, &right);
            for (points, error) in points.iter_mut().zip(errors) {
                points.push(Point {
                    step: rung(k),
                    error,
                });
            }
        }
        for ([case, what], points) in cases.into_iter().zip(points) {
            curves.push(Curve {
                case,
                what,
                dampers,
                cost,
                points,
            });
        }
    }
    curves.sort_by_key(|c| c.case == cases[1][0]);
    curves
}

fn energy<C: ContactLaw<Space = Two> + Stiffness>(
    sample: &Sample,
    law: C,
    (dampers, cost): (Dampers, f64),
    [case, what]: Case,
) -> Curve {
    let span = SPAN * sample.contact_time();
    let point = |k: u32| {
        let error = imbalance(sample, law, span, steps(k), dampers)?;
        Some(Point {
            step: rung(k),
            error,
        })
    };
    Curve {
        case,
        what,
        dampers,
        cost,
        points: (0..RUNGS).filter_map(point).collect(),
    }
}

/// Writes all points into `docs/figures/accuracy.csv` and prints a table of them.
pub fn write(curves: &[Curve]) {
    let mut csv = String::from("case,dampers,step_over_tau,ns_per_grain_and_tau,error\n");
    for c in curves {
        for p in &c.points {
            writeln!(
                csv,
                "{},{},{},{:.3},{:.4e}",
                c.case,
                if c.dampers == Dampers::FullStep {
                    "full-step"
                } else {
                    "half-step"
                },
                p.step,
                1e9 * c.time(p),
                p.error
            )
            .expect("into a string");
        }
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/figures/accuracy.csv");
    std::fs::write(path, csv).expect("docs/figures/accuracy.csv");
    let (pairs, samples): (Vec<_>, Vec<_>) = curves
        .iter()
        .partition(|c| ["impact", "oscillation"].contains(&c.case));
    println!("{}\n{}", table(&pairs), table(&samples));
}

/// Errors of every case and scheme, a line a Δt; orders below.
fn table(curves: &[&Curve]) -> String {
    let mut out = String::from("| Δt/τ |");
    let head = |c: &Curve| {
        let scheme = if c.dampers == Dampers::FullStep {
            ""
        } else {
            ", half-step dampers"
        };
        format!(" {}{scheme} |", c.case)
    };
    curves.iter().for_each(|c| out += &head(c));
    out += "\n| ---: |";
    curves.iter().for_each(|_| out += " ---: |");
    let longest = curves.iter().map(|c| c.points.len()).max();
    for k in 0..longest.unwrap_or(0) as u32 {
        let step = rung(k);
        write!(out, "\n| {step} |").expect("into a string");
        for c in curves {
            let point = c.points.iter().find(|p| p.step == step);
            out += &point.map_or(" |".into(), |p| format!(" {:.1e} |", p.error));
        }
    }
    out += "\n| order |";
    for c in curves {
        write!(out, " {:.2} |", c.order()).expect("into a string");
    }
    out += "\n| ns per step and grain |";
    for c in curves {
        write!(out, " {:.0} |", 1e9 * c.cost).expect("into a string");
    }
    out + "\n"
}
