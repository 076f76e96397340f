"""`gshear-reduce rate-state` on tables of a laboratory, made by SciPy from Dieterich and Ruina."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts/validation"))

from laboratory import NOISE, Law, fitted, slider

# Velocities (um/s) and durations (s) of the load point.
DRIVE = ((1.0, 200.0), (10.0, 60.0), (1.0, 300.0), (0.0, 50.0), (1.0, 200.0))


@pytest.mark.parametrize("evolution", ["aging", "slip"])
@pytest.mark.parametrize("states", [1, 2], ids=["one state", "two states"])
def test_what_a_table_is_made_of_comes_back(evolution: str, states: int, tmp_path: Path) -> None:
    b, d_c = ((0.006,), (15.0,)) if states == 1 else ((0.006, 0.004), (8.0, 100.0))
    law = Law(evolution, 0.008, b, d_c, stiffness=2e-3, trend=1e-5)
    made = slider(law, DRIVE, 0.05)
    table = tmp_path / "steps.csv"
    made.write(table, law.trend, np.random.default_rng(11))
    # With two state variables everything at once.
    stiffness = f"{law.stiffness}:1/um" if states == 1 else "fit"
    options = ("--states", str(states), "--stiffness", stiffness, "--detrend")
    fit = fitted(table, "--law", evolution, *options)[evolution]
    expected = law.parameters()
    del expected["a_minus_b"]
    if states == 1:
        del expected["stiffness"]
    for name, value in expected.items():
        low, high = fit[name]["interval"]
        # Twice as long an interval leaves a right value out once in 1e4 times.
        error = abs(fit[name]["value"] - value)
        assert error < high - low < 0.3 * value, f"{name}: {fit[name]} for {value}"
    low, high = fit["a_minus_b"]["interval"]
    assert high - low < 2e-4
    assert fit["rms"] < NOISE


def test_given_parameters_predict_both_laws(tmp_path: Path) -> None:
    """The curves of a law that is given are those of another integrator, for steps and holds."""
    a, b, d_c, stiffness = 0.0247, 0.0178, 12.0, 4e-3
    laws = {name: Law(name, a, (b,), (d_c,), stiffness) for name in ("aging", "slip")}
    curves = {name: slider(law, DRIVE, 0.1).friction for name, law in laws.items()}
    made = slider(laws["aging"], DRIVE, 0.1)
    table = tmp_path / "steps.csv"
    rows = np.stack([made.time, made.displacement, made.friction], axis=1)
    np.savetxt(table, rows, "%.12g", delimiter=",", header="t,x,mu", comments="")
    given = f"a={a},b={b},d_c={d_c * 1e-6}"
    laws_found = fitted(table, "--given", given, "--stiffness", f"{stiffness}:1/um")
    columns = np.genfromtxt(tmp_path / "steps/rate-state.csv", delimiter=",", names=True)
    assert columns.size == made.time.size
    # Steps and holds tell the laws apart: not by a constant alone.
    assert np.ptp(curves["aging"] - curves["slip"]) > 0.01
    for name, curve in curves.items():
        # mu* is fitted: the mean that is left of the data belongs to it.
        shift = laws_found[name]["mu_star"]["value"] - 0.6
        predicted = columns[f"mu_{name}"]
        assert np.max(np.abs(predicted - curve - shift)) < 1e-5, name
    assert abs(laws_found["aging"]["mu_star"]["value"] - 0.6) < 1e-6
    assert laws_found["aging"]["rms"] < 1e-6 < 1e-3 < laws_found["slip"]["rms"]


def test_a_step_of_the_law_is_its_closed_form(tmp_path: Path) -> None:
    """A jump of a ln 10 and a relaxation to (a - b) ln 10 over D_c, without a spring (slip law)."""
    a, b, d_c = 0.008, 0.006, 20.0
    time = np.arange(0.0, 200.0, 0.02)
    moved = np.where(time < 100.0, time, 100.0 + 10.0 * (time - 100.0))
    decay = np.exp(-np.maximum(moved - 100.0, 0.0) / d_c)
    friction = np.where(time <= 100.0, 0.6, 0.6 + np.log(10.0) * (a - b * (1.0 - decay)))
    friction += NOISE * np.random.default_rng(3).normal(size=time.size)
    table = tmp_path / "step.csv"
    rows = np.stack([time, moved, friction], axis=1)
    np.savetxt(table, rows, "%.9g", delimiter=",", header="t,x,mu", comments="")
    fit = fitted(table, "--law", "slip", "--stiffness", "fit")["slip"]
    for name, value in {"a": a, "b": b, "d_c": d_c * 1e-6, "a_minus_b": a - b}.items():
        low, high = fit[name]["interval"]
        error = abs(fit[name]["value"] - value)
        assert error < high - low < 0.1 * value, f"{name}: {fit[name]} for {value}"
    # On a softer spring the slider would need more than a row, 0.2 um, to follow the step.
    low, _ = fit["stiffness"]["interval"]
    assert low > a / 0.2e-6
