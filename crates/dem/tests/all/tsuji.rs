//! Impacts of spheres with the damping of Tsuji: against LAMMPS and the promised restitution, and
//! their energy budget.

use gshear_dem::budget::EnergyBudget;
use gshear_dem::contact::dissipation;
use gshear_dem::dimension::Three;
use gshear_dem::laws::mindlin::MindlinSprings;
use gshear_dem::laws::tsuji::TsujiSpheres;
use gshear_dem::laws::{Constants, Contact};
use gshear_dem::state::{GrainState, Masses};

use crate::common::{Rig, Vector, frictional, norm, undamped};

const RADII: [f64; 2] = [1.0e-3, 1.5e-3];

fn spheres(young_modulus: f64, restitution: f64, tangential_damping_ratio: f64) -> TsujiSpheres {
    TsujiSpheres {
        spheres: undamped(young_modulus, 0.3, 2500.0),
        restitution,
        tangential_damping_ratio,
    }
}

/// Steps of a collision that lasts as long as without dampers.
const STEPS: usize = 32_000;

/// The step (s) of an impact at this speed (m/s).
fn step_of(of: &TsujiSpheres, speed: f64) -> f64 {
    of.collision_time(RADII[0], speed).expect("a time") / STEPS as f64
}

/// The gap (m) between the spheres at the start: more than the rounding of their positions.
const GAP: f64 = 1e-12;

/// Two spheres that are about to touch, the second in the direction n from the first, which is at
/// rest.
struct Impact(Rig<Three>);

impl Impact {
    fn new(
        of: &dyn Constants,
        step: f64,
        contact: &Contact,
        n: Vector,
        velocity: Vector,
        spins: [Vector; 2],
    ) -> Self {
        let law = of.spheres(contact).expect("a law of spheres");
        let distance = RADII[0] + RADII[1] + GAP;
        let of_two = [
            [[0.0; 3], [0.0; 3], spins[0]],
            [n.map(|n| distance * n), velocity, spins[1]],
        ];
        let mut rig = Rig::couple(law, (of.masses(), step), RADII, of_two, Vec::new());
        rig.system.budget = Some(EnergyBudget::new(rig.system.grains().units, RADII[1]));
        Self(rig)
    }

    /// The two spheres after so many steps, when they have separated.
    fn after(&mut self, steps: usize) -> [GrainState; 2] {
        self.0.advance(steps);
        assert_eq!(self.0.system.contacts.touching().count(), 0);
        self.0.ends()
    }
}

/// Spheres that slide throughout, because v_t is ten times v_n, lose μ(1+e) v_n of their tangential
/// velocity, whatever the damper does at the touch, where x v_t exceeds μ v_n; the error shrinks
/// with Δt. Stiff, so that n does not turn much.
#[test]
fn gross_slip_converges() {
    const FRICTION: f64 = 0.3;
    for (ratio, steps) in [(0.5, 2000), (0.5, STEPS), (2.0, 2000), (2.0, STEPS)] {
        let of = spheres(1e14, 0.5, ratio);
        let (n, velocity) = ([1.0, 0.0, 0.0], [-0.1, 0.6, 0.8]);
        let step = step_of(&of, norm(velocity)) * (STEPS / steps) as f64;
        let contact = frictional(FRICTION);
        let mut impact = Impact::new(&of, step, &contact, n, velocity, [[0.0; 3]; 2]);
        let [a, b] = impact.after(3 * steps);
        let [away, y, z] = std::array::from_fn(|k| b.velocity[k] - a.velocity[k]);
        let lost = FRICTION * (0.1 + away);
        let [along, aside] = [0.6 * y + 0.8 * z, 0.8 * y - 0.6 * z];
        assert!(
            (1.0 - along - lost).abs() < 2e-3 * lost,
            "{steps}: {along} after {lost}"
        );
        assert!(aside.abs() < 1e-3 * lost, "{aside}");
    }
}

/// Restitution at speeds over four decades. It exceeds e because the force never pulls.
#[test]
fn restitution_does_not_depend_on_the_speed() {
    let of_impact = [0.397, 0.550, 0.718, 0.902, 1.0];
    for (e, expected) in [0.3, 0.5, 0.7, 0.9, 1.0].into_iter().zip(of_impact) {
        let of = spheres(1e10, e, 0.5);
        let promised = of.restitution_of_impact();
        assert!((promised - expected).abs() < 5e-4, "{e}: {promised}");
        for speed in [1e-3, 0.1, 10.0] {
            let (n, velocity) = ([1.0, 0.0, 0.0], [-speed, 0.0, 0.0]);
            let (step, still) = (step_of(&of, speed), [[0.0; 3]; 2]);
            let mut impact = Impact::new(&of, step, &Contact::NONE, n, velocity, still);
            let [a, b] = impact.after(3 * STEPS);
            let found = (b.velocity[0] - a.velocity[0]) / speed;
            assert!(
                (found - promised).abs() < 2e-4,
                "e = {e} at {speed} m/s: {found} is not {promised}"
            );
        }
    }
}

/// The energy budget after an oblique impact of so many steps, and the part of the loss that it
/// does not explain.
fn explained(
    of: &dyn Constants,
    (step, steps): (f64, usize),
    contact: &Contact,
    spins: [Vector; 2],
) -> ([f64; dissipation::KINDS], f64) {
    let mut impact = Impact::new(of, step, contact, [1.0, 0.0, 0.0], VELOCITY, spins);
    let (_, before) = impact.0.balance();
    impact.after(steps);
    let (entry, after) = impact.0.balance();
    assert_eq!(entry.elastic, [0.0; 3]);
    let lost = entry.dissipated.iter().sum::<f64>();
    let parts = entry.dissipated.map(|part| part / lost);
    (parts, (before - after - lost).abs() / lost)
}

/// Of the oblique impacts (m/s).
const VELOCITY: Vector = [-1.0, 1.5, 0.0];

/// The kinetic energy that an oblique impact takes equals the dissipation, also of spheres that
/// resist rolling and twisting, below their limits and at them.
#[test]
fn the_energy_budget_closes() {
    let spinning = [[900.0, 300.0, -400.0], [-700.0, 500.0, 200.0]];
    // The weak damper leaves the friction most of the work; the other alone exceeds its limit.
    for (ratio, mu, spins) in [
        (0.1, 0.0, [[0.0; 3]; 2]),
        (0.5, 0.05, spinning),
        (0.5, 100.0, spinning),
    ] {
        let contact = Contact {
            rolling_friction: mu,
            rolling_stiffness: Some(3e6),
            rolling_damping_ratio: 0.003,
            twisting_friction: mu / 2.0,
            twisting_stiffness: Some(2e6),
            twisting_damping_ratio: 0.002,
            ..frictional(0.3)
        };
        let of = spheres(1e10, 0.6, ratio);
        let steps = (step_of(&of, norm(VELOCITY)), 3 * STEPS);
        let ([damping, friction, rolling, _], missing) = explained(&of, steps, &contact, spins);
        assert!(
            damping > 0.1 && (friction > 0.1 || mu > 0.0),
            "{damping} {friction}"
        );
        assert_eq!(rolling > 1e-3, mu > 0.0, "{rolling}");
        assert!(missing < 2e-6, "{missing:e} with {mu}");
    }
}

/// The same of the law of Mindlin, which loses energy by sliding alone, also in the step in which
/// the spheres part.
#[test]
fn the_energy_budget_of_mindlin_closes() {
    let law = MindlinSprings {
        normal_stiffness: 1e9,
        tangential_stiffness: 8e8,
        masses: Masses::Density(2500.0),
    };
    let errors = [2e-8, 1e-8].map(|step| {
        let steps = (step, (3e-5 / step) as usize);
        let ([_, friction, ..], missing) = explained(&law, steps, &frictional(0.3), [[0.0; 3]; 2]);
        assert!(friction > 0.5, "{friction}");
        missing
    });
    assert!(
        errors[0] < 1e-4 && errors[1] < 0.5 * errors[0],
        "{errors:?}"
    );
}

/// Oblique impacts of spinning spheres, sticking and sliding, without and with resistance to
/// rolling and twisting, below its limits and at them. Stiff ones against LAMMPS; soft ones, whose
/// overlap reaches 0.15 R, against an integration with the arm R of the torques, where LAMMPS'
/// `granular` has R - δ/2, and no bound of springs that are set back: see lammps/impacts.py.
#[test]
fn impacts_are_those_of_lammps() {
    const SPEED: f64 = 0.2;
    let n = [2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0];
    let aside = [1.0 / 3.0, -2.0 / 3.0, -2.0 / 3.0];
    let spins = [[40.0, -25.0, 60.0], [-60.0, 70.0, -17.5]];
    let text = include_str!("lammps/impacts.txt");
    for row in text.lines().filter(|line| !line.starts_with('#')) {
        let numbers = row.split_whitespace().map(|n| n.parse().expect("a number"));
        let numbers: Vec<f64> = numbers.collect();
        let (of, expected) = numbers.split_first_chunk().expect("a row");
        let [modulus, e, ratio, angle, k, eta, mu, k_w, eta_w, mu_w] = *of;
        let contact = Contact {
            rolling_friction: mu,
            rolling_stiffness: Some(k),
            rolling_damping_ratio: eta,
            twisting_friction: mu_w,
            twisting_stiffness: Some(k_w),
            twisting_damping_ratio: eta_w,
            ..frictional(0.4)
        };
        let (s, c) = angle.to_radians().sin_cos();
        let velocity = std::array::from_fn(|k| SPEED * (s * aside[k] - c * n[k]));
        let of = spheres(modulus, e, ratio);
        let mut impact = Impact::new(&of, step_of(&of, SPEED), &contact, n, velocity, spins);
        let ends = impact.after(3 * STEPS);
        let velocities = ends.map(|g| (g.velocity, SPEED));
        let spins = ends.map(|g| (g.angular_velocity, SPEED / g.radius));
        let found = velocities.into_iter().chain(spins);
        for ((found, scale), expected) in found.zip(expected.chunks_exact(3)) {
            let error = norm(std::array::from_fn(|k| found[k] - expected[k])) / scale;
            assert!(
                error < 2e-5,
                "{row}: {found:?} is not {expected:?}, {error:e}"
            );
        }
    }
}
