"""Runs as universes of MDAnalysis. Needs the package MDAnalysis, which is not installed by default.

MDAnalysis knows neither the metre nor series that have more rows than there are frames, so its
reader of H5MD files refuses a run or takes its series from other times. This reader takes the
numbers as they are: lengths in m, times in s, velocities in m/s; in a periodic box in the units of
the scene.

    >>> from gshear.mdanalysis import universe
    >>> u = universe("out/lee-hurley")
    >>> u.trajectory[10].dimensions[:3], u.trajectory.ts.data["strain"]
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from MDAnalysis import Universe
from MDAnalysis.coordinates.H5MD import H5MDReader, H5PYPicklable

from gshear import _hdf5
from gshear.errors import RunError
from gshear.run import Run

__all__ = ["RunReader", "universe"]


class _AnyUnit(dict[Any, None]):
    """Takes a number as it is, whatever its unit."""

    def __missing__(self, unit: object) -> None:
        return None


class RunReader(H5MDReader):  # type: ignore[misc]
    """Reads `run.h5`, or `run.h5/newtonian`.

    `ts.dimensions` are the box of the frame, tilted by the Lees–Edwards offset. Walls are not told
    from a periodic axis. `ts.data` has the time series at the frame, NaN where it has no row, and
    `contacts`: [K, 2], rows of the grains that touch.
    """

    format = "GSHEAR"
    _unit_translation: ClassVar = {
        kind: _AnyUnit() for kind in ("time", "length", "velocity", "force")
    }

    def open_trajectory(self) -> None:
        """Opens the file without locks, as `Run` does, so that both can have it open."""
        self._frame = -1
        name, group = _hdf5.part_of(Path(self.filename))
        self._file = H5PYPicklable(name=str(name), mode="r", locking=False)
        self._particle_group = _hdf5.group_of(self._file, group)["particles/trajectory"]

    def __getstate__(self) -> dict[str, object]:
        """What another process needs to open the file again, without locks, too."""
        opened = ("_file", "_particle_group")
        return {name: value for name, value in self.__dict__.items() if name not in opened}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__ = state
        frame = self._frame
        self.open_trajectory()
        self._frame = frame

    def _copy_to_data(self) -> None:
        try:
            self._read_series_and_contacts()
        except _hdf5.UNSOUND as error:
            raise RunError(f"{self.filename}: is damaged: {error}") from error

    def _read_series_and_contacts(self) -> None:
        ts, file, frame = self.ts, self._particle_group.parent.parent, self._frame
        step, ts.time = (
            file[f"particles/trajectory/position/{part}"][frame] for part in ("step", "time")
        )
        ts.data["step"] = step
        for name, series in file["observables"].items():
            if "value" in series:
                row = np.searchsorted(series["step"], step)
                found = row < len(series["step"]) and series["step"][row] == step
                ts.data[name] = series["value"][row] if found else np.nan
        contacts = file["connectivity/contacts"]
        rows = slice(*contacts["offset"][frame : frame + 2])
        ts.data["contacts"] = np.stack([contacts["i"][rows], contacts["j"][rows]], axis=1)


def universe(run: Run | str | Path) -> Universe:
    """Returns a run as a universe with `ids`, `types` (`free`, `bottom`, `top`), `radii`, `masses`.

    Args:
        run: The run, its folder, or one of its HDF5 files.

    Raises:
        RunError: There is no run there, or it has no frames.
    """
    if not isinstance(run, Run):
        with Run(run) as opened:
            return universe(opened)
    names = np.array(["free", "bottom", "top"], dtype=object)
    grains = run.frame(0)
    u = Universe.empty(len(grains.id))
    u.add_TopologyAttr("ids", grains.id)
    u.add_TopologyAttr("types", names[grains.body])
    u.add_TopologyAttr("radii", grains.radius)
    u.add_TopologyAttr("masses", grains.mass)
    u.load_new(str(run.path), format=RunReader, convert_units=False)
    return u
