//! Attraction beside the laws: closed forms of impact, detachment and rest.

use bytemuck::Zeroable;
use gshear_dem::contact::attraction::Attraction;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::{ContactForces, PairForce};
use gshear_dem::laws::hertz::Spheres;
use gshear_dem::laws::hooke::Springs;
use gshear_dem::laws::{Contact, Law, LawSpace, hertz, hooke};
use gshear_dem::simd::Isa;
use gshear_dem::state::{Cell, GrainState};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{ListSettings, Setup, System};

const RADII: [f64; 2] = [1.0e-3, 1.5e-3];
/// k (N/m; Pa in 2D) and F_c (N; N/m in 2D): F_c/k is a thousandth of a radius.
const STIFFNESS: f64 = 1e6;
const FORCE: f64 = 1.0;

fn springs(damping_ratio: f64) -> Law {
    Law::of(
        &hooke::KIND,
        Springs {
            normal_stiffness: STIFFNESS,
            tangential_stiffness: 0.4 * STIFFNESS,
            density: 2500.0,
            damping_ratio,
            sliding_damping: 0.0,
        },
    )
}

fn attracting(friction: f64) -> Contact {
    Contact {
        friction,
        attraction: Attraction {
            constant: FORCE,
            per_radius: 0.0,
        },
        ..Contact::NONE
    }
}

/// Two grains beside each other along x, the first at rest.
struct Pair<D: LawSpace> {
    system: System<D>,
    law: Box<dyn PairForce<D>>,
    samples: ContactForces,
}

impl<D: LawSpace> Pair<D> {
    /// With an overlap (m), a velocity (m/s) of the second, and Δt (s).
    fn new(law: &Law, contact: &Contact, overlap: f64, velocity: [f64; 3], step: f64) -> Self {
        let setup = Setup {
            isa: Isa::detect(),
            list: ListSettings {
                skin: Some(0.2),
                rebuild_every: 0,
            },
            cell: Cell::between_walls([0.05; 2]),
            largest_radius: RADII[1],
            mean_diameter: RADII[0] + RADII[1],
            masses: law.masses(),
            step,
            gravity: [0.0; 2],
            typical_force: FORCE,
            threads: 1,
        };
        let grain = |id: u32, x: f64, velocity| GrainState {
            id,
            position: [x, 0.02, if D::AXES == 3 { 0.02 } else { 0.0 }],
            velocity,
            radius: RADII[id as usize],
            ..GrainState::zeroed()
        };
        let distance = RADII[0] + RADII[1] - overlap;
        let grains = vec![
            grain(0, 0.02, [0.0; 3]),
            grain(1, 0.02 + distance, velocity),
        ];
        let law = D::pair_force(law, contact).expect("a law of this dimension");
        let mut system = System::new(&Solo, setup).expect("one rank");
        system
            .replace(&Solo, law.as_ref(), &mut NoWalls, grains, Vec::new())
            .expect("a list");
        let mut samples = ContactForces::default();
        let given = Some(&mut samples);
        initial_forces(&Solo, &mut system, law.as_ref(), &mut NoWalls, given).expect("sound");
        Self {
            system,
            law,
            samples,
        }
    }

    fn advance(&mut self, steps: usize) {
        for _ in 0..steps {
            let request = StepRequest::sampled(&mut self.samples);
            advance(
                &Solo,
                &mut self.system,
                self.law.as_ref(),
                &mut NoWalls,
                request,
            )
            .expect("sound");
        }
    }

    /// δ (m) and the velocity (m/s) at which the pair separates.
    fn motion(&mut self) -> [f64; 2] {
        let [a, b] = self.system.grain_states()[..] else {
            panic!("two grains");
        };
        let r: Vec<f64> = (0..3).map(|k| b.position[k] - a.position[k]).collect();
        let overlap = RADII[0] + RADII[1] - r.iter().map(|x| x * x).sum::<f64>().sqrt();
        [overlap, b.velocity[0] - a.velocity[0]]
    }

    /// F_n and |F_t| of the contact, if the grains touch.
    fn forces(&self) -> Option<[f64; 2]> {
        let at = self.system.contacts.touching().next()?;
        let tangential = (0..D::SPINS).map(|k| self.samples.tangential[at.block][k].0[at.lane]);
        Some([
            self.samples.normal[at.block].0[at.lane],
            tangential.map(|f| f * f).sum::<f64>().sqrt(),
        ])
    }
}

fn reduced_mass(law: &Law, volume: fn(f64) -> f64) -> f64 {
    let [a, b] = RADII.map(|r| law.masses().of(0, volume(r)));
    a * b / (a + b)
}

/// m* δ'' = F_c - k δ between the touch and the opening, at
///
/// ```text
/// t = (2/ω) (π - atan(v k/(ω F_c))),  ω = √(k/m*)
/// ```
///
/// with the speed v of the impact. Touch and opening, where the force jumps, come at any part of a
/// step; the errors of position and velocity after the impact are of second order on average.
fn impact_is_of_second_order<D: LawSpace>(volume: fn(f64) -> f64) {
    let law = springs(0.0);
    let omega = (STIFFNESS / reduced_mass(&law, volume)).sqrt();
    // F_c/k and v/ω alike.
    let speed = omega * FORCE / STIFFNESS;
    let lasts = 2.0 / omega * (std::f64::consts::PI - std::f64::consts::FRAC_PI_4);
    let mut errors = [[0.0f64; 2]; 3];
    for (level, errors) in errors.iter_mut().enumerate() {
        let steps = 200 << level;
        let step = 2.0 * lasts / steps as f64;
        for k in 0..40 {
            let gap = speed * lasts * (0.1 + 0.00937 * f64::from(k));
            let velocity = [-speed, 0.0, 0.0];
            let mut pair = Pair::<D>::new(&law, &attracting(0.0), -gap, velocity, step);
            pair.advance(steps);
            let left = 2.0 * lasts - lasts - gap / speed;
            let [overlap, away] = pair.motion();
            assert!(pair.forces().is_none());
            let found = [(-overlap / (speed * left) - 1.0), away / speed - 1.0];
            for (sum, error) in errors.iter_mut().zip(found) {
                *sum += error.abs() / 40.0;
            }
        }
    }
    for k in 0..2 {
        let [a, b, c] = errors.map(|level| level[k]);
        assert!(
            c < 2e-4 && a / b > 3.0 && b / c > 3.0,
            "{k}: {a:e} {b:e} {c:e}"
        );
    }
}

#[test]
fn touch_and_opening_are_of_second_order() {
    use gshear_dem::dimension::Dimension;
    impact_is_of_second_order::<Two>(Two::volume);
    impact_is_of_second_order::<Three>(Three::volume);
}

/// Spheres at rest with Hertz(δ) = 4πγR* come apart if their energy exceeds (3/5) F_c δ, the work
/// of the pull-off, and stay together below it.
#[test]
fn the_work_of_detaching_spheres_is_that_of_dmt() {
    use gshear_dem::dimension::Dimension;
    let spheres = Spheres {
        young_modulus: 1e9,
        poisson_ratio: 0.3,
        density: 2500.0,
        normal_damping: 0.0,
        tangential_damping: 0.0,
    };
    let k_n = spheres.normal_stiffness();
    let law = Law::of(&hertz::KIND, spheres);
    let energy: f64 = 0.2;
    let contact = Contact {
        attraction: Attraction {
            constant: 0.0,
            per_radius: 4.0 * std::f64::consts::PI * energy,
        },
        ..Contact::NONE
    };
    let reduced = RADII[0] * RADII[1] / (RADII[0] + RADII[1]);
    let pull_off = 4.0 * std::f64::consts::PI * energy * reduced;
    let at_rest = (pull_off / (k_n * reduced.sqrt())).powf(2.0 / 3.0);
    let mass = reduced_mass(&law, Three::volume);
    let critical = (2.0 * 0.6 * pull_off * at_rest / mass).sqrt();
    let step = 2e-3 * at_rest / critical;
    let mut still = Pair::<Three>::new(&law, &contact, at_rest, [0.0; 3], step);
    still.advance(10);
    let [normal, _] = still.forces().expect("a contact");
    assert!(normal.abs() < 1e-9 * pull_off, "{normal:e}");
    for (part, leaves) in [(0.99, false), (1.01, true)] {
        let velocity = [part * critical, 0.0, 0.0];
        let mut pair = Pair::<Three>::new(&law, &contact, at_rest, velocity, step);
        pair.advance(10_000);
        assert_eq!(pair.forces().is_none(), leaves, "{part}");
        if leaves {
            let expected = critical * (part * part - 1.0f64).sqrt();
            let [_, away] = pair.motion();
            assert!((away / expected - 1.0).abs() < 1e-3, "{away} {expected}");
        }
    }
}

/// Two grains that hold each other without a load slide at μF_c: friction is limited by what
/// presses them together.
fn holds_by_friction<D: LawSpace>() {
    let friction = 0.3;
    let law = springs(0.0);
    let at_rest = FORCE / STIFFNESS;
    let velocity = [0.0, 0.5, 0.0];
    let mut pair = Pair::<D>::new(&law, &attracting(friction), at_rest, velocity, 1e-7);
    let mut slid = 0;
    for _ in 0..1000 {
        pair.advance(1);
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
