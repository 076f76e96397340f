//! Where a command prints: standard output, whose errors are failures of the command.

use std::fmt;
use std::io::{self, Write};
use std::path::Path;

use gshear_dem::failure::{Failure, Result};

/// The output of a command. `write!` and `writeln!` return the failure of the command.
pub struct Printer<'a>(&'a mut dyn Write);

impl<'a> Printer<'a> {
    /// Prints to `output`.
    pub fn new(output: &'a mut dyn Write) -> Self {
        Self(output)
    }

    /// Prints formatted text; `write!` calls it.
    ///
    /// # Errors
    /// [`Failure::Other`] if the terminal or the pipe cannot be written.
    pub(crate) fn write_fmt(&mut self, text: fmt::Arguments) -> Result<()> {
        self.0.write_fmt(text).map_err(unwritten)
    }

    /// Prints that a file was written.
    ///
    /// # Errors
    /// As [`Self::write_fmt`].
    pub fn wrote(&mut self, path: &Path) -> Result<()> {
        writeln!(self, "wrote {}", path.display())
    }

    /// Passes on what is buffered.
    ///
    /// # Errors
    /// As [`Self::write_fmt`].
    pub fn flush(&mut self) -> Result<()> {
        self.0.flush().map_err(unwritten)
    }
}

fn unwritten(error: io::Error) -> Failure {
    Failure::other(format!("standard output: {error}"))
}
