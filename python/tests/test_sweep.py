"""Runs side by side: keys, tables, means with errors."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from gshear import Run, RunError, Sweep, plots, programs, simulate

from .conftest import SCENES


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of two frictions, with three and two seeds."""
    folder = tmp_path_factory.mktemp("sweep")
    for friction, seeds in [(0.3, (1, 2, 3)), (0.6, (1, 2))]:
        for seed in seeds:
            values: dict[str, object] = {"contact.friction": friction, "seed": seed}
            values |= {"shear.inertial_number": 5e-3, "shear.strain": 0.01}
            values |= {"output.frame_strain": 1e-3}
            values |= {"output.series_strain": 2e-4, "sample.packing": "none"}
            values |= {"sample.grains": 120, "sample.length": 1.2e-5}
            values |= {"sample.radius_min": 0.5e-6, "sample.radius_max": 0.7e-6}
            out = folder / f"friction-{friction}_seed-{seed}"
            simulate(SCENES / "crossing.toml", out, values=values, quiet=True)
    (folder / "notes").mkdir()
    return folder


def test_a_sweep_is_its_runs_and_keys(folder: Path) -> None:
    with Sweep(folder, quiet=True) as sweep:
        assert sorted(sweep.keys) == ["contact.friction", "seed"]
        assert len(sweep) == 5
        assert [run.scene["contact.friction"] for run in sweep] == [0.3] * 3 + [0.6] * 2
        assert len(sweep[1:3]) == 2
        assert "5 runs over" in repr(sweep)


def test_means_and_errors_are_those_by_hand(folder: Path) -> None:
    """mean and std/√n, of the later rows of each run."""
    names = ["stress_ratio", "solid_fraction"]
    measures: dict[str, Callable[[Run], float]] = {"rows": lambda run: len(run.series)}
    with Sweep(folder, quiet=True) as sweep:
        table = sweep.table(names, start=0.5, measures=measures)
        means = sweep.means(names, start=0.5, measures=measures)
        by_hand = []
        for run in sweep:
            series = run.series
            half = series[int(0.5 * len(series)) :]
            # Rows count for the time since the last one: that at the end comes earlier than others.
            time = series["time"].to_numpy()
            of_rows = np.diff(time)[len(series) - len(half) - 1 :]
            ratio = (of_rows @ half["shear_force"]) / (of_rows @ half["normal_force"])
            by_hand.append([ratio, (of_rows @ half["solid_fraction"]) / of_rows.sum()])
            assert table.loc[run.folder.name, "rows"] == len(series)
    of_runs = np.array(by_hand)
    np.testing.assert_allclose(table[names].to_numpy(), of_runs, rtol=1e-14)
    assert list(means.index) == [0.3, 0.6]
    assert list(means.runs) == [3, 2]
    for friction, rows in [(0.3, of_runs[:3]), (0.6, of_runs[3:])]:
        for k, name in enumerate(names):
            found = means.loc[friction, [name, f"{name}_error"]]
            error = rows[:, k].std(ddof=1) / np.sqrt(len(rows))
            np.testing.assert_allclose(found, [rows[:, k].mean(), error], rtol=1e-12)


def test_columns_of_frames_and_phases_are_means_of_their_tables(folder: Path) -> None:
    """Over the later half of regions.csv, and over the phases that begin in the later rows."""
    names = ["slip_phases", "slip_change", "stress_ratio", "dmin_top_tenth"]
    with Sweep(folder, quiet=True) as sweep:
        table = sweep.table(names)
        assert list(table.columns) == [*sweep.keys, *names]
        for run in sweep:
            row = table.loc[run.folder.name]
            later = run.series.stress_ratio.to_numpy()[len(run.series) // 2 :]
            step = np.diff(later)
            falls = np.flatnonzero(np.diff(np.concatenate([[0], step < 0, [0]])) == 1)
            assert row.slip_phases == len(falls) > 1
            total = step[step < 0].sum()
            np.testing.assert_allclose(row.slip_change, total / len(falls), rtol=1e-9)
            of_rows = np.diff(run.series["time"])[len(run.series) // 2 - 1 :]
            forces = run.series[["shear_force", "normal_force"]][len(run.series) // 2 :]
            ratio = (of_rows @ forces.shear_force) / (of_rows @ forces.normal_force)
            np.testing.assert_allclose(row.stress_ratio, ratio, rtol=1e-12)
            dmin = run.regions()["dmin_top_tenth"].to_numpy()[len(run.frames) // 2 :]
            np.testing.assert_allclose(row.dmin_top_tenth, np.nanmean(dmin), rtol=1e-12)


def test_means_are_those_of_the_report(folder: Path, tmp_path: Path) -> None:
    """The same numbers from pandas and from gshear-reduce, for every column of the page."""
    programs.run([programs.find("gshear-reduce"), "report", folder, "--out", tmp_path], quiet=True)
    report = pd.read_csv(tmp_path / "means.csv", index_col="contact.friction")
    columns = [str(name) for name in report if f"{name}_error" in report]
    assert {"stress_ratio", "solid_fraction", "largest_drop"} <= set(columns)
    with Sweep(folder, quiet=True) as sweep:
        means = sweep.means(columns)
    for name in report:
        np.testing.assert_allclose(means[name], report[name], rtol=1e-12, err_msg=name)


def test_a_single_run_has_the_error_of_its_mean_over_time(folder: Path, tmp_path: Path) -> None:
    """The same from pandas and from gshear-reduce, and of `Run.mean`."""
    one = folder / "friction-0.6_seed-1"
    names = ["stress_ratio", "solid_fraction", "coordination", "slip_phases", "dmin_greatest"]
    words: list[str | Path] = [programs.find("gshear-reduce"), "report", one]
    words += ["--columns", ",".join(names), "--start", "0.3", "--out", tmp_path]
    programs.run(words, quiet=True)
    with Sweep([one], quiet=True) as sweep:
        assert sweep.keys == []
        means = sweep.means(names, start=0.3)
        tau = sweep[0].mean("stress_ratio", start=0.3)
    assert means["runs"].iloc[0] == 1
    for table in ("means.csv", "runs.csv"):
        report = pd.read_csv(tmp_path / table)
        for name in (f"{column}{end}" for column in names for end in ("", "_error")):
            np.testing.assert_allclose(means[name], report[name], rtol=1e-12, err_msg=name)
    assert (tau.mean, tau.error) == tuple(means[["stress_ratio", "stress_ratio_error"]].iloc[0])
    assert 0 < tau.error < tau.deviation
    assert np.isnan(means["slip_phases_error"].iloc[0])


def test_spheres_and_boxes_have_columns_of_dmin(copy: Callable[[str], Path]) -> None:
    """Means over frames of the greatest D²min of each."""
    for name in ("spheres", "box"):
        with Sweep([copy(name)], quiet=True) as sweep:
            found = sweep.table(["dmin_greatest"])["dmin_greatest"].iloc[0]
            run = sweep[0]
            greatest = np.nanmax(run.dmin(slice(1, None)), axis=1)
            later = greatest[len(run.frames) // 2 - 1 :]
            np.testing.assert_allclose(found, later.mean(), rtol=1e-9, err_msg=name)


def test_runs_that_did_not_end_are_left_out(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line says so and why; without any other run there is no sweep."""
    shutil.copytree(folder / "friction-0.6_seed-1", tmp_path / "stopped")
    with h5py.File(tmp_path / "stopped" / "run.h5", "r+") as file:
        del file["parameters"].attrs["digest"]
    with Sweep([tmp_path / "stopped", folder / "friction-0.6_seed-2"]) as sweep:
        assert [run.folder.name for run in sweep] == ["friction-0.6_seed-2"]
    assert capsys.readouterr().err == (f"gshear: {tmp_path / 'stopped'} is left out: unfinished\n")
    with pytest.raises(RunError, match="none of 1 runs has ended"):
        Sweep(tmp_path)


def test_what_is_no_sweep_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no folder in it holds a run"):
        Sweep(tmp_path)
    with pytest.raises(RunError, match="one run or more"):
        Sweep([])
    one = next(path for path in sorted(folder.iterdir()) if (path / "run.h5").exists())
    with pytest.raises(RunError, match="is given more than once"):
        Sweep([one, one])
    with Sweep(folder, quiet=True) as sweep:
        with pytest.raises(KeyError):
            sweep.table(["stres_ratio"])
        with pytest.raises(ValueError, match="from 0 to below 1"):
            sweep.table(["stress_ratio"], start=1.5)
        with pytest.raises(ValueError, match="give the measure another name"):
            sweep.table(measures={sweep.keys[0]: lambda _: 1.0})
        pd.testing.assert_frame_equal(sweep.means("stress_ratio"), sweep.means(["stress_ratio"]))


def test_figures_of_a_sweep(folder: Path) -> None:
    """A line for each group of runs, with the means at its keys; a curve for each run."""
    with Sweep(folder, quiet=True) as sweep:
        means = sweep.means(["stress_ratio"], start=0.5)
        _, (left, right) = plt.subplots(1, 2)
        plots.against(left, means, "stress_ratio")
        line = left.lines[0]
        np.testing.assert_array_equal(line.get_xdata(), means.index)
        np.testing.assert_array_equal(line.get_ydata(), means.stress_ratio)
        assert left.get_xlabel() == "contact.friction"
        plots.courses(right, sweep, "stress_ratio")
        assert len(right.lines) == 5
        shortest = sweep[0].series
        np.testing.assert_array_equal(right.lines[0].get_ydata(), shortest.stress_ratio)
        plt.close("all")


def test_a_map_of_a_sweep(folder: Path) -> None:
    """A field for each pair of values; pairs without a run are empty."""
    with Sweep(folder, quiet=True) as sweep:
        means = sweep.means(["stress_ratio"], start=0.5, over=())
        _, ax = plt.subplots()
        fields: Any = plots.sweep_map(ax, means, "stress_ratio").get_array()
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("seed", "contact.friction")
        assert [text.get_text() for text in ax.get_xticklabels()] == ["1", "2", "3"]
        assert fields.shape == (2, 3)
        assert fields[1, 0] == means.loc[(1, 0.6), "stress_ratio"]
        assert np.ma.getmaskarray(fields).tolist() == [[False] * 3, [False, False, True]]
        with pytest.raises(ValueError, match=r"a map needs two keys, these means have contact.f"):
            plots.sweep_map(ax, sweep.means(["stress_ratio"]), "stress_ratio")
        plt.close("all")
    with Sweep([folder / "friction-0.6_seed-1"], quiet=True) as sweep:
        one = sweep.means(["stress_ratio"])
    with pytest.raises(ValueError, match="differ in no key"):
        plots.against(ax, one, "stress_ratio")


def test_runs_without_a_key_and_lists_are_groups(copy: Callable[[str], Path]) -> None:
    """Scenes that lack a key are not left out of means; lists are values as others."""
    with Sweep([copy("disks"), copy("spheres")], quiet=True) as sweep:
        assert {"contact.rolling_friction", "shear.protocol"} <= set(sweep.keys)
        means = sweep.means(["stress_ratio"])
        assert means["runs"].tolist() == [1, 1]
        names = means.index.get_level_values("shear.protocol")
        assert any("velocity = 3.0" in str(name) for name in names)
