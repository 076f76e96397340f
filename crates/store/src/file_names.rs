//! Names of the files in a run's folder, but for the checkpoints' ([`crate::checkpoint`]).

use std::path::Path;

/// Frames and time series of the shear between walls.
pub const RUN_FILE: &str = "run.h5";
/// The time series of the shear as text.
pub const LOG_FILE: &str = "log.csv";
/// Units and meaning of its columns.
pub const LOG_METADATA_FILE: &str = "log.csv-metadata.json";
/// The scene, with all defaults.
pub const SCENE_FILE: &str = "scene.toml";
/// Strain steps of a run in a periodic box.
pub const AQS_FILE: &str = "aqs.h5";
/// Newton's equations of a run in a periodic box.
pub const NEWTONIAN_FILE: &str = "newtonian.h5";
/// Eigenvalues in time, one per line.
pub const SPECTRA_FILE: &str = "spectra.csv";
/// How far the run has come, for dashboards.
pub const STATUS_FILE: &str = "status.json";

/// The folder of a run: itself, or that of its file.
pub fn folder_of(run: &Path) -> &Path {
    match run.parent() {
        _ if run.is_dir() => run,
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}
