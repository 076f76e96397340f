//! An attraction F_c of grains that touch, the same at every δ > 0, with the potential -F_c δ.

use std::sync::Arc;

use super::AdhesionKind;
use crate::contact::adhesion::{Adhesion, AdhesionModel, AdhesivePairs};
use crate::dimension::Dimensions;
use crate::laws::keys::{Key, KeyReader, NOT_NEGATIVE};
use crate::simd::Lanes;

/// The adhesion as scenes name it.
pub const KIND: AdhesionKind = AdhesionKind {
    name: "constant",
    summary: "a constant attraction of grains that touch",
    dimensions: &[Dimensions::Two, Dimensions::Three],
    keys: &[&ATTRACTION],
    unfit: |_| None,
    read: |values, _| Constant::read(values).shared(),
};

/// F_c, which acts beside other adhesions, too.
pub(crate) const ATTRACTION: Key = Key {
    default: "0.0",
    ..Key::number("contact.attraction", NOT_NEGATIVE)
        .such_as("F_c", "N, in 2D N/m", "1e-3")
        .doc("attraction F_c of two grains that touch; packing does without")
};

/// A constant attraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constant {
    /// F_c (N; N/m in 2D).
    pub force: f64,
}

impl Constant {
    pub(super) fn read(values: &mut dyn KeyReader) -> Self {
        Self {
            force: values.number(&ATTRACTION).unwrap_or(0.0),
        }
    }

    /// As an adhesion, unless there is none.
    pub(super) fn shared(self) -> Option<Arc<dyn AdhesionModel>> {
        if self.force > 0.0 {
            Some(Arc::new(self))
        } else {
            None
        }
    }
}

impl Adhesion for Constant {
    #[inline(always)]
    fn force<L: Lanes>(&self, token: L::Token, _: &AdhesivePairs<L>) -> L {
        L::splat(token, self.force)
    }

    #[inline(always)]
    fn add_potential<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>, energy: L) -> L {
        (-self.force(token, pairs)).mul_add(pairs.overlap, energy)
    }
}
