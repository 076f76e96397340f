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


# Least number of blocks from whose scatter the error of a mean is taken.
FEWEST_BLOCKS = 4
# Intervals that differ by less than this share are equal.
EQUAL = 1e-6


class TimeMean(NamedTuple):
    """A mean over the time of a run.

    Attributes:
        mean: The mean; NaN without values.
        error: Its standard error, which knows that rows are correlated; NaN of less than four rows.
        deviation: Standard deviation over time; of a ratio S/N that of (S - mean·N)/⟨N⟩.
    """

    mean: float
    error: float
    deviation: float


def time_mean(
    values: ArrayLike, over: ArrayLike | None = None, *, weights: ArrayLike | None = None
) -> TimeMean:
    """Returns the mean of a series over time, or of a ratio the ratio of the means.

        half = run.series.iloc[len(run.series) // 2 :]
        tau, error, _ = analysis.time_mean(half.shear_force, half.normal_force)

    The mean of the rows' ratios would be ruined by one row whose denominator is near zero. The
    error is that of the mean of the linearised residuals (S - τN)/⟨N⟩ (Cochran, Sampling
    Techniques, 1977, section 6.3) by block averaging (Flyvbjerg & Petersen, J. Chem. Phys. 91, 461,
    1989), with the block length of Lee et al. (Phys. Rev. E 83, 066706, 2011). `gshear-reduce
    report` has the same numbers.

    Args:
        values: [n], in the order of time. Rows that are not finite do not count.
        over: [n], what they are divided by; default 1.
        weights: [n], of the rows, as from `durations`; by default all count the same.
    """
    s = np.asarray(values, dtype=np.float64)
    n = np.ones_like(s) if over is None else np.asarray(over, dtype=np.float64)
    w = np.ones_like(s) if weights is None else np.asarray(weights, dtype=np.float64)
    if s.ndim != 1 or not s.shape == n.shape == w.shape:
        raise ValueError(f"{s.shape} values over {n.shape} with {w.shape} weights; give one each")
    known = np.isfinite(s) & np.isfinite(n) & np.isfinite(w)
    s, n, w = s[known], n[known], w[known]
    with np.errstate(invalid="ignore", divide="ignore"):
        normal, time = (w * n).sum(), w.sum()
        mean = (w * s).sum() / normal
        residuals = (s - mean * n) * len(s) / normal
        deviation = np.sqrt((w * (s - mean * n) ** 2).sum() / time) * abs(time / normal)
        return TimeMean(float(mean), block_error(w * residuals), float(deviation))


def durations(time: ArrayLike, first: int = 0) -> Array:
    """Returns the weights of the rows from `first` on in a mean over time, [n - first].

    The time from the row before, of row 0 that to the next one; 1 if these are equal.

    Args:
        time: [n], in any unit.
        first: The first row of the mean.
    """
    t = np.asarray(time, dtype=np.float64)
    intervals = np.abs(np.diff(t))
    found = np.concatenate([intervals[:1] if len(intervals) else np.ones(len(t)), intervals])[
        first:
    ]
    mean = found.mean() if len(found) else 0.0
    if not mean > 0 or (np.abs(found - mean) <= EQUAL * mean).all():
        return np.ones(len(found))
    return found


def block_error(values: ArrayLike) -> float:
    """Returns the standard error of the mean of correlated values at equal intervals.

    Block averaging, as of `time_mean`: the block length B is the least power of two with
    B³ > 2n (e_B/e_1)⁴, e_B being the error from blocks of length B, or the longest one that leaves
    four blocks. NaN of less than four values.
    """
    blocks = np.asarray(values, dtype=np.float64)
    count, length, first, error = len(blocks), 1.0, np.nan, np.nan
    while len(blocks) >= FEWEST_BLOCKS:
        error = float(blocks.std(ddof=1) / np.sqrt(len(blocks)))
        if length == 1:
            first = error
        # All values are equal.
        if first == 0 or length**3 > 2 * count * (error / first) ** 4:
            break
        blocks = blocks[: len(blocks) // 2 * 2].reshape(-1, 2).mean(axis=1)
        length *= 2
    return error


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

    Grains with fewer contacts than can balance them are left out, with their contacts, until there
    are none. Grains that were removed are none of them.

    With friction two contacts balance a disk or a sphere: equal and opposite forces along the line
    through both points of contact, which give no torque, if that line is within both cones of
    friction (Agnolin & Roux, Phys. Rev. E 76, 061302, 2007, count such spheres). Without friction
    forces point to the centre, and one contact more than the dimension is needed (O'Hern et al.,
    Phys. Rev. E 68, 011306, 2003). Lee & Hurley's rattlers, those of `Run.dmin`, are others: grains
    with as few contacts as the dimension or fewer, counted once.

    Args:
        contacts: Contacts of a frame.
        least: Number of contacts that hold a grain; by default 2 if the scene has friction
            (`frame.friction`), else one more than the dimension.
    """
    frame, pairs = contacts.frame, contacts.pairs
    if least is None:
        least = 2 if frame.friction > 0 else frame.dimension + 1
    needed = np.where(frame.body == 0, least, 0)
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
