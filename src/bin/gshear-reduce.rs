//! `gshear-reduce`: the program with the laws of `gshear-dem`.

use std::process::ExitCode;

fn main() -> ExitCode {
    gshear_reduce::reduce(env!("GSHEAR_GIT_COMMIT"))
}
