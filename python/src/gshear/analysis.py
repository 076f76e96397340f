"""Short formulas of the field, on arrays, series and frames.

    from gshear import Run, analysis

    with Run("out/plane-shear-2d") as run:
        tau, time = run.series["stress_ratio"], run.series["time"]
        events = analysis.avalanches(tau, time, least=1e-4)
        b, error = analysis.b_value(np.log10(events["size"]), -4)
        layers = analysis.profiles(run.frames[-100:])

Units are those of what is given; those below are of runs in SI.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from .frames import Contacts, Frame

Array = NDArray[np.float64]

# Gauss's points on the line of a contact, over which the weight of a coarse-grained stress varies.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)


def power_spectrum(
    values: ArrayLike, spacing: float = 1.0, *, segments: int = 1
) -> tuple[Array, Array]:
    """Returns frequencies and the one-sided power spectral density of a series.

    Welch's method (IEEE Trans. Audio Electroacoust. 15, 70, 1967): the mean of the spectra of
    segments that overlap by half, each less its mean and under a Hann window. The integral over the
    frequencies is the variance.

    Args:
        values: [n], evenly spaced.
        spacing: Between two values, such as the time (s) or the strain between two rows.
        segments: Number of segments; more of them give less noise and a coarser spectrum.

    Returns:
        Frequencies (1/unit of the spacing) and densities (square of the values' unit times that of
        the spacing).
    """
    x = _numbers(values)
    if segments < 1 or not spacing > 0:
        raise ValueError(f"segments is {segments}, spacing {spacing}; give 1 or more, and above 0")
    length = 2 * (len(x) // (segments + 1)) if segments > 1 else len(x)
    if length < 4:
        raise ValueError(f"{len(x)} values are too few for {segments} segments")
    parts = np.lib.stride_tricks.sliding_window_view(x, length)[:: length // 2][:segments]
    window = np.sin(np.pi * np.arange(length) / length) ** 2
    parts = (parts - parts.mean(axis=1, keepdims=True)) * window
    scale = spacing / (window**2).sum()
    power: Array = (np.abs(np.fft.rfft(parts)) ** 2).mean(axis=0) * scale
    # Negative frequencies count with the positive ones; 0 and that of Nyquist have no other.
    power[1 : (length + 1) // 2] *= 2
    return np.arange(len(power)) / (length * spacing), power


def autocorrelation(values: ArrayLike) -> Array:
    """Returns the autocorrelation of a series at lags of 0 … n - 1 rows, [n], 1 at lag 0.

    C(k) = ⟨x(t)·x(t + k)⟩ / ⟨x·x⟩ of the values less their mean over time. Each lag is averaged
    over the pairs that it has, so that the last ones are noise.

    Args:
        values: [n], or [n, …] such as velocities [n, N, 3]; products are summed over the rest.
    """
    x = _numbers(values, dimensions=None)
    x = x - x.mean(axis=0)
    n = len(x)
    # Padded by zeros, so that the ends do not meet.
    spectrum = np.abs(np.fft.rfft(x, 2 * n, axis=0)) ** 2
    sums = np.fft.irfft(spectrum.reshape(len(spectrum), -1).sum(axis=1))[:n]
    products = sums / np.arange(n, 0, -1)
    correlation: Array = products / products[0]
    return correlation


def avalanches(
    values: ArrayLike, time: ArrayLike | None = None, *, least: float = 0.0
) -> pd.DataFrame:
    """Finds the avalanches of a series, such as of a stress: stretches over which it falls.

    Args:
        values: [n].
        time: [n], times or strains of the values; by default the numbers of the rows.
        least: Avalanches smaller than this are left out.

    Returns:
        A row for each: `start` and `end` (rows of the series), `size` (fall from start to end),
        `duration`, and `waiting` (from the end of the avalanche before, NaN of the first).
    """
    x = np.asarray(values, dtype=np.float64)
    t = np.arange(len(x)) if time is None else np.asarray(time, dtype=np.float64)
    if t.shape != x.shape:
        raise ValueError(f"{x.shape} values have {t.shape} times; give one each")
    falls = np.concatenate([[False], np.diff(x) < 0, [False]])
    start, end = np.flatnonzero(np.diff(falls)).reshape(-1, 2).T
    large = x[start] - x[end] >= least
    start, end = start[large], end[large]
    table = {"start": start, "end": end, "size": x[start] - x[end], "duration": t[end] - t[start]}
    waiting = np.append(np.nan, t[start[1:]] - t[end[:-1]])[: len(start)]
    return pd.DataFrame(table | {"waiting": waiting})


def b_value(magnitudes: ArrayLike, least: float, *, step: float = 0.0) -> tuple[float, float]:
    """Returns b of log₁₀ N(≥ M) = a - b M and its standard error, by maximum likelihood.

    b = log₁₀e / (⟨M⟩ - M_c) (Aki, Bull. Earthq. Res. Inst. 43, 237, 1965) with M_c less half a
    step of rounded magnitudes (Utsu 1966); the error is that of Shi & Bolt (Bull. Seismol. Soc. Am.
    72, 1677, 1982). Sizes S with the density S^-α have b = α - 1 for M = log₁₀ S.

    Args:
        magnitudes: [n], without unit.
        least: M_c, from which on the catalogue is complete; smaller magnitudes are left out.
        step: The step to which the magnitudes are rounded.
    """
    m = np.asarray(magnitudes, dtype=np.float64)
    # A rounded magnitude that equals M_c may differ from it in the last bit.
    m = m[m >= least - 1e-9 * max(step, abs(least))]
    if len(m) < 2:
        raise ValueError(f"{len(m)} magnitudes from {least:g} on: b needs two or more")
    b = float(np.log10(np.e) / (m.mean() - (least - step / 2)))
    return b, float(np.log(10) * b**2 * m.std(ddof=1) / np.sqrt(len(m)))


def fabric(normals: ArrayLike, weights: ArrayLike | None = None) -> Array:
    """Returns the fabric tensor ⟨n ⊗ n⟩ of unit vectors, [3, 3]; its trace is 1.

    Oda, Soils Found. 22, 96 (1982). An isotropic fabric is 1/2 along x and y for disks, 1/3 along
    every axis for spheres.

    Args:
        normals: [K, 3], such as `contacts.normal`.
        weights: [K], such as normal forces; by default all contacts count the same.
    """
    n = np.asarray(normals, dtype=np.float64)
    w = np.ones(len(n)) if weights is None else np.asarray(weights, dtype=np.float64)
    tensor: Array = (n * w[:, None]).T @ n / w.sum()
    return tensor


def rattlers(contacts: Contacts, least: int | None = None) -> NDArray[np.bool_]:
    """Finds the free grains that nothing holds, [N].

    Grains with too few contacts are left out, with their contacts, until there are none. Grains
    that were removed are none of them.

    Args:
        contacts: Contacts of a frame.
        least: Number of contacts that hold a grain; by default one more than the dimension, which
            grains without friction need.
    """
    frame, pairs = contacts.frame, contacts.pairs
    needed = np.where(frame.body == 0, frame.dimension + 1 if least is None else least, 0)
    needed[frame.removed] = 0
    held = np.ones(len(needed), dtype=bool)
    while True:
        ends = pairs[held[pairs].all(axis=1)].ravel()
        still = held & (np.bincount(ends, minlength=len(held)) >= needed)
        if (still == held).all():
            return ~held
        held = still


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


def _numbers(values: ArrayLike, dimensions: int | None = 1) -> Array:
    """Returns finite numbers as an array.

    Raises:
        ValueError: Some are not finite, or there are other dimensions.
    """
    x = np.asarray(values, dtype=np.float64)
    if dimensions not in (None, x.ndim) or not len(x):
        raise ValueError(f"values are of shape {x.shape}; give a series of numbers")
    wrong = np.flatnonzero(~np.isfinite(x.reshape(len(x), -1)).all(axis=1))
    if len(wrong):
        raise ValueError(f"row {wrong[0]} is not finite: choose rows that have numbers")
    return x
