//! `movie`: the pictures of a report, frame after frame.

use std::path::PathBuf;

use crate::frame_selection::FrameRange;
use crate::printer::Printer;
use crate::results::Results;
use gshear_dem::failure::{Failure, Result};
use gshear_report::movie::{Field, Movie};
use gshear_report::movie_file::{MovieFile, has_ffmpeg};
use gshear_store::run_reader::RunFile;

/// Draw a movie of frames: forces, D²min or velocities of the grains, on the same scale throughout
///
/// The pictures are those of the report: maps of disks between walls, else the packing seen from
/// outside. With ffmpeg in PATH it is an MP4, without an animated PNG, which browsers play, and a
/// folder of the same name with its frames 00000.png, 00001.png and so on.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/aqs, run.h5/newtonian or run.h5/shear for a later
    /// stage
    pub run: PathBuf,
    /// Frames A to B, both included, every Nth of them; .. is all [default: all]
    #[arg(
        long,
        value_name = "A..B[:N]",
        default_value = "..",
        hide_default_value = true
    )]
    frames: FrameRange,
    /// What to show, of force, dmin (D²min since the frame before in the movie) and velocity (along
    /// x); several share a picture
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "FIELD,...",
        default_value = "force"
    )]
    fields: Vec<Field>,
    /// Frames per second
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=240))]
    rate: u16,
    /// Width of the movie in pixels [default: that of the pictures, at most 1280]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=8192))]
    width: Option<u32>,
    /// File to write, .mp4 or .png [default: movie.mp4 with ffmpeg, else movie.png; of a box
    /// aqs-movie or newtonian-movie; in the folder of the run]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Arguments {
    /// # Errors
    /// A missing frame, a damaged run, a name with another ending, ffmpeg that is missing or fails,
    /// a file that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = RunFile::open_any(&self.run)?;
        let numbers = self.frames.of(&run)?;
        let path = self.path(&run)?;
        let movie = Movie::new(&run, &self.fields, numbers)?;
        let mut file = MovieFile::new(&path, movie.frames(), self.rate, movie.is_flat());
        movie.draw(self.width, |picture| file.frame(&picture))?;
        file.finish()?
            .iter()
            .try_for_each(|path| printer.wrote(path))
    }

    fn path(&self, run: &RunFile) -> Result<PathBuf> {
        let Some(path) = &self.out else {
            let name = run.stage().named(if has_ffmpeg() {
                "movie.mp4"
            } else {
                "movie.png"
            });
            return Results::of(None, run.folder()).place(&name);
        };
        let what = match path.extension().and_then(|ending| ending.to_str()) {
            Some("mp4") if !has_ffmpeg() => {
                "needs ffmpeg, which is not in PATH; install it, or give a name that ends in .png"
            }
            Some("mp4" | "png") => return Ok(path.clone()),
            _ => "must end in .mp4 (through ffmpeg) or .png (an animated PNG)",
        };
        let path = path.display();
        Err(Failure::input(format!("--out {path}: {what}")))
    }
}
