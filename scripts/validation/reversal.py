#!/usr/bin/env python3
"""Stress and fabric after a reversal of the shear, for docs/validation/physics.md.

reversal.py OUT.svg FAST SLOW     (folders of the sweep of reversal-3d.toml at two rates)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

from gshear import Run
from gshear.analysis import fabric

mpl.use("svg")
import matplotlib.pyplot as plt

# Strains since the reversal.
STRAINS = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.4])
GRID = np.linspace(0.0, 1.4, 141)
# Means are over this strain on both sides of a place.
WINDOW = 0.01


def over_strain(strain: np.ndarray, values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Means of a column about strains."""
    near = [np.abs(strain - place) <= WINDOW for place in places]
    return np.array([values[at].mean() if at.any() else np.nan for at in near])


def courses(path: Path, places: np.ndarray) -> np.ndarray:
    """Pressure over that before the reversal, shear stress over P, and -F_xz/F_xz before it."""
    with Run(path, quiet=True) as run:
        series = run.series
        strain = series["strain"].to_numpy()
        turn = int(np.argmax(strain))
        before = slice(turn // 2, turn)
        normal = [series[f"stress_{axis}{axis}"].to_numpy() for axis in "xyz"]
        pressure = np.mean(normal, axis=0)
        mu = series["shear_force"].to_numpy() / series["normal_force"].to_numpy() * normal[2]
        mu = mu / pressure
        since = strain[turn] - strain[turn:]
        found = [
            over_strain(since, pressure[turn:], places) / pressure[before].mean(),
            over_strain(since, mu[turn:], places) / mu[before].mean(),
        ]
        frames = run.frames
        turned = int(np.argmax(frames.strain))
        shear = np.array([fabric(frame.contacts.normal)[0, 2] for frame in frames])
        since = frames.strain[turned] - frames.strain[turned:]
        steady = shear[turned // 2 : turned].mean()
        found.append(np.interp(places, since, shear[turned:] / steady))
    return np.array(found)


def main() -> None:
    """Prints a table, and draws the courses."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("sweeps", type=Path, nargs=2, metavar="SWEEP")
    given = parser.parse_args()
    names = ("P over that before", "σ_xz/P over that before", "fabric over that before")
    figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.0), layout="constrained", sharex=True)
    for sweep, label, color in zip(given.sweeps, ("fast", "slow"), ("C0", "C1"), strict=True):
        runs = sorted(sweep.glob("seed-*"))
        table = np.array([courses(path, STRAINS) for path in runs])
        curves = np.array([courses(path, GRID) for path in runs])
        for k, (name, panel) in enumerate(zip(names, panels, strict=True)):
            mean, error = (
                of(table[:, k], axis=0) for of in (np.mean, lambda x, axis: x.std(axis, ddof=1))
            )
            cells = ", ".join(
                f"{m:.2f} ± {e / np.sqrt(len(runs)):.2f}" for m, e in zip(mean, error, strict=True)
            )
            print(f"{label}, {name}: {cells}")
            middle = np.nanmean(curves[:, k], axis=0)
            spread = np.nanstd(curves[:, k], axis=0, ddof=1) / np.sqrt(len(runs))
            panel.plot(GRID, middle, color=color, label=label)
            panel.fill_between(GRID, middle - spread, middle + spread, color=color, alpha=0.2)
            panel.set(xlabel="strain since the reversal", ylabel=name)
            panel.axhline(0.0, color="black", linewidth=0.5)
    panels[0].legend()
    figure.savefig(given.out, metadata={"Date": None})


if __name__ == "__main__":
    main()
