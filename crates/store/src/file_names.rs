//! Names of the files in a run's folder, but for the checkpoints' ([`crate::checkpoint`]).

use std::path::Path;

use gshear_scene::{RunStage, Stages};

/// Frames and time series of a run: of its first stage, and in parts of its later ones.
pub const RUN_FILE: &str = "run.h5";
/// Its part with Newton's equations, which follow strain steps.
pub const NEWTONIAN_PART: &str = "run.h5/newtonian";

/// The file and all its parts.
pub const ALL_PARTS: [&str; 4] = [RUN_FILE, STRAIN_PART, SHEAR_PART, NEWTONIAN_PART];
/// Its parts with strain steps and with a shear, where another stage came before.
const STRAIN_PART: &str = "run.h5/aqs";
const SHEAR_PART: &str = "run.h5/shear";

/// The file, or its part, of a stage.
pub fn part_of(stages: &Stages, stage: RunStage) -> &'static str {
    match stage {
        _ if stage == stages.first() => RUN_FILE,
        RunStage::Shear => SHEAR_PART,
        RunStage::Strain => STRAIN_PART,
        RunStage::Newtonian => NEWTONIAN_PART,
    }
}
/// The time series of the shear as text.
pub const LOG_FILE: &str = "log.csv";
/// Units and meaning of its columns.
pub const LOG_METADATA_FILE: &str = "log.csv-metadata.json";
/// The scene, with all defaults.
pub const SCENE_FILE: &str = "scene.toml";
/// Eigenvalues in time, one per line.
pub const SPECTRA_FILE: &str = "spectra.csv";
/// How far the run has come, for dashboards.
pub const STATUS_FILE: &str = "status.json";

/// What `gshear-reduce` writes into the folder of a run unless told otherwise, apart from metadata
/// of tables and from exports.
const REDUCED: [&str; 29] = [
    "report",
    "sweep-report",
    "rate-state",
    "replay",
    // By the studies in Python.
    "lee-hurley",
    "bonfanti",
    "reduced.h5",
    "phases.csv",
    "regions.csv",
    "measures.csv",
    "correlations.csv",
    "stages.csv",
    "stages-steps.csv",
    "stages-grains.csv",
    "stages-contacts.csv",
    "events.csv",
    "events-grains.csv",
    "events-propagator.csv",
    "events-map.csv",
    "events-pairs.csv",
    "growth.csv",
    "growth-grains.csv",
    "stability.csv",
    "birth",
    "spectrum.csv",
    "spectrum.h5",
    "spectrum.svg",
    "spectrum.pdf",
    "spectrum.png",
];

/// Figures of events, without their endings.
const EVENT_FIGURES: [&str; 5] = [
    "events",
    "events-sizes",
    "events-displacement",
    "events-stress",
    "events-propagator",
];

/// Whether `gshear-reduce` writes something of this name into the folder of a run unless told
/// otherwise. Its commands take the places of their results by these names alone; a new run in the
/// folder removes what has one.
pub fn is_reduced(name: &str) -> bool {
    let name = name.strip_suffix("-metadata.json").unwrap_or(name);
    let (stem, ending) = name.rsplit_once('.').unwrap_or((name, ""));
    let of_frames = stem.strip_suffix("-contacts").unwrap_or(stem);
    let of_frames = of_frames.strip_suffix("-wall").unwrap_or(of_frames);
    let is_movie = ["movie", "aqs-movie", "newtonian-movie"].contains(&stem);
    REDUCED.contains(&name)
        || match ending {
            // The folder of its frames has no ending.
            "" | "mp4" | "png" if is_movie => true,
            "svg" | "pdf" | "png" if EVENT_FIGURES.contains(&stem) => true,
            "dump" | "vtkhdf" | "xyz" | "npz" | "csv"
                if ["frames", "aqs-frames", "newtonian-frames"].contains(&of_frames) =>
            {
                true
            }
            "csv" => stem.strip_suffix("-contacts").is_some_and(is_of_a_state),
            "data" => is_of_a_state(stem),
            _ => false,
        }
}

/// Whether this is the name of a data file, without its ending.
fn is_of_a_state(stem: &str) -> bool {
    let number = stem.strip_prefix("frame-");
    stem.starts_with("checkpoint")
        || number.is_some_and(|text| text.bytes().all(|byte| byte.is_ascii_digit()))
}

/// The folder of a run: itself, or that of its file, or of a part of that.
pub fn folder_of(run: &Path) -> &Path {
    let run = match run.parent() {
        Some(file) if file.is_file() => file,
        _ => run,
    };
    match run.parent() {
        _ if run.is_dir() => run,
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_known_by_their_names_and_files_of_a_run_are_none() {
        for name in [
            "report",
            "stability.csv",
            "stability.csv-metadata.json",
            "spectrum.png",
            "frame-12.data",
            "frame-12-contacts.csv",
            "checkpoint-aqs-8.data",
            "aqs-frames.vtkhdf",
            "frames-contacts.csv-metadata.json",
            "aqs-frames-wall-contacts.dump",
            "aqs-movie.png",
            "events-stress.pdf",
            "movie",
        ] {
            assert!(is_reduced(name), "{name}");
        }
        for name in [
            RUN_FILE,
            LOG_FILE,
            LOG_METADATA_FILE,
            SPECTRA_FILE,
            "frame-a.data",
            "frame-a-contacts.csv",
            "a.xyz",
        ] {
            assert!(!is_reduced(name), "{name}");
        }
    }
}
