"""Runs that differ in some keys of their scenes, side by side."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from . import programs
from ._toml import toml
from .errors import ProgramFailedError, RunError
from .run import FILE, Run, mean_of
from .scene import Scene
from .tables import read_csv

# A key that only chooses a packing among equals.
SEED = "seed"
# The share of the rows that means leave out: the latter half is steady.
START = 0.5


class Sweep(Sequence[Run]):
    """The runs of a folder that `gshear-mpi --sweep` wrote, or any runs.

        with Sweep("out/sweep") as sweep:
            print(sweep.means(["stress_ratio", "slip_phases", "dmin_top_tenth"]))

    The numbers are those of `gshear-reduce report out/sweep`. Runs that have not ended by
    themselves are left out, and a line on standard error says so.

    Args:
        runs: The folder with a folder for each run, or the paths of runs as `Run` takes them.
        quiet: As of `Run`.

    Raises:
        RunError: If there are no finished runs.

    Attributes:
        keys: The keys in which the scenes differ, such as `contact.friction`.
    """

    def __init__(
        self,
        runs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
        *,
        quiet: bool = False,
    ) -> None:
        if isinstance(runs, (str, os.PathLike)):
            folder = Path(runs)
            if not folder.is_dir():
                raise RunError(f"{folder}: no such folder: give the folder of a sweep")
            inner = sorted(path for path in folder.iterdir() if path.is_dir())
            paths = [path for path in inner if (path / FILE).exists()]
            if not paths:
                raise RunError(f"{folder}: no folder in it holds a run")
        else:
            paths = [Path(path) for path in runs]
        if not paths:
            raise RunError("a sweep needs one run or more")
        places = [path.resolve() for path in paths]
        if len(set(places)) < len(places):
            twice = next(path for path in places if places.count(path) > 1)
            raise RunError(f"{twice} is given more than once")
        runs_of_all = [Run(path, quiet=quiet) for path in paths]
        self._runs = [run for run in runs_of_all if run.finished]
        self._quiet = quiet
        for run in runs_of_all:
            if not run.finished:
                if not quiet:
                    why = f"{run.state}: {run.failure}" if run.failure else run.state
                    print(f"gshear: {run.folder} is left out: {why}", file=sys.stderr)
                run.close()
        if not self._runs:
            raise RunError(f"none of {len(paths)} runs has ended, first {paths[0]}")
        scenes = [_values(run.scene) for run in self._runs]
        names = dict.fromkeys(name for scene in scenes for name in scene)
        self.keys = [
            name for name in names if any(s.get(name) != scenes[0].get(name) for s in scenes)
        ]
        self._values = [{name: scene.get(name) for name in self.keys} for scene in scenes]

    def __enter__(self) -> Sweep:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes all runs."""
        for run in self._runs:
            run.close()

    def __len__(self) -> int:
        return len(self._runs)

    def __getitem__(self, n: Any) -> Any:  # noqa: ANN401 - of a number a run, of a slice several
        return self._runs[n]

    def __iter__(self) -> Iterator[Run]:
        return iter(self._runs)

    def __repr__(self) -> str:
        return f"<Sweep of {len(self)} runs over {', '.join(self.keys) or 'nothing'}>"

    def table(
        self,
        columns: Iterable[str] = (),
        *,
        start: float = START,
        measures: Mapping[str, Callable[[Run], float]] | None = None,
    ) -> pd.DataFrame:
        """A row for each run: the keys in which they differ, then numbers.

        Args:
            columns: Columns of the time series, of the scalars of frames (`regions.csv`; of spheres
                and boxes those of D²min), or statistics of phases (`runs.csv`); means over the rows
                are given, of a ratio such as `stress_ratio` the ratio of the means. The latter two
                are computed by gshear-reduce.
            start: The share of the rows, from the first on, that is left out of the means: 0.4 of a
                run to the strain 0.1 leaves out what is before 0.04. By default the first half.
            measures: Further numbers, each a function of the run, such as
                `{"rows": lambda run: len(run.series)}`.

        Raises:
            KeyError: If a run has no such column.
            ValueError: A wrong share, or a measure with the name of a key.
        """
        columns = [columns] if isinstance(columns, str) else list(columns)
        return self._table(columns, start, measures)[0]

    def _table(
        self,
        columns: Sequence[str],
        start: float,
        measures: Mapping[str, Callable[[Run], float]] | None,
    ) -> tuple[pd.DataFrame, pd.DataFrame]:
        """`table`, and of each of its columns the standard error over the time of each run."""
        if not 0.0 <= start < 1.0:
            raise ValueError(f"start is {start}; give a share of the rows from 0 to below 1")
        stored = [name for name in columns if all(name in run.series for run in self._runs)]
        computed = self._computed([name for name in columns if name not in stored], start)
        known = [name for name in measures or {} if name in self.keys]
        if known:
            raise ValueError(f"{known[0]} is a key of the scenes; give the measure another name")
        rows, errors = [], []
        for k, (run, values) in enumerate(zip(self._runs, self._values, strict=True)):
            row = {"run": run.folder.name, **values}
            error: dict[str, Any] = {"run": run.folder.name}
            series = run.series if columns else pd.DataFrame()
            for name in columns:
                if name in stored:
                    of_run = mean_of(series, name, start=start, path=run.path)
                    row[name], error[name] = of_run.mean, of_run.error
                else:
                    row[name] = computed[name].iloc[k]
                    error[name] = computed[f"{name}_error"].iloc[k]
            row |= {name: of(run) for name, of in (measures or {}).items()}
            rows.append(row)
            errors.append(error)
        return pd.DataFrame(rows).set_index("run"), pd.DataFrame(errors).set_index("run")

    def _computed(self, columns: Sequence[str], start: float) -> pd.DataFrame:
        """Means of columns that are not in all time series, a row for each run."""
        if not columns:
            return pd.DataFrame()
        with tempfile.TemporaryDirectory() as folder:
            program = programs.find("gshear-reduce")
            words = [str(program), "report", *(str(run.path) for run in self._runs)]
            words += ["--columns", ",".join(columns), "--start", repr(start), "--out", folder]
            try:
                programs.run(words, quiet=self._quiet)
            except ProgramFailedError as error:
                if "--columns" in error.output:
                    raise KeyError(error.output.strip()) from error
                raise
            return read_csv(Path(folder) / "runs.csv")

    def means(
        self,
        columns: Iterable[str] = (),
        *,
        start: float = START,
        measures: Mapping[str, Callable[[Run], float]] | None = None,
        over: Sequence[str] = (SEED,),
    ) -> pd.DataFrame:
        """The means of `table` over the runs that differ in the keys `over` only.

        `name_error` is the standard error of the mean over the runs, of a single run that of its
        mean over time (NaN of statistics of phases and of measures); `runs` is the number of runs.
        The rows are indexed by the other keys.
        """
        columns = [columns] if isinstance(columns, str) else list(columns)
        table, over_time = self._table(columns, start, measures)
        by = [name for name in self.keys if name not in over]
        numbers = [name for name in table.columns if name not in self.keys]
        # Without other keys all runs are one group. Scenes without a key are a group, too.
        keys = by if by else [0] * len(table)
        groups = table.groupby(keys, sort=True, dropna=False)[numbers]
        means = groups.mean()
        errors, runs = groups.sem(), groups.size()
        values = {name: table[name].to_numpy() for name in by}
        of_runs = over_time.reindex(columns=numbers).assign(**values)
        single = of_runs.groupby(keys, sort=True, dropna=False)[numbers].first()
        for name in numbers:
            means[f"{name}_error"] = errors[name].where(runs > 1, single[name])
        means["runs"] = runs
        return means


def _values(scene: Scene) -> dict[str, Any]:
    """The values of a scene by their paths; lists are TOML. Names of the run are not among them."""
    values: dict[str, Any] = {}
    for name in scene:
        inner = scene[name]
        if isinstance(inner, dict):
            values |= {f"{name}.{key}": value for key, value in inner.items()}
        elif name not in ("title", "author"):
            values[name] = inner
    return {n: toml(v) if isinstance(v, list | dict) else v for n, v in values.items()}
