//! Extended XYZ files, as ASE and OVITO read them: one block of lines per frame.

use std::io::Write;
use std::path::{Path, PathBuf};

use gshear_dem::failure::Failure;
use gshear_store::text_writer::PartFile;

use super::FrameWriter;
use super::content::{ExportedFrame, ExportedRun};

/// Writes the file.
pub struct XyzWriter(PartFile);

impl XyzWriter {
    /// # Errors
    /// A file that cannot be created.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        PartFile::create(path).map(Self)
    }

    fn write(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> std::io::Result<()> {
        let file = &mut self.0;
        let grains = &frame.records.grains;
        let bounds = run.bounds(frame);
        let [lx, ly, lz] = bounds.map(|[low, high]| high - low);
        let [ox, oy, oz] = bounds.map(|[low, _]| low);
        let pbc = run
            .periodic()
            .map(|periodic| if periodic { "T" } else { "F" });
        writeln!(file, "{}", grains.len())?;
        write!(
            file,
            "Lattice=\"{lx:?} 0.0 0.0 0.0 {ly:?} 0.0 0.0 0.0 {lz:?}\" Origin=\"{ox:?} {oy:?} {oz:?}\" pbc=\"{}\" \
             Properties=species:S:1:pos:R:3:velo:R:3:angular_velocity:R:3:radius:R:1:mass:R:1:id:I:1:body:I:1",
            pbc.join(" ")
        )?;
        for name in run.field_names() {
            write!(file, ":{name}:R:1")?;
        }
        writeln!(
            file,
            " frame={} step={} time={:?} strain={:?} units=\"m s kg\"",
            frame.number, frame.records.step, frame.records.time, frame.strain
        )?;
        let constants = run.grains();
        for (g, grain) in grains.iter().enumerate() {
            // ASE knows chemical symbols only; X is its dummy.
            write!(file, "X")?;
            let state = [grain.position, grain.velocity, grain.angular_velocity];
            let fixed = [constants.radius[g], constants.mass[g]];
            for value in state.into_iter().flatten().chain(fixed) {
                write!(file, " {value:?}")?;
            }
            write!(file, " {} {}", grain.id, constants.body[g])?;
            for (_, values) in &frame.fields {
                write!(file, " {:?}", values[g])?;
            }
            writeln!(file)?;
        }
        Ok(())
    }
}

impl FrameWriter for XyzWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<(), Failure> {
        let written = self.write(run, frame);
        self.0.checked(written)
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, Failure> {
        Ok(vec![self.0.finish()?])
    }
}
