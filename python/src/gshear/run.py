"""Runs of gshear-mpi."""

from __future__ import annotations

import contextlib
import json
import operator
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex, TypeVar, overload

import h5py
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from . import _hdf5, _status, programs
from ._hdf5 import SharedFile
from .box import Box
from .errors import RunError
from .frames import Contacts, Frame, WallContacts
from .means import TimeMean, durations, time_mean
from .scene import Scene
from .tables import column_units, complete_lines, read_csv, with_units

if TYPE_CHECKING:
    import xarray as xr

T = TypeVar("T")

# The file of frames and time series.
FILE = "run.h5"
# Ratios of two columns, either of which may pass zero: their means are ratios of means.
RATIOS = {"stress_ratio": ("shear_force", "normal_force")}
# Whether the lower and the upper end of a sample is a rigid plane, by its boundary.
PLANES = {
    "flat walls": (True, True),
    "flat top": (False, True),
    "free surface above a plane": (True, False),
}
# Of eigenvectors, as `spectrum.h5` numbers them.
COMPONENTS = ("x", "y", "z", "rotation_x", "rotation_y", "rotation_z")
GRAINS = "particles/trajectory"
CONTACTS = "connectivity/contacts"
WALL_CONTACTS = "connectivity/wall_contacts"


class _DminReading(NamedTuple):
    """How D²min is read: the options of `gshear-reduce dmin`."""

    radius: float
    lag: int
    rattlers: str

    @property
    def options(self) -> list[str]:
        lag = [] if self.lag == 1 else ["--lag", str(self.lag)]
        rattlers = [] if self.rattlers == "lee-hurley" else ["--rattlers", self.rattlers]
        return ["--radius", repr(self.radius), *lag, *rattlers]

    @property
    def folder(self) -> str:
        """The folder of results that are not those of `reduced.h5`."""
        lag = "" if self.lag == 1 else f"-lag-{self.lag}"
        rattlers = "" if self.rattlers == "lee-hurley" else f"-{self.rattlers}"
        return f"dmin-{self.radius:g}{lag}{rattlers}"


class _Contacts(NamedTuple):
    """Contacts of one kind in all frames of a file."""

    columns: dict[str, h5py.Dataset]  # [K, …] over all frames
    offset: NDArray[np.int64]  # [T + 1], rows of the first contacts of the frames

    @property
    def frames(self) -> int:
        """The number of frames whose contacts every column has."""
        rows = min((len(column) for column in self.columns.values()), default=0)
        return max(0, int(np.searchsorted(self.offset, rows, side="right")) - 1)


class _Stored(NamedTuple):
    """The frames of a file: datasets, which stay open until the file changes, and small arrays."""

    constants: dict[str, h5py.Dataset]  # [N], the same in every frame
    grains: dict[str, h5py.Dataset]  # [T, N, …]
    contacts: _Contacts
    wall_contacts: _Contacts  # without columns if there are no flat walls
    units: dict[str, str]  # by column
    step: NDArray[np.uint64]  # [T]
    time: NDArray[np.float64]  # [T]
    edges: NDArray[np.float64]  # [T, 3] or [T, 3, 3]
    periodic: tuple[bool, bool, bool]


class Observable(NamedTuple):
    """A column of the time series that the scene declares."""

    name: str
    unit: str  # as the scene gives it; "1" without a unit
    definition: str


class Run:
    """A run: frames and time series of a `run.h5`.

    Arrays are read when they are used. A run that is under way can be read: what it writes later is
    seen by the next access. Results of `gshear-reduce` are read from its files; if they are missing
    or older than the run, gshear-reduce is run first, and the command is printed.

    Use it in a `with` statement, or call `close`.

    Args:
        path: Folder of a run, or its `run.h5`: its first stage, a shear or strain steps. `part`, or
            a path such as `run.h5/newtonian`, has a later one.
        results: Folder for what gshear-reduce writes, for runs in folders that cannot be written.
            Default: that of the run.
        quiet: Do not print the commands that are run.

    Attributes:
        path: The HDF5 file, or the part of it, such as `run.h5/newtonian`.
        folder: The folder of the file.
        results: Folder for what gshear-reduce writes.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        results: str | os.PathLike[str] | None = None,
        quiet: bool = False,
    ) -> None:
        self._name = _file_of(Path(path))
        self.path = self._name.absolute()
        self.folder = _hdf5.part_of(self.path)[0].parent
        self.results = self.folder if results is None else Path(results).absolute()
        self.quiet = quiet
        self._file = SharedFile(self.path)

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file. Arrays that were read stay valid; reading more raises ValueError."""
        self._file.close()

    def __repr__(self) -> str:
        return f"<Run {self._name}: {len(self.frames)} frames, {len(self.series)} rows>"

    @property
    def hdf5(self) -> h5py.Group:
        """The open file, or the group of its part, for what this class does not read.

        Do not close it, do not keep it.
        """
        return self._file.open()

    @property
    def stage(self) -> str:
        """`shear`, `aqs` (strain steps) or `newtonian` (Newton's equations after them)."""
        columns = self._series_units()
        if "stress_ratio" in columns:  # beside which a scene may declare any others
            return "shear"
        return (
            "newtonian" if "msd" in columns else "aqs" if "factorisations" in columns else "shear"
        )

    @property
    def newtonian(self) -> Run | None:
        """What followed the strain steps by Newton's equations; None without.

        Each use opens the file: close it, too.
        """
        return self.part("newtonian")

    def part(self, stage: str) -> Run | None:
        """A later stage of the run: `aqs`, `shear` or `newtonian`; None without.

        Each use opens the file: close it, too.

        Raises:
            ValueError: No stage has this name.
        """
        if stage not in _hdf5.PARTS:
            names = ", ".join(_hdf5.PARTS)
            raise ValueError(f"a later stage is one of {names}, not {stage!r}")
        if stage not in self.hdf5.file:
            return None
        path = _hdf5.part_of(self._name)[0] / stage
        return Run(path, results=self.results, quiet=self.quiet)

    # What the file says of the run

    @property
    def scene(self) -> Scene:
        """The checked scene, every default filled in."""
        return self._once("scene", lambda file: Scene(file["parameters"].attrs["scene"]))

    @property
    def parameters(self) -> dict[str, Any]:
        """Attributes of the group `parameters`: identity, provenance and derived quantities."""

        def read(file: h5py.Group) -> dict[str, Any]:
            attributes = file["parameters"].attrs
            return {name: _python(attributes[name]) for name in attributes}

        return dict(self._once("parameters", read))

    @property
    def finished(self) -> bool:
        """Whether the run has ended by itself; if not, it is under way or was stopped."""
        return bool(self.parameters.get("digest"))

    @property
    def state(self) -> str:
        """What has become of the run, as `gshear-reduce info` says.

        `running`, `killed` (its process is gone), `stopped` (at a checkpoint before its end),
        `finished`, `failed` (`failure` says why), or `unfinished` if no `status.json` tells.
        """
        return self._condition()[0]

    @property
    def failure(self) -> str | None:
        """Why the run failed; None unless it did."""
        return self._condition()[1]

    def _condition(self) -> tuple[str, str | None]:
        run_id = str(self.parameters.get("run_id", ""))
        return _status.condition(self.folder, run_id, finished=self.finished)

    @property
    def dimension(self) -> int:
        """2 for disks, 3 for spheres."""

        def read(file: h5py.Group) -> int:
            dimension = int(file["parameters"].attrs["dimension"])
            if dimension not in (2, 3):
                raise ValueError(f"the dimension is {dimension}")
            return dimension

        return self._once("dimension", read)

    @property
    def boundary(self) -> str | None:
        """What bounds the sample along its last axis, as the program wrote it.

        `rough walls`, `flat walls`, `flat top`, `free surface`, `free surface above a plane` or
        `periodic`; None in files of earlier versions.
        """
        stored = self.parameters.get("boundary")
        return None if stored is None else str(stored)

    @property
    def series(self) -> pd.DataFrame:
        """The time series, one line per row, with `step`, `time` and the columns of the file.

        `series.attrs["units"]` has the units by column, as the file has them; pure numbers have
        none. Columns that the scene declares (`[[observable]]`) come last; `observables` describes
        them. While a run between walls is under way, the values come from `log.csv`, which is
        written row by row, unless `output.columns` has chosen some of its columns.
        """
        log = self.folder / "log.csv"
        is_whole = "output.columns" not in self.scene
        if self.stage == "shear" and log.is_file() and is_whole and not self.finished:
            units = {name: unit for name, unit in self._series_units().items() if unit}
            table = complete_lines(log)
            if missing := [name for name in units if len(table) and name not in table]:
                raise RunError(f"{log}: is damaged, or of another run: has no {missing[0]}")
            return with_units(table, units)
        stored: pd.DataFrame = self._once("series", self._read_series)
        return with_units(stored.copy(), stored.attrs["units"])

    @property
    def observables(self) -> list[Observable]:
        """The columns of `series` that the scene declares, in their order; empty without any."""

        def read(file: h5py.Group) -> list[Observable]:
            stored = file["parameters"].attrs.get("observables")
            if stored is None:
                return []
            return [Observable(**column) for column in json.loads(_python(stored))]

        return list(self._once("observables", read))

    def mean(self, column: str, *, start: float = 0.5) -> TimeMean:
        """Returns the mean of a column of the time series over the later rows, with its error.

            tau, error, deviation = run.mean("stress_ratio")

        Of `stress_ratio` that is ⟨S⟩/⟨N⟩. Rows weigh by their time; `analysis.time_mean` has the
        method of the standard error, which knows that rows are correlated.

        Args:
            column: A column of `series`.
            start: The share of the rows, from the first on, that is left out.

        Raises:
            RunError: There is no such column.
            ValueError: A wrong share.
        """
        return mean_of(self.series, column, start=start, path=self.path)

    def _read_series(self, file: h5py.Group) -> pd.DataFrame:
        elements = _series_elements(file)
        # H5MD sorts names; the log has the order of the declaration.
        log = self.folder / "log.csv"
        if self.stage == "shear" and log.is_file():
            with log.open(encoding="utf-8", errors="replace") as file_of_log:
                order = file_of_log.readline().strip().split(",")
            elements = {
                name: elements[name]
                for name in sorted(elements, key=lambda n: order.index(n) if n in order else -1)
            }
        own = [observable.name for observable in self.observables]
        elements = {
            name: elements[name]
            for name in [*(n for n in elements if n not in own), *(n for n in own if n in elements)]
        }
        columns: dict[str, Any] = {}
        for name, element in elements.items():
            if not columns:
                columns = {"step": _hdf5.numbers(element, "step", (1,), "iu")[:]}
                columns["time"] = _hdf5.numbers(element, "time", (1,))[:]
            columns[name] = _hdf5.numbers(element, "value", (1,))[:]
        # The program may be adding rows to one column after the other.
        rows = min((len(column) for column in columns.values()), default=0)
        table = pd.DataFrame({name: column[:rows] for name, column in columns.items()})
        table.attrs["units"] = {n: u for n, u in self._series_units().items() if u is not None}
        return table

    def _series_units(self) -> dict[str, str | None]:
        def read(file: h5py.Group) -> dict[str, str | None]:
            items = _series_elements(file)
            units = {name: _hdf5.unit(item) for name, item in items.items()}
            for item in list(items.values())[:1]:
                units |= {"step": _hdf5.unit(item["step"]), "time": _hdf5.unit(item["time"])}
            return units

        found: dict[str, str | None] = self._once("series units", read)
        return found

    @property
    def units(self) -> dict[str, str]:
        """Units of length and force that follow from the time series: empty in reduced units."""
        series = self._series_units()
        known = {"length": series.get("wall_height"), "force": series.get("normal_force")}
        return {name: unit for name, unit in known.items() if unit}

    # Frames

    @property
    def frames(self) -> Frames:
        """The frames: steps, times and strains; `frames[i]`, `frames[a:b]`, iteration."""
        return Frames(self)

    @overload
    def frame(self, index: SupportsIndex) -> Frame: ...
    @overload
    def frame(self, index: slice) -> Iterator[Frame]: ...
    def frame(self, index: SupportsIndex | slice) -> Frame | Iterator[Frame]:
        """Returns a frame, from the end if `index` is negative, or an iterator over a slice."""
        return self.frames[index]

    @overload
    def contacts(self, index: SupportsIndex) -> Contacts: ...
    @overload
    def contacts(self, index: slice) -> Iterator[Contacts]: ...
    def contacts(self, index: SupportsIndex | slice) -> Contacts | Iterator[Contacts]:
        """Returns the contacts of a frame, or an iterator over those of a slice."""
        if isinstance(index, slice):
            return (frame.contacts for frame in self.frames[index])
        return self.frames[index].contacts

    @overload
    def wall_contacts(self, index: SupportsIndex) -> WallContacts: ...
    @overload
    def wall_contacts(self, index: slice) -> Iterator[WallContacts]: ...
    def wall_contacts(self, index: SupportsIndex | slice) -> WallContacts | Iterator[WallContacts]:
        """Returns the contacts with flat walls of a frame, or an iterator over those of a slice."""
        if isinstance(index, slice):
            return (frame.wall_contacts for frame in self.frames[index])
        return self.frames[index].wall_contacts

    def array(self, name: str, frames: slice | ArrayLike = slice(None)) -> Any:  # noqa: ANN401
        """Returns a quantity of many frames at once, read in as few pieces as possible.

            x = run.array("position")                        # [T, N, 3]
            force = run.array("normal_force", range(0, 1000, 10))
            np.concatenate(force).mean()

        Args:
            name: A column of `Frame` or `Contacts`; `unwrapped`, positions that move without jumps
                (m); or `edges` of the box, as in the file.
            frames: A slice, or the numbers of frames: one, a range, a list, an array, or a mask
                [T] of booleans. They may be negative and in any order. Default: all frames.

        Returns:
            Of grains [frames, N, …]; of `edges` [frames, 3] between walls, [frames, 3, 3] in a
            periodic box, an edge vector in each row. Of contacts, whose number varies, a list with
            an array [K, …] for each frame. Without the first axis, or the list, for one number. A
            column that is the same in every frame, such as `radius`, is [N].

        Raises:
            RunError: There is no such quantity.
            IndexError: There is no such frame.
            TypeError: `frames` are not numbers of frames.
        """
        stored = self._stored
        if not isinstance(frames, slice) and np.ndim(frames) == 0:
            found = self.array(name, np.asarray(frames)[None])
            return found if name in stored.constants else found[0]
        rows = _selected(frames, len(stored.step), self.path)
        if name in stored.constants:
            return self._values(lambda now: now.constants[name][:])
        if name in stored.grains:
            return self._values(lambda now: _read(now.grains[name], rows, rows + 1))
        if name in stored.contacts.columns:
            offset = stored.contacts.offset
            first, last = offset[rows], offset[rows + 1]
            values = self._values(lambda now: _read(now.contacts.columns[name], first, last))
            ends = np.cumsum(last - first)
            return [values[a:b] for a, b in zip(ends - (last - first), ends, strict=True)]
        if name == "edges":
            return stored.edges[rows]
        if name == "unwrapped":
            edges = stored.edges[rows]
            vectors = edges if edges.ndim == 3 else edges[:, None, :] * np.eye(3)
            return self.array("position", rows) + self.array("image", rows) @ vectors
        known = ", ".join([*stored.constants, *stored.grains, *stored.contacts.columns])
        raise RunError(f"{self.path}: frames have no {name!r}: give {known}, unwrapped or edges")

    def _frame(self, index: int, frames: Frames) -> Frame:
        stored = self._stored

        def read_grains(name: str) -> NDArray[Any]:
            if name in stored.constants:
                return self._values(lambda now: now.constants[name][:])
            return self._values(lambda now: now.grains[name][index])

        def rows(contacts: _Contacts) -> slice:
            return slice(*(int(row) for row in contacts.offset[index : index + 2]))

        def checked(group: str, name: str, values: NDArray[Any]) -> NDArray[Any]:
            if name in ("i", "j") and values.max(initial=0) >= self._grains():
                raise self._damaged(f"{group}/{name} has grains that there are not")
            return values

        def read_contacts(name: str) -> NDArray[Any]:
            now = self._values(lambda now: now.contacts.columns[name][rows(stored.contacts)])
            return checked(CONTACTS, name, now)

        def read_wall_contacts(name: str) -> NDArray[Any]:
            place = rows(stored.wall_contacts)
            now = self._values(lambda now: now.wall_contacts.columns[name][place])
            return checked(WALL_CONTACTS, name, now)

        def contacts_of(frame: Frame) -> Contacts:
            place = rows(stored.contacts)
            names = tuple(stored.contacts.columns)
            return Contacts(names, read_contacts, units, frame, place.stop - place.start)

        def wall_contacts_of(frame: Frame) -> WallContacts:
            names = tuple(stored.wall_contacts.columns)
            if not names:
                return _no_wall_contacts(stored, frame)
            place = rows(stored.wall_contacts)
            return WallContacts(names, read_wall_contacts, units, frame, place.stop - place.start)

        units = stored.units
        return Frame(
            (*stored.constants, *stored.grains),
            read_grains,
            units,
            index=index,
            step=int(frames.step[index]),
            time=float(frames.time[index]),
            strain=float(frames.strain[index]),
            dimension=self.dimension,
            pair_friction=self._once("friction", lambda _: _pair_friction(self.scene)),
            attracts=self._once("attraction", lambda _: _attracts(self.scene)),
            box=self._box(stored, index, frames),
            contacts=contacts_of,
            wall_contacts=wall_contacts_of,
        )

    @property
    def _stored(self) -> _Stored:
        """The complete frames of the present state of the file."""

        def read(file: h5py.Group) -> _Stored:
            group, numbers = file[GRAINS], _hdf5.numbers
            items = dict(_hdf5.members(group))
            constants = {
                name: numbers(group, name, (1,))
                for name, item in items.items()
                if isinstance(item, h5py.Dataset)
            }
            grains = {
                name: numbers(group, f"{name}/value", (2, 3))
                for name, item in items.items()
                if name not in constants and "value" in item
            }
            contacts = _contacts(file, CONTACTS)
            has_walls = WALL_CONTACTS in file
            wall_contacts = _contacts(file, WALL_CONTACTS) if has_walls else _Contacts({}, NONE)
            _check_columns(constants, grains, contacts.columns)
            box, clock = group["box"], group["position"]
            edges = numbers(box, "edges/value", (2, 3))
            if edges.shape[1:] not in ((3,), (3, 3)):
                raise ValueError(f"{edges.name} has the shape {edges.shape}")
            steps, times = numbers(clock, "step", (1,), "iu"), numbers(clock, "time", (1,))
            # The program may be writing a frame: all of it must be there.
            count = min(len(item) for item in (*grains.values(), steps, times, edges))
            count = min([count, contacts.frames, *([wall_contacts.frames] if has_walls else [])])
            named = (constants | grains | contacts.columns).items()
            units = {name: unit for name, item in named if (unit := _hdf5.unit(item))}
            x, y, z = (_hdf5.text(value) == "periodic" for value in box.attrs["boundary"])
            return _Stored(
                constants,
                grains,
                contacts,
                wall_contacts,
                units,
                steps[:count],
                times[:count],
                edges[:count],
                (x, y, z),
            )

        stored: _Stored = self._once("frames", read)
        return stored

    def _strains(self, step: NDArray[Any]) -> NDArray[np.float64]:
        """Returns γ of the first frames, whose steps are given, [T]."""
        name = f"strains of {len(step)} frames"
        return self._once(name, lambda file: self._strain_at(file, step))

    def _strain_at(self, file: h5py.Group, step: NDArray[Any]) -> NDArray[np.float64]:
        """Returns γ at steps: that of a row of the series, or linear between and beyond rows."""
        if "strain" not in file["observables"]:
            # Newton's equations in a box, which is not sheared meanwhile.
            return np.full(len(step), float(file["parameters"].attrs.get("strain", np.nan)))
        series = self.series
        rows = series["step"].to_numpy(dtype=np.float64)
        strains = series["strain"].to_numpy()
        if not (np.diff(rows) > 0).all():
            raise ValueError("the steps of the time series do not rise")
        if len(rows) == 0:
            return np.where(step == 0, 0.0, np.nan)
        if len(rows) == 1:
            return np.where(step == rows[0], strains[0], np.nan)
        # The first row of a branch is one interval after its checkpoint.
        before = _line(rows[:2], strains[:2], step)
        after = _line(rows[-2:], strains[-2:], step)
        between: NDArray[np.float64] = np.interp(step, rows, strains)
        return np.where(step < rows[0], before, np.where(step > rows[-1], after, between))

    def _box(self, stored: _Stored, index: int, frames: Frames) -> Box:
        edges, gradient, offset = stored.edges[index], self.dimension - 1, 0.0
        if edges.ndim == 2:
            # A tilted cell: the edge along the gradient leans along x.
            offset, edges = float(edges[gradient, 0]), np.diagonal(edges)
        name = f"periods of {len(frames)} frames"
        periods = self._once(name, lambda file: self._offset_periods(file, stored, frames))
        planes = PLANES.get(self.boundary or "", (False, False))
        return Box(edges.copy(), stored.periodic, gradient, offset, int(periods[index]), planes)

    def _offset_periods(
        self, file: h5py.Group, stored: _Stored, frames: Frames
    ) -> NDArray[np.int64]:
        """Returns how many periods Lees–Edwards offsets lack since the first frame, [T]."""
        count = len(frames)
        if stored.edges.ndim == 2 or count == 0:
            return np.zeros(count, dtype=np.int64)
        offset, period = (stored.edges[:count, self.dimension - 1, 0], stored.edges[:count, 0, 0])
        if self.stage == "shear":
            whole = frames.strain * float(file["parameters"].attrs["height_start"])
            lacking = np.nan_to_num((whole - offset) / period[0])
        elif self.stage == "aqs":
            # Each strain step has a row, and adds less than half a period.
            rows = self.series["image_offset"].to_numpy()
            before = np.searchsorted(self.series["step"], frames.step)
            jumps = np.append(0.0, np.cumsum(np.rint(-np.diff(rows) / period[0])))
            lacking = jumps[np.minimum(before, len(jumps) - 1)]
        else:
            lacking = np.zeros(count)
        periods: NDArray[np.int64] = np.rint(lacking - lacking[0]).astype(np.int64)
        return periods

    # Results of gshear-reduce

    def phases(self) -> pd.DataFrame:
        """Returns the stick and slip phases of τ, one line per phase (`phases.csv`).

        `docs/explanation/reduction.md` defines phases, `docs/reference/file-formats.md` the
        columns. Rows are those of `series`.
        """
        return self._table("phases.csv", ["phases"], self._are_phases)

    def drops(self, count: int | None = None) -> pd.DataFrame:
        """Returns the slip phases, largest drop of τ first, with the columns of `phases`.

        Args:
            count: At most so many.

        Raises:
            ValueError: `count` is negative.
        """
        if count is not None and operator.index(count) < 0:
            raise ValueError(f"count is {count}; give 0 or more")
        phases = self.phases()
        slips = phases[phases["kind"] == "slip"]
        drops = slips.sort_values("delta_tau_p", kind="stable", ignore_index=True)
        return drops if count is None else drops.head(count)

    def regions(self) -> pd.DataFrame:
        """Returns the scalars of every frame between walls (`regions.csv`)."""
        table = self._table("regions.csv", ["regions"], self._are_regions)
        return with_units(table, self._scalar_units())

    def measures(self) -> pd.DataFrame:
        """Returns the statistics of every phase between walls (`measures.csv` of `correlate`)."""
        return self._table("measures.csv", ["correlate"], self._are_measures)

    def correlations(self) -> pd.DataFrame:
        """Returns Spearman's ρ in ranges of the change of τ (`correlations.csv` of `correlate`).

        A table that `gshear-reduce correlate` made with other options, such as `--from`, is read.
        """
        self.measures()
        return self._table("correlations.csv", ["correlate"], lambda _: True)

    def events(self) -> pd.DataFrame:
        """Returns the events of the run, one line each (`events.csv` of gshear-reduce).

        Events are clusters of grains with a great D²min in space and time (Falk & Langer, Phys.
        Rev. E 57, 7192, 1998), as of elastoplastic models (Nicolas et al., Rev. Mod. Phys. 90,
        045006, 2018): start and end, place, size, strain and stress drop.
        `docs/explanation/events.md` says how they are found; units are in `attrs["units"]`. A table
        that `gshear-reduce events` made with other options, such as `--threshold`, is read.

            events = run.events()
            analysis.event_exponents(events)
        """
        return self._described("events.csv", self._are_events)

    def event_grains(self) -> pd.DataFrame:
        """Returns the active grains of the events of `events`, interval by interval."""
        self.events()
        return self._described("events-grains.csv", self._are_active_grains)

    def propagator(self) -> pd.DataFrame:
        """Returns the harmonics of the mean displacement and the mean stress around an event.

        Picard et al., Eur. Phys. J. E 15, 371 (2004); `docs/explanation/events.md` describes the
        columns. Displacements are in m, changes of stress in Pa.
        """
        self.events()
        return self._described("events-propagator.csv", lambda _: True)

    def event_pairs(self) -> pd.DataFrame:
        """Returns pairs of events by their distance in time and space, beside independent ones."""
        self.events()
        return self._described("events-pairs.csv", lambda _: True)

    def dmin(
        self,
        index: SupportsIndex | slice,
        *,
        radius: float = 5.0,
        lag: int = 1,
        rattlers: str = "lee-hurley",
    ) -> NDArray[np.float64]:
        """Returns D²min of the grains between an earlier frame and frame `index` (m²).

        Lee & Hurley, equations B1 to B4 (Falk & Langer 1998); `docs/explanation/reduction.md` has
        the details. NaN without an earlier frame, for rattlers of that frame, and where D²min is
        undefined.

        Args:
            index: Frame, or slice of frames.
            radius: Radius of the neighbourhood over the mean radius. What differs from `reduced.h5`
                in one of these options is computed into a folder of its own.
            lag: Number of frames from the earlier one on.
            rattlers: Which grains are left out: those of Lee & Hurley; `balance`, grains with too
                few contacts to be in balance, as `analysis.rattlers` finds them; or `none`.

        Returns:
            [N], by id; of a slice [frames, N].
        """
        frames = len(self.frames)
        if not isinstance(index, slice):
            index = _position(index, frames, self.path)
        reading = _DminReading(float(radius), operator.index(lag), rattlers)
        path = self.results / "reduced.h5"
        if not self._is_dmin(path, reading):
            if self._is_dmin(path, None):
                path = self.results / reading.folder / "reduced.h5"
            if not self._is_dmin(path, reading):
                self._reduce(["dmin", *reading.options], path.parent)
        try:
            with _hdf5.open_for_reading(path) as file:
                stored = _hdf5.numbers(file, "dmin/value", (2,))
                if isinstance(index, slice) and (rows := range(frames)[index]).step < 0:
                    # HDF5 reads forwards.
                    forwards = slice(rows[-1], rows[0] + 1, -rows.step) if rows else slice(0)
                    backwards: NDArray[np.float64] = stored[forwards][::-1]
                    return backwards
                values: NDArray[np.float64] = stored[index]
                return values
        except _hdf5.UNSOUND as error:
            raise RunError(f"{path}: is damaged; remove it: {error}") from error

    def _grains(self) -> int:
        return int(self._once("grains", lambda file: len(file[GRAINS]["id"])))

    def _is_dmin(self, path: Path, reading: _DminReading | None) -> bool:
        """Whether `path` has D²min of this run, as it is read unless that is None."""
        if not self._is_newer(path):
            return False
        try:
            with _hdf5.open_for_reading(path) as file:
                attributes = file.attrs
                strains = _hdf5.numbers(file, "dmin/strain", (1,))[:]
                earlier = _hdf5.numbers(file, "dmin/earlier", (1,))[:]
                grains = _hdf5.numbers(file, "dmin/value", (2,)).shape[1]
                digest = _hdf5.text(attributes["digest"])
                is_of_run = bool(
                    digest == self.parameters.get("digest", "") and grains == self._grains()
                )
                if reading is None:
                    return is_of_run
                frames = np.arange(len(self.frames))
                return (
                    is_of_run
                    and len(strains) == len(frames)
                    and np.allclose(strains, self.frames.strain, rtol=1e-6, equal_nan=True)
                    and np.array_equal(earlier, np.maximum(frames - reading.lag, -1))
                    and reading.radius == float(attributes["radius_over_mean_radius"])
                    and reading.rattlers == _hdf5.text(attributes["rattlers"])
                )
        except (RunError, *_hdf5.UNSOUND):
            return False

    def rate_state(self) -> dict[str, pd.DataFrame]:
        """Returns the tables of rate-and-state friction, by name of the file without its ending.

        `docs/explanation/rate-state.md` describes fits and intervals,
        `docs/reference/file-formats.md` the tables. If `gshear-reduce rate-state` was given several
        realisations with this run as the first, these are their tables.
        """
        folder = self.results / "rate-state"

        def belong(table: pd.DataFrame) -> bool:
            return bool(np.isin(table["time"][table["experiment"] == 0], self.series["time"]).all())

        self._table("rate-state/rate-state.csv", ["rate-state"], belong, folder)
        # A former reduction may have left tables that this one did not write.
        tables = [path for path in sorted(folder.glob("*.csv")) if self._is_newer(path)]
        return {path.stem: read_csv(path) for path in tables}

    def spectrum(self, frame: SupportsIndex = -1) -> pd.DataFrame:
        """Returns eigenvalues of K v = λ M v nearest to zero, one line each (`spectrum.csv`).

        `docs/explanation/spectrum.md` describes the columns. The file of the last frame of a run
        between walls is that of `gshear-reduce spectrum` without `--frame`, so that a spectrum
        computed with other options is read.

        Args:
            frame: Frame of the run.
        """
        folder, command = self._spectrum_of(frame)
        name = str((folder / "spectrum.csv").relative_to(self.results))
        return self._table(name, command, folder=folder)

    def modes(self, frame: SupportsIndex = -1) -> xr.Dataset:
        """Returns the eigenvectors of `spectrum`, by grain, as they are in `spectrum.h5`.

            modes = run.modes(-1)
            analysis.participation_ratio(modes["vector"])

        Args:
            frame: Frame of the run.

        Returns:
            `vector` [mode, grain, component], complex, of unit length: displacements along `x`, `y`
            and `z`, and rotations about them. It is NaN for grains that are no part of the problem,
            such as those of walls, and 0 for components that are none. `eigenvalue` [mode],
            complex, and `participation` [mode].

        Raises:
            RunError: The spectrum is damaged, or of another frame.
        """
        import xarray as xr

        self.spectrum(frame)
        folder, _ = self._spectrum_of(frame)
        path = folder / "spectrum.h5"
        grains = self._frame(_position(frame, len(self.frames), self.path), self.frames)
        try:
            with _hdf5.open_for_reading(path) as file:
                if int(file.attrs["step"]) != grains.step:
                    raise RunError(f"{path}: is of step {file.attrs['step']}, not {grains.step}")
                row, component = (file[name][:].astype(int) for name in ("grain", "component"))
                parts = _hdf5.numbers(file, "eigenvector", (3,))[:]
                re, im, participation = (
                    _hdf5.numbers(file, name, (1,))[:]
                    for name in ("lambda_re", "lambda_im", "participation")
                )
            vector = np.full((len(parts), len(grains.radius), len(COMPONENTS)), np.nan, complex)
            vector[:, np.unique(row)] = 0
            vector[:, row, component] = parts[..., 0] + 1j * parts[..., 1]
        except _hdf5.UNSOUND as error:
            again = "remove the spectrum.csv beside it, so that both are made anew"
            raise RunError(f"{path}: is damaged or missing; {again}: {error}") from error
        return xr.Dataset(
            {
                "vector": (("mode", "grain", "component"), vector),
                "eigenvalue": ("mode", re + 1j * im),
                "participation": ("mode", participation),
            },
            coords={"grain": grains["id"], "component": list(COMPONENTS)},
        )

    def _spectrum_of(self, frame: SupportsIndex) -> tuple[Path, list[str]]:
        """Returns the folder of the spectrum of a frame, and the command that makes it."""
        frames = len(self.frames)
        index = _position(frame, frames, self.path)
        is_shear = self.stage == "shear"
        if index == frames - 1 and is_shear:
            return self.results, ["spectrum"]
        stage = "" if is_shear else f"{self.stage}-"
        return self.results / f"spectrum-{stage}{index}", ["spectrum", "--frame", str(index)]

    def _are_phases(self, table: pd.DataFrame) -> bool:
        """Whether every phase starts and ends at this run's steps, with this run's change of τ."""
        series = self._once("series", self._read_series)
        # Without lines the columns have no type.
        rows = table[["start_row", "end_row"]].to_numpy(dtype=np.int64)
        if rows.max(initial=-1) >= len(series):
            return False
        step, tau = series["step"].to_numpy(), series["stress_ratio"].to_numpy()
        return np.array_equal(table[["start_step", "end_step"]], step[rows]) and _equal(
            table["delta_tau_p"], tau[rows[:, 1]] - tau[rows[:, 0]]
        )

    def _are_regions(self, table: pd.DataFrame) -> bool:
        """Whether the table has this run's steps, with this run's τ."""
        steps, tau = self._stress_ratio_at_scalars()
        return np.array_equal(table["step"], steps) and _equal(table["stress_ratio"], tau)

    def _are_measures(self, table: pd.DataFrame) -> bool:
        """Whether every phase starts and ends at this run's steps, with this run's change of τ."""
        steps, tau = self._stress_ratio_at_scalars()
        # Without lines the columns have no type.
        ends = table[["start_step", "end_step"]].to_numpy(dtype=np.uint64)
        at = np.searchsorted(steps, ends)
        if at.max(initial=-1) >= len(steps):
            return False
        return np.array_equal(steps[at], ends) and _equal(
            table["delta_tau_p"], tau[at[:, 1]] - tau[at[:, 0]]
        )

    def _are_events(self, table: pd.DataFrame) -> bool:
        """Whether the events are those of the active grains beside them, of this run."""
        path = self.results / "events-grains.csv"
        if not self._is_newer(path):
            return False
        grains = read_csv(path)
        sums = grains.groupby("event")["dmin"].sum().to_numpy(dtype=np.float64)
        return (
            self._are_active_grains(grains)
            and len(sums) == len(table)
            and _equal(table["dmin_sum"], sums)
        )

    def _are_active_grains(self, table: pd.DataFrame) -> bool:
        """Whether the first and the last active grain are where this run has them."""
        axes = ["x", "y", "z"][: self.dimension]
        for row in (table.iloc[0], table.iloc[-1]) if len(table) else ():
            if row["start_frame"] >= len(self.frames):
                return False
            place = self.frame(int(row["start_frame"])).position[int(row["grain"]), : len(axes)]
            if not np.array_equal(place, row[axes].to_numpy(dtype=np.float64)):
                return False
        return True

    def _stress_ratio_at_scalars(self) -> tuple[NDArray[np.uint64], NDArray[np.float64]]:
        """Returns the steps of the scalars of frames, or of the frames if there are none, and τ.

        NaN if the series has no row at a step.
        """

        def read(file: h5py.Group) -> NDArray[np.uint64]:
            for name in file["observables"].get("gshear", {}):
                path = f"observables/gshear/{name}/step"
                steps: NDArray[np.uint64] = _hdf5.numbers(file, path, (1,), "iu")[:]
                return steps
            return self.frames.step

        steps = self._once("steps of scalars", read)
        series = self._once("series", self._read_series)
        tau = pd.Series(series["stress_ratio"].to_numpy(), index=series["step"])
        return steps, tau.reindex(steps).to_numpy(dtype=np.float64)

    def _table(
        self,
        name: str,
        command: Sequence[str],
        belongs: Callable[[pd.DataFrame], bool] = lambda _: True,
        folder: Path | None = None,
    ) -> pd.DataFrame:
        """Returns a table of gshear-reduce, made anew unless it is newer than the run and of it.

        Args:
            name: Path of the table below `results`.
            command: Command of gshear-reduce and its options.
            belongs: Whether a table is of this run.
            folder: Folder that the command writes into; default `results`.
        """
        path = self.results / name
        if self._is_newer(path):
            # What is damaged, or another table, is made anew.
            with contextlib.suppress(RunError, *_hdf5.UNSOUND):
                table = read_csv(path)
                if belongs(table):
                    return table
        self._reduce(command, folder or self.results)
        return read_csv(path)

    def _described(self, name: str, belongs: Callable[[pd.DataFrame], bool]) -> pd.DataFrame:
        """Returns a table of `gshear-reduce events` with the units that stand beside it."""
        table = self._table(name, ["events"], belongs)
        return with_units(table, column_units(self.results / name))

    def _is_newer(self, path: Path) -> bool:
        """Whether a result exists and was written after the run."""
        try:
            newer = path.stat().st_mtime_ns > self._file.path.stat().st_mtime_ns
            return newer and path.is_file()
        except FileNotFoundError:
            return False

    def _reduce(self, command: Sequence[str], folder: Path) -> None:
        program = programs.find("gshear-reduce")
        words = [str(program), *command, str(self.path), "--out", str(folder)]
        programs.run(words, quiet=self.quiet)

    def _scalar_units(self) -> dict[str, str]:
        """Units of the scalars of frames, if the run has computed some."""

        def read(file: h5py.Group) -> dict[str, str]:
            group = file["observables"].get("gshear", {})
            units = {name: _hdf5.unit(item) for name, item in group.items()}
            return {name: unit for name, unit in units.items() if unit}

        found: dict[str, str] = self._once("scalar units", read)
        return found

    def _values(self, read: Callable[[_Stored], NDArray[Any]]) -> NDArray[Any]:
        """Returns numbers of frames, which are read when they are used."""
        return self._attempt(lambda _: read(self._stored))

    def _once(self, name: str, read: Callable[[h5py.Group], T]) -> T:
        """Returns what `read` makes of the file, kept until the file changes."""

        def kept(file: h5py.Group) -> T:
            cache = self._file.cache
            if name not in cache:
                cache[name] = read(file)
            value: T = cache[name]
            return value

        return self._attempt(kept)

    def _attempt(self, read: Callable[[h5py.Group], T]) -> T:
        """Returns what `read` makes of the file; the program may be in the middle of writing it."""
        for _ in range(_hdf5.ATTEMPTS):
            file = self._file.open()
            try:
                return read(file)
            except _hdf5.UNSOUND as error:
                problem = error
                if not self._file.reopen_if_recent():
                    break
        raise self._damaged(problem) from problem

    def _damaged(self, problem: object) -> RunError:
        what = "is damaged, or not a complete run of gshear-mpi"
        return RunError(f"{self.path}: {what}: {problem}")


class Frames:
    """The frames of a run.

    `frames[i]` is a `Frame`, `frames[a:b:c]` an iterator over frames, which are read one by one.

    Attributes:
        step: [T], steps since the start of the stage; of a box that is strained strain steps.
        time: [T], times (s); of a box that is strained strains.
        strain: [T], shear strains γ.
    """

    def __init__(self, run: Run) -> None:
        stored = run._stored
        self._run = run
        self.step: NDArray[np.uint64] = stored.step
        self.time: NDArray[np.float64] = stored.time
        self.strain: NDArray[np.float64] = run._strains(stored.step)

    def __len__(self) -> int:
        return len(self.step)

    def __iter__(self) -> Iterator[Frame]:
        return self[:]

    @overload
    def __getitem__(self, index: SupportsIndex) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Iterator[Frame]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> Frame | Iterator[Frame]:
        if isinstance(index, slice):
            return (self._run._frame(k, self) for k in range(*index.indices(len(self))))
        return self._run._frame(_position(index, len(self), self._run.path), self)

    def __repr__(self) -> str:
        return f"<Frames of {self._run._name}: {len(self)}>"


def mean_of(series: pd.DataFrame, column: str, *, start: float, path: Path) -> TimeMean:
    """Returns the mean of a column of a time series over its later rows, as of `Run.mean`."""
    if not 0.0 <= start < 1.0:
        raise ValueError(f"start is {start}; give a share of the rows from 0 to below 1")
    if column not in series:
        raise RunError(f"{path}: no column {column!r}; it has {', '.join(series.columns)}")
    first = int(start * len(series))
    later, weights = series.iloc[first:], durations(series["time"], first)
    numerator, denominator = RATIOS.get(column, (column, None))
    over = None if denominator is None else later[denominator]
    return time_mean(later[numerator], over, weights=weights)


def _file_of(path: Path) -> Path:
    """Returns the HDF5 file of a run, given the file, a part of it or its folder."""
    if _hdf5.part_of(path)[0].is_file():
        return path
    if (path / FILE).is_file():
        return path / FILE
    what = f"holds no {FILE}" if path.is_dir() else "no such file or folder"
    raise RunError(f"{path}: {what}: give the folder of a run (`--out` of gshear-mpi) or its file")


def _series_elements(file: h5py.Group) -> dict[str, h5py.Group]:
    """Returns the elements of the time series by name, each with `step`, `time` and `value`."""
    items = _hdf5.members(file["observables"])
    return {n: i for n, i in items if isinstance(i, h5py.Group) and "value" in i and "step" in i}


# The rows of no contacts.
NONE = np.zeros(1, dtype=np.int64)


def _contacts(file: h5py.Group, name: str) -> _Contacts:
    """Returns the contacts of a group.

    Raises:
        ValueError: The rows of the frames fall.
    """
    group = file[name]
    columns = {
        column: _hdf5.numbers(
            group, column, (1, 2), "iu" if column in ("i", "j", "wall") else "iuf"
        )
        for column, _ in _hdf5.members(group)
        if column not in ("step", "time", "offset")
    }
    # Numbers that may be subtracted.
    offset = _hdf5.numbers(group, "offset", (1,), "iu")[:].astype(np.int64)
    if offset[:1].any() or (np.diff(offset) < 0).any():
        raise ValueError(f"{name}/offset falls")
    return _Contacts(columns, offset)


def _no_wall_contacts(stored: _Stored, frame: Frame) -> WallContacts:
    """Returns no contacts, with the columns that they would have."""
    columns = stored.contacts.columns

    def empty(name: str) -> NDArray[Any]:
        if name == "wall":
            return np.zeros(0, np.uint8)
        return np.zeros((0, *columns[name].shape[1:]), columns[name].dtype)

    names = ("i", "wall", *(name for name in columns if name not in ("i", "j")))
    return WallContacts(names, empty, stored.units, frame, 0)


def _check_columns(
    constants: dict[str, h5py.Dataset],
    grains: dict[str, h5py.Dataset],
    contacts: dict[str, h5py.Dataset],
) -> None:
    """Whether frames have what every frame has, each of one number of grains.

    Raises:
        KeyError: A column is missing.
        ValueError: Columns are of different numbers of grains.
    """
    for name, columns in (
        *((name, constants) for name in ("id", "radius", "body")),
        *((name, grains) for name in ("position", "velocity")),
        *((name, contacts) for name in ("i", "j", "normal_force", "tangential_force")),
    ):
        if name not in columns:
            raise KeyError(f"frames have no {name}")
    count = len(constants["radius"])
    numbers = [len(column) for column in constants.values()]
    numbers += [column.shape[1] for column in grains.values()]
    if any(number != count for number in numbers):
        raise ValueError(f"frames have {count} radii, and other columns of {numbers} grains")


def _position(index: SupportsIndex, count: int, path: Path) -> int:
    """Returns an index from 0 on, of one that may count from the end."""
    index = operator.index(index)
    if not -count <= index < count:
        raise IndexError(f"{path}: no frame {index}: the run has {count} frames")
    return index % count


def _selected(frames: slice | ArrayLike, count: int, path: Path) -> NDArray[np.int64]:
    """Returns the numbers of frames from 0 on, in the order that is asked for."""
    if isinstance(frames, slice):
        return np.arange(count)[frames]
    rows = np.asarray(frames)
    if rows.dtype == bool:
        if rows.shape != (count,):
            raise IndexError(f"{path}: a mask of {rows.shape} booleans for {count} frames")
        return np.flatnonzero(rows)
    if rows.ndim != 1 or (rows.dtype.kind not in "iu" and len(rows)):
        raise TypeError(f"{path}: {frames!r} are no numbers of frames: give integers or a slice")
    rows = rows.astype(np.int64)
    for row in rows[(rows < -count) | (rows >= count)][:1]:
        raise IndexError(f"{path}: no frame {row}: the run has {count} frames")
    return rows % count if count else rows


def _read(dataset: h5py.Dataset, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[Any]:
    """Returns rows first[k] … last[k] - 1 for every k, one after the other.

    What is adjacent is read at once.
    """
    if not len(first):
        return np.empty((0, *dataset.shape[1:]), dataset.dtype)
    begins = np.flatnonzero(np.append(True, first[1:] != last[:-1]))
    ends = np.append(begins[1:], len(first)) - 1
    parts = [dataset[a:b] for a, b in zip(first[begins], last[ends], strict=True)]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _pair_friction(scene: Scene) -> NDArray[np.float64]:
    """Returns the coefficients of sliding friction between the materials of a scene, [M, M]."""
    materials = scene.get("material")
    named = materials if isinstance(materials, list) else [{}]
    names = [material.get("name") for material in named]
    given = {
        frozenset(pair["materials"]): float(pair["friction"])
        for pair in scene.get("contact.pair", [])
        if "friction" in pair
    }
    like = [given.get(frozenset([name]), scene.get("contact.friction", 0.0)) for name in names]
    return np.array(
        [
            [given.get(frozenset([a, b]), np.sqrt(x * y)) for b, y in zip(names, like, strict=True)]
            for a, x in zip(names, like, strict=True)
        ]
    )


def _attracts(scene: Scene) -> bool:
    """Whether grains of any materials attract each other."""
    contact = scene.get("contact", {})
    tables = [contact, *contact.get("pair", [])]
    return any(table.get(key, 0) for table in tables for key in ("attraction", "surface_energy"))


def _python(value: Any) -> Any:  # noqa: ANN401 - attributes have any type
    """Returns an attribute as a Python number or text, or as an array."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.generic):
        return value.item()
    return value


def _line(x: NDArray[np.float64], y: NDArray[np.float64], at: NDArray[Any]) -> NDArray[np.float64]:
    """Returns the line through two points, at other places."""
    line: NDArray[np.float64] = y[0] + (y[1] - y[0]) / (x[1] - x[0]) * (at - x[0])
    return line


def _equal(table: pd.Series, own: NDArray[np.float64]) -> bool:
    """Whether a column has the numbers of the run, where the run has any."""
    known = np.isfinite(own)
    # Without lines a column has no type.
    numbers = table.to_numpy(dtype=np.float64)
    return np.allclose(numbers[known], own[known], rtol=1e-9, atol=0)
