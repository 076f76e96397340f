#!/usr/bin/env python3
"""Response envelopes of configs/stress-probes-2d.toml, for docs/validation/boxes.md.

    stress_probes.py OUT [--seeds 3] [--size 5e-5]

Brings a packing to its stress, then appends a probe of the given size (k_n) in each of 16
directions of the plane of stress_yy and stress_xx to a copy of that run. Writes OUT/probes.csv: the
strains of each probe. Prints, for each seed, the greatest and least length of the strain over that
of the stress times k_n, their directions, and the strains of opposite probes over each other.
GSHEAR_MPI names the program.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd

from gshear import Run

ROOT = Path(__file__).parents[2]
SCENE = ROOT / "configs/stress-probes-2d.toml"
PROGRAM = os.environ.get("GSHEAR_MPI", "gshear-mpi")
STRESS = {"xx": 1e-3, "yy": 2.2e-3}
START = f"{{ stress_xx = {STRESS['xx']}, stress_yy = {STRESS['yy']}, steps = 60 }}"
DIRECTIONS = 16
STEPS = 5


def strains(out: Path) -> np.ndarray:
    """Natural strains along y and x of the last row, compression positive."""
    row = Run(out).series.iloc[-1]
    return np.array([row["strain_yy"], row["strain_xx"]])


def run(*arguments: str | Path) -> None:
    """Runs the program, and stops with its words if it fails."""
    subprocess.run([PROGRAM, *arguments], check=True, stdout=subprocess.DEVNULL)


def probes(base: Path, size: float) -> pd.DataFrame:
    """The strains of probes in all directions from the end of a run."""
    start = strains(base)
    rows = []
    for k in range(DIRECTIONS):
        angle = 2 * np.pi * k / DIRECTIONS
        change = size * np.array([np.cos(angle), np.sin(angle)])
        out = base.with_name(f"{base.name}-{k}")
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(base, out)
        part = f"stress_xx = {STRESS['xx'] + change[1]}, stress_yy = {STRESS['yy'] + change[0]}"
        run("--resume", out, "--set", f"aqs.protocol=[{START}, {{ {part}, steps = {STEPS} }}]")
        response = strains(out) - start
        rows.append([np.degrees(angle), *change, *response])
    columns = ["angle", "stress_yy", "stress_xx", "strain_yy", "strain_xx"]
    return pd.DataFrame(rows, columns=columns)


def main() -> None:
    """Runs the probes and prints what is on the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--size", type=float, default=5e-5)
    arguments = parser.parse_args()
    tables = []
    for seed in range(1, arguments.seeds + 1):
        base = arguments.out / f"seed-{seed}"
        if not (base / "run.h5").exists():
            run(SCENE, "--out", base, "--set", f"seed={seed}")
        table = probes(base, arguments.size)
        table.insert(0, "seed", seed)
        tables.append(table)
        response = table[["strain_yy", "strain_xx"]].to_numpy()
        lengths = np.linalg.norm(response, axis=1) / arguments.size
        longest, least = int(lengths.argmax()), int(lengths.argmin())
        flow = np.degrees(np.arctan2(response[longest, 1], response[longest, 0]))
        half = DIRECTIONS // 2
        opposite = lengths[longest] / lengths[(longest + half) % DIRECTIONS]
        print(
            f"seed {seed}: longest {lengths[longest]:.2f} at {table['angle'][longest]:.1f} deg,"
            f" strain at {flow:.1f} deg; least {lengths[least]:.2f} at"
            f" {table['angle'][least]:.1f} deg; over the opposite probe {opposite:.2f}",
            flush=True,
        )
    pd.concat(tables).to_csv(arguments.out / "probes.csv", index=False)


if __name__ == "__main__":
    main()
