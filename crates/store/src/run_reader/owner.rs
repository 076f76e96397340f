//! Which run a file belongs to.

use std::path::Path;

use super::open_file::OpenFile;
use super::{Parameter, Parameters};
use crate::journal;
use crate::part::Part;
use gshear_dem::failure::Result;

/// The run that a file of frames and time series belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct Owner {
    /// The identity of the run; `None` in files of versions without it.
    pub run_id: Option<String>,
    /// The scene as TOML.
    pub scene: String,
    /// Whether the stage of the file is done.
    pub finished: bool,
    /// Whether the run began from a checkpoint of another one.
    pub branch: bool,
    /// Steps of the stage before the file begins; 0 unless it was begun at a resume.
    pub begun_at: u64,
    /// Whether a replay wrote the file.
    pub replay: bool,
}

/// Reads which run a `run.h5`, or a part of it, belongs to.
///
/// # Errors
/// `Failure::Input` if the file is not of a run, or damaged.
pub fn owner(path: &Path) -> Result<Owner> {
    hdf5::silence_errors(true);
    let file = OpenFile::open(path)?;
    let parameters = file.parameters()?;
    file.close()?;
    Ok(Owner {
        run_id: text(&parameters, "run_id"),
        scene: text(&parameters, "scene").unwrap_or_default(),
        // A file with a journal was not closed: a killed program may have left it in any state.
        finished: parameters.contains_key("digest")
            && !journal::path_of(&Part::of(path).file).exists(),
        branch: parameters.contains_key("parent_run_id"),
        begun_at: match parameters.get("begun_at_step") {
            Some(Parameter::Integer(step)) => *step as u64,
            _ => 0,
        },
        replay: parameters.contains_key("replay"),
    })
}

fn text(parameters: &Parameters, name: &str) -> Option<String> {
    match parameters.get(name) {
        Some(Parameter::Text(text)) => Some(text.clone()),
        _ => None,
    }
}
