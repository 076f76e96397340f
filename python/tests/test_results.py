"""Results of gshear-reduce: their values, when they are made, and what is said of failures."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from gshear import Frame, ProgramFailedError, ProgramNotFoundError, Run, analysis, simulate
from gshear.programs import find, launcher

from .conftest import SCENES


def falk_langer(
    earlier: Frame, later: Frame, reach: float, bears: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """D²min of every grain by least squares, grain by grain (Falk & Langer 1998; LH B1 to B4).

    `bears`: grains that count; by default those that are no rattlers of Lee & Hurley.
    """
    d = earlier.dimension
    if bears is None:
        needed = np.where(earlier.body == 0, d + 1, d)
        bears = earlier.contacts.coordination() >= needed
    result = np.full(len(bears), np.nan)
    for i in np.flatnonzero(bears):
        whole = earlier.unwrapped - earlier.unwrapped[i]
        before = earlier.box.minimum_image(whole)
        # The images that were the nearest in the earlier frame.
        images = np.rint((whole - before) @ np.linalg.inv(earlier.box.vectors))
        after = later.unwrapped - later.unwrapped[i] - images @ later.box.vectors
        near = bears & (np.linalg.norm(before, axis=1) < reach)
        near[i] = False
        _, left, rank, _ = np.linalg.lstsq(before[near, :d], after[near, :d], rcond=1e-8)
        if rank == d:
            # NumPy gives no residuals if neighbours are as many as dimensions: they are zero then.
            result[i] = (left.sum() if len(left) else 0.0) / near.sum()
    return result


@pytest.mark.parametrize("radius", [5.0, 3.0])
def test_dmin_against_least_squares(walls: Run, radius: float) -> None:
    reach = radius * walls.frame(0).radius.mean()
    for index in (1, 12, len(walls.frames) - 1):
        ours = falk_langer(walls.frame(index - 1), walls.frame(index), reach)
        theirs = walls.dmin(index, radius=radius)
        assert np.isfinite(ours).sum() > 30
        # Below this, separations of a few r̄ have lost all digits of the residual.
        rounding = (1e-14 * walls.frame(0).box.edges[0]) ** 2 * 1e4
        np.testing.assert_allclose(theirs, ours, rtol=1e-7, atol=rounding)
    assert np.isnan(walls.dmin(0, radius=radius)).all()


def test_dmin_over_a_lag_and_of_other_grains_against_least_squares(walls: Run) -> None:
    """With all grains, and with those that friction or none holds in balance."""
    reach = 5.0 * walls.frame(0).radius.mean()
    rounding = (1e-14 * walls.frame(0).box.edges[0]) ** 2 * 1e4
    defined = []
    for rattlers, lag in [("none", 1), ("none", 7), ("balance", 3), ("lee-hurley", 7)]:
        earlier, later = walls.frame(20 - lag), walls.frame(20)
        bears = {
            "none": np.ones(len(earlier.radius), dtype=bool),
            "balance": ~analysis.rattlers(earlier.contacts),
            "lee-hurley": None,
        }[rattlers]
        ours = falk_langer(earlier, later, reach, bears)
        theirs = walls.dmin(20, lag=lag, rattlers=rattlers)
        np.testing.assert_allclose(theirs, ours, rtol=1e-7, atol=rounding)
        assert np.isnan(walls.dmin(lag - 1, lag=lag, rattlers=rattlers)).all()
        defined.append(np.isfinite(theirs).sum())
    everyone, _, balanced, paper = defined
    assert everyone == len(walls.frame(0).radius)
    assert paper < balanced < everyone
    assert earlier.friction > 0


def test_dmin_of_a_box_against_least_squares(box: Run) -> None:
    # The box is narrower than the neighbourhood.
    reach = 6.0 * box.frame(0).radius.mean()
    assert 2 * reach > box.frame(0).box.edges.min()
    for index in range(1, len(box.frames)):
        ours = falk_langer(box.frame(index - 1), box.frame(index), reach)
        theirs = box.dmin(index, radius=6.0)
        assert np.isfinite(ours).sum() > 30
        np.testing.assert_allclose(theirs, ours, rtol=1e-7, atol=1e-24)


def test_dmin_of_slices_and_negative_frames(disks: Run) -> None:
    several = disks.dmin(slice(1, None, 10))
    assert several.shape == (5, len(disks.frame(0).id))
    np.testing.assert_array_equal(several[1], disks.dmin(11))
    np.testing.assert_array_equal(disks.dmin(-1), disks.dmin(50))
    np.testing.assert_array_equal(disks.dmin(slice(9, 2, -3)), disks.dmin(slice(3, 10, 3))[::-1])
    assert len(disks.dmin(slice(2, 9, -3))) == 0
    with pytest.raises(IndexError, match="no frame 51"):
        disks.dmin(51)


def test_phases_are_the_monotone_runs_of_the_stress_ratio(walls: Run) -> None:
    phases, tau = walls.phases(), walls.series["stress_ratio"].to_numpy()
    with (walls.results / "phases.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["delta_tau_p"]) for row in rows] == phases["delta_tau_p"].tolist()
    assert phases["kind"].isin(["stick", "slip"]).all()
    ends = phases[["start_row", "end_row"]].to_numpy()
    for (start, end), kind, change in zip(ends, phases["kind"], phases["delta_tau_p"], strict=True):
        steps = np.diff(tau[start : end + 1])
        assert ((steps >= 0) if kind == "stick" else (steps <= 0)).all()
        assert change == tau[end] - tau[start]
    assert len(phases) > 10


def test_a_run_of_one_row_has_no_phases_however_often_it_is_asked(tmp_path: Path) -> None:
    words: list[str | Path] = [find("gshear-mpi"), SCENES / "crossing.toml", "--stop-at=1"]
    words += ["--set=output.series_strain=1.0", "--set=output.frame_strain=0.0"]
    done = subprocess.run([*words, "--out", tmp_path], capture_output=True, check=False)
    assert done.returncode == 75, done.stderr
    with Run(tmp_path, quiet=True) as opened:
        assert len(opened.series) == 1
        for _ in range(2):
            assert (len(opened.phases()), len(opened.drops(3))) == (0, 0)


def test_drops_are_the_slip_phases_by_size(walls: Run) -> None:
    drops, phases = walls.drops(), walls.phases()
    slips = phases.loc[phases["kind"] == "slip", "delta_tau_p"]
    assert drops["delta_tau_p"].tolist() == sorted(slips)
    assert drops["delta_tau_p"].iloc[0] == slips.min() < 0
    assert walls.drops(3)["phase"].tolist() == drops["phase"][:3].tolist()
    with pytest.raises(ValueError, match="give 0 or more"):
        walls.drops(-1)


def test_tables_of_disks(disks: Run) -> None:
    regions = disks.regions()
    assert regions["step"].tolist() == disks.frames.step.tolist()
    greatest = np.nanmax(disks.dmin(slice(1, None)), axis=1)
    np.testing.assert_allclose(regions["dmin_greatest"][1:], greatest, rtol=1e-12)
    measures = disks.measures()
    assert measures["dmin_max"].max() == regions["dmin_greatest"][1:].max()
    correlations = disks.correlations()
    assert correlations["rho"].dropna().between(-1, 1).all()
    assert (correlations["pairs"] >= 0).all()


def test_rate_state_of_a_spring(spheres: Run) -> None:
    tables = spheres.rate_state()
    assert {"rate-state", "segments", "holds", "fits"} <= set(tables)
    mu = tables["rate-state"]
    tau = spheres.series.set_index("time")["stress_ratio"]
    np.testing.assert_array_equal(tau.loc[mu["time"]], mu["mu"])
    velocities = [part["velocity"] for part in spheres.scene["shear.protocol"]]
    assert tables["segments"]["drive_velocity"].tolist() == velocities


def test_spectra(disks: Run, reduced: Callable[[str], Path]) -> None:
    with Run(reduced("box"), quiet=True) as run:
        eigenvalues = run.spectrum()
        assert 20 <= len(eigenvalues) <= 21
        assert eigenvalues["residual"].max() < 1e-10
        assert not np.array_equal(run.spectrum(0)["lambda_re"], eigenvalues["lambda_re"])
    # Of pairs both eigenvalues are given, so that there may be one more than asked for.
    last, third = disks.spectrum(), disks.spectrum(3)
    assert 20 <= min(len(last), len(third)) <= max(len(last), len(third)) <= 21
    assert not last["lambda_re"].isin(third["lambda_re"]).any()
    assert (disks.results / "spectrum-3" / "spectrum.csv").exists()


def test_commands_are_printed_once(
    copy: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = copy("disks")
    with Run(folder) as run:
        first = run.dmin(1)
        said = capsys.readouterr().err
        assert f"running {find('gshear-reduce')} dmin --radius 5.0 {folder}/run.h5" in said
        # What is there is read: a second call prints nothing, nor do other frames.
        np.testing.assert_array_equal(run.dmin(1), first)
        run.dmin(2)
        assert capsys.readouterr().err == ""


def test_other_radii_do_not_replace_the_file(copy: Callable[[str], Path]) -> None:
    with Run(copy("disks"), quiet=True) as run:
        run.dmin(1)
        written = (run.folder / "reduced.h5").stat().st_mtime_ns
        assert not np.array_equal(run.dmin(1, radius=3), run.dmin(1), equal_nan=True)
        assert (run.folder / "reduced.h5").stat().st_mtime_ns == written


RESULTS: dict[str, Callable[[Run], object]] = {
    "reduced.h5": lambda run: run.dmin(1),
    "phases.csv": lambda run: run.phases(),
    "regions.csv": lambda run: run.regions(),
    "correlations.csv": lambda run: run.correlations(),
    "measures.csv": lambda run: run.measures(),
    "events.csv": lambda run: run.events(),
}


@pytest.mark.parametrize("name", RESULTS)
def test_results_older_than_the_run_are_made_anew(name: str, copy: Callable[[str], Path]) -> None:
    with Run(copy("disks"), quiet=True) as run:
        RESULTS[name](run)
        result = run.folder / name
        os.utime(result, (0, 0))
        RESULTS[name](run)
        assert result.stat().st_mtime > 1e9


@pytest.mark.parametrize("name", [name for name in RESULTS if name != "correlations.csv"])
def test_results_of_another_run_are_made_anew(
    name: str, copy: Callable[[str], Path], reduced: Callable[[str], Path]
) -> None:
    # It differs in the seed only, so that it has the same steps and strains.
    other = reduced("other disks")
    with Run(other, quiet=True) as run:
        RESULTS[name](run)
    with Run(copy("disks"), quiet=True) as run:
        RESULTS[name](run)
        right = (run.folder / name).read_bytes()
        time.sleep(0.01)
        shutil.copy(other / name, run.folder / name)
        assert (run.folder / name).read_bytes() != right
        RESULTS[name](run)
        if name != "reduced.h5":
            assert (run.folder / name).read_bytes() == right
        assert np.nanmax(run.dmin(-1)) == pytest.approx(run.regions()["dmin_greatest"].iloc[-1])


@pytest.mark.parametrize("name", ["regions.csv", "measures.csv"])
def test_results_at_scalars_are_made_once(name: str, copy: Callable[[str], Path]) -> None:
    with Run(copy("scalars"), quiet=True) as run:
        RESULTS[name](run)
        made = (run.folder / name).stat().st_mtime_ns
        RESULTS[name](run)
        assert (run.folder / name).stat().st_mtime_ns == made


@pytest.mark.parametrize(("name", "value"), [("digest", "0" * 32), ("strain", 0.5)])
def test_dmin_of_other_frames_is_made_anew(
    name: str, value: str | float, copy: Callable[[str], Path]
) -> None:
    with Run(copy("disks"), quiet=True) as run:
        right = run.dmin(1)
        with h5py.File(run.folder / "reduced.h5", "r+") as file:
            if name == "digest":
                file.attrs["digest"] = value
            else:
                file["dmin/strain"][3] = value
            file["dmin/value"][1] = 0.0
        np.testing.assert_array_equal(run.dmin(1), right)


def test_results_in_another_folder(copy: Callable[[str], Path], tmp_path: Path) -> None:
    folder, results = copy("disks"), tmp_path / "results"
    before = sorted(folder.iterdir())
    with Run(folder, results=results, quiet=True) as run:
        assert len(run.phases()) > 0
        assert run.dmin(1).shape == run.frame(1).id.shape
    assert sorted(folder.iterdir()) == before
    assert (results / "phases.csv").exists()


def test_failures_hand_on_the_message(reduced: Callable[[str], Path]) -> None:
    run = Run(reduced("disks without walls"), quiet=True)
    with run, pytest.raises(ProgramFailedError, match="this command needs a run betw") as caught:
        run.regions()
    assert caught.value.exit_code == 2
    assert "regions" in caught.value.command


def test_a_missing_program_is_named(
    copy: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with Run(copy("disks"), quiet=True) as run:
        run.phases()
        monkeypatch.setenv("GSHEAR_REDUCE", str(tmp_path / "absent"))
        # What is there needs no program.
        assert len(run.phases()) > 0
        with pytest.raises(ProgramNotFoundError, match=r"GSHEAR_REDUCE=.*absent: no program"):
            run.dmin(1)
        monkeypatch.delenv("GSHEAR_REDUCE")
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setattr("gshear.programs.__file__", str(tmp_path / "programs.py"))
        with pytest.raises(ProgramNotFoundError, match="make build"):
            run.dmin(1)


def test_places_of_programs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def program(folder: Path, name: str = "gshear-reduce") -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / name
        path.write_text("#!/bin/sh\n")
        path.chmod(0o755)
        return path

    checkout = program(tmp_path / "target" / "release")
    in_path, given = program(tmp_path / "bin"), program(tmp_path / "given")
    monkeypatch.delenv("GSHEAR_REDUCE", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    monkeypatch.setattr("gshear.programs.__file__", str(tmp_path / "python/src/gshear/x.py"))
    assert find("gshear-reduce") == checkout
    monkeypatch.setenv("PATH", str(in_path.parent))
    assert find("gshear-reduce") == in_path

    # What pip writes down about the files of a wheel.
    def install(package: str, name: str) -> Path:
        record = tmp_path / "env/lib/site-packages" / f"{package}-1.dist-info" / "RECORD"
        record.parent.mkdir(parents=True)
        record.write_text(f"../../bin/{name},,\n{package}/{name},,\n")
        return program(tmp_path / "env/bin", name)

    monkeypatch.delenv("MPIRUN", raising=False)
    program(in_path.parent, "mpirun")
    monkeypatch.syspath_prepend(tmp_path / "env/lib/site-packages")
    wheel, mpiexec = install("gshear", "gshear-reduce"), install("mpich", "mpiexec")
    assert find("gshear-reduce") == wheel
    assert launcher(wheel) == [str(mpiexec)]
    assert launcher(in_path) == ["mpirun"]
    monkeypatch.setenv("MPIRUN", "srun --mpi=pmi2")
    assert launcher(wheel) == ["srun", "--mpi=pmi2"]
    monkeypatch.setenv("GSHEAR_REDUCE", str(given))
    assert find("gshear-reduce") == given


def test_a_bad_scene_hands_on_the_message(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="ranks is 0; give 1 or more"):
        simulate(tmp_path / "no.toml", tmp_path / "out", ranks=0, quiet=True)
    with pytest.raises(ProgramFailedError, match=r"no.toml") as caught:
        simulate(tmp_path / "no.toml", tmp_path / "out", ranks=1, quiet=True)
    assert caught.value.exit_code == 2
    assert str(subprocess.list2cmdline(caught.value.command[:1])).endswith("gshear-mpi")
