//! The least-squares problem of a fit, and the search for its minimum.
//!
//! μ* and the trend are linear parameters that leave the motion of the slider alone. They are
//! eliminated exactly at every evaluation (variable projection, Golub & Pereyra 1973), so that the
//! search is among a, b, D_c and k̄ only.

use std::ops::Range;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn, SVD};

use super::drive_segment::DriveSegment;
use super::evolution_law::{Evolution, LogState, RateStateLaw, SliderModel, StateVariable};
use super::quantity::{FitForm, PARAMETERS, Parameters, Quantity};
use super::window::FitWindow;
use crate::moments::joint_moments;

/// Steps of the central differences in the logarithms, and in b.
const DIFFERENCES: [f64; 2] = [1e-3, 1e-5];
/// Residual assigned to a failed integration, so that the search turns back.
const FAILED: f64 = 1e3;
/// Starts of which the search tries the best, if the model has more than a, b, D_c and μ*.
const SEARCHES: usize = 4;
/// Least distance of two starts in ln D_c or ln k̄.
const APART: f64 = 0.5;
/// Least a of a start; from a lesser one searches hardly find back.
const LEAST_A: f64 = 1e-4;

/// The least-squares problem at a point.
#[derive(Clone)]
pub(super) struct FitProblem<'a> {
    windows: &'a [FitWindow],
    evolution: Evolution,
    form: FitForm,
    /// Places of the parameters that the search moves.
    searched: Vec<usize>,
    /// μ*, and the trend if it is fitted.
    linear: LinearTerms,
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
pub(super) fn segments(windows: &[FitWindow]) -> impl Iterator<Item = &Range<usize>> {
    windows.iter().flat_map(|window| &window.segments)
}

/// The terms of μ whose factors are fitted exactly at every evaluation.
#[derive(Clone)]
struct LinearTerms {
    quantities: Vec<Quantity>,
    /// `[means][terms]` Weighted terms, decomposed.
    decomposed: SVD<f64, Dyn, Dyn>,
    /// The same.
    weighted: DMatrix<f64>,
}

/// Least singular value of the terms over the greatest.
const RANK: f64 = 1e-12;

impl LinearTerms {
    fn new(windows: &[FitWindow], form: &FitForm, roots: &[f64]) -> Self {
        let means = windows.iter().map(|window| window.friction.len()).sum();
        let mut quantities = vec![Quantity::MuStar];
        let mut terms = vec![DVector::from_element(means, 1.0)];
        if form.detrends {
            quantities.push(Quantity::Trend);
            let driven = windows.iter().flat_map(FitWindow::mean_displacements);
            terms.push(DVector::from_iterator(means, driven));
        }
        for term in &mut terms {
            weigh(term, windows, roots);
        }
        let weighted = DMatrix::from_columns(&terms);
        Self {
            quantities,
            decomposed: SVD::new(weighted.clone(), true, true),
            weighted,
        }
    }

    /// The part of a vector that the terms cannot give.
    fn without(&self, vector: &DVector<f64>) -> DVector<f64> {
        let u = self.decomposed.u.as_ref().expect("it is computed");
        vector - u * u.tr_mul(vector)
    }

    /// The factors whose terms are nearest to a vector.
    fn factors(&self, vector: &DVector<f64>) -> DVector<f64> {
        let least = RANK * self.decomposed.singular_values.max();
        let solved = self.decomposed.solve(vector, least);
        solved.expect("both sides are computed")
    }
}

/// Multiplies a value of each mean by the root of its weight.
fn weigh(values: &mut DVector<f64>, windows: &[FitWindow], roots: &[f64]) {
    let mut row = 0;
    for (means, root) in segments(windows).zip(roots) {
        values.rows_mut(row, means.len()).scale_mut(*root);
        row += means.len();
    }
}

impl<'a> FitProblem<'a> {
    /// The problem with equal weight per segment, at no point yet.
    fn new(windows: &'a [FitWindow], evolution: Evolution, form: &FitForm) -> Self {
        let roots: Vec<f64> = segments(windows).map(equal_weight).collect();
        let is_linear =
            |place: &usize| matches!(PARAMETERS[*place], Quantity::MuStar | Quantity::Trend);
        let problem = Self {
            windows,
            evolution,
            form: form.clone(),
            searched: form.free().into_iter().filter(|p| !is_linear(p)).collect(),
            linear: LinearTerms::new(windows, form, &roots),
            v_star: windows[0].drive[0].velocity,
            roots,
            at: [0.0; 8],
        };
        let at = problem.with_given(problem.at);
        problem.moved_to(at)
    }

    /// The problem at its minimum, with equal weight per segment.
    ///
    /// # Errors
    /// If no search converges.
    pub(super) fn solved(
        windows: &'a [FitWindow],
        evolution: Evolution,
        form: &FitForm,
    ) -> Result<Self, String> {
        let problem = Self::new(windows, evolution, form);
        if form.two_states {
            return problem.with_two_states();
        }
        let searches = if form.fits_stiffness || form.detrends {
            SEARCHES
        } else {
            1
        };
        problem.best_of(problem.starts(), searches)
    }

    /// The problem at its minimum with other weights, in the neighbourhood of this one.
    ///
    /// # Errors
    /// If the search does not converge.
    pub(super) fn weighted_by(mut self, roots: Vec<f64>) -> Result<Self, String> {
        self.linear = LinearTerms::new(self.windows, &self.form, &roots);
        self.roots = roots;
        self.minimized()
    }

    /// The k̄ (1/m) below the one at this minimum where the cost is greater by `more`, all else
    /// fitted anew: the lower end of a profile. 0 if there is none.
    pub(super) fn least_stiffness(&self, more: f64) -> f64 {
        /// First step of ln k̄; each is twice the one before, since the minimum may lie anywhere
        /// where k̄ has no effect.
        const STEP: f64 = 1.0;
        const STEPS: i32 = 7;
        /// Accuracy of ln k̄.
        const ACCURACY: f64 = 0.02;
        let place = Quantity::Stiffness as usize;
        let mut on_spring = self.clone();
        on_spring.searched.retain(|searched| *searched != place);
        let most = self.cost() + more;
        let at_stiffness = |from: &Self, ln_k: f64| {
            let mut at = from.at;
            at[place] = ln_k;
            let found = from.moved_to(at).minimized().ok()?;
            (found.cost() < most).then_some(found)
        };
        for step in (0..STEPS).map(|k| STEP * f64::powi(2.0, k)) {
            let ln_k = on_spring.at[place];
            if let Some(found) = at_stiffness(&on_spring, ln_k - step) {
                on_spring = found;
                continue;
            }
            let (mut low, mut high) = (ln_k - step, ln_k);
            while high - low > ACCURACY {
                let middle = 0.5 * (low + high);
                match at_stiffness(&on_spring, middle) {
                    Some(found) => (on_spring, high) = (found, middle),
                    None => low = middle,
                }
            }
            return high.exp();
        }
        0.0
    }

    /// The problem at another point.
    fn moved_to(&self, at: Parameters) -> Self {
        Self { at, ..self.clone() }
    }

    /// A parameter at this point, in the form of fits.
    pub(super) fn value(&self, quantity: Quantity) -> f64 {
        self.at[quantity as usize]
    }

    /// The square roots of the weights of the segments.
    pub(super) fn roots(&self) -> &[f64] {
        &self.roots
    }

    /// The fitted parameters, in the order of [`Self::derivatives`].
    pub(super) fn fitted(&self) -> Vec<Quantity> {
        let searched = self.searched.iter().map(|place| PARAMETERS[*place]);
        searched.chain(self.linear.quantities.clone()).collect()
    }

    /// The model at this point.
    pub(super) fn model(&self) -> SliderModel {
        let second = StateVariable {
            b: self.value(Quantity::SecondB),
            d_c: self.value(Quantity::SecondDc).exp(),
        };
        let law = RateStateLaw {
            evolution: self.evolution,
            mu_star: self.value(Quantity::MuStar),
            a: self.value(Quantity::A).exp(),
            b: self.value(Quantity::B),
            d_c: self.value(Quantity::Dc).exp(),
            second: self.form.two_states.then_some(second),
            v_star: self.v_star,
        };
        let stiffness = self.form.fits_stiffness;
        SliderModel {
            law,
            stiffness: stiffness.then(|| self.value(Quantity::Stiffness).exp()),
            trend: self.value(Quantity::Trend),
        }
    }

    /// `[windows][means]` measured less model.
    pub(super) fn residuals_of_windows(&self) -> Result<Vec<Vec<f64>>, String> {
        let model = self.model();
        let residuals = self.windows.iter().map(|window| {
            let model = window.model_means(&model)?;
            let pairs = window.friction.iter().zip(model);
            Ok(pairs.map(|(measured, model)| measured - model).collect())
        });
        residuals.collect()
    }

    /// Weighted residuals of all means.
    fn weighted(&self) -> Result<DVector<f64>, String> {
        let residuals = self.residuals_of_windows()?.into_iter().flatten();
        let mut weighted = DVector::from_vec(residuals.collect());
        weigh(&mut weighted, self.windows, &self.roots);
        Ok(weighted)
    }

    /// Weighted residuals at the best μ* and trend; each is `FAILED` if the integration fails.
    fn projected(&self) -> DVector<f64> {
        match self.weighted() {
            Ok(weighted) => self.linear.without(&weighted),
            Err(_) => {
                let mut failed = DVector::from_element(self.linear.weighted.nrows(), FAILED);
                weigh(&mut failed, self.windows, &self.roots);
                failed
            }
        }
    }

    /// Sum of the squares that the search minimizes.
    fn cost(&self) -> f64 {
        self.projected().norm_squared()
    }

    /// Puts in the best μ* and trend.
    fn with_linear(mut self) -> Result<Self, String> {
        let factors = self.linear.factors(&self.weighted()?);
        for (quantity, factor) in self.linear.quantities.iter().zip(factors.iter()) {
            self.at[*quantity as usize] += factor;
        }
        Ok(self)
    }

    /// Derivatives of the weighted residuals by the parameters that the search moves, with the
    /// linear ones fixed.
    fn derivatives_of_searched(&self) -> Vec<DVector<f64>> {
        let columns = self.searched.iter().map(|&place| {
            let h = DIFFERENCES[usize::from(!PARAMETERS[place].is_logarithmic())];
            let [after, before] = [h, -h].map(|by| {
                let mut at = self.at;
                at[place] += by;
                self.moved_to(at).weighted()
            });
            match (after, before) {
                (Ok(after), Ok(before)) => (after - before) / (2.0 * h),
                _ => DVector::zeros(self.linear.weighted.nrows()),
            }
        });
        columns.collect()
    }

    /// Derivatives of the weighted residuals by all fitted parameters.
    pub(super) fn derivatives(&self) -> DMatrix<f64> {
        let mut columns = self.derivatives_of_searched();
        let linear = self.linear.weighted.column_iter();
        columns.extend(linear.map(|column| -column));
        DMatrix::from_columns(&columns)
    }

    /// Puts in the given parameters.
    fn with_given(&self, mut at: Parameters) -> Parameters {
        for (quantity, value) in &self.form.given {
            at[*quantity as usize] = quantity.fitted_form(*value);
        }
        at
    }

    /// Starts of a search with one state variable, the best one first: a coarse grid of a, D_c and
    /// k̄ with a - b from the friction at the end of every slide, and the best of it with the a, b
    /// and trend that fit its motion.
    fn starts(&self) -> Vec<Parameters> {
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
        let (_, [spread, both]) = joint_moments(&points);
        let slope = if spread > 1e-6 { both / spread } else { 0.0 };
        // k̄ D_c/a; without a fit of k̄ any value will do.
        let springs: &[f64] = if self.form.fits_stiffness {
            &[1.0, 10.0, 100.0]
        } else {
            &[1.0]
        };
        let mut grid = Vec::new();
        for a in [0.003, 0.01, 0.03] {
            for share in [0.01, 0.03, 0.1, 0.3] {
                for spring in springs {
                    let mut at = [0.0; 8];
                    let ln_d_c = f64::ln(share * longest);
                    at[Quantity::A as usize] = f64::ln(a);
                    at[Quantity::B as usize] = a - slope;
                    at[Quantity::Dc as usize] = ln_d_c;
                    at[Quantity::Stiffness as usize] = f64::ln(a * spring) - ln_d_c;
                    grid.push(self.with_given(at));
                }
            }
        }
        let mut starts = self.by_cost(grid);
        let better = starts.iter().take(SEARCHES).filter_map(|at| {
            let motion = FixedMotion::new(&self.moved_to(*at), self)?;
            let (_, at) = motion.best(&[at[Quantity::Dc as usize]])?;
            Some(at)
        });
        let better: Vec<_> = better.collect();
        starts.extend(better);
        self.by_cost(starts)
    }

    /// Points in the order of their cost, those of failed integrations left out.
    fn by_cost(&self, points: Vec<Parameters>) -> Vec<Parameters> {
        let costs = points.into_iter().map(|at| (self.moved_to(at).cost(), at));
        let mut costs: Vec<_> = costs.collect();
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        costs.into_iter().map(|(_, at)| at).collect()
    }

    /// The best minimum of searches from several starts that differ, the first ones first.
    fn best_of(&self, starts: Vec<Parameters>, searches: usize) -> Result<Self, String> {
        let mut tried: Vec<Parameters> = Vec::new();
        let mut best: Option<(f64, Self)> = None;
        let mut failure = String::new();
        for at in starts {
            if tried.len() == searches {
                break;
            }
            if tried.iter().any(|other| is_near(other, &at)) {
                continue;
            }
            tried.push(at);
            match self.moved_to(at).minimized() {
                Ok(problem) => {
                    let cost = problem.cost();
                    if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                        best = Some((cost, problem));
                    }
                }
                Err(why) => failure = why,
            }
        }
        best.map(|(_, problem)| problem).ok_or(failure)
    }

    /// The minimum with two state variables. In the motion of the slider with one state variable,
    /// μ is linear in all but the D_c, so that all pairs of D_c are tried at little cost; searches
    /// start from the best of them. If k̄ is fitted, so they do from motions on other springs.
    fn with_two_states(self) -> Result<Self, String> {
        /// Factors of the k̄ that fits one state variable best.
        const SPRINGS: [f64; 3] = [1.0, 3.0, 0.3];
        let form = self.form.with_one_state();
        let single = Self::solved(self.windows, self.evolution, &form);
        let single = single.or_else(|_| {
            let single = Self::new(self.windows, self.evolution, &form);
            let start = single.starts().into_iter().next();
            start.map_or_else(
                || Err("no start of the search".to_string()),
                |at| Ok(single.moved_to(at)),
            )
        })?;
        let mut motions = vec![single.clone()];
        if form.fits_stiffness {
            for factor in &SPRINGS[1..] {
                let mut form = form.clone();
                let stiffness = single.value(Quantity::Stiffness).exp() * factor;
                form.given.push((Quantity::Stiffness, stiffness));
                let stiff = Self::new(self.windows, self.evolution, &form);
                let at = stiff.with_given(single.at);
                motions.extend(stiff.moved_to(at).minimized());
            }
        }
        let mut starts = Vec::new();
        for motion in &motions {
            if let Some(motion) = FixedMotion::new(motion, &self) {
                let mut pairs = motion.pairs();
                pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
                starts.extend(distinct(pairs.into_iter().map(|(_, at)| at), SEARCHES));
            }
        }
        if self.form.given(Quantity::SecondDc).is_some() {
            // The motion of a given first state variable alone may be far from the data.
            starts.extend(self.starts());
        }
        let starts = self.by_cost(starts);
        Ok(self.best_of(starts, SEARCHES)?.ordered())
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

    /// The problem at the minimum that a search from this point finds.
    fn minimized(self) -> Result<Self, String> {
        if self.searched.is_empty() {
            return self.with_linear();
        }
        let (problem, report) = LevenbergMarquardt::new()
            .with_tol(1e-8)
            .with_patience(30)
            .minimize(self);
        match report.termination {
            reason if reason.was_successful() => problem.with_linear(),
            TerminationReason::LostPatience => Err(format!(
                "the fit did not converge within {} evaluations: add velocity steps or holds",
                report.number_of_evaluations
            )),
            reason => Err(format!("the fit did not converge: {reason:?}")),
        }
    }
}

/// Whether two starts are so near that the same minimum is to be expected.
fn is_near(one: &Parameters, other: &Parameters) -> bool {
    let places = [Quantity::Dc, Quantity::SecondDc, Quantity::Stiffness].map(|q| q as usize);
    (places.iter()).all(|place| (one[*place] - other[*place]).abs() < APART)
}

/// The first of these points that are not near to each other.
fn distinct(points: impl Iterator<Item = Parameters>, count: usize) -> Vec<Parameters> {
    let mut kept: Vec<Parameters> = Vec::new();
    for at in points {
        if kept.len() == count {
            break;
        }
        if !kept.iter().any(|other| is_near(other, &at)) {
            kept.push(at);
        }
    }
    kept
}

/// The motion of a model, kept fixed while a law is fitted to μ: then μ is linear in all but the
/// D_c.
struct FixedMotion<'a> {
    /// What is fitted.
    problem: &'a FitProblem<'a>,
    /// The point of the motion.
    at: Parameters,
    /// `[windows][rows]` ln(V/V*).
    ln_v: Vec<Vec<f64>>,
    /// Weighted μ.
    friction: DVector<f64>,
    /// Weighted means of ln(V/V*).
    direct: DVector<f64>,
}

impl<'a> FixedMotion<'a> {
    /// D_c of pairs over the longest slide.
    const LONGEST: f64 = 1.0;
    const SHORTEST: f64 = 1e-4;
    const LENGTHS: usize = 20;

    /// `None` if the integration fails.
    fn new(motion: &FitProblem<'_>, problem: &'a FitProblem<'a>) -> Option<Self> {
        let model = motion.model();
        let motions = problem.windows.iter().map(|window| window.motion(&model));
        let motions: Vec<Vec<LogState>> = motions.collect::<Result<_, _>>().ok()?;
        let ln_v = motions.iter().map(|rows| rows.iter().map(|s| s.ln_v));
        let ln_v: Vec<Vec<f64>> = ln_v.map(Iterator::collect).collect();
        let friction = problem.windows.iter().flat_map(|window| &window.friction);
        let mut fixed = Self {
            problem,
            at: motion.at,
            friction: DVector::from_iterator(problem.linear.weighted.nrows(), friction.copied()),
            direct: DVector::zeros(0),
            ln_v,
        };
        weigh(&mut fixed.friction, problem.windows, &problem.roots);
        fixed.direct = fixed.weighted_means(&fixed.ln_v);
        Some(fixed)
    }

    /// Weighted means of a value of the rows.
    fn weighted_means(&self, rows: &[Vec<f64>]) -> DVector<f64> {
        let windows = self.problem.windows;
        let means = windows.iter().zip(rows);
        let means = means.flat_map(|(window, rows)| window.means(rows));
        let mut means = DVector::from_vec(means.collect());
        weigh(&mut means, windows, &self.problem.roots);
        means
    }

    /// Weighted means of ln(V*θ/D_c).
    fn state(&self, ln_d_c: f64) -> DVector<f64> {
        let FitProblem {
            windows,
            evolution,
            v_star,
            ..
        } = self.problem;
        let rows = windows.iter().zip(&self.ln_v);
        let states = rows.map(|(window, ln_v)| {
            evolution.states_in_motion(&window.time, ln_v, *v_star, ln_d_c.exp())
        });
        self.weighted_means(&states.collect::<Vec<_>>())
    }

    /// The least squares with state variables of these ln D_c, and the point where it is. `None`
    /// if its a is too little.
    fn best(&self, ln_d_c: &[f64]) -> Option<(f64, Parameters)> {
        let states: Vec<_> = ln_d_c.iter().map(|ln_d_c| self.state(*ln_d_c)).collect();
        self.solved(ln_d_c, &states.iter().collect::<Vec<_>>())
    }

    /// [`Self::best`] of all pairs of D_c.
    fn pairs(&self) -> Vec<(f64, Parameters)> {
        let slides = self.problem.windows.iter().flat_map(|window| &window.drive);
        let longest = slides.map(DriveSegment::distance).fold(0.0, f64::max);
        let span = f64::ln(Self::LONGEST / Self::SHORTEST) / (Self::LENGTHS - 1) as f64;
        let lengths = (0..Self::LENGTHS).map(|k| (longest * Self::SHORTEST).ln() + span * k as f64);
        let form = &self.problem.form;
        let given = |quantity: Quantity| form.given(quantity).map(f64::ln);
        let choices = [Quantity::Dc, Quantity::SecondDc].map(|quantity| match given(quantity) {
            Some(ln_d_c) => vec![ln_d_c],
            None => lengths.clone().collect(),
        });
        let [first, second] = choices.each_ref().map(|choices| {
            let states = choices.iter().map(|ln_d_c| self.state(*ln_d_c));
            states.collect::<Vec<_>>()
        });
        let mut pairs = Vec::new();
        for (one, of_first) in choices[0].iter().zip(&first) {
            for (two, of_second) in choices[1].iter().zip(&second) {
                let is_free = choices.iter().all(|choices| choices.len() > 1);
                if (is_free && one < two) || (!is_free && one != two) {
                    pairs.extend(self.solved(&[*one, *two], &[of_first, of_second]));
                }
            }
        }
        pairs
    }

    /// [`Self::best`] with the weighted states of these D_c.
    fn solved(&self, ln_d_c: &[f64], states: &[&DVector<f64>]) -> Option<(f64, Parameters)> {
        let form = &self.problem.form;
        let linear = &self.problem.linear;
        let mut at = self.at;
        let places = [Quantity::Dc, Quantity::SecondDc];
        for (place, ln_d_c) in places.iter().zip(ln_d_c) {
            at[*place as usize] = *ln_d_c;
        }
        let mut rest = self.friction.clone();
        let (mut free, mut columns) = (Vec::new(), Vec::new());
        let factors = [Quantity::A, Quantity::B, Quantity::SecondB];
        let terms = std::iter::once(&self.direct).chain(states.iter().copied());
        for (quantity, term) in factors.into_iter().zip(terms) {
            match form.given(quantity) {
                Some(value) => rest -= term * value,
                None => {
                    free.push(quantity);
                    columns.push(linear.without(term));
                }
            }
        }
        let mut rest = linear.without(&rest);
        if !free.is_empty() {
            let matrix = DMatrix::from_columns(&columns);
            let decomposed = SVD::new(matrix.clone(), true, true);
            let least = 1e-10 * decomposed.singular_values.max();
            let values = decomposed.solve(&rest, least).ok()?;
            rest -= matrix * &values;
            for (quantity, value) in free.iter().zip(values.iter()) {
                if *quantity == Quantity::A && *value < LEAST_A {
                    return None;
                }
                at[*quantity as usize] = quantity.fitted_form(*value);
            }
        }
        Some((rest.norm_squared(), self.problem.with_given(at)))
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for FitProblem<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, at: &DVector<f64>) {
        for (value, place) in at.iter().zip(&self.searched) {
            self.at[*place] = *value;
        }
    }

    fn params(&self) -> DVector<f64> {
        let values = self.searched.iter().map(|place| self.at[*place]);
        DVector::from_iterator(self.searched.len(), values)
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.projected())
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        // The linear terms do not depend on the other parameters, so this is exact.
        let columns = self.derivatives_of_searched();
        let columns = columns.iter().map(|column| self.linear.without(column));
        Some(DMatrix::from_columns(&columns.collect::<Vec<_>>()))
    }
}
