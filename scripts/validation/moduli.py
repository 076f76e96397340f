#!/usr/bin/env python3
"""Shear and bulk moduli of packings, by the slope of a stress and by K; and sound.

moduli.py RUN...     (boxes in simple shear or compression; docs/validation/physics.md has the
commands)

The prediction is the linear response of the packing: the affine motion of a
small strain leaves forces X on the grains, displacements inv(K) X remove them, and both change the
stress. K is the matrix that gshear-reduce exports. No contact may slide. Without friction also the
lowest modes of K v = lambda M v against G k^2/rho.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from response import Array, Springs, springs, stiffness
from scipy.linalg import eigh
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from gshear import Run


def affine_motion(net: Springs, axes: int, strain: str) -> tuple[Array, Array]:
    """Changes of separations and surface rotations of the contacts by unit strain, [K, 3] each.

    In simple shear the grains turn as the continuum does; a uniaxial strain is along the last axis.
    """
    separation = net.separation
    dr, ds = np.zeros_like(separation), np.zeros_like(separation)
    if strain == "compression":
        dr[:, :axes] = -separation[:, :axes] / axes
    elif strain == "uniaxial":
        dr[:, axes - 1] = -separation[:, axes - 1]
    else:
        dr[:, 0] = separation[:, axes - 1]
        radii = net.radius[net.i] + net.radius[net.j]
        # Disks about z, spheres about y.
        ds[:, 4 - axes] = (0.5 if axes == 3 else -0.5) * radii
    return dr, ds


def stress_change(net: Springs, volume: float, axes: int, strain: str, motion: Array) -> float:
    """Derivative of a stress by the strain, of the affine motion and of displacements.

    Args:
        net: The contacts.
        volume: Of the box.
        axes: 2 or 3.
        strain: `simple-shear`: of -sum(r_x F_up)/V by gamma. `compression`: of the pressure by the
            decrease of ln V. `uniaxial`: of the stress along the last axis by the decrease of the
            logarithm of that length.
        motion: Displacements and rotations of the grains by unit strain, [N, 6].
    """
    (dr, ds), (more, turns) = affine_motion(net, axes, strain), net.relative(motion)
    dr = dr + more
    change, _ = net.change(dr, ds + turns)
    r, force = net.separation, net.force
    if strain == "compression":
        pressure = float(np.sum(r * force)) / (axes * volume)
        return float(np.sum(dr * force + r * change)) / (axes * volume) + pressure
    up = axes - 1
    if strain == "uniaxial":
        stress = r[:, up] * force[:, up]
        return float(np.sum(dr[:, up] * force[:, up] + r[:, up] * change[:, up] + stress)) / volume
    return -float(np.sum(dr[:, 0] * force[:, up] + r[:, 0] * change[:, up])) / volume


def relaxation(net: Springs, axes: int, strain: str, matrix: csc_array, places: Array) -> Array:
    """Displacements and rotations [N, 6] that take the forces of the affine motion away.

    Args:
        net: The contacts.
        axes: 2 or 3.
        strain: As in `stress_change`.
        matrix: K, [U, U].
        places: Where the unknowns of K stand in [N, 6] when flattened, [U].
    """
    forces = net.on_grains(net.change(*affine_motion(net, axes, strain))).ravel()[places]
    # Rotations count as the way of the surface, so that no unit makes them soft.
    scale = np.where(places % 6 < 3, 1.0, 1.0 / np.mean(net.radius))
    matrix = csc_array(matrix.multiply(scale[:, None]).multiply(scale[None, :]))
    forces = scale * forces
    # Translations, and grains without contacts, have no stiffness.
    softer = 1e-10 * abs(matrix).max() * eye_array(len(places))
    factors = splu((matrix + softer).tocsc())
    found = factors.solve(forces)
    for _ in range(10):
        found += factors.solve(forces - matrix @ found)
    motion = np.zeros(6 * len(net.radius))
    motion[places] = scale * found
    return motion.reshape(-1, 6)


def waves(matrix: Array, masses: Array, axes: int, volume: float, modulus: float) -> Array:
    """The lowest eigenvalues over those of shear waves of one wavelength."""
    values = eigh(0.5 * (matrix + matrix.T), np.diag(masses), eigvals_only=True)
    values = values[values > 1e-9 * values[-1]]
    density = np.sum(masses) / axes / volume
    return values / (modulus / density * (2.0 * np.pi) ** 2 / volume ** (2.0 / axes))


def main() -> None:
    """Prints slopes and predictions of each run, and the mean modulus."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+")
    predictions = []
    for folder in parser.parse_args().runs:
        with Run(folder) as run:
            axes, strain = run.dimension, run.scene["aqs.deformation"]
            series = run.series
            if strain == "simple-shear":
                slope = np.diff(series.shear_stress) / np.diff(series.strain)
            else:
                lengths = series[["length_x", "length_y", "length_z"][:axes]]
                slope = -np.diff(series.pressure) / np.diff(np.log(lengths.prod(axis=1)))
            # Before the two small steps a compression has reached its first pressure. Slopes are
            # those in the middle of the steps.
            base = 0 if strain == "simple-shear" else 1
            first_step, second_step = slope[base : base + 2]
            at_rest = 1.5 * first_step - 0.5 * second_step
            net, volume = springs(run, base), run.frame(base).box.volume
            matrix, masses, places = stiffness(folder.resolve(), base)
            frictionless = run.scene["contact.friction"] == 0.0
            if frictionless:
                moved = places % 6 < axes
                matrix, masses = csc_array(matrix[moved][:, moved]), masses[moved]
                places = places[moved]
            motion = relaxation(net, axes, strain, matrix, places)
            first = stress_change(net, volume, axes, strain, np.zeros_like(motion))
            full = stress_change(net, volume, axes, strain, motion)
            line = (
                f"{folder.name}, {strain}: P {series.pressure[base]:.5g}, z "
                f"{series.coordination[base]:.3f}; slope {at_rest:.7g} (first {first_step:.7g}); "
                f"K {full:.7g} (affine {first:.5g}); difference {at_rest / full - 1.0:.1e}"
            )
            if frictionless and strain == "simple-shear":
                lowest = waves(matrix.toarray(), masses, axes, volume, full)[
                    : 4 if axes == 2 else 12
                ]
                line += (
                    f"; lowest modes over G k^2/rho {np.mean(lowest):.3f} ({lowest[0]:.3f} to "
                    f"{lowest[-1]:.3f})"
                )
            print(line)
            predictions.append(full)
    mean, error = np.mean(predictions), np.std(predictions, ddof=min(1, len(predictions) - 1))
    print(f"mean {mean:.5f} ± {error / np.sqrt(len(predictions)):.5f}")


if __name__ == "__main__":
    main()
