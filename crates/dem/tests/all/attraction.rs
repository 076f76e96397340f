//! Attraction beside the laws: closed forms of impact, detachment and rest.

use std::sync::Arc;

use gshear_dem::adhesions::constant::Constant;
use gshear_dem::adhesions::dmt::Dmt;
use gshear_dem::adhesions::jkr::Jkr;
use gshear_dem::contact::adhesion::Adhesion;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::laws::hertz::Spheres;
use gshear_dem::laws::{Contact, Law, LawSpace, hertz, hooke};

use crate::common::{Rig, elastic, frictional, minus, norm, undamped};

const RADII: [f64; 2] = [1.0e-3, 1.5e-3];
/// k (N/m; Pa in 2D) and F_c (N; N/m in 2D): F_c/k is a thousandth of a radius.
const STIFFNESS: f64 = 1e6;
const FORCE: f64 = 1.0;

fn springs() -> Law {
    let springs = elastic(STIFFNESS, 0.4 * STIFFNESS, 2500.0);
    Law::of(&hooke::KIND, springs)
}

fn attracting(friction: f64) -> Contact {
    Contact {
        adhesion: Some(Arc::new(Constant { force: FORCE })),
        ..frictional(friction)
    }
}

/// Two grains beside each other along x, the first at rest.
struct Pair<D: LawSpace>(Rig<D>);

impl<D: LawSpace> Pair<D> {
    /// With an overlap (m), a velocity (m/s) of the second, and Δt (s).
    fn new(law: &Law, contact: &Contact, overlap: f64, velocity: [f64; 3], step: f64) -> Self {
        let distance = RADII[0] + RADII[1] - overlap;
        let ends = [[[0.0; 3]; 3], [[distance, 0.0, 0.0], velocity, [0.0; 3]]];
        let masses = law.masses();
        let law = D::pair_force(law, contact).expect("a law of this dimension");
        Self(Rig::couple(law, (masses, step), RADII, ends, Vec::new()))
    }

    /// δ (m) and the velocity (m/s) at which the pair separates.
    fn motion(&mut self) -> [f64; 2] {
        let [a, b] = self.0.ends();
        let overlap = RADII[0] + RADII[1] - norm(minus(b.position, a.position));
        [overlap, b.velocity[0] - a.velocity[0]]
    }

    /// The velocity (m/s) at which the pair separates after so many steps, if it has come apart.
    fn away_after(&mut self, steps: usize) -> Option<f64> {
        self.0.advance(steps);
        let [_, away] = self.motion();
        self.forces().is_none().then_some(away)
    }

    /// F_n and |F_t| of the contact, if the grains touch.
    fn forces(&self) -> Option<[f64; 2]> {
        (self.0.contact_force()).map(|(normal, tangential)| [normal, norm(tangential)])
    }
}

fn reduced_mass<D: Dimension>(law: &Law) -> f64 {
    let [a, b] = RADII.map(|r| law.masses().of(0, D::volume(r)));
    a * b / (a + b)
}

/// Fails unless the mean errors of impacts that begin at another part of a step each are at last
/// this small, and fall by more than three when Δt is halved once and twice. `errors`: of an impact
/// with Δt halved so often.
fn are_of_second_order<const N: usize>(
    impacts: u32,
    last: f64,
    errors: impl Fn(i32, u32) -> [f64; N],
) {
    let means = [0, 1, 2].map(|halvings| {
        let mut means = [0.0; N];
        for k in 0..impacts {
            for (mean, error) in means.iter_mut().zip(errors(halvings, k)) {
                *mean += error.abs() / f64::from(impacts);
            }
        }
        means
    });
    for quantity in 0..N {
        let [a, b, c] = means.map(|means| means[quantity]);
        assert!(c < last && a / b > 3.0 && b / c > 3.0, "{means:?}");
    }
}

/// m* δ'' = F_c - k δ between the touch and the opening, at
///
/// ```text
/// t = (2/ω) (π - atan(v k/(ω F_c))),  ω = √(k/m*)
/// ```
///
/// with the speed v of the impact. Touch and opening, where the force jumps, come at any part of a
/// step; the errors of position and velocity after the impact are of second order on average.
fn impact_is_of_second_order<D: LawSpace>() {
    let law = springs();
    let omega = (STIFFNESS / reduced_mass::<D>(&law)).sqrt();
    // F_c/k and v/ω alike.
    let speed = omega * FORCE / STIFFNESS;
    let lasts = 2.0 / omega * (std::f64::consts::PI - std::f64::consts::FRAC_PI_4);
    are_of_second_order(40, 2e-4, |halvings, k| {
        let steps = 200 << halvings;
        let step = 2.0 * lasts / steps as f64;
        let gap = speed * lasts * (0.1 + 0.00937 * f64::from(k));
        let velocity = [-speed, 0.0, 0.0];
        let mut pair = Pair::<D>::new(&law, &attracting(0.0), -gap, velocity, step);
        let away = pair.away_after(steps).expect("it has opened");
        let left = 2.0 * lasts - lasts - gap / speed;
        let [overlap, _] = pair.motion();
        [-overlap / (speed * left) - 1.0, away / speed - 1.0]
    });
}

#[test]
fn touch_and_opening_are_of_second_order() {
    impact_is_of_second_order::<Two>();
    impact_is_of_second_order::<Three>();
}

const SPHERES: Spheres = undamped(1e9, 0.3, 2500.0);
/// γ (J/m²).
const ENERGY: f64 = 0.2;

fn reduced() -> f64 {
    RADII[0] * RADII[1] / (RADII[0] + RADII[1])
}

/// E* (Pa).
fn modulus() -> f64 {
    SPHERES.young_modulus / (2.0 * (1.0 - SPHERES.poisson_ratio * SPHERES.poisson_ratio))
}

fn adhering(adhesion: impl Adhesion) -> Contact {
    Contact {
        adhesion: Some(Arc::new(adhesion)),
        ..Contact::NONE
    }
}

fn jkr() -> Contact {
    adhering(Jkr::new(ENERGY, modulus()))
}

/// δ (m) and F_n (N) of JKR at the contact radius a (m), from Johnson, Kendall & Roberts as LAMMPS
/// writes them.
fn of_radius(a: f64) -> [f64; 2] {
    let (r, e, pi) = (reduced(), modulus(), std::f64::consts::PI);
    [
        a * a / r - 2.0 * (pi * ENERGY * a / e).sqrt(),
        4.0 * e * a.powi(3) / (3.0 * r) - 2.0 * pi * a * a * (4.0 * ENERGY * e / (pi * a)).sqrt(),
    ]
}

/// Contact radius (m) at pull-off, 3πγR* and a²/(3R*), where dF/da = 0.
fn pull_off() -> [f64; 3] {
    let (r, pi) = (reduced(), std::f64::consts::PI);
    let a = (9.0 * pi * ENERGY * r * r / (4.0 * modulus())).cbrt();
    [a, 3.0 * pi * ENERGY * r, a * a / (3.0 * r)]
}

/// ∫F dδ (J) between the contact radii a and b (m), by Simpson's rule.
fn work(a: f64, b: f64) -> f64 {
    let parts = 2000;
    let at = |k: usize| {
        let a = a + (b - a) * k as f64 / parts as f64;
        let h = 1e-6 * a;
        of_radius(a)[1] * (of_radius(a + h)[0] - of_radius(a - h)[0]) / (2.0 * h)
    };
    let weight = |k: usize| [2.0, 4.0][k % 2];
    let inner: f64 = (1..parts).map(|k| weight(k) * at(k)).sum();
    (at(0) + inner + at(parts)) * (b - a) / (3 * parts) as f64
}

/// The contact radius (m) at this overlap (m).
fn radius_at(overlap: f64) -> f64 {
    let [mut low, mut high] = [pull_off()[0], 0.1 * RADII[0]];
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if of_radius(middle)[0] < overlap {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// The force follows JKR's curve from the touch, where it is -8/9 of the pull-off force, over the
/// greatest overlap to the pull-off at a negative one, and is 0 afterwards, also where the grains
/// approach again.
#[test]
fn the_force_is_that_of_jkr() {
    let law = Law::of(&hertz::KIND, SPHERES);
    let [a, force, gap] = pull_off();
    let mass = reduced_mass::<Three>(&law);
    let speed = (3.0 * force * gap / mass).sqrt();
    let step = 2e-3 * gap / speed;
    let mut pair = Pair::<Three>::new(&law, &jkr(), -1.5 * step * speed, [-speed, 0.0, 0.0], step);
    let (mut least, mut seen, mut last) = (0.0f64, [false; 3], f64::NAN);
    for _ in 0..20_000 {
        pair.0.advance(1);
        let [overlap, _] = pair.motion();
        let Some([normal, _]) = pair.forces() else {
            assert!(overlap < 0.0);
            seen[2] |= seen[1] && overlap < -gap;
            continue;
        };
        // In the step of the touch the force stands for a part of it.
        if seen[0] {
            let [_, expected] = of_radius(radius_at(overlap));
            assert!(
                (normal - expected).abs() < 1e-9 * force,
                "{overlap:e}: {normal:e}"
            );
        }
        seen = [true, seen[1] || overlap < 0.0, false];
        (least, last) = (least.min(normal), overlap);
    }
    assert_eq!(seen, [true; 3]);
    assert!((least / -force - 1.0).abs() < 1e-5 && (last / -gap - 1.0).abs() < 1e-2);
    let touch = Pair::<Three>::new(&law, &jkr(), 1e-15, [0.0; 3], step);
    let [normal, _] = touch.forces().expect("a contact");
    assert!((normal / force + 8.0 / 9.0).abs() < 1e-6, "{normal:e}");
    assert!(of_radius(a)[1] / -force - 1.0 < 1e-12 && of_radius(a)[0] / -gap - 1.0 < 1e-12);
}

/// Spheres at rest come apart if their energy exceeds the work of the pull-off, of DMT (3/5) F_c δ
/// with Hertz(δ) = F_c = 4πγR*, and stay together below it.
#[test]
fn the_work_of_detaching_spheres_is_that_of_dmt_and_jkr() {
    let k_n = SPHERES.normal_stiffness();
    let law = Law::of(&hertz::KIND, SPHERES);
    let per_radius = 4.0 * std::f64::consts::PI * ENERGY;
    let dmt = adhering(Dmt::new(ENERGY, Constant { force: 0.0 }));
    let attraction = per_radius * reduced();
    let at_rest = (attraction / (k_n * reduced().sqrt())).powf(2.0 / 3.0);
    let [at_pull_off, force, _] = pull_off();
    // F = 0 where a³ is four times that at pull-off.
    let of_rest = 4.0f64.cbrt() * at_pull_off;
    for (contact, attraction, at_rest, work) in [
        (dmt, attraction, at_rest, 0.6 * attraction * at_rest),
        (
            jkr(),
            force,
            of_radius(of_rest)[0],
            work(of_rest, at_pull_off),
        ),
    ] {
        let mass = reduced_mass::<Three>(&law);
        let critical = (2.0 * work.abs() / mass).sqrt();
        let step = 2e-3 * at_rest / critical;
        let mut still = Pair::<Three>::new(&law, &contact, at_rest, [0.0; 3], step);
        still.0.advance(10);
        let [normal, _] = still.forces().expect("a contact");
        assert!(normal.abs() < 1e-9 * attraction, "{normal:e}");
        let [held, away] = [0.99, 1.01].map(|part| {
            let velocity = [part * critical, 0.0, 0.0];
            Pair::<Three>::new(&law, &contact, at_rest, velocity, step).away_after(10_000)
        });
        let away = away.expect("it comes apart") / (critical * (1.01f64 * 1.01 - 1.0).sqrt());
        assert!(
            held.is_none() && (away - 1.0).abs() < 1e-3,
            "{held:?} {away}"
        );
    }
}

/// Spheres that collide stick below the speed whose energy is ∫F dδ from the touch to the pull-off,
/// and above it lose just that. The errors of the speed afterwards are of second order.
#[test]
fn jkr_spheres_stick_or_lose_the_work_of_adhesion() {
    let law = Law::of(&hertz::KIND, SPHERES);
    let [at_pull_off, _, gap] = pull_off();
    let lost = -work(radius_at(0.0), at_pull_off);
    let mass = reduced_mass::<Three>(&law);
    let critical = (2.0 * lost.abs() / mass).sqrt();
    are_of_second_order(40, 1e-3, |halvings, k| {
        let step = 0.08 * gap / critical * 0.5f64.powi(halvings);
        let [held, away] = [0.9, 1.5].map(|part| {
            let speed = part * critical;
            let start = -speed * step * (0.5 + 0.123 * f64::from(k));
            let mut pair = Pair::<Three>::new(&law, &jkr(), start, [-speed, 0.0, 0.0], step);
            pair.away_after(400 << halvings)
        });
        assert_eq!(held, None);
        let expected = critical * (1.5f64 * 1.5 - 1.0).sqrt();
        [away.expect("it comes apart") / expected - 1.0]
    });
}

/// Oblique impacts with dampers and friction, whose forces jump at the touch and at the pull-off:
/// velocities and spins afterwards are of second order on average.
#[test]
fn damped_and_frictional_impacts_with_jkr_are_of_second_order() {
    let spheres = Spheres {
        normal_damping: 1e7,
        tangential_damping: 5e6,
        ..SPHERES
    };
    let law = Law::of(&hertz::KIND, spheres);
    let [_, force, gap] = pull_off();
    let mass = reduced_mass::<Three>(&law);
    let speed = 6.0 * (force * gap / mass).sqrt();
    let contact = Contact {
        friction: 0.3,
        ..jkr()
    };
    let end = |k: u32, step: f64, steps: usize| {
        let start = -gap * (0.1 + 0.0123 * f64::from(k));
        let velocity = [-speed, 0.4 * speed, 0.1 * speed];
        let mut pair = Pair::<Three>::new(&law, &contact, start, velocity, step);
        pair.away_after(steps).expect("it comes apart");
        let [grain, _] = pair.0.ends();
        let rim = grain.angular_velocity.map(|w| w * grain.radius);
        [grain.velocity, rim].map(|v| v.map(|v| v / speed))
    };
    let coarse = 0.1 * gap / speed;
    let references: Vec<_> = (0..20).map(|k| end(k, coarse / 32.0, 400 * 32)).collect();
    are_of_second_order(20, 1e-3, |halvings, k| {
        let found = end(k, coarse * 0.5f64.powi(halvings), 400 << halvings);
        [0, 1].map(|quantity| {
            let reference = references[k as usize][quantity];
            let error = minus(found[quantity], reference);
            error.into_iter().map(f64::abs).sum()
        })
    });
}

/// A damped impact beside LAMMPS (29 Sep 2021, `pair_style granular`, `jkr`,
/// `damping viscoelastic`; scripts/validation/jkr.in), whose Δt of 1e-8 s leaves 3e-4: the gap and
/// the speed after 0.4 ms.
#[test]
fn a_damped_impact_with_jkr_is_that_of_lammps() {
    let spheres = Spheres {
        normal_damping: 2e7,
        ..SPHERES
    };
    let law = Law::of(&hertz::KIND, spheres);
    let mut pair = Pair::<Three>::new(&law, &jkr(), -5e-7, [-0.006, 0.0, 0.0], 1e-7);
    let away = pair.away_after(4000).expect("it comes apart");
    let [overlap, _] = pair.motion();
    assert!((-overlap / 8.740_129e-7 - 1.0).abs() < 1e-3, "{overlap:e}");
    assert!((away / 4.378_189e-3 - 1.0).abs() < 1e-3, "{away:e}");
}

/// Two grains that hold each other without a load slide at μF_c: friction is limited by what
/// presses them together.
fn holds_by_friction<D: LawSpace>() {
    let friction = 0.3;
    let law = springs();
    let at_rest = FORCE / STIFFNESS;
    let velocity = [0.0, 0.5, 0.0];
    let mut pair = Pair::<D>::new(&law, &attracting(friction), at_rest, velocity, 1e-7);
    let mut slid = 0;
    for _ in 0..1000 {
        pair.0.advance(1);
        let [normal, tangential] = pair.forces().expect("a contact");
        let limit = friction * (normal + FORCE);
        assert!(tangential < limit * (1.0 + 1e-12), "{tangential} {limit}");
        slid += usize::from(tangential > limit * (1.0 - 1e-12));
    }
    assert!(slid > 10, "{slid}");
    let [normal, _] = pair.forces().expect("a contact");
    assert!(normal < 0.1 * FORCE, "{normal}");
}

#[test]
fn grains_that_only_attract_each_other_resist_sliding() {
    holds_by_friction::<Two>();
    holds_by_friction::<Three>();
}
