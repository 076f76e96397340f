//! Reads the eigenvectors of `spectrum.h5` by grain.

use std::path::{Path, PathBuf};

use hdf5::Dataset;
use hdf5::types::VarLenUnicode;
use ndarray::{Ix2, s};

use gshear_dem::failure::{Failure, Result};

use crate::run_reader::one_line;
use crate::sound::{self, ReadFile};

/// What a file of a run has of its grains.
const OF_GRAINS: [&str; 3] = ["grain", "component", "eigenvector"];

/// An open `spectrum.h5` of a run.
pub struct SpectrumFile {
    path: PathBuf,
    /// Identity of the run; `None` if the writer did not know it.
    pub run_id: Option<String>,
    /// Name of the stage of the state.
    pub stage: String,
    /// Step of the state in its stage.
    pub step: u64,
    grain: Vec<u32>,
    component: Vec<u8>,
    vectors: Dataset,
    /// Closed when its dataset is.
    _file: ReadFile,
}

/// An eigenvector: of every grain the displacement and the rotation, each as real and imaginary
/// part; zero of grains that are held.
pub struct Mode {
    /// `[N][3]` Real and imaginary part of the displacement.
    pub displacement: [Vec<[f64; 3]>; 2],
    /// `[N][3]` Real and imaginary part of the rotation.
    pub rotation: [Vec<[f64; 3]>; 2],
}

fn bad(path: &Path, why: &str) -> Failure {
    Failure::input(format!("{}: {why}", path.display()))
}

fn damaged(path: &Path, why: &hdf5::Error) -> Failure {
    bad(path, &format!("is damaged: {}", one_line(why)))
}

/// An attribute of text.
fn text(file: &hdf5::File, name: &str) -> hdf5::Result<String> {
    let value: VarLenUnicode = file.attr(name)?.read_scalar()?;
    Ok(value.as_str().into())
}

impl SpectrumFile {
    /// Opens a file that `gshear-reduce spectrum` wrote of a run.
    ///
    /// # Errors
    /// [`Failure::Input`] if it is no such file.
    pub fn open(path: &Path) -> Result<Self> {
        hdf5::silence_errors(true);
        if !path.is_file() {
            let why = "no such file; write it with gshear-reduce spectrum";
            return Err(bad(path, why));
        }
        let file = sound::open(path).map_err(|e| damaged(path, &e))?;
        let is_of_run = file.attr("stage").is_ok();
        if !is_of_run || OF_GRAINS.iter().any(|name| !file.link_exists(name)) {
            return Err(bad(
                path,
                "has no eigenvectors by grain; write it with gshear-reduce spectrum RUN, without --paper-form",
            ));
        }
        let spectrum = Self::read(path, file).map_err(|e| damaged(path, &e))?;
        let unknowns = spectrum.grain.len();
        let fits = spectrum.component.len() == unknowns
            && spectrum.component.iter().all(|&c| c < 6)
            && matches!(spectrum.vectors.shape()[..], [_, n, 2] if n == unknowns);
        if fits {
            Ok(spectrum)
        } else {
            Err(bad(path, "is damaged"))
        }
    }

    fn read(path: &Path, file: ReadFile) -> hdf5::Result<Self> {
        Ok(Self {
            path: path.to_path_buf(),
            run_id: text(&file, "run_id").ok(),
            stage: text(&file, "stage")?,
            step: file.attr("step")?.read_scalar()?,
            grain: file.dataset("grain")?.read_raw()?,
            component: file.dataset("component")?.read_raw()?,
            vectors: file.dataset("eigenvector")?,
            _file: file,
        })
    }

    /// Returns the number of eigenvectors.
    pub fn modes(&self) -> usize {
        self.vectors.shape()[0]
    }

    /// Reads eigenvector k, from 0 on, of a run of so many grains.
    ///
    /// # Errors
    /// [`Failure::Input`] if there is no such vector or grain, or the file is damaged.
    pub fn mode(&self, k: usize, grains: usize) -> Result<Mode> {
        let path = &self.path;
        if k >= self.modes() {
            let last = self.modes().saturating_sub(1);
            let why = format!("has no eigenvector {k}; it has 0 … {last}");
            return Err(bad(path, &why));
        }
        if self.grain.iter().any(|&grain| grain as usize >= grains) {
            let why = format!("has grains beyond the {grains} of the run");
            return Err(bad(path, &why));
        }
        let values = self.vectors.read_slice::<f64, _, Ix2>(s![k, .., ..]);
        let values = values.map_err(|e| damaged(path, &e))?;
        let none = [vec![[0.0; 3]; grains], vec![[0.0; 3]; grains]];
        let mut mode = Mode {
            displacement: none.clone(),
            rotation: none,
        };
        let unknowns = self.grain.iter().zip(&self.component);
        for ((&grain, &component), value) in unknowns.zip(values.outer_iter()) {
            let parts = match component {
                0..3 => &mut mode.displacement,
                _ => &mut mode.rotation,
            };
            for (part, value) in parts.iter_mut().zip(value) {
                part[grain as usize][usize::from(component % 3)] = *value;
            }
        }
        Ok(mode)
    }
}
