"""Scenes, parameters and time series, compared with the files read by other means."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from gshear import Run, RunError, simulate
from gshear.programs import find

from .conftest import SCENES


def bits(number: float) -> str:
    return "NaN" if math.isnan(number) else number.hex()


def assert_equals_log(run: Run, log: Path) -> None:
    with log.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(run.series) == list(rows[0])
    assert len(run.series) == len(rows) > 100
    for name in run.series:
        ours = [bits(float(value)) for value in run.series[name]]
        assert ours == [bits(float(row[name])) for row in rows], name


def test_series_has_the_bits_of_the_log(walls: Run) -> None:
    assert walls.finished
    assert_equals_log(walls, walls.folder / "log.csv")
    described = json.loads((walls.folder / "log.csv-metadata.json").read_text(encoding="utf-8"))
    columns = {column["name"]: column for column in described["tableSchema"]["columns"]}
    assert list(columns) == list(walls.series)
    units = {name: c["schema:unitText"] for name, c in columns.items() if "schema:unitText" in c}
    assert units == walls.series.attrs["units"]
    # Not because it reads the log.
    without = walls.folder / "log.moved"
    (walls.folder / "log.csv").rename(without)
    try:
        with Run(walls.folder) as run:
            assert set(run.series) == set(walls.series)
            assert run.series["stress_ratio"].equals(walls.series["stress_ratio"])
    finally:
        without.rename(walls.folder / "log.csv")


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was stopped at a step of its shear."""
    out = tmp_path_factory.mktemp("stopped") / "run"
    small = ["sample.grains=120", "sample.length=1.2e-5", "sample.packing=none"]
    small += ["sample.radius_min=0.5e-6", "sample.radius_max=0.7e-6"]
    sets = [f"--set={value}" for value in small]
    words: list[str | Path] = [find("gshear-mpi"), SCENES / "crossing.toml", *sets]
    words += ["--stop-at=200", "--out", out]
    done = subprocess.run(words, capture_output=True, check=False)
    assert done.returncode == 75, done.stderr
    return out


@pytest.mark.parametrize("state", ["running", "stopped", "failed", "done", None])
def test_a_state_is_that_of_info(stopped: Path, tmp_path: Path, state: str | None) -> None:
    """Of a run that was stopped; `running` without a lock, so that it was killed."""
    folder = tmp_path / "run"
    shutil.copytree(stopped, folder)
    path = folder / "status.json"
    status = json.loads(path.read_text(encoding="utf-8"))
    assert status["state"] == "stopped"
    if state is None:
        path.unlink()
    else:
        path.write_text(json.dumps(status | {"state": state, "message": "left the sample"}))
    expected = {"running": "killed", "stopped": "stopped", "failed": "failed"}
    with Run(folder) as run:
        assert run.state == expected.get(str(state), "unfinished")
        assert run.failure == ("left the sample (stage shear)" if state == "failed" else None)
        said = subprocess.run(
            [find("gshear-reduce"), "info", folder], capture_output=True, text=True
        )
        words = next(line for line in said.stdout.splitlines() if line.startswith("state"))
        assert words.split()[1].rstrip(":") == run.state
        assert (run.failure or "") in words
    if state is not None:
        # That of another run does not count.
        path.write_text(json.dumps(status | {"state": state, "run_id": "other"}))
        with Run(folder) as run:
            assert run.state == "unfinished"


def test_series_of_a_box_is_that_of_the_file(box: Run) -> None:
    with h5py.File(box.folder / "run.h5", locking=False) as whole:
        file = whole["newtonian"] if box.stage == "newtonian" else whole
        names = set(file["observables"])
        assert names | {"step", "time"} == set(box.series)
        for name in names:
            np.testing.assert_array_equal(box.series[name], file["observables"][name]["value"][:])
        assert box.series["step"].tolist() == file["observables/pressure/step"][:].tolist()
    assert box.series.attrs["units"] == {}


def test_later_stages_are_parts(tmp_path: Path) -> None:
    values: dict[str, object] = {"stages": ["aqs", "shear"], "aqs.steps": 1, "dimension": 2}
    values |= {"sample.solid_fraction": 0.86, "load.pressure": 1e-2, "contact.law": "hooke"}
    values |= {"material.mass": None, "material.density": 1.0, "contact.damping_ratio": 0.3}
    values |= {"shear.velocity": 1e-2, "shear.strain": 5e-3, "output.frame_strain": 1e-3}
    values |= {f"newtonian.{key}": None for key in ("growth_times", "rows", "frames")}
    folder = simulate(SCENES / "periodic.toml", tmp_path, ranks=1, values=values, quiet=True)
    with Run(folder, quiet=True) as run, Run(folder / "run.h5/shear", quiet=True) as shear:
        part = run.part("shear")
        assert part is not None
        with part:
            assert (run.stage, part.stage, shear.stage) == ("aqs", "shear", "shear")
            assert part.path == shear.path
            assert len(part.frames) == len(shear.frames) == 6
            np.testing.assert_array_equal(part.series["strain"], shear.series["strain"])
        assert run.part("aqs") is None
        assert run.newtonian is None
        with pytest.raises(ValueError, match="one of aqs, shear, newtonian, not 'pack'"):
            run.part("pack")


@pytest.mark.parametrize(("name", "force"), [("disks", "N m-1"), ("spheres", "N")])
def test_units_are_those_of_the_file(
    name: str, force: str, originals: Callable[[str], Path]
) -> None:
    with Run(originals(name)) as run:
        units = run.series.attrs["units"]
        assert units["normal_force"] == units["shear_force"] == force
        assert units["wall_height"] == "m"
        assert "stress_ratio" not in units
        assert run.units == {"length": "m", "force": force}


def test_scene_and_parameters(disks: Run, box: Run) -> None:
    # contact.law is a default that the scene does not name.
    assert "law" not in (SCENES / "crossing.toml").read_text()
    assert disks.scene["contact.law"] == disks.scene["contact"]["law"] == "lee-hurley"
    assert "contact.normal_stiffness" not in disks.scene
    assert "# effective modulus" in disks.scene.text
    assert disks.parameters["ranks"] == 2
    assert len(disks.parameters["run_id"]) == 32
    assert box.scene["sample.solid_fraction"] == 0.72
    assert (disks.dimension, box.dimension) == (2, 3)


def test_the_file_may_be_open_elsewhere(disks: Run) -> None:
    other = Run(disks.path)
    with h5py.File(disks.path) as file, other:
        rows = len(file["observables/strain/value"])
        assert len(other.series) == rows
        assert other.hdf5["observables/strain/value"][-1] == other.series["strain"].iloc[-1]


def test_missing_runs_are_named(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"nothing: no such file or folder: give the folder"):
        Run(tmp_path / "nothing")
    with pytest.raises(RunError, match=r"holds no run.h5"):
        Run(tmp_path)
    foreign = tmp_path / "run.h5"
    with h5py.File(foreign, "w") as file:
        file.create_group("parameters")
    os.utime(foreign, (0, 0))
    with Run(foreign) as run, pytest.raises(RunError, match="not a complete run of gshear-mpi"):
        _ = run.series
    foreign.write_text("text")
    os.utime(foreign, (0, 0))
    with pytest.raises(RunError, match="cannot be read"):
        _ = Run(foreign).parameters


@pytest.mark.parametrize("how", ["storage", "link", "virtual"])
def test_numbers_of_other_files_are_refused(
    how: str, copy: Callable[[str], Path], tmp_path: Path
) -> None:
    own = tmp_path / "own.h5"
    with h5py.File(own, "w") as file:
        file["x"] = np.arange(10.0)
    folder = copy("disks")
    name = "observables/strain/value"
    with h5py.File(folder / "run.h5", "r+") as file:
        del file[name]
        if how == "storage":
            file.create_dataset(name, shape=10, dtype="f8", external=[(str(own), 0, 80)])
        elif how == "link":
            file[name] = h5py.ExternalLink(str(own), "x")
        else:
            layout = h5py.VirtualLayout(shape=10, dtype="f8")
            layout[:] = h5py.VirtualSource(own, "x", shape=10)
            file.create_virtual_dataset(name, layout)
    with pytest.raises(RunError, match=f"{name} is in another file"):
        _ = Run(folder).series


def test_a_run_without_its_end_is_read_from_the_log(copy: Callable[[str], Path]) -> None:
    folder = copy("disks")
    log = folder / "log.csv"
    lines = log.read_text().splitlines(keepends=True)
    with Run(folder) as run:
        complete = run.series
    with h5py.File(folder / "run.h5", "r+") as file:
        del file["parameters"].attrs["digest"]
    # As if the program were in the middle of a line.
    log.write_text("".join(lines[:150]) + lines[150][:40])
    with Run(folder) as run:
        assert not run.finished
        assert len(run.series) == 149
        assert run.series["strain"].equals(complete["strain"][:149])
        assert run.series.attrs["units"] == complete.attrs["units"]


def test_a_stopped_run_grows_when_it_is_resumed(tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = [str(find("gshear-mpi")), str(SCENES / "crossing.toml"), "--out", str(out)]
    stopped = subprocess.run([*command, "--stop-at", "2000"], check=False, capture_output=True)
    assert stopped.returncode == 75
    with Run(out, quiet=True) as run:
        before, phases = run.frames, run.phases()
        assert not run.finished
        assert 10 < len(before) < 51
        first, some = run.frame(-1).position, run.array("position")
        assert phases["end_step"].max() <= 2000
        simulate(SCENES / "crossing.toml", out, ranks=2, quiet=True)
        assert run.finished
        assert len(run.frames) == 51
        np.testing.assert_array_equal(run.frames.strain[: len(before)], before.strain)
        np.testing.assert_array_equal(run.frame(len(before) - 1).position, first)
        assert len(run.array("position")) == 51
        np.testing.assert_array_equal(run.array("position", slice(len(some))), some)
        # The table of the first part is out of date.
        assert run.phases()["end_step"].max() > 5000
        assert_equals_log(run, out / "log.csv")


def test_frames_before_the_first_row_have_their_strain(tmp_path: Path) -> None:
    out, other = tmp_path / "run", tmp_path / "other"
    command = [str(find("gshear-mpi")), str(SCENES / "crossing.toml"), "--out", str(out)]
    stopped = subprocess.run([*command, "--stop-at", "250"], check=False, capture_output=True)
    assert stopped.returncode == 75
    command = [command[0], "--resume", str(out / "checkpoint.h5"), "--out", str(other)]
    sets = ("shear.strain=0.3", "output.series_strain=0.1", "output.frame_strain=0.02")
    command += [f"--set={value}" for value in sets]
    subprocess.run(command, check=True, capture_output=True)
    with Run(other, quiet=True) as run:
        assert len(run.frames) > 5
        assert run.frames.step[0] < run.series["step"].iloc[0]
        expected = run.frames.step * step_strain(run)
        np.testing.assert_allclose(run.frames.strain, expected, rtol=1e-9)


def test_a_run_is_read_while_it_is_written(tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = [str(find("gshear-mpi")), str(SCENES / "crossing.toml"), "--out", str(out)]
    with subprocess.Popen(
        [*command, "--set", "shear.strain=1000"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as program:
        try:
            while not (out / "run.h5").exists():
                assert program.poll() is None
            with Run(out, quiet=True) as run:
                seen: set[int] = set()
                while len(seen) < 4 or max(seen) == 0:
                    assert program.poll() is None
                    count = len(run.frames)
                    if count not in seen and count > 0:
                        frame = run.frame(-1)
                        assert frame.strain == pytest.approx(frame.step * step_strain(run))
                        assert np.isfinite(frame.contacts.force).all()
                        assert len(run.series) > 0
                    seen.add(count)
                assert not run.finished
        finally:
            program.terminate()
            program.wait()
    assert program.returncode == 75


def test_a_file_whose_objects_cannot_be_opened_is_refused(tmp_path: Path, walls: Run) -> None:
    path = tmp_path / "run.h5"
    content = bytearray((walls.folder / "run.h5").read_bytes())
    with h5py.File(walls.folder / "run.h5", "r", locking=False) as file:
        at = h5py.h5o.get_info(file["parameters"].id).addr
    content[at : at + 16] = bytes(16)
    path.write_bytes(content)
    # Long ago: nobody is in the middle of a flush.
    os.utime(path, (0, 0))
    with pytest.raises(RunError, match="cannot be read"):
        len(Run(path).frames)


def step_strain(run: Run) -> float:
    parameters = run.parameters
    return float(parameters["time_step"] * parameters["wall_speed"] / parameters["height_start"])
