//! A `run.h5` that a resumed run finds: what it holds, whether it can be continued, and its repair.

use super::contact_quantities::{
    AGE, ContactTable, FrameFormat, IDLE, TANGENTIAL_HISTORY, TWISTING,
};
use super::disk;
use super::h5::{self, Attribute};
use super::journal::{self, Journal};
use super::layout::{
    OBSERVABLES, PARAMETERS, PARTICLES, REMOVED, SCALARS, contact_dataset, grain_dataset,
};
use super::own_columns;
use super::part::Part;
use super::run_reader::owner;
use super::sound;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::columns::{Column, joined_names};
use gshear_dem::failure::{Failure, Result};
use hdf5::Group;
use hdf5::types::VarLenUnicode;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Prepares the file of a run that resumes: brings one that a killed program left behind back to
/// its last checkpoint, removes one that it had only begun, and sets one aside that is damaged,
/// with a note. Not collective.
///
/// # Errors
/// If a file can be neither written nor renamed, or the system does not let it be opened.
pub fn recover(path: &Path, notes: &mut Vec<String>) -> Result<()> {
    let Ok(metadata) = std::fs::metadata(path) else {
        return Ok(());
    };
    sound::is_regular(metadata.file_type())
        .map_err(|e| Failure::input(format!("{}: cannot be continued: {e}", path.display())))?;
    if let Some(journal) = Journal::read(path) {
        if journal.is_of_nothing() {
            return remove(path);
        }
        journal.restore(path)?;
    }
    hdf5::silence_errors(true);
    let Err(error) = sound::read(path, h5::walk) else {
        return Ok(());
    };
    let message = format!("{}: cannot be opened: {error}", path.display());
    if disk::is_refused(&message) {
        return Err(Failure::other(message));
    }
    let mut number = 1;
    let mut aside = path.with_extension("unreadable-1.h5");
    while aside.exists() {
        number += 1;
        aside = path.with_extension(format!("unreadable-{number}.h5"));
    }
    std::fs::rename(path, &aside)
        .map_err(|e| Failure::other(format!("{}: cannot be renamed: {e}", path.display())))?;
    journal::remove(path)?;
    notes.push(format!(
        "{} cannot be read ({error}); it is now {}, and a new file begins at the checkpoint",
        path.display(),
        aside.display()
    ));
    Ok(())
}

/// Removes a symbolic link in the place of a file that is about to be created. A user may link it
/// to another disk, but what somebody else has linked must not be replaced: the file there must not
/// exist, or be empty, or be of this run, and its name must end in `.h5`. Not collective.
///
/// # Errors
/// If the link cannot be removed.
pub(crate) fn unlink_foreign(path: &Path, run_id: Option<&Attribute>) -> Result<()> {
    if !path.is_symlink() || is_own(&journal::target(path), run_id) {
        return Ok(());
    }
    std::fs::remove_file(path)
        .map_err(|e| Failure::other(format!("{}: cannot be removed: {e}", path.display())))
}

/// Whether a file may be replaced by that of the run with this id.
fn is_own(target: &Path, run_id: Option<&Attribute>) -> bool {
    let is_named = target.extension().is_some_and(|ending| ending == "h5");
    let has_content = std::fs::metadata(target).is_ok_and(|file| file.len() > 0);
    is_named && (!has_content || is_of(target, run_id))
}

/// Whether a file is of the run with this id.
pub(crate) fn is_of(path: &Path, run_id: Option<&Attribute>) -> bool {
    let id = owner(path).ok().and_then(|owner| owner.run_id);
    id.is_some() && id.map(Attribute::Text).as_ref() == run_id
}

/// Removes a file without a checkpoint, which may be linked to another disk, and its journal.
fn remove(path: &Path) -> Result<()> {
    std::fs::remove_file(journal::target(path))
        .map_err(|e| Failure::other(format!("{}: cannot be removed: {e}", path.display())))?;
    journal::remove(path)
}

/// Returns the numbers of frames, rows of the time series and rows of scalars up to the step
/// `last`. Not collective.
///
/// # Errors
/// [`Failure::Input`] if the file is not a `run.h5`, or damaged.
pub fn up_to(path: &Path, series: &[Column], last: u64) -> Result<[u64; 3]> {
    inspect(path, series, 0, 0)?;
    let counts = within(path, |part| counts_up_to(part, series, last));
    counts.map_err(|error| unfit(path, &format!("{NO_RUN} ({error})")))
}

/// Reads from a part of a file, and closes it.
fn within<T>(path: &Path, read: impl FnOnce(&Group) -> hdf5::Result<T>) -> hdf5::Result<T> {
    let part = Part::of(path).open()?;
    let content = read(&part)?;
    part.close()?;
    Ok(content)
}

/// The steps of a group of datasets.
fn steps(part: &Group, name: &str) -> hdf5::Result<Vec<u64>> {
    part.dataset(&format!("{name}/step"))?.read_raw()
}

fn counts_up_to(part: &Group, series: &[Column], last: u64) -> hdf5::Result<[u64; 3]> {
    let frames = steps(part, &format!("{PARTICLES}/position"))?;
    let rows = steps(part, &format!("{OBSERVABLES}/{}", series[0]))?;
    let scalars = if part.link_exists(SCALARS) {
        steps(part, &format!("{SCALARS}/{}", FrameScalars::COLUMNS[0]))?
    } else {
        Vec::new()
    };
    Ok([frames, rows, scalars].map(|steps| ascending_up_to(&steps, last)))
}

/// Number of ascending steps up to `last`: a killed program may have left anything after them.
fn ascending_up_to(steps: &[u64], last: u64) -> u64 {
    let mut before = None;
    let mut count = 0;
    for &step in steps {
        if step > last || before.is_some_and(|before| step <= before) {
            break;
        }
        before = Some(step);
        count += 1;
    }
    count
}

fn unfit(path: &Path, why: &str) -> Failure {
    let path = path.display();
    disk::unread(format!("{path}: cannot continue this file: {why}"))
}

const NO_RUN: &str = "it is not the run.h5 of a run, or damaged";

const ANOTHER: &str = "another version wrote the file, its protocol imposed velocities alone and this one more, \
     its bottom did not vibrate along x, or output.temperatures has changed: resume with what wrote it or into another folder (--out)";

/// What is wrong with the columns that scenes have declared, of a file and of the run.
fn other_own_columns(file: &Group, series: &[Column]) -> hdf5::Result<Option<String>> {
    let parameters = file.group(PARAMETERS)?;
    let mut stored = String::new();
    if let Ok(attribute) = parameters.attr(own_columns::ATTRIBUTE) {
        stored = attribute.read_scalar::<VarLenUnicode>()?.to_string();
    }
    let now = own_columns::text(series).unwrap_or_default();
    if stored == now {
        return Ok(None);
    }
    let [stored, now] = [own_columns::read(&stored), own_columns::read(&now)];
    let names = |columns: &Option<Vec<Column>>| match columns.as_deref() {
        None | Some([]) => "none".to_string(),
        Some(columns) => joined_names(columns, ", "),
    };
    let what = if names(&stored) == names(&now) {
        let mut pairs = stored.iter().flatten().zip(now.iter().flatten());
        let changed = pairs.find(|(stored, now)| stored != now);
        changed.map(|(stored, now)| {
            let described = |column: &Column| format!("{} (unit {})", column.doc, column.unit);
            format!(
                "its observable {stored} is {}, and that of this run {}",
                described(stored),
                described(now)
            )
        })
    } else {
        None
    };
    let what = what.unwrap_or_else(|| {
        let [stored, now] = [names(&stored), names(&now)];
        format!("its observables are {stored}, and those of this run {now}")
    });
    Ok(Some(format!(
        "{what}: [[observable]] begins with a file; resume with those of the file, or into another folder (--out)"
    )))
}

/// A file that can be continued.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Continued {
    /// N.
    pub grains: u64,
    /// The number of contacts in the frames that are kept, in each table.
    pub contacts: Vec<u64>,
    /// What its contacts are.
    pub form: FrameFormat,
}

/// Checks that a file has these columns of the time series and can be continued after these numbers
/// of frames and rows. Returns what it holds of them. Writes nothing. Not collective.
///
/// # Errors
/// [`Failure::Input`] if the file is not a `run.h5` or holds less.
///
/// # Panics
/// If `series` is empty.
pub fn inspect(path: &Path, series: &[Column], frames: u64, rows: u64) -> Result<Continued> {
    hdf5::silence_errors(true);
    if !Part::of(path).file.is_file() {
        let name = path.display();
        return Err(Failure::input(format!(
            "{name}: there is no such file to continue"
        )));
    }
    match within(path, |part| continued(part, series, frames, rows)) {
        Ok(content) => content.map_err(|why| unfit(path, &why)),
        Err(error) => Err(unfit(path, &format!("{NO_RUN} ({error})"))),
    }
}

/// Number of rows of a dataset.
fn length(file: &Group, name: &str) -> hdf5::Result<u64> {
    let shape = file.dataset(name)?.shape();
    Ok(shape.first().copied().unwrap_or(0) as u64)
}

/// [`inspect`] of an open file: what it holds, or why it cannot be continued.
fn continued(
    file: &Group,
    series: &[Column],
    frames: u64,
    rows: u64,
) -> hdf5::Result<Result<Continued, String>> {
    file.group(PARAMETERS)?.attr("scene")?;
    let position = file.dataset(&format!("{PARTICLES}/position/value"))?;
    let [_, grains, 3] = position.shape()[..] else {
        return Ok(Err("position/value is not [T][N][3]".into()));
    };
    if let Some(why) = other_own_columns(file, series)? {
        return Ok(Err(why));
    }
    let mut others = file.group(OBSERVABLES)?.member_names()?;
    let mut first = None;
    for column in series {
        let Some(place) = others.iter().position(|other| other == column.name) else {
            return Ok(Err(format!("it has no column {column}; {ANOTHER}")));
        };
        let name = others.swap_remove(place);
        first.get_or_insert(name);
    }
    others.retain(|name| format!("{OBSERVABLES}/{name}") != SCALARS);
    if let Some(name) = others.first() {
        let why = format!("its column {name} would not be continued; {ANOTHER}");
        return Ok(Err(why));
    }
    let first = first.expect("the time series has a column");
    let has_frames = length(file, "connectivity/contacts/offset")?;
    let has_rows = length(file, &format!("{OBSERVABLES}/{first}/step"))?;
    if has_frames < frames + 1 || position.shape()[0] < frames as usize || has_rows < rows {
        return Ok(Err(format!(
            "it holds {} frames and {has_rows} rows, the checkpoint counts {frames} and {rows}",
            has_frames.saturating_sub(1)
        )));
    }
    let spin = file.dataset(&format!("{PARTICLES}/angular_velocity/value"))?;
    let form = FrameFormat {
        axes: spin.ndim(),
        torques: file.link_exists(&contact_dataset(TWISTING)),
        idle: file.link_exists(&contact_dataset(IDLE)),
        histories: file.link_exists(&contact_dataset(TANGENTIAL_HISTORY)),
        ages: file.link_exists(&contact_dataset(AGE)),
        removed: file.link_exists(&grain_dataset(&REMOVED.column)),
        walls: file.link_exists(ContactTable::Walls.group()),
    };
    let mut contacts = Vec::new();
    for table in ContactTable::of(form) {
        let offset = file.dataset(&table.dataset("offset"))?;
        if offset
            .shape()
            .first()
            .is_none_or(|rows| *rows as u64 <= frames)
        {
            return Ok(Err(format!("{} holds too few frames", table.group())));
        }
        let end = offset.read_slice_1d::<u64, _>(frames as usize..=frames as usize)?[0];
        if length(file, &table.dataset("i"))? < end {
            return Ok(Err("contacts are missing".into()));
        }
        contacts.push(end);
    }
    Ok(Ok(Continued {
        grains: grains as u64,
        contacts,
        form,
    }))
}
