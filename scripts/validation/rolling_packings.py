#!/usr/bin/env python3
"""Solid fraction and coordination of packings with sliding, rolling and twisting friction.

rolling_packings.py run FOLDER [--seeds 5] [--only 10,1,1] [--lammps lmp]
rolling_packings.py figure FOLDER FIGURE.svg

`run` compresses the same dilute states with gshear-mpi and with LAMMPS, by the same law, walls and
load, into folders below FOLDER. Packings that are there are not run again. `figure` measures those
that are there, prints means and errors over the seeds, writes them as a table beside the figure,
and draws them beside the isostatic numbers.
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from mu_of_i import below
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from gshear import Run, Scene, simulate

mpl.use("svg")
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
SCENE = HERE / "rolling_packings.toml"
INPUT = HERE / "rolling_packings.in"

# Free grains, periodic lengths (diameters), and the solid fraction between the walls at the start.
GRAINS = 1000
LENGTH = 8.0
DILUTE = 0.3
# Duration under the load, in sqrt(m/(P d)).
DURATION = 35.0
# Share of the height, around its middle, that is measured.
MIDDLE = 0.5
# mu_s, mu_r, mu_w.
COEFFICIENTS = [
    (10.0, 1.0, 1.0),
    (10.0, 0.0, 0.0),
    (0.3, 0.0, 0.0),
    (10.0, 0.1, 0.1),
    (10.0, 1.0, 0.0),
    (10.0, 0.0, 1.0),
    (0.1, 0.0, 0.0),
    (0.3, 0.1, 0.1),
]
NAMES = ["friction", "rolling_friction", "twisting_friction"]
MEASURED = ["phi", "z", "z_held", "rattlers", "constraints", "kinetic"]
PROGRAMS = ["gshear-mpi", "LAMMPS"]
# Phi and z without rattlers of equal hard spheres with mu_s = 0.3, compressed from a gas: Agnolin &
# Roux, Phys. Rev. E 76, 061302 (2007), arXiv:0705.3194, abstract.
AGNOLIN_ROUX = (0.593, 4.5)
# Coefficients of Tsuji's damping (docs/reference/laws.md).
TSUJI = [1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218]


Coefficients = tuple[float, float, float]


def counts(sliding: float, rolling: float, twisting: float) -> tuple[int, int]:
    """Degrees of freedom of a grain, and constraints of a contact that neither slides nor turns."""
    degrees = 6 if sliding or rolling or twisting else 3
    return degrees, 1 + 2 * (sliding > 0.0) + 2 * (rolling > 0.0) + (twisting > 0.0)


def isostatic(sliding: float, rolling: float, twisting: float) -> float:
    """Mean number of contacts at which constraints equal degrees of freedom."""
    degrees, constraints = counts(sliding, rolling, twisting)
    return 2.0 * degrees / constraints


# The initial states


def wall(rng: np.random.Generator, height: float) -> np.ndarray:
    """A square lattice of spheres without holes, made rough by random heights above `height`."""
    side = np.arange(LENGTH) + 0.5
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    return np.column_stack([x, y, height + 0.5 * rng.random(len(x))])


def dilute(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and types of LAMMPS: grains at random places (1) between two walls (2 and 3)."""
    rng = np.random.default_rng(seed)
    height = GRAINS * np.pi / 6.0 / (DILUTE * LENGTH**2)
    walls = [wall(rng, 0.5), wall(rng, height + 2.0)]
    positions = np.concatenate(walls)
    types = np.repeat([2, 3], [len(wall) for wall in walls])
    while len(positions) < GRAINS + len(types):
        places = rng.random((200, 3)) * [LENGTH, LENGTH, height] + [0.0, 0.0, 1.5]
        for place in places[: GRAINS + len(types) - len(positions)]:
            apart = positions - place
            apart[:, :2] -= LENGTH * np.round(apart[:, :2] / LENGTH)
            if np.sum(apart**2, axis=1).min() >= 1.0:
                positions = np.vstack([positions, place])
    return positions, np.concatenate([types, np.ones(GRAINS, dtype=int)])


def write_data(path: Path, positions: np.ndarray, types: np.ndarray, density: float) -> None:
    """Writes a LAMMPS data file of spheres of diameter 1, which both programs read."""
    lines = ["spheres between walls", "", f"{len(types)} atoms", "3 atom types", ""]
    lines += [
        f"0 {LENGTH} xlo xhi",
        f"0 {LENGTH} ylo yhi",
        f"-1 {positions[:, 2].max() + 1} zlo zhi",
    ]
    lines += ["", "Atoms # sphere", ""]
    for number, (kind, (x, y, z)) in enumerate(zip(types, positions, strict=True), start=1):
        lines.append(f"{number} {kind} 1 {density} {x:.17g} {y:.17g} {z:.17g}")
    path.write_text("\n".join(lines) + "\n")


# The packings


def contacts(positions: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Pairs of spheres of diameter 1 that overlap, without pairs of walls; periodic in x and y."""
    wrapped = positions.copy()
    wrapped[:, :2] %= LENGTH
    wrapped[:, 2] -= wrapped[:, 2].min()
    box = [LENGTH, LENGTH, 0.0]
    pairs = cKDTree(wrapped, boxsize=box).query_pairs(1.0, output_type="ndarray")
    return np.asarray(pairs[~walls[pairs].all(axis=1)])


def held(grains: int, pairs: np.ndarray, walls: np.ndarray, least: int) -> np.ndarray:
    """Grains that are no rattlers.

    Rattlers have fewer than `least` contacts with others that are held; grains of walls are held.
    """
    stay = np.ones(grains, dtype=bool)
    while True:
        count = np.bincount(pairs[stay[pairs].all(axis=1)].ravel(), minlength=grains)
        still = stay & ((count >= least) | walls)
        if (still == stay).all():
            return stay
        stay = still


def measure(
    positions: np.ndarray, velocities: np.ndarray, walls: np.ndarray, coefficients: Coefficients
) -> list[float]:
    """What MEASURED names.

    Phi, z of all grains and of those that are held, and the share of rattlers are those of the
    middle of the height. Constraints over degrees of freedom are those of all that is held, with
    the top wall, which moves along z. The kinetic energy is the mean of held grains.
    """
    height = positions[:, 2]
    low, high = height[walls].min(), height[walls].max()
    margin = 0.5 * (1.0 - MIDDLE) * (high - low)
    low, high = low + margin, high - margin
    radius = np.full(len(positions), 0.5)
    volume = below(height, radius, high, 3) - below(height, radius, low, 3)
    middle = ~walls & (height > low) & (height < high)

    pairs = contacts(positions, walls)
    degrees, constraints = counts(*coefficients)
    # Without friction a grain needs four contacts, with it two.
    stay = held(len(positions), pairs, walls, 4 if degrees == 3 else 2)
    of_held = pairs[stay[pairs].all(axis=1)]
    z = np.bincount(pairs.ravel(), minlength=len(positions))
    z_held = np.bincount(of_held.ravel(), minlength=len(positions))
    free = stay & ~walls
    freedom = degrees * free.sum() + 1.0
    if constraints == 3:
        # By sliding friction alone, a grain of two contacts may spin about the line through both.
        freedom -= (z_held[free] == 2).sum()
    return [
        float(volume / (LENGTH**2 * (high - low))),
        float(z[middle].mean()),
        float(z_held[middle & stay].mean()),
        float(1.0 - stay[middle].mean()),
        float(constraints * len(of_held) / freedom),
        float(0.5 * np.mean(np.sum(velocities[free] ** 2, axis=1))),
    ]


# The runs


def folder_of(folder: Path, program: str, seed: int, coefficients: Coefficients) -> Path:
    """Where a run is kept."""
    return folder / f"{program}-{seed}-{'-'.join(f'{c:g}' for c in coefficients)}"


def by_gshear(out: Path, data: Path, coefficients: Coefficients) -> None:
    """Runs gshear-mpi, unless it has done it."""
    values: dict[str, object] = {"sample.packing": data.resolve(), "output.frame_rows": 1}
    values |= {f"contact.{name}": c for name, c in zip(NAMES, coefficients, strict=True)}
    pressure = Scene(SCENE.read_text())["load.pressure"]
    values["shear.protocol"] = [{"velocity": 0.0, "time": DURATION, "pressure": pressure}]
    simulate(SCENE, out, ranks=1, values=values, quiet=True)


def tsuji(restitution: float) -> float:
    """The damping factor of a coefficient of restitution."""
    return float(np.polynomial.Polynomial(TSUJI)(restitution))


def lammps_variables(scene: Scene, coefficients: Coefficients) -> dict[str, float]:
    """The law in the quantities of LAMMPS, whose units docs/reference/laws.md explains."""
    contact = scene["contact"]
    arm = 0.25
    mass = scene["material.density"] * np.pi / 6.0
    rolling = contact["rolling_stiffness"] * arm**2
    twisting = contact["twisting_stiffness"] * arm**2
    # Half of a sphere's I, about the contact and about the normal.
    inertia = np.array([1.4, 0.4]) * mass * 0.25 / 2.0
    dashpots = 2.0 * np.sqrt(inertia * [rolling, twisting])
    # LAMMPS has m* where ours has 2 m*.
    damping = np.sqrt(2.0) * tsuji(contact["restitution"])
    return {
        "young": scene["material.young_modulus"],
        "poisson": scene["material.poisson_ratio"],
        "restitution": float(brentq(lambda e: tsuji(e) - damping, 1e-3, 1.0)),
        "sliding": coefficients[0],
        "rolling": coefficients[1],
        "twisting": coefficients[2] * arm,
        "krolling": contact["rolling_stiffness"],
        "grolling": contact["rolling_damping_ratio"] * dashpots[0] / arm**2,
        "ktwisting": twisting,
        "gtwisting": contact["twisting_damping_ratio"] * dashpots[1],
    }


def by_lammps(lammps: str, out: Path, data: Path, coefficients: Coefficients) -> None:
    """Runs LAMMPS, unless it has done it."""
    if (out / "end.dump").exists():
        return
    scene = Scene(SCENE.read_text())
    step = scene["time.step"]
    top = (np.loadtxt(data, skiprows=11)[:, 1] == 3).sum()
    variables = lammps_variables(scene, coefficients) | {
        "push": -scene["load.pressure"] * LENGTH**2 / top,
        "step": step,
        "steps": round(DURATION / step),
    }
    out.mkdir(parents=True, exist_ok=True)
    command = [lammps, "-in", str(INPUT), "-log", str(out / "log.lammps"), "-screen", "none"]
    for name, value in (variables | {"data": data, "end": out / "end.dump"}).items():
        command += ["-var", name, str(value)]
    subprocess.run(command, check=True)


def end(out: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities, and whether a grain is of a wall, at the end of a run."""
    if (out / "end.dump").exists():
        rows = np.loadtxt(out / "end.dump", skiprows=9)
        return rows[:, 2:5], rows[:, 5:8], rows[:, 1] != 1
    with Run(out) as run:
        frame = run.frame(-1)
        return frame.position, frame.velocity, frame.species != 0


def run_all(folder: Path, seeds: int, kinds: list[Coefficients], lammps: str) -> None:
    """Runs the packings that are missing."""
    folder.mkdir(parents=True, exist_ok=True)
    density = Scene(SCENE.read_text())["material.density"]
    for seed in range(1, seeds + 1):
        data = folder / f"{seed}.data"
        if not data.exists():
            write_data(data, *dilute(seed), density)
        for coefficients in kinds:
            for program in PROGRAMS:
                out = folder_of(folder, program, seed, coefficients)
                if program == "LAMMPS":
                    by_lammps(lammps, out, data, coefficients)
                else:
                    by_gshear(out, data, coefficients)


def measure_all(folder: Path) -> pd.DataFrame:
    """One row per packing that has ended."""
    rows = []
    for data in sorted(folder.glob("*.data")):
        seed = int(data.stem)
        for program, coefficients in itertools.product(PROGRAMS, COEFFICIENTS):
            out = folder_of(folder, program, seed, coefficients)
            if (out / "end.dump").exists() or (out / "checkpoint.h5").exists():
                values = measure(*end(out), coefficients)
                rows.append([program, seed, *coefficients, *values])
    return pd.DataFrame(rows, columns=["program", "seed", *NAMES, *MEASURED])


# Means and figure


def summary(packings: pd.DataFrame) -> pd.DataFrame:
    """Means and standard errors over the seeds, by coefficients and program."""
    groups = packings.groupby([*NAMES, "program"])[MEASURED]
    means, errors = groups.mean(), groups.sem()
    columns = {}
    for name in MEASURED:
        columns |= {name: means[name], f"{name}_error": errors[name]}
    return pd.DataFrame({"packings": groups.size(), **columns}).reset_index()


def draw(means: pd.DataFrame, out: Path) -> None:
    """Prints the means; writes the figure and, beside it, the table."""
    means.to_csv(out.with_suffix(".csv"), index=False, float_format="%.4g", lineterminator="\n")
    # From the greatest isostatic number to the least, and from small coefficients to great ones.
    means = means.assign(isostatic=[isostatic(*row) for row in means[NAMES].to_numpy()])
    total = means[NAMES].sum(axis=1)
    order = means.assign(total=total).sort_values(["isostatic", "total"], ascending=[False, True])
    kinds = [tuple(row) for row in order[NAMES].drop_duplicates().to_numpy()]
    figure, axes = plt.subplots(3, 1, figsize=(6.4, 7.2), sharex=True, height_ratios=[3, 4, 2])
    for program, colour, marker, shift in (
        ("gshear-mpi", "C0", "o", -0.13),
        ("LAMMPS", "C1", "s", 0.13),
    ):
        rows = means[means.program == program].set_index(NAMES)
        rows = rows.loc[[kind for kind in kinds if kind in rows.index]]
        x = np.array([kinds.index(kind) for kind in rows.index]) + shift
        for axis, name in zip(axes, ("phi", "z_held", "rattlers"), strict=True):
            error = rows[f"{name}_error"]
            axis.errorbar(
                x, rows[name], error, fmt=marker, ms=4.5, color=colour, capsize=2, label=program
            )
    numbers = [isostatic(*kind) for kind in kinds]
    axes[1].hlines(
        numbers,
        np.arange(len(kinds)) - 0.4,
        np.arange(len(kinds)) + 0.4,
        color="black",
        lw=1.2,
        label="isostatic",
    )
    of_roux = kinds.index((0.3, 0.0, 0.0))
    for axis, value in zip(axes[:2], AGNOLIN_ROUX, strict=True):
        axis.plot(of_roux, value, "kx", ms=6, label="Agnolin & Roux 2007")
    axes[0].set(ylabel="Φ")
    axes[1].set(ylabel="z without rattlers", ylim=(1.8, None))
    axes[2].set(ylabel="share of rattlers", ylim=(0.0, 1.0))
    names = ["\n".join(f"${c:g}$" for c in kind) for kind in kinds]
    axes[2].set_xticks(np.arange(len(kinds)), names, linespacing=1.3)
    side = axes[2].get_xaxis_transform()
    axes[2].text(
        -0.75, -0.07, "$μ_s$\n$μ_r$\n$μ_w$", transform=side, va="top", ha="right", linespacing=1.45
    )
    axes[2].set_xlabel("friction of sliding, rolling and twisting")
    for axis in axes:
        axis.grid(axis="y", lw=0.4, alpha=0.5)
    handles, labels = axes[1].get_legend_handles_labels()
    axes[0].legend(
        handles,
        labels,
        frameon=False,
        fontsize=9,
        ncols=4,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
    )
    figure.align_ylabels(axes)
    figure.tight_layout()
    figure.savefig(out)
    for row in order.itertuples():
        values = [
            f"{name} {getattr(row, name):.4f} ± {getattr(row, name + '_error'):.4f}"
            for name in MEASURED
        ]
        kind = ", ".join(f"{getattr(row, name):g}" for name in NAMES)
        print(f"{kind}: {row.program} ({row.packings}): {', '.join(values)}")


def main() -> None:
    """Runs the packings or draws them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    of_run = commands.add_parser("run")
    of_run.add_argument("folder", type=Path)
    of_run.add_argument("--seeds", type=int, default=5)
    of_run.add_argument("--only", help="mu_s,mu_r,mu_w of the only kind of packing to run")
    of_run.add_argument("--lammps", default="lmp")
    of_figure = commands.add_parser("figure")
    of_figure.add_argument("folder", type=Path)
    of_figure.add_argument("figure", type=Path)
    arguments = parser.parse_args()
    if arguments.command == "run":
        only = arguments.only and tuple(map(float, arguments.only.split(",")))
        kinds = [kind for kind in COEFFICIENTS if only in (None, kind)]
        run_all(arguments.folder, arguments.seeds, kinds, arguments.lammps)
    else:
        draw(summary(measure_all(arguments.folder)), arguments.figure)


if __name__ == "__main__":
    main()
