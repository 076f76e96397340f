#!/usr/bin/env python3
"""Spheres on a slope beside LAMMPS, as its bench/in.chute, for docs/validation.md.

chute.py [--program gshear-mpi] [--reducer gshear-reduce]

Errors of both programs against the limit of ours, after half a time √(d/g); needs lmp.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from without_walls import SIZES, End, read

HERE = Path(__file__).resolve().parent
# Of chute.toml, with masses, diameters and gravity of 1: k_n, k_t, alpha, duration.
NORMAL, TANGENTIAL, DAMPING, DURATION = 2e5, 2e5 * 2 / 7, 0.05, 0.5
STEP = 2e-4
FACTORS = [1.0, 1 / 4, 1 / 16]
REFERENCE = 1 / 64
EFFECTIVE_MASS = 0.5


def apart(found: End, limit: End) -> tuple[float, float]:
    """Differences of positions and velocities, over those of the motion."""
    r, v = found.position - limit.position, found.velocity - limit.velocity
    r[:, :2] -= limit.lengths[:2] * np.rint(r[:, :2] / limit.lengths[:2])
    scale = np.linalg.norm(limit.velocity)
    return float(np.linalg.norm(r) / scale / DURATION), float(np.linalg.norm(v) / scale)


def main() -> None:
    """Prints the errors without friction and with it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", default="target/release/gshear-mpi")
    parser.add_argument("--reducer", default="target/release/gshear-reduce")
    given = parser.parse_args()
    scene = HERE / "chute.toml"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data, end = folder / "packing.data", folder / "end.data"

        def export(source: str, out: Path, frame: str) -> None:
            what = ["export", "--format=lammps-data", str(folder / source), f"--frame={frame}"]
            subprocess.run([given.reducer, *what, "--out", out], check=True, capture_output=True)

        def run(out: str, *sets: str) -> None:
            words = [word for of in sets for word in ("--set", of)]
            quiet = ["--quiet", "--overwrite", "--out", folder / out]
            subprocess.run([given.program, scene, *words, *quiet], check=True)

        run("packed")
        export("packed", data, "0")

        def ours(factor: float, friction: float) -> End:
            sets = [f"sample.{key}=none" for key in SIZES]
            sets += [f"sample.packing={data}", f"contact.friction={friction}"]
            run("run", *sets, f"time.step={factor * STEP}")
            export("run", end, "last")
            return read(end)

        def theirs(factor: float, friction: float) -> End:
            variables = {
                "data": data,
                "kn": NORMAL,
                "kt": TANGENTIAL,
                "gamman": 2 * DAMPING * (NORMAL / EFFECTIVE_MASS) ** 0.5,
                "gammat": 2 * DAMPING * (TANGENTIAL / EFFECTIVE_MASS) ** 0.5,
                "friction": friction,
                "incline": 24,
                "skin": 0.1,
                "step": factor * STEP,
                "steps": round(DURATION / factor / STEP),
                "end": end,
            }
            words = [str(word) for key, of in variables.items() for word in ("-var", key, of)]
            files = ["-in", str(HERE / "chute.in"), "-log", "none", "-screen", "none"]
            subprocess.run([shutil.which("lmp") or "lmp", *files, *words], check=True)
            return read(end)

        print("friction  step/2e-4  ours: positions, velocities  LAMMPS: the same")
        for friction in [0.0, 0.5]:
            limit = ours(REFERENCE, friction)
            for factor in [*FACTORS, REFERENCE]:
                programs = [theirs] if factor == REFERENCE else [ours, theirs]
                found = [apart(of(factor, friction), limit) for of in programs]
                numbers = (f"{number:.2e}" for pair in found for number in pair)
                print(f"{friction:<8g}  {factor:<9g}", *numbers, flush=True)


if __name__ == "__main__":
    main()
