//! Failures of the programs and their exit codes.

use std::borrow::Cow;
use std::fmt;

/// A result whose error is a [`Failure`] if no other is named.
pub type Result<T, E = Failure> = std::result::Result<T, E>;

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

/// Text as a terminal may show it: control characters, which files of other people may hold in
/// names and texts, are escaped, but for line breaks and tabs.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c.is_control() && c != '\n' && c != '\t')
}

/// [`printable`] text on one line.
pub fn on_one_line(text: &str) -> Cow<'_, str> {
    escaped(text, char::is_control)
}

fn escaped(text: &str, is_bad: fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(is_bad) {
        return text.into();
    }
    let escape = |c: char| {
        if is_bad(c) {
            c.escape_default().to_string()
        } else {
            c.to_string()
        }
    };
    text.chars().map(escape).collect::<String>().into()
}

/// Exit code of a run that was stopped early and left a checkpoint to resume from.
pub const STOPPED_EARLY: i32 = 75;

/// Where the numbers failed on this rank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outside {
    /// This grain overlaps a plane too much.
    Plane(usize),
    /// The contact in this block and lane overlaps too much.
    Pair(usize, usize),
    /// The force of the contact in this block and lane is greater than any that the law should
    /// have.
    Force(usize, usize),
    /// A position or velocity is NaN, or a grain moved further than the list allows.
    Number,
}

impl Outside {
    /// A step reports the failure of the lowest precedence.
    pub(crate) fn precedence(self) -> u8 {
        match self {
            Self::Plane(_) => 0,
            Self::Pair(..) => 1,
            Self::Force(..) => 2,
            Self::Number => 3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped() {
        let text = "τ\t\u{1b}]0;x\u{7}\r\n\u{9b}2J\u{7f}";
        let shown = "τ\t\\u{1b}]0;x\\u{7}\\r\n\\u{9b}2J\\u{7f}";
        assert_eq!(printable(text), shown);
        assert_eq!(on_one_line("a\tb\nc"), "a\\tb\\nc");
        assert!(matches!(printable("plain: τ\n"), Cow::Borrowed(_)));
    }
}
