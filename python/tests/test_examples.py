"""The examples in Python: run on a small run, and their statistics against known cases."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from gshear import Run, simulate

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENES = Path(__file__).resolve().parents[2] / "tests" / "scenes"


def example(name: str) -> ModuleType:
    # They import each other, as a script's neighbours.
    sys.path.insert(0, str(EXAMPLES))
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.path.remove(str(EXAMPLES))
    return module


@pytest.fixture(scope="module")
def precursors() -> ModuleType:
    return example("slip_precursors")


def test_areas_and_ranks_of_known_cases(precursors: ModuleType) -> None:
    assert precursors.roc_area(np.array([2.0, 3.0]), np.array([0.0, 1.0])) == 1.0
    assert precursors.roc_area(np.array([1.0, 1.0]), np.array([1.0])) == 0.5
    # Of the six pairs three are above and two are ties.
    assert precursors.roc_area(np.array([1.0, 2.0]), np.array([0.0, 1.0, 2.0])) == 4 / 6
    random = np.random.default_rng(1)
    x = np.arange(20.0)
    rho, p = precursors.spearman(x, np.exp(-x), random)
    assert rho == pytest.approx(-1.0)
    assert p < 1e-3
    rho, p = precursors.spearman(x, random.permutation(x), random)
    assert p > 0.01
    apart = [pd.DataFrame({"run": 0, "x": values}) for values in (x + 30.0, x)]
    assert precursors.interval(*apart, "x", random) == [1.0, 1.0]


def test_intervals_of_several_runs_are_those_of_the_runs(precursors: ModuleType) -> None:
    """Of two runs, in one of which everything is above and in the other below."""
    random = np.random.default_rng(1)
    high = pd.DataFrame({"run": [0, 0, 1, 1], "x": [2.0, 2.0, 0.0, 0.0]})
    low = pd.DataFrame({"run": [0, 1], "x": [1.0, 1.0]})
    assert precursors.interval(high, low, "x", random) == [0.0, 1.0]
    # Within one run the same values leave both ends between.
    low_end, high_end = precursors.interval(high.assign(run=0), low.assign(run=0), "x", random)
    assert 0.0 <= low_end < 0.5 < high_end <= 1.0


@pytest.mark.parametrize(("stored", "gap"), [(True, 32), (False, 32), (False, 0)])
def test_slips_of_a_run_are_reduced(
    stored: bool,
    gap: int,
    precursors: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With frames at every row, and with frames from replays, also of single rows."""
    monkeypatch.setattr(precursors, "GAP", gap)
    values: dict[str, object] = {"shear.inertial_number": 5e-3, "shear.strain": 0.03}
    values |= {"output.series_strain": 5e-4, "output.frame_strain": 5e-4 if stored else 0.0}
    values |= {"output.keep_checkpoints": "true", "output.checkpoint_strain": 5e-3}
    run = simulate(SCENES / "crossing.toml", tmp_path / "run", ranks=1, values=values, quiet=True)
    out = tmp_path / "out"
    few = ["--slips=3", "--before=0,2", "--random=3", "--dmin=3"]
    precursors.main([str(run), f"--out={out}", *few])
    assert "3 slips and 3 frames at random times of 1 runs" in capsys.readouterr().out
    table = pd.read_csv(out / "precursors.csv")
    assert sorted(table["before"]) == [-1] * 3 + [0] * 3 + [2] * 3
    assert (table["contacts"] > 0).all()
    # The frames are those of the rows at the start of the slips.
    with Run(run, quiet=True) as original:
        phases = original.phases()
    for _, line in table[table["before"] == 0].iterrows():
        slip = phases[np.isclose(-phases["delta_tau_p"], line["size"], rtol=1e-12)]
        assert slip["start_step"].tolist() == [line["step"]]
    tests = pd.read_csv(out / "precursors-tests.csv")
    assert len(tests) == 2 * (len(precursors.MEASURES) + 2)
    assert tests["roc_area"].between(0, 1).all()
    assert (out / "precursors.svg").stat().st_size > 10_000
    # D²min of a replay is that of a run whose frames are written at once.
    values["output.frame_strain"] = 5e-4
    again = simulate(
        SCENES / "crossing.toml", tmp_path / "again", ranks=1, values=values, quiet=True
    )
    with Run(again, quiet=True) as original:
        numbers = original.frames.step.tolist()
        for state in table.to_dict("records"):
            frame = numbers.index(state["step"])
            dmin = original.dmin(frame, lag=3)[original.frames[0].body == 0]
            greatest = np.nanmax(dmin) / np.mean(original.frames[0].radius) ** 2
            assert state["dmin_greatest"] == pytest.approx(greatest, rel=1e-12)
            assert state["dmin_top_tenth"] < state["dmin_greatest"]
    if not stored:
        return
    # Several runs, here twice the same, with all measures.
    both = tmp_path / "both"
    precursors.main(
        [str(run), str(run), f"--out={both}", *few, "--dampers", "--calm=1", "--probes"]
    )
    pooled = pd.read_csv(both / "precursors.csv")
    assert (pooled.groupby("run").size() == len(table)).all()
    assert (pooled["growing"] == pooled["negative"]).all()
    assert (pooled["growing_pairs"] <= pooled["pairs"]).all()
    tests = pd.read_csv(both / "precursors-tests.csv")
    assert len(tests) == 2 * len(precursors.ALL)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_slab_as_high_as_the_layer_goes_on_as_the_run(dimension: int, tmp_path: Path) -> None:
    """Its τ is that of the run; lower slabs begin at the same τ, and bear more than the weakest."""
    local_yield = example("local_yield")
    values: dict[str, object] = {"shear.inertial_number": 5e-3, "shear.strain": 0.02}
    values |= {"output.series_strain": 1e-4, "output.frame_strain": 1e-3}
    if dimension == 3:
        part = {"velocity": 0.05, "time": 2e-3}
        values = {"shear.spring_number": None, "shear.protocol": [part]}
        values |= {"output.series_rows": 200, "output.frame_rows": 20}
    scene = SCENES / ("crossing.toml" if dimension == 2 else "crossing-3d.toml")
    path = simulate(scene, tmp_path / "run", ranks=1, values=values, quiet=True)
    with Run(path, quiet=True) as run:
        tau, slip, step = (run.series[c].to_numpy() for c in ("stress_ratio", "slip", "step"))
        starts = np.searchsorted(step, run.frames.step[1:-2])
        # Where τ rises most.
        frame = int(np.argmax([tau[at + 20] - tau[at] for at in starts])) + 1
        start, end = starts[frame - 1], starts[frame - 1] + 20
        rise = tau[start : end + 1].max() - tau[start]
        diameter = 2.0 * float(np.mean(run.frames[frame].radius))
        distance = (slip[end] - slip[start]) / diameter
        whole = local_yield.probed(run, frame, local_yield.Probe(1e3, 1.0, distance))
        assert len(whole) == 1
        assert whole["grains"].tolist() == [(run.frames[frame].body == 0).sum()]
        assert whole["stress_ratio"].tolist() == [tau[start]]
        assert whole["local_yield"][0] == pytest.approx(rise, rel=0.05)
        words = [str(path), str(frame), "1", f"--out={tmp_path / 'out'}", "--height=3"]
        local_yield.main([*words, "--spacing=2"])
        with pytest.raises(SystemExit, match="2"):
            local_yield.main([str(path), "99", f"--out={tmp_path / 'none'}"])
    assert not (tmp_path / "none").exists()
    table = pd.read_csv(tmp_path / "out/local-yield.csv")
    assert (table.groupby("frame").size() >= 2).all()
    assert (table["grains"] > 5).all()
    assert table["local_yield"].max() > rise


def test_stress_and_energy_of_a_relaxation_are_those_of_the_program(
    originals: Callable[[str], Path],
) -> None:
    """Of every frame; and what is at rest stays as it is."""
    relaxation = example("relax_end_state")
    with Run(originals("box") / "run.h5/newtonian", quiet=True) as run:
        for index, step in enumerate(run.frames.step):
            state = relaxation.State(run, index)
            row = run.series[run.series.step == step].iloc[0]
            assert state.energy == pytest.approx(row.elastic_energy, rel=1e-11)
            assert state.stress == pytest.approx(row.shear_stress, rel=1e-9)
        energy = state.energy
        assert state.relax(0.2, 0.4, 1000) < relaxation.AT_REST
        assert state.energy == pytest.approx(energy, rel=1e-9)
        # Once a grain is moved, the packing comes to rest again and loses the work.
        state.x[0] += 0.01 * state.radius[0]
        state.evaluate(0.0)
        moved = state.energy
        assert moved > (1.0 + 1e-6) * energy
        assert state.relax(0.2, 0.4, 20000) < relaxation.AT_REST
        assert state.energy < moved - 0.9 * (moved - energy)


def test_the_history_of_a_relaxation_turns_about_the_normal(
    originals: Callable[[str], Path],
) -> None:
    """Two grains that spin as a rigid body about the line through both, by 1.2 rad."""
    relaxation = example("relax_end_state")
    with Run(originals("box") / "run.h5/newtonian", quiet=True) as run:
        state = relaxation.State(run, 0)
    radius, overlap, angle, steps = 0.5, 1e-3, 1.2, 60
    state.radius, state.mass = np.full(2, radius), np.ones(2)
    state.x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * radius - overlap]])
    state.v, state.spin = np.zeros((2, 3)), np.array([[0.0, 0.0, angle]] * 2)
    state.find({(0, 1): np.array([1e-4, 0.0, 0.0])})
    for _ in range(steps):
        state.evaluate(1.0 / steps)
    expected = 1e-4 * np.array([[np.cos(angle), np.sin(angle), 0.0]])
    np.testing.assert_allclose(state.t, expected, atol=1e-15)
