//! What the program keeps to rounding: momentum, the balance of torques, a history without slip,
//! bits of every isa.

use gshear_dem::budget::{EnergyBudget, SampleState};
use gshear_dem::dimension::{Dimension, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::ContactForces;
use gshear_dem::simd::Isa;
use gshear_dem::state::{ContactState, GrainState};
use gshear_dem::step::{StepRequest, advance, forces};
use gshear_dem::system::System;

use super::scenes::{LAW, grain, program_law, system};

/// Bound on the relative rounding error of one operation.
const HALF_ULP: f64 = 0.5 * f64::EPSILON;

const COLUMNS: usize = 15;
const ROWS: usize = 20;
const SPACING: f64 = 1.985e-6;
const LENGTH: f64 = COLUMNS as f64 * SPACING;

/// Disks in rows, up to 0.8 % overlapping at the start, driven together, sheared and carried along
/// x across the seam.
fn dense() -> Vec<GrainState> {
    let mut seed = 11u64;
    let mut random = || {
        seed = seed
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..COLUMNS * ROWS)
        .map(|k| {
            let (column, row) = (k / ROWS, k % ROWS);
            let height = row as f64 / (ROWS - 1) as f64 - 0.5;
            let (radius, turn) = (0.99e-6 + 0.01e-6 * random(), 1e6 * (random() - 0.5));
            let x = (column as f64 + 0.25 + 0.5 * (row % 2) as f64) * SPACING;
            let y = row as f64 * 0.866 * SPACING;
            let velocity = [8.0 + 10.0 * height + random(), -20.0 * height];
            grain(k as u32, radius, [x, y], velocity, turn)
        })
        .collect()
}

/// A tenth of √(m/k_n), as the program would choose.
const STEP: f64 = 6e-10;

fn dense_system(isa: Isa) -> System<Two> {
    system::<true, true>(isa, &LAW, LENGTH, STEP, None, dense(), Vec::new(), None)
}

/// Σ terms, as if summed in twice the precision.
fn exact_sum(terms: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut rest) = (0.0, 0.0);
    for term in terms {
        let next: f64 = sum + term;
        let bulk = next - sum;
        rest += (sum - (next - bulk)) + (term - bulk);
        sum = next;
    }
    sum + rest
}

fn mass_of(system: &System<Two>, grain: &GrainState) -> f64 {
    system.masses.of(grain.material, Two::volume(grain.radius))
}

/// Contact forces cancel exactly, pair by pair; what is left is rounding, which is followed here
/// step by step.
///
/// Per step and grain: two kicks round the velocity (each by at most ½ε|u|) and the product with
/// ½Δt/m; up to six additions round the force, each by at most ½ε times the sum of the magnitudes.
/// A rounding error is uniform between its bounds, so its variance is a third of the bound's
/// square; the sum over all steps and grains is held to six standard deviations. ½Δt/m is itself
/// rounded, always the same way for a grain, which adds at most ½ε m|Δu|.
#[test]
fn momentum_is_conserved_to_rounding() {
    const STEPS: usize = 4000;
    let law = program_law::<true, true>(&LAW);
    let mut system = dense_system(Isa::detect());
    let mut drive = NoWalls;
    let start = system.grain_states();
    let mass: Vec<f64> = start.iter().map(|g| mass_of(&system, g)).collect();
    // m u_now - m u_start of all grains, each product with its own rounding error.
    let drift = |now: &[GrainState], c: usize| {
        exact_sum(
            now.iter()
                .zip(&start)
                .zip(&mass)
                .flat_map(|((g, was), &m)| {
                    let (p, q) = (m * g.velocity[c], m * was.velocity[c]);
                    [
                        p,
                        m.mul_add(g.velocity[c], -p),
                        -q,
                        -m.mul_add(was.velocity[c], -q),
                    ]
                }),
        )
    };
    let mut samples = ContactForces::default();
    let mut variance = [0.0; 2];
    let (mut seam, mut sliding, mut last) = (0, 0, start.clone());
    let (mut built, mut pull) = (system.list.rebuilds, vec![0.0; start.len()]);
    for _ in 0..STEPS {
        advance(
            &Solo,
            &mut system,
            &law,
            &mut drive,
            StepRequest::sampled(&mut samples),
        )
        .unwrap();
        let now = system.grain_states();
        // After a rebuild the forces are those of the former list; the pull of the step before
        // stands for them.
        if system.list.rebuilds == built {
            pull.fill(0.0);
            let ids: Vec<usize> = system.grains().id.iter().map(|&id| id as usize).collect();
            for at in system.contacts.touching() {
                let force = samples.normal[at.block].0[at.lane].abs()
                    + samples.tangential[at.block][0].0[at.lane].abs();
                pull[ids[at.i]] += force;
                pull[ids[at.j]] += force;
            }
        }
        built = system.list.rebuilds;
        sliding += (system.contacts.limits.iter())
            .map(|[slides, ..]| slides.count_ones())
            .sum::<u32>();
        for (k, (g, was)) in now.iter().zip(&last).enumerate() {
            seam += u32::from((g.position[0] - was.position[0]).abs() > 0.5 * LENGTH);
            let m = mass[k];
            for (c, v) in variance.iter_mut().enumerate() {
                let speed = HALF_ULP * m * g.velocity[c].abs().max(was.velocity[c].abs());
                let force = HALF_ULP * STEP * pull[k];
                *v += (2.0 * speed * speed + (6.0 + 0.5) * force * force) / 3.0;
            }
        }
        last = now;
        // Rounded to one unit, the forces of all contacts cancel without a remainder.
        for c in 0..2 {
            assert_eq!(system.grains().force.iter().map(|f| f[c]).sum::<f64>(), 0.0);
        }
    }
    assert!(
        seam > 100 && sliding > 20_000,
        "{seam} across the seam, {sliding} sliding"
    );
    for (c, variance) in variance.into_iter().enumerate() {
        let drift = drift(&last, c).abs();
        let sum = |of: &dyn Fn(usize) -> f64| -> f64 { (0..mass.len()).map(of).sum() };
        let change = sum(&|k| mass[k] * (last[k].velocity[c] - start[k].velocity[c]).abs());
        let all = sum(&|k| mass[k] * start[k].velocity[c].abs());
        let bound = HALF_ULP * change + 6.0 * variance.sqrt();
        let (part, of) = (drift / all, bound / all);
        println!("momentum {c}: drift {part:.2e}, bound {of:.2e} of Σ m|v|");
        assert!(drift <= bound, "component {c}: {drift:e} over {bound:e}");
    }
}

/// Every instruction set gives the same state, to the last bit.
#[test]
fn every_instruction_set_gives_the_same_trajectory() {
    let run = |isa: Isa| {
        let law = program_law::<true, true>(&LAW);
        let mut system = dense_system(isa);
        let mut drive = NoWalls;
        for _ in 0..400 {
            advance(&Solo, &mut system, &law, &mut drive, StepRequest::default()).unwrap();
        }
        (system.grain_states(), system.contact_states(&law))
    };
    let expected = run(Isa::Portable);
    assert!(expected.1.len() > 100, "{} contacts", expected.1.len());
    for isa in ["avx2", "avx512"].into_iter().filter_map(Isa::named) {
        let found = run(isa);
        assert!(found == expected, "{} differs", isa.name());
    }
}

/// Two overlapping disks with velocities, spins and histories.
fn pair<const R: bool>(step: f64, samples: &mut ContactForces) -> System<Two> {
    let (r_i, r_j) = (0.7e-6, 1.0e-6);
    let (distance, angle) = ((r_i + r_j) * (1.0 - 3e-3), 0.7f64);
    let place = |s: f64| {
        [
            4e-6 + s * distance * angle.cos(),
            s * distance * angle.sin(),
        ]
    };
    system::<true, R>(
        Isa::detect(),
        &LAW,
        8e-6,
        step,
        Some(0.1),
        vec![
            grain(0, r_i, place(0.5), [-0.2, 0.1], 2e4),
            grain(1, r_j, place(-0.5), [0.3, -0.4], -3e4),
        ],
        vec![ContactState::new(0, 1, [0.2, 0.0, 1e-9])],
        Some(samples),
    )
}

/// Torques are -R_i F_t and -R_j F_t, plus and minus the rolling torque; forces are opposite.
#[test]
fn torques_are_those_of_the_full_radii() {
    let mut samples = ContactForces::default();
    let mut s = pair::<true>(1e-12, &mut samples);
    let tangential = samples.tangential[0][0].0[0];
    let [a, b] = [s.grains().force[0], s.grains().force[1]];
    let (r_i, r_j) = (s.grains().radius[0], s.grains().radius[1]);
    assert!(tangential != 0.0);
    assert_eq!([a[0], a[1]], [-b[0], -b[1]]);
    // The rolling torque drops out. Three products and three sums are rounded, and two torques to
    // the unit.
    let arms = (r_i + r_j) * tangential;
    let scale = a[2].abs() + b[2].abs() + arms.abs();
    assert!((a[2] + b[2] + arms).abs() <= 6.0 * HALF_ULP * scale + s.grains().units.torque);
    let mut samples = ContactForces::default();
    let mut s = pair::<false>(1e-12, &mut samples);
    let tangential = samples.tangential[0][0].0[0];
    for (k, r) in [(0, r_i), (1, r_j)] {
        let torque = s.grains().force[k][2];
        assert!(
            (torque + r * tangential).abs()
                <= 4.0 * HALF_ULP * torque.abs() + 0.5 * s.grains().units.torque,
            "{torque:e}"
        );
    }
    // F_t = F·t̂ with t̂ = ẑ × n, n from j to i.
    let (p, q) = (s.grain_states()[0].position, s.grain_states()[1].position);
    let (dx, dy) = (p[0] - q[0], p[1] - q[1]);
    let f = s.grains().force[0];
    let along = (f[1] * dx - f[0] * dy) / dx.hypot(dy);
    assert!((along - tangential).abs() <= 8.0 * f64::EPSILON * (f[0].abs() + f[1].abs()));
}

/// With arms of the full radii the contact turns the pair as a whole by -δ F_t. The scheme keeps
/// exactly that balance: its kicks act at the positions of the forces, and its drift is along the
/// velocity.
#[test]
fn angular_momentum_changes_by_the_overlap_alone() {
    const STEPS: usize = 2000;
    let step = 5e-12;
    let law = program_law::<true, true>(&LAW);
    let mut samples = ContactForces::default();
    let mut s = pair::<true>(step, &mut samples);
    let mut drive = NoWalls;
    let about = |s: &mut System<Two>| -> f64 {
        let states = s.grain_states();
        exact_sum(states.iter().flat_map(|g| {
            let m = mass_of(s, g);
            let ([x, y, _], [u, v, _]) = (g.position, g.velocity);
            // About a point amid the two.
            let x = x - 4e-6;
            [
                m * x * v,
                -m * y * u,
                0.5 * m * g.radius * g.radius * g.angular_velocity[2],
            ]
        }))
    };
    let turn = |samples: &ContactForces| -samples.overlap[0].0[0] * samples.tangential[0][0].0[0];
    let before = about(&mut s);
    let (mut turned, mut gross, mut size) = (0.0, 0.0, 0.0f64);
    for _ in 0..STEPS {
        let first = turn(&samples);
        advance(
            &Solo,
            &mut s,
            &law,
            &mut drive,
            StepRequest::sampled(&mut samples),
        )
        .unwrap();
        turned += 0.5 * step * (first + turn(&samples));
        gross += step * first.abs();
        // Largest terms in which roundings of x (up to 8e-6), u, v and ω enter.
        let states = s.grain_states();
        let term = |g: &GrainState| {
            let speed = g.velocity[0].hypot(g.velocity[1]);
            mass_of(&s, g) * (8e-6 * speed + g.radius * g.radius * g.angular_velocity[2].abs())
        };
        size = size.max(states.iter().map(term).sum());
    }
    let error = (about(&mut s) - before - turned).abs();
    // Some ten roundings per step, each at most half an ulp of the largest terms, at random: six
    // standard deviations.
    let bound = 6.0 * HALF_ULP * size * (10.0 * STEPS as f64 / 3.0).sqrt();
    println!("angular momentum: turned {turned:.2e}, error {error:.2e}, bound {bound:.2e}");
    assert!(error <= bound, "{error:e} over {bound:e}");
    assert!(gross > 1e3 * bound, "nothing was turned");
}

/// Compression alone changes no F_t^e; unloading lowers it only where the limit μ_s F_n says so.
#[test]
fn overlap_alone_does_not_change_the_tangential_force() {
    let law = program_law::<true, true>(&LAW);
    let radius = 1e-6;
    let history = [0.1, 0.0, 0.0];
    // One above the other, so that v_t is exactly zero while they approach.
    let mut s = system::<true, true>(
        Isa::detect(),
        &LAW,
        8e-6,
        1e-12,
        Some(0.1),
        vec![
            grain(0, radius, [4e-6, 0.0], [0.0, 0.0], 0.0),
            grain(
                1,
                radius,
                [4e-6, 2.0 * radius * (1.0 - 1e-3)],
                [0.0, 0.0],
                0.0,
            ),
        ],
        vec![ContactState::new(0, 1, history)],
        None,
    );
    let mut drive = NoWalls;
    let mut visit = |overlap: f64, speed: f64| {
        let mut samples = ContactForces::default();
        let r = s.grains_mut().fields_mut(1);
        r[Two::UP] = 2.0 * radius * (1.0 - overlap);
        r[Two::VELOCITY + Two::UP] = speed;
        r[Two::HALF_VELOCITY + Two::UP] = speed;
        let outside = forces(&Solo, &mut s, &law, &mut drive, 1e-12, Some(&mut samples));
        assert_eq!(outside, None);
        let force = s.contact_states(&law)[0].history[0];
        (force, LAW.friction * samples.normal[0].0[0])
    };
    for k in 0..100 {
        let (force, limit) = visit(1e-3 * (1.0 + 0.05 * f64::from(k)), -1.0);
        assert_eq!(force, history[0]);
        assert!(limit > force);
    }
    let mut held = history[0];
    let mut limited = 0;
    for k in (0..100).rev() {
        let (force, limit) = visit(6e-5 * f64::from(k) + 1e-6, 1.0);
        assert_eq!(force, held.min(limit));
        limited += u32::from(force < held);
        held = force;
    }
    assert!(limited > 0 && held == 0.0);
}

/// The energy budget of the dense cell, which is driven together and slides: what it dissipated is
/// what its kinetic and elastic energy lack, to a hundredth, and a quarter of Δt leaves less than
/// half of the difference (of first order are the switches of regime).
#[test]
fn energy_is_accounted_for() {
    const STEPS: usize = 400;
    let residual = |parts: usize| {
        let law = program_law::<true, true>(&LAW);
        let step = STEP / parts as f64;
        let mut samples = ContactForces::default();
        let mut system = system::<true, true>(
            Isa::detect(),
            &LAW,
            LENGTH,
            step,
            None,
            dense(),
            Vec::new(),
            Some(&mut samples),
        );
        system.budget = Some(EnergyBudget::new(system.grains().units, 1e-6));
        let mut drive = NoWalls;
        let entry = |system: &mut System<Two>, samples: &ContactForces| {
            let kinetic: f64 = system
                .grain_states()
                .iter()
                .map(|g| {
                    let spin = 0.5 * g.radius.powi(2) * g.angular_velocity[2].powi(2);
                    0.5 * mass_of(system, g)
                        * (g.velocity[0].powi(2) + g.velocity[1].powi(2) + spin)
                })
                .sum();
            let mut budget = system.budget.take().expect("a budget");
            let balance = budget.balance(
                &Solo,
                system.isa,
                &law,
                SampleState {
                    contacts: &system.contacts,
                    overlap: &samples.overlap,
                    load: 0.0,
                    height: 0.0,
                    kinetic,
                    potential: 0.0,
                    gravity: [0.0; 2],
                },
            );
            system.budget = Some(budget);
            (
                kinetic + balance.elastic.iter().sum::<f64>(),
                balance.dissipated,
            )
        };
        let (begin, _) = entry(&mut system, &samples);
        for _ in 0..parts * STEPS {
            advance(
                &Solo,
                &mut system,
                &law,
                &mut drive,
                StepRequest::sampled(&mut samples),
            )
            .unwrap();
        }
        let (end, dissipated) = entry(&mut system, &samples);
        assert!(
            dissipated[..3].iter().all(|&d| d > 1e-3 * begin),
            "{dissipated:?} of {begin:e}"
        );
        (begin - end - dissipated.iter().sum::<f64>()) / (begin - end)
    };
    let (coarse, fine) = (residual(1), residual(4));
    println!("missing of what was dissipated: {coarse:.2e}, with a quarter of the step {fine:.2e}");
    assert!(coarse.abs() < 1e-2, "{coarse:e}");
    assert!(fine.abs() < coarse.abs() / 2.0, "{fine:e} of {coarse:e}");
}
