//! LAMMPS data files of `atom_style sphere`, read and written as text.
//!
//! A file has a header (counts and the box), then sections. Its first line is never read; `#`
//! begins a comment.

use std::collections::HashMap;
use std::fmt::Write as _;

use crate::words::{quoted, shortened};
use gshear_dem::failure::{Failure, Result};

/// A file's content.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DataFile {
    /// lo and hi along x, y, z.
    pub bounds: [[f64; 2]; 3],
    /// xy, xz, yz of a tilted box.
    pub tilt: [f64; 3],
    /// What the file says of the bounds along an axis that is not periodic, such as `ff`.
    pub bounded: [Option<String>; 3],
    /// Velocity along x of the image above (m/s), if it is known; no file has it.
    pub stream: Option<f64>,
    /// Number of types.
    pub types: u32,
    /// In the order of the section `Atoms`.
    pub atoms: Vec<Atom>,
}

/// One sphere.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Atom {
    /// Any number; the file has each once.
    pub id: u64,
    /// 1 … types.
    pub kind: u32,
    /// In the unit of length of the file.
    pub diameter: f64,
    /// Mass over the volume of a sphere of this diameter.
    pub density: f64,
    /// Of the centre.
    pub position: [f64; 3],
    /// Zero in a file without velocities.
    pub velocity: [f64; 3],
    /// Zero in a file without them.
    pub angular_velocity: [f64; 3],
    /// Line of the file, from 1.
    pub line: usize,
}

pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];
/// Sections that are skipped, by their last word.
const PASSED_OVER: [&str; 3] = ["Masses", "Coeffs", "Labels"];
/// Sections of what grains do not have, which must be empty.
const WITHOUT_ROWS: &str = "Bonds Angles Dihedrals Impropers Ellipsoids Lines Triangles Bodies";
/// Columns of the section `Atoms` of `atom_style sphere`, and of a hybrid that begins with it.
const COLUMNS: [&str; 2] = [
    "id type diameter density x y z",
    "id type x y z diameter density",
];

/// The file as text: numbers in shortest form that reads back to the same bits. `title` and
/// `comments` are lines without `#`.
pub fn write(title: &str, comments: &[&str], file: &DataFile) -> String {
    let mut text = format!("{title}\n");
    for comment in comments {
        text.push_str(&format!("# {comment}\n"));
    }
    let (atoms, types) = (file.atoms.len(), file.types);
    text.push_str(&format!("\n{atoms} atoms\n{types} atom types\n\n"));
    for ([lo, hi], axis) in file.bounds.iter().zip(AXES) {
        text.push_str(&format!("{lo:?} {hi:?} {axis}lo {axis}hi\n"));
    }
    let [xy, xz, yz] = file.tilt;
    if file.tilt != [0.0; 3] {
        text.push_str(&format!("{xy:?} {xz:?} {yz:?} xy xz yz\n"));
    }
    // LAMMPS compares the whole comment with its atom_style.
    text.push_str("\nAtoms # sphere\n\n");
    for a in &file.atoms {
        let [x, y, z] = a.position;
        let _ = write!(text, "{} {}", a.id, a.kind);
        end_row(&mut text, &[a.diameter, a.density, x, y, z]);
    }
    text.push_str("\nVelocities\n\n");
    for a in &file.atoms {
        let _ = write!(text, "{}", a.id);
        end_row(&mut text, [a.velocity, a.angular_velocity].as_flattened());
    }
    text
}

/// Writes the numbers at the end of a row.
fn end_row(text: &mut String, numbers: &[f64]) {
    for x in numbers {
        // Writing to a string cannot fail.
        let _ = write!(text, " {x:?}");
    }
    text.push('\n');
}

/// Reads a file's text; `name` is what messages call it.
///
/// # Errors
/// `Failure::Input` with the line, what is wrong with it and what would be right.
pub fn parse(name: &str, text: &str) -> Result<DataFile> {
    let mut lines = Lines::new(name, text);
    if text.trim().is_empty() {
        return Err(Failure::input(format!(
            "{name}: is empty; give a LAMMPS data file of atom_style sphere"
        )));
    }
    lines.rest.next();
    let (header, mut section) = DataHeader::read(&mut lines)?;
    let (mut file, count) = header.complete(name)?;
    let mut atoms: Option<Vec<Atom>> = None;
    let mut place = HashMap::new();
    while let Some((at, heading)) = section {
        let (title, style) = split_comment(heading);
        section = match title {
            "Atoms" => {
                if atoms.is_some() {
                    return Err(lines.wrong(at, "a second section Atoms"));
                }
                let rows = AtomRows {
                    style: AtomStyle::read(&lines, at, style)?,
                    types: file.types,
                    count,
                };
                atoms = Some(lines.atoms(&rows, &mut place)?);
                lines.heading(&format!("the header says {count} atoms, here is one more"))?
            }
            "Velocities" => {
                let Some(atoms) = &mut atoms else {
                    return Err(lines.wrong(at, "Velocities come before Atoms; put them after"));
                };
                lines.velocities(atoms, &place)?;
                lines.heading(&format!(
                    "the header says {count} atoms, here is a velocity more"
                ))?
            }
            passed if PASSED_OVER.iter().any(|word| passed.ends_with(word)) => lines.pass_over(),
            empty if WITHOUT_ROWS.split(' ').any(|section| section == empty) => lines.heading(
                &format!("{empty} are not taken: grains have none; delete the section"),
            )?,
            other => {
                return Err(lines.wrong(
                    at,
                    &format!(
                        "{} is no section of a packing of spheres or disks; it has Atoms, and may have Velocities, Masses, … Coeffs, … Labels",
                        quoted(other)
                    ),
                ));
            }
        };
    }
    file.atoms =
        atoms.ok_or_else(|| Failure::input(format!("{name}: the section Atoms is missing")))?;
    Ok(file)
}

/// The style of the rows of the section Atoms.
#[derive(Clone, Copy, PartialEq)]
enum AtomStyle {
    Sphere,
    /// A hybrid that begins with sphere.
    Hybrid {
        /// Whether it has other styles, and their columns.
        has_more: bool,
    },
}

impl AtomStyle {
    /// Reads the comment of the heading on line `at`.
    fn read(lines: &Lines<'_>, at: usize, style: &str) -> Result<Self> {
        let words: Vec<&str> = style.split_whitespace().collect();
        match words[..] {
            [] | ["sphere" | "granular", ..] => Ok(Self::Sphere),
            ["hybrid", "sphere", ref others @ ..] => Ok(Self::Hybrid {
                has_more: !others.is_empty(),
            }),
            _ => {
                let what = format!(
                    "Atoms are of the style {}; write them with atom_style sphere: {}; or with a hybrid that begins with sphere",
                    shortened(style),
                    COLUMNS[0]
                );
                Err(lines.wrong(at, &what))
            }
        }
    }

    /// How a row is written, for messages.
    fn form(self) -> String {
        let (style, columns) = match self {
            Self::Sphere => ("sphere", COLUMNS[0]),
            Self::Hybrid { .. } => ("hybrid sphere", COLUMNS[1]),
        };
        format!("a row of Atoms is {columns}, as atom_style {style} writes it")
    }
}

/// The rows of the section Atoms.
struct AtomRows {
    style: AtomStyle,
    /// Number of types.
    types: u32,
    /// Number of atoms, as the header says.
    count: u64,
}

/// The lines of a file that are not read yet.
pub(crate) struct Lines<'a> {
    name: &'a str,
    pub(crate) rest: std::iter::Enumerate<std::str::Lines<'a>>,
    /// Line after the last.
    end: usize,
}

type Heading<'a> = Option<(usize, &'a str)>;

impl<'a> Lines<'a> {
    pub(crate) fn new(name: &'a str, text: &'a str) -> Self {
        Self {
            name,
            rest: text.lines().enumerate(),
            end: 1 + text.lines().count(),
        }
    }

    /// The ends of an axis of the box.
    pub(crate) fn bounds(&self, at: usize, words: &[&str], form: &str) -> Result<[f64; 2]> {
        let [lo, hi] = self.numbers(at, words, 0, &format!("write: {form}"))?;
        if hi <= lo {
            let what = format!("the box is empty: {lo:?} is not below {hi:?}");
            return Err(self.wrong(at, &what));
        }
        if !(hi - lo).is_finite() {
            let what =
                format!("the box is too long: from {lo:?} to {hi:?} is more than a number can say");
            return Err(self.wrong(at, &what));
        }
        Ok([lo, hi])
    }

    /// The rows of the section Atoms; their places by ids are added to `place`.
    fn atoms(&mut self, rows: &AtomRows, place: &mut HashMap<u64, usize>) -> Result<Vec<Atom>> {
        // The header may say more than the file has.
        let mut read = Vec::with_capacity((rows.count as usize).min(self.end));
        for _ in 0..rows.count {
            let atom = self.atom(rows)?;
            if let Some(first) = place.insert(atom.id, read.len()) {
                let first: &Atom = &read[first];
                let what = format!("atom {} was on line {} already", atom.id, first.line);
                return Err(self.wrong(atom.line, &what));
            }
            read.push(atom);
        }
        Ok(read)
    }

    /// The rows of the section Velocities.
    fn velocities(&mut self, atoms: &mut [Atom], place: &HashMap<u64, usize>) -> Result<()> {
        let mut seen = vec![false; atoms.len()];
        let count = atoms.len() as u64;
        for _ in 0..count {
            let (line, words) = self.row(count, "Velocities")?;
            let form = "a row of Velocities is id vx vy vz wx wy wz";
            let id = self.id(line, &words, form)?;
            let Some(&k) = place.get(&id) else {
                return Err(self.wrong(line, &format!("there is no atom {id}")));
            };
            if std::mem::replace(&mut seen[k], true) {
                return Err(self.wrong(line, &format!("a second velocity of atom {id}")));
            }
            // A hybrid may have more of them.
            if words.len() < 7 {
                let what = format!("{} columns; {form}", words.len());
                return Err(self.wrong(line, &what));
            }
            let [vx, vy, vz, wx, wy, wz] = self.numbers(line, &words, 1, form)?;
            atoms[k].velocity = [vx, vy, vz];
            atoms[k].angular_velocity = [wx, wy, wz];
        }
        Ok(())
    }

    pub(crate) fn wrong(&self, line: usize, what: &str) -> Failure {
        Failure::input(format!("{}:{line}: {what}", self.name))
    }

    /// The next line that holds more than a comment, with its number.
    pub(crate) fn next(&mut self) -> Heading<'a> {
        self.rest
            .by_ref()
            .map(|(k, line)| (k + 1, line.trim()))
            .find(|(_, line)| !split_comment(line).0.is_empty())
    }

    /// The words of the next of `count` rows.
    pub(crate) fn row(&mut self, count: u64, section: &str) -> Result<(usize, Vec<&'a str>)> {
        match self.next() {
            Some((at, line)) if !is_heading(line) => {
                Ok((at, split_comment(line).0.split_whitespace().collect()))
            }
            other => {
                let at = other.map_or(self.end, |(at, _)| at);
                let what =
                    format!("{section} ends here; the header says {count} atoms, a row for each");
                Err(self.wrong(at, &what))
            }
        }
    }

    /// The heading that must come next, if anything does.
    fn heading(&mut self, otherwise: &str) -> Result<Heading<'a>> {
        match self.next() {
            Some((at, line)) if !is_heading(line) => Err(self.wrong(at, otherwise)),
            other => Ok(other),
        }
    }

    fn pass_over(&mut self) -> Heading<'a> {
        loop {
            match self.next() {
                Some((_, line)) if !is_heading(line) => {}
                other => return other,
            }
        }
    }

    pub(crate) fn id(&self, line: usize, words: &[&str], form: &str) -> Result<u64> {
        match words[0].parse::<u64>() {
            Ok(id) if id > 0 => Ok(id),
            _ => {
                let found = quoted(words[0]);
                let what =
                    format!("the id must be a whole number from 1 on, found {found}; {form}");
                Err(self.wrong(line, &what))
            }
        }
    }

    /// K numbers from the word `first` on.
    pub(crate) fn numbers<const K: usize>(
        &self,
        line: usize,
        words: &[&str],
        first: usize,
        form: &str,
    ) -> Result<[f64; K]> {
        let mut numbers = [0.0; K];
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = self.number(line, words, first + k, form)?;
        }
        Ok(numbers)
    }

    /// The number that this word is.
    pub(crate) fn number(
        &self,
        line: usize,
        words: &[&str],
        place: usize,
        form: &str,
    ) -> Result<f64> {
        let Some(word) = words.get(place) else {
            let what = format!("{} columns are too few; {form}", words.len());
            return Err(self.wrong(line, &what));
        };
        match word.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(self.wrong(line, &format!("{} is no number; {form}", quoted(word)))),
        }
    }

    fn atom(&mut self, rows: &AtomRows) -> Result<Atom> {
        let AtomRows {
            style,
            types,
            count,
        } = *rows;
        let (line, words) = self.row(count, "Atoms")?;
        let form = style.form();
        let id = self.id(line, &words, &form)?;
        let has_more = style == AtomStyle::Hybrid { has_more: true };
        if words.len() < 7 || !has_more && ![7, 10].contains(&words.len()) {
            let what = format!("{} columns; {form}", words.len());
            return Err(self.wrong(line, &what));
        }
        // Images are not needed: positions are wrapped in any case.
        let image = words[7..].iter().find(|word| word.parse::<i64>().is_err());
        if let Some(image) = image
            && !has_more
        {
            let what = format!(
                "the images of atom {id} must be three whole numbers, such as 0 0 0, found {}",
                quoted(image)
            );
            return Err(self.wrong(line, &what));
        }
        let kind = match words[1].parse::<u32>() {
            Ok(kind) if (1..=types).contains(&kind) => kind,
            _ => {
                let found = quoted(words[1]);
                let what = format!("the type must lie in 1 … {types}, found {found}; {form}");
                return Err(self.wrong(line, &what));
            }
        };
        let mut numbers = self.numbers(line, &words, 2, &form)?;
        if style != AtomStyle::Sphere {
            numbers.rotate_left(3);
        }
        let [diameter, density, x, y, z] = numbers;
        self.check_sphere(line, id, diameter, density)?;
        Ok(Atom {
            id,
            kind,
            diameter,
            density,
            position: [x, y, z],
            line,
            ..Atom::default()
        })
    }

    /// Refuses a size or density of a sphere with which numbers overflow.
    pub(crate) fn check_sphere(
        &self,
        line: usize,
        id: u64,
        diameter: f64,
        density: f64,
    ) -> Result<()> {
        for (what, value) in [("diameter", diameter), ("density", density)] {
            // Half of the least float is 0, the square of 1e-200 too.
            if !(1e-100..=1e100).contains(&value) {
                let what =
                    format!("the {what} of atom {id} must lie in 1e-100 … 1e100, found {value:?}");
                return Err(self.wrong(line, &what));
            }
        }
        Ok(())
    }
}

/// A line without its comment, and the comment without its `#`.
pub(crate) fn split_comment(line: &str) -> (&str, &str) {
    let (text, comment) = line.split_once('#').unwrap_or((line, ""));
    (text.trim(), comment.trim())
}

/// Rows begin with a number, headings with a letter.
fn is_heading(line: &str) -> bool {
    line.starts_with(|c: char| c.is_ascii_alphabetic())
}

/// A line of the header: numbers, and what they are.
struct HeaderLine<'a> {
    at: usize,
    text: &'a str,
    words: Vec<&'a str>,
    /// How many of the words are numbers.
    numbers: usize,
    /// The others.
    keyword: String,
}

impl<'a> HeaderLine<'a> {
    fn new(at: usize, line: &'a str) -> Self {
        let text = split_comment(line).0;
        let words: Vec<&str> = text.split_whitespace().collect();
        let numbers = words
            .iter()
            .take_while(|word| word.parse::<f64>().is_ok())
            .count();
        Self {
            at,
            text,
            numbers,
            keyword: words[numbers..].join(" "),
            words,
        }
    }

    /// The axis whose bounds it has.
    fn axis(&self) -> Option<usize> {
        AXES.iter()
            .position(|axis| self.keyword == format!("{axis}lo {axis}hi"))
    }

    /// Refuses another number of numbers.
    fn check_numbers(&self, lines: &Lines<'_>, wanted: usize, form: &str) -> Result<()> {
        if self.numbers == wanted {
            return Ok(());
        }
        let what = format!("{} numbers; write: {form}", self.numbers);
        Err(lines.wrong(self.at, &what))
    }

    /// Refuses a second line of the same keyword.
    fn check_first(&self, lines: &Lines<'_>, is_given: bool) -> Result<()> {
        if !is_given {
            return Ok(());
        }
        let what = format!("a second line {}; leave it out", self.keyword);
        Err(lines.wrong(self.at, &what))
    }

    /// Its only number, a number of things.
    fn count(&self, lines: &Lines<'_>) -> Result<u32> {
        let keyword = &self.keyword;
        self.check_numbers(lines, 1, &format!("N {keyword}"))?;
        match self.words[0].parse::<u32>() {
            Ok(count) if count > 0 => Ok(count),
            _ => {
                let (most, found) = (u32::MAX, shortened(self.words[0]));
                let what = format!(
                    "the number of {keyword} must be a whole number in 1 … {most}, found {found}"
                );
                Err(lines.wrong(self.at, &what))
            }
        }
    }

    /// Whether it is of something that packings do without, such as `0 bonds` or `2 extra bond per
    /// atom`.
    fn is_skipped(&self) -> bool {
        let keyword = &self.keyword;
        let is_none = self.words[0] == "0" && !keyword.is_empty();
        self.numbers == 1 && (is_none || keyword.starts_with("extra "))
    }
}

/// What the header has said so far.
#[derive(Default)]
struct DataHeader {
    bounds: [Option<[f64; 2]>; 3],
    tilt: [f64; 3],
    types: Option<u32>,
    atoms: Option<u64>,
}

impl DataHeader {
    /// Reads up to the first heading, which is returned, too.
    fn read<'a>(lines: &mut Lines<'a>) -> Result<(Self, Heading<'a>)> {
        let mut header = DataHeader::default();
        loop {
            let Some((at, line)) = lines.next() else {
                return Ok((header, None));
            };
            if is_heading(line) {
                return Ok((header, Some((at, line))));
            }
            header.add(lines, &HeaderLine::new(at, line))?;
        }
    }

    fn add(&mut self, lines: &Lines<'_>, line: &HeaderLine<'_>) -> Result<()> {
        match (line.keyword.as_str(), line.axis()) {
            (keyword, Some(axis)) => {
                line.check_first(lines, self.bounds[axis].is_some())?;
                let form = format!("lo hi {keyword}");
                line.check_numbers(lines, 2, &form)?;
                let numbers = &line.words[..line.numbers];
                self.bounds[axis] = Some(lines.bounds(line.at, numbers, &form)?);
            }
            ("atoms", _) => {
                line.check_first(lines, self.atoms.is_some())?;
                self.atoms = Some(line.count(lines)?.into());
            }
            ("atom types", _) => {
                line.check_first(lines, self.types.is_some())?;
                self.types = Some(line.count(lines)?);
            }
            ("xy xz yz", _) => {
                let form = "0 0 0 xy xz yz";
                line.check_numbers(lines, 3, form)?;
                let form = format!("write: {form}");
                self.tilt = lines.numbers(line.at, &line.words, 0, &form)?;
            }
            _ if line.is_skipped() => {}
            _ => {
                let what = format!(
                    "{} is no header line of a packing of disks; they are atoms, atom types, xlo xhi, ylo yhi, zlo zhi",
                    quoted(line.text)
                );
                return Err(lines.wrong(line.at, &what));
            }
        }
        Ok(())
    }

    /// A file without its atoms, and their number, if nothing is missing.
    fn complete(self, name: &str) -> Result<(DataFile, u64)> {
        let [x, y, z] = self.bounds;
        let count = present(name, self.atoms, "N atoms")?;
        let file = DataFile {
            tilt: self.tilt,
            types: present(name, self.types, "n atom types")?,
            bounds: [
                present(name, x, "lo hi xlo xhi")?,
                present(name, y, "lo hi ylo yhi")?,
                present(name, z, "lo hi zlo zhi")?,
            ],
            ..DataFile::default()
        };
        Ok((file, count))
    }
}

/// What a line of the header says; refuses a file without the line.
fn present<T>(name: &str, value: Option<T>, line: &str) -> Result<T> {
    value.ok_or_else(|| Failure::input(format!("{name}: the header lacks the line `{line}`")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::cases;

    fn file() -> DataFile {
        let atom = |k: usize| Atom {
            id: 7 - k as u64,
            kind: 1 + k as u32 % 3,
            diameter: 0.1 + 0.3 * k as f64,
            density: 1.0 / 3.0,
            position: [1e-9 * k as f64, -2.5e-300, 0.0],
            velocity: [0.1 * k as f64, 1e22, 0.0],
            angular_velocity: [0.0, 0.0, -1.0 / 7.0],
            line: 0,
        };
        DataFile {
            bounds: [[0.0, 48e-6], [-1e-9, 0.1 + 0.2], [-0.5, 0.5]],
            bounded: [const { None }; 3],
            tilt: [1e-6 / 3.0, 0.0, 0.0],
            stream: None,
            types: 3,
            atoms: (0..4).map(atom).collect(),
        }
    }

    fn without_lines(mut file: DataFile) -> DataFile {
        file.atoms.iter_mut().for_each(|a| a.line = 0);
        file
    }

    #[test]
    fn what_is_written_reads_back_to_the_same_bits() {
        let text = write("title", &["1 free", "2 bottom"], &file());
        assert!(text.starts_with("title\n# 1 free\n# 2 bottom\n\n4 atoms\n3 atom types\n"));
        assert_eq!(without_lines(parse("x", &text).unwrap()), file());
    }

    /// As LAMMPS' own write_data writes it, and as people do.
    #[test]
    fn sections_and_rows_in_any_order() {
        let text = "first line: 5 atoms, never read
2 atoms # as many
1 atom types
0 bonds
0 10 xlo xhi
-1 2.5e1 ylo yhi
-0.5 0.5 zlo zhi
0 0 0 xy xz yz

Masses

1 1.0

Pair Coeffs # gran/hooke/history

1 1e5 NULL

Atoms  # sphere

9 1 1.0 2.5 1 2 0 0 0 0
# in between
3 1 2.0 2.5 5 6 0 -1 0 0   # the second

Velocities

3 1 2 0 0 0 3
9 4 5 0 0 0 6
";
        let file = parse("x", text).unwrap();
        assert_eq!(file.bounds[1], [-1.0, 25.0]);
        let [first, second] = file.atoms[..] else {
            panic!("two atoms")
        };
        assert_eq!((first.id, first.line, second.line), (9, 20, 22));
        assert_eq!(first.velocity, [4.0, 5.0, 0.0]);
        assert_eq!(second.angular_velocity[2], 3.0);
    }

    /// Rows of a hybrid have the position first; sections and header lines of a molecular style
    /// say nothing; lines may end as on Windows.
    #[test]
    fn hybrids_and_what_comes_with_them() {
        let text = |style: &str, more: &str| {
            format!(
                "Größe\n2 atoms\n0 bonds\n1 atom types\n2 extra bond per atom\n0 1 xlo xhi\n0 1 ylo yhi\n0 1 zlo zhi\n0.1 0 0 xy xz yz\n\nBond Coeffs\n\n1 2.0\n\nAtoms # {style}\n\n1 1 0.3 0.4 0.5 0.1 2500{more}\n2 1 0.6 0.7 0.8 0.2 2500{more}\n\nBonds\n\nVelocities\n\n2 1 0 0 0 0 3{more}\n1 0 0 0 0 0 0{more}\n"
            )
        };
        for text in [
            text("hybrid sphere", ""),
            text("hybrid sphere bond", " 7"),
            text("hybrid sphere", "").replace('\n', "\r\n"),
        ] {
            let file = parse("x", &text).unwrap();
            assert_eq!(file.tilt, [0.1, 0.0, 0.0]);
            let [first, second] = file.atoms[..] else {
                panic!("two atoms")
            };
            assert_eq!((first.position, first.diameter), ([0.3, 0.4, 0.5], 0.1));
            assert_eq!((second.diameter, second.density), (0.2, 2500.0));
            assert_eq!(second.angular_velocity, [0.0, 0.0, 3.0]);
        }
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let good = "title
2 atoms
2 atom types
0 10 xlo xhi
0 10 ylo yhi
-1 1 zlo zhi

Atoms # sphere

1 1 1.0 1.0 1 1 0
2 2 1.0 1.0 3 1 0

Velocities

1 0 0 0 0 0 0
2 0 0 0 0 0 0
";
        assert!(parse("f", good).is_ok());
        let refused = |text: &str| parse("f", text).unwrap_err().to_string();
        for [from, to, expected] in cases(
            r#"
            2 atoms\n |  | f: the header lacks the line `N atoms`
            0 10 ylo yhi\n |  | f: the header lacks the line `lo hi ylo yhi`
            2 atom types | 2.5 atom types | f:3: the number of atom types must be a whole number in 1 … 4294967295, found 2.5
            2 atoms | 9223372036854775807 atoms | f:2: the number of atoms must be a whole number in 1 … 4294967295, found 9223372036854775807
            2 atoms | -2 atoms | f:2: the number of atoms must be a whole number in 1 … 4294967295, found -2
            2 atoms | 0 atoms | f:2: the number of atoms must be a whole number in 1 … 4294967295, found 0
            // No memory is taken for atoms that are not there.
            2 atoms | 4294967295 atoms | f:13: Atoms ends here; the header says 4294967295 atoms, a row for each
            2 atoms | 1 2 atoms | f:2: 2 numbers; write: N atoms
            2 atoms\n | 2 atoms\n3 atoms\n | f:3: a second line atoms; leave it out
            0 10 xlo xhi | -1e308 1e308 xlo xhi | f:4: the box is too long: from -1e308 to 1e308 is more than a number can say
            0 10 xlo xhi | 0 inf xlo xhi | f:4: "inf" is no number; write: lo hi xlo xhi
            0 10 xlo xhi | 0 10 20 xlo xhi | f:4: 3 numbers; write: lo hi xlo xhi
            2 2 1.0 1.0 3 1 0 | 2 2 1.0 1.0 3 1 0 0 abc 0 | f:11: the images of atom 2 must be three whole numbers, such as 0 0 0, found "abc"
            2 2 1.0 1.0 3 1 0 | 2 2 1.0 1.0 3 1 0 nan 0 0 | f:11: the images of atom 2 must be three whole numbers, such as 0 0 0, found "nan"
            2 2 1.0 1.0 3 1 0 | 2 2 1.0 1.0 3 1 0 0 0 0.5 | f:11: the images of atom 2 must be three whole numbers, such as 0 0 0, found "0.5"
            // Its radius would be 0.
            2 2 1.0 1.0 3 1 0 | 2 2 5e-324 1.0 3 1 0 | f:11: the diameter of atom 2 must lie in 1e-100 … 1e100, found 5e-324
            2 2 1.0 1.0 3 1 0 | 2 2 1.0 0 3 1 0 | f:11: the density of atom 2 must lie in 1e-100 … 1e100, found 0.0
            2 0 0 0 0 0 0 | 2 0 0 0 0 -inf 0 | f:16: "-inf" is no number; a row of Velocities is id vx vy vz wx wy wz
            0 10 xlo xhi | 10 0 xlo xhi | f:4: the box is empty: 10.0 is not below 0.0
            0 10 xlo xhi | 10 xlo xhi | f:4: 1 numbers; write: lo hi xlo xhi
            2 atom types | 2 atom types\n7 bonds | f:4: "7 bonds" is no header line of a packing of disks; they are atoms, atom types, xlo xhi, ylo yhi, zlo zhi
            Atoms # sphere | Atoms # atomic | f:8: Atoms are of the style atomic; write them with atom_style sphere: id type diameter density x y z; or with a hybrid that begins with sphere
            1 1 1.0 1.0 1 1 0 | 1 1 1 1 0 | f:10: 5 columns; a row of Atoms is id type diameter density x y z, as atom_style sphere writes it
            2 2 1.0 1.0 3 1 0 | 2 3 1.0 1.0 3 1 0 | f:11: the type must lie in 1 … 2, found "3"; a row of Atoms is id type diameter density x y z, as atom_style sphere writes it
            2 2 1.0 1.0 3 1 0 | 2 2 -1.0 1.0 3 1 0 | f:11: the diameter of atom 2 must lie in 1e-100 … 1e100, found -1.0
            2 2 1.0 1.0 3 1 0 | 2 2 1.0 1.0 nan 1 0 | f:11: "nan" is no number; a row of Atoms is id type diameter density x y z, as atom_style sphere writes it
            2 2 1.0 1.0 3 1 0 | 0 2 1.0 1.0 3 1 0 | f:11: the id must be a whole number from 1 on, found "0"; a row of Atoms is id type diameter density x y z, as atom_style sphere writes it
            2 2 1.0 | 1 2 1.0 | f:11: atom 1 was on line 10 already
            2 2 1.0 1.0 3 1 0\n |  | f:12: Atoms ends here; the header says 2 atoms, a row for each
            2 2 1.0 1.0 3 1 0 | 2 2 1.0 1.0 3 1 0\n3 2 1.0 1.0 3 1 0 | f:12: the header says 2 atoms, here is one more
            2 0 0 0 0 0 0\n |  | f:16: Velocities ends here; the header says 2 atoms, a row for each
            2 0 0 0 0 0 0 | 5 0 0 0 0 0 0 | f:16: there is no atom 5
            2 0 0 0 0 0 0 | 1 0 0 0 0 0 0 | f:16: a second velocity of atom 1
            2 0 0 0 0 0 0 | 2 0 0 0 | f:16: 4 columns; a row of Velocities is id vx vy vz wx wy wz
            Velocities | Rotations | f:13: "Rotations" is no section of a packing of spheres or disks; it has Atoms, and may have Velocities, Masses, … Coeffs, … Labels
            Velocities | Bonds | f:15: Bonds are not taken: grains have none; delete the section
            Atoms # sphere | Atoms # hybrid bond sphere | f:8: Atoms are of the style hybrid bond sphere; write them with atom_style sphere: id type diameter density x y z; or with a hybrid that begins with sphere
            Atoms # sphere\n\n1 1 1.0 1.0 1 1 0 | Atoms # hybrid sphere\n\n1 1 1.0 1.0 1 1 0 8 | f:10: 8 columns; a row of Atoms is id type x y z diameter density, as atom_style hybrid sphere writes it
            Velocities | Atoms | f:13: a second section Atoms
            Atoms # sphere | Velocities | f:8: Velocities come before Atoms; put them after
            "#,
        ) {
            let text = good.replacen(&from, &to, 1);
            assert_ne!(text, good, "{from}");
            assert_eq!(refused(&text), expected, "{to}");
        }
        for nothing in ["", "\n", "  \n\t\n"] {
            let expected = "f: is empty; give a LAMMPS data file of atom_style sphere";
            assert_eq!(refused(nothing), expected);
        }
        let headless = &good[..good.find("Atoms").unwrap()];
        assert_eq!(refused(headless), "f: the section Atoms is missing");
    }
}
