"""Frames of planted grains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gshear import Box, Contacts, Frame, WallContacts


def planted(
    dimension: int,
    edges: list[float],
    grains: dict[str, Any],
    *,
    walls: bool,
    pairs: Sequence[tuple[int, int]] = (),
    friction: float = 0.0,
    offset: float = 0.0,
    index: int = 0,
    on_walls: dict[str, NDArray[Any]] | None = None,
    **forces: NDArray[np.float64],
) -> Frame:
    """A frame of planted grains, of which these touch, by default with the normal force 7.

    Args:
        dimension: 2 or 3.
        edges: [3], of the cell.
        grains: Columns of the grains.
        walls: Whether the cell is bounded along the gradient.
        pairs: Rows of the grains that touch.
        friction: Between all grains.
        offset: Of the images above.
        index: Number of the frame.
        on_walls: Columns of the contacts with flat walls.
        forces: Columns of the contacts.
    """
    box = Box(np.array(edges), (True, dimension == 3, False), dimension - 1)
    if not walls:
        box = Box(np.array(edges), (True, True, dimension == 3), dimension - 1, offset)
    i, j = np.array(pairs, dtype=int).reshape(-1, 2).T
    columns: dict[str, NDArray[Any]] = {"i": i, "j": j, "normal_force": np.full(len(i), 7.0)}
    columns["tangential_force"] = np.zeros(len(i))
    columns["sliding"] = np.zeros(len(i), dtype=np.uint8)
    columns |= forces
    of_walls = {name: values[:0] for name, values in columns.items() if name != "j"}
    of_walls["wall"] = np.zeros(0, dtype=np.uint8)
    of_walls["overlap"] = np.zeros(0)
    of_walls |= on_walls or {}
    return Frame(
        tuple(grains),
        grains.__getitem__,
        {},
        index=index,
        step=0,
        time=0.0,
        strain=0.0,
        dimension=dimension,
        pair_friction=np.full((1, 1), friction),
        box=box,
        contacts=lambda frame: Contacts(tuple(columns), columns.__getitem__, {}, frame, len(i)),
        wall_contacts=lambda frame: WallContacts(
            tuple(of_walls), of_walls.__getitem__, {}, frame, len(of_walls["i"])
        ),
    )
