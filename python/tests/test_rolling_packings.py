"""Packings in scripts/validation/rolling_packings.py: lattices, planted contacts, closed forms."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts/validation"))

import rolling_packings as packings

SIDE, LAYERS = 9, 13
SPACING = packings.LENGTH / SIDE


def lattice() -> tuple[np.ndarray, np.ndarray]:
    """A simple cubic lattice that overlaps its six neighbours, and its first and last layer."""
    side = SPACING * np.arange(SIDE)
    x, y, z = np.meshgrid(side, side, SPACING * np.arange(LAYERS), indexing="ij")
    positions = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    layer = np.round(positions[:, 2] / SPACING)
    return positions, (layer == 0) | (layer == LAYERS - 1)


def test_isostatic_numbers() -> None:
    assert packings.isostatic(0.0, 0.0, 0.0) == 6.0
    assert packings.isostatic(1.0, 0.0, 0.0) == 4.0
    assert packings.isostatic(1.0, 1.0, 0.0) == pytest.approx(2.4, rel=1e-15)
    assert packings.isostatic(1.0, 0.0, 1.0) == 3.0
    assert packings.isostatic(1.0, 1.0, 1.0) == 2.0


def test_lattice_has_its_fraction_and_coordination() -> None:
    positions, walls = lattice()
    velocities = np.tile([0.0, 3.0, 4.0], (len(positions), 1))
    measured = packings.measure(positions, velocities, walls, (1.0, 1.0, 0.0))
    phi, z, z_held, rattlers, constraints, kinetic = measured
    # The middle half is six layers high.
    assert phi == pytest.approx(np.pi / 6.0 / SPACING**3, rel=1e-12)
    assert (z, z_held, rattlers) == (6.0, 6.0, 0.0)
    free, within, between = LAYERS - 2, 2 * (LAYERS - 2), LAYERS - 1
    layer = SIDE**2
    assert constraints == pytest.approx(
        5 * layer * (within + between) / (6 * layer * free + 1), rel=1e-15
    )
    assert kinetic == pytest.approx(12.5, rel=1e-15)


@pytest.mark.parametrize(
    ("coefficients", "constraints"),
    # By sliding friction alone each of the eleven may spin.
    [((1.0, 0.0, 0.0), 36 / 56), ((1.0, 1.0, 0.0), 60 / 67), ((1.0, 1.0, 1.0), 72 / 67)],
)
def test_constraints_of_a_column(coefficients: packings.Coefficients, constraints: float) -> None:
    positions = np.zeros((LAYERS, 3))
    positions[:, 2] = SPACING * np.arange(LAYERS)
    walls = np.zeros(LAYERS, dtype=bool)
    walls[[0, -1]] = True
    measured = packings.measure(positions, np.zeros_like(positions), walls, coefficients)
    assert measured[2] == 2.0
    assert measured[4] == pytest.approx(constraints, rel=1e-15)


def test_positions_beyond_the_box_are_the_same() -> None:
    positions, walls = lattice()
    images = np.random.default_rng(1).integers(-2, 3, (len(positions), 2))
    moved = positions.copy()
    moved[:, :2] += packings.LENGTH * images
    expected = {tuple(sorted(pair)) for pair in packings.contacts(positions, walls).tolist()}
    assert {tuple(sorted(pair)) for pair in packings.contacts(moved, walls).tolist()} == expected


def test_rattlers_are_removed_until_there_are_none() -> None:
    # A chain from wall to wall with a tail of two, and a pair apart.
    pairs = np.array([[0, 1], [1, 2], [2, 3], [1, 4], [4, 5], [6, 7]])
    walls = np.zeros(8, dtype=bool)
    walls[[0, 3]] = True
    assert packings.held(8, pairs, walls, 2).tolist() == [True] * 4 + [False] * 4
    assert packings.held(8, pairs, walls, 3).tolist() == walls.tolist()


def test_dilute_states_have_no_contacts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packings, "GRAINS", 150)
    positions, types = packings.dilute(3)
    assert (types == 1).sum() == 150
    assert len(packings.contacts(positions, types != 1)) == 0
    again, _ = packings.dilute(3)
    assert (positions == again).all()


def test_data_files_keep_every_bit(tmp_path: Path) -> None:
    positions = np.random.default_rng(2).random((5, 3))
    packings.write_data(tmp_path / "some.data", positions, np.array([1, 2, 3, 1, 1]), 1.5)
    rows = np.loadtxt(tmp_path / "some.data", skiprows=11)
    assert (rows[:, 4:] == positions).all()
    assert rows[:, 1].tolist() == [1, 2, 3, 1, 1]


def test_law_of_lammps() -> None:
    scene = packings.Scene(packings.SCENE.read_text())
    law = packings.lammps_variables(scene, (0.3, 0.2, 0.1))
    ours = np.sqrt(2.0) * packings.tsuji(scene["contact.restitution"])
    assert packings.tsuji(law["restitution"]) == pytest.approx(ours, rel=1e-9)
    assert [law[name] for name in ("sliding", "rolling", "twisting")] == [0.3, 0.2, 0.025]
    # Of m = d = 1: k R_r^2, and 2 eta sqrt(I k_r) with I = 7/40 and 1/20.
    assert law["ktwisting"] == pytest.approx(625.0, rel=1e-12)
    assert law["gtwisting"] == pytest.approx(0.2 * np.sqrt(625.0 / 20.0), rel=1e-12)
    assert law["grolling"] / 16.0 == pytest.approx(0.2 * np.sqrt(625.0 * 7.0 / 40.0), rel=1e-12)


def test_means_and_errors_over_seeds() -> None:
    rows = pd.DataFrame({"program": "LAMMPS", "seed": [1, 2, 3, 4], "friction": 1.0})
    rows["rolling_friction"] = rows["twisting_friction"] = 0.0
    for name in packings.MEASURED:
        rows[name] = [1.0, 2.0, 3.0, 6.0]
    (found,) = packings.summary(rows).to_dict("records")
    assert found["packings"] == 4
    assert found["z_held"] == 3.0
    # Variance 14/3 of four.
    assert found["z_held_error"] == pytest.approx(np.sqrt(14.0 / 12.0), rel=1e-14)
