//! `dmin`: writes D²min between consecutive frames into `reduced.h5`.

use std::path::PathBuf;

use ndarray::Array2;

use crate::frame_pairs;
use crate::printer::Printer;
use crate::results::Results;
use gshear_analysis::dmin::{NonAffine, RADIUS};
use gshear_analysis::event;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{Frame, FrameRecords};
use gshear_scene::Dimensions;
use gshear_store::reduced_writer::ReducedWriter;
use gshear_store::run_reader::{FrameFields, RunFile};

/// Write D²min between consecutive frames into reduced.h5 (Lee & Hurley, appendix B)
///
/// Dataset dmin/value, by frame and grain, in m². NaN in frame 0, for rattlers of the earlier
/// frame, and for grains with fewer than two neighbours or with all neighbours on one line.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/newtonian for Newton's equations of a box
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Radius of the neighbourhood in mean radii
    #[arg(long, value_name = "R", default_value_t = RADIUS, allow_negative_numbers = true)]
    radius: f64,
}

impl Arguments {
    /// # Errors
    /// A radius that is not positive, a damaged run, a file that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = &RunFile::open_any(&self.run)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        if !(self.radius.is_finite() && self.radius > 0.0) {
            return Err(Failure::input(format!(
                "--radius {}: must be a positive number of mean radii",
                self.radius
            )));
        }
        let (grains, n) = (run.grains(), run.grains().count());
        let path = results.place("reduced.h5");
        let writer = ReducedWriter::create(&path, &run.frame_strains()?, n)?;
        writer.attribute("run", run.path().display().to_string())?;
        writer.attribute("run_id", run.text("run_id").unwrap_or_default())?;
        writer.attribute("digest", run.digest().unwrap_or_default())?;
        writer.attribute("version", env!("CARGO_PKG_VERSION"))?;
        writer.attribute("radius_over_mean_radius", self.radius)?;
        let radius = self.radius * grains.mean_radius();

        if run.frames() > 0 {
            writer.dmin(0, Array2::from_elem((1, n), f64::NAN).view())?;
        }
        let write = |first: usize, rows: Vec<Vec<f64>>| {
            let values = Array2::from_shape_vec((rows.len(), n), rows.concat());
            writer.dmin(first, values.expect("N values a row").view())
        };
        if is_planar(run) {
            let read = |range| run.block_of(range, FrameFields::Pairs);
            let value = |of: &mut NonAffine, _: [usize; 2], [earlier, later]: [&Frame; 2]| {
                let mut row = vec![0.0; n];
                of.between(grains, radius, earlier, later, &mut row);
                row
            };
            frame_pairs::each(run, read, value, write)?;
        } else {
            let read = |range| run.records(range);
            let value = |(): &mut (), numbers: [usize; 2], frames: [&FrameRecords; 2]| {
                between(run, numbers, frames, radius)
            };
            frame_pairs::each(run, read, value, write)?;
        }
        printer.wrote(&writer.finish()?)
    }
}

/// Whether [`NonAffine`] computes D²min, which is faster: of disks between walls.
pub fn is_planar(run: &RunFile) -> bool {
    run.has_walls() && run.dimension() == Dimensions::Two
}

/// Returns D²min of every grain between two frames of these numbers, `[N]` (m²), with the
/// neighbours within `radius` (m) in the earlier one. NaN where it is not defined; rattlers do not
/// count.
pub fn between(
    run: &RunFile,
    numbers: [usize; 2],
    frames: [&FrameRecords; 2],
    radius: f64,
) -> Vec<f64> {
    let (grains, interval) = (run.grains(), run.interval(numbers, frames));
    event::between_frames(run.dimension().axes(), grains, &interval, radius)
}
