//! `report`: a page on a run; with `--study` it repeats a published study on our runs.

use std::path::{Path, PathBuf};

use super::export::Which;
use super::rate_state::{self, Laws};
use super::replay::{self, ReplayRequest, Rows};
use super::scalars::FrameSeries;
use super::stiffness::{StateSelection, StoredState};
use gshear_analysis::jacobian::History;
use gshear_dem::failure::Failure;
use gshear_report::bonfanti::{self, BothForms, EnsembleRun, FirstPair};
use gshear_report::lee_hurley::{self, Size, Studied, StudyOptions, friction};
use gshear_scene::{Boundary, Source};
use gshear_spectrum::{Spectrum, Verdict};
use gshear_store::file_names::{AQS_FILE, NEWTONIAN_FILE};
use gshear_store::run_reader::{RunFile, RunStage};

/// Reduces the runs one after the other and writes the study of Lee & Hurley into `folder`, by default
/// lee-hurley/ beside the first. Returns the path of the page.
///
/// If the frames around the largest drop of a run are missing and checkpoints were kept, `threads`
/// threads replay them into `folder`/replay-K.
///
/// # Errors
/// An unfit run, a replay that differs, files that cannot be written.
pub fn lee_hurley(
    paths: &[PathBuf],
    folder: Option<&Path>,
    choice: StudyOptions,
    threads: usize,
) -> Result<PathBuf, Failure> {
    // Opens all runs first, so that a wrong name is reported at once.
    let runs: Vec<RunFile> = paths
        .iter()
        .map(|path| RunFile::open(path))
        .collect::<Result<_, _>>()?;
    let beside = runs[0].folder().join("lee-hurley");
    let folder = folder.unwrap_or(&beside);
    let labels = labels(&runs);
    let mut studied = Vec::new();
    for (k, (run, label)) in runs.iter().zip(labels).enumerate() {
        let series = FrameSeries::of(run)?;
        if series.tau.len() < 2 {
            return Err(Failure::input(format!(
                "{}: has {} frames: the study needs two or more",
                run.path().display(),
                series.tau.len()
            )));
        }
        let curve = [&series.strain[..], &series.tau[..]];
        let mut found = Studied::of(run, label, choice, curve, &series.step, &series.scalars)?;
        if let (Some(strain), true) = (found.missing(), replay::can(run)) {
            let request = ReplayRequest {
                rows: Rows::Strain(strain),
                every: None,
                threads,
            };
            let out = folder.join(format!("replay-{}", k + 1));
            found.take_frames(&replay::window(run, request, &out)?.run)?;
        }
        studied.push(found);
    }
    lee_hurley::write(&studied, folder)
}

/// Writes the report of a run into `folder`, by default report/ beside it. If no frames show the
/// largest drop between walls and checkpoints were kept, `threads` threads replay it into
/// `folder`/replay. Velocity steps and holds under a spring are reduced into `folder`/rate-state.
/// Returns the path of the page.
///
/// # Errors
/// A damaged run, a replay that differs, files that cannot be written.
pub fn report(path: &Path, folder: Option<&Path>, threads: usize) -> Result<PathBuf, Failure> {
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
    let slider = match rate_state::is_test(run) {
        true => Some("rate-state"),
        false => None,
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

/// Writes the study of Bonfanti et al. on the run in a folder, or on an ensemble of runs. Returns the
/// path of the page.
///
/// # Errors
/// Missing or damaged files, runs of an ensemble that are not done, files that cannot be written.
pub fn bonfanti(runs: &[PathBuf], folder: Option<&Path>) -> Result<PathBuf, Failure> {
    let beside = runs[0].join("bonfanti");
    let folder = folder.unwrap_or(&beside);
    let foretold = |run: &Path| {
        let moving = run.join(NEWTONIAN_FILE);
        match moving.exists() {
            true => growing_pair(&RunFile::open_any(&moving)?),
            false => Ok(None),
        }
    };
    if let [run] = runs {
        return bonfanti::write(run, folder, foretold(run)?.as_deref());
    }
    let mut studied = Vec::new();
    for run in runs {
        let strain = RunFile::open_any(&run.join(AQS_FILE))?;
        studied.push(EnsembleRun {
            folder: run,
            family: box_family(&strain)?,
            mode_weight: foretold(run)?,
            forms: first_pairs(&strain)?,
        });
    }
    bonfanti::write_ensemble(&studied, folder)
}

/// What runs in a box have in common that differ in their seeds only.
fn box_family(run: &RunFile) -> Result<String, Failure> {
    let name = format!("{} (its scene)", run.path().display());
    let scene = gshear_scene::load(&Source::new(&name, run.scene().to_string()), &[])?;
    match &scene.boundary {
        Boundary::Periodic(of) => Ok(format!(
            "φ = {} {} N = {}",
            of.solid_fraction,
            of.placement.name(),
            scene.sample.grains
        )),
        Boundary::Walls(_) => Err(Failure::input(format!(
            "{}: is not of a periodic box",
            run.path().display()
        ))),
    }
}

/// Finds the first frame with a complex pair, with K and with J in the paper's form.
fn first_pairs(run: &RunFile) -> Result<BothForms, Failure> {
    let strains = match run.frames() {
        0 => Vec::new(),
        _ => run.frame_strains()?,
    };
    let first = |history: History| -> Result<Option<FirstPair>, Failure> {
        for (t, &strain) in strains.iter().enumerate() {
            let state = StoredState::of_run(run, StateSelection::Frame(Which::Number(t)))?;
            let found = match state.stability(history) {
                Err(failure @ Failure::Numbers(_)) => {
                    eprintln!("note: {failure}; going on with the next frame");
                    continue;
                }
                found => found?,
            };
            if found.pairs > 0.0 {
                let omega = faer::c64::new(found.pair_real, found.imaginary_greatest).sqrt();
                return Ok(Some(FirstPair {
                    before: t.checked_sub(1).map_or(f64::NAN, |t| strains[t]),
                    after: strain,
                    lambda_i: found.imaginary_greatest,
                    omega_r: omega.re,
                    omega_i: omega.im,
                }));
            }
        }
        Ok(None)
    };
    Ok(BothForms {
        frames: strains.len(),
        ours: first(History::Turned)?,
        paper: first(History::Unturned)?,
    })
}

/// Largest number of unknowns for which the growing pair is computed, from all eigenvalues.
const MOST_UNKNOWNS: usize = 3000;

/// Returns |v|² of each grain's translation, `[N]`, scaled to a sum of 1, for the complex pair that
/// grows fastest (greatest Im √λ) in the first frame; `None` without a frame or a pair.
fn growing_pair(run: &RunFile) -> Result<Option<Vec<f64>>, Failure> {
    if run.frames() == 0 {
        return Ok(None);
    }
    let first = StateSelection::Frame(Which::Number(0));
    let jacobian = StoredState::of_run(run, first)?.jacobian(History::Turned);
    if jacobian.unknowns() > MOST_UNKNOWNS {
        return Ok(None);
    }
    let unfit = |why| Failure::numbers(format!("{}: {why}", run.path().display()));
    let problem = jacobian.problem().map_err(unfit)?;
    let spectrum = Spectrum::dense(&problem);
    let pairs = (0..spectrum.eigenvalues.len())
        .filter(|&k| spectrum.eigenvalues[k].verdict == Verdict::Pair);
    // Both of a pair have the same |Im √λ|.
    let rate = |k: usize| spectrum.eigenvalues[k].value.sqrt().im.abs();
    let Some(k) = pairs.max_by(|a, b| rate(*a).total_cmp(&rate(*b))) else {
        return Ok(None);
    };
    let w: Vec<_> = (0..problem.size())
        .map(|i| spectrum.right[(i, k)])
        .collect();
    let v = problem.eigenvector(&w);
    let of_grain = |unknowns: &[faer::c64]| {
        let axes = &unknowns[..jacobian.axes];
        axes.iter().map(faer::c64::norm_sqr).sum::<f64>()
    };
    let squares: Vec<f64> = v.chunks(jacobian.per_grain).map(of_grain).collect();
    let sum: f64 = squares.iter().sum();
    Ok(Some(squares.iter().map(|x| x / sum).collect()))
}

/// The friction and, where runs of both sizes are there, the size; numbered where that does not
/// tell them apart. Without commas, since they stand in tables.
fn labels(runs: &[RunFile]) -> Vec<String> {
    let sizes: Vec<Size> = runs.iter().map(|run| Size::of(run.grains())).collect();
    let both = sizes.iter().any(|size| *size != sizes[0]);
    let label = |(run, size): (&RunFile, &Size)| {
        let friction = friction(run).map_or("μ_s unknown".into(), |mu| format!("μ_s = {mu}"));
        if both {
            format!("{friction} {}", size.name())
        } else {
            friction
        }
    };
    let labels: Vec<String> = runs.iter().zip(&sizes).map(label).collect();
    let numbered = |(k, label): (usize, &String)| {
        let same = |other: &&String| *other == label;
        if labels.iter().filter(same).count() == 1 {
            return label.clone();
        }
        format!("{label} ({})", labels[..=k].iter().filter(same).count())
    };
    labels.iter().enumerate().map(numbered).collect()
}
