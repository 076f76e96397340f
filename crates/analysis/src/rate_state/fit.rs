//! Least-squares fit of a, b, D_c and μ* to measured friction, with the spring slider as forward
//! model.

use std::ops::Range;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::storage::Owned;
use nalgebra::{Dyn, Matrix4, OMatrix, OVector, U4, Vector4};

use super::evolution_law::{Evolution, RateStateLaw};
use super::noise::correlation;
use super::steps_and_holds::student;
use super::window::FitWindow;
use crate::moments::joint_moments;

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

/// The best-fitting law, its intervals and residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The law at the estimates.
    pub law: RateStateLaw,
    /// a, the direct effect.
    pub a: Estimate,
    /// b, the evolution effect.
    pub b: Estimate,
    /// a - b.
    pub a_minus_b: Estimate,
    /// D_c (m).
    pub d_c: Estimate,
    /// μ*, at V* of the law.
    pub mu_star: Estimate,
    /// Root mean square of the residuals, all means with equal weight.
    pub rms: f64,
    /// Σ n/g over the segments: the number of independent values the means are worth.
    pub effective: f64,
    /// `[windows][means]` measured minus modelled μ.
    pub residuals: Vec<Vec<f64>>,
    /// `[segments]` of all windows, γ_0 g of the residuals.
    pub(super) noise: Vec<f64>,
}

impl Fit {
    /// Returns the estimates with their names in tables.
    pub fn estimates(&self) -> [(&'static str, Estimate); 5] {
        [
            ("a", self.a),
            ("b", self.b),
            ("a_minus_b", self.a_minus_b),
            ("d_c", self.d_c),
            ("mu_star", self.mu_star),
        ]
    }

    /// Returns the names of the parameters that the data do not determine.
    pub fn undetermined(&self) -> Vec<&'static str> {
        let without = self.estimates().into_iter().filter(|(_, e)| !e.determined);
        without.map(|(name, _)| name).collect()
    }
}

/// Number of parameters: ln a, b, ln D_c, μ*. a and D_c are positive; b may be zero or negative, if
/// friction only strengthens with velocity.
const PARAMETERS: usize = 4;
/// Steps of the central differences in ln a, b and ln D_c.
const DIFFERENCES: [f64; 3] = [1e-3, 1e-5, 1e-3];
/// Residual assigned to a failed integration, so that the search turns back.
const FAILED: f64 = 1e3;
/// Numerical error of the forward model in μ, the lower bound of the noise.
const MODEL_ERROR: f64 = 1e-7;

/// Fits a law to all windows together, starting from several a and D_c.
///
/// Segments are weighted by the noise of their residuals, γ_0 g (variance and statistical
/// inefficiency, see [`correlation`]), as a first fit with equal weight per
/// segment gives it. The covariance of ln a, b, ln D_c, μ* is
///
/// ```text
/// C = Σ C_s,   C_s = A⁻¹ (w_s² γ_0 g (1 + h/ν) J_sᵀJ_s) A⁻¹,   A = Σ w_s J_sᵀJ_s
/// ```
///
/// with sums over the segments s, the derivatives J, the weights w, and γ_0 g of the final
/// residuals. Thus n correlated values count as n/g independent ones. γ_0 g is a sum over 2W + 1
/// lags, as uncertain as an average of ν = n/(2W + 1) independent squares. The h = tr(w_s J_sᵀJ_s
/// A⁻¹) parameters that the segment determines bias it low by the share h/ν (Wolff 2004, eq. 49,
/// where h = 1). Intervals are 95 % by Student's t with the degrees of freedom of Welch and
/// Satterthwaite, (ΣC_s)²/Σ(C_s²/ν). V* is the first velocity of the first window.
///
/// # Errors
/// Says why there is no fit: no windows, no convergence, a failed integration, or data that do not
/// determine the parameters.
pub(crate) fn fit(windows: &[FitWindow], evolution: Evolution) -> Result<Fit, String> {
    let Some(first) = windows.first() else {
        return Err("no window to fit: give at least one record with a slide".into());
    };
    let v_star = first.drive[0].velocity;
    let mut problem = FitProblem {
        windows,
        evolution,
        v_star,
        roots: segments(windows).map(equal_weight).collect(),
        at: Vector4::zeros(),
    };
    problem.at = problem.guess();
    problem = problem.minimized()?;
    let noise = problem.noise(&problem.residuals_of_windows()?);
    problem.roots = noise
        .iter()
        .map(|noise| noise.variance.sqrt().recip())
        .collect();
    problem.minimized()?.result()
}

/// Returns χ² of `fit` in units of the noise that `noise_of` left: Σ r²/(γ_0 g) over all means.
///
/// The χ² of `noise_of` itself is its `effective`. Of two laws fitted to the same
/// windows, the one with the lesser χ² is more likely; take the noise from the fit with the lesser
/// `rms`.
pub(crate) fn chi_squared(windows: &[FitWindow], fit: &Fit, noise_of: &Fit) -> f64 {
    let squares = by_segment(windows, &fit.residuals)
        .map(|residuals| residuals.iter().map(|r| r * r).sum::<f64>());
    squares
        .zip(&noise_of.noise)
        .map(|(square, noise)| square / noise)
        .sum()
}

/// Noise of the residuals in one segment.
#[derive(Debug, Clone, Copy)]
struct Noise {
    /// γ_0 g.
    variance: f64,
    /// n/g.
    effective: f64,
    /// ν = n/(2W + 1), at least 1.
    freedom: f64,
}

impl Noise {
    fn of_residuals(residuals: &[f64]) -> Self {
        let correlation = correlation(residuals);
        let floor = MODEL_ERROR * MODEL_ERROR;
        Self {
            variance: correlation.spectral_variance().max(floor),
            effective: residuals.len() as f64 / correlation.inefficiency,
            freedom: (residuals.len() as f64 / (2 * correlation.window + 1) as f64).max(1.0),
        }
    }
}

/// The least-squares problem at a point.
#[derive(Clone)]
struct FitProblem<'a> {
    windows: &'a [FitWindow],
    evolution: Evolution,
    v_star: f64,
    /// `[segments]` of all windows, square roots of the weights.
    roots: Vec<f64>,
    /// ln a, b, ln D_c, μ*.
    at: Vector4<f64>,
}

/// The square root of the weight of a segment if all segments count alike.
fn equal_weight(means: &Range<usize>) -> f64 {
    (means.len().max(1) as f64).sqrt().recip()
}

/// The segments of all windows.
fn segments(windows: &[FitWindow]) -> impl Iterator<Item = &Range<usize>> {
    windows.iter().flat_map(|window| &window.segments)
}

/// The values of the segments of all windows, from `[windows][means]`.
fn by_segment<'a>(
    windows: &'a [FitWindow],
    values: &'a [Vec<f64>],
) -> impl Iterator<Item = &'a [f64]> {
    let windows = windows.iter().zip(values);
    windows.flat_map(|(window, values)| window.segments.iter().map(|means| &values[means.clone()]))
}

impl FitProblem<'_> {
    fn law(&self, at: &Vector4<f64>) -> RateStateLaw {
        RateStateLaw {
            evolution: self.evolution,
            mu_star: at[3],
            a: at[0].exp(),
            b: at[1],
            d_c: at[2].exp(),
            v_star: self.v_star,
        }
    }

    /// Start of the search: the a and D_c of least cost on a coarse grid, with a - b and μ* from
    /// the friction at the end of every slide.
    fn guess(&self) -> Vector4<f64> {
        let (mut points, mut longest) = (Vec::new(), 0.0_f64);
        for window in self.windows {
            for (k, segment) in window.drive.iter().enumerate() {
                if !segment.is_hold() {
                    let ln_v = (segment.velocity / self.v_star).ln();
                    points.push([ln_v, window.steady_friction(k)]);
                    longest = longest.max(segment.distance());
                }
            }
        }
        let ([x, y], [spread, both]) = joint_moments(&points);
        let slope = if spread > 1e-6 { both / spread } else { 0.0 };
        let mut best = (f64::INFINITY, Vector4::zeros());
        for a in [0.003, 0.01, 0.03] {
            for share in [0.01, 0.03, 0.1, 0.3] {
                let ln_d_c = f64::ln(share * longest);
                let at = Vector4::new(f64::ln(a), a - slope, ln_d_c, y - slope * x);
                let cost = self.weighted(&at).norm_squared();
                if cost < best.0 {
                    best = (cost, at);
                }
            }
        }
        best.1
    }

    fn means(&self) -> usize {
        let windows = self.windows.iter();
        windows.map(|window| window.friction.len()).sum()
    }

    /// Weighted residuals of all means; each is `FAILED` if the integration fails.
    fn weighted(&self, at: &Vector4<f64>) -> OVector<f64, Dyn> {
        let law = self.law(at);
        let mut all = Vec::with_capacity(self.means());
        let mut roots = self.roots.iter();
        for window in self.windows {
            let model = window.model_means(&law);
            for (means, root) in window.segments.iter().zip(&mut roots) {
                all.extend(means.clone().map(|k| match &model {
                    Ok(model) => root * (window.friction[k] - model[k]),
                    Err(_) => root * FAILED,
                }));
            }
        }
        OVector::<f64, Dyn>::from_vec(all)
    }

    /// Derivatives of the weighted residuals by ln a, b, ln D_c, μ*.
    fn derivatives(&self) -> OMatrix<f64, Dyn, U4> {
        let mut j = OMatrix::<f64, Dyn, U4>::zeros(self.means());
        for (c, h) in DIFFERENCES.into_iter().enumerate() {
            let [after, before] = [h, -h].map(|by| {
                let mut at = self.at;
                at[c] += by;
                self.weighted(&at)
            });
            j.set_column(c, &((after - before) / (2.0 * h)));
        }
        let segments = segments(self.windows).zip(&self.roots);
        let roots = segments.flat_map(|(means, root)| std::iter::repeat_n(-root, means.len()));
        j.set_column(3, &OVector::<f64, Dyn>::from_iterator(self.means(), roots));
        j
    }

    fn minimized(self) -> Result<Self, String> {
        let (problem, report) = LevenbergMarquardt::new()
            .with_tol(1e-8)
            .with_patience(30)
            .minimize(self);
        match report.termination {
            reason if reason.was_successful() => Ok(problem),
            TerminationReason::LostPatience => Err(format!(
                "the fit did not converge within {} evaluations: add velocity steps or holds",
                report.number_of_evaluations
            )),
            reason => Err(format!("the fit did not converge: {reason:?}")),
        }
    }

    /// `[windows][means]` measured less model.
    fn residuals_of_windows(&self) -> Result<Vec<Vec<f64>>, String> {
        let law = self.law(&self.at);
        let residuals = self.windows.iter().map(|window| {
            let model = window.model_means(&law)?;
            let pairs = window.friction.iter().zip(model);
            Ok(pairs.map(|(measured, model)| measured - model).collect())
        });
        residuals.collect()
    }

    /// `[segments]` of all windows.
    fn noise(&self, residuals: &[Vec<f64>]) -> Vec<Noise> {
        let segments = by_segment(self.windows, residuals);
        segments.map(Noise::of_residuals).collect()
    }

    fn result(self) -> Result<Fit, String> {
        let residuals = self.residuals_of_windows()?;
        let noise = self.noise(&residuals);
        let effective: f64 = noise.iter().map(|noise| noise.effective).sum();
        if effective < PARAMETERS as f64 + 1.0 {
            return Err(format!(
                "the data are worth {effective:.1} independent values, but {PARAMETERS} parameters need at least {}; record longer or more often",
                PARAMETERS + 1
            ));
        }
        let covariance = self.covariance(&noise)?;
        let law = self.law(&self.at);
        // d(a - b) = a d(ln a) - db
        let [a, b, a_minus_b, d_c, mu_star] = [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [law.a, -1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
        .map(|factors| half_width(&covariance, &Vector4::from(factors)));
        let count = residuals.iter().map(Vec::len).sum::<usize>() as f64;
        let square: f64 = residuals.iter().flatten().map(|r| r * r).sum();
        Ok(Fit {
            a: Estimate::direct_effect(law.a, a),
            b: Estimate::linear(law.b, b),
            a_minus_b: Estimate::linear(law.a - law.b, a_minus_b),
            d_c: Estimate::logarithmic(law.d_c, d_c),
            mu_star: Estimate::linear(law.mu_star, mu_star),
            law,
            rms: (square / count).sqrt(),
            effective,
            residuals,
            noise: noise.iter().map(|noise| noise.variance).collect(),
        })
    }

    /// C_s of each segment and its degrees of freedom.
    fn covariance(&self, noise: &[Noise]) -> Result<Vec<(Matrix4<f64>, f64)>, String> {
        let j = self.derivatives();
        let mut squares = Vec::new();
        let mut row = 0;
        for ((means, root), noise) in segments(self.windows).zip(&self.roots).zip(noise) {
            let part = j.rows(row, means.len());
            // `part` holds weighted derivatives, so this is w JᵀJ.
            squares.push((part.transpose() * part, root * root, *noise));
            row += means.len();
        }
        let a: Matrix4<f64> = squares.iter().map(|(square, ..)| square).sum();
        // Scaled to a unit diagonal, so that small parameters count as much as large ones.
        let scale = Matrix4::from_diagonal(&a.diagonal().map(|d: f64| d.sqrt().recip()));
        let scaled = scale * a * scale;
        let inverse = if scaled.symmetric_eigenvalues().min() > SINGULAR {
            scaled.try_inverse()
        } else {
            None
        };
        let inverse = inverse
            .ok_or("these data do not determine a, b, D_c and μ*: add velocity steps or holds")?;
        let inverse = scale * inverse * scale;
        let parts = squares.into_iter().map(|(square, weight, noise)| {
            let taken = (square * inverse).trace();
            let variance = noise.variance * (1.0 + taken / noise.freedom);
            let part = inverse * square * inverse * (weight * variance);
            (part, noise.freedom)
        });
        Ok(parts.collect())
    }
}

/// Half the 95 % interval of the linear combination of parameters with these factors.
fn half_width(covariance: &[(Matrix4<f64>, f64)], factors: &Vector4<f64>) -> f64 {
    let parts = covariance.iter().map(|(part, freedom)| {
        let variance = factors.dot(&(part * factors));
        (variance, variance * variance / freedom)
    });
    let (variance, square) = parts.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    student(variance * variance / square) * variance.sqrt()
}

/// Least eigenvalue of the scaled JᵀJ; below it the finite differences of the model are noise.
const SINGULAR: f64 = 1e-9;

impl LeastSquaresProblem<f64, Dyn, U4> for FitProblem<'_> {
    type ParameterStorage = Owned<f64, U4>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, U4>;

    fn set_params(&mut self, at: &Vector4<f64>) {
        self.at = *at;
    }

    fn params(&self) -> Vector4<f64> {
        self.at
    }

    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        Some(self.weighted(&self.at))
    }

    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, U4>> {
        Some(self.derivatives())
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
