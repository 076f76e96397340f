"""Displacements, local strain and D²min, compared with gshear-reduce, OVITO and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gshear import Frame, Run, analysis

from .planted import planted

Array = NDArray[np.float64]
EDGES = [12.0, 10.0, 8.0]


def moved(
    dimension: int, gradient: Array, *, walls: bool, offset: float = 0.0, noise: float = 0.0
) -> tuple[Frame, Frame, Array]:
    """Grains before and after a deformation of space, and the noise of their displacements.

    The edges of the later cell are those of the earlier one, deformed; the offset is wrapped.
    """
    count = 200
    random = np.random.default_rng(11)
    place = random.random((count, 3)) * EDGES
    place[:, dimension:] = 0
    extra = noise * random.normal(size=(count, 3))
    extra[:, dimension:] = 0
    grains = {
        "position": place,
        "radius": np.full(count, 0.5),
        "body": np.zeros(count, dtype=int),
        "image": np.zeros((count, 3), dtype=int),
    }
    earlier = planted(dimension, EDGES, grains, walls=walls, offset=offset)
    vectors = earlier.box.vectors @ gradient.T
    up = dimension - 1
    periods = int(np.rint(vectors[up, 0] / vectors[0, 0]))
    box = replace(
        earlier.box,
        edges=np.diagonal(vectors).copy(),
        image_offset=vectors[up, 0] - periods * vectors[0, 0],
        offset_periods=periods,
    )
    after = place @ gradient.T + extra
    wrapped = after if walls else box.wrap(after)
    image = np.rint((after - wrapped) @ np.linalg.inv(box.vectors)).astype(int)
    columns = grains | {"position": wrapped, "image": image}
    later = planted(dimension, EDGES, columns, walls=walls, index=1)
    later.box = box
    return earlier, later, extra


def shear(dimension: int, gamma: float) -> Array:
    gradient = np.eye(3)
    gradient[0, dimension - 1] = gamma
    return gradient


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("gamma", [0.02, 0.6, 3.7])
def test_a_sheared_cell_is_strained_alike_everywhere(dimension: int, gamma: float) -> None:
    """However many periods the images above have moved by."""
    gradient = shear(dimension, gamma) @ np.diag([1.01, 0.98, 1.0 if dimension == 2 else 0.97])
    earlier, later, _ = moved(dimension, gradient, walls=False, offset=1.7)
    # The cell cannot lean but along x.
    found = analysis.local_strain([earlier, later], rattlers="none", radius=5.0)
    f = gradient[:dimension, :dimension]
    np.testing.assert_allclose(found.gradient[0], np.broadcast_to(f, (200, *f.shape)), atol=1e-9)
    np.testing.assert_allclose(found.dmin, 0, atol=1e-15)
    strain = (f.T @ f - np.eye(dimension)) / 2
    np.testing.assert_allclose(found.strain[0, 7], strain, atol=1e-9)
    np.testing.assert_allclose(found.volumetric, np.trace(strain), atol=1e-9)
    deviator = strain - np.trace(strain) / dimension * np.eye(dimension)
    np.testing.assert_allclose(found["shear"], np.sqrt((deviator**2).sum() / 2), atol=1e-9)
    # All grains move with the cell: less the mean, nothing is left.
    rest = analysis.non_affine_displacement([earlier, later])
    np.testing.assert_allclose(rest, 0, atol=1e-12)
    u = analysis.displacement([earlier, later])[0]
    np.testing.assert_allclose(u, earlier.position @ (gradient.T - np.eye(3)), atol=1e-12)


def test_a_rotation_is_no_strain() -> None:
    angle = 0.7
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    near, _, _ = moved(2, np.eye(3), walls=True)
    columns = {name: near[name] for name in near}
    # Far from the sides of a large cell.
    middle = np.array([400.0, 400.0, 0.0])
    columns["position"] = near.position + middle
    earlier = planted(2, [1000.0, 1000.0, 1.0], columns, walls=True)
    turned = columns | {"position": near.position @ turn.T + middle}
    later = planted(2, [1000.0, 1000.0, 1.0], turned, walls=True)
    found = analysis.local_strain([earlier, later], rattlers="none")
    np.testing.assert_allclose(found.gradient[0, 3], turn[:2, :2], atol=1e-9)
    np.testing.assert_allclose(found.strain, 0, atol=1e-9)
    np.testing.assert_allclose(found["shear"], 0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "lag"),
    [
        ("disks", 7),
        ("spheres", 1),
        ("box", 2),
        ("disks in a box", 1),
        ("disks without walls", 15),
        ("spheres without walls", 15),
    ],
)
@pytest.mark.parametrize("rattlers", ["lee-hurley", "balance", "none"])
def test_dmin_is_that_of_the_program(
    name: str, lag: int, rattlers: str, reduced: Callable[[str], Path]
) -> None:
    with Run(reduced(name), quiet=True) as run:
        found = analysis.local_strain(run.frames[-lag - 1 :], lag=lag, rattlers=rattlers)
        expected = run.dmin(-1, lag=lag, rattlers=rattlers)
        assert np.isfinite(expected).sum() > 100
        np.testing.assert_allclose(found.dmin[-1], expected, rtol=1e-9)
        if lag == 15:
            # The offset has lost a period in between.
            assert run.frame(-1).box.offset_periods == 1
            assert abs(run.frame(-1).box.image_offset) < run.frame(-1).box.edges[0] / 2
        assert found.frame.item() == len(run.frames) - 1
        assert found.earlier.item() == len(run.frames) - 1 - lag


def test_local_strain_is_that_of_ovito(originals: Callable[[str], Path]) -> None:
    from ovito.data import DataCollection, Particles, SimulationCell
    from ovito.modifiers import AtomicStrainModifier
    from ovito.pipeline import Pipeline, StaticSource

    with Run(originals("spheres without walls")) as run:
        first, last = run.frame(8), run.frame(10)
        cutoff = 4 * first.radius.mean()

        def source(frame: Frame) -> Any:
            data = DataCollection()
            cell = SimulationCell(pbc=(True, True, True))
            matrix = np.zeros((3, 4))
            matrix[:, :3] = frame.box.vectors.T
            cell[...] = matrix
            data.objects.append(cell)
            particles = Particles(count=len(frame.radius))
            particles.create_property("Position", data=frame.position)
            data.objects.append(particles)
            return StaticSource(data=data)

        modifier = AtomicStrainModifier(
            cutoff=cutoff,
            output_deformation_gradients=True,
            output_strain_tensors=True,
            output_nonaffine_squared_displacements=True,
            minimum_image_convention=True,
        )
        modifier.reference = source(first)
        pipeline = Pipeline(source=source(last))
        pipeline.modifiers.append(modifier)
        theirs = pipeline.compute().particles
        own = analysis.local_strain([first, last], radius=4.0, rattlers="none")
        f = np.array(theirs["Deformation Gradient"]).reshape(-1, 3, 3).swapaxes(1, 2)
        np.testing.assert_allclose(own.gradient[0], f, atol=1e-6)
        xx, yy, zz, xy, xz, yz = np.array(theirs["Strain Tensor"]).T
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
        np.testing.assert_allclose(own.strain[0], tensor, atol=1e-6)
        np.testing.assert_allclose(own["shear"][0], theirs["Shear Strain"], atol=1e-6)
        squares = np.array(theirs["Nonaffine Squared Displacement"])
        np.testing.assert_allclose(own.dmin[0] * own.neighbours[0], squares, rtol=1e-4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_not_affine_is_the_noise(dimension: int) -> None:
    earlier, later, noise = moved(
        dimension, shear(dimension, 0.3), walls=False, offset=3.0, noise=0.1
    )
    found = analysis.non_affine_displacement([earlier, later])[0]
    np.testing.assert_allclose(found, noise - noise.mean(axis=0), atol=1e-12)
    # Between walls the best line over the height goes, too; walls have no part in the fit.
    earlier, later, noise = moved(dimension, shear(dimension, 0.3), walls=True, noise=0.1)
    earlier.body[:50] = 1
    later.position[:50] += 5.0
    found = analysis.non_affine_displacement([earlier, later])[0]
    height = earlier.position[:, dimension - 1]
    for axis in range(3):
        u = later.position[:, axis] - earlier.position[:, axis]
        line = np.polynomial.Polynomial.fit(height[50:], u[50:], 1)
        np.testing.assert_allclose(found[:, axis], u - line(height), atol=1e-12)


@pytest.mark.parametrize("name", ["box", "disks in a box"])
def test_displacements_have_the_mean_square_of_the_series(
    name: str, originals: Callable[[str], Path]
) -> None:
    with Run(originals(name) / "run.h5" / "newtonian") as run:
        frames = run.frames
        msd = run.series.set_index("step")["msd"]
        steps = [step for step in frames.step[1:] if step in msd.index]
        assert steps
        for k, step in enumerate(frames.step):
            if step in steps:
                u = analysis.displacement([frames[0], frames[k]])
                square = float((u**2).sum("axis").mean())
                assert square == pytest.approx(msd[step], rel=1e-6)


def test_neighbours_in_a_narrow_cell_count_once() -> None:
    """As the nearest of their images, though others are within the radius, too."""
    earlier, later, _ = moved(2, np.eye(3), walls=False, offset=5.0)
    found = analysis.local_strain([earlier, later], radius=24.0, rattlers="none")
    r = earlier.position[None] - earlier.position[:, None]
    images = np.array([[i, j, 0] for i in range(-3, 4) for j in range(-3, 4)]) @ earlier.box.vectors
    nearest = np.linalg.norm(r[:, :, None] + images, axis=-1).min(axis=-1)
    np.testing.assert_array_equal(found.neighbours[0], (nearest <= 12.0).sum(axis=1) - 1)


def test_removed_grains_have_no_values() -> None:
    earlier, later, _ = moved(2, shear(2, 0.1), walls=False)
    columns = {name: later[name] for name in later} | {"removed": (np.arange(200) == 9).astype(int)}
    columns["position"] = np.where((np.arange(200) == 9)[:, None], 1e9, later.position)
    box = later.box
    later = planted(2, EDGES, columns, walls=False)
    later.box = box
    found = analysis.local_strain([earlier, later], rattlers="none")
    others = np.arange(200) != 9
    assert np.isnan(found.dmin[0, 9])
    assert int(found.neighbours[0, 9]) == 0
    np.testing.assert_allclose(found.dmin[0, others], 0, atol=1e-15)
    rest = analysis.non_affine_displacement([earlier, later])[0]
    assert np.isnan(rest[9]).all()
    np.testing.assert_allclose(rest[others], 0, atol=1e-12)


def test_neighbours_on_a_line_have_no_strain() -> None:
    place = np.array([[x, 5.0, 0.0] for x in range(10)])
    grains = {"position": place, "radius": np.full(10, 0.5), "body": np.zeros(10, dtype=int)}
    grains["image"] = np.zeros((10, 3), dtype=int)
    frame = planted(2, [10.0, 10.0, 1.0], grains, walls=True)
    found = analysis.local_strain([frame, frame], rattlers="none", radius=5.0)
    assert found.dmin.isnull().all()
    assert (found.neighbours == 4).all()


def test_a_lag_beyond_the_run_is_refused(disks: Run) -> None:
    count = len(disks.frames)
    message = rf"lag is {count} with {count} frames; give 1 to {count - 1}"
    functions = (
        analysis.local_strain,
        analysis.displacement,
        analysis.non_affine_displacement,
    )
    for function in functions:
        with pytest.raises(ValueError, match=message):
            function(disks.frames, lag=count)
        with pytest.raises(ValueError, match="lag is 0"):
            function(disks.frames, lag=0)
        with pytest.raises(ValueError, match="with 1 frames; give two frames or more"):
            function(disks.frame(0))
    with pytest.raises(ValueError, match="rattlers is 'all'; give lee-hurley"):
        analysis.local_strain(disks.frames, rattlers="all")
    with pytest.raises(ValueError, match="radius is 0"):
        analysis.local_strain(disks.frames, radius=0)
    assert analysis.displacement(disks.frames, lag=count - 1).sizes["frame"] == 1


def test_participation_ratios() -> None:
    vectors = np.zeros((3, 8, 2))
    vectors[0] = [3.0, 4.0]
    vectors[1, 5] = [0.0, 2.0]
    vectors[2, :4] = [1.0, 0.0]
    found = analysis.participation_ratio(vectors)
    np.testing.assert_allclose(found, [1, 1 / 8, 1 / 2])
    np.testing.assert_allclose(analysis.participation_ratio(1j * vectors), found)
    # Grains that are no part of the problem do not count.
    vectors[:, 7] = np.nan
    np.testing.assert_allclose(analysis.participation_ratio(vectors), [1, 1 / 7, 4 / 7])
    with pytest.raises(ValueError, match="grains, components"):
        analysis.participation_ratio(np.zeros(3))


def test_modes_have_the_participation_of_the_table(box: Run, disks: Run) -> None:
    for run in (box, disks):
        modes = run.modes(-1)
        table = run.spectrum(-1)
        found = analysis.participation_ratio(modes.vector)
        np.testing.assert_allclose(found, table["participation"], rtol=1e-9)
        np.testing.assert_allclose(modes.eigenvalue.real, table["lambda_re"])
        held = run.frame(-1).body != 0
        assert modes.vector[:, held].isnull().all()
        np.testing.assert_allclose((abs(modes.vector) ** 2).sum(["grain", "component"]), 1)
