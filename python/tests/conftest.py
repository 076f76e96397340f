"""Runs made by the real programs, once per session."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib as mpl
import pytest

from gshear import Run, simulate

mpl.use("Agg")
CHECKOUT = Path(__file__).resolve().parents[2]
SCENES = CHECKOUT / "tests" / "scenes"


@pytest.fixture(scope="session")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Returns a function that makes a run, once, and returns its folder, which nobody changes."""
    base = tmp_path_factory.mktemp("runs")
    slow: dict[str, object] = {"shear.inertial_number": 5e-3, "shear.strain": 0.1}
    slow |= {"output.frame_strain": 2e-3, "output.series_strain": 5e-4}
    protocol = (
        "[{ velocity = 3.0, distance = 2e-3 }, { velocity = 0.0, time = 2e-4 }, "
        "{ velocity = 2.0, distance = 1.5e-3 }]"
    )
    steps = [{"velocity": v, "distance": 1.5e-3} for v in (3.0, 2.0, 3.0)]
    scalars: dict[str, object] = {"analysis.scalars": True, "output.frame_strain": 0.01}
    scalars |= {"analysis.strain": 2e-3, "shear.strain": 0.04}
    flow: dict[str, object] = {"sample.grains": 120, "sample.length": "10 mm"}
    flow |= {"output.series_rows": 60, "output.frame_rows": 4, "output.temperatures": True}
    flow |= {"shear.protocol": [{"velocity": 0.5, "time": 0.03, "pressure": p} for p in (1e3, 4e3)]}
    periodic: dict[str, object] = {"shear.strain": 0.3, "sample.grains": 250}
    periodic["output.temperatures"] = True
    speeds: dict[str, object] = {"sample.grains": 150, "sample.length": "12 mm"}
    speeds |= {"shear.inertial_number": None, "shear.strain": None, "output.series_strain": None}
    speeds |= {"output.frame_strain": None, "output.series_rows": 150, "output.frame_rows": 5}
    speeds["shear.protocol"] = [{"velocity": v, "distance": "6 mm"} for v in (0.3, 0.8, 2.0, 5.0)]
    thick: dict[str, object] = {"sample.length": "5 mm", "sample.width": "5 mm"}
    plates: dict[str, object] = {"pack.tolerance": 1e-3, "shear.strain": 0.01}
    plates |= {"output.frame_strain": 2e-3, "output.series_strain": 1e-3}
    scenes: dict[str, tuple[str, int, dict[str, object]]] = {
        "disks between plates": ("plates-2d.toml", 2, plates),
        "spheres between plates": (
            "../../configs/smooth-walls-3d.toml",
            1,
            plates | {"sample.grains": 120, "sample.length": "8 mm", "sample.width": "8 mm"},
        ),
        "disks": ("crossing.toml", 2, slow),
        "other disks": ("crossing.toml", 1, slow | {"seed": 6}),
        "scalars": ("crossing.toml", 1, slow | scalars),
        "spheres": ("crossing-3d.toml", 1, {"shear.protocol": protocol}),
        "velocity steps": ("crossing-3d.toml", 1, {"shear.protocol": steps}),
        "box": ("periodic.toml", 1, {}),
        "flow": ("../../configs/mu-of-i-2d.toml", 1, flow),
        "speeds": ("../../configs/flow-2d.toml", 1, speeds),
        "disks without walls": (
            "../../configs/flow-2d.toml",
            1,
            periodic | {"sample.length": "12 mm"},
        ),
        "spheres without walls": ("../../configs/flow-volume-3d.toml", 1, periodic | thick),
        "jamming": ("../../configs/jamming-2d.toml", 1, {"sample.grains": 60}),
        "disks in a box": ("periodic.toml", 1, {"dimension": 2, "sample.solid_fraction": 0.9}),
    }

    def folder(name: str) -> Path:
        scene, ranks, values = scenes[name]
        if not (base / name).exists():
            simulate(SCENES / scene, base / name, ranks=ranks, values=values, quiet=True)
        return base / name

    return folder


@pytest.fixture
def copy(originals: Callable[[str], Path], tmp_path: Path) -> Callable[[str], Path]:
    """Returns a function that copies a run, for tests that write into its folder."""

    def folder(name: str) -> Path:
        return Path(shutil.copytree(originals(name), tmp_path / name))

    return folder


@pytest.fixture(scope="session")
def reduced(
    originals: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Path]:
    """As `originals`, with the results of gshear-reduce of earlier tests beside the run."""
    base = tmp_path_factory.mktemp("reduced")

    def folder(name: str) -> Path:
        if not (base / name).exists():
            shutil.copytree(originals(name), base / name)
        return base / name

    return folder


@pytest.fixture(params=["disks", "spheres"])
def walls(request: pytest.FixtureRequest, reduced: Callable[[str], Path]) -> Iterator[Run]:
    """A run between walls, of disks and of spheres."""
    with Run(reduced(request.param), quiet=True) as run:
        yield run


@pytest.fixture(params=["disks between plates", "spheres between plates"])
def plates(request: pytest.FixtureRequest, reduced: Callable[[str], Path]) -> Iterator[Run]:
    """A run between flat walls, of disks and of spheres."""
    with Run(reduced(request.param), quiet=True) as run:
        yield run


@pytest.fixture
def disks(reduced: Callable[[str], Path]) -> Iterator[Run]:
    with Run(reduced("disks"), quiet=True) as run:
        yield run


@pytest.fixture
def spheres(reduced: Callable[[str], Path]) -> Iterator[Run]:
    with Run(reduced("spheres"), quiet=True) as run:
        yield run


@pytest.fixture(params=["run.h5", "run.h5/newtonian"])
def box(request: pytest.FixtureRequest, reduced: Callable[[str], Path]) -> Iterator[Run]:
    """A run in a sheared periodic box: strain steps, then Newton's equations."""
    with Run(reduced("box") / request.param, quiet=True) as run:
        yield run
