//! Columns of one's own in the time series of a shear: reductions over grains or contacts, and
//! formulas of other columns.
//!
//! An [`Observable`] sees every grain and every contact of the sample once, on whichever rank and
//! thread they are, and adds to [`Total`]s. These are exact: sums are those of
//! [`LongSum`](crate::domain::LongSum), so that a value has the same bits on any ranks and threads.
//! Nothing here changes the state.
//!
//! [`GrainReduction`] and [`PlaneStress`] are those that a scene can describe. A program adds
//! others by [`register`].

mod expression;
mod grain_reduction;
mod measure;
mod plane_stress;
mod total;

use std::fmt;
use std::sync::{Arc, OnceLock};

pub use self::expression::{BadExpression, Expression, functions, is_reserved};
pub use self::grain_reduction::{
    GrainQuantity, GrainReduction, Quantity, Reduction, Selection, quantities,
};
pub use self::measure::{Measured, measure};
pub use self::plane_stress::{PlaneStress, StressComponent};
pub use self::total::Total;

use crate::columns::Column;
use crate::dimension::Dimensions;
use crate::laws::keys::{Key, KeyReader};

/// The sample at the end of a step, as observables see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleView {
    /// Disks or spheres.
    pub dimension: Dimensions,
    /// t (s).
    pub time: f64,
    /// L_x, in 3D L_y, and along the last axis h (m), the column `wall_height`; 1 along an axis
    /// that two dimensions lack.
    pub lengths: [f64; 3],
    /// The height (m) of the bottom, from which h counts.
    pub bottom: f64,
    /// Whether the sample is periodic along its last axis, too.
    pub is_periodic: bool,
}

impl SampleView {
    /// The last axis: that of the heights.
    pub fn up(&self) -> usize {
        self.dimension.axes() - 1
    }

    /// h (m).
    pub fn height(&self) -> f64 {
        self.lengths[self.up()]
    }

    /// Area of a plane across the last axis (m²; length, m, in 2D).
    pub fn base(&self) -> f64 {
        self.lengths[..self.up()].iter().product()
    }
}

/// A grain of the sample. Components that two dimensions lack are 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grain {
    /// Id.
    pub id: u32,
    /// Free, or of a wall; see [`body`](crate::state::body).
    pub body: u32,
    /// Number of its material, from 0.
    pub material: u64,
    /// R (m).
    pub radius: f64,
    /// m (kg; kg/m in 2D).
    pub mass: f64,
    /// Moment of inertia (kg m²; kg m in 2D).
    pub inertia: f64,
    /// Wrapped position of the centre (m).
    pub position: [f64; 3],
    /// Velocity (m/s) at the end of the step.
    pub velocity: [f64; 3],
    /// Velocity (m/s) less that with which a grain streams in a sheared cell without walls.
    pub peculiar_velocity: [f64; 3],
    /// Angular velocity (rad/s); of disks about z.
    pub angular_velocity: [f64; 3],
    /// Number of its contacts, with grains and flat walls.
    pub contacts: u32,
    /// Sum of the normal forces of its contacts (N; N/m in 2D).
    pub normal_force: f64,
    /// Number of its contacts with the bottom and with the top wall, of grains or flat.
    pub wall_contacts: [u32; 2],
}

/// A contact of the sample, between two grains or of a grain with a flat wall. Components that two
/// dimensions lack are 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The ids of grains i < j; N for a flat bottom, N + 1 for a flat top as j.
    pub ids: [u32; 2],
    /// Their bodies.
    pub bodies: [u32; 2],
    /// Their radii (m); 0 of a flat wall.
    pub radii: [f64; 2],
    /// Wrapped position of the centre of i (m).
    pub position: [f64; 3],
    /// Separation of i from j (m): the centre of j, or its point of a flat wall, is at `position`
    /// less this.
    pub separation: [f64; 3],
    /// Force on i (N; N/m in 2D); that on j is opposite.
    pub force: [f64; 3],
    /// F_n (N; N/m in 2D), less an attraction.
    pub normal_force: f64,
    /// δ (m).
    pub overlap: f64,
}

/// What an observable must be given, so that the others cost nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// The fields of [`Grain`] that follow from its contacts.
    pub contacts_of_grains: bool,
    /// [`Observable::contact`].
    pub contacts: bool,
    /// [`Total::least`] and [`Total::greatest`].
    pub extremes: bool,
}

impl Needs {
    /// Everything.
    pub const ALL: Self = Self {
        contacts_of_grains: true,
        contacts: true,
        extremes: true,
    };
    /// Grains without their contacts, sums and counts.
    pub const GRAINS: Self = Self {
        contacts_of_grains: false,
        contacts: false,
        extremes: false,
    };

    /// What either needs.
    pub(crate) fn or(self, other: Self) -> Self {
        Self {
            contacts_of_grains: self.contacts_of_grains || other.contacts_of_grains,
            contacts: self.contacts || other.contacts,
            extremes: self.extremes || other.extremes,
        }
    }
}

/// A number of the sample.
pub trait Observable: fmt::Debug + Send + Sync {
    /// The number of its totals.
    fn totals(&self) -> usize {
        1
    }

    /// What it must be given.
    fn needs(&self) -> Needs {
        Needs::ALL
    }

    /// Adds a grain. Called once for every grain, of walls as well.
    fn grain(&self, _sample: &SampleView, _grain: &Grain, _totals: &mut [Total]) {}

    /// Adds a contact. Called once for every contact.
    fn contact(&self, _sample: &SampleView, _contact: &Contact, _totals: &mut [Total]) {}

    /// The number that follows from the totals of the whole sample.
    fn value(&self, sample: &SampleView, totals: &[Total]) -> f64;
}

/// How a value of the time series comes about.
#[derive(Debug, Clone)]
pub enum Measure {
    /// From the grains and contacts.
    Sample(Arc<dyn Observable>),
    /// From the time and the columns before it.
    Columns(Expression),
}

/// A column of one's own.
#[derive(Debug, Clone)]
pub struct ObservableColumn {
    /// Name, unit and definition.
    pub column: Column,
    /// How its values come about.
    pub measure: Measure,
}

/// By their definitions.
impl PartialEq for ObservableColumn {
    fn eq(&self, other: &Self) -> bool {
        self.column == other.column
    }
}

/// A kind of observable that a program adds.
#[derive(Debug)]
pub struct ObservableKind {
    /// The name in `kind`.
    pub name: &'static str,
    /// One line for the documentation.
    pub summary: &'static str,
    /// Unit as [`Column::unit`] has it, unless a scene gives one.
    pub unit: &'static str,
    /// The keys it takes, `observable.NAME`, in the order in which they are written.
    pub keys: &'static [&'static Key],
    /// Makes the observable from the keys' values.
    pub read: fn(&mut dyn KeyReader, Dimensions) -> Arc<dyn Observable>,
}

/// The kinds that the program has registered.
static OWN: OnceLock<&'static [&'static ObservableKind]> = OnceLock::new();

/// Adds kinds of observables: scenes can name them, and their keys are checked by their
/// declarations. A program calls it once, before it reads a scene or a file of a run;
/// `examples/own_law` is one.
///
/// # Panics
/// If it is called twice, or two kinds have the same name.
pub fn register(own: &'static [&'static ObservableKind]) {
    for (k, kind) in own.iter().enumerate() {
        let mut before = own[..k].iter();
        assert!(
            before.all(|other| other.name != kind.name),
            "two kinds of observables are called {:?}",
            kind.name
        );
    }
    assert!(OWN.set(own).is_ok(), "observables are registered once");
}

/// Every kind that the program has registered.
pub fn all() -> impl Iterator<Item = &'static ObservableKind> {
    OWN.get().copied().unwrap_or_default().iter().copied()
}

/// The kind of this name, if there is one.
pub fn kind(name: &str) -> Option<&'static ObservableKind> {
    all().find(|kind| kind.name == name)
}
