#!/usr/bin/env python3
"""Spheres in a sheared periodic cell beside LAMMPS, `fix deform`, for docs/validation.md.

without_walls.py [--program gshear-mpi] [--reducer gshear-reduce]

Errors of both programs against the limit of ours, after 10 µs at constant volume; needs lmp.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
# Of without_walls.toml: Δt (s), E (Pa), nu, gamma_n (1/(m s)), V (m/s).
STEP, YOUNG, POISSON, DAMPING, VELOCITY = 2e-8, 50e9, 0.3, 6e7, 20.0
DURATION = 500 * STEP
FACTORS = [1.0, 1 / 4, 1 / 16]
REFERENCE = 1 / 64
# Keys of the packing that a file replaces.
SIZES = ["grains", "radius_min", "radius_max", "length", "width"]


@dataclass
class End:
    """Grains of a LAMMPS data file, by id: [N, 3] each, and its box."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    lengths: NDArray[np.float64]
    tilt: float


def read(path: Path) -> End:
    """The grains of a data file."""
    lines = path.read_text().splitlines()

    def section(name: str) -> dict[int, list[float]]:
        start = next(k for k, line in enumerate(lines) if line.startswith(name)) + 2
        rows = (line.split() for line in itertools.takewhile(bool, lines[start:]))
        return {int(row[0]): [float(x) for x in row[1:]] for row in rows}

    bounds = [line.split() for line in lines if line.endswith("hi")]
    tilts = [line.split() for line in lines if line.endswith("xy xz yz")]
    atoms, moves = section("Atoms"), section("Velocities")
    return End(
        np.array([atoms[number][3:6] for number in sorted(atoms)]),
        np.array([moves[number][:3] for number in sorted(moves)]),
        np.array([float(high) - float(low) for low, high, *_ in bounds]),
        float(tilts[0][1]) if tilts else 0.0,
    )


def apart(found: End, limit: End) -> tuple[float, float]:
    """Differences of positions and velocities, over the peculiar motion."""
    r, v = found.position - limit.position, found.velocity - limit.velocity
    crossed = np.rint(r[:, 2] / limit.lengths[2])
    r[:, 2] -= crossed * limit.lengths[2]
    r[:, 0] -= crossed * limit.tilt
    v[:, 0] -= crossed * VELOCITY
    r[:, :2] -= limit.lengths[:2] * np.rint(r[:, :2] / limit.lengths[:2])
    peculiar = limit.velocity.copy()
    peculiar[:, 0] -= VELOCITY * limit.position[:, 2] / limit.lengths[2]
    scale = np.linalg.norm(peculiar)
    return float(np.linalg.norm(r) / scale / DURATION), float(np.linalg.norm(v) / scale)


def main() -> None:
    """Prints the errors with and without dampers and friction."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", default="target/release/gshear-mpi")
    parser.add_argument("--reducer", default="target/release/gshear-reduce")
    given = parser.parse_args()
    scene = HERE / "without_walls.toml"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data, end = folder / "packing.data", folder / "end.data"

        def export(source: str, out: Path, *frame: str) -> None:
            what = ["export", "--format=lammps-data", str(folder / source), *frame]
            subprocess.run([given.reducer, *what, "--out", out], check=True, capture_output=True)

        quiet = ["--quiet", "--overwrite", "--out"]
        subprocess.run([given.program, scene, *quiet, folder / "packed"], check=True)
        export("packed", data, "--frame=0")
        height = read(data).lengths[2]

        def ours(factor: float, friction: float, damping: float) -> End:
            sets = [f"sample.{key}=none" for key in SIZES]
            sets += [f"sample.packing={data}", "shear.strain=1", "output.frame_strain=0.5"]
            sets += [f"contact.friction={friction}", f"contact.normal_damping={damping}"]
            sets += [f"time.step={factor * STEP}", "output.series_strain=0.01"]
            stop = f"--stop-at={round(DURATION / factor / STEP)}"
            words = [word for of in sets for word in ("--set", of)]
            subprocess.run(
                [given.program, scene, *words, stop, *quiet, folder / "run"], check=False
            )
            export("run/checkpoint.h5", end)
            return read(end)

        def theirs(factor: float, friction: float, damping: float) -> End:
            variables = {
                "data": data,
                "kn": 2 / 3 * YOUNG / (1 - POISSON**2),
                "kt": 2 * YOUNG / ((1 + POISSON) * (2 - POISSON)),
                "gamman": damping,
                "gammat": damping / 2,
                "friction": friction,
                "skin": 3e-4,
                "velocity": VELOCITY,
                "height": height,
                "rate": VELOCITY / height,
                "step": factor * STEP,
                "steps": round(DURATION / factor / STEP),
                "end": end,
            }
            words = [str(word) for key, of in variables.items() for word in ("-var", key, of)]
            files = ["-in", str(HERE / "without_walls.in"), "-log", "none", "-screen", "none"]
            subprocess.run([shutil.which("lmp") or "lmp", *files, *words], check=True)
            return read(end)

        print("friction  gamma_n  step/2e-8  ours: positions, velocities  LAMMPS: the same")
        for law in [(0.0, 0.0), (0.0, DAMPING), (0.5, DAMPING)]:
            limit = ours(REFERENCE, *law)
            for factor in [*FACTORS, REFERENCE]:
                programs = [theirs] if factor == REFERENCE else [ours, theirs]
                found = [apart(of(factor, *law), limit) for of in programs]
                numbers = (f"{number:.2e}" for pair in found for number in pair)
                print(f"{law[0]:<8g}  {law[1]:<7g}  {factor:<9g}", *numbers, flush=True)


if __name__ == "__main__":
    main()
