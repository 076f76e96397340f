"""The linear response in scripts/validation against lattices whose moduli have closed forms."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts/validation"))

from moduli import relaxation, stress_change
from response import Springs
from scipy.sparse import csc_array

K_N, K_T, FORCE = 3.0, 1.7, 0.02


def lattice(axes: int) -> Springs:
    """One grain and its contacts with its own images: a triangular, or a simple cubic lattice."""
    if axes == 2:
        angles = np.pi / 3.0 * np.arange(3)
        r = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    else:
        r = np.eye(3)
    grain = np.zeros(3, dtype=np.int64)
    return Springs(
        grain,
        grain,
        np.array([0.5]),
        r,
        np.full(3, FORCE),
        np.full(3, K_N),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        K_T * np.broadcast_to(np.eye(3), (3, 3, 3)),
    )


def modulus(axes: int, strain: str) -> float:
    """The modulus of a lattice of unit spacing, whose grains do not move against it."""
    volume = np.sqrt(0.75) if axes == 2 else 1.0
    return float(stress_change(lattice(axes), volume, axes, strain, np.zeros((1, 6))))


def test_bulk_modulus() -> None:
    # P = sqrt(3) F/a and F/a^2, of spacing a: -V dP/dV.
    root = np.sqrt(3.0)
    assert modulus(2, "compression") == pytest.approx(root / 2.0 * (K_N + FORCE), rel=1e-14)
    assert modulus(3, "compression") == pytest.approx((K_N + 2.0 * FORCE) / 3.0, rel=1e-14)


def test_uniaxial_modulus() -> None:
    # Of the triangle from sigma = sum(y^2 F(r)/r)/V of the two contacts at 60 degrees, with
    # y^2 = 3/4: the derivative by -y of y^2 F/r is y^4 (k + F) - 2 y^2 F at r = 1, and -dV/V adds
    # sigma. Each slips by xy.
    assert modulus(3, "uniaxial") == pytest.approx(K_N, rel=1e-14)
    two = 2.0 * (9.0 / 16.0 * (K_N + FORCE) - 2.0 * 0.75 * FORCE + 3.0 / 16.0 * K_T)
    assert modulus(2, "uniaxial") == pytest.approx((two + 1.5 * FORCE) / np.sqrt(0.75), rel=1e-14)


def test_shear_modulus() -> None:
    # Of the triangle by sums over its three angles. In the cube the contacts along x and z slip by
    # half of the shear each, and F_n along z turns with n by the whole of it.
    force = np.sqrt(3.0) / 4.0 * (K_N + K_T - 3.0 * FORCE)
    assert modulus(2, "simple-shear") == pytest.approx(force, rel=1e-14)
    assert modulus(3, "simple-shear") == pytest.approx(0.5 * K_T - FORCE, rel=1e-14)


def test_grains_turn_until_no_torque_is_left() -> None:
    # Shear alone, the grain not turned: the torque of the contacts turns it by -1/2.
    net = lattice(2)
    dr = np.stack([net.separation[:, 1], np.zeros(3), np.zeros(3)], axis=1)
    torque = net.on_grains(net.change(dr, np.zeros((3, 3))))[0, 5]
    assert torque / (3.0 * K_T) == pytest.approx(-0.5, rel=1e-14)


def test_unlike_springs_in_a_row() -> None:
    # Springs 1 and 3 in turn along y, two grains in a cell of length 2 and width 1. As ln V falls
    # by 1, the row of 3/4 shortens by 1; the pressure is half of the stress along y.
    separation = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    none = np.zeros((2, 3))
    net = Springs(
        np.array([0, 0]),
        np.array([1, 1]),
        np.full(2, 0.5),
        separation,
        np.zeros(2),
        np.array([1.0, 3.0]),
        none,
        none,
        np.zeros((2, 3, 3)),
    )
    matrix = csc_array(4.0 * np.array([[1.0, -1.0], [-1.0, 1.0]]))
    motion = relaxation(net, 2, "compression", matrix, np.array([1, 7]))
    assert stress_change(net, 2.0, 2, "compression", motion) == pytest.approx(0.375, rel=1e-13)
