//! A packing from a file in place of inserted grains: what the file says, as the grains of a run.

use std::collections::HashMap;
use std::fmt::Display;
use std::io::Read;
use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use flate2::read::MultiGzDecoder;

use crate::holes;
use crate::identity::hash;
use crate::insertion::{finish_walls, freeze_walls};
use crate::lammps_data::{self, AXES, Atom, DataFile};
use crate::lammps_dump;
use crate::sample::{Arrangement, PackingFile, Walls};
use crate::scene::{Boundary, Scene};
use crate::source::read_bytes;
use crate::walls::PlaneShear;
use gshear_dem::contact::model::WALL;
use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::neighbour::{self, Cutoff, LocalExtent};
use gshear_dem::simd::Isa;
use gshear_dem::state::{Confinement, GrainState, Grains, Ids, body, length, nearest_image};

/// Type of the grains of the bottom and of the top wall, where types say what is wall.
const BOTTOM_TYPE: u32 = 2;
const TOP_TYPE: u32 = 3;

/// Cells of the largest diameter in the box of a packing, for each of its grains. In a box with
/// more the grains are far apart, and cells would take more memory than they.
const MOST_CELLS: f64 = 1e4;

/// Squares or cubes of their diameters over the room that the atoms of a cell may have: more than
/// any overlap of a law allows.
const MOST_FILLED: f64 = 4.0;

/// Periods from the box beyond which a position says nothing about the place in the box.
const MOST_PERIODS: f64 = 1e6;

/// The greatest id of an atom, copies included: one less is a u32.
const LAST_ID: u64 = 1 << 32;

/// The formats, for messages.
const FORMAT: &str = "a LAMMPS data file or dump, a list x y z r, or a run";

/// Bytes of a packed file over its own: a file may not fill the memory with zeros.
const MOST_UNPACKED: u64 = 100;

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

/// Refuses a file that messages call `name`, with the line if that is not 0: a state has none.
fn wrong(name: &str, line: usize, what: impl Display) -> Failure {
    Failure::input(match line {
        0 => format!("{name}: {what}"),
        line => format!("{name}:{line}: {what}"),
    })
}

/// The line of another atom, for messages; nothing of a state that is no text.
fn in_line(line: usize) -> String {
    match line {
        0 => String::new(),
        line => format!(" (line {line})"),
    }
}

/// The axis along which a cell is sheared: y of disks, which are in the plane z = 0, z of spheres.
fn gradient(atoms: &[Atom]) -> usize {
    1 + usize::from(atoms.iter().any(|atom| atom.position[2] != 0.0))
}

/// Finds with what velocity along x (m/s) of the image above the grains stream: by the straight
/// line of least squares, weighed by volume, through their velocities over the height. Takes from
/// them the velocity of that line at the lower edge, at which images of the bottom rest.
fn find_stream(data: &mut DataFile) {
    let up = gradient(&data.atoms);
    let [low, high] = data.bounds[up];
    // Weight, height and velocity.
    let of_atom = |atom: &Atom| {
        let volume = atom.diameter.powi(1 + up as i32);
        (volume, atom.position[up] - low, atom.velocity[0])
    };
    let mut sums = [0.0; 3];
    // In the order of their ids, which a file need not have.
    let mut atoms: Vec<&Atom> = data.atoms.iter().collect();
    atoms.sort_by_key(|atom| atom.id);
    for (weight, height, velocity) in atoms.iter().map(|atom| of_atom(atom)) {
        for (sum, value) in sums.iter_mut().zip([1.0, height, velocity]) {
            *sum += weight * value;
        }
    }
    let [height, velocity] = [sums[1], sums[2]].map(|sum| sum / sums[0]);
    let (mut above, mut below) = (0.0, 0.0);
    for (weight, at, v) in atoms.iter().map(|atom| of_atom(atom)) {
        above += weight * (at - height) * (v - velocity);
        below += weight * (at - height) * (at - height);
    }
    let rate = if below > 0.0 { above / below } else { 0.0 };
    let drift = velocity - rate * height;
    for atom in &mut data.atoms {
        atom.velocity[0] -= drift;
    }
    data.stream = Some(rate * (high - low));
}

/// So many copies beside each other along the axes, in a box as many times as long. Those above
/// each other stream as images do.
fn replicated(
    name: &str,
    mut data: DataFile,
    copies: [u32; 3],
    limit: &GrainLimit,
) -> Result<DataFile> {
    let number: u128 = copies.map(u128::from).iter().product();
    let grains = data.atoms.len() as u128 * number;
    if grains > limit.most.into() {
        let of_copies = match number {
            1 => String::new(),
            _ => {
                let copies = copies.map(|n| n.to_string()).join(" × ");
                format!(" in {copies} copies (sample.replicate)")
            }
        };
        let (atoms, GrainLimit { most, reason }) = (data.atoms.len(), limit);
        let what = format!(
            "has {atoms} atoms{of_copies}: {grains} grains are more than the {most} that {reason}; give fewer"
        );
        return Err(wrong(name, 0, what));
    }
    let too_long = |axis: usize| {
        let [low, high] = data.bounds[axis];
        !(low + (high - low) * f64::from(copies[axis])).is_finite()
    };
    if let Some(axis) = (0..3).find(|axis| too_long(*axis)) {
        let (copies, axis) = (copies[axis], AXES[axis]);
        let what = format!(
            "{copies} copies of the box along {axis} (sample.replicate) are longer than a number can say; give fewer"
        );
        return Err(wrong(name, 0, what));
    }
    let up = gradient(&data.atoms);
    for (axis, copies) in copies.into_iter().enumerate() {
        let faster = data.stream.filter(|_| axis == up).unwrap_or(0.0);
        let [low, high] = data.bounds[axis];
        let [xy, xz, yz] = data.tilt;
        let mut edge = [[0.0; 3], [xy, 0.0, 0.0], [xz, yz, 0.0]][axis];
        edge[axis] = high - low;
        let once = data.atoms.clone();
        let last = once.iter().map(|atom| atom.id).max().unwrap_or(0);
        for copy in 1..copies {
            data.atoms.extend(once.iter().map(|atom| {
                let mut atom = *atom;
                for (x, edge) in atom.position.iter_mut().zip(edge) {
                    *x += edge * f64::from(copy);
                }
                atom.velocity[0] += faster * f64::from(copy);
                // As LAMMPS numbers copies.
                let before = last.saturating_mul(u64::from(copy));
                atom.id = atom.id.saturating_add(before);
                atom
            }));
        }
        data.bounds[axis][1] = low + (high - low) * f64::from(copies);
        if axis == up {
            data.stream = data.stream.map(|stream| stream * f64::from(copies));
        }
        for tilt in [&[][..], &[0], &[1, 2]][axis] {
            data.tilt[*tilt] *= f64::from(copies);
        }
    }
    Ok(data)
}

/// A path that ends in `@` and a number, if no file has this name: the file and the frame.
pub fn split_frame(path: &Path) -> (PathBuf, Option<usize>) {
    let text = path.to_str().filter(|_| !path.exists());
    let split = text.and_then(|text| {
        let (file, frame) = text.rsplit_once('@')?;
        Some((file.into(), frame.parse().ok()?))
    });
    split.map_or_else(|| (path.into(), None), |(file, frame)| (file, Some(frame)))
}

/// What messages call a file, and its absolute path.
fn named(path: &Path) -> Result<(String, PathBuf)> {
    let name = path.display().to_string();
    let absolute =
        std::path::absolute(path).map_err(|e| wrong(&name, 0, format!("cannot be read: {e}")))?;
    // The scene and the checkpoints hold the path as text.
    if absolute.to_str().is_none() {
        let what = format!("the path {} is not UTF-8; rename it", absolute.display());
        return Err(wrong(&name, 0, what));
    }
    Ok((name, absolute))
}

/// What the bytes of a file say, in any of the formats.
fn parsed(name: &str, bytes: &[u8], frame: Option<usize>) -> Result<DataFile> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(wrong(name, 0, "is text in UTF-16; save it as UTF-8"));
    }
    // Comments may be in any other encoding.
    let text = String::from_utf8_lossy(bytes);
    // A byte order mark says nothing in UTF-8.
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    if lammps_dump::is_dump(text) {
        return lammps_dump::parse(name, text, frame);
    }
    if let Some(frame) = frame {
        let what = format!("holds one state; leave out @{frame}");
        return Err(wrong(name, 0, what));
    }
    if lammps_dump::is_list(text) {
        return lammps_dump::parse_list(name, text);
    }
    lammps_data::parse(name, text)
}

/// The bytes of a file, unpacked if gzip has packed them.
fn unpacked(name: &str, bytes: Vec<u8>) -> Result<Vec<u8>> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let most = MOST_UNPACKED * bytes.len() as u64;
    let mut text = Vec::new();
    let read = MultiGzDecoder::new(&bytes[..])
        .take(most + 1)
        .read_to_end(&mut text);
    let what = match read {
        Err(e) => format!("cannot be unpacked: {e}; pack it again with gzip"),
        Ok(_) if text.len() as u64 > most => format!(
            "has more than {MOST_UNPACKED} times its bytes when unpacked; unpack it with gunzip"
        ),
        Ok(_) => return Ok(text),
    };
    Err(wrong(name, 0, what))
}

/// Refuses a grain that is out of the box or moves out of the plane of disks, and puts it into the
/// periods: coordinates along them begin at 0. `up`: the last axis; `offset`: of a box that is
/// periodic along that, too.
fn place(
    a: &mut Atom,
    up: usize,
    bounds: &[[f64; 2]; 3],
    offset: Option<f64>,
) -> Result<(), String> {
    let out_of_plane = [
        ("z", a.position[2]),
        ("vz", a.velocity[2]),
        ("wx", a.angular_velocity[0]),
        ("wy", a.angular_velocity[1]),
    ];
    let moving = out_of_plane.into_iter().find(|(_, value)| *value != 0.0);
    if let Some((what, value)) = moving.filter(|_| up == 1) {
        return Err(format!(
            "{what} of atom {} is {value:?}; in a packing of disks it is 0",
            a.id
        ));
    }
    let (height, [bottom, top]) = (a.position[up], bounds[up]);
    if offset.is_none() && !(bottom..=top).contains(&height) {
        let axis = AXES[up];
        return Err(format!(
            "atom {} is out of the box: {axis} = {height:?}, the box has {bottom:?} {top:?} {axis}lo {axis}hi",
            a.id
        ));
    }
    // The last axis first: its images are displaced along x.
    for axis in (0..=up).rev().skip(usize::from(offset.is_none())) {
        let [low, high] = bounds[axis];
        let (inside, period) = (a.position[axis] - low, high - low);
        let is_near = inside.abs() <= MOST_PERIODS * period;
        if !is_near {
            let name = AXES[axis];
            return Err(format!(
                "{name} of atom {} is {:?}, more than {MOST_PERIODS:e} periods from the box, {low:?} {high:?} {name}lo {name}hi; give a place in the box",
                a.id, a.position[axis]
            ));
        }
        if (0.0..period).contains(&inside) {
            a.position[axis] = inside;
            continue;
        }
        let (mut wrapped, mut images) = (inside.rem_euclid(period), (inside / period).floor());
        // A little below zero rounds to the period.
        if wrapped >= period {
            (wrapped, images) = (0.0, images + 1.0);
        }
        a.position[axis] = wrapped;
        if axis == up {
            a.position[0] -= images * offset.unwrap_or_default();
        }
    }
    Ok(())
}

/// Refuses a file that says that its box ends along an axis along which the sample is periodic:
/// grains at its two ends would touch each other. `up`: the last axis.
fn check_periodic(
    name: &str,
    bounded: &[Option<String>; 3],
    up: usize,
    arrangement: Arrangement,
) -> Result<()> {
    let periodic = if arrangement.boxed { up + 1 } else { up };
    for (axis, bounded) in AXES.iter().zip(bounded).take(periodic) {
        if let Some(kind) = bounded {
            let what = format!(
                "the box is not periodic along {axis} ({kind} in ITEM: BOX BOUNDS), but the sample is; give a packing that is periodic there, or write pp if this one is"
            );
            return Err(wrong(name, 0, what));
        }
    }
    Ok(())
}

/// Refuses grains that are few for their box.
fn check_room(atoms: &[Atom], periods: &[f64], largest: f64) -> Result<(), String> {
    let count = atoms.len();
    let heights = || atoms.iter().map(|a| a.position[periods.len()]);
    let tall =
        heights().fold(f64::NEG_INFINITY, f64::max) - heights().fold(f64::INFINITY, f64::min);
    let room = |length: f64| (length / largest).max(1.0);
    let rooms = periods
        .iter()
        .fold(room(tall), |all, length| all * room(*length));
    let is_filled = rooms <= MOST_CELLS * count as f64;
    if is_filled {
        return Ok(());
    }
    Err(format!(
        "{count} atoms are too few for their box, in which {rooms:.1e} of the largest diameter, {largest:?}, have room; check the units of lengths and diameters"
    ))
}

/// Refuses atoms that overlap too many neighbours: the pairs might not fit into memory.
fn check_neighbours(name: &str, atoms: &[Atom], up: usize, largest: f64) -> Result<()> {
    // What has its centre in a cell is within twice its width.
    let room = 2f64.powi(1 + up as i32) * MOST_FILLED;
    let mut filled: HashMap<[i64; 3], f64> = HashMap::new();
    for a in atoms {
        let cell = a.position.map(|x| (x / largest).floor() as i64);
        let filled = filled.entry(cell).or_default();
        *filled += (a.diameter / largest).powi(1 + up as i32);
        if *filled > room {
            let what = format!(
                "atom {} overlaps too many neighbours; check the units of lengths and diameters",
                a.id
            );
            return Err(wrong(name, a.line, what));
        }
    }
    Ok(())
}

/// Disks if all are in the plane z = 0, or in a box no thicker than `thinnest` (m).
fn dimension_of(
    name: &str,
    atoms: &[Atom],
    [low, high]: [f64; 2],
    thinnest: f64,
) -> Result<Dimensions> {
    let planar = gradient(atoms) == 1 || high - low <= (1.0 + 1e-9) * thinnest;
    if !planar {
        return Ok(Dimensions::Three);
    }
    if low > 0.0 || high < 0.0 {
        let what = format!(
            "the box is beside the plane z = 0, in which the disks are: {low:?} {high:?} zlo zhi"
        );
        return Err(wrong(name, 0, what));
    }
    Ok(Dimensions::Two)
}

/// Refuses ids of sorted atoms that occur twice or are too great.
fn check_ids(name: &str, atoms: &[Atom]) -> Result<()> {
    if let Some([first, again]) = atoms.array_windows().find(|[a, b]| a.id == b.id) {
        let what = format!("atom {} was on line {} already", again.id, first.line);
        return Err(wrong(name, again.line, what));
    }
    let last = atoms[atoms.len() - 1].id;
    if last > LAST_ID {
        let what = format!(
            "the id of atom {last} is greater than {LAST_ID}; number the atoms of the file from 1 on"
        );
        return Err(wrong(name, 0, what));
    }
    Ok(())
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
        let (name, absolute) = named(path)?;
        let (file, frame) = split_frame(path);
        let bytes = unpacked(&name, read_bytes(&file, FORMAT, u64::MAX)?)?;
        let mut content = hash(&bytes);
        if let Some(frame) = frame {
            content += &format!("@{frame}");
        }
        let data = parsed(&name, &bytes, frame)?;
        Self::arranged((&name, &absolute), data, content, arrangement, limit)
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
        let (name, absolute) = named(path)?;
        let content = hash(lammps_data::write("", &[], &data).as_bytes());
        let packing = Self::arranged((&name, &absolute), data, content, arrangement, limit)?;
        Ok(Self {
            is_state: true,
            ..packing
        })
    }

    fn arranged(
        (name, path): (&str, &Path),
        mut data: DataFile,
        content: String,
        arrangement: Arrangement,
        limit: &GrainLimit,
    ) -> Result<Self> {
        if arrangement.boxed && data.stream.is_none() {
            find_stream(&mut data);
        }
        let data = replicated(name, data, arrangement.copies, limit)?;
        let mut packing = Self::new(name, path, data, arrangement)?;
        packing.file.content = content;
        Ok(packing)
    }

    fn new(name: &str, path: &Path, data: DataFile, arrangement: Arrangement) -> Result<Self> {
        let mut atoms = data.atoms;
        let count = u32::try_from(atoms.len()).ok().filter(|&n| n > 0);
        let count = count.ok_or_else(|| wrong(name, 0, "a packing has 1 to 4294967295 atoms"))?;
        let largest = atoms.iter().fold(0.0, |d: f64, a| d.max(a.diameter));
        // Flat walls may hold a single layer of spheres.
        let thinnest = if arrangement.flat { 0.0 } else { largest };
        let dimension = dimension_of(name, &atoms, data.bounds[2], thinnest)?;
        let up = dimension.axes() - 1;
        let mut tilt = data.tilt;
        // Images along the last axis may be displaced along x in a box.
        let offset = arrangement.boxed.then(|| std::mem::take(&mut tilt[up - 1]));
        if tilt != [0.0; 3] {
            let what = if arrangement.boxed {
                "the box is tilted otherwise than by a shear along x (xy of disks, xz of spheres); give one that is not"
            } else {
                "the box is tilted; between walls it must be a rectangle"
            };
            return Err(wrong(name, 0, what));
        }
        check_periodic(name, &data.bounded, up, arrangement)?;
        let of_atoms = atoms.iter().flat_map(|a| &a.position[..=up]);
        let coordinates = of_atoms.chain(data.bounds[..up].as_flattened());
        let farthest = coordinates.fold(0.0, |most: f64, x| most.max(x.abs()));
        for a in &mut atoms {
            let line = a.line;
            let placed = place(a, up, &data.bounds, offset);
            placed.map_err(|what| wrong(name, line, what))?;
        }
        let periods = data.bounds.map(|[low, high]| high - low);
        check_room(&atoms, &periods[..up], largest).map_err(|what| wrong(name, 0, what))?;
        check_neighbours(name, &atoms, up, largest)?;
        atoms.sort_by_key(|a| a.id);
        check_ids(name, &atoms)?;
        let radii = || atoms.iter().map(|a| 0.5 * a.diameter);
        let edge = |a: &Atom, sign: f64| a.position[up] + sign * 0.5 * a.diameter;
        let edges = |sign: f64| atoms.iter().map(move |a| edge(a, sign));
        let has = |kind| atoms.iter().any(|a| a.kind == kind);
        let file = PackingFile {
            path: path.into(),
            replicate: arrangement.copies.to_vec(),
            grains: count,
            radius_min: radii().fold(f64::INFINITY, f64::min),
            radius_max: 0.5 * largest,
            mean_diameter: 2.0 * radii().sum::<f64>() / f64::from(count),
            mean_volume: radii().map(|r| dimension.volume(r)).sum::<f64>() / f64::from(count),
            length: periods[0],
            width: (up == 2).then_some(periods[1]),
            boxed: offset.map(|offset| [periods[up], nearest_image(offset, periods[0])]),
            stream: data.stream.unwrap_or(0.0),
            edges: if arrangement.flat {
                data.bounds[up]
            } else {
                [
                    edges(-1.0).fold(f64::INFINITY, f64::min),
                    edges(1.0).fold(f64::NEG_INFINITY, f64::max),
                ]
            },
            farthest,
            wall_types: (1..=3).all(has) && atoms.iter().all(|a| a.kind <= 3),
            bottom_type: (1..=2).all(has) && atoms.iter().all(|a| a.kind <= 2),
            content: String::new(),
            ids: Ids::new(atoms.iter().map(|a| (a.id - 1) as u32)),
        };
        Ok(Packing {
            name: name.into(),
            file,
            atoms,
            is_state: false,
        })
    }

    /// The grains as the first stage of the scene takes them: sheared as they are, with walls, or
    /// to be compressed between planes, all free, at rest and with the lowest edge at y = 0; in a
    /// box at rest.
    ///
    /// # Errors
    /// `Failure::Input` where types are no walls, no grain is free, or an overlap is outside the
    /// contact law.
    pub fn grains(self, scene: &Scene) -> Result<Vec<GrainState>> {
        let up = scene.dimension.axes() - 1;
        let materials = self.materials(scene)?;
        let at_rest = |(id, a): (usize, &Atom)| GrainState {
            id: id as u32,
            position: a.position,
            radius: 0.5 * a.diameter,
            material: materials[id],
            ..GrainState::zeroed()
        };
        let all = self.atoms.iter().enumerate();
        let Boundary::Walls(plane_shear) = &scene.boundary else {
            let grains: Vec<GrainState> = all.map(at_rest).collect();
            self.check_overlaps(scene, &grains)?;
            return Ok(grains);
        };
        let PlaneShear { walls, pack, .. } = plane_shear;
        if plane_shear.origin.file().is_none() {
            return Ok(Vec::new());
        }
        let wall = scene
            .materials
            .wall
            .filter(|_| plane_shear.confinement != Confinement::Images);
        let grain = |(id, a): (usize, &Atom)| {
            let mut grain = at_rest((id, a));
            if pack.skip {
                GrainState {
                    velocity: a.velocity,
                    angular_velocity: a.angular_velocity,
                    ..grain
                }
            } else {
                // Smooth planes and smooth grains would let spins go on for ever.
                grain.position[up] -= self.file.edges[0];
                grain
            }
        };
        let mut grains: Vec<GrainState> = all.map(grain).collect();
        if pack.skip && plane_shear.confinement != Confinement::Images {
            match walls {
                Walls::Flat => {}
                Walls::Layers => {
                    let planes = plane_shear.planes(&scene.sample, self.file.edges);
                    freeze_walls(&mut grains, up, planes, wall);
                    let plugs = holes::plugs(scene, plane_shear, self.file.edges, &grains);
                    holes::close(&mut grains, &plugs, wall);
                }
                Walls::Types if plane_shear.confinement == Confinement::FreeSurface => {
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
        let all = &scene.materials;
        let walls = [BOTTOM_TYPE, TOP_TYPE];
        let both = || (walls.iter()).all(|kind| self.atoms.iter().any(|a| a.kind == *kind));
        let to_a_bottom = scene.boundary.walls().is_some_and(|of| {
            of.walls == Walls::Types && of.confinement == Confinement::FreeSurface
        });
        let has_walls = self.is_state || to_a_bottom || both();
        let material = |a: &Atom| match all.of_type(a.kind.into()) {
            Some(material) => Ok(material),
            None if all.names.len() == 1 => Ok(0),
            None if has_walls && walls.contains(&a.kind) => Ok(all.wall.unwrap_or(0)),
            None => {
                let (id, kind) = (a.id, a.kind);
                let what = format!(
                    "atom {id} is of type {kind}, which is that of no material; give a material atom_type = {kind}"
                );
                Err(wrong(&self.name, a.line, what))
            }
        };
        self.atoms.iter().map(material).collect()
    }

    /// The bottom of a free surface: type 2.
    fn bottom_by_type(&self, grains: &mut [GrainState], wall: Option<u64>) -> Result<()> {
        if self.atoms.iter().all(|a| a.kind != BOTTOM_TYPE) {
            let what = format!(
                "no atom is of type {BOTTOM_TYPE}; with walls = \"types\" that is the bottom wall"
            );
            return Err(wrong(&self.name, 0, what));
        }
        self.set_walls(grains, &[(BOTTOM_TYPE, body::BOTTOM)], wall);
        Ok(())
    }

    /// Gives the atoms of these types the bodies of walls, and frees the others.
    fn set_walls(&self, grains: &mut [GrainState], bodies: &[(u32, u32)], wall: Option<u64>) {
        for (g, a) in grains.iter_mut().zip(&self.atoms) {
            let of_type = bodies.iter().find(|(kind, _)| *kind == a.kind);
            g.body = of_type.map_or(body::FREE, |(_, body)| *body);
        }
        finish_walls(grains, wall);
    }

    fn walls_by_type(&self, grains: &mut [GrainState], up: usize, wall: Option<u64>) -> Result<()> {
        let of = |kind| self.atoms.iter().filter(move |a| a.kind == kind);
        let by_height = |a: &&Atom, b: &&Atom| a.position[up].total_cmp(&b.position[up]);
        let highest = of(BOTTOM_TYPE).max_by(by_height);
        let lowest = of(TOP_TYPE).min_by(by_height);
        let (Some(highest), Some(lowest)) = (highest, lowest) else {
            let lacks = highest.map_or(BOTTOM_TYPE, |_| TOP_TYPE);
            let what = format!(
                "no atom is of type {lacks}; with walls = \"types\" type {BOTTOM_TYPE} is the bottom wall and type {TOP_TYPE} the top wall"
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

    /// Tells the overlap that is furthest outside the law, if one is.
    fn check_overlaps(&self, scene: &Scene, states: &[GrainState]) -> Result<()> {
        let of_plane = at_planes(scene, states).find_map(|(g, [_, plane], overlap)| {
            let radius = states[g].radius;
            let largest = scene.law.largest_overlap(radius, WALL * radius);
            (overlap > largest).then_some((&self.atoms[g], plane, overlap, largest))
        });
        if let Some((atom, plane, overlap, largest)) = of_plane {
            let what = format!(
                "atom {} overlaps the flat wall at {plane:?} m, a bound of the box, by {overlap:.3e} m; the law {} takes {largest:.3e} m",
                atom.id,
                scene.law.kind().name,
            );
            return Err(wrong(&self.name, atom.line, what));
        }
        let mut worst = (1.0, None);
        each_touching(scene, states, |[i, j], overlap| {
            let (a, b) = (&states[i], &states[j]);
            let largest = scene.law.largest_overlap(a.radius, b.radius);
            if overlap > worst.0 * largest {
                worst = (overlap / largest, Some((i, j, overlap, largest)));
            }
        });
        let Some((i, j, overlap, largest)) = worst.1 else {
            return Ok(());
        };
        let (a, b) = (&self.atoms[i], &self.atoms[j]);
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

/// Calls `visit` with each pair of grains that touch, and their overlap (m). Leaves out pairs of
/// wall grains.
fn each_touching(scene: &Scene, states: &[GrainState], visit: impl FnMut([usize; 2], f64)) {
    match scene.dimension {
        Dimensions::Two => each_touching_in::<Two>(scene, states, visit),
        Dimensions::Three => each_touching_in::<Three>(scene, states, visit),
    }
}

fn each_touching_in<D: Dimension>(
    scene: &Scene,
    states: &[GrainState],
    mut visit: impl FnMut([usize; 2], f64),
) {
    let sample = &scene.sample;
    let cell = scene.cell();
    let mut grains = Grains::<D>::default();
    grains.replace(states, &scene.materials.masses, scene.time_step.step);
    let extent = LocalExtent::whole(sample.length);
    let cutoff = Cutoff {
        greatest: 2.0 * sample.radius_max,
        skin: 0.0,
    };
    let mut pairs = neighbour::pairs(Isa::detect(), None, &grains, (cell, extent, cutoff));
    pairs.sort_unstable_by_key(|pair| pair.grains);
    for pair in pairs {
        let pair = pair.grains.map(|g| g as usize);
        let [a, b] = pair.map(|g| &states[g]);
        let apart = cell.separation::<D>(&a.position, &b.position);
        let overlap = a.radius + b.radius - length(apart);
        if overlap > 0.0 {
            visit(pair, overlap);
        }
    }
}

/// The grains that touch flat walls, if there are some, with the sign of the side and the height of
/// the plane, and their overlap (m).
fn at_planes<'a>(
    scene: &Scene,
    grains: &'a [GrainState],
) -> impl Iterator<Item = (usize, [f64; 2], f64)> + 'a {
    let up = scene.dimension.axes() - 1;
    let planes = scene.boundary.walls().and_then(PlaneShear::planes_of_file);
    let sides = planes.map(|[low, high]| [[-1.0, low], [1.0, high]]);
    let sides = move |g| sides.into_iter().flatten().map(move |side| (g, side));
    let touching = move |(g, [sign, plane]): (usize, [f64; 2])| {
        let overlap = grains[g].radius + sign * (grains[g].position[up] - plane);
        (overlap > 0.0).then_some((g, [sign, plane], overlap))
    };
    (0..grains.len()).flat_map(sides).filter_map(touching)
}

/// The force (N; N/m in 2D) upwards on the top wall that the overlaps of grains at rest exert.
pub(crate) fn force_on_top(scene: &Scene, grains: &[GrainState]) -> f64 {
    let up = scene.dimension.axes() - 1;
    let mut sum = 0.0;
    each_touching(scene, grains, |pair, overlap| {
        let [a, b] = pair.map(|g| &grains[g]);
        let (top, other) = match [a.body, b.body].map(|of| of == body::TOP) {
            [true, false] => (a, b),
            [false, true] => (b, a),
            _ => return,
        };
        let force = scene.law.normal_stiffness(a.radius, b.radius, overlap) * overlap;
        let rise = top.position[up] - other.position[up];
        sum += force * rise / (a.radius + b.radius - overlap);
    });
    for (g, [sign, _], overlap) in at_planes(scene, grains) {
        let radius = grains[g].radius;
        if sign > 0.0 {
            sum += scene.law.normal_stiffness(radius, WALL * radius, overlap) * overlap;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;
    use std::io::Write;
    use std::os::unix::ffi::OsStrExt;

    use super::*;
    use crate::Source;
    use crate::testing::{cases, overrides};
    use gshear_dem::state::{Cell, Sheared};

    const FILE: &str = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/scenes/triangular.data"
    );
    const TEXT: &str = include_str!("../../../tests/scenes/triangular.data");

    /// The packing as changed by `edit`, and a scene of it.
    fn packing(edit: impl Fn(String) -> String, sets: &str) -> Result<(Packing, Scene)> {
        let data = lammps_data::parse("f", &edit(TEXT.into()))?;
        packing_of(data, 1, sets)
    }

    /// Copies along x.
    fn along(copies: u32) -> Arrangement {
        Arrangement {
            copies: [copies, 1, 1],
            ..Arrangement::BETWEEN_WALLS
        }
    }

    fn packing_of(data: DataFile, copies: u32, sets: &str) -> Result<(Packing, Scene)> {
        let text = "
            material.density = 2500
            contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
            sample.packing = 'f'
            load.stiffness_number = 1e3
            shear = { inertial_number = 1e-3, strain = 0.01 }
        ";
        let arrangement = along(copies);
        let data = replicated("f", data, arrangement.copies, &GrainLimit::default())?;
        let packing = Packing::new("f", Path::new(FILE), data, arrangement)?;
        let source = Source::new("s", text);
        let scene = crate::load_with(&source, &overrides(sets), &mut |_, _| {
            Ok(packing.file.clone())
        })?;
        Ok((packing, scene))
    }

    fn grains(edit: impl Fn(String) -> String, sets: &str) -> Result<Vec<GrainState>> {
        let (packing, scene) = packing(edit, sets)?;
        packing.grains(&scene)
    }

    fn message<T>(result: Result<T>) -> String {
        match result {
            Err(Failure::Input(message)) => message.replace(FILE, "f"),
            Err(other) => panic!("not bad input: {other}"),
            Ok(_) => panic!("taken"),
        }
    }

    fn refused(edit: impl Fn(String) -> String, sets: &str) -> String {
        message(grains(edit, sets))
    }

    /// Replaces the row of an atom, which begins with its id.
    fn with_atom(row: &str) -> impl Fn(String) -> String + '_ {
        move |text| {
            let (id, _) = row.split_once(' ').unwrap();
            let (head, tail) = text.split_once("Velocities").unwrap();
            let at = head.find(&format!("\n{id} ")).unwrap() + 1;
            let end = at + head[at..].find('\n').unwrap();
            format!("{}{row}{}Velocities{tail}", &head[..at], &head[end..])
        }
    }

    /// Before memory is taken for them.
    #[test]
    fn too_many_copies_are_refused() {
        let read = |n| {
            let arrangement = Arrangement {
                copies: [n, n, 1],
                ..Arrangement::BETWEEN_WALLS
            };
            message(Packing::read(Path::new(FILE), arrangement))
        };
        let expected = "f: has 120 atoms in 1000000 × 1000000 × 1 copies (sample.replicate): 120000000000000 grains are more than the 4294967295 that a run can have; give fewer";
        assert_eq!(read(1_000_000), expected);
        let limit = GrainLimit {
            most: 119,
            reason: "fit".into(),
        };
        let expected = "f: has 120 atoms: 120 grains are more than the 119 that fit; give fewer";
        let read = Packing::read_at_most(Path::new(FILE), along(1), &limit);
        assert_eq!(message(read), expected);
        let long = TEXT.replace("-0.002 0.00799 xlo", "-0.002 1e307 xlo");
        assert_ne!(long, TEXT);
        let data = lammps_data::parse("f", &long).unwrap();
        let copies = replicated("f", data, [100, 1, 1], &GrainLimit::default());
        let expected = "f: 100 copies of the box along x (sample.replicate) are longer than a number can say; give fewer";
        assert_eq!(message(copies), expected);
    }

    #[test]
    fn files_that_cannot_be_read_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let read = |path: &Path| {
            let name = format!("{}/", folder.path().display());
            message(Packing::read(path, along(1))).replace(&name, "")
        };
        let path = folder.path().join("file");
        let said = read(folder.path());
        assert!(said.ends_with(&format!(": is a directory; give {FORMAT}")));
        assert_eq!(read(&path), format!("file: no such file; give {FORMAT}"));
        // Without an end.
        let device = read(Path::new("/dev/zero"));
        assert_eq!(device, format!("/dev/zero: is a device; give {FORMAT}"));
        // As gzip writes them, cut short, or of zeros alone.
        let packed = |text: &[u8]| {
            let mut to = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
            to.write_all(text).unwrap();
            to.finish().unwrap()
        };
        let good = packed(&TEXT.replace('\n', " # Gr\u{f6}\u{df}e\n").into_bytes());
        std::fs::write(&path, &good).unwrap();
        assert_eq!(Packing::read(&path, along(1)).unwrap().file.grains, 120);
        let mut latin1 = TEXT.as_bytes().to_vec();
        latin1.extend(b"# Gr\xf6\xdfe\n");
        std::fs::write(&path, latin1).unwrap();
        assert_eq!(Packing::read(&path, along(1)).unwrap().file.grains, 120);
        std::fs::write(&path, &good[..good.len() / 2]).unwrap();
        let said = read(&path);
        assert!(said.starts_with("file: cannot be unpacked: "), "{said}");
        std::fs::write(&path, packed(&vec![0; 10_000_000])).unwrap();
        let expected =
            "file: has more than 100 times its bytes when unpacked; unpack it with gunzip";
        assert_eq!(read(&path), expected);
        std::fs::write(&path, "x".repeat(10_000_000)).unwrap();
        assert_eq!(read(&path), "file: the header lacks the line `N atoms`");
        std::fs::write(&path, format!("\n{}", "7".repeat(10_000_000))).unwrap();
        assert!(read(&path).len() < 300, "{}", read(&path).len());
        // The scene names the path.
        let odd = folder.path().join(OsStr::from_bytes(b"\xff"));
        std::fs::write(&odd, TEXT).unwrap();
        let said = read(&odd);
        assert!(said.ends_with("is not UTF-8; rename it"), "{said}");
    }

    /// The same grains in other formats.
    #[test]
    fn dumps_and_lists_are_read() {
        let data = lammps_data::parse("f", TEXT).unwrap();
        let [[xlo, xhi], [ylo, yhi], [zlo, zhi]] = data.bounds;
        let row = |a: &Atom| {
            let ([x, y, z], [u, v, w]) = (a.position, a.velocity);
            let (id, kind, radius, spin) = (a.id, a.kind, 0.5 * a.diameter, a.angular_velocity[2]);
            format!("{radius:?} {id} {kind} {x:?} {y:?} {z:?} {u:?} {v:?} {w:?} 0 0 {spin:?}\n")
        };
        let rows: String = data.atoms.iter().map(row).collect();
        let head = |step: u32, count: usize| {
            format!(
                "ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{count}\nITEM: BOX BOUNDS pp ff ff\n{xlo:?} {xhi:?}\n{ylo:?} {yhi:?}\n{zlo:?} {zhi:?}\nITEM: ATOMS radius id type x y z vx vy vz omegax omegay omegaz\n"
            )
        };
        let first = format!("{}1.0 1 1 0 0 0 0 0 0 0 0 0\n", head(0, 1));
        let dump = format!("ITEM: UNITS\nsi\n{first}{}{rows}", head(100, 120));
        let without_lines = |mut data: DataFile| {
            data.atoms
                .iter_mut()
                .for_each(|a| (a.line, a.density) = (0, 1.0));
            data
        };
        let mut expected = without_lines(data.clone());
        expected.bounded = [None, Some("ff".into()), Some("ff".into())];
        for frame in [None, Some(1)] {
            let read = parsed("f", dump.as_bytes(), frame).unwrap();
            assert_eq!(read.atoms[0].line, 22);
            assert_eq!(without_lines(read), expected);
        }
        // A run that was killed leaves a part of its last frame, at least of the heading.
        let whole = dump.len() - rows.len();
        for cut in [whole - 20, whole, dump.len() - 30] {
            for (name, frame) in [("f", None), ("f@1", Some(1))] {
                let said = message(parsed(name, &dump.as_bytes()[..cut], frame));
                let hint = "; the last frame may be cut off: f@0 is the one before it";
                assert!(said.ends_with(hint), "{said}");
            }
        }
        let only = &dump.as_bytes()[first.len() + 15..dump.len() - 30];
        assert!(!message(parsed("f", only, None)).contains("f@"));
        let one = parsed("f", dump.as_bytes(), Some(0)).unwrap();
        assert_eq!(one.atoms.len(), 1);
        let said = message(parsed("f", dump.as_bytes(), Some(2)));
        let expected = "f: has 2 frames; give @0 … of one that it has, or none for the last";
        assert_eq!(said, expected);

        // Parts of the edges of a tilted box, as LAMMPS computes them.
        let tilted = "ITEM: TIMESTEP\n7\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS xy xz yz pp pp pp\n-1.25 4.5 -0.25\n0 2.5 0.5\n0 1 0.5\nITEM: ATOMS id xs ys zs diameter\n3 0.5 0.25 0.5 0.1\n";
        let read = parsed("f", tilted.as_bytes(), None).unwrap();
        assert_eq!(read.bounds, [[-1.0, 4.0], [0.0, 2.0], [0.0, 1.0]]);
        assert_eq!(read.tilt, [-0.25, 0.5, 0.5]);
        assert_eq!(read.atoms[0].position, [1.6875, 0.75, 0.5]);
        assert_eq!((read.atoms[0].id, read.atoms[0].diameter), (3, 0.1));
        for [from, to, expected] in cases(
            r#"
            diameter | mass | f:9: there is no column radius; write it by dump custom with id type x y z radius, and for moving grains vx vy vz omegax omegay omegaz
            id xs | id x | f:9: there is no column x, y or z; write it by dump custom with id type x y z radius, and for moving grains vx vy vz omegax omegay omegaz
            3 0.5 | 3 half | f:10: "half" is no number; a row has a number for every column
            3 0.5 | 3 | f:10: 4 columns; a row has a number for every column
            ATOMS\n1 | ATOMS\nall | f:4: "all" is no number of atoms
            -1.25 4.5 -0.25 | -1.25 4.5 -0.25 1 | f:6: a general triclinic box is not taken; dump one whose first edge is along x
            -0.25\n | 9\n | f:5: the box is tilted by more than its bounds are apart
            BOX BOUNDS | CELL | f:5: ITEM: CELL xy xz yz pp pp pp is not expected here; a frame has ITEM: TIMESTEP, NUMBER OF ATOMS, BOX BOUNDS, ATOMS
            "#,
        ) {
            let text = tilted.replacen(&from, &to, 1);
            assert_ne!(text, tilted, "{from}");
            assert_eq!(message(parsed("f", text.as_bytes(), None)), expected);
        }

        let list = "##PERIODIC:: 4 3 2\n# x y z r\n1 2 0.5 0.25\n3 2 1 0.125 7\n";
        let read = parsed("f", list.as_bytes(), None).unwrap();
        assert_eq!(read.bounds, [[0.0, 4.0], [0.0, 3.0], [0.0, 2.0]]);
        let rows = read.atoms.iter().map(|a| (a.id, a.position, a.diameter));
        let expected = [(1, [1.0, 2.0, 0.5], 0.5), (2, [3.0, 2.0, 1.0], 0.25)];
        assert!(rows.eq(expected), "{:?}", read.atoms);
        let refused = |bytes: &[u8], frame| message(parsed("f", bytes, frame));
        for [text, expected] in cases(
            r#"
            1 2 3 4\n | f: a list of spheres x y z r lacks its box; begin it with the line ##PERIODIC:: L_x L_y L_z
            ##PERIODIC:: 1 1 0\n1 2 3 4\n | f:1: a length of the box is 0.0; write: ##PERIODIC:: L_x L_y L_z
            ##PERIODIC:: 1 1 1\n1 2 3 4\n1 2 3\n | f:3: 3 columns are too few; a row is x y z r
            ##PERIODIC:: 1 1 1\n0 Sphere .1 .1 .1 .1\n | f:2: 0 Sphere .1 .1 .1 .1 is no row of a list of spheres, which is x y z r: four numbers with blanks between them, and YADE's clumpId after them
            ##PERIODIC:: 1 1 1\n0.1,0.1,0.1,0.1\n | f:2: 0.1,0.1,0.1,0.1 is no row of a list of spheres, which is x y z r: four numbers with blanks between them, and YADE's clumpId after them
            ##PERIODIC:: 1 1 1\n1 2 3 4 0\n1 2 3 4 -1\n1 2 3 4 0\n | f:4: spheres 1 (line 2) and 3 form clump 0 (the fifth column, YADE's clumpId), but samples have no clumps; give a packing of single spheres, with -1 in this column or without it
            ##PERIODIC:: 1 1 1\n1 2 3 4 .5\n | f:2: ".5" is no number of a clump (the fifth column, YADE's clumpId); -1 is none
            "#,
        ) {
            assert_eq!(refused(text.as_bytes(), None), expected);
        }
        let clumps = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n3\nITEM: BOX BOUNDS pp pp pp\n0 1\n0 1\n0 1\nITEM: ATOMS id id_multisphere x y z radius\n7 -1 0 0 0 1\n8 2 0 0 0 1\n9 2 0 0 0 1\n";
        let expected = "f:12: spheres 8 (line 11) and 9 form clump 2 (id_multisphere), but samples have no clumps; give a packing of single spheres, with -1 in this column or without it";
        assert_eq!(refused(clumps.as_bytes(), None), expected);
        let single = clumps.replace("9 2", "9 3");
        assert_eq!(parsed("f", single.as_bytes(), None).unwrap().atoms.len(), 3);
        let marked = "\u{feff}1 2 3 4\n".as_bytes();
        let expected = "f: a list of spheres x y z r lacks its box; begin it with the line ##PERIODIC:: L_x L_y L_z";
        assert_eq!(refused(marked, None), expected);
        let expected = "f: holds one state; leave out @3";
        assert_eq!(refused(TEXT.as_bytes(), Some(3)), expected);
        let utf_16 = b"\xff\xfe1\0";
        let expected = "f: is text in UTF-16; save it as UTF-8";
        assert_eq!(refused(utf_16, None), expected);
    }

    /// Of mean overlaps of 1 µm, in boxes moved along either axis.
    #[test]
    fn coordinates_that_do_not_resolve_overlaps_are_refused() {
        let moved = |by: f64, axis: usize| {
            move |text: String| {
                let lines = text.lines().map(|line| {
                    let mut words: Vec<String> = line.split(' ').map(String::from).collect();
                    let at = match &words[..] {
                        [_, _, low, _] if *low == ["xlo", "ylo"][axis] => 0..2,
                        [_, _, _, density, ..] if density == "2500" => 4 + axis..5 + axis,
                        _ => 0..0,
                    };
                    for word in &mut words[at] {
                        *word = format!("{:?}", word.parse::<f64>().unwrap() + by);
                    }
                    words.join(" ")
                });
                lines.collect::<Vec<_>>().join("\n")
            }
        };
        for axis in [0, 1] {
            let said = refused(moved(1e4, axis), "");
            let expected = "s:4: sample.packing: coordinates up to 1.0e4 are rounded by 1.1e-12, more than 1e-6 of the mean overlap of 1.0e-6; give coordinates up to 9.0e3, or a load that presses grains together by 1.1e-6 or more (a stiffness number of at most 9.0e2)";
            assert_eq!(said, expected);
            refused(moved(1e9, axis), "");
            assert!(grains(moved(0.5, axis), "").is_ok());
        }
    }

    #[test]
    fn what_the_scene_knows_of_it() {
        let file = Packing::read(Path::new(FILE), along(1)).unwrap().file;
        assert_eq!((file.grains, file.wall_types), (120, true));
        let size = (file.radius_min, file.radius_max, file.mean_volume);
        assert_eq!((size.0, size.1), (0.5e-3, 0.5e-3));
        assert!((size.2 / (std::f64::consts::PI * 0.25e-6) - 1.0).abs() < 1e-14);
        assert!((file.mean_diameter / 1e-3 - 1.0).abs() < 1e-14);
        assert_eq!(file.length, 0.00799 - -0.002);
        assert_eq!(file.edges[0], 0.0);
        let rows = 1e-3 + 11.0 * 0.5 * 3f64.sqrt() * 0.999e-3;
        assert!((file.edges[1] / rows - 1.0).abs() < 1e-14);
    }

    /// A grain is followed by its id; copies are numbered on, and stand beside each other.
    #[test]
    fn ids_are_those_of_the_file() {
        let once = lammps_data::parse("f", TEXT).unwrap();
        let [low, high] = once.bounds[0];
        let edges = packing_of(once.clone(), 1, "").unwrap().0.file.edges;
        let period = packing_of(once.clone(), 1, "").unwrap().0.file.length;
        for copies in [1, 2, 3] {
            let (packing, scene) = packing_of(once.clone(), copies, "").unwrap();
            let file = &packing.file;
            assert_eq!((file.grains, file.edges), (120 * copies, edges));
            let length = f64::from(copies) * period;
            // The far end of the box is rounded.
            assert!((file.length / length - 1.0).abs() <= 2.0 * f64::EPSILON);
            let all = packing.grains(&scene).unwrap();
            assert_eq!(all.len(), 120 * copies as usize);
            for (k, grain) in all.iter().enumerate() {
                assert_eq!(grain.id as usize, k);
                let atom = once.atoms.iter().find(|a| a.id as usize == k % 120 + 1);
                let atom = atom.expect("ids from 1 on");
                let x = atom.position[0] - low + (k / 120) as f64 * (high - low);
                let apart = (grain.position[0] - x).abs() % (f64::from(copies) * (high - low));
                assert!(apart < 1e-15, "{k}: {apart}");
                assert_eq!(grain.position[1], atom.position[1]);
                assert_eq!(grain.radius, 0.5 * atom.diameter);
            }
        }
    }

    #[test]
    fn ids_may_have_gaps() {
        let mut data = lammps_data::parse("f", TEXT).unwrap();
        let of = |id: u64| 3 * id + 5 * u64::from(id > 40) + LAST_ID - 1000;
        let files: Vec<u64> = data.atoms.iter().map(|a| of(a.id)).collect();
        data.atoms.iter_mut().for_each(|a| a.id = of(a.id));
        let (packing, _) = packing_of(data.clone(), 1, "").unwrap();
        let mut ids: Vec<u64> = files.iter().map(|id| id - 1).collect();
        ids.sort_unstable();
        let of_rows = (0..120).map(|row| u64::from(packing.file.ids.of(row)));
        assert!(of_rows.eq(ids.iter().copied()), "{:?}", packing.file.ids);
        let last = 2 * (ids[119] + 1);
        let expected = format!(
            "f: the id of atom {last} is greater than 4294967296; number the atoms of the file from 1 on"
        );
        assert_eq!(message(packing_of(data, 2, "")), expected);
        for ids in [&[0, 1, 2][..], &[1, 2, 3], &[0, 1, 3, 4, 9], &[u32::MAX]] {
            let jumps = Ids::new(ids.iter().copied());
            let of_rows: Vec<u32> = (0..ids.len() as u32).map(|row| jumps.of(row)).collect();
            assert_eq!(of_rows, ids);
        }
    }

    /// Distances of near atoms in a tilted box, some of them written outside of it, and in copies.
    #[test]
    fn boxes_keep_distances() {
        let (length, height, tilt) = (8.0, 6.0, 3.0);
        let place = |k: u32| {
            let part = |n: u32| f64::from(k * n % 97) / 97.0;
            [20.0 * part(31) - 6.0, 15.0 * part(53) - 4.0, 0.0]
        };
        let atom = |k: u32| Atom {
            id: k.into(),
            kind: 1,
            diameter: 0.5,
            density: 1.0,
            position: place(k),
            ..Atom::default()
        };
        let data = DataFile {
            bounds: [[1.0, 1.0 + length], [2.0, 2.0 + height], [-1.0, 1.0]],
            tilt: [tilt, 0.0, 0.0],
            types: 1,
            atoms: (1..=30).map(atom).collect(),
            ..DataFile::default()
        };
        let sorted = |mut all: Vec<f64>| {
            all.retain(|apart| *apart < 2.0);
            all.sort_by(f64::total_cmp);
            all
        };
        let pairs = |n: usize| (0..n).flat_map(|j| (0..j).map(move |i| [i, j]));
        let nearest = |[i, j]: [usize; 2]| {
            let [a, b] = [i, j].map(|k| data.atoms[k].position);
            let images = (-9..=9).flat_map(|n| (-9..=9).map(move |m| [n, m].map(f64::from)));
            let apart = images.map(|[n, m]| {
                let x = a[0] - b[0] + n * length + m * tilt;
                x.hypot(a[1] - b[1] + m * height)
            });
            apart.fold(f64::INFINITY, f64::min)
        };
        let expected = sorted(pairs(30).map(nearest).collect());
        assert!(expected.len() > 50);
        for copies in [[1, 1, 1], [1, 2, 1], [3, 2, 1]] {
            let arrangement = Arrangement {
                copies,
                boxed: true,
                flat: false,
            };
            let data = replicated("f", data.clone(), copies, &GrainLimit::default()).unwrap();
            let packing = Packing::new("f", Path::new(FILE), data, arrangement).unwrap();
            let [height, offset] = packing.file.boxed.unwrap();
            let length = packing.file.length;
            assert!(offset.abs() <= 0.5 * length, "{offset}");
            let cell = Cell {
                periods: [length, f64::INFINITY],
                sheared: Some(Sheared {
                    offset,
                    ..Sheared::upright(height)
                }),
            };
            let inside = |a: &Atom| {
                (0.0..length).contains(&a.position[0]) && (0.0..height).contains(&a.position[1])
            };
            assert!(packing.atoms.iter().all(inside));
            let apart = |[i, j]: [usize; 2]| {
                let [a, b] = [i, j].map(|k| &packing.atoms[k].position);
                gshear_dem::state::length(cell.separation::<Two>(a, b))
            };
            let number = copies.iter().product::<u32>() as usize;
            let found = sorted(pairs(30 * number).map(apart).collect());
            assert_eq!(found.len(), number * expected.len());
            for (found, expected) in found.chunks(number).zip(&expected) {
                assert!(found.iter().all(|found| (found - expected).abs() < 1e-12));
            }
        }
        let walls = Packing::new("f", Path::new(FILE), data, Arrangement::BETWEEN_WALLS);
        let expected = "f: the box is tilted; between walls it must be a rectangle";
        assert_eq!(message(walls), expected);
    }

    #[test]
    fn walls_come_from_types_or_layers() {
        let by = |sets: &str| {
            let mut counts = [0; 3];
            for g in grains(|text| text, sets).unwrap() {
                counts[g.body as usize] += 1;
                if g.body != body::FREE {
                    assert_eq!((g.velocity, g.angular_velocity), ([0.0; 3], [0.0; 3]));
                } else if sets != "pack.skip=false" {
                    assert!((g.velocity[0] / g.position[1] - 0.1).abs() < 1e-12);
                    assert!(g.angular_velocity[2] < 0.0 && g.velocity[1] == 0.001);
                }
            }
            counts
        };
        assert_eq!(by(""), [100, 10, 10]);
        assert_eq!(by("sample.walls=types"), [100, 10, 10]);
        // The second row's centres lie 1.37 diameters high.
        assert_eq!(by("sample.walls=layers"), [100, 10, 10]);
        assert_eq!(by("pack.skip=false"), [120, 0, 0]);
        // Types 1 and 2 alone are no walls.
        let two = |text: String| text.replace(" 3 0.001 2500 ", " 2 0.001 2500 ");
        let (packing, scene) = packing(two, "").unwrap();
        assert!(!packing.file.wall_types);
        assert_eq!(scene.plane_shear("s").unwrap().walls, Walls::Layers);
        let expected = "f: no atom is of type 3; with walls = \"types\" type 2 is the bottom wall and type 3 the top wall";
        assert_eq!(refused(two, "sample.walls=types"), expected);
    }

    /// Twelve by sixteen columns of nine spheres that overlap by 1e-6 m along z alone.
    #[test]
    fn force_of_spheres_on_the_top() {
        let at = |n: usize| (n as f64 + 0.5) * 1e-3;
        let row = |n: usize| {
            let (x, y, k) = (at(n / 144), at(n / 9 % 16), n % 9);
            let kind = [2, 1, 1, 1, 1, 1, 1, 1, 3][k];
            let z = 0.5e-3 + 0.999e-3 * k as f64;
            format!("{} {kind} 0.001 2500 {x:e} {y:e} {z:e}\n", n + 1)
        };
        let rows: String = (0..1728).map(row).collect();
        let text = format!(
            "t\n1728 atoms\n3 atom types\n0 0.012 xlo xhi\n0 0.016 ylo yhi\n0 0.01 zlo zhi\nAtoms # sphere\n\n{rows}"
        );
        let (packing, scene) = packing(|_| text.clone(), "dimension=3").unwrap();
        let force = force_on_top(&scene, &packing.grains(&scene).unwrap());
        assert!((force / 192.0 - 1.0).abs() < 1e-9, "{force}");
    }

    /// A dump says along which axes its box is periodic: between walls along all but the last, in a
    /// box along all.
    #[test]
    fn boxes_that_end_are_not_periodic() {
        let read = |kinds: &str, boxed: bool| {
            let text = format!(
                "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS {kinds}\n0 4\n0 4\n0 4\nITEM: ATOMS id x y z radius\n1 1 1 1 0.5\n"
            );
            let data = parsed("f", text.as_bytes(), None).unwrap();
            let arrangement = Arrangement {
                boxed,
                ..Arrangement::BETWEEN_WALLS
            };
            Packing::new("f", Path::new(FILE), data, arrangement)
        };
        for (kinds, boxed) in [
            ("pp pp ff", false),
            ("xy xz yz pp pp fm", false),
            ("pp pp pp", false),
            ("pp pp pp", true),
            ("", true),
        ] {
            assert!(read(kinds, boxed).is_ok(), "{kinds}");
        }
        for (kinds, boxed, axis, kind) in [
            ("ff pp ff", false, "x", "ff"),
            ("pp sm ff", false, "y", "sm"),
            ("pp pp ff", true, "z", "ff"),
        ] {
            let expected = format!(
                "f: the box is not periodic along {axis} ({kind} in ITEM: BOX BOUNDS), but the sample is; give a packing that is periodic there, or write pp if this one is"
            );
            assert_eq!(message(read(kinds, boxed)), expected);
        }
    }

    /// Positions along x are wrapped as LAMMPS wraps them, and begin at xlo.
    #[test]
    fn x_is_wrapped() {
        let moved = with_atom("11 1 0.001 2500 0.00873925 0.0013651593783806542 0");
        let as_it_is = grains(|text| text, "").unwrap();
        for (a, b) in as_it_is.iter().zip(&grains(moved, "").unwrap()) {
            assert!((a.position[0] - b.position[0]).abs() < 1e-17);
        }
    }

    /// Of each case rows of atoms, or a text and what stands for it.
    #[test]
    fn what_is_no_packing_of_disks_is_refused() {
        let edited = |text: String, change: &str| match change.split_once(" -> ") {
            Some((from, to)) => text.replace(from, to),
            None => with_atom(change)(text),
        };
        for [changes, expected] in cases(
            r#"
            11 1 0.001 2500 1e300 0.00136 0 | f:19: x of atom 11 is 1e300, more than 1e6 periods from the box, -0.002 0.00799 xlo xhi; give a place in the box
            // Diameters in millimetres.
            0.001 2500 -> 1 2500 | f:34: atom 116 overlaps too many neighbours; check the units of lengths and diameters
            0.001 2500 -> 1e-9 2500 | f: 120 atoms are too few for their box, in which 9.5e13 of the largest diameter, 1e-9, have room; check the units of lengths and diameters
            11 1 0.001 2500 -0.00125075 0.00136 1e-9 | f:19: z of atom 11 is 1e-9; in a packing of disks it is 0
            11 1 0.001 2500 -0.00125075 0.03 0 | f:19: atom 11 is out of the box: y = 0.03, the box has -0.001 0.02 ylo yhi
            -0.0005 0.0005 zlo -> 0.1 0.2 zlo | f: the box is beside the plane z = 0, in which the disks are: 0.1 0.2 zlo zhi
            // Onto atom 32.
            39 1 0.001 2500 -0.0003 0.0030954781351419628 0 | f:22: atom 32 overlaps atom 39 (line 23) by 9.517e-4 m, 95.2 % of the sum of their radii; the law hooke takes 5.000e-4 m
            // Two of one row.
            32 2 0.001 2500 -0.0002517499999999998 0.0030954781351419628 0 & 39 3 0.001 2500 0.00674125 0.0030954781351419628 0 | f:23: atom 39 of type 3 is not above atom 32 of type 2 (line 22): the types are taken as top and bottom wall; give sample.walls = "layers" if they are not
            "#,
        ) {
            let said = refused(|text| changes.split(" & ").fold(text, edited), "");
            assert_eq!(said, expected);
        }
        let two = |text: String| {
            let (head, _) = text.split_once("4 2").unwrap();
            format!("{}4 2 1 1 0 0 0\n", head.replace("120 atoms", "1 atoms"))
        };
        let expected = "s:4: sample.packing: the cell is too narrow for its grains: length = 0.00999 m; give at least 4 diameters of the largest, 4.000e0 m";
        assert_eq!(refused(two, ""), expected);
    }
}
