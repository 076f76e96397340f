//! K of the whole packing on one rank: the step of Newton's method, and the eigenvalues.

use bytemuck::allocation::pod_collect_to_vec;
use bytemuck::cast_slice;
use faer::c64;

use super::assembly::Assembly;
use crate::header::Pair;
use crate::memory::DENSE_COPIES;
use gshear_analysis::jacobian::{self, History, Jacobian};
use gshear_dem::dimension::Dimension;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{ContactState, GrainState};
use gshear_spectrum::{Factors, Problem, Solver, Spectrum, Verdict};
use gshear_store::collective::{gathered, on_root};
use gshear_store::memory::require;

/// dr and dθ of a grain; unused components are 0 in two dimensions.
pub(super) type Move = [[f64; 3]; 2];

/// All grains by id, and all touching contacts by (i, j).
pub(super) struct GlobalState {
    pub grains: Vec<GrainState>,
    pub contacts: Vec<ContactState>,
    /// [`jacobian::NetworkState::at_rest`].
    at_rest: bool,
}

impl GlobalState {
    /// Gathers those of a state at rest on every rank; collective.
    pub fn at_rest<D: Dimension>(assembly: &mut Assembly<'_, D>) -> Self {
        Self {
            at_rest: true,
            ..Self::moving(assembly)
        }
    }

    /// Gathers those of a moving state on every rank; collective.
    pub fn moving<D: Dimension>(assembly: &mut Assembly<'_, D>) -> Self {
        let exchange = assembly.exchange;
        let contacts = assembly.system.owned_contact_states(assembly.law);
        Self {
            grains: gathered(exchange, &assembly.system.grain_states(), |g| g.id),
            contacts: gathered(exchange, &contacts, |c| (c.i, c.j)),
            at_rest: false,
        }
    }

    pub fn has(&self, pair: [u32; 2]) -> bool {
        let place = self.contacts.binary_search_by_key(&pair, |c| [c.i, c.j]);
        place.is_ok()
    }

    fn jacobian<D: Dimension>(&self, assembly: &Assembly<'_, D>) -> Jacobian {
        let state = jacobian::NetworkState {
            flat: None,
            grains: &self.grains,
            contacts: &self.contacts,
            cell: assembly.system.cell,
            masses: &assembly.system.masses,
            at_rest: self.at_rest,
        };
        jacobian::assemble::<D>(state, assembly.law, History::Turned)
    }

    /// K on rank 0; `None` on other ranks, and if an element is not finite.
    pub fn tangent<D: Dimension>(&self, assembly: &Assembly<'_, D>) -> Option<Tangent> {
        if assembly.exchange.rank() != 0 {
            return None;
        }
        let jacobian = self.jacobian(assembly);
        let problem = jacobian.problem().ok()?;
        Some(Tangent { jacobian, problem })
    }

    /// All eigenvalues of K v = λ M v, on every rank; rank 0 computes them. Collective.
    ///
    /// # Errors
    /// If an element of K is not finite.
    pub fn eigenvalues<D: Dimension>(&self, assembly: &Assembly<'_, D>) -> Result<Eigenvalues> {
        let exchange = assembly.exchange;
        let records = on_root(exchange, || self.spectrum(assembly))?;
        let bytes = exchange.broadcast(cast_slice(&records).to_vec());
        let mut all = Vec::new();
        for record in pod_collect_to_vec::<u8, [f64; 3]>(&bytes) {
            let [re, im, verdict] = record;
            all.push((c64::new(re, im), Verdict::ALL[verdict as usize]));
        }
        Ok(Eigenvalues { all })
    }

    /// Real and imaginary part, and the index of the verdict in the list of verdicts.
    fn spectrum<D: Dimension>(&self, assembly: &Assembly<'_, D>) -> Result<Vec<[f64; 3]>> {
        let jacobian = self.jacobian(assembly);
        let problem = jacobian
            .problem()
            .map_err(|why| Failure::numbers(format!("the stiffness matrix: {why}")))?;
        let n = problem.size();
        require(
            DENSE_COPIES * 8.0 * (n as f64).powi(2),
            &format!("all eigenvalues of a matrix of {n} unknowns"),
            "leave them out with aqs.spectrum = false and newtonian.spectra = 0",
        )?;
        let mut records = Vec::new();
        for value in Spectrum::values(&problem) {
            let verdict = Verdict::of_value(value, problem.norm());
            let place = Verdict::ALL.iter().position(|known| *known == verdict);
            records.push([value.re, value.im, place.unwrap_or(0) as f64]);
        }
        Ok(records)
    }
}

impl<D: Dimension> Assembly<'_, D> {
    /// All eigenvalues at rest, on every rank; rank 0 computes them. Collective.
    ///
    /// # Errors
    /// If an element of K is not finite.
    pub(crate) fn eigenvalues(&mut self) -> Result<Eigenvalues> {
        GlobalState::at_rest(self).eigenvalues(self)
    }
}

/// K of a packing, for Newton's method.
pub(super) struct Tangent {
    jacobian: Jacobian,
    problem: Problem,
}

impl Tangent {
    /// `None` if a pivot is too small.
    pub fn factor<'a>(&'a self, solver: &'a mut Solver) -> Option<Factors<'a>> {
        solver.factor(&self.problem).ok()
    }

    /// The solution dq of K dq = F without zero modes, for all grains by id.
    fn solve(&self, factors: &Factors<'_>, grains: &[GrainState]) -> Vec<Move> {
        let force = self.jacobian.unknowns_of(|id| {
            let g = &grains[id as usize];
            [g.force, g.torque]
        });
        let moved = factors.solve(&force).x;
        let mut moves = vec![[[0.0; 3]; 2]; grains.len()];
        for (id, by) in self.jacobian.by_grain(&moved) {
            moves[id as usize] = by;
        }
        moves
    }
}

/// The step of Newton's method for the owned grains; `None` without factors. Only rank 0 has the
/// factors and solves, so that the bits do not depend on the ranks; collective.
pub(super) fn newton_step<D: Dimension>(
    assembly: &mut Assembly<'_, D>,
    tangent: Option<(&Tangent, &Factors<'_>)>,
) -> Option<Vec<Move>> {
    let exchange = assembly.exchange;
    let grains = gathered(exchange, &assembly.system.grain_states(), |g| g.id);
    let solved = tangent.map_or_else(Vec::new, |(k, factors)| k.solve(factors, &grains));
    let bytes = exchange.broadcast(cast_slice(&solved).to_vec());
    let moves: Vec<Move> = pod_collect_to_vec(&bytes);
    let grains = assembly.system.grains();
    let owned = &grains.id[..grains.owned];
    (!moves.is_empty()).then(|| owned.iter().map(|&id| moves[id as usize]).collect())
}

/// All eigenvalues of a packing with their verdicts.
pub(crate) struct Eigenvalues {
    all: Vec<(c64, Verdict)>,
}

impl Eigenvalues {
    pub fn all(&self) -> impl Iterator<Item = (c64, Verdict)> + '_ {
        self.all.iter().copied()
    }

    /// Complex eigenvalues above the real axis.
    fn upper(&self) -> impl Iterator<Item = c64> + '_ {
        let pairs = self.all().filter(|(_, verdict)| *verdict == Verdict::Pair);
        pairs.map(|(value, _)| value).filter(|value| value.im > 0.0)
    }

    /// Number of complex pairs.
    pub fn pairs(&self) -> u64 {
        self.upper().count() as u64
    }

    /// The pair of the greatest |Im λ|, above the real axis.
    pub(crate) fn greatest_imaginary(&self) -> Option<c64> {
        self.upper().max_by(|a, b| a.im.total_cmp(&b.im))
    }

    /// The pair that grows fastest, with the greatest ω_i = Im √λ: of many not always that of the
    /// greatest |Im λ|.
    pub(crate) fn fastest_pair(&self) -> Option<Pair> {
        let pairs = self.upper().map(|value| Pair::new(value.re, value.im));
        pairs.max_by(|a, b| a.omega_i.total_cmp(&b.omega_i))
    }

    /// The least real part of the eigenvalues that are not zero.
    pub fn least_real(&self) -> f64 {
        let real = self.all().filter(|(_, verdict)| *verdict != Verdict::Zero);
        real.map(|(value, _)| value.re)
            .fold(f64::INFINITY, f64::min)
    }

    /// Number of zero modes.
    pub fn zeros(&self) -> u64 {
        self.all()
            .filter(|(_, verdict)| *verdict == Verdict::Zero)
            .count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pair_that_grows_fastest_need_not_have_the_greatest_imaginary_part() {
        let value = |re, im| (c64::new(re, im), Verdict::Pair);
        let (stiff, soft) = ((100.0, 2.0), (0.01, 0.1));
        let all = [stiff, soft].map(|(re, im)| [value(re, im), value(re, -im)]);
        let eigenvalues = Eigenvalues {
            all: all.into_iter().flatten().collect(),
        };
        assert_eq!(eigenvalues.greatest_imaginary(), Some(c64::new(100.0, 2.0)));
        let pair = eigenvalues.fastest_pair().unwrap();
        assert_eq!([pair.lambda_r, pair.lambda_i], [0.01, 0.1]);
        // ω_i² = (|λ| - Re λ)/2.
        let rate = (0.5 * (0.01f64.hypot(0.1) - 0.01)).sqrt();
        assert!((pair.omega_i - rate).abs() < 1e-15, "{pair:?}");
        assert!(pair.omega_i > (0.5 * (100.0f64.hypot(2.0) - 100.0)).sqrt());
    }
}
