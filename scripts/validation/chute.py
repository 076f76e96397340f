#!/usr/bin/env python3
"""Spheres on a slope beside LAMMPS, as its bench/in.chute, for docs/validation.md.

chute.py [--program gshear-mpi] [--reducer gshear-reduce]

Errors of both programs against the limit of ours, after half a time √(d/g); needs lmp.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from beside_lammps import SIZES, End, Programs

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
    with tempfile.TemporaryDirectory() as name:
        programs = Programs(__doc__, "chute.toml", Path(name))
        data = Path(name) / "packing.data"
        programs.run("packed")
        programs.export("packed", data, "--frame=0")

        def ours(factor: float, friction: float) -> End:
            sets = [f"sample.{key}=none" for key in SIZES]
            sets += [f"sample.packing={data}", f"contact.friction={friction}"]
            programs.run("run", *sets, f"time.step={factor * STEP}")
            return programs.export("run", programs.end, "--frame=last")

        def theirs(factor: float, friction: float) -> End:
            return programs.theirs(
                {
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
                }
            )

        print("friction  step/2e-4  ours: positions, velocities  LAMMPS: the same")
        for friction in [0.0, 0.5]:
            limit = ours(REFERENCE, friction)
            for factor in [*FACTORS, REFERENCE]:
                codes = [theirs] if factor == REFERENCE else [ours, theirs]
                found = [apart(of(factor, friction), limit) for of in codes]
                numbers = (f"{number:.2e}" for pair in found for number in pair)
                print(f"{friction:<8g}  {factor:<9g}", *numbers, flush=True)


if __name__ == "__main__":
    main()
