"""Grains and contacts of a frame."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .box import Box
from .errors import NoSuchNameError, no_such

if TYPE_CHECKING:
    import networkx as nx

Array = NDArray[Any]
Reader = Callable[[str], Array]

# The top wall, as `body` and `wall` have it.
TOP = 2


class Columns(Mapping[str, Array]):
    """Arrays by name, each read from the file when it is first used.

    `columns["radius"]` and `columns.radius` are the same. The names are those of the file
    (`docs/reference/file-formats.md`).

    Attributes:
        units: Units by name, as the file has them (H5MD: `kg m s-2`). Pure numbers have none, and
            neither have files in reduced units.
    """

    def __init__(self, names: Collection[str], read: Reader, units: Mapping[str, str]) -> None:
        self._names = names
        self._reader = read
        self._read: dict[str, Array] = {}
        self.units = {name: units[name] for name in names if name in units}

    def __getitem__(self, name: str) -> Array:
        if name not in self._read:
            if name not in self._names:
                raise self._no_such(name)
            self._read[name] = self._reader(name)
        return self._read[name]

    def __getattr__(self, name: str) -> Array:
        # Names with an underscore are never columns; during unpickling `_names` is not yet there.
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._names:
            raise AttributeError(str(self._no_such(name)))
        return self[name]

    def _no_such(self, name: str) -> NoSuchNameError:
        return no_such(f"a {type(self).__name__}", "column", name, self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._names]


class Frame(Columns):
    """Grains at one step. Row n of every column is the same grain in every frame.

    Columns, for N grains: `id`, `radius` (m), `body` (0 free, 1 bottom wall, 2 top wall), `mass`
    (kg; kg/m for disks), each [N]; `position` (m) and `velocity` (m/s), [N, 3], with z = 0 for
    disks; `angular_velocity` (rad/s), [N] for disks, [N, 3] for spheres; `image`, [N, 3], the
    multiples of the edges by which positions are wrapped.

    Attributes:
        index: Number of the frame, from 0 on.
        step: Steps since the start of the stage; of a box that is strained strain steps.
        time: Time (s); of a box that is strained the strain.
        strain: Shear strain γ.
        dimension: 2 for disks, 3 for spheres.
        pair_friction: [M, M], coefficients of sliding friction between the M materials.
        attracts: Whether grains of the scene attract each other.
        box: The periodic cell.
        contacts: The contacts between grains in this frame.
        wall_contacts: Those with flat walls; none in files of earlier versions.
    """

    def __init__(
        self,
        names: Collection[str],
        read: Reader,
        units: Mapping[str, str],
        *,
        index: int,
        step: int,
        time: float,
        strain: float,
        dimension: int,
        box: Box,
        contacts: Callable[[Frame], Contacts],
        wall_contacts: Callable[[Frame], WallContacts],
        pair_friction: NDArray[np.float64] | None = None,
        attracts: bool = False,
    ) -> None:
        super().__init__(names, read, units)
        self.index = index
        self.step = step
        self.time = time
        self.strain = strain
        self.dimension = dimension
        self.pair_friction = np.zeros((1, 1)) if pair_friction is None else pair_friction
        self.attracts = attracts
        self.box = box
        self.contacts = contacts(self)
        self.wall_contacts = wall_contacts(self)

    @property
    def friction(self) -> float:
        """The greatest coefficient of sliding friction."""
        return float(self.pair_friction.max())

    @property
    def unwrapped(self) -> NDArray[np.float64]:
        """[N, 3], positions that move from frame to frame without jumps (m)."""
        unwrapped: NDArray[np.float64] = self.position + self["image"] @ self.box.vectors
        return unwrapped

    @property
    def removed(self) -> NDArray[np.bool_]:
        """[N], which grains had passed a wall and were removed (`sample.outside` of the scene)."""
        if "removed" in self:
            told: NDArray[np.bool_] = self["removed"] != 0
            return told
        # Files of earlier versions say it by an image along the axis that walls bound.
        gradient = self.box.gradient
        if self.box.periodic[gradient] or "image" not in self:
            return np.zeros(len(self.radius), dtype=np.bool_)
        beyond: NDArray[np.bool_] = self["image"][:, gradient] != 0
        return beyond

    def __repr__(self) -> str:
        return (
            f"<Frame {self.index}: step {self.step}, strain {self.strain:.6g}, "
            f"{len(self.radius)} grains, {self.contacts.count} contacts>"
        )


class ContactColumns(Columns):
    """Contacts of one kind in a frame.

    Attributes:
        frame: The frame with the grains.
        count: K.
    """

    def __init__(
        self,
        names: Collection[str],
        read: Reader,
        units: Mapping[str, str],
        frame: Frame,
        count: int,
    ) -> None:
        super().__init__(names, read, units)
        self.frame = frame
        self.count = count

    @property
    def normal(self) -> NDArray[np.float64]:
        """[K, 3], the unit vector n towards grain i."""
        raise NotImplementedError

    def _force(self) -> NDArray[np.float64]:
        n = self.normal
        t = self.tangential_force
        if t.ndim == 1:
            t = t[:, None] * np.stack([-n[:, 1], n[:, 0], np.zeros(len(n))], axis=1)
        total: NDArray[np.float64] = self.normal_force[:, None] * n + t
        return total

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of frame {self.frame.index}: {self.count}>"


class WallContacts(ContactColumns):
    """Contacts of the grains of a frame with flat walls, ordered by (i, wall).

    Columns, for K contacts: `i` (row of the grain), `wall` (1 bottom, 2 top), and the others of
    `Contacts`, of the force on i.

    Attributes:
        frame: The frame with the grains.
        count: K.
    """

    @property
    def normal(self) -> NDArray[np.float64]:
        """[K, 3], n, from the wall to the grain."""
        n = np.zeros((self.count, 3))
        n[:, self.frame.box.gradient] = np.where(self.wall == TOP, -1.0, 1.0)
        return n

    @property
    def branch(self) -> NDArray[np.float64]:
        """[K, 3], from the centre of the grain to the point of contact: -(R - δ) n (m)."""
        distance = self.frame.radius[self.i] - self.overlap
        return -distance[:, None] * self.normal

    @property
    def position(self) -> NDArray[np.float64]:
        """[K, 3], the points of contact, on the planes of the walls (m)."""
        place: NDArray[np.float64] = self.frame.position[self.i] + self.branch
        return place

    @property
    def force(self) -> NDArray[np.float64]:
        """[K, 3], force on i: F_n n + F_t (N; N/m for disks). That on the wall is opposite."""
        return self._force()

    def force_on_wall(self, wall: int) -> NDArray[np.float64]:
        """Returns the force of the grains on a wall, 1 bottom or 2 top, [3] (N; N/m for disks).

        Of the top wall of a shear, component `box.gradient` is N, and that along x is -S.
        """
        total: NDArray[np.float64] = -self.force[self.wall == wall].sum(axis=0)
        return total

    def force_on_grains(self) -> NDArray[np.float64]:
        """Returns the sum of the forces of flat walls on every grain, [N, 3] (N; N/m for disks)."""
        total = np.zeros(self.frame.position.shape)
        np.add.at(total, self.i, self.force)
        return total


class Contacts(ContactColumns):
    """Contacts between the grains of a frame, ordered by (i, j).

    Columns, for K contacts: `i`, `j` (rows of the grains, i < j), `normal_force` (F_n, on i along
    n, negative where they attract), `overlap` (δ), `sliding` (1 at Coulomb's limit), each [K];
    `tangential_force` (F_t on i) and `tangential_history`, [K] for disks (along t̂ = ẑ × n), [K, 3]
    for spheres;
    `rolling_history` and `rolling` (1 at the limit of rolling), [K] for disks; for spheres that
    resist rolling or twisting [K, 3] and [K], with `twisting_history` and `twisting`, [K]; `idle`
    (1 where the damper leaves the spring no force), [K], not in files of earlier versions. Forces
    are in N, for disks in N/m. `docs/reference/glossary.md` defines the quantities.

    Attributes:
        frame: The frame with the grains.
        count: K.
    """

    @property
    def pairs(self) -> Array:
        """[K, 2], rows (i, j) of every contact: the edges of the contact network."""
        return np.stack([self.i, self.j], axis=1)

    @property
    def separation(self) -> NDArray[np.float64]:
        """[K, 3], r = r_i - r_j, nearest periodic image (m)."""
        x = self.frame.position
        return self.frame.box.minimum_image(x[self.i] - x[self.j])

    @property
    def normal(self) -> NDArray[np.float64]:
        """[K, 3], n = r/|r|, from j to i."""
        r = self.separation
        unit: NDArray[np.float64] = r / np.linalg.norm(r, axis=1, keepdims=True)
        return unit

    @property
    def force(self) -> NDArray[np.float64]:
        """[K, 3], force on i: F_n n + F_t (N; N/m for disks). That on j is opposite."""
        return self._force()

    def force_on_grains(self) -> NDArray[np.float64]:
        """Returns the sum of the forces of others on every grain, [N, 3] (N; N/m for disks)."""
        total = np.zeros(self.frame.position.shape)
        force = self.force
        np.add.at(total, self.i, force)
        np.subtract.at(total, self.j, force)
        return total

    def coordination(self) -> NDArray[np.int64]:
        """Returns the number of contacts of every grain with others, [N]."""
        ends = np.concatenate([self.i, self.j])
        return np.bincount(ends, minlength=len(self.frame.radius))

    def to_networkx(self) -> nx.Graph:
        """Returns the contact network as a `networkx.Graph`.

        Nodes are the rows of all grains, with `radius` and `body`; edges are contacts, with the
        columns that have one number per contact. Needs networkx (`pip install gshear[networkx]`).
        """
        import networkx as nx

        graph = nx.Graph()
        radius, body = self.frame.radius.tolist(), self.frame.body.tolist()
        graph.add_nodes_from(
            (n, {"radius": radius[n], "body": body[n]}) for n in range(len(radius))
        )
        names = [name for name in self if name not in ("i", "j") and self[name].ndim == 1]
        values = zip(*(self[name].tolist() for name in names), strict=True)
        graph.add_edges_from(
            (i, j, dict(zip(names, row, strict=True)))
            for (i, j), row in zip(self.pairs.tolist(), values, strict=True)
        )
        return graph
