//! `gshear-mpi` with one more law, one more adhesion and one more observable.

use std::process::ExitCode;

fn main() -> ExitCode {
    own_law::register();
    gshear_mpi::simulate(option_env!("OWN_LAW_COMMIT").unwrap_or("unknown"))
}
