#!/usr/bin/env python3
"""Shear modulus of frictionless packings, by the slope of the stress and by K; and sound.

moduli.py RUN...     (of configs/moduli-2d.toml, or of configs/pure-shear.toml in simple shear)

The prediction is that of a harmonic packing, G = (1/V) (sum of d.k.d - X.inv(K).X), with d the
affine part of each separation, k the stiffness of its contact and X the forces of the affine part.
K is the matrix that gshear-reduce exports. Sound: the lowest modes of K v = lambda M v against
G k^2/rho.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
from pathlib import Path

import h5py
import numpy as np
from scipy.io import mmread
from scipy.linalg import eigh

from gshear import Run


def matrices(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """K, the diagonal of M, and grain and component of each unknown, of the first frame."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "K.mtx"
        program = os.environ.get("GSHEAR_REDUCE", "gshear-reduce")
        command = [program, "spectrum", folder, "--frame", "0", "--count", "1"]
        command += ["--export-matrix", path, "--out", place]
        subprocess.run(command, check=True, capture_output=True, cwd=place)
        masses = mmread(path.with_suffix(".mass.mtx"))
        with h5py.File(Path(place) / "spectrum.h5") as file:
            grain, component = file["grain"][:], file["component"][:]
        return mmread(path).toarray(), masses.diagonal(), grain, component


def predict(
    run: Run, stiffness: np.ndarray, masses: np.ndarray, grain: np.ndarray, component: np.ndarray
) -> tuple[float, float, np.ndarray]:
    """Affine and full shear modulus, and the lowest eigenvalues over G k^2/rho."""
    axes = run.dimension
    frame, contacts = run.frame(0), run.contacts(0)
    separation = contacts.separation[:, :axes]
    distance = np.linalg.norm(separation, axis=1)
    n = separation / distance[:, None]
    force = contacts.normal_force
    law, factor = run.scene["contact.law"], run.scene["contact.normal_stiffness"]
    normal = 1.5 * factor * np.sqrt(contacts.overlap) if law == "mindlin" else factor
    # The height is the last axis; images above it move along x.
    affine = np.zeros_like(separation)
    affine[:, 0] = separation[:, axes - 1]
    along = np.sum(affine * n, axis=1)
    pull = (normal * along)[:, None] * n - (force / distance)[:, None] * (
        affine - along[:, None] * n
    )
    forces = np.zeros((len(frame.radius), axes))
    for axis in range(axes):
        np.add.at(forces[:, axis], contacts.i, pull[:, axis])
        np.add.at(forces[:, axis], contacts.j, -pull[:, axis])
    # Without friction rotations meet no force.
    moved = component < axes
    x = forces[grain[moved], component[moved]]
    k = 0.5 * (stiffness + stiffness.T)[np.ix_(moved, moved)]
    values, vectors = eigh(k)
    stiff = values > 1e-9 * values[-1]
    share = vectors[:, stiff].T @ x
    lengths = np.asarray(frame.box.edges)
    volume = float(np.prod((np.diag(lengths) if lengths.ndim == 2 else lengths)[:axes]))
    first = float(np.sum(affine * pull))
    full = (first - float(np.sum(share**2 / values[stiff]))) / volume
    of_masses = eigh(k, np.diag(masses[moved]), eigvals_only=True)
    of_masses = of_masses[of_masses > 1e-9 * of_masses[-1]]
    wave = (
        full * (2.0 * np.pi) ** 2 / volume ** (2.0 / axes) * volume / np.sum(masses[moved]) * axes
    )
    return first / volume, full, of_masses / wave


def main() -> None:
    """Prints slopes and predictions of each run, and the mean modulus."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+")
    differences = []
    for folder in parser.parse_args().runs:
        with Run(folder) as run:
            slope = np.diff(run.series.shear_stress) / np.diff(run.series.strain)
            # Slopes are those in the middle of their steps.
            at_rest = 1.5 * slope[0] - 0.5 * slope[1]
            first, full, waves = predict(run, *matrices(folder.resolve()))
            number = 4 if run.dimension == 2 else 12
            print(
                f"{folder.name}: slope {at_rest:.7g} (first step {slope[0]:.7g}); "
                f"K {full:.7g} (affine {first:.5g}); difference {at_rest / full - 1.0:.1e}; "
                f"lowest modes over G k^2/rho "
                f"{np.mean(waves[:number]):.3f} ({waves[0]:.3f} to {waves[number - 1]:.3f})"
            )
            differences.append(full)
    mean, error = np.mean(differences), np.std(differences, ddof=min(1, len(differences) - 1))
    print(f"G = {mean:.5f} ± {error / np.sqrt(len(differences)):.5f}")


if __name__ == "__main__":
    main()
