//! The coefficient of friction of contacts: one for all, or of what a contact keeps.

use std::fmt::Debug;

use super::norm;
use crate::dimension::Vector;
use crate::simd::{Lanes, Lanes16};

/// What the friction of a contact is in a step. A law takes what it has of it at compile time.
pub trait Friction: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// Numbers that a contact keeps for it, behind those of its tangential spring.
    const HISTORY: usize;

    /// The coefficient at the end of a step in which contacts stick. Their ages, `kept`, grow by
    /// the step, and are 0 where the grains do not touch.
    fn of_stuck<L: Lanes>(
        &self,
        token: L::Token,
        kept: &mut [Lanes16],
        touching: L::Mask,
        per_step: f64,
    ) -> L;

    /// The coefficient where contacts slide, which their slip renews; elsewhere `stuck`, that of
    /// [`Friction::of_stuck`].
    fn of_sliding<L: Lanes>(
        &self,
        token: L::Token,
        kept: &mut [Lanes16],
        slip: &SlipOfStep<L>,
        stuck: L,
    ) -> L;

    /// The coefficient of a contact of this age (s).
    fn at_age(&self, age: f64) -> Coefficient;
}

/// The slip of contacts in a step.
pub struct SlipOfStep<L: Lanes> {
    /// v_t(t + ½Δt) Δt (m), of one component, the first, or in the tangent plane.
    pub way: Vector<L>,
    /// Number of components: 1 or 3.
    pub components: usize,
    /// Where they slide.
    pub sliding: L::Mask,
    /// 1/Δt (1/s); 0 if Δt is 0.
    pub per_step: f64,
}

impl<L: Lanes> SlipOfStep<L> {
    /// Its length (m).
    #[inline(always)]
    pub fn length(&self, token: L::Token) -> L {
        match self.components {
            1 => self.way[0].abs(),
            _ => norm(token, &self.way).0,
        }
    }
}

/// A coefficient of friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficient {
    /// The coefficient.
    pub value: f64,
    /// By how much it falls over a slip (1/m).
    pub fall: f64,
}

/// The coefficient that all contacts have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coulomb(pub f64);

impl Friction for Coulomb {
    const HISTORY: usize = 0;

    #[inline(always)]
    fn of_stuck<L: Lanes>(&self, token: L::Token, _: &mut [Lanes16], _: L::Mask, _: f64) -> L {
        L::splat(token, self.0)
    }

    #[inline(always)]
    fn of_sliding<L: Lanes>(
        &self,
        _: L::Token,
        _: &mut [Lanes16],
        _: &SlipOfStep<L>,
        stuck: L,
    ) -> L {
        stuck
    }

    fn at_age(&self, _: f64) -> Coefficient {
        Coefficient {
            value: self.0,
            fall: 0.0,
        }
    }
}
