#!/usr/bin/env python3
"""Figure of run time against error from the table of `benches/peers/run --errors`, and ratios at equal error.

errors.py errors.csv FIGURE.svg     (in the environment of scripts/python-env)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

mpl.use("svg")
import matplotlib.pyplot as plt

# Errors of the positions at which run times are compared.
EQUAL = [1e-3, 2.5e-4, 1e-4]


def seconds_at(rows: pd.DataFrame, error: float) -> float:
    """Run time (s) of one program at an error of the positions, by a power law between its steps.

    NaN outside its errors.
    """
    rows = rows.sort_values("position_error")
    errors, seconds = np.log(rows.position_error), np.log(rows.seconds)
    return float(np.exp(np.interp(np.log(error), errors, seconds, left=np.nan, right=np.nan)))


def main() -> None:
    """Draws the table, and prints the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path)
    parser.add_argument("figure", type=Path)
    arguments = parser.parse_args()
    table = pd.read_csv(arguments.table)
    scenes = list(table.groupby(["scene", "grains"], sort=False))
    figure, axes = plt.subplots(
        1, len(scenes), figsize=(0.4 + 3.4 * len(scenes), 3.4), sharex=True, squeeze=False
    )
    for axis, ((scene, grains), of_scene) in zip(axes[0], scenes, strict=True):
        programs = list(of_scene.groupby("program", sort=False))
        for (name, rows), marker in zip(programs, "os^D", strict=False):
            axis.loglog(rows.position_error, rows.seconds, marker=marker, ms=4.5, label=name)
            ours = programs[0][1]
            ratios = [seconds_at(rows, error) / seconds_at(ours, error) for error in EQUAL]
            said = ", ".join(f"{r:.2f} at {e:g}" for r, e in zip(ratios, EQUAL, strict=True))
            print(f"{scene}, {grains} grains, {name} over {programs[0][0]}: {said}")
        axis.set(title=f"{scene}, {grains:,} grains", xlabel="error of the positions")
        axis.grid(which="major", lw=0.4, alpha=0.5)
        axis.legend(frameon=False, fontsize=8)
    axes[0][0].set_ylabel("run time of the motion (s)")
    figure.tight_layout()
    figure.savefig(arguments.figure)


if __name__ == "__main__":
    main()
