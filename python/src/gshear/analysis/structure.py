"""Where grains are relative to each other: g(r), S(k), and correlations in space."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..frames import Frame
from ._given import attributes, frame_list, free_grains, has_walls, product
from ._neighbours import images, largest_cutoff, pairs_within

Array = NDArray[np.float64]

# Grains whose waves are in memory at a time.
BLOCK = 2000


def g_of_r(
    frames: Frame | Iterable[Frame],
    *,
    cutoff: float | None = None,
    bins: int = 200,
    grains: ArrayLike | None = None,
) -> xr.DataArray:
    """Returns the radial distribution function g(r), mean over frames.

    g = V/n² Σ_{i≠j} ⟨δ(r - r_ij)⟩ over the circumference (2D) or surface (3D) at r (Allen &
    Tildesley, Computer Simulation of Liquids, 2nd ed. 2017, section 2.6), of n grains in the volume
    V. It is 1 far away in a disordered sample. Images are those of the sheared cell. Between walls
    V reaches from the lowest to the highest centre, and of every shell the part within V counts, in
    the mean over V: 2πr (1 - 2r/(πh)) of disks and 4πr² (1 - r/(2h)) of spheres in a layer of
    height h, the translation correction of Ohser (Math. Operationsforsch. Stat. Ser. Stat. 14, 63,
    1983).

        analysis.g_of_r(run.frames[-20:]).plot()

    Args:
        frames: A frame, or frames of one run.
        cutoff: Greatest distance (m); by default ten mean diameters, or what fits in the cell.
        bins: Number of intervals of r.
        grains: [N], mask of the grains that count; by default all free ones. Removed grains never
            do.

    Returns:
        [r], with `r`, the middles of the intervals (m).

    Raises:
        ValueError: There are fewer than two grains, or `cutoff` is more than half the width of the
            cell or more than the height between walls.
    """
    from scipy.spatial import KDTree

    listed = frame_list(frames)
    masks = [free_grains(frame, grains) for frame in listed]
    fewest = min(int(mask.sum()) for mask in masks)
    if fewest < 2:
        raise ValueError(f"{fewest} grains have no g(r); give two or more")
    heights = [
        np.ptp(frame.position[mask, frame.box.gradient])
        for frame, mask in zip(listed, masks, strict=True)
    ]
    greatest = min(largest_cutoff(frame) for frame in listed)
    if has_walls(listed[0]):
        greatest = min(greatest, float(min(heights)))
    edges = _intervals(listed[0], cutoff, greatest, bins)
    d = listed[0].dimension
    count, expected = np.zeros(bins), np.zeros(bins)
    for frame, mask, height in zip(listed, masks, heights, strict=True):
        near = images(frame.position[mask], frame.box, edges[-1])
        n, volume = int(mask.sum()), frame.box.volume
        own = KDTree(near.place[:n, :d])
        count += np.diff(own.count_neighbors(KDTree(near.place[:, :d]), edges))
        within = np.pi * edges**2 if d == 2 else 4 / 3 * np.pi * edges**3
        if has_walls(frame):
            volume *= height / frame.box.edges[frame.box.gradient]
            within -= (4 / 3 * edges**3 if d == 2 else np.pi / 2 * edges**4) / height
        expected += n**2 / volume * np.diff(within)
    r = (edges[1:] + edges[:-1]) / 2
    units = product(listed[0].units, "radius", 1)
    return xr.DataArray(
        count / expected,
        coords={"r": ("r", r, attributes("distance", units))},
        name="g",
        attrs=attributes("radial distribution function", frames=len(listed)),
    )


def structure_factor(
    frames: Frame | Iterable[Frame],
    *,
    k_max: float | None = None,
    bins: int | None = None,
    weights: ArrayLike | None = None,
    grains: ArrayLike | None = None,
) -> xr.DataArray:
    """Returns the static structure factor S(k), mean over frames and directions.

    S = |Σ w exp(-i k·x)|²/Σ w² (Hansen & McDonald, Theory of Simple Liquids, 4th ed. 2013, section
    4.1, with w = 1) at all wave vectors of the cell: k·a is a multiple of 2π for every edge a of
    the sheared cell. Between walls these are along x, and along y of spheres; then S(k) is that of
    the sample projected onto them. With volumes as weights S is the spectral density over its value
    for grains at random, as Zachary, Jiao & Torquato (Phys. Rev. E 83, 051308, 2011) need it for
    sizes that vary. The time goes with the number of grains times (k_max L)^d.

        analysis.structure_factor(run.frames[-20:]).plot()

    Args:
        frames: A frame, or frames of one run.
        k_max: Greatest wave number (rad/m); by default 15 over the mean diameter, beyond the second
            peak.
        bins: Number of intervals of k; by default as wide as the least wave number.
        weights: [N]; by default 1.
        grains: [N], mask of the grains that count; by default all free ones. Removed grains never
            do.

    Returns:
        [k] for the intervals that hold wave vectors, with `k`, their mean (rad/m), and `vectors`,
        their number over all frames.

    Raises:
        ValueError: No grains, or no wave vectors up to k_max.
    """
    listed = frame_list(frames)
    if k_max is None:
        k_max = 7.5 / float(listed[0].radius.mean())
    longest = max(float(frame.box.edges[: frame.dimension].max()) for frame in listed)
    if bins is None:
        bins = max(1, int(k_max * longest / (2 * np.pi)))
    if not 0 < k_max < np.inf or bins < 1:
        raise ValueError(f"k_max is {k_max} with {bins} bins; give more than 0, and one or more")
    w = np.ones(len(listed[0].radius)) if weights is None else np.asarray(weights, np.float64)
    if w.shape != listed[0].radius.shape:
        raise ValueError(f"weights are of shape {w.shape}; give {len(listed[0].radius)}")
    totals = np.zeros((3, bins))
    for frame in listed:
        mask = free_grains(frame, grains)
        if not mask.any():
            raise ValueError(f"frame {frame.index} has no such grains")
        k, s, number = _at_wave_vectors(frame, mask, w[mask], k_max)
        interval = np.minimum((k / k_max * bins).astype(int), bins - 1)
        for total, values in zip(totals, (number, number * k, number * s), strict=True):
            total += np.bincount(interval, values, bins)
    number, k_sum, s_sum = totals[:, totals[0] > 0]
    if not len(number):
        raise ValueError(f"the cell has no wave vectors up to k_max = {k_max:g} rad/m; give more")
    units = product(listed[0].units, "radius", -1)
    return xr.DataArray(
        s_sum / number,
        coords={
            "k": ("k", k_sum / number, attributes("wave number", units)),
            "vectors": ("k", number.astype(int), attributes("number of wave vectors")),
        },
        dims="k",
        name="S",
        attrs=attributes("static structure factor", frames=len(listed)),
    )


def _at_wave_vectors(
    frame: Frame, mask: NDArray[np.bool_], weights: Array, k_max: float
) -> tuple[Array, Array, Array]:
    """Returns |k|, S(k), and how many of ±k count, for half of the wave vectors of a cell."""
    axes = [axis for axis in range(frame.dimension) if frame.box.periodic[axis]]
    vectors = frame.box.vectors[np.ix_(axes, range(3))]
    reciprocal = 2 * np.pi * np.linalg.pinv(vectors).T
    # Along every edge, in parts of it.
    place = frame.position[mask] @ np.linalg.pinv(vectors)
    most = [int(k_max * np.linalg.norm(vector) / (2 * np.pi)) for vector in vectors]
    orders = [np.arange(-m, m + 1) for m in most[:-1]]
    grid = np.array(list(itertools.product(*orders)))
    # Of the last axis half of the orders: S(-k) = S(k).
    last_orders = np.arange(most[-1] + 1)
    amplitude = np.zeros((len(last_orders), len(grid)), dtype=np.complex128)
    for first in range(0, len(place), BLOCK):
        some = slice(first, first + BLOCK)
        *waves, last = (
            np.exp(-2j * np.pi * order[:, None] * x)
            for order, x in zip((*orders, last_orders), place[some].T, strict=True)
        )
        last *= weights[some]
        if len(waves) == 2:
            for n in last_orders:
                amplitude[n] += ((waves[0] * last[n]) @ waves[1].T).ravel()
        else:
            amplitude += last @ waves[0].T if waves else last.sum(axis=1)[:, None]
    last_order = np.repeat(last_orders, len(grid))
    order = np.concatenate([np.tile(grid, (len(last_orders), 1)), last_order[:, None]], axis=1)
    k = np.linalg.norm(order @ reciprocal, axis=1)
    s = np.abs(amplitude.ravel()) ** 2 / (weights**2).sum()
    # The plane of order 0 holds both k and -k.
    number = np.where(last_order == 0, 1.0, 2.0)
    chosen = (k > 0) & (k <= k_max)
    return k[chosen], s[chosen], number[chosen]


def spatial_correlation(
    frame: Frame,
    values: ArrayLike,
    *,
    cutoff: float | None = None,
    bins: int = 50,
) -> xr.DataArray:
    """Returns the correlation of a quantity of the grains over their distance.

    C(r) = (⟨u(x)·u(x + r)⟩ - ⟨u⟩²)/(⟨u²⟩ - ⟨u⟩²) over the pairs of grains at the distance r, 1 for
    grains that move alike and 0 for independent ones (Chikkadi & Schall, Phys. Rev. E 85, 031402,
    2012, of non-affine displacements).

        u = analysis.non_affine_displacement(run.frames[-11:], lag=10)[0]
        analysis.spatial_correlation(run.frame(-11), u).plot()

    Args:
        frame: The frame that has the positions.
        values: [N], or vectors [N, …]. Grains that were removed, or have NaN, do not count.
        cutoff: Greatest distance (m); by default ten mean diameters, or what fits in the cell.
        bins: Number of intervals of r.

    Returns:
        [r], with `r`, the middles of the intervals (m), and `pairs`, their numbers; NaN where there
        are none.

    Raises:
        ValueError: Fewer than two grains have values, all are equal, or `cutoff` does not fit.
    """
    u = np.asarray(values, dtype=np.float64)
    if u.shape[:1] != frame.radius.shape:
        raise ValueError(f"values are of shape {u.shape}; give one for each of the grains")
    u = u.reshape(len(u), -1)
    mask = np.isfinite(u).all(axis=1) & ~frame.removed
    edges = _intervals(frame, cutoff, largest_cutoff(frame), bins)
    if mask.sum() < 2:
        raise ValueError(f"{mask.sum()} grains have values; give two or more")
    u = u - u[mask].mean(axis=0)
    variance = (u[mask] ** 2).sum(axis=1).mean()
    if not variance > 0:
        raise ValueError("all values are equal, and have no correlation")
    sums, count = np.zeros(bins), np.zeros(bins)
    for pairs in pairs_within(frame, mask, edges[-1]):
        r = np.linalg.norm(pairs.separation, axis=1)
        interval = np.minimum((r / edges[1]).astype(int), bins - 1)
        sums += np.bincount(interval, (u[pairs.i] * u[pairs.j]).sum(axis=1), bins)
        count += np.bincount(interval, minlength=bins)
    with np.errstate(invalid="ignore"):
        correlation = sums / count / variance
    units = product(frame.units, "radius", 1)
    return xr.DataArray(
        correlation,
        coords={
            "r": ("r", (edges[1:] + edges[:-1]) / 2, attributes("distance", units)),
            "pairs": ("r", count.astype(int) // 2, attributes("number of pairs")),
        },
        dims="r",
        name="C",
        attrs=attributes("spatial correlation"),
    )


def _intervals(frame: Frame, cutoff: float | None, greatest: float, bins: int) -> Array:
    """Returns the edges of intervals of the distance, [bins + 1] (m)."""
    if cutoff is None:
        cutoff = min(20 * float(frame.radius.mean()), greatest)
    if not 0 < cutoff <= greatest * (1 + 1e-12) or bins < 1:
        raise ValueError(
            f"cutoff is {cutoff:g} with {bins} bins; give more than 0 and at most {greatest:g}, "
            "as far as pairs are unique in the cell, and one bin or more"
        )
    return np.linspace(0, cutoff, bins + 1)
