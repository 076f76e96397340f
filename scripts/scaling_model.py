#!/usr/bin/env python3
"""A step on any number of ranks and threads: the model of docs/validation/speed.md, "Many ranks".

    scripts/scaling --model                     the tables of docs/figures/scaling-model.txt
    scripts/scaling --model --cells             the same with the parts of every step
    scripts/scaling --model --measured          beside the measurements of docs/figures/scaling.csv

Nothing is measured here. Constants of one and two ranks are measured ones, each with its source;
those of a network and of a node are assumptions, given as options.
"""

from __future__ import annotations

import argparse
import csv
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Speeds of one rank and of two.
MEASURED = ROOT / "docs" / "figures" / "scaling.csv"

# The time of a border grain over that of a grain: 23 ns and 30 ns of disks on Z
# (docs/validation/speed.md, "Many ranks"); for spheres an assumption.
BORDER = 23 / 30
# A sum of two ranks on a node (s): docs/validation/speed.md, "Many ranks", Z.
SUM = 0.5e-6
# A slab is at least so many diameters wide, more than twice the cutoff.
NARROWEST = 4


@dataclass(frozen=True)
class Law:
    """Constants of a scene of docs/figures/scaling.csv."""

    name: str
    # Bytes of a border grain in a message: docs/figures/scaling.csv, bytes over grains of the
    # border.
    record: int
    # Bytes that a step moves for a grain: docs/lab/speed.md, "A million grains" (disks), and
    # docs/figures/roofline.csv, contacts and motion (spheres).
    traffic: int
    # Bytes of a grain in memory: docs/validation/speed.md.
    size: int
    # Two threads over one with some 5,000 grains: docs/validation/speed.md, "Threads".
    two_threads: float
    # Time of a grain (s) of large packings, without list and checkpoint: docs/lab/speed.md, "A
    # million grains". Smaller ones: docs/figures/scaling.csv, one rank.
    large: tuple[tuple[float, float], ...]


LAWS = {
    "disks": Law("hooke", 64, 660, 500, 1.73, ((1e5, 18.0e-9), (1e6, 37.5e-9))),
    "spheres": Law("hertz", 128, 863, 700, 1.72, ((96_300, 68.9e-9), (963_000, 112e-9))),
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

    grains: float
    border: float
    messages: float
    sums: float

    @property
    def total(self) -> float:
        """Time of the step (s)."""
        return self.grains + self.border + self.messages + self.sums


def rows(law: Law) -> list[dict[str, str]]:
    """The measurements of a law."""
    with MEASURED.open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["scene"] == law.name]


def grain(law: Law, grains: float) -> float:
    """Time of a grain (s) of a rank alone on its machine, interpolated over the logarithm."""
    small = [(float(r["grains"]), 1e-6 / float(r["one_rank_m"])) for r in rows(law)]
    known = [*(point for point in small if point[0] < law.large[0][0]), *law.large]
    points = [(math.log(of), time) for of, time in known]
    x = min(max(math.log(grains), points[0][0]), points[-1][0])
    for (x0, t0), (x1, t1) in pairwise(points):
        if x <= x1:
            return t0 + (t1 - t0) * (x - x0) / (x1 - x0)
    return points[-1][1]


def threads_speed(law: Law, threads: int) -> float:
    """Speed of threads over one, if what two of them lose is a serial share (Amdahl)."""
    serial = 2 / law.two_threads - 1
    return 1 / (serial + (1 - serial) / threads)


@dataclass(frozen=True)
class Sample:
    """A sample of a length of `aspect` heights; spheres have a square section."""

    grains: float
    spheres: bool
    aspect: float

    @property
    def length(self) -> float:
        """Length along the shear, in diameters."""
        axes = 3 if self.spheres else 2
        return self.aspect * math.pow(self.grains / self.aspect, 1 / axes)

    @property
    def border(self) -> float:
        """Border grains of a slab: two columns at each side, sent and received."""
        return 4 * self.grains / self.length


def step(law: Law, sample: Sample, ranks: int, threads: int, machine: Machine) -> Step | None:
    """A step on so many ranks of so many threads; None if slabs are too narrow."""
    if ranks > 1 and sample.length / ranks < NARROWEST:
        return None
    own = sample.grains / ranks
    border = sample.border if ranks > 1 else 0.0
    on_node = min(machine.cores // threads, ranks)
    nodes = math.ceil(ranks * threads / machine.cores)
    # All cores of a node read what does not fit into their caches.
    missed = max(0.0, 1 - machine.cache * threads / (own * law.size))
    from_memory = missed * law.traffic * on_node * threads / machine.memory
    one = grain(law, own / threads)
    speed = threads_speed(law, threads)
    messages = sums = 0.0
    if ranks > 1:
        sums = SUM * math.log2(max(on_node, 2))
    if nodes > 1:
        messages = machine.latency + border / 2 * law.record / machine.bandwidth
        sums += machine.latency * math.log2(nodes)
    work = max(own * one / speed, own * from_memory / threads)
    return Step(work, border * BORDER * one / speed, messages, sums)


def table(law: Law, spheres: bool, machine: Machine, aspect: float, cells: bool) -> None:
    """Prints the table of a law: million grain-steps/s and share of what cores alone would do."""
    threads = (1, 4, 16)
    print("| grains | cores | " + " | ".join(f"{t} thread{'s' * (t > 1)}" for t in threads) + " |")
    print("| ---: | ---: |" + " ---: |" * len(threads))
    for grains in (1e5, 1e6, 1e7, 1e8):
        sample = Sample(grains, spheres, aspect)
        for cores in (1, 16, 128, 1024, 8192):
            words = []
            for of_rank in threads:
                found = None
                if cores % of_rank == 0:
                    found = step(law, sample, cores // of_rank, of_rank, machine)
                if found is None:
                    words.append("–")
                    continue
                # Cores that neither wait nor share anything.
                alone = grains / cores * grain(law, grains / cores)
                words.append(
                    f"{grains / found.total / 1e6:,.0f} ({100 * alone / found.total:.0f} %)"
                )
                if cells:
                    parts = (found.grains, found.border, found.messages, found.sums)
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
        border = float(row["bytes_sent_per_step"]) / law.record
        model = 1e6 * (border * BORDER * grain(law, grains / 2) + SUM)
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
    add("--cells", action="store_true", help="the parts: grains + border + messages + sums")
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
