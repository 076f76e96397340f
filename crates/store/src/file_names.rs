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
/// D²min of every grain and frame.
pub const REDUCED_FILE: &str = "reduced.h5";
/// Eigenvalues and eigenvectors of a state.
pub const SPECTRUM_FILE: &str = "spectrum.h5";
/// Folders of the report and of fits of rate and state.
pub const REPORT_FOLDER: &str = "report";
/// See [`REPORT_FOLDER`].
pub const RATE_STATE_FOLDER: &str = "rate-state";
/// What `gshear-reduce` writes into the folder of a run beside tables of the [`crate::dictionary`].
pub const RESULTS: [&str; 6] = [
    REDUCED_FILE,
    SPECTRUM_FILE,
    REPORT_FOLDER,
    RATE_STATE_FOLDER,
    // By the studies in Python.
    "lee-hurley",
    "bonfanti",
];

/// The folder of a run: itself, or that of its file.
pub fn folder_of(run: &Path) -> &Path {
    match run.parent() {
        _ if run.is_dir() => run,
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}
