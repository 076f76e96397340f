//! The contacts of a packing with their histories: a table beside the file of its grains, written
//! and read as CSV.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;

use gshear_dem::contact::model::Layout;
use gshear_dem::contact::stiffness::{SpringState, Stiffness};
use gshear_dem::contact::{AGE, History, TORQUES};
use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::failure::Result;
use gshear_dem::laws::LawSpace;
use gshear_dem::state::{Cell, ContactState, GrainState, HeldState, body, length};

use super::file::{unpacked, wrong};
use super::overlaps::grain_contacts;
use crate::identity::hash;
use crate::sample::ContactFile;
use crate::scene::Scene;
use crate::source::read_bytes;
use crate::walls::PlaneShear;
use crate::words::quoted;

/// What such a file is, for messages.
const FORMAT: &str = "a table of contacts (CSV)";
/// What stands for a flat wall in the column j: the bottom and the top.
const FLAT: [i64; 2] = [-1, -2];
/// The limits that a contact may be at, and whether it is idle.
const FLAGS: [&str; 4] = ["sliding", "rolling", "twisting", "idle"];
/// |F_t| over μ F_n, of the springs, beyond which a contact is told that does not slide.
const BEYOND: f64 = 1.01;

/// A column of a history.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct HistoryColumn {
    name: &'static str,
    /// Its place in a [`History`].
    place: usize,
}

/// The columns of the histories that a law keeps. The last k_t of disks is not among them: it
/// follows from the overlap.
fn history_columns(dimension: Dimensions, layout: &Layout) -> Vec<HistoryColumn> {
    const TURNS: [&str; TORQUES] = [
        "rolling_history_x",
        "rolling_history_y",
        "rolling_history_z",
        "twisting_history",
    ];
    let name = |place: usize| match (dimension, place) {
        (_, AGE) => Some("age"),
        (Dimensions::Two, 0) => Some("tangential_history"),
        (Dimensions::Two, 2) => Some("rolling_history"),
        (Dimensions::Two, _) => None,
        (Dimensions::Three, 0..3) if layout.history_unit == "m" => Some(DISPLACEMENTS[place]),
        (Dimensions::Three, 0..3) => Some(FORCES[place]),
        (Dimensions::Three, _) => TURNS.get(place - 3).copied(),
    };
    let places = layout.history.iter();
    let columns = places.filter_map(|&place| {
        let name = name(place)?;
        Some(HistoryColumn { name, place })
    });
    columns.collect()
}

/// Histories of the tangential spring of spheres: its elastic force, or its displacement.
const FORCES: [&str; 3] = [
    "tangential_history_x",
    "tangential_history_y",
    "tangential_history_z",
];
const DISPLACEMENTS: [&str; 3] = [
    "tangential_displacement_x",
    "tangential_displacement_y",
    "tangential_displacement_z",
];

/// A state whose contacts are written.
pub struct TabledState<'a> {
    /// Its scene.
    pub scene: &'a Scene,
    /// The cell.
    pub cell: Cell,
    /// Heights of flat walls (m), infinite where there is none.
    pub planes: Option<[f64; 2]>,
    /// Grains, by their ids.
    pub grains: &'a [GrainState],
    /// Contacts.
    pub contacts: &'a [ContactState],
}

/// The table of a state as text: names of the columns, then a line for each contact. `id`: that of
/// a grain in the file of the grains.
pub fn write(state: &TabledState<'_>, id: impl Fn(u32) -> u64) -> String {
    match state.scene.dimension {
        Dimensions::Two => write_in::<Two>(state, id),
        Dimensions::Three => write_in::<Three>(state, id),
    }
}

fn write_in<D: LawSpace>(state: &TabledState<'_>, id: impl Fn(u32) -> u64) -> String {
    let law = state.scene.force::<D>();
    let layout = law.layout();
    let histories = history_columns(state.scene.dimension, &layout);
    let components: &[&str] = match state.scene.dimension {
        Dimensions::Two => &["tangential_force"],
        Dimensions::Three => &[
            "tangential_force_x",
            "tangential_force_y",
            "tangential_force_z",
        ],
    };
    let names = ["i", "j", "overlap", "normal_force"].iter();
    let names = names.chain(components).copied();
    let names = names.chain(histories.iter().map(|column| column.name));
    let names: Vec<&str> = names.chain(FLAGS).collect();
    let mut text = names.join(",") + "\n";
    let mut contacts: Vec<&ContactState> = state.contacts.iter().collect();
    contacts.sort_by_key(|contact| (contact.i, contact.j));
    for contact in contacts {
        let springs = Springs::of::<D>(state, contact);
        let derivatives = springs.forces(law.as_ref(), contact.is_idle());
        let j = match state.grains.get(contact.j as usize) {
            Some(_) => id(contact.j).to_string(),
            None => FLAT[contact.j as usize - state.grains.len()].to_string(),
        };
        let _ = write!(text, "{},{j},{:?}", id(contact.i), springs.0.overlap);
        let [normal, tangential @ ..] = derivatives;
        let all = contact.all_histories();
        let numbers = [normal].into_iter();
        let numbers = numbers.chain(tangential.into_iter().take(components.len()));
        let numbers = numbers.chain(histories.iter().map(|column| all[column.place]));
        for number in numbers {
            let _ = write!(text, ",{number:?}");
        }
        let [slides, rolls, twists] = contact.limits();
        for flag in [slides, rolls, twists, Some(contact.is_idle())] {
            // Nothing where it is not known.
            let _ = match flag {
                Some(is_set) => write!(text, ",{}", u8::from(is_set)),
                None => write!(text, ","),
            };
        }
        text.push('\n');
    }
    text
}

/// The springs of a contact.
struct Springs(SpringState);

impl Springs {
    fn of<D: Dimension>(state: &TabledState<'_>, contact: &ContactState) -> Self {
        let a = &state.grains[contact.i as usize];
        let (material, radius, overlap) = match state.grains.get(contact.j as usize) {
            Some(b) => {
                let separation = state.cell.separation::<D>(&a.position, &b.position);
                let overlap = a.radius + b.radius - length(separation);
                (b.material, b.radius, overlap)
            }
            None => {
                let [low, high] = state.planes.unwrap_or([f64::NAN; 2]);
                let height = a.position[D::UP];
                let distance = if contact.j as usize == state.grains.len() {
                    height - low
                } else {
                    high - height
                };
                let wall = state.scene.flat_walls().map_or(0, |flat| flat.material);
                let radius = gshear_dem::contact::model::WALL * a.radius;
                (wall, radius, a.radius - distance)
            }
        };
        Self(SpringState {
            materials: [a.material, material],
            radii: [a.radius, radius],
            overlap,
            history: contact.history,
            torques: contact.torques,
            age: contact.age,
            // Forces of springs are not cut.
            limits: [Some(false); 3],
        })
    }

    /// F_n and F_t of the springs; nothing if the contact is idle.
    fn forces(&self, law: &dyn Stiffness, is_idle: bool) -> [f64; 4] {
        let derivatives = if is_idle {
            law.idle_derivatives(&self.0).unwrap_or_default()
        } else {
            law.derivatives(&self.0)
        };
        let [x, y, z] = derivatives.tangential.value;
        [derivatives.normal, x, y, z]
    }
}

/// The contacts of a file.
#[derive(Debug, Clone)]
pub(super) struct ContactTable {
    /// What messages call the file.
    name: String,
    /// The names of the columns.
    names: Vec<String>,
    rows: Vec<ContactRow>,
}

/// A contact, as the file has it.
#[derive(Debug, Clone)]
struct ContactRow {
    /// Line of the file, from 1.
    line: usize,
    /// i and j.
    ids: [i64; 2],
    /// The values of all columns; NaN where nothing is.
    values: Vec<f64>,
}

impl ContactTable {
    /// Reads a table, and what a scene knows of its file.
    ///
    /// # Errors
    /// `Failure::Input` with the line, what is wrong with it and what would be right.
    pub(super) fn read(path: &Path) -> Result<(Self, ContactFile)> {
        let name = path.display().to_string();
        let bytes = unpacked(&name, read_bytes(path, FORMAT, u64::MAX)?)?;
        let absolute = std::path::absolute(path)
            .map_err(|e| wrong(&name, 0, format!("cannot be read: {e}")))?;
        if absolute.to_str().is_none() {
            let what = format!("the path {} is not UTF-8; rename it", absolute.display());
            return Err(wrong(&name, 0, what));
        }
        let file = ContactFile {
            path: absolute,
            content: hash(&bytes),
        };
        let text = String::from_utf8_lossy(&bytes);
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        Ok((Self::parse(&name, text)?, file))
    }

    fn parse(name: &str, text: &str) -> Result<Self> {
        let lines = text.lines().enumerate();
        let lines = lines.map(|(k, line)| (k + 1, line.trim()));
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let Some((at, heading)) = lines.next() else {
            let what = "is empty; give a table of contacts with the columns i and j";
            return Err(wrong(name, 0, what));
        };
        let names: Vec<String> = heading.split(',').map(|name| name.trim().into()).collect();
        if let Some((_, again)) = (names.iter().enumerate())
            .find(|(k, column)| !column.is_empty() && names[..*k].contains(column))
        {
            let what = format!("has two columns {}; leave one out", quoted(again));
            return Err(wrong(name, at, what));
        }
        let place = |column: &str| {
            let found = names.iter().position(|known| known == column);
            found.ok_or_else(|| {
                let what = format!(
                    "lacks the column {column}: the first line names the columns, i and j are the ids of the grains of a contact"
                );
                wrong(name, at, what)
            })
        };
        let places = [place("i")?, place("j")?];
        let rows = lines.map(|(line, text)| Self::row(name, &names, places, line, text));
        Ok(Self {
            name: name.into(),
            rows: rows.collect::<Result<_>>()?,
            names,
        })
    }

    fn row(
        name: &str,
        names: &[String],
        places: [usize; 2],
        line: usize,
        text: &str,
    ) -> Result<ContactRow> {
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        if cells.len() != names.len() {
            let what = format!(
                "{} columns, but the first line names {}; give each its value",
                cells.len(),
                names.len()
            );
            return Err(wrong(name, line, what));
        }
        let mut ids = [0; 2];
        for (id, place) in ids.iter_mut().zip(places) {
            *id = cells[place].parse().map_err(|_| {
                let what = format!(
                    "{} must be the id of a grain, a whole number, found {}",
                    names[place],
                    quoted(cells[place])
                );
                wrong(name, line, what)
            })?;
        }
        let is_known = |column: &str| {
            let histories = [&FORCES[..], &DISPLACEMENTS, &["age"]].concat();
            histories.contains(&column) || column.contains("_history") || FLAGS.contains(&column)
        };
        let mut values = Vec::with_capacity(cells.len());
        for (cell, column) in cells.iter().zip(names) {
            // Columns of others may hold anything.
            let value = match cell.parse::<f64>() {
                Ok(value) if value.is_finite() => value,
                _ if !is_known(column) || cell.is_empty() => f64::NAN,
                _ => {
                    let what = format!("{column} must be a number, found {}", quoted(cell));
                    return Err(wrong(name, line, what));
                }
            };
            values.push(value);
        }
        Ok(ContactRow { line, ids, values })
    }

    /// The contacts between these grains, which have the ids `ids` in the file of the grains, in
    /// the same order; those of two grains of one wall, which have no forces, are left out.
    ///
    /// # Errors
    /// `Failure::Input` with the line of a contact that is none, and of a history that the law does
    /// not have.
    pub(super) fn states(
        &self,
        scene: &Scene,
        grains: &[GrainState],
        ids: &[u64],
    ) -> Result<Vec<ContactState>> {
        match scene.dimension {
            Dimensions::Two => self.states_in::<Two>(scene, grains, ids),
            Dimensions::Three => self.states_in::<Three>(scene, grains, ids),
        }
    }

    fn states_in<D: LawSpace>(
        &self,
        scene: &Scene,
        grains: &[GrainState],
        ids: &[u64],
    ) -> Result<Vec<ContactState>> {
        let law = scene.force::<D>();
        let columns = history_columns(scene.dimension, &law.layout());
        let mut places = Vec::new();
        for column in &columns {
            let found = self.names.iter().position(|name| name == column.name);
            places.push(found.ok_or_else(|| self.lacks(column, scene))?);
        }
        let flags = FLAGS.map(|flag| self.names.iter().position(|name| name == flag));
        let planes = scene.shear().and_then(PlaneShear::planes_of_file);
        let state = TabledState {
            scene,
            cell: scene.cell(),
            planes,
            grains,
            contacts: &[],
        };
        let mut seen: HashMap<[u32; 2], usize> = HashMap::with_capacity(self.rows.len());
        let mut states = Vec::with_capacity(self.rows.len());
        for row in &self.rows {
            let [i, j] = self.pair(row, ids, planes)?;
            if let Some(first) = seen.insert([i, j], row.line) {
                let [i, j] = row.ids;
                let what = format!("the contact of {i} and {j} was on line {first} already");
                return Err(self.wrong(row, what));
            }
            let mut numbers = History::default();
            for (column, place) in columns.iter().zip(&places) {
                let value = row.values[*place];
                if value.is_nan() {
                    let what = format!("{} is missing; give 0 where there is none", column.name);
                    return Err(self.wrong(row, what));
                }
                numbers[column.place] = value;
            }
            let mut is_at = [None; 4];
            for (is_at, place) in is_at.iter_mut().zip(flags) {
                *is_at = match place.map(|place| row.values[place]) {
                    None => None,
                    Some(value) if value.is_nan() => None,
                    Some(0.0) => Some(false),
                    Some(1.0) => Some(true),
                    Some(value) => {
                        let what = format!(
                            "sliding, rolling, twisting and idle are 0 or 1, found {value:?}"
                        );
                        return Err(self.wrong(row, what));
                    }
                };
            }
            let [slides, rolls, twists, idle] = is_at;
            let contact = ContactState {
                limits: ContactState::stored([slides, rolls, twists], idle.unwrap_or(false)),
                ..ContactState::new(i, j, [0.0; 3])
            }
            .with_histories(numbers);
            let springs = Springs::of::<D>(&state, &contact).0;
            let gap = law.gap(springs.materials, springs.radii);
            // NaN touches nothing.
            let touches = springs.overlap > -gap;
            if !touches {
                let [i, j] = row.ids;
                let what = format!(
                    "{i} and {j} do not touch: they are {:.3e} m apart; delete the line, or give the grains of this table as sample.packing",
                    -springs.overlap
                );
                return Err(self.wrong(row, what));
            }
            let [of_i, of_j] = [i, j].map(|g| grains.get(g as usize).map(|g| g.body));
            let is_within_wall = of_i == of_j && of_i != Some(body::FREE);
            if !is_within_wall {
                states.push(contact);
            }
        }
        states.sort_by_key(|contact| (contact.i, contact.j));
        Ok(states)
    }

    /// The grains of a row, by their places; beyond them the flat walls.
    fn pair(&self, row: &ContactRow, ids: &[u64], planes: Option<[f64; 2]>) -> Result<[u32; 2]> {
        let place = |id: i64| {
            let found = u64::try_from(id)
                .ok()
                .and_then(|id| ids.binary_search(&id).ok());
            let found = found.map(|place| place as u32);
            found
                .ok_or_else(|| self.wrong(row, format!("there is no grain {id} in sample.packing")))
        };
        let [i, j] = row.ids;
        if let Some(side) = FLAT.iter().position(|wall| *wall == j) {
            let is_there = planes.is_some_and(|planes| planes[side].is_finite());
            if !is_there {
                let wall = ["bottom", "top"][side];
                let what = format!("j = {j} is a flat {wall} wall, which the scene does not have");
                return Err(self.wrong(row, what));
            }
            return Ok([place(i)?, (ids.len() + side) as u32]);
        }
        if i >= j {
            let what = format!(
                "i must be less than j, found {i} and {j}; histories are those of forces on i, so turn their signs where they are exchanged"
            );
            return Err(self.wrong(row, what));
        }
        Ok([place(i)?, place(j)?])
    }

    fn wrong(&self, row: &ContactRow, what: String) -> gshear_dem::failure::Failure {
        wrong(&self.name, row.line, what)
    }

    /// The failure of a table without a column of the law.
    fn lacks(&self, column: &HistoryColumn, scene: &Scene) -> gshear_dem::failure::Failure {
        let (name, law) = (column.name, scene.law.kind().name);
        let has = |name: &str| self.names.iter().any(|known| known == name);
        let others = [
            (FORCES[0], "forces"),
            (DISPLACEMENTS[0], "displacements"),
            ("tangential_history", "forces of disks"),
        ];
        let other = others.iter().find(|(other, _)| has(other));
        let what = match other {
            Some((_, kind)) if column.place < 3 => format!(
                "lacks the column {name}, the history of the law {law} of the scene; the file has {kind} of tangential springs, of another law"
            ),
            _ => format!(
                "lacks the column {name}, a history of the law {law} of the scene; give it, 0 where there is none"
            ),
        };
        wrong(&self.name, 0, what)
    }
}

/// A sentence if contacts of a table begin beyond the limit of friction, or if grains touch that it
/// does not have.
pub fn doubts(scene: &Scene, state: &HeldState) -> Option<String> {
    let file = scene.packing()?.contacts.as_ref()?;
    match scene.dimension {
        Dimensions::Two => doubts_in::<Two>(scene, state, file),
        Dimensions::Three => doubts_in::<Three>(scene, state, file),
    }
}

fn doubts_in<D: LawSpace>(scene: &Scene, state: &HeldState, file: &ContactFile) -> Option<String> {
    let HeldState { grains, contacts } = state;
    let law = scene.force::<D>();
    let tabled = TabledState {
        scene,
        cell: scene.cell(),
        planes: scene.shear().and_then(PlaneShear::planes_of_file),
        grains,
        contacts,
    };
    let known: std::collections::HashSet<[u32; 2]> = contacts
        .iter()
        .map(|contact| [contact.i, contact.j])
        .collect();
    let touching = grain_contacts(scene, grains);
    let unknown = touching.iter().filter(|contact| {
        let [a, b] = contact.grains.map(|g| &grains[g]);
        let is_within_wall = a.body == b.body && a.body != body::FREE;
        !is_within_wall && !known.contains(&contact.grains.map(|g| g as u32))
    });
    let unknown = unknown.count();
    let beyond = contacts.iter().filter(|contact| {
        let [slides, ..] = contact.limits();
        let springs = Springs::of::<D>(&tabled, contact);
        let [normal, x, y, z] = springs.forces(law.as_ref(), contact.is_idle());
        let friction = scene.materials.friction(springs.0.materials);
        let limit = BEYOND * friction * normal.max(0.0);
        slides != Some(true) && x * x + y * y + z * z > limit * limit
    });
    let beyond = beyond.count();
    let mut sentences = Vec::new();
    if beyond > 0 {
        sentences.push(format!(
            "tangential springs of {beyond} of {} contacts have more than friction allows, and slip to it in the first step; if they are to slide, give the column sliding",
            contacts.len()
        ));
    }
    if unknown > 0 {
        sentences.push(format!(
            "{unknown} pairs of grains touch that are not in the table; they begin without a history"
        ));
    }
    if sentences.is_empty() {
        return None;
    }
    Some(format!("{}: {}", file.path.display(), sentences.join("; ")))
}
