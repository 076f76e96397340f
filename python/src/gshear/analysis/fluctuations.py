"""Temperatures of the fluctuations of a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Frame

Array = NDArray[np.float64]


class Temperatures(NamedTuple):
    """Temperatures of the free grains (J; J/m of disks).

    Attributes:
        velocities: Of the velocities, T.
        spins: Of the spins.
    """

    velocities: float
    spins: float


# The greatest number of layers of `temperatures`, and the least variance of the heights in one,
# over the square of its thickness, that determines a gradient.
MOST_LAYERS = 1000.0
LEAST_VARIANCE = 1e-12


def temperatures(frame: Frame) -> Temperatures:
    """Returns the temperatures of the fluctuations: `granular_temperature`, `spin_temperature`.

    Twice the kinetic energy of the free grains about a linear profile in each of some layers, over
    the degrees of freedom. Layers are as thick as a mean diameter, from the lowest to the highest
    centre; profiles are least squares weighted by mass (moment of inertia), and take two degrees of
    freedom of each component in a layer. A translation and a shear of the sample have none.
    """
    there = (frame.body == 0) & ~frame.removed
    height = frame.position[there, frame.box.gradient]
    mass, radius = frame.mass[there], frame.radius[there]
    low, high = height.min(), height.max()
    layers = np.clip(np.floor((high - low) / (2 * radius.mean()) + 0.5), 1.0, MOST_LAYERS)
    scaled = (height - low) * (layers / max(high - low, np.finfo(float).tiny))
    layer = np.minimum(scaled.astype(np.int64), int(layers) - 1)
    distance: Array = scaled - layer - 0.5
    count = np.bincount(layer, minlength=int(layers))

    def temperature(inertia: Array, motion: Array) -> float:
        """Of components, [n, k]."""

        def total(values: Array) -> Array:
            sums = np.bincount(layer, inertia * values, minlength=len(count))
            return np.asarray(sums, dtype=np.float64)

        with np.errstate(invalid="ignore", divide="ignore"):
            weight = total(np.ones_like(distance))
            centre = total(distance) / weight
            offset = distance - centre[layer]
            variance = total(offset**2) / weight
            inclined = (count > 1) & (variance > LEAST_VARIANCE)
            square = 0.0
            for v in motion.T:
                mean = total(v) / weight
                gradient = np.where(inclined, total(offset * v) / weight / variance, 0.0)
                about = v - mean[layer] - gradient[layer] * offset
                square += float(inertia @ about**2)
        freedom = motion.shape[1] * int((count - np.minimum(count, 1 + inclined)).sum())
        return square / freedom if freedom else float("nan")

    spins = frame.angular_velocity[there]
    velocity = frame.velocity[there, : frame.dimension]
    lever = 0.5 if frame.dimension == 2 else 0.4
    of_spins = temperature(lever * mass * radius**2, spins.reshape(len(mass), -1))
    return Temperatures(temperature(mass, velocity), of_spins)
