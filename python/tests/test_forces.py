"""Forces, mobilised friction and stresses, compared with gshear-reduce and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gshear import Frame, Run, Scene, analysis
from gshear.programs import find
from gshear.programs import run as started
from gshear.run import _pair_friction

from .planted import planted


def touching(dimension: int = 2, friction: float = 0.5) -> Frame:
    """Three grains of radius 1 in a row, the first one of a wall."""
    grains = {
        "position": np.array([[1.0, 1.0, 0.0], [3.0, 1.0, 0.0], [5.0, 1.0, 0.0]]),
        "radius": np.ones(3),
        "body": np.array([1, 0, 0]),
    }
    tangential = np.array([1.0, -2.0])
    if dimension == 3:
        tangential = np.array([[0.0, 0.6, 0.8], [0.0, 0.0, -2.0]])
    return planted(
        dimension,
        [20.0, 9.0, 9.0],
        grains,
        walls=True,
        pairs=[(0, 1), (1, 2)],
        friction=friction,
        normal_force=np.array([2.0, 6.0]),
        tangential_force=tangential,
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_planted_forces_have_their_distribution(dimension: int) -> None:
    found = analysis.force_distributions(touching(dimension), bins=[0.0, 1.0, 2.0])
    # Over the means 4 and 1.5: 0.5 and 1.5, 2/3 and 4/3.
    np.testing.assert_allclose(found.normal, [0.5, 0.5])
    np.testing.assert_allclose(found.tangential, [0.5, 0.5])
    assert found.normal.attrs["mean"] == 4
    assert found.tangential.attrs["mean"] == 1.5
    assert found.normal_count.to_numpy().tolist() == [1, 1]


def test_exponential_forces_have_exponential_distributions() -> None:
    count = 100_000
    random = np.random.default_rng(1)
    pairs = [(0, 1)] * count
    grains = {"position": np.zeros((2, 3)), "radius": np.ones(2), "body": np.zeros(2, dtype=int)}
    frame = planted(
        2,
        [9.0, 9.0, 1.0],
        grains,
        walls=True,
        pairs=pairs,
        normal_force=random.exponential(3.0, count),
        tangential_force=random.normal(size=count),
    )
    found = analysis.force_distributions([frame, frame], bins=np.linspace(0, 4, 21))
    ends = np.exp(-np.linspace(0, 4, 21))
    np.testing.assert_allclose(found.normal, -np.diff(ends) / 0.2, rtol=0.05)
    # |t|/⟨|t|⟩ of a Gauss distribution.
    half = 2 / np.pi * np.exp(-(found.force.to_numpy() ** 2) / np.pi)
    np.testing.assert_allclose(found.tangential[:15], half[:15], rtol=0.05)


def test_distributions_of_a_run_hold_all_forces(walls: Run) -> None:
    found = analysis.force_distributions(walls.frames[-3:])
    width = float(found.force[1] - found.force[0])
    for name in ("normal", "tangential"):
        assert float(found[name].sum() * width) == pytest.approx(1)
        # The mean of a force over its mean is 1.
        mean = float((found[name] * found.force).sum() * width)
        assert mean == pytest.approx(1, abs=0.1)
    assert found.normal.attrs["mean_units"].startswith("N")
    frames = list(walls.frames[-3:])
    contacts = sum(
        int((frame.body[frame.contacts.pairs] == 0).any(axis=1).sum()) for frame in frames
    )
    assert int(found.normal_count.sum()) == contacts


def test_without_contacts_there_are_no_forces() -> None:
    frame = planted(
        2, [9.0, 9.0, 1.0], {"radius": np.ones(2), "body": np.zeros(2, int)}, walls=True
    )
    with pytest.raises(ValueError, match="frame 0 has no contacts, so no forces"):
        analysis.force_distributions(frame)
    grains = {"radius": np.ones(2), "body": np.zeros(2, int)}
    pulled = planted(
        2, [9.0, 9.0, 1.0], grains, walls=True, pairs=[(0, 1)], normal_force=np.array([-1.0])
    )
    with pytest.raises(ValueError, match="no pressure: ⟨F_n⟩ is -1"):
        analysis.force_distributions(pulled)
    with pytest.raises(ValueError, match="bins is 0; give one or more"):
        analysis.force_distributions(touching(), bins=0)
    smooth = planted(2, [9.0, 9.0, 1.0], grains, walls=True, pairs=[(0, 1)])
    found = analysis.force_distributions(smooth)
    assert found.tangential.isnull().all()
    assert found.normal.notnull().all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_planted_mobilisation(dimension: int) -> None:
    contacts = touching(dimension).contacts
    found = analysis.mobilisation(contacts)
    np.testing.assert_allclose(found, [1 / (0.5 * 2), 2 / (0.5 * 6)])
    assert found.j.to_numpy().tolist() == [1, 2]
    np.testing.assert_allclose(analysis.mobilisation(contacts, attraction=2.0), [0.5, 0.5])
    with pytest.raises(ValueError, match="the scene has no friction"):
        analysis.mobilisation(touching(friction=0.0).contacts)
    frame = touching()
    frame.attracts = True
    with pytest.raises(ValueError, match=r"give attraction, the F_c of every contact"):
        analysis.mobilisation(frame.contacts)


@pytest.mark.parametrize("name", ["spheres", "box", "disks without walls"])
def test_sliding_contacts_mobilise_all_friction(
    name: str, originals: Callable[[str], Path]
) -> None:
    with Run(originals(name)) as run:
        for contacts in run.contacts(slice(1, None)):
            found = analysis.mobilisation(contacts)
            pressed = found.notnull()
            assert float(found.max()) <= 1 + 1e-9
            slides = (found.sliding == 1) & pressed
            np.testing.assert_allclose(found[slides], 1, rtol=1e-9)
        assert slides.any()


def test_friction_of_several_materials() -> None:
    """Of unlike pairs the geometric mean of the like ones, if it is not given."""
    scene = Scene(
        '[[material]]\nname = "glass"\n[[material]]\nname = "steel"\n'
        '[[material]]\nname = "rubber"\n'
        "[contact]\nfriction = 0.4\n"
        'pair = [{ friction = 0.1, materials = ["steel", "steel"] }, '
        '{ friction = 0.9, materials = ["rubber", "glass"] }, '
        '{ restitution = 0.9, materials = ["rubber", "rubber"] }]\n'
    )
    expected = [[0.4, 0.2, 0.9], [0.2, 0.1, 0.2], [0.9, 0.2, 0.4]]
    np.testing.assert_allclose(_pair_friction(scene), expected)
    one = Scene("[material]\ndensity = 1.0\n[contact]\nfriction = 0.3\n")
    np.testing.assert_allclose(_pair_friction(one), [[0.3]])
    frame = touching()
    materials = {name: frame[name] for name in frame} | {"material": np.array([2, 0, 1])}
    mixed = planted(
        2,
        [20.0, 9.0, 9.0],
        materials,
        walls=True,
        pairs=[(0, 1), (1, 2)],
        normal_force=frame.contacts.normal_force,
        tangential_force=frame.contacts.tangential_force,
    )
    mixed.pair_friction = np.array(expected)
    found = analysis.mobilisation(mixed.contacts)
    np.testing.assert_allclose(found, [1 / (0.9 * 2), 2 / (0.2 * 6)])


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_stress_of_a_row(dimension: int) -> None:
    """R f/V along the row at each end; tangential forces shear the middle grain."""
    found = analysis.grain_stress(touching(dimension).contacts)
    volume = np.pi if dimension == 2 else 4 / 3 * np.pi
    np.testing.assert_allclose(found[:, 0, 0] * volume, [2, 8, 6])
    if dimension == 2:
        # t̂ = ẑ × n, with n from j to i: along -y.
        np.testing.assert_allclose(found[:, 0, 1] * volume, [0.5, -0.5, -1.0])
    np.testing.assert_allclose(found, found.transpose("grain", "along", "axis"))
    halved = analysis.grain_stress(touching(dimension).contacts, volumes=np.full(3, 2 * volume))
    np.testing.assert_allclose(2 * halved, found)
    with pytest.raises(ValueError, match="give one for each of 3 grains"):
        analysis.grain_stress(touching().contacts, volumes=[1.0])


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_grain_between_plates_has_their_pressure(dimension: int) -> None:
    """Pressed by F between two planes: σ = 2 R F/V along their normal, and F_t shears it."""
    up = dimension - 1
    shear = np.array([1.0, -1.0]) if dimension == 2 else np.array([[1.0, 0, 0], [1.0, 0, 0]])
    frame = planted(
        dimension,
        [9.0, 9.0, 9.0],
        {"position": np.ones((1, 3)), "radius": np.array([2.0]), "body": np.zeros(1, dtype=int)},
        walls=True,
        on_walls={
            "i": np.array([0, 0]),
            "wall": np.array([1, 2], dtype=np.uint8),
            "normal_force": np.array([5.0, 5.0]),
            "tangential_force": shear,
            "overlap": np.array([0.25, 0.5]),
        },
    )
    walls = frame.wall_contacts
    volume = 4 * np.pi if dimension == 2 else 32 / 3 * np.pi
    found = analysis.grain_stress(frame.contacts)[0] * volume
    assert found[up, up] == 2 * 2 * 5
    # t̂ = ẑ × n is -x at the bottom, x at the top: both forces are along -x, and cancel in a moment.
    expected = [-1, -1] if dimension == 2 else [1, 1]
    np.testing.assert_array_equal(walls.force[:, 0], expected)
    assert found[0, up] == 0
    np.testing.assert_array_equal(walls.branch[:, up], [-1.75, 1.5])
    np.testing.assert_array_equal(walls.position[:, up], [-0.75, 2.5])
    np.testing.assert_array_equal(walls.force_on_wall(2)[[0, up]], [-expected[1], 5])
    np.testing.assert_array_equal(walls.force_on_grains()[0, [0, up]], [sum(expected), 0])


@pytest.mark.parametrize(
    "name", ["disks", "spheres", "disks between plates", "spheres between plates"]
)
def test_stresses_of_grains_are_those_of_the_program(
    name: str, originals: Callable[[str], Path], tmp_path: Path
) -> None:
    out = tmp_path / "frames.npz"
    command = [str(find("gshear-reduce")), "export", str(originals(name)), "--format", "npz"]
    started([*command, "--fields", "stress,contacts", "--out", str(out)], quiet=True)
    with Run(originals(name)) as run, np.load(out) as exported:
        found = analysis.grain_stress(run.contacts(-1))
        for column, (a, b) in {"xx": (0, 0), "yy": (1, 1), "xy": (0, 1)}.items():
            names = [n for n in exported.files if n in (f"stress_{column}", "stress")]
            values = exported[names[0]][-1]
            if values.ndim > 1:
                order = ["xx", "yy", "xy"] if run.dimension == 2 else ["xx", "yy", "zz", "xy"]
                values = values[:, order.index(column)]
            scale = abs(found).max().item()
            np.testing.assert_allclose(found[:, a, b], values, atol=1e-12 * scale)
        contacts = exported["contacts"][-1]
        flat = np.bincount(run.wall_contacts(-1).i, minlength=len(contacts))
        np.testing.assert_array_equal(run.contacts(-1).coordination() + flat, contacts)


@pytest.mark.parametrize("name", ["box", "disks in a box"])
def test_grains_bear_the_stress_of_the_cell(name: str, originals: Callable[[str], Path]) -> None:
    """Σ V σ over the volume is, but for overlaps, the stress of the series."""
    with Run(originals(name)) as run:
        frame = run.frame(-1)
        phi = analysis.solid_fractions(frame)
        found = analysis.grain_stress(frame.contacts, volumes=phi.cell)
        contacts, d = frame.contacts, run.dimension
        # Arms end at the surfaces: a contact has R_i + R_j, not the distance of the centres.
        beyond = contacts.normal * contacts.overlap[:, None]
        extra = (beyond.T @ contacts.force)[:d, :d] / frame.box.volume
        mean = (found * phi.cell).sum("grain") / frame.box.volume - (extra + extra.T) / 2
        row = run.series[run.series["step"] == frame.step].iloc[0].to_dict()
        for axis in "xyz"[:d]:
            stress = row[f"stress_{axis * 2}"]
            assert float(mean.sel(axis=axis, along=axis)) == pytest.approx(stress, rel=1e-9)
        shear = float(mean.sel(axis="x", along="xyz"[d - 1]))
        assert -shear == pytest.approx(row["shear_stress"], abs=1e-3 * row["pressure"])
