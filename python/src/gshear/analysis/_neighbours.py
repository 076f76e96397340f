"""Pairs of grains in cells that are periodic, sheared, or bounded by walls."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..box import Box
from ..frames import Frame

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

# About how many pairs are in memory at a time.
PAIRS = 2_000_000


class Pairs(NamedTuple):
    """Pairs of a grain i and an image of a grain j.

    Attributes:
        i: [P], rows of the grains.
        j: [P], rows of their neighbours.
        separation: [P, 3], from i to the image of j (m).
    """

    i: Rows
    j: Rows
    separation: Array


class Images(NamedTuple):
    """Grains and those of their images that are near the cell, the grains first.

    Attributes:
        place: [G, 3] (m).
        row: [G], rows of the grains.
    """

    place: Array
    row: Rows


def images(position: Array, box: Box, reach: float) -> Images:
    """Returns grains, wrapped into the cell, and their images within `reach` of it (m)."""
    place, row = box.wrap(position), np.arange(len(position))
    # Across the gradient first: those images are displaced along x, and then wrapped.
    for axis in (box.gradient, *(axis for axis in (0, 1) if axis != box.gradient)):
        if not box.periodic[axis]:
            continue
        edge = box.edges[axis]
        count = int(np.ceil(reach / edge))
        places, rows = [place], [row]
        for n in (k for k in range(-count, count + 1) if k != 0):
            moved = place + n * box.vectors[axis]
            if axis == box.gradient:
                moved[:, 0] %= box.edges[0]
            near = (moved[:, axis] >= -reach) & (moved[:, axis] <= edge + reach)
            places.append(moved[near])
            rows.append(row[near])
        place, row = np.concatenate(places), np.concatenate(rows)
    return Images(place, row)


def largest_cutoff(frame: Frame) -> float:
    """Returns the distance up to which a grain meets no two images of another one (m).

    Half of the least distance between the sides of the cell along its periodic axes.
    """
    box, dimension = frame.box, frame.dimension
    periodic = [axis for axis in range(dimension) if box.periodic[axis]]
    vectors = box.vectors[np.ix_(periodic, range(dimension))].copy()
    if box.gradient in periodic:
        # The least tilted of the equivalent cells.
        x = vectors[-1, 0]
        vectors[-1, 0] -= box.edges[0] * np.rint(x / box.edges[0])
    # The inverse of the vectors has the normals of the sides as columns.
    widths = 1 / np.linalg.norm(np.linalg.pinv(vectors), axis=0)
    return float(widths.min() / 2)


def pairs_within(frame: Frame, included: NDArray[np.bool_], cutoff: float) -> Iterator[Pairs]:
    """Yields all pairs of grains up to a distance, each in both directions, block by block.

    Args:
        frame: The frame.
        included: [N], which grains count.
        cutoff: The greatest distance (m). A grain and its own images are no pairs.
    """
    from scipy.spatial import KDTree

    rows = np.flatnonzero(included)
    d = frame.dimension
    near = images(frame.position[rows], frame.box, cutoff)
    tree = KDTree(near.place[:, :d])
    ball = np.pi * cutoff**2 if d == 2 else 4 / 3 * np.pi * cutoff**3
    expected = 1 + len(rows) * ball / frame.box.volume
    block_length = max(1, int(PAIRS / expected))
    for first in range(0, len(rows), block_length):
        last = min(first + block_length, len(rows))
        block = KDTree(near.place[first:last, :d])
        found = block.sparse_distance_matrix(tree, cutoff, output_type="ndarray")
        i, image = found["i"] + first, found["j"]
        others = i != near.row[image]
        i, image = i[others], image[others]
        separation = near.place[image] - near.place[i]
        yield Pairs(rows[i], rows[near.row[image]], separation)
