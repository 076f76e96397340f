"""Files of `gshear-reduce export`, opened by the programs that they are made for."""

from __future__ import annotations

import itertools
import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from gshear import Run
from gshear.programs import find

FIELDS = {
    "disks": "dmin,stress,regions,contacts",
    "spheres": "dmin,stress,contacts",
    "box": "dmin,stress,contacts",
    "disks in a box": "dmin,stress,contacts",
}


@pytest.fixture(params=FIELDS)
def exported(
    request: pytest.FixtureRequest, originals: Callable[[str], Path], tmp_path: Path
) -> tuple[Run, Callable[[str], Path]]:
    """A run, and a function that exports every second of its frames."""
    run = originals(request.param)

    def export(form: str) -> Path:
        path = tmp_path / f"frames.{form}"
        options = ["--frames", "..:2", "--fields", FIELDS[request.param]]
        command = [str(find("gshear-reduce")), "export", str(run), "--format", form, *options]
        subprocess.run([*command, "--out", str(path)], check=True, capture_output=True)
        return path

    return Run(run, quiet=True), export


def bounds(run: Run, t: int) -> NDArray[np.float64]:
    """The edges that exported frames have: those of the box, but the extent of the grains."""
    frame = run.frame(t)
    edges, up = frame.box.vectors, frame.box.gradient
    if not frame.box.periodic[up]:
        height = frame.position[:, up]
        edges[up, up] = (height + frame.radius).max() - (height - frame.radius).min()
    if run.dimension == 2:
        edges[2, 2] = 2 * frame.radius.max()
    return edges


def test_numpy_reads_the_arrays(exported: tuple[Run, Callable[[str], Path]]) -> None:
    run, export = exported
    with np.load(export("npz")) as arrays, run:
        frames = range(0, len(run.frames), 2)
        assert arrays["frame"].tolist() == list(frames)
        ends = arrays["contact_offset"]
        for k, t in enumerate(frames):
            frame, contacts = run.frame(t), run.contacts(t)
            assert np.array_equal(arrays["position"][k], frame.position)
            assert np.array_equal(arrays["velocity"][k], frame.velocity)
            assert np.array_equal(arrays["image"][k], frame.image)
            rows = slice(ends[k], ends[k + 1])
            assert np.array_equal(arrays["contact_pair"][rows], contacts.pairs)
            assert np.array_equal(arrays["contact_normal_force"][rows], contacts.normal_force)
            assert np.array_equal(arrays["contact_overlap"][rows], contacts.overlap)
            np.testing.assert_allclose(arrays["edges"][k], bounds(run, t), rtol=1e-14)
            # Contact stress, summed over the grains, is that of the contacts in the cell.
            axes = "xyz"[: run.dimension]
            volume = np.pi * frame.radius**2
            if run.dimension == 3:
                volume *= 4 / 3 * frame.radius
            lever = contacts.normal * frame.radius[contacts.pairs].sum(axis=1)[:, None]
            whole = np.einsum("ka,kb->ab", lever, contacts.force)
            for a, b in itertools.combinations_with_replacement(range(len(axes)), 2):
                of_grains = arrays[f"stress_{axes[a]}{axes[b]}"][k] @ volume
                both = (whole[a, b] + whole[b, a]) / 2
                assert abs(of_grains - both) <= 1e-11 * np.abs(whole).max()
        assert arrays["body"].dtype == np.uint8


def test_vtk_reads_grains_and_contacts(exported: tuple[Run, Callable[[str], Path]]) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    run, export = exported
    reader = vtkHDFReader()
    reader.SetFileName(str(export("vtkhdf")))
    reader.UpdateInformation()
    with run:
        frames = range(0, len(run.frames), 2)
        assert reader.GetNumberOfSteps() == len(frames)
        for k in [0, 1, len(frames) - 1]:
            reader.SetStep(k)
            reader.Update()
            data = reader.GetOutput()
            frame, contacts = run.frame(frames[k]), run.contacts(frames[k])
            grains = len(frame.position)
            points = vtk_to_numpy(data.GetPoints().GetData())
            assert np.array_equal(points[:grains], frame.position)
            assert data.GetNumberOfVerts() == grains
            assert data.GetNumberOfLines() == len(contacts.pairs)
            radius = vtk_to_numpy(data.GetPointData().GetArray("radius"))
            force = vtk_to_numpy(data.GetCellData().GetArray("normal_force"))
            assert np.isnan(force[:grains]).all()
            assert np.array_equal(force[grains:], contacts.normal_force)
            # Also across the periodic boundaries, where lines end at images.
            ends = vtk_to_numpy(data.GetLines().GetConnectivityArray()).reshape(-1, 2)
            assert len(points) > grains
            length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
            overlap = radius[ends].sum(axis=1) - length
            assert np.abs(overlap - contacts.overlap).max() < 1e-13 * np.abs(points).max() + 1e-16


def test_ase_reads_the_grains(exported: tuple[Run, Callable[[str], Path]]) -> None:
    import ase.io

    run, export = exported
    images = ase.io.read(export("xyz"), ":", format="extxyz")
    with run:
        frames = range(0, len(run.frames), 2)
        assert len(images) == len(frames)
        for image, t in zip(images, frames, strict=True):
            frame = run.frame(t)
            assert np.array_equal(image.positions, frame.position)
            assert np.array_equal(image.arrays["radius"], frame.radius)
            assert image.info["step"] == frame.step
            assert image.pbc.tolist() == list(frame.box.periodic)
            np.testing.assert_allclose(image.cell[:], bounds(run, t), rtol=1e-14)
        assert np.isfinite(image.arrays["dmin"]).any()


@pytest.mark.filterwarnings("ignore")
def test_ovito_reads_grains_and_contacts(exported: tuple[Run, Callable[[str], Path]]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from ovito.io import import_file
        from ovito.modifiers import LoadTrajectoryModifier
    run, export = exported
    dump = export("lammps-dump")
    pipeline = import_file(str(dump))
    with run:
        frames = range(0, len(run.frames), 2)
        assert pipeline.num_frames == len(frames)
        last = frames[-1]
        frame, contacts = run.frame(last), run.contacts(last)
        local = dump.with_name(f"{dump.stem}-contacts{dump.suffix}")
        lines = local.read_text().splitlines()
        head = next(line for line in lines if line.startswith("ITEM: ENTRIES")).split()[2:]
        names = ["Particle Identifiers.1", "Particle Identifiers.2", *head[2:]]
        # The modifier forgets them.
        image = pipeline.compute(len(frames) - 1).particles["Periodic Image"][...]
        bonds = LoadTrajectoryModifier()
        bonds.source.load(str(local), columns=names)
        pipeline.modifiers.append(bonds)
        data = pipeline.compute(len(frames) - 1)
        order = np.argsort(data.particles["Particle Identifier"][...])
        place = data.particles.positions[...][order]
        assert np.abs(place - frame.position).max() <= 1e-15 * np.abs(frame.position).max()
        assert np.array_equal(image[order], frame.image)
        # OVITO keeps radii in single precision.
        radius = data.particles["Radius"][...][order]
        assert np.allclose(radius, frame.radius, rtol=2e-7, atol=0)
        np.testing.assert_allclose(data.cell[:, :3].T, bounds(run, last), rtol=1e-12, atol=1e-18)
        assert data.particles.bonds.count == len(contacts.pairs)
        force = np.asarray(data.particles.bonds["normal_force"][...])
        assert np.allclose(np.sort(force), np.sort(contacts.normal_force), rtol=1e-15)


@pytest.fixture
def exported_walls(plates: Run, tmp_path: Path) -> Callable[[str], Path]:
    """A function that exports all frames of a run between flat walls."""

    def export(form: str) -> Path:
        path = tmp_path / f"frames.{form}"
        command = [str(find("gshear-reduce")), "export", str(plates.folder), "--format", form]
        subprocess.run([*command, "--out", str(path)], check=True, capture_output=True)
        return path

    return export


def test_numpy_reads_contacts_with_walls(
    plates: Run, exported_walls: Callable[[str], Path]
) -> None:
    with np.load(exported_walls("npz")) as arrays:
        ends = arrays["wall_contact_offset"]
        assert len(ends) == len(plates.frames) + 1
        for t, walls in enumerate(plates.wall_contacts(slice(None))):
            rows = slice(ends[t], ends[t + 1])
            assert walls.count == ends[t + 1] - ends[t] > 4
            assert np.array_equal(arrays["wall_contact_grain"][rows], walls.i)
            for name in walls:
                if name != "i":
                    assert np.array_equal(arrays[f"wall_contact_{name}"][rows], walls[name])
            height = plates.frame(t).box.edges.max()
            np.testing.assert_allclose(
                arrays["wall_contact_point"][rows], walls.position, atol=1e-15 * height
            )
            force = arrays["wall_contact_force"][rows]
            np.testing.assert_allclose(force, walls.force, rtol=1e-15)


def test_tables_have_contacts_with_walls(
    plates: Run, exported_walls: Callable[[str], Path]
) -> None:
    path = exported_walls("csv")
    table = pd.read_csv(path.with_name("frames-wall-contacts.csv"))
    for t, walls in enumerate(plates.wall_contacts(slice(None))):
        rows = table[table.frame == t]
        assert np.array_equal(rows.i, walls.i)
        assert np.array_equal(rows.wall, walls.wall)
        assert np.array_equal(rows.normal_force, walls.normal_force)
        np.testing.assert_allclose(rows[["x", "y", "z"]], walls.position, rtol=1e-14, atol=1e-18)


def test_vtk_reads_contacts_with_walls(plates: Run, exported_walls: Callable[[str], Path]) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(exported_walls("vtkhdf")))
    reader.UpdateInformation()
    reader.SetStep(1)
    reader.Update()
    data = reader.GetOutput()
    frame = plates.frame(1)
    walls, grains, between = frame.wall_contacts, len(frame.radius), frame.contacts.count
    assert data.GetNumberOfLines() == between + walls.count
    points = vtk_to_numpy(data.GetPoints().GetData())
    ends = vtk_to_numpy(data.GetLines().GetConnectivityArray()).reshape(-1, 2)[between:]
    assert np.array_equal(points[ends[:, 0]], frame.position[walls.i])
    np.testing.assert_allclose(points[ends[:, 1]], walls.position, rtol=1e-14, atol=1e-18)
    kind = vtk_to_numpy(data.GetCellData().GetArray("wall"))
    assert np.isnan(kind[:grains]).all()
    assert not kind[grains : grains + between].any()
    assert np.array_equal(kind[grains + between :], walls.wall)
    force = vtk_to_numpy(data.GetCellData().GetArray("normal_force"))
    assert np.array_equal(force[grains + between :], walls.normal_force)


@pytest.mark.filterwarnings("ignore")
def test_ovito_reads_contacts_with_walls(
    plates: Run, exported_walls: Callable[[str], Path]
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from ovito.io import import_file
    dump = exported_walls("lammps-dump")
    pipeline = import_file(str(dump.with_name(f"frames-wall-contacts{dump.suffix}")))
    assert pipeline.num_frames == len(plates.frames)
    found = pipeline.compute(len(plates.frames) - 1).particles
    walls = plates.wall_contacts(-1)
    order = np.argsort(found["Particle Identifier"][...])
    place = found.positions[...][order]
    np.testing.assert_allclose(place, walls.position, rtol=1e-14, atol=1e-18)
    assert np.array_equal(found["Particle Type"][...][order], walls.wall + 1)
    np.testing.assert_allclose(found["Force"][...][order], walls.force, rtol=1e-14)
    assert np.array_equal(found["grain"][...][order], walls.i + 1)


@pytest.mark.parametrize("name", ["disks", "box"])
def test_eigenvectors_by_grain(name: str, copy: Callable[[str], Path], tmp_path: Path) -> None:
    folder = copy(name)
    run = folder / "run.h5"
    stiffness, archive = tmp_path / "K.mtx", tmp_path / "modes.npz"
    reduce = [str(find("gshear-reduce"))]
    of_frame = ["spectrum", str(run), "--frame", "1", "--export-matrix", str(stiffness)]
    subprocess.run([*reduce, *of_frame], check=True, capture_output=True)
    modes = ["export", str(run), "--modes", "0,3", "--format", "npz", "--out", str(archive)]
    subprocess.run([*reduce, *modes], check=True, capture_output=True)
    size, rows, columns, entries = matrix(stiffness)
    _, _, _, mass = matrix(stiffness.with_suffix(".mass.mtx"))
    with h5py.File(folder / "spectrum.h5") as file, np.load(archive) as arrays:
        assert arrays["frame"].tolist() == [1]
        free = arrays["body"] == 0
        turns = [2] if file.attrs["stage"] == "shear" else [0, 1, 2]
        axes = [0, 1] if len(turns) == 1 else [0, 1, 2]
        for k in [0, 3]:
            eigenvalue = file["lambda_re"][k] + 1j * file["lambda_im"][k]
            parts = []
            for kind, of in [("displacement", axes), ("rotation", turns)]:
                re, im = (arrays[f"mode{k}_{kind}_{part}"][0] for part in ["re", "im"])
                assert not re[~free].any()
                assert not im[~free].any()
                parts.append((re + 1j * im)[free][:, of])
            # The unknowns of K: translations, then rotations, of grain after grain.
            v = np.concatenate(parts, axis=1).ravel()
            assert len(v) == size
            assert abs(np.linalg.norm(v) - 1) < 1e-12
            product = np.zeros(size, dtype=complex)
            np.add.at(product, rows, entries * v[columns])
            left = product - eigenvalue * mass * v
            assert np.linalg.norm(left) < 1e-9 * np.abs(entries).max()


def matrix(path: Path) -> tuple[int, NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Size, rows, columns and entries of a square Matrix Market file."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("%")]
    size = int(lines[0].split()[0])
    numbers = np.array([line.split() for line in lines[1:]], dtype=float)
    rows, columns = (numbers[:, :2].T - 1).astype(np.intp)
    return size, rows, columns, numbers[:, 2]


def test_modes_are_those_of_their_frame(copy: Callable[[str], Path]) -> None:
    run = copy("disks") / "run.h5"
    reduce = str(find("gshear-reduce"))

    def said(*options: str) -> tuple[int, str]:
        command = [reduce, "export", str(run), "--format", "xyz", *options]
        outcome = subprocess.run(command, check=False, capture_output=True, text=True)
        return outcome.returncode, outcome.stderr

    code, message = said("--modes", "0")
    assert code == 2
    assert "spectrum.h5" in message
    spectrum = [reduce, "spectrum", str(run), "--frame", "2", "--count", "3"]
    subprocess.run(spectrum, check=True, capture_output=True)
    code, message = said("--modes", "0", "--frames", "0..4")
    assert code == 2
    assert "frame 2" in message
    code, message = said("--modes", "99")
    assert code == 2
    assert "no eigenvector 99" in message
    # A number that is given twice counts once.
    assert said("--modes", "1,1")[0] == 0
    head = (run.parent / "frames.xyz").read_text().splitlines()[1]
    assert head.count("mode1_displacement_re") == 1
