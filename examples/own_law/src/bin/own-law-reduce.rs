//! `gshear-reduce` for the runs of this program.

use std::process::ExitCode;

fn main() -> ExitCode {
    gshear_dem::laws::register(&[&own_law::KIND]);
    gshear_reduce::reduce(option_env!("OWN_LAW_COMMIT").unwrap_or("unknown"))
}
