"""Spectra and correlations of a series in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._given import numbers

Array = NDArray[np.float64]


def power_spectrum(
    values: ArrayLike, spacing: float = 1.0, *, segments: int = 1
) -> tuple[Array, Array]:
    """Returns frequencies and the one-sided power spectral density of a series.

    Welch's method (IEEE Trans. Audio Electroacoust. 15, 70, 1967): the mean of the spectra of
    segments that overlap by half, each less its mean and under a Hann window. The integral over the
    frequencies is the variance.

    Args:
        values: [n], evenly spaced.
        spacing: Between two values, such as the time (s) or the strain between two rows.
        segments: Number of segments; more of them give less noise and a coarser spectrum.

    Returns:
        Frequencies (1/unit of the spacing) and densities (square of the values' unit times that of
        the spacing).
    """
    x = numbers(values)
    if segments < 1 or not spacing > 0:
        raise ValueError(f"segments is {segments}, spacing {spacing}; give 1 or more, and above 0")
    length = 2 * (len(x) // (segments + 1)) if segments > 1 else len(x)
    if length < 4:
        raise ValueError(f"{len(x)} values are too few for {segments} segments")
    parts = np.lib.stride_tricks.sliding_window_view(x, length)[:: length // 2][:segments]
    window = np.sin(np.pi * np.arange(length) / length) ** 2
    parts = (parts - parts.mean(axis=1, keepdims=True)) * window
    scale = spacing / (window**2).sum()
    power: Array = (np.abs(np.fft.rfft(parts)) ** 2).mean(axis=0) * scale
    # Negative frequencies count with the positive ones; 0 and that of Nyquist have no other.
    power[1 : (length + 1) // 2] *= 2
    return np.arange(len(power)) / (length * spacing), power


def autocorrelation(values: ArrayLike) -> Array:
    """Returns the autocorrelation of a series at lags of 0 … n - 1 rows, [n], 1 at lag 0.

    C(k) = ⟨x(t)·x(t + k)⟩ / ⟨x·x⟩ of the values less their mean over time. Each lag is averaged
    over the pairs that it has, so that the last ones are noise.

    Args:
        values: [n], or [n, …] such as velocities [n, N, 3]; products are summed over the rest.
    """
    x = numbers(values, dimensions=None)
    x = x - x.mean(axis=0)
    n = len(x)
    # Padded by zeros, so that the ends do not meet.
    spectrum = np.abs(np.fft.rfft(x, 2 * n, axis=0)) ** 2
    sums = np.fft.irfft(spectrum.reshape(len(spectrum), -1).sum(axis=1))[:n]
    products = sums / np.arange(n, 0, -1)
    correlation: Array = products / products[0]
    return correlation
