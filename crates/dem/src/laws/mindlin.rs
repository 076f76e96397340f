//! The smoothed Mindlin law of BO, between disks or spheres, without damping.
//!
//! ```text
//! F_n = k_n δ^(3/2)                                                    (BO 1)
//! F_t = -k_t √δ (1 + s - s²) t,   s = |t|/t*,   t* = μ (k_n/k_t) δ     (BO 5, A4, A5)
//! ```
//!
//! The history t (m) is the tangential displacement since the touch. F_t reaches Coulomb's limit
//! μF_n at |t| = t* with zero slope. If |t| exceeds t*, it is set back to t*, and the contact
//! slides. (In BO 5 and A4, t stands for |t|.)
//!
//! F_t has no potential: a change of δ at constant t dissipates energy, or creates some.

use std::marker::PhantomData;
use std::sync::Arc;

use super::hooke::read_stiffnesses;
use super::keys::{DENSITY, Key, KeyReader, MASS, NORMAL_STIFFNESS_3_2, TANGENTIAL_STIFFNESS_3_2};
use super::rolling_spheres::between_spheres;
use super::{Constants, Contact, LawKind, Rigidity};
use crate::contact::parts::{exceeds, set_back};
use crate::contact::stiffness::{self, Derivatives, SpringForce, SpringState, Stiffness};
use crate::contact::{Blocks, ContactLaw, dissipation, norm, sum, vector};
use crate::dimension::{Dimension, Dimensions, Three, Two, Vector};
use crate::kernel::PairForce;
use crate::simd::{Lanes, Lanes16, Mask, inverse, inverse_sqrt};
use crate::state::Masses;

/// The law as scenes name it.
pub const KIND: LawKind = LawKind {
    name: "mindlin",
    summary: "the smoothed Mindlin law, F_n = k_n δ^(3/2), the same for all pairs, without damping \
              (BO eqs 1 and 5)",
    dimensions: &[Dimensions::Two, Dimensions::Three],
    rolling: false,
    keys: &[
        &DENSITY,
        &MASS,
        &NORMAL_STIFFNESS_3_2,
        &TANGENTIAL_STIFFNESS_3_2,
    ],
    read: |values| Arc::new(MindlinSprings::read(values)),
};

/// Springs of F = k δ^(3/2) between grains, whatever their radii.
#[derive(Debug, Clone, PartialEq)]
pub struct MindlinSprings {
    /// k_n (N/m^(3/2); per unit depth in 2D).
    pub normal_stiffness: f64,
    /// k_t (N/m^(3/2); per unit depth in 2D).
    pub tangential_stiffness: f64,
    /// The density of the grains, or the mass of each.
    pub masses: Masses,
}

impl MindlinSprings {
    fn read(values: &mut dyn KeyReader) -> Self {
        let [normal_stiffness, tangential_stiffness] =
            read_stiffnesses(values, &NORMAL_STIFFNESS_3_2, &TANGENTIAL_STIFFNESS_3_2);
        let chosen = values.exactly_one(
            &[&DENSITY, &MASS],
            "the masses: density (rho, kg/m^3), such as density = 2500.0, or mass (kg; kg/m in 2D), the same for all grains",
        );
        let masses = match (values.number(&DENSITY), values.number(&MASS)) {
            (_, Some(mass)) if chosen == 1 => Masses::Equal(mass),
            (density, _) => Masses::Density(density.unwrap_or(f64::NAN)),
        };
        Self {
            normal_stiffness,
            tangential_stiffness,
            masses,
        }
    }
}

impl Constants for MindlinSprings {
    fn masses(&self) -> Masses {
        self.masses.clone()
    }

    fn normal_stiffness(&self, _: f64, _: f64, overlap: f64) -> f64 {
        self.normal_stiffness * overlap.sqrt()
    }

    fn largest_overlap(&self, r1: f64, r2: f64) -> f64 {
        2.0 * LARGEST_OVERLAP * r1.min(r2)
    }

    fn rigidity(&self, secant: f64, _: f64, tangential: bool) -> Rigidity {
        // (1 + 2s - 3s²) k_t √δ is greatest at s = 1/3.
        let k_t = 4.0 / 3.0 * self.tangential_stiffness / self.normal_stiffness * secant;
        Rigidity {
            normal: 1.5 * secant,
            tangential: if tangential { k_t } else { 0.0 },
            rolling: 0.0,
            damping: [0.0; 2],
        }
    }

    fn default_of(&self, key: &Key) -> Option<f64> {
        (key.path == TANGENTIAL_STIFFNESS_3_2.path).then_some(self.tangential_stiffness)
    }

    fn derived(&self) -> Vec<(&'static str, f64, &'static str)> {
        Vec::new()
    }

    fn disks(&self, contact: &Contact) -> Option<Box<dyn PairForce<Two>>> {
        Some(if contact.friction > 0.0 {
            Box::new(Mindlin::<Two, true>::new(self, contact))
        } else {
            Box::new(Mindlin::<Two, false>::new(self, contact))
        })
    }

    fn spheres(&self, contact: &Contact) -> Option<Box<dyn PairForce<Three>>> {
        let rough = Mindlin::<Three, true>::new(self, contact);
        let smooth = Mindlin::<Three, false>::new(self, contact);
        Some(between_spheres(self, contact, rough, smooth))
    }
}

/// Largest δ over the diameter of the smaller grain. The law itself has no bound: up to here its
/// forces are rounded exactly to the unit of forces.
pub const LARGEST_OVERLAP: f64 = 0.39;
/// δ over the diameter from whose F_n the unit of the forces follows; at [`LARGEST_OVERLAP`] F_n is
/// less than twice as great.
const UNIT_OVERLAP: f64 = 0.25;

/// Constants of the law, the same for all contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mindlin<D, const FRICTION: bool> {
    /// k_n, k_t (N/m^(3/2); per unit depth in 2D).
    normal_stiffness: f64,
    tangential_stiffness: f64,
    /// μ.
    friction: f64,
    space: PhantomData<D>,
}

impl<D: Dimension, const FRICTION: bool> Mindlin<D, FRICTION> {
    /// The law between grains with these springs.
    pub fn new(springs: &MindlinSprings, contact: &Contact) -> Self {
        Self {
            normal_stiffness: springs.normal_stiffness,
            tangential_stiffness: springs.tangential_stiffness,
            friction: contact.friction,
            space: PhantomData,
        }
    }

    /// t*/δ.
    fn threshold_per_overlap(&self) -> f64 {
        self.friction * self.normal_stiffness / self.tangential_stiffness
    }
}

// Index in `Blocks::carry`: √δ.
const ROOT: usize = 0;

/// Lower bound of δ (m), also for pairs that do not touch.
const NO_OVERLAP: f64 = 1e-200;

impl<D: Dimension, const FRICTION: bool> ContactLaw for Mindlin<D, FRICTION> {
    type Space = D;
    const PARAMETERS: usize = 0;
    const HISTORY: usize = if FRICTION { D::SPINS } else { 0 };
    const HISTORY_UNIT: &'static str = "m";
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = false;
    const LARGEST_OVERLAP: f64 = LARGEST_OVERLAP;

    fn parameters<L: Lanes>(&self, _: L::Token, _: L, _: L, _: &mut [Lanes16]) {}

    /// F_t may be greater than F_n, but more than twice as great only in contacts of tiny F_n.
    fn largest_force(&self, radius: f64) -> f64 {
        let overlap = 2.0 * UNIT_OVERLAP * radius;
        self.normal_stiffness * overlap * overlap.sqrt() * self.friction.clamp(1.0, 2.0)
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let c = |v| L::splat(token, v);
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let pairs = blocks.motion.iter().zip(&mut *blocks.carry);
        for ((motion, carry), response) in pairs.zip(&mut *blocks.response) {
            let overlap = load(&motion.overlap);
            let depth = overlap.max(c(NO_OVERLAP));
            let root = depth * inverse_sqrt(token, depth);
            root.store(&mut carry[ROOT]);
            (c(self.normal_stiffness) * depth * root).store(&mut response.normal);
            if BUDGET {
                response.dissipated = [Lanes16::ZERO; dissipation::COUNTS];
            }
        }
        if FRICTION {
            self.tangential_force::<L, BUDGET>(token, blocks);
        }
    }

    /// Normal: ∫ F_n dδ = (2/5) k_n δ^(5/2). Tangential: ∫ F_t dt at this δ.
    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        _: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3] {
        let c = |v| L::splat(token, v);
        let depth = overlap.max(c(NO_OVERLAP));
        let root = depth * inverse_sqrt(token, depth);
        let normal = c(0.4 * self.normal_stiffness) * root * depth * depth;
        let mut tangential = c(0.0);
        if FRICTION {
            let t = vector(token, history, D::SPINS);
            let s = self.mobilised(token, depth, &t);
            tangential = self.energy(token, root, s, &t);
        }
        [normal, tangential, c(0.0)]
    }
}

impl<D: Dimension, const FRICTION: bool> Mindlin<D, FRICTION> {
    /// s = |t|/t*, for t ≠ 0.
    #[inline(always)]
    fn mobilised<L: Lanes>(&self, token: L::Token, depth: L, t: &Vector<L>) -> L {
        let length = if D::SPINS == 1 {
            t[0].abs()
        } else {
            norm(token, t).0
        };
        length * inverse(token, L::splat(token, self.threshold_per_overlap()) * depth)
    }

    /// -F_t/t.
    #[inline(always)]
    fn secant<L: Lanes>(&self, token: L::Token, root: L, s: L) -> L {
        let one = L::splat(token, 1.0);
        L::splat(token, self.tangential_stiffness) * root * s.mul_add(one - s, one)
    }

    /// ∫ F_t dt = k_t √δ t² (1/2 + s/3 - s²/4), s ≤ 1.
    #[inline(always)]
    fn energy<L: Lanes>(&self, token: L::Token, root: L, s: L, t: &Vector<L>) -> L {
        let c = |v| L::splat(token, v);
        let square = if D::SPINS == 1 {
            t[0] * t[0]
        } else {
            D::dot(t, t)
        };
        let s = c(1.0).select(s.greater(c(1.0)), s);
        let part = c(-0.25).mul_add(s, c(1.0 / 3.0)).mul_add(s, c(0.5));
        c(self.tangential_stiffness) * root * square * part
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
        let (zero, one) = (c(0.0), c(1.0));
        let spins = D::SPINS;
        let histories = blocks.history.chunks_exact_mut(Self::HISTORY);
        let pairs = histories.zip(blocks.motion).zip(&*blocks.carry);
        for (((history, motion), carry), response) in pairs.zip(&mut *blocks.response) {
            let overlap = load(&motion.overlap);
            let touching = overlap.greater(zero);
            let (depth, root) = (overlap.max(c(NO_OVERLAP)), load(&carry[ROOT]));
            let before = vector(token, history, spins);
            let slip = vector(token, &motion.tangential_increment, spins);
            let mut t = sum(&before, &slip);
            let s = self.mobilised(token, depth, &t);
            let mut sliding = s.greater(one);
            if spins == 3 {
                let limit = c(self.threshold_per_overlap()) * depth;
                sliding = exceeds(&t, limit).and(touching);
                if sliding.bits() != 0 {
                    let slid = L::mask(token, response.sliding);
                    t = set_back(token, &before, &t, limit, slid, sliding);
                }
            } else {
                t[0] = t[0] * inverse(token, s).select(sliding, one);
            }
            response.sliding = sliding.bits();
            // Without overlap s may be too great for its square.
            let s = one.select(sliding, s).select(touching, zero);
            let stiffness = self.secant(token, root, s);
            for k in 0..spins {
                (-(stiffness * t[k])).store(&mut response.tangential[k]);
                t[k] = t[k].select(touching, zero);
                t[k].store(&mut history[k]);
            }
            if BUDGET {
                let earlier = (overlap + load(&motion.normal_increment)).max(c(NO_OVERLAP));
                let root_before = earlier * inverse_sqrt(token, earlier);
                let s_before = self.mobilised(token, earlier, &before);
                let s_before = one.select(s_before.greater(one), s_before);
                let stiffness_before = self.secant(token, root_before, s_before);
                let (mut work, mut slid) = (zero, zero);
                for k in 0..spins {
                    let force = c(0.5) * (stiffness_before * before[k] + stiffness * t[k]);
                    work = force.mul_add(slip[k], work);
                    slid = force.mul_add(before[k] + slip[k] - t[k], slid);
                }
                let gained = self.energy(token, root, s, &t)
                    - self.energy(token, root_before, s_before, &before);
                let dissipated = work - gained;
                // A contact that opens has slid until t was zero.
                let friction = slid.select(sliding, zero).select(touching, dissipated);
                let stiffness = (dissipated - friction).select(touching, zero);
                stiffness.store(&mut response.dissipated[dissipation::STIFFNESS]);
                friction.store(&mut response.dissipated[dissipation::FRICTION]);
            }
        }
    }
}

/// For s ≤ 1, ∂F_t/∂t = -k_t √δ (1 + 2s - 3s²) along t (BO A6) and -k_t √δ (1 + s - s²)
/// perpendicular to it; ∂F_t/∂δ = -k_t (1 + s - s² + 2(2s² - s)) t/(2√δ) (BO B1). For s > 1, F_t =
/// -μ k_n δ^(3/2) t/|t|, with the same derivatives at s = 1.
impl<D: Dimension, const FRICTION: bool> Stiffness for Mindlin<D, FRICTION> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let (overlap, history, [slides, ..]) = (state.overlap, state.history, state.limits);
        let root = overlap.sqrt();
        let mut d = Derivatives {
            normal: self.normal_stiffness * overlap * root,
            normal_slope: 1.5 * self.normal_stiffness * root,
            ..Derivatives::default()
        };
        if !FRICTION {
            return d;
        }
        let length = stiffness::norm(history);
        let direction = stiffness::unit(history, length);
        let s = length / (self.threshold_per_overlap() * overlap);
        let k_t = self.tangential_stiffness * root;
        // A contact that was cut to s = 1 has it with a rounding error.
        let at_limit = slides.unwrap_or(s >= 1.0);
        let limit = d.limit(self.friction);
        d.tangential = if at_limit {
            SpringForce {
                value: direction.map(|t| -limit.value * t),
                slope: direction.map(|t| -limit.slope * t),
                along: 0.0,
                across: limit.value / length,
                direction,
                at_limit,
            }
        } else {
            let s = s.min(1.0);
            let secant = 1.0 + s - s * s;
            let slope = -k_t / (2.0 * overlap) * (secant + 2.0 * s * (2.0 * s - 1.0));
            SpringForce {
                value: history.map(|t| -k_t * secant * t),
                slope: history.map(|t| slope * t),
                along: k_t * (1.0 + 2.0 * s - 3.0 * s * s),
                across: k_t * secant,
                direction,
                at_limit,
            }
        };
        d
    }

    /// There are none.
    fn dampers(&self, _: &SpringState) -> Derivatives {
        Derivatives::default()
    }
}
