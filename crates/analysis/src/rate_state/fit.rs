//! Least-squares fit of a, b, D_c and μ* to measured friction, with the spring slider as forward
//! model; of a second state variable, k̄ and a trend, too, and of all but those that are given.

use std::ops::Range;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};

use super::evolution_law::{Evolution, RateStateLaw, SliderModel, StateVariable};
use super::noise::correlation;
use super::steps_and_holds::student;
use super::window::FitWindow;
use crate::moments::joint_moments;

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
type Parameters = [f64; 8];

/// The quantities that are parameters, each at its place.
const PARAMETERS: [Quantity; 8] = [
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
    fn has(&self, parameter: Quantity) -> bool {
        match parameter {
            Quantity::SecondB | Quantity::SecondDc => self.two_states,
            Quantity::Stiffness => self.fits_stiffness,
            Quantity::Trend => self.detrends,
            _ => true,
        }
    }

    /// The parameters that are fitted, by their places.
    fn free(&self) -> Vec<usize> {
        let places = (0..PARAMETERS.len()).filter(|place| {
            let parameter = PARAMETERS[*place];
            self.has(parameter) && self.given(parameter).is_none()
        });
        places.collect()
    }

    /// The same with one state variable.
    fn with_one_state(&self) -> Self {
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

/// Steps of the central differences in the logarithms, and in b.
const DIFFERENCES: [f64; 2] = [1e-3, 1e-5];
/// Residual assigned to a failed integration, so that the search turns back.
const FAILED: f64 = 1e3;
/// Numerical error of the forward model in μ, the lower bound of the noise.
const MODEL_ERROR: f64 = 1e-7;

/// Fits a law to all windows together, starting from several a and D_c; of two state variables
/// from several pairs of D_c around the D_c of one.
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
/// Satterthwaite, (ΣC_s)²/Σ(C_s²/ν). V* is the first velocity of the first window.
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
    let mut problem = if form.two_states {
        FitProblem::new(windows, evolution, form).of_two_states()?
    } else {
        FitProblem::new(windows, evolution, form).minimized()?
    };
    let noise = problem.noise(&problem.residuals_of_windows()?);
    problem.roots = noise
        .iter()
        .map(|noise| noise.variance.sqrt().recip())
        .collect();
    problem.minimized()?.ordered().result()
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
    form: FitForm,
    /// Places of the parameters that are fitted.
    free: Vec<usize>,
    v_star: f64,
    /// `[segments]` of all windows, square roots of the weights.
    roots: Vec<f64>,
    at: Parameters,
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

impl<'a> FitProblem<'a> {
    /// The problem at the start of the search.
    fn new(windows: &'a [FitWindow], evolution: Evolution, form: &FitForm) -> Self {
        let mut problem = FitProblem {
            windows,
            evolution,
            form: form.clone(),
            free: form.free(),
            v_star: windows[0].drive[0].velocity,
            roots: segments(windows).map(equal_weight).collect(),
            at: [0.0; 8],
        };
        problem.at = problem.guess();
        problem
    }

    fn model(&self, at: &Parameters) -> SliderModel {
        let value = |quantity: Quantity| at[quantity as usize];
        let second = StateVariable {
            b: value(Quantity::SecondB),
            d_c: value(Quantity::SecondDc).exp(),
        };
        let law = RateStateLaw {
            evolution: self.evolution,
            mu_star: value(Quantity::MuStar),
            a: value(Quantity::A).exp(),
            b: value(Quantity::B),
            d_c: value(Quantity::Dc).exp(),
            second: self.form.two_states.then_some(second),
            v_star: self.v_star,
        };
        let stiffness = self.form.fits_stiffness;
        SliderModel {
            law,
            stiffness: stiffness.then(|| value(Quantity::Stiffness).exp()),
            trend: value(Quantity::Trend),
        }
    }

    /// Puts in the given parameters.
    fn with_given(&self, mut at: Parameters) -> Parameters {
        for (quantity, value) in &self.form.given {
            at[*quantity as usize] = quantity.fitted_form(*value);
        }
        at
    }

    /// Start of the search: the a, D_c and k̄ of least cost on a coarse grid, with a - b and μ* from
    /// the friction at the end of every slide.
    fn guess(&self) -> Parameters {
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
        // k̄ D_c; without a fit of k̄ any value will do.
        let springs: &[f64] = if self.form.fits_stiffness {
            &[0.3, 3.0, 30.0]
        } else {
            &[1.0]
        };
        let mut best = (f64::INFINITY, [0.0; 8]);
        for a in [0.003, 0.01, 0.03] {
            for share in [0.01, 0.03, 0.1, 0.3] {
                for spring in springs {
                    let mut at = [0.0; 8];
                    let ln_d_c = f64::ln(share * longest);
                    at[Quantity::A as usize] = f64::ln(a);
                    at[Quantity::B as usize] = a - slope;
                    at[Quantity::Dc as usize] = ln_d_c;
                    at[Quantity::MuStar as usize] = y - slope * x;
                    at[Quantity::Stiffness as usize] = spring.ln() - ln_d_c;
                    let at = self.with_given(at);
                    let cost = self.weighted(&at).norm_squared();
                    if cost < best.0 {
                        best = (cost, at);
                    }
                }
            }
        }
        best.1
    }

    /// The problem of two state variables at its minimum: the best of searches from the pairs of
    /// state variables, around the one that alone fits best, that cost least.
    fn of_two_states(self) -> Result<Self, String> {
        /// D_c and D_c2 over the D_c of one state variable.
        const LENGTHS: [[f64; 2]; 4] = [[0.1, 1.0], [0.3, 3.0], [1.0, 10.0], [0.03, 1.0]];
        /// Shares of b in b and b_2, and a part of b that b_2 takes back.
        const SHARES: [[f64; 3]; 4] = [
            [0.5, 0.5, 0.0],
            [0.8, 0.2, 0.0],
            [0.5, 0.5, 0.005],
            [0.5, 0.5, -0.005],
        ];
        const SEARCHES: usize = 3;
        let single = Self::new(self.windows, self.evolution, &self.form.with_one_state());
        let start = single.at;
        let single = single.minimized().map_or(start, |single| single.at);
        let mut starts = Vec::new();
        for [first, second] in LENGTHS {
            for [of_first, of_second, more] in SHARES {
                let mut at = single;
                let (b, d_c) = (at[Quantity::B as usize], at[Quantity::Dc as usize]);
                at[Quantity::B as usize] = of_first * b + more;
                at[Quantity::SecondB as usize] = of_second * b - more;
                at[Quantity::Dc as usize] = d_c + f64::ln(first);
                at[Quantity::SecondDc as usize] = d_c + f64::ln(second);
                let at = self.with_given(at);
                starts.push((self.weighted(&at).norm_squared(), at));
            }
        }
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let searches = starts.into_iter().take(SEARCHES).map(|(_, at)| {
            let found = Self { at, ..self.clone() }.minimized()?;
            Ok((found.weighted(&found.at).norm_squared(), found))
        });
        let (found, failed): (Vec<_>, Vec<_>) = searches.partition(Result::is_ok);
        let found = found.into_iter().filter_map(Result::ok);
        match found.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((_, problem)) => Ok(problem),
            None => Err(failed.into_iter().find_map(Result::err).unwrap_or_default()),
        }
    }

    /// With the state variable of the lesser D_c first, unless they are given.
    fn ordered(mut self) -> Self {
        let [first, second] = [Quantity::Dc as usize, Quantity::SecondDc as usize];
        let is_given = Quantity::GIVEN[1..]
            .iter()
            .any(|q| self.form.given(*q).is_some());
        if self.form.two_states && !is_given && self.at[first] > self.at[second] {
            self.at.swap(first, second);
            self.at
                .swap(Quantity::B as usize, Quantity::SecondB as usize);
        }
        self
    }

    fn means(&self) -> usize {
        let windows = self.windows.iter();
        windows.map(|window| window.friction.len()).sum()
    }

    /// Weighted residuals of all means; each is `FAILED` if the integration fails.
    fn weighted(&self, at: &Parameters) -> DVector<f64> {
        let of_slider = self.model(at);
        let mut all = Vec::with_capacity(self.means());
        let mut roots = self.roots.iter();
        for window in self.windows {
            let model = window.model_means(&of_slider);
            for (means, root) in window.segments.iter().zip(&mut roots) {
                all.extend(means.clone().map(|k| match &model {
                    Ok(model) => root * (window.friction[k] - model[k]),
                    Err(_) => root * FAILED,
                }));
            }
        }
        DVector::from_vec(all)
    }

    /// Derivatives of the weighted residuals by the free parameters.
    fn derivatives(&self) -> DMatrix<f64> {
        let mut j = DMatrix::zeros(self.means(), self.free.len());
        for (column, &place) in self.free.iter().enumerate() {
            let derivative = match PARAMETERS[place] {
                Quantity::MuStar => {
                    let means = self.windows.iter().map(|window| window.friction.len());
                    self.of_linear_terms(means.flat_map(|n| std::iter::repeat_n(1.0, n)))
                }
                Quantity::Trend => {
                    let windows = self.windows.iter();
                    self.of_linear_terms(windows.flat_map(FitWindow::mean_displacements))
                }
                parameter => {
                    let h = DIFFERENCES[usize::from(!parameter.is_logarithmic())];
                    let [after, before] = [h, -h].map(|by| {
                        let mut at = self.at;
                        at[place] += by;
                        self.weighted(&at)
                    });
                    (after - before) / (2.0 * h)
                }
            };
            j.set_column(column, &derivative);
        }
        j
    }

    /// The derivative of the weighted residuals by the factor of these terms of μ, one of a mean.
    fn of_linear_terms(&self, terms: impl Iterator<Item = f64>) -> DVector<f64> {
        let segments = segments(self.windows).zip(&self.roots);
        let roots = segments.flat_map(|(means, root)| std::iter::repeat_n(-root, means.len()));
        DVector::from_iterator(
            self.means(),
            roots.zip(terms).map(|(root, term)| root * term),
        )
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
        let model = self.model(&self.at);
        let residuals = self.windows.iter().map(|window| {
            let model = window.model_means(&model)?;
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
        let count = self.free.len();
        if effective < count as f64 + 1.0 {
            return Err(format!(
                "the data are worth {effective:.1} independent values, but {count} parameters need at least {}; record longer or more often",
                count + 1
            ));
        }
        let covariance = self.covariance(&noise)?;
        let model = self.model(&self.at);
        let drives = self.windows.iter().flat_map(FitWindow::mean_displacements);
        let length = drives.fold(0.0, f64::max);
        let quantities = Quantity::ALL.into_iter().filter(|q| self.form.has(*q));
        let estimates = quantities.map(|quantity| {
            let value = match quantity {
                Quantity::AMinusB => model.law.rate_dependence(),
                _ if quantity.is_logarithmic() => self.at[quantity as usize].exp(),
                _ => self.at[quantity as usize],
            };
            let half_width = half_width(&covariance, &self.factors(quantity));
            (quantity, quantity.estimate(value, half_width, length))
        });
        let means = residuals.iter().map(Vec::len).sum::<usize>() as f64;
        let square: f64 = residuals.iter().flatten().map(|r| r * r).sum();
        Ok(Fit {
            model,
            estimates: estimates.collect(),
            given: self
                .form
                .given
                .iter()
                .map(|(quantity, _)| *quantity)
                .collect(),
            rms: (square / means).sqrt(),
            effective,
            residuals,
            noise: noise.iter().map(|noise| noise.variance).collect(),
            length,
        })
    }

    /// Derivatives of a quantity by the free parameters.
    fn factors(&self, quantity: Quantity) -> DVector<f64> {
        let factors = self
            .free
            .iter()
            .map(|&place| match (quantity, PARAMETERS[place]) {
                // d(a - b) = a d(ln a) - db
                (Quantity::AMinusB, Quantity::A) => self.at[place].exp(),
                (Quantity::AMinusB, Quantity::B | Quantity::SecondB) => -1.0,
                (quantity, parameter) if quantity == parameter => 1.0,
                _ => 0.0,
            });
        DVector::from_iterator(self.free.len(), factors)
    }

    /// C_s of each segment and its degrees of freedom.
    fn covariance(&self, noise: &[Noise]) -> Result<Vec<(DMatrix<f64>, f64)>, String> {
        let j = self.derivatives();
        let mut squares = Vec::new();
        let mut row = 0;
        for ((means, root), noise) in segments(self.windows).zip(&self.roots).zip(noise) {
            let part = j.rows(row, means.len());
            // `part` holds weighted derivatives, so this is w JᵀJ.
            squares.push((part.transpose() * part, root * root, *noise));
            row += means.len();
        }
        let free = self.free.len();
        let mut a = DMatrix::zeros(free, free);
        for (square, ..) in &squares {
            a += square;
        }
        // Scaled to a unit diagonal, so that small parameters count as much as large ones.
        let scale = DMatrix::from_diagonal(&a.diagonal().map(|d: f64| d.sqrt().recip()));
        let scaled = &scale * a * &scale;
        let is_regular = scaled.iter().all(|value| value.is_finite());
        let inverse = if is_regular && scaled.symmetric_eigenvalues().min() > SINGULAR {
            scaled.try_inverse()
        } else {
            None
        };
        let inverse = inverse.ok_or_else(|| {
            let names = self.free.iter().map(|place| PARAMETERS[*place].name());
            format!(
                "these data do not determine {}: add velocity steps or holds",
                names.collect::<Vec<_>>().join(", ")
            )
        })?;
        let inverse = &scale * inverse * &scale;
        let parts = squares.into_iter().map(|(square, weight, noise)| {
            let taken = (&square * &inverse).trace();
            let variance = noise.variance * (1.0 + taken / noise.freedom);
            let part = &inverse * square * &inverse * (weight * variance);
            (part, noise.freedom)
        });
        Ok(parts.collect())
    }
}

/// Half the 95 % interval of the linear combination of parameters with these factors.
fn half_width(covariance: &[(DMatrix<f64>, f64)], factors: &DVector<f64>) -> f64 {
    let parts = covariance.iter().map(|(part, freedom)| {
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

/// Least eigenvalue of the scaled JᵀJ; below it the finite differences of the model are noise.
const SINGULAR: f64 = 1e-9;

impl LeastSquaresProblem<f64, Dyn, Dyn> for FitProblem<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, at: &DVector<f64>) {
        for (value, place) in at.iter().zip(&self.free) {
            self.at[*place] = *value;
        }
    }

    fn params(&self) -> DVector<f64> {
        let values = self.free.iter().map(|place| self.at[*place]);
        DVector::from_iterator(self.free.len(), values)
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.weighted(&self.at))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
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
