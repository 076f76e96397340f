//! What a contact has apart from its grains, declared once: name, unit and order of the datasets
//! and of the columns of exports, and where the values are in a [`ContactSample`].

use std::mem::offset_of;
use std::slice::{from_mut, from_ref};

use bytemuck::{cast_slice, cast_slice_mut};
use gshear_dem::columns::Column;
use gshear_dem::state::ContactSample;
use hdf5::H5Type;
use hdf5::types::TypeDescriptor;
use serde::{Deserialize, Serialize};

const CONTACTS: &str = "connectivity/contacts";
/// Flat walls have it.
const WALL_CONTACTS: &str = "connectivity/wall_contacts";

const NORMAL_FORCE: Column = Column::new("normal_force", "N", "F_n");
const TANGENTIAL_FORCE: Column = Column::new("tangential_force", "N", "F_t");
/// What the values of a dataset are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// f64
    Number,
    /// i32
    Image,
    /// u32
    Id,
    /// u8
    Flag,
}

impl Kind {
    /// The type of a value in a file.
    pub(crate) fn element(self) -> TypeDescriptor {
        match self {
            Kind::Number => f64::type_descriptor(),
            Kind::Image => i32::type_descriptor(),
            Kind::Id => u32::type_descriptor(),
            Kind::Flag => u8::type_descriptor(),
        }
    }
}

/// What the frames of a file hold of grains and contacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a column that may be missing"
)]
pub struct FrameFormat {
    /// Dimensions.
    pub axes: usize,
    /// Whether contacts have the torques of spheres that resist rolling or twisting.
    pub torques: bool,
    /// Whether contacts say which are idle: files of earlier versions do not.
    pub idle: bool,
    /// Whether grains say which are removed: in scenes that remove grains.
    pub removed: bool,
    /// Whether there are contacts with flat walls: files of earlier versions leave them out.
    pub walls: bool,
    /// Whether contacts have their histories, which K of a frame needs.
    pub histories: bool,
    /// Whether contacts have their age: where friction grows with it, and with the histories.
    pub ages: bool,
}

impl FrameFormat {
    /// That of frames in so many dimensions, as this version writes them, without removal and flat
    /// walls, and of contacts that do not age.
    pub const fn new(axes: usize, torques: bool) -> Self {
        Self {
            axes,
            torques,
            idle: true,
            removed: false,
            walls: false,
            histories: true,
            ages: false,
        }
    }
}

/// Only files with [`FrameFormat::histories`] have these three. The unit is that of the law's
/// history.
pub(crate) const TANGENTIAL_HISTORY: Column =
    Column::new("tangential_history", "N", "history of F_t");
const ROLLING_HISTORY: Column = Column::new("rolling_history", "N m", "M^k");
const TWISTING_HISTORY: Column = Column::new("twisting_history", "N m", "T");
const OVERLAP: Column = Column::new("overlap", "m", "δ");
const SLIDING: Column = Column::new("sliding", "1", "at its limit");
const ROLLING: Column = Column::new("rolling", "1", "at its limit");
/// Only files of spheres that resist rolling or twisting have it.
pub(crate) const TWISTING: Column = Column::new("twisting", "1", "at its limit");
/// Files of earlier versions do not have it.
pub(crate) const IDLE: Column = Column::new("idle", "1", "spring and damper leave no force");

/// Only files with [`FrameFormat::ages`] have it.
pub(crate) const AGE: Column = Column::new("age", "s", "age of the contact");

/// A table of the contacts of a file, with a group of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactTable {
    /// Of grains with each other.
    Grains,
    /// Of grains with flat walls.
    Walls,
}

impl ContactTable {
    /// The tables of a file.
    pub fn of(form: FrameFormat) -> impl Iterator<Item = Self> {
        [Self::Grains, Self::Walls]
            .into_iter()
            .take(1 + usize::from(form.walls))
    }

    /// Its group.
    pub(crate) fn group(self) -> &'static str {
        match self {
            Self::Grains => CONTACTS,
            Self::Walls => WALL_CONTACTS,
        }
    }

    /// One of its datasets.
    pub(crate) fn dataset(self, name: impl std::fmt::Display) -> String {
        format!("{}/{name}", self.group())
    }

    /// What a contact is of besides its first grain.
    pub(crate) fn second(self) -> Column {
        match self {
            Self::Grains => Column::new("j", "1", "higher id"),
            Self::Walls => Column::new("wall", "1", "1 bottom, 2 top"),
        }
    }
}

/// A number, a flag, or the components of a vector, of a contact.
pub struct ContactQuantity {
    /// Name, unit and meaning.
    pub column: Column,
    /// Number or flag.
    pub(crate) kind: Kind,
    /// The first of its values in a record, counted in words of eight bytes.
    at: usize,
    /// Number of values of disks, of spheres, and of spheres that resist rolling or twisting; 0
    /// where there is none.
    widths: [usize; 3],
}

macro_rules! quantities {
    ($($kind:ident $column:ident: $field:ident[$first:literal], $widths:expr;)*) => {
        [$(ContactQuantity {
            column: $column,
            kind: Kind::$kind,
            at: offset_of!(ContactSample, $field) / size_of::<f64>() + $first,
            widths: $widths,
        }),*]
    };
}

/// In the order of the file: flags come last.
static ALL: [ContactQuantity; 12] = quantities! {
    Number NORMAL_FORCE: normal_force[0], [1, 1, 1];
    Number TANGENTIAL_FORCE: tangential_force[0], [1, 3, 3];
    Number TANGENTIAL_HISTORY: tangential_history[0], [1, 3, 3];
    Number ROLLING_HISTORY: rolling_history[0], [1, 0, 0];
    Number ROLLING_HISTORY: torques[0], [0, 0, 3];
    Number TWISTING_HISTORY: torques[3], [0, 0, 1];
    Number OVERLAP: overlap[0], [1, 1, 1];
    Number AGE: age[0], [1, 1, 1];
    Flag SLIDING: sliding[0], [1, 1, 1];
    Flag ROLLING: rolling[0], [1, 0, 1];
    Flag TWISTING: twisting[0], [0, 0, 1];
    Flag IDLE: idle[0], [1, 1, 1];
};

/// All quantities of a contact apart from its grains.
pub fn of_contacts(form: FrameFormat) -> impl Iterator<Item = &'static ContactQuantity> {
    ALL.iter().filter(move |quantity| quantity.width(form) > 0)
}

/// Its numbers.
pub(crate) fn numbers(form: FrameFormat) -> impl Iterator<Item = &'static ContactQuantity> {
    of_contacts(form).filter(|quantity| quantity.kind == Kind::Number)
}

/// Its flags.
pub(crate) fn flags(form: FrameFormat) -> impl Iterator<Item = &'static ContactQuantity> {
    of_contacts(form).filter(|quantity| quantity.kind == Kind::Flag)
}

impl ContactQuantity {
    /// Number of its values.
    pub fn width(&self, form: FrameFormat) -> usize {
        let histories = [TANGENTIAL_HISTORY, ROLLING_HISTORY, TWISTING_HISTORY];
        let is_history = histories.iter().any(|h| h.name == self.column.name);
        let is_missing = match self.column.name {
            name if name == IDLE.name => !form.idle,
            name if name == AGE.name => !form.ages,
            _ => is_history && !form.histories,
        };
        if is_missing {
            return 0;
        }
        match (form.axes, form.torques) {
            (2, _) => self.widths[0],
            (_, false) => self.widths[1],
            (_, true) => self.widths[2],
        }
    }

    /// Its values; a flag is 0 or 1.
    pub fn values(&self, form: FrameFormat, contact: &ContactSample) -> impl Iterator<Item = f64> {
        let (mut numbers, mut flag) = (&[][..], None);
        if self.kind == Kind::Flag {
            flag = Some(self.flag(contact).into());
        } else {
            numbers = self.numbers(form, contact);
        }
        numbers.iter().copied().chain(flag)
    }

    /// The values of numbers.
    pub(crate) fn numbers<'c>(&self, form: FrameFormat, contact: &'c ContactSample) -> &'c [f64] {
        &cast_slice(from_ref(contact))[self.at..][..self.width(form)]
    }

    /// The value of a flag.
    pub(crate) fn flag(&self, contact: &ContactSample) -> u8 {
        cast_slice::<_, u64>(from_ref(contact))[self.at] as u8
    }

    /// Sets numbers.
    pub(crate) fn set_numbers(&self, contact: &mut ContactSample, values: &[f64]) {
        cast_slice_mut(from_mut(contact))[self.at..][..values.len()].copy_from_slice(values);
    }

    /// Sets a flag.
    pub(crate) fn set_flag(&self, contact: &mut ContactSample, flag: u8) {
        cast_slice_mut(from_mut(contact))[self.at] = u64::from(flag);
    }
}
