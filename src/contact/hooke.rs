//! Linear springs in 2D: Hooke with linear damping, Coulomb friction and rolling resistance, as LAMMPS' `gran/hooke/history` and
//! LIGGGHTS' `hooke` have them, here with the clamp, the damping ratio and the conventions of `lee_hurley`.
//!
//! Normal:
//!
//!     F_n = max(0, k_n δ - γ_n v_n),  γ_n = 2α√(k_n m*)
//!
//! Tangential: the history is the elastic force on i along t̂,
//!
//!     F_t^e ← F_t^e - k_t v_t(t+½Δt) Δt
//!
//! set to the limit ±μ_s F_n and kept so where it is beyond; elsewhere -γ_t v_t is added, γ_t = 2α√(k_t m*).
//!
//! Rolling, as LIGGGHTS' `epsd2` (Ai et al. 2011, type C, with the stiffness of Iwashita & Oda):
//!
//!     M^k ← M^k - k_r Δθ_r,  k_r = k_t R_r²,  R_r = R_i R_j/(R_i+R_j)
//!
//! limited to μ_r R_r F_n; below the limit -C_r (ω_i-ω_j) is added, C_r = 2η_r√(I_r k_r), which `epsd2` lacks and η_r = 0 takes away.

use super::{ContactLaw, Motion, Response};
use crate::config::{Contact, Springs};
use crate::simd::{Lanes, Mask, Row};

/// Largest δ/(R_1+R_2) of two equal disks. A spring has no end, but disks this far in each other are disks no longer; for unequal
/// ones it is this part of the smaller one's diameter. About that of LH's law, so that κ has the same bounds.
pub const LARGEST_OVERLAP: f64 = 0.094;

/// Constants of the law, the same for all contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hooke<const FRICTION: bool, const ROLLING: bool> {
    /// k_n, k_t (Pa).
    normal_stiffness: f64,
    tangential_stiffness: f64,
    /// γ_t/γ_n = √(k_t/k_n).
    tangential_damping: f64,
    /// Mass per squared radius, ρπ (kg/m³).
    density: f64,
    /// α.
    damping_ratio: f64,
    /// μ_s.
    friction: f64,
    /// μ_r.
    rolling_friction: f64,
    /// η_r.
    rolling_damping_ratio: f64,
}

impl<const FRICTION: bool, const ROLLING: bool> Hooke<FRICTION, ROLLING> {
    pub fn new(springs: &Springs, contact: &Contact) -> Self {
        Self {
            normal_stiffness: springs.normal_stiffness,
            tangential_stiffness: springs.tangential_stiffness,
            tangential_damping: (springs.tangential_stiffness / springs.normal_stiffness).sqrt(),
            density: std::f64::consts::PI * springs.density,
            damping_ratio: contact.damping_ratio,
            friction: contact.friction,
            rolling_friction: contact.rolling_friction,
            rolling_damping_ratio: contact.rolling_damping_ratio,
        }
    }
}

// Places in the parameters of a pair.
/// γ_n (kg/(m s)).
const DAMPING: usize = 0;
/// Largest overlap (m).
const LARGEST: usize = 1;
/// k_r (N).
const ROLLING_STIFFNESS: usize = 2;
/// C_r (N s).
const ROLLING_DAMPING: usize = 3;
/// μ_r R_r (m).
const ROLLING_LIMIT: usize = 4;

impl<const FRICTION: bool, const ROLLING: bool> ContactLaw for Hooke<FRICTION, ROLLING> {
    const PARAMETERS: usize = 2 + if ROLLING { 3 } else { 0 };
    const HISTORY: usize = FRICTION as usize + ROLLING as usize;
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = ROLLING;

    fn parameters(&self, r_i: f64, r_j: f64, out: &mut [f64]) {
        let (m_i, m_j) = (self.density * r_i * r_i, self.density * r_j * r_j);
        let reduced_mass = m_i * m_j / (m_i + m_j);
        let smaller = if r_i < r_j { r_i } else { r_j };
        out[DAMPING] = 2.0 * self.damping_ratio * (self.normal_stiffness * reduced_mass).sqrt();
        out[LARGEST] = 2.0 * LARGEST_OVERLAP * smaller;
        if ROLLING {
            let r_r = r_i * r_j / (r_i + r_j);
            let k_r = self.tangential_stiffness * r_r * r_r;
            // I + mR² of a disk.
            let (i_i, i_j) = (1.5 * m_i * r_i * r_i, 1.5 * m_j * r_j * r_j);
            let i_r = i_i * i_j / (i_i + i_j);
            out[ROLLING_STIFFNESS] = k_r;
            out[ROLLING_DAMPING] = 2.0 * self.rolling_damping_ratio * (i_r * k_r).sqrt();
            out[ROLLING_LIMIT] = self.rolling_friction * r_r;
        }
    }

    #[inline(always)]
    fn evaluate<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Row],
        history: &mut [Row],
        motion: Motion<L>,
        touching: L::Mask,
    ) -> Response<L> {
        let c = |v| L::splat(token, v);
        let p = |k: usize| L::load(token, &parameters[k]);
        let zero = c(0.0);

        let damping = p(DAMPING);
        let normal = c(self.normal_stiffness)
            .mul_add(motion.overlap, -(damping * motion.normal_velocity))
            .max(zero);
        let beyond = motion.overlap.greater(p(LARGEST)).and(touching);

        let mut tangential = zero;
        let mut rolling = zero;
        let mut sliding = zero.greater(zero);
        if FRICTION {
            let trial = -c(self.tangential_stiffness)
                .mul_add(motion.tangential_increment, -L::load(token, &history[0]));
            let limit = c(self.friction) * normal;
            sliding = trial.abs().greater(limit);
            let elastic = limit.copy_sign(trial).select(sliding, trial);
            let viscous = c(self.tangential_damping) * damping * motion.tangential_velocity;
            tangential = elastic - zero.select(sliding, viscous);
            sliding = sliding.and(touching);
            elastic.select(touching, zero).store(&mut history[0]);
        }
        if ROLLING {
            let place = Self::HISTORY - 1;
            let trial = -p(ROLLING_STIFFNESS)
                .mul_add(motion.rolling_increment, -L::load(token, &history[place]));
            let limit = p(ROLLING_LIMIT) * normal;
            let limited = trial.abs().greater(limit);
            let elastic = limit.copy_sign(trial).select(limited, trial);
            let viscous = p(ROLLING_DAMPING) * motion.rolling_velocity;
            rolling = elastic - zero.select(limited, viscous);
            elastic.select(touching, zero).store(&mut history[place]);
        }
        Response {
            normal,
            tangential,
            rolling,
            sliding,
            beyond,
        }
    }

    // k_t is the same in every step: its place in the state stays 0.
    fn history_to_state([first, second, _]: [f64; 3]) -> [f64; 3] {
        match (FRICTION, ROLLING) {
            (true, _) => [first, 0.0, second],
            (false, _) => [0.0, 0.0, first],
        }
    }

    fn history_from_state([tangential, _, rolling]: [f64; 3]) -> [f64; 3] {
        match (FRICTION, ROLLING) {
            (true, _) => [tangential, rolling, 0.0],
            (false, _) => [rolling, 0.0, 0.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Portable, PortableToken};

    const SPRINGS: Springs = Springs {
        normal_stiffness: 2e6,
        tangential_stiffness: 0.5e6,
        density: 2500.0,
    };
    const CONTACT: Contact = Contact {
        friction: 0.4,
        rolling_friction: 0.1,
        damping_ratio: 0.2,
        rolling_damping_ratio: 0.3,
    };
    const RADII: [f64; 2] = [0.5e-3, 1e-3];

    /// What two disks of `RADII` do: F_n, F_t, M, sliding, beyond, and the new history. `motion` in the order of `Motion`.
    fn response(motion: [f64; 6], history: [f64; 2]) -> ([f64; 3], [bool; 2], [f64; 2]) {
        type Law = Hooke<true, true>;
        let law = Law::new(&SPRINGS, &CONTACT);
        let mut numbers = [0.0; Law::PARAMETERS];
        law.parameters(RADII[0], RADII[1], &mut numbers);
        let parameters = numbers.map(|v| Row([v; 8]));
        let mut history = history.map(|v| Row([v; 8]));
        let c = |v| Portable::splat(PortableToken, v);
        let [overlap, v_n, v_t, slip, spin, roll] = motion.map(c);
        let motion = Motion {
            overlap,
            normal_velocity: v_n,
            tangential_velocity: v_t,
            tangential_increment: slip,
            rolling_velocity: spin,
            rolling_increment: roll,
        };
        let r = law.evaluate(PortableToken, &parameters, &mut history, motion, 0xff);
        let one = |lanes: Portable| {
            let mut row = Row::ZERO;
            lanes.store(&mut row);
            row.0[3]
        };
        (
            [one(r.normal), one(r.tangential), one(r.rolling)],
            [r.sliding.bits() != 0, r.beyond.bits() != 0],
            history.map(|row| row.0[3]),
        )
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
        let ([normal, tangential, rolling], flags, history) =
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
        assert_eq!(flags, [false, false]);
    }

    #[test]
    fn limits_are_kept_and_remembered_without_dampers() {
        let ([normal, tangential, rolling], flags, history) =
            response([1e-6, 0.0, 5.0, 1e-5, 1e5, 1.0], [0.0, 0.0]);
        close(normal, 2.0);
        close(tangential, -0.4 * 2.0);
        close(history[0], tangential);
        close(rolling, -0.1 * (0.5e-3 / 1.5) * 2.0);
        close(history[1], rolling);
        assert_eq!(flags, [true, false]);
    }

    /// No attraction: where the damper would pull, there is no force at all.
    #[test]
    fn separating_disks_do_not_attract() {
        let ([normal, tangential, _], ..) = response([1e-9, 1.0, 0.1, 1e-9, 0.0, 0.0], [0.3, 0.0]);
        assert_eq!([normal, tangential], [0.0, 0.0]);
    }

    #[test]
    fn the_largest_overlap() {
        let beyond = |overlap| response([overlap, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]).1[1];
        assert!(!beyond(0.93e-4 * 1.0) && beyond(0.95e-4));
    }

    #[test]
    fn every_part_of_the_history_has_its_place() {
        let state = [0.7, 0.0, 0.3];
        assert_eq!(
            Hooke::<true, true>::history_to_state(Hooke::<true, true>::history_from_state(state)),
            state
        );
        assert_eq!(
            Hooke::<true, false>::history_to_state([0.7, 0.0, 0.0]),
            [0.7, 0.0, 0.0]
        );
        assert_eq!(
            Hooke::<false, true>::history_to_state(Hooke::<false, true>::history_from_state(state)),
            [0.0, 0.0, 0.3]
        );
    }
}
