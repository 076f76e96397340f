"""Figures: what they draw, with which units. How they look was judged by eye."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from gshear import Run, RunError, plots


@pytest.fixture
def ax() -> Iterator[Axes]:
    """Axes; after the test the figure is rendered, in which warnings are errors."""
    figure, axes = plt.subplots(layout="constrained")
    yield axes
    figure.savefig(io.BytesIO(), format="png")
    plt.close(figure)


def test_force_network(disks: Run, ax: Axes) -> None:
    lines = plots.force_network(ax, disks, 20, width=2.0)
    contacts = disks.contacts(20)
    force = contacts.normal_force[contacts.normal_force > 0]
    segments = lines.get_segments()
    # Contacts across the seam are drawn at both sides of the box.
    length = contacts.frame.box.edges[0]
    x = contacts.frame.position[:, 0]
    across = np.abs(x[contacts.i] - x[contacts.j]) > length / 2
    assert across.sum() > 0
    assert len(segments) == len(force) + (across & (contacts.normal_force > 0)).sum()
    widths = np.asarray(lines.get_linewidth())
    np.testing.assert_allclose(widths.max(), 2.0 * force.max() / force.mean())
    np.testing.assert_allclose(np.asarray(lines.get_array()), widths / 2.0)
    lengths = [np.linalg.norm(segment[1] - segment[0]) for segment in segments]
    assert max(lengths) < 2.0 * contacts.frame.radius.max()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (µm)", "y (µm)")


def test_dmin_map(disks: Run, ax: Axes) -> None:
    drawn = plots.dmin_map(ax, disks, 20)
    frame, values = disks.frame(20), disks.dmin(20)
    shown = np.asarray(drawn.get_array())
    scale = frame.radius.mean() ** 2
    own = (values / scale)[np.isfinite(values) & (values > 0)]
    np.testing.assert_array_equal(shown[: len(own)], own)
    # The rest are images at the other side.
    assert set(shown[len(own) :]) <= set(own)
    assert drawn.norm.vmax == own.max()
    assert len(ax.figure.axes) == 2
    with pytest.raises(RunError, match="frame 0 has no D²min"):
        plots.dmin_map(ax, disks, 0)


@pytest.mark.parametrize(
    "name",
    ["disks", "spheres", "box", "disks in a box", "disks in a box/run.h5/newtonian"],
)
def test_maps_fit_together_across_the_boundaries(
    name: str, reduced: Callable[[str], Path], ax: Axes
) -> None:
    """Grains that a map shows overlap if they touch: images are where they belong."""
    folder, _, file = name.partition("/")
    with Run(reduced(folder) / file, quiet=True) as run:
        frame = run.frame(-1)
        own = np.arange(len(frame.radius))
        grains = plots.grain_map(ax, run, frame, own, colorbar=False)
        grain = np.asarray(grains.get_array()).astype(int)
        centre, radius = np.asarray(grains.get_offsets()), np.asarray(grains.get_widths()) / 2
        apart = np.asarray(np.linalg.norm(centre[:, None] - centre[None], axis=2))
        i, j = np.nonzero(np.triu(radius[:, None] + radius - apart > 1e-12 * apart.max(), 1))
        pairs = np.sort(np.stack([grain[i], grain[j]], axis=1), axis=1)
        # Grains of a wall are not in contact with each other.
        pairs = pairs[(frame.body[pairs] == 0).any(axis=1)]
        assert len(pairs) > 10
        assert set(map(tuple, pairs.tolist())) <= set(map(tuple, frame.contacts.pairs.tolist()))
        up = frame.box.gradient
        assert ax.get_ylabel().startswith("xyz"[up])
        images = np.bincount(grain) - 1
        if run.dimension == 3:
            cut = np.abs(frame.position[:, 1] - frame.box.edges[1] / 2) < frame.radius
            assert set(grain) == set(np.flatnonzero(cut))
        else:
            assert set(grain) == set(own)
        if frame.box.periodic[up]:
            assert frame.box.image_offset > 0.1 * frame.radius.min()
            low = frame.position[grain, up] < radius
            assert (images[grain[low]] > 0).all()
        # Lines of the forces join the centres of grains that the map shows.
        ends = np.array(plots.force_network(ax, run, frame).get_segments()).reshape(-1, 2)
        nearest = np.linalg.norm(ends[:, None] - centre[None], axis=2).min(axis=1)
        low, high = ax.get_xlim(), ax.get_ylim()
        inside = (ends > [low[0], high[0]]).all(axis=1) & (ends < [low[1], high[1]]).all(axis=1)
        assert inside.sum() > 10
        assert nearest[inside].max() < 1e-9 * apart.max()


def test_spheres_are_cut(spheres: Run, ax: Axes) -> None:
    frame = spheres.frame(-1)
    grain = int(frame.contacts.i[0])
    own, y = np.arange(len(frame.radius)), float(frame.position[grain, 1])
    drawn = plots.grain_map(ax, spheres, frame, own, y=y)
    row = np.flatnonzero(np.asarray(drawn.get_array()) == grain)[0]
    widths = np.asarray(drawn.get_widths())
    assert widths[row] == 2 * frame.radius[grain]
    centre = np.asarray(drawn.get_offsets())[row]
    np.testing.assert_array_equal(centre, frame.position[grain, [0, 2]])
    # The box is periodic along y.
    again = plots.grain_map(ax, spheres, frame, own, y=y + frame.box.edges[1])
    np.testing.assert_allclose(np.asarray(again.get_widths()), widths, rtol=1e-6)
    plots.dmin_map(ax, spheres, -1)


def test_stress_ratio(walls: Run, ax: Axes) -> None:
    lines = plots.stress_ratio(ax, walls, drops=2)
    np.testing.assert_array_equal(lines[0].get_ydata(), walls.series["stress_ratio"])
    for line, change in zip(lines[1:], walls.drops(2)["delta_tau_p"], strict=True):
        tau = np.asarray(line.get_ydata())
        assert tau[-1] - tau[0] == change
    assert ax.get_ylabel() == "stress ratio τ"


def test_statistics(disks: Run, ax: Axes) -> None:
    stick, slip = plots.phase_statistics(ax, disks)
    phases = disks.phases()
    for line, kind in ((stick, "stick"), (slip, "slip")):
        sizes = phases.loc[phases["kind"] == kind, "delta_tau_p"].abs().to_numpy()
        assert_exceedance(line, sizes)
    ax.clear()
    (line,) = plots.dmin_distribution(ax, disks, {"one": 20})
    values = disks.dmin(20)[disks.frame(20).body == 0] / disks.frame(20).radius.mean() ** 2
    assert_exceedance(line, values[values > 0])


def assert_exceedance(line: Line2D, values: NDArray[np.float64]) -> None:
    x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    assert set(x) == set(values)
    np.testing.assert_allclose(y, (values[None, :] >= x[:, None]).mean(axis=1), rtol=1e-12)


def test_rate_state(spheres: Run, ax: Axes) -> None:
    lines = plots.rate_state(ax, spheres)
    np.testing.assert_array_equal(lines[0].get_ydata(), spheres.rate_state()["rate-state"]["mu"])
    assert ax.get_xlabel() == "slip (mm)"


@pytest.mark.parametrize(
    ("column", "label"),
    [
        ("wall_height", "wall height (µm)"),
        ("kinetic_energy", "kinetic energy (J m⁻¹)"),
        ("coordination", "coordination"),
    ],
)
def test_units_of_series(disks: Run, ax: Axes, column: str, label: str) -> None:
    line = plots.series(ax, disks, column)
    np.testing.assert_array_equal(line.get_ydata(), disks.series[column])
    assert ax.get_ylabel() == label
    assert ax.get_xlabel() == "strain"


def test_ticks_have_the_prefix_of_the_label(ax: Axes) -> None:
    ax.set_ylim(43.25e-6, 43.38e-6)
    plots.label_axis(ax.yaxis, "height", "m", [43.38e-6])
    assert ax.get_ylabel() == "height (µm)"
    text = [ax.yaxis.get_major_formatter()(tick, 0) for tick in (43.26e-6, 43.3e-6)]
    assert text == ["43.26", "43.30"]


def test_series_of_a_box(box: Run, ax: Axes) -> None:
    """Reduced units are not named; runs without a strain are drawn against the time."""
    line = plots.series(ax, box, "shear_stress")
    assert ax.get_ylabel() == "shear stress"
    column = "strain" if box.stage == "aqs" else "time"
    assert ax.get_xlabel() == column
    np.testing.assert_array_equal(line.get_xdata(), box.series[column])
    with pytest.raises(RunError, match="a box has no stress ratio"):
        plots.stress_ratio(ax, box)


def test_colours_of_many_runs_differ() -> None:
    for count in (1, 7, 8, 30):
        colours = plots._colours(count)
        assert len({to_hex(colour) for colour in colours}) == len(colours) == count
