"""Exceptions of the package."""

from __future__ import annotations

import shlex
from collections.abc import Sequence


class GshearError(Exception):
    """Base of the exceptions of this package."""


class RunError(GshearError):
    """A folder or file is no run, is damaged, or lacks what is asked for."""


class ProgramNotFoundError(GshearError):
    """gshear-mpi or gshear-reduce is not installed where this package looks for it."""


class ProgramFailedError(GshearError):
    """A program ended with an exit code other than 0.

    Attributes:
        command: Program and arguments.
        exit_code: See the table of exit codes in docs/running.md of gshear-mpi.
        output: What the program wrote to standard output and standard error.
    """

    def __init__(self, command: Sequence[str], exit_code: int, output: str) -> None:
        self.command = tuple(command)
        self.exit_code = exit_code
        self.output = output
        super().__init__(
            f"{shlex.join(command)} ended with exit code {exit_code}:\n{output.strip()}"
        )
