"""Exceptions of the package."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Iterable, Sequence

# What papers and the programs' pictures call some columns.
SYMBOLS = {
    "tau": "stress_ratio",
    "mu": "stress_ratio",
    "phi": "solid_fraction",
    "gamma": "strain",
    "z": "coordination",
}


class GshearError(Exception):
    """Base of the exceptions of this package."""


class RunError(GshearError):
    """A folder or file is no run, is damaged, or lacks what is asked for."""


class NoSuchNameError(GshearError, KeyError):
    """There is no column or key of this name; the message has those that there are."""

    def __str__(self) -> str:
        # KeyError would quote it.
        return str(self.args[0])


def no_such(holder: str, kind: str, name: str, known: Iterable[object]) -> NoSuchNameError:
    """Returns what to raise at a name that is none of the known ones, with the nearest of them."""
    names = [str(each) for each in known]
    last = name.rpartition(".")[2]
    close = [own for own in [SYMBOLS.get(last.lower())] if own in names]
    close = close or difflib.get_close_matches(last, names, 1)
    hint = f": did you mean {close[0]!r}? It" if close else "; it"
    return NoSuchNameError(
        f"{holder} has no {kind} {name!r}{hint} has {', '.join(names) or 'none'}"
    )


class ProgramNotFoundError(GshearError):
    """gshear-mpi or gshear-reduce is not installed where this package looks for it."""


# What programs of the wheel, or MPI itself, say before they run, and what helps.
HINTS = {
    "libmpi.so.12: cannot open": "the programs of the wheel need the MPI that pip installs with "
    "them: pip install 'mpich>=5,<6', or put the lib of an MPI with the ABI of MPICH into "
    "LD_LIBRARY_PATH",
    "unsupported PMI version": "another MPI's mpiexec or srun started the program: take the "
    "bin/mpiexec of the environment that has the wheel, or set MPIRUN to it",
}


class ProgramFailedError(GshearError):
    """A program ended with an exit code other than 0.

    Attributes:
        command: Program and arguments.
        exit_code: See the table of exit codes in docs/howto/running.md of gshear-mpi.
        output: What the program wrote to standard output and standard error.
    """

    def __init__(self, command: Sequence[str], exit_code: int, output: str) -> None:
        self.command = tuple(command)
        self.exit_code = exit_code
        self.output = output
        hints = [f"\n{hint}" for said, hint in HINTS.items() if said in output]
        super().__init__(
            f"{shlex.join(command)} ended with exit code {exit_code}:\n{output.strip()}"
            f"{''.join(hints)}"
        )
