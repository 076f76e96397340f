//! Plane shear between walls: `[pack]`, and what follows from all of its tables.

use gshear_dem::boundary::Boundary;
use gshear_dem::drive::Servo;
use gshear_dem::failure::Result;
use gshear_dem::laws::keys::{Change, FROM_ONE, Key, KeyReader, NOT_NEGATIVE, POSITIVE};
use gshear_dem::laws::{Contact, Law};
use gshear_dem::observables::ObservableColumn;
use gshear_dem::state::Masses;

use crate::checker::Checker;
use crate::derived;
use crate::grains::Sample;
use crate::load::{self, Control, LOAD, Load};
use crate::output::{self, ANALYSIS, Analysis, OUTPUT, Output};
use crate::protocol::{self, SHEAR, Shear};
use crate::sample::{Origin, SAMPLE, Walled, Walls};
use crate::table::table;

table! {
    /// The compression of the sample.
    PACK: PackKeys "pack" Sheared Branch {
        /// shear the grains of `sample.packing` as they are
        skip: Flag {
            condition: "true with `sample.packing` only",
            otherwise: "true with `sample.packing`, false without",
            change: Change::Never,
        },
        /// μ_s while the sample is compressed; 0 packs densest
        friction: Number(NOT_NEGATIVE) { default: "0.0" },
        /// drag on grains and planes once the bottom carries the load, over the inverse of
        /// √(m̄/P), in 3D of √(m̄/(P d̄)); 0.25 to 0.6 comes to rest in fewer steps
        drag: Number(POSITIVE) { default: "1.0" },
        /// kinetic energy per grain over P d̄ δ̄ at which the sample is at rest, if the bottom
        /// carries N and the weight up to a share √`tolerance` (at least 1e-3)
        tolerance: Number(POSITIVE) { default: "1e-7" },
        /// steps after which packing is given up; if it is not given, ten times the number that
        /// `--check` expects where that is more
        max_steps: Whole(FROM_ONE) { default: "5000000", change: Change::Resume },
    }
}

/// Plane shear between walls, of a cell without them, or flow below a free surface.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneShear {
    /// Where the grains come from.
    pub origin: Origin,
    /// What bounds the sample.
    pub boundary: &'static Boundary,
    /// Which grains are the walls, where these are of grains.
    pub walls: Walls,
    /// Thickness of each wall over d̄; 0 without walls, and of flat ones.
    pub(crate) wall_layers: f64,
    /// Whether a grain that passes a wall while the sample is sheared is removed.
    pub removes: bool,
    /// The load on the top wall, and gravity.
    pub load: Load,
    /// The compression.
    pub pack: Pack,
    /// The shear.
    pub shear: Shear,
    /// What is written, and how often.
    pub output: Output,
    /// What the run computes of its frames.
    pub analysis: Analysis,
    /// Columns of the time series that the scene adds.
    pub observables: Vec<ObservableColumn>,
    /// The columns of `log.csv` after step and time; `None`: all.
    pub log_columns: Option<Vec<&'static str>>,
}

/// Compression between smooth planes under P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pack {
    /// No compression: the grains are sheared as they come.
    pub skip: bool,
    /// μ_s while packing; 0 is a law without history.
    pub friction: f64,
    /// Drag once the bottom carries the load, over the inverse `schedule::packing_time`.
    pub drag: f64,
    /// Kinetic energy per grain, over P d̄ δ̄, below which the sample is at rest.
    pub tolerance: f64,
    /// Steps after which packing is given up.
    pub max_steps: u64,
}

impl PlaneShear {
    /// Thickness of each wall of this sample (m).
    pub fn wall_thickness(&self, sample: &Sample) -> f64 {
        self.wall_layers * sample.mean_diameter
    }

    /// Thickness of all walls of this sample (m).
    pub fn thickness_of_walls(&self, sample: &Sample) -> f64 {
        self.boundary.bodies().count() as f64 * self.wall_thickness(sample)
    }

    /// Where the height of the top counts from (m): the lower edge of the sample at the start.
    pub fn floor(&self) -> f64 {
        match &self.origin {
            Origin::Packing(file) if self.pack.skip => file.edges[0],
            _ => 0.0,
        }
    }

    /// The heights (m) of the flat walls of a file's grains, infinite where there is none.
    pub(crate) fn planes_of_file(&self) -> Option<[f64; 2]> {
        if !self.pack.skip {
            return None;
        }
        self.boundary.planes(self.origin.file()?.edges)
    }

    /// The planes at which the walls of a sample between these heights (m) are cut from it: centres
    /// below the first are of the bottom, above the second of the top. What is no wall of grains
    /// has none.
    pub fn cuts(&self, sample: &Sample, edges: [f64; 2]) -> [f64; 2] {
        let [low, high] = edges;
        let thickness = self.wall_thickness(sample);
        self.boundary.cuts([low + thickness, high - thickness])
    }

    /// Layers of grains that give way together where the top of this sample moves along its normal.
    pub(crate) fn layers(&self, sample: &Sample) -> f64 {
        if self.boundary.is_periodic() {
            self.height(sample) / sample.mean_diameter
        } else {
            1.0
        }
    }

    /// H (m) of this sample with its walls: estimated, or that of its file.
    pub(crate) fn height(&self, sample: &Sample) -> f64 {
        match &self.origin {
            Origin::Insertion(_) => derived::packed_height(sample),
            Origin::Packing(file) => file.height(),
            Origin::StageBefore { height } => *height,
        }
    }

    /// The servo that moves the top wall of this sample, if one does.
    pub fn servo(&self, sample: &Sample) -> Option<Servo> {
        match self.load.control {
            Control::Mass | Control::Volume => None,
            Control::Servo { gain, speed_max } => Some(Servo {
                gain: gain / sample.base(),
                fastest: speed_max,
            }),
        }
    }

    /// δ̄ (m) at the greatest pressure, with the attraction.
    pub(crate) fn greatest_overlap(&self, law: &Law, contact: &Contact, sample: &Sample) -> f64 {
        let pressure = self.shear.greatest_pressure(self.load.pressure);
        let section = sample.mean_section();
        let attraction = derived::attraction_under(pressure * section, contact, sample);
        let most = pressure + attraction / section;
        match derived::stiffness_number(law, sample, most) {
            Some(kappa) if most > self.load.pressure => sample.mean_diameter / kappa,
            _ => self.load.mean_overlap(sample),
        }
    }
}

/// What the keys of a shear say by themselves.
pub(crate) struct ShearTables {
    boundary: &'static Boundary,
    removes: bool,
    pub(crate) pack: Pack,
    output: Output,
    analysis: Analysis,
}

/// Checks each key by itself. `is_first`: no other stage comes before the shear.
pub(crate) fn check(
    c: &mut Checker<'_>,
    law: &Law,
    boundary: &'static Boundary,
    is_first: bool,
) -> ShearTables {
    load::check(c, boundary);
    let pack = if is_first {
        check_pack(c)
    } else {
        check_after_strain(c)
    };
    protocol::check(c, boundary);
    if !boundary.is_periodic() {
        let why = "applies to sample.boundary = \"periodic\"";
        c.useless(&LOAD.solid_fraction, why);
    }
    if boundary.has_planes()
        && !law.has_flat_limit()
        && let Some(walls) = c.choice(&SAMPLE.walls)
    {
        let what = format!(
            "{walls:?} has no meaning with contact.law = {:?}: cylinders on a plane approach by the logarithm of its radius; give contact.law = \"hooke\", or walls of grains",
            law.kind().name
        );
        c.refuse(&SAMPLE.walls, &what);
    }
    if !boundary.has_walls() {
        refuse_walls(c, boundary, is_first);
    }
    if boundary.walls() < 2 {
        refuse_scalars(c, boundary);
    }
    let has_protocol = c.is_given(&SHEAR.protocol);
    if has_protocol && c.choice(&LOAD.control) == Some("volume") {
        let what = "says what the top wall does, and so do the parts of shear.protocol; leave it out, and give them wall_velocity = 0";
        c.refuse(&LOAD.control, what);
    }
    let removes = boundary.has_walls() && crate::sample::removes(c);
    if removes {
        refuse_with_removal(c);
    }
    let mut output = output::check(c, has_protocol);
    if removes {
        output.energy = false;
        c.fill(&OUTPUT.energy, false);
    }
    let analysis = output::check_analysis(c, has_protocol, &output);
    ShearTables {
        boundary,
        removes,
        pack,
        output,
        analysis,
    }
}

/// The shear of this sample.
pub(crate) fn derive(
    c: &mut Checker<'_>,
    tables: ShearTables,
    law: &Law,
    masses: &Masses,
    walled: Walled,
) -> Result<(Sample, PlaneShear)> {
    let ShearTables {
        boundary,
        removes,
        pack,
        output,
        analysis,
    } = tables;
    let Walled {
        sample,
        origin,
        walls,
        wall_layers,
    } = walled;
    let load = load::derive(c, law, masses, &sample)?;
    if !pack.skip {
        load::check_packable(c, law, &sample, &load);
    }
    let shear = protocol::derive(c, law, &sample, &load, boundary)?;
    c.settle()?;
    let contact_time = derived::contact_time(law, &sample, load.mean_overlap(&sample));
    // Values that are each within their bounds can still overflow together, such as a radius of
    // 1e-200 m squared.
    let derived = [
        ("pressure", load.pressure),
        ("normal force", load.normal_force),
        ("mean volume of a grain", sample.mean_volume),
        ("time scale of a contact", contact_time),
    ];
    if let Some((name, x)) = derived.iter().find(|(_, x)| !x.is_normal()) {
        return Err(c.out_of_range(&format!(
            "the {name} comes out as {x:?}; check the units (SI) of [material], [sample] and [load]"
        )));
    }
    let plane_shear = PlaneShear {
        origin,
        boundary,
        walls,
        wall_layers,
        removes,
        load,
        pack,
        shear,
        output,
        analysis,
        observables: Vec::new(),
        log_columns: None,
    };
    Ok((sample, plane_shear))
}

/// Refuses scalars of frames, which need two walls.
fn refuse_scalars(c: &mut Checker<'_>, boundary: &Boundary) {
    if c.flag(&ANALYSIS.scalars) == Some(true) {
        let what = format!(
            "needs walls, but sample.boundary = {:?}; leave it out",
            boundary.key
        );
        c.refuse(&ANALYSIS.scalars, &what);
    }
}

/// Refuses what needs all of the grains.
fn refuse_with_removal(c: &mut Checker<'_>) {
    let budget = "what removed grains take away is not in the energy budget";
    for (key, needs) in [
        (&OUTPUT.energy, budget),
        (&ANALYSIS.scalars, "scalars of frames are of all grains"),
    ] {
        if c.is_given(key) && c.flag(key) == Some(true) {
            let what = format!("{needs}, but sample.outside = \"remove\"; leave it out");
            c.refuse(key, &what);
        }
    }
}

/// Refuses what needs a wall. `is_first`: no other stage comes before the shear.
fn refuse_walls(c: &mut Checker<'_>, boundary: &Boundary, is_first: bool) {
    if c.number(&LOAD.gravity).is_some_and(|g| g > 0.0) {
        let what = format!(
            "needs walls, but sample.boundary = {:?}; leave it out",
            boundary.key
        );
        c.refuse(&LOAD.gravity, &what);
    }
    if is_first && c.is_given(&SAMPLE.packing) && c.flag(&PACK.skip) == Some(false) {
        let what = "a packing in a periodic cell is sheared as it is; leave it out";
        c.refuse(&PACK.skip, what);
    }
}

/// The keys of a shear whose sample strain steps leave, in a cell whose lengths they may change.
fn check_after_strain(c: &mut Checker<'_>) -> Pack {
    let why = "packs a sample, and the strain steps before the shear leave one; leave [pack] out";
    for key in PackKeys::TABLE.own {
        c.refuse_useless(key, why);
    }
    let why = "is by the lengths of the cell, which the strain steps before the shear may change";
    for (key, other) in [
        (&LOAD.normal_force, &LOAD.pressure),
        (&SHEAR.spring_number, &SHEAR.spring_stiffness),
    ] {
        c.refuse_useless(key, &format!("{why}; give {}", other.path));
    }
    let why = "stretches a packed sample, and strain steps come before the shear";
    c.useless(&LOAD.solid_fraction, why);
    Pack {
        skip: true,
        friction: 0.0,
        drag: 0.0,
        tolerance: 0.0,
        max_steps: 0,
    }
}

fn check_pack(c: &mut Checker<'_>) -> Pack {
    let keys = &PACK;
    let packing = c.is_given(&SAMPLE.packing);
    let skip = c.flag(&keys.skip).unwrap_or(packing);
    c.fill(&keys.skip, skip);
    if skip && !packing {
        let what =
            "inserted grains are loose and must be packed; give sample.packing, or leave it out";
        c.refuse(&keys.skip, what);
    }
    if skip {
        let compression: [&Key; 4] = [&keys.friction, &keys.drag, &keys.tolerance, &keys.max_steps];
        c.omit(&compression);
        let skipped = c.mention(&keys.skip, "the default with sample.packing");
        let what = format!(
            "says how to pack, but pack.skip = true ({skipped}); leave it out, or give pack.skip = false"
        );
        for key in compression {
            if packing && c.is_given(key) {
                c.refuse(key, &what);
            }
        }
    }
    if !skip && packing && c.text(&SAMPLE.walls) == Some("types") {
        c.refuse(
            &keys.skip,
            "contradicts sample.walls = \"types\": a sample that is compressed gets its walls afterwards; leave out one of the two",
        );
    }
    Pack {
        skip,
        friction: c.number_or_default(&keys.friction),
        drag: c.number_or_default(&keys.drag),
        tolerance: c.number_or_default(&keys.tolerance),
        max_steps: c.count(&keys.max_steps),
    }
}
