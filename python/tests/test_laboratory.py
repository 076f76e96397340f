"""`gshear-reduce rate-state` on tables of a laboratory, made by SciPy from Dieterich and Ruina."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gshear import programs

Array = NDArray[np.float64]

# Velocities (um/s) and durations (s) of the load point.
DRIVE = ((1.0, 200.0), (10.0, 60.0), (1.0, 300.0), (0.0, 50.0), (1.0, 200.0))
MU_STAR, A, STIFFNESS = 0.6, 0.008, 2e-3
# b, and D_c (um).
ONE = ((0.006, 15.0),)
TWO = ((0.006, 8.0), (0.004, 100.0))
INTERVAL, NOISE = 0.05, 5e-4


@dataclass
class Series:
    """Time (s), displacement of the load point (um) and friction."""

    time: Array
    displacement: Array
    friction: Array


def series(law: str, states: tuple[tuple[float, float], ...]) -> Series:
    """The friction of a spring slider, from steady sliding at 1 um/s.

    The unknowns are mu and theta themselves, where the program integrates ln V and ln theta.
    """
    b, d_c = np.array(states).T

    def rates(_: float, y: Array, drive: float) -> Array:
        mu, theta = y[0], y[1:]
        v = np.exp((mu - MU_STAR - np.sum(b * np.log(theta / d_c))) / A)
        x = v * theta / d_c
        evolution = 1.0 - x if law == "aging" else -x * np.log(x)
        return np.concatenate([[STIFFNESS * (drive - v)], evolution])

    y = np.concatenate([[MU_STAR], d_c])
    time: list[Array] = [np.zeros(1)]
    moved: list[Array] = [np.zeros(1)]
    friction: list[Array] = [np.array([MU_STAR])]
    begin, start = 0.0, 0.0
    for v, duration in DRIVE:
        t = INTERVAL * np.arange(1, round(duration / INTERVAL) + 1)
        found = solve_ivp(
            rates, (0.0, t[-1]), y, "Radau", t_eval=t, args=(v,), rtol=1e-9, atol=1e-11
        )
        assert found.success
        time.append(begin + t)
        moved.append(start + v * t)
        friction.append(found.y[0])
        y, begin, start = found.y[:, -1], begin + duration, start + v * duration
    return Series(*(np.concatenate(parts) for parts in (time, moved, friction)))


def fits(table: Path, *words: str) -> dict[str, Any]:
    """The fits to all data, by law."""
    out = table.parent / "out"
    program = programs.find("gshear-reduce")
    command: list[str | Path] = [program, "rate-state", table, "--out", out, *words]
    programs.run([*command, "--time", "t"], quiet=True)
    found = json.loads((out / "rate-state.json").read_text())
    laws: dict[str, Any] = found["fits"][0]["laws"]
    return laws


@pytest.mark.parametrize("law", ["aging", "slip"])
@pytest.mark.parametrize("states", [ONE, TWO], ids=["one state", "two states"])
def test_what_a_table_is_made_of_comes_back(
    law: str, states: tuple[tuple[float, float], ...], tmp_path: Path
) -> None:
    made = series(law, states)
    random = np.random.default_rng(11)
    trend = 1e-5
    rows = [
        made.time + 1000.0,
        made.displacement + 0.02 * random.normal(size=made.time.size),
        made.friction + trend * made.displacement + NOISE * random.normal(size=made.time.size),
    ]
    table = tmp_path / "steps.csv"
    np.savetxt(
        table, np.stack(rows, axis=1), "%.9g", delimiter=",", header="t,load_point,mu", comments=""
    )
    columns = ("--displacement", "load_point:um", "--friction", "mu", "--detrend")
    # With two state variables everything at once.
    stiffness = f"{STIFFNESS}:1/um" if states == ONE else "fit"
    options = ("--law", law, "--states", str(len(states)), "--stiffness", stiffness)
    fit = fits(table, *columns, *options)[law]
    expected = {"a": A, "trend": trend * 1e6}
    if states == TWO:
        expected["stiffness"] = STIFFNESS * 1e6
    for (b, d_c), end in zip(states, ("", "_2"), strict=False):
        expected |= {f"b{end}": b, f"d_c{end}": d_c * 1e-6}
    for name, value in expected.items():
        low, high = fit[name]["interval"]
        # Twice as long an interval leaves a right value out once in 1e4 times.
        error = abs(fit[name]["value"] - value)
        assert error < high - low < 0.3 * value, f"{name}: {fit[name]} for {value}"
    low, high = fit["a_minus_b"]["interval"]
    assert high - low < 2e-4
    assert fit["rms"] < NOISE


def test_a_step_of_the_law_is_its_closed_form(tmp_path: Path) -> None:
    """A jump of a ln 10 and a relaxation to (a - b) ln 10 over D_c, without a spring (slip law)."""
    random = np.random.default_rng(3)
    time = np.arange(0.0, 200.0, 0.02)
    slip = np.where(time < 100.0, time, 100.0 + 10.0 * (time - 100.0))
    decay = np.exp(-np.maximum(slip - 100.0, 0.0) / 20.0)
    friction = np.where(time <= 100.0, 0.6, 0.6 + np.log(10.0) * (A - 0.006 * (1.0 - decay)))
    friction += NOISE * random.normal(size=time.size)
    table = tmp_path / "step.csv"
    rows = np.stack([time, slip, friction], axis=1)
    np.savetxt(table, rows, "%.9g", delimiter=",", header="t,x,mu", comments="")
    columns = ("--displacement", "x:um", "--friction", "mu", "--law", "slip")
    fit = fits(table, *columns, "--stiffness", "fit")["slip"]
    for name, value in {"a": A, "b": 0.006, "d_c": 20e-6, "a_minus_b": A - 0.006}.items():
        low, high = fit[name]["interval"]
        error = abs(fit[name]["value"] - value)
        assert error < high - low < 0.1 * value, f"{name}: {fit[name]} for {value}"
    # On a softer spring the slider would need more than a row, 0.2 um, to follow the step.
    low, _ = fit["stiffness"]["interval"]
    assert low > A / 0.2e-6
