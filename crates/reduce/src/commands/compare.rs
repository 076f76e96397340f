//! `compare`: compares two runs field by field, to the last bit.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

use crate::printer::Printer;
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactSample, Frame};
use gshear_scene::Dimensions;
use gshear_store::contact_quantities::of_contacts;
use gshear_store::run_reader::RunFile;
use gshear_store::trajectory::FrameFormat;

/// Compare two runs field by field, to the last bit
///
/// Prints for each field the number of values that differ, and the largest absolute and
/// relative difference with its place. NaN equals NaN. Frames and rows are compared in their
/// order, contacts by their ids. Exit code 0 if everything is equal, 1 if anything differs.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/aqs, run.h5/newtonian or run.h5/shear for a later
    /// stage
    pub(super) a: PathBuf,
    /// Another one
    pub(super) b: PathBuf,
}

impl Arguments {
    /// Returns the exit code.
    ///
    /// # Errors
    /// A damaged run.
    pub(super) fn run(&self, printer: &mut Printer) -> Result<i32> {
        let comparison = runs(&RunFile::open_any(&self.a)?, &RunFile::open_any(&self.b)?)?;
        comparison.print(printer)?;
        Ok(i32::from(!comparison.equal()))
    }
}

/// Parameters that describe how, where and when a run was made, not its results.
const PROVENANCE: [&str; 7] = [
    "git_commit",
    "processor",
    "rank_map",
    "ranks",
    "speed",
    "started",
    "version",
];

/// Components of a vector, as named in places.
const PARTS: [&str; 3] = [" x", " y", " z"];

/// Where two values differ.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Location {
    /// No place, as for a number of the whole run.
    #[default]
    Nowhere,
    /// Grain.
    Grain(usize),
    /// Row of the time series.
    Row(usize),
    /// Frame.
    Frame(usize),
    /// Frame, grain, component.
    GrainOf(usize, usize, &'static str),
    /// Frame, ids of the grains.
    ContactOf(usize, u32, u32),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Location::Nowhere => f.write_str("-"),
            Location::Grain(n) => write!(f, "grain {n}"),
            Location::Row(row) => write!(f, "row {row}"),
            Location::Frame(t) => write!(f, "frame {t}"),
            Location::GrainOf(t, n, part) => write!(f, "frame {t} grain {n}{part}"),
            Location::ContactOf(t, i, j) => write!(f, "frame {t} contact {i}-{j}"),
        }
    }
}

/// Comparison of one field. A difference with NaN on one side only is infinite.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FieldComparison {
    /// Name of the field.
    pub name: String,
    /// Number of values compared.
    pub compared: u64,
    /// Number of values with different bits (NaN equals NaN).
    pub differing: u64,
    /// First difference in the order of the file.
    pub first: Location,
    /// Largest |a - b|.
    pub absolute: f64,
    /// Place of the largest |a - b|.
    pub absolute_at: Location,
    /// Largest |a - b|/max(|a|, |b|).
    pub relative: f64,
    /// Place of the largest |a - b|/max(|a|, |b|).
    pub relative_at: Location,
}

impl FieldComparison {
    fn new(name: impl Into<String>) -> Self {
        FieldComparison {
            name: name.into(),
            ..Self::default()
        }
    }

    fn see(&mut self, a: f64, b: f64, at: Location) {
        self.compared += 1;
        if a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()) {
            return;
        }
        if self.differing == 0 {
            (self.first, self.absolute_at, self.relative_at) = (at, at, at);
        }
        self.differing += 1;
        let absolute = nan_is_infinite((a - b).abs());
        // Zeros of different sign differ only in their bits.
        let relative = if absolute == 0.0 {
            0.0
        } else {
            nan_is_infinite(absolute / a.abs().max(b.abs()))
        };
        if absolute > self.absolute {
            (self.absolute, self.absolute_at) = (absolute, at);
        }
        if relative > self.relative {
            (self.relative, self.relative_at) = (relative, at);
        }
    }
}

/// The size of a difference, which NaN on one side makes infinite.
fn nan_is_infinite(x: f64) -> f64 {
    if x.is_nan() { f64::INFINITY } else { x }
}

/// The result of a comparison.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Comparison {
    /// Fields compared value by value.
    pub fields: Vec<FieldComparison>,
    /// Differing numbers of frames, rows, grains; differing digests.
    pub unequal: Vec<String>,
    /// Differences in parameters that do not count as results.
    pub asides: Vec<String>,
}

impl Comparison {
    /// Returns whether the runs hold the same results, to the last bit.
    pub fn equal(&self) -> bool {
        self.unequal.is_empty() && self.fields.iter().all(|field| field.differing == 0)
    }

    /// Prints one line per field, then the other differences.
    fn print(&self, printer: &mut Printer) -> Result<()> {
        writeln!(
            printer,
            "{:<24}{:>12}{:>12}{:>14}  {:<30}{:>14}  {:<30}first difference",
            "field", "values", "differing", "max absolute", "at", "max relative", "at"
        )?;
        for field in &self.fields {
            writeln!(
                printer,
                "{:<24}{:>12}{:>12}{:>14.4e}  {:<30}{:>14.4e}  {:<30}{}",
                field.name,
                field.compared,
                field.differing,
                field.absolute,
                field.absolute_at.to_string(),
                field.relative,
                field.relative_at.to_string(),
                field.first
            )?;
        }
        for line in &self.unequal {
            writeln!(printer, "differs: {line}")?;
        }
        for line in &self.asides {
            writeln!(printer, "not counted: {line}")?;
        }
        let outcome = if self.equal() { "equal" } else { "different" };
        writeln!(printer, "{outcome}")?;
        printer.flush()
    }

    fn count(&mut self, what: &str, a: usize, b: usize) -> usize {
        if a != b {
            self.unequal.push(format!("{what}: {a} against {b}"));
        }
        a.min(b)
    }
}

/// Compares the whole content of two runs: frames and rows in their order, contacts by their ids.
///
/// # Errors
/// `Failure::Input` if a file is damaged.
pub fn runs(a: &RunFile, b: &RunFile) -> Result<Comparison> {
    let mut comparison = Comparison::default();
    if a.stage() != b.stage() {
        let [a, b] = [a, b].map(|run| run.stage().name());
        comparison
            .unequal
            .push(format!("the stage {a} against {b}"));
        return Ok(comparison);
    }
    parameters(a, b, &mut comparison);
    let grains = comparison.count("number of grains", a.grains().count(), b.grains().count());
    let [x, y] = [a, b].map(|run| run.series().rows());
    let rows = comparison.count("rows of the time series", x, y);
    let frames = comparison.count("number of frames", a.frames(), b.frames());

    let dimension = a.dimension();
    if dimension != b.dimension() {
        comparison.unequal.push("disks against spheres".into());
        return Ok(comparison);
    }
    let mut cell = FieldComparison::new("box");
    cell.see(a.periods()[0], b.periods()[0], Location::Nowhere);
    if dimension == Dimensions::Three {
        let [x, y] = [a, b].map(|run| run.periods()[1]);
        cell.see(x, y, Location::Nowhere);
    }
    cell.see(a.height(), b.height(), Location::Nowhere);
    for t in 0..frames {
        let [x, y] = [a, b].map(|run| run.box_edges(t));
        for (x, y) in x.as_flattened().iter().zip(y.as_flattened()) {
            cell.see(*x, *y, Location::Frame(t));
        }
    }
    comparison.fields.push(cell);
    let (x, y) = (a.grains(), b.grains());
    if grains == x.count() && grains == y.count() {
        let bodies = [x, y].map(|grains| grains.body.iter().map(|body| f64::from(*body)));
        let [x_body, y_body] = bodies.map(Iterator::collect::<Vec<f64>>);
        for (name, x, y) in [
            ("radius", &x.radius, &y.radius),
            ("body", &x_body, &y_body),
            ("mass", &x.mass, &y.mass),
        ] {
            let mut field = FieldComparison::new(name);
            for (n, (x, y)) in x.iter().zip(y).enumerate() {
                field.see(*x, *y, Location::Grain(n));
            }
            comparison.fields.push(field);
        }
        comparison.fields.extend(frames_of(a, b, frames)?);
    }

    let rows: Vec<[usize; 2]> = (0..rows).map(|row| [row; 2]).collect();
    comparison.fields.extend(series(a, b, &rows));
    for (one, other) in [(a, b), (b, a)] {
        let declared = one.series().declared.iter();
        let alone = declared.filter(|column| !other.series().has(column.name));
        let path = one.path().display();
        let lines = alone.map(|column| format!("column {column}: only in {path}"));
        comparison.asides.extend(lines);
    }
    Ok(comparison)
}

/// Compares the time series in these rows of the one and of the other run, the columns that both
/// have; places are rows of the first.
pub fn series(a: &RunFile, b: &RunFile, rows: &[[usize; 2]]) -> Vec<FieldComparison> {
    let (a, b) = (a.series(), b.series());
    let steps = [a, b].map(|series| series.step.iter().map(|step| *step as f64));
    let [a_steps, b_steps] = steps.map(Iterator::collect::<Vec<f64>>);
    let mut columns = vec![
        ("series step", &a_steps[..], &b_steps[..]),
        ("series time", &a.time, &b.time),
    ];
    for column in a.declared.iter().filter(|column| b.has(column.name)) {
        columns.push((column.name, a.column(column.name), b.column(column.name)));
    }
    let fields = columns.into_iter().map(|(name, x, y)| {
        let mut field = FieldComparison::new(name);
        for &[i, j] in rows {
            field.see(x[i], y[j], Location::Row(i));
        }
        field
    });
    fields.collect()
}

fn parameters(a: &RunFile, b: &RunFile, comparison: &mut Comparison) {
    let names: BTreeSet<_> = a.parameters().keys().chain(b.parameters().keys()).collect();
    for name in names {
        match (a.parameters().get(name), b.parameters().get(name)) {
            (Some(x), Some(y)) if x == y => {}
            (Some(x), Some(y)) if name == "digest" => {
                comparison.unequal.push(format!("digest: {x} against {y}"));
            }
            (Some(_), Some(_)) if name == "scene" => {
                comparison.asides.push("the scene".to_string());
            }
            (Some(x), Some(y)) => comparison.asides.push(format!("{name}: {x} against {y}")),
            (x, _) => {
                let has = if x.is_some() { a } else { b };
                let aside = format!("{name}: only in {}", has.path().display());
                comparison.asides.push(aside);
            }
        }
    }
    // Settings come before parameters that differ between any two runs.
    comparison
        .asides
        .sort_by_key(|line| PROVENANCE.iter().any(|name| line.starts_with(name)));
}

/// Compares the fields of frames, read in blocks.
fn frames_of(a: &RunFile, b: &RunFile, frames: usize) -> Result<Vec<FieldComparison>> {
    let form = FrameFormat {
        // Files of earlier versions leave them out.
        walls: a.form().walls && b.form().walls,
        // Without them the other run has nothing to compare.
        histories: a.form().histories && b.form().histories,
        ages: a.form().ages && b.form().ages,
        ..b.form()
    };
    let mut fields = FrameComparison::new(form);
    let length = a.block_length().min(b.block_length());
    for first in (0..frames).step_by(length) {
        let range = first..frames.min(first + length);
        let pairs = a.records(range.clone())?.into_iter().zip(b.records(range)?);
        for (k, (x, y)) in pairs.enumerate() {
            fields.see(first + k, &x, &y);
        }
    }
    Ok(fields.fields)
}

/// Fields of frames, before those of contacts; the last one is whether a contact is in both runs.
const FRAME_FIELDS: [&str; 8] = [
    "frame step",
    "frame time",
    "position",
    "velocity",
    "angular_velocity",
    "image",
    "removed",
    "contacts",
];

struct FrameComparison {
    form: FrameFormat,
    /// [`FRAME_FIELDS`], then those of contacts.
    fields: Vec<FieldComparison>,
}

impl FrameComparison {
    fn new(form: FrameFormat) -> Self {
        let contacts = of_contacts(form);
        let contacts =
            contacts.map(|quantity| FieldComparison::new(format!("c. {}", quantity.column)));
        let fields = FRAME_FIELDS.map(FieldComparison::new).into_iter();
        FrameComparison {
            form,
            fields: fields.chain(contacts).collect(),
        }
    }

    fn see(&mut self, t: usize, a: &Frame, b: &Frame) {
        let [step, time, position, velocity, spin, image, removed, ..] = &mut self.fields[..]
        else {
            unreachable!("FRAME_FIELDS come first");
        };
        step.see(a.step as f64, b.step as f64, Location::Frame(t));
        time.see(a.time, b.time, Location::Frame(t));
        let axes = self.form.axes;
        let spins = if axes == 2 { 2..3 } else { 0..3 };
        for (n, (a, b)) in a.grains.iter().zip(&b.grains).enumerate() {
            let at = Location::GrainOf(t, n, "");
            removed.see(a.removed.into(), b.removed.into(), at);
            for (k, part) in PARTS.iter().enumerate().take(axes) {
                let at = Location::GrainOf(t, n, part);
                position.see(a.position[k], b.position[k], at);
                velocity.see(a.velocity[k], b.velocity[k], at);
                image.see(a.image[k] as f64, b.image[k] as f64, at);
            }
            for k in spins.clone() {
                let at = Location::GrainOf(t, n, PARTS[k]);
                spin.see(a.angular_velocity[k], b.angular_velocity[k], at);
            }
        }
        self.see_contacts(t, &a.contacts, &b.contacts);
        if self.form.walls {
            self.see_contacts(t, &a.wall_contacts, &b.wall_contacts);
        }
    }

    /// Merges two lists in order of (i, j).
    fn see_contacts(&mut self, t: usize, mut a: &[ContactSample], mut b: &[ContactSample]) {
        let (frames, contacts) = self.fields.split_at_mut(FRAME_FIELDS.len());
        let pairs = &mut frames[FRAME_FIELDS.len() - 1];
        loop {
            let order = match (a.first(), b.first()) {
                (Some(x), Some(y)) => (x.i, x.j).cmp(&(y.i, y.j)),
                (Some(_), None) => Ordering::Less,
                (None, Some(_)) => Ordering::Greater,
                (None, None) => return,
            };
            let [in_a, in_b] = [Ordering::Greater, Ordering::Less].map(|other| order != other);
            let sample = if in_a { &a[0] } else { &b[0] };
            let at = Location::ContactOf(t, sample.i, sample.j);
            pairs.see(in_a.into(), in_b.into(), at);
            if in_a && in_b {
                for (field, quantity) in contacts.iter_mut().zip(of_contacts(self.form)) {
                    let [x, y] = [&a[0], &b[0]].map(|contact| quantity.values(self.form, contact));
                    x.zip(y).for_each(|(x, y)| field.see(x, y, at));
                }
            }
            a = &a[usize::from(in_a)..];
            b = &b[usize::from(in_b)..];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One NaN differs, two do not; zeros of different sign differ by nothing; absolute and
    /// relative differences keep their own places.
    #[test]
    fn the_largest_differences_are_kept() {
        let nan = f64::NAN;
        let cases = [
            (
                &[[nan, -nan], [nan, 1.0], [5.0, 1.0]][..],
                2,
                [f64::INFINITY; 2],
                [1, 1],
            ),
            (&[[1.0, 1.0], [0.0, -0.0]], 1, [0.0, 0.0], [1, 1]),
            (&[[1000.0, 1001.0], [0.5, 0.25]], 2, [1.0, 0.5], [0, 1]),
        ];
        for (pairs, differing, greatest, at) in cases {
            let mut field = FieldComparison::new("f");
            for (row, [a, b]) in pairs.iter().enumerate() {
                field.see(*a, *b, Location::Row(row));
            }
            assert_eq!(
                (field.compared, field.differing),
                (pairs.len() as u64, differing)
            );
            assert_eq!([field.absolute, field.relative], greatest);
            assert_eq!(
                [field.absolute_at, field.relative_at],
                at.map(Location::Row)
            );
        }
    }

    #[test]
    fn contacts_are_matched_by_their_ids() {
        let contact = |i: u32, j: u32, force: f64| {
            let mut contact: ContactSample = bytemuck::Zeroable::zeroed();
            (contact.i, contact.j, contact.normal_force) = (i, j, force);
            contact
        };
        let a = [contact(0, 1, 1.0), contact(0, 2, 2.0), contact(4, 5, 3.0)];
        let b = [contact(0, 2, 2.0), contact(3, 4, 9.0), contact(4, 5, 3.5)];
        let mut fields = FrameComparison::new(FrameFormat::new(2, false));
        fields.see_contacts(7, &a, &b);
        let [.., pairs, force, _, _, _, _, _, _, _] = &fields.fields[..] else {
            panic!("too few fields");
        };
        assert_eq!((pairs.compared, pairs.differing), (4, 2));
        assert_eq!(pairs.first, Location::ContactOf(7, 0, 1));
        assert_eq!((force.compared, force.differing), (2, 1));
        assert_eq!(force.first, Location::ContactOf(7, 4, 5));
    }
}
