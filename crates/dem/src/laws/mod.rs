//! The contact laws: one law, one file. [`LAWS`] is the only list of them.
//!
//! A law's file has its formulas and their source, its keys with defaults and limits, its stability
//! and its derivatives.

pub mod damping;
pub mod hertz;
pub mod hooke;
pub mod keys;
pub mod lee_hurley;
pub mod mindlin;
pub mod rolling;
pub mod tsuji;

use std::fmt::Debug;
use std::sync::Arc;

use self::keys::{Key, Values};
use crate::dimension::{Dimensions, Three, Two};
use crate::kernel::PairForce;
use crate::state::Masses;

/// Every law that a scene can name.
pub const LAWS: &[&LawKind] = &[
    &lee_hurley::KIND,
    &hooke::KIND,
    &hertz::KIND,
    &mindlin::KIND,
    &tsuji::KIND,
];

/// A contact law before its constants are known.
#[derive(Debug)]
pub struct LawKind {
    /// The name in `contact.law`.
    pub name: &'static str,
    /// One line for the documentation.
    pub summary: &'static str,
    /// The dimensions in which it exists.
    pub dimensions: &'static [Dimensions],
    /// Whether it knows rolling resistance, in two dimensions.
    pub rolling: bool,
    /// The keys it takes, in the order in which they are written.
    pub keys: &'static [&'static Key],
    /// Makes the constants from the keys' values.
    pub read: fn(&mut dyn Values) -> Arc<dyn Constants>,
}

/// The kind of this name.
pub fn kind(name: &str) -> Option<&'static LawKind> {
    LAWS.iter().copied().find(|kind| kind.name == name)
}

/// μ_s, μ_r and η_r: the limits of the contacts beside their springs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contact {
    /// μ_s.
    pub friction: f64,
    /// μ_r.
    pub rolling_friction: f64,
    /// η_r.
    pub rolling_damping_ratio: f64,
}

/// Stiffnesses and damping constants of one contact of two of the lightest grains, for the limit of
/// the time step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigidity {
    /// dF_n/dδ, the largest k_t, and the largest k_r/R² (N/m; Pa in 2D).
    pub normal: f64,
    pub tangential: f64,
    pub rolling: f64,
    /// γ_n and γ_t (kg/s; per unit depth in 2D).
    pub damping: [f64; 2],
}

/// A law with its constants, before dimension, friction and rolling are chosen.
pub trait Constants: Debug + Send + Sync {
    /// What gives the grains their masses.
    fn masses(&self) -> Masses;

    /// k_n = F_n^e/δ (N/m; Pa in 2D) of two grains of radii r1, r2 (m) at the overlap δ (m).
    fn normal_stiffness(&self, r1: f64, r2: f64, overlap: f64) -> f64;

    /// The largest overlap (m) within the law of two grains of radii r1, r2 (m).
    fn largest_overlap(&self, r1: f64, r2: f64) -> f64;

    /// Bounds for the stiffness of a contact of two grains of mass m (kg; kg/m in 2D) whose k_n is
    /// `secant`. `tangential`: whether contacts may stick.
    fn rigidity(&self, secant: f64, mass: f64, tangential: bool) -> Rigidity;

    /// The constants while a sample of this mean diameter (m) is packed under a pressure (Pa), if
    /// they differ.
    fn while_packing(&self, _mean_diameter: f64, _pressure: f64) -> Option<Arc<dyn Constants>> {
        None
    }

    /// How long two spheres of this radius (m) collide at this speed (m/s), without damping (s), if
    /// the duration depends on the speed.
    fn collision_time(&self, _radius: f64, _speed: f64) -> Option<f64> {
        None
    }

    /// The value of a key that has a default and was not given.
    fn default_of(&self, _key: &Key) -> Option<f64> {
        None
    }

    /// Derived constants for people: symbol, value, unit.
    fn derived(&self) -> Vec<(&'static str, f64, &'static str)>;

    /// The law between disks, with what the contacts have and nothing else compiled in.
    fn disks(&self, _: &Contact) -> Option<Box<dyn PairForce<Two>>> {
        None
    }

    /// The law between spheres.
    fn spheres(&self, _: &Contact) -> Option<Box<dyn PairForce<Three>>> {
        None
    }
}

/// A law of a scene: its kind, the values of its keys, and its constants.
#[derive(Debug, Clone)]
pub struct Law {
    kind: &'static LawKind,
    given: Vec<(&'static Key, f64)>,
    constants: Arc<dyn Constants>,
}

impl Law {
    /// The law with the values of its keys. Problems are noted by `values`.
    pub fn read(kind: &'static LawKind, values: &mut dyn Values) -> Self {
        let constants = (kind.read)(values);
        let given = kind.keys.iter().filter_map(|key| {
            let value = values.number(key).or_else(|| constants.default_of(key))?;
            Some((*key, value))
        });
        Self {
            kind,
            given: given.collect(),
            constants,
        }
    }

    /// A law of these constants, without the values that they come from.
    pub fn of(kind: &'static LawKind, constants: impl Constants + 'static) -> Self {
        Self {
            kind,
            given: Vec::new(),
            constants: Arc::new(constants),
        }
    }

    /// What the law is.
    pub fn kind(&self) -> &'static LawKind {
        self.kind
    }

    /// The values of its keys, given or default, in the order of the kind's keys.
    pub fn given(&self) -> &[(&'static Key, f64)] {
        &self.given
    }

    /// The law while a sample is packed; see [`Constants::while_packing`].
    #[must_use]
    pub fn while_packing(&self, mean_diameter: f64, pressure: f64) -> Self {
        let packing = self.constants.while_packing(mean_diameter, pressure);
        Self {
            constants: packing.unwrap_or_else(|| Arc::clone(&self.constants)),
            ..self.clone()
        }
    }
}

impl std::ops::Deref for Law {
    type Target = dyn Constants;

    fn deref(&self) -> &Self::Target {
        self.constants.as_ref()
    }
}

/// By kind and values.
impl PartialEq for Law {
    fn eq(&self, other: &Self) -> bool {
        let values = |law: &Self| -> Vec<(&'static str, f64)> {
            law.given.iter().map(|(key, x)| (key.path, *x)).collect()
        };
        self.kind.name == other.kind.name && values(self) == values(other)
    }
}

/// The dimensions in which laws make forces.
pub trait LawSpace: crate::dimension::Dimension {
    /// The law between this dimension's grains; `None` if it has none there.
    fn pair_force(law: &Law, contact: &Contact) -> Option<Box<dyn PairForce<Self>>>;
}

impl LawSpace for Two {
    fn pair_force(law: &Law, contact: &Contact) -> Option<Box<dyn PairForce<Self>>> {
        law.disks(contact)
    }
}

impl LawSpace for Three {
    fn pair_force(law: &Law, contact: &Contact) -> Option<Box<dyn PairForce<Self>>> {
        law.spheres(contact)
    }
}

/// Makes the instance of a law that has what the contacts have: `$law<…, FRICTION, ROLLING>`.
macro_rules! with_limits {
    ($contact:expr, $make:ident, $args:expr) => {{
        let contact: &$crate::laws::Contact = $contact;
        match (contact.friction > 0.0, contact.rolling_friction > 0.0) {
            (false, false) => $make::<false, false>($args),
            (false, true) => $make::<false, true>($args),
            (true, false) => $make::<true, false>($args),
            (true, true) => $make::<true, true>($args),
        }
    }};
}
pub(crate) use with_limits;
