//! Messages to the terminal. A closed or full output does not end a run, because its results are
//! files.

use std::io::Write;

/// Prints a line, if standard output is neither closed nor full.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

/// Prints a line to standard error, if that is neither closed nor full.
pub fn say_error(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}
