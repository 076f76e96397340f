//! Extended XYZ files, as ASE and OVITO read them: one block of lines per frame.

use std::io::Write;
use std::path::{Path, PathBuf};

use gshear_dem::failure::Result;
use gshear_store::text_writer::PartFile;

use super::content::{ExportedFrame, ExportedRun};
use super::{FrameWriter, write_numbers};

/// Writes the file.
pub(crate) struct XyzWriter(PartFile);

impl XyzWriter {
    /// # Errors
    /// A file that cannot be created.
    pub fn create(path: &Path) -> Result<Self> {
        PartFile::create(path).map(Self)
    }

    fn write(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> std::io::Result<()> {
        let file = &mut self.0;
        let edges = run.edges(frame);
        let lattice = edges.as_flattened().iter();
        let lattice: Vec<String> = lattice.map(|side| format!("{side:?}")).collect();
        let [ox, oy, oz] = run.bounds(frame).map(|[low, _]| low);
        let pbc = run
            .periodic()
            .map(|is_periodic| if is_periodic { "T" } else { "F" });
        writeln!(file, "{}", frame.present.len())?;
        write!(
            file,
            "Lattice=\"{}\" Origin=\"{ox:?} {oy:?} {oz:?}\" pbc=\"{}\" \
             Properties=species:S:1:pos:R:3:velo:R:3:angular_velocity:R:3:radius:R:1:mass:R:1:id:I:1:body:I:1",
            lattice.join(" "),
            pbc.join(" ")
        )?;
        for (name, components) in run.shapes() {
            write!(file, ":{name}:R:{components}")?;
        }
        write!(
            file,
            " frame={} step={} time={:?} strain={:?}",
            frame.number, frame.records.step, frame.records.time, frame.strain
        )?;
        let units = run.units().map(|units| format!(" units=\"{units}\""));
        writeln!(file, "{}", units.unwrap_or_default())?;
        let constants = run.file.grains();
        for &g in &frame.present {
            // ASE knows chemical symbols only; X is its dummy.
            write!(file, "X")?;
            write_numbers(file, run.state_values(frame, g))?;
            write!(file, " {} {}", run.file.ids()[g], constants.body[g])?;
            write_numbers(file, run.field_values(frame, g))?;
            writeln!(file)?;
        }
        Ok(())
    }
}

impl FrameWriter for XyzWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<()> {
        let written = self.write(run, frame);
        self.0.checked(written)
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>> {
        Ok(vec![self.0.finish()?])
    }
}
