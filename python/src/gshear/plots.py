"""Figures in matplotlib. Every function draws into the Axes that it is given.

Colours are those of Okabe & Ito and the map viridis, which stay apart for colour-blind readers and
in grey. Lengths are drawn in the unit of the run, with the prefix that suits them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsIndex

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import EllipseCollection, LineCollection, QuadMesh
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
    y: float | None = None,
) -> LineCollection:
    """Draws contacts as lines between centres, as wide as their normal force.

    Args:
        ax: Axes to draw into.
        run: Run of disks or spheres, between walls or in a box.
        frame: Its frame, or the number of one.
        width: Width of a contact with the mean force (points). Widths are proportional to F_n.
        colorbar: Add a colour bar with F_n over its mean.
        y: Of spheres, the plane of `draw_grains`; contacts between spheres that it cuts are drawn.

    Returns:
        The lines; a contact across a periodic boundary has one at each side.
    """
    frame = _frame(run, frame)
    draw_grains(ax, run, frame, y=y)
    contacts = frame.contacts
    seen = _radii(frame, y) > 0
    bears = contacts.normal_force > 0
    mean = contacts.normal_force[bears].mean() if bears.any() else 1.0
    bears &= seen[contacts.i] & seen[contacts.j]
    relative = contacts.normal_force[bears] / mean
    end = frame.position[contacts.i[bears]]
    ends = np.stack([end, end - contacts.separation[bears]], axis=1)[..., _axes(frame)]
    rows, shifts = _images(frame, ends.min(axis=1), ends.max(axis=1))
    segments, relative = ends[rows] + shifts[:, None, :], relative[rows]
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
        _bar(ax, lines, "normal force / mean", extend="max")
    return lines


def grain_map(
    ax: Axes,
    run: Run,
    frame: SupportsIndex | Frame,
    values: ArrayLike,
    *,
    label: str = "",
    colorbar: bool = True,
    y: float | None = None,
    **style: Any,  # noqa: ANN401
) -> EllipseCollection:
    """Draws grains coloured by a value of each.

    Args:
        ax: Axes to draw into.
        run: Run of disks or spheres, between walls or in a box.
        frame: Its frame, or the number of one.
        values: [N], one of each grain, such as `frame.velocity[:, 0]`. Grains with NaN are grey.
        label: What the colour bar says.
        colorbar: Add a colour bar.
        y: Of spheres, the plane of `draw_grains`.
        **style: Of matplotlib's collection, such as `cmap` and `norm`.

    Returns:
        The coloured grains, then their images across periodic boundaries.
    """
    frame = _frame(run, frame)
    values = np.asarray(values, dtype=np.float64)
    draw_grains(ax, run, frame, y=y)
    grains, rows = _grains(ax, frame, np.isfinite(values), y)
    grains.set(**{"cmap": "viridis", "edgecolors": "none", "zorder": 2} | style)
    grains.set_array(values[rows])
    if colorbar:
        _bar(ax, grains, label)
    return grains


def dmin_map(
    ax: Axes,
    run: Run,
    frame: SupportsIndex,
    *,
    colorbar: bool = True,
    decades: float = 4.0,
    y: float | None = None,
) -> EllipseCollection:
    """Draws grains coloured by D²min between the frame before and this one, over r̄².

    Grains without D²min (rattlers of the earlier frame) are grey, which the colours leave out.

    Args:
        ax: Axes to draw into.
        run: Run of disks or spheres, between walls or in a box.
        frame: Number of the frame.
        colorbar: Add a colour bar.
        decades: Decades below the greatest value that the colours span.
        y: Of spheres, the plane of `draw_grains`.

    Returns:
        The coloured grains.
    """
    drawn = run.frame(frame)
    values = run.dmin(frame) / np.mean(drawn.radius) ** 2
    defined = np.isfinite(values) & (values > 0)
    if not defined.any():
        raise RunError(
            f"{run.path}: frame {frame} has no D²min: frame 0 has none, nor have rattlers"
        )
    greatest = float(values[defined].max())
    norm = LogNorm(greatest * 10**-decades, greatest)
    values = np.where(defined, values, np.nan)
    grains = grain_map(ax, run, drawn, values, colorbar=False, y=y, norm=norm)
    if colorbar:
        _bar(ax, grains, DMIN_LABEL, extend="min")
    return grains


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
    if "stress_ratio" not in series:
        raise RunError(f"{run.path}: a box has no stress ratio: draw `shear_stress` with `series`")
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


def series(ax: Axes, run: Run, column: str, *, against: str | None = None) -> Line2D:
    """Draws a column of the time series against another one, with units on the axes.

    By default that is the strain, or the time under Newton's equations in a box.
    """
    table = run.series
    against = against or ("strain" if "strain" in table else "time")
    (line,) = ax.plot(table[against], table[column], color=STICK, linewidth=1.0)
    units = table.attrs["units"]
    for axis, name in ((ax.xaxis, against), (ax.yaxis, column)):
        label_axis(axis, name.replace("_", " "), units.get(name), table[name].to_numpy())
    return line


def courses(ax: Axes, sweep: Sweep, column: str, *, against: str | None = None) -> list[Line2D]:
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

    Raises:
        ValueError: There is no key.
    """
    first, *others = means.index.names
    if first is None:
        raise ValueError("these means are of one group: the runs differ in no key to draw against")
    groups = means.groupby(others, sort=True, dropna=False) if others else [((), means)]
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


def sweep_map(ax: Axes, means: pd.DataFrame, column: str, *, colorbar: bool = True) -> QuadMesh:
    """Draws a column of `Sweep.means` as a map of coloured fields, the first key along x.

    Fields have one size, whatever the spacing of the keys; those without a run are empty.

    Raises:
        ValueError: The means differ in fewer or more keys than two.
    """
    if means.index.nlevels != 2:
        keys = ", ".join(str(name) for name in means.index.names)
        raise ValueError(
            f"a map needs two keys, these means have {keys}: average over further keys with `over` "
            "of Sweep.means, draw one key with `against`"
        )
    table = means[column].unstack(0)  # noqa: PD010 - the index has both keys
    fields = ax.pcolormesh(np.ma.masked_invalid(table.to_numpy(dtype=np.float64)), cmap="viridis")
    for axis, labels in ((ax.xaxis, table.columns), (ax.yaxis, table.index)):
        axis.set_ticks(np.arange(len(labels)) + 0.5, [str(value) for value in labels])
        axis.set_label_text(str(labels.name))
    if colorbar:
        _bar(ax, fields, column.replace("_", " "))
    return fields


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


def draw_grains(ax: Axes, run: Run, frame: Frame, *, y: float | None = None) -> EllipseCollection:
    """Draws grains in light grey, those of the walls darker, and labels the axes.

    Spheres are shown where the plane y = `y` cuts them, by default the middle of the box, as the
    circles that it cuts out.

    Returns:
        The grains; those that cross a periodic boundary are drawn at both sides. In a sheared box
        those above and below are moved by the Lees–Edwards offset.
    """
    grains, rows = _grains(ax, frame, np.ones(len(frame.removed), dtype=bool), y)
    grains.set(
        facecolors=np.where(frame.body[rows] > 0, WALL, GRAIN).tolist(),
        edgecolors=EDGE,
        linewidths=0.2,
        zorder=1,
    )
    low, high = _window(frame)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_aspect("equal")
    unit = frame.units.get("position", run.units.get("length"))
    for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "xyz"[frame.box.gradient])):
        label_axis(axis, name, unit, high[:1])
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    return grains


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


def _frame(run: Run, frame: SupportsIndex | Frame) -> Frame:
    return frame if isinstance(frame, Frame) else run.frame(frame)


def _axes(frame: Frame) -> list[int]:
    """Returns the axes of a map: along the shear and along its gradient."""
    return [0, frame.box.gradient]


def _window(frame: Frame) -> NDArray[np.float64]:
    """Returns the least and the greatest coordinates that a map shows, [2, 2]."""
    box, axes = frame.box, _axes(frame)
    window = np.stack([np.zeros(2), box.edges[axes]])
    for k, axis in enumerate(axes):
        if not box.periodic[axis]:
            there = ~frame.removed
            x, radius = frame.position[there, axis], frame.radius[there]
            window[:, k] = (x - radius).min(), (x + radius).max()
    return window


def _radii(frame: Frame, y: float | None) -> NDArray[np.float64]:
    """Returns the radii of the circles that a map shows, [N], 0 of spheres off the plane."""
    if frame.dimension == 2:
        return np.asarray(frame.radius)
    off = np.zeros((len(frame.radius), 3))
    off[:, 1] = frame.position[:, 1] - (frame.box.edges[1] / 2 if y is None else y)
    off = frame.box.minimum_image(off)
    return np.sqrt(np.maximum(frame.radius**2 - off[:, 1] ** 2, 0.0))


def _images(
    frame: Frame, low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Finds the periodic images, within a map, of shapes from `low` to `high`, [n, 2] each.

    Returns:
        The numbers of the shapes, those in their own place first, and their shifts, [m, 2].
    """
    box, axes, window = frame.box, _axes(frame), _window(frame)
    vectors = box.vectors[np.ix_(axes, axes)]
    across, above = (range(-2, 3) if box.periodic[axis] else [0] for axis in axes)
    steps = sorted(((i, j) for i in across for j in above), key=lambda step: step != (0, 0))
    rows, shifts = [], []
    for step in steps:
        shift = step @ vectors
        seen = ((high + shift > window[0]) & (low + shift < window[1])).all(axis=1)
        if step == (0, 0):
            seen[:] = True
        rows.append(np.flatnonzero(seen))
        shifts.append(np.broadcast_to(shift, (len(rows[-1]), 2)))
    return np.concatenate(rows), np.concatenate(shifts)


def _grains(
    ax: Axes, frame: Frame, which: NDArray[np.bool_], y: float | None
) -> tuple[EllipseCollection, NDArray[np.intp]]:
    """Adds some of the grains of a frame, with their images, to `ax`; returns their rows, too.

    Grains that were removed are left out.
    """
    radius = _radii(frame, y)
    shown = np.flatnonzero(which & ~frame.removed & (radius > 0))
    x, reach = frame.position[shown][:, _axes(frame)], radius[shown, None]
    rows, shifts = _images(frame, x - reach, x + reach)
    diameters = 2 * radius[shown[rows]]
    grains = EllipseCollection(
        diameters,
        diameters,
        np.zeros(len(diameters)),
        units="xy",
        offsets=x[rows] + shifts,
        offset_transform=ax.transData,
    )
    ax.add_collection(grains)
    return grains, shown[rows]


def _bar(ax: Axes, drawn: Any, label: str, **style: Any) -> None:  # noqa: ANN401
    bar = _figure(ax).colorbar(drawn, ax=ax, shrink=0.85, pad=0.02, **style)
    bar.set_label(label)


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


def _colours(count: int) -> list[Any]:
    colours = [STICK, SLIP, THIRD, "#CC79A7", "#E69F00", "#56B4E9", "#000000"]
    if count > len(colours):
        return list(colormaps["viridis"](np.linspace(0, 0.95, count)))
    return colours[:count]


def _figure(ax: Axes) -> Any:  # noqa: ANN401 - a Figure or a SubFigure
    return ax.figure


def table_of_units(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the columns of a table with their units, for display."""
    units = table.attrs.get("units", {})
    return pd.DataFrame({"column": list(table), "unit": [units.get(name, "") for name in table]})
