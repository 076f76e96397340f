#!/usr/bin/env python3
"""Solid fraction and coordination at jamming, of compressions through a ramp of pressures.

jamming.py RUN...     (one run for each seed, with a frame at each pressure)

At the two least pressures; a line through both gives those at P = 0, for z over the root of P.
z leaves out rattlers: grains with too few contacts to be held, removed until there are none.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from gshear import Run
from gshear.analysis import rattlers


def coordination(run: Run, number: int) -> tuple[float, float]:
    """Contacts of a grain that is no rattler, and the share of rattlers."""
    contacts = run.contacts(number)
    held = ~rattlers(contacts)
    return 2.0 * held[contacts.pairs].all(axis=1).sum() / held.sum(), 1.0 - held.mean()


def jammed(folder: Path) -> list[float]:
    """Phi at P = 0; z at the least pressure and at P = 0; the share of rattlers."""
    with Run(folder) as run:
        rows = run.series.iloc[1:3]
        pressure, fraction = rows.pressure.to_numpy(), rows.solid_fraction.to_numpy()
        frames = np.searchsorted(run.frames.step, rows.step)
        z, rattlers = zip(*(coordination(run, int(frame)) for frame in frames), strict=True)
        phi_j = np.polyfit(pressure, fraction, 1)[1]
        z_j = np.polyfit(np.sqrt(pressure), z, 1)[1]
        return [phi_j, z[0], z_j, rattlers[0]]


def main() -> None:
    """Prints means over the runs, and the values of each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+")
    values = np.array([jammed(folder) for folder in parser.parse_args().runs])
    errors = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    names = ["Phi at P = 0", "z at the least P", "z at P = 0", "rattlers"]
    for name, mean, error in zip(names, values.mean(axis=0), errors, strict=True):
        print(f"{name:18}{mean:.4f} ± {error:.4f}")
    print(values.round(4))


if __name__ == "__main__":
    main()
