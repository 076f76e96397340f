"""Runs of this program and of LAMMPS from the same packing, for scripts of this folder."""

from __future__ import annotations

import argparse
import itertools
import math
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
# Keys of a sample that a file replaces.
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


class Programs:
    """The programs, and the folder of their files."""

    def __init__(self, doc: str | None, scene: str, folder: Path) -> None:
        """Takes the programs from the command line; `scene` and its input for LAMMPS are here."""
        parser = argparse.ArgumentParser(description=doc)
        parser.add_argument("--program", default="target/release/gshear-mpi")
        parser.add_argument("--reducer", default="target/release/gshear-reduce")
        self.given = parser.parse_args()
        self.scene = HERE / scene
        self.folder = folder
        self.end = folder / "end.data"

    def run(self, out: str, *sets: str, stop: int | None = None) -> float:
        """Runs the scene into a folder, to its end or to a step. Returns million grain-steps/s."""
        words = [word for of in sets for word in ("--set", of)]
        words += [] if stop is None else [f"--stop-at={stop}"]
        command = [
            self.given.program,
            self.scene,
            *words,
            "--overwrite",
            "--out",
            self.folder / out,
        ]
        done = subprocess.run(command, check=stop is None, capture_output=True, text=True)
        speed = re.search(r"^speed (\S+) million", done.stdout, re.MULTILINE)
        return float(speed[1]) if speed else math.nan

    def export(self, source: str, out: Path, *frame: str) -> End:
        """A frame of a run, or a checkpoint, as a data file."""
        what = ["export", "--format=lammps-data", str(self.folder / source), *frame]
        command = [self.given.reducer, *what, "--out", out]
        subprocess.run(command, check=True, capture_output=True)
        return read(out)

    def theirs(self, variables: Mapping[str, object]) -> tuple[End, float]:
        """The end of LAMMPS' run, and its time (s); `variables` are those of the input."""
        of = {**variables, "end": self.end}
        words = [str(word) for key, value in of.items() for word in ("-var", key, value)]
        command = ["lmp", "-in", str(self.scene.with_suffix(".in")), "-log", "none", *words]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        time = re.search(r"^Loop time of (\S+) on", done.stdout, re.MULTILINE)
        return read(self.end), float(time[1]) if time else math.nan
