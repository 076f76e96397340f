#!/usr/bin/env python3
"""The local yield stress of frames: how much more stress each part of a sheared layer bears.

    python3 examples/local_yield.py RUN FRAME [FRAME ...] --out OUT [--height 6] [--spacing 3]
        [--displacement 0.003] [--velocity V]

As Patinet, Vandembroucq & Falk (Phys. Rev. Lett. 117, 045501, 2016) shear a patch of a glass with
all around it frozen, each slab of a layer is sheared alone: the grains above and below it become
rigid blocks, the upper one under the load of the run. The slab has the positions, velocities and
histories of the frame, and gshear-mpi moves the upper block. The local yield stress is the greatest
τ on the way less the τ of the frame: near 0 where a slab is yielding already.

Writes OUT/local-yield.csv, one line for each slab of each frame. Takes runs between walls of grains
whose frames have the histories of contacts (`output.histories`). Needs the Python package of
`python/`, gshear-mpi and gshear-reduce.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from gshear import GshearError, Run, RunError, programs, simulate

# Tables of the scene that a probe keeps; its packing is that of the frame.
KEPT = ("material", "contact", "load", "time")
BOTTOM, TOP = "2", "3"
# Rows of a probe, and those of the running mean of τ: the start of the motion rings.
ROWS, SMOOTHED = 100, 5


class Probe(NamedTuple):
    """How slabs are chosen and sheared; lengths are in mean diameters."""

    height: float = 6.0
    spacing: float = 3.0
    displacement: float = 0.003
    # m/s; that of the drive, if it is not given: a jump of it would send a wave into the slab.
    velocity: float | None = None


class State(NamedTuple):
    """A frame as a LAMMPS data file, whose lines of grains are split, and its contacts."""

    before: str
    grains: list[list[str]]
    after: str
    contacts: pd.DataFrame

    def heights(self, dimension: int) -> np.ndarray:
        """Returns the heights of the grains (m)."""
        return np.array([float(line[3 + dimension]) for line in self.grains])


def exported(path: Path, frame: int, folder: Path) -> State:
    """Returns a frame of a run as gshear-reduce exports it."""
    data = folder / "frame.data"
    words = ["--format", "lammps-data", "--contacts", "--frame", str(frame), "--out", str(data)]
    programs.run([programs.find("gshear-reduce"), "export", *words, str(path)], quiet=True)
    head = "# sphere\n\n"
    before, rest = data.read_text().split(f"Atoms {head}", 1)
    lines, after = rest.split("\n\n", 1)
    grains = [line.split() for line in lines.split("\n")]
    contacts = pd.read_csv(folder / "frame-contacts.csv")
    return State(f"{before}Atoms {head}", grains, f"\n\n{after}", contacts)


def write_slab(state: State, heights: np.ndarray, slab: tuple[float, float], folder: Path) -> int:
    """Writes the packing whose free grains are those of a slab, and returns their number.

    Contacts within and between the blocks are left out: they exert no force.
    """
    types = np.array([line[1] for line in state.grains])
    free = ~np.isin(types, [BOTTOM, TOP])
    below, above = free & (heights < slab[0]), free & (heights > slab[1])
    types[below], types[above] = BOTTOM, TOP
    of_slab = free & ~below & ~above
    lines = [" ".join([g[0], kind, *g[2:]]) for g, kind in zip(state.grains, types, strict=True)]
    (folder / "slab.data").write_text(state.before + "\n".join(lines) + state.after)
    ids = [int(line[0]) for line, inside in zip(state.grains, of_slab, strict=True) if inside]
    kept = state.contacts["i"].isin(ids) | state.contacts["j"].isin(ids)
    state.contacts[kept].to_csv(folder / "slab-contacts.csv", index=False)
    return len(ids)


def keys_of(run: Run, folder: Path, part: dict[str, float]) -> dict[str, object]:
    """Returns the keys of the scene of a probe: what the run has, and the slab in `folder`."""
    values: dict[str, object] = {
        f"{table}.{key}": value for table in KEPT for key, value in run.scene[table].items()
    }
    values["dimension"] = run.dimension
    values["sample.packing"] = folder / "slab.data"
    values["sample.contacts"] = folder / "slab-contacts.csv"
    values["sample.walls"] = "types"
    values["shear.protocol"] = [part]
    values["output.series_rows"] = ROWS
    return values


def probed(run: Run, frame: int, probe: Probe) -> pd.DataFrame:
    """Returns a line for each slab of a frame.

    Columns: `bottom`, `top` (m), `grains`, `stress_ratio` of the frame, `greatest` τ of the probe,
    `displacement` at which it comes (m), and `local_yield`, their difference.
    """
    diameter = 2.0 * float(np.mean(run.frames[frame].radius))
    rows_here = run.series[run.series["step"] == run.frames.step[frame]]
    if rows_here.empty:
        raise RunError(f"{run.path}: frame {frame}: the time series has no row at its step")
    here = rows_here.iloc[0]
    velocity = probe.velocity or float(here["drive_velocity"])
    if velocity == 0.0:
        raise RunError(f"{run.path}: frame {frame}: the drive stands still; give --velocity")
    part = {"velocity": velocity, "distance": probe.displacement * diameter}
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        values = keys_of(run, folder, part)
        scene = folder / "probe.toml"
        scene.write_text('title = "Probe of a slab"\n')
        state = exported(run.path, frame, folder)
        heights = state.heights(run.dimension)
        walls = np.isin([line[1] for line in state.grains], [BOTTOM, TOP])
        if not walls.any():
            raise RunError(f"{run.path}: has no walls of grains, which a probe moves")
        free = heights[~walls]
        high = free.max() - probe.height * diameter
        # A slab higher than the layer is the layer.
        count = 1 + max(0, int((high - free.min()) / (probe.spacing * diameter)))
        for k in range(count):
            bottom = float(free.min()) + k * probe.spacing * diameter
            slab = (bottom, bottom + probe.height * diameter)
            grains = write_slab(state, heights, slab, folder)
            out = folder / f"slab-{k}"
            simulate(scene, out, ranks=1, values=values, quiet=True)
            with Run(out, quiet=True) as sheared:
                rows = sheared.series
            tau = rows["stress_ratio"].rolling(SMOOTHED, min_periods=1).mean()
            at = int(tau.argmax())
            found.append(
                {
                    "frame": frame,
                    "bottom": slab[0],
                    "top": slab[1],
                    "grains": grains,
                    "stress_ratio": here["stress_ratio"],
                    "greatest": tau.iloc[at],
                    "displacement": rows["slip"].iloc[at],
                    "local_yield": tau.iloc[at] - here["stress_ratio"],
                }
            )
    return pd.DataFrame(found)


def main(arguments: list[str] | None = None) -> None:
    """Probes the frames that the arguments name."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default = Probe()
    parser.add_argument("run", type=Path, help="folder of a run, or its run.h5")
    parser.add_argument("frames", type=int, nargs="+", help="numbers of the frames")
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument("--height", type=float, default=default.height, help="of a slab, in d̄ [6]")
    parser.add_argument("--spacing", type=float, default=default.spacing, help="of slabs, in d̄ [3]")
    parser.add_argument(
        "--displacement", type=float, default=default.displacement, help="of a probe, d̄ [0.003]"
    )
    parser.add_argument("--velocity", type=float, help="m/s [that of the drive]")
    given = parser.parse_args(arguments)
    probe = Probe(given.height, given.spacing, given.displacement, given.velocity)
    try:
        with Run(given.run, quiet=True) as run:
            table = pd.concat([probed(run, frame, probe) for frame in given.frames])
    except (IndexError, GshearError) as error:
        parser.error(str(error))
    given.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(given.out / "local-yield.csv", index=False)
    print(table.to_string(index=False, float_format=lambda x: f"{x:.4g}"))


if __name__ == "__main__":
    main()
