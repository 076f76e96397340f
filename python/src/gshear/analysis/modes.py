"""How many grains take part in a mode."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def participation_ratio(vectors: ArrayLike) -> NDArray[np.float64]:
    """Returns the participation ratio of vectors over the grains: 1 if all move alike, 1/N if one.

    (Σ p)²/(N Σ p²) with p = |v|² of each grain (Bell & Dean, Discuss. Faraday Soc. 50, 55, 1970),
    as `participation` of `spectrum.csv`.

        analysis.participation_ratio(run.modes(-1)["vector"])
        analysis.participation_ratio(analysis.non_affine_displacement(run.frames, lag=10))

    Args:
        vectors: [..., N, components], real or complex; grains with NaN do not count.

    Returns:
        [...]; NaN of vectors that are zero.
    """
    v = np.asarray(vectors)
    if v.ndim < 2 or v.dtype.kind not in "iufc":
        raise ValueError(
            f"vectors are {v.dtype} of shape {v.shape}; give [..., grains, components]"
        )
    p = (np.abs(v) ** 2).sum(axis=-1)
    count = np.isfinite(p).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio: NDArray[np.float64] = np.nansum(p, axis=-1) ** 2 / (count * np.nansum(p**2, axis=-1))
    return ratio
