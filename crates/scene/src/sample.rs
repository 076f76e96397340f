//! The sample: `[sample]`, and the file it may come from.

mod keys;
mod sizes;

use std::fmt::Display;
use std::path::{Path, PathBuf};

use gshear_dem::boundary::{Boundary, PERIODIC, ROUGH_WALLS};
use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::laws::keys::{Key, KeyReader, Values};
use gshear_dem::state::Ids;
use serde::{Deserialize, Serialize};

use crate::checker::Checker;
use crate::derived;
use crate::grains::{Sample, Sizes};
use crate::insertion::volume_in_box;
use crate::value::Value;
use crate::words::show;

use keys::OUTSIDE;
pub use keys::{Placement, Walls};
pub(crate) use keys::{SAMPLE, SampleKeys};
use sizes::SizeKey;

/// Returns what a scene must know of the file of a packing. The file may have been read before, or
/// by another rank.
pub type ReadPacking<'a> = &'a mut dyn FnMut(PackingPaths<'_>, Arrangement) -> Result<PackingFile>;

/// The files from which a scene takes its grains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PackingPaths<'a> {
    /// That of the grains.
    pub grains: &'a Path,
    /// That of their contacts, if there is one.
    pub contacts: Option<&'a Path>,
}

/// How a scene takes a packing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrangement {
    /// Copies along the axes that are set beside each other.
    pub copies: [u32; 3],
    /// What bounds it along its last axis.
    pub boundary: &'static Boundary,
}

impl Arrangement {
    /// Once, between walls of its grains.
    pub const BETWEEN_WALLS: Self = Self {
        copies: [1; 3],
        boundary: &ROUGH_WALLS,
    };
}

/// Where the grains come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Origin {
    /// They are inserted on a lattice.
    Insertion(Sizes),
    /// A file has them, and this is in it.
    Packing(PackingFile),
    /// The stage before leaves them, in a cell of about this height (m).
    StageBefore {
        /// As far as it is known before the run.
        height: f64,
    },
}

impl Origin {
    /// The file of the packing, if the grains come from one.
    pub fn file(&self) -> Option<&PackingFile> {
        match self {
            Origin::Insertion(_) | Origin::StageBefore { .. } => None,
            Origin::Packing(file) => Some(file),
        }
    }
}

/// What a scene needs to know of the file of a packing. A checkpoint holds it, so that going on
/// does not need the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackingFile {
    /// The path, absolute.
    pub path: PathBuf,
    /// Copies along the axes that are set beside each other; what follows is of all of them.
    #[serde(default)]
    pub replicate: Vec<u32>,
    /// Number of grains.
    pub grains: u32,
    /// Least R (m).
    pub radius_min: f64,
    /// Greatest R (m).
    pub radius_max: f64,
    /// d̄ (m).
    pub mean_diameter: f64,
    /// π⟨R²⟩ (m²) in 2D, (4/3)π⟨R³⟩ (m³) in 3D.
    pub mean_volume: f64,
    /// L_x (m).
    pub length: f64,
    /// L_y (m); `None` in 2D.
    pub width: Option<f64>,
    /// L (m) along the last axis of a periodic box, and its Lees–Edwards offset (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub boxed: Option<[f64; 2]>,
    /// Velocity along x of the image above in that box (m/s).
    #[serde(default)]
    pub stream: f64,
    /// Coordinates of the lowest and of the highest edge of a grain, along the last axis (m); that
    /// of the file's box where a plane is.
    pub edges: [f64; 2],
    /// Greatest coordinate of a grain or of its box in the file, in magnitude (m); 0 in checkpoints
    /// of versions without it.
    #[serde(default)]
    pub farthest: f64,
    /// Whether its types are 1, 2 and 3, all three, so that 2 and 3 can be walls.
    pub wall_types: bool,
    /// Whether its types are 1 and 2, both, so that 2 can be the bottom of a free surface.
    #[serde(default)]
    pub bottom_type: bool,
    /// Hash of the file's bytes; empty in checkpoints of versions without it.
    #[serde(default)]
    pub content: String,
    /// The file of the contacts, if they come from one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contacts: Option<Box<ContactFile>>,
    /// Those of the file and its copies, less one.
    #[serde(default)]
    pub ids: Ids,
}

/// The file of a table of contacts, in what a scene knows of its packing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactFile {
    /// The path, absolute.
    pub path: PathBuf,
    /// Hash of the file's bytes.
    pub content: String,
}

impl PackingFile {
    /// Whether its files are these.
    pub fn is_at(&self, paths: PackingPaths<'_>) -> bool {
        let contacts = self.contacts.as_ref().map(|file| file.path.as_path());
        self.path == paths.grains && contacts == paths.contacts
    }

    /// H (m) with its walls; of a box its length along the last axis.
    pub fn height(&self) -> f64 {
        let between = self.edges[1] - self.edges[0];
        self.boxed.map_or(between, |[height, _]| height)
    }
}

/// The grains of a scene, as the keys say by themselves.
pub(crate) enum Grains {
    Inserted(Sizes),
    File(Arrangement),
}

/// Checks each key of a scene between walls by itself.
pub(crate) fn check(c: &mut Checker<'_>) -> Grains {
    let keys = &SAMPLE;
    let boundary = boundary(c);
    let arrangement = arrangement(c, boundary);
    if !boundary.has_walls() {
        let why = format!("is of walls, but sample.boundary = {:?}", boundary.key);
        c.all_useless(&WALL_KEYS, &why);
    }
    c.number(&keys.wall_thickness);
    if let Some(walls) = c.choice(&keys.walls)
        && boundary.has_planes()
        && !boundary.has_grains()
    {
        let why = format!("is of walls of grains, but sample.walls = {walls:?}");
        c.useless(&keys.wall_thickness, &why);
    }
    if c.dimension == Dimensions::Two {
        let why = "is L_y (m) of three dimensions, and dimension = 2";
        c.useless(&keys.width, why);
    }
    let why = "is of a cell whose first stage is quasi-static strain; this sample is packed under its load";
    c.all_useless(&[&keys.solid_fraction, &keys.aspect, &keys.placement], why);
    if c.is_given(&keys.packing) {
        check_filed(c);
        return Grains::File(arrangement);
    }
    if boundary.has_walls() && c.named(&keys.walls, &Walls::NAMES).is_some() {
        let what = "there is no packing to find walls in; give sample.packing, or leave it out";
        c.refuse(&keys.walls, what);
    }
    let sizes = sizes::check(c);
    c.required(&keys.length);
    if c.dimension == Dimensions::Three {
        c.required(&keys.width);
    }
    Grains::Inserted(sizes)
}

/// Whether grains that pass a wall are removed.
pub(crate) fn removes(c: &mut Checker<'_>) -> bool {
    c.named(&SAMPLE.outside, &OUTSIDE) == Some(true)
}

/// What bounds the sample below and above.
pub(crate) fn boundary(c: &mut Checker<'_>) -> &'static Boundary {
    let walls = c.choice(&SAMPLE.walls);
    let chosen = c.choice(&SAMPLE.boundary);
    chosen
        .and_then(|key| Boundary::of_keys(key, walls))
        .unwrap_or_default()
}

/// The keys of walls.
static WALL_KEYS: [&Key; 4] = [
    &SAMPLE.walls,
    &SAMPLE.wall_thickness,
    &SAMPLE.wall_material,
    &SAMPLE.outside,
];

/// Why the keys of inserted grains do not apply to a packing.
const FOR_INSERTED: &str = "applies to inserted grains, but the grains come from sample.packing";

/// The keys of inserted grains, where a file has them.
fn check_filed(c: &mut Checker<'_>) {
    let keys = &SAMPLE;
    c.whole(&keys.grains);
    for key in [
        &keys.radius_min,
        &keys.radius_max,
        &keys.length,
        &keys.width,
    ] {
        c.number(key);
    }
    c.useless(&keys.sizes, FOR_INSERTED);
    for size_key in SizeKey::all() {
        c.useless(size_key.key, FOR_INSERTED);
    }
}

/// How the scene takes its packing.
fn arrangement(c: &mut Checker<'_>, boundary: &'static Boundary) -> Arrangement {
    if !c.is_given(&SAMPLE.packing) {
        let why = "is of the grains of sample.packing, which is not given";
        c.useless(&SAMPLE.contacts, why);
    }
    let key = &SAMPLE.replicate;
    let mut arrangement = Arrangement {
        copies: [1; 3],
        boundary,
    };
    let (Some(Value::Numbers(given)), Values::Numbers(range)) = (c.value(key), key.values) else {
        return arrangement;
    };
    let given = given.clone();
    if !c.is_given(&SAMPLE.packing) {
        let why = "says how often sample.packing is repeated, which is not given";
        c.useless(key, why);
    }
    if given.iter().any(|copies| *copies > 1.0) && c.is_given(&SAMPLE.contacts) {
        let what = "is of a packing without copies, but sample.replicate makes some; leave one of them out";
        c.refuse(&SAMPLE.contacts, what);
    }
    let axes = periodic_axes(c, boundary.is_periodic());
    let are_whole = given.iter().all(|x| x.fract() == 0.0 && range.hold(*x));
    if given.len() == axes && are_whole {
        for (copies, given) in arrangement.copies.iter_mut().zip(given) {
            *copies = given as u32;
        }
    } else {
        let example = [
            "one whole number, the copies along x, such as replicate = [10]",
            "two whole numbers, the copies along x and y, such as replicate = [10, 10]",
            "three whole numbers, the copies along x, y and z, such as replicate = [2, 2, 2]",
        ][axes - 1];
        c.refuse(key, &format!("must be {example}"));
    }
    arrangement
}

fn periodic_axes(c: &Checker<'_>, boxed: bool) -> usize {
    c.dimension.axes() - usize::from(!boxed)
}

/// The keys of grains in a cell that is strained first, whose size follows from its solid fraction
/// or from a file.
pub(crate) fn check_boxed(c: &mut Checker<'_>) -> Grains {
    let keys = &SAMPLE;
    let why = format!("is of walls, but sample.boundary = {:?}", PERIODIC.key);
    c.all_useless(&WALL_KEYS, &why);
    let arrangement = arrangement(c, &PERIODIC);
    if c.is_given(&keys.packing) {
        c.all_useless(&[&keys.placement, &keys.aspect], FOR_INSERTED);
        c.useless(&keys.solid_fraction, "follows from sample.packing");
        check_filed(c);
        return Grains::File(arrangement);
    }
    c.required(&keys.solid_fraction);
    let why = "follows from sample.solid_fraction";
    c.all_useless(&[&keys.length, &keys.width], why);
    Grains::Inserted(sizes::check(c))
}

/// The sample of a file in its box.
pub(crate) fn derive_filed(
    c: &mut Checker<'_>,
    arrangement: Arrangement,
    packing: ReadPacking<'_>,
) -> Result<(Sample, PackingFile)> {
    let file = read(c, arrangement, packing)?;
    let sample = filed(c, &file)?;
    fill_from(c, &file);
    let least = sample.least_box_length();
    let [height, _] = file.boxed.unwrap_or_default();
    let lengths = [sample.length, sample.width, height];
    if let Some(length) = lengths.into_iter().find(|length| *length < least) {
        let what = format!(
            "the box is {length:.3e} long, so that grains would touch their own images; give a packing at least {least:.3e} long, or copies of it (sample.replicate)"
        );
        c.refuse(&SAMPLE.packing, &what);
    }
    c.settle()?;
    Ok((sample, file))
}

/// Reads the file that the scene names.
fn read(
    c: &mut Checker<'_>,
    arrangement: Arrangement,
    packing: ReadPacking<'_>,
) -> Result<PackingFile> {
    let [of_grains, of_contacts] = [&SAMPLE.packing, &SAMPLE.contacts];
    let path = |key: &Key| c.text(key).map(|path| c.resolve(key, path));
    let (grains, contacts) = (path(of_grains).unwrap_or_default(), path(of_contacts));
    let paths = PackingPaths {
        grains: &grains,
        contacts: contacts.as_deref(),
    };
    packing(paths, arrangement).map_err(|failure| match failure {
        Failure::Input(what) => {
            let named = contacts.as_ref().map(|path| path.display().to_string());
            let is_of_contacts = named.is_some_and(|name| what.starts_with(&name));
            c.failure(
                if is_of_contacts {
                    of_contacts
                } else {
                    of_grains
                },
                &what,
            )
        }
        other => other,
    })
}

/// Ratios of the lengths of a box to L_x: of L_y (spheres) and of that along the last axis.
fn aspect(c: &mut Checker<'_>) -> [f64; 2] {
    let key = &SAMPLE.aspect;
    if !c.is_given(key) {
        return [1.0; 2];
    }
    match (c.dimension, &c.required_list(key, "ratio")[..]) {
        (Dimensions::Two, [x, y]) => [1.0, y / x],
        (Dimensions::Three, [x, y, z]) => [y / x, z / x],
        (dimension, given) => {
            let example = match dimension {
                Dimensions::Two => "two ratios, those of L_x and L_y, such as [2.0, 1.0]",
                Dimensions::Three => {
                    "three ratios, those of L_x, L_y and L_z, such as [2.0, 1.0, 1.0]"
                }
            };
            let what = format!("must hold {example}, found {}", given.len());
            c.refuse(key, &what);
            [1.0; 2]
        }
    }
}

/// The sample in a box of the given ratios of lengths in which its grains have the solid fraction
/// φ.
pub(crate) fn derive_boxed(
    c: &mut Checker<'_>,
    seed: u64,
    sizes: &Sizes,
    solid_fraction: f64,
) -> Result<Sample> {
    let dimension = c.dimension;
    let aspect = aspect(c);
    let sample = Sample {
        aspect,
        ..inserted(c, sizes)?
    };
    let grains = volume_in_box(seed, &sample, sizes, |r| dimension.volume(r));
    let ratios: f64 = aspect.iter().product();
    let length = derived::box_length(dimension, grains / solid_fraction / ratios);
    let sample = sample.in_box(dimension, length);
    let lengths = sample.box_axes(length);
    if !(sample.mean_volume.is_normal() && lengths.iter().all(|length| length.is_normal())) {
        return Err(c.out_of_range(&format!(
            "the mean volume of a grain comes out as {:?} and the length of the box as {:?}; check the units of [sample]",
            sample.mean_volume, sample.length
        )));
    }
    let least = sample.least_box_length();
    let shortest = lengths.into_iter().fold(f64::INFINITY, f64::min);
    if shortest < least {
        let remedy = if aspect == [1.0; 2] {
            "give more grains"
        } else {
            "give more grains or ratios nearer to 1 (sample.aspect)"
        };
        let what = format!(
            "the box would be {shortest:.3e} long, so that grains would touch their own images; {remedy}, for a length of at least {least:.3e}"
        );
        c.refuse_among(&[&SAMPLE.aspect, &SAMPLE.grains, &SAMPLE.radii], &what);
    }
    c.settle()?;
    Ok(sample)
}

/// Inserted grains in a cell of the given size.
fn inserted(c: &mut Checker<'_>, sizes: &Sizes) -> Result<Sample> {
    let dimension = c.dimension;
    let limits = sizes::radius_limits(c, sizes);
    c.settle()?;
    let grains = match sizes {
        Sizes::Given(radii) => radii.len() as u32,
        _ => c.whole(&SAMPLE.grains).map_or(0, |n| n as u32),
    };
    Ok(Sample {
        grains,
        radius_min: limits[0],
        radius_max: limits[1],
        mean_diameter: sizes.mean(limits, |r| 2.0 * r),
        mean_volume: sizes.mean(limits, |r| dimension.volume(r)),
        length: c.known(&SAMPLE.length),
        width: c.number(&SAMPLE.width).unwrap_or(f64::INFINITY),
        aspect: [1.0; 2],
    })
}

/// A sample that is sheared, and what its walls are made of.
pub(crate) struct Walled {
    pub(crate) sample: Sample,
    pub(crate) origin: Origin,
    pub(crate) walls: Walls,
    /// Thickness of each wall over d̄.
    pub(crate) wall_layers: f64,
}

impl Walled {
    /// A sample that a stage before leaves in its cell.
    pub(crate) fn left(sample: Sample, height: f64) -> Self {
        Self {
            sample,
            origin: Origin::StageBefore { height },
            walls: Walls::Layers,
            wall_layers: 0.0,
        }
    }
}

/// The sample between its walls; `skip`: it is not compressed.
pub(crate) fn derive(
    c: &mut Checker<'_>,
    grains: Grains,
    skip: bool,
    packing: ReadPacking<'_>,
) -> Result<Walled> {
    let walled = match grains {
        Grains::Inserted(sizes) => derive_inserted(c, sizes)?,
        Grains::File(arrangement) => {
            let file = read(c, arrangement, packing)?;
            derive_packed(c, file, skip)?
        }
    };
    c.fill(&SAMPLE.wall_thickness, walled.wall_layers);
    Ok(walled)
}

/// A sample of inserted grains.
fn derive_inserted(c: &mut Checker<'_>, sizes: Sizes) -> Result<Walled> {
    let keys = &SAMPLE;
    let sample = inserted(c, &sizes)?;
    let height = derived::packed_height(&sample);
    let sized_by = [
        &keys.grains,
        &keys.radius_min,
        &keys.radius_max,
        &keys.length,
    ];
    let wall_layers = check_size(c, &sample, height, &sized_by)?;
    Ok(Walled {
        sample,
        origin: Origin::Insertion(sizes),
        walls: Walls::Layers,
        wall_layers,
    })
}

/// The sample of a packing; `skip`: it is not compressed.
fn derive_packed(c: &mut Checker<'_>, file: PackingFile, skip: bool) -> Result<Walled> {
    let keys = &SAMPLE;
    if !skip {
        let why = "has the contacts of grains that are sheared as they are, but pack.skip = false compresses them first";
        c.useless(&keys.contacts, why);
    }
    let sample = filed(c, &file)?;
    let wall_layers = check_size(c, &sample, file.height(), &[&keys.packing])?;
    let has_types = match boundary(c).bodies().count() {
        0 => false,
        1 => file.bottom_type,
        _ => file.wall_types,
    };
    let default = if skip && has_types {
        Walls::Types
    } else {
        Walls::Layers
    };
    let walls = c.named(&keys.walls, &Walls::NAMES).unwrap_or(default);
    fill_from(c, &file);
    let name = Walls::NAMES.iter().find(|(_, known)| *known == walls);
    let name = name.map_or("", |(name, _)| name);
    let name = c.choice(&keys.walls).unwrap_or(name);
    c.fill(&keys.walls, name);
    Ok(Walled {
        sample,
        origin: Origin::Packing(file),
        walls,
        wall_layers,
    })
}

/// The sample that a file holds, which the keys that are given must agree with.
fn filed(c: &mut Checker<'_>, file: &PackingFile) -> Result<Sample> {
    let keys = &SAMPLE;
    if let Some(n) = c.whole(&keys.grains)
        && n != i64::from(file.grains)
    {
        c.refuse(&keys.grains, &unlike_file(n, file.grains));
    }
    let width = file.width.unwrap_or(f64::INFINITY);
    for (key, held) in [
        (&keys.radius_min, file.radius_min),
        (&keys.radius_max, file.radius_max),
        (&keys.length, file.length),
        (&keys.width, width),
    ] {
        if let Some(x) = c.number(key)
            && x != held
        {
            c.refuse(key, &unlike_file(show(x), show(held)));
        }
    }
    if file.width.is_some() != (c.dimension == Dimensions::Three) {
        let (is, dimension) = match file.width {
            Some(_) => ("spheres", 3),
            None => ("disks in the plane z = 0", 2),
        };
        let what = format!("holds {is}; give dimension = {dimension}");
        c.refuse(&keys.packing, &what);
    }
    c.settle()?;
    Ok(Sample {
        grains: file.grains,
        radius_min: file.radius_min,
        radius_max: file.radius_max,
        mean_diameter: file.mean_diameter,
        mean_volume: file.mean_volume,
        length: file.length,
        width,
        aspect: [1.0; 2],
    })
}

/// What to say of a value that is another one than that of the packing.
fn unlike_file(given: impl Display, held: impl Display) -> String {
    format!("is {held} in the packing of sample.packing, found {given}; leave it out")
}

/// Fills in what follows from a file.
fn fill_from(c: &mut Checker<'_>, file: &PackingFile) {
    let keys = &SAMPLE;
    c.fill(&keys.packing, &*file.path.display().to_string());
    if let Some(contacts) = &file.contacts {
        c.fill(&keys.contacts, &*contacts.path.display().to_string());
    }
    let axes = periodic_axes(c, file.boxed.is_some());
    let copies: Vec<u32> = (0..axes)
        .map(|axis| file.replicate.get(axis).copied().unwrap_or(1))
        .collect();
    c.fill(&keys.replicate, &copies[..]);
    c.fill(&keys.grains, u64::from(file.grains));
    c.fill(&keys.radius_min, file.radius_min);
    c.fill(&keys.radius_max, file.radius_max);
    c.fill(&keys.length, file.length);
    if let Some(width) = file.width {
        c.fill(&keys.width, width);
    }
}

/// Refuses a cell too small for its grains and walls. Returns the thickness of these over d̄.
/// `height` (m) includes the walls; `sized_by` are the keys that set the size.
fn check_size(c: &mut Checker<'_>, sample: &Sample, height: f64, sized_by: &[&Key]) -> Result<f64> {
    let keys = &SAMPLE;
    let given = c.number(&keys.wall_thickness);
    let boundary = boundary(c);
    let wall_layers = if boundary.has_grains() {
        given.unwrap_or_else(|| derived::wall_layers(sample))
    } else {
        0.0
    };
    let least = 8.0 * sample.radius_max;
    if sample.width < least {
        c.refuse(&keys.width, &too_narrow("width", sample.width, least));
    }
    if sample.length < least {
        // The length first, where it was given.
        let reversed: Vec<&Key> = sized_by.iter().rev().copied().collect();
        c.refuse_among(&reversed, &too_narrow("length", sample.length, least));
    }
    c.settle()?;
    let needed = NeededHeight::new(sample, boundary, wall_layers);
    // Between flat walls one grain is enough.
    if height < needed.height && !boundary.has_planes() {
        let what = needed.too_low(sample, height);
        c.refuse_among(&[sized_by, &[&keys.wall_thickness]].concat(), &what);
    }
    c.settle()?;
    Ok(wall_layers)
}

/// What to say of a cell that is too short along an axis.
fn too_narrow(name: &str, length: f64, least: f64) -> String {
    format!(
        "the cell is too narrow for its grains: {name} = {} m; give at least 4 diameters of the largest, {least:.3e} m",
        show(length)
    )
}

/// The least height of a cell.
struct NeededHeight {
    /// With its walls (m).
    height: f64,
    /// What decides it in a cell without walls of grains.
    reason: &'static str,
    boundary: &'static Boundary,
    /// Thickness of each wall over d̄.
    wall_layers: f64,
}

impl NeededHeight {
    fn new(sample: &Sample, boundary: &'static Boundary, wall_layers: f64) -> Self {
        let all_layers = boundary.bodies().count() as f64 * wall_layers;
        let mut height = derived::least_height(all_layers) * sample.mean_diameter;
        let mut reason = "five mean diameters";
        if boundary.is_periodic() && height < sample.least_box_length() {
            height = sample.least_box_length();
            reason = "2.2 diameters of the largest";
        }
        Self {
            height,
            reason,
            boundary,
            wall_layers,
        }
    }

    /// What to say of a sample that fills only this height (m).
    fn too_low(&self, sample: &Sample, height: f64) -> String {
        let needed = self.height;
        let remedy = self.remedy(sample);
        if self.wall_layers == 0.0 {
            return format!(
                "the cell is too low: {} grains fill about {height:.2e} m of height, less than {needed:.2e} m, {}; {remedy}",
                sample.grains, self.reason
            );
        }
        let thickness = if self.wall_layers == 1.0 {
            "one mean diameter".into()
        } else {
            format!("{} mean diameters", (1e3 * self.wall_layers).round() / 1e3)
        };
        let walls = if self.boundary.bodies().count() == 2 {
            format!("two walls of {thickness} and five between them")
        } else {
            format!("a bottom wall of {thickness} and five above it")
        };
        format!(
            "the cell is too low for its walls: {} grains fill about {height:.2e} m of height, but {walls} take {needed:.2e} m; {remedy}",
            sample.grains
        )
    }

    fn remedy(&self, sample: &Sample) -> String {
        let least = derived::least_grains(sample, self.height);
        let mut remedy = if least <= f64::from(u32::MAX) {
            format!("give at least {least} grains or a shorter cell")
        } else {
            "give a shorter cell".into()
        };
        if self.wall_layers > 1.0 {
            remedy += ", or thinner walls (sample.wall_thickness)";
        }
        remedy
    }
}
