//! A contact law of its own: disks whose springs stiffen, with a damper and Coulomb friction. An
//! adhesion of its own is in [`liquid_bridge`], a column of the time series in [`fabric`].
//!
//! ```text
//! F_n = max(0, k_n δ (1 + a δ/d) - γ_n v_n),   d = R_i + R_j,   γ_n = 2α√(k_n m*)
//! F_t ← F_t - k_t v_t(t+½Δt) Δt,               |F_t| ≤ μ_s F_n
//! ```

pub mod fabric;
pub mod liquid_bridge;

use std::f64::consts::PI;
use std::sync::Arc;

use gshear_dem::contact::parts::{self, NormalSpring, SpringAndDamper, SpringWork};
use gshear_dem::contact::stiffness::{Derivatives, SpringForce, SpringState, Stiffness};
use gshear_dem::contact::{Blocks, ContactLaw, dissipation, parameters_of};
use gshear_dem::dimension::{Dimensions, Two};
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::keys::{
    DAMPING_RATIO, DENSITY, Key, NORMAL_STIFFNESS, NOT_NEGATIVE, TANGENTIAL_STIFFNESS, Values,
};
use gshear_dem::laws::{Constants, Contact, LawKind, Rigidity};
use gshear_dem::simd::{Lanes, Lanes16, Mask};
use gshear_dem::state::Masses;

/// Adds the law, the adhesion and the observable to those that scenes can name.
pub fn register() {
    gshear_dem::laws::register(&[&KIND]);
    gshear_dem::adhesions::register(&[&liquid_bridge::KIND]);
    gshear_dem::observables::register(&[&fabric::KIND]);
}

/// The law as scenes name it.
pub const KIND: LawKind = LawKind {
    name: "stiffening",
    summary: "springs that stiffen with the overlap",
    dimensions: &[Dimensions::Two],
    rolling: false,
    keys: &[
        &DENSITY,
        &NORMAL_STIFFNESS,
        &TANGENTIAL_STIFFNESS,
        &DAMPING_RATIO,
        &STIFFENING,
    ],
    read: |values| {
        let k_n = values.required(&NORMAL_STIFFNESS);
        Arc::new(Stiffening {
            k_n,
            k_t: values
                .number(&TANGENTIAL_STIFFNESS)
                .unwrap_or(2.0 / 7.0 * k_n),
            density: values.required(&DENSITY),
            alpha: values.required(&DAMPING_RATIO),
            a: values.required(&STIFFENING),
        })
    },
};

/// A key that no other law has. Its bounds, message and unit follow from this declaration.
const STIFFENING: Key = Key {
    path: "contact.stiffening",
    doc: "growth a of the normal stiffness",
    values: Values::Number(NOT_NEGATIVE),
    what: "a",
    example: "10.0",
    ..Key::PLAIN
};

/// Largest overlap over the diameter of the smaller grain.
const LARGEST_OVERLAP: f64 = 0.1;

/// The constants: k_n, k_t (Pa), ρ (kg/m³), α, a.
#[derive(Debug, Clone, Copy)]
struct Stiffening {
    k_n: f64,
    k_t: f64,
    density: f64,
    alpha: f64,
    a: f64,
}

impl Constants for Stiffening {
    fn masses(&self) -> Masses {
        Masses::Density(self.density)
    }
    fn normal_stiffness(&self, r1: f64, r2: f64, overlap: f64) -> f64 {
        self.k_n * (1.0 + self.a * overlap / (r1 + r2))
    }
    fn largest_overlap(&self, r1: f64, r2: f64) -> f64 {
        2.0 * LARGEST_OVERLAP * r1.min(r2)
    }
    /// dF_n/dδ = k_n (1 + 2 a δ/d) is at most twice F_n/δ.
    fn rigidity(&self, secant: f64, mass: f64, tangential: bool) -> Rigidity {
        Rigidity {
            normal: 2.0 * secant,
            tangential: if tangential { self.k_t } else { 0.0 },
            rolling: 0.0,
            damping: [2.0 * self.alpha * (0.5 * self.k_n * mass).sqrt(), 0.0],
        }
    }
    fn default_of(&self, key: &Key) -> Option<f64> {
        (key.path == TANGENTIAL_STIFFNESS.path).then_some(self.k_t)
    }
    fn derived(&self) -> Vec<(&'static str, f64, &'static str)> {
        vec![("stiffening a", self.a, "")]
    }
    fn disks(&self, contact: &Contact) -> Option<Box<dyn PairForce<Two>>> {
        let (law, friction) = (*self, contact.friction);
        let per_area = contact
            .relative_densities
            .map(|part| part * PI * self.density);
        Some(if friction > 0.0 {
            Box::new(Disks::<true> {
                law,
                friction,
                per_area,
            })
        } else {
            Box::new(Disks::<false> {
                law,
                friction,
                per_area,
            })
        })
    }
}

/// The law between disks, compiled with friction and without.
#[derive(Debug, Clone, Copy)]
struct Disks<const FRICTION: bool> {
    law: Stiffening,
    friction: f64,
    /// m/R² of i and j.
    per_area: [f64; 2],
}

// Places in the parameters of a pair: γ_n, a/d, the largest overlap.
const DAMPING: usize = 0;
const PER_LENGTH: usize = 1;
const LARGEST: usize = 2;

impl<const FRICTION: bool> ContactLaw for Disks<FRICTION> {
    type Space = Two;
    const PARAMETERS: usize = 3;
    const HISTORY: usize = FRICTION as usize;
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = false;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        let c = |x| L::splat(token, x);
        let (m_i, m_j) = (
            c(self.per_area[0]) * r_i * r_i,
            c(self.per_area[1]) * r_j * r_j,
        );
        let stiffness = c(self.law.k_n) * (m_i * m_j / (m_i + m_j));
        (c(2.0 * self.law.alpha) * stiffness.sqrt()).store(&mut out[DAMPING]);
        (c(self.law.a) / (r_i + r_j)).store(&mut out[PER_LENGTH]);
        let smaller = r_i.select(r_j.greater(r_i), r_j);
        (c(2.0 * LARGEST_OVERLAP) * smaller).store(&mut out[LARGEST]);
    }

    fn largest_force(&self, radius: f64) -> f64 {
        let overlap = self.law.largest_overlap(radius, radius);
        self.law.normal_stiffness(radius, radius, overlap) * overlap
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let zero = L::splat(token, 0.0);
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let pairs = parameters.zip(blocks.motion).zip(&mut *blocks.response);
        for (k, ((p, motion), response)) in pairs.enumerate() {
            let overlap = L::load(token, &motion.overlap);
            let stiffening = L::load(token, &p[PER_LENGTH]).mul_add(overlap, L::splat(token, 1.0));
            let spring = NormalSpring {
                stiffness: L::splat(token, self.law.k_n) * stiffening,
                damping: L::load(token, &p[DAMPING]),
                overlap,
                velocity: L::load(token, &motion.normal_velocity),
            };
            let normal = spring.force(token);
            normal.store(&mut response.normal);
            response.beyond = overlap.greater(L::load(token, &p[LARGEST])).bits();
            if BUDGET {
                let power = spring.dissipated_power(token, normal);
                power.store(&mut response.dissipated[dissipation::DAMPING]);
            }
            if FRICTION {
                let before = L::load(token, &blocks.history[k]);
                let slip = L::load(token, &motion.tangential_increment[0]);
                let elastic = L::splat(token, -self.law.k_t).mul_add(slip, before);
                let touching = overlap.greater(zero);
                let slid_before = L::mask(token, response.sliding);
                let spring = SpringAndDamper::scalar(before, elastic, zero, slid_before, touching);
                let limit = L::splat(token, self.friction) * normal;
                let slid = spring.slide_together(token, limit);
                slid.force[0].store(&mut response.tangential[0]);
                response.sliding = slid.at_limit.bits();
                let after = slid.elastic[0].select(touching, zero);
                after.store(&mut blocks.history[k]);
                if BUDGET {
                    parts::FRICTION.clear(response);
                    let work = SpringWork {
                        stored: spring.before,
                        force_before: spring.force_before,
                        increment: [slip; 3],
                        compliance: L::splat(token, 1.0 / self.law.k_t),
                        limit,
                        power: zero,
                        was_at_limit: spring.was_at_limit,
                    };
                    spring.count_slider(token, &slid, &work, &parts::FRICTION, response);
                }
            }
        }
    }

    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3] {
        let c = |x| L::splat(token, x);
        let (per_length, zero) = (L::load(token, &parameters[PER_LENGTH]), c(0.0));
        let series = (c(1.0 / 3.0) * per_length).mul_add(overlap, c(0.5));
        let normal = c(self.law.k_n) * overlap * overlap * series;
        let force = if FRICTION {
            L::load(token, &history[0])
        } else {
            zero
        };
        [normal, c(0.5 / self.law.k_t) * force * force, zero]
    }
}

impl<const FRICTION: bool> Stiffness for Disks<FRICTION> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let (law, x) = (
            &self.law,
            self.law.a * state.overlap / state.radii.iter().sum::<f64>(),
        );
        let mut d = Derivatives {
            normal: law.k_n * state.overlap * (1.0 + x),
            normal_slope: law.k_n * (1.0 + 2.0 * x),
            ..Derivatives::default()
        };
        if FRICTION {
            let force = [state.history[0], 0.0, 0.0];
            d.tangential =
                SpringForce::new(force, law.k_t, d.limit(self.friction), state.limits[0]);
        }
        d
    }

    fn dampers(&self, state: &SpringState) -> Derivatives {
        Derivatives {
            normal_slope: parameters_of(self, state.radii)[DAMPING],
            ..Derivatives::default()
        }
    }
}
