"""Fits of μ(I) and Φ(I), compared with SciPy and planted laws."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats

from gshear.analysis import fit_mu_of_i, fit_phi_of_i

I = np.geomspace(1e-3, 0.6, 12)  # noqa: E741 - the symbol of the inertial number


def noise(sigma: float, seed: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(0, sigma, len(I))


def jop(i: NDArray[np.float64], mu_s: float, mu_2: float, i_0: float) -> NDArray[np.float64]:
    return np.asarray(mu_s + (mu_2 - mu_s) / (1 + i_0 / i))


def power(i: NDArray[np.float64], mu_s: float, a: float, alpha: float) -> NDArray[np.float64]:
    return np.asarray(mu_s + a * i**alpha)


def test_linear_laws_have_the_intervals_of_student() -> None:
    mu = 0.3 + 0.9 * I + noise(0.01, 1)
    fit = fit_mu_of_i(I, mu, law="linear", confidence=0.9)
    line = stats.linregress(I, mu)
    t = stats.t.ppf(0.95, len(I) - 2)
    for name, value, error in (
        ("mu_s", line.intercept, line.intercept_stderr),
        ("b", line.slope, line.stderr),
    ):
        np.testing.assert_allclose(
            fit.loc[name], [value, value - t * error, value + t * error], rtol=1e-7
        )
    assert fit.attrs["law"] == "linear"
    assert fit.attrs["residual"] == pytest.approx(np.std(mu - 0.3 - 0.9 * I), rel=0.2)
    phi = fit_phi_of_i(I, 0.81 - 0.3 * I + noise(0.001, 2))
    assert phi.index.tolist() == ["phi_c", "a"]
    assert (phi["low"] < [0.81, 0.3]).all()
    assert (phi["high"] > [0.81, 0.3]).all()


def test_given_errors_have_the_intervals_of_gauss() -> None:
    sigma = 0.002 * (1 + np.arange(len(I)))
    mu = 0.3 + 0.9 * I + noise(1, 3) * sigma
    fit = fit_mu_of_i(I, mu, sigma, law="linear")
    best, covariance = np.polyfit(I, mu, 1, w=1 / sigma, cov="unscaled")
    np.testing.assert_allclose(fit["value"], best[::-1], rtol=1e-8)
    half = 1.959964 * np.sqrt(np.diag(covariance))[::-1]
    np.testing.assert_allclose(fit["high"] - fit["value"], half, rtol=1e-5)
    np.testing.assert_allclose(fit["value"] - fit["low"], half, rtol=1e-5)
    assert 0.2 < fit.attrs["chi2_per_dof"] < 3


@pytest.mark.parametrize("law", ["jop", "power"])
def test_curved_laws_are_fitted_as_by_scipy(law: str) -> None:
    function = {"jop": jop, "power": power}[law]
    truth = {"jop": [0.38, 0.9, 0.25], "power": [0.3, 0.8, 0.6]}[law]
    mu = function(I, *truth) + noise(0.003, 4)
    fit = fit_mu_of_i(I, mu, law=law)
    best, covariance = optimize.curve_fit(function, I, mu, p0=truth)
    np.testing.assert_allclose(fit["value"], best, rtol=1e-4)
    # Nearly linear: half of the interval is about that of Student.
    half = stats.t.ppf(0.975, len(I) - 3) * np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((fit["high"] - fit["low"]) / 2, half, rtol=0.2)
    exact = fit_mu_of_i(I, function(I, *truth), law=law)
    np.testing.assert_allclose(exact["value"], truth, rtol=1e-4)
    # Φ(I) is the same law with the other sign.
    phi = fit_phi_of_i(I, 0.6 - 0.2 * I**0.8, law="power")
    np.testing.assert_allclose(phi["value"], [0.6, 0.2, 0.8], rtol=1e-4)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    truth = np.array([0.38, 0.9, 0.25])
    held = np.zeros(3)
    for seed in range(40):
        fit = fit_mu_of_i(I, jop(I, *truth) + noise(0.01, seed), confidence=0.8)
        held += (fit["low"] < truth) & (truth < fit["high"])
    # 32 ± 2.5 of 40.
    assert (np.abs(held - 32) < 9).all()


def test_what_the_data_do_not_bound_has_no_bound() -> None:
    """Far below I₀ the law is a line: only μ₂/I₀ is known."""
    slow = I / 100
    fit = fit_mu_of_i(slow, 0.3 + slow + noise(2e-4, 4))
    assert fit["high"]["mu_2"] == np.inf
    assert fit["high"]["I_0"] == np.inf
    assert fit["low"]["mu_s"] < 0.3 < fit["high"]["mu_s"]
    assert fit["high"]["mu_s"] - fit["low"]["mu_s"] < 0.01


def test_what_has_no_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="there is no law 'cubic'; give jop, linear, power"):
        fit_mu_of_i(I, I, law="cubic")
    with pytest.raises(ValueError, match="3 inertial numbers do not determine mu_s, mu_2, I_0"):
        fit_mu_of_i(I[:3], I[:3])
    with pytest.raises(ValueError, match="1 inertial numbers do not determine"):
        fit_mu_of_i(np.full(9, 0.1), I[:9], law="linear")
    with pytest.raises(ValueError, match="12 inertial numbers have 3 values"):
        fit_phi_of_i(I, I[:3])
    with pytest.raises(ValueError, match="must be above 0"):
        fit_phi_of_i(I - I[0], I)
    with pytest.raises(ValueError, match="confidence is 95"):
        fit_phi_of_i(I, I, confidence=95)
    with pytest.raises(ValueError, match="row 2 is not finite"):
        fit_mu_of_i([1.0, 2.0, np.nan, 4.0, 5.0], I[:5])
