#!/usr/bin/env python3
"""A step on any number of ranks and threads: the model of docs/validation/speed.md, "Many ranks".

    scripts/scaling --model                     the tables of docs/figures/scaling-model.txt
    scripts/scaling --model --cells             the same with the parts of every step
    scripts/scaling --model --measured          beside the measurements of docs/figures/scaling.csv

Nothing is measured here. Constants of a rank and of its neighbours are measured ones, each with its
source; those of a network and of a node are assumptions, given as options.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Speeds of one rank and of two.
MEASURED = ROOT / "docs" / "figures" / "scaling.csv"

# A sum of two ranks on a node, and of each level of a tree (s): docs/validation/speed.md, "Where
# the time of a step goes".
SUM = 0.5e-6
# Ranks whose terms a rank of the tree adds: crates/mpi-exchange/src/node.rs.
BRANCHES = 8
# A region of parallel work beyond its work (s), and their number in a step:
# docs/validation/speed.md, "Threads".
REGION, REGIONS = 0.45e-6, 3
# Least number of ghosts that threads copy together: crates/dem/src/domain/slabs.rs.
COPIED_BY_THREADS = 512
# The work of the rank that has most over the mean, and of the thread that has most (which is also
# what taking turns on two cores makes of it): docs/figures/work.csv.
RANK_IMBALANCE, THREAD_IMBALANCE = 1.04, 1.13
# A slab is at least so many diameters wide, more than twice the cutoff.
NARROWEST = 4
# Width of a cell of the list in diameters: the greatest diameter and the skin.
COLUMN = 1.4
# Steps at once, grains of a thread in the smallest band, thickness of a layer of a band in
# diameters, and the part of the grains that fit into the cache which a band may have:
# crates/dem/src/state/bands.rs.
STEPS_AT_ONCE, BAND, LAYER, PART = 8, 1000, 1.65, 0.1


@dataclass(frozen=True)
class Law:
    """Constants of a scene of docs/figures/scaling.csv. Areas are in d̄², or lengths in d̄ in 2D."""

    name: str
    # Bytes of a grain's record in a message.
    record: int
    # Bytes that a step moves for a grain: docs/lab/speed.md, "A million grains" (disks), and
    # docs/figures/roofline.csv, contacts and motion (spheres).
    traffic: int
    # Bytes of a grain in memory: docs/validation/speed.md.
    size: int
    # Part of the time of a grain that its pairs take: docs/validation/speed.md, "Where the time of
    # a step goes" (disks), and docs/figures/roofline.csv (spheres).
    of_pairs: float
    # Pairs of a grain in the list, pairs across an area, and ghosts at each side of it:
    # docs/figures/work.csv, whose cuts are 69.3 d̄ high, or 12.3 d̄ high and 20 or 100 d̄ wide.
    pairs: float
    across: float
    ghosts: float
    # To pack, send and copy a ghost (s): docs/figures/work.csv, 96,300 spheres on 16 ranks less
    # 4,815 on 4; of disks, whose records are half as long, half of it.
    copied: float
    # What a pair across two threads takes beyond another one (s): what two threads lose of two
    # runs, without regions, over their pairs (docs/validation/speed.md, "Threads").
    between_threads: float
    # What one thread of 16 does alone, over all grains (s): docs/figures/work.csv.
    alone: float
    # Grains in d̄³, or d̄² in 2D: docs/figures/work.csv.
    density: float
    # Time of a grain (s) in the cache of a core, and beyond it, where it waits for memory alone:
    # docs/validation/speed.md, "Packings larger than the cache", and docs/lab/speed.md.
    times: tuple[tuple[float, float], ...]


LAWS = {
    "disks": Law(
        name="hooke",
        record=64,
        traffic=660,
        size=500,
        of_pairs=0.85,
        pairs=2.12,
        across=1.40,
        ghosts=0.90,
        copied=8.5e-9,
        between_threads=31e-9,
        alone=0.28e-9,
        density=1.03,
        times=((1e3, 14.0e-9), (5e3, 13.7e-9), (6.4e4, 14.5e-9), (1e5, 19.7e-9), (1e6, 37.5e-9)),
    ),
    "spheres": Law(
        name="hertz",
        record=128,
        traffic=863,
        size=750,
        of_pairs=0.84,
        pairs=3.06,
        across=1.65,
        ghosts=0.77,
        copied=17e-9,
        between_threads=19e-9,
        alone=0.41e-9,
        density=0.98,
        times=((1e3, 30.0e-9), (5e3, 30.9e-9), (4.5e4, 33.0e-9), (96_300, 57.1e-9), (1e6, 112e-9)),
    ),
}


@dataclass(frozen=True)
class Machine:
    """Assumptions about the network and the nodes."""

    cores: int
    # s, B/s.
    latency: float
    bandwidth: float
    # Memory bandwidth of a node (B/s), and cache of a core (bytes).
    memory: float
    cache: float


@dataclass(frozen=True)
class Step:
    """Parts of the time of a step (s) of a rank."""

    # Its grains, on all its threads.
    grains: float
    # Pairs across its borders, which both ranks evaluate, the records of ghosts, and what other
    # ranks have less to do.
    border: float
    # What its threads lose.
    threads: float
    messages: float
    sums: float

    @property
    def total(self) -> float:
        """Time of the step (s)."""
        return self.grains + self.border + self.threads + self.messages + self.sums


@dataclass(frozen=True)
class Sample:
    """A sample of a length of `aspect` heights; spheres have a square section."""

    grains: float
    spheres: bool
    aspect: float
    # In d̄³, or d̄² in 2D.
    density: float

    @property
    def height(self) -> float:
        """Height, in diameters."""
        axes = 3 if self.spheres else 2
        return math.pow(self.grains / self.density / self.aspect, 1 / axes)

    @property
    def lengths(self) -> tuple[float, float, float]:
        """Length, width and height, in diameters; the width of disks is 1."""
        return (self.aspect * self.height, self.height if self.spheres else 1.0, self.height)


@dataclass(frozen=True)
class Cuts:
    """Numbers of parts along the length, the width and the height: slabs, pencils or bricks."""

    parts: tuple[int, int, int]

    @property
    def ranks(self) -> int:
        """Number of parts."""
        return math.prod(self.parts)

    def sides(self, sample: Sample) -> tuple[float, ...]:
        """Lengths of a part, in diameters."""
        return tuple(s / n for s, n in zip(sample.lengths, self.parts, strict=True))

    def area(self, sample: Sample) -> float:
        """Area of the faces of a part that are cut; a wall is no cut, but counts as one."""
        sides = self.sides(sample)
        volume = math.prod(sides)
        cut = (2 * volume / side for side, n in zip(sides, self.parts, strict=True) if n > 1)
        return sum(cut)

    def neighbours(self) -> int:
        """Number of messages that a rank sends in a step."""
        return 2 * sum(n > 1 for n in self.parts)


def rows(law: Law) -> list[dict[str, str]]:
    """The measurements of a law."""
    with MEASURED.open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["scene"] == law.name]


def grain(law: Law, grains: float) -> float:
    """Time of a grain (s) of a rank alone on its machine, interpolated over the logarithm."""
    points = [(math.log(count), time) for count, time in law.times]
    x = min(max(math.log(grains), points[0][0]), points[-1][0])
    for (x0, t0), (x1, t1) in pairwise(points):
        if x <= x1:
            return t0 + (t1 - t0) * (x - x0) / (x1 - x0)
    return points[-1][1]


def has_bands(
    law: Law, sides: tuple[float, ...], grains: float, threads: int, cache: float
) -> bool:
    """Whether a rank advances its grains band by band, several steps at once."""
    fit = cache / law.size
    layer = grains * LAYER / sides[2]
    return grains > fit and max(BAND * threads, layer) <= PART * fit


def between_threads(law: Law, sides: tuple[float, ...], threads: int) -> float:
    """Pairs between two threads of a rank for each of them.

    Shares are runs of columns of cells along x, or of parts of a column if there are not enough.
    """
    if threads == 1:
        return 0.0
    length, width, height = sides
    section = width * height
    share = length / threads
    if share >= COLUMN:
        return law.across * section
    # Pieces of a column: their sides face the next columns, their ends the next pieces.
    pieces = section * share / COLUMN
    ends = COLUMN * (height if width > 1 else 1.0)
    return law.across * (pieces * (1 - COLUMN / length) + ends)


def step(law: Law, sample: Sample, cuts: Cuts, threads: int, machine: Machine) -> Step | None:
    """A step on ranks of so many threads; None if parts are too narrow."""
    sides = cuts.sides(sample)
    if any(n > 1 and side < NARROWEST for side, n in zip(sides, cuts.parts, strict=True)):
        return None
    ranks = cuts.ranks
    own = sample.grains / ranks
    on_node = min(machine.cores // threads, ranks)
    nodes = math.ceil(ranks * threads / machine.cores)
    # All cores of a node read what does not fit into their caches; with bands once in some steps.
    missed = max(0.0, 1 - machine.cache * threads / (own * law.size))
    banded = has_bands(law, sides, own, threads, machine.cache * threads)
    traffic = law.traffic / (STEPS_AT_ONCE if banded else 1)
    from_memory = missed * traffic * on_node * threads / machine.memory
    one = max(grain(law, own / threads), from_memory)
    pair = law.of_pairs * one / law.pairs
    area = cuts.area(sample)
    duplicates = 0.5 * law.across * area
    ghosts = law.ghosts * area
    packing = threads if ghosts / 2 >= COPIED_BY_THREADS else 1
    border = duplicates * pair / threads + ghosts * law.copied / packing
    lost = between_threads(law, sides, threads) * law.between_threads
    if threads > 1:
        lost += REGIONS * REGION * math.log2(threads) + own * law.alone
        lost += (THREAD_IMBALANCE - 1) * own * one / threads
    messages = sums = 0.0
    if ranks > 1:
        border += (RANK_IMBALANCE - 1) * own * one / threads
        # All read each other's terms, or those of a tree.
        levels = 1 if on_node <= BRANCHES else 1 + math.ceil(math.log(on_node, BRANCHES))
        sums = SUM * levels
    if nodes > 1:
        messages = machine.latency + ghosts * law.record / machine.bandwidth
        sums += machine.latency * math.log2(nodes)
    return Step(own * one / threads, border, lost, messages, sums)


def layouts(ranks: int, sample: Sample, cut_axes: int) -> Iterator[Cuts]:
    """Ways to cut a sample into so many parts along its first axes; disks have no width."""
    if cut_axes == 1:
        yield Cuts((ranks, 1, 1))
        return
    for x in (x for x in range(1, ranks + 1) if ranks % x == 0):
        rest = ranks // x
        if cut_axes == 2:
            yield Cuts((x, rest, 1) if sample.spheres else (x, 1, rest))
            continue
        for y in (y for y in range(1, rest + 1) if rest % y == 0):
            if sample.spheres or y == 1:
                yield Cuts((x, y, rest // y))


@dataclass(frozen=True)
class Choice:
    """Ranks, threads and the step that they take."""

    cuts: Cuts
    threads: int
    step: Step


def best(
    law: Law, sample: Sample, cores: int, cut_axes: int, machine: Machine, most_threads: int
) -> Choice | None:
    """The fastest way to use so many cores."""
    found: Choice | None = None
    threads = 1
    while threads <= min(most_threads, cores, machine.cores):
        for cuts in layouts(cores // threads, sample, cut_axes):
            one = step(law, sample, cuts, threads, machine)
            if one is not None and (found is None or one.total < found.step.total):
                found = Choice(cuts, threads, one)
        threads *= 2
    return found


def alone(law: Law, sample: Sample, cores: int) -> float:
    """A step (s) of cores that neither wait nor share anything."""
    return sample.grains / cores * grain(law, sample.grains / cores)


# What the columns of the table cut: axes, and the most threads of a rank.
COLUMNS = (
    ("slabs, 1 thread", 1, 1),
    ("slabs, ranks × threads", 1, 64),
    ("cut along the width as well", 2, 64),
    ("bricks, 1 thread", 3, 1),
)


def table(law: Law, spheres: bool, machine: Machine, aspect: float, cells: bool) -> None:
    """Prints the table of a law: million grain-steps/s and share of what cores alone would do."""
    columns = COLUMNS if spheres else (COLUMNS[0], COLUMNS[1], COLUMNS[3])
    print("| grains | cores | " + " | ".join(name for name, _, _ in columns) + " |")
    print("| ---: | ---: |" + " ---: |" * len(columns))
    for grains in (1e5, 1e6, 1e7, 1e8):
        sample = Sample(grains, spheres, aspect, law.density)
        for cores in (1, 16, 128, 1024, 8192):
            words = []
            for _, cut_axes, threads in columns:
                found = best(law, sample, cores, cut_axes, machine, threads)
                if found is None:
                    words.append("–")
                    continue
                time = found.step.total
                share = 100 * alone(law, sample, cores) / time
                words.append(f"{grains / time / 1e6:,.0f} ({share:.0f} %)")
                if threads > 1 and cores > 1:
                    words[-1] += f" {found.cuts.ranks:,} × {found.threads}"
                if cells:
                    one = found.step
                    parts = [one.grains, one.border, one.threads, one.messages, one.sums]
                    words[-1] += " " + "+".join(f"{1e6 * part:.1f}" for part in parts) + " µs"
            if set(words) != {"–"}:
                print(
                    f"| {grains:.0e} | {cores:,} | ".replace("e+0", "e") + " | ".join(words) + " |"
                )


def beside(law: Law) -> None:
    """Prints what two ranks on two cores lose, as measured and by the model."""
    print("| grains | a step of half a sample | two ranks take longer by | model |")
    print("| ---: | ---: | ---: | ---: |")
    for row in rows(law):
        grains = float(row["grains"])
        half = grains / float(row["two_runs_m"])
        longer = grains / float(row["two_ranks_m"]) - half
        sent = float(row["bytes_sent_per_step"]) / law.record
        # Of the measured ghosts.
        duplicates = 0.5 * sent / law.ghosts * law.across
        pair = law.of_pairs * grain(law, grains / 2) / law.pairs
        model = 1e6 * (duplicates * pair + sent * law.copied + SUM)
        print(f"| {grains:,.0f} | {half:,.1f} µs | {longer:,.1f} µs | {model:,.1f} µs |")


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--law", choices=LAWS, help="of these grains alone")
    add("--aspect", type=float, default=10.0, help="length over height of the sample [%(default)s]")
    add("--node", type=int, default=128, help="cores of a node [%(default)s]")
    add("--latency", type=float, default=2e-6, help="of a message between nodes (s) [%(default)s]")
    add("--bandwidth", type=float, default=12e9, help="between nodes (B/s) [%(default)s]")
    add("--memory", type=float, default=400e9, help="of a node (B/s) [%(default)s]")
    add("--cache", type=float, default=5e6, help="of a core, all levels (bytes) [%(default)s]")
    add("--cells", action="store_true", help="parts: grains + border + threads + messages + sums")
    add("--measured", action="store_true", help="beside two measured ranks")
    given = parser.parse_args()
    machine = Machine(given.node, given.latency, given.bandwidth, given.memory, given.cache)
    for name in [given.law] if given.law else LAWS:
        print(f"\n{name.capitalize()}\n")
        if given.measured:
            beside(LAWS[name])
        else:
            table(LAWS[name], name == "spheres", machine, given.aspect, given.cells)


if __name__ == "__main__":
    main()
