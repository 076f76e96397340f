#!/usr/bin/env python3
"""Figures 14 to 25 of Lee & Hurley from short windows.

    lee_hurley_large.py OUT [KEY=VALUE ...]

Runs configs/lee-hurley-large-windows.toml, four frictions, and the small sample that figures 14 and
22 compare it with, friction 0.7 of configs/lee-hurley-windows.toml, into OUT; then writes the study
into OUT/study. Runs that are there already are not made again. KEY=VALUE replaces values of the
scenes of the large sample (--set), as in 'output.frame_rows=60'. The windows are too short for the
correlations of the paper, which are those of 130,000 intervals.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CONFIGS = Path(__file__).parents[2] / "configs"
PROGRAM = os.environ.get("GSHEAR_MPI", "gshear-mpi")
# Of configs/lee-hurley-windows.toml: friction 0.7, packing 1.
SMALL = "10"


def sweep(scene: str, out: Path, which: str, sets: list[str]) -> list[Path]:
    """Makes runs of a sweep and returns their folders; what is finished is left as it is."""
    command = [PROGRAM, str(CONFIGS / scene), "--out", str(out), "--sweep", which, *sets]
    subprocess.run(command, check=True)
    return sorted(path.parent for path in out.glob("*/run.h5"))


def main() -> None:
    """Makes the runs and the study."""
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    out = Path(sys.argv[1])
    sets = [word for value in sys.argv[2:] for word in ("--set", value)]
    runs = sweep("lee-hurley-windows.toml", out / "small", SMALL, [])
    runs += sweep("lee-hurley-large-windows.toml", out / "large", "all", sets)
    study = [sys.executable, "-m", "gshear.studies.lee_hurley", *map(str, runs)]
    subprocess.run([*study, "--out", str(out / "study")], check=True)


if __name__ == "__main__":
    main()
