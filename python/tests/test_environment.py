"""What a test finds does not depend on who runs it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from .environment import KEPT, SET

# OVITO sets them for itself when a test before this one imports it.
OF_OVITO = {"KMP_DUPLICATE_LIB_OK", "QT_PLUGIN_PATH", "QT_QPA_PLATFORM"}
# glibc keeps signals 32 and 33 for itself; no program can set them.
OF_GLIBC = 0b11 << 31
INNER = f"{Path(__file__).resolve()}::test_a_program_has_the_environment_of_the_tests"


def test_a_program_has_the_environment_of_the_tests() -> None:
    names = {name for name in os.environ if not name.startswith("PYTEST_")}
    assert names - KEPT - set(SET) - OF_OVITO == set()
    said = subprocess.run(
        ["sh", "-c", "umask; cat /proc/self/status"],  # noqa: S607
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert said.startswith("0022\n")
    ignored = re.search(r"SigIgn:\s*(\w+)", said)
    assert ignored
    assert int(ignored[1], 16) & ~OF_GLIBC == 0, ignored[1]


def test_whoever_runs_the_tests_finds_the_same() -> None:
    """As under `nohup`, in a job."""
    strange = {"COLUMNS": "20", "NO_COLOR": "1", "TERM": "strange", "RUST_BACKTRACE": "full"}
    strange |= {"SLURM_NTASKS": "4", "PMI_SIZE": "2", "GSHEAR_NO_SHARED_MEMORY": "1"}
    strange |= {"HDF5_DRIVER": "split", "OMPI_MCA_mpi_yield_when_idle": "0"}
    ignoring = 'trap \'\' HUP INT QUIT TERM USR1 USR2; umask 077; exec "$0" "$@"'
    pytest = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", INNER]
    done = subprocess.run(
        ["sh", "-c", ignoring, *pytest],  # noqa: S607
        env=os.environ | strange,
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
