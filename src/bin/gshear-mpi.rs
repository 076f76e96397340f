//! `gshear-mpi`: the program with the laws of `gshear-dem`.

use std::process::ExitCode;

fn main() -> ExitCode {
    gshear_mpi::simulate(env!("GSHEAR_GIT_COMMIT"))
}
