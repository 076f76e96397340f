//! Writes `spectrum.h5` (docs/reference/file-formats.md).

use std::path::{Path, PathBuf};

use ndarray::{Array3, ArrayView};

use gshear_dem::failure::Result;
use gshear_spectrum::{Eigenvalue, Problem};

use crate::checked::CheckedFile;
use crate::h5::Attribute;
use crate::run_reader::RunStage;

/// The stored state that K is of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StateOrigin {
    /// Identity of the run; `None` if it is not known.
    pub run_id: Option<String>,
    /// The stage.
    pub stage: RunStage,
    /// Step of the state in its stage.
    pub step: u64,
}

/// What an unknown of K moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unknown {
    /// Id of the grain.
    pub grain: u32,
    /// 0, 1, 2: along x, y, z; 3, 4, 5: rotation about them.
    pub component: u8,
}

/// Columns of the file, one entry per eigenvalue; k of them.
pub struct Columns {
    /// Eigenvalues with residual, condition and verdict.
    pub eigenvalues: Vec<Eigenvalue>,
    /// Participation ratios of the eigenvectors.
    pub participation: Vec<f64>,
    /// Eigenvectors `[k][unknowns][2]`, real and imaginary parts.
    pub vectors: Array3<f64>,
    /// `[unknowns]` What they are; none of a matrix without a run.
    pub unknowns: Vec<Unknown>,
    /// The state that K is of, if it is of a run.
    pub origin: Option<StateOrigin>,
}

/// Writes the file and returns its path. `matrix`: file that K comes from.
///
/// # Errors
/// `Failure::Other` if the file cannot be written.
pub fn write(path: &Path, matrix: &Path, problem: &Problem, columns: &Columns) -> Result<PathBuf> {
    let mut file = CheckedFile::create(path)?;
    let saved = save(&mut file, matrix, problem, columns);
    file.checked(saved)?;
    file.finish()
}

fn save(
    file: &mut CheckedFile,
    matrix: &Path,
    problem: &Problem,
    columns: &Columns,
) -> hdf5::Result<()> {
    let eigenvalues = &columns.eigenvalues;
    for (name, values) in [
        ("lambda_re", numbers(eigenvalues, |e| e.value.re)),
        ("lambda_im", numbers(eigenvalues, |e| e.value.im)),
        ("residual", numbers(eigenvalues, |e| e.residual)),
        ("condition", numbers(eigenvalues, |e| e.condition)),
    ] {
        file.dataset(name, ArrayView::from(&values))?;
    }
    let verdicts = columns.eigenvalues.iter().map(|e| e.verdict as u8);
    let verdicts: Vec<u8> = verdicts.collect();
    file.dataset("verdict", ArrayView::from(&verdicts))?;
    let participation = ArrayView::from(&columns.participation);
    file.dataset("participation", participation)?;
    file.dataset("eigenvector", columns.vectors.view())?;
    if !columns.unknowns.is_empty() {
        let unknowns = columns.unknowns.iter();
        let (grain, component): (Vec<u32>, Vec<u8>) = unknowns
            .map(|unknown| (unknown.grain, unknown.component))
            .unzip();
        file.dataset("grain", ArrayView::from(&grain))?;
        file.dataset("component", ArrayView::from(&component))?;
    }
    file.attribute("matrix", &matrix.display().to_string().into())?;
    file.attribute("version", &env!("CARGO_PKG_VERSION").into())?;
    if let Some(origin) = &columns.origin {
        file.attribute("stage", &origin.stage.name().into())?;
        if let Some(id) = &origin.run_id {
            file.attribute("run_id", &id.as_str().into())?;
        }
        file.attribute("step", &origin.step.into())?;
    }
    file.attribute("rattling", &Attribute::Count(problem.rattling() as u64))?;
    let null = problem.null().ncols() as u64;
    file.attribute("null_vectors", &Attribute::Count(null))?;
    file.attribute("norm", &problem.norm().into())
}

/// A number of each eigenvalue.
fn numbers(eigenvalues: &[Eigenvalue], number: fn(&Eigenvalue) -> f64) -> Vec<f64> {
    eigenvalues.iter().map(number).collect()
}
