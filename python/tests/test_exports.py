"""Files of `gshear-reduce export`, opened by the programs that they are made for."""

from __future__ import annotations

import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gshear import Run
from gshear.programs import find

FIELDS = {"disks": "dmin,stress,regions,contacts", "spheres": "dmin,stress,contacts"}


@pytest.fixture(params=["disks", "spheres"])
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
            assert image.pbc.tolist() == [True, run.dimension == 3, False]
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
        assert data.particles.bonds.count == len(contacts.pairs)
        force = np.asarray(data.particles.bonds["normal_force"][...])
        assert np.allclose(np.sort(force), np.sort(contacts.normal_force), rtol=1e-15)
