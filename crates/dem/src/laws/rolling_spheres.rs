//! Rolling and twisting resistance of spheres, beside any law between them: springs, dashpots and
//! sliders as LAMMPS' `rolling sds` and `twisting sds` (Luding 2008; Santos et al. 2020).
//!
//! With the rotation Δθ of i against j in a step, its part Δθ_r in the tangent plane and its
//! component Δθ_n along n, the torques on i are
//!
//! ```text
//! M ← M - k_r Δθ_r,  M_r = M - C_r (ω_i-ω_j)_r,  |M_r| ≤ μ_r R_r F_n,  k_r = k R_r²
//! T ← T - k_w Δθ_n,  T_n = T - C_w (ω_i-ω_j)_n,  |T_n| ≤ μ_w R_r F_n,  k_w = k' R_r²
//! C = 2η√(I k)
//! ```
//!
//! with R_r = R_i R_j/(R_i+R_j), I = I_i I_j/(I_i+I_j), and of a sphere I = (7/5) mR² for rolling,
//! about the contact, and (2/5) mR² for twisting. A torque beyond its limit is cut to it, and its
//! spring set back so that spring and damper together give the limit; that of rolling turns as a
//! spring that slides (`contact::parts`). The histories, M and T, turn with the pair as that of
//! F_t.
//!
//! At the touch the spring is unloaded, but not the dashpot. If that is beyond the limit, the
//! spring is set back at once. With most laws F_n and with it the limits begin at 0: then M begins
//! as C (ω_i-ω_j), and the torque at 0.
//!
//! LAMMPS counts in forces R_r apart: its k_roll is k, its γ_roll is C_r/R_r², its k_twist and
//! γ_twist are k_w and C_w, its μ_twist is μ_w R_r (m). It sets a twisting torque beyond its limit
//! against the present twisting velocity; here the torque keeps its sign.

use super::rolling::{self, PairResistance, Resistance, Rotation};
use super::{Constants, Contact};
use crate::contact::parts::{self, SpringWork};
use crate::contact::stiffness::{Derivatives, SpringState, Stiffness};
use crate::contact::{
    AGE, Blocks, CARRY, ContactLaw, Jump, PairMotion, Response, TORQUES, Turning, dissipation,
    parameters_of, vector,
};
use crate::dimension::{Dimension, Three};
use crate::kernel::PairForce;
use crate::simd::{Lanes, Lanes16, Mask};
use crate::state::Masses;

/// The law `rough`, `smooth` without friction, or with rolling and twisting resistance, as the
/// contacts have them.
pub fn between_spheres(
    constants: &dyn Constants,
    contact: &Contact,
    rough: impl ContactLaw<Space = Three> + Stiffness,
    smooth: impl ContactLaw<Space = Three> + Stiffness,
) -> Box<dyn PairForce<Three>> {
    match (contact.friction > 0.0, contact.resists_rotation()) {
        (true, true) => Box::new(Resisting::new(constants, contact, rough)),
        (false, true) => Box::new(Resisting::new(constants, contact, smooth)),
        (true, false) => Box::new(rough),
        (false, false) => Box::new(smooth),
    }
}

/// A law with rolling and twisting resistance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Resisting<C> {
    law: C,
    /// (4/3)πρ (kg/m³) of i and j, or the mass of each (kg).
    masses: [f64; 2],
    /// Which of the two.
    is_density: bool,
    rolling: Resistance,
    twisting: Resistance,
}

impl<C: ContactLaw> Resisting<C> {
    fn new(constants: &dyn Constants, contact: &Contact, law: C) -> Self {
        let rolling = contact.rolling_stiffness.or(constants.rolling_stiffness());
        // A scene gives what it needs.
        let rolling = rolling.unwrap_or(0.0);
        let (masses, is_density) = match constants.masses() {
            Masses::Equal(mass) => ([mass; 2], false),
            of => (contact.densities(of.of(0, Three::volume(1.0))), true),
        };
        Self {
            law,
            masses,
            is_density,
            rolling: Resistance {
                stiffness: rolling,
                friction: contact.rolling_friction,
                damping: 2.0 * contact.rolling_damping_ratio * 1.4f64.sqrt(),
            },
            twisting: Resistance {
                stiffness: contact.twisting_stiffness.unwrap_or(rolling),
                friction: contact.twisting_friction,
                damping: 2.0 * contact.twisting_damping_ratio * 0.4f64.sqrt(),
            },
        }
    }
}

/// Parameters of a pair after those of the law: of rolling, then of twisting.
const OWN: usize = 2 * rolling::PARAMETERS;
/// Most parameters of a law between spheres.
const MOST: usize = 4;
/// Most numbers of its history: of the tangential spring, and the age.
const MOST_HISTORY: usize = 4;

/// Blocks whose parameters and histories are put in a row at a time.
const TOGETHER: usize = 4;

impl<C: ContactLaw<Space = Three>> ContactLaw for Resisting<C> {
    type Space = Three;
    const PARAMETERS: usize = C::PARAMETERS + OWN;
    const HISTORY: usize = C::HISTORY + TORQUES;
    // Without friction the torques come first.
    const HISTORY_PLACES: &'static [usize] = match (C::FRICTION, C::AGES) {
        (true, true) => &[0, 1, 2, AGE, 3, 4, 5, 6],
        (true, false) => &[0, 1, 2, 3, 4, 5, 6],
        (false, _) => &[3, 4, 5, 6],
    };
    const AGES: bool = C::AGES;
    const HISTORY_UNIT: &'static str = C::HISTORY_UNIT;
    // The motion across n is needed.
    const FRICTION: bool = true;
    const ROLLING: bool = true;
    const CUTS_DAMPERS: bool = true;
    const NEEDS_LAST_OVERLAP: bool = C::NEEDS_LAST_OVERLAP;
    const LIMITS_JUMP: bool = C::LIMITS_JUMP;
    const LARGEST_OVERLAP: f64 = C::LARGEST_OVERLAP;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        let c = |v| L::splat(token, v);
        self.law.parameters(token, r_i, r_j, out);
        let out = &mut out[C::PARAMETERS..];
        let [mut m_i, mut m_j] = [c(self.masses[0]), c(self.masses[1])];
        if self.is_density {
            (m_i, m_j) = (m_i * Three::power(r_i), m_j * Three::power(r_j));
        }
        let r_r = r_i * r_j / (r_i + r_j);
        // mR².
        let (i, j) = (m_i * r_i * r_i, m_j * r_j * r_j);
        let inertia = i * j / (i + j);
        let (rolling, twisting) = out.split_at_mut(rolling::PARAMETERS);
        self.rolling.parameters(token, r_r, inertia, rolling);
        self.twisting.parameters(token, r_r, inertia, twisting);
    }

    fn largest_force(&self, radius: f64) -> f64 {
        self.law.largest_force(radius)
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        self.evaluate_law::<L, BUDGET>(token, blocks);
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let kept = parameters.zip(blocks.history.chunks_exact_mut(Self::HISTORY));
        let moving = kept.zip(blocks.motion).zip(&mut *blocks.turning);
        let pairs = moving.zip(&mut *blocks.response).enumerate();
        for (block, ((((p, history), motion), turning), response)) in pairs {
            if !C::FRICTION {
                response.tangential = [Lanes16::ZERO; 3];
                response.sliding = 0;
            }
            if BUDGET {
                if !C::FRICTION {
                    response.dissipated[dissipation::STIFFNESS] = Lanes16::ZERO;
                }
                if !(C::FRICTION && C::CUTS_DAMPERS) {
                    response.dissipated[dissipation::CUT_FRICTION] = Lanes16::ZERO;
                    response.dissipated[dissipation::SET_BACK_TANGENTIAL] = Lanes16::ZERO;
                }
                parts::ROLLING.clear(response);
            }
            let torques = &mut history[C::HISTORY..];
            let jumps = blocks.jumps.iter().filter(|jump| jump.block == block);
            let begins = begins_at(token, motion, turning, torques, blocks.per_step, jumps);
            let normal = L::load(token, &response.normal);
            let (normal, set_back) = self.at_first::<L>(token, p, normal, motion, &begins);
            let step = TurningStep {
                parameters: &p[C::PARAMETERS..],
                normal,
                begins,
                set_back,
                per_step: blocks.per_step,
                touching: L::load(token, &motion.overlap).greater(L::splat(token, 0.0)),
            };
            // Not a loop, so that each has its numbers as constants.
            step.resist::<BUDGET>(token, &ROLLING, torques, turning, response);
            step.resist::<BUDGET>(token, &TWISTING, torques, turning, response);
        }
    }

    /// Rolling: ½M²/k_r + ½T²/k_w.
    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3] {
        let c = |v| L::splat(token, v);
        let [normal, tangential, _] = self
            .law
            .elastic_energies(token, parameters, overlap, history);
        let torques = &history[C::HISTORY..];
        let own = &parameters[C::PARAMETERS..];
        let rolling = PairResistance::<L>::load(token, &own[ROLLING.parameters..]);
        let twisting = PairResistance::<L>::load(token, &own[TWISTING.parameters..]);
        let k_r = rolling.stiffness.max(c(rolling::SOFTEST));
        let k_w = twisting.stiffness.max(c(rolling::SOFTEST));
        let moment = vector::<L>(token, torques, 3);
        let twist = L::load(token, &torques[3]);
        let rolling = c(0.5) * Three::dot(&moment, &moment) / k_r;
        let rolling = rolling + c(0.5) * twist * twist / k_w;
        [normal, tangential, rolling]
    }
}

impl<C: ContactLaw<Space = Three>> Resisting<C> {
    /// F_n that limits the torques at the end of the step, of pairs that come to touch in it for
    /// the whole velocity, and the part of the dashpots of rolling and of twisting that is beyond
    /// their limits where they begin, by which the springs are set back.
    #[inline(always)]
    fn at_first<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        mut normal: L,
        motion: &PairMotion,
        begins: &Begins<L>,
    ) -> (L, [L; 2]) {
        let c = |v| L::splat(token, v);
        let [x, y, z, twist] = begins.velocity;
        let rolling = [x, y, z];
        let squares = Three::dot(&rolling, &rolling);
        let has_begun = squares.max(twist.abs()).greater(c(0.0)).bits() != 0;
        if !has_begun && begins.touches.bits() == 0 {
            return (normal, [c(0.0); 2]);
        }
        let mut begun = normal;
        if begins.touches.bits() != 0 {
            let velocity = L::load(token, &motion.normal_velocity) / (c(0.5) + begins.part);
            let least = c(f64::MIN_POSITIVE);
            let at_touch = self.normal_force(token, parameters, least, velocity);
            let overlap = L::load(token, &motion.overlap);
            let whole = self.normal_force(token, parameters, overlap, velocity);
            begun = at_touch.select(begins.touches, normal);
            normal = whole.select(begins.touches, normal);
        }
        let own = &parameters[C::PARAMETERS..];
        let mut parts = [squares.sqrt(), twist.abs()];
        for k in 0..2 {
            let own = PairResistance::<L>::load(token, &own[k * rolling::PARAMETERS..]);
            let limit = own.arm * begun;
            let size = own.damping * parts[k];
            let within = limit / size.max(c(rolling::SOFTEST));
            let part = (c(1.0) - within).max(c(0.0));
            // None of the torques that do not begin here, whatever else is in the block.
            parts[k] = part.select(size.greater(c(0.0)), c(0.0));
        }
        (normal, parts)
    }

    /// F_n at this δ (m) and v_n (m/s).
    #[inline(always)]
    fn normal_force<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        velocity: L,
    ) -> L {
        let mut motion = PairMotion::default();
        overlap.store(&mut motion.overlap);
        velocity.store(&mut motion.normal_velocity);
        let mut response = Response::default();
        self.law.evaluate::<L, false>(
            token,
            &mut Blocks {
                parameters: &parameters[..C::PARAMETERS],
                history: &mut [Lanes16::ZERO; MOST_HISTORY][..C::HISTORY],
                motion: &[motion],
                turning: &mut [],
                per_step: 0.0,
                carry: &mut [[Lanes16::ZERO; CARRY]],
                response: std::slice::from_mut(&mut response),
                jumps: &[],
            },
        );
        L::load(token, &response.normal)
    }

    /// Evaluates the law itself, with its own parameters and histories in a row.
    #[inline(always)]
    fn evaluate_law<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let mut parameters = [Lanes16::ZERO; TOGETHER * MOST];
        let mut history = [Lanes16::ZERO; TOGETHER * MOST_HISTORY];
        for first in (0..blocks.motion.len()).step_by(TOGETHER) {
            let part = first..blocks.motion.len().min(first + TOGETHER);
            for (k, block) in part.clone().enumerate() {
                parameters[k * C::PARAMETERS..][..C::PARAMETERS].copy_from_slice(
                    &blocks.parameters[block * Self::PARAMETERS..][..C::PARAMETERS],
                );
                history[k * C::HISTORY..][..C::HISTORY]
                    .copy_from_slice(&blocks.history[block * Self::HISTORY..][..C::HISTORY]);
            }
            self.law.evaluate::<L, BUDGET>(
                token,
                &mut Blocks {
                    parameters: &parameters[..part.len() * C::PARAMETERS],
                    history: &mut history[..part.len() * C::HISTORY],
                    motion: &blocks.motion[part.clone()],
                    turning: &mut [],
                    per_step: blocks.per_step,
                    carry: &mut blocks.carry[part.clone()],
                    response: &mut blocks.response[part.clone()],
                    jumps: &[],
                },
            );
            for (k, block) in part.enumerate() {
                blocks.history[block * Self::HISTORY..][..C::HISTORY]
                    .copy_from_slice(&history[k * C::HISTORY..][..C::HISTORY]);
            }
        }
    }
}

/// One of the two torques of a pair: where its numbers are.
struct Torque {
    /// The first of its components among those of both, and their number.
    first: usize,
    components: usize,
    /// The first of its parameters.
    parameters: usize,
    /// Its place among the two.
    place: usize,
}

/// M_r.
const ROLLING: Torque = Torque {
    first: 0,
    components: 3,
    parameters: 0,
    place: 0,
};

/// T_n.
const TWISTING: Torque = Torque {
    first: 3,
    components: 1,
    parameters: rolling::PARAMETERS,
    place: 1,
};

impl Torque {
    /// The lanes of a response at its limit.
    #[inline(always)]
    fn at_limit<'r>(&self, response: &'r mut Response) -> &'r mut u16 {
        match self.place {
            0 => &mut response.rolls,
            _ => &mut response.twists,
        }
    }
}

/// How pairs turn in a step, and what they are.
struct TurningStep<'a, L: Lanes> {
    /// Of rolling, then of twisting.
    parameters: &'a [Lanes16],
    /// F_n that limits the torques.
    normal: L,
    begins: Begins<L>,
    /// The parts of the dampers by which the springs are set back where they begin.
    set_back: [L; 2],
    /// 1/Δt as in [`Blocks::per_step`].
    per_step: f64,
    touching: L::Mask,
}

impl<L: Lanes> TurningStep<'_, L> {
    /// Computes one of the torques and its spring.
    #[inline(always)]
    fn resist<const BUDGET: bool>(
        &self,
        token: L::Token,
        torque: &Torque,
        history: &mut [Lanes16],
        turning: &mut Turning,
        response: &mut Response,
    ) {
        let zero = L::splat(token, 0.0);
        let (first, components) = (torque.first, torque.components);
        let resistance = PairResistance::<L>::load(token, &self.parameters[torque.parameters..]);
        let set_back = self.set_back[torque.place];
        let has_begun = set_back.greater(zero);
        let stored = vector(token, &history[first..], components);
        // The spring, and spring and damper, where the torque begins.
        let (mut before, mut at_first) = (stored, stored);
        for k in 0..components {
            let velocity = self.begins.velocity[first + k];
            let part = set_back * velocity;
            before[k] = stored[k] + resistance.damping * part;
            at_first[k] = resistance.damping * (part - velocity);
        }
        let rotation = Rotation {
            components,
            before,
            angle: vector(token, &turning.increment[first..], components),
            velocity: vector(token, &turning.velocity[first..], components),
            per_step: self.per_step,
            was_at_limit: L::mask(token, *torque.at_limit(response)),
            touching: self.touching,
        };
        let spring = resistance.turned(token, &rotation);
        let limit = resistance.arm * self.normal;
        let slid = spring.slide_together(token, limit);
        *torque.at_limit(response) = slid.at_limit.bits();
        for k in 0..components {
            // A torque that begins with a jump acts for ½ + θ of the step.
            let acting = self
                .begins
                .beyond_a_step
                .mul_add(at_first[k], slid.force[k]);
            acting.store(&mut turning.torque[first + k]);
            let elastic = slid.elastic[k].select(self.touching, zero);
            elastic.store(&mut history[first + k]);
        }
        if BUDGET {
            let mut work = SpringWork {
                stored,
                force_before: spring.force_before,
                increment: rotation.angle,
                compliance: resistance.compliance(token),
                limit,
                power: zero,
                was_at_limit: either::<L>(token, [rotation.was_at_limit, has_begun]),
            };
            for k in 0..components {
                work.increment[k] = rotation.angle[k].select(self.touching, zero);
                work.force_before[k] = at_first[k].select(has_begun, spring.force_before[k]);
                let power = spring.viscous[k] * rotation.velocity[k];
                // Of a pair that has opened, half of the last step's was too much.
                let is_loaded = stored[k].abs().greater(zero);
                let too_much = L::splat(token, -0.5).select(is_loaded, zero);
                let share = self.begins.share.select(self.touching, too_much);
                let counts = share.abs().greater(zero);
                work.power = work.power + (share * power).select(counts, zero);
            }
            spring.count(token, &slid, &work, &parts::ROLLING, response);
        }
    }
}

/// Where at least one of two masks is set.
#[inline(always)]
fn either<L: Lanes>(token: L::Token, masks: [L::Mask; 2]) -> L::Mask {
    L::mask(token, masks[0].bits() | masks[1].bits())
}

/// Where torques begin, in contacts without history.
struct Begins<L: Lanes> {
    /// ω_i - ω_j there (rad/s): at the touch, a part θ of the step ago. 0 of other contacts.
    velocity: [L; TORQUES],
    /// Which of them touch for the first time, F_n beginning without overlap.
    touches: L::Mask,
    /// θ of these, and θ - ½, 0 of others.
    part: L,
    beyond_a_step: L,
    /// The part of the dampers' power in the step, by the rule of trapezoids ½ + θ, before the
    /// kernel divides it by that.
    share: L,
}

/// Finds where torques begin. There increments are of the part θ, and v_n has been multiplied by
/// ½ + θ.
#[inline(always)]
fn begins_at<'j, L: Lanes>(
    token: L::Token,
    motion: &PairMotion,
    turning: &Turning,
    history: &[Lanes16],
    per_step: f64,
    mut jumps: impl Iterator<Item = &'j Jump>,
) -> Begins<L> {
    let c = |v| L::splat(token, v);
    let load = |lanes: &Lanes16| L::load(token, lanes);
    let (zero, half, one) = (c(0.0), c(0.5), c(1.0));
    let mut begins = Begins {
        velocity: [zero; TORQUES],
        touches: L::mask(token, 0),
        part: one,
        beyond_a_step: zero,
        share: one,
    };
    if per_step == 0.0 {
        return begins;
    }
    let mut size = zero;
    for lanes in &history[..TORQUES] {
        size = size + load(lanes).abs();
    }
    let overlap = load(&motion.overlap);
    let least = c(f64::MIN_POSITIVE);
    let has_none = least.greater(size).and(overlap.greater(zero));
    let first_jump = jumps.next();
    if has_none.bits() == 0 && first_jump.is_none() {
        return begins;
    }
    // Of a pair that comes to touch (½ + θ)/θ ≥ 3/2, but for its acceleration in the step.
    let way = load(&motion.normal_velocity) * c(-1.0 / per_step);
    let ratio = way / overlap.max(least);
    let mut part = half / (ratio - one).max(half);
    let mut touches = has_none.and(ratio.greater(c(1.25)));
    for &Jump { lane, factor, .. } in first_jump.into_iter().chain(jumps) {
        touches = L::mask(token, touches.bits() & !(1 << lane));
        let mut parts = part.to_lanes16();
        parts.0[lane] = factor - 0.5;
        part = load(&parts);
    }
    let factor = half + part;
    for k in 0..TORQUES {
        let of_half_step = c(2.0 * per_step) * load(&turning.increment[k]);
        let velocity = load(&turning.velocity[k]);
        let begun = c(-2.0).mul_add(part, one).mul_add(velocity, of_half_step);
        begins.velocity[k] = begun.select(has_none, zero);
    }
    Begins {
        touches,
        part,
        beyond_a_step: (part - half).select(touches, zero),
        share: (factor * factor).select(touches, one),
        ..begins
    }
}

impl<C: ContactLaw<Space = Three> + Stiffness> Stiffness for Resisting<C> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let d = self.law.derivatives(state);
        let radii = state.radii;
        let [_, rolls, twists] = state.limits;
        let [x, y, z, twist] = state.torques;
        Derivatives {
            rolling: self.rolling.derivatives([x, y, z], radii, &d, rolls),
            twisting: (self.twisting).derivatives([twist, 0.0, 0.0], radii, &d, twists),
            ..d
        }
    }

    fn dampers(&self, state: &SpringState) -> Derivatives {
        let (d, springs) = (self.law.dampers(state), self.derivatives(state));
        let parameters = parameters_of(self, state.radii);
        let own = &parameters[C::PARAMETERS..];
        Derivatives {
            rolling: rolling::damper_of(&own[ROLLING.parameters..], &springs.rolling, &d),
            twisting: rolling::damper_of(&own[TWISTING.parameters..], &springs.twisting, &d),
            ..d
        }
    }
}
