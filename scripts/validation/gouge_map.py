#!/usr/bin/env python3
"""What decides how fast an agitated gouge creeps: holds over frequency, amplitude and source.

    gouge_map.py OUT [NAME ...] [SEED ...]

Runs configs/gouge-holds-cheap.toml with three seeds into OUT and holds that branch from it, and
writes a line into OUT/holds.csv as each hold ends. NAME is one or more of wall, long, load, steps,
large, kicks, table (default: all). Runs that are there already are not made again. table writes the
tables OUT/gouge-map-runs.csv, OUT/gouge-map.csv, OUT/gouge-collapse.csv, OUT/gouge-steps.csv and
the figure OUT/gouge-map.svg of docs/validation/gouge.md. GSHEAR_MPI names the program.
"""

from __future__ import annotations

import runpy
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from gouge_creep import (
    FAST,
    KICKS,
    SEEDS,
    SLIDE,
    agitated,
    base,
    branch,
    branch_from,
    checkpoint_after,
    kicked_hold,
    units,
)

from gshear import Run

Array = np.ndarray

HOLD = 10e-3
LONG_HOLD = 100e-3
# Rows of a hold of 10 ms: no frequency below has a whole number of them in a period, so that their
# mean is one over phases.
ROWS = 3236
# Amplitudes (m) of the wall by frequency (Hz).
WALLS = {
    20e3: (1e-6, 2e-6, 4e-6),
    2e3: (20e-6, 40e-6, 80e-6),
    100e3: (0.2e-6, 0.4e-6, 0.8e-6),
    5e3: (2e-6, 4e-6, 8e-6),
    50e3: (0.8e-6,),
    10e3: (4e-6,),
}
LONG = ((20e3, 2e-6), (2e3, 40e-6), (20e3, 1e-6), (100e3, 0.4e-6), (5e3, 4e-6))
LARGE = ((20e3, 2e-6), (2e3, 40e-6), (100e3, 0.4e-6))
LOADS = ((20e3, 0.2e6), (2e3, 0.5e6))
# About as many free spheres as the paper has, between walls of two layers: at 2 kHz one slips
# through a wall of a single layer.
LARGE_SIZE = (
    "sample.grains=5720",
    "sample.length=60e-3",
    "sample.width=60e-3",
    "sample.wall_thickness=2",
)
# Branches have the keys of the run that they begin from.
RECORDED = ("output.energy=true", "output.temperatures=true")
# Windows of the slope over ln t (s).
WINDOWS = ((1e-4, 1e-3), (1e-3, 1e-2), (1e-2, 1e-1))
# Frames in a cycle of the vibration after the hold, where contacts are counted.
FRAMES = 20


def slope(time: Array, mu: Array, window: tuple[float, float], frequency: float) -> float:
    """The slope of μ over ln t in a window, less what oscillates with the agitation.

    Least squares of A + B ln t and the first two harmonics, rows weighted by 1/t, so that every
    decade counts alike. NaN if the hold is shorter, or if the window has less than a cycle.
    """
    first, last = window
    if time[-1] < 0.99 * last or last - first < 1.0 / frequency:
        return float("nan")
    inside = (time >= first) & (time <= last)
    t = time[inside]
    phase = 2.0 * np.pi * frequency * t
    waves = [f(k * phase) for k in (1, 2) for f in (np.cos, np.sin)]
    terms = np.stack([np.ones_like(t), np.log(t / first), *waves], axis=1)
    weight = np.sqrt(1.0 / t)
    found = np.linalg.lstsq(terms * weight[:, None], mu[inside] * weight, rcond=None)[0]
    return float(found[1])


def contacts_of_cycles(folder: Path, frequency: float) -> list[float]:
    """Contacts of a free grain, and shares of the contacts that change and that slip.

    Means over the cycles of a run with FRAMES frames in each: the share of the contacts that are
    made or lost between two frames, per second; that differ after a cycle; that are at the limit of
    friction in one frame of a cycle or more.
    """
    with Run(folder, quiet=True) as run:
        pairs, sliding = [], []
        for frame in run.frames:
            contacts = frame.contacts
            pair = contacts.i.astype(np.int64) * len(frame.radius) + contacts.j
            pairs.append(pair)
            sliding.append(pair[np.asarray(contacts.sliding, dtype=bool)])
        free = int((run.frames[0].body == 0).sum())
    mean = np.mean([len(pair) for pair in pairs])
    changed = np.mean([len(np.setxor1d(a, b)) for a, b in pairwise(pairs)])
    cycles = [slice(k, k + FRAMES) for k in range(0, len(pairs) - FRAMES, FRAMES)]
    after = [len(np.setxor1d(pairs[c.start], pairs[c.stop])) for c in cycles]
    slipped = [len(np.unique(np.concatenate(sliding[c]))) for c in cycles]
    return [
        2.0 * mean / free,
        changed * FRAMES * frequency / mean,
        float(np.mean(after)) / mean,
        float(np.mean(slipped)) / mean,
    ]


def measured(folder: Path, slide: Path, frequency: float) -> dict[str, float | str]:
    """Temperatures, powers and slopes of a hold. The slide before it is in the run `slide`."""
    with Run(slide, quiet=True) as run:
        before = run.series[run.series["drive_velocity"] == 0.1]
        start = before["stress_ratio"].to_numpy()[-20:].mean()
    unit, free, _ = units(folder)
    with Run(folder, quiet=True) as run:
        rows = run.series[run.series["drive_velocity"] == 0.0]
        digest, spheres = str(run.parameters["digest"]), free
    time = rows["time"].to_numpy()
    time = time - time[0] + (time[1] - time[0])
    mu = rows["stress_ratio"].to_numpy()
    late = rows.iloc[len(rows) // 2 :]
    since = late["time"].to_numpy()
    lost = sum(late[f"dissipated_{by}"] for by in ("damping", "friction", "rolling", "stiffness"))

    def power(energy: pd.Series) -> float:
        """Power per grain over P d³ (1/s)."""
        return float(np.polyfit(since - since[0], energy.to_numpy(), 1)[0] / free / unit)

    ends = []
    for t in (1e-4, HOLD):
        near = (time > t / 1.2) & (time < t * 1.2)
        ends.append(np.polyfit(np.log(time[near] / t), mu[near], 1)[1] - start)
    last = mu[time > 0.9 * time[-1]].mean() - start
    return {
        "spheres": spheres,
        "scaled_temperature": float(late["granular_temperature"].mean() / unit),
        "scaled_spin_temperature": float(late["spin_temperature"].mean() / unit),
        "scaled_kinetic_energy": float(late["kinetic_energy"].mean() / free / unit),
        "dissipated_power": power(lost),
        "friction_power": power(late["dissipated_friction"]),
        "work_power": power(late["work_load"] + late["work_drive"]),
        "sliding_fraction": float(late["sliding_fraction"].mean()),
        "change": float(last),
        "slope_ends": float((ends[1] - ends[0]) / np.log(HOLD / 1e-4)),
        **{
            f"slope_{first * 1e3:g}_{last * 1e3:g}_ms": slope(time, mu, (first, last), frequency)
            for first, last in WINDOWS
        },
        "slope_0.1_10_ms": slope(time, mu, (1e-4, HOLD), frequency),
        "digest": digest,
    }


def record(out: Path, row: dict[str, float | str]) -> None:
    """Adds a line to OUT/holds.csv."""
    path = out / "holds.csv"
    line = pd.DataFrame([row])
    line.to_csv(path, mode="a", header=not path.exists(), index=False)
    print(*(f"{key}={value}" for key, value in row.items()), flush=True)


def is_recorded(out: Path, key: dict[str, float | str]) -> bool:
    """Whether OUT/holds.csv has a hold."""
    path = out / "holds.csv"
    if not path.exists():
        return False
    table = pd.read_csv(path)
    same = np.ones(len(table), dtype=bool)
    for name, value in key.items():
        same &= (table[name] == value).to_numpy()
    return bool(same.any())


def hold(
    out: Path,
    source: str,
    frequency: float,
    amplitude: float,
    seed: int,
    time: float = HOLD,
    large: bool = False,
) -> None:
    """Makes and records a hold, and a few cycles after it in which contacts are counted."""
    size = "5720" if large else "770"
    key = {
        "size": int(size),
        "source": source,
        "frequency": frequency,
        "amplitude": amplitude,
        "seed": seed,
        "duration": time,
    }
    if is_recorded(out, key):
        return
    sets = (*RECORDED, *LARGE_SIZE) if large else RECORDED
    start = (base(out, seed, f"base-{size}", *sets), 2)
    rows = f"output.series_rows={round(ROWS * time / HOLD)}"
    of = agitation(source, frequency, amplitude)
    held = f"{{velocity=0.0,time={time}{of}}}"
    name = f"{source}-{size}-{frequency:g}-{amplitude:g}-{time:g}".replace(" ", "-")
    if source == "random kicks":
        folder = out / name / f"seed-{seed}"
        if not (folder / "kicked").exists():
            shutil.rmtree(folder, ignore_errors=True)
            kicked_hold(checkpoint_after(*start), folder, amplitude, seed)
            (folder / "kicked").touch()
        counted = [float("nan")] * 4
    else:
        folder = branch(out, start, name, [FAST, SLIDE, held], rows)
        cycles = max(2, min(10, round(frequency * 1e-3)))
        after = out / f"{name}-cycles" / f"seed-{seed}"
        parts = [FAST, SLIDE, held, f"{{velocity=0.0,time={cycles / frequency}{of}}}"]
        branch_from(folder / "checkpoint.h5", after, parts, f"output.frame_rows={cycles * FRAMES}")
        counted = contacts_of_cycles(after, frequency)
    names = ("coordination", "changes_per_second", "changed_per_cycle", "slipping_per_cycle")
    record(
        out,
        {
            **key,
            **measured(folder, start[0], frequency),
            **dict(zip(names, counted, strict=True)),
        },
    )


def agitation(source: str, frequency: float, amplitude: float) -> str:
    """Keys of a part with this agitation."""
    if source == "load":
        return f",pressure=5e6,pressure_amplitude={amplitude},pressure_frequency={frequency}"
    return agitated(amplitude, frequency) if source == "wall" else ""


def wall(out: Path, seed: int) -> None:
    """Holds under a wall that vibrates, and one without agitation."""
    for frequency, amplitudes in WALLS.items():
        for amplitude in amplitudes:
            hold(out, "wall", frequency, amplitude, seed)
    hold(out, "none", 20e3, 0.0, seed)


def large(out: Path, seed: int) -> None:
    """Holds of the paper's number of spheres, 4,160 of them free."""
    for frequency, amplitude in LARGE:
        hold(out, "wall", frequency, amplitude, seed, large=True)


def long(out: Path, seed: int) -> None:
    """Holds of 100 ms."""
    for frequency, amplitude in LONG:
        hold(out, "wall", frequency, amplitude, seed, LONG_HOLD)


def load(out: Path, seed: int) -> None:
    """Holds while the load vibrates."""
    for frequency, amplitude in LOADS:
        hold(out, "load", frequency, amplitude, seed)


def kicks(out: Path, seed: int) -> None:
    """Holds in which free grains get random velocities 20,000 times a second."""
    for deviation in KICKS[1::2]:
        hold(out, "random kicks", 20e3, deviation, seed)


def steps(out: Path, seed: int) -> None:
    """Velocity steps between 0.01 and 0.001 m/s at 2 µm and 20 kHz, down and up three times.

    At a spring and layer of k̄ = 770 /m a slide is steady after some a/(k̄ V), 32 and 3 ms with the
    paper's a: half of each part is several times as long.
    """
    of = agitated(2e-6)
    slides = [(0.01, 0.5e-3), *[(0.001, 0.15e-3), (0.01, 0.2e-3)] * 3]
    parts = [FAST, SLIDE, *(f"{{velocity={v},distance={d}{of}}}" for v, d in slides)]
    start = (base(out, seed, "base-770", *RECORDED), 2)
    branch(out, start, "steps", parts, "output.series_rows=20000")


POINT = ["size", "source", "frequency", "amplitude", "duration"]
QUANTITIES = [
    "scaled_kinetic_energy",
    "scaled_temperature",
    "scaled_spin_temperature",
    "dissipated_power",
    "changes_per_second",
    "slipping_per_cycle",
    "sliding_fraction",
]
# In the figure.
DRAWN = {
    "scaled_temperature": "T/(P d³)",
    "dissipated_power": "power of a grain/(P d³) (1/s)",
    "changes_per_second": "share of contacts\nthat change, per second",
    "sliding_fraction": "share of contacts\nthat slip at a time",
}
SLOPES = ["slope_ends", *(f"slope_{a * 1e3:g}_{b * 1e3:g}_ms" for a, b in WINDOWS)]
SLOPE = "slope_0.1_10_ms"
FIT_OVER = [SLOPE, "slope_0.1_1_ms", "slope_1_10_ms"]


def points(runs: pd.DataFrame) -> pd.DataFrame:
    """Means over packings of every point of the map, with their standard errors."""
    columns = [*QUANTITIES, "friction_power", "work_power", "changed_per_cycle", "change"]
    columns += [SLOPE, *SLOPES]
    groups = runs.groupby(POINT, sort=True)[columns]
    means, errors = groups.mean(), groups.sem()
    table = means.join(errors.add_suffix("_error"))
    table.insert(0, "packings", groups.size())
    return table.reset_index()


def misfits(x: Array, y: Array) -> list[float]:
    """How well x alone says y: ρ of Spearman, and what a power law leaves.

    The latter is e to the rms of the difference of logarithms, a factor; NaN if y changes its sign.
    """
    rho = float(pd.Series(x).corr(pd.Series(y), method="spearman"))
    if (y <= 0.0).any():
        return [rho, float("nan")]
    a, b = np.log(x), np.log(y)
    rest = b - np.polyval(np.polyfit(a, b, 1), a)
    return [rho, float(np.exp(np.sqrt((rest**2).sum() / (len(y) - 2))))]


def misfits_of(table: pd.DataFrame, quantity: str, window: str) -> list[float]:
    """`misfits` of the slopes in a window over a quantity."""
    return misfits(table[quantity].to_numpy(), -table[window].to_numpy())


def collapse(runs: pd.DataFrame) -> pd.DataFrame:
    """How well each quantity alone says the slope, of 770 spheres in 10 ms over a vibrating wall.

    Of frequencies from `least_frequency` up: `points`, all of them, with the means over their
    packings; or those that all packings have, with the mean and the standard error over packings.
    """
    chosen = runs[(runs["size"] == 770) & (runs["source"] == "wall") & (runs["duration"] == HOLD)]
    rows = []
    for least in (2e3, 5e3, 20e3):
        of = chosen[chosen["frequency"] >= least]
        mapped = of.groupby(["frequency", "amplitude"])
        shared = of[mapped["seed"].transform("nunique") == of["seed"].nunique()]
        packings = [table for _, table in shared.groupby("seed")]
        for window in FIT_OVER:
            for quantity in QUANTITIES:
                means = mapped[[quantity, window]].mean()
                rho, factor = misfits_of(means, quantity, window)
                row: dict[str, float | str] = {"least_frequency": least, "window": window[6:]}
                row |= {"quantity": quantity, "points": len(means), "rho": rho, "factor": factor}
                found = np.array([misfits_of(table, quantity, window) for table in packings])
                for k, name in enumerate(("rho", "factor")):
                    row[f"{name}_by_packing"] = found[:, k].mean()
                    row[f"{name}_error"] = found[:, k].std(ddof=1) / len(found) ** 0.5
                rows.append(row | {"shared_points": len(packings[0]), "packings": len(packings)})
    return pd.DataFrame(rows)


def sources_of(table: pd.DataFrame) -> dict[str, tuple[pd.DataFrame, str, object]]:
    """The points of a figure by source and frequency, with marker and colour."""
    import matplotlib.pyplot as plt

    colours = dict(zip(sorted(WALLS), plt.get_cmap("plasma")(np.linspace(0, 0.9, 6)), strict=True))
    markers = {"wall": "o", "load": "^", "random kicks": "X"}
    held = table[(table["duration"] == HOLD) & (table["source"] != "none")]
    groups = {}
    for (source, frequency, size), rows in held.groupby(["source", "frequency", "size"]):
        is_large = size != 770
        marker = "s" if is_large else markers[source]
        more = ", 4,160 spheres" if is_large else ""
        name = f"{source}, {frequency / 1e3:g} kHz{more}"
        groups[name] = (rows, marker, colours[frequency])
    return groups


def draw(table: pd.DataFrame, path: Path) -> None:
    """The slopes of the holds of 10 ms in two windows of time over four quantities."""
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator

    figure = plt.figure(figsize=(10.0, 6.0), layout="constrained")
    grid = figure.subplots(2, 4, sharey=True, sharex="col")
    for panels, (first, last) in zip(grid, WINDOWS[:2], strict=True):
        window = f"slope_{first * 1e3:g}_{last * 1e3:g}_ms"
        panels[0].set_ylabel(
            f"fall of μ per factor e of time,\n{first * 1e3:g} to {last * 1e3:g} ms"
        )
        for panel, (quantity, label) in zip(panels, DRAWN.items(), strict=True):
            for name, (rows, marker, colour) in sources_of(table).items():
                errors = rows[f"{window}_error"], rows[f"{quantity}_error"]
                shown = {"marker": marker, "color": colour, "label": name, "markersize": 5}
                panel.errorbar(rows[quantity], -rows[window], *errors, linestyle="", **shown)
            panel.axhline(0.0247, color="black", linestyle="--", linewidth=0.8)
            panel.set(xscale="log", ylim=(0, None))
            panel.xaxis.set_minor_formatter("")
            subs = (1.0,) if quantity == "scaled_temperature" else (1.0, 3.0)
            panel.xaxis.set_major_locator(LogLocator(subs=subs))
            panel.xaxis.set_major_formatter("{x:g}")
            panel.set_xlabel(label if last == HOLD else "")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize="small")
    figure.savefig(path, metadata={"Date": None})


def slides(out: Path) -> tuple[pd.DataFrame, list[str]]:
    """The agitated slides of `steps` and the digests of their runs.

    μ and T are means over the latter half of a slide; `per_factor_e` is the change of μ from the
    slide before over that of ln V.
    """
    rows, digests = [], []
    for folder in sorted((out / "steps").glob("seed-*")):
        unit, _, _ = units(folder)
        with Run(folder, quiet=True) as run:
            series = run.series
            digests.append(str(run.parameters["digest"]))
        part = series["drive_velocity"].diff().ne(0.0).cumsum()
        before = None
        for _, slide in series.groupby(part):
            late = slide.iloc[len(slide) // 2 :]
            velocity, mu = slide["drive_velocity"].iloc[0], late["stress_ratio"].mean()
            change = float("nan")
            if before is not None:
                change = (mu - before[1]) / np.log(velocity / before[0])
            before = (velocity, mu)
            rows.append(
                {
                    "seed": int(folder.name.rpartition("-")[2]),
                    "velocity": velocity,
                    "slip": slide["slip"].iloc[-1] - slide["slip"].iloc[0],
                    "mu": mu,
                    "scaled_temperature": late["granular_temperature"].mean() / unit,
                    "per_factor_e": change,
                }
            )
    return pd.DataFrame(rows), digests


def table(out: Path) -> None:
    """Writes the tables and the figure, and the digest of each for made.csv."""
    runs = pd.read_csv(out / "holds.csv").sort_values([*POINT, "seed"])
    joined = runpy.run_path(str(Path(__file__).parents[1] / "tables.py"))["joined"]
    mapped = points(runs)
    tables = {"gouge-map-runs": runs, "gouge-map": mapped, "gouge-collapse": collapse(runs)}
    for name, rows in tables.items():
        rows.to_csv(out / f"{name}.csv", index=False, float_format="%.4g")
        print(f"{name}.csv: {len(runs)} runs, digest {joined(runs['digest'])}")
    draw(mapped, out / "gouge-map.svg")
    table_of_steps(out)


def table_of_steps(out: Path) -> None:
    """Writes the table of the velocity steps, if there are any, and prints their mean."""
    joined = runpy.run_path(str(Path(__file__).parents[1] / "tables.py"))["joined"]
    rows, digests = slides(out)
    if not digests:
        return
    rows.to_csv(out / "gouge-steps.csv", index=False, float_format="%.4g")
    print(f"gouge-steps.csv: {len(digests)} runs, digest {joined(digests)}")
    of_packings = rows.groupby("seed")["per_factor_e"].mean()
    print(f"per factor e: {of_packings.mean():.4f} ± {of_packings.sem():.4f} over packings")
    print(f"single steps: ± {rows['per_factor_e'].std():.4f}")


EXPERIMENTS = (wall, long, load, steps, large, kicks)


def main(out: Path, words: list[str]) -> None:
    """Makes the experiments of these names for these seeds."""
    out.mkdir(parents=True, exist_ok=True)
    names = [word for word in words if not word.isdigit()]
    seeds = [int(word) for word in words if word.isdigit()] or SEEDS
    for seed in seeds:
        for experiment in EXPERIMENTS:
            if not names or experiment.__name__ in names:
                experiment(out, seed)
    if not names or "table" in names:
        table(out)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
