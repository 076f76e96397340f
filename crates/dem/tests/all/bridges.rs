//! An adhesion of a program of one's own, that of `examples/own_law`: it acts across a gap, beside
//! laws that do not.

use std::f64::consts::PI;
use std::sync::Arc;

use gshear_dem::adhesions::{self, ADHESIONS, AdhesionKind, jkr};
use gshear_dem::budget::EnergyBudget;
use gshear_dem::contact::adhesion::Adhesion;
use gshear_dem::contact::dissipation;
use gshear_dem::contact::stiffness::SpringState;
use gshear_dem::dimension::{Dimension, Three};
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::hertz::Spheres;
use gshear_dem::laws::hooke::{self, Springs};
use gshear_dem::laws::{Contact, Law, LawSpace, hertz};
use gshear_dem::simd::Isa;
use gshear_dem::state::GrainState;
use gshear_dem::system::Setup;

use crate::common::{self, RADIUS, Rig, elastic, frictional, gas, minus, norm, undamped};

#[path = "../../../../examples/own_law/src/liquid_bridge.rs"]
mod liquid_bridge;

use liquid_bridge::LiquidBridge;

const RADII: [f64; 2] = [1.0e-3, 1.5e-3];
/// γ (N/m), V (m³) and θ.
const TENSION: f64 = 0.07;
const VOLUME: f64 = 8e-12;
const ANGLE: f64 = 0.3;

/// s_c (m): (1 + θ/2) V^(1/3).
const RUPTURE: f64 = (1.0 + 0.5 * ANGLE) * 2e-4;

fn bridge() -> LiquidBridge {
    LiquidBridge::new(TENSION, VOLUME, ANGLE)
}

fn wet(friction: f64) -> Contact {
    Contact {
        adhesion: Some(Arc::new(bridge())),
        ..frictional(friction)
    }
}

fn reduced() -> f64 {
    RADII[0] * RADII[1] / (RADII[0] + RADII[1])
}

/// F_c (N) at the gap s (m): with the harmonic mean 2R* of the radii for R,
///
/// ```text
/// F_c = 2πRγ cos θ (1 - 1/√(1 + 2V/(πRs²)))
/// ```
fn force_at(gap: f64) -> f64 {
    let radius = 2.0 * reduced();
    let bridged = 2.0 * VOLUME / (PI * radius * gap * gap);
    2.0 * PI * radius * TENSION * ANGLE.cos() * (1.0 - 1.0 / (1.0 + bridged).sqrt())
}

/// ∫F_c ds (J) up to s_c, by Simpson's rule.
fn work() -> f64 {
    let parts = 2000;
    let at = |k: usize| force_at((k as f64 / parts as f64 * RUPTURE).max(1e-12));
    let weight = |k: usize| [2.0, 4.0][k % 2];
    let inner: f64 = (1..parts).map(|k| weight(k) * at(k)).sum();
    (at(0) + inner + at(parts)) * RUPTURE / (3 * parts) as f64
}

const SPHERES: Spheres = undamped(1e8, 0.3, 2500.0);

fn law() -> Law {
    Law::of(&hertz::KIND, SPHERES)
}

fn reduced_mass() -> f64 {
    let [a, b] = RADII.map(|r| law().masses().of(0, Three::volume(r)));
    a * b / (a + b)
}

/// Two spheres beside each other along x, the first at rest.
struct Pair(Rig<Three>);

impl Pair {
    /// Of Hertzian spheres, with a gap (m), a velocity (m/s) of the second, and Δt (s).
    fn new(contact: &Contact, gap: f64, velocity: [f64; 3], step: f64) -> Self {
        Self::beside(&law(), contact, gap, velocity, step)
    }

    fn beside(law: &Law, contact: &Contact, gap: f64, velocity: [f64; 3], step: f64) -> Self {
        let place = [RADII[0] + RADII[1] + gap, 0.0, 0.0];
        let ends = [[[0.0; 3]; 3], [place, velocity, [0.0; 3]]];
        let masses = law.masses();
        let force = Three::pair_force(law, contact).expect("a law of spheres");
        Self(Rig::couple(force, (masses, step), RADII, ends, Vec::new()))
    }

    /// The gap (m) and the velocity (m/s) at which the pair separates.
    fn motion(&mut self) -> [f64; 2] {
        let [a, b] = self.0.ends();
        let gap = norm(minus(b.position, a.position)) - RADII[0] - RADII[1];
        [gap, b.velocity[0] - a.velocity[0]]
    }
}

/// A bridge forms at the touch, not before; it pulls by the formula up to s_c, and not beyond, also
/// where the spheres come near again without a touch.
#[test]
fn a_bridge_forms_at_the_touch_and_breaks_at_its_distance() {
    let touch = 4.0 * PI * TENSION * ANGLE.cos() * reduced();
    let speed = 2.0 * (2.0 * work() / reduced_mass()).sqrt();
    let step = 1e-3 * RUPTURE / speed;
    let mut pair = Pair::new(&wet(0.0), 0.5 * RUPTURE, [-speed, 0.0, 0.0], step);
    let (mut last, mut has_touched) = (0.0f64, false);
    for _ in 0..10_000 {
        pair.0.advance(1);
        let [gap, _] = pair.motion();
        let Some((normal, _)) = pair.0.contact_force() else {
            assert!(!has_touched || gap > RUPTURE, "{gap:e}");
            continue;
        };
        assert!(gap < RUPTURE, "{gap:e}");
        has_touched |= gap < 0.0;
        assert!(has_touched, "a bridge across {gap:e} before a touch");
        if gap > 0.0 {
            assert!((normal / -force_at(gap) - 1.0).abs() < 1e-12, "{gap:e}");
            last = gap;
        }
    }
    let [gap, _] = pair.motion();
    assert!(
        gap > RUPTURE && (last / RUPTURE - 1.0).abs() < 1e-3,
        "{last:e}"
    );
    let at_touch = Adhesion::contact(&bridge(), RADII, 0.0).force;
    assert!((at_touch / touch - 1.0).abs() < 1e-14, "{at_touch:e}");
    // Without a touch.
    let mut apart = Pair::new(&wet(0.0), 0.3 * RUPTURE, [0.0; 3], step);
    apart.0.advance(10);
    assert!(apart.0.contact_force().is_none());
}

/// Across the gap a law with dampers and friction says nothing, not even where spheres that slip
/// and spin come near again.
#[test]
fn across_a_gap_only_the_bridge_acts() {
    let springs = Springs {
        damping_ratio: 0.4,
        ..elastic(1e3, 4e2, 2500.0)
    };
    let law = Law::of(&hooke::KIND, springs);
    let speed = 0.5 * (2.0 * work() / reduced_mass()).sqrt();
    let step = 2e-3 * RUPTURE / speed;
    let velocity = [speed, 0.2 * speed, 0.0];
    let mut pair = Pair::beside(&law, &wet(0.5), -1e-9, velocity, step);
    let (mut approached, mut touched_again) = (0, false);
    for _ in 0..20_000 {
        pair.0.advance(1);
        let [gap, away] = pair.motion();
        let (normal, tangential) = pair.0.contact_force().expect("the bridge holds");
        if gap > 0.0 {
            assert!((normal / -force_at(gap) - 1.0).abs() < 1e-12, "{gap:e}");
            assert_eq!(tangential, [0.0; 3]);
            approached += usize::from(away < 0.0);
        } else {
            touched_again |= approached > 50;
        }
    }
    assert!(touched_again, "{approached} steps of approach");
}

/// The mean errors of 20 impacts whose touch and rupture fall on another part of a step each.
fn errors(halvings: i32) -> f64 {
    let critical = (2.0 * work() / reduced_mass()).sqrt();
    let errors = (0..20).map(|k| {
        let step = 0.02 * RUPTURE / critical * 0.5f64.powi(halvings);
        let [held, away] = [0.9, 1.5].map(|part| {
            let speed = part * critical;
            let gap = speed * step * (0.5 + 0.123 * f64::from(k));
            let mut pair = Pair::new(&wet(0.0), gap, [-speed, 0.0, 0.0], step);
            pair.0.advance(200 << halvings);
            let [_, away] = pair.motion();
            let is_apart = pair.0.contact_force().is_none();
            is_apart.then_some(away)
        });
        assert_eq!(held, None, "the bridge holds");
        let expected = critical * (1.5f64 * 1.5 - 1.0).sqrt();
        (away.expect("the bridge breaks") / expected - 1.0).abs()
    });
    errors.sum::<f64>() / 20.0
}

/// Spheres that collide stick below the speed whose energy is ∫F_c ds, and above it lose just that,
/// with errors of second order.
#[test]
fn bridges_hold_spheres_or_cost_their_work() {
    let means = [0, 1, 2].map(errors);
    let [a, b, c] = means;
    assert!(c < 1e-3 && a / b > 3.0 && b / c > 3.0, "{means:?}");
}

/// K has the derivative of the force, in contact and across the gap, and no contact beyond s_c.
#[test]
fn derivatives_are_those_of_the_forces() {
    let force = Three::pair_force(&law(), &wet(0.4)).expect("a law of spheres");
    let gap = force.gap([0; 2], RADII);
    assert!((gap / RUPTURE - 1.0).abs() < 1e-14, "{gap:e}");
    let at = |overlap: f64| {
        force.derivatives(&SpringState {
            materials: [0; 2],
            radii: RADII,
            overlap,
            history: [0.0; 3],
            torques: [0.0; 4],
            age: 0.0,
            limits: [None; 3],
        })
    };
    let hertz = |overlap: f64| SPHERES.normal_stiffness() * reduced().sqrt() * overlap.powf(1.5);
    for overlap in [3e-6, 1e-6, -1e-6, -1e-5, -1e-4, -0.99 * RUPTURE] {
        let h = 1e-3 * overlap.abs();
        let slope = (at(overlap + h).normal - at(overlap - h).normal) / (2.0 * h);
        let found = at(overlap);
        assert!(
            (found.normal_slope / slope - 1.0).abs() < 1e-5,
            "{overlap:e}"
        );
        let expected = if overlap > 0.0 {
            hertz(overlap) - force_at(1e-12)
        } else {
            -force_at(-overlap)
        };
        assert!((found.normal - expected).abs() < 1e-6 * force_at(1e-12));
    }
}

/// Spheres of a gas that collide, stick together by bridges, and come apart: energies and
/// dissipation add up, and no part of the dissipation gives energy back.
#[test]
fn the_energy_budget_has_the_work_of_broken_bridges() {
    for (law, friction) in [
        (Law::of(&hertz::KIND, undamped(4e7, 0.3, 2500.0)), 0.0),
        (Law::of(&hooke::KIND, elastic(1e4, 4e3, 2500.0)), 0.3),
    ] {
        // Bridges of which many break.
        let bridge = LiquidBridge::new(2.0, 1e-13, ANGLE);
        let contact = Contact {
            adhesion: Some(Arc::new(bridge)),
            rolling_friction: 0.3 * friction,
            rolling_stiffness: Some(4e3),
            ..frictional(friction)
        };
        let mut rig = rig(&law, &contact, 5e-8, |_| {});
        rig.system.budget = Some(EnergyBudget::new(rig.system.grains().units, 1.06 * RADIUS));
        let begun = energy(&mut rig);
        let mut least = 0.0f64;
        let mut last = begun.broken;
        for _ in 0..40 {
            rig.advance(250);
            let now = energy(&mut rig);
            let missing = begun.stored - now.stored - now.dissipated;
            assert!(
                missing.abs() < 1e-3 * begun.kinetic,
                "{missing:e} of {:e}",
                begun.kinetic
            );
            least = least.min(now.broken - last);
            last = now.broken;
        }
        let per_bridge = 1e-10 * begun.kinetic;
        assert!(
            last > 1e-3 * begun.kinetic && least > -per_bridge,
            "{last:e} {least:e}"
        );
    }
}

fn rig(law: &Law, contact: &Contact, step: f64, change: impl FnOnce(&mut Setup)) -> Rig<Three> {
    let side = 4;
    let mut grains: Vec<GrainState> = gas::<Three>(side, 0.8, 5);
    for grain in &mut grains {
        grain.radius *= 1.02;
    }
    let mut setup = Setup {
        step,
        masses: law.masses(),
        largest_radius: 1.06 * RADIUS,
        ..common::setup::<Three>(side, 0.0, (0.3, 20))
    };
    change(&mut setup);
    let force: Box<dyn PairForce<Three>> = Three::pair_force(law, contact).expect("spheres");
    Rig::new(
        setup,
        force,
        gshear_dem::drive::NoWalls,
        (grains, Vec::new()),
    )
}

/// Energies of a gas (J).
struct Energies {
    kinetic: f64,
    stored: f64,
    dissipated: f64,
    /// What broken bridges have cost.
    broken: f64,
}

fn energy(rig: &mut Rig<Three>) -> Energies {
    let (entry, kinetic) = rig.balance();
    Energies {
        kinetic,
        stored: kinetic + entry.elastic.iter().sum::<f64>(),
        dissipated: entry.dissipated.iter().sum(),
        broken: entry.dissipated[dissipation::STIFFNESS],
    }
}

/// The digest of a gas after some thousand steps, and the bridges across gaps.
fn wet_gas(change: impl FnOnce(&mut Setup)) -> (String, usize) {
    let contact = Contact {
        adhesion: Some(Arc::new(LiquidBridge::new(2.0, 1e-13, ANGLE))),
        rolling_friction: 0.1,
        rolling_stiffness: Some(4e3),
        ..frictional(0.3)
    };
    let law = Law::of(&hertz::KIND, undamped(4e7, 0.3, 2500.0));
    let mut rig = rig(&law, &contact, 5e-8, change);
    rig.advance(5000);
    let overlap = &rig.samples.overlap;
    let contacts = rig.system.contacts.touching();
    let across = contacts.filter(|at| overlap[at.block].0[at.lane] < 0.0);
    let across = across.count();
    (rig.digest(&[]), across)
}

/// Contacts that only an adhesion holds have the same bits with every instruction set, list of
/// pairs, and number of threads.
#[test]
fn bridges_do_not_depend_on_bookkeeping() {
    let (digest, across) = wet_gas(|_| {});
    assert!(across > 0);
    for name in ["portable", "avx2", "avx512"] {
        if let Some(isa) = Isa::named(name) {
            let (found, _) = wet_gas(|setup| setup.isa = isa);
            assert_eq!(found, digest, "{name}");
        }
    }
    let (found, _) = wet_gas(|setup| setup.list.rebuild_every = 3);
    assert_eq!(found, digest, "other lists");
    let (found, _) = wet_gas(|setup| setup.list.skin = Some(0.05));
    assert_eq!(found, digest, "another skin");
    let (found, _) = wet_gas(|setup| setup.threads = 2);
    assert_eq!(found, digest, "two threads");
}

const AGAIN: AdhesionKind = AdhesionKind {
    name: "jkr",
    ..liquid_bridge::KIND
};

/// One test, because adhesions are registered once in a process.
#[test]
fn a_program_adds_adhesions_once() {
    let again = |own| std::panic::catch_unwind(|| adhesions::register(own)).is_err();
    assert!(again(&[&AGAIN]), "the name of {:?}", jkr::KIND.name);
    assert!(
        again(&[&liquid_bridge::KIND, &liquid_bridge::KIND]),
        "a name twice"
    );
    assert!(adhesions::kind(liquid_bridge::KIND.name).is_none());

    adhesions::register(&[&liquid_bridge::KIND]);
    assert!(adhesions::kind(liquid_bridge::KIND.name).is_some());
    assert_eq!(adhesions::all().count(), ADHESIONS.len() + 1);
    assert!(again(&[&liquid_bridge::KIND]), "a second call");
}
