"""Figures in matplotlib. Every function draws into the Axes that it is given.

Colours are those of Okabe & Ito and the map viridis, which stay apart for colour-blind readers and
in grey. Lengths are drawn in the unit of the run, with the prefix that suits them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsIndex

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from .errors import RunError
from .frames import Frame
from .run import Run
from .sweep import Sweep

STICK, SLIP, THIRD = "#0072B2", "#D55E00", "#009E73"  # Okabe & Ito
KINDS = {"stick": STICK, "slip": SLIP}
DMIN_LABEL = r"$D^2_\mathrm{min}\;/\;\bar{r}^2$"
GRAIN, WALL, EDGE = "#e8e8e8", "#9a9a9a", "#6e6e6e"
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def force_network(
    ax: Axes,
    run: Run,
    frame: SupportsIndex | Frame = -1,
    *,
    width: float = 1.5,
    colorbar: bool = True,
) -> LineCollection:
    """Draws the contacts of disks as lines between centres, as wide as their normal force.

    Args:
        ax: Axes to draw into.
        run: Run of disks.
        frame: Its frame, or the number of one.
        width: Width of a contact with the mean force (points). Widths are proportional to F_n.
        colorbar: Add a colour bar with F_n over its mean.

    Returns:
        The lines; a contact across the periodic boundary has one at each side.
    """
    frame = _frame_of_disks(run, frame)
    draw_disks(ax, run, frame)
    contacts = frame.contacts
    bears = contacts.normal_force > 0
    force = contacts.normal_force[bears]
    relative = force / force.mean() if len(force) else force
    r = contacts.separation[bears, :2]
    x = frame.position[:, :2]
    from_i = np.stack([x[contacts.i[bears]], x[contacts.i[bears]] - r], axis=1)
    from_j = np.stack([x[contacts.j[bears]] + r, x[contacts.j[bears]]], axis=1)
    seam = np.abs(from_i - from_j).max(axis=(1, 2)) > 0.5 * frame.radius.min()
    segments = np.concatenate([from_i, from_j[seam]])
    relative = np.concatenate([relative, relative[seam]])
    # Strong contacts above weak ones.
    order = np.argsort(relative)
    lines = LineCollection(
        list(segments[order]),
        linewidths=width * relative[order],
        cmap="viridis_r",
        norm=Normalize(0, max(1.0, float(np.quantile(relative, 0.99))) if len(relative) else 1.0),
        capstyle="round",
        zorder=2,
    )
    lines.set_array(relative[order])
    ax.add_collection(lines)
    if colorbar:
        bar = _figure(ax).colorbar(lines, ax=ax, extend="max", shrink=0.85, pad=0.02)
        bar.set_label("normal force / mean")
    return lines


def dmin_map(
    ax: Axes, run: Run, frame: SupportsIndex, *, colorbar: bool = True, decades: float = 4.0
) -> EllipseCollection:
    """Draws disks coloured by D²min between the frame before and this one, over r̄².

    Disks without D²min (rattlers of the earlier frame) are grey, which the colours leave out.

    Args:
        ax: Axes to draw into.
        run: Run of disks.
        frame: Number of the frame.
        colorbar: Add a colour bar.
        decades: Decades below the greatest value that the colours span.

    Returns:
        The coloured disks.
    """
    drawn = _frame_of_disks(run, frame)
    values = run.dmin(frame) / np.mean(drawn.radius) ** 2
    defined = np.isfinite(values) & (values > 0)
    if not defined.any():
        raise RunError(
            f"{run.path}: frame {frame} has no D²min: frame 0 has none, nor have rattlers"
        )
    draw_disks(ax, run, drawn)
    greatest = float(values[defined].max())
    disks = _disks(ax, drawn, defined)
    disks.set(
        cmap="viridis",
        norm=LogNorm(greatest * 10**-decades, greatest),
        edgecolors="none",
        zorder=2,
    )
    disks.set_array(_with_images(drawn, values)[_with_images(drawn, defined)])
    if colorbar:
        bar = _figure(ax).colorbar(disks, ax=ax, extend="min", shrink=0.85, pad=0.02)
        bar.set_label(DMIN_LABEL)
    return disks


def stress_ratio(ax: Axes, run: Run, *, drops: int = 3) -> list[Line2D]:
    """Draws τ against γ, with its largest drops marked and numbered.

    Args:
        ax: Axes to draw into.
        run: Run between walls.
        drops: Number of drops to mark.

    Returns:
        The line of τ, then one for each drop, largest first.
    """
    series = run.series
    lines = ax.plot(series["strain"], series["stress_ratio"], color="#333333", linewidth=0.8)
    if drops:
        ends = run.drops(drops)[["start_row", "end_row"]].to_numpy()
        near = 0.03 * np.ptp(series["strain"])
        labelled: list[tuple[float, int]] = []
        for place, (start, end) in enumerate(ends, start=1):
            rows = series.iloc[start : end + 1]
            (line,) = ax.plot(
                rows["strain"],
                rows["stress_ratio"],
                color=SLIP,
                linewidth=2.2,
                solid_capstyle="round",
                label="largest drops" if place == 1 else None,
            )
            lines.append(line)
            strain = float(series["strain"].iloc[start])
            taken = [level for at, level in labelled if abs(at - strain) < near]
            level = min(set(range(len(taken) + 1)) - set(taken))
            labelled.append((strain, level))
            # Numbers of neighbours stand above each other, over all of τ near them.
            around = series.loc[(series["strain"] - strain).abs() < near, "stress_ratio"]
            ax.annotate(
                str(place),
                (strain, around.max()),
                xytext=(0, 4 + 12 * level),
                textcoords="offset points",
                ha="center",
                color=SLIP,
            )
        ax.legend(frameon=False, loc="lower right")
    ax.set_xlabel("shear strain γ")
    ax.set_ylabel("stress ratio τ")
    ax.margins(x=0.01, y=0.15)
    return lines


def series(ax: Axes, run: Run, column: str, *, against: str = "strain") -> Line2D:
    """Draws a column of the time series against another one, with units on the axes."""
    table = run.series
    (line,) = ax.plot(table[against], table[column], color=STICK, linewidth=1.0)
    units = table.attrs["units"]
    for axis, name in ((ax.xaxis, against), (ax.yaxis, column)):
        label_axis(axis, name.replace("_", " "), units.get(name), table[name].to_numpy())
    return line


def courses(ax: Axes, sweep: Sweep, column: str, *, against: str = "strain") -> list[Line2D]:
    """Draws a column of the time series of every run of a sweep, named by the keys that differ."""
    lines = []
    for run, colour in zip(sweep, _colours(len(sweep)), strict=True):
        line = series(ax, run, column, against=against)
        line.set_color(colour)
        line.set_label(", ".join(f"{key} = {run.scene.get(key)}" for key in sweep.keys))
        lines.append(line)
    if len(lines) > 1:
        ax.legend(fontsize="x-small")
    return lines


def against(ax: Axes, means: pd.DataFrame, column: str) -> list[Line2D]:
    """Draws a column of `Sweep.means` with its errors against the first of its keys.

    Runs that differ in further keys have lines of their own.
    """
    first, *others = means.index.names
    groups = means.groupby(others, sort=True) if others else [((), means)]
    lines = []
    for values, group in groups:
        label = ", ".join(f"{k} = {v}" for k, v in zip(others, values, strict=True))
        bars = ax.errorbar(
            group.index.get_level_values(str(first)),
            group[column],
            group[f"{column}_error"],
            fmt="o-",
            markersize=4,
            linewidth=0.8,
            capsize=2,
            label=label or None,
        )
        lines.append(bars.lines[0])
    ax.set(xlabel=first, ylabel=column)
    if others:
        ax.legend(fontsize="x-small")
    return lines


def dmin_distribution(
    ax: Axes, run: Run, frames: Mapping[str, SupportsIndex | slice] | None = None
) -> list[Line2D]:
    """Draws the fraction of the free grains whose D²min is at least x, over r̄².

    The axis begins at the value that 99 % of them exceed.

    Args:
        ax: Axes to draw into.
        run: Run between walls.
        frames: Frames by name in the legend; default: all of them.

    Returns:
        One line per name.
    """
    grains = run.frame(0)
    scale, free = float(np.mean(grains.radius)) ** 2, grains.body == 0
    lines: list[Line2D] = []
    first, last = np.inf, 0.0
    groups = frames or {"all frames": slice(None)}
    for colour, (name, which) in zip(_colours(len(groups)), groups.items(), strict=True):
        values = np.ravel(run.dmin(which)[..., free]) / scale
        values = values[values > 0]
        lines += _exceedance(ax, values, label=name, color=colour)
        if len(values):
            first = min(first, float(np.quantile(values, 0.01)))
            last = max(last, float(values.max()))
    if last > first:
        ax.set_xlim(first, 2 * last)
    ax.set_xlabel(DMIN_LABEL)
    ax.set_ylabel("fraction of grains with at least as much")
    ax.legend(frameon=False)
    return lines


def phase_statistics(ax: Axes, run: Run, quantity: str = "delta_tau_p") -> list[Line2D]:
    """Draws the fraction of stick and of slip phases whose magnitude is at least x.

    Args:
        ax: Axes to draw into.
        run: Run between walls.
        quantity: Column of `phases`: `delta_tau_p` (change of τ) or `t_p` (duration in rows).

    Returns:
        The lines of stick and of slip phases.
    """
    labels = {"delta_tau_p": "change of τ in a phase", "t_p": "duration of a phase (rows)"}
    phases = run.phases()
    lines: list[Line2D] = []
    for kind, marker in (("stick", "o"), ("slip", "s")):
        values = phases.loc[phases["kind"] == kind, quantity].abs().to_numpy(dtype=np.float64)
        lines += _exceedance(
            ax,
            values,
            label=f"{kind} ({len(values)})",
            color=KINDS[kind],
            marker=marker,
            markersize=3,
        )
    ax.set_xlabel(labels.get(quantity, quantity.replace("_", " ")))
    ax.set_ylabel("fraction of phases with at least as much")
    ax.legend(frameon=False)
    return lines


def rate_state(ax: Axes, run: Run, *, experiment: int = 0) -> list[Line2D]:
    """Draws μ against slip, with the fits of the aging and the slip law (`rate-state.csv`).

    Args:
        ax: Axes to draw into.
        run: Run under a spring.
        experiment: Protocol, in the order of the runs given to gshear-reduce.

    Returns:
        The lines of the data and of the laws that were fitted.
    """
    table = run.rate_state()["rate-state"]
    table = table[table["experiment"] == experiment]
    lines = ax.plot(table["slip"], table["mu"], color="#999999", linewidth=0.6, label="simulation")
    for column, label, colour, style in (
        ("mu_aging", "aging law", STICK, "-"),
        ("mu_slip", "slip law", SLIP, "--"),
    ):
        if table[column].notna().any():
            lines += ax.plot(
                table["slip"], table[column], style, color=colour, linewidth=1.4, label=label
            )
    label_axis(ax.xaxis, "slip", run.series.attrs["units"].get("slip"), table["slip"].to_numpy())
    ax.set_ylabel("friction μ")
    ax.legend(frameon=False)
    return lines


def draw_disks(ax: Axes, run: Run, frame: Frame) -> EllipseCollection:
    """Draws disks in light grey, those of the walls darker, and labels the axes.

    Returns:
        The disks; those that cross the periodic boundary are drawn at both sides.
    """
    disks = _disks(ax, frame, np.ones(len(frame.radius), dtype=bool))
    wall = _with_images(frame, frame.body) > 0
    disks.set(
        facecolors=np.where(wall, WALL, GRAIN).tolist(),
        edgecolors=EDGE,
        linewidths=0.2,
        zorder=1,
    )
    x, radius = frame.position, frame.radius
    ax.set_xlim(0, frame.box.edges[0])
    ax.set_ylim((x[:, 1] - radius).min(), (x[:, 1] + radius).max())
    ax.set_aspect("equal")
    unit = frame.units.get("position", run.units.get("length"))
    for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "y")):
        label_axis(axis, name, unit, frame.box.edges[:1])
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    return disks


def label_axis(axis: Axis, name: str, unit: str | None, values: ArrayLike) -> None:
    """Labels an axis with name and unit; the unit gets the prefix that suits the values.

    A prefix is given to units of one factor only, since that of `m2` would be squared.
    """
    sizes = np.abs(np.asarray(values, dtype=np.float64))
    greatest = float(np.max(sizes, initial=0.0, where=np.isfinite(sizes)))
    if unit is None:
        axis.set_label_text(name)
        return
    power = 3 * int(np.floor(np.log10(greatest) / 3 + 1e-9)) if greatest > 0 else 0
    if not unit.isalpha() or power not in PREFIXES:
        axis.set_label_text(f"{name} ({_readable(unit)})")
        return
    axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(axis, value, 10.0**power)))
    axis.set_label_text(f"{name} ({PREFIXES[power]}{unit})")


def _tick(axis: Axis, value: float, scale: float) -> str:
    """Returns the text of a tick, with as many decimals as all ticks of the axis need."""
    ticks = np.asarray(axis.get_majorticklocs()) / scale
    steps = np.diff(ticks)
    needed = (d for d in range(9) if np.allclose(steps, np.round(steps, d), rtol=1e-6, atol=0))
    return f"{value / scale:.{next(needed, 9)}f}"


def _readable(unit: str) -> str:
    """Returns an H5MD unit such as `N m-1` as `N m⁻¹`."""
    raised = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return " ".join(
        factor[: len(factor.rstrip("-0123456789"))]
        + factor[len(factor.rstrip("-0123456789")) :].translate(raised)
        for factor in unit.split()
    )


def _frame_of_disks(run: Run, frame: SupportsIndex | Frame) -> Frame:
    if run.dimension != 2:
        raise RunError(f"{run.path}: this figure shows disks; the run has spheres")
    return frame if isinstance(frame, Frame) else run.frame(frame)


def _with_images(frame: Frame, values: NDArray[Any]) -> NDArray[Any]:
    """Returns values of the grains, then those of the images at the right and at the left side."""
    x, radius, length = frame.position[:, 0], frame.radius, frame.box.edges[0]
    return np.concatenate([values, values[x < radius], values[x > length - radius]])


def _disks(ax: Axes, frame: Frame, which: NDArray[np.bool_]) -> EllipseCollection:
    """Adds some of the disks of a frame, with their images, to `ax`."""
    x, length = frame.position[:, :2], np.array([frame.box.edges[0], 0.0])
    count, right = len(x), int(np.sum(x[:, 0] < frame.radius))
    centres = _with_images(frame, x)
    centres[count : count + right] += length
    centres[count + right :] -= length
    shown = _with_images(frame, which)
    diameters = 2 * _with_images(frame, frame.radius)[shown]
    disks = EllipseCollection(
        diameters,
        diameters,
        np.zeros(len(diameters)),
        units="xy",
        offsets=centres[shown],
        transOffset=ax.transData,
    )
    ax.add_collection(disks)
    return disks


def _exceedance(ax: Axes, values: NDArray[np.float64], **style: Any) -> list[Line2D]:  # noqa: ANN401
    """Draws the fraction of positive values that are at least x, on logarithmic axes."""
    values, equal = np.unique(values[values > 0], return_counts=True)
    fraction = 1 - (np.cumsum(equal) - equal) / max(1, equal.sum())
    if len(values) > 2000:
        # Points even in the logarithm of the fraction look the same and make small files.
        kept = np.unique(len(values) - np.geomspace(1, len(values), 1000).astype(int))
        values, fraction = values[kept], fraction[kept]
    if "marker" not in style:
        style["drawstyle"] = "steps-pre"
    ax.set_xscale("log")
    ax.set_yscale("log")
    return ax.plot(values, fraction, linewidth=1.2, **style)


def _colours(count: int) -> list[str]:
    colours = [STICK, SLIP, THIRD, "#CC79A7", "#E69F00", "#56B4E9", "#000000"]
    return [colours[k % len(colours)] for k in range(count)]


def _figure(ax: Axes) -> Any:  # noqa: ANN401 - a Figure or a SubFigure
    return ax.figure


def table_of_units(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the columns of a table with their units, for display."""
    units = table.attrs.get("units", {})
    return pd.DataFrame({"column": list(table), "unit": [units.get(name, "") for name in table]})
