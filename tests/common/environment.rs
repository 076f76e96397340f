//! The one place where tests start programs: with the same environment, working directory and
//! signals, whoever runs the tests.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Once, OnceLock};

/// Variables of the caller that programs get: where programs, libraries and temporary files are.
const PASSED_ON: [&str; 4] = ["PATH", "LD_LIBRARY_PATH", "OPAL_PREFIX", "TMPDIR"];

/// The other variables of every program. Each is read by Open MPI; other programs ignore them.
const SET: [(&str, &str); 8] = [
    // mpirun wants to be told twice that root is meant, as in a container.
    ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
    ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
    // More ranks than cores are slow, but right.
    ("OMPI_MCA_rmaps_base_oversubscribe", "1"),
    ("OMPI_MCA_hwloc_base_binding_policy", "none"),
    // Tests start thousands of ranks on one node: the libraries of networks and graphics take a
    // fifth of a start.
    ("OMPI_MCA_pml", "ob1"),
    ("OMPI_MCA_btl", "self,vader"),
    (
        "HWLOC_COMPONENTS",
        "-gl,-opencl,-cuda,-nvml,-pci,-levelzero,-rsmi",
    ),
    // mpirun would give ranks two seconds after an exit code other than 0, as of a stop at a
    // checkpoint.
    ("OMPI_MCA_odls_base_sigkill_timeout", "0"),
];

/// A program with nothing of the caller but [`PASSED_ON`]: no other variable, not the working
/// directory, in which `out/` may hold runs, and no ignored signal, as under `nohup`.
pub fn start(program: impl AsRef<Path>) -> Command {
    restore_signals();
    let mut command = Command::new(program.as_ref());
    command.env_clear().envs(SET);
    command.envs(
        PASSED_ON
            .iter()
            .filter_map(|&name| Some((name, std::env::var_os(name)?))),
    );
    // Settings of git and of Open MPI would be found there.
    command.env("HOME", empty_folder());
    command.current_dir(empty_folder());
    command
}

/// The working directory of every program. No test writes there.
pub fn empty_folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let name = concat!("empty-for-", env!("CARGO_CRATE_NAME"));
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        std::fs::create_dir_all(&folder).expect("a folder");
        folder
    })
}

/// Signals that glibc keeps for its threads. Programs that `posix_spawn` starts, as cargo does,
/// ignore the second one.
const OF_THE_C_LIBRARY: Range<i32> = 32..34;

/// Gives each signal that this process ignores a handler, which does nothing either. A started
/// program inherits an ignored signal, but not a handler.
fn restore_signals() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let status = std::fs::read_to_string("/proc/self/status").expect("a process");
        for signal in ignored_in(&status) {
            // Rust restores SIGPIPE itself. Some signals take no handler.
            if signal != signal_hook::consts::SIGPIPE
                && !signal_hook::consts::FORBIDDEN.contains(&signal)
            {
                signal_hook::flag::register(signal, Arc::default()).expect("a handler");
            }
        }
    });
}

/// The signals in the line `SigIgn` of a `status` file that a program can know of.
pub fn ignored_in(status: &str) -> Vec<i32> {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = u64::from_str_radix(mask.expect("a mask").trim(), 16).expect("hexadecimal digits");
    (1..=64)
        .filter(|signal| mask >> (signal - 1) & 1 == 1 && !OF_THE_C_LIBRARY.contains(signal))
        .collect()
}
