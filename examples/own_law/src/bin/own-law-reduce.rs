//! `gshear-reduce` for the runs of this program.

use std::process::ExitCode;

fn main() -> ExitCode {
    own_law::register();
    gshear_reduce::reduce(option_env!("OWN_LAW_COMMIT").unwrap_or("unknown"))
}
