//! What a fit estimates: quantities, which of them are fitted, and estimates with intervals.

/// What a fit estimates: a parameter of the model, or a combination of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// a, the direct effect.
    A,
    /// b, the evolution effect.
    B,
    /// D_c (m).
    Dc,
    /// μ*, at V* of the law.
    MuStar,
    /// b_2 of a second state variable.
    SecondB,
    /// D_c2 (m).
    SecondDc,
    /// k̄ (1/m).
    Stiffness,
    /// Trend of μ with the displacement of the drive (1/m).
    Trend,
    /// a - b, with b the sum of both state variables.
    AMinusB,
}

/// Values of the parameters, in the order of [`PARAMETERS`]; [`Quantity::is_logarithmic`] ones as
/// logarithms.
pub(super) type Parameters = [f64; 8];

/// The quantities that are parameters, each at its place.
pub(super) const PARAMETERS: [Quantity; 8] = [
    Quantity::A,
    Quantity::B,
    Quantity::Dc,
    Quantity::MuStar,
    Quantity::SecondB,
    Quantity::SecondDc,
    Quantity::Stiffness,
    Quantity::Trend,
];

impl Quantity {
    /// All, in the order of tables.
    pub const ALL: [Self; 9] = [
        Self::A,
        Self::B,
        Self::AMinusB,
        Self::Dc,
        Self::MuStar,
        Self::SecondB,
        Self::SecondDc,
        Self::Stiffness,
        Self::Trend,
    ];
    /// Those that can be given instead of fitted.
    pub const GIVEN: [Self; 5] = [Self::A, Self::B, Self::Dc, Self::SecondB, Self::SecondDc];

    /// Returns the name in options and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::A => "a",
            Self::B => "b",
            Self::Dc => "d_c",
            Self::MuStar => "mu_star",
            Self::SecondB => "b_2",
            Self::SecondDc => "d_c_2",
            Self::Stiffness => "stiffness",
            Self::Trend => "trend",
            Self::AMinusB => "a_minus_b",
        }
    }

    /// Whether the quantity is positive and fitted by its logarithm.
    pub fn is_logarithmic(self) -> bool {
        matches!(self, Self::A | Self::Dc | Self::SecondDc | Self::Stiffness)
    }

    /// The value as fits use it.
    pub(super) fn fitted_form(self, value: f64) -> f64 {
        if self.is_logarithmic() {
            value.ln()
        } else {
            value
        }
    }

    /// An estimate, with half of its interval as fits use it. `length` (m): displacement of the
    /// drive, over which a trend acts.
    pub(super) fn estimate(self, value: f64, half_width: f64, length: f64) -> Estimate {
        match self {
            Self::A => Estimate::direct_effect(value, half_width),
            Self::Trend => Estimate {
                determined: half_width * length < WIDEST[0],
                ..Estimate::linear(value, half_width)
            },
            _ if self.is_logarithmic() => Estimate::logarithmic(value, half_width),
            _ => Estimate::linear(value, half_width),
        }
    }
}

/// What is fitted beside a, b, D_c and μ* of one state variable, and what is given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FitForm {
    /// Whether there are two state variables.
    pub two_states: bool,
    /// Whether k̄ is fitted, the same of all records.
    pub fits_stiffness: bool,
    /// Whether a trend of μ with the displacement of the drive is fitted.
    pub detrends: bool,
    /// Parameters that are given, with their values (SI units).
    pub given: Vec<(Quantity, f64)>,
}

impl FitForm {
    /// The value of a given parameter.
    pub fn given(&self, quantity: Quantity) -> Option<f64> {
        let given = self.given.iter().find(|(name, _)| *name == quantity);
        given.map(|(_, value)| *value)
    }

    /// Whether the model has this parameter.
    pub(super) fn has(&self, parameter: Quantity) -> bool {
        match parameter {
            Quantity::SecondB | Quantity::SecondDc => self.two_states,
            Quantity::Stiffness => self.fits_stiffness,
            Quantity::Trend => self.detrends,
            _ => true,
        }
    }

    /// The parameters that are fitted, by their places.
    pub(super) fn free(&self) -> Vec<usize> {
        let places = (0..PARAMETERS.len()).filter(|place| {
            let parameter = PARAMETERS[*place];
            self.has(parameter) && self.given(parameter).is_none()
        });
        places.collect()
    }

    /// The same with one state variable.
    pub(super) fn with_one_state(&self) -> Self {
        let given = self
            .given
            .iter()
            .filter(|(quantity, _)| !matches!(quantity, Quantity::SecondB | Quantity::SecondDc));
        Self {
            two_states: false,
            given: given.copied().collect(),
            ..self.clone()
        }
    }
}

/// An estimate with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Lower and upper end of the 95 % interval.
    pub interval: [f64; 2],
    /// Whether the data say anything about it: the interval of a positive quantity spans less than
    /// a factor of 1000, that of a friction coefficient less than 2.
    pub determined: bool,
}

/// The half-widths from which on an estimate counts as not determined.
const WIDEST: [f64; 2] = [1.0, 3.454];

/// Numerical error of the forward model in μ, the lower bound of the noise.
pub(super) const MODEL_ERROR: f64 = 1e-7;

impl Estimate {
    /// Creates a symmetric interval of half-width `half_width`.
    pub(super) fn linear(value: f64, half_width: f64) -> Self {
        Estimate {
            value,
            interval: [value - half_width, value + half_width],
            determined: half_width < WIDEST[0],
        }
    }

    /// [`Estimate::logarithmic`] of a. An a below the numerical error of the model has no effect
    /// that could be measured, whatever the derivatives there, which are rounding errors.
    fn direct_effect(a: f64, half_width: f64) -> Self {
        let estimate = Self::logarithmic(a, half_width);
        Estimate {
            determined: estimate.determined && a > MODEL_ERROR,
            ..estimate
        }
    }

    /// Creates an interval that is symmetric in the logarithm, of half-width `half_width` there.
    pub(super) fn logarithmic(value: f64, half_width: f64) -> Self {
        Estimate {
            value,
            interval: [value * (-half_width).exp(), value * half_width.exp()],
            determined: half_width < WIDEST[1],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_a_of_nothing_is_not_determined() {
        let is_determined = |a, half_width| Estimate::direct_effect(a, half_width).determined;
        assert!(is_determined(0.01, 0.1));
        assert!(!is_determined(0.01, 4.0));
        assert!(!is_determined(1.5e-16, 3e-3));
    }
}
