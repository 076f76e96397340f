//! Least-squares fit of a, b, D_c and μ* to measured friction, with the spring slider as forward
//! model; of a second state variable, k̄ and a trend, too, and of all but those that are given.

use nalgebra::{DMatrix, DVector};

use super::evolution_law::{Evolution, SliderModel};
use super::noise::correlation;
use super::quantity::{Estimate, FitForm, MODEL_ERROR, Quantity};
use super::search::{FitProblem, segments};
use super::steps_and_holds::student;
use super::window::FitWindow;

/// The best-fitting model, its intervals and residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The model at the estimates.
    pub model: SliderModel,
    /// The estimates, in the order of tables; given ones with an interval of their value alone.
    pub estimates: Vec<(Quantity, Estimate)>,
    /// The parameters that were given.
    pub given: Vec<Quantity>,
    /// Root mean square of the residuals, all means with equal weight.
    pub rms: f64,
    /// Σ n/g over the segments: the number of independent values the means are worth.
    pub effective: f64,
    /// `[windows][means]` measured minus modelled μ.
    pub residuals: Vec<Vec<f64>>,
    /// `[segments]` of all windows, γ_0 g of the residuals.
    pub(super) noise: Vec<f64>,
    /// Greatest displacement of the drive (m).
    pub(super) length: f64,
}

impl Fit {
    /// Returns an estimate, if the model has the quantity.
    pub fn estimate(&self, quantity: Quantity) -> Option<Estimate> {
        let found = self.estimates.iter().find(|(name, _)| *name == quantity);
        found.map(|(_, estimate)| *estimate)
    }

    /// Returns the names of the parameters that the data do not determine.
    pub fn undetermined(&self) -> Vec<&'static str> {
        let without = self.estimates.iter().filter(|(_, e)| !e.determined);
        without.map(|(quantity, _)| quantity.name()).collect()
    }
}

/// Fits a law to all windows together, as [`FitProblem::solved`] searches.
///
/// Segments are weighted by the noise of their residuals, γ_0 g (variance and statistical
/// inefficiency, see [`correlation`]), as a first fit with equal weight per
/// segment gives it. The covariance of the parameters is
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
/// Satterthwaite, (ΣC_s)²/Σ(C_s²/ν). Parameters that take part in a direction of A without
/// curvature are not determined, those beside it keep their intervals; a k̄ that is not determined
/// has the lower end of its profile. V* is the first velocity of the first window.
///
/// # Errors
/// Says why there is no fit: no windows, no convergence, a failed integration, or data that do not
/// determine the parameters.
pub(crate) fn fit(
    windows: &[FitWindow],
    evolution: Evolution,
    form: &FitForm,
) -> Result<Fit, String> {
    if windows.is_empty() {
        return Err("no window to fit: give at least one record with a slide".into());
    }
    let problem = FitProblem::solved(windows, evolution, form)?;
    let noise = noise(windows, &problem.residuals_of_windows()?);
    let roots = noise.iter().map(|noise| noise.variance.sqrt().recip());
    let problem = problem.weighted_by(roots.collect())?;
    result(windows, form, &problem)
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

/// The values of the segments of all windows, from `[windows][means]`.
fn by_segment<'a>(
    windows: &'a [FitWindow],
    values: &'a [Vec<f64>],
) -> impl Iterator<Item = &'a [f64]> {
    let windows = windows.iter().zip(values);
    windows.flat_map(|(window, values)| window.segments.iter().map(|means| &values[means.clone()]))
}

/// `[segments]` of all windows.
fn noise(windows: &[FitWindow], residuals: &[Vec<f64>]) -> Vec<Noise> {
    let segments = by_segment(windows, residuals);
    segments.map(Noise::of_residuals).collect()
}

/// The fit at the minimum of a problem.
fn result(windows: &[FitWindow], form: &FitForm, problem: &FitProblem<'_>) -> Result<Fit, String> {
    let residuals = problem.residuals_of_windows()?;
    let noise = noise(windows, &residuals);
    let effective: f64 = noise.iter().map(|noise| noise.effective).sum();
    let count = problem.fitted().len();
    if effective < count as f64 + 1.0 {
        return Err(format!(
            "the data are worth {effective:.1} independent values, but {count} parameters need at least {}; record longer or more often",
            count + 1
        ));
    }
    let covariance = Covariance::of(windows, problem, &noise)?;
    let model = problem.model();
    let drives = windows.iter().flat_map(FitWindow::mean_displacements);
    let length = drives.fold(0.0, f64::max);
    let quantities = Quantity::ALL.into_iter().filter(|q| form.has(*q));
    let estimates = quantities.map(|quantity| {
        let value = match quantity {
            _ if let Some(given) = form.given(quantity) => given,
            Quantity::AMinusB => model.law.rate_dependence(),
            _ if quantity.is_logarithmic() => problem.value(quantity).exp(),
            _ => problem.value(quantity),
        };
        let half_width = covariance.half_width(&factors(problem, quantity));
        let mut estimate = quantity.estimate(value, half_width, length);
        if quantity == Quantity::Stiffness && !estimate.determined {
            // A spring too stiff for the rows: any stiffer one would do as well.
            let freedom = noise.iter().map(|noise| noise.freedom).sum();
            let least = problem.least_stiffness(student(freedom).powi(2));
            estimate.interval = [least, f64::INFINITY];
        }
        (quantity, estimate)
    });
    let means = residuals.iter().map(Vec::len).sum::<usize>() as f64;
    let square: f64 = residuals.iter().flatten().map(|r| r * r).sum();
    Ok(Fit {
        model,
        estimates: estimates.collect(),
        given: form.given.iter().map(|(quantity, _)| *quantity).collect(),
        rms: (square / means).sqrt(),
        effective,
        residuals,
        noise: noise.iter().map(|noise| noise.variance).collect(),
        length,
    })
}

/// Derivatives of a quantity by the fitted parameters.
fn factors(problem: &FitProblem<'_>, quantity: Quantity) -> DVector<f64> {
    let fitted = problem.fitted().into_iter();
    let factors = fitted.map(|parameter| match (quantity, parameter) {
        // d(a - b) = a d(ln a) - db
        (Quantity::AMinusB, Quantity::A) => problem.value(parameter).exp(),
        (Quantity::AMinusB, Quantity::B | Quantity::SecondB) => -1.0,
        (quantity, parameter) if quantity == parameter => 1.0,
        _ => 0.0,
    });
    DVector::from_vec(factors.collect())
}

/// Covariance of the fitted parameters.
struct Covariance {
    /// C_s of each segment and its degrees of freedom.
    parts: Vec<(DMatrix<f64>, f64)>,
    /// 1/√A_ii of each parameter.
    scale: DVector<f64>,
    /// `[parameters][directions]` Directions of the scaled parameters in which the data do not
    /// change.
    free: DMatrix<f64>,
}

impl Covariance {
    /// # Errors
    /// If none of a, b and D_c has an effect that the data would show.
    fn of(
        windows: &[FitWindow],
        problem: &FitProblem<'_>,
        noise: &[Noise],
    ) -> Result<Self, String> {
        let j = problem.derivatives();
        let mut squares = Vec::new();
        let mut row = 0;
        for ((means, root), noise) in segments(windows).zip(problem.roots()).zip(noise) {
            let part = j.rows(row, means.len());
            // `part` holds weighted derivatives, so this is w JᵀJ.
            squares.push((part.transpose() * part, root * root, *noise));
            row += means.len();
        }
        let count = j.ncols();
        let mut a = DMatrix::zeros(count, count);
        for (square, ..) in &squares {
            a += square;
        }
        // Scaled to a unit diagonal, so that small parameters count as much as large ones.
        let scale = a
            .diagonal()
            .map(|d: f64| if d > 0.0 { d.sqrt().recip() } else { 1.0 });
        let diagonal = DMatrix::from_diagonal(&scale);
        let scaled = (&diagonal * a * &diagonal).symmetric_eigen();
        let (mut inverse, mut free) = (DMatrix::zeros(count, count), Vec::new());
        for (value, direction) in scaled
            .eigenvalues
            .iter()
            .zip(scaled.eigenvectors.column_iter())
        {
            if *value > SINGULAR {
                inverse += direction * direction.transpose() / *value;
            } else {
                free.push(direction.into_owned());
            }
        }
        let inverse = &diagonal * inverse * &diagonal;
        let parts = squares.into_iter().map(|(square, weight, noise)| {
            let taken = (&square * &inverse).trace();
            let variance = noise.variance * (1.0 + taken / noise.freedom);
            let part = &inverse * square * &inverse * (weight * variance);
            (part, noise.freedom)
        });
        let mut covariance = Self {
            parts: parts.collect(),
            free: DMatrix::zeros(count, free.len()),
            scale,
        };
        for (k, direction) in free.iter().enumerate() {
            covariance.free.set_column(k, direction);
        }
        let of_law: Vec<Quantity> = problem.fitted();
        let of_law: Vec<Quantity> = of_law
            .into_iter()
            .filter(|quantity| Quantity::GIVEN.contains(quantity))
            .collect();
        let is_lost = |quantity: &Quantity| {
            let half_width = covariance.half_width(&factors(problem, *quantity));
            half_width.is_infinite()
        };
        if !of_law.is_empty() && of_law.iter().all(is_lost) {
            let names = of_law.iter().map(|quantity| quantity.name());
            return Err(format!(
                "these data do not determine {}: add velocity steps or holds",
                names.collect::<Vec<_>>().join(", ")
            ));
        }
        Ok(covariance)
    }

    /// Half the 95 % interval of the linear combination of parameters with these factors.
    fn half_width(&self, factors: &DVector<f64>) -> f64 {
        let scaled = factors.component_mul(&self.scale);
        if self.free.tr_mul(&scaled).norm() > ALONG_FREE * scaled.norm() {
            return f64::INFINITY;
        }
        let parts = self.parts.iter().map(|(part, freedom)| {
            let variance = factors.dot(&(part * factors));
            (variance, variance * variance / freedom)
        });
        let (variance, square) = parts.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        if variance == 0.0 {
            // Of given parameters alone.
            return 0.0;
        }
        student(variance * variance / square) * variance.sqrt()
    }
}

/// Least eigenvalue of the scaled JᵀJ; below it the finite differences of the model are noise.
const SINGULAR: f64 = 1e-9;
/// Share of a parameter in a direction without curvature from which on it is not determined.
const ALONG_FREE: f64 = 1e-3;
