"""g(r), S(k), correlations and cells, compared with freud, closed forms and sums by hand."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import freud
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import special

from gshear import Frame, Run, analysis

from .planted import planted

Array = NDArray[np.float64]
# Threads that wait for each other take longer.
freud.parallel.set_num_threads(1)
SHEARED = ["disks without walls", "spheres without walls"]


def system_of_freud(frame: Frame) -> tuple[Any, Array]:
    """The sheared cell and the grains of a frame for freud, in units of L_x: it has floats."""
    lx, ly, lz = frame.box.edges / frame.box.edges[0]
    lean = frame.box.image_offset / frame.box.edges[frame.box.gradient]
    if frame.dimension == 2:
        box = freud.box.Box(lx, ly, 0, lean, 0, 0, is2D=True)
    else:
        box = freud.box.Box(lx, ly, lz, 0, lean, 0)
    return box, box.wrap(frame.position / frame.box.edges[0])


def at_random(dimension: int, edges: list[float], count: int, seed: int, **more: Any) -> Frame:
    """Grains at random places of a cell."""
    place = np.random.default_rng(seed).random((count, 3)) * edges
    place[:, dimension:] = 0
    grains = {
        "position": place,
        "radius": np.full(count, 0.5),
        "body": np.zeros(count, dtype=int),
        "image": np.zeros((count, 3), dtype=int),
    }
    return planted(dimension, edges, grains, **more)


def by_hand(frame: Frame, places: Array) -> Array:
    """All separations of images within two cells around, [n, n, images, 3]."""
    periodic = [range(-2, 3) if p else (0,) for p in frame.box.periodic[: frame.dimension]]
    images = np.array(list(itertools.product(*periodic))) @ frame.box.vectors[: frame.dimension]
    separations: Array = (places[None, :] - places[:, None])[:, :, None] + images
    return separations


@pytest.mark.parametrize("name", SHEARED)
def test_g_of_r_of_a_sheared_cell_is_that_of_freud(
    name: str, originals: Callable[[str], Path]
) -> None:
    with Run(originals(name)) as run:
        frame = run.frame(-2)
        assert abs(frame.box.image_offset) > 0.3 * frame.box.edges[0]
        own = analysis.g_of_r(frame, bins=40)
        r_max = float(own.r[-1] + own.r[0])
        # freud takes less than half of the cell.
        theirs = freud.density.RDF(40, r_max / frame.box.edges[0] * (1 - 1e-7))
        theirs.compute(system_of_freud(frame), reset=True)
        n, volume = len(frame.radius), frame.box.volume
        edges = np.linspace(0, r_max, 41)
        shells = np.diff(np.pi * edges**2 if run.dimension == 2 else 4 / 3 * np.pi * edges**3)
        # A pair at the border of an interval may be in the next one.
        np.testing.assert_allclose(own * shells * n**2 / volume, theirs.bin_counts, atol=2.01)
        assert own[:4].sum() == 0
        assert own.max() > 1.5
        assert own.r.attrs["units"] == "m"


@pytest.mark.parametrize("dimension", [2, 3])
def test_g_of_r_of_a_lattice(dimension: int) -> None:
    """A square or cubic lattice of spacing 1, sheared by multiples of it."""
    across = 8 if dimension == 3 else 1
    place = np.stack(np.meshgrid(range(8), range(8), range(across)), axis=-1).reshape(-1, 3) * 1.0
    grains = {"position": place, "radius": np.full(len(place), 0.5)}
    grains["body"] = np.zeros(len(place), dtype=int)
    for offset in (0.0, 3.0, -1.0):
        frame = planted(dimension, [8.0, 8.0, 8.0], grains, walls=False, offset=offset)
        g = analysis.g_of_r(frame, cutoff=1.47, bins=28)
        shell = np.diff(np.linspace(0, 1.47, 29) ** dimension)
        shell *= np.pi if dimension == 2 else 4 / 3 * np.pi
        expected = np.zeros(28)
        expected[19] = 2 * dimension
        expected[26] = 2 * dimension * (dimension - 1)
        np.testing.assert_allclose(g * shell, expected, atol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_grains_at_random_between_walls_have_g_of_1(dimension: int) -> None:
    """The part of every shell that walls cut off does not count."""
    edges = [6.0, 3.0, 1.0] if dimension == 2 else [6.0, 6.0, 3.0]
    frames = [at_random(dimension, edges, 1200, seed, walls=True) for seed in range(4)]
    g = analysis.g_of_r(frames, cutoff=2.9, bins=6)
    np.testing.assert_allclose(g, 1, atol=0.02)


def test_removed_grains_and_walls_do_not_count() -> None:
    frame = at_random(2, [9.0, 9.0, 1.0], 300, 1, walls=False)
    some = np.arange(300) < 200
    columns = {name: frame[name] for name in frame}
    fewer = {name: values[:200] for name, values in columns.items()}
    expected = analysis.g_of_r(planted(2, [9.0, 9.0, 1.0], fewer, walls=False))
    np.testing.assert_array_equal(analysis.g_of_r(frame, grains=some), expected)
    for marked in ({"removed": (~some).astype(int)}, {"body": (~some).astype(int)}):
        marked_frame = planted(2, [9.0, 9.0, 1.0], columns | marked, walls=False)
        np.testing.assert_array_equal(analysis.g_of_r(marked_frame), expected)
        found = analysis.structure_factor(marked_frame)
        np.testing.assert_allclose(found, analysis.structure_factor(frame, grains=some))


def test_what_has_no_g_of_r_is_refused() -> None:
    frame = at_random(2, [9.0, 9.0, 1.0], 3, 1, walls=False)
    with pytest.raises(ValueError, match=r"cutoff is 5 with 200 bins; give .* at most 4.5"):
        analysis.g_of_r(frame, cutoff=5)
    # The sides of a sheared cell are nearer to each other.
    leaning = at_random(2, [9.0, 9.0, 1.0], 3, 1, walls=False, offset=4.5)
    with pytest.raises(ValueError, match=r"at most 4.02"):
        analysis.g_of_r(leaning, cutoff=4.2)
    with pytest.raises(ValueError, match="there are no frames"):
        analysis.g_of_r([])
    with pytest.raises(ValueError, match="1 grains have no g"):
        analysis.g_of_r(frame, grains=np.array([True, False, False]))
    with pytest.raises(ValueError, match="give a mask of 3 booleans"):
        analysis.g_of_r(frame, grains=[0, 1])
    with pytest.raises(ValueError, match="give frames of one run"):
        analysis.g_of_r([frame, at_random(2, [9.0, 9.0, 1.0], 4, 1, walls=False)])
    with pytest.raises(ValueError, match="k_max is -1"):
        analysis.structure_factor(frame, k_max=-1)
    with pytest.raises(ValueError, match=r"no wave vectors up to k_max = 0\.1"):
        analysis.structure_factor(frame, k_max=0.1)
    with pytest.raises(ValueError, match="weights are of shape"):
        analysis.structure_factor(frame, weights=[1.0])


@pytest.mark.parametrize(("dimension", "walls"), [(2, False), (2, True), (3, True), (3, False)])
def test_s_of_k_is_the_sum_by_hand(dimension: int, walls: bool) -> None:
    """Of grains with weights, over the wave vectors of the cell, in narrow intervals."""
    offset = 0.0 if walls else 1.3
    frame = at_random(dimension, [5.0, 4.0, 3.0], 40, 2, walls=walls, offset=offset)
    weights = np.random.default_rng(3).random(40) + 0.5
    found = analysis.structure_factor(frame, k_max=4.5, bins=5000, weights=weights)
    axes = [axis for axis in range(dimension) if frame.box.periodic[axis]]
    vectors = frame.box.vectors[np.ix_(axes, range(dimension))]
    sums: dict[float, list[float]] = {}
    for order in itertools.product(range(-6, 7), repeat=len(axes)):
        k = np.linalg.lstsq(vectors, 2 * np.pi * np.array(order), rcond=None)[0]
        length = float(np.linalg.norm(k))
        if 0 < length <= 4.5:
            amplitude = (weights * np.exp(-1j * frame.position[:, :dimension] @ k)).sum()
            value = abs(amplitude) ** 2 / (weights**2).sum()
            sums.setdefault(round(length, 9), []).append(value)
    assert found.vectors.sum() == sum(map(len, sums.values()))
    mean = sum(map(sum, sums.values())) / sum(map(len, sums.values()))
    assert float((found * found.vectors).sum() / found.vectors.sum()) == pytest.approx(mean)
    first = min(sums)
    assert float(found.k[0]) == pytest.approx(first)
    assert float(found[0]) == pytest.approx(np.mean(sums[first]))


def test_a_lattice_has_its_peak_of_bragg() -> None:
    place = np.stack(np.meshgrid(range(10), range(10), [0]), axis=-1).reshape(-1, 3) * 1.0
    grains = {"position": place, "radius": np.full(100, 0.5), "body": np.zeros(100, dtype=int)}
    frame = planted(2, [10.0, 10.0, 1.0], grains, walls=False, offset=2.0)
    found = analysis.structure_factor(frame, k_max=2 * np.pi * 1.001, bins=2000)
    assert float(found[-1]) == pytest.approx(100)
    assert int(found.vectors[-1]) == 4
    np.testing.assert_allclose(found[:-1], 0, atol=1e-20)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_correlation_of_a_wave(dimension: int) -> None:
    """cos q·x at random places has J₀(qr) over all directions of a plane, sin qr/(qr) in space."""
    edges = [12.0] * 3
    frame = at_random(dimension, edges, 1500, 5, walls=False, offset=12.0 / 3)
    # A wave of the sheared cell: it is along z or y, so that no offset changes it.
    up = dimension - 1
    q = 2 * np.pi / 12 * 2
    wave = np.cos(q * frame.position[:, up])
    vectors = np.stack([wave, np.sin(q * frame.position[:, up])], axis=1)
    for values in (3 + wave, vectors):
        found = analysis.spatial_correlation(frame, values, cutoff=5.5, bins=50)
        r = found.r.to_numpy()
        expected = special.j0(q * r) if dimension == 2 else np.sinc(q * r / np.pi)
        np.testing.assert_allclose(found[8:], expected[8:], atol=0.08)
    assert int(found.pairs[-1]) > 1000


@pytest.mark.parametrize("walls", [True, False])
def test_correlations_are_sums_by_hand(walls: bool) -> None:
    frame = at_random(2, [5.0, 6.0, 1.0], 30, 6, walls=walls, offset=0.0 if walls else 2.2)
    u = np.random.default_rng(7).normal(size=(30, 2))
    u[4] = np.nan
    kept = np.arange(30) != 4
    found = analysis.spatial_correlation(frame, u, cutoff=2.2, bins=4)
    v = u[kept] - u[kept].mean(axis=0)
    r = np.linalg.norm(by_hand(frame, frame.position[kept]), axis=-1)
    products = (v @ v.T)[:, :, None] * np.ones(r.shape[2])
    for k in range(4):
        inside = (r > 0.55 * k) & (r < 0.55 * (k + 1)) & (r > 0)
        expected = products[inside].mean() / (v**2).sum(axis=1).mean()
        assert float(found[k]) == pytest.approx(expected)
        assert int(found.pairs[k]) == inside.sum() / 2
    with pytest.raises(ValueError, match="all values are equal"):
        analysis.spatial_correlation(frame, np.ones(30))
    with pytest.raises(ValueError, match="give one for each"):
        analysis.spatial_correlation(frame, np.ones(29))
    with pytest.raises(ValueError, match="0 grains have values"):
        analysis.spatial_correlation(frame, np.full(30, np.nan))


@pytest.mark.parametrize("name", [*SHEARED, "box"])
def test_cells_of_voronoi_are_those_of_freud(name: str, originals: Callable[[str], Path]) -> None:
    with Run(originals(name)) as run:
        frame = run.frame(-1)
        own = analysis.solid_fractions(frame, radical=False)
        theirs = freud.locality.Voronoi().compute(system_of_freud(frame))
        scale = frame.box.edges[0] ** run.dimension
        np.testing.assert_allclose(own.cell, theirs.volumes * scale, rtol=1e-3)
        # Sizes matter, and cells fill the sheared cell.
        radical = analysis.solid_fractions(frame)
        assert abs(radical.cell / own.cell - 1).max() > 0.01
        for found in (own, radical):
            assert float(found.cell.sum()) == pytest.approx(frame.box.volume, rel=1e-9)
        r, d = frame.radius, frame.dimension
        volume = np.pi * r**2 if d == 2 else 4 / 3 * np.pi * r**3
        np.testing.assert_allclose(radical, volume / radical.cell)


@pytest.mark.parametrize("name", SHEARED)
def test_radical_cells_hold_the_places_nearest_by_tangents(
    name: str, originals: Callable[[str], Path]
) -> None:
    """Drawn at random: a place is in the cell of the grain to which its tangent is shortest."""
    with Run(originals(name)) as run:
        frame = run.frame(-1)
        found = analysis.solid_fractions(frame)
        d, count = frame.dimension, 40_000
        place = np.zeros((count, 3))
        place[:, :d] = np.random.default_rng(8).random((count, d)) * frame.box.edges[:d]
        power = np.stack(
            [
                (frame.box.minimum_image(place - x) ** 2).sum(axis=1) - r**2
                for x, r in zip(frame.position, frame.radius, strict=True)
            ]
        )
        drawn = np.bincount(power.argmin(axis=0), minlength=len(frame.radius))
        expected = found.cell / frame.box.volume * count
        scatter = (drawn - expected) / np.sqrt(expected)
        assert float((scatter**2).mean()) == pytest.approx(1, abs=0.3)


def test_cells_in_a_row_of_unequal_disks() -> None:
    """Between two flat walls, which end the cells, and below a free surface, which has none."""
    grains = {
        "position": np.array([[1.0, 0.3, 0.0], [2.0, 0.3, 0.0]]),
        "radius": np.array([0.6, 0.4]),
        "body": np.zeros(2, dtype=int),
    }
    frame = planted(2, [2.0, 1.5, 1.0], grains, walls=True)
    # The face is where both tangents are equal: at 0.6 and 0.4 from the centres.
    for planes, expected in (
        ((True, True), [1.2 * 1.5, 0.8 * 1.5]),
        ((True, False), [np.nan] * 2),
        ((False, False), [np.nan] * 2),
    ):
        object.__setattr__(frame.box, "planes", planes)
        found = analysis.solid_fractions(frame)
        np.testing.assert_allclose(found.cell, expected, rtol=1e-12)
    object.__setattr__(frame.box, "planes", (True, True))
    own = np.pi * grains["radius"] ** 2
    np.testing.assert_allclose(analysis.solid_fractions(frame), own / [1.8, 1.2])


def test_cells_between_walls_of_grains(walls: Run) -> None:
    """Free grains have cells between those of the walls, which have none of their own."""
    frame = walls.frame(-1)
    found = analysis.solid_fractions(frame)
    free = frame.body == 0
    assert found[~free].isnull().all()
    assert found[free].notnull().mean() > 0.99
    # Free grains and their share of the wall's fill the height.
    base = frame.box.volume / frame.box.edges[frame.box.gradient]
    height = np.ptp(frame.position[free, frame.box.gradient])
    assert 0.9 < float(found.cell.sum()) / (base * height) < 1.3
    assert found.notnull().sum() > 0
    assert 0.3 < float(found.mean()) < 1


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvoro2", None)
    frame = at_random(2, [9.0, 9.0, 1.0], 3, 1, walls=False)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'gshear\[voronoi\]'"):
        analysis.solid_fractions(frame)
