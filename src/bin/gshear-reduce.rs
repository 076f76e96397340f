//! `gshear-reduce`: parses the command line, reduces runs of `gshear-mpi`, returns the exit code.

use std::io::{BufWriter, stdout};
use std::process::ExitCode;

use clap::Parser;
use gshear_reduce::{Arguments, run};
use gshear_store::provenance;

fn main() -> ExitCode {
    provenance::set_git_commit(env!("GSHEAR_GIT_COMMIT"));
    let arguments = Arguments::parse();
    let code = run(&arguments, &mut BufWriter::new(stdout().lock())).unwrap_or_else(|failure| {
        eprintln!("error: {failure}");
        failure.exit_code()
    });
    ExitCode::from(code as u8)
}
