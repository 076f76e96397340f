//! What is written and computed of the shear: `[output]` and `[analysis]`.

use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::keys::{FROM_ZERO, Key, KeyReader, NOT_NEGATIVE, POSITIVE};

use crate::checker::Checker;
use crate::table::table;
use crate::words::show;

table! {
    /// What is written.
    OUTPUT: OutputKeys "output" All Resume {
        /// Δγ between frames; 0 is never
        frame_strain: Number(NOT_NEGATIVE) { default: "1e-4" },
        /// γ of the first frame, rounded to a multiple of `frame_strain`
        frame_start: Number(NOT_NEGATIVE) { default: "0.0" },
        /// Δγ between rows of the time series; 0 is never
        series_strain: Number(NOT_NEGATIVE) { default: "1e-5" },
        /// Δγ between checkpoints; 0 is only at the end
        checkpoint_strain: Number(NOT_NEGATIVE) { default: "0.02" },
        /// time of computing between checkpoints, besides those by strain and of parts; 0 is never
        checkpoint_time: Number(NOT_NEGATIVE) { unit: "s", default: "600.0" },
        /// keep every checkpoint of the shear as `checkpoint-<step>.h5`, from step 0 on, for
        /// `gshear-reduce replay`; of a box as `checkpoint-aqs-<step>.h5` and
        /// `checkpoint-newtonian-<step>.h5`
        keep_checkpoints: Flag { default: "false" },
        /// with a protocol: frames in each part; 0 is none
        frame_rows: Whole(FROM_ZERO) { default: "0" },
        /// with a protocol: rows of the time series in each part; 0 is none
        series_rows: Whole(FROM_ZERO) { default: "1000" },
        /// lines of progress over the whole run; a terminal has one that is drawn anew
        progress_lines: Whole(FROM_ZERO) { default: "20" },
        /// record the energy budget in the time series
        energy: Flag { default: "true" },
        /// record the temperatures of the fluctuations in the time series; these columns begin
        /// with a file, so at a resume only in another folder (`--out`)
        temperatures: Flag { default: "false" },
        /// columns of `log.csv` after step and time, in this order; `run.h5` has all of them. They
        /// begin with the file, so at a resume only in another folder (`--out`)
        columns: Names {
            condition: "names of columns of the time series",
            otherwise: "all",
        },
        /// write the histories of contacts into frames, a quarter of them: `gshear-reduce spectrum`
        /// and `stability` of frames need them; replays have them all the same
        histories: Flag { default: "true" },
        /// compress `run.h5` when the run has ended, to about 60 %; all that reads HDF5 reads it
        compress: Flag { default: "true" },
    }
}

table! {
    /// What the run computes of its frames.
    ANALYSIS: AnalysisKeys "analysis" Sheared Resume {
        /// compute the scalars of frames during the run (docs/explanation/reduction.md), so that
        /// frames need not be written; 2D only
        scalars: Flag { default: "false" },
        /// Δγ between these frames
        strain: Number(POSITIVE) {
            condition: "a whole number of `output.series_strain`",
            otherwise: "`output.frame_strain`",
        },
        /// γ of the first of them, rounded to a multiple of `analysis.strain`
        start: Number(NOT_NEGATIVE) { otherwise: "`output.frame_start`" },
    }
}

/// Intervals of output as Δγ, and as rows in each part of a protocol; 0 is never.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a key")]
pub struct Output {
    /// Δγ between frames.
    pub frame_strain: f64,
    /// γ from which on frames are written.
    pub frame_start: f64,
    /// Δγ between rows of the time series.
    pub series_strain: f64,
    /// Δγ between checkpoints.
    pub checkpoint_strain: f64,
    /// Frames in each part of a protocol.
    pub frame_rows: u64,
    /// Rows of the time series in each part of a protocol.
    pub series_rows: u64,
    /// Lines on the terminal over the whole run.
    pub progress_lines: u64,
    /// Whether the energy budget is recorded.
    pub energy: bool,
    /// Whether the temperatures of the fluctuations are recorded.
    pub temperatures: bool,
    /// Whether frames have the histories of contacts.
    pub histories: bool,
    /// Whether `run.h5` is compressed at the end.
    pub compress: bool,
}

impl Output {
    /// How many rows of the time series an interval has, if it has a whole number of them.
    pub(crate) fn rows_in(&self, strain: f64) -> Option<u64> {
        let rows = strain / self.series_strain;
        // Decimal fractions divide no better.
        let whole = rows.round();
        (rows.is_finite() && whole >= 1.0 && (rows - whole).abs() < 1e-9 * whole)
            .then_some(whole as u64)
    }
}

/// What the run itself computes of its frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Analysis {
    /// Whether the scalars of frames are computed (LH section 3).
    pub scalars: bool,
    /// Δγ between these frames, which need not be written.
    pub strain: f64,
    /// γ of the first of them.
    pub start: f64,
}

/// The intervals of strain, which a protocol does not have.
static STRAINS: [&Key; 4] = [
    &OUTPUT.frame_strain,
    &OUTPUT.frame_start,
    &OUTPUT.series_strain,
    &OUTPUT.checkpoint_strain,
];

/// The output of a scene between walls. `protocol`: it has one.
pub(crate) fn check(c: &mut Checker<'_>, protocol: bool) -> Output {
    let keys = &OUTPUT;
    if protocol {
        let why = "does not apply to the parts of shear.protocol; give frame_rows and series_rows, the frames and rows of each part";
        c.all_useless(&STRAINS, why);
    } else {
        let why = "counts per part of shear.protocol, which is not given";
        c.all_useless(&[&keys.frame_rows, &keys.series_rows], why);
    }
    Output {
        frame_strain: c.number_or_default(&keys.frame_strain),
        frame_start: c.number_or_default(&keys.frame_start),
        series_strain: c.number_or_default(&keys.series_strain),
        checkpoint_strain: c.number_or_default(&keys.checkpoint_strain),
        frame_rows: c.count(&keys.frame_rows),
        series_rows: c.count(&keys.series_rows),
        progress_lines: c.count(&keys.progress_lines),
        energy: c.flag_or_default(&keys.energy),
        temperatures: c.flag_or_default(&keys.temperatures),
        histories: c.flag_or_default(&keys.histories),
        compress: c.flag_or_default(&keys.compress),
    }
}

/// The intervals of output of strain steps are those of `[aqs]` and `[newtonian]`.
pub(crate) fn check_without_shear(c: &mut Checker<'_>) {
    let why = "is of a shear at a rate; strain steps have aqs.frame_every, newtonian.frames and newtonian.rows";
    let keys = OutputKeys::TABLE.own.iter();
    let common = [OUTPUT.keep_checkpoints.path, OUTPUT.checkpoint_time.path];
    for key in keys.filter(|key| !common.contains(&key.path)) {
        c.useless(key, why);
    }
}

/// What is computed of the frames of a scene between walls. `protocol`: it has one.
pub(crate) fn check_analysis(c: &mut Checker<'_>, protocol: bool, output: &Output) -> Analysis {
    let keys = &ANALYSIS;
    let scalars = c.flag_or_default(&keys.scalars);
    let analysis = Analysis {
        scalars,
        strain: c.number(&keys.strain).unwrap_or(output.frame_strain),
        start: c.number(&keys.start).unwrap_or(output.frame_start),
    };
    if scalars && c.dimension == Dimensions::Three {
        let what = "the scalars of frames are those of disks; leave it out with dimension = 3";
        c.refuse(&keys.scalars, what);
    }
    // 0 is no interval of its own.
    if analysis.strain > 0.0 {
        c.fill(&keys.strain, analysis.strain);
    }
    c.fill(&keys.start, analysis.start);
    if protocol {
        let why = "does not apply to the parts of shear.protocol";
        c.all_useless(&[&keys.strain, &keys.start], why);
        if scalars {
            c.useless(&keys.scalars, why);
        }
    }
    if scalars && output.rows_in(analysis.strain).is_none() {
        let what = format!(
            "every frame that is analysed needs a row of the time series: analysis.strain (default output.frame_strain) must be \
             a whole number of output.series_strain = {}, found {}",
            show(output.series_strain),
            show(analysis.strain)
        );
        c.refuse_among(&[&keys.strain, &keys.scalars], &what);
    }
    analysis
}
