//! The law of LH, appendix A, in 2D: Hertzian cylinders, Lai's tangential stiffness, Coulomb
//! friction, rolling resistance of type C, linear damping.
//!
//! Normal (A1 to A5): the implicit A2 in closed form. With y = δ/(4(R_1+R_2)) and
//! ℓ = ln(16 R_1R_2/a²),
//!
//! ```text
//! ℓ = L + ln(ℓ-1),  L = -ln y;   k_n = πE*/(ℓ-1);   a² = 16 R_1R_2 y/(ℓ-1)
//! F_n = max(0, k_n δ - γ_n v_n),  γ_n = 2α√(k_n m*)
//! ```
//!
//! Tangential (A6 to A12, A23): the history is the elastic force on i along t̂,
//!
//! ```text
//! F_t^e ← F_t^e - ½(k_t' + k_t) v_t(t+½Δt) Δt
//! ```
//!
//! with k_t' of the last step, which makes it of second order in Δt. It is cut to ±μ_s F_n and
//! stored so. Below this limit -γ_t v_t is added, γ_t = 2α√(k_t m*); at it the share
//! `sliding_damping` of that. A23 has no damper there, share 0; A6 and A11 as printed have all of
//! it, share 1.
//!
//! Rolling (A13 to A22): M^k ← M^k - k_r Δθ_r, cut to μ_r R_r F_n; below this limit -C_r (ω_i-ω_j)
//! is added.

use std::f64::consts::{LN_2, PI};
use std::sync::Arc;

use super::damping::{of_ratio, read_ratio, read_sliding};
use super::keys::{
    DAMPING_RATIO, DENSITY, Key, KeyReader, POISSON_RATIO, RESTITUTION, SLIDING_DAMPING,
    YOUNG_MODULUS,
};
use super::rolling::{self, Rolling, rolling_force};
use super::{Constants, Contact, LawKind, Rigidity};
use crate::contact::parts::{NormalSpring, SlidingForce, add_damping};
use crate::contact::stiffness::{Derivatives, ParallelDamper, SpringForce, SpringState, Stiffness};
use crate::contact::{Blocks, ContactLaw, dissipation, parameters_of, portable_ln, scalar};
use crate::dimension::{Dimensions, Two};
use crate::kernel::PairForce;
use crate::simd::{Lanes, Lanes16, Mask, Portable, inverse, inverse_sqrt, ln};
use crate::state::Masses;

/// The law as scenes name it.
pub const KIND: LawKind = LawKind {
    name: "lee-hurley",
    summary: "cylinders of one elastic material: Hertz, Lai, Coulomb, rolling resistance of type C \
              with k_r = πE* R_r²/4 (LH appendix A)",
    dimensions: &[Dimensions::Two],
    rolling: true,
    keys: &[
        &YOUNG_MODULUS,
        &POISSON_RATIO,
        &DENSITY,
        &DAMPING_RATIO,
        &RESTITUTION,
        &SLIDING_DAMPING,
    ],
    read: |values| Arc::new(Material::read(values)),
};

/// The elastic material of the grains and their damping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// E (Pa).
    pub young_modulus: f64,
    /// ν.
    pub poisson_ratio: f64,
    /// ρ (kg/m³).
    pub density: f64,
    /// α, normal and tangential.
    pub damping_ratio: f64,
    /// The share of the tangential damper that acts on sliding contacts.
    pub sliding_damping: f64,
}

/// Least k_n/k_t of A2 and A8: 1 + w of A9 for ν = 0, a → 0.
const NORMAL_PER_TANGENTIAL: f64 = 1.22;

impl Material {
    fn read(values: &mut dyn KeyReader) -> Self {
        Self {
            young_modulus: values.required(&YOUNG_MODULUS),
            poisson_ratio: values.required(&POISSON_RATIO),
            density: values.required(&DENSITY),
            damping_ratio: read_ratio(values),
            sliding_damping: read_sliding(values),
        }
    }

    /// E* (Pa) of two grains: 1/E* = 2 (1-ν²)/E.
    pub fn effective_modulus(&self) -> f64 {
        self.young_modulus / (2.0 * (1.0 - self.poisson_ratio * self.poisson_ratio))
    }
}

impl Constants for Material {
    fn masses(&self) -> Masses {
        Masses::Density(self.density)
    }

    fn normal_stiffness(&self, r1: f64, r2: f64, overlap: f64) -> f64 {
        normal_stiffness(self.effective_modulus(), r1, r2, overlap)
    }

    /// Cylinders approach by ln R.
    fn has_flat_limit(&self) -> bool {
        false
    }

    /// δ = 4(R1+R2) x (ln(1/x) - 1) at x = a²/(16 R1 R2).
    fn largest_overlap(&self, r1: f64, r2: f64) -> f64 {
        let a = LARGEST_CONTACT * r1.min(r2);
        let x = a * a / (16.0 * r1 * r2);
        4.0 * (r1 + r2) * x * (-portable_ln(x) - 1.0)
    }

    fn rigidity(&self, secant: f64, mass: f64, tangential: bool) -> Rigidity {
        let modulus = PI * self.effective_modulus();
        let tangential = if tangential {
            secant / NORMAL_PER_TANGENTIAL
        } else {
            0.0
        };
        Rigidity {
            // πE*/(ℓ-2), as F/δ = πE*/(ℓ-1).
            normal: 1.0 / (1.0 / secant - 1.0 / modulus),
            tangential,
            rolling: modulus / 16.0,
            damping: of_ratio(self.damping_ratio, mass, [secant, tangential]),
        }
    }

    /// k_r/R_r² = πE*/4 (A15).
    fn rolling_stiffness(&self) -> Option<f64> {
        Some(0.25 * PI * self.effective_modulus())
    }

    fn default_of(&self, key: &Key) -> Option<f64> {
        (key.path == SLIDING_DAMPING.path).then_some(self.sliding_damping)
    }

    fn derived(&self) -> Vec<(&'static str, f64, &'static str)> {
        vec![
            ("effective modulus E*", self.effective_modulus(), "Pa"),
            ("damping ratio alpha", self.damping_ratio, ""),
        ]
    }

    fn disks(&self, contact: &Contact) -> Option<Box<dyn PairForce<Two>>> {
        Some(
            match (contact.friction > 0.0, contact.rolling_friction > 0.0) {
                (false, false) => Box::new(LeeHurley::<false, false>::new(self, contact)),
                (false, true) => Box::new(LeeHurley::<false, true>::new(self, contact)),
                (true, false) => Box::new(LeeHurley::<true, false>::new(self, contact)),
                (true, true) => Box::new(LeeHurley::<true, true>::new(self, contact)),
            },
        )
    }
}

/// Largest a/R of the smaller grain: a little beyond it the penalty factor of A9, a fit, changes
/// sign.
pub(crate) const LARGEST_CONTACT: f64 = 0.3;

/// Constants of the law, the same for all contacts. Both grains are of one material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeeHurley<const FRICTION: bool, const ROLLING: bool> {
    /// πE* (Pa).
    stiffness: f64,
    /// Mass per squared radius, ρπ (kg/m³), of i and j.
    densities: [f64; 2],
    /// α.
    damping_ratio: f64,
    /// The share of the tangential damper that acts on sliding contacts.
    sliding_damping: f64,
    /// μ_s.
    friction: f64,
    rolling: Rolling,
    /// Part of A9 that does not depend on a.
    penalty: f64,
    /// Factor of a/R in A9.
    penalty_slope: f64,
    /// ν/(2(1-ν)) of A8.
    poisson: f64,
}

impl<const FRICTION: bool, const ROLLING: bool> LeeHurley<FRICTION, ROLLING> {
    /// The law between grains of this material.
    pub fn new(material: &Material, contact: &Contact) -> Self {
        let nu = material.poisson_ratio;
        Self {
            stiffness: PI * material.effective_modulus(),
            densities: contact.densities(PI * material.density),
            damping_ratio: material.damping_ratio,
            sliding_damping: material.sliding_damping,
            friction: contact.friction,
            rolling: Rolling::new(material, contact),
            penalty: 0.22 + 0.18 * nu + 0.36 * nu * nu,
            penalty_slope: 2.89 + 1.75 * nu,
            poisson: nu / (2.0 * (1.0 - nu)),
        }
    }
}

// Places in the parameters of a pair.
/// 1/(4(R_i+R_j)) (1/m).
const INVERSE_SIZE: usize = 0;
/// 2α√(πE* m*): γ_n √(ℓ-1), or γ_t times the root of the tangential compliance.
const DAMPING: usize = 1;
/// Without friction: the largest √x = a/(4√(R_iR_j)) within the law.
const LARGEST_ROOT: usize = 2;
/// With friction: a/R_i and a/R_j over √x, 4√(R_j/R_i) and 4√(R_i/R_j).
const RATIO_I: usize = 2;
const RATIO_J: usize = 3;
/// ½ ln(R_i/R_j).
const HALF_LOG_RATIO: usize = 4;

/// Lower bound of y: an overlap of 4e-17 (R_1+R_2) is below the rounding of the distance.
const SMALLEST_Y: f64 = 1e-17;

// The root m = ℓ-1 of m e^{-m-1} = y, m > 1, for y from 1e-17 to 0.026 (δ/(R_1+R_2) from 4e-17 to
// 0.1), to rounding error, with one logarithm of full precision: g ≈ 1/m to 8e-6 from a rough
// logarithm; m̂ = -ln(y g) - 1; and with 1/m = g(1+ε) the equation reads
// (1+ε)(g m̂ - g ln(1+ε)) = 1, which gives ε to third order.

/// g from y: L = -ln y to 9e-6 from a polynomial in the mantissa, then one in 1/(L+1).
#[inline(always)]
fn rough_inverse<L: Lanes>(token: L::Token, y: L) -> L {
    let c = |v| L::splat(token, v);
    let (exponent, mantissa) = y.exponent_mantissa();
    let f = mantissa - c(1.0);
    let log_mantissa = c(0.031103903420807752)
        .mul_add(f, c(-0.13321959654078797))
        .mul_add(f, c(0.28670634351300217))
        .mul_add(f, c(-0.4907430540737507))
        .mul_add(f, c(0.999299584240674))
        .mul_add(f, c(8.690916788947958e-6));
    let t = inverse(token, exponent.mul_add(c(-LN_2), c(1.0) - log_mantissa));
    c(2557.0650187196525)
        .mul_add(t, c(-1871.2736757477744))
        .mul_add(t, c(657.709659048908))
        .mul_add(t, c(-127.14398470452159))
        .mul_add(t, c(19.87690929967744))
        .mul_add(t, c(-1.3103538122716398))
        .mul_add(t, c(0.9762364837359377))
        .mul_add(t, c(0.00010907877487182954))
}

/// m̂ from y and g.
#[inline(always)]
fn near_root<L: Lanes>(token: L::Token, y: L, g: L) -> L {
    L::splat(token, -1.0) - ln(token, y * g)
}

/// m and 1/m from g and m̂.
#[inline(always)]
fn root<L: Lanes>(token: L::Token, g: L, m_hat: L) -> (L, L) {
    let c = |v| L::splat(token, v);
    let d = g.mul_add(m_hat, c(-1.0));
    let per_slope = inverse(token, (c(1.0) - g) + d);
    let first = -(d * per_slope);
    let epsilon = (c(0.5) * g * per_slope * first).mul_add(first, first);
    let m = (c(0.5) * epsilon).mul_add(epsilon, m_hat - epsilon);
    (m, g.mul_add(epsilon, g))
}

/// k_n = F_n^e/δ (Pa) of two cylinders of radii r1, r2 (m) at the overlap δ (m), E* in Pa (LH A2).
pub fn normal_stiffness(effective_modulus: f64, r1: f64, r2: f64, overlap: f64) -> f64 {
    PI * effective_modulus * inverse_root(overlap / (4.0 * (r1 + r2)))
}

/// 1/m from y.
fn inverse_root(y: f64) -> f64 {
    scalar(|token| {
        let y = Portable::splat(token, y);
        let g = rough_inverse(token, y);
        root(token, g, near_root(token, y, g)).1
    })
}

impl<const FRICTION: bool, const ROLLING: bool> ContactLaw for LeeHurley<FRICTION, ROLLING> {
    type Space = Two;
    const PARAMETERS: usize =
        3 + if FRICTION { 2 } else { 0 } + if ROLLING { rolling::PARAMETERS } else { 0 };
    const HISTORY: usize = if FRICTION { 2 } else { 0 } + if ROLLING { 1 } else { 0 };
    const HISTORY_PLACES: &'static [usize] = if FRICTION { &[0, 1, 2] } else { &[2] };
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = ROLLING;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        let c = |v| L::splat(token, v);
        let (one, four) = (c(1.0), c(4.0));
        let [of_i, of_j] = [c(self.densities[0]), c(self.densities[1])];
        let (m_i, m_j) = (of_i * r_i * r_i, of_j * r_j * r_j);
        let reduced_mass = m_i * m_j / (m_i + m_j);
        let ratio = r_j / r_i;
        (one / (four * (r_i + r_j))).store(&mut out[INVERSE_SIZE]);
        (c(2.0 * self.damping_ratio) * (c(self.stiffness) * reduced_mass).sqrt())
            .store(&mut out[DAMPING]);
        if FRICTION {
            (four * ratio.sqrt()).store(&mut out[RATIO_I]);
            (four * (one / ratio).sqrt()).store(&mut out[RATIO_J]);
            (c(-0.5) * ln(token, ratio)).store(&mut out[HALF_LOG_RATIO]);
        } else {
            let smaller = ratio.select(one.greater(ratio), one / ratio);
            (c(0.25 * LARGEST_CONTACT) * smaller.sqrt()).store(&mut out[LARGEST_ROOT]);
        }
        if ROLLING {
            let at = Self::PARAMETERS - rolling::PARAMETERS;
            self.rolling.parameters(token, r_i, r_j, &mut out[at..]);
        }
    }

    /// F_n = πE*a²/(4R*) at a = 0.3 R, R* = R/2.
    fn largest_force(&self, radius: f64) -> f64 {
        0.5 * self.stiffness * LARGEST_CONTACT * LARGEST_CONTACT * radius
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        self.normal_force::<L, BUDGET>(token, blocks);
        if FRICTION {
            self.tangential_force::<L, BUDGET>(token, blocks);
        }
        if ROLLING {
            rolling_force::<Self, L, BUDGET>(token, blocks);
        }
    }

    /// Normal: the integral of F_n = 4πE*S x over δ = 4S y, with S = R_i + R_j and dy = (ℓ-2) dx,
    /// is 16πE*S² x² (½ℓ - ¾).
    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3] {
        let c = |v| L::splat(token, v);
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let per_size = load(&parameters[INVERSE_SIZE]);
        let y = (overlap * per_size).max(c(SMALLEST_Y));
        let g = rough_inverse(token, y);
        let (m, per_m) = root(token, g, near_root(token, y, g));
        let a = y * per_m / per_size;
        let normal = c(self.stiffness) * a * a * c(0.5).mul_add(m, c(-0.25));
        let (mut tangential, mut rolling) = (c(0.0), c(0.0));
        if FRICTION {
            let force = load(&history[0]);
            tangential = c(0.5) * force * force / load(&history[1]);
        }
        if ROLLING {
            let k_r = load(&parameters[Self::PARAMETERS - rolling::PARAMETERS]);
            let torque = load(&history[Self::HISTORY - 1]);
            rolling = c(0.5) * torque * torque / k_r;
        }
        [normal, tangential, rolling]
    }
}

// Indices in `Blocks::carry`. Later quantities replace those that are no longer needed.
const Y: usize = 0;
const ROOT_X: usize = Y;
const G: usize = 1;
const PER_M: usize = G;
const M: usize = 2;
const COMPLIANCE: usize = M;
const ROOT_COMPLIANCE: usize = 3;

impl<const FRICTION: bool, const ROLLING: bool> LeeHurley<FRICTION, ROLLING> {
    /// Computes F_n; carries m and √x.
    #[inline(always)]
    fn normal_force<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let c = |v| L::splat(token, v);
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let parameters = || blocks.parameters.chunks_exact(Self::PARAMETERS);
        let carry = &mut *blocks.carry;
        for ((p, motion), carry) in parameters().zip(blocks.motion).zip(&mut *carry) {
            // NaN and subnormal numbers would cost time, also in lanes that do not touch.
            let y = (load(&motion.overlap) * load(&p[INVERSE_SIZE])).max(c(SMALLEST_Y));
            y.store(&mut carry[Y]);
            rough_inverse(token, y).store(&mut carry[G]);
        }
        for carry in &mut carry[..blocks.motion.len()] {
            near_root(token, load(&carry[Y]), load(&carry[G])).store(&mut carry[M]);
        }
        for carry in &mut carry[..blocks.motion.len()] {
            let (m, per_m) = root(token, load(&carry[G]), load(&carry[M]));
            m.store(&mut carry[M]);
            per_m.store(&mut carry[PER_M]);
        }
        let pairs = parameters().zip(blocks.motion).zip(carry);
        for (((p, motion), carry), response) in pairs.zip(&mut *blocks.response) {
            let (m, per_m) = (load(&carry[M]), load(&carry[PER_M]));
            let x = load(&carry[Y]) * per_m;
            let root_x = x * inverse_sqrt(token, x);
            root_x.store(&mut carry[ROOT_X]);
            let spring = NormalSpring {
                stiffness: c(self.stiffness) * per_m,
                damping: load(&p[DAMPING]) * inverse_sqrt(token, m),
                overlap: load(&motion.overlap),
                velocity: load(&motion.normal_velocity),
            };
            let normal = spring.force(token);
            normal.store(&mut response.normal);
            if BUDGET {
                let power = spring.dissipated_power(token, normal);
                power.store(&mut response.dissipated[dissipation::DAMPING]);
            }
            let beyond = if FRICTION {
                let larger = load(&p[RATIO_I]).max(load(&p[RATIO_J]));
                (larger * root_x).greater(c(LARGEST_CONTACT))
            } else {
                root_x.greater(load(&p[LARGEST_ROOT]))
            };
            response.beyond = beyond.bits();
        }
    }

    /// The penalty factor of A9 at a/R.
    #[inline(always)]
    fn penalty_factor<L: Lanes>(&self, token: L::Token, ratio: L) -> L {
        L::splat(token, -10.31)
            .mul_add(ratio, L::splat(token, self.penalty_slope))
            .mul_add(ratio, L::splat(token, self.penalty))
    }

    /// Computes F_t.
    #[inline(always)]
    fn tangential_force<L: Lanes, const BUDGET: bool>(
        &self,
        token: L::Token,
        blocks: &mut Blocks<'_>,
    ) {
        let c = |v| L::splat(token, v);
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let zero = c(0.0);
        let parameters = || blocks.parameters.chunks_exact(Self::PARAMETERS);
        let carry = &mut blocks.carry[..blocks.motion.len()];
        for (p, carry) in parameters().zip(&mut *carry) {
            let (m, root_x) = (load(&carry[M]), load(&carry[ROOT_X]));
            let half_log = load(&p[HALF_LOG_RATIO]);
            let base = c(0.5).mul_add(m, c(0.5 + self.poisson));
            let of_i = self.penalty_factor(token, load(&p[RATIO_I]) * root_x);
            let of_j = self.penalty_factor(token, load(&p[RATIO_J]) * root_x);
            let of_both = of_j.mul_add(base - half_log, m + c(2.0 - 2.0 * LN_2));
            let compliance = of_i.mul_add(base + half_log, of_both);
            inverse_sqrt(token, compliance).store(&mut carry[ROOT_COMPLIANCE]);
            if BUDGET {
                compliance.store(&mut carry[COMPLIANCE]);
            }
        }
        let kept = parameters().zip(blocks.history.chunks_exact_mut(Self::HISTORY));
        let pairs = kept.zip(blocks.motion).zip(carry);
        for ((((p, history), motion), carry), response) in pairs.zip(&mut *blocks.response) {
            let touching = load(&motion.overlap).greater(zero);
            let root = load(&carry[ROOT_COMPLIANCE]);
            let k_t = c(self.stiffness) * (root * root);
            let last = load(&history[1]);
            // Since the touch k_t has grown about as δ^(1/(m-1)), whose mean is (1 - 1/m) k_t.
            let first = (c(-2.0) * k_t).mul_add(load(&carry[PER_M]), k_t);
            let last = last.select(last.greater(zero), first);
            let before = load(&history[0]);
            let slip = load(&motion.tangential_increment[0]);
            let v_t = load(&motion.tangential_velocity[0]);
            let elastic = (c(-0.5) * (last + k_t)).mul_add(slip, before);
            let viscous = load(&p[DAMPING]) * root * v_t;
            let limit = c(self.friction) * load(&response.normal);
            let slid =
                SlidingForce::spring_alone(token, elastic, viscous, limit, self.sliding_damping);
            slid.force[0].store(&mut response.tangential[0]);
            response.sliding = slid.at_limit.bits();
            let after = slid.elastic[0].select(touching, zero);
            if BUDGET {
                let work = c(-0.5) * (before + after) * slip;
                let per_k = load(&carry[COMPLIANCE]) * c(1.0 / self.stiffness);
                let per_last = inverse(token, last);
                let gained = c(0.5) * after * after * per_k - c(0.5) * before * before * per_last;
                let dissipated = work - gained;
                let friction = dissipated.select(slid.at_limit, zero);
                friction.store(&mut response.dissipated[dissipation::FRICTION]);
                let stuck = zero.select(slid.at_limit, dissipated);
                stuck.store(&mut response.dissipated[dissipation::STIFFNESS]);
                let viscous = slid.viscous[0].select(touching, zero);
                add_damping(token, response, viscous * v_t);
            }
            after.store(&mut history[0]);
            k_t.select(touching, zero).store(&mut history[1]);
        }
    }
}

/// The history is a force, so F_t does not depend on δ below the limit. dF_n/dδ = πE*/(ℓ-2).
impl<const FRICTION: bool, const ROLLING: bool> Stiffness for LeeHurley<FRICTION, ROLLING> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let (overlap, [r_i, r_j]) = (state.overlap, state.radii);
        let y = overlap / (4.0 * (r_i + r_j));
        let m = 1.0 / inverse_root(y);
        let [slides, rolls, _] = state.limits;
        let mut d = Derivatives {
            normal: self.stiffness / m * overlap,
            normal_slope: self.stiffness / (m - 1.0),
            ..Derivatives::default()
        };
        let [force, _, torque] = state.history;
        if FRICTION {
            let k_t = self.tangential_stiffness(state.radii, m, (y / m).sqrt());
            d.tangential = SpringForce::new([force, 0.0, 0.0], k_t, d.limit(self.friction), slides);
        }
        if ROLLING {
            d.rolling = self.rolling.derivatives(torque, state.radii, &d, rolls);
        }
        d
    }

    fn dampers(&self, state: &SpringState) -> Derivatives {
        let springs = self.derivatives(state);
        let parameters = parameters_of(self, state.radii);
        let [r_i, r_j] = state.radii;
        let y = state.overlap / (4.0 * (r_i + r_j));
        let per_m = inverse_root(y);
        let mut d = Derivatives {
            normal_slope: parameters[DAMPING] * per_m.sqrt(),
            ..Derivatives::default()
        };
        if FRICTION {
            let m = 1.0 / per_m;
            let k_t = self.tangential_stiffness(state.radii, m, (y / m).sqrt());
            let gamma_t = parameters[DAMPING] * (k_t / self.stiffness).sqrt();
            let damper = ParallelDamper {
                cut: (1.0 - self.sliding_damping) * gamma_t,
                beside: self.sliding_damping * gamma_t,
                of_limit: self.friction * d.normal_slope,
            };
            d.tangential = damper.derivatives(&springs.tangential, k_t);
        }
        if ROLLING {
            let own = &parameters[Self::PARAMETERS - rolling::PARAMETERS..];
            d.rolling = rolling::damper_of(own, &springs.rolling, &d);
        }
        d
    }
}

impl<const FRICTION: bool, const ROLLING: bool> LeeHurley<FRICTION, ROLLING> {
    /// k_t (Pa) of A8 and A9 from m = ℓ-1 and √x, as in `tangential_force`.
    fn tangential_stiffness(&self, radii: [f64; 2], m: f64, root_x: f64) -> f64 {
        let [r_i, r_j] = radii;
        let penalty = |radius: f64, other: f64| {
            let a = 4.0 * (other / radius).sqrt() * root_x;
            self.penalty + a * (self.penalty_slope - 10.31 * a)
        };
        let half_log = 0.5 * portable_ln(r_i / r_j);
        let base = 0.5 * m + 0.5 + self.poisson;
        let compliance = m + 2.0 - 2.0 * LN_2
            + penalty(r_i, r_j) * (base + half_log)
            + penalty(r_j, r_i) * (base - half_log);
        self.stiffness / compliance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::tests::response_of;

    const MATERIAL: Material = Material {
        young_modulus: 1e9,
        poisson_ratio: 0.2,
        density: 2500.0,
        damping_ratio: 0.1,
        sliding_damping: 0.0,
    };
    const CONTACT: Contact = Contact {
        friction: 0.7,
        rolling_friction: 0.01,
        rolling_damping_ratio: 0.3,
        ..Contact::NONE
    };

    /// Lower branch of Lambert's W by 40-digit arithmetic (mpmath): ℓ of δ/(R_1+R_2).
    #[test]
    fn closed_form_of_the_cylinder() {
        for (ratio, expected) in [
            (1e-6, 18.037_204_363_872_48),
            (1e-5, 15.578_787_379_050_668),
            (1e-4, 13.088_924_430_173_33),
            (1e-3, 10.550_659_890_711_273),
            (1e-2, 7.926_873_037_311_755),
            (5e-2, 5.989_327_832_447_779),
            (9e-2, 5.238_433_779_037_182),
        ] {
            let k = normal_stiffness(1.0 / PI, 0.4, 0.6, ratio);
            let error = (k * (expected - 1.0) - 1.0).abs();
            assert!(error < 5e-16, "{ratio:e}: {error:e}");
        }
    }

    /// A2 itself: with the force of the closed form, a² = 4FR*/(πE*) and k_n of A2 give back the
    /// force.
    #[test]
    fn closed_form_satisfies_the_implicit_law() {
        let (e, r1, r2) = (MATERIAL.effective_modulus(), 0.5e-6, 0.9e-6);
        for exponent in -30..-9 {
            let overlap = (r1 + r2) * 2f64.powi(exponent);
            let force = normal_stiffness(e, r1, r2, overlap) * overlap;
            let a = (4.0 * force * (r1 * r2 / (r1 + r2)) / (PI * e)).sqrt();
            let k = PI * e / ((4.0 * r1 / a).ln() + (4.0 * r2 / a).ln() - 1.0);
            assert!((k * overlap / force - 1.0).abs() < 4e-15);
        }
    }

    /// k_t/k_n of equal disks with ν = 0.2, worked out independently.
    #[test]
    fn tangential_stiffness_reference_values() {
        let law = LeeHurley::<true, true>::new(&MATERIAL, &CONTACT);
        for (ratio, expected) in [(0.005, 0.733), (0.01, 0.718), (0.05, 0.645), (0.1, 0.594)] {
            let r = 1e-6;
            let e = MATERIAL.effective_modulus();
            // δ from a: F = πE*a²/(4R*), δ = F/k_n.
            let ell: f64 = (16.0f64 / (ratio * ratio)).ln();
            let k_n = PI * e / (ell - 1.0);
            let overlap = PI * e * (ratio * r) * (ratio * r) / (4.0 * 0.5 * r) / k_n;
            let mut state = [0.0; 3];
            response_of(&law, [r; 2], [overlap, 0.0, 0.0, 0.0, 0.0, 0.0], &mut state);
            assert!((state[1] / k_n - expected).abs() < 5.1e-4, "{ratio}");
        }
    }

    #[test]
    fn slides_at_the_limit_and_remembers_it() {
        let law = LeeHurley::<true, true>::new(&MATERIAL, &CONTACT);
        let mut state = [0.0; 3];
        let motion = [1e-10, 0.0, 0.0, 1e-9, 0.0, 0.0];
        response_of(&law, [1e-6; 2], motion, &mut state);
        let force = normal_stiffness(MATERIAL.effective_modulus(), 1e-6, 1e-6, 1e-10) * 1e-10;
        assert!((state[0] + 0.7 * force).abs() < 1e-15 * force);
    }
}
