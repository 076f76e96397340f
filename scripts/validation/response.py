"""Linear response of a packing: how forces and stresses change with small displacements.

Formulas are those of docs/explanation/spectrum.md (K of a state). Vectors have three components;
disks lie in the plane of x and y, and their rotations are about z. K itself is that of
gshear-reduce.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import mmread
from scipy.sparse import csc_array

from gshear import Run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Springs:
    """The contacts of a frame, as springs.

    Attributes:
        i, j: Grains of each contact, [K].
        radius: Radii of all grains, [N].
        separation: r_i - r_j, [K, 3].
        normal_force: F_n on i along n, [K].
        normal_stiffness: dF_n/ddelta, [K].
        tangential_force: F_t on i, [K, 3].
        tangential_slope: dF_t/ddelta without slip, [K, 3].
        slip_stiffness: -dF_t/dslip, [K, 3, 3].
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    radius: Array
    separation: Array
    normal_force: Array
    normal_stiffness: Array
    tangential_force: Array
    tangential_slope: Array
    slip_stiffness: Array

    @property
    def force(self) -> Array:
        """Force on i, [K, 3]."""
        return self.normal_force[:, None] * self._normal + self.tangential_force

    @property
    def _normal(self) -> Array:
        return self.separation / self._distance[:, None]

    @property
    def _distance(self) -> Array:
        length: Array = np.linalg.norm(self.separation, axis=1)
        return length

    def change(self, dr: Array, ds: Array) -> tuple[Array, Array]:
        """Changes of the force on i and of n x F_t, [K, 3] each.

        Args:
            dr: Change of r_i - r_j, [K, 3].
            ds: R_i dtheta_i + R_j dtheta_j, [K, 3].
        """
        n, force = self._normal, self.tangential_force
        along = np.sum(dr * n, axis=1)[:, None]
        aside = dr - along * n
        dn = aside / self._distance[:, None]
        slip = aside + np.cross(n, ds)
        tangential = -along * self.tangential_slope
        tangential -= np.einsum("kab,kb->ka", self.slip_stiffness, slip)
        tangential -= n * np.sum(force * dn, axis=1)[:, None]
        normal = -along * self.normal_stiffness[:, None] * n + self.normal_force[:, None] * dn
        return normal + tangential, np.cross(dn, force) + np.cross(n, tangential)

    def on_grains(self, change: tuple[Array, Array]) -> Array:
        """Sums of changes on the grains: force and torque, [N, 6]."""
        force, moment = change
        total = np.zeros((len(self.radius), 6))
        for grain, sign in ((self.i, 1.0), (self.j, -1.0)):
            np.add.at(total[:, :3], grain, sign * force)
            np.add.at(total[:, 3:], grain, -self.radius[grain][:, None] * moment)
        return total

    def relative(self, motion: Array) -> tuple[Array, Array]:
        """Dr and ds of the contacts from displacements and rotations of the grains, [N, 6]."""
        dr = motion[self.i, :3] - motion[self.j, :3]
        ds = sum(self.radius[grain][:, None] * motion[grain, 3:] for grain in (self.i, self.j))
        return dr, ds


def springs(run: Run, index: int) -> Springs:
    """The contacts of a frame of a law that the scripts know; none may slide.

    Raises:
        ValueError: Another law, or sliding contacts.
    """
    frame, contacts = run.frame(index), run.contacts(index)
    law, overlap = run.scene["contact.law"], contacts.overlap
    count, friction = len(overlap), run.scene["contact.friction"]
    if friction > 0.0 and np.any(contacts.sliding):
        raise ValueError(f"{int(np.sum(contacts.sliding))} contacts slide")
    force = contacts.force - contacts.normal_force[:, None] * contacts.normal
    slope, slip = np.zeros((count, 3)), np.zeros((count, 3, 3))
    if law == "hooke":
        normal = np.full(count, run.scene["contact.normal_stiffness"])
        tangential = np.full(count, run.scene["contact.tangential_stiffness"])
    elif law == "hertz":
        young, nu = run.scene["material.young_modulus"], run.scene["material.poisson_ratio"]
        r_i, r_j = frame.radius[contacts.i], frame.radius[contacts.j]
        root = np.sqrt(overlap * r_i * r_j / (r_i + r_j))
        normal = young / (1.0 - nu**2) * root
        tangential = 2.0 * young / ((1.0 + nu) * (2.0 - nu)) * root
        slope = force / (2.0 * overlap[:, None])
    elif law == "mindlin":
        normal = 1.5 * run.scene["contact.normal_stiffness"] * np.sqrt(overlap)
        if friction > 0.0:
            raise ValueError("the law mindlin is known here without friction only")
        tangential = np.zeros(count)
    else:
        raise ValueError(f"the law {law} is not known here")
    if friction > 0.0:
        slip = tangential[:, None, None] * np.eye(3)
    return Springs(
        contacts.i.astype(np.int64),
        contacts.j.astype(np.int64),
        frame.radius,
        contacts.separation,
        contacts.normal_force,
        normal,
        force,
        slope,
        slip,
    )


def stiffness(folder: Path, index: int) -> tuple[csc_array, Array, Array]:
    """K of a frame, the diagonal of M, and where each unknown stands in [N, 6] when flattened."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "K.mtx"
        program = os.environ.get("GSHEAR_REDUCE", "gshear-reduce")
        command = [program, "spectrum", folder, "--frame", str(index), "--count", "1"]
        command += ["--export-matrix", path, "--out", place]
        subprocess.run(command, check=True, capture_output=True, cwd=place)
        masses = mmread(path.with_suffix(".mass.mtx")).diagonal()
        with h5py.File(Path(place) / "spectrum.h5") as file:
            grain, component = file["grain"][:], file["component"][:]
        matrix = csc_array(mmread(path))
    if np.max(component) < 3:
        # Disks: the third unknown is the rotation about z.
        component = np.where(component == 2, 5, component)
    return matrix, masses, 6 * grain.astype(np.int64) + component
