//! `gshear-mpi` with one more law and one more adhesion.

use std::process::ExitCode;

fn main() -> ExitCode {
    own_law::register();
    gshear_mpi::simulate(option_env!("OWN_LAW_COMMIT").unwrap_or("unknown"))
}
