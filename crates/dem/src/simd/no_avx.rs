//! In place of `avx2` and `avx512` on processors other than x86-64.

use super::Work;

/// A token that cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Token {}

impl Token {
    /// `None`.
    pub fn detect() -> Option<Self> {
        None
    }
}

/// Cannot be called.
pub(super) fn run<W: Work>(token: Token, _: W) -> W::Output {
    match token {}
}
