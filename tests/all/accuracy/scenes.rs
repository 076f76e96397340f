//! Small set-ups, run by the program and by the reference, and the difference between the two.

use bytemuck::Zeroable;
use gshear_dem::dimension::Two;
use gshear_dem::domain::Solo;
use gshear_dem::drive::{Drive, NoWalls};
use gshear_dem::kernel::ContactForces;
use gshear_dem::laws::Contact;
use gshear_dem::laws::lee_hurley::LeeHurley;
use gshear_dem::laws::lee_hurley::Material;
use gshear_dem::simd::Isa;
use gshear_dem::state::{Cell, ContactState, GrainState, Masses, body};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{ListSettings, Setup, System};

use super::reference::{Disk, Law, Pair, Regime, STICKING, World};

pub type Full = LeeHurley<true, true>;

/// LH's material and coefficients; friction and rolling friction as each scene wants them.
pub const LAW: Law = Law {
    young_modulus: 1e9,
    poisson_ratio: 0.2,
    density: 2500.0,
    friction: 0.7,
    rolling_friction: 0.01,
    damping_ratio: 0.1,
    rolling_damping_ratio: 0.3,
};

/// The same for the program.
pub fn program_law<const FRICTION: bool, const ROLLING: bool>(
    law: &Law,
) -> LeeHurley<FRICTION, ROLLING> {
    LeeHurley::new(
        &Material {
            young_modulus: law.young_modulus,
            poisson_ratio: law.poisson_ratio,
            density: law.density,
            damping_ratio: law.damping_ratio,
            sliding_damping: 0.0,
        },
        &Contact {
            friction: law.friction,
            rolling_friction: law.rolling_friction,
            rolling_damping_ratio: law.rolling_damping_ratio,
            ..Contact::NONE
        },
    )
}

/// A few disks, from the start to `duration` (s), compared at `LOOKS` equidistant times.
#[derive(Debug, Clone)]
pub struct Scene {
    pub law: Law,
    /// L_x (m); centres may start outside [0, L_x), the program then has them wrapped.
    pub length: f64,
    pub grains: Vec<GrainState>,
    pub free: Vec<bool>,
    /// Pairs (i, j), i < j, with F_t^e and M^k at the start and the regime that they start in.
    pub pairs: Vec<(usize, usize, [f64; 2], Regime)>,
    pub duration: f64,
}

pub const LOOKS: usize = 8;

/// Greatest differences: positions, velocities, angular velocities, F_t^e, M^k, each over the
/// greatest value of its kind in the reference: overlap, speed, angular velocity, F_t^e, M^k.
pub type Errors = [f64; 5];
pub const FIELDS: [&str; 5] = ["position", "velocity", "spin", "F_t^e", "M^k"];

pub fn grain(
    id: u32,
    radius: f64,
    position: [f64; 2],
    velocity: [f64; 2],
    spin: f64,
) -> GrainState {
    GrainState {
        id,
        radius,
        position: in_plane(position),
        velocity: in_plane(velocity),
        angular_velocity: [0.0, 0.0, spin],
        ..GrainState::zeroed()
    }
}

pub fn in_plane([x, y]: [f64; 2]) -> [f64; 3] {
    [x, y, 0.0]
}

/// One system of these grains on one rank, its forces computed.
#[expect(clippy::too_many_arguments, reason = "all that makes a system")]
pub fn system<const F: bool, const R: bool>(
    isa: Isa,
    law: &Law,
    length: f64,
    step: f64,
    skin: Option<f64>,
    grains: Vec<GrainState>,
    contacts: Vec<ContactState>,
    samples: Option<&mut ContactForces>,
) -> System<Two> {
    let own = program_law::<F, R>(law);
    let radii = grains.iter().map(|g| g.radius);
    let mean = radii.clone().sum::<f64>() / grains.len() as f64;
    let list = ListSettings {
        skin,
        rebuild_every: 0,
    };
    let setup = Setup {
        list,
        mean_diameter: 2.0 * mean,
        isa,
        ..Setup::new(
            Cell::between_walls([length, f64::INFINITY]),
            radii.fold(0.0, f64::max),
            Masses::Density(law.density),
            step,
        )
    };
    let mut system = System::new(&Solo, setup).unwrap();
    let mut drive = NoWalls;
    system
        .replace(&Solo, &own, &mut drive, grains, contacts)
        .unwrap();
    initial_forces(&Solo, &mut system, &own, &mut drive, samples).unwrap();
    system
}

impl Scene {
    /// The states at the looks, by the program in `steps` steps (a multiple of `LOOKS`).
    pub fn program(&self, steps: usize) -> Vec<Vec<f64>> {
        self.driven(steps, &mut NoWalls)
    }

    /// The same with something between the drift and the forces.
    pub fn driven(&self, steps: usize, drive: &mut impl Drive<Two>) -> Vec<Vec<f64>> {
        assert_eq!(steps % LOOKS, 0);
        let law = program_law::<true, true>(&self.law);
        let mut grains = self.grains.clone();
        for (g, &free) in grains.iter_mut().zip(&self.free) {
            g.position[0] = g.position[0].rem_euclid(self.length);
            g.body = if free { body::FREE } else { body::BOTTOM };
        }
        let touching = self.pairs.iter().filter(|p| p.3 != Regime::Apart);
        let contacts = touching
            .map(|&(i, j, [force, moment], _)| {
                ContactState::new(i as u32, j as u32, [force, 0.0, moment])
            })
            .collect();
        let mut system = system::<true, true>(
            Isa::detect(),
            &self.law,
            self.length,
            self.duration / steps as f64,
            Some(0.1),
            grains,
            contacts,
            None,
        );
        let mut looks = Vec::new();
        for step in 1..=steps {
            advance(&Solo, &mut system, &law, drive, StepRequest::default()).unwrap();
            if step % (steps / LOOKS) == 0 {
                looks.push(self.state(&mut system, &law));
            }
        }
        looks
    }

    fn state(&self, system: &mut System<Two>, law: &Full) -> Vec<f64> {
        let mut s = Vec::new();
        for g in system.grain_states() {
            let ([x, y, _], [u, v, _]) = (g.position, g.velocity);
            s.extend([x, y, u, v, g.angular_velocity[2]]);
        }
        let contacts = system.contact_states(law);
        for &(i, j, ..) in &self.pairs {
            let found = contacts.iter().find(|c| (c.i, c.j) == (i as u32, j as u32));
            let history = found.map_or([0.0; 3], |c| c.history);
            s.extend([history[0], history[2]]);
        }
        s
    }

    /// The reference, with `steps` equal steps (more where the law demands it).
    pub fn world(&self, steps: usize) -> (World, Vec<f64>) {
        let disks = self.grains.iter().zip(&self.free);
        let world = World {
            law: self.law,
            disks: disks
                .map(|(g, &free)| Disk {
                    radius: g.radius,
                    free,
                })
                .collect(),
            pairs: self
                .pairs
                .iter()
                .map(|&(i, j, _, regime)| Pair { i, j, regime })
                .collect(),
            longest: self.duration / steps as f64,
            switches: Vec::new(),
        };
        let mut s = Vec::new();
        for g in &self.grains {
            let ([x, y, _], [u, v, _]) = (g.position, g.velocity);
            s.extend([x, y, u, v, g.angular_velocity[2]]);
        }
        for &(_, _, history, _) in &self.pairs {
            s.extend(history);
        }
        (world, s)
    }

    /// The states at the looks, by the reference; and the reference, which remembers its switches.
    pub fn reference(&self, steps: usize) -> (World, Vec<Vec<f64>>) {
        let (mut world, mut s) = self.world(steps);
        let mut looks = Vec::new();
        for look in 0..LOOKS {
            let time = |k: usize| self.duration * k as f64 / LOOKS as f64;
            world.integrate(&mut s, time(look), time(look + 1));
            looks.push(s.clone());
        }
        (world, looks)
    }

    pub fn errors(&self, reference: &(World, Vec<Vec<f64>>), looks: &[Vec<f64>]) -> Errors {
        let (world, expected) = reference;
        let grains = self.grains.len();
        let mut scale = [0.0f64; 5];
        let mut error = [0.0f64; 5];
        for (look, e) in looks.iter().zip(expected) {
            for (k, (&value, &right)) in look.iter().zip(e).enumerate() {
                let field = if k >= 5 * grains {
                    3 + (k - 5 * grains) % 2
                } else {
                    [0, 0, 1, 1, 2][k % 5]
                };
                let mut difference = value - right;
                if k < 5 * grains && k % 5 == 0 {
                    difference -= self.length * (difference / self.length).round();
                }
                error[field] = error[field].max(difference.abs());
                if field > 0 {
                    scale[field] = scale[field].max(right.abs());
                }
            }
            for p in 0..self.pairs.len() {
                scale[0] = scale[0].max(world.touch(e, p).overlap);
            }
        }
        std::array::from_fn(|f| {
            if error[f] == 0.0 {
                0.0
            } else {
                error[f] / scale[f]
            }
        })
    }

    /// √(m/k_n) of the lightest disk at an overlap of a thousandth of two radii: the program's
    /// default Δt is a tenth of such a time.
    pub fn time_scale(&self) -> f64 {
        let r = self
            .grains
            .iter()
            .map(|g| g.radius)
            .fold(f64::MAX, f64::min);
        let [k_n, _] = self.law.stiffnesses(r, r, 2e-3 * r);
        (self.law.mass(r) / k_n).sqrt()
    }
}

/// Unit vector at an angle.
fn direction(angle: f64) -> [f64; 2] {
    [angle.cos(), angle.sin()]
}

/// Two unequal disks, i at `angle` from j, across the seam at x = 0; i at rest, j towards it at
/// `approach`, sideways at `sideways` (m/s) along -t̂, both spinning. `overlap` is over the sum of
/// the radii, negative for a gap.
fn impact(
    law: Law,
    angle: f64,
    overlap: f64,
    approach: f64,
    sideways: f64,
    spin: [f64; 2],
) -> Scene {
    let (r_i, r_j) = (0.7e-6, 1.0e-6);
    let n = direction(angle);
    let distance = (r_i + r_j) * (1.0 - overlap);
    let at = |s: f64| [s * distance * n[0], s * distance * n[1]];
    let velocity = [
        approach * n[0] + sideways * n[1],
        approach * n[1] - sideways * n[0],
    ];
    let regime = if overlap > 0.0 {
        STICKING
    } else {
        Regime::Apart
    };
    Scene {
        law,
        length: 8e-6,
        grains: vec![
            grain(0, r_i, at(0.5), [0.0, 0.0], spin[0]),
            grain(1, r_j, at(-0.5), velocity, spin[1]),
        ],
        free: vec![true, true],
        pairs: vec![(0, 1, [0.0, 0.0], regime)],
        duration: 0.0,
    }
}

/// Oblique, spinning, fully damped; from just inside contact to shortly before the normal force
/// ends; sticks throughout.
pub fn sticking_impact() -> Scene {
    let law = Law {
        rolling_friction: 0.5,
        ..LAW
    };
    Scene {
        duration: 9.6e-9,
        ..impact(law, 0.9, 1e-4, 1.0, 0.15, [2e4, -6e4])
    }
}

/// The same with a great sideways velocity: slides throughout, the rolling torque at its limit.
pub fn sliding_impact() -> Scene {
    let mut scene = Scene {
        duration: 10e-9,
        ..impact(LAW, 2.2, 1e-4, 1.0, 4.0, [3e5, -4e5])
    };
    scene.pairs[0].3 = Regime::Pressed {
        sliding: Some(-1.0),
        rolling_limit: Some(-1.0),
    };
    // Beyond the limits: both set them back in the first evaluation.
    scene.pairs[0].2 = [-1e9, -1e9];
    scene
}

/// The whole of an oblique impact, from a gap to free flight.
pub fn whole_impact(damping_ratio: f64, sideways: f64) -> Scene {
    let law = Law {
        damping_ratio,
        ..LAW
    };
    oblique(law, 1.0, sideways)
}

/// From a gap to free flight, at these velocities (m/s) along and across the line of centres.
pub fn oblique(law: Law, approach: f64, sideways: f64) -> Scene {
    Scene {
        duration: 20e-9,
        ..impact(law, 0.9, -1e-3 * approach, approach, sideways, [0.0, 0.0])
    }
}

/// A disk between two fixed ones, set swinging, damped, sticking throughout: some five periods.
pub fn oscillation() -> Scene {
    let law = Law {
        rolling_friction: 0.5,
        ..LAW
    };
    let mut scene = sheared(law, 0.0, 0.0, 5e4, 0.0);
    scene.grains[1].velocity = [0.1, 0.2, 0.0];
    scene.duration = 25.6 * scene.time_scale();
    scene
}

/// Head-on, from a gap to free flight, at the approach velocity (m/s).
pub fn head_on(damping_ratio: f64, approach: f64) -> Scene {
    let law = Law {
        damping_ratio,
        ..LAW
    };
    oblique(law, approach, 0.0)
}

/// A free disk between two wall grains of other sizes; the upper one comes closer at `approach`
/// while it passes at `speed` (m/s).
fn sheared(law: Law, speed: f64, approach: f64, spin: f64, duration: f64) -> Scene {
    let radii = [0.8e-6, 1.0e-6, 0.9e-6];
    let overlap = 2e-3;
    let (below, above) = (direction(-1.4), direction(1.72));
    let centre = [0.5e-6, 0.0];
    let next = |r: f64, n: [f64; 2]| {
        let d = (r + radii[1]) * (1.0 - overlap);
        [centre[0] + d * n[0], centre[1] + d * n[1]]
    };
    let passing = [speed * above[1], -speed * above[0]];
    let upper = [
        passing[0] - approach * above[0],
        passing[1] - approach * above[1],
    ];
    let middle = passing.map(|u| 0.5 * u);
    Scene {
        law,
        length: 8e-6,
        grains: vec![
            grain(0, radii[0], next(radii[0], below), [0.0, 0.0], 0.0),
            grain(1, radii[1], centre, middle, spin),
            grain(2, radii[2], next(radii[2], above), upper, 0.0),
        ],
        free: vec![false, true, false],
        pairs: vec![(0, 1, [0.0, 0.0], STICKING), (1, 2, [0.0, 0.0], STICKING)],
        duration,
    }
}

/// Both contacts stick, the disk rolls and the load grows.
pub fn sticking_shear() -> Scene {
    let law = Law {
        rolling_friction: 0.5,
        ..LAW
    };
    sheared(law, 0.3, 0.2, -1e5, 12e-9)
}

/// Both contacts slide and are at the limit of the rolling torque, and the load grows.
pub fn sliding_shear() -> Scene {
    let mut scene = sheared(LAW, 8.0, 0.5, -1e5, 6e-9);
    // The disk, hardly turning, is dragged along +x by the upper grain and held back by the lower
    // one.
    for (pair, turn) in scene.pairs.iter_mut().zip([-1.0, 1.0]) {
        // Beyond the limits, to be set back.
        pair.2 = [1e9, turn * 1e9];
        pair.3 = Regime::Pressed {
            sliding: Some(1.0),
            rolling_limit: Some(turn),
        };
    }
    scene
}

/// i at rest, j passing at `speed` (m/s) along x; undisturbed, they would overlap by `depth` of the
/// sum of their radii.
pub fn grazing(damping_ratio: f64, depth: f64, speed: f64) -> Scene {
    let law = Law {
        damping_ratio,
        ..LAW
    };
    let (r_i, r_j) = (0.7e-6, 1.0e-6);
    let sum: f64 = r_i + r_j;
    let half_chord = sum * (1.0 - (1.0 - depth).powi(2)).sqrt();
    let start = 1.05 * half_chord;
    Scene {
        law,
        length: 8e-6,
        grains: vec![
            grain(0, r_i, [4e-6, sum * (1.0 - depth)], [0.0, 0.0], 0.0),
            grain(1, r_j, [4e-6 - start, 0.0], [speed, 0.0], 0.0),
        ],
        free: vec![true, true],
        pairs: vec![(0, 1, [0.0, 0.0], Regime::Apart)],
        duration: 2.0 * start / speed + 20e-9,
    }
}
