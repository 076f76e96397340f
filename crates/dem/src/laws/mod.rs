//! The contact laws: one law, one file. [`LAWS`] is the only list of them; a program adds laws of
//! its own by [`register`].
//!
//! The file of a law has its formulas and their source, its keys with defaults and limits, its
//! stability and its derivatives. To add a law, write its file and add it to [`LAWS`].

mod adhering;
pub mod ageing;
pub mod damping;
pub mod hertz;
pub mod hooke;
pub mod keys;
pub mod lee_hurley;
pub mod mindlin;
pub mod mixture;
pub mod rolling;
mod rolling_spheres;
pub mod tsuji;

use std::fmt::Debug;
use std::sync::{Arc, OnceLock};

use self::adhering::Adhering;
use self::keys::{Key, KeyReader};
pub use self::rolling_spheres::between_spheres;
use crate::contact::adhesion::AdhesionModel;
use crate::dimension::{Dimensions, Three, Two};
use crate::kernel::PairForce;
use crate::state::Masses;

/// The laws of this crate.
pub const LAWS: &[&LawKind] = &[
    &lee_hurley::KIND,
    &hooke::KIND,
    &hertz::KIND,
    &mindlin::KIND,
    &tsuji::KIND,
];

/// The laws that the program has registered.
static OWN: OnceLock<&'static [&'static LawKind]> = OnceLock::new();

/// Adds laws to [`LAWS`]: scenes can name them, and their keys are checked by their declarations.
/// A program calls it once, before it reads a scene or a file of a run; `examples/own_law` is one.
///
/// # Panics
/// If it is called twice, or two laws have the same name.
pub fn register(own: &'static [&'static LawKind]) {
    for (k, kind) in own.iter().enumerate() {
        let before = LAWS.iter().chain(&own[..k]);
        assert!(
            before.into_iter().all(|other| other.name != kind.name),
            "two contact laws are called {:?}",
            kind.name
        );
    }
    assert!(OWN.set(own).is_ok(), "contact laws are registered once");
}

/// Every law that a scene can name: [`LAWS`], then those of the program.
pub fn all() -> impl Iterator<Item = &'static LawKind> {
    let own = OWN.get().copied().unwrap_or_default();
    LAWS.iter().chain(own).copied()
}

/// A contact law before its constants are known.
#[derive(Debug)]
pub struct LawKind {
    /// The name in `contact.law`.
    pub name: &'static str,
    /// One line for the documentation.
    pub summary: &'static str,
    /// The dimensions in which it exists.
    pub dimensions: &'static [Dimensions],
    /// Whether it has rolling resistance between disks; between spheres all laws have.
    pub rolling: bool,
    /// The keys it takes, in the order in which they are written.
    pub keys: &'static [&'static Key],
    /// Makes the constants from the keys' values.
    pub read: fn(&mut dyn KeyReader) -> Arc<dyn Constants>,
}

/// The law of this name, if there is one.
pub fn kind(name: &str) -> Option<&'static LawKind> {
    all().find(|kind| kind.name == name)
}

/// What all laws share: friction, rolling and twisting resistance, and adhesion.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// μ_s, sliding friction.
    pub friction: f64,
    /// μ_r, rolling friction.
    pub rolling_friction: f64,
    /// k_r/R_r² (N/m; Pa in 2D); `None`: [`Constants::rolling_stiffness`].
    pub rolling_stiffness: Option<f64>,
    /// η_r, rolling damping ratio.
    pub rolling_damping_ratio: f64,
    /// μ_w, twisting friction, of spheres.
    pub twisting_friction: f64,
    /// k_w/R_r² (N/m); `None`: that of rolling.
    pub twisting_stiffness: Option<f64>,
    /// η_w, twisting damping ratio.
    pub twisting_damping_ratio: f64,
    /// What holds the grains together beside the law; [`crate::adhesions`] has what there is.
    pub adhesion: Option<Arc<dyn AdhesionModel>>,
    /// ρ_i and ρ_j over that of the constants.
    pub relative_densities: [f64; 2],
}

impl Default for Contact {
    fn default() -> Self {
        Self::NONE
    }
}

impl Contact {
    /// Contacts without friction.
    pub const NONE: Self = Self {
        friction: 0.0,
        rolling_friction: 0.0,
        rolling_stiffness: None,
        rolling_damping_ratio: 0.0,
        twisting_friction: 0.0,
        twisting_stiffness: None,
        twisting_damping_ratio: 0.0,
        adhesion: None,
        relative_densities: [1.0; 2],
    };

    /// ρ_i and ρ_j, times a factor, of constants of this density.
    fn densities(&self, density: f64) -> [f64; 2] {
        self.relative_densities.map(|part| part * density)
    }

    /// Whether they resist rolling or twisting.
    pub fn resists_rotation(&self) -> bool {
        self.rolling_friction > 0.0 || self.twisting_friction > 0.0
    }

    /// The same without friction, rolling and twisting resistance, and adhesion.
    #[must_use]
    pub fn smooth(&self) -> Self {
        Self {
            friction: 0.0,
            rolling_friction: 0.0,
            twisting_friction: 0.0,
            adhesion: None,
            ..self.clone()
        }
    }
}

/// Stiffnesses and damping constants of one contact of two of the lightest grains, for the limit of
/// the time step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigidity {
    /// dF_n/dδ (N/m; Pa in 2D).
    pub normal: f64,
    /// The largest k_t (N/m; Pa in 2D).
    pub tangential: f64,
    /// The largest k_r/R² (N/m; Pa in 2D).
    pub rolling: f64,
    /// γ_n and γ_t (kg/s; per unit depth in 2D).
    pub damping: [f64; 2],
}

/// A law with its constants, before dimension, friction and rolling are chosen.
pub trait Constants: Debug + Send + Sync {
    /// How the masses of the grains follow from their sizes.
    fn masses(&self) -> Masses;

    /// k_n = F_n^e/δ (N/m; Pa in 2D) of two grains of radii r1, r2 (m) at the overlap δ (m).
    fn normal_stiffness(&self, r1: f64, r2: f64, overlap: f64) -> f64;

    /// The largest overlap (m) of two grains of radii r1, r2 (m) for which the law is valid.
    fn largest_overlap(&self, r1: f64, r2: f64) -> f64;

    /// Whether the contact of two grains has a limit for a radius that grows without bounds, which
    /// that of a grain and a flat wall then is.
    fn has_flat_limit(&self) -> bool {
        true
    }

    /// Upper bounds for the stiffness and damping of a contact of two grains of mass m (kg; kg/m in
    /// 2D) with F_n^e/δ = `secant`. `tangential`: whether contacts may stick.
    fn rigidity(&self, secant: f64, mass: f64, tangential: bool) -> Rigidity;

    /// The constants while a sample of this mean diameter (m) is packed under a pressure (Pa), if
    /// they differ.
    fn while_packing(&self, _mean_diameter: f64, _pressure: f64) -> Option<Arc<dyn Constants>> {
        None
    }

    /// The duration (s) of an undamped collision of two spheres of this radius (m) at this speed
    /// (m/s), if it depends on the speed.
    fn collision_time(&self, _radius: f64, _speed: f64) -> Option<f64> {
        None
    }

    /// E* (Pa) of Hertzian spheres, which may have JKR adhesion.
    fn contact_modulus(&self) -> Option<f64> {
        None
    }

    /// k_r/R_r² (N/m; Pa in 2D) of rolling resistance where the contacts have no other.
    fn rolling_stiffness(&self) -> Option<f64> {
        None
    }

    /// The value of a key that has a default and was not given.
    fn default_of(&self, _key: &Key) -> Option<f64> {
        None
    }

    /// Derived constants for the terminal and the report: symbol, value, unit.
    fn derived(&self) -> Vec<(&'static str, f64, &'static str)>;

    /// The law between disks, compiled for the friction and rolling resistance that the contacts
    /// have; `None` if there is none.
    fn disks(&self, _: &Contact) -> Option<Box<dyn PairForce<Two>>> {
        None
    }

    /// The law between spheres, likewise.
    fn spheres(&self, _: &Contact) -> Option<Box<dyn PairForce<Three>>> {
        None
    }
}

/// A law of a scene: its kind, the values of its keys, and its constants.
#[derive(Debug, Clone)]
pub struct Law {
    kind: &'static LawKind,
    given: Vec<(&'static Key, f64)>,
    /// The words of its keys that take one.
    chosen: Vec<&'static str>,
    constants: Arc<dyn Constants>,
}

impl Law {
    /// Reads the keys of a law. `values` collects the problems.
    pub fn read(kind: &'static LawKind, values: &mut dyn KeyReader) -> Self {
        let constants = (kind.read)(values);
        let (mut given, mut chosen) = (Vec::new(), Vec::new());
        for key in kind.keys {
            if let keys::Values::Text(_) = key.values {
                chosen.extend(values.choice(key));
            } else {
                let value = values.number(key).or_else(|| constants.default_of(key));
                given.extend(value.map(|value| (*key, value)));
            }
        }
        Self {
            kind,
            given,
            chosen,
            constants,
        }
    }

    /// A law with these constants and no values of keys.
    pub fn of(kind: &'static LawKind, constants: impl Constants + 'static) -> Self {
        Self {
            kind,
            given: Vec::new(),
            chosen: Vec::new(),
            constants: Arc::new(constants),
        }
    }

    /// The kind of law.
    pub fn kind(&self) -> &'static LawKind {
        self.kind
    }

    /// The values of its keys, given or default, in the order of [`LawKind::keys`].
    pub fn given(&self) -> &[(&'static Key, f64)] {
        &self.given
    }

    /// The value of a key, given or default; `None` if it has none.
    pub fn value(&self, key: &Key) -> Option<f64> {
        let mut given = self.given.iter();
        let (_, value) = given.find(|(own, _)| own.path == key.path)?;
        Some(*value)
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

/// Laws are equal if their kinds and values are.
impl PartialEq for Law {
    fn eq(&self, other: &Self) -> bool {
        let [one, two] = [self, other].map(|law| law.given.iter().map(|(key, x)| (key.path, *x)));
        self.kind.name == other.kind.name && one.eq(two) && self.chosen == other.chosen
    }
}

/// A dimension for which laws can be chosen at run time.
pub trait LawSpace: crate::dimension::Dimension {
    /// The forces of a law between grains of this dimension; `None` if it has none. Everything that
    /// evaluates a law, forces and stiffness matrix alike, chooses it here.
    fn pair_force(law: &Law, contact: &Contact) -> Option<Box<dyn PairForce<Self>>>;
}

impl LawSpace for Two {
    fn pair_force(law: &Law, contact: &Contact) -> Option<Box<dyn PairForce<Self>>> {
        let force = law.disks(contact)?;
        Some(Adhering::beside(force, contact.adhesion.as_ref()))
    }
}

impl LawSpace for Three {
    fn pair_force(law: &Law, contact: &Contact) -> Option<Box<dyn PairForce<Self>>> {
        let force = law.spheres(contact)?;
        Some(Adhering::beside(force, contact.adhesion.as_ref()))
    }
}
