//! Persistent contacts: rotated a thousand times, at rest for a hundred million steps.

use std::f64::consts::PI;

use bytemuck::Zeroable;
use gshear_dem::contact::ContactLaw;
use gshear_dem::contact::stiffness::Stiffness;
use gshear_dem::laws::Contact;
use gshear_dem::laws::hertz::Hertz;
use gshear_dem::laws::hertz::Spheres;
use gshear_dem::state::{ContactState, GrainState, body};

use super::rig::{Place, Rig, Setting};
use super::table::{Line, line};
use crate::accuracy::reference::Law;
use crate::accuracy::scenes::{Full, LAW, grain, program_law};

const RADIUS: f64 = 1e-6;
/// δ over 2R.
const PART: f64 = 1e-3;
const OVERLAP: f64 = 2.0 * RADIUS * PART;
const CENTRE: [f64; 2] = [4e-6, 0.0];
/// Rotation (rad/s).
const RATE: f64 = 1e5;

fn setting(step: f64) -> Setting {
    Setting {
        length: 8e-6,
        density: LAW.density,
        step,
        skin: Some(0.1),
    }
}

/// A pair that rotates rigidly, with a whole number of steps per revolution; its spins are `spin`
/// times the rate of rotation.
struct Turning {
    rig: Rig<Full>,
    steps: usize,
    spin: f64,
    step: f64,
    /// Sine and cosine of every angle of the revolution.
    directions: Vec<[f64; 2]>,
}

impl Turning {
    /// F_t^e at the start, in units of the limit μ_s F_n.
    fn new(steps: usize, spin: f64, tangential: f64) -> Self {
        let step = 2.0 * PI / (RATE * steps as f64);
        let directions = (0..steps)
            .map(|k| (2.0 * PI * k as f64 / steps as f64).sin_cos())
            .map(|(s, c)| [c, s])
            .collect();
        let history = [tangential * LAW.friction * normal_force(), 0.0, 0.0];
        let grains = vec![at(0, 1.0, [1.0, 0.0]), at(1, -1.0, [1.0, 0.0])];
        let contact = ContactState::new(0, 1, history);
        let law = program_law(&LAW);
        let rig = Rig::free(law, setting(step), grains, vec![contact]).expect("within the law");
        Self {
            rig,
            steps,
            spin,
            step,
            directions,
        }
    }

    /// Rotates the pair from the k-th angle to the next.
    fn one(&mut self, k: usize) {
        let [last, now] = [k, k + 1].map(|k| self.directions[k % self.steps]);
        for (g, side) in [(0, 1.0), (1, -1.0)] {
            let (position, before) = (place(side, now), place(side, last));
            let arm = side * (RADIUS - 0.5 * OVERLAP);
            let to = Place {
                position,
                velocity: [-RATE * arm * now[1], RATE * arm * now[0]],
                half_velocity: [0, 1].map(|c| (position[c] - before[c]) / self.step),
                spin: self.spin * RATE,
            };
            self.rig.place(g, to);
        }
        self.rig.pass(self.step).expect("within the law");
    }

    /// F_t^e over μ_s F_n.
    fn tangential(&self) -> f64 {
        self.rig.contacts()[0].history[0] / (LAW.friction * normal_force())
    }
}

fn normal_force() -> f64 {
    LAW.stiffnesses(RADIUS, RADIUS, OVERLAP)[0] * OVERLAP
}

/// The position of the grain on this side of the pair.
fn place(side: f64, direction: [f64; 2]) -> [f64; 2] {
    let arm = side * (RADIUS - 0.5 * OVERLAP);
    [
        CENTRE[0] + arm * direction[0],
        CENTRE[1] + arm * direction[1],
    ]
}

fn at(id: u32, side: f64, direction: [f64; 2]) -> GrainState {
    grain(id, RADIUS, place(side, direction), [0.0; 2], 0.0)
}

/// A sliding pair keeps F_t = μ_s F_n. F_t is stored as its component along t̂, so it rotates with
/// the pair.
pub fn sliding_pair() -> Vec<Line> {
    const REVOLUTIONS: usize = 1000;
    const STEPS: usize = 10_000;
    let mut pair = Turning::new(STEPS, 1.0, 1.0);
    let before = pair.tangential();
    let mut furthest = 0.0f64;
    for k in 0..REVOLUTIONS * STEPS {
        pair.one(k);
        if k % 997 == 0 {
            furthest = furthest.max((pair.tangential() / before - 1.0).abs());
        }
    }
    vec![line(
        format!(
            "a loaded sliding pair rotated rigidly by {REVOLUTIONS} revolutions of {STEPS} steps"
        ),
        "F_t constant to 1e-9",
        format!("largest change {furthest:.1e}"),
        furthest < 1e-9 && (before - 1.0).abs() < 1e-9,
    )]
}

/// The lever arms are the full radii, but the centres are closer than R_i + R_j. So a pair that
/// rotates rigidly slips by δ per radian, and F_t^e grows by k_t δ per radian; with spins smaller
/// by δ/(R_i + R_j) it does not slip.
pub fn sticking_pair() -> Vec<Line> {
    const STEPS: usize = 100_000;
    let [k_n, k_t] = LAW.stiffnesses(RADIUS, RADIUS, OVERLAP);
    let unit = LAW.friction * k_n * OVERLAP;
    // A tenth of a revolution is 0.63 rad, well before sliding at μ_s k_n/k_t = 1 rad.
    let tenth = |spin: f64| {
        let mut pair = Turning::new(STEPS, spin, 0.0);
        (0..STEPS / 10).for_each(|k| pair.one(k));
        pair.tangential()
    };
    let expected = k_t * OVERLAP * 0.2 * PI / unit;
    let with_spins = tenth(1.0);
    // The increment is that of the chord, (sin φ (1 + sin² ½φ) - φ) r of a step of φ rad.
    let phi = 2.0 * PI / STEPS as f64;
    let chord = (phi.sin() * (1.0 + (0.5 * phi).sin().powi(2)) - phi) * (2.0 * RADIUS - OVERLAP);
    let of_chords = -k_t * chord * 0.1 * STEPS as f64 / unit;
    let rolling = tenth(1.0 - PART);
    vec![
        line(
            "a loaded sticking pair rotated rigidly by a tenth of a revolution",
            format!(
                "lever arms are the full radii, so it slips by δ per radian: F_t = {expected:.6} μ_s F_n"
            ),
            format!("{with_spins:.6} μ_s F_n"),
            (with_spins / expected - 1.0).abs() < 1e-4,
        ),
        line(
            "the same with spins smaller by δ/(R_i + R_j), so that it does not slip",
            format!(
                "F_t changes only because {STEPS} chords replace the circle: by {of_chords:.3e} μ_s F_n"
            ),
            format!("{rolling:.3e} μ_s F_n"),
            (rolling - of_chords).abs() < 1e-3 * of_chords.abs() + 1e-10,
        ),
    ]
}

/// A grain held by three fixed ones, with tangential forces and rolling torques in balance, over
/// `steps` steps.
fn disk_held(steps: u64) -> Line {
    let law = Law {
        rolling_friction: 0.5,
        ..LAW
    };
    let [k_n, k_t] = law.stiffnesses(RADIUS, RADIUS, OVERLAP);
    let force = k_n * OVERLAP;
    let mut grains = vec![grain(0, RADIUS, CENTRE, [0.0; 2], 0.0)];
    for (id, angle) in [(1, 0.3f64), (2, 2.4), (3, 4.6)] {
        let distance = 2.0 * RADIUS - OVERLAP;
        let (s, c) = angle.sin_cos();
        let place = [CENTRE[0] + distance * c, CENTRE[1] + distance * s];
        grains.push(GrainState {
            body: body::BOTTOM,
            ..grain(id, RADIUS, place, [0.0; 2], 0.0)
        });
    }
    let contacts = [(1, 0.2, 0.05), (2, -0.1, 0.03), (3, 0.15, -0.04)]
        .map(|(j, t, m)| ContactState::new(0, j, [t * force, k_t, m * force * RADIUS]));
    let step = 0.1 * (law.mass(RADIUS) / k_n).sqrt();
    let mut rig = Rig::free(
        program_law::<true, true>(&law),
        setting(step),
        grains,
        contacts.to_vec(),
    )
    .expect("within the law");
    let (moved, [tangential, rolling]) = drift(&mut rig, steps, [0, 2]);
    let moved = moved / OVERLAP;
    line(
        format!(
            "a grain held by three others for {steps:.0e} steps",
            steps = steps as f64
        ),
        "no drift: position to 1e-9 δ, F_t and M^k to 1e-9",
        format!("position {moved:.1e} δ, F_t {tangential:.1e}, M^k {rolling:.1e}"),
        moved < 1e-9 && tangential < 1e-9 && rolling < 1e-9,
    )
}

/// The displacement of grain 0 (m) in `steps` steps after its dampers have stopped it, and the
/// change of these parts of the histories over the greatest of them. No contact opens.
fn drift<C: ContactLaw + Stiffness, const N: usize>(
    rig: &mut Rig<C>,
    steps: u64,
    parts: [usize; N],
) -> (f64, [f64; N]) {
    const SETTLING: u64 = 20_000;
    let mut go = |steps: u64| {
        (0..steps).for_each(|_| rig.advance().expect("within the law"));
        (rig.grains()[0], rig.contacts())
    };
    let (grain_before, before) = go(SETTLING);
    let (grain_after, after) = go(steps);
    assert_eq!(before.len(), after.len());
    let [p, q] = [grain_before.position, grain_after.position];
    let moved = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt();
    let change = |k: usize| {
        let greatest = |numbers: &mut dyn Iterator<Item = f64>| numbers.fold(0.0, f64::max);
        let size = greatest(&mut before.iter().map(|c| c.history[k].abs()));
        assert!(size > 0.0);
        let pairs = before.iter().zip(&after);
        greatest(&mut pairs.map(|(a, b)| (a.history[k] - b.history[k]).abs())) / size
    };
    (moved, parts.map(change))
}

/// A sphere held by four fixed ones, with tangential forces, over `steps` steps.
fn sphere_held(steps: u64) -> Line {
    const RADIUS: f64 = 1e-3;
    const OVERLAP: f64 = 2.0 * RADIUS * PART;
    const CENTRE: [f64; 3] = [4.0 * RADIUS, 3.0 * RADIUS, 5.0 * RADIUS];
    /// Damping of the normal motion.
    const DAMPING_RATIO: f64 = 0.2;
    let mut spheres = Spheres {
        young_modulus: 1e9,
        poisson_ratio: 0.3,
        density: 2500.0,
        normal_damping: 0.0,
        tangential_damping: 0.0,
        remembers_force: false,
        ageing: None,
    };
    let mass = 4.0 / 3.0 * PI * spheres.density * RADIUS.powi(3);
    let root = (0.5 * RADIUS * OVERLAP).sqrt();
    let stiffness = 1.5 * spheres.normal_stiffness() * root;
    spheres.normal_damping = 2.0 * DAMPING_RATIO * (2.0 * stiffness / mass).sqrt() / root;
    spheres.tangential_damping = 0.5 * spheres.normal_damping;
    let contact = Contact {
        friction: 0.5,
        ..Contact::NONE
    };
    let free = GrainState {
        radius: RADIUS,
        position: CENTRE,
        ..Zeroable::zeroed()
    };
    let (mut grains, mut contacts) = (vec![free], vec![]);
    // Near the corners of a tetrahedron; u is a fraction of δ, perpendicular to n.
    for (j, corner, part) in [
        (1, [1.0, 1.1, 0.9], 0.2),
        (2, [1.05, -0.95, -1.0], -0.1),
        (3, [-0.9, 1.0, -1.1], 0.15),
        (4, [-1.0, -1.05, 0.95], 0.05),
    ] {
        let length = corner.iter().map(|c: &f64| c * c).sum::<f64>().sqrt();
        let n = corner.map(|c| c / length);
        let distance = 2.0 * RADIUS - OVERLAP;
        grains.push(GrainState {
            id: j,
            body: body::BOTTOM,
            position: [0, 1, 2].map(|k| CENTRE[k] + distance * n[k]),
            ..free
        });
        let across = [n[1] - n[2], n[2] - n[0], n[0] - n[1]];
        contacts.push(ContactState::new(0, j, across.map(|a| part * OVERLAP * a)));
    }
    let setting = Setting {
        length: 8.0 * RADIUS,
        density: spheres.density,
        step: 0.1 * (mass / stiffness).sqrt(),
        skin: Some(0.1),
    };
    let law = Hertz::<true>::new(&spheres, &contact);
    let mut rig = Rig::free(law, setting, grains, contacts).expect("within the law");
    let (moved, changes) = drift(&mut rig, steps, [0, 1, 2]);
    let (moved, change) = (moved / OVERLAP, changes.into_iter().fold(0.0, f64::max));
    line(
        format!(
            "a sphere held by four others for {steps:.0e} steps",
            steps = steps as f64
        ),
        "no drift: position to 1e-9 δ, u to 1e-9",
        format!("position {moved:.1e} δ, u {change:.1e}"),
        moved < 1e-9 && change < 1e-9,
    )
}

pub fn held_for_a_million_steps() -> Vec<Line> {
    vec![disk_held(1_000_000), sphere_held(1_000_000)]
}

pub fn held_for_a_hundred_million_steps() -> Vec<Line> {
    vec![disk_held(100_000_000), sphere_held(100_000_000)]
}
