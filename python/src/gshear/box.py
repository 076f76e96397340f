"""Periodic images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vectors = NDArray[np.float64]


@dataclass(frozen=True)
class Box:
    """The cell of a frame. Lengths have the unit of the file: m, or of a scene without `[shear]`.

    Attributes:
        edges: [3], lengths of the edges; for disks the last one is the unit depth. Between walls
            the height is that of the frame.
        periodic: [3], whether the axis is periodic.
        gradient: Axis along which the velocity of the shear changes: 1 (y) for disks, 2 (z) for
            spheres. The shear is along x.
        image_offset: Lees–Edwards offset: displacement along x of the image above, which is the
            next one along the axis `gradient`. 0 if the box is not sheared or that axis is not
            periodic.
        offset_periods: Number of periods along x that `image_offset`, which stays within half of
            one, lacks of the whole displacement since the first frame.
        planes: Whether a rigid plane is at the lower and at the upper end of the axis `gradient`,
            at 0 and at the height.
    """

    edges: Vectors
    periodic: tuple[bool, bool, bool]
    gradient: int
    image_offset: float = 0.0
    offset_periods: int = 0
    planes: tuple[bool, bool] = (False, False)

    @property
    def vectors(self) -> Vectors:
        """[3, 3], the vectors of the edges, one a row; that along the gradient leans if sheared."""
        vectors = np.diag(self.edges)
        vectors[self.gradient, 0] = self.image_offset
        return vectors

    def minimum_image(self, separation: ArrayLike) -> Vectors:
        """Returns the nearest periodic images of separations, [..., 3].

        With an offset the image across the gradient is chosen first, then that along x. This is the
        nearest one for separations of less than half of every edge, so for contacts and neighbours.
        """
        r = np.array(separation, dtype=np.float64)
        crossed = np.zeros(r.shape[:-1])
        if self.periodic[self.gradient]:
            crossed = np.rint(r[..., self.gradient] / self.edges[self.gradient])
        self._shift(r, crossed)
        for axis in self._flat_axes():
            r[..., axis] -= self.edges[axis] * np.rint(r[..., axis] / self.edges[axis])
        return r

    def wrap(self, position: ArrayLike) -> Vectors:
        """Returns positions [..., 3] wrapped into [0, edge) along the periodic axes."""
        x = np.array(position, dtype=np.float64)
        crossed = np.zeros(x.shape[:-1])
        if self.periodic[self.gradient]:
            crossed = np.floor(x[..., self.gradient] / self.edges[self.gradient])
        self._shift(x, crossed)
        for axis in self._flat_axes():
            x[..., axis] %= self.edges[axis]
            # The remainder of a tiny negative number is rounded up to the edge.
            x[..., axis][x[..., axis] >= self.edges[axis]] = 0.0
        return x

    @property
    def volume(self) -> float:
        """Product of the edges; of a cell of disks the area."""
        return float(np.prod(self.edges[: self.gradient + 1]))

    def _shift(self, vectors: Vectors, crossed: NDArray[Any]) -> None:
        """Moves vectors back by `crossed` images along the gradient, in place."""
        vectors[..., self.gradient] -= crossed * self.edges[self.gradient]
        vectors[..., 0] -= crossed * self.image_offset

    def _flat_axes(self) -> list[int]:
        """Returns the periodic axes whose images are not displaced."""
        return [axis for axis in range(3) if self.periodic[axis] and axis != self.gradient]
