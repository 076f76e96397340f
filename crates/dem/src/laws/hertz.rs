//! Spheres: Hertz and Mindlin with viscoelastic damping and Coulomb friction (FR eqs 1 and 2).
//!
//! With the overlap δ and R* = R_i R_j/(R_i+R_j), m* = m_i m_j/(m_i+m_j),
//!
//! ```text
//! F_n = max(0, √(δR*) (k_n δ - m*γ_n v_n)),   k_n = (2/3) E/(1-ν²)
//! F_t = -√(δR*) (k_t u + m*γ_t v_t),          k_t = 2E/((1+ν)(2-ν))
//! ```
//!
//! The history u (m) is the tangential displacement since the touch. If |F_t| exceeds μF_n, it is
//! cut to that limit, and u is set back so that spring and damper together give the limit.
//!
//! The force of a loaded spring grows and falls with √δ, without work along the slip: a cycle that
//! shears, presses, shears back and releases returns more energy than it took
//! (`dissipated_stiffness` < 0). With `tangential_history = "force"` the history is the force F of
//! the spring (N) instead, and no cycle does so (D. Elata and J. G. Berryman, Mech. Mater. 24, 229,
//! 1996). It grows by the slip Δu, does not change while δ grows, and falls with √δ,
//!
//! ```text
//! F ← F - k_t √(δR*) Δu            while δ grows,
//! F ← F √(δ/δ') - k_t √(δR*) Δu    while δ falls from δ' to δ
//! ```
//!
//! as LAMMPS' `mindlin_rescale/force`, but with the mean of √(δR*) of the step while δ grows. K has
//! the derivative of a δ that grows: F does not change with δ.
//!
//! With `ageing` μ grows with the age of the contact (below).
//!
//! This is LAMMPS' `gran/hertz/history` with `limit_damping` and the k_t of FR.

use std::fmt::Debug;
use std::marker::PhantomData;
use std::sync::Arc;

use super::ageing::{Aged, Ageing, read_ageing};
use super::keys::{
    AGEING, AGEING_SLIP, AGEING_TIME, DENSITY, IMPACT_DIAMETER, IMPACT_SPEED, Key, KeyReader,
    NORMAL_DAMPING, POISSON_RATIO, RESTITUTION, TANGENTIAL_DAMPING, TANGENTIAL_HISTORY,
    YOUNG_MODULUS,
};
use super::rolling_spheres::between_spheres;
use super::{Constants, Contact, LawKind, Rigidity};
use crate::contact::friction::{Coulomb, Friction, SlipOfStep};
use crate::contact::parts::{
    self, CutDamper, LimitedSpring, SpringAndDamper, exceeds, reaches, set_back,
};
use crate::contact::stiffness::{Derivatives, ParallelDamper, SpringForce, SpringState, Stiffness};
use crate::contact::{
    AGE, Blocks, ContactLaw, difference, dissipation, norm, parameters_of, portable_exp,
    portable_ln, scalar, scaled, sum, vector, velocity_before,
};
use crate::dimension::{Dimension, Dimensions, Three, Vector, scaled_sum};
use crate::kernel::PairForce;
use crate::simd::{Lanes, Lanes16, Mask, Portable, inverse, inverse_sqrt};
use crate::state::Masses;

/// The law as scenes name it.
pub const KIND: LawKind = LawKind {
    name: "hertz",
    summary: "spheres of one elastic material: Hertz and Mindlin with viscous damping and Coulomb \
              friction (FR eqs 1 and 2; LAMMPS `gran/hertz/history`)",
    dimensions: &[Dimensions::Three],
    rolling: false,
    keys: &[
        &YOUNG_MODULUS,
        &POISSON_RATIO,
        &DENSITY,
        &RESTITUTION,
        &IMPACT_SPEED,
        &IMPACT_DIAMETER,
        &NORMAL_DAMPING,
        &TANGENTIAL_DAMPING,
        &TANGENTIAL_HISTORY,
        &AGEING,
        &AGEING_TIME,
        &AGEING_SLIP,
    ],
    read: |values| Arc::new(Spheres::read(values)),
};

/// The elastic material of the spheres and their damping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spheres {
    /// E (Pa).
    pub young_modulus: f64,
    /// ν.
    pub poisson_ratio: f64,
    /// ρ (kg/m³).
    pub density: f64,
    /// γ_n (1/(m s)).
    pub normal_damping: f64,
    /// γ_t (1/(m s)).
    pub tangential_damping: f64,
    /// Whether the history of the tangential spring is its force, not its displacement.
    pub remembers_force: bool,
    /// How friction grows with the age of a contact.
    pub ageing: Option<Ageing>,
}

impl Spheres {
    /// k_n = (2/3) E/(1-ν²) (Pa).
    pub fn normal_stiffness(&self) -> f64 {
        2.0 / 3.0 * self.young_modulus / (1.0 - self.poisson_ratio * self.poisson_ratio)
    }

    /// k_t = 2E/((1+ν)(2-ν)) (Pa).
    pub fn tangential_stiffness(&self) -> f64 {
        2.0 * self.young_modulus / ((1.0 + self.poisson_ratio) * (2.0 - self.poisson_ratio))
    }

    /// k_n and k_t for [`Constants::derived`].
    pub(super) fn stiffnesses(&self) -> [(&'static str, f64, &'static str); 2] {
        let k_t = self.tangential_stiffness();
        [
            ("normal stiffness k_n", self.normal_stiffness(), "Pa"),
            ("tangential stiffness k_t", k_t, "Pa"),
        ]
    }

    /// The material, undamped.
    pub(super) fn read_material(values: &mut dyn KeyReader) -> Self {
        Self {
            young_modulus: values.required(&YOUNG_MODULUS),
            poisson_ratio: values.required(&POISSON_RATIO),
            density: values.required(&DENSITY),
            normal_damping: 0.0,
            tangential_damping: 0.0,
            remembers_force: values.choice(&TANGENTIAL_HISTORY) == Some("force"),
            ageing: None,
        }
    }

    fn read(values: &mut dyn KeyReader) -> Self {
        let mut spheres = Self::read_material(values);
        let chosen = values.exactly_one(
            &[&NORMAL_DAMPING, &RESTITUTION],
            "the damping: normal_damping (gamma_n, 1/(m s)), such as normal_damping = 6e7, or restitution with impact_speed (m/s) and impact_diameter (m)",
        );
        let gamma_n = values.number(&NORMAL_DAMPING).unwrap_or(0.0);
        spheres.normal_damping = if chosen == 1 {
            let e = values.number(&RESTITUTION).unwrap_or(1.0);
            let speed = values.required(&IMPACT_SPEED);
            let diameter = values.required(&IMPACT_DIAMETER);
            impact_damping(&spheres, e, speed, diameter)
        } else {
            let why = "says at what the restitution is measured, and normal_damping is given instead of it";
            values.useless(&IMPACT_SPEED, why);
            values.useless(&IMPACT_DIAMETER, why);
            gamma_n
        };
        let gamma_t = values.number(&TANGENTIAL_DAMPING);
        if gamma_t.is_some_and(|gamma_t| gamma_t > 0.0) && spheres.normal_damping == 0.0 {
            values.refuse(
                &TANGENTIAL_DAMPING,
                "must be 0 where normal_damping is 0: contacts that slow each other down across do so along n as well",
            );
        }
        spheres.tangential_damping = gamma_t.unwrap_or(0.5 * spheres.normal_damping);
        spheres.ageing = read_ageing(values);
        if spheres.ageing.is_some() && spheres.remembers_force {
            values.refuse(
                &AGEING,
                "is not for tangential_history = \"force\"; leave one of the two out",
            );
        }
        spheres
    }
}

impl Constants for Spheres {
    fn masses(&self) -> Masses {
        Masses::Density(self.density)
    }

    fn normal_stiffness(&self, r1: f64, r2: f64, overlap: f64) -> f64 {
        Spheres::normal_stiffness(self) * (overlap * r1 * r2 / (r1 + r2)).sqrt()
    }

    fn largest_overlap(&self, r1: f64, r2: f64) -> f64 {
        2.0 * LARGEST_OVERLAP * r1.min(r2)
    }

    fn rigidity(&self, secant: f64, mass: f64, tangential: bool) -> Rigidity {
        let k_n = Spheres::normal_stiffness(self);
        // √(δR*) m* γ.
        let damping = |gamma: f64| secant / k_n * 0.5 * mass * gamma;
        Rigidity {
            normal: 1.5 * secant,
            tangential: if tangential {
                self.tangential_stiffness() / k_n * secant
            } else {
                0.0
            },
            rolling: 0.0,
            damping: [self.normal_damping, self.tangential_damping].map(damping),
        }
    }

    /// Damped for a restitution of 0.3 at the speed √(P/ρ) of the collapsing loose sample, unless
    /// the damping is already stronger: a gas of weakly damped spheres takes long to settle.
    fn while_packing(&self, mean_diameter: f64, pressure: f64) -> Option<Arc<dyn Constants>> {
        let speed = (pressure / self.density).sqrt();
        let damping = impact_damping(self, PACKING_RESTITUTION, speed, mean_diameter);
        Some(Arc::new(Self {
            normal_damping: damping.max(self.normal_damping),
            tangential_damping: (0.5 * damping).max(self.tangential_damping),
            ..*self
        }))
    }

    /// 2.9433 (5m*/(4k_n √R*))^(2/5) v^(-1/5).
    fn collision_time(&self, radius: f64, speed: f64) -> Option<f64> {
        let mass = 0.5 * self.density * Three::volume(radius);
        let reduced = 0.5 * radius;
        let k_n = Spheres::normal_stiffness(self);
        let deepest = two_fifths(1.25 * mass * speed * speed / (k_n * reduced.sqrt()));
        // 2 ∫ dx/√(1 - x^(5/2)) from 0 to 1.
        Some(2.943_275_194_3 * deepest / speed)
    }

    fn contact_modulus(&self) -> Option<f64> {
        Some(0.75 * Spheres::normal_stiffness(self))
    }

    fn default_of(&self, key: &Key) -> Option<f64> {
        match key.path {
            path if path == TANGENTIAL_DAMPING.path => Some(self.tangential_damping),
            path if path == AGEING.path => Some(self.ageing.map_or(0.0, |ageing| ageing.growth)),
            _ => None,
        }
    }

    fn derived(&self) -> Vec<(&'static str, f64, &'static str)> {
        let mut derived = self.stiffnesses().to_vec();
        derived.push(("normal damping gamma_n", self.normal_damping, "1/(m s)"));
        derived
    }

    fn spheres(&self, contact: &Contact) -> Option<Box<dyn PairForce<Three>>> {
        let smooth = Hertz::<false>::new(self, contact);
        Some(if self.remembers_force {
            between_spheres(self, contact, Rescaled::new(smooth), smooth)
        } else if let Some(ageing) = &self.ageing {
            let friction = Aged::new(contact.friction, ageing);
            let rough = Hertz::<true, Viscoelastic, Aged>::with(self, contact, friction);
            between_spheres(self, contact, rough, smooth)
        } else {
            let rough = Hertz::<true>::new(self, contact);
            between_spheres(self, contact, rough, smooth)
        })
    }
}

/// The γ_n (1/(m s)) for which two equal spheres of this diameter (m) that collide at this speed
/// (m/s) have this restitution.
///
/// With δ = vT x, t = T s and T^(5/2) = m*/(k_n √(R* v)), the impact is x'' = -max(0, √x (x + β
/// x')) with β = γ_n √(R* v T) T.
pub(crate) fn impact_damping(
    spheres: &Spheres,
    restitution: f64,
    speed: f64,
    diameter: f64,
) -> f64 {
    let radius = 0.25 * diameter;
    let mass = 0.5 * spheres.density * Three::volume(0.5 * diameter);
    let time = two_fifths(mass / (spheres.normal_stiffness() * (radius * speed).sqrt()));
    let (mut low, mut high) = (0.0, 20.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if restitution_of(middle) > restitution {
            low = middle;
        } else {
            high = middle;
        }
    }
    low / ((radius * speed * time).sqrt() * time)
}

/// The restitution of spheres while they are packed, unless theirs is lower.
pub(super) const PACKING_RESTITUTION: f64 = 0.3;

/// x^(2/5) of a positive number.
fn two_fifths(x: f64) -> f64 {
    let exponent = 0.4 * portable_ln(x);
    if exponent > 0.0 {
        1.0 / portable_exp(-exponent)
    } else {
        portable_exp(exponent)
    }
}

/// The restitution of the dimensionless impact of [`impact_damping`].
fn restitution_of(beta: f64) -> f64 {
    impact(|x, v| x.sqrt() * (x + beta * v))
}

/// The speed at which the impact x'' = -max(0, `force`(x, x')) of unit speed ends, x ≥ 0, by the
/// Runge–Kutta method of fourth order.
pub(super) fn impact(force: impl Fn(f64, f64) -> f64) -> f64 {
    let force = |x: f64, v: f64| -force(x.max(0.0), v).max(0.0);
    let (mut x, mut v) = (0.0, 1.0);
    // The contact lasts about 3.2 without damping, and longer with it.
    let h = 1e-3;
    for _ in 0..200_000 {
        let (k1, a1) = (v, force(x, v));
        let (k2, a2) = (v + 0.5 * h * a1, force(x + 0.5 * h * k1, v + 0.5 * h * a1));
        let (k3, a3) = (v + 0.5 * h * a2, force(x + 0.5 * h * k2, v + 0.5 * h * a2));
        let (k4, a4) = (v + h * a3, force(x + h * k3, v + h * a3));
        x += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        if x <= 0.0 || (v < 0.0 && force(x, v) == 0.0) {
            break;
        }
    }
    -v
}

/// Largest δ/(R_1+R_2) of two equal spheres; of two unequal spheres the largest δ over the diameter
/// of the smaller one, about that of `lee_hurley`. Hertz' theory fails long before.
pub const LARGEST_OVERLAP: f64 = 0.094;

/// How the dampers of Hertzian contacts depend on the overlap.
pub trait Damper: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// Whether a spring that is set back against the slip stops at μ times the elastic part of F_n:
    /// needed if the damper may be stronger than any spring.
    const BOUNDS_SPRING: bool = false;

    /// The damping of a pair, from the law's constant and m* (kg).
    fn of_pair<L: Lanes>(token: L::Token, constant: L, reduced_mass: L) -> L;

    /// The normal damper over √(δR*) (kg/(m s)), from the damping of the pair and √(δR*) (m).
    fn per_root<L: Lanes>(token: L::Token, of_pair: L, root: L) -> L;
}

/// A damper √(δR*) m*γ_n.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viscoelastic;

impl Damper for Viscoelastic {
    #[inline(always)]
    fn of_pair<L: Lanes>(_: L::Token, constant: L, reduced_mass: L) -> L {
        constant * reduced_mass
    }

    #[inline(always)]
    fn per_root<L: Lanes>(_: L::Token, of_pair: L, _: L) -> L {
        of_pair
    }
}

/// Constants of the law, the same for all contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hertz<const FRICTION: bool, D = Viscoelastic, F = Coulomb> {
    /// k_n and k_t (Pa).
    normal_stiffness: f64,
    tangential_stiffness: f64,
    /// The constant of the normal damper: γ_n (1/(m s)) of a viscoelastic one.
    damping: f64,
    /// γ_t/γ_n.
    tangential_damping: f64,
    /// (4/3)πρ (kg/m³) of i and j.
    densities: [f64; 2],
    /// μ.
    friction: F,
    damper: PhantomData<D>,
}

impl<const FRICTION: bool> Hertz<FRICTION> {
    /// The law between these spheres.
    pub fn new(spheres: &Spheres, contact: &Contact) -> Self {
        Self::with(spheres, contact, Coulomb(contact.friction))
    }
}

impl<const FRICTION: bool, F: Friction> Hertz<FRICTION, Viscoelastic, F> {
    /// The law between these spheres with this friction.
    fn with(spheres: &Spheres, contact: &Contact, friction: F) -> Self {
        let tangential = spheres.tangential_damping / spheres.normal_damping.max(f64::MIN_POSITIVE);
        let dampers = [spheres.normal_damping, tangential];
        Self::damped(spheres, contact, dampers, friction)
    }
}

impl<const FRICTION: bool, D: Damper, F: Friction> Hertz<FRICTION, D, F> {
    /// The law with the damper `D`, its constant and the tangential damper over the normal one, and
    /// this friction.
    pub(super) fn damped(
        spheres: &Spheres,
        contact: &Contact,
        [damping, tangential_damping]: [f64; 2],
        friction: F,
    ) -> Self {
        Self {
            normal_stiffness: spheres.normal_stiffness(),
            tangential_stiffness: spheres.tangential_stiffness(),
            damping,
            tangential_damping,
            densities: contact.densities(Three::volume(1.0) * spheres.density),
            friction,
            damper: PhantomData,
        }
    }
}

// Places in the parameters of a pair.
/// R* (m).
const RADIUS: usize = 0;
/// [`Damper::of_pair`]: m*γ_n (kg/(m s)) of a viscoelastic damper.
const DAMPING: usize = 1;

// Indices in `Blocks::carry`: √(δR*), and F_n over it (Pa m).
const ROOT: usize = 0;
const NORMAL: usize = 1;

/// Lower bound of δR* (m²), also for pairs that do not touch.
const NO_AREA: f64 = 1e-290;

impl<const FRICTION: bool, D: Damper, F: Friction> ContactLaw for Hertz<FRICTION, D, F> {
    type Space = Three;
    const PARAMETERS: usize = 2;
    const HISTORY: usize = if FRICTION { 3 + F::HISTORY } else { 0 };
    const HISTORY_PLACES: &'static [usize] = &[0, 1, 2, AGE];
    const AGES: bool = FRICTION && F::HISTORY > 0;
    const HISTORY_UNIT: &'static str = "m";
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = false;
    const CUTS_DAMPERS: bool = true;
    const LARGEST_OVERLAP: f64 = LARGEST_OVERLAP;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        let c = |v| L::splat(token, v);
        let [of_i, of_j] = [c(self.densities[0]), c(self.densities[1])];
        let (m_i, m_j) = (of_i * Three::power(r_i), of_j * Three::power(r_j));
        (r_i * r_j / (r_i + r_j)).store(&mut out[RADIUS]);
        D::of_pair(token, c(self.damping), m_i * m_j / (m_i + m_j)).store(&mut out[DAMPING]);
    }

    fn largest_force(&self, radius: f64) -> f64 {
        let overlap = 2.0 * LARGEST_OVERLAP * radius;
        self.normal_stiffness * overlap * (0.5 * radius * overlap).sqrt()
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let c = |v| L::splat(token, v);
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let zero = c(0.0);
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let pairs = parameters.zip(blocks.motion).zip(&mut *blocks.carry);
        for (((p, motion), carry), response) in pairs.zip(&mut *blocks.response) {
            let (overlap, v_n) = (load(&motion.overlap), load(&motion.normal_velocity));
            let square = (overlap * load(&p[RADIUS])).max(c(NO_AREA));
            let root = square * inverse_sqrt(token, square);
            root.store(&mut carry[ROOT]);
            let elastic = c(self.normal_stiffness) * overlap;
            let damping = D::per_root(token, load(&p[DAMPING]), root);
            let per_root = (elastic - damping * v_n).max(zero);
            per_root.store(&mut carry[NORMAL]);
            let normal = root * per_root;
            normal.store(&mut response.normal);
            if BUDGET {
                let power = root.mul_add(elastic, -normal) * v_n;
                let power = power.select(overlap.greater(zero), zero);
                power.store(&mut response.dissipated[dissipation::DAMPING]);
            }
        }
        if FRICTION {
            self.tangential_force::<L, BUDGET>(token, blocks);
        }
    }

    /// Normal: the integral of √R* k_n δ^(3/2), (2/5) √R* k_n δ^(5/2). Tangential: ½ k_t √(δR*) u².
    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3] {
        let c = |v| L::splat(token, v);
        let root = (overlap.max(c(0.0)) * L::load(token, &parameters[RADIUS])).sqrt();
        let normal = c(0.4 * self.normal_stiffness) * root * overlap * overlap;
        let mut tangential = c(0.0);
        if FRICTION {
            let u = vector(token, history, 3);
            tangential = c(0.5 * self.tangential_stiffness) * root * Three::dot(&u, &u);
        }
        [normal, tangential, c(0.0)]
    }
}

/// Spring and damper over a step in which contacts slide, over √(δR*).
struct SlidingStep<L: Lanes> {
    /// What they would be at its end without a limit.
    trial: Vector<L>,
    /// The damper's constant, over √(δR*).
    gamma_t: L,
    /// v_t(t + ½Δt) Δt (m).
    slip: Vector<L>,
    /// v_t at the end (m/s).
    velocity: Vector<L>,
    limit: L,
    /// μ.
    friction: L,
    /// δ (m).
    overlap: L,
    /// Contacts at the limit before the step.
    slid: L::Mask,
    /// Contacts at the limit at its end.
    sliding: L::Mask,
}

impl<const FRICTION: bool, D: Damper, F: Friction> Hertz<FRICTION, D, F> {
    /// Spring and damper over √(δR*), set back to their limit, and the spring's u. At the beginning
    /// of the step v_t was 2 v_t(t + ½Δt) - v_t, to second order.
    #[inline(always)]
    fn set_back<L: Lanes>(
        &self,
        token: L::Token,
        per_step: f64,
        step: &SlidingStep<L>,
    ) -> [Vector<L>; 2] {
        let c = |v| L::splat(token, v);
        let SlidingStep {
            trial,
            gamma_t,
            slip,
            velocity: v_t,
            limit,
            ..
        } = step;
        let (gamma_t, limit) = (*gamma_t, *limit);
        let per_slip = gamma_t.mul_add(c(-2.0 * per_step), c(self.tangential_stiffness));
        let moves = c(if per_step > 0.0 { 2.0 } else { 0.0 });
        let per_velocity = moves * gamma_t;
        let mut earlier = *trial;
        for k in 0..3 {
            earlier[k] = trial[k] - per_slip.mul_add(slip[k], per_velocity * v_t[k]);
        }
        let mut force = set_back(token, &earlier, trial, limit, step.slid, step.sliding);
        let compliance = c(1.0 / self.tangential_stiffness);
        let mut spring = scaled(&scaled_sum(-gamma_t, v_t, &force), compliance);
        if D::BOUNDS_SPRING {
            let (speed, per_speed) = norm(token, v_t);
            let bound = step.friction * c(self.normal_stiffness) * step.overlap;
            let exceeds = (gamma_t * speed).greater(limit + bound);
            let damped = exceeds.and(step.sliding);
            let back = -(bound * compliance);
            for k in 0..3 {
                let along = v_t[k] * per_speed;
                force[k] = (limit * along).select(damped, force[k]);
                spring[k] = (back * along).select(damped, spring[k]);
            }
        }
        [force, spring]
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
        let k_t = c(self.tangential_stiffness);
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let kept = parameters.zip(blocks.history.chunks_exact_mut(3 + F::HISTORY));
        let pairs = kept.zip(blocks.motion).zip(&*blocks.carry);
        for ((((p, history), motion), carry), response) in pairs.zip(&mut *blocks.response) {
            let touching = load(&motion.overlap).greater(zero);
            let (history, age) = history.split_at_mut(3);
            let root = load(&carry[ROOT]);
            let before = vector(token, history, 3);
            let slip = vector(token, &motion.tangential_increment, 3);
            let v_t = vector(token, &motion.tangential_velocity, 3);
            let u = sum(&before, &slip);
            let damping = D::per_root(token, load(&p[DAMPING]), root);
            let gamma_t = c(self.tangential_damping) * damping;
            // Spring and damper over √(δR*).
            let mut force = scaled_sum(k_t, &u, &scaled(&v_t, gamma_t));
            let normal = load(&carry[NORMAL]);
            let mut friction = self
                .friction
                .of_stuck(token, age, touching, blocks.per_step);
            let mut limit = friction * normal;
            let slid = L::mask(token, response.sliding);
            let sliding = exceeds(&force, limit).and(touching);
            let mut spring = u;
            if sliding.bits() != 0 {
                let slip_of_step = SlipOfStep {
                    way: slip,
                    components: 3,
                    sliding,
                    per_step: blocks.per_step,
                };
                friction = self
                    .friction
                    .of_sliding(token, age, &slip_of_step, friction);
                limit = friction * normal;
                let step = SlidingStep {
                    trial: force,
                    gamma_t,
                    slip,
                    velocity: v_t,
                    limit,
                    friction,
                    overlap: load(&motion.overlap),
                    slid,
                    sliding,
                };
                let cut;
                [force, cut] = self.set_back(token, blocks.per_step, &step);
                for k in 0..3 {
                    spring[k] = cut[k].select(sliding, u[k]);
                }
            }
            response.sliding = sliding.bits();
            for k in 0..3 {
                (-(root * force[k])).store(&mut response.tangential[k]);
                spring[k].select(touching, zero).store(&mut history[k]);
            }
            if BUDGET {
                let after = vector(token, history, 3);
                let earlier = load(&motion.overlap) + load(&motion.normal_increment);
                let root_before = (earlier.max(zero) * load(&p[RADIUS])).sqrt();
                let root = root.select(touching, zero);
                let half_k = c(0.5 * self.tangential_stiffness);
                let work = half_k
                    * (root_before * Three::dot(&before, &slip) + root * Three::dot(&after, &slip));
                let gained = half_k
                    * (root * Three::dot(&after, &after)
                        - root_before * Three::dot(&before, &before));
                let stiffness = half_k * (root_before - root) * Three::dot(&before, &after);
                let viscous = if D::BOUNDS_SPRING {
                    scaled_sum(-k_t, &spring, &force)
                } else {
                    scaled(&v_t, gamma_t)
                };
                let square = Three::dot(&force, &force);
                let v_before = velocity_before(token, blocks.per_step, &slip, &v_t);
                let damper_before = scaled(&v_before, gamma_t);
                let force_before = scaled_sum(k_t, &before, &damper_before);
                let reaches = reaches(token, sliding, square, limit);
                let damper = CutDamper {
                    power: (root * Three::dot(&viscous, &v_t)).select(touching, zero),
                    before: LimitedSpring {
                        energy: half_k * root_before * Three::dot(&before, &before),
                        beyond: Three::dot(&damper_before, &damper_before)
                            - Three::dot(&force_before, &force_before),
                        at_limit: slid.and(touching),
                    },
                    after: LimitedSpring {
                        energy: half_k * root * Three::dot(&after, &after),
                        beyond: Three::dot(&viscous, &viscous) - square,
                        at_limit: reaches.and(touching),
                    },
                };
                let is_set_back = damper.after.is_set_back(token);
                let is_spring = L::mask(token, touching.bits() & !is_set_back.bits());
                let stiffness = stiffness.select(is_spring, zero);
                stiffness.store(&mut response.dissipated[dissipation::STIFFNESS]);
                parts::FRICTION.clear(response);
                (work - gained - stiffness).store(&mut response.dissipated[dissipation::FRICTION]);
                damper.count(token, response, &parts::FRICTION);
            }
        }
    }
}

/// At constant u, F_t = -√(δR*) k_t u grows with √δ; at the limit F_t = -μF_n u/|u|.
impl<const FRICTION: bool, D: Damper, F: Friction> Stiffness for Hertz<FRICTION, D, F> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let (overlap, [r_i, r_j]) = (state.overlap, state.radii);
        let root = (overlap * r_i * r_j / (r_i + r_j)).sqrt();
        let d = Derivatives {
            normal: self.normal_stiffness * root * overlap,
            normal_slope: 1.5 * self.normal_stiffness * root,
            ..Derivatives::default()
        };
        if !FRICTION {
            return d;
        }
        let k_t = self.tangential_stiffness * root;
        let trial = state.history.map(|u| -k_t * u);
        let [slides, ..] = state.limits;
        let friction = self.friction.at_age(state.age);
        let mut tangential = d.friction(trial, k_t, friction, slides);
        if !tangential.at_limit {
            tangential.slope = tangential.value.map(|f| 0.5 * f / overlap);
        }
        Derivatives { tangential, ..d }
    }

    fn dampers(&self, state: &SpringState) -> Derivatives {
        let springs = self.derivatives(state);
        let (k_t, gamma_n) = self.spring_and_damper(state);
        let mut d = Derivatives {
            normal_slope: gamma_n,
            ..Derivatives::default()
        };
        if FRICTION {
            let friction = self.friction.at_age(state.age).value;
            d.tangential = self
                .tangential_damper(&d, friction)
                .derivatives(&springs.tangential, k_t);
        }
        d
    }
}

impl<const FRICTION: bool, D: Damper, F: Friction> Hertz<FRICTION, D, F> {
    /// The stiffness of the tangential spring (N/m) and the normal damper (kg/s) of a contact.
    fn spring_and_damper(&self, state: &SpringState) -> (f64, f64) {
        let parameters = parameters_of(self, state.radii);
        let root = (state.overlap * parameters[RADIUS]).sqrt();
        let per_root = scalar(|token| {
            let of_pair = Portable::splat(token, parameters[DAMPING]);
            D::per_root(token, of_pair, Portable::splat(token, root))
        });
        (self.tangential_stiffness * root, per_root * root)
    }

    /// The tangential damper beside a normal one, under this friction.
    fn tangential_damper(&self, normal: &Derivatives, friction: f64) -> ParallelDamper {
        ParallelDamper {
            cut: self.tangential_damping * normal.normal_slope,
            beside: 0.0,
            of_limit: friction * normal.normal_slope,
        }
    }
}

/// The law whose contacts remember the force of their tangential spring, not its displacement:
/// `tangential_history = "force"`, of [`super::tsuji`], too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rescaled<D: Damper> {
    normal: Hertz<false, D>,
}

impl<D: Damper> Rescaled<D> {
    /// The law with this F_n and the constants of its F_t.
    pub(super) fn new(normal: Hertz<false, D>) -> Self {
        Self { normal }
    }

    /// √(δR*) (m), of pairs that do not touch its lower bound.
    #[inline(always)]
    fn root<L: Lanes>(token: L::Token, overlap: L, radius: L) -> L {
        let square = (overlap * radius).max(L::splat(token, NO_AREA));
        square * inverse_sqrt(token, square)
    }
}

impl<D: Damper> ContactLaw for Rescaled<D> {
    type Space = Three;
    const PARAMETERS: usize = Hertz::<false, D>::PARAMETERS;
    const HISTORY: usize = 3;
    const FRICTION: bool = true;
    const ROLLING: bool = false;
    const CUTS_DAMPERS: bool = true;
    const NEEDS_LAST_OVERLAP: bool = true;
    const LARGEST_OVERLAP: f64 = Hertz::<false, D>::LARGEST_OVERLAP;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        self.normal.parameters(token, r_i, r_j, out);
    }

    fn largest_force(&self, radius: f64) -> f64 {
        self.normal.largest_force(radius)
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        self.normal.evaluate::<L, BUDGET>(token, blocks);
        let c = |v| L::splat(token, v);
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let (zero, one, half) = (c(0.0), c(1.0), c(0.5));
        let law = &self.normal;
        let k_t = c(law.tangential_stiffness);
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let kept = parameters.zip(blocks.history.chunks_exact_mut(3));
        let pairs = kept.zip(blocks.motion).zip(&*blocks.carry);
        for ((((p, history), motion), carry), response) in pairs.zip(&mut *blocks.response) {
            let overlap = load(&motion.overlap);
            let touching = overlap.greater(zero);
            let root = load(&carry[ROOT]);
            let last_overlap = overlap + load(&motion.normal_increment);
            let last_root = Self::root(token, last_overlap, load(&p[RADIUS]));
            let shrinks = last_root.greater(root);
            let rescaled = (root * inverse(token, last_root)).select(shrinks, one);
            // The mean of √δ over a step in which δ grows evenly, also from nothing.
            let sum = root + last_root;
            let squares = root.mul_add(root, last_root * sum);
            let mean = c(2.0 / 3.0) * squares * inverse(token, sum);
            let stiffness = k_t * root.select(shrinks, mean);
            let before = vector(token, history, 3);
            let slip = vector(token, &motion.tangential_increment, 3);
            let v_t = vector(token, &motion.tangential_velocity, 3);
            let damping = D::per_root(token, load(&p[DAMPING]), root);
            let gamma_t = c(law.tangential_damping) * damping * root;
            let kept = scaled(&before, rescaled);
            let elastic = scaled_sum(-stiffness, &slip, &kept);
            let viscous = scaled(&v_t, gamma_t);
            let v_before = velocity_before(token, blocks.per_step, &slip, &v_t);
            let viscous_before = scaled(&v_before, gamma_t);
            let spring = SpringAndDamper {
                components: 3,
                before: kept,
                force_before: difference(&kept, &viscous_before),
                elastic,
                viscous,
                force: difference(&elastic, &viscous),
                was_at_limit: L::mask(token, response.sliding),
                touching,
            };
            let limit = c(law.friction.0) * load(&response.normal);
            let mut slid = spring.slide_together(token, limit);
            if D::BOUNDS_SPRING && slid.at_limit.bits() != 0 {
                let (speed, per_speed) = norm(token, &v_t);
                let bound = c(law.friction.0 * law.normal_stiffness) * overlap * root;
                let exceeds = (gamma_t * speed).greater(limit + bound);
                let damped = exceeds.and(slid.at_limit);
                for (k, v) in v_t.iter().enumerate() {
                    let along = *v * per_speed;
                    slid.force[k] = (-(limit * along)).select(damped, slid.force[k]);
                    slid.elastic[k] = (bound * along).select(damped, slid.elastic[k]);
                }
            }
            response.sliding = slid.at_limit.bits();
            let mut after = slid.elastic;
            for k in 0..3 {
                slid.force[k].store(&mut response.tangential[k]);
                after[k] = after[k].select(touching, zero);
                after[k].store(&mut history[k]);
            }
            if BUDGET {
                let half_compliance = half * c(1.0 / law.tangential_stiffness);
                let per_root = inverse(token, root);
                let energy = half_compliance * per_root * Three::dot(&after, &after);
                let stored = half_compliance * inverse(token, last_root);
                let stored = stored * Three::dot(&before, &before);
                let stored = stored.select(last_overlap.greater(zero), zero);
                let (mut work, mut lengths) = (zero, zero);
                for k in 0..3 {
                    work = (half * (before[k] + after[k])).mul_add(-slip[k], work);
                    let mean = half * (kept[k] + after[k]);
                    lengths = mean.mul_add(elastic[k] - after[k], lengths);
                }
                let lost = work - (energy - stored);
                let viscous = difference(&slid.elastic, &slid.force);
                let force_before = difference(&before, &viscous_before);
                let square = Three::dot(&slid.force, &slid.force);
                let damper = CutDamper {
                    power: Three::dot(&viscous, &v_t).select(touching, zero),
                    before: LimitedSpring {
                        energy: stored,
                        beyond: Three::dot(&viscous_before, &viscous_before)
                            - Three::dot(&force_before, &force_before),
                        at_limit: spring.was_at_limit.and(touching),
                    },
                    after: LimitedSpring {
                        energy,
                        beyond: Three::dot(&viscous, &viscous) - square,
                        at_limit: reaches(token, slid.at_limit, square, limit).and(touching),
                    },
                };
                // A contact that opens has slid until F was 0.
                let friction = (lengths * inverse(token, stiffness)).select(slid.at_limit, zero);
                let is_set_back = damper.after.is_set_back(token);
                let is_spring = L::mask(token, touching.bits() & !is_set_back.bits());
                let friction = friction.select(is_spring, lost);
                parts::FRICTION.clear(response);
                friction.store(&mut response.dissipated[dissipation::FRICTION]);
                (lost - friction).store(&mut response.dissipated[dissipation::STIFFNESS]);
                damper.count(token, response, &parts::FRICTION);
            }
        }
    }

    /// Normal as `hertz`. Tangential: ½ F²/(k_t √(δR*)).
    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3] {
        let [normal, _, rolling] = self
            .normal
            .elastic_energies(token, parameters, overlap, history);
        let root = Self::root(token, overlap, L::load(token, &parameters[RADIUS]));
        let half_compliance = L::splat(token, 0.5 / self.normal.tangential_stiffness);
        let force = vector(token, history, 3);
        let tangential = half_compliance * inverse(token, root) * Three::dot(&force, &force);
        [normal, tangential, rolling]
    }
}

/// F_t below the limit does not depend on δ while that grows.
impl<D: Damper> Stiffness for Rescaled<D> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let d = self.normal.derivatives(state);
        let (overlap, [r_i, r_j]) = (state.overlap, state.radii);
        let root = (overlap * r_i * r_j / (r_i + r_j)).sqrt();
        let k_t = self.normal.tangential_stiffness * root;
        let limit = d.limit(self.normal.friction.0);
        let [slides, ..] = state.limits;
        Derivatives {
            tangential: SpringForce::new(state.history, k_t, limit, slides),
            ..d
        }
    }

    fn dampers(&self, state: &SpringState) -> Derivatives {
        let springs = self.derivatives(state);
        let (k_t, _) = self.normal.spring_and_damper(state);
        let d = self.normal.dampers(state);
        let damper = self.normal.tangential_damper(&d, self.normal.friction.0);
        Derivatives {
            tangential: damper.derivatives(&springs.tangential, k_t),
            ..d
        }
    }
}
