//! `gshear-reduce`: reduces the runs of `gshear-mpi`. Parse, run, exit code.

use std::io::{BufWriter, stdout};
use std::process::ExitCode;

use clap::Parser;
use gshear::reduce::{Arguments, run};

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let code = run(&arguments, &mut BufWriter::new(stdout().lock())).unwrap_or_else(|failure| {
        eprintln!("error: {failure}");
        failure.exit_code()
    });
    ExitCode::from(code as u8)
}
