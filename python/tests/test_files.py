"""Files that the package writes, and those that it refuses to read."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import h5py
import pytest

from gshear import Run, RunError
from gshear._files import write


def test_a_file_is_whole_or_as_before(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write(path, "before")
    umask = os.umask(0)
    os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~umask
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    # As on a full disk: the system refuses what is beyond, and Python ignores the signal.
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(OSError, match=r"table\.csv"):
            write(path, "x" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    def half(file: BinaryIO) -> None:
        file.write(b"half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write(path, half)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
    # A link is replaced, not followed.
    other = tmp_path / "other"
    other.write_text("mine")
    path.unlink()
    path.symlink_to(other)
    write(path, "after")
    assert other.read_text() == "mine"
    assert path.read_text() == "after"
    assert not path.is_symlink()


def test_parts_of_different_runs_are_refused(copy: Callable[[str], Path]) -> None:
    folder = copy("box")
    with h5py.File(folder / "run.h5", "r+") as file:
        file["newtonian/parameters"].attrs["run_id"] = "0" * 32
    for path in (folder, folder / "run.h5/newtonian"):
        with Run(path, quiet=True) as run, pytest.raises(RunError, match="different runs"):
            _ = run.parameters
