#!/usr/bin/env python3
"""Do complex pairs and negative eigenvalues of K foretell slips?

    python3 examples/slip_precursors.py RUN [RUN ...] --out OUT [--slips 50]
        [--before 0,1,2,4,8,16,32] [--calm 2e-3] [--dampers] [--dmin 8] [--probes]

Takes the largest slips of each run of disks, finds all eigenvalues of K v = λ M v at some rows of
the time series before the start of each, and compares them with frames at random times in sticks of
the same runs. With --calm only slips that begin a drop count: τ has not fallen by that before.
--dampers adds the motions that grow with the dampers, --dmin D²min over so many intervals before,
--probes the local yield stress (local_yield.py): the least of the slabs. Intervals of several runs
are by resampling runs, those of one by resampling its slips. Without frames in RUN every slip is
replayed from its kept checkpoints.

Writes precursors.csv (one line per frame), precursors-tests.csv (one line per measure and time) and
precursors.svg into OUT. Needs the Python package of `python/` and gshear-reduce; frames that are
done already are read from OUT.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from local_yield import Probe, probed

from gshear import Run, programs

MEASURES = {
    "pairs": "complex pairs",
    "negative": "negative real eigenvalues",
    "pairs_negative": "pairs with negative real part",
    "growth_rate": "fastest growth rate",
    "sliding": "sliding contacts",
}
DAMPED = {
    "growing_pairs": "growing pairs, damped",
    "growing": "growing real motions, damped",
    "damped_growth_rate": "fastest growth rate, damped",
}
OTHERS = {
    "dmin_greatest": "greatest D²min",
    "dmin_top_tenth": "D²min, top tenth",
    "local_yield": "least local yield stress",
}
ALL = MEASURES | DAMPED | OTHERS
# Slabs of 6 diameters every 4, sheared by 0.002 diameters: some hundred intervals.
PROBE = Probe(spacing=4.0, displacement=0.002)
RESAMPLES = 2000
# Rows further apart are replayed each by itself.
GAP = 32


class Slip(NamedTuple):
    """A slip: the row at its start, and the change of τ."""

    row: int
    size: float


class Chosen(NamedTuple):
    """Which slips are taken, and when they are looked at."""

    count: int
    times: list[int]
    # By how much τ may have fallen before.
    calm: float
    with_dampers: bool
    # Intervals of D²min; 0 is without it.
    lag: int
    with_probes: bool


def slips_of(run: Run, chosen: Chosen, first: int) -> list[Slip]:
    """Returns the largest slips that begin at row `first` or later, in their order."""
    phases, count = run.phases(), chosen.count
    found = phases[(phases["kind"] == "slip") & (phases["start_row"] >= first)]
    tau, longest = run.series["stress_ratio"].to_numpy(), max(chosen.times)
    fallen = [tau[row - longest : row + 1].max() - tau[row] for row in found["start_row"]]
    found = found[np.array(fallen) < chosen.calm]
    largest = found.nsmallest(count, "delta_tau_p").sort_values("start_row")
    rows = zip(largest["start_row"], largest["delta_tau_p"], strict=True)
    return [Slip(int(row), float(-change)) for row, change in rows]


def random_rows(run: Run, count: int, first: int, random: np.random.Generator) -> list[int]:
    """Returns rows in sticks, each as likely as the others."""
    phases = run.phases()
    sticks = phases[(phases["kind"] == "stick") & (phases["end_row"] > first)]
    rows = [
        np.arange(max(start, first), end)
        for start, end in zip(sticks["start_row"], sticks["end_row"], strict=True)
    ]
    all_rows = np.concatenate(rows)
    return sorted(random.choice(all_rows, min(count, len(all_rows)), replace=False).tolist())


def windows(rows: list[int]) -> list[list[int]]:
    """Returns the rows in groups that one replay each serves."""
    groups: list[list[int]] = []
    for row in rows:
        if groups and row - groups[-1][-1] <= GAP:
            groups[-1].append(row)
        else:
            groups.append([row])
    return groups


def reduce(*arguments: object) -> None:
    """Runs gshear-reduce."""
    programs.run([programs.find("gshear-reduce"), *map(str, arguments)], quiet=True)


def frames_of(run: Run, rows: list[int], out: Path, lag: int) -> Path:
    """Returns a file with a frame at each of the rows and `lag` before: of the run or a replay."""
    steps = run.series["step"][rows]
    if set(steps) <= set(run.frames.step.tolist()):
        return run.path
    folder = out / f"replay-{steps.iloc[0]}"
    if not (folder / "run.h5").exists():
        strain = run.series["strain"]
        # A replay needs two rows: the one before the first comes along, and half an interval.
        first = rows[0] - max(1, lag)
        half = 0.4 * (strain[rows[0]] - strain[rows[0] - 1])
        ends = [float(strain[first] - half), float(strain[rows[-1]] + half)]
        reduce("replay", run.path, "--out", folder, f"--strain={ends[0]!r}..{ends[1]!r}")
    return folder / "run.h5"


def other_measures(run: Run, frame: int, chosen: Chosen) -> dict[str, float]:
    """Returns D²min over the square of the mean radius, and the least local yield stress."""
    found = {}
    if chosen.lag:
        grains = run.frames[frame]
        dmin = run.dmin(frame, lag=chosen.lag)[np.asarray(grains.body) == 0]
        known = np.sort(dmin[np.isfinite(dmin)])[::-1] / np.mean(grains.radius) ** 2
        found["dmin_greatest"] = float(known[0])
        found["dmin_top_tenth"] = float(known[: max(1, len(known) // 10)].mean())
    if chosen.with_probes:
        found["local_yield"] = float(probed(run, frame, PROBE)["local_yield"].min())
    return found


def measures_of(run: Run, rows: list[int], out: Path, chosen: Chosen) -> pd.DataFrame:
    """Returns a line at every row of the time series: that of stability.csv, and other measures."""
    more = ["--dampers"] if chosen.with_dampers else []
    lines = []
    for group in windows(rows):
        steps = [int(run.series["step"][row]) for row in group]
        folders = [out / f"step-{step}" for step in steps]
        if not all((folder / "measures.csv").exists() for folder in folders):
            path = frames_of(run, group, out, chosen.lag)
            results = out if path == run.path else path.parent
            with Run(path, results=results, quiet=True) as source:
                numbers = {int(step): k for k, step in enumerate(source.frames.step)}
                for step, folder in zip(steps, folders, strict=True):
                    folder.mkdir(parents=True, exist_ok=True)
                    at = numbers[step]
                    if not (folder / "stability.csv").exists():
                        reduce("stability", path, f"--frames={at}..{at}", "--out", folder, *more)
                    line = pd.read_csv(folder / "stability.csv").iloc[0].to_dict()
                    line |= other_measures(source, at, chosen)
                    pd.DataFrame([line]).to_csv(folder / "measures.csv", index=False)
        lines += [pd.read_csv(folder / "measures.csv").iloc[0] for folder in folders]
    table = pd.DataFrame(lines).reset_index(drop=True)
    table["row"] = [row for group in windows(rows) for row in group]
    return table


def roc_area(high: np.ndarray, low: np.ndarray) -> float:
    """Returns the probability that a value of `high` is above one of `low`; ties count half."""
    above = (high[:, None] > low[None, :]).mean()
    equal = (high[:, None] == low[None, :]).mean()
    return float(above + 0.5 * equal)


def interval(
    high: pd.DataFrame, low: pd.DataFrame, measure: str, random: np.random.Generator
) -> list[float]:
    """Returns the 95 % interval of the area, by resampling runs, or slips and frames of one run."""
    groups = [
        {run: of[measure].to_numpy(float) for run, of in x.groupby("run")} for x in (high, low)
    ]
    runs = sorted(set(groups[0]) & set(groups[1]))
    areas = []
    for _ in range(RESAMPLES):
        if len(runs) > 1:
            drawn = random.choice(runs, len(runs))
            samples = [np.concatenate([of[run] for run in drawn]) for of in groups]
        else:
            samples = [random.choice(x, len(x)) for of in groups for x in of.values()]
        areas.append(roc_area(*samples))
    return [float(x) for x in np.quantile(areas, [0.025, 0.975])]


def spearman(a: np.ndarray, b: np.ndarray, random: np.random.Generator) -> list[float]:
    """Returns Spearman's ρ and its two-sided p by permutation."""
    ranks = [pd.Series(x).rank().to_numpy() for x in (a, b)]
    if any(np.ptp(x) == 0.0 for x in ranks):
        return [np.nan, np.nan]
    rho = float(np.corrcoef(*ranks)[0, 1])
    others = [
        abs(np.corrcoef(ranks[0], random.permutation(ranks[1]))[0, 1]) for _ in range(RESAMPLES)
    ]
    return [rho, float((1 + np.sum(np.array(others) >= abs(rho) - 1e-12)) / (1 + RESAMPLES))]


def tests_of(table: pd.DataFrame, random: np.random.Generator) -> pd.DataFrame:
    """Returns the tests of every measure at every time before the slips against random frames."""
    null = table[table["before"] < 0]
    found = []
    for before, frames in table[table["before"] >= 0].groupby("before"):
        for measure in [name for name in ALL if name in table]:
            high, low = frames[measure].to_numpy(float), null[measure].to_numpy(float)
            rho, p = spearman(high, frames["size"].to_numpy(float), random)
            area, (from_, to) = roc_area(high, low), interval(frames, null, measure, random)
            mean = [high.mean(), low.mean()]
            found.append([measure, before, len(high), len(low), *mean, area, from_, to, rho, p])
    names = ["measure", "before", "slips", "random", "mean_before_slips", "mean_random"]
    names += ["roc_area", "roc_low", "roc_high", "rho_with_size", "p"]
    return pd.DataFrame(found, columns=names)


def draw(table: pd.DataFrame, tests: pd.DataFrame, path: Path) -> None:
    """Draws the areas against the time to the slip, and a measure against the size of the slip."""
    mpl.rcParams["svg.fonttype"] = "none"
    mpl.rcParams["svg.hashsalt"] = "slip precursors"
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    shown = {name: label for name, label in ALL.items() if name in table}
    for k, (measure, name) in enumerate(shown.items()):
        of = tests[tests["measure"] == measure]
        # Zero intervals before the slip stand at a half.
        x = np.maximum(of["before"], 0.5) * (1 + 0.05 * (k - len(shown) // 2))
        error = [of["roc_area"] - of["roc_low"], of["roc_high"] - of["roc_area"]]
        marker = "s" if measure in OTHERS else "o"
        left.errorbar(x, of["roc_area"], yerror(error), fmt=marker, ms=4, capsize=2, label=name)
    left.axhline(0.5, color="grey", lw=1)
    left.set(xscale="log", ylim=(0, 1), xlabel="intervals before the start of the slip")
    left.set_ylabel("ROC area against random times, 95 %")
    left.invert_xaxis()
    left.legend(fontsize=8, loc="lower center", ncols=2)
    nearest = table[table["before"] == table.loc[table["before"] >= 0, "before"].min()]
    right.plot(nearest["size"], nearest["pairs"], "o", ms=4)
    null = table.loc[table["before"] < 0, "pairs"]
    right.axhspan(*np.quantile(null, [0.25, 0.75]), color="grey", alpha=0.25)
    right.axhline(null.median(), color="grey", lw=1)
    right.set(xscale="log", xlabel="size of the slip, |Δτ|")
    right.xaxis.set_minor_formatter("")
    right.set_ylabel("complex pairs; grey: quartiles at random times")
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def yerror(error: list[pd.Series]) -> np.ndarray:
    """Returns both lengths of the error bars, none below zero by rounding."""
    return np.maximum(np.array([part.to_numpy(float) for part in error]), 0.0)


def main(arguments: list[str] | None = None) -> None:
    """Reduces the run that the arguments name."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+", help="folders of runs, or their run.h5")
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument("--slips", type=int, default=50, help="number of slips of a run [50]")
    parser.add_argument("--random", type=int, default=100, help="random frames of a run [100]")
    parser.add_argument(
        "--calm", type=float, default=np.inf, help="greatest fall of τ before [any]"
    )
    parser.add_argument("--dampers", action="store_true", help="with the dampers, too")
    parser.add_argument("--dmin", type=int, default=0, help="D²min over so many intervals [none]")
    parser.add_argument("--probes", action="store_true", help="the local yield stress, too")
    parser.add_argument("--before", default="0,1,2,4,8,16,32", help="intervals before the slip")
    parser.add_argument("--from", type=float, default=0.0, dest="onset", help="first strain [0]")
    given = parser.parse_args(arguments)
    times = [int(x) for x in given.before.split(",")]
    chosen = Chosen(given.slips, times, given.calm, given.dampers, given.dmin, given.probes)
    random = np.random.default_rng(1)
    given.out.mkdir(parents=True, exist_ok=True)
    lines = []
    for k, path in enumerate(given.runs):
        with Run(path, quiet=True) as run:
            onset = int(np.searchsorted(run.series["strain"], given.onset)) + 1
            # D²min looks back.
            onset = max(onset, given.dmin)
            slips = slips_of(run, chosen, onset + max(times))
            wanted = {slip.row - time for slip in slips for time in times}
            null = random_rows(run, given.random, onset, random)
            rows = sorted(wanted | set(null))
            out = given.out if len(given.runs) == 1 else given.out / f"run-{k + 1}"
            found = measures_of(run, rows, out, chosen).set_index("row")
        lines += [
            {"run": k, "slip": n, "before": time, "size": slip.size}
            | found.loc[slip.row - time].to_dict()
            for n, slip in enumerate(slips)
            for time in times
        ]
        lines += [
            {"run": k, "slip": -1, "before": -1, "size": np.nan} | found.loc[row].to_dict()
            for row in null
        ]
    table = pd.DataFrame(lines)
    tests = tests_of(table, random)
    table.to_csv(given.out / "precursors.csv", index=False)
    tests.to_csv(given.out / "precursors-tests.csv", index=False)
    draw(table, tests, given.out / "precursors.svg")
    slips, null = (table["before"] == times[0]).sum(), (table["before"] < 0).sum()
    print(f"{slips} slips and {null} frames at random times of {len(given.runs)} runs")
    print(tests.to_string(index=False, float_format=lambda x: f"{x:.3g}"))


if __name__ == "__main__":
    main()
