"""The environment of the tests, and of every program that they start, whoever runs them."""

from __future__ import annotations

import os
import signal

# Where programs and files are, and which of them are meant.
KEPT = {
    *("PATH", "HOME", "USER", "LD_LIBRARY_PATH", "OPAL_PREFIX", "TMPDIR", "XDG_CACHE_HOME"),
    *("GSHEAR_MPI", "GSHEAR_REDUCE", "MPIRUN", "CARGO_HOME", "RUSTUP_HOME", "ALL_SHELLS"),
}
# Tests start many ranks on one node, where the libraries of networks and graphics take time.
# mpirun would give ranks two seconds after an exit code other than 0, as of a stop.
SET = {
    "OMPI_MCA_pml": "ob1",
    "OMPI_MCA_btl": "self,vader",
    "OMPI_MCA_odls_base_sigkill_timeout": "0",
    "HWLOC_COMPONENTS": "-gl,-opencl,-cuda,-nvml,-pci,-levelzero,-rsmi",
}


def restore() -> None:
    """Takes the caller's variables, umask and ignored signals, as of `nohup`, away."""
    for name in list(os.environ):
        if name not in KEPT and not name.startswith("PYTEST_"):
            del os.environ[name]
    os.environ.update(SET)
    os.umask(0o022)
    for number in signal.valid_signals():
        # Python restores SIGPIPE and SIGXFSZ in what it starts.
        restored = number in (signal.SIGPIPE, signal.SIGXFSZ)
        if not restored and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
