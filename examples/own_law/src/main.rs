//! `gshear-mpi` with one more law.

use std::process::ExitCode;

fn main() -> ExitCode {
    gshear_dem::laws::register(&[&own_law::KIND]);
    gshear_mpi::simulate(option_env!("OWN_LAW_COMMIT").unwrap_or("unknown"))
}
