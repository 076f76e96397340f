//! `dmin`: writes D²min between frames into `reduced.h5`.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::str::FromStr;

use clap::ValueEnum;
use ndarray::Array2;

use crate::frame_pairs::{self, DminOfPairs};
use crate::printer::Printer;
use crate::results::Results;
use gshear_analysis::dmin::{DefinedCounts, RADIUS};
use gshear_analysis::rattlers::RattlerRule;
use gshear_dem::failure::{Failure, Result};
use gshear_scene::identity;
use gshear_store::reduced_writer::ReducedWriter;
use gshear_store::run_reader::RunFile;

/// Write D²min between frames into reduced.h5 (Lee & Hurley, appendix B)
///
/// Dataset dmin/value, by frame and grain, in m²: between each frame and the one before it, unless
/// --lag or --window choose others. NaN without an earlier frame, for rattlers of the earlier frame
/// (--rattlers), and for grains with fewer neighbours within the radius than dimensions or with all
/// of them on one line or plane. A line says how many free grains have a value, and why others have
/// none.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/aqs, run.h5/newtonian or run.h5/shear for a later
    /// stage
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Cutoff of the neighbours in the earlier frame, in mean radii
    #[arg(long, visible_alias = "cutoff", value_name = "R", default_value_t = RADIUS, allow_negative_numbers = true)]
    radius: f64,
    /// Which grains are neither centres nor neighbours
    #[arg(long, value_enum, default_value_t = Rattlers::LeeHurley)]
    rattlers: Rattlers,
    /// Frames from the earlier to the later one
    #[arg(long, value_name = "N", default_value_t = NonZeroUsize::MIN, group = "earlier")]
    lag: NonZeroUsize,
    /// Shear strain from the earlier frame to the later one: the last frame that is as far back
    #[arg(long, value_name = "STRAIN", value_parser = super::positive, group = "earlier")]
    lag_strain: Option<f64>,
    /// Time from the earlier frame to the later one (s), likewise
    #[arg(long, value_name = "TIME", value_parser = super::positive, group = "earlier")]
    lag_time: Option<f64>,
    /// Between these two frames alone
    #[arg(long, value_name = "A..B", group = "earlier")]
    window: Option<Window>,
}

/// Which grains are left out as rattlers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Rattlers {
    /// Grains with two contacts or fewer (spheres three), in a wall one fewer
    LeeHurley,
    /// Free grains with too few contacts for balance, two with friction, else three (spheres four);
    /// removed with their contacts until there are none
    Balance,
    /// None: all grains within the radius count
    None,
}

impl Rattlers {
    pub(super) fn rule(self, run: &RunFile) -> RattlerRule {
        match self {
            Self::LeeHurley => RattlerRule::LeeHurley,
            Self::Balance => RattlerRule::Balance {
                friction: identity::has_friction(run.scene()),
            },
            Self::None => RattlerRule::None,
        }
    }

    fn name(self) -> String {
        let value = self.to_possible_value();
        value.map_or_else(String::new, |value| value.get_name().to_string())
    }
}

/// Two frames: `A..B`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Window {
    from: usize,
    to: usize,
}

impl FromStr for Window {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let ends = text.split_once("..").and_then(|(from, to)| {
            let (from, to) = (from.parse().ok()?, to.parse().ok()?);
            (from < to).then_some(Self { from, to })
        });
        ends.ok_or_else(|| "write A..B: two numbers of frames, the earlier one first".into())
    }
}

/// A row of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Row {
    /// The later frame.
    frame: usize,
    /// The earlier one; `None` if there is none.
    earlier: Option<usize>,
}

impl Row {
    /// The number of the earlier frame; -1 if there is none.
    fn earlier_number(&self) -> i64 {
        self.earlier.map_or(-1, |frame| frame as i64)
    }
}

impl Arguments {
    /// # Errors
    /// A radius that is not positive, frames that the run lacks, a strain that returns, a damaged
    /// run, a file that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = &RunFile::open_any(&self.run)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        if !(self.radius.is_finite() && self.radius > 0.0) {
            return Err(Failure::input(format!(
                "--radius {}: must be a positive number of mean radii",
                self.radius
            )));
        }
        let rows = self.rows(run)?;
        let (grains, n) = (run.grains(), run.grains().count());
        let strains = run.frame_strains()?;
        let strains: Vec<f64> = rows.iter().map(|row| strains[row.frame]).collect();
        let path = results.place("reduced.h5")?;
        let mut writer = ReducedWriter::create(&path, &strains, n)?;
        let later: Vec<i64> = rows.iter().map(|row| row.frame as i64).collect();
        let earlier: Vec<i64> = rows.iter().map(Row::earlier_number).collect();
        writer.numbers("frame", &later)?;
        writer.numbers("earlier", &earlier)?;
        writer.attribute("run", run.path().display().to_string())?;
        writer.attribute("run_id", run.text("run_id").unwrap_or_default())?;
        writer.attribute("digest", run.digest().unwrap_or_default())?;
        writer.attribute("version", env!("CARGO_PKG_VERSION"))?;
        writer.attribute("radius_over_mean_radius", self.radius)?;
        writer.attribute("rattlers", self.rattlers.name())?;

        let pairs: Vec<[usize; 2]> = (rows.iter())
            .filter_map(|row| Some([row.earlier?, row.frame]))
            .collect();
        // Earlier frames of the first ones are missing.
        let without = rows.len() - pairs.len();
        for row in 0..without {
            writer.dmin(row, Array2::from_elem((1, n), f64::NAN).view())?;
        }
        let mut counts = DefinedCounts::default();
        let work = DminOfPairs {
            run,
            radius: self.radius * grains.mean_radius(),
            rattlers_by: self.rattlers.rule(run),
        };
        frame_pairs::each(run, &pairs, &work, |first, rows| {
            let mut values = Vec::with_capacity(rows.len() * n);
            for (dmin, defined) in &rows {
                values.extend(dmin);
                counts.add(defined);
            }
            let values = Array2::from_shape_vec((rows.len(), n), values);
            writer.dmin(without + first, values.expect("N values a row").view())
        })?;
        if counts.free > 0 {
            writeln!(printer, "D²min is {counts}")?;
        }
        printer.wrote(&writer.finish()?)
    }

    /// The rows of the result, those without an earlier frame first.
    fn rows(&self, run: &RunFile) -> Result<Vec<Row>> {
        let frames = 0..run.frames();
        if let Some(Window { from, to }) = self.window {
            if to >= run.frames() {
                return Err(run.wrong(format!(
                    "has {} frames; --window {from}..{to} needs those of the numbers {from} and {to}",
                    run.frames()
                )));
            }
            let earlier = Some(from);
            return Ok(vec![Row { frame: to, earlier }]);
        }
        let (option, passed, lag) = match (self.lag_strain, self.lag_time) {
            (Some(lag), _) => ("--lag-strain", run.frame_strains()?, lag),
            (_, Some(lag)) => ("--lag-time", run.frame_times().to_vec(), lag),
            (None, None) => {
                let lag = self.lag.get();
                if lag > 1 && lag >= run.frames() {
                    return Err(run.wrong(format!(
                        "--lag {lag}: the run has {} frames; give a lesser lag",
                        run.frames()
                    )));
                }
                let rows = frames.map(|frame| Row {
                    frame,
                    earlier: frame.checked_sub(lag),
                });
                return Ok(rows.collect());
            }
        };
        if !passed.windows(2).all(|pair| pair[1] > pair[0]) {
            let what = "does not grow from frame to frame; give --lag, a number of frames";
            return Err(run.wrong(format!("{option}: what it counts {what}")));
        }
        // A lag of a whole number of frames is one, whatever rounding does.
        let rows = frames.map(|frame| {
            let latest = passed[frame] - lag * (1.0 - 1e-6);
            let earlier = passed.partition_point(|at| *at <= latest).checked_sub(1);
            Row { frame, earlier }
        });
        let rows: Vec<Row> = rows.collect();
        if rows.iter().all(|row| row.earlier.is_none()) && rows.len() > 1 {
            let reach = passed[passed.len() - 1] - passed[0];
            return Err(run.wrong(format!(
                "{option} {lag}: the frames cover {reach} only; give a lesser lag"
            )));
        }
        Ok(rows)
    }
}
