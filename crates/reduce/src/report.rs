//! `report`: a page on a run.

use std::path::{Path, PathBuf};

use super::rate_state::{self, Laws};
use super::replay::{self, ReplayRequest, Rows};
use gshear_dem::failure::Failure;
use gshear_store::file_names::NEWTONIAN_FILE;
use gshear_store::run_reader::{RunFile, RunStage};

/// Writes the report of a run into `folder`, by default report/ beside it. If no frames show the
/// largest drop between walls and checkpoints were kept, `threads` threads replay it into
/// `folder`/replay. Velocity steps and holds under a spring are reduced into `folder`/rate-state.
/// Returns the path of the page.
///
/// # Errors
/// A damaged run, a replay that differs, files that cannot be written.
pub fn write(path: &Path, folder: Option<&Path>, threads: usize) -> Result<PathBuf, Failure> {
    let run = &RunFile::open_any(path)?;
    let beside = run.folder().join("report");
    let folder = folder.unwrap_or(&beside);
    if run.stage() != RunStage::Shear {
        let moving = path.join(NEWTONIAN_FILE);
        let further = (run.stage() == RunStage::Strain && moving.exists())
            .then(|| RunFile::open_any(&moving));
        let further = further.transpose()?;
        let files: Vec<&RunFile> = [run].into_iter().chain(&further).collect();
        return gshear_report::write_box(&files, folder);
    }
    let missing = gshear_report::window_without_frames(run)?.filter(|_| replay::can(run));
    let again = |time| {
        let request = ReplayRequest {
            rows: Rows::Time(time),
            every: None,
            threads,
        };
        replay::window(run, request, &folder.join("replay"))
    };
    let replayed = missing.map(again).transpose()?;
    let slider = if rate_state::is_test(run) {
        Some("rate-state")
    } else {
        None
    };
    if let Some(name) = slider {
        let runs = std::slice::from_ref(run);
        rate_state::write(
            runs,
            (Laws::Both, None),
            &folder.join(name),
            &mut std::io::sink(),
        )?;
    }
    let page = slider.map(|name| format!("{name}/index.html"));
    let replayed = replayed.as_ref().map(|of| &of.run);
    gshear_report::write(run, replayed, page.as_deref(), folder)
}
