"""Means over the time of a run, with errors that know that rows are correlated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

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
