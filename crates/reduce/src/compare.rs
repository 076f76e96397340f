//! `compare`: compares two runs field by field, to the last bit.

use std::cmp::Ordering;
use std::fmt;
use std::io::{self, Write};

use gshear_dem::failure::Failure;
use gshear_dem::state::{ContactSample, FrameRecords};
use gshear_scene::Dimensions;
use gshear_store::run_reader::RunFile;

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
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Location {
    /// No place, as for a number of the whole run.
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
#[derive(Debug, Clone, PartialEq)]
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
        let name = name.into();
        let at = Location::Nowhere;
        FieldComparison {
            name,
            compared: 0,
            differing: 0,
            first: at,
            absolute: 0.0,
            absolute_at: at,
            relative: 0.0,
            relative_at: at,
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
        let finite = |difference: f64| {
            if difference.is_nan() {
                f64::INFINITY
            } else {
                difference
            }
        };
        let absolute = finite((a - b).abs());
        // Zeros of different sign differ only in their bits.
        let relative = if absolute == 0.0 {
            0.0
        } else {
            finite(absolute / a.abs().max(b.abs()))
        };
        if absolute > self.absolute {
            (self.absolute, self.absolute_at) = (absolute, at);
        }
        if relative > self.relative {
            (self.relative, self.relative_at) = (relative, at);
        }
    }
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
    ///
    /// # Errors
    /// If `output` cannot be written.
    pub fn print(&self, output: &mut impl Write) -> io::Result<()> {
        let head = [
            "field",
            "values",
            "differing",
            "max absolute",
            "at",
            "max relative",
            "at",
            "first difference",
        ];
        let [
            field,
            values,
            differing,
            absolute,
            at,
            relative,
            there,
            first,
        ] = head;
        writeln!(
            output,
            "{field:<24}{values:>12}{differing:>12}{absolute:>14}  {at:<30}{relative:>14}  {there:<30}{first}"
        )?;
        for field in &self.fields {
            writeln!(
                output,
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
        self.unequal
            .iter()
            .try_for_each(|line| writeln!(output, "differs: {line}"))?;
        self.asides
            .iter()
            .try_for_each(|line| writeln!(output, "not counted: {line}"))?;
        writeln!(
            output,
            "{}",
            if self.equal() { "equal" } else { "different" }
        )?;
        output.flush()
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
/// [`Failure::Input`] if a file is damaged.
pub fn runs(a: &RunFile, b: &RunFile) -> Result<Comparison, Failure> {
    let mut found = Comparison::default();
    if a.stage() != b.stage() {
        let [a, b] = [a, b].map(|run| run.stage().name());
        found.unequal.push(format!("the stage {a} against {b}"));
        return Ok(found);
    }
    parameters(a, b, &mut found);
    let grains = found.count("number of grains", a.grains().count(), b.grains().count());
    let rows = found.count(
        "rows of the time series",
        a.series().rows(),
        b.series().rows(),
    );
    let frames = found.count("number of frames", a.frames(), b.frames());

    let dimension = a.dimension();
    if dimension != b.dimension() {
        found.unequal.push("disks against spheres".into());
        return Ok(found);
    }
    let mut cell = FieldComparison::new("box");
    cell.see(a.grains().length, b.grains().length, Location::Nowhere);
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
    found.fields.push(cell);
    let (x, y) = (a.grains(), b.grains());
    if grains == x.count() && grains == y.count() {
        let mut column = |name: &str, of: &dyn Fn(usize) -> (f64, f64)| {
            let mut field = FieldComparison::new(name);
            (0..grains).for_each(|n| field.see(of(n).0, of(n).1, Location::Grain(n)));
            found.fields.push(field);
        };
        column("radius", &|n| (x.radius[n], y.radius[n]));
        column("body", &|n| (x.body[n].into(), y.body[n].into()));
        column("mass", &|n| (x.mass[n], y.mass[n]));
        found.fields.extend(frames_of(a, b, frames)?);
    }

    let (x, y) = (a.series(), b.series());
    let mut step = FieldComparison::new("series step");
    let mut time = FieldComparison::new("series time");
    for row in 0..rows {
        step.see(x.step[row] as f64, y.step[row] as f64, Location::Row(row));
        time.see(x.time[row], y.time[row], Location::Row(row));
    }
    found.fields.extend([step, time]);
    for column in x.declared {
        let mut field = FieldComparison::new(column.name);
        let pairs = x.column(column.name).iter().zip(y.column(column.name));
        pairs
            .enumerate()
            .for_each(|(row, (a, b))| field.see(*a, *b, Location::Row(row)));
        found.fields.push(field);
    }
    Ok(found)
}

fn parameters(a: &RunFile, b: &RunFile, found: &mut Comparison) {
    let mut names: Vec<&String> = a.parameters().keys().chain(b.parameters().keys()).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        match (a.parameters().get(name), b.parameters().get(name)) {
            (Some(x), Some(y)) if x == y => {}
            (Some(x), Some(y)) if name == "digest" => {
                found.unequal.push(format!("digest: {x} against {y}"));
            }
            (Some(_), Some(_)) if name == "scene" => found.asides.push("the scene".to_string()),
            (Some(x), Some(y)) => found.asides.push(format!("{name}: {x} against {y}")),
            (Some(_), None) => found
                .asides
                .push(format!("{name}: only in {}", a.path().display())),
            _ => found
                .asides
                .push(format!("{name}: only in {}", b.path().display())),
        }
    }
    // Settings come before parameters that differ between any two runs.
    found
        .asides
        .sort_by_key(|line| PROVENANCE.iter().any(|name| line.starts_with(name)));
}

/// Compares the fields of frames, read in blocks.
fn frames_of(a: &RunFile, b: &RunFile, frames: usize) -> Result<Vec<FieldComparison>, Failure> {
    let mut fields = FrameComparison::new(a.dimension());
    let length = a.block_length().min(b.block_length());
    for first in (0..frames).step_by(length) {
        let range = first..frames.min(first + length);
        let pairs = a.records(range.clone())?.into_iter().zip(b.records(range)?);
        pairs
            .enumerate()
            .for_each(|(k, (x, y))| fields.see(first + k, &x, &y));
    }
    Ok(fields.into_fields())
}

/// A field of a contact: name, whether it is a tangential vector (one component in 2D), getter.
type ContactField = (&'static str, bool, fn(&ContactSample) -> [f64; 3]);

const CONTACT_FIELDS: [ContactField; 7] = [
    ("normal_force", false, |c| [c.normal_force; 3]),
    ("tangential_force", true, |c| c.tangential_force),
    ("tangential_history", true, |c| c.tangential_history),
    ("rolling_history", false, |c| [c.rolling_history; 3]),
    ("overlap", false, |c| [c.overlap; 3]),
    ("sliding", false, |c| [c.sliding as f64; 3]),
    // Last: of disks.
    ("rolling", false, |c| [c.rolling as f64; 3]),
];

struct FrameComparison {
    dimension: Dimensions,
    step: FieldComparison,
    time: FieldComparison,
    position: FieldComparison,
    velocity: FieldComparison,
    angular_velocity: FieldComparison,
    image: FieldComparison,
    /// Whether a contact is in both runs.
    pairs: FieldComparison,
    contacts: Vec<FieldComparison>,
}

impl FrameComparison {
    fn new(dimension: Dimensions) -> Self {
        let columns = match dimension {
            Dimensions::Two => CONTACT_FIELDS.len(),
            Dimensions::Three => CONTACT_FIELDS.len() - 1,
        };
        FrameComparison {
            dimension,
            step: FieldComparison::new("frame step"),
            time: FieldComparison::new("frame time"),
            position: FieldComparison::new("position"),
            velocity: FieldComparison::new("velocity"),
            angular_velocity: FieldComparison::new("angular_velocity"),
            image: FieldComparison::new("image"),
            pairs: FieldComparison::new("contacts"),
            contacts: CONTACT_FIELDS[..columns]
                .iter()
                .map(|(name, ..)| FieldComparison::new(format!("c. {name}")))
                .collect(),
        }
    }

    fn see(&mut self, t: usize, a: &FrameRecords, b: &FrameRecords) {
        self.step
            .see(a.step as f64, b.step as f64, Location::Frame(t));
        self.time.see(a.time, b.time, Location::Frame(t));
        let axes = self.dimension.axes();
        for (n, (a, b)) in a.grains.iter().zip(&b.grains).enumerate() {
            for (k, part) in PARTS.into_iter().enumerate().take(axes) {
                let at = Location::GrainOf(t, n, part);
                self.position.see(a.position[k], b.position[k], at);
                self.velocity.see(a.velocity[k], b.velocity[k], at);
            }
            let spins = match self.dimension {
                Dimensions::Two => 2..3,
                Dimensions::Three => 0..3,
            };
            for k in spins {
                let at = Location::GrainOf(t, n, PARTS[k]);
                self.angular_velocity
                    .see(a.angular_velocity[k], b.angular_velocity[k], at);
            }
            for (k, part) in PARTS.into_iter().enumerate().take(axes) {
                let at = Location::GrainOf(t, n, part);
                let [a, b] = [a, b].map(|grain| grain.image[k] as f64);
                self.image.see(a, b, at);
            }
        }
        self.see_contacts(t, &a.contacts, &b.contacts);
    }

    /// Merges two lists in order of (i, j).
    fn see_contacts(&mut self, t: usize, mut a: &[ContactSample], mut b: &[ContactSample]) {
        loop {
            let order = match (a.first(), b.first()) {
                (Some(x), Some(y)) => (x.i, x.j).cmp(&(y.i, y.j)),
                (Some(_), None) => Ordering::Less,
                (None, Some(_)) => Ordering::Greater,
                (None, None) => return,
            };
            let sample = if order == Ordering::Greater {
                &b[0]
            } else {
                &a[0]
            };
            let at = Location::ContactOf(t, sample.i, sample.j);
            self.pairs.see(
                (order != Ordering::Greater).into(),
                (order != Ordering::Less).into(),
                at,
            );
            if order == Ordering::Equal {
                for (field, (_, vector, of)) in self.contacts.iter_mut().zip(CONTACT_FIELDS) {
                    let (x, y) = (of(&a[0]), of(&b[0]));
                    let components = match self.dimension {
                        Dimensions::Three if vector => 3,
                        _ => 1,
                    };
                    (0..components).for_each(|k| field.see(x[k], y[k], at));
                }
            }
            a = &a[usize::from(order != Ordering::Greater)..];
            b = &b[usize::from(order != Ordering::Less)..];
        }
    }

    fn into_fields(self) -> Vec<FieldComparison> {
        let mut fields = vec![
            self.step,
            self.time,
            self.position,
            self.velocity,
            self.angular_velocity,
        ];
        fields.push(self.image);
        fields.push(self.pairs);
        fields.extend(self.contacts);
        fields
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_nan_differs_and_two_do_not() {
        let mut field = FieldComparison::new("f");
        field.see(f64::NAN, -f64::NAN, Location::Row(0));
        assert_eq!(field.differing, 0);
        field.see(f64::NAN, 1.0, Location::Row(1));
        field.see(5.0, 1.0, Location::Row(2));
        assert_eq!((field.compared, field.differing), (3, 2));
        assert_eq!(
            (field.absolute, field.absolute_at),
            (f64::INFINITY, Location::Row(1))
        );
    }

    #[test]
    fn zeros_of_different_sign_differ_by_nothing() {
        let mut field = FieldComparison::new("f");
        field.see(0.0, -0.0, Location::Grain(3));
        assert_eq!((field.differing, field.first), (1, Location::Grain(3)));
        assert_eq!((field.absolute, field.relative), (0.0, 0.0));
    }

    #[test]
    fn absolute_and_relative_differences_keep_their_own_places() {
        let mut field = FieldComparison::new("f");
        field.see(1000.0, 1001.0, Location::Row(0));
        field.see(0.5, 0.25, Location::Row(1));
        assert_eq!((field.absolute, field.absolute_at), (1.0, Location::Row(0)));
        assert_eq!((field.relative, field.relative_at), (0.5, Location::Row(1)));
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
        let mut fields = FrameComparison::new(Dimensions::Two);
        fields.see_contacts(7, &a, &b);
        assert_eq!((fields.pairs.compared, fields.pairs.differing), (4, 2));
        assert_eq!(fields.pairs.first, Location::ContactOf(7, 0, 1));
        let force = &fields.contacts[0];
        assert_eq!(
            (force.compared, force.differing, force.first),
            (2, 1, Location::ContactOf(7, 4, 5))
        );
    }
}
