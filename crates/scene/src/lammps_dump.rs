//! Frames of LAMMPS' text dumps (`dump custom`), and lists of spheres `x y z r`.

use std::collections::HashMap;

use crate::lammps_data::{AXES, Atom, DataFile, Lines, split_comment};
use crate::words::{quoted, shortened};
use gshear_dem::failure::{Failure, Result};

/// What a dump must have, for messages.
const CUSTOM: &str =
    "dump custom with id type x y z radius, and for moving grains vx vy vz omegax omegay omegaz";

/// Line with which a list of spheres says its periods, as YADE writes it.
const PERIODIC: &str = "##PERIODIC::";

/// Whether a text is a dump.
pub(crate) fn is_dump(text: &str) -> bool {
    text.trim_start().starts_with("ITEM:")
}

/// Whether a text is a list of spheres: it says its periods as one, or its first row has four
/// numbers, or YADE's five.
pub(crate) fn is_list(text: &str) -> bool {
    let mut rows = text.lines().map(str::trim);
    let first =
        rows.find(|row| row.starts_with(PERIODIC) || !row.is_empty() && !row.starts_with('#'));
    let first = first.unwrap_or("");
    let words: Vec<&str> = first.split_whitespace().collect();
    let has_numbers = (4..=5).contains(&words.len()) && words.into_iter().all(is_number);
    has_numbers || first.starts_with(PERIODIC)
}

fn is_number(word: &str) -> bool {
    word.parse::<f64>().is_ok()
}

/// The spheres of clumps, of which a sample has none.
#[derive(Default)]
struct Clumps {
    /// The first sphere of each clump, and its line.
    first: HashMap<i64, (u64, usize)>,
}

impl Clumps {
    /// Adds a sphere whose clump the column `column` names; a negative number is none.
    fn add(&mut self, lines: &Lines<'_>, atom: &Atom, word: &str, column: &str) -> Result<()> {
        let number = word.parse::<f64>().ok().filter(|x| x.fract() == 0.0);
        let Some(clump) = number.map(|x| x as i64) else {
            let what = format!(
                "{} is no number of a clump ({column}); -1 is none",
                quoted(word)
            );
            return Err(lines.wrong(atom.line, &what));
        };
        if clump < 0 {
            return Ok(());
        }
        let Some((id, line)) = self.first.insert(clump, (atom.id, atom.line)) else {
            return Ok(());
        };
        let what = format!(
            "spheres {id} (line {line}) and {} form clump {clump} ({column}), but samples have no clumps; give a packing of single spheres, with -1 in this column or without it",
            atom.id
        );
        Err(lines.wrong(atom.line, &what))
    }
}

/// Reads a frame of a dump, counted from 0 on; by default the last one. `name` is what messages
/// call the file.
///
/// # Errors
/// `Failure::Input` with the line, what is wrong with it and what would be right.
pub(crate) fn parse(name: &str, text: &str, frame: Option<usize>) -> Result<DataFile> {
    let numbered = text.lines().enumerate();
    let starts: Vec<usize> = numbered
        .filter(|(_, line)| line.trim_end() == "ITEM: TIMESTEP")
        .map(|(k, _)| k)
        .collect();
    let Some(start) = frame.map_or(starts.last(), |frame| starts.get(frame)) else {
        return Err(Failure::input(format!(
            "{name}: has {} frames; give @0 … of one that it has, or none for the last",
            starts.len()
        )));
    };
    let mut lines = Lines::new(name, text);
    if let Some(before) = start.checked_sub(1) {
        lines.rest.nth(before);
    }
    let data = parse_frame(name, &mut lines);
    // A run that was killed leaves a part of its last frame.
    let is_cut_off = data.is_err() && lines.rest.next().is_none();
    data.map_err(|failure| match starts.len().checked_sub(2) {
        Some(before) if is_cut_off && starts.last() == Some(start) => {
            let file = match name.rsplit_once('@') {
                Some((file, _)) if frame.is_some() => file,
                _ => name,
            };
            Failure::input(format!(
                "{failure}; the last frame may be cut off: {file}@{before} is the one before it"
            ))
        }
        _ => failure,
    })
}

/// Reads the frame that begins here.
fn parse_frame(name: &str, lines: &mut Lines<'_>) -> Result<DataFile> {
    let (mut count, mut dump_box, mut bounded) = (None, None, [const { None }; 3]);
    loop {
        let Some((at, line)) = lines.next() else {
            return Err(Failure::input(format!(
                "{name}: the frame ends before ITEM: ATOMS; dump it again"
            )));
        };
        let item = line.strip_prefix("ITEM: ").unwrap_or_default();
        if item == "NUMBER OF ATOMS" {
            let row = lines.next().map_or("", |(_, row)| row);
            let Ok(number) = row.parse::<u64>() else {
                let what = format!("{} is no number of atoms", quoted(row));
                return Err(lines.wrong(at + 1, &what));
            };
            count = Some(number);
        } else if item.starts_with("BOX BOUNDS") {
            bounded = not_periodic(item);
            dump_box = Some(DumpBox::read(lines, at)?);
        } else if let (Some(names), Some(count), Some(dump_box)) =
            (item.strip_prefix("ATOMS "), count, &dump_box)
        {
            let columns = Columns::find(lines, at, names)?;
            let mut clumps = Clumps::default();
            let rows = (0..count).map(|_| columns.atom(lines, count, dump_box, &mut clumps));
            let atoms = rows.collect::<Result<Vec<Atom>>>()?;
            return Ok(DataFile {
                bounds: dump_box.bounds,
                tilt: dump_box.tilt,
                bounded,
                stream: None,
                types: atoms.iter().map(|a| a.kind).max().unwrap_or(1),
                atoms,
            });
        } else if ["TIMESTEP", "TIME", "UNITS"].contains(&item) {
            lines.next();
        } else {
            let what = format!(
                "{} is not expected here; a frame has ITEM: TIMESTEP, NUMBER OF ATOMS, BOX BOUNDS, ATOMS",
                shortened(line)
            );
            return Err(lines.wrong(at, &what));
        }
    }
}

/// What the heading of the bounds says of each axis that is not periodic. Old dumps say nothing.
fn not_periodic(item: &str) -> [Option<String>; 3] {
    let mut words = item.split_whitespace().rev();
    let mut kinds = [words.next(), words.next(), words.next()];
    kinds.reverse();
    let are_kinds = kinds.iter().all(|word| word.is_some_and(is_kind_of_bounds));
    if !are_kinds {
        return [const { None }; 3];
    }
    kinds.map(|kind| kind.filter(|kind| *kind != "pp").map(String::from))
}

/// Whether a word says of both ends of an axis how they bound it, such as `ff`.
fn is_kind_of_bounds(word: &str) -> bool {
    word.len() == 2 && word.bytes().all(|end| b"pfsm".contains(&end))
}

/// The box of a dump.
struct DumpBox {
    /// lo and hi along x, y, z.
    bounds: [[f64; 2]; 3],
    /// xy, xz, yz.
    tilt: [f64; 3],
}

impl DumpBox {
    /// Reads it, below the heading on this line. A dump says the bounds of a box at right angles
    /// around the tilted one.
    fn read(lines: &mut Lines<'_>, heading: usize) -> Result<Self> {
        let (mut bounds, mut tilt) = ([[0.0; 2]; 3], [0.0; 3]);
        let form = "lo hi, in a tilted box with xy, xz or yz";
        for axis in 0..3 {
            let (at, row) = lines.next().unwrap_or((heading, ""));
            let words: Vec<&str> = row.split_whitespace().collect();
            if words.len() > 3 {
                let what =
                    "a general triclinic box is not taken; dump one whose first edge is along x";
                return Err(lines.wrong(at, what));
            }
            bounds[axis] = lines.bounds(at, &words, form)?;
            if words.len() > 2 {
                tilt[axis] = lines.number(at, &words, 2, form)?;
            }
        }
        let [xy, xz, yz] = tilt;
        let along_x = [0.0, xy, xz, xy + xz];
        for (axis, offsets) in [(0, &along_x[..]), (1, &[0.0, yz])] {
            bounds[axis][0] -= offsets.iter().copied().fold(0.0, f64::min);
            bounds[axis][1] -= offsets.iter().copied().fold(0.0, f64::max);
            let [low, high] = bounds[axis];
            if low >= high {
                let what = "the box is tilted by more than its bounds are apart";
                return Err(lines.wrong(heading, what));
            }
        }
        Ok(Self { bounds, tilt })
    }

    /// The position that is these parts of its edges.
    fn unscaled(&self, scaled: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = scaled;
        let [xy, xz, yz] = self.tilt;
        let low = self.bounds.map(|[low, _]| low);
        let length = self.bounds.map(|[low, high]| high - low);
        [
            low[0] + x * length[0] + y * xy + z * xz,
            low[1] + y * length[1] + z * yz,
            low[2] + z * length[2],
        ]
    }
}

/// Places of the columns of the atoms.
struct Columns {
    count: usize,
    id: usize,
    kind: Option<usize>,
    position: [usize; 3],
    /// Whether positions are parts of the edges of the box.
    scaled: bool,
    size: usize,
    /// Diameter over the size.
    times: f64,
    velocity: [Option<usize>; 6],
    /// LIGGGHTS' number of a clump.
    clump: Option<usize>,
}

/// Its name.
const MULTISPHERE: &str = "id_multisphere";

/// The names of the columns, in their order.
struct ColumnNames<'n>(Vec<&'n str>);

impl ColumnNames<'_> {
    fn place(&self, name: &str) -> Option<usize> {
        self.0.iter().position(|word| *word == name)
    }

    /// The columns of positions, and whether they are parts of the edges of the box.
    fn positions(&self) -> Option<([usize; 3], bool)> {
        for suffix in ["", "u", "s", "su"] {
            let places = AXES.map(|axis| self.place(&format!("{axis}{suffix}")));
            if let [Some(x), Some(y), Some(z)] = places {
                return Some(([x, y, z], suffix.starts_with('s')));
            }
        }
        None
    }
}

/// A dump without a column.
fn lacks(lines: &Lines<'_>, at: usize, name: &str) -> Failure {
    let what = format!("there is no column {name}; write it by {CUSTOM}");
    lines.wrong(at, &what)
}

impl Columns {
    /// `names`: after ITEM: ATOMS, on line `at`.
    fn find(lines: &Lines<'_>, at: usize, names: &str) -> Result<Self> {
        let names = ColumnNames(names.split_whitespace().collect());
        let (position, scaled) = names
            .positions()
            .ok_or_else(|| lacks(lines, at, "x, y or z"))?;
        let (size, times) = match (names.place("radius"), names.place("diameter")) {
            (Some(radius), _) => (radius, 2.0),
            (None, Some(diameter)) => (diameter, 1.0),
            (None, None) => return Err(lacks(lines, at, "radius")),
        };
        let id = names.place("id").ok_or_else(|| lacks(lines, at, "id"))?;
        let velocity = ["vx", "vy", "vz", "omegax", "omegay", "omegaz"];
        Ok(Self {
            count: names.0.len(),
            id,
            kind: names.place("type"),
            position,
            scaled,
            size,
            times,
            velocity: velocity.map(|name| names.place(name)),
            clump: names.place(MULTISPHERE),
        })
    }

    fn atom(
        &self,
        lines: &mut Lines<'_>,
        count: u64,
        dump_box: &DumpBox,
        clumps: &mut Clumps,
    ) -> Result<Atom> {
        let (line, words) = lines.row(count, "ITEM: ATOMS")?;
        let form = "a row has a number for every column";
        if words.len() != self.count {
            return Err(lines.wrong(line, &format!("{} columns; {form}", words.len())));
        }
        let id = lines.id(line, &words[self.id..], form)?;
        let mut position = [0.0; 3];
        for (x, at) in position.iter_mut().zip(self.position) {
            *x = lines.number(line, &words, at, form)?;
        }
        if self.scaled {
            position = dump_box.unscaled(position);
        }
        let diameter = self.times * lines.number(line, &words, self.size, form)?;
        lines.check_sphere(line, id, diameter, 1.0)?;
        let kind = match self.kind {
            Some(at) => lines.number(line, &words, at, form)?,
            None => 1.0,
        };
        let mut velocity = [0.0; 6];
        for (v, at) in velocity.iter_mut().zip(self.velocity) {
            if let Some(at) = at {
                *v = lines.number(line, &words, at, form)?;
            }
        }
        let [vx, vy, vz, wx, wy, wz] = velocity;
        let atom = Atom {
            id,
            kind: kind as u32,
            diameter,
            density: 1.0,
            position,
            velocity: [vx, vy, vz],
            angular_velocity: [wx, wy, wz],
            line,
        };
        if let Some(at) = self.clump {
            clumps.add(lines, &atom, words[at], MULTISPHERE)?;
        }
        Ok(atom)
    }
}

/// Reads a list of spheres `x y z r`, as YADE's `SpherePack` writes it.
///
/// # Errors
/// As [`parse`].
pub(crate) fn parse_list(name: &str, text: &str) -> Result<DataFile> {
    let mut lines = Lines::new(name, text);
    let header = (1..)
        .zip(text.lines())
        .find_map(|(at, line)| Some((at, line.trim().strip_prefix(PERIODIC)?)));
    let Some((at, periods)) = header else {
        return Err(Failure::input(format!(
            "{name}: a list of spheres x y z r lacks its box; begin it with the line {PERIODIC} L_x L_y L_z"
        )));
    };
    let words: Vec<&str> = periods.split_whitespace().collect();
    let form = format!("write: {PERIODIC} L_x L_y L_z");
    let periods: [f64; 3] = lines.numbers(at, &words, 0, &form)?;
    if let Some(length) = periods.into_iter().find(|length| *length <= 0.0) {
        return Err(lines.wrong(at, &format!("a length of the box is {length:?}; {form}")));
    }
    let mut atoms = Vec::new();
    let mut clumps = Clumps::default();
    while let Some((line, row)) = lines.next() {
        let row = split_comment(row).0;
        let words: Vec<&str> = row.split_whitespace().collect();
        if words.len() > 5 || !words.iter().copied().all(is_number) {
            let what = format!(
                "{} is no row of a list of spheres, which is x y z r: four numbers with blanks between them, and YADE's clumpId after them",
                shortened(row)
            );
            return Err(lines.wrong(line, &what));
        }
        let [x, y, z, radius] = lines.numbers(line, &words, 0, "a row is x y z r")?;
        let id = atoms.len() as u64 + 1;
        lines.check_sphere(line, id, 2.0 * radius, 1.0)?;
        let atom = Atom {
            id,
            kind: 1,
            diameter: 2.0 * radius,
            density: 1.0,
            position: [x, y, z],
            line,
            ..Atom::default()
        };
        if let Some(clump) = words.get(4) {
            clumps.add(&lines, &atom, clump, "the fifth column, YADE's clumpId")?;
        }
        atoms.push(atom);
    }
    Ok(DataFile {
        bounds: periods.map(|length| [0.0, length]),
        types: 1,
        atoms,
        ..DataFile::default()
    })
}
