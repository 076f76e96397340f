"""Exponents of avalanches, compared with the package powerlaw and with planted laws."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import powerlaw
import pytest
from scipy import optimize

from gshear import analysis


def sample(exponent: float, count: int, seed: int, greatest: float = np.inf) -> np.ndarray:
    """Values from 1 on with the density x^-exponent, by their inverse distribution."""
    u = np.random.default_rng(seed).random(count)
    if exponent == 1:
        return np.asarray(greatest**u)
    top = greatest ** (1 - exponent) if np.isfinite(greatest) else 0.0
    return np.asarray((1 - u * (1 - top)) ** (1 / (1 - exponent)))


@pytest.mark.parametrize("exponent", [1.5, 2.4])
def test_exponents_are_those_of_the_package_powerlaw(exponent: float) -> None:
    values = sample(exponent, 600, 1)
    # Below 2 there is another law.
    values = np.concatenate([values[values > 2], np.random.default_rng(2).uniform(0.5, 2, 300)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fixed = powerlaw.Fit(values, xmin=2.0, verbose=False).power_law
        found_by_them = powerlaw.Fit(values, verbose=False)
        error = fixed.standard_err
    own = analysis.power_law(values, 2.0)
    assert own.exponent == pytest.approx(fixed.alpha, rel=1e-9)
    assert own.error == pytest.approx(error, rel=1e-9)
    assert own.values == (values >= 2).sum()
    best = analysis.power_law(values)
    assert best.least == pytest.approx(found_by_them.xmin, rel=0.1)
    assert best.exponent == pytest.approx(found_by_them.power_law.alpha, rel=0.02)
    assert best.exponent == pytest.approx(exponent, abs=4 * best.error)
    # The density S^-α has b = α - 1.
    b, _ = analysis.b_value(np.log10(values), np.log10(2.0))
    assert b == pytest.approx(own.exponent - 1, rel=1e-9)


@pytest.mark.parametrize("exponent", [0.7, 1.0, 1.3, 2.5])
def test_a_law_that_ends_has_the_greatest_likelihood(exponent: float) -> None:
    values = sample(exponent, 3000, 3, greatest=100.0)

    def likelihood(a: float) -> float:
        norm = np.log(100.0) if abs(a - 1) < 1e-12 else (100.0 ** (1 - a) - 1) / (1 - a)
        return float(a * np.log(values).sum() + len(values) * np.log(norm))

    best = optimize.minimize_scalar(likelihood, bounds=(-2, 5), method="bounded")
    own = analysis.power_law(values, 1.0, 100.0)
    assert own.exponent == pytest.approx(best.x, abs=1e-4)
    assert own.exponent == pytest.approx(exponent, abs=4 * own.error)
    # The curvature of the likelihood is one over the variance.
    h = 1e-2
    curvature = (likelihood(best.x + h) + likelihood(best.x - h) - 2 * best.fun) / h**2
    assert own.error == pytest.approx(curvature**-0.5, rel=0.01)
    assert own.distance < 1.7 / np.sqrt(3000)
    # A law without an end is too steep, most of all where it is flat.
    excess = analysis.power_law(values, 1.0).exponent - own.exponent
    assert excess > (0.2 if exponent < 1.4 else 0)


@pytest.mark.parametrize("greatest", [np.inf, 50.0])
def test_errors_of_exponents_are_the_scatter_of_repetitions(greatest: float) -> None:
    found = [
        analysis.power_law(sample(1.6, 400, seed, greatest), 1.0, greatest) for seed in range(300)
    ]
    scatter = np.std([fit.exponent for fit in found])
    assert scatter == pytest.approx(np.mean([fit.error for fit in found]), rel=0.15)


def test_avalanches_of_a_stress_have_the_planted_exponent() -> None:
    """A series that rises by what it falls, in falls of planted sizes."""
    sizes = 1e-4 * sample(1.8, 4000, 4)
    stress = np.empty(2 * len(sizes) + 1)
    stress[0] = 0
    stress[1::2] = sizes
    stress[2::2] = 0
    events = analysis.avalanches(stress)
    exponent, error, *_ = analysis.power_law(events["size"], 1e-4)
    assert exponent == pytest.approx(1.8, abs=4 * error)
    assert error < 0.02


def test_what_has_no_exponent_is_refused() -> None:
    with pytest.raises(ValueError, match="the least value is 0; give values above 0"):
        analysis.power_law([0.0, 1.0])
    with pytest.raises(ValueError, match="3 values from 1 to inf have no power law"):
        analysis.power_law([1.0, 2.0, 3.0], 1.0)
    with pytest.raises(ValueError, match="have no power law; give ten or more that differ"):
        analysis.power_law(np.full(20, 3.0))
    with pytest.raises(ValueError, match="2 values have no power law"):
        analysis.power_law([1.0, 2.0])
    with pytest.raises(ValueError, match="row 1 is not finite"):
        analysis.power_law([1.0, np.nan])


def test_samples_of_a_law_are_possible_and_others_are_not() -> None:
    p = [
        analysis.power_law_p(sample(1.9, 150, seed), repetitions=30, seed=seed)
        for seed in range(16)
    ]
    # Evenly spread: the mean of 16 is 0.5 ± 0.07.
    assert np.mean(p) == pytest.approx(0.5, abs=0.25)
    # Between 1 and 2 all values are equally frequent.
    assert analysis.power_law_p(np.linspace(1, 2, 400), repetitions=30) == 0


def test_exponents_of_events_say_whether_they_are_determined() -> None:
    count = 800
    table = pd.DataFrame(
        {
            # One in ten such samples is ruled out; this one is not.
            "strain_sum": sample(1.7, count, 6),
            "stress_drop": np.linspace(-1, 2, count),
            "waiting_strain": np.full(count, 1e-3),
        }
    )
    laws = analysis.event_exponents(table)
    assert list(laws.index) == ["strain_sum", "stress_drop", "waiting_strain"]
    error = laws["error"]["strain_sum"]
    assert laws["exponent"]["strain_sum"] == pytest.approx(1.7, abs=4 * error)
    assert laws["decades"]["strain_sum"] > 1
    assert np.isnan(laws["exponent"]["waiting_strain"])
    assert laws["determined"].tolist() == [True, False, False]
