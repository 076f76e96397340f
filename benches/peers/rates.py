#!/usr/bin/env python3
"""Speed of gshear-mpi over the faster LAMMPS, over the inertial number and the size, for
docs/validation/peers.md.

rates.py PEERS.csv OUT.svg     (in the environment of scripts/python-env; of `make peers PEERS="--ranks 1 --inertial-numbers …"`)

Prints a table of the speeds and ratios.
"""

import argparse
import csv
from collections import defaultdict
from pathlib import Path

import matplotlib as mpl

mpl.use("svg")
import matplotlib.pyplot as plt

NAMES = {"hooke": "disks", "hertz": "spheres"}


def main() -> None:
    """Prints the table, and draws the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    ours: dict[tuple[str, int, float], float] = {}
    ratios: dict[tuple[str, int, float], dict[str, float]] = defaultdict(dict)
    with given.table.open() as file:
        for row in csv.DictReader(file):
            key = (row["scene"], int(row["grains"]), float(row["inertial_number"]))
            if row["program"] == f"gshear-mpi {row['scene']}":
                ours[key] = float(row["million_grain_steps_per_s"])
            elif not row["program"].startswith("gshear-mpi"):
                ratios[key][row["program"]] = float(row["ours_over_it"])
    programs = sorted({name for of in ratios.values() for name in of})
    print("| grains | I | speed | " + " | ".join(f"over {name}" for name in programs) + " |")
    print("| --- | ---: | ---: |" + " ---: |" * len(programs))
    figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    lines: dict[tuple[str, int], list[tuple[float, float]]] = defaultdict(list)
    for (scene, grains, number), speed in ours.items():
        of = ratios[scene, grains, number]
        cells = " | ".join(f"{of[name]:.2f}" if name in of else "" for name in programs)
        print(f"| {grains:,} {NAMES[scene]} | {number:g} | {speed:.1f} | {cells} |")
        least = min(ratio for name, ratio in of.items() if name.startswith("LAMMPS"))
        lines[scene, grains].append((number, least))
    for (scene, grains), points in lines.items():
        style = "o-" if scene == "hooke" else "s--"
        axes.plot(*zip(*sorted(points), strict=True), style, label=f"{grains:,} {NAMES[scene]}")
    axes.axhline(1.0, color="black", linewidth=0.5)
    axes.set(xscale="log", xlabel="inertial number I", ylabel="speed over the faster LAMMPS")
    axes.set_ylim(0.0, None)
    axes.legend()
    figure.savefig(given.out, metadata={"Date": None})


if __name__ == "__main__":
    main()
