//! Linear springs in 2D and 3D: Hooke with linear damping, Coulomb friction and rolling resistance.
//!
//! The law of LAMMPS' `gran/hooke/history` and LIGGGHTS' `hooke`, with F_n ≥ 0 and the damping
//! ratio of `lee_hurley`. Normal:
//!
//! ```text
//! F_n = max(0, k_n δ - γ_n v_n),  γ_n = 2α√(k_n m*)
//! ```
//!
//! Tangential: the history is the elastic force on i, in the tangent plane,
//!
//! ```text
//! F_t^e ← F_t^e - k_t v_t(t+½Δt) Δt
//! ```
//!
//! beside the damper -γ_t v_t, γ_t = 2α√(k_t m*). With s = `sliding_damping`, by default 0,
//!
//! ```text
//! |F_t^e - (1-s) γ_t v_t| ≤ μ_s F_n,   F_t = F_t^e - γ_t v_t
//! ```
//!
//! Beyond this limit the sum on the left is cut to it, F_t^e is set back so that spring and damper
//! together give the limit, as in LAMMPS, and -s γ_t v_t acts beside it, without a jump of F_t.
//! LIGGGHTS cuts the spring alone, and drops the damper with a jump while it is cut. With `ageing`
//! μ_s grows with the age of the contact (below).
//!
//! Rolling, in 2D, as in LIGGGHTS' `epsd2` (Ai et al. 2011, type C, with the stiffness of Iwashita
//! and Oda):
//!
//! ```text
//! M^k ← M^k - k_r Δθ_r,  k_r = k_t R_r²,  R_r = R_i R_j/(R_i+R_j)
//! ```
//!
//! beside the damper -C_r (ω_i-ω_j) (`rolling`), the two cut to μ_r R_r F_n together; `epsd2` has
//! no damper, as here with η_r = 0.

use std::marker::PhantomData;
use std::sync::Arc;

use super::ageing::{Aged, Ageing, read_ageing};
use super::damping::{of_ratio, read_ratio, read_sliding};
use super::keys::{
    AGEING, AGEING_SLIP, AGEING_TIME, DAMPING_RATIO, DENSITY, Key, KeyReader, NORMAL_STIFFNESS,
    RESTITUTION, SLIDING_DAMPING, TANGENTIAL_STIFFNESS,
};
use super::rolling::{self, Rolling, rolling_force};
use super::rolling_spheres::between_spheres;
use super::{Constants, Contact, LawKind, Rigidity};
use crate::contact::friction::{Coulomb, Friction, SlipOfStep};
use crate::contact::parts::{self, NormalSpring, SpringAndDamper, SpringWork, add_damping};
use crate::contact::stiffness::{Derivatives, ParallelDamper, SpringState, Stiffness};
use crate::contact::{
    AGE, Blocks, ContactLaw, difference, dissipation, parameters_of, scaled, vector,
    velocity_before,
};
use crate::dimension::{Dimension, Dimensions, Three, Two, scaled_sum};
use crate::kernel::PairForce;
use crate::simd::{Lanes, Lanes16, Mask};
use crate::state::Masses;

/// The law as scenes name it.
pub const KIND: LawKind = LawKind {
    name: "hooke",
    summary: "linear springs k_n and k_t with linear damping, Coulomb friction and, in 2D, rolling \
              resistance with k_r = k_t R_r² (LIGGGHTS `epsd2`)",
    dimensions: &[Dimensions::Two, Dimensions::Three],
    rolling: true,
    keys: &[
        &DENSITY,
        &NORMAL_STIFFNESS,
        &TANGENTIAL_STIFFNESS,
        &DAMPING_RATIO,
        &RESTITUTION,
        &SLIDING_DAMPING,
        &AGEING,
        &AGEING_TIME,
        &AGEING_SLIP,
    ],
    read: |values| Arc::new(Springs::read(values)),
};

/// Linear springs between grains, and their damping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Springs {
    /// k_n (N/m; per unit depth, Pa, in 2D).
    pub normal_stiffness: f64,
    /// k_t (N/m; per unit depth, Pa, in 2D).
    pub tangential_stiffness: f64,
    /// ρ (kg/m³).
    pub density: f64,
    /// α, normal and tangential.
    pub damping_ratio: f64,
    /// s, the share of the tangential damper that acts on sliding contacts.
    pub sliding_damping: f64,
    /// How friction grows with the age of a contact.
    pub ageing: Option<Ageing>,
}

impl Springs {
    fn read(values: &mut dyn KeyReader) -> Self {
        let [normal_stiffness, tangential_stiffness] =
            read_stiffnesses(values, &NORMAL_STIFFNESS, &TANGENTIAL_STIFFNESS);
        Self {
            normal_stiffness,
            tangential_stiffness,
            density: values.required(&DENSITY),
            damping_ratio: read_ratio(values),
            sliding_damping: read_sliding(values),
            ageing: read_ageing(values),
        }
    }

    /// The law between disks with friction.
    fn rough_disks<const ROLLING: bool>(&self, contact: &Contact) -> Box<dyn PairForce<Two>> {
        if let Some(ageing) = &self.ageing {
            let friction = Aged::new(contact.friction, ageing);
            Box::new(Hooke::<Two, true, ROLLING, Aged>::with(
                self, contact, friction,
            ))
        } else {
            Box::new(Hooke::<Two, true, ROLLING>::new(self, contact))
        }
    }
}

/// Reads k_n and k_t; k_t is at most k_n, and 2/7 of it by default.
pub(super) fn read_stiffnesses(
    values: &mut dyn KeyReader,
    normal: &Key,
    tangential: &Key,
) -> [f64; 2] {
    let k_n = values.required(normal);
    let k_t = values.number(tangential);
    if let Some(k_t) = k_t.filter(|&k_t| k_t > k_n) {
        values.refuse(
            tangential,
            &format!(
                "must lie in (0, normal_stiffness = {}], found {}",
                show(k_n),
                show(k_t)
            ),
        );
    }
    [k_n, k_t.unwrap_or(2.0 / 7.0 * k_n)]
}

/// The shortest decimal that reads back to the same bits, with an exponent from 1e7 on.
fn show(x: f64) -> String {
    if x.is_finite() && x.abs() >= 1e7 {
        format!("{x:e}")
    } else {
        format!("{x:?}")
    }
}

impl Constants for Springs {
    fn masses(&self) -> Masses {
        Masses::Density(self.density)
    }

    fn normal_stiffness(&self, _: f64, _: f64, _: f64) -> f64 {
        self.normal_stiffness
    }

    fn largest_overlap(&self, r1: f64, r2: f64) -> f64 {
        2.0 * LARGEST_OVERLAP * r1.min(r2)
    }

    fn rigidity(&self, secant: f64, mass: f64, tangential: bool) -> Rigidity {
        let k_t = self.tangential_stiffness;
        let tangential = if tangential { k_t } else { 0.0 };
        Rigidity {
            normal: secant,
            tangential,
            rolling: k_t / 4.0,
            damping: of_ratio(self.damping_ratio, mass, [secant, tangential]),
        }
    }

    fn default_of(&self, key: &Key) -> Option<f64> {
        match key.path {
            path if path == TANGENTIAL_STIFFNESS.path => Some(self.tangential_stiffness),
            path if path == SLIDING_DAMPING.path => Some(self.sliding_damping),
            path if path == AGEING.path => Some(self.ageing.map_or(0.0, |ageing| ageing.growth)),
            _ => None,
        }
    }

    fn derived(&self) -> Vec<(&'static str, f64, &'static str)> {
        vec![("damping ratio alpha", self.damping_ratio, "")]
    }

    fn disks(&self, contact: &Contact) -> Option<Box<dyn PairForce<Two>>> {
        Some(
            match (contact.friction > 0.0, contact.rolling_friction > 0.0) {
                (false, false) => Box::new(Hooke::<Two, false, false>::new(self, contact)),
                (false, true) => Box::new(Hooke::<Two, false, true>::new(self, contact)),
                (true, false) => self.rough_disks::<false>(contact),
                (true, true) => self.rough_disks::<true>(contact),
            },
        )
    }

    fn spheres(&self, contact: &Contact) -> Option<Box<dyn PairForce<Three>>> {
        let smooth = Hooke::<Three, false, false>::new(self, contact);
        Some(match &self.ageing {
            Some(ageing) => {
                let friction = Aged::new(contact.friction, ageing);
                let rough = Hooke::<Three, true, false, Aged>::with(self, contact, friction);
                between_spheres(self, contact, rough, smooth)
            }
            None => {
                let rough = Hooke::<Three, true, false>::new(self, contact);
                between_spheres(self, contact, rough, smooth)
            }
        })
    }

    /// k_t.
    fn rolling_stiffness(&self) -> Option<f64> {
        Some(self.tangential_stiffness)
    }
}

/// Largest δ over the diameter of the smaller grain. Linear springs have no bound; geometry has:
/// beyond it the centre of the smaller grain is within the other grain, or below a flat wall.
pub const LARGEST_OVERLAP: f64 = 0.5;

/// Constants of the law, the same for all contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hooke<D, const FRICTION: bool, const ROLLING: bool, F = Coulomb> {
    /// k_n, k_t (N/m; per unit depth, Pa, in 2D).
    normal_stiffness: f64,
    tangential_stiffness: f64,
    /// γ_t/γ_n = √(k_t/k_n).
    tangential_damping: f64,
    /// Mass per squared radius, ρπ, in 2D, and per cubed radius, (4/3)ρπ, in 3D (kg/m³), of i and
    /// j.
    densities: [f64; 2],
    /// α.
    damping_ratio: f64,
    /// The share of the tangential damper that acts on sliding contacts.
    sliding_damping: f64,
    /// μ_s.
    friction: F,
    rolling: Rolling,
    space: PhantomData<D>,
}

impl<D: Dimension, const FRICTION: bool, const ROLLING: bool> Hooke<D, FRICTION, ROLLING> {
    /// The law between grains with these springs.
    pub fn new(springs: &Springs, contact: &Contact) -> Self {
        Self::with(springs, contact, Coulomb(contact.friction))
    }
}

impl<D: Dimension, const FRICTION: bool, const ROLLING: bool, F: Friction>
    Hooke<D, FRICTION, ROLLING, F>
{
    /// The same with this friction.
    fn with(springs: &Springs, contact: &Contact, friction: F) -> Self {
        Self {
            normal_stiffness: springs.normal_stiffness,
            tangential_stiffness: springs.tangential_stiffness,
            tangential_damping: (springs.tangential_stiffness / springs.normal_stiffness).sqrt(),
            densities: contact.densities(D::volume(1.0) * springs.density),
            damping_ratio: springs.damping_ratio,
            sliding_damping: springs.sliding_damping,
            friction,
            rolling: Rolling::new(springs, contact),
            space: PhantomData,
        }
    }
}

// Places in the parameters of a pair.
/// γ_n (kg/(m s)).
const DAMPING: usize = 0;
/// Rows of the law without rolling.
const PLAIN: usize = 1;

impl<D: Dimension, const FRICTION: bool, const ROLLING: bool, F: Friction> ContactLaw
    for Hooke<D, FRICTION, ROLLING, F>
{
    type Space = D;
    const PARAMETERS: usize = PLAIN + if ROLLING { rolling::PARAMETERS } else { 0 };
    const HISTORY: usize = if FRICTION { D::SPINS + F::HISTORY } else { 0 } + ROLLING as usize;
    // In two dimensions the second place is for the last k_t, which this law does not need.
    const HISTORY_PLACES: &'static [usize] = match (D::SPINS, FRICTION, Self::AGES) {
        (3, _, _) => &[0, 1, 2, AGE],
        (_, true, true) => &[0, AGE, 2],
        (_, true, false) => &[0, 2],
        (_, false, _) => &[2],
    };
    const AGES: bool = FRICTION && F::HISTORY > 0;
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = ROLLING;
    const CUTS_DAMPERS: bool = true;
    // F_n begins with its damper.
    const LIMITS_JUMP: bool = true;
    const LARGEST_OVERLAP: f64 = LARGEST_OVERLAP;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        let c = |v| L::splat(token, v);
        let [of_i, of_j] = [c(self.densities[0]), c(self.densities[1])];
        let (m_i, m_j) = (of_i * D::power(r_i), of_j * D::power(r_j));
        let reduced_mass = m_i * m_j / (m_i + m_j);
        (c(2.0 * self.damping_ratio) * (c(self.normal_stiffness) * reduced_mass).sqrt())
            .store(&mut out[DAMPING]);
        if ROLLING {
            self.rolling.parameters(token, r_i, r_j, &mut out[PLAIN..]);
        }
    }

    fn largest_force(&self, radius: f64) -> f64 {
        2.0 * LARGEST_OVERLAP * radius * self.normal_stiffness
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
        let normal = c(0.5 * self.normal_stiffness) * overlap * overlap;
        let (mut tangential, mut rolling) = (c(0.0), c(0.0));
        if FRICTION {
            for lanes in &history[..D::SPINS] {
                let force = load(lanes);
                tangential =
                    (c(0.5 / self.tangential_stiffness) * force).mul_add(force, tangential);
            }
        }
        if ROLLING {
            let torque = load(&history[Self::HISTORY - 1]);
            rolling = c(0.5) * torque * torque / load(&parameters[PLAIN]);
        }
        [normal, tangential, rolling]
    }
}

impl<D: Dimension, const FRICTION: bool, const ROLLING: bool, F: Friction>
    Hooke<D, FRICTION, ROLLING, F>
{
    /// Computes F_n.
    #[inline(always)]
    fn normal_force<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let pairs = parameters.zip(blocks.motion);
        for ((p, motion), response) in pairs.zip(&mut *blocks.response) {
            let spring = NormalSpring {
                stiffness: L::splat(token, self.normal_stiffness),
                damping: L::load(token, &p[DAMPING]),
                overlap: L::load(token, &motion.overlap),
                velocity: L::load(token, &motion.normal_velocity),
            };
            let normal = spring.force(token);
            normal.store(&mut response.normal);
            if BUDGET {
                let power = spring.dissipated_power(token, normal);
                power.store(&mut response.dissipated[dissipation::DAMPING]);
                response.dissipated[dissipation::STIFFNESS] = Lanes16::ZERO;
            }
        }
    }

    /// Computes F_t.
    #[inline(always)]
    fn tangential_force<L: Lanes, const BUDGET: bool>(
        &self,
        token: L::Token,
        blocks: &mut Blocks<'_>,
    ) {
        let zero = L::splat(token, 0.0);
        let k_t = L::splat(token, self.tangential_stiffness);
        let damping_ratio = L::splat(token, self.tangential_damping);
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let kept = parameters.zip(blocks.history.chunks_exact_mut(Self::HISTORY));
        let pairs = kept.zip(blocks.motion);
        for (((p, history), motion), response) in pairs.zip(&mut *blocks.response) {
            let components = D::SPINS;
            let touching = L::load(token, &motion.overlap).greater(zero);
            let slip = vector(token, &motion.tangential_increment, components);
            let v_t = vector(token, &motion.tangential_velocity, components);
            let gamma_t = damping_ratio * L::load(token, &p[DAMPING]);
            // The part of the damper that is cut with the spring, and the part beside the slider.
            let cut = L::splat(token, 1.0 - self.sliding_damping) * gamma_t;
            let beside = L::splat(token, self.sliding_damping) * gamma_t;
            let normal = L::load(token, &response.normal);
            let before = vector(token, history, components);
            let elastic = scaled_sum(-k_t, &slip, &before);
            let viscous = scaled(&v_t, cut);
            let v_before = velocity_before(token, blocks.per_step, &slip, &v_t);
            let spring = SpringAndDamper {
                components,
                before,
                force_before: difference(&before, &scaled(&v_before, cut)),
                elastic,
                viscous,
                force: difference(&elastic, &viscous),
                was_at_limit: L::mask(token, response.sliding),
                touching,
            };
            let kept = &mut history[components..][..F::HISTORY];
            let mut friction = self
                .friction
                .of_stuck(token, kept, touching, blocks.per_step);
            if Self::AGES {
                let slip = SlipOfStep {
                    way: slip,
                    components,
                    sliding: spring.exceeds(friction * normal),
                    per_step: blocks.per_step,
                };
                friction = self.friction.of_sliding(token, kept, &slip, friction);
            }
            let limit = friction * normal;
            let slid = spring.slide_together(token, limit);
            response.sliding = slid.at_limit.bits();
            for k in 0..components {
                let force = (-beside).mul_add(v_t[k], slid.force[k]);
                force.store(&mut response.tangential[k]);
                let elastic = slid.elastic[k].select(touching, zero);
                elastic.store(&mut history[k]);
            }
            if BUDGET {
                parts::FRICTION.clear(response);
                let mut square = zero;
                for v in &v_t[..components] {
                    square = v.mul_add(*v, square);
                }
                let square = square.select(touching, zero);
                add_damping(token, response, beside * square);
                let work = SpringWork {
                    stored: before,
                    force_before: spring.force_before,
                    increment: slip,
                    compliance: L::splat(token, 1.0 / self.tangential_stiffness),
                    limit,
                    power: cut * square,
                    was_at_limit: spring.was_at_limit,
                };
                spring.count(token, &slid, &work, &parts::FRICTION, response);
            }
        }
    }
}

impl<D: Dimension, const FRICTION: bool, const ROLLING: bool, F: Friction> Stiffness
    for Hooke<D, FRICTION, ROLLING, F>
{
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let [slides, rolls, _] = state.limits;
        let mut d = Derivatives {
            normal: self.normal_stiffness * state.overlap,
            normal_slope: self.normal_stiffness,
            ..Derivatives::default()
        };
        let [first, _, torque] = state.history;
        let force = match D::SPINS {
            3 => state.history,
            _ => [first, 0.0, 0.0],
        };
        if FRICTION {
            let friction = self.friction.at_age(state.age);
            d.tangential = d.friction(force, self.tangential_stiffness, friction, slides);
        }
        if ROLLING {
            d.rolling = self.rolling.derivatives(torque, state.radii, &d, rolls);
        }
        d
    }

    fn dampers(&self, state: &SpringState) -> Derivatives {
        let springs = self.derivatives(state);
        let parameters = parameters_of(self, state.radii);
        let mut d = Derivatives {
            normal_slope: parameters[DAMPING],
            ..Derivatives::default()
        };
        if FRICTION {
            let gamma_t = self.tangential_damping * parameters[DAMPING];
            let damper = ParallelDamper {
                cut: (1.0 - self.sliding_damping) * gamma_t,
                beside: self.sliding_damping * gamma_t,
                of_limit: self.friction.at_age(state.age).value * d.normal_slope,
            };
            d.tangential = damper.derivatives(&springs.tangential, self.tangential_stiffness);
        }
        if ROLLING {
            d.rolling = rolling::damper_of(&parameters[PLAIN..], &springs.rolling, &d);
        }
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::model::PairModel;
    use crate::contact::tests::response_of;

    const SPRINGS: Springs = Springs {
        normal_stiffness: 2e6,
        tangential_stiffness: 0.5e6,
        density: 2500.0,
        damping_ratio: 0.2,
        sliding_damping: 0.0,
        ageing: None,
    };
    const CONTACT: Contact = Contact {
        friction: 0.4,
        rolling_friction: 0.1,
        rolling_damping_ratio: 0.3,
        ..Contact::NONE
    };
    const RADII: [f64; 2] = [0.5e-3, 1e-3];

    /// [`with_springs`] of `SPRINGS`.
    fn response(motion: [f64; 6], history: [f64; 2]) -> ([f64; 3], bool, [f64; 2]) {
        with_springs(&SPRINGS, motion, history)
    }

    /// The response of two disks of `RADII`: F_n, F_t and M; whether they slide; the new history.
    fn with_springs(
        springs: &Springs,
        motion: [f64; 6],
        mut history: [f64; 2],
    ) -> ([f64; 3], bool, [f64; 2]) {
        let law = Hooke::<Two, true, true>::new(springs, &CONTACT);
        let r = response_of(&law, RADII, motion, &mut history);
        let forces = [r.normal, r.tangential[0], r.rolling].map(|lanes| lanes.0[3]);
        (forces, r.sliding != 0, history)
    }

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-14 * b.abs(), "{a} is not {b}");
    }

    /// m* of `RADII` by hand: πρ R²r²/(R²+r²).
    fn reduced_mass() -> f64 {
        std::f64::consts::PI * 2500.0 * (0.25e-6 * 1e-6) / 1.25e-6
    }

    #[test]
    fn springs_and_dampers_below_the_limits() {
        let ([normal, tangential, rolling], slides, history) =
            response([1e-6, -0.01, 0.002, 1e-8, 3.0, 2e-6], [0.05, 1e-6]);
        let m = reduced_mass();
        close(normal, 2.0 + 2.0 * 0.2 * (2e6 * m).sqrt() * 0.01);
        let elastic = 0.05 - 0.5e6 * 1e-8;
        close(history[0], elastic);
        close(tangential, elastic - 2.0 * 0.2 * (0.5e6 * m).sqrt() * 0.002);
        let r_r: f64 = 0.5e-3 / 1.5;
        let k_r = 0.5e6 * r_r * r_r;
        close(history[1], 1e-6 - k_r * 2e-6);
        let inertia = |r: f64| 1.5 * std::f64::consts::PI * 2500.0 * r.powi(4);
        let i_r = inertia(0.5e-3) * inertia(1e-3) / (inertia(0.5e-3) + inertia(1e-3));
        close(rolling, history[1] - 2.0 * 0.3 * (i_r * k_r).sqrt() * 3.0);
        assert!(!slides);
    }

    /// γ_t of `RADII`.
    fn tangential_damping() -> f64 {
        2.0 * 0.2 * (0.5e6 * reduced_mass()).sqrt()
    }

    /// Beyond their limits springs and dampers are cut together, and the springs set back.
    #[test]
    fn limits_cut_springs_and_dampers_together() {
        let ([normal, tangential, rolling], slides, history) =
            response([1e-6, 0.0, 5.0, 1e-5, 1e5, 1.0], [0.0, 0.0]);
        close(normal, 2.0);
        close(tangential, -0.4 * 2.0);
        close(history[0], tangential + tangential_damping() * 5.0);
        close(rolling, -0.1 * (0.5e-3 / 1.5) * 2.0);
        let r_r: f64 = 0.5e-3 / 1.5;
        let inertia = |r: f64| 1.5 * std::f64::consts::PI * 2500.0 * r.powi(4);
        let i_r = inertia(0.5e-3) * inertia(1e-3) / (inertia(0.5e-3) + inertia(1e-3));
        let damper = 2.0 * 0.3 * (i_r * 0.5e6 * r_r * r_r).sqrt() * 1e5;
        close(history[1], rolling + damper);
        assert!(slides);
    }

    /// The forces on both sides of the limit are the same.
    #[test]
    fn nothing_jumps_where_sliding_begins() {
        let damper = tangential_damping() * 5.0;
        let at_limit = -(0.4 * 2.0 - damper);
        let forces = [1.0 - 1e-12, 1.0 + 1e-12].map(|part| {
            let history = [part * at_limit, 0.0];
            response([1e-6, 0.0, 5.0, 0.0, 0.0, 0.0], history).0[1]
        });
        assert!(
            (forces[0] - forces[1]).abs() < 1e-8 * forces[0].abs(),
            "{forces:?}"
        );
    }

    /// The share of the damper acts beside the limit, and is not cut.
    #[test]
    fn a_damper_acts_on_sliding_contacts_if_it_is_to() {
        for share in [0.25, 1.0] {
            let springs = Springs {
                sliding_damping: share,
                ..SPRINGS
            };
            let ([_, tangential, rolling], slides, history) =
                with_springs(&springs, [1e-6, 0.0, 5.0, 1e-5, 1e5, 1.0], [0.0, 0.0]);
            let damper = tangential_damping() * 5.0;
            close(history[0], -0.4 * 2.0 + (1.0 - share) * damper);
            close(tangential, -0.4 * 2.0 - share * damper);
            close(rolling, -0.1 * (0.5e-3 / 1.5) * 2.0);
            assert!(slides);
        }
        let springs = Springs {
            sliding_damping: 1.0,
            ..SPRINGS
        };
        let below = [1e-6, -0.01, 0.002, 1e-8, 3.0, 2e-6];
        let [with, without] = [&springs, &SPRINGS].map(|s| with_springs(s, below, [0.05, 1e-6]));
        close(with.0[1], without.0[1]);
        assert_eq!((with.1, with.2), (without.1, without.2));
    }

    /// K of a contact that slides on: friction falls with the slip, which renews it. By differences
    /// of the law's own forces at a slip of h and 2h.
    #[test]
    fn friction_of_a_renewed_contact_falls_over_the_slip() {
        let ageing = Ageing {
            growth: 0.1,
            time: 2e-3,
            slip: Some(1e-6),
        };
        let friction = Aged::new(CONTACT.friction, &ageing);
        let law = Hooke::<Two, true, false, Aged>::with(&SPRINGS, &CONTACT, friction);
        let (overlap, age, h) = (1e-6, 5e-3, 1e-11);
        let limit = 0.4 * (1.0 + 0.1 * (1.0 + age / 2e-3_f64).ln()) * 2.0;
        let force = |slip| {
            let mut history = [-limit, age];
            let motion = [overlap, 0.0, 0.0, slip, 0.0, 0.0];
            let r = response_of(&law, RADII, motion, &mut history);
            assert!(slip == 0.0 || r.sliding != 0);
            r.tangential[0].0[3]
        };
        let [one, two] = [h, 2.0 * h].map(|slip| force(slip) - force(0.0));
        let slope = (4.0 * one - two) / (2.0 * h);
        let found = law.derivatives(&SpringState {
            materials: [0; 2],
            radii: RADII,
            overlap,
            history: [-limit, 0.0, 0.0],
            torques: [0.0; 4],
            age,
            limits: [Some(true), None, None],
        });
        let along = found.tangential.along;
        assert!((along / -slope - 1.0).abs() < 1e-4, "{along} {slope}");
        close(found.tangential.value[0], -limit);
    }

    /// F_n is 0 if the damper alone would make it negative.
    #[test]
    fn separating_disks_do_not_attract() {
        let ([normal, tangential, _], ..) = response([1e-9, 1.0, 0.1, 1e-9, 0.0, 0.0], [0.3, 0.0]);
        assert_eq!([normal, tangential], [0.0, 0.0]);
    }

    #[test]
    fn every_part_of_the_history_has_its_place() {
        fn places<const FRICTION: bool, const ROLLING: bool>() -> &'static [usize] {
            let law = Hooke::<Two, FRICTION, ROLLING>::new(&SPRINGS, &CONTACT);
            law.layout().history
        }
        assert_eq!(places::<true, true>(), [0, 2]);
        assert_eq!(places::<true, false>(), [0]);
        assert_eq!(places::<false, true>(), [2]);
    }
}
