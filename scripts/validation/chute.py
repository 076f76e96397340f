#!/usr/bin/env python3
"""Spheres on a slope beside LAMMPS, as its bench/in.chute, for docs/validation/physics.md.

chute.py [--program gshear-mpi] [--reducer gshear-reduce]

Errors of both programs against the limit of ours, after a twentieth of √(d/g), then speeds in turn
from the packing of in.chute itself, 32,000 spheres that flow, on one core; needs lmp, and for the
latter what scripts/peers-deps installs.
"""

from __future__ import annotations

import math
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np
from beside_lammps import SIZES, End, Programs

# Of chute.toml, with masses, diameters and gravity of 1: k_n, k_t, alpha, duration.
NORMAL, TANGENTIAL, DAMPING, DURATION = 2e5, 2e5 * 2 / 7, 0.05, 0.05
STEP = 2e-4
FACTORS = [1.0, 1 / 4, 1 / 16]
REFERENCE = 1 / 64
EFFECTIVE_MASS = 0.5
# Friction and alpha. LAMMPS also limits the damper of a contact that slides, ours has none there.
LAWS = [(0.0, DAMPING), (0.5, 0.0)]
# Of in.chute: a density of 1, gamma_n, the slope, Δt, and how long the motions are compared.
OFFICIAL = "target/peers/lib/python*/site-packages/lammps/share/lammps/bench/data.chute"
MASS, GAMMA, SLOPE, OFFICIAL_STEP, COMPARED = math.pi / 6, 50.0, 26.0, 1e-4, 100
STEPS, REPETITIONS = 2000, 5
# Of LAMMPS' list, over d.
SKINS = [0.1, 0.3]


def apart(found: End, limit: End, duration: float = DURATION) -> tuple[float, float]:
    """Differences of positions and velocities, over those of the motion."""
    r, v = found.position - limit.position, found.velocity - limit.velocity
    r[:, :2] -= limit.lengths[:2] * np.rint(r[:, :2] / limit.lengths[:2])
    scale = np.linalg.norm(limit.velocity)
    return float(np.linalg.norm(r) / scale / duration), float(np.linalg.norm(v) / scale)


def main() -> None:
    """Prints the errors with dampers and with friction, then the speeds."""
    with tempfile.TemporaryDirectory() as name:
        programs = Programs(__doc__, "chute.toml", Path(name))
        data = Path(name) / "packing.data"
        programs.run("packed")
        programs.export("packed", data, "--frame=0")

        def ours(factor: float, friction: float, damping: float) -> End:
            sets = [f"sample.{key}=none" for key in SIZES]
            sets += [f"sample.packing={data}", f"contact.friction={friction}"]
            sets += [f"contact.damping_ratio={damping}"]
            programs.run("run", *sets, f"time.step={factor * STEP}")
            return programs.export("run", programs.end, "--frame=last")

        def law(friction: float, damping: float) -> dict[str, float]:
            return {
                "kn": NORMAL,
                "kt": TANGENTIAL,
                "gamman": 2 * damping * (NORMAL / EFFECTIVE_MASS) ** 0.5,
                "gammat": 2 * damping * (TANGENTIAL / EFFECTIVE_MASS) ** 0.5,
                "friction": friction,
                "incline": 24,
            }

        def theirs(factor: float, *of: float) -> End:
            step = {"step": factor * STEP, "steps": round(DURATION / factor / STEP)}
            end, _ = programs.theirs({**law(*of), **step, "data": data, "skin": SKINS[0]})
            return end

        print("friction  alpha  step/2e-4  ours: positions, velocities  LAMMPS: the same")
        for contact in LAWS:
            limit = ours(REFERENCE, *contact)
            for factor in [*FACTORS, REFERENCE]:
                codes = [theirs] if factor == REFERENCE else [ours, theirs]
                found = [apart(of(factor, *contact), limit) for of in codes]
                numbers = (f"{number:.2e}" for pair in found for number in pair)
                print(f"{contact[0]:<8g}  {contact[1]:<5g}  {factor:<9g}", *numbers, flush=True)

        official = sorted(Path().glob(OFFICIAL))
        if not official:
            sys.exit("the packing of in.chute is not here: scripts/peers-deps installs it")
        benchmark(programs, official[-1].resolve())


def benchmark(programs: Programs, data: Path) -> None:
    """Prints how far both are apart on the packing of in.chute, and the speeds."""
    damping = 0.5 * GAMMA * (0.5 * MASS / NORMAL) ** 0.5
    sets = [f"sample.{key}=none" for key in SIZES]
    sets += [f"sample.packing={data}", f"load.incline={SLOPE}", "material.density=1.0"]
    sets += [f"contact.damping_ratio={damping}", f"time.step={OFFICIAL_STEP}"]
    of = {
        "kn": NORMAL,
        "kt": TANGENTIAL,
        "gamman": GAMMA,
        "gammat": GAMMA * (TANGENTIAL / NORMAL) ** 0.5,
        "friction": 0.5,
        "incline": SLOPE,
        "data": data,
        "step": OFFICIAL_STEP,
    }
    duration = COMPARED * OFFICIAL_STEP
    programs.run("official", *sets, f"shear.protocol=[{{ time = {duration} }}]")
    ours = programs.export("official", programs.end, "--frame=last")
    theirs, _ = programs.theirs({**of, "steps": COMPARED, "skin": SKINS[0]})
    grains = len(ours.position)
    numbers = (f"{number:.2e}" for number in apart(theirs, ours, duration))
    print(f"{grains} spheres of in.chute, {COMPARED} steps, positions and velocities:", *numbers)
    found: list[list[float]] = []
    for _ in range(REPETITIONS):
        flow = ["shear.protocol=[{ time = 1.0 }]", "output.series_rows=10"]
        speeds = [programs.run("speed", *sets, *flow, stop=STEPS)]
        for skin in SKINS:
            _, seconds = programs.theirs({**of, "steps": STEPS, "skin": skin})
            speeds.append(1e-6 * grains * STEPS / seconds)
        found.append(speeds)
    print(f"{grains} spheres, {STEPS} steps: million grain-steps/s, and ours over it")
    for k, program in enumerate(["ours", *(f"LAMMPS, skin {skin}" for skin in SKINS)]):
        speed = statistics.median(row[k] for row in found)
        ratio = statistics.median(row[0] / row[k] for row in found)
        print(f"{program:<18} {speed:6.2f} {ratio:6.2f}", flush=True)


if __name__ == "__main__":
    main()
