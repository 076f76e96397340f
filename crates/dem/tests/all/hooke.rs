//! The linear springs, through the program's own step: closed forms of an impact, and the order of
//! convergence.

use std::f64::consts::PI;

use gshear_dem::dimension::Two;
use gshear_dem::laws::Contact;
use gshear_dem::laws::hooke::Hooke;
use gshear_dem::laws::hooke::Springs;
use gshear_dem::state::{ContactState, Masses};

use crate::common::Rig;

type Law = Hooke<Two, true, true>;

const SPRINGS: Springs = Springs {
    normal_stiffness: 1e6,
    tangential_stiffness: 0.4e6,
    density: 2500.0,
    damping_ratio: 0.15,
    sliding_damping: 0.0,
};
const CONTACT: Contact = Contact {
    friction: 0.5,
    rolling_friction: 0.3,
    rolling_damping_ratio: 0.2,
    ..Contact::NONE
};
const RADII: [f64; 2] = [0.7e-3, 1e-3];

fn mass(r: f64) -> f64 {
    SPRINGS.density * PI * r * r
}

fn reduced_mass() -> f64 {
    1.0 / (1.0 / mass(RADII[0]) + 1.0 / mass(RADII[1]))
}

/// Two disks, 1 at the origin and 0 at `angle` from it, overlapping by `overlap` (m): 0 at rest and
/// 1 moving towards it at `approach` and sideways at `sideways` (m/s) along -t̂, with these spins
/// (rad/s).
struct Impact {
    /// α.
    damping_ratio: f64,
    contact: Contact,
    angle: f64,
    overlap: f64,
    approach: f64,
    sideways: f64,
    spin: [f64; 2],
    /// F_t^e and M^k at the start; beyond the limits they are set back at once.
    history: [f64; 2],
}

/// x, y, u, v, ω of both disks.
type State = [f64; 10];

/// In which direction disk 0 lies from disk 1, how they approach along it (m/s), and their overlap
/// (m).
fn approach(s: &State) -> ([f64; 2], f64, f64) {
    let (dx, dy) = (s[0] - s[5], s[1] - s[6]);
    let distance = dx.hypot(dy);
    let n = [dx / distance, dy / distance];
    let v_n = (s[2] - s[7]) * n[0] + (s[3] - s[8]) * n[1];
    (n, -v_n, RADII[0] + RADII[1] - distance)
}

impl Impact {
    /// Hands on the state and F_n after every step of `step` (s), until told to stop.
    fn run(&self, step: f64, mut look: impl FnMut(u64, &State, f64) -> bool) {
        let springs = Springs {
            damping_ratio: self.damping_ratio,
            sliding_damping: 0.0,
            ..SPRINGS
        };
        let law = Box::new(Law::new(&springs, &self.contact));
        let n = [self.angle.cos(), self.angle.sin()];
        let distance = RADII[0] + RADII[1] - self.overlap;
        let moving = [
            self.approach * n[0] + self.sideways * n[1],
            self.approach * n[1] - self.sideways * n[0],
            0.0,
        ];
        let apart = [distance * n[0], distance * n[1], 0.0];
        let of = [
            [apart, [0.0; 3], [0.0, 0.0, self.spin[0]]],
            [[0.0; 3], moving, [0.0, 0.0, self.spin[1]]],
        ];
        let contact = ContactState::new(0, 1, [self.history[0], 0.0, self.history[1]]);
        let masses = Masses::Density(SPRINGS.density);
        let mut pair = Rig::couple(law, (masses, step), RADII, of, vec![contact]);
        for k in 1.. {
            pair.advance();
            let mut state = [0.0; 10];
            for (to, g) in state.chunks_mut(5).zip(pair.system.grain_states()) {
                let ([x, y, _], [u, v, _]) = (g.position, g.velocity);
                to.copy_from_slice(&[x, y, u, v, g.angular_velocity[2]]);
            }
            if !look(k, &state, pair.samples.normal[0].0[0]) {
                break;
            }
        }
    }

    /// The state after `duration` (s) in so many steps.
    fn after(&self, duration: f64, steps: u64) -> State {
        let mut last = [0.0; 10];
        self.run(duration / steps as f64, |k, state, _| {
            last = *state;
            k < steps
        });
        last
    }
}

/// ω_0 = √(k_n/m*), λ = αω_0 and ω = √(ω_0²-λ²) of the contact as an oscillator (1/s).
fn oscillator(damping_ratio: f64) -> [f64; 3] {
    let free = (SPRINGS.normal_stiffness / reduced_mass()).sqrt();
    let decay = damping_ratio * free;
    [free, decay, (free * free - decay * decay).sqrt()]
}

fn head_on(damping_ratio: f64, overlap: f64) -> Impact {
    Impact {
        damping_ratio,
        contact: CONTACT,
        angle: 0.8,
        overlap,
        approach: 0.1,
        sideways: 0.0,
        spin: [0.0; 2],
        history: [0.0; 2],
    }
}

/// The damped half sine: peak overlap, the time at which the clamped force ends, and the
/// restitution up to there.
#[test]
fn an_impact_is_a_damped_half_sine() {
    for damping_ratio in [0.0, 0.1, 0.5] {
        let [free, decay, frequency] = oscillator(damping_ratio);
        let speed = 0.1;
        let to_peak = (frequency / decay).atan() / frequency;
        let peak = speed / free * (-decay * to_peak).exp();
        // F_n = k δ - γ v_n = 0: tan ωt = -2λω/(ω_0² - 2λ²), and there the speed apart is v
        // e^{-λt}.
        let end =
            (PI - (2.0 * decay * frequency).atan2(free * free - 2.0 * decay * decay)) / frequency;
        let restitution = (-decay * end).exp();

        let step = 1e-4 / free;
        let (mut deepest, mut pressed, mut last) = (0.0f64, 0, 0.0);
        head_on(damping_ratio, 1e-4 * step * speed).run(step, |k, state, force| {
            let (_, approach, overlap) = approach(state);
            deepest = deepest.max(overlap);
            pressed += u64::from(force > 0.0);
            last = -approach;
            overlap > 0.0 && k < 100_000
        });
        let close = |name: &str, found: f64, expected: f64, tolerance: f64| {
            assert!(
                (found / expected - 1.0).abs() < tolerance,
                "α = {damping_ratio}: {name} {found:e} is not {expected:e}"
            );
        };
        close("peak overlap", deepest, peak, 1e-7);
        close("restitution", last / speed, restitution, 1e-6);
        close("contact time", pressed as f64 * step, end, 1e-4);
    }
}

/// Below the clamp e = exp(-πα/√(1-α²)) is what one makes of α; the clamp ends the contact a little
/// earlier and faster.
#[test]
fn restitution_gives_the_damping_ratio() {
    for restitution in [0.5, 0.9, 0.99] {
        let alpha = gshear_dem::laws::damping::damping_ratio(restitution);
        let [free, ..] = oscillator(alpha);
        let step = 1e-3 / free;
        let mut last = 0.0;
        head_on(alpha, 1e-4 * step * 0.1).run(step, |k, state, _| {
            let (_, approach, overlap) = approach(state);
            last = -approach;
            overlap > 0.0 && k < 100_000
        });
        let found = last / 0.1;
        let above = found - restitution;
        assert!(
            (0.0..0.15).contains(&above) && above < 2.0 * (1.0 - restitution).powi(2),
            "{restitution} became {found}"
        );
    }
}

/// Against the closed form within the contact: second order in δ and v_n.
#[test]
fn the_normal_spring_is_second_order() {
    let alpha = 0.15;
    let [free, decay, frequency] = oscillator(alpha);
    let (start, speed) = (1e-6, 0.1);
    let time = 2.2 / free;
    let (sine, cosine) = (frequency * time).sin_cos();
    let swing = (speed + decay * start) / frequency;
    let fade = (-decay * time).exp();
    let overlap = fade * (start * cosine + swing * sine);
    let rate = -decay * overlap + fade * frequency * (swing * cosine - start * sine);
    let errors = [50, 100, 200, 400].map(|steps| {
        let (_, found_rate, found) = approach(&head_on(alpha, start).after(time, steps));
        [
            (found / overlap - 1.0).abs(),
            (found_rate - rate).abs() / speed,
        ]
    });
    for pair in errors.windows(2) {
        for (coarse, fine) in pair[0].iter().zip(pair[1]) {
            let order = (coarse / fine).log2();
            assert!((1.9..2.1).contains(&order), "{errors:?}");
        }
    }
    assert!(errors[3][0] < 1e-5, "{errors:?}");
}

/// Differences between runs of halved steps fall by four in every number of the state, with springs
/// sticking and with the limits of both reached throughout.
#[test]
fn friction_and_rolling_are_second_order() {
    let sticking = Impact {
        damping_ratio: SPRINGS.damping_ratio,
        contact: Contact {
            friction: 50.0,
            rolling_friction: 50.0,
            ..CONTACT
        },
        angle: 2.2,
        overlap: 1e-7,
        approach: 0.1,
        sideways: 0.03,
        spin: [20.0, -45.0],
        history: [0.0; 2],
    };
    let sliding = Impact {
        contact: Contact {
            rolling_friction: 0.01,
            ..CONTACT
        },
        sideways: 0.5,
        spin: [2000.0, -3000.0],
        history: [-1e9, -1e9],
        ..sticking
    };
    let [free, ..] = oscillator(SPRINGS.damping_ratio);
    for (name, impact) in [("sticking", sticking), ("sliding", sliding)] {
        let time = 1.8 / free;
        let [a, b, c] = [400, 800, 1600].map(|steps| impact.after(time, steps));
        for (k, ((a, b), c)) in a.iter().zip(b).zip(c).enumerate() {
            let ratio = (a - b) / (b - c);
            assert!((3.6..4.4).contains(&ratio), "{name}: number {k}: {ratio}");
        }
    }
}

/// Gross slip: the impulse of friction is μ times that of the normal force, and each disk takes R/I
/// of it as spin.
#[test]
fn gross_slip_turns_the_disks() {
    let impact = Impact {
        approach: 0.02,
        sideways: 0.1,
        contact: Contact {
            rolling_friction: 0.0,
            ..CONTACT
        },
        // Undamped, so that F_t is at its limit from the first step on.
        ..head_on(0.0, 1e-9)
    };
    let [free, ..] = oscillator(0.0);
    let mut end = [0.0; 10];
    impact.run(1e-3 / free, |k, state, _| {
        end = *state;
        approach(state).2 > 0.0 && k < 100_000
    });
    let n = [impact.angle.cos(), impact.angle.sin()];
    // What disk 0 has gained, along n and t̂ of the first touch.
    let m = mass(RADII[0]);
    let (along, across) = (
        m * (end[2] * n[0] + end[3] * n[1]),
        m * (end[3] * n[0] - end[2] * n[1]),
    );
    // n turns by a hundredth during the impact.
    assert!(
        ((-across / along) / CONTACT.friction - 1.0).abs() < 0.02,
        "{along:e} {across:e}"
    );
    for (g, r) in [(0, RADII[0]), (1, RADII[1])] {
        let spin = end[5 * g + 4];
        let impulse = 0.5 * mass(r) * r * spin;
        assert!((impulse / -across - 1.0).abs() < 0.02, "disk {g}: {spin}");
    }
}
