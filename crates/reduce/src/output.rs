//! Standard output that cannot be written.

use gshear_dem::failure::Failure;

/// Returns the failure of output that could not be written to a terminal or a pipe.
pub fn cannot_write(error: std::io::Error) -> Failure {
    Failure::other(format!("standard output: {error}"))
}
