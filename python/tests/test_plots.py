"""Figures: what they draw, with which units. How they look was judged by eye."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
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


def test_reduced_units_are_not_named(reduced: Callable[[str], Path], ax: Axes) -> None:
    with Run(reduced("box"), quiet=True) as run:
        plots.series(ax, run, "shear_stress")
        assert ax.get_ylabel() == "shear stress"
        with pytest.raises(RunError, match="the run has spheres"):
            plots.force_network(ax, run)
