//! Every law in every dimension it has, with every damper, resistance to rolling, attraction and
//! history: the order of the scheme, and what the energy budget makes of it. In a gas so dense that
//! its grains collide at once, slide, stick, roll and part.

use std::fmt::Write;
use std::sync::Arc;

use gshear_dem::adhesions::constant::Constant;
use gshear_dem::adhesions::jkr::Jkr;
use gshear_dem::budget::EnergyBudget;
use gshear_dem::contact::adhesion::AdhesionModel;
use gshear_dem::contact::dissipation;
use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::laws::hertz::{self, Spheres};
use gshear_dem::laws::hooke::{self, Springs};
use gshear_dem::laws::lee_hurley::{self, Material};
use gshear_dem::laws::mindlin::{self, MindlinSprings};
use gshear_dem::laws::tsuji::{self, TsujiSpheres};
use gshear_dem::laws::{Contact, Law, LawSpace};
use gshear_dem::state::{GrainState, Masses};
use gshear_dem::system::Setup;

use crate::common::{RADIUS, Rig, dot, gas, minus, setup, undamped};

const DENSITY: f64 = 2500.0;

/// A law in a dimension, with what its contacts have beside it.
struct Case {
    dimension: Dimensions,
    law: Law,
    contact: Contact,
    /// Law, damper, rolling and attraction, for the table.
    names: [&'static str; 4],
    /// Whether the errors are of second order. They are not where a damper begins with a jump, or
    /// is alone beyond its limit.
    is_second_order: bool,
}

fn hertzian(damped: bool, remembers_force: bool) -> Spheres {
    let [normal_damping, tangential_damping] = if damped { [3e7, 1.5e7] } else { [0.0; 2] };
    Spheres {
        normal_damping,
        tangential_damping,
        remembers_force,
        ..undamped(4e7, 0.3, DENSITY)
    }
}

/// The laws, and the names of them and their dampers.
fn laws(dimension: Dimensions) -> Vec<(Law, &'static str, &'static str)> {
    let stiffness = match dimension {
        Dimensions::Two => 1e7,
        Dimensions::Three => 1e4,
    };
    let springs = |damping_ratio, sliding_damping| {
        let springs = Springs {
            normal_stiffness: stiffness,
            tangential_stiffness: 0.4 * stiffness,
            density: DENSITY,
            damping_ratio,
            sliding_damping,
            ageing: None,
        };
        Law::of(&hooke::KIND, springs)
    };
    let smoothed = MindlinSprings {
        normal_stiffness: 1e3 * stiffness,
        tangential_stiffness: 5e2 * stiffness,
        masses: Masses::Density(DENSITY),
    };
    let mut all = vec![
        (springs(0.0, 0.0), "hooke", "none"),
        (springs(0.2, 0.0), "hooke", "α = 0.2"),
        (springs(0.2, 0.5), "hooke", "α = 0.2, s = 0.5"),
        (Law::of(&mindlin::KIND, smoothed), "mindlin", "none"),
    ];
    if dimension == Dimensions::Two {
        for (damping_ratio, damper) in [(0.0, "none"), (0.1, "α = 0.1")] {
            let material = Material {
                young_modulus: 5e7,
                poisson_ratio: 0.2,
                density: DENSITY,
                damping_ratio,
                sliding_damping: 0.0,
            };
            all.push((Law::of(&lee_hurley::KIND, material), "lee-hurley", damper));
        }
        return all;
    }
    for (force, hertz_name, tsuji_name) in [
        (false, "hertz", "hertz-tsuji"),
        (true, "hertz, force", "hertz-tsuji, force"),
    ] {
        for (is_damped, damper) in [(false, "none"), (true, "γ_n = 3e7")] {
            let law = Law::of(&hertz::KIND, hertzian(is_damped, force));
            all.push((law, hertz_name, damper));
        }
        let damped = TsujiSpheres {
            spheres: hertzian(false, force),
            restitution: 0.4,
            tangential_damping_ratio: 0.5,
        };
        all.push((Law::of(&tsuji::KIND, damped), tsuji_name, "e = 0.4"));
    }
    all
}

/// Every case of a dimension.
fn cases(dimension: Dimensions) -> Vec<Case> {
    let mut cases = Vec::new();
    let in_space = dimension == Dimensions::Three;
    let depth = if in_space { 1.0 } else { 1e3 };
    for (law, name, damper) in laws(dimension) {
        let constant = Constant { force: 0.1 * depth };
        let mut adhesions: Vec<(Option<Arc<dyn AdhesionModel>>, _)> =
            vec![(None, "none"), (Some(Arc::new(constant)), "constant")];
        if let Some(modulus) = law.contact_modulus() {
            adhesions.push((Some(Arc::new(Jkr::new(0.3, modulus))), "jkr"));
        }
        let rolls = in_space || law.kind().rolling;
        for (adhesion, attracts) in adhesions {
            for (rolling_friction, rolling) in [(0.0, "none"), (0.1, "μ_r = 0.1, η_r = 0.2")] {
                if rolling_friction > 0.0 && !rolls {
                    continue;
                }
                let twists = if in_space { 0.5 } else { 0.0 };
                let contact = Contact {
                    friction: 0.3,
                    rolling_friction,
                    rolling_stiffness: Some(4e3 * depth),
                    rolling_damping_ratio: 0.2,
                    twisting_friction: twists * rolling_friction,
                    twisting_stiffness: None,
                    twisting_damping_ratio: 0.1,
                    adhesion: adhesion.clone(),
                    ..Contact::NONE
                };
                let is_damped = damper != "none" || rolling_friction > 0.0;
                let begins_at_zero = name.starts_with("hertz") && !name.starts_with("hertz-tsuji");
                cases.push(Case {
                    dimension,
                    law: law.clone(),
                    contact,
                    names: [name, damper, rolling, attracts],
                    is_second_order: !is_damped || begins_at_zero || name == "mindlin",
                });
            }
        }
    }
    cases
}

/// Grains of the gas, by id; some are pressed together and spin at the start.
fn grains<D: Dimension>(side: usize, seed: u64) -> Vec<GrainState> {
    let mut all = gas::<D>(side, 0.8, seed);
    let mut random = crate::common::random(seed + 1);
    for grain in &mut all {
        grain.radius *= 1.06;
        for k in 3 - D::SPINS..3 {
            grain.angular_velocity[k] = 800.0 * random();
        }
    }
    all
}

fn rig<D: LawSpace>(case: &Case, side: usize, step: f64, seed: u64) -> Rig<D> {
    let force = D::pair_force(&case.law, &case.contact).expect("a law of this dimension");
    let setup = Setup {
        step,
        masses: case.law.masses(),
        largest_radius: 1.06 * RADIUS,
        ..setup::<D>(side, 0.0, (0.3, 20))
    };
    let walls = gshear_dem::drive::NoWalls;
    Rig::new(setup, force, walls, (grains::<D>(side, seed), Vec::new()))
}

/// Time of a run (s): some durations of a collision.
const TIME: f64 = 6e-4;

/// Orders in Δt of the errors of velocities and spins of the grains: of their median, and of their
/// root mean square.
#[derive(Clone, Copy)]
struct Orders {
    median: f64,
    mean_square: f64,
}

/// Of runs of so many steps and its doubles against one of 32 times as many.
fn orders<D: LawSpace>(case: &Case, side: usize, steps: usize) -> Orders {
    let end = |parts: usize| {
        let count = parts * steps;
        let mut rig = rig::<D>(case, side, TIME / count as f64, 7);
        for _ in 0..count {
            rig.step();
        }
        let mut states = rig.system.grain_states();
        states.sort_by_key(|state| state.id);
        states
    };
    let reference = end(32);
    let sizes = reference.iter().fold([0.0; 2], |[v, w], state| {
        let spin = dot(state.angular_velocity, state.angular_velocity);
        [v + dot(state.velocity, state.velocity), w + spin]
    });
    let squares = |parts: usize| -> Vec<f64> {
        let mut squares: Vec<f64> = end(parts)
            .iter()
            .zip(&reference)
            .map(|(a, b)| {
                let v = minus(a.velocity, b.velocity);
                let w = minus(a.angular_velocity, b.angular_velocity);
                dot(v, v) / sizes[0] + dot(w, w) / sizes[1]
            })
            .collect();
        squares.sort_unstable_by(f64::total_cmp);
        squares
    };
    let [coarse, fine] = [1, 4].map(squares);
    let mean = |of: &[f64]| of.iter().sum::<f64>();
    let middle = coarse.len() / 2;
    // Squares, and two halvings.
    Orders {
        median: 0.25 * (coarse[middle] / fine[middle]).log2(),
        mean_square: 0.25 * (mean(&coarse) / mean(&fine)).log2(),
    }
}

fn orders_of(case: &Case, sides: [usize; 2], steps: usize) -> Orders {
    match case.dimension {
        Dimensions::Two => orders::<Two>(case, sides[0], steps),
        Dimensions::Three => orders::<Three>(case, sides[1], steps),
    }
}

fn all_cases() -> impl Iterator<Item = Case> {
    let [two, three] = [Dimensions::Two, Dimensions::Three].map(cases);
    two.into_iter().chain(three)
}

/// The table docs/figures/orders.csv, and its rows that fall short of their order.
fn table(sides: [usize; 2], steps: usize) -> (String, Vec<String>) {
    let mut text =
        String::from("law,dimension,damper,rolling,attraction,median,root_mean_square\n");
    let mut failures = Vec::new();
    for case in all_cases() {
        let orders = orders_of(&case, sides, steps);
        let [law, damper, rolling, attraction] = case.names;
        let axes = match case.dimension {
            Dimensions::Two => 2,
            Dimensions::Three => 3,
        };
        let line = format!(
            "\"{law}\",{axes},\"{damper}\",\"{rolling}\",\"{attraction}\",{:.2},{:.2}",
            orders.median, orders.mean_square
        );
        writeln!(text, "{line}").expect("a text");
        let least = if case.is_second_order { 1.6 } else { 0.9 };
        if orders.median < least {
            failures.push(line);
        }
    }
    (text, failures)
}

#[test]
fn every_law_is_of_its_order() {
    let (text, failures) = table([8, 4], 75);
    println!("{text}");
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Writes docs/figures/orders.csv: `make accuracy`.
#[test]
#[ignore = "writes into docs/"]
fn write_the_orders_of_every_law() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/figures/orders.csv");
    let (text, _) = table([24, 8], 300);
    std::fs::write(path, text).expect("written");
}

/// Steps between looks at the energies, and how often.
const BETWEEN: usize = 50;
const LOOKS: usize = 60;

/// What of the budget of a run is unsound: parts of the dissipation that give energy back, energy
/// stored before anything worked on it, or missing.
fn unsound<D: LawSpace>(case: &Case, side: usize) -> Vec<String> {
    let mut found = Vec::new();
    let mut rig = rig::<D>(case, side, 2.0 * TIME / (BETWEEN * LOOKS) as f64, 11);
    rig.system.budget = Some(EnergyBudget::new(rig.system.grains().units, 1.06 * RADIUS));
    gshear_dem::step::initial_forces(
        &Solo,
        &mut rig.system,
        rig.law.as_ref(),
        &mut rig.walls,
        Some(&mut rig.samples),
    )
    .expect("sound");
    let (first, kinetic) = rig.balance();
    let begun = kinetic + first.elastic.iter().sum::<f64>();
    let at_first = first.elastic[1].abs() + first.elastic[2].abs();
    if at_first > 1e-13 * begun {
        found.push(format!("{at_first:e} stored at the start"));
    }
    let mut last = [0.0; dissipation::KINDS];
    let mut least = [0.0f64; dissipation::KINDS];
    let mut missing = 0.0f64;
    for _ in 0..LOOKS {
        rig.advance(BETWEEN);
        let (entry, kinetic) = rig.balance();
        for (kind, least) in least.iter_mut().enumerate() {
            *least = least.min(entry.dissipated[kind] - last[kind]);
        }
        last = entry.dissipated;
        let now = kinetic + entry.elastic.iter().sum::<f64>();
        let of_row = begun - now - last.iter().sum::<f64>();
        missing = missing.max(of_row.abs());
    }
    for kind in [
        dissipation::DAMPING,
        dissipation::FRICTION,
        dissipation::ROLLING,
    ] {
        if least[kind] < -1e-6 * begun {
            found.push(format!("{:e} of kind {kind}", least[kind] / begun));
        }
    }
    if missing > 1e-3 * begun {
        found.push(format!("{:e} missing", missing / begun));
    }
    if last[dissipation::FRICTION] < 1e-3 * begun {
        found.push("no friction".into());
    }
    let rolls = case.contact.rolling_friction > 0.0;
    if (last[dissipation::ROLLING] > 1e-4 * begun) != rolls {
        found.push("rolling, or none".into());
    }
    found
}

/// Dampers and sliders never give energy back, and together they dissipate what the grains lose.
#[test]
fn no_part_of_the_dissipation_is_negative() {
    let mut failures = Vec::new();
    for case in all_cases() {
        let found = match case.dimension {
            Dimensions::Two => unsound::<Two>(&case, 8),
            Dimensions::Three => unsound::<Three>(&case, 4),
        };
        if !found.is_empty() {
            failures.push(format!(
                "{:?} {:?}: {}",
                case.names,
                case.dimension,
                found.join(", ")
            ));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
