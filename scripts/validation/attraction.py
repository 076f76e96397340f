#!/usr/bin/env python3
"""Attraction between grains beside LAMMPS, and in plane shear, for docs/validation.md.

attraction.py lammps              DMT spheres: errors of both programs against the limit of ours
attraction.py flow OUT.svg RUN... mu, Phi and z of runs over the cohesion number, one for each seed

The first needs lmp, and the packing that `make peers PEERS="--scenes hertz --grains 4815"` makes.
"""

from __future__ import annotations

import argparse
import csv
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import matplotlib as mpl
import numpy as np

from gshear import Run

mpl.use("svg")
import matplotlib.pyplot as plt

# Box, and the numbers of the grains by id.
End = tuple[list[float], dict[int, list[float]]]

ROOT = Path(__file__).resolve().parents[2]
# J/m²: F_c is 0.4 of the force of the load on a mean grain.
SURFACE_ENERGY = 2e3
# Of the default step of the scene, and the steps of it in the motion.
FACTORS = [1.0, 1 / 4, 1 / 16]
REFERENCE = 1 / 64
MOTION = 500
# Of each run the first share is left out.
TRANSIENT = 0.4


def peers() -> ModuleType:
    """The module of benches/peers/run."""
    module = ModuleType("peers")
    module.__file__ = str(ROOT / "benches/peers/run")
    SourceFileLoader("peers", module.__file__).exec_module(module)
    return module


def lammps() -> None:
    """Prints the errors of positions and velocities of spheres without friction and dampers."""
    bench = peers()
    bench.CACHE.mkdir(parents=True, exist_ok=True)
    scene = bench.Scene("hertz", 4815)
    material = scene.config["material"]
    step = scene.config["time"]["step"]
    folder = bench.CACHE / "attraction"
    folder.mkdir(exist_ok=True)
    elastic = f"{material['young_modulus']} 0.0 {material['poisson_ratio']} {SURFACE_ENERGY}"
    tangential = "tangential linear_nohistory 0.0 0.0 damping viscoelastic"
    contact = folder / "dmt.in"
    contact.write_text(f"pair_style granular\npair_coeff * * dmt {elastic} {tangential}\n")

    def ours(factor: float) -> End:
        out = folder / "run"
        sets = {
            "sample.packing": scene.ours,
            "shear.velocity": scene.velocity,
            "shear.strain": 1000.0,
            "output.series_strain": 0.01,
            "time.step": factor * step,
            "contact.friction": 0.0,
            "contact.normal_damping": 0.0,
            "contact.surface_energy": SURFACE_ENERGY,
        }
        stop = ["--stop-at", round(MOTION / factor), "--overwrite", "--out", out]
        config = bench.HERE / "hertz.toml"
        bench.execute([bench.GSHEAR, config, *bench.given(sets), *stop], accepted=[75])
        end = folder / "end.data"
        what = ["export", "--format=lammps-data", out / "checkpoint.h5", "--out", end]
        bench.execute([bench.REDUCE, *what])
        return bench.read_end(end)

    def theirs(factor: float) -> End:
        steps = round(MOTION / factor)
        variables = {
            "data": scene.folder / "lammps-walls.data",
            "contact": contact,
            "velocity": scene.velocity,
            "push": -scene.config["load"]["pressure"] * scene.base / scene.top,
            "step": factor * step,
            "steps": steps,
            "end": folder / "lammps.data",
            "look": steps,
            "skin": 0.1 * scene.mean_diameter,
            "newton": "off",
            "every": 1,
            "grid": "* * *",
        }
        words = [word for key, value in variables.items() for word in ("-var", key, value)]
        files = ["-in", bench.HERE / "lammps/shear-3d.in", "-log", "none"]
        bench.execute(["lmp", *files, *words])
        return bench.read_end(variables["end"])

    limit = ours(REFERENCE)
    print("step/default  gshear-mpi: positions, velocities  LAMMPS: positions, velocities")
    for factor in [*FACTORS, REFERENCE]:
        programs = [theirs] if factor == REFERENCE else [ours, theirs]
        found = [bench.error(of(factor), limit, MOTION * step)[:2] for of in programs]
        print(f"{factor:<12g}", *(f"{number:.2e}" for pair in found for number in pair))


def flow(out: Path, folders: list[Path]) -> None:
    """Draws the means over seeds against the cohesion number, and writes them beside the figure."""
    names = ["stress_ratio", "solid_fraction", "coordination"]
    runs: dict[float, list[list[float]]] = {}
    for folder in folders:
        with Run(folder) as run:
            series = run.series
            diameter = run.scene["sample.radius_min"] + run.scene["sample.radius_max"]
            number = run.scene.get("contact.attraction", 0.0) / (
                run.scene["load.pressure"] * diameter
            )
            later = series[series.strain > TRANSIENT * series.strain.max()]
            ratio = later.shear_force.mean() / later.normal_force.mean()
            values = [ratio, later.solid_fraction.mean(), later.coordination.mean()]
            runs.setdefault(round(float(number), 6), []).append(values)
    rows = []
    for number, seeds in sorted(runs.items()):
        of_seeds = np.array(seeds)
        errors = of_seeds.std(axis=0, ddof=1) / len(seeds) ** 0.5
        rows.append([number, *of_seeds.mean(axis=0), *errors])
    table = np.array(rows)
    with out.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["cohesion_number", *names, *(f"{name}_error" for name in names)])
        writer.writerows([[f"{value:.4g}" for value in row] for row in rows])
    figure, axes = plt.subplots(1, 3, figsize=(9.0, 3.0))
    for k, (axis, label) in enumerate(zip(axes, ["μ = S/N", "Φ", "z"], strict=True)):
        axis.errorbar(table[:, 0], table[:, 1 + k], table[:, 4 + k], fmt="o-", ms=4, lw=0.8)
        axis.set(xscale="symlog", xlabel="η = F_c/(P d)", ylabel=label)
    figure.tight_layout()
    figure.savefig(out)


def main() -> None:
    """Runs a command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("lammps")
    of_flow = commands.add_parser("flow")
    of_flow.add_argument("out", type=Path)
    of_flow.add_argument("runs", type=Path, nargs="+")
    arguments = parser.parse_args()
    if arguments.command == "lammps":
        lammps()
    else:
        flow(arguments.out, arguments.runs)


if __name__ == "__main__":
    main()
