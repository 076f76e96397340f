#!/usr/bin/env python3
"""Does the shape or the size of grains change stick-slip? Disks that resist rolling, size ratios.

    disk_shapes.py OUT [run|table]

Rolling resistance stands in for shape. Each kind of disks, in three packings, is sheared at
I = 2e-4 up to γ = 2.2 %, and from there in two branches: for 3,300 intervals at I = 4e-6 as Lee &
Hurley do (configs/lee-hurley-windows.toml), and by another 10 % at I = 2e-4, where the large slips
are. Writes OUT/disk-shapes-runs.csv, OUT/disk-shapes.csv and OUT/disk-shapes.svg of
docs/validation/lee-hurley.md. Runs that are reduced already are not made again; 30 minutes of a
core. GSHEAR_MPI and GSHEAR_REDUCE name the programs.
"""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from gouge_creep import branch_from, program

from gshear import Run

SCENE = Path(__file__).parents[2] / "configs/lee-hurley-windows.toml"
REDUCE = os.environ.get("GSHEAR_REDUCE", "gshear-reduce")
SEEDS = (1, 2, 3)
FRICTION = 0.5
MEAN_RADIUS = 0.75e-6
# Those of the scene: up to γ = 2.2 % at I = 2e-4, then 3,300 intervals at I = 4e-6.
UP_TO_REGIME = "{velocity=1.4869e-2,time=6.4e-5}"
SLOW = "{velocity=2.9737e-4,time=3.4562e-4}"
# 10 % of γ at I = 2e-4, with frames 3e-5 apart.
FAST = "{velocity=1.4869e-2,time=2.91e-4}"
# Left out of a window at I = 4e-6, where τ settles after the velocity has fallen.
SETTLING = 300
# Changes of τ that are slips here; smaller ones ring (docs/validation/lee-hurley.md).
SLIP = 1e-3
# D²min over the square of the mean radius of an active grain, in frames 3e-5 apart: the greatest
# hundredth has as much in a packing of Lee & Hurley's.
ACTIVE = 1e-6


class Kind(NamedTuple):
    """Disks of a resistance to rolling and a ratio of the greatest radius to the least."""

    rolling: float
    ratio: float

    def keys(self) -> list[str]:
        """Its keys."""
        least = 2.0 * MEAN_RADIUS / (1.0 + self.ratio)
        rolling = [f"contact.rolling_friction={self.rolling}"]
        if self.rolling == 0.0:
            rolling = ["contact.rolling_friction=none", "contact.rolling_damping_ratio=none"]
        return [
            f"contact.friction={FRICTION}",
            *rolling,
            f"sample.radius_min={least}",
            f"sample.radius_max={least * self.ratio}",
        ]


# Lee & Hurley's own first.
KINDS = (
    Kind(0.01, 2.0),
    Kind(0.0, 2.0),
    Kind(0.03, 2.0),
    Kind(0.1, 2.0),
    Kind(0.3, 2.0),
    Kind(0.01, 1.2),
    Kind(0.01, 4.0),
)


def reduce(*words: object) -> None:
    """Runs gshear-reduce."""
    subprocess.run([REDUCE, *map(str, words)], check=True, stdout=subprocess.DEVNULL)


def correlation(run: Run, least: float) -> tuple[float, int]:
    """Spearman's ρ of |Δτ_p| with the greatest mean of the top tenth of D²min, and its slips."""
    slips = run.measures()
    slips = slips[(slips["delta_tau_p"] < -least) & slips["top_max"].notna()]
    rho = slips["top_max"].corr(-slips["delta_tau_p"], method="spearman")
    return float(rho), len(slips)


def of_window(folder: Path) -> dict[str, float | str]:
    """Phases of a window at I = 4e-6, and its correlation."""
    with Run(folder, quiet=True) as run:
        begin = float(run.series["strain"].iloc[SETTLING])
        reduce("phases", folder, f"--from={begin!r}")
        phases = len(run.phases())
        reduce("correlate", folder, f"--from={begin!r}")
        rho, slips = correlation(run, 1e-4)
        rows = run.series.iloc[SETTLING:]
        return {
            "slow_stress_ratio": rows["stress_ratio"].mean(),
            "slow_deviation": rows["stress_ratio"].std(),
            "slow_phases_per_interval": phases / (len(rows) - 1),
            "slow_slips": slips,
            "slow_rho": rho,
            "slow_digest": str(run.parameters["digest"]),
        }


def of_strain(folder: Path) -> dict[str, float | str]:
    """Slips, correlation and events of 10 % at I = 2e-4."""
    with Run(folder, quiet=True) as run:
        strain = run.series["strain"].to_numpy()
        first = float(strain[0])
        passed = 100.0 * (strain[-1] - first)
        rows = run.series
        drops = -run.phases()["delta_tau_p"]
        drops = drops[drops > SLIP].sort_values(ascending=False)
        reduce("correlate", folder)
        rho, slips = correlation(run, SLIP)
        # By Lee & Hurley's rule grains with two contacts are rattlers; with friction and rolling
        # resistance they bear a load.
        reduce("events", folder, "--threshold", ACTIVE)
        of_three_contacts = len(run.events())
        reduce("events", folder, "--threshold", ACTIVE, "--rattlers", "balance")
        events = run.events()
        return {
            "stress_ratio": rows["stress_ratio"].mean(),
            "deviation": rows["stress_ratio"].std(),
            "solid_fraction": rows["solid_fraction"].mean(),
            "coordination": rows["coordination"].mean(),
            "sliding_fraction": rows["sliding_fraction"].mean(),
            "slips_per_percent": len(drops) / passed,
            "fall_per_percent": drops.sum() / passed,
            "greatest_slip": drops.iloc[0],
            "mean_of_ten_greatest": drops.iloc[:10].mean(),
            "rho": rho,
            "slips": slips,
            "events_per_percent": len(events) / passed,
            "events_per_percent_lee_hurley": of_three_contacts / passed,
            "grains_of_an_event": events["grains"].mean(),
            "grains_of_great_events": float(events["grains"].quantile(0.99)),
            "strain_of_events_per_percent": events["strain_sum"].sum() / passed,
            "digest": str(run.parameters["digest"]),
        }


def row(out: Path, kind: Kind, seed: int) -> dict[str, object]:
    """Makes and reduces a packing of a kind; its frames are not kept."""
    name = f"rolling-{kind.rolling:g}-ratio-{kind.ratio:g}/seed-{seed}"
    start, slow, fast = (out / part / name for part in ("start", "slow", "fast"))
    keys = ("sweep=none", f"seed={seed}", f"shear.protocol=[{UP_TO_REGIME}]", *kind.keys())
    changes = [word for key in keys for word in ("--set", key)]
    program(start, str(SCENE), "--out", str(start), *changes)
    for folder, part in ((slow, SLOW), (fast, FAST)):
        branch_from(start / "checkpoint.h5", folder, [UP_TO_REGIME, part])
    found = {**kind._asdict(), "seed": seed, **of_strain(fast), **of_window(slow)}
    for folder in (start, slow, fast):
        shutil.rmtree(folder)
    return found


def table(out: Path) -> None:
    """Means over packings with their standard errors, and the figure."""
    runs = pd.read_csv(out / "disk-shapes-runs.csv")
    groups = runs.drop(columns=["seed", "digest", "slow_digest"]).groupby(["rolling", "ratio"])
    means, errors = groups.mean(), groups.sem()
    found = means.join(errors.add_suffix("_error"))
    found.insert(0, "packings", groups.size())
    found.reset_index().to_csv(out / "disk-shapes.csv", index=False, float_format="%.4g")
    print(found.T.to_string())
    draw(runs, out / "disk-shapes.svg")
    joined = runpy.run_path(str(Path(__file__).parents[1] / "tables.py"))["joined"]
    digests = [*runs["digest"], *runs["slow_digest"]]
    print(f"{len(digests)} runs, digest {joined(digests)}")


# In the figure, with the names of the axes.
DRAWN = {
    "stress_ratio": "τ",
    "slips_per_percent": "slips beyond 1e-3\nper percent of γ",
    "mean_of_ten_greatest": "mean |Δτ_p| of\nthe ten greatest",
    "slow_phases_per_interval": "phases per interval\nat I = 4e-6",
    "events_per_percent": "events of D²min\nper percent of γ",
    "rho": "ρ of |Δτ_p| with\nmg_t10%D²min",
}


def draw(runs: pd.DataFrame, path: Path) -> None:
    """Draws means over packings with their standard errors, over rolling and over the ratio."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    mpl.rcParams["svg.fonttype"] = "none"
    mpl.rcParams["svg.hashsalt"] = "disk shapes"
    figure = plt.figure(figsize=(14.0, 4.6), layout="constrained")
    grid = figure.subplots(2, len(DRAWN), sharey="col")
    chosen = ((runs["ratio"] == KINDS[0].ratio, "rolling"), (runs["rolling"] == 0.01, "ratio"))
    for line, (own, over) in zip(grid, chosen, strict=True):
        for panel, (quantity, label) in zip(line, DRAWN.items(), strict=True):
            groups = runs[own].groupby(over)[quantity]
            means = groups.mean()
            places = range(len(means))
            panel.errorbar(places, means, groups.sem(), fmt="o-", capsize=2, color="#30527a")
            panel.set_xticks(places, [f"{x:g}" for x in means.index], fontsize="small")
            panel.set_xlabel("μ_r" if over == "rolling" else "R_max/R_min")
            panel.set_ylabel(label)
            if quantity == "events_per_percent":
                panel.set_yscale("log")
                panel.set_yticks([30, 100, 300], ["30", "100", "300"])
                panel.yaxis.set_minor_formatter("")
    figure.savefig(path, metadata={"Date": None})


def main(out: Path, what: str) -> None:
    """Makes the runs, their rows and the tables."""
    path = out / "disk-shapes-runs.csv"
    if what != "table":
        out.mkdir(parents=True, exist_ok=True)
        done = pd.read_csv(path).to_dict("records") if path.exists() else []
        for seed in SEEDS:
            for kind in KINDS:
                key = (*kind, seed)
                if any((line["rolling"], line["ratio"], line["seed"]) == key for line in done):
                    continue
                done.append(row(out, kind, seed))
                pd.DataFrame(done).to_csv(path, index=False)
    table(out)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "run")
