//! Adhesion of two grains, beside any law of their contact:
//!
//! ```text
//! F_n = F_n' - F_c
//! ```
//!
//! with F_n' ≥ 0 of the law's spring and damper. The limits of friction, rolling and twisting are
//! those of F_n', which presses the grains together. A contact begins at δ = 0, and ends there or
//! at the gap that the adhesion says.
//!
//! F_c jumps when a pair touches and when it separates. In these steps the kernel scales it by the
//! part of the step in which the pair is in contact, so that the scheme stays of second order.

pub mod constant;
pub mod dmt;
pub mod jkr;

use std::sync::{Arc, OnceLock};

use crate::contact::adhesion::AdhesionModel;
use crate::dimension::Dimensions;
use crate::laws::Law;
use crate::laws::keys::{Key, KeyReader};

/// The adhesions of this crate; the first of a dimension is its default.
pub const ADHESIONS: &[&AdhesionKind] = &[&dmt::KIND, &jkr::KIND, &constant::KIND];

/// The adhesions that the program has registered.
static OWN: OnceLock<&'static [&'static AdhesionKind]> = OnceLock::new();

/// Adds adhesions to [`ADHESIONS`]: scenes can name them, and their keys are checked by their
/// declarations. A program calls it once, before it reads a scene or a file of a run;
/// `examples/own_law` is one.
///
/// # Panics
/// If it is called twice, or two adhesions have the same name.
pub fn register(own: &'static [&'static AdhesionKind]) {
    for (k, kind) in own.iter().enumerate() {
        let mut before = ADHESIONS.iter().chain(&own[..k]);
        assert!(
            before.all(|other| other.name != kind.name),
            "two adhesions are called {:?}",
            kind.name
        );
    }
    assert!(OWN.set(own).is_ok(), "adhesions are registered once");
}

/// Every adhesion that a scene can name: [`ADHESIONS`], then those of the program.
pub fn all() -> impl Iterator<Item = &'static AdhesionKind> {
    let own = OWN.get().copied().unwrap_or_default();
    ADHESIONS.iter().chain(own).copied()
}

/// The adhesion of this name, if there is one.
pub fn kind(name: &str) -> Option<&'static AdhesionKind> {
    all().find(|kind| kind.name == name)
}

/// An adhesion before its constants are known.
#[derive(Debug)]
pub struct AdhesionKind {
    /// The name in `contact.adhesion`.
    pub name: &'static str,
    /// One line for the documentation.
    pub summary: &'static str,
    /// The dimensions in which it exists.
    pub dimensions: &'static [Dimensions],
    /// The keys it takes, in the order in which they are written.
    pub keys: &'static [&'static Key],
    /// Why it cannot be beside this law, for the message that refuses it.
    pub unfit: fn(&Law) -> Option<String>,
    /// Makes the adhesion beside a law that fits from the keys' values; `None` if they attract
    /// nothing.
    pub read: fn(&mut dyn KeyReader, &Law) -> Option<Arc<dyn AdhesionModel>>,
}
