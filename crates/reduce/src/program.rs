//! The program `gshear-reduce`: parses the command line, reduces runs of `gshear-mpi`, returns the
//! exit code.

use std::io::{self, BufWriter, ErrorKind, Write, stdout};
use std::os::unix::process::CommandExt;
use std::process::{self, ExitCode};

use clap::Parser;
use gshear_dem::failure::printable;
use gshear_driver::say::{say, say_error};
use gshear_driver::signals::outlive_full_files;
use gshear_driver::version;
use gshear_mpi_exchange::end_process;
use gshear_store::{h5, provenance};

use crate::commands::{Arguments, Command, run};

/// Standard output. What is written after the reader of a pipe has closed it, such as `head -1`, is
/// dropped: the command still writes its files and returns its exit code. Control characters are
/// escaped, unless the command draws on the terminal.
struct Output<W> {
    to: W,
    draws: bool,
}

impl<W: Write> Write for Output<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        let shown = if self.draws { text } else { printable(&text) };
        match self.to.write_all(shown.as_bytes()) {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e),
            _ => Ok(bytes.len()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self.to.flush() {
            Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
            other => other,
        }
    }
}

/// Starts the program again with a variable without which HDF5 does not open a file that a run
/// writes, because the run has locked it. Goes on without, if that fails.
fn start_again_without_locks() {
    const VARIABLE: &str = "HDF5_USE_FILE_LOCKING";
    if let (None, Ok(program)) = (std::env::var_os(VARIABLE), std::env::current_exe()) {
        let mut command = process::Command::new(program);
        command.args(std::env::args_os().skip(1));
        let _ = command.env(VARIABLE, "FALSE").exec();
    }
}

/// The program `gshear-reduce`, and of programs with laws of their own
/// ([`register`](gshear_dem::laws::register)). `commit` names the sources in what it writes.
pub fn reduce(commit: &'static str) -> ExitCode {
    provenance::set_git_commit(commit);
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(e) if e.kind() == clap::error::ErrorKind::DisplayVersion => {
            say(version::text_of_reducer().trim_end());
            return ExitCode::SUCCESS;
        }
        Err(e) => e.exit(),
    };
    start_again_without_locks();
    outlive_full_files();
    let mut output = BufWriter::new(Output {
        to: stdout().lock(),
        draws: matches!(arguments.command, Command::Watch { .. }),
    });
    let code = run(&arguments, &mut output).unwrap_or_else(|failure| {
        say_error(&format!("error: {failure}"));
        failure.exit_code()
    });
    if h5::is_left_open() {
        // When the process ends, HDF5 would try to close the file, and could crash.
        let _ = output.flush();
        end_process(code);
    }
    ExitCode::from(code as u8)
}
