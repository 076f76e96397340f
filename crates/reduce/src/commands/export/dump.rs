//! LAMMPS dump files: grains in the format of `dump custom`, contacts in that of `dump local`.
//! Contacts with flat walls have no second grain: they are atoms, with the force on the grain.

use std::io::Write;
use std::path::{Path, PathBuf};

use gshear_analysis::forces;
use gshear_dem::failure::Result;
use gshear_scene::atom_type;
use gshear_store::text_writer::PartFile;

use super::content::{ExportedFrame, ExportedRun, contact_names, contact_values};
use super::{FrameWriter, beside, write_numbers};

/// Writes the files.
pub(crate) struct DumpWriter {
    grains: PartFile,
    contacts: PartFile,
    /// Of runs with flat walls.
    wall_contacts: Option<PartFile>,
}

impl DumpWriter {
    /// # Errors
    /// Files that cannot be created.
    pub fn create(path: &Path, run: &ExportedRun) -> Result<Self> {
        Ok(Self {
            grains: PartFile::create(path)?,
            contacts: PartFile::create(&beside(path, "contacts"))?,
            wall_contacts: (run.file.form().walls)
                .then(|| PartFile::create(&beside(path, "wall-contacts")))
                .transpose()?,
        })
    }

    fn head(
        file: &mut PartFile,
        run: &ExportedRun,
        frame: &ExportedFrame,
        count: (&str, usize),
    ) -> std::io::Result<()> {
        writeln!(file, "ITEM: TIMESTEP\n{}", frame.records.step)?;
        writeln!(file, "ITEM: NUMBER OF {}\n{}", count.0, count.1)?;
        // LAMMPS needs a period along z in 2D.
        let mut periodic = run.periodic();
        periodic[run.axes()..].fill(true);
        let kinds: String = periodic
            .map(|is_periodic| if is_periodic { " pp" } else { " ff" })
            .concat();
        let mut bounds = run.bounds(frame);
        let Some(tilt) = run.tilt(frame) else {
            writeln!(file, "ITEM: BOX BOUNDS{kinds}")?;
            let mut lines = bounds.iter();
            return lines.try_for_each(|[low, high]| writeln!(file, "{low:?} {high:?}"));
        };
        // The bounds along x are those of the tilted box.
        bounds[0][0] += tilt.min(0.0);
        bounds[0][1] += tilt.max(0.0);
        let tilts = match run.axes() {
            2 => [tilt, 0.0, 0.0],
            _ => [0.0, tilt, 0.0],
        };
        writeln!(file, "ITEM: BOX BOUNDS xy xz yz{kinds}")?;
        let mut lines = bounds.iter().zip(tilts);
        lines.try_for_each(|([low, high], tilt)| writeln!(file, "{low:?} {high:?} {tilt:?}"))
    }

    fn write_grains(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> std::io::Result<()> {
        let file = &mut self.grains;
        let grains = &frame.records.grains;
        Self::head(file, run, frame, ("ATOMS", frame.present.len()))?;
        write!(
            file,
            "ITEM: ATOMS id type x y z vx vy vz omegax omegay omegaz radius mass ix iy iz"
        )?;
        for name in run.field_names() {
            write!(file, " {name}")?;
        }
        writeln!(file)?;
        for &g in &frame.present {
            write!(file, "{} {}", run.file.ids()[g] + 1, run.atom_type(g))?;
            write_numbers(file, run.state_values(frame, g))?;
            let [x, y, z] = grains[g].image;
            write!(file, " {x} {y} {z}")?;
            write_numbers(file, run.field_values(frame, g))?;
            writeln!(file)?;
        }
        Ok(())
    }

    fn write_contacts(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> std::io::Result<()> {
        let file = &mut self.contacts;
        let contacts = &frame.records.contacts;
        Self::head(file, run, frame, ("ENTRIES", contacts.len()))?;
        write!(file, "ITEM: ENTRIES batom1 batom2")?;
        for name in contact_names(run.file.form()) {
            write!(file, " {name}")?;
        }
        writeln!(file)?;
        for contact in contacts {
            let [i, j] = [contact.i, contact.j].map(|row| run.file.ids()[row as usize] + 1);
            write!(file, "{i} {j}")?;
            write_numbers(file, contact_values(run.file.form(), contact))?;
            writeln!(file)?;
        }
        Ok(())
    }

    fn write_wall_contacts(
        file: &mut PartFile,
        run: &ExportedRun,
        frame: &ExportedFrame,
    ) -> std::io::Result<()> {
        let contacts = &frame.records.wall_contacts;
        Self::head(file, run, frame, ("ATOMS", contacts.len()))?;
        write!(file, "ITEM: ATOMS id type x y z fx fy fz grain")?;
        for name in contact_names(run.file.form()) {
            write!(file, " {name}")?;
        }
        writeln!(file)?;
        for (k, contact) in contacts.iter().enumerate() {
            let wall = contact.wall(frame.records.grains.len());
            write!(file, "{} {}", k + 1, atom_type(wall.unwrap_or_default(), 0))?;
            write_numbers(file, run.wall_point(frame, contact).into_iter())?;
            let force = forces::vectors(&frame.records, contact).force;
            write_numbers(file, force.into_iter())?;
            write!(file, " {}", run.file.ids()[contact.i as usize] + 1)?;
            write_numbers(file, contact_values(run.file.form(), contact))?;
            writeln!(file)?;
        }
        Ok(())
    }
}

impl FrameWriter for DumpWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<()> {
        let written = self.write_grains(run, frame);
        self.grains.checked(written)?;
        let written = self.write_contacts(run, frame);
        self.contacts.checked(written)?;
        let Some(file) = &mut self.wall_contacts else {
            return Ok(());
        };
        let written = Self::write_wall_contacts(file, run, frame);
        file.checked(written)
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>> {
        let files = [self.grains, self.contacts].into_iter();
        files
            .chain(self.wall_contacts)
            .map(PartFile::finish)
            .collect()
    }
}
