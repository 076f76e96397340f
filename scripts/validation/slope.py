#!/usr/bin/env python3
"""Steady flows down slopes and their velocity profiles, for docs/validation/physics.md.

slope.py OUT.svg RUN...     (branches of a run of slope.toml, one for each angle)
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import matplotlib as mpl
import numpy as np
from scipy.optimize import curve_fit

from gshear import Run

mpl.use("svg")
import matplotlib.pyplot as plt

# Last share of a run that is measured, and the consecutive blocks whose means give the errors.
SHARE, BLOCKS = 0.38, 5
# Slower ones are at rest (d, g and m of 1).
MOVING = 0.05


def bagnold(z: np.ndarray, rate: float, height: float) -> np.ndarray:
    """The velocity of a constant ratio of the stresses (Bagnold), no slip at the bottom."""
    return rate * (height**1.5 - np.clip(height - z, 0.0, None) ** 1.5)


def profile(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Height above the bottom and mean velocity of layers of a diameter, but the outermost."""
    first, axis = run.frame(0), run.dimension - 1
    times = run.frames.time
    late = np.flatnonzero(times > (1.0 - SHARE) * times[-1])
    free = first.body == 0
    bottom = first.position[~free, axis].max()
    height = run.array("position", late)[:, free, axis].ravel() - bottom
    velocity = run.array("velocity", late)[:, free, 0].ravel()
    layer = np.floor(height).astype(int)
    full = np.bincount(layer[layer >= 0])
    layers = np.flatnonzero(full > 0.4 * np.median(full[full > 0]))
    mean = [velocity[layer == k].mean() for k in layers]
    return layers + 0.5, np.array(mean)


def misfit(found: np.ndarray, fitted: np.ndarray) -> float:
    """Root mean square of the difference, over the greatest velocity."""
    return float(np.sqrt(np.mean((found - fitted) ** 2)) / found.max())


def main() -> None:
    """Prints a table, and draws the profiles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("runs", type=Path, nargs="+")
    given = parser.parse_args()
    runs = sorted((Run(path) for path in given.runs), key=lambda run: run.scene["load.incline"])
    rows = []
    axes = plt.figure(figsize=(6.0, 4.2)).subplots()
    for run in runs:
        angle = run.scene["load.incline"]
        series = run.series
        late = series[series.time > (1.0 - SHARE) * series.time.iloc[-1]]

        def error(column: str, late=late) -> float:  # noqa: ANN001
            means = [block.mean() for block in np.array_split(late[column].to_numpy(), BLOCKS)]
            return float(np.std(means, ddof=1) / BLOCKS**0.5)

        ratio = late.shear_force.mean() / late.normal_force.mean()
        row = [angle, np.tan(np.radians(angle)), ratio, error("stress_ratio")]
        row += [late.mean_velocity.mean(), error("mean_velocity")]
        row += [late.solid_fraction.mean(), late.wall_height.mean()]
        height, velocity = profile(run)
        if velocity.max() > MOVING:
            start = [velocity.max() / row[-1] ** 1.5, row[-1]]
            bounds = ([0.0, 1.0], [np.inf, 1e3])
            (rate, depth), _ = curve_fit(bagnold, height, velocity, p0=start, bounds=bounds)
            line = np.polyval(np.polyfit(height, velocity, 1), height)
            row += [depth, misfit(velocity, bagnold(height, rate, depth)), misfit(velocity, line)]
            (points,) = axes.plot(velocity, height, "o", ms=3.5, label=f"{angle:g}°")
            z = np.linspace(0.0, height[-1] + 0.5, 100)
            axes.plot(bagnold(z, rate, depth), z, color=points.get_color(), lw=1.0)
        rows.append(row)
    names = ["angle", "tan", "ratio", "ratio_error", "velocity", "velocity_error"]
    names += ["fraction", "height", "bagnold_height", "bagnold_misfit", "line_misfit"]
    print(*names)
    for row in rows:
        print(*(f"{x:.4g}" for x in row))
    with given.out.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([[f"{x:.6g}" for x in row] for row in rows])
    axes.set_xlabel("velocity along the slope, over √(g d)")
    axes.set_ylabel("height above the bottom, over d")
    axes.legend(frameon=False)
    axes.figure.tight_layout()
    axes.figure.savefig(given.out, metadata={"Date": None})


if __name__ == "__main__":
    main()
