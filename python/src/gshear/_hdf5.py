"""HDF5 files that another process may be writing."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from .errors import RunError

# The groups of a run.h5 with its later stages; the first one is in the root.
PARTS = ("aqs", "shear", "newtonian")
# A program that writes the file may be in the middle of a flush.
ATTEMPTS = 20
PAUSE = 0.1  # s
RECENT = 60.0  # s
# Bytes that deflate, the densest of the filters, makes of one at most.
DENSEST = 1032
# No file has groups within groups of as many levels.
DEEPEST = 8
# What h5py and NumPy raise where an object is not what a run has in its place.
UNSOUND = (
    *(AttributeError, IndexError, KeyError, OSError, OverflowError),
    *(RuntimeError, TypeError, ValueError),
)


def text(value: object) -> str:
    """Returns a text attribute, of fixed or variable length, as `str`."""
    return value.decode() if isinstance(value, bytes) else str(value)


def unit(item: h5py.Group | h5py.Dataset) -> str | None:
    """Returns the attribute `unit` of a dataset, or of the values of an H5MD element, if any."""
    if isinstance(item, h5py.Group):
        return unit(item["value"]) if "value" in item else None
    found = item.attrs.get("unit")
    return None if found is None else text(found)


def members(group: h5py.Group) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Yields the objects of a group; links elsewhere are none."""
    for name in group:
        if isinstance(group.get(name, getlink=True), h5py.HardLink):
            yield name, group[name]


def numbers(
    group: h5py.Group, name: str, axes: tuple[int, ...], kinds: str = "iuf"
) -> h5py.Dataset:
    """Returns a dataset of numbers.

    Args:
        group: Group of the dataset.
        name: Path from there.
        axes: How many axes it may have.
        kinds: Which numbers it may have, as NumPy's `dtype.kind`.

    Raises:
        KeyError: There is no such object.
        TypeError: It holds something else.
    """
    item = group[name]
    if not isinstance(item, h5py.Dataset) or item.shape is None or item.dtype.kind not in kinds:
        raise TypeError(f"{item.name} holds no {'integers' if 'f' not in kinds else 'numbers'}")
    if item.ndim not in axes:
        raise TypeError(f"{item.name} has {item.ndim} axes, not {' or '.join(map(str, axes))}")
    return item


def part_of(path: Path) -> tuple[Path, str]:
    """Returns the file and the group in it of a path such as `run.h5` or `run.h5/newtonian`."""
    is_part = path.name in PARTS and path.parent.is_file()
    return (path.parent, path.name) if is_part else (path, "/")


def group_of(file: h5py.File, group: str) -> h5py.Group:
    """Returns a group of a file; of one that holds one later stage alone, as a replay's, that.

    Raises:
        RunError: The file has no such group.
    """
    if group == "/" and "particles" not in file:
        group = next((part for part in PARTS if part in file), group)
    if group not in file:
        raise RunError(f"{file.filename}: has no later stage {group}")
    _check_runs(file)
    return file[group]


def _check_runs(file: h5py.File) -> None:
    """Raises RunError if stages of a file are of different runs."""
    parts = ["parameters", *(f"{group}/parameters" for group in PARTS)]
    attributes = [file[part].attrs for part in parts if part in file]
    runs = [text(of["run_id"]) for of in attributes if "run_id" in of]
    if len(set(runs)) > 1:
        raise RunError(
            f"{file.filename}: stages are of different runs (run_id {' and '.join(runs)})"
        )


def open_for_reading(path: Path) -> h5py.File:
    """Opens a file without locking it.

    HDF5 refuses this if the same process has it open with locks; then it is opened with locks.

    Raises:
        OSError: It cannot be opened, or an object in it, as in the middle of a flush.
        RunError: Its numbers are in other files, links lead to them, or it announces more than it
            can hold.
    """
    try:
        file = h5py.File(path, "r", locking=False)
    except OSError as error:
        if "locking flag" not in str(error):
            raise
        file = h5py.File(path, "r")
    try:
        found = _unsound(file, path.stat().st_size)
    except UNSOUND as error:
        file.close()
        raise OSError(f"{path}: {error}") from error
    if found is not None:
        file.close()
        raise RunError(f"{path}: {found}")
    return file


def _unsound(group: h5py.Group, size: int, levels: int = DEEPEST) -> str | None:
    """Returns what is wrong with an object below a group of a file of `size` bytes, if anything."""
    if levels == 0:
        return "is damaged: its groups contain each other"
    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            return f"{group.name.rstrip('/')}/{name} is in another file"
        if not isinstance(link, h5py.HardLink):
            continue
        item = group[name]
        found = None
        if isinstance(item, h5py.Dataset):
            found = _not_held(item, size)
        elif isinstance(item, h5py.Group):
            found = _unsound(item, size, levels - 1)
        if found is not None:
            return found
    return None


def _not_held(item: h5py.Dataset, size: int) -> str | None:
    """Returns what to say of a dataset that a file of `size` bytes cannot hold."""
    if item.external or item.is_virtual:
        return f"{item.name} is in another file"
    # Without numbers, it has no shape.
    announced = math.prod(item.shape or (0,)) * item.dtype.itemsize
    has_filters = item.id.get_create_plist().get_nfilters() > 0
    if announced <= size * (DENSEST if has_filters else 1):
        return None
    return f"is damaged: {item.name} announces {item.shape} values, more than the file can hold"


class SharedFile:
    """An HDF5 file, opened when first used and opened again when it has changed on disk.

    HDF5 keeps metadata of an open file in memory, so that frames written later would stay hidden.
    Files are opened without locks: the program that writes the file does not lock it, and locks
    fail on some network file systems.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._group = part_of(path)
        self._file: h5py.File | None = None
        self._signature: tuple[int, ...] = ()
        self._closed = False
        self.cache: dict[str, Any] = {}
        """What was read from the present state of the file; emptied when the file changes."""

    def open(self) -> h5py.Group:
        """Returns the open file, or its group if the path names one.

        Raises:
            RunError: The file cannot be opened, or has no such group.
            ValueError: The run is closed.
        """
        if self._closed:
            raise ValueError(f"{self.path}: the run is closed")
        for attempt in range(ATTEMPTS):
            try:
                signature = self.signature()
                if self._file is None or signature != self._signature:
                    self._release()
                    self._file = open_for_reading(self.path)
                    self._signature = signature
                return group_of(self._file, self._group)
            except RunError:
                raise
            except UNSOUND as error:
                self._release()
                absent = isinstance(error, FileNotFoundError)
                if absent or attempt + 1 == ATTEMPTS or not self.reopen_if_recent():
                    raise RunError(f"{self.path}: cannot be read: {error}") from error
        raise AssertionError("the last attempt returns or raises")

    def reopen_if_recent(self) -> bool:
        """Waits and opens the file again, if it was written less than a minute ago.

        Returns False if it was not, so that another attempt would find the same.
        """
        if time.time() - self.path.stat().st_mtime > RECENT:
            return False
        self._release()
        time.sleep(PAUSE)
        return True

    def signature(self) -> tuple[int, ...]:
        """Returns numbers that change when the file does."""
        status = self.path.stat()
        return (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)

    def close(self) -> None:
        """Closes the file for good."""
        self._release()
        self._closed = True

    def _release(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = None
        self.cache = {}
