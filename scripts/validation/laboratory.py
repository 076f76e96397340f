#!/usr/bin/env python3
"""Fits of `gshear-reduce rate-state` to laboratory series, for docs/validation/laboratory.md.

laboratory.py made OUT RSFMODEL             series that rsfmodel makes
laboratory.py random OUT                    series of random laws with two state variables
laboratory.py measured OUT RSFMODEL TABLES  measured steps, fitted here and by rsfmodel

RSFMODEL is a checkout of github.com/jrleeman/rsfmodel, TABLES one of the branch
Demo-velocity-stepping-tests of github.com/pgiacomel/steadystate.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.integrate
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gshear import programs

Array = NDArray[np.float64]

MU_STAR = 0.6
# Standard deviations of mu and of the displacement (um).
NOISE = 5e-4
DISPLACEMENT_NOISE = 0.02
# a and D_c (um) of the starts of the search with rsfmodel.
STARTS = ((0.005, 5.0), (0.01, 20.0), (0.015, 100.0), (0.03, 10.0), (0.03, 0.5))
# Residual of a failed integration.
FAILED = 1e3
FIT = ("--stiffness", "fit", "--detrend")


@dataclass
class Law:
    """A spring slider; lengths in um, times in s."""

    evolution: str
    a: float
    b: tuple[float, ...]
    d_c: tuple[float, ...]
    stiffness: float
    trend: float = 0.0

    def parameters(self) -> dict[str, float]:
        """Its parameters by the names of fits.csv, in SI units."""
        found = {
            "a": self.a,
            "a_minus_b": self.a - sum(self.b),
            "stiffness": self.stiffness * 1e6,
            "trend": self.trend * 1e6,
        }
        for end, b, d_c in zip(("", "_2"), self.b, self.d_c, strict=False):
            found |= {f"b{end}": b, f"d_c{end}": d_c * 1e-6}
        return found


@dataclass
class Series:
    """Time (s), displacement of the load point (um) and friction."""

    time: Array
    displacement: Array
    friction: Array

    def write(self, table: Path, trend: float, random: np.random.Generator) -> None:
        """Writes a table of it with a trend of mu (1/um) and noise."""
        rows = [
            self.time,
            self.displacement + DISPLACEMENT_NOISE * random.normal(size=self.time.size),
            self.friction + trend * self.displacement + NOISE * random.normal(size=self.time.size),
        ]
        table.parent.mkdir(parents=True, exist_ok=True)
        columns = np.stack(rows, axis=1)
        np.savetxt(table, columns, "%.9g", delimiter=",", header="t,x,mu", comments="")


@dataclass
class Step:
    """A velocity step: time (s), velocities of the load point (um/s)."""

    time: float
    before: float
    after: float


# Velocity (um/s) and duration (s) of the load point.
Drive = tuple[tuple[float, float], ...]


def slider(law: Law, drive: Drive, interval: float) -> Series:
    """The friction of a spring slider, from steady sliding at 1 um/s, a row each interval.

    The unknowns are mu and theta themselves, where the program integrates ln V and ln theta.
    """
    b, d_c = np.array(law.b), np.array(law.d_c)

    def rates(_: float, y: Array, load_point: float) -> Array:
        mu, theta = y[0], y[1:]
        v = np.exp((mu - MU_STAR - np.sum(b * np.log(theta / d_c))) / law.a)
        x = v * theta / d_c
        evolution = 1.0 - x if law.evolution == "aging" else -x * np.log(x)
        return np.concatenate([[law.stiffness * (load_point - v)], evolution])

    y = np.concatenate([[MU_STAR], d_c])
    time, moved, friction = [np.zeros(1)], [np.zeros(1)], [np.array([MU_STAR])]
    begin, start = 0.0, 0.0
    for v, duration in drive:
        t = interval * np.arange(1, round(duration / interval) + 1)
        found = scipy.integrate.solve_ivp(
            rates, (0.0, t[-1]), y, "Radau", t_eval=t, args=(v,), rtol=1e-9, atol=1e-11
        )
        if not found.success:
            raise ArithmeticError(found.message)
        time.append(begin + t)
        moved.append(start + v * t)
        friction.append(found.y[0])
        y, begin, start = found.y[:, -1], begin + duration, start + v * duration
    return Series(*(np.concatenate(parts) for parts in (time, moved, friction)))


def fitted(table: Path, *words: str, columns: tuple[str, ...] = ()) -> dict[str, Any]:
    """The fits to all data of a table, by law."""
    out = table.with_suffix("")
    columns = columns or ("--time", "t", "--displacement", "x:um", "--friction", "mu")
    program = programs.find("gshear-reduce")
    command: list[str | Path] = [program, "rate-state", table, "--out", out, *columns, *words]
    programs.run(command, quiet=True)
    found = json.loads((out / "rate-state.json").read_text())
    laws: dict[str, Any] = found["fits"][0]["laws"]
    return laws


def cells(fit: dict[str, Any]) -> str:
    """The parameters of a fit with their intervals."""
    names = ("a", "b", "d_c", "b_2", "d_c_2", "stiffness", "trend")
    found = (
        f"{name} {fit[name]['value']} {fit[name]['interval']}" for name in names if name in fit
    )
    return "; ".join(found) + f"; rms {fit['rms']:.4e}"


@dataclass
class RsfModel:
    """The module rsfmodel of a checkout."""

    module: Any

    @classmethod
    def of(cls, checkout: Path) -> RsfModel:
        """Imports it."""
        # Its name until SciPy 1.14.
        scipy.integrate.cumtrapz = scipy.integrate.cumulative_trapezoid
        sys.path.insert(0, str(checkout))
        from rsfmodel import rsf, staterelations

        rsf.staterelations = staterelations
        return cls(rsf)

    def friction(self, law: Law, time: Array, velocity: Array, tolerance: float) -> Array:
        """Friction at times (s, from 0) under velocities of the load point from each row on."""
        relations = self.module.staterelations
        kind = relations.DieterichState if law.evolution == "aging" else relations.RuinaState
        model = self.module.Model()
        model.mu0, model.a, model.vref, model.k = MU_STAR, law.a, velocity[0], law.stiffness
        for b, d_c in zip(law.b, law.d_c, strict=True):
            state = kind()
            state.b, state.Dc = b, d_c
            model.state_relations.append(state)
        model.time, model.loadpoint_velocity = time, velocity
        model.solve(rtol=tolerance, atol=tolerance)
        found: Array = np.array(model.results.friction)
        return found


def made(out: Path, checkout: Path) -> None:
    """Series that rsfmodel makes."""
    rsfmodel = RsfModel.of(checkout)
    interval = 0.1
    drive = ((1.0, 100.0), (10.0, 60.0), (1.0, 200.0), (0.0, 100.0), (1.0, 200.0), (3.0, 100.0))
    velocity = np.concatenate([np.full(round(s / interval), v) for v, s in drive])
    time = interval * np.arange(velocity.size)
    moved = np.concatenate([[0.0], np.cumsum(interval * velocity[:-1])])
    for evolution in ("aging", "slip"):
        for states in (1, 2):
            law = Law(evolution, 0.008, (0.006, 0.004)[:states], (15.0, 150.0)[:states], 2e-3, 1e-5)
            series = Series(time, moved, rsfmodel.friction(law, time, velocity, 1e-12))
            table = out / f"{evolution}-{states}.csv"
            series.write(table, law.trend, np.random.default_rng(1))
            words = ("--law", evolution, "--states", str(states), *FIT)
            print(f"{evolution}, {states}: {cells(fitted(table, *words)[evolution])}")


def random_law(evolution: str, random: np.random.Generator) -> Law:
    """A law with two state variables that slides steadily on its spring."""
    while True:
        a = float(np.exp(random.uniform(np.log(0.003), np.log(0.02))))
        b = a * np.array([random.uniform(0.3, 1.2), random.uniform(-0.6, 0.6)])
        d_c = 5.0 * 6.4 ** random.uniform()
        stiffness = 5e-4 * 20.0 ** random.uniform()
        # The critical stiffness if both states evolved over the lesser D_c.
        if stiffness * d_c > 1.5 * (np.maximum(b, 0.0).sum() - a):
            lengths = (d_c, d_c * 4.0 ** random.uniform(1.0, 2.0))
            return Law(
                evolution, a, tuple(b.tolist()), lengths, stiffness, random.uniform(-2e-5, 2e-5)
            )


def random_laws(out: Path) -> None:
    """How often the intervals of fits hold the parameters, and how far off these are."""
    count = 24
    random = np.random.default_rng(5)
    drive = ((1.0, 200.0), (10.0, 60.0), (1.0, 300.0), (0.0, 50.0), (1.0, 200.0))
    held: dict[str, int] = {}
    worst: dict[str, float] = {}
    for k in range(count):
        law = random_law(("aging", "slip")[k % 2], random)
        table = out / f"law-{k}.csv"
        slider(law, drive, 0.1).write(table, law.trend, random)
        fit = fitted(table, "--law", law.evolution, "--states", "2", *FIT)[law.evolution]
        print(f"{law}\n    {cells(fit)}")
        for name, value in law.parameters().items():
            low, high = fit[name]["interval"]
            held[name] = held.get(name, 0) + (low <= value <= high)
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            worst[name] = max(worst.get(name, 0.0), abs(value - middle) / half)
    for name in held:
        print(f"{name}: held {held[name]} of {count}, at most {worst[name]:.2f} half intervals off")


def fitted_by_rsfmodel(
    rsfmodel: RsfModel, start: Law, series: Series, step: Step
) -> tuple[Law, float]:
    """The least squares of all rows by rsfmodel and SciPy from a start, and their root mean."""
    change, before, after = step.time, step.before, step.after
    states = len(start.b)

    def law(x: Array) -> Law:
        lengths = np.exp(x[2 + states : 2 + 2 * states])
        b = x[1 : 1 + states]
        return Law(
            start.evolution,
            float(np.exp(x[0])),
            tuple(b.tolist()),
            tuple(lengths.tolist()),
            float(np.exp(x[1 + states])),
        )

    linear = np.stack([np.ones_like(series.time), series.displacement], axis=1)

    # A row at the change of the velocity, for the integration alone.
    time = np.sort(np.append(series.time, change))
    is_row = time != change
    velocity = np.where(time < change, before, after)

    def residuals(x: Array) -> Array:
        try:
            model = rsfmodel.friction(law(x), time, velocity, 1e-8)
        except (OverflowError, ValueError):
            return np.full_like(series.time, FAILED)
        rest = series.friction - model[is_row]
        if not np.all(np.isfinite(rest)):
            return np.full_like(rest, FAILED)
        return rest - linear @ np.linalg.lstsq(linear, rest, rcond=None)[0]

    x = np.concatenate([[np.log(start.a)], start.b, [np.log(start.stiffness)], np.log(start.d_c)])
    found = least_squares(residuals, x, x_scale=0.1, diff_step=1e-4)
    return law(found.x), float(np.sqrt(np.mean(found.fun**2)))


def measured(out: Path, checkout: Path, tables: Path) -> None:
    """Measured steps, fitted here and by rsfmodel, by the slip law."""
    rsfmodel = RsfModel.of(checkout)
    out.mkdir(parents=True, exist_ok=True)
    for name, stress in (
        ("velstep4_BRAVA_expb819_basalt", "Normal_stress(MPa)"),
        ("velstep3_TR2_exp013_sepiolite", "Effective_Normal_stress(MPa)"),
    ):
        table = out / f"{name}.txt"
        table.write_bytes((tables / table.name).read_bytes())
        columns = ("--time", "Time(s)", "--displacement", "Displ(microns):um")
        columns += ("--friction", "Friction", "--normal-stress", f"{stress}:MPa")
        for states in ("1", "2"):
            words = ("--law", "slip", "--states", states, *FIT)
            fit = fitted(table, *words, columns=columns)["slip"]
            print(f"{name}, {states}: {cells(fit)}")
        found = json.loads((out / name / "rate-state.json").read_text())
        before, after = found["experiments"][0]["protocol"]
        data = np.loadtxt(table, skiprows=1).T
        # As here, the fit begins half-way through the first segment.
        since = data[0] - data[0, 0]
        data = data[:, since >= 0.5 * before["duration"]]
        series = Series(data[0] - data[0, 0], data[1] - data[1, 0], data[2])
        change = before["duration"] - (since[-1] - series.time[-1])
        step = Step(change, 1e6 * before["velocity"], 1e6 * after["velocity"])
        for states in (1, 2):
            for a, d_c in STARTS:
                b = (0.8 * a, 0.2 * a)[:states]
                start = Law("slip", a, b, (d_c, 8.0 * d_c)[:states], 2e-3)
                law, rms = fitted_by_rsfmodel(rsfmodel, start, series, step)
                print(f"{name}, {states}, rsfmodel: {law}; rms {rms:.4e}", flush=True)


def main() -> None:
    """Prints the numbers of the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    kinds = parser.add_subparsers(required=True, dest="series")
    for kind, sources in (
        ("made", ["rsfmodel"]),
        ("random", []),
        ("measured", ["rsfmodel", "tables"]),
    ):
        of_kind = kinds.add_parser(kind)
        for name in ["out", *sources]:
            of_kind.add_argument(name, type=Path)
    given = parser.parse_args()
    if given.series == "made":
        made(given.out, given.rsfmodel)
    elif given.series == "random":
        random_laws(given.out)
    else:
        measured(given.out, given.rsfmodel, given.tables)


if __name__ == "__main__":
    main()
