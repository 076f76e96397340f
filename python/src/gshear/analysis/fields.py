"""Profiles and coarse-grained fields."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from ..frames import Frame

Array = NDArray[np.float64]

# Gauss's points on the line of a contact, over which the weight of a coarse-grained stress varies.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)


def profiles(frames: Iterable[Frame], layers: int = 20) -> pd.DataFrame:
    """Returns profiles across the height of a sample between walls, means over frames.

    Each grain, those of the walls included, counts in each layer with the part of its volume that
    lies there. The granular temperature is ⟨|v - V|²⟩/d in d dimensions, with V the profile of the
    mean velocity at the height of the grain (Campbell, Annu. Rev. Fluid Mech. 22, 57, 1990).

    Args:
        frames: Frames of one run, such as `run.frames[-100:]`.
        layers: Number of layers of equal height, from the lowest to the highest grain.

    Returns:
        A row for each layer: `height` of its middle (m), `velocity` along the shear (m/s),
        `solid_fraction` and `temperature` (m²/s²).

    Raises:
        ValueError: There are no frames, or no walls.
    """
    frames = list(frames)
    if not frames or frames[0].box.periodic[frames[0].box.gradient]:
        raise ValueError("profiles need one frame or more of a run between walls")
    axis, dimension = frames[0].box.gradient, frames[0].dimension
    heights = [frame.position[:, axis] for frame in frames]
    radius, present = frames[0].radius, [~frame.removed for frame in frames]
    low, high = (
        f([f((z + s * radius)[there]) for z, there in zip(heights, present, strict=True)])
        for f, s in ((np.min, -1), (np.max, 1))
    )
    edges = np.linspace(low, high, layers + 1)
    middles = (edges[1:] + edges[:-1]) / 2

    def volumes(z: Array) -> Array:
        """The volume of every grain in every layer, [N, layers]."""
        u = np.clip((edges - z[:, None]) / radius[:, None], -1, 1)
        if dimension == 2:
            below = radius[:, None] ** 2 * (np.arccos(-u) + u * np.sqrt(1 - u**2))
        else:
            below = np.pi * radius[:, None] ** 3 * (2 / 3 + u - u**3 / 3)
        return np.diff(below, axis=1)

    shares = [volumes(z) * there[:, None] for z, there in zip(heights, present, strict=True)]
    base = frames[0].box.edges[0] * (frames[0].box.edges[1] if dimension == 3 else 1.0)
    filled = np.sum([share.sum(axis=0) for share in shares], axis=0)
    with np.errstate(invalid="ignore"):
        mean = sum(f.velocity.T @ share for f, share in zip(frames, shares, strict=True)) / filled
        squares = np.zeros(layers)
        for frame, z, share in zip(frames, heights, shares, strict=True):
            there = ~np.isnan(mean[0])
            flow = np.stack([np.interp(z, middles[there], v[there]) for v in mean], axis=1)
            squares += ((frame.velocity - flow) ** 2).sum(axis=1) @ share
        return pd.DataFrame(
            {
                "height": middles,
                "velocity": mean[0],
                "solid_fraction": filled / (base * (edges[1] - edges[0]) * len(frames)),
                "temperature": squares / filled / dimension,
            }
        )


class Fields(NamedTuple):
    """Coarse-grained fields at points of shape […].

    Attributes:
        density: […], mass per volume (kg/m³).
        velocity: […, 3], momentum over density (m/s); NaN far from every grain.
        temperature: […], granular temperature ⟨|v - V|²⟩/d in d dimensions (m²/s²); NaN far from
            every grain.
        stress: […, 3, 3], of the contacts, Σ r ⊗ F per volume (Pa); compression is positive.
    """

    density: Array
    velocity: Array
    temperature: Array
    stress: Array


def coarse_grained(frame: Frame, points: ArrayLike, width: float) -> Fields:
    """Returns fields of a frame at points, under Gaussian weights.

    Goldhirsch, Granular Matter 12, 239 (2010): masses count with the weight φ at their centres,
    contacts with its mean along the line between the centres. The kinetic part of the stress,
    density times temperature, is not in `stress`. Needs memory for points times contacts.

        x, y = np.meshgrid(np.linspace(0, 48e-6, 40), np.linspace(0, 43e-6, 40))
        fields = analysis.coarse_grained(run.frame(-1), np.stack([x, y], axis=-1), 2e-6)
        plt.pcolormesh(x, y, fields.density)

    Args:
        frame: Grains and contacts.
        points: […, 2] for disks, […, 3] for spheres (m).
        width: Standard deviation of the weight (m), about a diameter or more, and much less than a
            period: the nearest image of a grain counts alone.
    """
    if not width > 0:
        raise ValueError(f"width is {width}; give a length above 0")
    given = np.asarray(points, dtype=np.float64)
    dimension, contacts = frame.dimension, frame.contacts
    if given.shape[-1:] != (dimension,):
        raise ValueError(f"points are {given.shape}; give {dimension} coordinates each")
    places = np.zeros((*given.shape[:-1], 1, 3))
    places[..., 0, :dimension] = given

    def weight(centres: Array) -> Array:
        r = frame.box.minimum_image(places - centres)
        scale = (2 * np.pi * width**2) ** (dimension / 2)
        phi: Array = np.exp(-(r**2).sum(axis=-1) / (2 * width**2)) / scale
        return phi

    mass = weight(frame.position) * np.where(frame.removed, 0.0, frame.mass)
    density = mass.sum(axis=-1)
    with np.errstate(invalid="ignore"):
        velocity = mass @ frame.velocity / density[..., None]
        square = mass @ (frame.velocity**2).sum(axis=1) / density
    temperature = (square - (velocity**2).sum(axis=-1)) / dimension
    r, x = contacts.separation, frame.position[contacts.i]
    on_line: Any = sum(
        w / 2 * weight(x - (1 + s) / 2 * r) for s, w in zip(NODES, WEIGHTS, strict=True)
    )
    stress = np.einsum("...k,ka,kb->...ab", on_line, r, contacts.force, optimize=True)
    return Fields(density, velocity, temperature, stress)
