"""Frames and contacts, compared with exports of gshear-reduce and with the recorded stresses."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import networkx as nx
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gshear import Box, Frame, Run, RunError, analysis, plots, simulate
from gshear.programs import find

# Sums of some hundred contacts in another order than that of the program, which rounds forces.
ROUNDING = 1e-12


def exported(run: Run, frame: int, path: Path) -> dict[str, NDArray[np.float64]]:
    """Reads grains as `gshear-reduce export` writes them for LAMMPS."""
    command = [str(find("gshear-reduce")), "export", "--format", "lammps-data"]
    command += ["--frame", str(frame), str(run.path), "--out", str(path)]
    subprocess.run(command, check=True, capture_output=True)
    lines = path.read_text().split("Atoms")[1].split("\n\n")[1].splitlines()
    table = np.array([[float(word) for word in line.split()] for line in lines])
    table = table[np.argsort(table[:, 0])]
    velocities = path.read_text().split("Velocities")
    found = {"id": table[:, 0] - 1, "type": table[:, 1], "diameter": table[:, 2]}
    found["position"] = table[:, 4:7]
    if len(velocities) > 1:
        rows = [line.split() for line in velocities[1].split("\n\n")[1].splitlines()]
        moving = np.array(rows, dtype=np.float64)
        found["velocity"] = moving[np.argsort(moving[:, 0])][:, 1:4]
    return found


@pytest.mark.parametrize("index", [0, 7, -1])
def test_a_frame_has_the_bits_of_the_export(walls: Run, index: int, tmp_path: Path) -> None:
    frame = walls.frame(index)
    other = exported(walls, frame.index, tmp_path / "frame.data")
    np.testing.assert_array_equal(frame.id, other["id"])
    np.testing.assert_array_equal(frame.body, other["type"] - 1)
    np.testing.assert_array_equal(2 * frame.radius, other["diameter"])
    np.testing.assert_array_equal(frame.position, other["position"])
    np.testing.assert_array_equal(frame.velocity, other["velocity"])
    assert frame.position.shape == frame.velocity.shape == (len(frame.id), 3)
    spins = (len(frame.id),) if walls.dimension == 2 else (len(frame.id), 3)
    assert frame.angular_velocity.shape == spins
    # Two materials would do this as well, one does.
    volume = np.pi * frame.radius**2 if walls.dimension == 2 else 4 / 3 * np.pi * frame.radius**3
    np.testing.assert_allclose(frame.mass / volume, walls.scene["material.density"], rtol=1e-14)


def test_indices_and_slices(disks: Run) -> None:
    count = len(disks.frames)
    assert count == 51
    assert disks.frame(-1).index == count - 1
    assert disks.frame(np.int64(3)).step == disks.frame(np.uint8(3)).step == disks.frames.step[3]
    assert [frame.index for frame in disks.frames[-2:]] == [49, 50]
    assert [frame.step for frame in disks.frames] == disks.frames.step.tolist()
    backwards = disks.frame(slice(4, None, -2))
    assert next(backwards).index == 4
    assert [frame.index for frame in backwards] == [2, 0]
    assert [c.frame.index for c in disks.contacts(slice(2, 4))] == [2, 3]
    for index in (count, -count - 1):
        with pytest.raises(IndexError, match=rf"no frame {index}: the run has 51 frames"):
            disks.frame(index)


@pytest.mark.parametrize("name", ["disks", "spheres", "box/run.h5", "box/run.h5/newtonian"])
def test_arrays_of_many_frames_are_those_of_each(name: str, reduced: Callable[[str], Path]) -> None:
    with Run(reduced(name.split("/")[0]) / name.partition("/")[2]) as run:
        count = len(run.frames)
        mask = np.arange(count) % 2 == 1
        some: list[Any] = [slice(None), slice(None, 1, -1), range(0, count, 2), [-1, 0, 0, 1], mask]
        for which in some:
            frames = [run.frame(int(k)) for k in np.arange(count)[which]]
            for column in (*frames[0], "unwrapped"):
                own = np.array([getattr(frame, column) for frame in frames])
                if column in ("id", "radius", "mass", "body", "species"):
                    own = own[0]
                np.testing.assert_array_equal(run.array(column, which), own)
            vectors = run.array("edges", which)
            for frame, edges in zip(frames, vectors, strict=True):
                own = edges if edges.ndim == 2 else np.diag(edges)
                np.testing.assert_array_equal(frame.box.vectors, own)
            for column in frames[0].contacts:
                of_frames = run.array(column, which)
                for frame, values in zip(frames, of_frames, strict=True):
                    np.testing.assert_array_equal(values, frame.contacts[column])
        # One number gives no axis of frames, an empty list an empty one.
        assert run.array("position", np.uint8(1)).shape == run.frame(1).position.shape
        assert run.array("overlap", -1).shape == (run.contacts(-1).count,)
        assert run.array("radius", 1).shape == run.array("radius", []).shape
        assert run.array("position", []).shape == (0, *run.frame(1).position.shape)
        assert run.array("overlap", []) == []


def test_frames_and_quantities_that_are_not_there_are_named(disks: Run) -> None:
    for frames in (51, -52, [0, 51], range(50, 53)):
        with pytest.raises(IndexError, match=r"run.h5: no frame (51|-52): the run has 51 frames"):
            disks.array("position", frames)
    with pytest.raises(IndexError, match=r"a mask of \(49,\) booleans for 51 frames"):
        disks.array("position", np.ones(49, dtype=bool))
    for wrong in ([0.0, 1.0], [[0, 1]], "first", 1.5):
        with pytest.raises(TypeError, match="give integers or a slice"):
            disks.array("position", wrong)
    with pytest.raises(RunError, match=r"no 'speed': give .*position.*normal_force.*unwrapped"):
        disks.array("speed")


def test_strains_of_frames(walls: Run) -> None:
    series, steps = walls.series.set_index("step"), walls.frames.step
    # In a protocol frames need no row of their own; the strain of the others lies between rows.
    shared = np.isin(steps, series.index)
    assert shared.sum() > 30
    for column, ours in (("strain", walls.frames.strain), ("time", walls.frames.time)):
        np.testing.assert_array_equal(series.loc[steps[shared], column], ours[shared])
    # As gshear-reduce computes it.
    walls.dmin(1)
    with h5py.File(walls.results / "reduced.h5", locking=False) as file:
        np.testing.assert_allclose(walls.frames.strain, file["dmin/strain"][:], rtol=1e-12)


def test_strains_of_frames_of_a_box(box: Run) -> None:
    expected = [0, 8e-3, 16e-3] if box.stage == "aqs" else [16e-3] * 6
    np.testing.assert_allclose(box.frames.strain, expected, rtol=1e-12)


def test_arrays_are_read_when_used(reduced: Callable[[str], Path]) -> None:
    with Run(reduced("disks")) as run:
        frame = run.frame(3)
        radius = frame.radius
        assert frame["radius"] is frame.radius
    np.testing.assert_array_equal(frame.radius, radius)
    with pytest.raises(ValueError, match="the run is closed"):
        _ = frame.position
    with pytest.raises(AttributeError, match="Frame has no column 'colour'"):
        _ = frame.colour
    assert {"position", "radius"} <= set(dir(frame))


@pytest.mark.parametrize("name", ["disks", "spheres", "box", "box/run.h5/newtonian"])
def test_contacts_overlap_across_the_seams(name: str, reduced: Callable[[str], Path]) -> None:
    run = Run(reduced(name.split("/")[0]) / name.partition("/")[2], quiet=True)
    for frame in run.frames:
        contacts = frame.contacts
        assert contacts.count == len(contacts.i) == len(contacts.overlap) > 0
        assert (contacts.i < contacts.j).all()
        distance = np.linalg.norm(contacts.separation, axis=1)
        apart = frame.radius[contacts.i] + frame.radius[contacts.j]
        rounding = 1e-14 * frame.box.edges.max()
        np.testing.assert_allclose(apart - distance, contacts.overlap, rtol=0, atol=rounding)
        # The plain difference would be wrong for some of them.
        plain = frame.position[contacts.i] - frame.position[contacts.j]
        assert (np.linalg.norm(plain, axis=1) > 1.5 * apart).any()


def frames_with_rows(run: Run) -> Iterator[Frame]:
    steps = set(run.series["step"])
    return (frame for frame in run.frames if frame.step in steps)


def force_on_top_wall(frame: Frame) -> NDArray[np.float64]:
    contacts, body = frame.contacts, frame.body
    force = contacts.force
    on_i = (body[contacts.i] == 2) & (body[contacts.j] == 0)
    on_j = (body[contacts.j] == 2) & (body[contacts.i] == 0)
    total: NDArray[np.float64] = force[on_i].sum(axis=0) - force[on_j].sum(axis=0)
    return total


def test_contact_forces_on_the_wall_are_those_of_the_series(walls: Run) -> None:
    series, up = walls.series.set_index("step"), walls.dimension - 1
    compared = 0
    for frame in frames_with_rows(walls):
        row, force = series.loc[frame.step], force_on_top_wall(frame)
        assert force[up] == pytest.approx(row["normal_force"], rel=ROUNDING)
        scale = abs(row["normal_force"]) + abs(row["shear_force"])
        assert -force[0] == pytest.approx(row["shear_force"], abs=ROUNDING * scale)
        compared += int(force[up] > 0)
    assert compared > 30


def test_flat_walls_bear_the_forces_of_the_series(plates: Run) -> None:
    series, up = plates.series.set_index("step"), plates.dimension - 1
    for frame in frames_with_rows(plates):
        row, walls = series.loc[frame.step], frame.wall_contacts
        force = walls.force_on_wall(2)
        assert force[up] == pytest.approx(row["normal_force"], rel=ROUNDING)
        scale = abs(row["normal_force"]) + abs(row["shear_force"])
        assert -force[0] == pytest.approx(row["shear_force"], abs=ROUNDING * scale)
        # Each point of contact is on one of two planes, as far apart as the box is high.
        places = [walls.position[walls.wall == wall] for wall in (1, 2)]
        assert min(map(len, places)) > 2
        low, high = (place[:, up] for place in places)
        height = frame.box.edges[up]
        assert np.ptp(low) < 1e-13 * height
        assert np.ptp(high) < 1e-13 * height
        assert high.mean() - low.mean() == pytest.approx(height, rel=1e-13)
        assert height == row["wall_height"]
        below = walls.position - frame.position[walls.i]
        assert not np.delete(below, up, axis=1).any()
        gap = frame.radius[walls.i] - np.abs(below[:, up])
        np.testing.assert_allclose(gap, walls.overlap, atol=1e-13 * height)
        ends = frame.contacts.coordination() + np.bincount(walls.i, minlength=len(frame.radius))
        assert ends.mean() == pytest.approx(row["coordination"], rel=ROUNDING)


def test_rough_walls_have_no_flat_contacts(walls: Run) -> None:
    contacts = walls.wall_contacts(-1)
    assert (contacts.count, len(contacts.force), len(contacts.wall)) == (0, 0, 0)
    assert not contacts.force_on_wall(2).any()
    assert set(contacts) == set(walls.contacts(-1)) - {"j"} | {"wall"}


def test_unwrapped_positions_follow_the_walls(walls: Run) -> None:
    slip = walls.series.set_index("step")["slip"].astype(float).to_dict()
    first = walls.frames[0]
    top, bottom = first.body == 2, first.body == 1
    last, images = first.unwrapped, 0
    for frame in frames_with_rows(walls):
        moved = frame.unwrapped - first.unwrapped
        assert moved[top, 0] == pytest.approx(slip[frame.step] - slip[first.step], abs=1e-12)
        assert np.array_equal(moved[bottom], np.zeros_like(moved[bottom]))
        assert np.abs(frame.unwrapped - last).max() < 0.25 * frame.box.edges[0]
        last = frame.unwrapped
        images += int(np.count_nonzero(frame.image))
    assert images > 0


def test_removed_grains_are_told(tmp_path: Path, walls: Run) -> None:
    assert not any(frame.removed.any() for frame in walls.frames)
    # A bottom with a hole, and above it a grain that falls.
    bottom = [(2, x + 0.5, 0.5) for x in range(10) if x not in (5, 6)]
    rows = [f"{n} {t} 1 2500 {x} {y} 0" for n, (t, x, y) in enumerate([*bottom, (1, 6, 7)], 1)]
    head = "a hole\n\n9 atoms\n2 atom types\n0 10 xlo xhi\n0 8 ylo yhi\n-1 1 zlo zhi"
    (tmp_path / "hole.data").write_text("\n".join([head, "", "Atoms # sphere", "", *rows, ""]))
    scene = """
        material.density = 2500
        contact = { law = "hooke", normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.3 }
        sample = { packing = "hole.data", boundary = "free", outside = "remove" }
        load.gravity = 9.81
        shear.protocol = [{ time = 2.0 }]
        output.frame_rows = 10
    """
    (tmp_path / "hole.toml").write_text(scene)
    assert walls.boundary == "rough walls"
    with Run(simulate(tmp_path / "hole.toml", tmp_path / "out", ranks=1, quiet=True)) as run:
        assert run.boundary == "free surface"
        assert all("removed" in frame for frame in run.frames)
        removed = [frame.removed for frame in run.frames]
        lowest = [frame.position[8, 1] for frame in run.frames]
        layers = analysis.profiles(run.frames[-1:], 4)
        held = analysis.rattlers(run.frames[-1].contacts)
        fields = analysis.coarse_grained(run.frames[-1], run.frames[-1].position[8:, :2], 0.1)
        drawn = plots.grain_map(Figure().add_subplot(), run, run.frames[-1], np.arange(9.0))
    # Only the bottom is left, in layers of a quarter of its diameter.
    assert layers["height"].to_numpy() == pytest.approx([0.125, 0.375, 0.625, 0.875])
    assert layers["solid_fraction"].mean() == pytest.approx(8 * np.pi / 4 / 10, rel=1e-12)
    assert not held.any()
    assert set(np.asarray(drawn.get_array())) == set(range(8))
    assert fields.density[0] < 1e-6
    assert not removed[0].any()
    assert removed[-1].tolist() == [False] * 8 + [True]
    # It rests where it was removed.
    after = {y for r, y in zip(removed, lowest, strict=True) if r[8]}
    assert len(after) == 1
    assert max(after) < 0


def test_coordination_is_that_of_the_series(walls: Run) -> None:
    series = walls.series.set_index("step")
    for frame in frames_with_rows(walls):
        contacts = frame.contacts.coordination()
        assert contacts.sum() == 2 * frame.contacts.count
        mean = contacts[frame.body == 0].mean()
        assert mean == pytest.approx(series.loc[frame.step, "coordination"], rel=1e-14)


def test_stress_of_the_contacts_is_that_of_the_box(box: Run) -> None:
    series = box.series.set_index("step")
    for frame in box.frames:
        contacts = frame.contacts
        stress = np.einsum("ka,kb->ab", contacts.separation, contacts.force) / frame.box.volume
        row = series.loc[frame.step]
        assert -stress[0, 2] == pytest.approx(row["shear_stress"], rel=ROUNDING)
        assert np.trace(stress) / 3 == pytest.approx(row["pressure"], rel=ROUNDING)


@pytest.mark.parametrize("kind", ["disks", "spheres"])
def test_stress_without_walls_is_of_contacts_and_velocities(
    kind: str, reduced: Callable[[str], Path]
) -> None:
    with Run(reduced(f"{kind} without walls"), quiet=True) as run:
        series, up = run.series.set_index("step"), run.dimension - 1
        assert len(run.frames) > 10
        for frame in run.frames[1:]:
            row, volume = series.loc[frame.step].to_dict(), frame.box.volume
            height = frame.box.edges[up]
            assert height == row["wall_height"]
            u = frame.velocity.copy()
            u[:, 0] -= row["slip_rate"] * frame.position[:, up] / height
            moving = np.einsum("n,na,nb->ab", frame.mass, u, u) / volume
            contacts = frame.contacts
            stress = np.einsum("ka,kb->ab", contacts.separation, contacts.force) / volume + moving
            # Rounded to the units of forces, and velocities are those predicted for the step.
            for axis, name in enumerate(["stress_xx", "stress_yy", "stress_zz"][: up + 1]):
                assert stress[axis, axis] == pytest.approx(row[name], rel=1e-9)
            assert np.trace(moving) / (up + 1) == pytest.approx(row["kinetic_pressure"], rel=1e-9)
            base = volume / height
            assert stress[up, up] * base == pytest.approx(row["normal_force"], rel=1e-3)
            assert -stress[up, 0] * base == pytest.approx(
                row["shear_force"], abs=1e-3 * row["normal_force"]
            )
        assert len(np.unique([frame.box.image_offset for frame in run.frames])) > 10


def test_grains_at_rest_feel_no_more_than_the_residual(reduced: Callable[[str], Path]) -> None:
    with Run(reduced("box")) as run:
        assert run.stage == "aqs"
        series = run.series.set_index("step")
        for frame in run.frames:
            contacts = frame.contacts
            force = np.linalg.norm(contacts.force_on_grains(), axis=1).max()
            # Both grains feel the torque -R n × F.
            torque = np.zeros(frame.position.shape)
            for grain in (contacts.i, contacts.j):
                np.add.at(torque, grain, np.cross(contacts.normal, contacts.force))
            greatest = max(force, np.linalg.norm(torque, axis=1).max())
            largest = np.abs(contacts.normal_force).max()
            residual = series.loc[frame.step, "residual"]
            assert residual < 1e-6 * largest
            assert greatest == pytest.approx(residual, abs=1e-13 * largest)


def test_the_network_as_a_graph(disks: Run) -> None:
    contacts = disks.contacts(10)
    assert contacts.pairs.shape == (contacts.count, 2)
    graph = contacts.to_networkx()
    assert isinstance(graph, nx.Graph)
    assert graph.number_of_nodes() == len(contacts.frame.id)
    degrees = [graph.degree(n) for n in range(graph.number_of_nodes())]
    assert degrees == contacts.coordination().tolist()
    i, j = contacts.pairs[5].tolist()
    assert graph.edges[i, j]["normal_force"] == contacts.normal_force[5]
    assert graph.nodes[j]["radius"] == contacts.frame.radius[j]


@pytest.mark.parametrize("offset", [0.0, 1.7, -3.9])
def test_the_nearest_image_of_all(offset: float) -> None:
    box = Box(np.array([8.0, 5.0, 6.0]), (True, True, True), gradient=2, image_offset=offset)
    random = np.random.default_rng(1)
    x = random.uniform(-20, 20, (500, 3))
    # True separations are short; images of them are what a file may give.
    short = random.uniform(-1, 1, (500, 3))
    images = random.integers(-2, 3, (500, 3))
    moved = short + images * box.edges
    moved[:, 0] += images[:, 2] * offset
    np.testing.assert_allclose(box.minimum_image(moved), short, atol=1e-13)
    wrapped = box.wrap(x)
    assert (wrapped >= 0).all()
    assert (wrapped < box.edges).all()
    np.testing.assert_allclose(box.minimum_image(wrapped - x), 0, atol=1e-12)
    assert box.wrap([-1e-30, 0, 0])[0] == 0
    assert box.volume == 240


def test_walls_have_no_images_above() -> None:
    box = Box(np.array([8.0, 5.0, 0.0]), (True, False, False), gradient=1)
    np.testing.assert_array_equal(box.minimum_image([[7.0, 7.0, 0.0]]), [[-1.0, 7.0, 0.0]])
    np.testing.assert_array_equal(box.wrap([9.0, 7.0, 0.0]), [1.0, 7.0, 0.0])
    assert box.volume == 40
