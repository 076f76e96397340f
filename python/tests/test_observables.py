"""Columns that a scene declares: what Python reads of them, against `math.fsum` over frames."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gshear import Observable, Run, simulate
from gshear.programs import find

from .conftest import SCENES

OBSERVABLES = """
[[observable]]
name = "middle"
quantity = "v_x"
unit = "m/s"
y = [0.4, 0.6]

[[observable]]
name = "energy"
quantity = "0.5*mass*(v_x^2 + v_y^2)"
reduce = "sum"

[[observable]]
name = "msd"
expression = "energy / kinetic_energy"
"""


@pytest.fixture(scope="module")
def observed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("observed")
    scene = folder / "scene.toml"
    scene.write_text(f'extends = "{SCENES / "crossing.toml"}"\n{OBSERVABLES}')
    values = {"shear.strain": 0.1, "output.columns": ["middle", "strain"]}
    simulate(scene, folder / "run", ranks=2, values=values, quiet=True)
    return folder / "run"


def test_series_have_the_declared_columns(observed: Path) -> None:
    with Run(observed) as run:
        assert run.observables == [
            Observable("middle", "m/s", 'quantity = "v_x", y = [0.4, 0.6]'),
            Observable("energy", "1", 'quantity = "0.5*mass*(v_x^2 + v_y^2)", reduce = "sum"'),
            Observable("msd", "1", 'expression = "energy / kinetic_energy"'),
        ]
        series = run.series
        assert list(series)[-3:] == ["middle", "energy", "msd"]
        assert series.attrs["units"]["middle"] == "m/s"
        assert "energy" not in series.attrs["units"]
        # A name that belongs to another stage does not make it one.
        assert run.stage == "shear"
        assert math.isfinite(run.mean("middle").mean)
    log = (observed / "log.csv").read_text().splitlines()
    assert log[0] == "step,time,middle,strain"
    assert [float(line.split(",")[2]) for line in log[1:]] == list(series["middle"])


def test_sums_are_exact(observed: Path) -> None:
    with Run(observed) as run:
        series = run.series.set_index("step")
        compared = 0
        for frame in run.frames:
            if frame.step not in series.index:
                continue
            free = frame.body == 0
            v = frame.velocity[free]
            mass = frame.mass[free]
            terms = 0.5 * mass * (v[:, 0] * v[:, 0] + v[:, 1] * v[:, 1])
            assert series.loc[frame.step, "energy"] == math.fsum(terms)
            compared += 1
        assert compared > 3


def test_a_run_under_way_is_read_from_its_file(observed: Path, tmp_path: Path) -> None:
    # The log has some of the columns only.
    out = tmp_path / "run"
    words: list[str | Path] = [find("gshear-mpi"), observed.parent / "scene.toml", "--out", out]
    words += ["--set=shear.strain=0.1", '--set=output.columns=["strain"]', "--stop-at=300"]
    done = subprocess.run(words, capture_output=True, check=False)
    assert done.returncode == 75, done.stderr
    with Run(out) as run, Run(observed) as whole:
        assert not run.finished
        rows = len(run.series)
        assert 0 < rows < len(whole.series)
        assert np.array_equal(run.series["energy"], whole.series["energy"][:rows])
