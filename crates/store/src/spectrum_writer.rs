//! Writes `spectrum.h5` (docs/file-formats.md).

use std::path::{Path, PathBuf};

use hdf5::types::VarLenUnicode;
use ndarray::{Array3, ArrayView};

use gshear_dem::failure::Failure;
use gshear_spectrum::{Eigenvalue, Problem};

use crate::checked;
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
/// [`Failure::Other`] if the file cannot be written.
pub fn write(
    path: &Path,
    matrix: &Path,
    problem: &Problem,
    columns: &Columns,
) -> Result<PathBuf, Failure> {
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
        let text = |name: &str, value: &str| {
            let value: VarLenUnicode = value.parse().unwrap_or_default();
            file.new_attr::<VarLenUnicode>()
                .create(name)?
                .write_scalar(&value)
        };
        text("matrix", &matrix.display().to_string())?;
        text("version", env!("CARGO_PKG_VERSION"))?;
        let count = |name: &str, value: usize| {
            file.new_attr::<u64>()
                .create(name)?
                .write_scalar(&(value as u64))
        };
        if let Some(origin) = &columns.origin {
            text("stage", origin.stage.name())?;
            if let Some(id) = &origin.run_id {
                text("run_id", id)?;
            }
            file.new_attr::<u64>()
                .create("step")?
                .write_scalar(&origin.step)?;
        }
        count("rattling", problem.rattling())?;
        count("null_vectors", problem.null().ncols())?;
        file.new_attr::<f64>()
            .create("norm")?
            .write_scalar(&problem.norm())?;
        file.close()
    };
    let saved = save();
    part.checked(saved)?;
    part.finish()
}
