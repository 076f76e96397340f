"""Laws of dense flows: friction and solid fraction over the inertial number."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from ._given import numbers

Array = NDArray[np.float64]


class _Law(NamedTuple):
    """A law y = p₁ b₁(I; q) + p₂ b₂(I; q), with or without a parameter q that is not linear.

    Attributes:
        names: Those of p₁, p₂ and q.
        basis: Returns b₁ and b₂ of I and q.
        bounds: Within which q is searched, given the least and the greatest I.
    """

    names: tuple[str, ...]
    basis: Callable[[Array, Array], tuple[Array, Array]]
    bounds: Callable[[float, float], tuple[float, float]] = lambda _least, _greatest: (1.0, 1.0)


def _exponents(_least: float, _greatest: float) -> tuple[float, float]:
    return 0.02, 10.0


MU_LAWS = {
    "jop": _Law(
        ("mu_s", "mu_2", "I_0"),
        lambda i, q: (q / (q + i), i / (q + i)),
        lambda least, greatest: (least / 1e4, greatest * 1e4),
    ),
    "linear": _Law(("mu_s", "b"), lambda i, q: (q**0, i * q**0)),
    "power": _Law(("mu_s", "A", "alpha"), lambda i, q: (q**0, i**q), _exponents),
}
PHI_LAWS = {
    "linear": _Law(("phi_c", "a"), lambda i, q: (q**0, -i * q**0)),
    "power": _Law(("phi_c", "a", "alpha"), lambda i, q: (q**0, -(i**q)), _exponents),
}
# Values of q among which the best one is searched first.
GRID = 120
# Factor by which they reach further, to see whether an end of an interval follows from them.
WIDER = 3.0
# Beyond so many times the scatter of the data a parameter is not bounded by them.
UNBOUNDED = 1e6


def fit_mu_of_i(
    inertial_number: ArrayLike,
    mu: ArrayLike,
    errors: ArrayLike | None = None,
    *,
    law: str = "jop",
    confidence: float = 0.95,
) -> pd.DataFrame:
    """Fits μ(I) by least squares, with confidence intervals.

    - `jop`: μ_s + (μ_2 - μ_s)/(1 + I_0/I) (Jop, Forterre & Pouliquen, Nature 441, 727, 2006)
    - `linear`: μ_s + b I, for I below 0.3 or so (da Cruz et al., Phys. Rev. E 72, 021309, 2005)
    - `power`: μ_s + A I^α (Peyneau & Roux, Phys. Rev. E 78, 011307, 2008)

    Intervals are those of the profile: a parameter is within it while the least sum of squares over
    the others rises by less than the quantile of F, times the variance (Bates & Watts, Nonlinear
    Regression Analysis, 1988, chapter 6), or of χ² if errors are given. Where the data do not bound
    a parameter, such as μ_2 far below I_0, the interval is infinite.

        fit = analysis.fit_mu_of_i(flow["I"], flow["mu"], flow["mu_error"])

    Args:
        inertial_number: [n], above 0.
        mu: [n].
        errors: [n], standard errors of μ; by default equal and unknown.
        law: `jop`, `linear` or `power`.
        confidence: Share of repetitions in which an interval holds the parameter.

    Returns:
        A row for each parameter: `value`, `low` and `high`. `attrs` has `law`, `confidence`,
        `residual`, the root mean square of the residuals, and `chi2_per_dof`, if errors are given.

    Raises:
        ValueError: Fewer points than parameters and one, wrong numbers, or no such law.
    """
    return _fit(MU_LAWS, law, inertial_number, mu, errors, confidence)


def fit_phi_of_i(
    inertial_number: ArrayLike,
    phi: ArrayLike,
    errors: ArrayLike | None = None,
    *,
    law: str = "linear",
    confidence: float = 0.95,
) -> pd.DataFrame:
    """Fits Φ(I) by least squares, with confidence intervals as of `fit_mu_of_i`.

    - `linear`: Φ_c - a I (da Cruz et al., Phys. Rev. E 72, 021309, 2005)
    - `power`: Φ_c - a I^α (Peyneau & Roux, Phys. Rev. E 78, 011307, 2008)

    Args:
        inertial_number: [n], above 0.
        phi: [n].
        errors: [n], standard errors of Φ; by default equal and unknown.
        law: `linear` or `power`.
        confidence: Share of repetitions in which an interval holds the parameter.

    Returns:
        As `fit_mu_of_i`.

    Raises:
        ValueError: As `fit_mu_of_i`.
    """
    return _fit(PHI_LAWS, law, inertial_number, phi, errors, confidence)


class _Problem(NamedTuple):
    """Points to which a law is fitted, over their errors.

    Attributes:
        law: The law.
        x: [n], inertial numbers.
        y: [n], values over their errors.
        weight: [n], 1 over the errors.
        grid: Values of q among which the best one is searched first.
    """

    law: _Law
    x: Array
    y: Array
    weight: Array
    grid: Array

    def basis(self, q: Array) -> Array:
        """Returns the two functions of the law over the errors, [2, Q, n]."""
        both = self.law.basis(self.x, q[:, None])
        return np.stack([np.broadcast_to(b, (len(q), len(self.x))) for b in both]) * self.weight

    def at(self, q: Array) -> tuple[Array, Array]:
        """Returns the least sums of squares for values of q, [Q], and their p, [Q, 2]."""
        a, b = self.basis(q)
        # Orthogonal to the first one, so that nothing cancels.
        aa = (a * a).sum(axis=1)
        share = (a * b).sum(axis=1) / aa
        rest = b - share[:, None] * a
        p2 = (rest * self.y).sum(axis=1) / (rest * rest).sum(axis=1)
        p1 = (a * self.y).sum(axis=1) / aa - share * p2
        residual = self.y - p1[:, None] * a - p2[:, None] * b
        return (residual**2).sum(axis=1), np.stack([p1, p2], axis=1)

    def with_fixed(self, k: int, value: float) -> Callable[[Array], Array]:
        """Returns the least sums of squares for values of q while the k-th p is fixed."""

        def sums(q: Array) -> Array:
            both = self.basis(q)
            y, b = self.y - value * both[k], both[1 - k]
            other = (b * y).sum(axis=1) / (b * b).sum(axis=1)
            total: Array = ((y - other[:, None] * b) ** 2).sum(axis=1)
            return total

        return sums

    @property
    def widened(self) -> _Problem:
        """The same problem with more values of q on both sides."""
        low, high = self.grid[[0, -1]]
        return self._replace(grid=np.geomspace(low / WIDER, high * WIDER, len(self.grid)))

    def least(self, sums: Callable[[Array], Array]) -> tuple[float, float]:
        """Returns the q of the least sum of squares, and that sum."""
        from scipy.optimize import minimize_scalar

        if len(self.grid) == 1:
            return float(self.grid[0]), float(sums(self.grid)[0])
        values = sums(self.grid)
        k = int(values.argmin())
        low, high = np.log(self.grid[[max(k - 1, 0), min(k + 1, len(self.grid) - 1)]])
        found = minimize_scalar(
            lambda u: float(sums(np.exp([u]))[0]),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-10},
        )
        if found.fun > values[k]:
            return float(self.grid[k]), float(values[k])
        return float(np.exp(found.x)), float(found.fun)


def _fit(
    laws: dict[str, _Law],
    law: str,
    inertial_number: ArrayLike,
    values: ArrayLike,
    errors: ArrayLike | None,
    confidence: float,
) -> pd.DataFrame:
    """Fits one of the laws: see `fit_mu_of_i`."""
    from scipy import stats

    if law not in laws:
        raise ValueError(f"there is no law {law!r}; give {', '.join(laws)}")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence is {confidence}; give a share between 0 and 1")
    x, y = numbers(inertial_number), numbers(values)
    sigma = np.ones_like(x) if errors is None else numbers(errors)
    if not x.shape == y.shape == sigma.shape:
        raise ValueError(f"{len(x)} inertial numbers have {len(y)} values; give one each")
    if not ((x > 0).all() and (sigma > 0).all()):
        raise ValueError("inertial numbers and errors must be above 0")
    names = laws[law].names
    dof = len(x) - len(names)
    if dof < 1 or len(np.unique(x)) < len(names):
        raise ValueError(
            f"{len(np.unique(x))} inertial numbers do not determine {', '.join(names)} and their "
            f"intervals; give {len(names) + 1} or more"
        )
    low, high = laws[law].bounds(float(x.min()), float(x.max()))
    grid = np.geomspace(low, high, GRID if len(names) > 2 else 1)
    problem = _Problem(laws[law], x, y / sigma, 1 / sigma, grid)
    q, least = problem.least(lambda q: problem.at(q)[0])
    best = [*problem.at(np.array([q]))[1][0], q]
    if errors is None:
        limit = least * (1 + stats.f.ppf(confidence, 1, dof) / dof)
    else:
        limit = least + stats.chi2.ppf(confidence, 1)
    intervals = [_interval_of_p(problem, k, best[k], limit) for k in (0, 1)]
    if len(names) > 2:
        intervals.append(_interval_of_q(problem, q, limit))
    table = pd.DataFrame(
        {
            "value": best[: len(names)],
            "low": [low for low, _ in intervals],
            "high": [high for _, high in intervals],
        },
        index=pd.Index(names, name="parameter"),
    )
    residual = (y / sigma - np.stack(best[:2]) @ problem.basis(np.array([q]))[:, 0]) * sigma
    table.attrs |= {"law": law, "confidence": confidence}
    table.attrs["residual"] = float(np.sqrt((residual**2).mean()))
    if errors is not None:
        table.attrs["chi2_per_dof"] = least / dof
    return table


def _interval_of_p(problem: _Problem, k: int, best: float, limit: float) -> tuple[float, float]:
    """Returns between which values of the k-th p the sum of squares stays below a limit."""
    low, high = (_end_of_p(problem, k, best, limit, sign) for sign in (-1, 1))
    if len(problem.grid) == 1:
        return low, high
    # An end that follows from where the search of q ends is none of the data.
    wider = [_end_of_p(problem.widened, k, best, limit, sign) for sign in (-1, 1)]
    tolerance = 0.01 * (high - low)
    return (
        low if abs(wider[0] - low) <= tolerance else -np.inf,
        high if abs(wider[1] - high) <= tolerance else np.inf,
    )


def _end_of_p(problem: _Problem, k: int, best: float, limit: float, sign: int) -> float:
    """Returns where the sum of squares rises to a limit, from the best value of the k-th p on."""
    from scipy.optimize import brentq

    def excess(value: float) -> float:
        return problem.least(problem.with_fixed(k, value))[1] - limit

    scatter = float(np.ptp(problem.y / problem.weight)) or 1.0
    if excess(best) >= 0:
        # Data without scatter.
        return best
    step = 1e-2 * scatter
    while excess(best + sign * step) < 0:
        step *= 4
        if step > UNBOUNDED * scatter:
            return sign * np.inf
    return float(brentq(excess, *sorted((best, best + sign * step)), xtol=1e-12 * scatter))


def _interval_of_q(problem: _Problem, best: float, limit: float) -> tuple[float, float]:
    """Returns between which values of q the sum of squares stays below a limit."""
    from scipy.optimize import brentq

    def excess(u: float) -> float:
        return float(problem.at(np.exp([u]))[0][0]) - limit

    if excess(np.log(best)) >= 0:
        return best, best
    below = problem.at(problem.grid)[0] < limit
    ends = []
    for end, side in ((0.0, problem.grid < best), (np.inf, problem.grid > best)):
        # The nearest value beyond the limit, on this side of the best one.
        outside = problem.grid[side & ~below]
        if not len(outside):
            ends.append(end)
            continue
        nearest = outside.max() if end == 0 else outside.min()
        ends.append(float(np.exp(brentq(excess, *sorted((np.log(best), np.log(nearest)))))))
    return ends[0], ends[1]
