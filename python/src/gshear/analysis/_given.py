"""What functions are given, and the units of what they return."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..frames import Frame

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def numbers(values: ArrayLike, dimensions: int | None = 1) -> Array:
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


def frame_list(frames: Frame | Iterable[Frame]) -> list[Frame]:
    """Returns frames of one run as a list; one frame is a list of its own.

    Raises:
        ValueError: There are none, or they are of different grains.
    """
    listed = [frames] if isinstance(frames, Frame) else list(frames)
    if not listed:
        raise ValueError("there are no frames; give one frame or more")
    counts = {len(frame.radius) for frame in listed}
    if len(counts) > 1:
        raise ValueError(f"frames have {counts} grains; give frames of one run")
    return listed


def frame_pairs(frames: Frame | Iterable[Frame], lag: int) -> list[tuple[Frame, Frame]]:
    """Returns all pairs of an earlier and a later frame that are `lag` apart in the list.

    Raises:
        ValueError: There are fewer frames than that, or they are of different grains.
    """
    listed = frame_list(frames)
    if not 1 <= lag < len(listed):
        allowed = f"1 to {len(listed) - 1}" if len(listed) > 1 else "two frames or more"
        raise ValueError(f"lag is {lag} with {len(listed)} frames; give {allowed}")
    return list(zip(listed, listed[lag:], strict=False))


def free_grains(frame: Frame, grains: ArrayLike | None = None) -> Mask:
    """Returns which grains count, [N]: those asked for, by default the free ones, if not removed.

    Raises:
        ValueError: `grains` is no mask of them.
    """
    present = ~frame.removed
    if grains is None:
        free: Mask = (frame.body == 0) & present
        return free
    mask = np.asarray(grains)
    if mask.shape != present.shape or mask.dtype != bool:
        raise ValueError(
            f"grains are {mask.dtype} of shape {mask.shape}; give a mask of {len(present)} booleans"
        )
    chosen: Mask = mask & present
    return chosen


def grain_rows(frame: Frame) -> NDArray[np.int_]:
    """Returns the coordinate of grains in labelled arrays: their ids, else their rows, [N]."""
    rows: NDArray[np.int_] = frame["id"] if "id" in frame else np.arange(len(frame.radius))
    return rows


def has_walls(frame: Frame) -> bool:
    """Whether the cell is bounded along the gradient."""
    return not frame.box.periodic[frame.box.gradient]


def attributes(name: str, units: str | None = None, **more: object) -> dict[str, object]:
    """Returns the attributes of a labelled array; reduced quantities have no units."""
    return {"long_name": name} | ({} if units is None else {"units": units}) | more


def product(units: Mapping[str, str], name: str, power: int) -> str | None:
    """Returns the unit of a column to a power, as the units module of H5MD writes it.

    None if the file has none.
    """
    if name not in units:
        return None
    factors = []
    for factor in units[name].split():
        base = factor.rstrip("-+0123456789")
        exponent = int(factor[len(base) :] or 1) * power
        factors.append(base if exponent == 1 else f"{base}{exponent:+d}".replace("+", ""))
    return " ".join(factors)
