"""Files of runs, opened by the readers of H5MD."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from gshear import Run
from gshear.mdanalysis import universe

FILES = ["disks", "spheres", "box"]


@pytest.fixture(params=FILES)
def run(request: pytest.FixtureRequest, originals: Callable[[str], Path]) -> Run:
    return Run(originals(request.param), quiet=True)


def test_pyh5md_reads_grains_box_and_contacts(run: Run) -> None:
    import pyh5md

    with run, pyh5md.File(str(run.path), "r") as file:
        grains = file.particles_group("trajectory")
        names = ("position", "velocity", "image")
        position, velocity, image = (pyh5md.element(grains, name) for name in names)
        edges = pyh5md.element(grains["box"], "edges")
        contacts = file["connectivity/contacts"]
        assert file[contacts.attrs["particles_group"]] == grains
        for t, frame in enumerate(run.frames):
            for element in (position, velocity, image, edges):
                assert element.step[t] == frame.step
                assert element.time[t] == frame.time
            assert np.array_equal(position.value[t], frame.position)
            assert np.array_equal(velocity.value[t], frame.velocity)
            assert np.array_equal(image.value[t], frame.image)
            vectors = edges.value[t] if edges.value.ndim == 3 else np.diag(edges.value[t])
            assert np.array_equal(np.diagonal(vectors), frame.box.edges)
            rows = slice(*contacts["offset"][t : t + 2])
            pairs = np.stack([contacts["i"][rows], contacts["j"][rows]], axis=1)
            assert np.array_equal(pairs, frame.contacts.pairs)
        assert np.array_equal(pyh5md.element(grains, "species").value, run.frame(0).body)


def test_mdanalysis_reads_grains_box_and_contacts(run: Run) -> None:
    with run:
        u = universe(run)
        assert len(u.trajectory) == len(run.frames)
        assert np.array_equal(u.atoms.radii, run.frame(0).radius)
        assert (u.select_atoms("type free").ix == np.flatnonzero(run.frame(0).body == 0)).all()
        for ts, frame in zip(u.trajectory, run.frames, strict=True):
            assert np.array_equal(ts.positions, frame.position.astype(np.float32))
            assert np.array_equal(ts.velocities, frame.velocity.astype(np.float32))
            assert ts.time == frame.time
            assert np.array_equal(ts.data["contacts"], frame.contacts.pairs)
            assert np.allclose(ts.triclinic_dimensions, frame.box.vectors, rtol=1e-5, atol=1e-9)
            series = run.series
            row = series[series["step"] == frame.step]
            for name in ("coordination", "sliding_fraction"):
                if name in series and len(row):
                    assert ts.data[name] == row[name].item()
        u.trajectory.close()


# MDAnalysis copies the interval of frames, which ours do not have.
@pytest.mark.filterwarnings("ignore:Reader has no dt information")
@pytest.mark.parametrize("name", ["disks", "box", "box/run.h5/newtonian"])
def test_other_processes_get_the_same_frames(name: str, originals: Callable[[str], Path]) -> None:
    """A universe can be pickled, and reads the stage that it was made of."""
    scene, _, part = name.partition("/")
    with Run(originals(scene) / part, quiet=True) as run:
        u = universe(run)
        again = pickle.loads(pickle.dumps(u))  # noqa: S301
        assert len(again.trajectory) == len(run.frames) > 1
        for ts, frame in zip(again.trajectory, run.frames, strict=True):
            assert np.array_equal(ts.positions, frame.position.astype(np.float32))
            assert ts.data["step"] == frame.step
            assert np.array_equal(ts.data["contacts"], frame.contacts.pairs)
        again.trajectory.close()
        u.trajectory.close()


def test_the_box_of_a_frame_is_that_of_its_row(originals: Callable[[str], Path]) -> None:
    with Run(originals("disks"), quiet=True) as run:
        heights = run.series.set_index("step")["wall_height"]
        found = [frame.box.edges[1] == heights.get(frame.step, np.nan) for frame in run.frames]
        assert sum(found) > 10
        assert heights.nunique() > 10
    with Run(originals("box"), quiet=True) as run:
        assert {frame.box.image_offset for frame in run.frames} != {0.0}


def test_every_dataset_says_its_unit(run: Run) -> None:
    pure = {"id", "body", "species", "step", "offset", "i", "j"}
    pure |= {"sliding", "rolling", "twisting", "idle"}
    with run:
        units = run.series.attrs["units"]
        series = {f"observables/{name}/value" for name in run.series if name not in units}
        series.add("particles/trajectory/image/value")

        def look(name: str, item: h5py.HLObject) -> None:
            if not isinstance(item, h5py.Dataset) or "checksums/" in name:
                return
            unit = item.attrs.get("unit")
            has_none = name.rsplit("/", 1)[-1] in pure or name in series
            si = "units" in run.hdf5["h5md"].get("modules", {})
            assert (unit is None) == (has_none or not si), name
            assert unit is None or isinstance(unit, bytes), "a text of fixed length"

        run.hdf5.visititems(look)
        if run.dimension == 2 and run.stage == "shear":
            force = run.hdf5["connectivity/contacts/normal_force"].attrs["unit"]
            assert force == b"N m-1"
        author = run.hdf5["h5md/author"].attrs["name"]
        assert author
        assert author.dtype.kind == "S"
