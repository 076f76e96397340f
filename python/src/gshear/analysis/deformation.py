"""How grains move between two frames: displacements, local strain, D²min."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..frames import Frame
from ._given import attributes, frame_pairs, free_grains, grain_rows, has_walls, product
from ._neighbours import largest_cutoff, pairs_within
from .contacts import rattlers as unbalanced

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A neighbourhood whose second moments have a smaller determinant, over that of a round one, is a
# line or a plane.
FLAT = 1e-12


def displacement(frames: Frame | Iterable[Frame], *, lag: int = 1) -> xr.DataArray:
    """Returns how far grains move between frames that are `lag` apart in the list.

    Of each grain the image that is in the cell in the earlier frame is followed, also through the
    sides of a sheared cell.

    Args:
        frames: Frames of one run, such as `run.frames`, or the two ends of a window.
        lag: Number of frames from the earlier one to the later one.

    Returns:
        [frame, grain, axis] (m), with `frame`, the number of the later frame, `earlier`, that of
        the earlier one, and `time`, of the later one. NaN of grains that were removed.

    Raises:
        ValueError: There are no frames that are so far apart.
    """
    pairs = frame_pairs(frames, lag)
    values = [_displacement(earlier, later) for earlier, later in pairs]
    return _labelled(values, "displacement", pairs, lag)


def non_affine_displacement(
    frames: Frame | Iterable[Frame], *, lag: int = 1, grains: ArrayLike | None = None
) -> xr.DataArray:
    """Returns displacements less the mean deformation of the sample.

    In a periodic cell that is the deformation of the cell and the mean displacement (Tanguy et al.,
    Phys. Rev. B 66, 174205, 2002). Between walls it is the map u = a + b y that fits the
    displacements best (of spheres a + b z), as in `docs/explanation/reduction.md`.

    Args:
        frames: Frames of one run, such as `run.frames`, or the two ends of a window.
        lag: Number of frames from the earlier one to the later one.
        grains: [N], mask of the grains to whose displacements the map is fitted; by default all
            free ones.

    Returns:
        [frame, grain, axis] (m), as `displacement`.

    Raises:
        ValueError: There are no frames that are so far apart, or no such grains.
    """
    pairs = frame_pairs(frames, lag)
    found = []
    for earlier, later in pairs:
        u = _displacement(earlier, later)
        fitted = free_grains(earlier, grains) & np.isfinite(u).all(axis=1)
        if not fitted.any():
            raise ValueError(f"frame {earlier.index} has no such grains")
        if has_walls(earlier):
            height = earlier.position[:, earlier.box.gradient]
            map_of_height = np.stack([np.ones(len(height)), height - height[fitted].mean()], axis=1)
            # If all grains have the same height, there is no slope.
            best = np.linalg.lstsq(map_of_height[fitted], u[fitted], rcond=None)[0]
            u = u - map_of_height @ best
        else:
            u = u - earlier.position @ (_cell_deformation(earlier, later).T - np.eye(3))
            u = u - u[fitted].mean(axis=0)
        found.append(u)
    return _labelled(found, "non-affine displacement", pairs, lag)


def local_strain(
    frames: Frame | Iterable[Frame],
    *,
    lag: int = 1,
    radius: float = 5.0,
    rattlers: str = "lee-hurley",
) -> xr.Dataset:
    """Returns the strain around every grain, and D²min, between frames that are `lag` apart.

    F is the deformation gradient that maps the separations of a grain from its neighbours in the
    earlier frame best to those in the later one; D²min is the mean square of what remains (Falk &
    Langer, Phys. Rev. E 57, 7192, 1998, equations 2.11 to 2.14; divided by the number of neighbours
    as by Lee & Hurley, B1). `Run.dmin` has the same D²min. The strain is ½(FᵀF - 1), in which
    rotations have no part, and its shear invariant √(½ E':E') of the deviator E' (Shimizu, Ogata &
    Li, Mater. Trans. 48, 2923, 2007). Neighbours are nearest images in the earlier frame, and those
    images are followed through the sides of the sheared cell.

        local = analysis.local_strain(run.frames[-50:], lag=10)
        plots.grain_map(ax, run, -1, local["shear"][-1])

    Args:
        frames: Frames of one run, such as `run.frames`, or the two ends of a window.
        lag: Number of frames from the earlier one to the later one.
        radius: Radius of the neighbourhood over the mean radius.
        rattlers: Which grains of the earlier frame are left out: `lee-hurley`, `balance` or `none`,
            as of `Run.dmin`.

    Returns:
        With `frame` (of the later frame), `earlier` and `time`: `gradient`, F, and `strain`, both
        [frame, grain, axis, along]; `shear` and `volumetric` (the trace), [frame, grain];
        `dmin` (m²) and `neighbours`, [frame, grain]. NaN for grains that are left out or removed,
        and for those with fewer neighbours than dimensions, or with all on a line or plane.

    Raises:
        ValueError: There are no frames that are so far apart, or a wrong option.
    """
    pairs = frame_pairs(frames, lag)
    if not 0 < radius < np.inf:
        raise ValueError(f"radius is {radius}; give a number of mean radii above 0")
    d = pairs[0][0].dimension
    shape = (len(pairs), len(pairs[0][0].radius))
    gradient, dmin = np.full((*shape, d, d), np.nan), np.full(shape, np.nan)
    neighbours = np.zeros(shape, dtype=int)
    for k, (earlier, later) in enumerate(pairs):
        left_out = _left_out(earlier, rattlers) | earlier.removed | later.removed
        cutoff = radius * float(earlier.radius.mean())
        _fit(earlier, later, ~left_out, cutoff, gradient[k], dmin[k], neighbours[k])
    strain = (np.swapaxes(gradient, -1, -2) @ gradient - np.eye(d)) / 2
    trace = np.trace(strain, axis1=-2, axis2=-1)
    deviator = strain - trace[..., None, None] * np.eye(d) / d
    length = pairs[0][0].units
    names, full = ("frame", "grain"), ("frame", "grain", "axis", "along")
    shear = np.sqrt((deviator**2).sum(axis=(-2, -1)) / 2)
    area = product(length, "radius", 2)
    return xr.Dataset(
        {
            "gradient": (full, gradient, attributes("deformation gradient")),
            "strain": (full, strain, attributes("Green–Lagrange strain")),
            "shear": (names, shear, attributes("shear strain")),
            "volumetric": (names, trace, attributes("volumetric strain")),
            "dmin": (names, dmin, attributes("D²min", area)),
            "neighbours": (names, neighbours, attributes("number of neighbours")),
        },
        coords=_coordinates(pairs, "axis", "along", axes=d),
        attrs={"lag": lag, "radius_over_mean_radius": radius, "rattlers": rattlers},
    )


def _fit(
    earlier: Frame,
    later: Frame,
    included: Mask,
    cutoff: float,
    gradient: Array,
    dmin: Array,
    neighbours: NDArray[np.int_],
) -> None:
    """Writes the best F, its D²min (m²) and the number of neighbours of every grain."""
    d, count = earlier.dimension, len(included)
    u = _displacement(earlier, later)
    stretch = _whole_vectors(earlier, later) - earlier.box.vectors
    to_edges = np.linalg.inv(earlier.box.vectors)
    position, are_unique = earlier.position, cutoff < largest_cutoff(earlier)
    for pairs in pairs_within(earlier, included, cutoff):
        i, j, b = pairs if are_unique else _nearest(*pairs)
        crossed = np.rint((b - position[j] + position[i]) @ to_edges)
        after = (b + u[j] - u[i] + crossed @ stretch)[:, :d]
        before = b[:, :d]
        number = np.bincount(i, minlength=count)
        moments = _sums(i, before, before, count)
        rows = np.flatnonzero(number >= d)
        scale = np.trace(moments[rows], axis1=1, axis2=2) / d
        rows = rows[np.linalg.det(moments[rows]) > FLAT * scale**d]
        gradient[rows] = _sums(i, after, before, count)[rows] @ np.linalg.inv(moments[rows])
        kept = np.isin(i, rows)
        i, before, after = i[kept], before[kept], after[kept]
        rest = after - np.einsum("pab,pb->pa", gradient[i], before)
        dmin[rows] = np.bincount(i, (rest**2).sum(axis=1), count)[rows] / number[rows]
        neighbours += number


def _sums(i: NDArray[np.intp], left: Array, right: Array, count: int) -> Array:
    """Returns the sum of left ⊗ right of every grain, [count, d, d]."""
    d = left.shape[1]
    sums = np.empty((count, d, d))
    for a in range(d):
        for b in range(d):
            sums[:, a, b] = np.bincount(i, left[:, a] * right[:, b], count)
    return sums


def _nearest(
    i: NDArray[np.intp], j: NDArray[np.intp], separation: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Returns the pairs with the nearest of several images of a grain."""
    order = np.lexsort(((separation**2).sum(axis=1), j, i))
    i, j, separation = i[order], j[order], separation[order]
    first = np.append(True, (np.diff(i) != 0) | (np.diff(j) != 0))[: len(i)]
    return i[first], j[first], separation[first]


def _left_out(frame: Frame, rattlers: str) -> Mask:
    """Returns the rattlers of a frame by one of the definitions of `gshear-reduce dmin`, [N]."""
    if rattlers == "none":
        return np.zeros(len(frame.radius), dtype=np.bool_)
    if rattlers == "balance":
        return unbalanced(frame.contacts)
    if rattlers == "lee-hurley":
        fewest = np.where(frame.body == 0, frame.dimension, frame.dimension - 1)
        few: Mask = frame.contacts.coordination() <= fewest
        return few
    raise ValueError(f"rattlers is {rattlers!r}; give lee-hurley, balance or none")


def _whole_vectors(earlier: Frame, later: Frame) -> Array:
    """Returns the vectors of the later cell, with the whole offset since the earlier one."""
    box, vectors = later.box, later.box.vectors
    vectors[box.gradient, 0] += (
        later.box.offset_periods - earlier.box.offset_periods
    ) * later.box.edges[0]
    return vectors


def _cell_deformation(earlier: Frame, later: Frame) -> Array:
    """Returns the deformation gradient of the cell, [3, 3]."""
    gradient: Array = (np.linalg.inv(earlier.box.vectors) @ _whole_vectors(earlier, later)).T
    return gradient


def _displacement(earlier: Frame, later: Frame) -> Array:
    """Returns how far the images move that are in the cell in the earlier frame, [N, 3] (m)."""
    moved: Array = later.unwrapped - earlier["image"] @ _whole_vectors(earlier, later)
    moved -= earlier.position
    moved[earlier.removed | later.removed] = np.nan
    return moved


def _labelled(
    vectors: list[Array], name: str, pairs: list[tuple[Frame, Frame]], lag: int
) -> xr.DataArray:
    """Returns vectors of the grains between frames, each [N, 3] (m), as a labelled array."""
    return xr.DataArray(
        np.array(vectors),
        coords=_coordinates(pairs, "axis"),
        dims=("frame", "grain", "axis"),
        name=name.replace(" ", "_").replace("-", "_"),
        attrs=attributes(name, product(pairs[0][0].units, "radius", 1), lag=lag),
    )


def _coordinates(pairs: list[tuple[Frame, Frame]], *names: str, axes: int = 3) -> dict[str, object]:
    """Returns the coordinates of what is between frames."""
    first = pairs[0][0]
    return {
        "frame": [later.index for _, later in pairs],
        "earlier": ("frame", [earlier.index for earlier, _ in pairs]),
        "time": ("frame", [later.time for _, later in pairs]),
        "grain": grain_rows(first),
        **{name: list("xyz"[:axes]) for name in names},
    }
