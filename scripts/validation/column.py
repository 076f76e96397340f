#!/usr/bin/env python3
"""Writes copies of a periodic packing on top of each other, as a LAMMPS data file for sound.

column.py RUN COPIES OUT.data     (RUN: a box of spheres, at its first frame)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from gshear import Run


def main() -> None:
    """Writes the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("copies", type=int)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    with Run(arguments.run) as run:
        frame, density = run.frame(0), run.scene["material.density"]
        edges = [float(edge) for edge in frame.box.edges]
        # Grains are numbered in the order of x, as the program numbers its own.
        order = np.argsort(frame.position[:, 0], kind="stable")
        places = [
            (x, y, z + copy * edges[2], 2.0 * radius)
            for (x, y, z), radius in zip(
                frame.box.wrap(frame.position)[order].tolist(),
                frame.radius[order].tolist(),
                strict=True,
            )
            for copy in range(arguments.copies)
        ]
    lines = ["copies of a packing", "", f"{len(places)} atoms", "1 atom types", ""]
    lines += [f"0 {edges[0]!r} xlo xhi", f"0 {edges[1]!r} ylo yhi"]
    lines += [f"0 {arguments.copies * edges[2]!r} zlo zhi", "", "Atoms # sphere", ""]
    lines += [
        f"{number} 1 {diameter!r} {density!r} {x!r} {y!r} {z!r}"
        for number, (x, y, z, diameter) in enumerate(places, 1)
    ]
    arguments.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
