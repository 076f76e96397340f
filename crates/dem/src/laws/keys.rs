//! What the configuration may say about a contact law, declared once for everybody who reads it.

use std::ops::{Bound, RangeBounds};

/// An interval of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The lower end.
    pub from: Bound<f64>,
    /// The upper end.
    pub to: Bound<f64>,
}

/// Every number.
pub const ANY: Bounds = Bounds {
    from: Bound::Unbounded,
    to: Bound::Unbounded,
};
/// x > 0.
pub const POSITIVE: Bounds = Bounds {
    from: Bound::Excluded(0.0),
    to: Bound::Unbounded,
};
/// x ≥ 0.
pub const NOT_NEGATIVE: Bounds = Bounds {
    from: Bound::Included(0.0),
    to: Bound::Unbounded,
};
/// 0 ≤ x < 1.
pub const BELOW_ONE: Bounds = Bounds {
    from: Bound::Included(0.0),
    to: Bound::Excluded(1.0),
};
/// 0 < x ≤ 1.
pub const UNIT: Bounds = Bounds {
    from: Bound::Excluded(0.0),
    to: Bound::Included(1.0),
};
/// 0 ≤ x ≤ 1.
pub const SHARE: Bounds = Bounds {
    from: Bound::Included(0.0),
    to: Bound::Included(1.0),
};
/// 0 ≤ x ≤ ½.
pub const POISSON: Bounds = Bounds {
    from: Bound::Included(0.0),
    to: Bound::Included(0.5),
};

impl Bounds {
    /// Whether a number lies in the interval; NaN lies in none.
    pub fn hold(&self, x: f64) -> bool {
        !x.is_nan() && (self.from, self.to).contains(&x)
    }

    /// What a number must be, for messages: "must be greater than 0", "must lie in \[0, 1)".
    pub fn words(&self) -> String {
        let (open, from) = match self.from {
            Bound::Included(x) => ("[", short(x)),
            Bound::Excluded(x) => ("(", short(x)),
            Bound::Unbounded => ("(", "-∞".into()),
        };
        let (to, close) = match self.to {
            Bound::Included(x) => (short(x), "]"),
            Bound::Excluded(x) => (short(x), ")"),
            Bound::Unbounded => match self.from {
                Bound::Included(_) => return format!("must be {from} or greater"),
                Bound::Excluded(_) => return format!("must be greater than {from}"),
                Bound::Unbounded => ("∞".into(), ")"),
            },
        };
        format!("must lie in {open}{from}, {to}{close}")
    }

    /// The interval as a formula: "> 0", "0 ≤ x < 1", "0 … 0.5"; empty for every number.
    pub fn formula(&self) -> String {
        let from = match self.from {
            Bound::Included(x) => Some(("≥", "≤", short(x))),
            Bound::Excluded(x) => Some((">", "<", short(x))),
            Bound::Unbounded => None,
        };
        let to = match self.to {
            Bound::Included(x) => Some(("≤", short(x))),
            Bound::Excluded(x) => Some(("<", short(x))),
            Bound::Unbounded => None,
        };
        match (from, to) {
            (None, None) => String::new(),
            (Some((over, _, from)), None) => format!("{over} {from}"),
            (None, Some((under, to))) => format!("{under} {to}"),
            (Some((_, "≤", from)), Some(("≤", to))) => format!("{from} … {to}"),
            (Some((_, over, from)), Some((under, to))) => format!("{from} {over} x {under} {to}"),
        }
    }
}

/// A limit to four digits.
fn short(x: f64) -> String {
    let rounded = format!("{x:.3e}").parse().unwrap_or(x);
    match x.abs() {
        large if large >= 1e7 => format!("{rounded:e}"),
        _ => format!("{rounded}"),
    }
}

/// A number of the configuration that a law takes.
#[derive(Debug, Clone, Copy)]
pub struct LawKey {
    /// The table and the name: `material.young_modulus`.
    pub path: &'static str,
    /// The symbol, or what it is, in ASCII for messages: `E`.
    pub symbol: &'static str,
    /// Empty for a pure number.
    pub unit: &'static str,
    /// A value as an example.
    pub example: &'static str,
    /// The range of its values.
    pub bounds: Bounds,
    /// What it is, for the documentation.
    pub doc: &'static str,
    /// The default in words; empty for a key without one.
    pub default: &'static str,
    /// A constant default, instead of one in words. A scene with it has the identity of one without
    /// the key, so that runs of earlier versions can be resumed.
    pub constant: Option<f64>,
}

impl LawKey {
    /// The name without the table.
    pub fn name(&self) -> &'static str {
        self.path
            .split_once('.')
            .map_or(self.path, |(_, name)| name)
    }

    /// The table.
    pub fn table(&self) -> &'static str {
        self.path
            .split_once('.')
            .map_or(self.path, |(table, _)| table)
    }

    const fn new(
        path: &'static str,
        symbol: &'static str,
        unit: &'static str,
        example: &'static str,
        bounds: Bounds,
        doc: &'static str,
    ) -> Self {
        Self {
            path,
            symbol,
            unit,
            example,
            bounds,
            doc,
            default: "",
            constant: None,
        }
    }

    const fn default(mut self, words: &'static str) -> Self {
        self.default = words;
        self
    }

    const fn constant(mut self, value: f64) -> Self {
        self.constant = Some(value);
        self
    }
}

/// E.
pub const YOUNG_MODULUS: LawKey = LawKey::new(
    "material.young_modulus",
    "E",
    "Pa",
    "1e9",
    POSITIVE,
    "Young's modulus E of the grains",
);
/// ν.
pub const POISSON_RATIO: LawKey = LawKey::new(
    "material.poisson_ratio",
    "nu",
    "",
    "0.2",
    POISSON,
    "Poisson's ratio ν of the grains",
);
/// ρ.
pub const DENSITY: LawKey = LawKey::new(
    "material.density",
    "rho",
    "kg/m³",
    "2500.0",
    POSITIVE,
    "density ρ of the grains",
);
/// m.
pub const MASS: LawKey = LawKey::new(
    "material.mass",
    "m",
    "kg, in 2D kg/m",
    "1.0",
    POSITIVE,
    "mass m of every grain, whatever its size, instead of ρ",
);
/// k_n of a linear spring.
pub const NORMAL_STIFFNESS: LawKey = LawKey::new(
    "contact.normal_stiffness",
    "k_n",
    "N/m, in 2D Pa",
    "1e8",
    POSITIVE,
    "normal stiffness k_n",
);
/// k_t of a linear spring.
pub const TANGENTIAL_STIFFNESS: LawKey = LawKey::new(
    "contact.tangential_stiffness",
    "k_t",
    "N/m, in 2D Pa",
    "3e7",
    POSITIVE,
    "tangential stiffness k_t, at most k_n",
)
.default("(2/7) k_n");
/// k_n of a spring F = k δ^(3/2).
pub const NORMAL_STIFFNESS_3_2: LawKey = LawKey {
    unit: "N/m^1.5, in 2D N/m^2.5",
    example: "1e10",
    ..NORMAL_STIFFNESS
};
/// k_t of a spring F = k δ^(1/2) t.
pub const TANGENTIAL_STIFFNESS_3_2: LawKey = LawKey {
    unit: "N/m^1.5, in 2D N/m^2.5",
    example: "3e9",
    ..TANGENTIAL_STIFFNESS
};
/// γ_n.
pub const NORMAL_DAMPING: LawKey = LawKey::new(
    "contact.normal_damping",
    "gamma_n",
    "1/(m s)",
    "6e7",
    NOT_NEGATIVE,
    "normal damping γ_n",
);
/// γ_t.
pub const TANGENTIAL_DAMPING: LawKey = LawKey::new(
    "contact.tangential_damping",
    "gamma_t",
    "1/(m s)",
    "3e7",
    NOT_NEGATIVE,
    "tangential damping γ_t",
)
.default("γ_n/2");
/// γ_t/γ_n.
pub const TANGENTIAL_DAMPING_RATIO: LawKey = LawKey::new(
    "contact.tangential_damping_ratio",
    "gamma_t/gamma_n",
    "",
    "0.5",
    NOT_NEGATIVE,
    "tangential over normal damping, γ_t/γ_n",
)
.default("0.5");
/// The speed of an impact.
pub const IMPACT_SPEED: LawKey = LawKey::new(
    "contact.impact_speed",
    "the speed at which two equal spheres collide with that restitution",
    "m/s",
    "25.0",
    POSITIVE,
    "with `restitution`: the speed at which two equal spheres collide with that restitution",
);
/// The diameter of the colliding spheres.
pub const IMPACT_DIAMETER: LawKey = LawKey::new(
    "contact.impact_diameter",
    "the diameter of those spheres",
    "m",
    "3e-3",
    POSITIVE,
    "with `impact_speed`: the diameter of those spheres",
);
/// α.
pub const DAMPING_RATIO: LawKey = LawKey::new(
    "contact.damping_ratio",
    "alpha",
    "",
    "0.1",
    BELOW_ONE,
    "normal and tangential damping ratio α",
);
/// The share of the tangential damper that acts on sliding contacts.
pub const SLIDING_DAMPING: LawKey = LawKey::new(
    "contact.sliding_damping",
    "the share of the tangential damper that acts on sliding contacts",
    "",
    "1.0",
    SHARE,
    "share of the tangential damper that acts on sliding contacts, too",
)
.constant(0.0);
/// e.
pub const RESTITUTION: LawKey = LawKey::new(
    "contact.restitution",
    "e",
    "",
    "0.73",
    UNIT,
    "coefficient of restitution e, instead of the damping",
);

/// Reads the values of a law's keys from a configuration, and collects the errors.
pub trait KeyReader {
    /// A number within the key's bounds; `None` if it is not given.
    fn number(&mut self, key: &LawKey) -> Option<f64>;
    /// A number that must be given; NaN if it is not.
    fn required(&mut self, key: &LawKey) -> f64;
    /// Ways to give one quantity, of which exactly one must be given. Returns its place; `what`
    /// names the ways.
    fn exactly_one(&mut self, keys: &[&LawKey], what: &str) -> usize;
    /// Refuses a key that means nothing beside the others.
    fn useless(&mut self, key: &LawKey, why: &str);
    /// Refuses the value of a key.
    fn refuse(&mut self, key: &LawKey, what: &str);
}
