"""Formulas of the field in a line, on arrays, series, frames and contacts.

    from gshear import Run, analysis

    with Run("out/plane-shear-2d") as run:
        g = analysis.g_of_r(run.frames[-20:])
        g.plot()
        phi = analysis.solid_fractions(run.frame(-1))
        local = analysis.local_strain(run.frames, lag=10)
        events = analysis.avalanches(run.series["stress_ratio"], run.series["time"])
        alpha, error, *_ = analysis.power_law(events["size"])

Results are labelled arrays of xarray or tables of pandas. Units are those of what is given, as the
attribute `units` says; those below are of runs in SI, in 2D per unit depth.
"""

from __future__ import annotations

from ..means import TimeMean, block_error, durations, time_mean
from .cells import solid_fractions
from .contacts import fabric, force_distributions, grain_stress, mobilisation, rattlers
from .deformation import displacement, local_strain, non_affine_displacement
from .events import (
    PowerLaw,
    avalanches,
    b_value,
    event_exponents,
    power_law,
    power_law_p,
)
from .fields import Fields, coarse_grained, profiles
from .flow import fit_mu_of_i, fit_phi_of_i
from .fluctuations import Temperatures, temperatures
from .modes import participation_ratio
from .series import autocorrelation, power_spectrum
from .structure import g_of_r, spatial_correlation, structure_factor

__all__ = [
    "Fields",
    "PowerLaw",
    "Temperatures",
    "TimeMean",
    "autocorrelation",
    "avalanches",
    "b_value",
    "block_error",
    "coarse_grained",
    "displacement",
    "durations",
    "event_exponents",
    "fabric",
    "fit_mu_of_i",
    "fit_phi_of_i",
    "force_distributions",
    "g_of_r",
    "grain_stress",
    "local_strain",
    "mobilisation",
    "non_affine_displacement",
    "participation_ratio",
    "power_law",
    "power_law_p",
    "power_spectrum",
    "profiles",
    "rattlers",
    "solid_fractions",
    "spatial_correlation",
    "structure_factor",
    "temperatures",
    "time_mean",
]
