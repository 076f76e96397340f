//! Writes `spectrum.h5` (docs/file-formats.md).

use std::path::{Path, PathBuf};

use ndarray::{Array3, ArrayView};

use gshear_dem::failure::Result;
use gshear_spectrum::{Eigenvalue, Problem};

use crate::checked;
use crate::h5::{Attribute, set_attribute};
use crate::run_reader::RunStage;
use crate::text_writer::PartFile;

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
    let part = PartFile::create(path)?;
    let save = || -> hdf5::Result<()> {
        let file = checked::create(part.part())?;
        let numbers = |name: &str, of: &dyn Fn(&Eigenvalue) -> f64| {
            let values: Vec<f64> = columns.eigenvalues.iter().map(of).collect();
            checked::dataset(&file, name, ArrayView::from(&values))
        };
        numbers("lambda_re", &|e| e.value.re)?;
        numbers("lambda_im", &|e| e.value.im)?;
        numbers("residual", &|e| e.residual)?;
        numbers("condition", &|e| e.condition)?;
        let verdicts = columns.eigenvalues.iter().map(|e| e.verdict as u8);
        let verdicts: Vec<u8> = verdicts.collect();
        checked::dataset(&file, "verdict", ArrayView::from(&verdicts))?;
        let participation = ArrayView::from(&columns.participation);
        checked::dataset(&file, "participation", participation)?;
        checked::dataset(&file, "eigenvector", columns.vectors.view())?;
        if !columns.unknowns.is_empty() {
            let grain: Vec<u32> = columns.unknowns.iter().map(|of| of.grain).collect();
            let component: Vec<u8> = columns.unknowns.iter().map(|of| of.component).collect();
            checked::dataset(&file, "grain", ArrayView::from(&grain))?;
            checked::dataset(&file, "component", ArrayView::from(&component))?;
        }
        let attribute = |name: &str, value: Attribute| set_attribute(&file, name, &value);
        attribute("matrix", matrix.display().to_string().into())?;
        attribute("version", env!("CARGO_PKG_VERSION").into())?;
        if let Some(origin) = &columns.origin {
            attribute("stage", origin.stage.name().into())?;
            if let Some(id) = &origin.run_id {
                attribute("run_id", id.as_str().into())?;
            }
            attribute("step", origin.step.into())?;
        }
        attribute("rattling", Attribute::Count(problem.rattling() as u64))?;
        let null = problem.null().ncols() as u64;
        attribute("null_vectors", Attribute::Count(null))?;
        attribute("norm", problem.norm().into())?;
        file.close()
    };
    let saved = save();
    part.checked(saved)?;
    part.finish()
}
