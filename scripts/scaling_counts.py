#!/usr/bin/env python3
"""What ranks, threads and bands do in a run, against counts by geometry; and speeds.

    scripts/scaling

Packs a scene once, and goes on from its checkpoint on 1, 2 and 4 ranks, with 1, 2 and 4 threads,
and in several bands. What `--profile` counts there must be what follows from the positions in the
checkpoint by a search over all pairs: pairs, ghosts, messages and bytes, equal or within bounds
that the list leaves open. Fails where a count or a digest differs, never for want of speed, since
other work may share the cores.
"""

from __future__ import annotations

import csv
import io
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt

from gshear.scene import Scene

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = Path(os.environ.get("GSHEAR_MPI", ROOT / "target" / "release" / "gshear-mpi"))
# Exit code of a run that was stopped.
STOPPED = 75
# Skin over the mean diameter: one list lasts for all steps of a run.
SKIN = 0.06
# Steps of a run whose work is counted.
STEPS = 60
# Pairs of a block.
LANES = 16
# The most bands in a message, one of each step at once: bookkeeping.steps_at_once.
MOST_TOGETHER = 8
# Part of the pairs that touch which go on touching for so many steps.
STILL_TOUCHING = 0.9
# Work of a contact over that of a grain, and bins of the histogram for each rank, by which the
# slabs are cut: docs/explanation/scheme.md, "Slabs".
CONTACT_COST = 6
BINS = 256
# Bytes of the sum of a step: five flags, and two forces on walls of five numbers each.
SUM_BYTES = 8 * (5 + 2 * 5)

Integers = npt.NDArray[np.int64]
Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A scene whose work is counted."""

    name: str
    # Arguments that begin it.
    scene: list[str]
    # Bytes of a grain's record: docs/explanation/scheme.md, "Slabs".
    record: int


CASES = (
    Case("disks", [], 64),
    Case(
        "spheres",
        [str(ROOT / "tests/scenes/crossing-3d.toml"), "--set=sample.replicate=[2, 1]"],
        128,
    ),
)


@dataclass
class Check:
    """Counts that were compared."""

    failures: list[str] = field(default_factory=list)
    count: int = 0

    def within(self, what: str, found: float, least: float, most: float) -> None:
        """Notes a count that is not within its bounds."""
        self.count += 1
        if not least <= found <= most:
            wanted = f"{least:g}" if least == most else f"{least:g} to {most:g}"
            self.failures.append(f"{what}: {found:g}, must be {wanted}")

    def equal(self, what: str, found: float, wanted: float) -> None:
        """Notes a count that differs."""
        self.within(what, found, wanted, wanted)


@dataclass(frozen=True)
class State:
    """Grains and contacts of a checkpoint, in a cell of these periods (m)."""

    position: Numbers
    radius: Numbers
    is_free: npt.NDArray[np.bool_]
    contacts: Integers
    periods: list[float]

    @classmethod
    def read(cls, path: Path) -> State:
        """Reads a checkpoint."""
        with h5py.File(path) as file:
            scene = Scene(bytes(file["scene"][()]).decode())
            grains, contacts = file["grains"], file["contacts"]
            identity = grains["id"][()]
            # Grains are numbered from 0 on, in the order of their ids.
            order = np.argsort(identity)
            if not np.array_equal(identity[order], np.arange(len(order))):
                sys.exit(f"error: {path}: ids are not 0 to {len(order) - 1}")
            periods = [float(scene["sample.length"])]
            if scene.get("dimension", 2) == 3:
                periods.append(float(scene["sample.width"]))
            return cls(
                position=grains["position"][()][order],
                radius=grains["radius"][()][order],
                is_free=grains["body"][()][order] == 0,
                contacts=np.stack([contacts["i"][()], contacts["j"][()]], axis=1).astype(np.int64),
                periods=periods,
            )

    def pairs(self, gap: float) -> Integers:
        """All pairs with at most this gap (m), of which one grain is free, the lower id first."""
        found = []
        for i in range(len(self.radius) - 1):
            apart = self.position[i + 1 :] - self.position[i]
            for axis, period in enumerate(self.periods):
                apart[:, axis] -= period * np.round(apart[:, axis] / period)
            reach = self.radius[i + 1 :] + self.radius[i] + gap
            near = (apart**2).sum(axis=1) < reach**2
            near &= self.is_free[i + 1 :] | self.is_free[i]
            others = i + 1 + np.flatnonzero(near)
            found.append(np.stack([np.full(len(others), i), others], axis=1))
        return np.concatenate(found)


@dataclass(frozen=True)
class Run:
    """Rows of `--profile`, a rank each, and what else a run said."""

    ranks: int
    threads: int
    rows: list[dict[str, float]]
    digest: str
    speed: float

    @property
    def name(self) -> str:
        """The run, for messages."""
        bands = int(self.rows[0]["bands"])
        words = [f"{self.ranks} ranks", f"{self.threads} threads", f"{bands} bands"]
        return ", ".join(word for word in words if not word.startswith("1 ")) or "1 rank"


def launch(ranks: int, arguments: list[str], accepted: tuple[int, ...]) -> str:
    """Standard output of the program on ranks."""
    command = [str(PROGRAM), *arguments]
    if ranks > 1:
        command = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "-n", str(ranks), *command]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    if done.returncode not in accepted:
        print(done.stdout[-4000:], done.stderr[-4000:], sep="\n")
        sys.exit(f"error: {shlex.join(command)} ended with exit code {done.returncode}")
    return done.stdout


def word(said: str, key: str) -> str:
    """The word after one that begins a line."""
    found = re.search(rf"^{key} (\S+)", said, re.MULTILINE)
    if found is None:
        sys.exit(f"error: a run said no {key}:\n{said}")
    return found.group(1)


def go_on(checkpoint: Path, ranks: int, threads: int, options: list[str], stop: int) -> Run:
    """Goes on from a checkpoint, up to a step if `stop` is not 0."""
    arguments = ["--resume", str(checkpoint), "--out", str(checkpoint.parent / "on"), "--overwrite"]
    arguments += ["--profile", f"--threads={threads}", *options]
    if stop:
        arguments += ["--stop-at", str(stop)]
    said = launch(ranks, arguments, (STOPPED,) if stop else (0,))
    lines = said[said.index("\nrank,threads,") + 1 :].splitlines()[: ranks + 1]
    rows = [
        {k: float(v) for k, v in row.items()}
        for row in csv.DictReader(io.StringIO("\n".join(lines)))
    ]
    return Run(ranks, threads, rows, word(said, "digest"), float(word(said, "speed")))


@dataclass(frozen=True)
class RankCounts:
    """What a rank counted in a run, to be compared."""

    check: Check
    name: str
    row: dict[str, float]

    def within(self, column: str, least: float, most: float) -> None:
        """Compares a column with bounds."""
        what = f"{self.name}: {column} of rank {self.row['rank']:g}"
        self.check.within(what, self.row[column], float(least), float(most))

    def equal(self, column: str, wanted: float) -> None:
        """Compares a column with a number."""
        self.within(column, wanted, wanted)


@dataclass(frozen=True)
class Geometry:
    """The pairs of a state, and the ranks that own their grains."""

    state: State
    pairs: Integers
    # Of the grains, and of those of the pairs.
    owner: Integers
    owners: Integers

    @classmethod
    def of(cls, state: State, run: Run) -> Geometry:
        """Of the first list of a run."""
        pairs = state.pairs(run.rows[0]["listed_gap"])
        cuts = np.array([row["to"] for row in run.rows[:-1]])
        owner = np.searchsorted(cuts, state.position[:, 0], side="right")
        return cls(state, pairs, owner, owner[pairs])

    @property
    def across(self) -> npt.NDArray[np.bool_]:
        """Whether two ranks have a pair."""
        different: npt.NDArray[np.bool_] = self.owners[:, 0] != self.owners[:, 1]
        return different

    def of_rank(self, rank: int) -> npt.NDArray[np.bool_]:
        """Whether a rank has a grain of a pair."""
        has: npt.NDArray[np.bool_] = (self.owners == rank).any(axis=1)
        return has

    def ghosts(self, rank: int, owner: int) -> int:
        """Number of grains of an owner that are in pairs with those of another rank."""
        grains = self.pairs[self.of_rank(rank) & self.of_rank(owner)].ravel()
        return len(np.unique(grains[self.owner[grains] == owner]))

    def blocks(self, rank: int) -> int:
        """Blocks of pairs of two own grains, of an own and a ghost, and of a ghost and an own."""
        groups = (
            self.of_rank(rank) & ~self.across,
            self.across & (self.owners[:, 0] == rank),
            self.across & (self.owners[:, 1] == rank),
        )
        return sum(math.ceil(np.count_nonzero(group) / LANES) for group in groups)


def compare(case: Case, state: State, run: Run, check: Check) -> None:
    """Compares the counts of a run with those of the geometry of its first list."""
    geometry = Geometry.of(state, run)
    touching = geometry.owner[state.pairs(0.0)]
    for row in run.rows:
        rank = int(row["rank"])
        counts = RankCounts(check, f"{case.name} on {run.name}", row)
        neighbours = {(rank - 1) % run.ranks, (rank + 1) % run.ranks} - {rank}
        counts.equal("steps", STEPS)
        counts.equal("lists", 1)
        counts.equal("grains", int(np.count_nonzero(geometry.owner == rank)))
        counts.equal("pairs", int(np.count_nonzero(geometry.of_rank(rank))))
        across = int(np.count_nonzero(geometry.of_rank(rank) & geometry.across))
        counts.equal("pairs_across_ranks", across)
        counts.equal("ghosts", sum(geometry.ghosts(rank, other) for other in neighbours))
        # In every step each of its grains that is a ghost of a neighbour. A message holds the bands
        # that move together, of one step or of several at once.
        sent = sum(geometry.ghosts(other, rank) for other in neighbours)
        most = len(neighbours) * row["bands"] * STEPS
        counts.within("messages", most if row["bands"] == 1 else most / MOST_TOGETHER, most)
        counts.equal("message_bytes", sent * case.record * STEPS)
        counts.equal("sums", STEPS if run.ranks > 1 else 0)
        counts.equal("sum_bytes", row["sums"] * SUM_BYTES)
        # Each band and thread has groups of pairs of its own, whose last blocks are not full.
        more = 3 * (row["bands"] - 1) + (run.threads if run.threads > 1 else 0)
        blocks = geometry.blocks(rank)
        counts.within("blocks", blocks, blocks + more)
        # A block in which something touches is evaluated in every step, and some others are not.
        pairs = np.count_nonzero((touching == rank).any(axis=1))
        least = math.ceil(STILL_TOUCHING * pairs / LANES)
        counts.within("evaluated_blocks", least * STEPS, row["blocks"] * STEPS - 1)
    balance(case, geometry, run, check)
    if run.threads > 1:
        between_threads(case, geometry, run, check)


def balance(case: Case, geometry: Geometry, run: Run, check: Check) -> None:
    """Compares the work of the ranks with equal parts, up to a bin at each cut."""
    state, owner = geometry.state, geometry.owner
    length = state.periods[0]
    cost = np.ones(len(owner))
    np.add.at(cost, state.contacts[:, 0], CONTACT_COST)
    bins = BINS * run.ranks
    places = np.minimum((state.position[:, 0] / length * bins).astype(int), bins - 1)
    of_bins = np.bincount(places, cost, minlength=bins)
    part = cost.sum() / run.ranks
    for row in run.rows:
        cuts = {row["from"], row["to"]} - {0.0, length}
        margin = 1 + sum(of_bins[min(int(cut / length * bins), bins - 1)] for cut in cuts)
        what = f"{case.name} on {run.name}: work of rank {row['rank']:g}"
        check.within(what, cost[owner == row["rank"]].sum(), part - margin, part + margin)


def between_threads(case: Case, geometry: Geometry, run: Run, check: Check) -> None:
    """Compares the pairs of two threads with those at the borders of as many shares.

    A share is a run of columns of cells, the first and the last of which may be parts. So no more
    pairs are across a border than have a grain in a column.
    """
    state = geometry.state
    length = state.periods[0]
    cutoff = 2 * state.radius.max() + run.rows[0]["listed_gap"]
    column = length / math.floor(length / cutoff)
    x = state.position[:, 0]
    of_grains = np.bincount(geometry.pairs.ravel(), minlength=len(x))
    order = np.argsort(x)
    # Twice around the period.
    places = np.concatenate([x[order], x[order] + length])
    sums = np.concatenate([[0], np.cumsum(np.tile(of_grains[order], 2))])
    ends = np.searchsorted(places, places[: len(x)] + column, side="right")
    most = (sums[ends] - sums[: len(x)]).max()
    for row in run.rows:
        counts = RankCounts(check, f"{case.name} on {run.name}", row)
        counts.within("pairs_across_threads", 1, run.threads * most)


def count(case: Case, folder: Path, check: Check) -> None:
    """Counts the work of a case on ranks, threads and bands."""
    first = folder / case.name
    launch(2, [*case.scene, "--out", str(first), "--stop-at", "1"], (STOPPED,))
    checkpoint = first / "checkpoint.h5"
    state = State.read(checkpoint)
    quiet = [f"--set=bookkeeping.skin={SKIN}"]
    single = [*quiet, "--set=bookkeeping.band_grains=1000000"]
    bands = [*quiet, "--set=bookkeeping.band_grains=100"]
    runs = [go_on(checkpoint, ranks, 1, single, 1 + STEPS) for ranks in (1, 2, 4)]
    runs += [go_on(checkpoint, 1, threads, single, 1 + STEPS) for threads in (2, 4)]
    runs += [go_on(checkpoint, 2, 2, single, 1 + STEPS)]
    runs += [go_on(checkpoint, ranks, 1, bands, 1 + STEPS) for ranks in (1, 2)]
    print(f"\n{case.name}: {len(state.radius)} grains, {STEPS} steps; of rank 0")
    columns = [
        "grains",
        "ghosts",
        "pairs",
        "pairs_across_threads",
        "evaluated_blocks",
        "messages",
        "message_bytes",
        "sum_bytes",
    ]
    print(
        " ".join(f"{name.replace('_', ' '):>{len(name)}}" for name in ("run" + 17 * " ", *columns))
    )
    for run in runs:
        compare(case, state, run, check)
        values = (f"{run.rows[0][name]:>{len(name)}g}" for name in columns)
        print(f"{run.name:<20}", *values)
        check.equal(f"{case.name}: digest on {run.name}", run.digest == runs[0].digest, 1)
    banded = [run.rows[0]["bands"] for run in runs[-2:]]
    check.within(f"{case.name}: bands", min(banded), 2, math.inf)


def speeds(folder: Path, check: Check) -> None:
    """Prints speeds, of runs with the same digest."""
    checkpoint = folder / "disks" / "checkpoint.h5"
    strain = [f"--set=shear.strain={os.environ.get('STRAIN', '0.005')}"]
    runs = [go_on(checkpoint, *of, strain, 0) for of in ((1, 1), (2, 1), (1, 2))]
    print("\nspeed of the disks (million grain-steps/s), which decides nothing")
    for run in runs:
        print(f"{run.name:<20} {run.speed:8.2f} {run.speed / runs[0].speed:6.2f} of 1 rank")
        check.equal(f"digest on {run.name}", run.digest == runs[0].digest, 1)


def main() -> None:
    """Counts, prints speeds, and fails where a count differs."""
    check = Check()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for case in CASES:
            count(case, folder, check)
        speeds(folder, check)
    for failure in check.failures:
        print(f"error: {failure}", file=sys.stderr)
    if check.failures:
        sys.exit(1)
    print(f"\n{check.count} counts and digests as they must be")


if __name__ == "__main__":
    main()
