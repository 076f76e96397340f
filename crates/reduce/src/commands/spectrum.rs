//! `spectrum`: computes eigenvalues of K v = λ M v, of a run or of matrix files.

use std::path::{Path, PathBuf};

use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Par, c64};

use crate::frame_selection::Which;
use crate::printer::Printer;
use crate::results::Results;
use crate::stored_state::{StateSelection, StoredState, history};
use gshear_analysis::jacobian::{Jacobian, paper_form};
use gshear_dem::failure::{Failure, Result};
use gshear_report::{drawing, eigenvalue_figures};
use gshear_spectrum::{
    Failed, Nearest, Problem, RESIDUAL, Rectangle, Request, Sought, Spectrum, Symbolic, Uncounted,
    Unfit, Verdict, bendixson, nearest, participation, scan, unstable, winding,
};
use gshear_store::csv_table::Table;
use gshear_store::file_names::folder_of;
use gshear_store::spectrum_writer::{self, Columns, StateOrigin, Unknown};
use gshear_store::{matrix_market, memory};

/// Unknowns up to which --all-pairs uses the dense solver: 200 MB of vectors, one to two minutes.
const DENSE: usize = 3000;
/// Unknowns above which --dense is refused: memory grows with the square, time with the cube.
const MOST_DENSE: usize = 12_000;
/// Greatest shift over ‖A‖: with greater ones the eigenvalues are equally far.
const FARTHEST: f64 = 100.0;

/// Compute eigenvalues of K v = λ M v, of a run or of matrix files
///
/// K is real and sparse, M diagonal. Without --dense, --all-pairs or --unstable: the
/// eigenvalues nearest the shift, by shift-invert. Trust a pair only if its verdict is pair;
/// doubtful pairs may be rounding errors (docs/explanation/spectrum.md). Writes spectrum.csv,
/// spectrum.h5 with the eigenvectors, and spectrum.svg.
#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "flags of the command line")]
pub struct Arguments {
    /// A run.h5, run.h5/newtonian, the folder of a run, or a checkpoint, from which K and M
    /// are assembled
    #[arg(required_unless_present = "matrix", conflicts_with_all = ["matrix", "mass", "null", "group"])]
    pub run: Option<PathBuf>,
    /// Frame of the run: its number, from 0 on, or last [default: last]
    #[arg(long, value_name = "K", requires = "run")]
    frame: Option<Which>,
    /// The frame nearest to this shear strain
    #[arg(long, value_name = "GAMMA", requires = "run", conflicts_with = "frame", value_parser = super::strain)]
    strain: Option<f64>,
    /// Use the matrix J of the appendix of Bonfanti et al., in which histories do not turn with the
    /// contacts, not K
    #[arg(long, requires = "run")]
    paper_form: bool,
    /// Write K to this file, M to .mass.mtx and the translations to .null.mtx beside it
    #[arg(long, value_name = "K.mtx", requires = "run")]
    export_matrix: Option<PathBuf>,
    /// K as a Matrix Market file, without a run: real, square, any symmetry
    #[arg(long, value_name = "K.mtx")]
    matrix: Option<PathBuf>,
    /// M as a Matrix Market file: diagonal, positive [default: the identity]
    #[arg(long, value_name = "M.mtx", requires = "matrix")]
    mass: Option<PathBuf>,
    /// Null vectors of K and of its transpose (translations), one per column, which are projected
    /// out
    #[arg(long, value_name = "N.mtx", requires = "matrix")]
    null: Option<PathBuf>,
    /// Compute the eigenvalues nearest to this number
    #[arg(long, value_name = "RE[,IM]", default_value = "0", allow_hyphen_values = true, value_parser = shift)]
    shift: c64,
    /// Number of eigenvalues; with --all-pairs per shift, with --unstable at most [default: 20,
    /// 100, 100]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    count: Option<u32>,
    /// Compute all eigenvalues, and count the complex pairs by the winding of det(K - zM) to check
    /// that none is missing
    #[arg(long, conflicts_with = "shift")]
    all_pairs: bool,
    /// Compute all eigenvalues by the QR algorithm on the dense matrix
    #[arg(long, conflicts_with_all = ["shift", "count"])]
    dense: bool,
    /// Compute the modes that grow fastest under Newton's equations: complex pairs and negative
    /// eigenvalues, without factorisation
    #[arg(long, conflicts_with_all = ["shift", "all_pairs", "dense"])]
    unstable: bool,
    /// With --unstable: smallest |Im λ| over ‖A‖ of the pairs that must be found
    #[arg(long, value_name = "F", requires = "unstable", default_value_t = 1e-3, value_parser = resolution)]
    resolution: f64,
    /// Skip left eigenvectors: half the time, but conditions are only lower bounds
    #[arg(long, conflicts_with_all = ["all_pairs", "dense", "unstable"])]
    right_only: bool,
    /// Number of consecutive unknowns per grain, for the participation ratio
    #[arg(long, value_name = "D", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    group: u16,
    /// Folder to write into [default: that of the run or matrix]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn shift(text: &str) -> Result<c64, String> {
    let (re, im) = text.split_once(',').unwrap_or((text, "0"));
    Ok(c64::new(finite(re)?, finite(im)?))
}

fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(value) if f64::is_finite(value) => Ok(value),
        _ => Err(format!("{text}: must be a finite number")),
    }
}

fn resolution(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok();
    let fit = value.filter(|value| *value > f64::EPSILON.sqrt() && *value < 1.0);
    fit.ok_or(format!(
        "{text}: must be a number between {:.1e} and 1; below, pairs may be rounding errors",
        f64::EPSILON.sqrt()
    ))
}

impl Arguments {
    /// # Errors
    /// Bad matrices, an iteration that does not converge, files that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let asked = match &self.run {
            Some(run) => of_run(run, self, printer)?,
            None => of_files(self)?,
        };
        let problem = &asked.problem;
        let par = match rayon::current_num_threads() {
            1 => Par::Seq,
            threads => Par::rayon(threads),
        };
        faer::set_global_parallelism(par);
        writeln!(
            printer,
            "{} unknowns, ‖A‖ = {:.6e}; projected out: {} without stiffness, {} null vectors",
            problem.unknowns(),
            problem.norm(),
            problem.rattling(),
            problem.null().ncols()
        )?;
        let solver = Solver {
            arguments: self,
            problem,
            par,
        };
        let mut spectrum = solver.solve(printer)?;
        solver.refine(&mut spectrum, printer)?;
        let spectrum = if self.dense || self.all_pairs {
            spectrum.arranged(|_| true, |e| e.value.re)
        } else {
            spectrum.arranged(|_| true, |e| (e.value - self.shift).norm())
        };
        summary(&spectrum, printer)?;

        let results = Results::of(self.out.as_deref(), folder_of(&asked.source));
        let columns = columns(&asked, &spectrum);
        let table = table(&spectrum, &columns.participation);
        results.table("spectrum.csv", &table, printer)?;
        let vectors = results.place("spectrum.h5")?;
        spectrum_writer::write(&vectors, &asked.source, problem, &columns)?;
        printer.wrote(&vectors)?;
        let svg = results.place("spectrum.svg")?;
        let figure = eigenvalue_figures::in_the_plane(&spectrum.eigenvalues);
        drawing::write(&svg, &figure, &drawing::Format::ALL)?;
        printer.wrote(&svg)
    }
}

/// The eigenvalue problem and its origin.
struct Asked {
    problem: Problem,
    source: PathBuf,
    /// Number of the grain of every unknown, for the participation ratio.
    grain: Vec<usize>,
    /// Of a run: what the unknowns are, and the state.
    unknowns: Vec<Unknown>,
    origin: Option<StateOrigin>,
}

fn of_run(run: &Path, arguments: &Arguments, printer: &mut Printer) -> Result<Asked> {
    let frame = arguments.frame.map(StateSelection::Frame);
    let selection = frame.or(arguments.strain.map(StateSelection::Strain));
    let state = StoredState::read(run, selection)?;
    let jacobian = state.jacobian(history(arguments.paper_form));
    writeln!(
        printer,
        "{}: {} free grains of {}, {} contacts, {} of them sliding",
        state.what,
        jacobian.grains.len(),
        state.grains.len(),
        jacobian.contacts,
        jacobian.sliding
    )?;
    let paper = if arguments.paper_form {
        Some(paper_form(&jacobian, |g| state.grains[g as usize].radius))
    } else {
        None
    };
    let n = jacobian.unknowns();
    // J contains the masses and has other null vectors.
    let (k, mass, null) = match &paper {
        Some(j) => (j, vec![1.0; n], Mat::zeros(n, 0)),
        None => (&jacobian.k, jacobian.mass.clone(), jacobian.translations()),
    };
    if let Some(path) = &arguments.export_matrix {
        let entries: Vec<_> = (0..n).map(|i| Triplet::new(i, i, mass[i])).collect();
        let m = matrix_market::matrix(n, n, &entries);
        let places = (0..null.ncols()).flat_map(|j| (0..n).map(move |i| (i, j)));
        let entries: Vec<_> = places
            .filter(|&at| null[at] != 0.0)
            .map(|(i, j)| Triplet::new(i, j, null[(i, j)]))
            .collect();
        let mut files = vec![(path.clone(), k), (path.with_extension("mass.mtx"), &m)];
        let translations = matrix_market::matrix(n, null.ncols(), &entries);
        if null.ncols() > 0 {
            files.push((path.with_extension("null.mtx"), &translations));
        }
        for (path, matrix) in files {
            matrix_market::write(&path, matrix)?;
            printer.wrote(&path)?;
        }
    }
    let per_grain = jacobian.per_grain;
    let grains = (0..n).map(|unknown| match paper {
        Some(_) => unknown % (n / per_grain),
        None => unknown / per_grain,
    });
    let problem = Problem::new(k, &mass, null.as_ref())
        .map_err(|unfit| Failure::numbers(format!("{}: K: {unfit}", run.display())))?;
    Ok(Asked {
        problem,
        source: run.to_path_buf(),
        grain: grains.collect(),
        unknowns: match paper {
            Some(_) => Vec::new(),
            None => (0..n).map(|unknown| moved(&jacobian, unknown)).collect(),
        },
        origin: paper.is_none().then_some(state.origin),
    })
}

/// What an unknown of K moves: translations come first, and disks turn about z only.
fn moved(jacobian: &Jacobian, unknown: usize) -> Unknown {
    let (per_grain, axes) = (jacobian.per_grain, jacobian.axes);
    let component = match unknown % per_grain {
        axis if axis < axes => axis,
        turn => 6 + turn - per_grain,
    };
    Unknown {
        grain: jacobian.grains[unknown / per_grain],
        component: component as u8,
    }
}

fn of_files(arguments: &Arguments) -> Result<Asked> {
    let source = arguments.matrix.clone().unwrap_or_default();
    let k = matrix_market::read(&source)?;
    let mass = match &arguments.mass {
        Some(path) => diagonal(path, &matrix_market::read(path)?)?,
        None => vec![1.0; k.ncols()],
    };
    let null = match &arguments.null {
        Some(path) => matrix_market::read(path)?.to_dense(),
        None => Mat::zeros(k.ncols(), 0),
    };
    let problem = Problem::new(&k, &mass, null.as_ref()).map_err(|unfit| {
        let path = match unfit {
            Unfit::Matrix(_) => &None,
            Unfit::Mass(_) => &arguments.mass,
            Unfit::Null(_) => &arguments.null,
        };
        let path = path.as_ref().unwrap_or(&source);
        Failure::input(format!("{}: {unfit}", path.display()))
    })?;
    let grain = (0..problem.unknowns()).map(|k| k / usize::from(arguments.group));
    Ok(Asked {
        grain: grain.collect(),
        problem,
        source,
        unknowns: Vec::new(),
        origin: None,
    })
}

fn diagonal(path: &Path, m: &SparseColMat<usize, f64>) -> Result<Vec<f64>> {
    let mut mass = vec![0.0; m.ncols()];
    for entry in m.triplet_iter().filter(|entry| *entry.val != 0.0) {
        if entry.row != entry.col {
            return Err(Failure::input(format!(
                "{}: row {}, column {}: M must be diagonal",
                path.display(),
                entry.row + 1,
                entry.col + 1
            )));
        }
        mass[entry.row] = *entry.val;
    }
    Ok(mass)
}

/// What is solved, how, and on how many threads.
struct Solver<'a> {
    arguments: &'a Arguments,
    problem: &'a Problem,
    par: Par,
}

/// The dense matrix, its Schur form and a copy, and complex vectors.
const DENSE_COPIES: f64 = 5.0;

/// [`Spectrum::dense`], if there is memory for it.
///
/// # Errors
/// A matrix that is too large.
pub fn dense(problem: &Problem) -> Result<Spectrum> {
    let n = problem.size();
    memory::require(
        DENSE_COPIES * 8.0 * (n as f64).powi(2),
        &format!("a dense matrix of {n} unknowns with its eigenvectors"),
        "use gshear-reduce spectrum with --shift or --unstable, which work on the sparse matrix",
    )?;
    Ok(Spectrum::dense(problem))
}

impl Solver<'_> {
    fn solve(&self, printer: &mut Printer) -> Result<Spectrum> {
        let (arguments, problem) = (self.arguments, self.problem);
        let n = problem.size();
        if arguments.dense && n > MOST_DENSE {
            return Err(Failure::input(format!(
                "--dense: {n} unknowns, must be {MOST_DENSE} or fewer; use --all-pairs or --shift, which work on the sparse matrix"
            )));
        }
        if arguments.dense || n < 3 {
            return dense(problem);
        }
        if arguments.unstable {
            return self.amplified(printer);
        }
        let symbolic = Symbolic::new(problem.matrix().symbolic());
        writeln!(
            printer,
            "factors: {} entries, {:.3e} operations",
            symbolic.fill(),
            symbolic.operations()
        )?;
        // Complex numbers.
        memory::require(
            16.0 * symbolic.fill() as f64,
            &format!("the factors of a matrix of {n} unknowns"),
            "reduce a smaller sample, or a machine with more memory is needed",
        )?;
        if arguments.all_pairs {
            return self.all_pairs(&symbolic, printer);
        }
        let (far, norm) = (arguments.shift.norm(), problem.norm());
        if far > FARTHEST * norm {
            return Err(Failure::input(format!(
                "--shift: all eigenvalues are within {norm:.3e} of 0, so that at {far:.3e} none is nearer than another; give a shift within {:.3e}",
                FARTHEST * norm
            )));
        }
        let request = Request {
            shift: arguments.shift,
            count: arguments.count.unwrap_or(20) as usize,
            left: !arguments.right_only,
            par: self.par,
        };
        let solution = nearest(problem, &symbolic, request).map_err(unsolved)?;
        tell(&solution, arguments.shift, printer)?;
        Ok(solution.spectrum)
    }

    fn all_pairs(&self, symbolic: &Symbolic, printer: &mut Printer) -> Result<Spectrum> {
        let (problem, par) = (self.problem, self.par);
        let bounds = bendixson(problem);
        let spectrum = if problem.size() <= DENSE {
            dense(problem)?
        } else {
            let count = self.arguments.count.unwrap_or(100) as usize;
            let scanned = scan(problem, symbolic, bounds.re, count, par).map_err(unsolved)?;
            let (disks, solves) = (scanned.disks, scanned.solves);
            writeln!(printer, "scan: {disks} shifts, {solves} solves")?;
            let (all, n) = (scanned.spectrum.eigenvalues.len(), problem.size());
            let all = all + problem.null().ncols();
            writeln!(printer, "scan: {all} of {n} eigenvalues")?;
            scanned.spectrum
        };
        let mut known: Vec<c64> = spectrum.eigenvalues.iter().map(|e| e.value).collect();
        known.resize(problem.size().max(known.len()), c64::new(0.0, 0.0));
        let margin = 0.01 * problem.norm();
        let strip = Rectangle {
            re: [bounds.re[0] - margin, bounds.re[1] + margin],
            im: [f64::EPSILON.sqrt() * problem.norm(), bounds.im[1] + margin],
        };
        let inside = known.iter().filter(|&&z| strip.contains(z)).count();
        match winding(problem, symbolic, strip, &known, par) {
            Ok(count) => writeln!(
                printer,
                "pairs above the limit of trust: {inside} found, {} counted by the winding of the determinant ({} factorisations)",
                count.eigenvalues, count.factorisations
            ),
            Err(Uncounted { at }) => writeln!(
                printer,
                "pairs above the limit of trust: {inside} found; not counted, because an eigenvalue lies on the contour at {at:.3e}"
            ),
        }?;
        Ok(spectrum)
    }

    fn amplified(&self, printer: &mut Printer) -> Result<Spectrum> {
        let arguments = self.arguments;
        let sought = Sought {
            resolution: arguments.resolution,
            most: arguments.count.unwrap_or(100) as usize,
            par: self.par,
        };
        let modes =
            unstable(self.problem, sought).map_err(|stalled| unsolved(Failed::Stalled(stalled)))?;
        let within = format!("|Im λ| ≥ {:e} ‖A‖", arguments.resolution);
        writeln!(
            printer,
            "polynomials of degrees {:?}, {} products\n{}",
            modes.degrees,
            modes.products,
            if modes.complete {
                format!("complete: all modes with {within}, or that grow as fast")
            } else {
                format!(
                    "the fastest-growing modes; there may be more with {within}: increase --count"
                )
            }
        )?;
        Ok(modes.spectrum)
    }

    /// Refines residuals above [`RESIDUAL`] and prints how many remain above it.
    fn refine(&self, spectrum: &mut Spectrum, printer: &mut Printer) -> Result<()> {
        let eigenvalues = spectrum.eigenvalues.iter();
        let before = eigenvalues.filter(|e| e.residual > RESIDUAL).count();
        if before == 0 {
            return Ok(());
        }
        let symbolic = Symbolic::new(self.problem.matrix().symbolic());
        let after = spectrum.refine(self.problem, &symbolic, self.par);
        writeln!(
            printer,
            "{before} residuals were over {RESIDUAL:e} ‖A‖ and refined; {after} still are"
        )
    }
}

fn unsolved(failed: Failed) -> Failure {
    Failure::numbers(match failed {
        Failed::Factors => {
            "K - σM is singular at the shift and near it: choose another --shift".to_string()
        }
        Failed::Stalled(stalled) => format!(
            "the iteration has stalled with {} eigenvalues converged: try another --shift or --count",
            stalled.converged
        ),
    })
}

fn tell(solution: &Nearest, wished: c64, printer: &mut Printer) -> Result<()> {
    if solution.shift != wished {
        let moved = (solution.shift - wished).norm();
        writeln!(
            printer,
            "K - σM is singular at the shift, or nearly so: moved by {moved:.3e}"
        )?;
    }
    writeln!(
        printer,
        "{} solves, {} restarts, {} factorisations",
        solution.solves, solution.restarts, solution.factorisations
    )
}

fn summary(spectrum: &Spectrum, printer: &mut Printer) -> Result<()> {
    let all = &spectrum.eigenvalues;
    let [real, pairs, doubtful, zero] = [
        Verdict::Real,
        Verdict::Pair,
        Verdict::Doubtful,
        Verdict::Zero,
    ]
    .map(|verdict| all.iter().filter(|e| e.verdict == verdict).count());
    let worst = all.iter().map(|e| e.residual).fold(0.0, f64::max);
    writeln!(
        printer,
        "{} eigenvalues: {real} real, {pairs} in pairs, {doubtful} doubtful, {zero} zero; largest residual {worst:.1e} ‖A‖",
        all.len()
    )
}

fn columns(asked: &Asked, spectrum: &Spectrum) -> Columns {
    let problem = &asked.problem;
    let k = spectrum.eigenvalues.len();
    let mut vectors = ndarray::Array3::zeros((k, problem.unknowns(), 2));
    let mut taking_part = Vec::with_capacity(k);
    for (k, mut row) in vectors.outer_iter_mut().enumerate() {
        let v = spectrum.eigenvector(problem, k);
        for (mut to, value) in row.outer_iter_mut().zip(&v) {
            to[0] = value.re;
            to[1] = value.im;
        }
        taking_part.push(participation(&v, &asked.grain));
    }
    Columns {
        eigenvalues: spectrum.eigenvalues.clone(),
        participation: taking_part,
        vectors,
        unknowns: asked.unknowns.clone(),
        origin: asked.origin.clone(),
    }
}

/// Returns one line per eigenvalue.
fn table(spectrum: &Spectrum, participation: &[f64]) -> String {
    Table::of(spectrum.eigenvalues.iter().zip(participation))
        .column("lambda_re", |(e, _)| e.value.re)
        .column("lambda_im", |(e, _)| e.value.im)
        .column("verdict", |(e, _)| e.verdict.name())
        .column("residual", |(e, _)| e.residual)
        .column("condition", |(e, _)| e.condition)
        .column("participation", |(_, participation)| *participation)
        .csv()
}
