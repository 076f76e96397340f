"""The study of Bonfanti et al. (BO), repeated on runs in periodic boxes.

*Oscillatory instabilities in three-dimensional frictional granular matter*, sections II to IV. Of
one run figures 1 to 5 are drawn and the paper's numbers stand next to the run's; of several runs
the study says what became of their growing pairs. gshear-reduce fits the growth and finds the
eigenvalues (`docs/validation/bonfanti.md`). Quantities are in the units of the scene.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from numpy.typing import NDArray

from ..errors import ProgramFailedError, RunError
from ..run import Run
from ..tables import read_csv
from . import _output
from ._output import CURVES, GREY, INK, PALE, Drawn, drawing, reduce, scientific

Array: TypeAlias = NDArray[np.float64]

LAMBDA_I = "5.87e-5"  # of the pair at the start of Newton's equations (section IV)
DROP = 0.22  # of the shear stress (figure 5)
NUMBER_FAILED = 3  # exit code of gshear-reduce


@dataclass
class Studied:
    """A run in a box.

    Attributes:
        strain: Its strain steps.
        moving: Newton's equations after them; None without.
        growth: The line of `growth.csv`; NaN without Newton's equations.
        grains: `growth-grains.csv`: |v|² in the growing pair and D²min of the slip; may be empty.
    """

    strain: Run
    moving: Run | None
    growth: pd.Series
    grains: pd.DataFrame

    def pair(self, name: str) -> float:
        """Returns λ_i, ω_i or ω_r of the pair at the start of Newton's equations; NaN without."""
        return float(self.moving.parameters.get(name, np.nan)) if self.moving else np.nan

    def error_of_time_step(self) -> tuple[float, float]:
        """Returns the parts by which the time step changes ω_i and ω_r of the pair.

        Velocity Verlet turns ω = ω_r + iω_i into ω + ω³Δt²/24, which is 3(ω_rΔt)²/24 of ω_i and
        (ω_rΔt)²/24 of ω_r for ω_i « ω_r.
        """
        if self.moving is None or not len(self.moving.series):
            return np.nan, np.nan
        last = self.moving.series.iloc[-1]
        part = (self.pair("omega_r") * last["time"] / last["step"]) ** 2 / 24
        return 3 * part, part

    def off(self, name: str) -> float:
        """Returns the fitted ω_i or ω_r over that of the eigenvalue, less 1."""
        return float(self.growth[f"fitted_{name}"] / self.pair(name) - 1)


def study(options: argparse.Namespace) -> Path:
    """Writes the study and returns the path of its page.

    Raises:
        GshearError: A run cannot be studied, or gshear-reduce failed.
    """
    out = _output.folder_of(options.out, options.runs[0], "bonfanti")
    many = len(options.runs) > 1
    runs = [_open(path, done=many) for path in options.runs]
    if not many:
        return _one(_read(*runs[0], out), out)
    lines = []
    for k, of in enumerate(runs, start=1):
        folder = out / f"run-{k}"
        lines.append(_numbers_of_run(_read(*of, folder), folder))
    return _ensemble(pd.DataFrame(lines), out)


def _open(path: Path, *, done: bool) -> tuple[Run, Run | None]:
    """Opens both parts of a run; if `done`, refuses a run that was stopped."""
    strain = Run(path, quiet=True)
    if strain.stage != "aqs":
        raise RunError(f"{path}: has no strain steps: give the folder of a run in a periodic box")
    moving = strain.newtonian
    for run in [strain, *([moving] if moving else [])] if done else []:
        if not run.finished:
            raise RunError(
                f"{run.path}: is not done, and an ensemble needs the end of each run; "
                "continue it (--resume) or leave it out"
            )
    return strain, moving


def _read(strain: Run, moving: Run | None, folder: Path) -> Studied:
    if moving is None:
        folder.mkdir(parents=True, exist_ok=True)
        nothing = {"fitted_omega_i": np.nan, "fitted_omega_r": np.nan, "decades": np.nan}
        return Studied(strain, None, pd.Series(nothing), pd.DataFrame())
    reduce("growth", moving.path, folder)
    growth = read_csv(folder / "growth.csv").iloc[0]
    return Studied(strain, moving, growth, read_csv(folder / "growth-grains.csv"))


# One run


def _one(run: Studied, out: Path) -> Path:
    numbers = pd.DataFrame(_numbers(run), columns=["statement", "paper", "ours"])
    _output.write_table(out / "numbers.csv", numbers, quoted=True)
    body = _output.html_table(["", "paper", "this run"], numbers.to_numpy())
    body += _output.save_numbered(out, _figures(run))
    lead = f"Figures and numbers of the paper for the run {run.strain.path}."
    return _output.page(out / "index.html", "The study of Bonfanti et al.", lead, body)


def _numbers(run: Studied) -> list[tuple[str, str, str]]:
    """Returns statement, the paper's value and the run's value."""
    of, growth = run.strain.parameters, run.growth

    def compared(name: str, part: float) -> str:
        pair = run.pair(name)
        if np.isnan(growth[f"fitted_{name}"]) or np.isnan(pair):
            return "–"
        return (
            f"fitted {scientific(growth[f'fitted_{name}'], 6)}, eigenvalue {scientific(pair, 6)}: "
            f"{100 * run.off(name):+.3f} %, of which the time step explains {100 * part:+.3f} %"
        )

    birth, lambda_i, decades = "–", run.pair("lambda_i"), growth["decades"]
    if "birth_after" in of:
        before = scientific(of["birth_after"] - of["birth_before"], 1)
        birth = f"{of['birth_after']:.12f} (no pair {before} earlier)"
    overlap = "–"
    if len(run.grains):
        overlap = f"{growth['overlap']:.3f} ({growth['overlap_by_chance']:.3f} by chance)"
    stress = run.moving.series["shear_stress"] if run.moving else pd.Series(dtype="float64")
    drop = f"{100 * (1 - stress.iloc[-1] / stress.iloc[0]):.1f} %" if len(stress) else "–"
    fell_back = f"{of['fell_back']:g} of {len(run.strain.series) - 1}" if "fell_back" in of else "–"
    of_i, of_r = run.error_of_time_step()
    return [
        ("strain at which the first complex pair appears", "not given", birth),
        (
            "strain steps that fell back to overdamped dynamics",
            "(overdamped dynamics throughout)",
            fell_back,
        ),
        (
            "imaginary part of the pair at the start of Newton's equations",
            LAMBDA_I,
            "–" if np.isnan(lambda_i) else scientific(lambda_i, 4),
        ),
        ("omega_i", "corresponds perfectly", compared("omega_i", of_i)),
        ("omega_r", "corresponds perfectly", compared("omega_r", of_r)),
        (
            "decades over which the mean square displacement grows as the pair",
            "about 10",
            "–" if np.isnan(decades) else f"{decades:.1f}",
        ),
        (
            "overlap of the pair's eigenvector with D²min of the slip that follows",
            "not in the paper",
            overlap,
        ),
        ("drop of the shear stress", f"{100 * DROP:.0f} %", drop),
    ]


def _figures(run: Studied) -> dict[int, Drawn | str]:
    drawn = (_imaginary, _eigenvalues, _displacement, _spirals, _stress, _slip)
    return {number: draw(run) for number, draw in enumerate(drawn, start=1)}


def _axes(panels: int = 1, *, square: bool = False) -> tuple[Drawing, list[Axes]]:
    figure = drawing(6.4, 6) if square else drawing(9, 4 * panels)
    axes = list(figure.subplots(panels, 1, squeeze=False)[:, 0])
    for ax in axes:
        ax.grid(color=PALE)
    return figure, axes


def _imaginary(run: Studied) -> Drawn | str:
    """Figure 1."""
    table = run.strain.series[["strain", "imaginary_least", "imaginary_greatest"]]
    if table["imaginary_greatest"].isna().all():
        return "no eigenvalues along the strain: set aqs.spectrum"
    figure, (ax,) = _axes()
    for name, colour in (("least", CURVES[0]), ("greatest", CURVES[2])):
        ax.plot(table["strain"], table[f"imaginary_{name}"], color=colour, label=name)
    ax.set(xlabel="strain γ", ylabel="Im λ")
    ax.legend(frameon=False)
    caption = "Least and greatest imaginary part of the eigenvalues of K v = λ M v against strain."
    return caption, figure, {"": table}


def _eigenvalues(run: Studied) -> Drawn | str:
    """Figure 2."""
    path = run.strain.folder / "spectra.csv"
    table = read_csv(path)[["time", "real", "imaginary"]] if path.exists() else pd.DataFrame()
    if not len(table):
        return "no eigenvalues in time: set newtonian.spectra"
    figure, (ax,) = _axes()
    ax.plot(table["time"], table["imaginary"], ".", color=CURVES[0], ms=3, rasterized=True)
    ax.set(xlabel="time", ylabel="Im λ")
    caption = "Imaginary parts of all eigenvalues against time, under Newton's equations."
    return caption, figure, {"": table}


NO_MOTION = "the run has no [newtonian] stage"


def _displacement(run: Studied) -> Drawn | str:
    """Figure 3."""
    if run.moving is None:
        return NO_MOTION
    table = run.moving.series[["time", "msd"]]
    time, msd = (table[name].to_numpy() for name in table)
    grows = np.isfinite(run.growth["decades"])
    zoom = oscillation(time, run.growth["growth_to"])
    figure, axes = _axes(2 if zoom else 1)
    axes[0].plot(time[msd > 0], msd[msd > 0], color=CURVES[0], label="mean square displacement")
    if grows:
        ends = run.growth[["growth_from", "growth_to"]].to_numpy(dtype=np.float64)
        inside = (time >= ends[0]) & (time <= ends[1]) & (msd > 0)
        for omega, colour, label in (
            (run.growth["fitted_omega_i"], CURVES[1], r"fitted $\exp 2\omega_i t$"),
            (run.pair("omega_i"), GREY, r"$\exp 2\omega_i t$ of the complex pair"),
        ):
            level = np.mean(np.log(msd[inside]) - 2 * omega * time[inside])
            if np.isfinite(level):
                axes[0].plot(ends, np.exp(level + 2 * omega * ends), color=colour, label=label)
    axes[0].set(yscale="log", title="(a)")
    axes[0].legend(frameon=False)
    if zoom:
        axes[1].plot(time[zoom], msd[zoom], color=CURVES[0])
        axes[1].set_title("(b)")
    for ax in axes:
        ax.set(xlabel="time", ylabel="mean square displacement")
    caption = (
        "(a) Mean square displacement (eq. 10), its fitted exponential growth, and that of the "
        "complex pair. (b) An interval of the growth in which the oscillation is resolved."
    )
    return caption, figure, {"": table}


def oscillation(time: Array, growth_to: float) -> slice | None:
    """Returns `dense` of the rows until the growth ends, of all of them if there is none."""
    return dense(time[time <= growth_to]) if np.isfinite(growth_to) else dense(time)


def dense(time: Array) -> slice | None:
    """Returns the last interval of more than 17 rows at less than half the greatest distance."""
    close = np.diff(time) < 0.5 * np.max(np.diff(time), initial=0.0)
    if not close.any():
        return None
    end = int(np.flatnonzero(close)[-1])
    apart = np.flatnonzero(~close[:end])
    begin = int(apart[-1]) + 1 if len(apart) else 0
    return slice(begin, end + 1) if end > begin + 16 else None


def _spirals(run: Studied) -> Drawn | str:
    """Figure 4."""
    if run.moving is None:
        return NO_MOTION
    if np.isnan(run.growth["decades"]):
        return "the mean square displacement does not grow exponentially"
    times = run.moving.frames.time
    times = times[: int(np.argmax(np.append(times > run.growth["growth_to"], True)))]
    if len(times) < 3:
        return "fewer than three frames during the growth: increase newtonian.frames"
    frames = run.moving.frames[: len(times)]
    places = np.stack([f.unwrapped if "image" in f else f.position for f in frames])
    moved = places - places[0]
    size = np.linalg.norm(moved, axis=2)
    grains = np.argsort(-size[-1], kind="stable")[:8]
    moved = moved[:, grains] / size[:, grains].max()
    figure, (ax,) = _axes(square=True)
    tables = []
    for k, grain in enumerate(grains):
        ax.plot(*moved[:, k, :2].T, color=CURVES[k] if k < len(CURVES) else INK, lw=1.2)
        place = dict(zip("xyz", moved[:, k].T, strict=True))
        tables.append(pd.DataFrame({"time": times, "grain": grain} | place))
    ax.set(xlabel="Δx over the greatest", ylabel="Δy over the greatest")
    caption = (
        "Trajectories of the eight spheres with the greatest displacement at the end of the linear "
        "growth, over the greatest displacement, seen along z."
    )
    return caption, figure, {"": pd.concat(tables)}


def _stress(run: Studied) -> Drawn | str:
    """Figure 5."""
    if run.moving is None:
        return NO_MOTION
    table = run.moving.series[["time", "shear_stress"]]
    grows = np.isfinite(run.growth["decades"])
    figure, axes = _axes(2 if grows else 1)
    axes[0].plot(table["time"], table["shear_stress"], color=CURVES[0])
    axes[0].set(xlabel="time", ylabel=r"shear stress $\sigma_{xz}$", title="(a)")
    if grows:
        linear = table[table["time"] <= run.growth["growth_to"]]
        change = linear["shear_stress"] - table["shear_stress"].iloc[0]
        axes[1].plot(linear["time"], change, color=CURVES[0])
        axes[1].set(xlabel="time", ylabel=r"change of $\sigma_{xz}$", title="(b)")
    caption = "(a) Shear stress (virial) against time. (b) Its change during the linear growth."
    return caption, figure, {"": table}


def _slip(run: Studied) -> Drawn | str:
    """Figure 6."""
    if not len(run.grains):
        return "no complex pair, or no frames after it"
    table = run.grains[["eigenvector_square", "dmin"]]
    shown = table[(table > 0).all(axis=1)]
    figure, (ax,) = _axes(square=True)
    ax.loglog(shown["eigenvector_square"], shown["dmin"], "o", color=CURVES[0], ms=4)
    ax.set(xlabel=r"$|v|^2$ in the growing pair", ylabel=r"$D^2_\mathrm{min}$ of the slip")
    caption = (
        "Not in the paper: D²min between the first and the last frame against |v|² of the growing "
        "pair, one point per sphere."
    )
    return caption, figure, {"": table}


# Several runs


def _numbers_of_run(run: Studied, folder: Path) -> dict[str, object]:
    """Returns the line of a run in `ensemble-runs.csv`; NaN stands for what it does not have."""
    scene, growth = run.strain.scene, run.growth
    sample = scene["sample"]
    if "packing" in sample:
        made = f"packing {sample['packing']}"
    else:
        made = f"φ = {scene['sample.solid_fraction']:g} {sample.get('placement', 'lattice')}"
    family = f"{made} N = {sample['grains']}"
    ours, paper = (first_pair(run.strain, folder, paper_form=form) for form in (False, True))
    lambda_i, omega_i = run.pair("lambda_i"), run.pair("omega_i")
    aftermath = growth.get("aftermath", "")
    aftermath = aftermath if isinstance(aftermath, str) else ""
    is_catastrophe = aftermath == "catastrophe"

    def change(name: str) -> float:
        return float(growth.get(name, np.nan))

    def in_catastrophe(name: str) -> float:
        return change(name) if is_catastrophe else np.nan

    birth = float(run.strain.parameters.get("birth_after", np.nan))
    of_i, of_r = run.error_of_time_step()
    numbers: dict[str, object] = {
        "path": str(run.strain.path),
        "runs_of": family,
        "aftermath": aftermath,
        "frames": len(run.strain.frames),
        "birth": birth,
        "has_pair": float(np.isfinite(birth)),
    }
    firsts = {
        "first_frame_with_pair": "strain",
        "first_omega_r": "omega_r",
        "first_omega_i": "omega_i",
    }
    for name, key in firsts.items():
        numbers |= {name: ours[key], f"{name}_paper_form": paper[key]}
    numbers |= {
        "lambda_i": lambda_i,
        "omega_i_error": run.off("omega_i"),
        "omega_r_error": run.off("omega_r"),
        "omega_i_error_of_time_step": of_i,
        "omega_r_error_of_time_step": of_r,
        "decades": float(growth["decades"]),
        "overlap_less_chance": change("overlap") - change("overlap_by_chance"),
    }
    for name in ("catastrophe", "saturation", "growing"):
        numbers[name] = float(aftermath == name) if aftermath else np.nan
    for name in ("change_over_pressure", "change_over_stress"):
        numbers[name] = change(name)
    for name in ("change_over_pressure", "change_over_stress"):
        numbers[f"{name}_catastrophe"] = in_catastrophe(name)
    numbers |= {
        "stress_over_pressure_before": abs(change("stress_before")) / change("pressure_before"),
        "energy_change_catastrophe": in_catastrophe("energy_change"),
        "contacts_change_catastrophe": in_catastrophe("contacts_change"),
        "linear_growth_times": change("linear_until") * omega_i,
        "catastrophe_growth_times": change("catastrophe_at") * omega_i,
    }
    names = [str(name) for name in growth.index]
    further = names[names.index("pressure_before") :] if "pressure_before" in names else []
    return numbers | {name: growth[name] for name in further if name not in numbers}


def first_pair(strain: Run, folder: Path, *, paper_form: bool) -> dict[str, float]:
    """Returns strain, ω_r and ω_i of the first frame with a complex pair; NaN without.

    Args:
        strain: Strain steps of a run.
        folder: Folder for `stability.csv`.
        paper_form: With J in the form of BO's appendix B rather than K, the derivative of the
            program's forces.
    """
    nothing = dict.fromkeys(("strain", "omega_r", "omega_i"), np.nan)
    if not len(strain.frames):
        return nothing
    folder = folder / ("paper-form" if paper_form else "frames")
    table = folder / "stability.csv"
    table.unlink(missing_ok=True)
    try:
        reduce("stability", strain.path, folder, "--until-pair", *["--paper-form"] * paper_form)
    except ProgramFailedError as error:
        # Frames without eigenvalues are NaN in the table, and none of them is the first pair.
        if error.exit_code != NUMBER_FAILED or not table.exists():
            raise
        print(f"note: {error.output.strip()}")
    found = read_csv(table)
    found = found[found["pairs"] > 0]
    if not len(found):
        return nothing
    row = found.iloc[0]
    omega = np.sqrt(complex(row["pair_real"], row["imaginary_greatest"]))
    return {"strain": row["strain"], "omega_r": omega.real, "omega_i": omega.imag}


def _ensemble(runs: pd.DataFrame, out: Path) -> Path:
    """Writes tables, figure and page of several runs; `runs` has a line per run."""
    names = list(runs)
    quantities = names[names.index("birth") : names.index("catastrophe_growth_times") + 1]
    tables, rows = "", []
    for family, members in runs.groupby("runs_of", sort=False):
        statistics: list[dict[str, object]] = [
            {"runs_of": family, "what": n} | _output.spread(members[n]) for n in quantities
        ]
        rows += statistics
        cells = [
            [f"{x:.5g}" if isinstance(x, float) else str(x) for x in of.values()][1:]
            for of in statistics
        ]
        head = ["", *list(statistics[0])[2:]]
        tables += f"<h3>{family}: {len(members)} runs</h3>\n{_output.html_table(head, cells)}"
    _output.write_table(out / "ensemble.csv", pd.DataFrame(rows))
    figure, data = _distributions(runs)
    caption = (
        "Shares of the runs. (a) Change of the shear stress over Newton's equations, over the "
        "pressure before. (b) The same over the size of the shear stress before; the vertical line "
        f"is the paper's {100 * DROP:.0f} %. (c) Births by the frames of the strain steps, lines "
        "with K, dots with J in the paper's form."
    )
    body = _output.save(out, "ensemble", (caption, figure, {"-distributions": data, "-runs": runs}))
    body += (
        '<p><a href="ensemble.csv">ensemble.csv</a>'
        ". Of a quantity that a run has or has not, such as catastrophe, the mean is the share of "
        f"the runs.</p>\n{tables}"
    )
    lead = f"{len(runs)} runs, by what they have in common."
    return _output.page(out / "index.html", "Ensemble of the study of Bonfanti et al.", lead, body)


def _distributions(runs: pd.DataFrame) -> tuple[Drawing, pd.DataFrame]:
    """Draws the share of the runs of each family up to a value, and returns its points."""
    figure, axes = _axes(3)
    panels = [
        ("(a)", "|Δσ| over the pressure before", {"line": "change_over_pressure"}),
        ("(b)", "|Δσ| over |σ| before", {"line": "change_over_stress"}),
        (
            "(c)",
            "strain γ of the first frame with a pair: K, and dots in the paper's form",
            {"line": "first_frame_with_pair", "dots": "first_frame_with_pair_paper_form"},
        ),
    ]
    data = []
    for ax, (panel, label, kinds) in zip(axes, panels, strict=True):
        for kind, name in kinds.items():
            for k, (family, of) in enumerate(runs.groupby("runs_of", sort=False)):
                values = np.sort(of[name][of[name] > 0].to_numpy())
                share = np.arange(1, len(values) + 1) / len(values) if len(values) else values
                head = {"panel": panel, "runs_of": family, "what": kind}
                data.append(pd.DataFrame(head | {"value": values, "share_of_runs": share}))
                colour = CURVES[k % len(CURVES)]
                if kind == "line" and len(values):
                    ax.ecdf(values, color=colour, label=str(family))
                else:
                    ax.plot(values, share, ".", color=colour)
        ax.set(xscale="log", xlabel=label, ylabel="share of the runs", ylim=(0, 1.05))
        ax.set_title(panel, loc="left")
        ax.legend(frameon=False)
    axes[1].axvline(DROP, color=GREY, ls="--")
    return figure, pd.concat(data)


def parser() -> argparse.ArgumentParser:
    """Returns the command line."""
    return argparse.ArgumentParser(
        prog="python -m gshear.studies.bonfanti",
        description="Repeats the study of Bonfanti et al. on the folder of a run in a periodic "
        "box: figures 1 to 5 as fig-NN.svg with fig-NN.csv, and the paper's numbers next to those "
        "of the run (numbers.csv). Of several runs it says what became of their growing pairs: "
        "ensemble-runs.csv has a line per run, ensemble.csv means over runs that differ in their "
        "seeds only, ensemble.svg their distributions. index.html shows all of it.",
        epilog="Figures need aqs.spectrum, newtonian.spectra or newtonian.frames, and an ensemble "
        "aqs.frame_every; what is missing is said. Runs of an ensemble must be done. Default of "
        "--out: the first run's folder + /bonfanti. Exit codes: 0 done, 2 bad input, others as "
        "gshear-reduce.",
    )


if __name__ == "__main__":
    raise SystemExit(_output.main(parser(), study))
