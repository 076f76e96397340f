//! The study of Bonfanti et al. (BO): figures 1 to 5 of the paper drawn from one run, and the
//! paper's numbers next to the run's; of several runs, what became of their pairs.

mod curves;
mod ensemble;

use std::path::{Path, PathBuf};

pub use self::ensemble::{BothForms, FirstPair};
use crate::drawing;
use crate::page::{document, escape, links, scene_of};
use gshear_analysis::event;
use gshear_analysis::growth::{self, Growth};
use gshear_dem::dimension::{Three, Two};
use gshear_dem::failure::Failure;
use gshear_store::file_names::{AQS_FILE, NEWTONIAN_FILE, SPECTRA_FILE};
use gshear_store::run_reader::RunFile;
use gshear_store::table::{self, Table};
use gshear_store::{dictionary, text_writer};

/// Limit of the linear regime: mean square displacement over the square of the mean diameter.
const LINEAR: f64 = 1e-11;

/// The data of a run.
struct BoxRun {
    strain: RunFile,
    newtonian: Option<RunFile>,
    spectra: Option<SvgWithData>,
    growth: Option<Growth>,
    /// Places of the grains in the frames of the linear growth, which do not jump at the seams.
    places: Vec<Vec<[f64; 3]>>,
    /// |v|² in the growing pair, and D²min of the slip that follows it, `[N]` each.
    slip: Option<[Vec<f64>; 2]>,
}

/// A row of `spectra.csv`.
#[derive(serde::Deserialize)]
struct SpectrumRow {
    time: f64,
    real: f64,
    imaginary: f64,
}

/// A figure under the paper's number, or why there is none.
struct PaperFigure {
    number: u8,
    caption: &'static str,
    drawn: Result<SvgWithData, &'static str>,
}

/// A figure as SVG, and its data as CSV.
#[derive(Clone)]
pub(crate) struct SvgWithData {
    pub svg: String,
    pub csv: String,
}

/// A quantity, its value in the paper, and that of the run.
struct PaperValue {
    what: &'static str,
    paper: &'static str,
    ours: String,
}

/// Writes the study of the run in folder `run` into `folder` and returns the path of the page.
/// `mode_weight`: |v|² of each grain in the growing pair, `[N]`.
///
/// # Errors
/// If files are missing or damaged, or cannot be written.
pub fn write(run: &Path, folder: &Path, mode_weight: Option<&[f64]>) -> Result<PathBuf, Failure> {
    let studied = BoxRun::read(run, mode_weight)?;
    let figures = studied.figures();
    let axes = studied.strain.dimension().axes();
    let numbers = studied.numbers();
    for figure in &figures {
        if let Ok(drawn) = &figure.drawn {
            let name = format!("fig-{:02}", figure.number);
            drawing::write(&folder.join(name.clone() + ".svg"), &drawn.svg)?;
            dictionary::write_figure_data(&folder.join(name + ".csv"), &drawn.csv, axes)?;
        }
    }
    let csv = Table::of(&numbers)
        .column("statement", |number| number.what)
        .column("paper", |number| number.paper)
        .column("ours", |number| &number.ours)
        .quoted()
        .csv();
    dictionary::write_figure_data(&folder.join("numbers.csv"), &csv, axes)?;
    let page = folder.join("index.html");
    text_writer::write(&page, html(&studied, &numbers, &figures))?;
    Ok(page)
}

/// A run of an ensemble, with what is found in its states.
#[derive(Debug)]
pub struct EnsembleRun<'a> {
    /// Its folder.
    pub folder: &'a Path,
    /// What it has in common with the runs that differ in their seeds only.
    pub family: String,
    /// |v|² of each grain in the growing pair, `[N]`.
    pub mode_weight: Option<Vec<f64>>,
    /// The first pairs in the frames of its strain steps.
    pub forms: BothForms,
}

/// Writes the study of several runs into `folder`: `ensemble.csv` with means over the runs of each
/// family, `ensemble-runs.csv` with a line per run, `ensemble.svg` with its data, and the page, whose
/// path it returns.
///
/// # Errors
/// If files are missing or damaged, runs not done, or files cannot be written.
pub fn write_ensemble(runs: &[EnsembleRun<'_>], folder: &Path) -> Result<PathBuf, Failure> {
    let mut found = Vec::new();
    for run in runs {
        let studied = BoxRun::read(run.folder, run.mode_weight.as_deref())?;
        studied.must_be_done()?;
        found.push(ensemble::numbers(&studied, run.family.clone(), run.forms));
    }
    let tables = ensemble::tables(&found);
    for (name, csv) in &tables {
        dictionary::write_figure_data(&folder.join(name), csv, 3)?;
    }
    let figure = ensemble::figure_of(&found);
    drawing::write(&folder.join("ensemble.svg"), &figure.svg)?;
    dictionary::write_figure_data(&folder.join("ensemble-distributions.csv"), &figure.csv, 3)?;
    let page = folder.join("index.html");
    text_writer::write(&page, ensemble::html(&found))?;
    Ok(page)
}

impl BoxRun {
    /// Refuses a run that was stopped: what becomes of its pair is not known yet.
    fn must_be_done(&self) -> Result<(), Failure> {
        for run in [Some(&self.strain), self.newtonian.as_ref()]
            .into_iter()
            .flatten()
        {
            if run.digest().is_none() {
                return Err(Failure::input(format!(
                    "{}: is not done, and an ensemble needs the end of each run; continue it (--resume) or leave it out",
                    run.path().display()
                )));
            }
        }
        Ok(())
    }

    fn read(run: &Path, mode_weight: Option<&[f64]>) -> Result<Self, Failure> {
        let strain = RunFile::open_any(&run.join(AQS_FILE))?;
        let path = run.join(NEWTONIAN_FILE);
        let newtonian = match path.exists() {
            true => Some(RunFile::open_any(&path)?),
            false => None,
        };
        let spectra = spectra_of(run)?;
        let growth = newtonian.as_ref().and_then(|run| {
            let diameter = run.number("mean_diameter").unwrap_or(1.0);
            let (series, limit) = (run.series(), LINEAR * diameter * diameter);
            growth::fit(&series.time, series.column("msd"), limit)
        });
        let slip = match (&newtonian, mode_weight) {
            (Some(run), Some(weight)) => dmin_of(run)?.map(|dmin| [weight.to_vec(), dmin]),
            _ => None,
        };
        let places = match (&newtonian, &growth) {
            (Some(run), Some(growth)) => {
                let times = run.frame_times();
                run.unwrapped(0..times.iter().take_while(|t| **t <= growth.to).count())?
            }
            _ => Vec::new(),
        };
        Ok(Self {
            strain,
            newtonian,
            spectra,
            growth,
            places,
            slip,
        })
    }

    /// By which parts the time step changes ω_i and ω_r of the pair: velocity Verlet turns ω = ω_r +
    /// iω_i into ω + ω³Δt²/24, which are 3(ω_rΔt)²/24 and (ω_rΔt)²/24 for ω_i « ω_r.
    fn integration_error(&self) -> Option<[f64; 2]> {
        let run = self.newtonian.as_ref()?;
        let series = run.series();
        let step = series.time.last()? / *series.step.last()? as f64;
        let part = (run.number("omega_r")? * step).powi(2) / 24.0;
        Some([3.0 * part, part])
    }

    fn figures(&self) -> Vec<PaperFigure> {
        let moving = self
            .newtonian
            .as_ref()
            .ok_or("the run has no [newtonian] stage");
        vec![
            PaperFigure {
                number: 1,
                caption: "Least and greatest imaginary part of the eigenvalues of K v = λ M v against strain.",
                drawn: curves::imaginary(&self.strain),
            },
            PaperFigure {
                number: 2,
                caption: "Imaginary parts of all eigenvalues against time, under Newton's equations.",
                drawn: (self.spectra.clone())
                    .ok_or("no eigenvalues in time: set newtonian.spectra"),
            },
            PaperFigure {
                number: 3,
                caption: "(a) Mean square displacement (eq. 10), its fitted exponential growth, and that of the complex pair. \
                          (b) One of the intervals in which the oscillation is resolved.",
                drawn: moving.map(|run| curves::growth(run, self.growth.as_ref())),
            },
            PaperFigure {
                number: 4,
                caption: "Trajectories of the eight spheres with the greatest displacement at the end of the linear growth, over the greatest displacement, seen along z. \
                          The interval of the frames is a little more than a whole number of periods, so they show the oscillation slowed down.",
                drawn: moving
                    .and_then(|run| curves::spirals(run, self.growth.as_ref(), &self.places)),
            },
            PaperFigure {
                number: 5,
                caption: "(a) Shear stress (virial) against time. (b) Its change during the linear growth.",
                drawn: moving.map(|run| curves::stress(run, self.growth.as_ref())),
            },
            PaperFigure {
                number: 6,
                caption: "Not in the paper: D²min between the first and the last frame against |v|² of the growing pair, one point per sphere.",
                drawn: self
                    .slip
                    .as_ref()
                    .map(|[mode_weight, dmin]| curves::slip(mode_weight, dmin))
                    .ok_or("no complex pair, or no frames after it"),
            },
        ]
    }

    fn numbers(&self) -> Vec<PaperValue> {
        let mut numbers = Vec::new();
        let mut add = |what, paper, ours: Option<String>| {
            let ours = ours.unwrap_or_else(|| "–".into());
            numbers.push(PaperValue { what, paper, ours });
        };
        let of_strain = |name| self.strain.number(name);
        add(
            "strain at which the first complex pair appears",
            "not given",
            of_strain("birth_before")
                .zip(of_strain("birth_after"))
                .map(|(low, high)| format!("{high:.12} (no pair {:.1e} earlier)", high - low)),
        );
        let rows = self.strain.series().rows().saturating_sub(1);
        add(
            "strain steps that fell back to overdamped dynamics",
            "(overdamped dynamics throughout)",
            of_strain("fell_back").map(|n| format!("{n} of {rows}")),
        );
        let of_pair = |name: &str| self.newtonian.as_ref().and_then(|run| run.number(name));
        let expected = self.integration_error();
        let both = |fitted: Option<f64>, name: &str, place: usize| {
            fitted.zip(of_pair(name)).map(|(fitted, of)| {
                let off = 100.0 * (fitted / of - 1.0);
                let of_step = expected.map_or(String::new(), |parts| {
                    format!(
                        ", of which the time step explains {:+.3} %",
                        100.0 * parts[place]
                    )
                });
                format!("fitted {fitted:.6e}, eigenvalue {of:.6e}: {off:+.3} %{of_step}")
            })
        };
        add(
            "imaginary part of the pair at the start of Newton's equations",
            "5.87e-5",
            of_pair("lambda_i").map(|x| format!("{x:.4e}")),
        );
        add(
            "omega_i",
            "corresponds perfectly",
            both(self.growth.map(|g| g.omega_i), "omega_i", 0),
        );
        add(
            "omega_r",
            "corresponds perfectly",
            both(self.growth.map(|g| g.omega_r), "omega_r", 1),
        );
        add(
            "decades over which the mean square displacement grows as the pair",
            "about 10",
            self.growth.map(|g| format!("{:.1}", g.decades)),
        );
        add(
            "overlap of the pair's eigenvector with D²min of the slip that follows",
            "not in the paper",
            self.slip.as_ref().map(|[mode_weight, dmin]| {
                let overlap = event::overlap(mode_weight, dmin);
                let chance = event::by_chance(mode_weight, dmin);
                format!("{overlap:.3} ({chance:.3} by chance)")
            }),
        );
        add(
            "drop of the shear stress",
            "22 %",
            self.newtonian.as_ref().and_then(|run| {
                let stress = run.series().column("shear_stress");
                let (first, last) = (stress.first()?, stress.last()?);
                Some(format!("{:.1} %", 100.0 * (1.0 - last / first)))
            }),
        );
        numbers
    }
}

/// Draws the eigenvalues in time, if the run in this folder has computed some.
pub(crate) fn spectra_of(run: &Path) -> Result<Option<SvgWithData>, Failure> {
    let path = run.join(SPECTRA_FILE);
    let rows: Vec<SpectrumRow> = match path.exists() {
        true => table::read(&path)?,
        false => Vec::new(),
    };
    Ok((!rows.is_empty()).then(|| curves::spectra(&rows)))
}

/// D²min of every grain between the first and the last frame, with neighbours within 5 mean radii
/// as in LH; `None` without frames.
fn dmin_of(run: &RunFile) -> Result<Option<Vec<f64>>, Failure> {
    let Some(last) = run.frames().checked_sub(1) else {
        return Ok(None);
    };
    let at = |t: usize| Ok::<_, Failure>(run.records(t..t + 1)?.swap_remove(0));
    let (earlier, later) = (at(0)?, at(last)?);
    let interval = run.interval([0, last], [&earlier, &later]);
    let radius = 5.0 * run.grains().mean_radius();
    Ok(Some(match run.dimension().axes() {
        2 => event::non_affine::<Two>(&interval, radius, |_| true),
        _ => event::non_affine::<Three>(&interval, radius, |_| true),
    }))
}

fn html(studied: &BoxRun, numbers: &[PaperValue], figures: &[PaperFigure]) -> String {
    let mut body = String::new();
    for figure in figures {
        match &figure.drawn {
            Ok(_) => {
                let name = format!("fig-{:02}", figure.number);
                body += &format!(
                    "<figure id=\"{name}\">\n<img src=\"{name}.svg\" alt=\"Figure {0}\"/>\n<figcaption>Figure {0}. {1} \
                     {2}</figcaption>\n</figure>\n",
                    figure.number,
                    escape(figure.caption),
                    links(&name, &[format!("{name}.csv")])
                );
            }
            Err(why) => body += &format!("<p>Figure {}: {}.</p>\n", figure.number, escape(why)),
        }
    }
    let rows: String = numbers
        .iter()
        .map(|number| {
            let cells = [number.what, number.paper, &number.ours].map(escape);
            format!(
                "<tr><th>{}</th><td>{}</td><td>{}</td></tr>\n",
                cells[0], cells[1], cells[2]
            )
        })
        .collect();
    let lead = format!(
        "The figures of \"Oscillatory instabilities in three-dimensional frictional granular matter\" for the run {}.",
        escape(&studied.strain.path().display().to_string())
    );
    let body = format!(
        "<table>\n<tr><th></th><td>paper</td><td>this run</td></tr>\n{rows}</table>\n<h2>Figures</h2>\n{body}{}",
        scene_of(studied.strain.scene())
    );
    document("The study of Bonfanti et al.", &lead, &body)
}
