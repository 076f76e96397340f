#!/usr/bin/env python3
"""Do ageing contacts heal a gouge, and what does agitation do to it? Holds and reslides.

    contact_ageing.py OUT [run|table]

A layer of configs/gouge-holds-cheap.toml slides at 0.1 m/s, is held for 0.1 to 100 ms and slides
again, with seven kinds of contacts and agitation. All holds of a kind begin in one state, so that
peaks after them differ by the hold alone. Writes OUT/contact-ageing-runs.csv,
OUT/contact-ageing.csv and the figure OUT/contact-ageing.svg of docs/validation/gouge.md. Runs that
are there already are not made again; 80 minutes of a core. GSHEAR_MPI names the program.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from gouge_creep import FAST, SCENE, THICK, agitated, branch_from, columns, program

from gshear import Run

SEEDS = (1, 2, 3)
VELOCITY = 0.1
SLIDE = 1.5e-3
HOLDS = (1e-4, 1e-3, 1e-2, 1e-1)
RESLIDE = 0.3e-3
# Slip after a hold (m) in which the peak is sought, and windows of means.
PEAK = 0.1e-3
WINDOWS = ((0.0, 0.02e-3), (0.02e-3, 0.1e-3), (0.1e-3, 0.3e-3))
# 2 µm at 20 kHz: creep has the paper's a.
AMPLITUDE = 2e-6
# θ_0: a contact slips 1 µm in it while the layer slides.
BETA, TIME = 0.1, 1e-5


class Kind(NamedTuple):
    """Contacts and agitation of a layer."""

    name: str
    # β, and the slip that renews a contact (m).
    growth: float
    slip: float | None
    amplitude: float

    def keys(self) -> list[str]:
        """Its keys."""
        if self.growth == 0.0:
            return []
        slip = [] if self.slip is None else [f"contact.ageing_slip={self.slip}"]
        return [f"contact.ageing={self.growth}", f"contact.ageing_time={TIME}", *slip]


KINDS = (
    Kind("no ageing", 0.0, None, 0.0),
    Kind("D = 1 µm", BETA, 1e-6, 0.0),
    Kind("D = 10 µm", BETA, 1e-5, 0.0),
    Kind("D = 100 µm", BETA, 1e-4, 0.0),
    Kind("never renewed", BETA, None, 0.0),
    Kind("no ageing, agitated", 0.0, None, AMPLITUDE),
    Kind("D = 10 µm, agitated", BETA, 1e-5, AMPLITUDE),
)


def row(out: Path, kind: Kind, seed: int, hold: float) -> dict[str, object]:
    """The reslide after one hold, made if it is not there."""
    of = agitated(kind.amplitude)
    parts = [FAST, f"{{velocity={VELOCITY},distance={SLIDE}{of}}}"]
    packed = out / f"packed/seed-{seed}"
    keys = ("sweep=none", f"seed={seed}", f"shear.protocol=[{FAST}]", *THICK)
    changes = [word for key in keys for word in ("--set", key)]
    program(packed, str(SCENE), "--out", str(packed), *changes)
    folder = out / f"{KINDS.index(kind)}" / packed.name
    branch_from(packed / "checkpoint.h5", folder, parts, *kind.keys())
    held = out / f"{KINDS.index(kind)}-{hold:g}" / packed.name
    reslide = f"{{velocity={VELOCITY},distance={RESLIDE}{of}}}"
    parts += [f"{{velocity=0.0,time={hold}{of}}}", reslide]
    branch_from(folder / "checkpoint.h5", held, parts, "output.series_rows=3000")
    velocity, mu, slip, sliding = columns(
        held, "drive_velocity", "stress_ratio", "slip", "sliding_fraction"
    )
    edge = np.flatnonzero(np.diff(velocity))[-1]
    again = slice(edge + 1, None)
    slip = slip[again] - slip[edge]
    with Run(held, quiet=True) as run:
        digest = run.parameters["digest"]
    before, slipped = columns(folder, "stress_ratio", "slip")
    return {
        "kind": kind.name,
        "seed": seed,
        "hold": hold,
        "steady": before[slipped > slipped[-1] - 0.5e-3].mean(),
        "relaxed": mu[edge],
        "peak": mu[again][slip <= PEAK].max(),
        **{
            f"mean_{1e6 * a:.0f}_{1e6 * b:.0f}_um": mu[again][(slip > a) & (slip <= b)].mean()
            for a, b in WINDOWS
        },
        "sliding_fraction": sliding[again].mean(),
        "digest": digest,
    }


def slopes(rows: pd.DataFrame, column: str, holds: tuple[float, ...]) -> list[float]:
    """Of each seed the slope over ln t_hold."""
    chosen = rows[rows["hold"].isin(holds)]
    return [np.polyfit(np.log(of["hold"]), of[column], 1)[0] for _, of in chosen.groupby("seed")]


def table(out: Path) -> None:
    """Slopes over ln t_hold from 1 to 100 ms of each kind, their errors, and the figure."""
    rows = pd.read_csv(out / "contact-ageing-runs.csv")
    quantities = ["peak", *(c for c in rows if c.startswith("mean_")), "relaxed"]
    lines = []
    for kind in KINDS:
        own = rows[rows["kind"] == kind.name]
        line: dict[str, object] = {"kind": kind.name, "seeds": own["seed"].nunique()}
        steady = own.groupby("seed")["steady"].first()
        line["steady"] = round(steady.mean(), 4)
        line["steady_error"] = round(steady.sem(), 4)
        for name in quantities:
            found = slopes(own, name, HOLDS[1:])
            line[f"{name}_per_factor_e"] = round(float(np.mean(found)), 5)
            error = np.std(found, ddof=1) / np.sqrt(len(found))
            line[f"{name}_error"] = round(float(error), 5)
        lines.append(line)
    pd.DataFrame(lines).to_csv(out / "contact-ageing.csv", index=False)
    print(pd.DataFrame(lines).T.to_string())
    draw(rows, out / "contact-ageing.svg")


def draw(rows: pd.DataFrame, path: Path) -> None:
    """Peaks after holds, less that after 1 ms, when grains rest, over the time of the hold."""
    import matplotlib.pyplot as plt

    still, shaken = plt.figure(figsize=(7.0, 3.4), layout="constrained").subplots(1, 2, sharey=True)
    for kind in KINDS:
        own = rows[rows["kind"] == kind.name].pivot_table("peak", "hold", "seed")
        change = own - own.loc[HOLDS[1]]
        axes = shaken if kind.amplitude else still
        errors = change.sem(axis=1)
        axes.errorbar(
            change.index * 1e3, change.mean(axis=1), errors, fmt="o-", capsize=2, label=kind.name
        )
    for axes, title in ((still, "at rest"), (shaken, "agitated by 2 µm at 20 kHz")):
        axes.set(xscale="log", xlabel="hold (ms)", title=title)
        axes.axhline(0.0, color="grey", linewidth=0.5)
        axes.legend(fontsize="small")
    still.set_ylabel("peak less that after 1 ms")
    still.figure.savefig(path, metadata={"Date": None})


def main(out: Path, what: str) -> None:
    """Makes the runs, their rows and the tables."""
    if what != "table":
        found = []
        for seed in SEEDS:
            for kind in KINDS:
                found += [row(out, kind, seed, hold) for hold in HOLDS]
                pd.DataFrame(found).to_csv(out / "contact-ageing-runs.csv", index=False)
    table(out)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "run")
