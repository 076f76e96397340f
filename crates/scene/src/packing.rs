//! A packing from a file instead of inserted grains: what the file says, as the grains of a run.

mod cell;
pub mod contacts;
mod copies;
mod file;
mod overlaps;
#[cfg(test)]
mod tests;

use std::path::Path;

use bytemuck::Zeroable;
use gshear_dem::contact::model::WALL;
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactState, GrainState, HeldState, Ids, body};

use crate::holes;
use crate::identity::hash;
use crate::insertion::{finish_walls, freeze_walls};
use crate::lammps_data::{self, Atom, DataFile};
use crate::materials::Materials;
use crate::sample::{Arrangement, PackingFile, Walls};
use crate::scene::Scene;
use crate::source::read_bytes;
use crate::walls::PlaneShear;

use cell::{PackingBox, check_ids, check_neighbours, check_periodic, check_room};
use contacts::ContactTable;
use copies::{find_stream, replicated};
pub use file::split_frame;
use file::{FORMAT, PackingPath, in_line, parsed, unpacked, wrong};
pub(crate) use overlaps::force_on_top;
use overlaps::{grain_contacts, plane_contacts};

/// Type of the grains of the bottom and of the top wall, where types say what is wall.
const BOTTOM_TYPE: u32 = 2;
const TOP_TYPE: u32 = 3;

/// How many grains a packing may have.
#[derive(Debug, Clone)]
pub struct GrainLimit {
    /// The number.
    pub most: u32,
    /// Whose limit it is, for the message.
    pub reason: String,
}

impl Default for GrainLimit {
    fn default() -> Self {
        Self {
            most: u32::MAX,
            reason: "a run can have".into(),
        }
    }
}

/// The grains of a file.
#[derive(Debug, Clone)]
pub struct Packing {
    /// What messages call the file.
    name: String,
    /// What a scene needs to know of the file.
    pub file: PackingFile,
    /// Sorted by id, as the rows of a run.
    atoms: Vec<Atom>,
    /// Whether it is the state of a run, whose types are known.
    is_state: bool,
    /// The contacts of another file.
    contacts: Option<ContactTable>,
}

impl Packing {
    /// Reads a file of spheres: disks where all are in the plane z = 0 or the box along z is no
    /// longer than the largest of them.
    ///
    /// # Errors
    /// `Failure::Input` with the line, what is wrong with it and what would be right.
    pub fn read(path: &Path, arrangement: Arrangement) -> Result<Self> {
        Self::read_at_most(path, arrangement, &GrainLimit::default())
    }

    /// [`read`](Self::read), refusing more grains than the limit before memory is taken for them.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_at_most(path: &Path, arrangement: Arrangement, limit: &GrainLimit) -> Result<Self> {
        let named = PackingPath::new(path)?;
        let (file, frame) = split_frame(path);
        let bytes = unpacked(&named.name, read_bytes(&file, FORMAT, u64::MAX)?)?;
        let mut content = hash(&bytes);
        if let Some(frame) = frame {
            content += &format!("@{frame}");
        }
        let data = parsed(&named.name, &bytes, frame)?;
        Self::arranged(&named, data, content, arrangement, limit)
    }

    /// The state of a run or a checkpoint as a packing.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn of_state(
        path: &Path,
        data: DataFile,
        arrangement: Arrangement,
        limit: &GrainLimit,
    ) -> Result<Self> {
        let named = PackingPath::new(path)?;
        let content = hash(lammps_data::write("", &[], &data).as_bytes());
        let packing = Self::arranged(&named, data, content, arrangement, limit)?;
        Ok(Self {
            is_state: true,
            ..packing
        })
    }

    fn arranged(
        named: &PackingPath,
        mut data: DataFile,
        content: String,
        arrangement: Arrangement,
        limit: &GrainLimit,
    ) -> Result<Self> {
        if arrangement.boundary.is_periodic() && data.stream.is_none() {
            find_stream(&mut data);
        }
        let data = replicated(&named.name, data, arrangement.copies, limit)?;
        let mut packing = Self::new(&named.name, &named.absolute, data, arrangement)?;
        packing.file.content = content;
        Ok(packing)
    }

    fn new(name: &str, path: &Path, data: DataFile, arrangement: Arrangement) -> Result<Self> {
        let count = u32::try_from(data.atoms.len()).ok().filter(|&n| n > 0);
        let count = count.ok_or_else(|| wrong(name, 0, "a packing has 1 to 4294967295 atoms"))?;
        let largest = data.atoms.iter().fold(0.0, |d: f64, a| d.max(a.diameter));
        let cell = PackingBox::new(name, &data, arrangement, largest)?;
        let up = cell.up();
        check_periodic(name, &data.bounded, up, arrangement)?;
        let mut atoms = data.atoms;
        let farthest = cell.farthest(&atoms);
        for a in &mut atoms {
            let line = a.line;
            cell.place(a).map_err(|what| wrong(name, line, what))?;
        }
        let periods = cell.periods();
        check_room(&atoms, &periods[..up], largest).map_err(|what| wrong(name, 0, what))?;
        check_neighbours(name, &atoms, up, largest)?;
        atoms.sort_by_key(|a| a.id);
        check_ids(name, &atoms)?;
        let radii: Vec<f64> = atoms.iter().map(|a| 0.5 * a.diameter).collect();
        let volumes = radii.iter().map(|r| cell.dimension.volume(*r));
        let file = PackingFile {
            path: path.into(),
            replicate: arrangement.copies.to_vec(),
            grains: count,
            radius_min: radii.iter().copied().fold(f64::INFINITY, f64::min),
            radius_max: 0.5 * largest,
            mean_diameter: 2.0 * radii.iter().sum::<f64>() / f64::from(count),
            mean_volume: volumes.sum::<f64>() / f64::from(count),
            length: periods[0],
            width: (up == 2).then_some(periods[1]),
            boxed: cell.boxed(),
            stream: data.stream.unwrap_or(0.0),
            edges: arrangement
                .boundary
                .edges(data.bounds[up], edges(&atoms, up)),
            farthest,
            wall_types: are_types(&atoms, TOP_TYPE),
            bottom_type: are_types(&atoms, BOTTOM_TYPE),
            content: String::new(),
            contacts: None,
            ids: Ids::new(atoms.iter().map(|a| (a.id - 1) as u32)),
        };
        Ok(Packing {
            name: name.into(),
            file,
            atoms,
            is_state: false,
            contacts: None,
        })
    }

    /// Adds the contacts of a table, if there is one.
    ///
    /// # Errors
    /// `Failure::Input` with the line of the table, what is wrong with it and what would be right.
    pub fn with_contacts(mut self, path: Option<&Path>) -> Result<Self> {
        if let Some(path) = path {
            let (table, file) = ContactTable::read(path)?;
            (self.contacts, self.file.contacts) = (Some(table), Some(Box::new(file)));
        }
        Ok(self)
    }

    /// The grains and contacts as the first stage of the scene takes them; see [`Self::grains`].
    ///
    /// # Errors
    /// As [`Self::grains`], and where a contact of the table is none of the scene.
    pub fn state(mut self, scene: &Scene) -> Result<HeldState> {
        let table = self.contacts.take();
        let ids: Vec<u64> = self.atoms.iter().map(|atom| atom.id).collect();
        let grains = self.grains(scene)?;
        let contacts: Result<Vec<ContactState>> = match table {
            Some(table) if !grains.is_empty() => table.states(scene, &grains, &ids),
            _ => Ok(Vec::new()),
        };
        Ok(HeldState {
            grains,
            contacts: contacts?,
        })
    }

    /// The grains as the first stage of the scene takes them: sheared as they are, with walls, or
    /// to be compressed between planes, all free, at rest and with the lowest edge at y = 0; for
    /// strain steps at rest.
    ///
    /// # Errors
    /// `Failure::Input` where types are no walls, no grain is free, or an overlap is outside the
    /// contact law.
    pub fn grains(self, scene: &Scene) -> Result<Vec<GrainState>> {
        let up = scene.dimension.axes() - 1;
        let mut grains = self.grains_at_rest(scene)?;
        if scene.packing().is_none() {
            return Ok(Vec::new());
        }
        let Some(plane_shear) = scene.stages.first_shear() else {
            self.check_overlaps(scene, &grains)?;
            return Ok(grains);
        };
        let PlaneShear { walls, pack, .. } = plane_shear;
        for (grain, atom) in grains.iter_mut().zip(&self.atoms) {
            if pack.skip {
                grain.velocity = atom.velocity;
                grain.angular_velocity = atom.angular_velocity;
            } else {
                // Smooth planes and smooth grains would let spins go on for ever.
                grain.position[up] -= self.file.edges[0];
            }
        }
        if pack.skip && plane_shear.boundary.has_grains() {
            let wall = scene.materials.wall;
            match walls {
                Walls::Layers => {
                    let planes = plane_shear.cuts(&scene.sample, self.file.edges);
                    freeze_walls(&mut grains, up, planes, wall);
                    let plugs = holes::plugs(scene, plane_shear, self.file.edges, &grains);
                    holes::close(&mut grains, &plugs, wall);
                }
                Walls::Types if plane_shear.boundary.bodies().count() == 1 => {
                    self.bottom_by_type(&mut grains, wall)?;
                }
                Walls::Types => self.walls_by_type(&mut grains, up, wall)?,
            }
            if grains.iter().all(|g| g.body != body::FREE) {
                let what = "all grains belong to walls, none is free";
                return Err(wrong(&self.name, 0, what));
            }
        }
        self.check_overlaps(scene, &grains)?;
        Ok(grains)
    }

    /// The materials of the atoms by their types. Types 2 and 3, if there are both, may be those of
    /// walls, which have no type of their material; type 2 alone that of a bottom.
    fn materials(&self, scene: &Scene) -> Result<Vec<u64>> {
        let is_bottom_by_type = scene.shear().is_some_and(|shear| {
            shear.walls == Walls::Types && shear.boundary.bodies().count() == 1
        });
        let has_walls = self.is_state
            || is_bottom_by_type
            || has_type(&self.atoms, BOTTOM_TYPE) && has_type(&self.atoms, TOP_TYPE);
        let materials = &scene.materials;
        let atoms = self.atoms.iter();
        atoms
            .map(|a| self.material(a, materials, has_walls))
            .collect()
    }

    /// The material of an atom; `has_walls`: some are of walls.
    fn material(&self, a: &Atom, materials: &Materials, has_walls: bool) -> Result<u64> {
        match materials.of_type(a.kind.into()) {
            Some(material) => Ok(material),
            None if materials.names.len() == 1 => Ok(0),
            None if has_walls && [BOTTOM_TYPE, TOP_TYPE].contains(&a.kind) => {
                Ok(materials.wall.unwrap_or(0))
            }
            None => {
                let (id, kind) = (a.id, a.kind);
                let what = format!(
                    "atom {id} is of type {kind}, which is that of no material; give a material atom_type = {kind}"
                );
                Err(wrong(&self.name, a.line, what))
            }
        }
    }

    /// The atoms as free grains at rest.
    fn grains_at_rest(&self, scene: &Scene) -> Result<Vec<GrainState>> {
        let materials = self.materials(scene)?;
        let atoms = self.atoms.iter().enumerate();
        let grains = atoms.map(|(id, a)| GrainState {
            id: id as u32,
            position: a.position,
            radius: 0.5 * a.diameter,
            material: materials[id],
            ..GrainState::zeroed()
        });
        Ok(grains.collect())
    }

    /// The bottom of a free surface: type 2.
    fn bottom_by_type(&self, grains: &mut [GrainState], wall: Option<u64>) -> Result<()> {
        if !has_type(&self.atoms, BOTTOM_TYPE) {
            let what = format!(
                "no atom is of type {BOTTOM_TYPE}; with walls = \"types\" that is the bottom wall"
            );
            return Err(wrong(&self.name, 0, what));
        }
        self.set_walls(grains, &[(BOTTOM_TYPE, body::BOTTOM)], wall);
        Ok(())
    }

    /// Gives the atoms of these types the bodies of walls, and frees the others.
    fn set_walls(&self, grains: &mut [GrainState], bodies: &[(u32, u32)], material: Option<u64>) {
        for (g, a) in grains.iter_mut().zip(&self.atoms) {
            let wall = bodies.iter().find(|(kind, _)| *kind == a.kind);
            g.body = wall.map_or(body::FREE, |(_, body)| *body);
        }
        finish_walls(grains, material);
    }

    fn walls_by_type(&self, grains: &mut [GrainState], up: usize, wall: Option<u64>) -> Result<()> {
        let bottom = self.atoms.iter().filter(|a| a.kind == BOTTOM_TYPE);
        let highest = bottom.max_by(|a, b| a.position[up].total_cmp(&b.position[up]));
        let top = self.atoms.iter().filter(|a| a.kind == TOP_TYPE);
        let lowest = top.min_by(|a, b| a.position[up].total_cmp(&b.position[up]));
        let (Some(highest), Some(lowest)) = (highest, lowest) else {
            let lacking = match highest {
                None => BOTTOM_TYPE,
                Some(_) => TOP_TYPE,
            };
            let what = format!(
                "no atom is of type {lacking}; with walls = \"types\" type {BOTTOM_TYPE} is the bottom wall and type {TOP_TYPE} the top wall"
            );
            return Err(wrong(&self.name, 0, what));
        };
        if lowest.position[up] <= highest.position[up] {
            let what = format!(
                "atom {} of type {TOP_TYPE} is not above atom {} of type {BOTTOM_TYPE}{}: the types are taken as top and bottom wall; \
                 give sample.walls = \"layers\" if they are not",
                lowest.id,
                highest.id,
                in_line(highest.line),
            );
            return Err(wrong(&self.name, lowest.line, what));
        }
        let walls = [(BOTTOM_TYPE, body::BOTTOM), (TOP_TYPE, body::TOP)];
        self.set_walls(grains, &walls, wall);
        Ok(())
    }

    /// Refuses overlaps outside the law.
    fn check_overlaps(&self, scene: &Scene, states: &[GrainState]) -> Result<()> {
        self.check_plane_overlaps(scene, states)?;
        self.check_grain_overlaps(scene, states)
    }

    /// Tells the first overlap with a flat wall that is outside the law, if one is.
    fn check_plane_overlaps(&self, scene: &Scene, states: &[GrainState]) -> Result<()> {
        for contact in plane_contacts(scene, states) {
            let radius = states[contact.grain].radius;
            let largest = scene.law.largest_overlap(radius, WALL * radius);
            if contact.overlap > largest {
                let atom = &self.atoms[contact.grain];
                let what = format!(
                    "atom {} overlaps the flat wall at {:?} m, a bound of the box, by {:.3e} m; the law {} takes {largest:.3e} m",
                    atom.id,
                    contact.plane,
                    contact.overlap,
                    scene.law.kind().name,
                );
                return Err(wrong(&self.name, atom.line, what));
            }
        }
        Ok(())
    }

    /// Tells the overlap of two grains that is furthest outside the law, if one is.
    fn check_grain_overlaps(&self, scene: &Scene, states: &[GrainState]) -> Result<()> {
        let mut worst = None;
        // Overlap over the largest one of the law.
        let mut greatest = 1.0;
        for contact in grain_contacts(scene, states) {
            let [a, b] = contact.grains.map(|g| &states[g]);
            let largest = scene.law.largest_overlap(a.radius, b.radius);
            if contact.overlap > greatest * largest {
                greatest = contact.overlap / largest;
                worst = Some((contact, largest));
            }
        }
        let Some((contact, largest)) = worst else {
            return Ok(());
        };
        let overlap = contact.overlap;
        let [a, b] = contact.grains.map(|g| &self.atoms[g]);
        let (first, second) = if a.line < b.line { (a, b) } else { (b, a) };
        let what = format!(
            "atom {} overlaps atom {}{} by {overlap:.3e} m, {:.1} % of the sum of their radii; the law {} takes {largest:.3e} m",
            first.id,
            second.id,
            in_line(second.line),
            200.0 * overlap / (a.diameter + b.diameter),
            scene.law.kind().name,
        );
        Err(wrong(&self.name, first.line, what))
    }
}

/// Whether an atom is of this type.
fn has_type(atoms: &[Atom], kind: u32) -> bool {
    atoms.iter().any(|a| a.kind == kind)
}

/// Whether the types are 1 … `last`, all of them.
fn are_types(atoms: &[Atom], last: u32) -> bool {
    (1..=last).all(|kind| has_type(atoms, kind)) && atoms.iter().all(|a| a.kind <= last)
}

/// Coordinates of the lowest and of the highest edge of an atom.
fn edges(atoms: &[Atom], up: usize) -> [f64; 2] {
    let mut edges = [f64::INFINITY, f64::NEG_INFINITY];
    for a in atoms {
        edges[0] = edges[0].min(a.position[up] - 0.5 * a.diameter);
        edges[1] = edges[1].max(a.position[up] + 0.5 * a.diameter);
    }
    edges
}
