#!/usr/bin/env python3
"""Attraction, alone and in shear, and materials beside LAMMPS, for docs/validation/physics.md.

contacts.py attraction          DMT and JKR spheres: errors of both programs from the limit of ours
contacts.py materials           spheres of two materials between walls of a third, by both programs
contacts.py flow OUT.svg RUN... mu, Phi and z of runs over the cohesion number, one for each seed

The first two need lmp and the packing of `make peers PEERS="--scenes hertz --grains 4815"`.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from itertools import combinations_with_replacement
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
# E (Pa), nu, rho (kg/m³). The walls have the density of the packing, so the same mass in both.
MATERIALS = {
    "stone": (50e9, 0.3, 2500.0),
    "steel": (200e9, 0.28, 7800.0),
    "wall": (5e9, 0.4, 2500.0),
}
# Without friction and damping, in LAMMPS.
SMOOTH = "tangential linear_nohistory 0.0 0.0 damping viscoelastic"
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


class Motion:
    """The motion of the sheared spheres of `make peers` without friction and dampers, by both."""

    def __init__(self, name: str) -> None:
        self.bench = peers()
        self.bench.CACHE.mkdir(parents=True, exist_ok=True)
        self.scene = self.bench.Scene("hertz", 4815)
        self.step = self.scene.config["time"]["step"]
        self.folder = self.bench.CACHE / name
        self.folder.mkdir(exist_ok=True)
        self.config = self.bench.HERE / "hertz.toml"
        self.packings = [self.scene.ours, self.scene.folder / "lammps-walls.data"]
        self.contact = self.folder / "contact.in"

    def ours(self, factor: float, **further: object) -> End:
        """The end by this program, at so many default steps."""
        out, end = self.folder / "run", self.folder / "end.data"
        sets = {
            "sample.packing": self.packings[0],
            "shear.velocity": self.scene.velocity,
            "shear.strain": 1000.0,
            "output.series_strain": 0.01,
            "time.step": factor * self.step,
            "contact.friction": 0.0,
            "contact.normal_damping": 0.0,
            **further,
        }
        stop = ["--stop-at", round(MOTION / factor), "--overwrite", "--out", out]
        bench = self.bench
        bench.execute([bench.GSHEAR, self.config, *bench.given(sets), *stop], accepted=[75])
        what = ["export", "--format=lammps-data", out / "checkpoint.h5", "--out", end]
        bench.execute([bench.REDUCE, *what])
        found: End = bench.read_end(end)
        return found

    def theirs(self, factor: float) -> End:
        """The end by LAMMPS."""
        scene, steps = self.scene, round(MOTION / factor)
        variables = {
            "data": self.packings[1],
            "contact": self.contact,
            "velocity": scene.velocity,
            "push": -scene.config["load"]["pressure"] * scene.base / scene.top,
            "step": factor * self.step,
            "steps": steps,
            "end": self.folder / "lammps.data",
            "look": steps,
            "skin": 0.1 * scene.mean_diameter,
            "newton": "off",
            "every": 1,
            "grid": "* * *",
        }
        words = [word for key, value in variables.items() for word in ("-var", key, value)]
        files = ["-in", self.bench.HERE / "lammps/shear-3d.in", "-log", "none"]
        self.bench.execute(["lmp", *files, *words])
        found: End = self.bench.read_end(variables["end"])
        return found

    def apart(self, found: End, limit: End) -> list[float]:
        """By how much positions and velocities differ, over the mean motion."""
        errors: list[float] = self.bench.error(found, limit, MOTION * self.step)[:2]
        return errors


def attraction() -> None:
    """Prints the errors of positions and velocities of DMT and JKR spheres."""
    motion = Motion("attraction")
    material = motion.scene.config["material"]
    elastic = f"{material['young_modulus']} 0.0 {material['poisson_ratio']} {SURFACE_ENERGY}"
    sets = {"contact.surface_energy": SURFACE_ENERGY}
    for model in ["dmt", "jkr"]:
        # Without histories LAMMPS' jkr ends with "Neighbor history overflow".
        smooth = SMOOTH.replace("linear_nohistory 0.0", "linear_history 1.0 0.0")
        coefficients = f"{model} {elastic} {SMOOTH if model == 'dmt' else smooth}"
        motion.contact.write_text(f"pair_style granular\npair_coeff * * {coefficients}\n")
        sets["contact.adhesion"] = f"'{model}'"
        limit = motion.ours(REFERENCE, **sets)
        print(f"{model}: step/default  gshear-mpi: positions, velocities  LAMMPS: the same")
        for factor in [*FACTORS, REFERENCE]:
            found = [] if factor == REFERENCE else motion.apart(motion.ours(factor, **sets), limit)
            found += motion.apart(motion.theirs(factor), limit)
            print(f"{factor:<12g}", *(f"{number:.2e}" for number in found))


def materials() -> None:
    """Prints how far both are apart where every third sphere is of steel, and walls are softer."""
    motion = Motion("materials")
    for k, packing in enumerate(motion.packings):
        motion.packings[k] = motion.folder / f"{k}.data"
        motion.packings[k].write_text("".join(mixed(packing.read_text().splitlines(True))))
    kinds = {1: "stone", 2: "wall", 3: "wall", 4: "steel"}
    lines = ["pair_style granular\n"]
    for i, j in combinations_with_replacement(kinds, 2):
        # F_n = (4/3) E* √(R*δ) δ, 1/E* of both materials (Johnson, Contact Mechanics, 4.20).
        pair = [MATERIALS[kinds[i]], MATERIALS[kinds[j]]]
        compliance = sum((1.0 - ratio**2) / modulus for modulus, ratio, _ in pair)
        lines.append(f"pair_coeff {i} {j} hertz {4.0 / 3.0 / compliance!r} 0.0 {SMOOTH}\n")
    motion.contact.write_text("".join(lines))
    tables = "".join(
        f"[[material]]\nname = '{name}'\nyoung_modulus = {modulus}\npoisson_ratio = {ratio}\n"
        f"density = {density}\n"
        for name, (modulus, ratio, density) in MATERIALS.items()
    )
    base, motion.config = motion.config, motion.folder / "mixture.toml"
    motion.config.write_text(f"extends = '{base}'\n{tables}")
    walls = {"sample.walls": "types", "sample.wall_material": "wall"}
    limit = motion.ours(REFERENCE, **walls)
    print("step/default  apart: positions, velocities  ours from its limit")
    for factor in [1 / 2, 1 / 8]:
        ours = motion.ours(factor, **walls)
        pairs = [motion.apart(motion.theirs(factor), ours), motion.apart(ours, limit)]
        print(f"{factor:<12g}", *(f"{number:.2e}" for pair in pairs for number in pair))


def mixed(lines: list[str]) -> Iterator[str]:
    """A data file in which every third free grain is of steel, as a fourth type."""
    for line in lines:
        words = line.split()
        if len(words) >= 7 and words[1] == "1" and int(words[0]) % 3 == 0:
            words[1], words[3] = "4", str(MATERIALS["steel"][2])
            yield " ".join(words) + "\n"
        else:
            yield line.replace("3 atom types", "4 atom types")


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
    for alone in [attraction, materials]:
        commands.add_parser(alone.__name__).set_defaults(run=alone)
    of_flow = commands.add_parser("flow")
    of_flow.add_argument("out", type=Path)
    of_flow.add_argument("runs", type=Path, nargs="+")
    arguments = parser.parse_args()
    if arguments.command == "flow":
        flow(arguments.out, arguments.runs)
    else:
        arguments.run()


if __name__ == "__main__":
    main()
