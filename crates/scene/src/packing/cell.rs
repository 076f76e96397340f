//! The box of a packing, and checks of the atoms in it.

use std::collections::HashMap;

use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::Result;
use gshear_dem::state::nearest_image;

use super::copies::gradient;
use super::file::wrong;
use crate::lammps_data::{AXES, Atom, DataFile};
use crate::sample::Arrangement;

/// Cells of the largest diameter in the box of a packing, for each of its grains. In a box with
/// more the grains are far apart, and cells would take more memory than they.
const MOST_CELLS: f64 = 1e4;

/// Squares or cubes of their diameters over the room that the atoms of a cell may have: more than
/// any overlap of a law allows.
const MOST_FILLED: f64 = 4.0;

/// Periods from the box beyond which a position says nothing about the place in the box.
const MOST_PERIODS: f64 = 1e6;

/// The greatest id of an atom, copies included: one less is a u32.
pub(super) const LAST_ID: u64 = 1 << 32;

/// The box of a packing.
pub(super) struct PackingBox {
    /// lo and hi along x, y, z.
    bounds: [[f64; 2]; 3],
    pub(super) dimension: Dimensions,
    /// Of the image above, along x; `None` between walls.
    offset: Option<f64>,
}

impl PackingBox {
    /// The box of a file whose largest atom has this diameter.
    ///
    /// # Errors
    /// `Failure::Input` if disks are beside it, or if it is tilted otherwise than a sheared one.
    pub(super) fn new(
        name: &str,
        data: &DataFile,
        arrangement: Arrangement,
        largest: f64,
    ) -> Result<Self> {
        // Flat walls may hold a single layer of spheres.
        let thinnest = if arrangement.boundary.has_planes() {
            0.0
        } else {
            largest
        };
        let dimension = dimension(name, data, thinnest)?;
        let up = dimension.axes() - 1;
        let mut tilt = data.tilt;
        // Images along the last axis may be displaced along x in a box.
        let offset = if arrangement.boundary.is_periodic() {
            Some(std::mem::take(&mut tilt[up - 1]))
        } else {
            None
        };
        if tilt != [0.0; 3] {
            let what = if arrangement.boundary.is_periodic() {
                "the box is tilted otherwise than by a shear along x (xy of disks, xz of spheres); give one that is not"
            } else {
                "the box is tilted; between walls it must be a rectangle"
            };
            return Err(wrong(name, 0, what));
        }
        Ok(Self {
            bounds: data.bounds,
            dimension,
            offset,
        })
    }

    /// The last axis, along which walls bound the sample if there are some.
    pub(super) fn up(&self) -> usize {
        self.dimension.axes() - 1
    }

    /// The lengths.
    pub(super) fn periods(&self) -> [f64; 3] {
        self.bounds.map(|[low, high]| high - low)
    }

    /// The length along the last axis and the Lees–Edwards offset, if it is periodic there.
    pub(super) fn boxed(&self) -> Option<[f64; 2]> {
        let periods = self.periods();
        let offset = nearest_image(self.offset?, periods[0]);
        Some([periods[self.up()], offset])
    }

    /// The greatest coordinate of an atom or of the box along its other axes, in magnitude.
    pub(super) fn farthest(&self, atoms: &[Atom]) -> f64 {
        let up = self.up();
        let coordinates = atoms.iter().flat_map(|a| &a.position[..=up]);
        let coordinates = coordinates.chain(self.bounds[..up].as_flattened());
        coordinates.fold(0.0, |most: f64, x| most.max(x.abs()))
    }

    /// Refuses an atom that is out of the box or moves out of the plane of disks, and puts it into
    /// the periods: coordinates along them begin at 0.
    pub(super) fn place(&self, a: &mut Atom) -> Result<(), String> {
        if self.dimension == Dimensions::Two {
            check_in_plane(a)?;
        }
        let up = self.up();
        let (height, [bottom, top]) = (a.position[up], self.bounds[up]);
        if self.offset.is_none() && !(bottom..=top).contains(&height) {
            let axis = AXES[up];
            return Err(format!(
                "atom {} is out of the box: {axis} = {height:?}, the box has {bottom:?} {top:?} {axis}lo {axis}hi",
                a.id
            ));
        }
        // The last axis first: its images are displaced along x.
        if let Some(offset) = self.offset
            && let Some(images) = self.wrap(a, up)?
        {
            a.position[0] -= images * offset;
        }
        for axis in (0..up).rev() {
            self.wrap(a, axis)?;
        }
        Ok(())
    }

    /// Puts an atom into the period along an axis. Returns from which image, if it was not in the
    /// box.
    fn wrap(&self, a: &mut Atom, axis: usize) -> Result<Option<f64>, String> {
        let [low, high] = self.bounds[axis];
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
            return Ok(None);
        }
        let (mut wrapped, mut images) = (inside.rem_euclid(period), (inside / period).floor());
        // A little below zero rounds to the period.
        if wrapped >= period {
            (wrapped, images) = (0.0, images + 1.0);
        }
        a.position[axis] = wrapped;
        Ok(Some(images))
    }
}

/// Refuses an atom that is or moves out of the plane of disks.
fn check_in_plane(a: &Atom) -> Result<(), String> {
    for (what, value) in [
        ("z", a.position[2]),
        ("vz", a.velocity[2]),
        ("wx", a.angular_velocity[0]),
        ("wy", a.angular_velocity[1]),
    ] {
        if value != 0.0 {
            return Err(format!(
                "{what} of atom {} is {value:?}; in a packing of disks it is 0",
                a.id
            ));
        }
    }
    Ok(())
}

/// Refuses a file that says that its box ends along an axis along which the sample is periodic:
/// grains at its two ends would touch each other. `up`: the last axis.
pub(super) fn check_periodic(
    name: &str,
    bounded: &[Option<String>; 3],
    up: usize,
    arrangement: Arrangement,
) -> Result<()> {
    let periodic = if arrangement.boundary.is_periodic() {
        up + 1
    } else {
        up
    };
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

/// Refuses grains that are few for their box. `periods`: its lengths along the periodic axes of a
/// sample between walls.
pub(super) fn check_room(atoms: &[Atom], periods: &[f64], largest: f64) -> Result<(), String> {
    let count = atoms.len();
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for a in atoms {
        lowest = lowest.min(a.position[periods.len()]);
        highest = highest.max(a.position[periods.len()]);
    }
    let mut rooms = ((highest - lowest) / largest).max(1.0);
    for length in periods {
        rooms *= (length / largest).max(1.0);
    }
    let is_filled = rooms <= MOST_CELLS * count as f64;
    if is_filled {
        return Ok(());
    }
    Err(format!(
        "{count} atoms are too few for their box, in which {rooms:.1e} of the largest diameter, {largest:?}, have room; check the units of lengths and diameters"
    ))
}

/// Refuses atoms that overlap too many neighbours: the pairs might not fit into memory.
pub(super) fn check_neighbours(name: &str, atoms: &[Atom], up: usize, largest: f64) -> Result<()> {
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
fn dimension(name: &str, data: &DataFile, thinnest: f64) -> Result<Dimensions> {
    let [low, high] = data.bounds[2];
    let planar = gradient(&data.atoms) == 1 || high - low <= (1.0 + 1e-9) * thinnest;
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
pub(super) fn check_ids(name: &str, atoms: &[Atom]) -> Result<()> {
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
