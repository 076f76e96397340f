"""The study of Lee & Hurley (LH), repeated on runs of disks between walls.

*Microscopic dynamics of particle rearrangement and its correlation with stick-slip behavior in
granular shear.* Figures 2 to 25 of the paper are drawn from the runs (figure 1 is a drawing of the
set-up), and the paper's numbers stand next to theirs. gshear-reduce finds phases, correlations and
the stages of the largest drop (`docs/explanation/reduction.md`).
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure as Drawing
from numpy.typing import ArrayLike, NDArray

from .. import programs
from ..analysis import time_mean
from ..errors import RunError
from ..run import Run
from ..tables import read_csv
from . import _output
from ._output import CURVES, GREY, INK, PALE, Drawn, drawing, reduce, scientific

Array: TypeAlias = NDArray[np.float64]
Line: TypeAlias = "tuple[str, str, str]"  # what, the paper's value, the run's value
Of: TypeAlias = "tuple[str, str]"  # a quantity, and intervals or phases

# About 1,000 disks in sections 3 and 4 and about 5,000 in section 5; runs of up to their geometric
# mean are compared with the small sample.
BETWEEN = 2236
SAMPLES = {"small": "about 1,000", "large": "about 5,000"}
# γ at which the stick-slip regime (section 3.2) or the steady state (section 5) begins.
ONSET = {"small": 0.022, "large": 0.054}
FRAME_STRAIN = {"small": "7.2e-7", "large": "1.8e-6"}
# Number of phases by μ_s, each in about 130,000 intervals (sections 4 and 5, appendix C).
PHASES = {
    "small": {0.1: 18e3, 0.3: 46e3, 0.5: 52e3, 0.7: 42e3},
    "large": {0.1: 12e3, 0.3: 31e3, 0.5: 31e3, 0.7: 26e3},
}
INTERVALS = 130e3
DROP = {"small": "10.0555 % to 10.0575 %", "large": "9.380 % to 9.384 %"}
MAIN_FRICTION = 0.7  # of the figures of one run; section 4 has the others
SIGNIFICANT, LEAST_PAIRS = 0.05, 5  # greatest p (section 3.3); no order of four is rarer than 8 %
MODERATE, STRONG = 0.4, 0.6  # own thresholds: the paper has the words without numbers
ANY = np.inf

SYMBOLS = {
    "dmin_greatest": r"$gD^2_\mathrm{min}$",
    "dmin_top_tenth": r"$g_{t10\%}D^2_\mathrm{min}$",
    "dmin_max": r"$mgD^2_\mathrm{min}$",
    "top_max": r"$mg_{t10\%}D^2_\mathrm{min}$",
    "dmin_sum": r"$sgD^2_\mathrm{min}$",
    "top_sum": r"$sg_{t10\%}D^2_\mathrm{min}$",
    "t_p": r"$t_p$",
    "regions_least": r"$N_c$",
    "angle_mean": r"mean |θ|",
    "angle_median": r"median |θ|",
}
# Panels (a) to (j) of figures 13, 22 and 25: quantity, and intervals or phases.
PANELS = [("dmin_top_tenth", "intervals")]
PANELS += [("top_max", over) for over in ("all", "long", "short")] + [("dmin_max", "long")]
PANELS += [("top_sum", over) for over in ("all", "long", "short")] + [("dmin_sum", "long")]
PANELS += [("t_p", "long")]
FOUR = ("dmin_max", "top_max", "dmin_sum", "top_sum")
NINE = {
    r"$\Delta\tau$, all intervals": [(of, "intervals") for of in list(SYMBOLS)[:2]],
    r"$\Delta\tau_p$, all phases": [(of, "all") for of in FOUR],
}
TEN = {
    r"$\Delta\tau_p$, long phases ($t_p > 3\Delta\gamma$)": [(of, "long") for of in FOUR],
    r"$\Delta\tau_p$, short phases": [(of, "short") for of in FOUR],
    r"$\Delta\tau_p$, long and short phases": [("t_p", "long"), ("t_p", "short")],
}
SPEARMAN = "Absolute values of Spearman's coefficient"
OMITTED = "Points with p > 0.05 are left out, but kept in the table."
REDUCTIONS = {"net": "", "losses": "loss_", "greatest-loss": "greatest_loss_"}
OVER_SQUARE = r"$D^2_\mathrm{min}/\bar{r}^2$"
STAGES = {"I": "#d6eaf5", "II": "#faddc9", "III": "#dceee4"}
CHANGE = LinearSegmentedColormap.from_list("change", ["#d55e00", "#e4e7ea", "#0072b2"])


class Studied:
    """A run with the tables of gshear-reduce.

    Attributes:
        label: Name in figures and tables.
        size: Sample of the paper that it is compared with: small or large.
        friction: μ_s; None if the scene has none.
        family: Equal for runs that differ in their seeds and outputs only.
        radius: Mean radius r̄ (m).
        length: Period along x (m).
        series: γ and τ of the whole run.
        onset: γ at which the regime begins.
        regime: `regions.csv` from there on: τ, and scalars of the interval that ends in each row.
        tau: Mean of τ over the regime, ⟨S⟩/⟨N⟩, with its error and deviation.
        phases: `measures.csv`.
        correlations: `correlations.csv`.
        stages: `stages.csv`, rows of the regime by `start` and `end`; empty without a slip.
        steps: `stages-steps.csv`; empty without frames around the drop, as the next two.
        disks: `stages-grains.csv`.
        contacts: `stages-contacts.csv`.

    Raises:
        GshearError: The run has no two frames, or gshear-reduce failed.
    """

    def __init__(self, run: Run, label: str, folder: Path, options: argparse.Namespace) -> None:
        """Reduces the run into `folder` and reads the tables."""
        self.label, self.path, self.options = label, run.path, options
        self.size, self.friction = _size(run), _friction(run)
        self.seed, self.parameters = run.scene.get("seed"), run.parameters
        if "protocol" in run.scene.get("shear", {}):
            self.parameters.pop("inertial_number", None)  # every part has another one
        radius = run.hdf5["particles/trajectory/radius"][:]
        self.grains, self.radius = len(radius), float(radius.mean())
        self.length = float(self.parameters["edges"][0])
        series = run.series
        self.series = series[["strain", "stress_ratio"]]
        info = programs.run([programs.find("gshear-reduce"), "info", run.path], quiet=True)
        self.family = re.findall(r"^family +(\S+)", info, re.MULTILINE)[0]

        reduce("regions", run.path, folder)
        regime = read_csv(folder / "regions.csv")
        if len(regime) < 2:
            raise RunError(f"{run.path}: has {len(regime)} frames: the study needs two or more")
        wanted = ONSET[self.size] if options.onset is None else options.onset
        first, last = regime["strain"].iloc[[0, -1]]
        self.onset = float(max(wanted, first) if last > wanted else first)
        self.regime = regime[regime["strain"] >= self.onset].reset_index(drop=True)
        during = series["step"].between(*self.regime["step"].iloc[[0, -1]])
        rows = series[during]
        self.tau = time_mean(rows["shear_force"], rows["normal_force"])
        choices = ["--from", repr(self.onset), "--reduction", options.reduction]
        more = ["--min-points", str(options.min_points), "--bins", options.bins]
        reduce("correlate", run.path, folder, *choices, *more)
        self.phases = read_csv(folder / "measures.csv")
        self.correlations = read_csv(folder / "correlations.csv")
        paths = [folder / f"stages{end}.csv" for end in ("", "-steps", "-grains", "-contacts")]
        for path in paths:
            path.unlink(missing_ok=True)
        if (self.phases["kind"] == "slip").any():
            threads = ["--threads", str(options.threads)] if options.threads else []
            reduce("stages", run.path, folder, *choices, *threads)
        tables = [read_csv(path) if path.exists() else pd.DataFrame() for path in paths]
        self.stages, self.steps, self.disks, self.contacts = tables
        for table in (self.stages, self.steps):
            for name in ("start", "end") if len(table) else ():
                table[name] = np.searchsorted(self.regime["step"], table[f"{name}_step"])

    def slips(self) -> pd.DataFrame:
        """Returns the slip phases, the greatest loss of τ first."""
        slips = self.phases[self.phases["kind"] == "slip"]
        return slips.sort_values("delta_tau_p", kind="stable")

    def stage(self, name: str) -> slice:
        """Returns the rows whose intervals, from the row before, belong to a stage."""
        begin, end = self.stages.loc[self.stages["stage"] == name, ["start", "end"]].to_numpy()[0]
        return slice(begin + 1, end + 1)

    def coefficients(self, quantity: str, over: str) -> pd.DataFrame:
        """Returns ρ with Δτ (over intervals) or Δτ_p (over phases) in ranges of it."""
        table = self.correlations
        is_of = (table["with"] == quantity) & (table["over"] == over)
        return table[is_of & table["range_of"].str.startswith("delta_tau")]

    def coefficients_by(self, measure: str, quantity: str) -> pd.DataFrame:
        """Returns ρ of Δτ_p of long phases in ranges of a measure over r̄²."""
        table = self.correlations
        range_of = f"{measure}_over_mean_radius_squared"
        return table[(table["with"] == quantity) & (table["range_of"] == range_of)]


def study(options: argparse.Namespace) -> Path:
    """Writes the study and returns the path of its page.

    Raises:
        GshearError: A run cannot be studied, or gshear-reduce failed.
    """
    # All are opened first, so that a wrong name is reported at once.
    runs = [Run(path, quiet=True) for path in options.runs]
    for of in runs:
        if of.dimension != 2 or "stress_ratio" not in of.series:
            raise RunError(f"{of.path}: must be a run of disks between walls")
    out = _output.folder_of(options.out, runs[0].folder, "lee-hurley")
    studied = [
        Studied(run, label, out / f"run-{k}", options)
        for k, (run, label) in enumerate(zip(runs, _labels(runs), strict=True), start=1)
    ]
    families = _families(studied)
    body = _output.save_numbered(out, _figures([of[0] for of in families]))
    numbers = pd.DataFrame(
        [(run.label, *line) for run in studied for line in _numbers(run)],
        columns=["run", "what", "paper", "ours"],
    )
    _output.write_table(out / "numbers.csv", numbers, quoted=True)
    _output.write_table(out / "drops.csv", pd.concat([_drops(run) for run in studied]))
    seeds = [of for of in families if len(of) > 1]
    if seeds:
        body += _write_ensemble(seeds, out)
    body += "<h2>Numbers of the paper and of these runs</h2>\n"
    body += "<p>Coefficients below 0.4 are called weak, from 0.6 on strong.</p>\n"
    for run in studied:
        lines = numbers[numbers["run"] == run.label]
        body += f"<h3>{run.label}</h3>\n<p>{run.path}, the {run.size} sample.</p>\n"
        body += _output.html_table(
            ["", "paper", "this run"], lines[["what", "paper", "ours"]].to_numpy()
        )
    return _output.page(
        out / "index.html",
        "The study of Lee and Hurley",
        "Figures and numbers of the paper for these runs. Each figure links to its data.",
        body,
    )


# Runs and their tables


def _size(run: Run) -> str:
    return "large" if len(run.hdf5["particles/trajectory/radius"]) > BETWEEN else "small"


def _friction(run: Run) -> float | None:
    friction = run.scene.get("contact", {}).get("friction")
    return float(friction) if isinstance(friction, float) else None


def _labels(runs: Sequence[Run]) -> list[str]:
    """Returns friction and, if there are both, size of the runs, numbered where these are equal."""
    sizes = [_size(run) for run in runs]
    frictions = [_friction(run) for run in runs]
    labels = [f"μ_s {'unknown' if mu is None else f'= {mu:g}'}" for mu in frictions]
    if len(set(sizes)) > 1:
        labels = [f"{label} {size}" for label, size in zip(labels, sizes, strict=True)]
    return [
        f"{label} ({labels[: k + 1].count(label)})" if labels.count(label) > 1 else label
        for k, label in enumerate(labels)
    ]


def _families(runs: Sequence[Studied]) -> list[list[Studied]]:
    """Groups runs that differ in their seeds only; a seed given twice counts once."""
    families: dict[str, dict[int | None, Studied]] = {}
    for run in runs:
        families.setdefault(run.family, {}).setdefault(run.seed, run)
    return [list(family.values()) for family in families.values()]


def _significant(table: pd.DataFrame) -> pd.Series[bool]:
    return (table["pairs"] >= LEAST_PAIRS) & (table["p"] <= SIGNIFICANT)


# Numbers


def _numbers(run: Studied) -> list[Line]:
    """Returns what, the paper's value and the run's value."""
    drop = _numbers_of_drop(run) if len(run.stages) else []
    return [*_basics(run), *drop, *_statements(run)]


def _basics(run: Studied) -> list[Line]:
    strain = run.regime["strain"]
    intervals, phases = len(strain) - 1, len(run.phases)
    step = (strain.iloc[-1] - strain.iloc[0]) / max(intervals, 1)
    counted = PHASES[run.size].get(run.friction or 0.0)
    known = {n: scientific(x, 3) for n, x in run.parameters.items() if isinstance(x, float)}
    number, share = "not given", "not given"
    if counted is not None:
        number, share = f"about {counted:.0f}", f"about {counted / INTERVALS:.2f}"
    similar = "similar for all μ_s; small and large similar, deviation smaller in the large"
    long = (run.phases["length"] == "long").sum()
    onset = f"{100 * ONSET[run.size]:.1f} %"
    return [
        ("disks", SAMPLES[run.size], str(run.grains)),
        ("inertial number I", "4e-6", known.get("inertial_number", "unknown")),
        ("stiffness number κ", "1e4", known.get("stiffness_number", "unknown")),
        ("Δγ between frames", FRAME_STRAIN[run.size], scientific(step, 3)),
        ("regime begins at γ", onset, f"{100 * run.onset:.3f} %"),
        ("intervals in the regime", f"about {INTERVALS:,.0f}", str(intervals)),
        ("phases in the regime", number, str(phases)),
        ("phases per interval", share, f"{phases / max(intervals, 1):.3f}"),
        ("long phases (t_p > 3Δγ)", "not given", str(long)),
        (
            "τ in the regime, mean and deviation",
            similar,
            f"{run.tau.mean:.3f}, {run.tau.deviation:.3f}",
        ),
    ]


def _numbers_of_drop(run: Studied) -> list[Line]:
    before, during = run.stage("I"), run.stage("II")

    def greatest(name: str, rows: slice, least: float) -> float:
        return float(np.fmax.reduce(run.regime[name].to_numpy()[rows], initial=least))

    strain = run.regime["strain"].to_numpy()
    begin, end = strain[before.start - 1], strain[run.stage("III").stop - 1]
    slips: list[Any] = run.slips()[:4].to_dict("records")
    largest = slips[0]
    of_slip = " to ".join(f"{100 * largest[of]:.4f} %" for of in ("start_strain", "end_strain"))
    following = [
        f"Δτ_p = {slip['delta_tau_p']:.4f} at {100 * slip['start_strain']:.4f} %"
        for slip in slips[1:]
    ]
    rho = [greatest("stress_dmin_rho", rows, -np.inf) for rows in (before, during)]
    dmin = [
        scientific(greatest(name, during, np.nan) / run.radius**2, 2)
        for name in ("dmin_greatest", "dmin_top_tenth")
    ]
    lag = drop_lag(run.regime["stress_ratio"], run.regime["dmin_top_tenth"], before, during)
    paper = DROP[run.size] if run.friction == MAIN_FRICTION else "not given"
    great = "2" if run.size == "large" else "1"
    similar = "almost the same in the small and the large sample"
    lines = [
        ("largest drop, with its stages", paper, f"{100 * begin:.4f} % to {100 * end:.4f} %"),
        ("largest slip", "not given", f"Δτ_p = {largest['delta_tau_p']:.4f} from {of_slip}"),
        ("next largest slips", "not given", "; ".join(following) or "none"),
        ("great slips in Stage II", great, str((run.stages["stage"] == "slip").sum())),
        (
            "ρ of |Δσ_p| with D²min, greatest in Stage I, II",
            "low, high at the beginning",
            f"{rho[0]:.2f}, {rho[1]:.2f}",
        ),
        ("gD²min/r̄² and g_t10%D²min/r̄², greatest in Stage II", similar, ", ".join(dmin)),
        (
            "intervals by which Δτ lags behind g_t10%D²min",
            "it lags",
            "no rise" if lag is None else str(lag),
        ),
    ]
    words = {"net": "net change", "losses": "losses alone", "greatest-loss": "greatest loss"}
    for reduction, name in words.items():
        mean, least = _drop_regions(run, reduction)
        what = f"GR regions by {name}: mean of Stage I, least of Stage II"
        lines.append((what, "multiple, 1 (small) or few (large)", f"{mean:.1f}, {least:g}"))
    return lines


def _drop_regions(run: Studied, reduction: str) -> tuple[float, float]:
    """Returns the mean number of GR regions in Stage I and the least in Stage II; NaN without."""
    if not len(run.stages):
        return np.nan, np.nan
    of_two = "_of_two" if run.options.min_points == 2 else ""
    count = run.regime[f"{REDUCTIONS[reduction]}regions{of_two}"].to_numpy()
    before = count[run.stage("I")]
    least = np.fmin.reduce(count[run.stage("II")], initial=np.inf)
    return float(before.sum() / max(len(before), 1)), float(least)


def drop_lag(tau: ArrayLike, top: ArrayLike, before: slice, during: slice) -> int | None:
    """Returns by how many intervals the fastest decrease of τ follows the rise of `top`.

    The rise is the first interval with ten times the `top` of the first one; None if there is none.

    Args:
        tau: [L], τ.
        top: [L], g_t10%D²min of the interval that ends in each row.
        before: Rows of Stage I.
        during: Rows of Stage II, in which the fastest decrease is sought.
    """
    tau, top = np.asarray(tau), np.asarray(top)
    risen = np.flatnonzero(top[before.start : during.stop] > 10.0 * top[before.start])
    if not len(risen):
        return None
    change = np.diff(tau)[during.start - 1 : during.stop - 1]
    return int(during.start + np.argmin(change) - before.start - risen[0])


def _statements(run: Studied) -> list[Line]:
    def of(quantity: str, over: str, sign: float, farther: float, nearer: float) -> str:
        return described(within(run.coefficients(quantity, over), sign, farther, nearer))

    top = {"mg_t10%": "top_max", "sg_t10%": "top_sum"}
    rather = [
        (f"{symbol}: {words}", (name, stronger), weaker or (name, other), nearer)
        for words, stronger, other, weaker, nearer in (
            ("all phases rather than intervals", "all", "", ("dmin_top_tenth", "intervals"), 1e-3),
            ("long rather than all phases", "long", "all", None, 1e-4),
            ("long rather than short phases", "long", "short", None, 1e-4),
        )
        for symbol, name in top.items()
    ]
    rather += [
        (f"long phases: {words}", (stronger, "long"), (weaker, "long"), 1e-5)
        for words, stronger, weaker in (
            ("mg_t10% rather than mg", "top_max", "dmin_max"),
            ("sg_t10% rather than sg", "top_sum", "dmin_sum"),
            ("sg_t10% rather than mg_t10%", "top_sum", "top_max"),
        )
    ]
    lines = [_compared(run, *comparison) for comparison in rather]
    for symbol, name in (("gD²min", "dmin_greatest"), ("g_t10%D²min", "dmin_top_tenth")):
        for paper, where, sign, farther, nearer in (
            ("weak", "slip, Δτ < -1e-2", -1, ANY, 1e-2),
            ("moderate", "slip, -1e-2 < Δτ < -1e-3", -1, 1e-2, 1e-3),
            ("moderate", "stick, 1e-3 < Δτ < 1e-2", 1, 1e-2, 1e-3),
        ):
            found = of(name, "intervals", sign, farther, nearer)
            lines.append((f"intervals, {symbol}, {where}", paper, found))
    for name in ("dmin_max", "dmin_sum", "top_max", "top_sum"):
        what = f"all phases, {name}, slip, Δτ_p < -1e-3"
        lines.append((what, "moderate to strong", of(name, "all", -1, ANY, 1e-3)))
    for name in ("top_max", "top_sum"):
        for paper, where, farther, nearer in (
            ("strong", "Δτ_p < -1e-2", ANY, 1e-2),
            ("mostly moderate", "-1e-2 < Δτ_p < 0", 1e-2, 1e-5),
        ):
            found = of(name, "long", -1, farther, nearer)
            lines.append((f"long phases, {name}, {where}", paper, found))
        what = f"short phases, {name}, slip and stick"
        lines.append((what, "not strong", of(name, "short", 0, ANY, 0.0)))
    low = run.friction is not None and run.friction < 0.4
    of_stick = "weak or insignificant" if low else "moderate"
    for what, paper, over, sign, nearer in (
        ("long stick phases, t_p, Δτ_p > 1e-3", of_stick, "long", 1, 1e-3),
        ("long stick phases, t_p, Δτ_p > 1e-4", of_stick, "long", 1, 1e-4),
        ("long slip phases, t_p", "weak", "long", -1, 1e-5),
        ("short slip phases, t_p", "weak", "short", -1, 1e-5),
        ("short stick phases, t_p", "weak", "short", 1, 1e-5),
    ):
        lines.append((what, paper, of("t_p", over, sign, ANY, nearer)))
    for name in ("angle_mean", "angle_median", "regions_least"):
        both = pd.concat([run.coefficients_by(by, name) for by in ("top_max", "top_sum")])
        what = f"long phases, {name}, ranges of mg_t10% and sg_t10%"
        lines.append((what, "weak or insignificant", described(both)))
    return lines


def within(table: pd.DataFrame, sign: float, farther: float, nearer: float) -> pd.DataFrame:
    """Returns the ranges of one sign (0: of both) that lie between these |Δτ|."""
    inside = (table["to"].abs() <= farther * 1.001) & (table["from"].abs() >= nearer * 0.999)
    return table[inside & ((table["to"] * sign > 0) | (sign == 0))]


def described(table: pd.DataFrame) -> str:
    """Returns |ρ| of every significant range, a word for it, the nearer end and the pairs."""
    words = []
    for row in table[_significant(table)].to_dict("records"):
        rho = abs(row["rho"])
        word = "weak" if rho < MODERATE else "moderate" if rho < STRONG else "strong"
        words.append(f"{rho:.2f} {word} (from {scientific(row['from'], 1)}, {row['pairs']})")
    return "; ".join(words) or "no significant range"


def _compared(run: Studied, what: str, stronger: Of, weaker: Of, nearer: float) -> Line:
    """Counts the ranges of slip in which one correlation is stronger than another."""
    a, b = (within(run.coefficients(*of), -1, ANY, nearer) for of in (stronger, weaker))
    both = _significant(a).to_numpy() & _significant(b).to_numpy()
    holds = np.abs(a["rho"].to_numpy()) > np.abs(b["rho"].to_numpy())
    ours = f"stronger in {(holds & both).sum()} of {both.sum()} {run.options.bins}"
    ours = ours if both.any() else "no range in which both are significant"
    return f"slip, {what} (Δτ < -{scientific(nearer, 0)})", "stronger", ours


def _drops(run: Studied) -> pd.DataFrame:
    """Returns the 20 largest slip phases."""
    slips = run.slips()[:20]
    names = ["start_step", "end_step", "start_strain", "end_strain", "t_p", "delta_tau_p"]
    table = slips[names].reset_index(drop=True)
    table.insert(0, "run", run.label)
    table.insert(1, "rank", np.arange(1, len(slips) + 1))
    return table


# Runs that differ in their seeds


def _write_ensemble(families: Sequence[Sequence[Studied]], out: Path) -> str:
    """Writes means and errors over families of runs; returns the figures as HTML."""
    numbers, merged, body = [], [], ""
    for family in families:
        table = pd.DataFrame([_numbers_of_seed(run) for run in family])
        rows = [{"runs_of": _label(family), "what": n} | _output.spread(table[n]) for n in table]
        numbers.append(pd.DataFrame(rows).drop(columns="median"))
        merged.append(seed_correlations([run.correlations for run in family]))
        merged[-1].insert(0, "runs_of", _label(family))
    _output.write_table(out / "ensemble.csv", pd.concat(numbers))
    correlations = pd.concat(merged)
    _output.write_table(out / "ensemble-correlations.csv", correlations)
    for size in SAMPLES:
        labels = [_label(of) for of in families if of[0].size == size]
        if labels:
            tables = [correlations[correlations["runs_of"] == label] for label in labels]
            figure = _ten_panels(labels, [_of_seeds(table) for table in tables])
            caption = (
                "Runs that differ in their seeds only: mean coefficients with standard errors; "
                "points with a median p above 0.05 are left out."
            )
            body += _output.save(out, f"ensemble-{size}", (caption, figure, {}))
    return body


def _label(family: Sequence[Studied]) -> str:
    return family[0].label.removesuffix(" (1)")


def _numbers_of_seed(run: Studied) -> dict[str, float]:
    slips = run.slips()["delta_tau_p"]
    intervals, phases = len(run.regime) - 1, len(run.phases)
    numbers = {
        "intervals": float(intervals),
        "phases": float(phases),
        "phases_per_interval": phases / intervals if intervals else np.nan,
        "long_phases": float((run.phases["length"] == "long").sum()),
        "tau_mean": run.tau.mean,
        "tau_deviation": run.tau.deviation,
        "largest_slip": float(slips.min()),
        "mean_slip": float(slips.mean()),
    }
    for reduction, prefix in REDUCTIONS.items():
        name = prefix or "net_"
        before, least = _drop_regions(run, reduction)
        numbers |= {f"{name}regions_before": before, f"{name}regions_in_drop": least}
    return numbers


def seed_correlations(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Returns mean, standard error and range of ρ over runs, in every range of Δτ and Δτ_p.

    Args:
        tables: `correlations.csv` of each run. A run with fewer than five pairs in a range does not
            count there.
    """
    every = pd.concat(tables)
    every = every[every["range_of"].str.startswith("delta_tau")]
    few = every["pairs"] < LEAST_PAIRS
    every.loc[few, ["rho", "p"]] = np.nan
    every["pairs"] = every["pairs"].mask(few)
    merged = every.groupby(["with", "over", "from", "to"], sort=False).agg(
        runs=("rho", "count"),
        least_pairs=("pairs", "min"),
        rho_mean=("rho", "mean"),
        rho_error=("rho", "sem"),
        rho_least=("rho", "min"),
        rho_greatest=("rho", "max"),
        p_median=("p", "median"),
    )
    merged["least_pairs"] = merged["least_pairs"].fillna(0).astype(int)
    return merged.reset_index()


def _of_seeds(table: pd.DataFrame) -> Callable[[str, str], pd.DataFrame]:
    """Returns a function that gives the mean coefficients of a quantity as those of a run."""
    names = {"rho_mean": "rho", "p_median": "p", "least_pairs": "pairs", "rho_error": "error"}
    renamed = table.rename(columns=names)
    return lambda name, over: renamed[(renamed["with"] == name) & (renamed["over"] == over)]


# Figures


def _figures(runs: Sequence[Studied]) -> dict[int, Drawn | str]:
    """Returns figures 2 to 25 of the first runs of the families."""
    of = {size: [run for run in runs if run.size == size] for size in SAMPLES}

    def nearest(size: str) -> list[Studied]:
        return sorted(
            of[size],
            key=lambda run: abs((np.inf if run.friction is None else run.friction) - MAIN_FRICTION),
        )[:1]

    small, large = nearest("small"), nearest("large")
    drawn: dict[int, tuple[list[str], list[Studied], Callable[..., Drawn | str]]] = {
        2: (["small"], small, _whole_and_drop),
        3: (["small"], small, partial(_maps, "I", "before the drop")),
        4: (["small"], small, partial(_maps, "II", "during the drop")),
        5: (["small"], small, partial(_maps, "III", "after the drop")),
        6: (["small"], small, _network),
        7: (["small"], small, _displacements),
        8: (["small"], small, _scalars),
        9: (["small"], small, partial(_by_stress, f"{SPEARMAN} of Δτ and Δτ_p", NINE)),
        10: (["small"], small, partial(_by_stress, f"{SPEARMAN} of Δτ_p", TEN)),
        11: (["small"], small, partial(_by_measure, ["angle_mean", "angle_median"])),
        12: (["small"], of["small"], _frictions),
        13: (["small"], of["small"], _ten_of_runs),
        14: (["large"], [*small, *large], _whole_and_drop),
        15: (["large"], large, partial(_maps, "I", "before the drop")),
        16: (["large"], large, partial(_maps, "II", "during the drop", part="largest")),
        17: (["large"], large, partial(_maps, "II", "during the further drops", part="further")),
        18: (["large"], large, partial(_maps, "III", "after the drop")),
        19: (["large"], large, _network),
        20: (["large"], large, _displacements),
        21: (["large"], large, _scalars),
        22: (["small", "large"], [*small, *large], _ten_of_runs),
        23: (["large"], large, partial(_by_measure, ["regions_least"])),
        24: (["large"], of["large"], _frictions),
        25: (["large"], of["large"], _ten_of_runs),
    }
    figures: dict[int, Drawn | str] = {}
    for number, (needed, shown, draw) in drawn.items():
        lacking = [size for size in needed if not of[size]]
        why = f"no run of the {lacking[0]} sample" if lacking else ""
        figures[number] = why or draw(*shown)
    return figures


def _typeset(label: str) -> str:
    return label.replace("μ_s", r"$\mu_s$")


def _curves(ax: Axes, runs: Sequence[Studied]) -> None:
    """Draws τ over γ of whole runs; a dashed line is the start of the regime."""
    for colour, run in zip(cycle(CURVES), runs, strict=False):
        strain, tau = run.series["strain"], run.series["stress_ratio"]
        ax.plot(100 * strain, tau, color=colour, lw=0.9, label=_typeset(run.label))
        ax.axvline(100 * run.onset, color=GREY, ls="--", lw=1.0)
    ax.set(xlabel="shear strain γ (%)", ylabel="shear stress ratio τ = S/N")
    ax.grid(color=PALE)
    ax.legend(ncols=4, frameon=False, loc="lower left", bbox_to_anchor=(0, 1))


def _shade(ax: Axes, run: Studied) -> None:
    for name, colour in STAGES.items():
        row = run.stages[run.stages["stage"] == name].iloc[0]
        ax.axvspan(
            100 * row["start_strain"],
            100 * row["end_strain"],
            color=colour,
            lw=0,
            alpha=0.5,
            label=f"Stage {name}",
        )


def _around(run: Studied) -> pd.DataFrame:
    """Returns the rows around the drop with the stage of the interval that each ends."""
    rows = slice(run.stage("I").start - 1, run.stage("III").stop)
    table = run.regime[rows].copy()
    calm, drop = run.stage("II").stop - 1, run.stage("I").stop - 1
    row = table.index
    table["stage"] = np.where(row <= drop, "I", np.where(row <= calm, "II", "III"))
    return table


def _whole_and_drop(*runs: Studied) -> Drawn:
    """Figures 2 and 14: whole curves, and the largest drop of the last run."""
    run, has_drop = runs[-1], len(runs[-1].stages) > 0
    figure = drawing(9, 8 if has_drop else 4)
    axes = figure.subplots(2 if has_drop else 1, squeeze=False)[:, 0]
    _curves(axes[0], runs)
    data = [_whole(runs)]
    if has_drop:
        ax, table = axes[1], _around(run)
        _shade(ax, run)
        marker = "o" if len(table) <= 200 else ""
        strain, tau = 100 * table["strain"], table["stress_ratio"]
        ax.plot(strain, tau, color=INK, lw=1.4, marker=marker, ms=3)
        numbers = dict(zip(run.steps.get("end", []), run.steps.get("step", []), strict=True))
        for row, number in numbers.items():
            at = (strain[row], tau[row])
            ax.annotate(f"{number}", at, (0, 5), textcoords="offset points", ha="center")
        ax.set(xlabel="shear strain γ (%)", ylabel="shear stress ratio τ = S/N", title="(b)")
        ax.margins(y=0.14)
        ax.legend(frameon=False)
        table["step"] = [str(numbers.get(row, "")) for row in table.index]
        table = table[["strain", "stress_ratio", "stage", "step"]]
        data.append(table.assign(panel="b", run=run.label))
    caption = (
        f"(a) Normalised shear stress over shear strain of {_names(runs)}. Dashed: start of the "
        "stick-slip regime. (b) The same around the largest drop of the regime, with the stages "
        "before, during and after it. Numbers: steps shown in the maps."
    )
    return caption, figure, {"": pd.concat(data)}


def _names(runs: Sequence[Studied]) -> str:
    return " and ".join(f"the run {run.label}" for run in runs)


def _whole(runs: Sequence[Studied]) -> pd.DataFrame:
    tables = [run.series.assign(panel="a", run=run.label, stage="", step="") for run in runs]
    return pd.concat(tables)[["panel", "run", "strain", "stress_ratio", "stage", "step"]]


def _frictions(*runs: Studied) -> Drawn:
    """Figures 12 and 24."""
    figure = drawing(9, 4)
    _curves(figure.subplots(), runs)
    caption = "Normalised shear stress over shear strain for each friction coefficient, "
    return f"{caption}{runs[0].size} sample.", figure, {"": _whole(runs)}


def _scalars(run: Studied) -> Drawn | str:
    """Figures 8 and 21: the scalars of the intervals around the drop."""
    if not len(run.stages):
        return "no slip in the regime"
    table = _around(run).iloc[1:]
    table = table.drop(columns=["frame", "step"])
    table.insert(2, "stage", table.pop("stage"))
    rho = table["stress_dmin_rho"].where(table["stress_dmin_p"] <= SIGNIFICANT)
    dmin = ("dmin_greatest", "dmin_top_tenth")
    counts = {
        "minPts = 1": "",
        "minPts = 2": "",
        "losses": "loss_",
        "greatest loss": "greatest_loss_",
    }
    regions = {name: table[f"{prefix}regions"] for name, prefix in counts.items()}
    regions["minPts = 2"] = table["regions_of_two"]
    angles = {name: table[f"region_angle_{name}"] for name in ("mean", "median")}
    panels: list[tuple[str, dict[str, pd.Series[float]]]] = [
        (r"Spearman ρ of $|\Delta\sigma_p|$ with $D^2_\mathrm{min}$", {"ρ where p ≤ 0.05": rho}),
        (OVER_SQUARE, {SYMBOLS[name]: table[name] / run.radius**2 for name in dmin}),
        ("number of GR regions", regions),
        ("|θ| in GR regions (rad)", angles),
    ]
    figure = drawing(11, 6.6)
    axes = figure.subplots(2, 2).ravel()
    for letter, ax, (label, curves) in zip("abcd", axes, panels, strict=True):
        _shade(ax, run)
        drawn = [
            ax.plot(100 * table["strain"], values, "o-", color=colour, lw=1.3, ms=3, label=name)[0]
            for colour, (name, values) in zip(CURVES, curves.items(), strict=False)
        ]
        ax.set(xlabel="shear strain γ (%)", ylabel=label, title=f"({letter})")
        ax.legend(handles=drawn, frameon=False)
    axes[1].set_yscale("log")
    caption = (
        f"Around the largest drop of the run {run.label}, for every interval Δγ: (a) Spearman's "
        "coefficient between the change of the largest principal stress of a grain and its D²min; "
        "(b) the greatest D²min and the mean of the greatest 10 %; (c) the number of GR regions "
        "by both readings of minPts and by losses; (d) their contact angles. Shaded: the stages."
    )
    return caption, figure, {"": table}


# Figures of correlations


def _points(ax: Axes, curves: dict[str, pd.DataFrame]) -> None:
    """Draws |ρ| in the middle of each range; lines join neighbours that are both significant."""
    significant = False
    for k, (name, table) in enumerate(curves.items()):
        if not len(table):
            continue
        # An open range is as wide as its neighbour, half a decade or a decade.
        ratio = (table["to"] / table["from"]).replace(np.inf, np.nan).min()
        middle = table["from"] * np.sqrt(np.minimum(table["to"] / table["from"], ratio))
        rho = table["rho"].abs().where(_significant(table))
        significant |= bool(rho.notna().any())
        style: dict[str, Any] = {
            "color": CURVES[k % len(CURVES)],
            "marker": "sD^v"[k % 4],
            "lw": 1.4,
            "ms": 5,
        }
        for side in (middle < 0, middle > 0):
            error = table["error"][side] if "error" in table else None
            label = name if side[side.index[0]] else None
            ax.errorbar(middle[side], rho[side], error, label=label, **style)
    if not significant:
        ax.text(0.5, 0.5, "no coefficient with p ≤ 0.05", transform=ax.transAxes, ha="center")
    ax.set(ylim=(0, 1.04), ylabel="|Spearman ρ|")
    ax.grid(color=PALE)
    ax.legend(ncols=4, frameon=False, fontsize="small", loc="lower left", bbox_to_anchor=(0, 1))


def _panel_of_stress(ax: Axes, title: str, curves: dict[str, pd.DataFrame]) -> None:
    _points(ax, curves)
    ax.set_xscale("symlog", linthresh=1e-5, linscale=0.5)
    ax.set(xlim=(-0.13, 0.13), xlabel="change of the shear stress ratio: slip | stick")
    ax.set_xticks([sign * 10.0**k for sign in (-1, 1) for k in range(-5, 0)])
    ax.axvline(0, color=PALE)
    ax.set_title(title, loc="left", pad=24)


def _coefficients(panel: str, run: Studied, table: pd.DataFrame) -> pd.DataFrame:
    data = table.copy()
    data.insert(0, "panel", panel)
    data.insert(1, "run", run.label)
    return data


def _by_stress(caption: str, panels: dict[str, list[Of]], run: Studied) -> Drawn:
    """Figures 9 and 10."""
    figure = drawing(11, 3.6 * ((len(panels) + 1) // 2))
    axes, data = figure.subplots((len(panels) + 1) // 2, 2, squeeze=False).ravel(), []
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    for letter, ax, (title, subjects) in zip("abc", axes, panels.items(), strict=False):
        curves = {}
        for name, over in subjects:
            table = run.coefficients(name, over)
            curves[f"$t_p$, {over}" if name == "t_p" else SYMBOLS[name]] = table
            data.append(_coefficients(letter, run, table))
        _panel_of_stress(ax, f"({letter}) {title}", curves)
    return f"{caption}, run {run.label}. {OMITTED}", figure, {"": pd.concat(data)}


def _by_measure(names: Sequence[str], run: Studied) -> Drawn:
    """Figures 11 and 23: ρ of Δτ_p in ranges of mg_t10%D²min and of sg_t10%D²min."""
    figure, data = drawing(11, 3.8), []
    measures = ("top_max", "top_sum")
    for letter, ax, by in zip("ab", figure.subplots(1, 2), measures, strict=True):
        tables = {name: run.coefficients_by(by, name) for name in names}
        data += [_coefficients(letter, run, table) for table in tables.values()]
        _points(ax, {SYMBOLS[name]: table for name, table in tables.items()})
        ends = pd.concat(list(tables.values()))[["from", "to"]].to_numpy()
        ax.set_xscale("log")
        if len(ends):
            ax.set_xlim(ends.min(), ends.max())
        ax.set_xlabel(rf"{SYMBOLS[by]}$/\bar{{r}}^2$")
        ax.set_title(rf"({letter}) $\Delta\tau_p$, long phases", loc="left", pad=24)
    what = "N_c, the least number of GR regions"
    if "angle_mean" in names:
        what = "contact angles in GR regions, at the last interval with the least number of regions"
    caption = f"{SPEARMAN} of Δτ_p with {what}, run {run.label}. {OMITTED}"
    return caption, figure, {"": pd.concat(data)}


def _ten_panels(
    labels: Sequence[str], tables: Sequence[Callable[[str, str], pd.DataFrame]]
) -> Drawing:
    figure = drawing(11, 18)
    axes = figure.subplots(5, 2).ravel()
    for letter, ax, (name, over) in zip("abcdefghij", axes, PANELS, strict=True):
        curves = {_typeset(of): table(name, over) for of, table in zip(labels, tables, strict=True)}
        change = r"$\Delta\tau$" if over == "intervals" else r"$\Delta\tau_p$"
        what = "all intervals" if over == "intervals" else f"{over} phases"
        _panel_of_stress(ax, f"({letter}) {change} – {SYMBOLS[name]}, {what}", curves)
    return figure


def _ten_of_runs(*runs: Studied) -> Drawn:
    """Figures 13, 22 and 25."""
    figure = _ten_panels([run.label for run in runs], [run.coefficients for run in runs])
    data = [
        _coefficients(letter, run, run.coefficients(*of))
        for letter, of in zip("abcdefghij", PANELS, strict=True)
        for run in runs
    ]
    caption = f"{SPEARMAN} of Δτ and Δτ_p, for {_names(runs)}. {OMITTED}"
    return caption, figure, {"": pd.concat(data)}


# Maps

NO_FRAMES = (
    "the run has no frames around the largest drop: store them, or keep checkpoints "
    "(output.keep_checkpoints)"
)
FAINT = 2e-3  # share of the greatest force below which lines are left out


def _panel(ax: Axes, run: Studied, disks: pd.DataFrame, title: str) -> None:
    ax.set_aspect("equal")
    ax.set_xlim(0, run.length)
    ax.set_ylim((disks["y"] - disks["radius"]).min(), (disks["y"] + disks["radius"]).max())
    ax.set(xticks=[], yticks=[])
    ax.set_title(title, fontsize="small", loc="left")


def _draw_disks(
    ax: Axes, run: Studied, disks: pd.DataFrame, colours: object, **options: object
) -> None:
    """Draws disks, and those across the periodic boundary at both sides."""
    x, y, radius = (disks[name].to_numpy() for name in ("x", "y", "radius"))
    shifts = np.array([-run.length, 0.0, run.length])
    at = np.stack(np.broadcast_arrays(x + shifts[:, None], y), axis=-1)
    seen = (at[..., 0] > -radius) & (at[..., 0] < run.length + radius)
    values = np.broadcast_to(np.asarray(colours), (3, len(x)))[seen]
    size = 2 * np.broadcast_to(radius, (3, len(x)))[seen]
    coloured = values.dtype.kind == "f"
    collection = EllipseCollection(
        size,
        size,
        np.zeros(len(size)),
        units="xy",
        offsets=at[seen],
        offset_transform=ax.transData,
        rasterized=True,
        linewidths=0,
        **({} if coloured else {"facecolors": values.tolist()}),
        **options,
    )
    if coloured:
        collection.set_array(values)
    ax.add_collection(collection)


def _draw_contacts(
    ax: Axes, run: Studied, contacts: pd.DataFrame, share: Array, colours: Array
) -> None:
    """Draws contacts as lines as wide as |share|, and those across the boundary at both sides."""
    ends = contacts[["x_i", "y_i", "x_j", "y_j"]].to_numpy().reshape(-1, 2, 2)
    order = np.argsort(np.abs(share))
    order = order[np.abs(share[order]) > FAINT]
    ends, width, colours = ends[order], 4.0 * np.minimum(np.abs(share[order]), 1), colours[order]
    for shift in (-run.length, 0.0, run.length):
        moved = ends + np.array([shift, 0.0])
        seen = (moved[..., 0].max(axis=1) > 0) & (moved[..., 0].min(axis=1) < run.length)
        ax.add_collection(
            LineCollection(
                list(moved[seen]), linewidths=width[seen], colors=colours[seen], rasterized=True
            )
        )


def _title(step: Any) -> str:  # noqa: ANN401 - a row
    return f"Step {step.step}, Stage {step.stage}, γ = {100 * step.end_strain:.5f} %"


def _maps(stage: str, what: str, run: Studied, part: str = "") -> Drawn | str:
    """Figures 3 to 5 and 15 to 18: one row of maps per step of a stage."""
    if not len(run.steps):
        return NO_FRAMES
    steps = run.steps[run.steps["stage"] == stage]
    if part:
        first_end = run.stages.loc[run.stages["stage"] == "slip", "end"].iloc[0]
        steps = steps[(steps["end"] <= first_end) == (part == "largest")]
    if not len(steps):
        return f"Stage {stage}, {what}: this drop has no such part"
    disks = run.disks[run.disks["step"].isin(steps["step"])]
    contacts = run.contacts[run.contacts["step"].isin(steps["step"])]
    greatest = float(contacts["force_change"].abs().max()) or 1.0
    square = run.radius**2
    levels = disks.loc[disks["dmin"] > 0, "dmin"] / square
    high, low = (levels.max(), levels.quantile(0.05)) if len(levels) else (1.0, 0.1)
    norm = LogNorm(np.clip(low, high * 1e-6, high * 0.1), high)
    figure = drawing(11, 2.9 * len(steps) + 0.6)
    rows = figure.subplots(len(steps), 4, squeeze=False)
    titles = ["greatest 1 % reduction of force", "differential force network"]
    titles += [r"greatest 1 % $D^2_\mathrm{min}$", r"$D^2_\mathrm{min}$"]
    for axes, step in zip(rows, steps.itertuples(), strict=True):
        own = disks[disks["step"] == step.step]
        lines = contacts[contacts["step"] == step.step]
        for ax, title in zip(axes, titles, strict=True):
            _panel(ax, run, own, f"{_title(step)}\n{title}" if ax is axes[0] else title)
        grey = np.where(own["body"] > 0, "#c3c8ce", PALE)
        for ax, mark in ((axes[0], "in_gr_region"), (axes[2], "greatest_dmin")):
            _draw_disks(ax, run, own, np.where(own[mark] == 1, CURVES[1], grey))
        _draw_disks(axes[1], run, own, grey)
        share = lines["force_change"].to_numpy() / greatest
        _draw_contacts(axes[1], run, lines, share, CHANGE(0.5 + 0.5 * share))
        known = own[own["dmin"] > 0]
        values = known["dmin"].to_numpy() / square
        _draw_disks(axes[3], run, known, values, norm=norm, cmap="viridis")
    for column, scale, label in (
        (1, ScalarMappable(Normalize(-greatest, greatest), CHANGE), "change of |f| (N/m)"),
        (3, ScalarMappable(norm, "viridis"), OVER_SQUARE),
    ):
        figure.colorbar(scale, ax=list(rows[:, column]), location="bottom", label=label)
    caption = (
        f"Stage {stage}, {what}, run {run.label}: the 1 % of the grains with the greatest "
        "reduction of contact force (GR regions), differential force network, the 1 % of the "
        "grains with the greatest D²min, and D²min (white: undefined, as of rattlers). All steps "
        "share the scales."
    )
    return caption, figure, {"": disks.drop(columns=["u_x", "u_y"]), "-contacts": contacts}


def _grid(run: Studied) -> tuple[Drawing, list[Axes]]:
    count = len(run.steps)
    figure = drawing(11, 2.8 * ((count + 3) // 4))
    axes = list(figure.subplots((count + 3) // 4, 4, squeeze=False).ravel())
    for ax in axes[count:]:
        ax.set_axis_off()
    return figure, axes


def _network(run: Studied) -> Drawn | str:
    """Figures 6 and 19: |f| of every contact at the end of every step."""
    if not len(run.steps):
        return NO_FRAMES
    sizes = np.sort(run.contacts["force"].to_numpy())
    # With the maximum as the end of the scale, most contacts would look alike.
    greatest = sizes[len(sizes) * 999 // 1000] if len(sizes) else 1.0
    norm = Normalize(0, greatest if greatest > 0 else 1.0)
    scale = ScalarMappable(norm, "viridis_r")
    figure, axes = _grid(run)
    for ax, step in zip(axes, run.steps.itertuples(), strict=False):
        contacts = run.contacts[run.contacts["step"] == step.step]
        _panel(ax, run, run.disks[run.disks["step"] == step.step], _title(step))
        share = contacts["force"].to_numpy() / norm.vmax
        _draw_contacts(ax, run, contacts, share, scale.to_rgba(contacts["force"].to_numpy()))
    figure.colorbar(scale, ax=axes, location="bottom", shrink=0.4, label="|f| (N/m)")
    caption = (
        f"Force network around the largest drop, run {run.label}. Lines join the centres of "
        "touching grains; width and colour give the magnitude of the contact force, on one scale."
    )
    return caption, figure, {"": run.contacts.drop(columns="force_change")}


def _displacements(run: Studied) -> Drawn | str:
    """Figures 7 and 20: non-affine displacements."""
    if not len(run.steps):
        return NO_FRAMES
    figure, axes = _grid(run)
    rows: list[Any] = list(run.steps.itertuples())
    for ax, step in zip(axes, rows, strict=False):
        disks = run.disks[run.disks["step"] == step.step]
        x, y, u, v = (disks[name].to_numpy() for name in ("x", "y", "u_x", "u_y"))
        size = np.hypot(u, v)
        # The 99th percentile of the displacements becomes an arrow of four mean radii.
        most = np.sort(size)[len(size) * 99 // 100] or 1.0
        factor = 4 * run.radius / most
        with np.errstate(divide="ignore"):
            longest = factor * np.minimum(1.5 * most / size, 1.0)
        _panel(ax, run, disks, f"{_title(step)}\narrows × {scientific(factor, 2)}")
        arrows: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "headwidth": 6}
        ax.quiver(x, y, longest * u, longest * v, color=INK, width=0.003, **arrows)
        if step.stage == "II" and not np.isnan(step.tension_x):
            along = np.array([step.tension_x, step.tension_y])
            across = np.array([-along[1], along[0]])
            near, far, centre = 3.0 * run.radius, 12.0 * run.radius, np.array([step.x, step.y])
            for side in (1, -1):
                of_arrows: dict[str, Any] = {"color": GREY, "width": 0.012} | arrows
                ax.quiver(
                    *(centre + side * near * along), *(side * (far - near) * along), **of_arrows
                )
                ax.quiver(
                    *(centre + side * far * across), *(side * (near - far) * across), **of_arrows
                )
    caption = (
        f"Non-affine displacements around the largest drop, run {run.label}: displacements minus "
        "the mean shear and stretch along y. Each step has its own scale; the longest arrows are "
        "cut. Grey arrows: directions of tension (outward) and compression (inward) around the "
        "greatest D²min, from the displacement gradient within five mean diameters."
    )
    names = ["body", "in_gr_region", "dmin", "greatest_dmin"]
    return caption, figure, {"": run.disks.drop(columns=names)}


def parser() -> argparse.ArgumentParser:
    """Returns the command line."""
    of = argparse.ArgumentParser(
        prog="python -m gshear.studies.lee_hurley",
        description="Repeats the study of Lee & Hurley on one or several runs of disks between "
        "walls. Writes figures 2 to 25 as fig-NN.svg with fig-NN.csv, the paper's numbers next to "
        "those of the runs (numbers.csv), the largest drops (drops.csv), means over runs that "
        "differ in their seeds only (ensemble*.csv), and index.html with all of them.",
        epilog="Runs need two or more frames, or scalars (analysis.scalars). If frames around the "
        "largest drop are missing but checkpoints were kept (output.keep_checkpoints), they are "
        "replayed. A sample of more than 2,236 disks is compared with the paper's large one. "
        "Default of --out: the first run's folder + /lee-hurley. gshear-reduce writes its tables "
        "into run-1, run-2, … there. Exit codes: 0 done, 2 bad input, others as gshear-reduce.",
    )
    onset = "shear strain at which the stick-slip regime begins (default: the paper's, 0.022 in "
    onset += "the small and 0.054 in the large sample)"
    of.add_argument("--from", dest="onset", type=float, metavar="STRAIN", help=onset)
    points = "minPts of DBSCAN, the point itself counted (default: 1)"
    of.add_argument("--min-points", type=int, choices=[1, 2], default=1, help=points)
    force = "reduction of force of a grain, by which the grains of GR regions are chosen"
    of.add_argument("--reduction", choices=list(REDUCTIONS), default="net", help=force)
    width = "width of the ranges of Δτ, Δτ_p and D²min"
    of.add_argument("--bins", choices=["decades", "half-decades"], default="decades", help=width)
    of.add_argument("--threads", type=int, metavar="N", help="threads of a replay")
    return of


if __name__ == "__main__":
    raise SystemExit(_output.main(parser(), study))
