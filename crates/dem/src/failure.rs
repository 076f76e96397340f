//! Failures of the programs and their exit codes.

use std::fmt;

/// The reason why a run or a reduction ends early. Printed once, as `error: …`.
#[derive(Debug, Clone, PartialEq)]
pub enum Failure {
    /// Bad input: configuration, file or arguments. The message says what is wrong, where, and what
    /// would be right.
    Input(String),
    /// The numbers failed: overlap outside the law, NaN, no convergence.
    Numbers(String),
    /// Anything else, such as a full disk.
    Other(String),
}

impl Failure {
    /// 0 done, 1 other, 2 bad input, 3 the numbers failed, 75 stopped early at a checkpoint.
    pub fn exit_code(&self) -> i32 {
        match self {
            Failure::Other(_) => 1,
            Failure::Input(_) => 2,
            Failure::Numbers(_) => 3,
        }
    }

    /// Bad input.
    pub fn input(message: impl Into<String>) -> Self {
        Failure::Input(message.into())
    }

    /// Numbers that failed.
    pub fn numbers(message: impl Into<String>) -> Self {
        Failure::Numbers(message.into())
    }

    /// Any other failure.
    pub fn other(message: impl Into<String>) -> Self {
        Failure::Other(message.into())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Input(m) | Failure::Numbers(m) | Failure::Other(m) => f.write_str(m),
        }
    }
}

impl std::error::Error for Failure {}

/// Exit code of a run that was stopped early and left a checkpoint to resume from.
pub const STOPPED_EARLY: i32 = 75;
