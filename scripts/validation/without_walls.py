#!/usr/bin/env python3
"""Spheres in a sheared periodic cell beside LAMMPS, `fix deform`, for docs/validation/physics.md.

without_walls.py [--program gshear-mpi] [--reducer gshear-reduce]

Errors of both programs against the limit of ours, after 10 µs at constant volume; needs lmp.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from beside_lammps import SIZES, End, Programs

# Of without_walls.toml: Δt (s), E (Pa), nu, gamma_n (1/(m s)), V (m/s).
STEP, YOUNG, POISSON, DAMPING, VELOCITY = 2e-8, 50e9, 0.3, 6e7, 20.0
DURATION = 500 * STEP
FACTORS = [1.0, 1 / 4, 1 / 16]
REFERENCE = 1 / 64


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
    with tempfile.TemporaryDirectory() as name:
        programs = Programs(__doc__, "without_walls.toml", Path(name))
        data = Path(name) / "packing.data"
        programs.run("packed")
        height = programs.export("packed", data, "--frame=0").lengths[2]

        def ours(factor: float, friction: float, damping: float) -> End:
            sets = [f"sample.{key}=none" for key in SIZES]
            sets += [f"sample.packing={data}", "shear.strain=1", "output.frame_strain=0.5"]
            sets += [f"contact.friction={friction}", f"contact.normal_damping={damping}"]
            sets += [f"time.step={factor * STEP}", "output.series_strain=0.01"]
            programs.run("run", *sets, stop=round(DURATION / factor / STEP))
            return programs.export("run/checkpoint.h5", programs.end)

        def theirs(factor: float, friction: float, damping: float) -> End:
            end, _ = programs.theirs(
                {
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
                }
            )
            return end

        print("friction  gamma_n  step/2e-8  ours: positions, velocities  LAMMPS: the same")
        for law in [(0.0, 0.0), (0.0, DAMPING), (0.5, DAMPING)]:
            limit = ours(REFERENCE, *law)
            for factor in [*FACTORS, REFERENCE]:
                codes = [theirs] if factor == REFERENCE else [ours, theirs]
                found = [apart(of(factor, *law), limit) for of in codes]
                numbers = (f"{number:.2e}" for pair in found for number in pair)
                print(f"{law[0]:<8g}  {law[1]:<7g}  {factor:<9g}", *numbers, flush=True)


if __name__ == "__main__":
    main()
