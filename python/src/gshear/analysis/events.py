"""Avalanches of a series, and the laws of their sizes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from ._given import numbers

Array = NDArray[np.float64]


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


class PowerLaw(NamedTuple):
    """The law p(x) ∝ x^-α of a sample.

    Attributes:
        exponent: α.
        error: Its standard error at the given `least` and `greatest`.
        least: The least value from which on the law is fitted.
        greatest: The greatest one; infinite unless given.
        values: Number of values that are fitted.
        distance: Kolmogorov and Smirnov's distance of the sample from the law.
    """

    exponent: float
    error: float
    least: float
    greatest: float
    values: int
    distance: float


# The fewest values to which a law is fitted.
FEWEST = 10
# Among how many of the values the least one of the law is searched.
STARTS = 1000
# The same for samples, of which there are many.
STARTS_OF_SAMPLES = 50
# Fewest values and least p of an exponent that is determined.
MANY, POSSIBLE = 50, 0.1
# Columns of events that may follow a power law.
EVENT_SIZES = ("grains", "strain_sum", "stress_drop", "waiting_strain")


def power_law(values: ArrayLike, least: float | None = None, greatest: float = np.inf) -> PowerLaw:
    """Fits the exponent of a power law to sizes or durations, by maximum likelihood.

    α = 1 + n/Σ ln(x/x_least) with the error (α - 1)/√n (Clauset, Shalizi & Newman, SIAM Rev. 51,
    661, 2009, equations 3.1 and 3.2). With `greatest` the law is cut off there, for samples whose
    size bounds the events (Deluca & Corral, Acta Geophys. 61, 1351, 2013); the error is that of the
    Fisher information. Without `least` the one is taken that gives the least Kolmogorov–Smirnov
    distance (Clauset et al., section 3.3); the error does not know of that choice. Values are taken
    as independent and continuous: durations in rows are not.

        events = analysis.avalanches(run.series["stress_ratio"])
        tau, error, *_ = analysis.power_law(events["size"], least=1e-4)

    Args:
        values: [n], above 0.
        least: x_least; by default found.
        greatest: Values above it are left out.

    Raises:
        ValueError: Fewer than ten values are left, or they do not differ.
    """
    x = _positive(values)
    x = x[x <= greatest]
    if least is not None:
        return _power_law_from(x[x >= least], float(least), greatest)
    return _best_law(x, greatest, STARTS)


def power_law_p(
    values: ArrayLike, greatest: float = np.inf, *, repetitions: int = 200, seed: int = 0
) -> float:
    """Returns how often a sample of the fitted power law is as far from its own fit as this one.

    The share of samples with a greater Kolmogorov–Smirnov distance (Clauset, Shalizi & Newman,
    section 4.1): values from `least` on are drawn from the law, those below from the given ones,
    and `least` is found anew. The law is ruled out below 0.1, as they suggest; above it is
    possible, beside other laws.

    Args:
        values: [n], above 0.
        greatest: Values above it are left out.
        repetitions: Number of samples.
        seed: Of the samples.

    Raises:
        ValueError: As of `power_law`.
    """
    x = _positive(values)
    x = x[x <= greatest]
    found = _best_law(x, greatest, STARTS_OF_SAMPLES)
    below = x[x < found.least]
    random = np.random.default_rng(seed)
    farther = 0
    for _ in range(repetitions):
        u = random.random(int(random.binomial(len(x), found.values / len(x))))
        drawn = _drawn(found, u)
        rest = random.choice(below, len(x) - len(u)) if len(below) else drawn[:0]
        sample = np.sort(np.concatenate([rest, drawn]))
        farther += _best_law(sample, greatest, STARTS_OF_SAMPLES).distance >= found.distance
    return farther / repetitions


def event_exponents(events: pd.DataFrame) -> pd.DataFrame:
    """Returns the exponents of the sizes of events and of the times between them.

    Sizes are those of `Run.events`: numbers of grains, sums of the local strain, stress drops.
    Their density is p(s) ∝ s^-τ in elastoplastic models (Nicolas et al., Rev. Mod. Phys. 90,
    045006, 2018). Times between independent events are exponential, without an exponent.

        events = run.events()
        laws = analysis.event_exponents(events[events["grains"] > 1])

    Args:
        events: Columns of `Run.events`; those that it lacks are left out.

    Returns:
        By quantity: `exponent`, `error`, `least` and `values` of `power_law`, `decades` from
        `least` to the greatest value, `p` of `power_law_p`, and `determined`: from 50 values on,
        over at least one decade, with p of 0.1 or more. NaN with fewer than ten different values
        above 0.
    """
    rows = {}
    for name in EVENT_SIZES:
        if name not in events:
            continue
        x = events[name].to_numpy(dtype=np.float64)
        x = x[np.isfinite(x) & (x > 0)]
        if len(np.unique(x)) < FEWEST:
            rows[name] = [np.nan, np.nan, np.nan, len(x), np.nan, np.nan, False]
            continue
        law = power_law(x)
        decades, p = float(np.log10(x.max() / law.least)), power_law_p(x)
        determined = law.values >= MANY and decades >= 1 and p >= POSSIBLE
        rows[name] = [law.exponent, law.error, law.least, law.values, decades, p, determined]
    columns = ["exponent", "error", "least", "values", "decades", "p", "determined"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns)


def _positive(values: ArrayLike) -> Array:
    """Returns values in order.

    Raises:
        ValueError: Some are not above 0.
    """
    x: Array = np.sort(numbers(values))
    if not x[0] > 0:
        raise ValueError(f"the least value is {x[0]:g}; give values above 0")
    return x


def _drawn(law: PowerLaw, u: Array) -> Array:
    """Returns values of a law from numbers between 0 and 1."""
    span, power = np.log(law.greatest / law.least), law.exponent - 1
    if not np.isfinite(span):
        logarithm = -np.log1p(-u) / power
    elif power == 0:
        logarithm = u * span
    else:
        logarithm = -np.log1p(u * np.expm1(-power * span)) / power
    drawn: Array = law.least * np.exp(logarithm)
    return drawn


def _best_law(x: Array, greatest: float, most: int) -> PowerLaw:
    """Fits the law to sorted values from the one on that gives the least distance.

    Args:
        x: [n].
        greatest: Where the law ends.
        most: Number of values that are tried at most.
    """
    if len(x) < FEWEST or x[0] == x[-1]:
        raise ValueError(f"{len(x)} values have no power law; give ten or more that differ")
    # The distances of the last ones, few as they are, say nothing.
    starts = np.unique(x[: len(x) - FEWEST + 1])
    starts = starts[np.unique(np.linspace(0, len(starts) - 1, most).astype(int))]
    fits = [
        _power_law_from(x[np.searchsorted(x, start) :], float(start), greatest)
        for start in starts[starts < x[-1]]
    ]
    return min(fits, key=lambda fit: fit.distance)


def _power_law_from(x: Array, least: float, greatest: float) -> PowerLaw:
    """Fits the law to sorted values from `least` to `greatest`."""
    n = len(x)
    if n < FEWEST or not x[-1] > least > 0:
        raise ValueError(
            f"{n} values from {least:g} to {greatest:g} have no power law; "
            "give ten or more that differ"
        )
    logarithm = np.log(x / least)
    exponent, error = 1 + n / logarithm.sum(), 1 / np.sqrt(n) * n / logarithm.sum()
    span = np.log(greatest / least)
    if np.isfinite(span):
        exponent, error = _truncated(float(logarithm.mean()), float(span), n)
    power = exponent - 1
    expected = -np.expm1(-power * logarithm)
    if np.isfinite(span):
        expected = logarithm / span if power == 0 else expected / -np.expm1(-power * span)
    above, below = np.arange(1, n + 1) / n - expected, expected - np.arange(n) / n
    distance = float(max(above.max(), below.max()))
    return PowerLaw(float(exponent), float(error), least, float(greatest), n, distance)


def _truncated(mean: float, span: float, count: int) -> tuple[float, float]:
    """Returns α and its error of logarithms with this mean, of a law that ends at `span`.

    ln(x/x_least) is exponential with the rate α - 1, cut off at `span`: its mean falls with the
    rate from the span to 0.
    """
    from scipy.optimize import brentq

    def mean_at(rate: float) -> float:
        u = rate * span
        # Its series near 0, where the difference would cancel.
        return span * (0.5 - u / 12 if abs(u) < 1e-4 else 1 / u - 1 / np.expm1(u))

    bound = 10 / min(mean, span - mean)
    rate = brentq(lambda rate: mean_at(rate) - mean, -bound, bound, xtol=1e-12 * bound)
    u = rate * span
    # The variance of a logarithm is the Fisher information of one value.
    variance = span**2 * (
        1 / 12 - u**2 / 240 if abs(u) < 1e-2 else 1 / u**2 - 1 / (4 * np.sinh(u / 2) ** 2)
    )
    return 1 + rate, float(1 / np.sqrt(count * variance))
