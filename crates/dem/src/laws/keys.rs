//! Keys of the configuration: how one is declared, and those of the contact laws. Whoever reads the
//! configuration uses these declarations.

use std::ops::Bound::{self, Excluded, Included, Unbounded};
use std::ops::RangeBounds;

/// An interval of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The lower end.
    pub from: Bound<f64>,
    /// The upper end.
    pub to: Bound<f64>,
}

/// Every number.
pub const ANY: Bounds = Bounds::new(Unbounded, Unbounded);
/// x > 0.
pub const POSITIVE: Bounds = Bounds::new(Excluded(0.0), Unbounded);
/// x ≥ 0.
pub const NOT_NEGATIVE: Bounds = Bounds::new(Included(0.0), Unbounded);
/// 0 ≤ x < 1.
pub const BELOW_ONE: Bounds = Bounds::new(Included(0.0), Excluded(1.0));
/// 0 < x ≤ 1.
pub const UNIT: Bounds = Bounds::new(Excluded(0.0), Included(1.0));
/// 0 ≤ x ≤ 1.
pub const SHARE: Bounds = Bounds::new(Included(0.0), Included(1.0));
/// 0 ≤ x ≤ ½.
pub const POISSON: Bounds = Bounds::new(Included(0.0), Included(0.5));

impl Bounds {
    /// An interval with these ends.
    pub const fn new(from: Bound<f64>, to: Bound<f64>) -> Self {
        Self { from, to }
    }

    /// Whether a number lies in the interval; NaN lies in none.
    pub fn hold(&self, x: f64) -> bool {
        !x.is_nan() && (self.from, self.to).contains(&x)
    }

    /// What a number must be, for messages: "must be greater than 0", "must lie in \[0, 1)".
    pub fn words(&self) -> String {
        let (open, from) = match self.from {
            Included(x) => ("[", short(x)),
            Excluded(x) => ("(", short(x)),
            Unbounded => ("(", "-∞".into()),
        };
        let (to, close) = match self.to {
            Included(x) => (short(x), "]"),
            Excluded(x) => (short(x), ")"),
            Unbounded => match self.from {
                Included(_) => return format!("must be {from} or greater"),
                Excluded(_) => return format!("must be greater than {from}"),
                Unbounded => ("∞".into(), ")"),
            },
        };
        format!("must lie in {open}{from}, {to}{close}")
    }

    /// The interval as a formula: "> 0", "0 ≤ x < 1", "0 … 0.5"; empty for every number.
    pub fn formula(&self) -> String {
        let from = match self.from {
            Included(x) => Some(("≥", "≤", short(x))),
            Excluded(x) => Some((">", "<", short(x))),
            Unbounded => None,
        };
        let to = match self.to {
            Included(x) => Some(("≤", short(x))),
            Excluded(x) => Some(("<", short(x))),
            Unbounded => None,
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

/// Integers from … to, both included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Integers {
    /// The least.
    pub from: i64,
    /// The greatest.
    pub to: i64,
}

/// n ≥ 0.
pub const FROM_ZERO: Integers = Integers {
    from: 0,
    to: i64::MAX,
};
/// n ≥ 1.
pub const FROM_ONE: Integers = Integers {
    from: 1,
    to: i64::MAX,
};

impl Integers {
    /// What a number must be, for messages.
    pub fn words(&self) -> String {
        let Integers { from, to } = self;
        if *to == i64::MAX {
            format!("must be {from} or greater")
        } else {
            format!("must lie in {from} … {to}")
        }
    }
}

/// The values that a key takes.
#[derive(Debug, Clone, Copy)]
pub enum Values {
    /// A number.
    Number(Bounds),
    /// A list of numbers.
    Numbers(Bounds),
    /// An integer.
    Whole(Integers),
    /// True or false.
    Flag,
    /// One of these strings; any string if there are none.
    Text(&'static [&'static str]),
    /// One of these strings, which the program knows when it runs.
    Word(fn() -> Vec<&'static str>),
    /// A list of names.
    Names,
    /// A list of tables of numbers with these keys: the parts of a protocol.
    Parts(&'static [&'static Key]),
    /// A list of tables with these keys.
    Tables(fn() -> Vec<&'static Key>),
}

/// When the value of a key may change after a run has begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Never: the key decides the grains, or what a checkpoint stores of them.
    Never,
    /// Only in a branch, because the key decides the trajectory.
    Branch,
    /// At every resume: the key decides where a stage ends.
    End,
    /// At every resume: output and bookkeeping, which do not reach the trajectory.
    Resume,
}

impl Change {
    /// Whether the key belongs to the identity of a run.
    pub fn is_physics(self) -> bool {
        matches!(self, Change::Never | Change::Branch)
    }

    /// The word in docs/reference/keys.md.
    pub fn name(self) -> &'static str {
        match self {
            Change::Never => "never",
            Change::Branch => "branch",
            Change::End | Change::Resume => "resume",
        }
    }
}

/// A key of the configuration. Checks, messages, `scene.toml`, the table of
/// docs/reference/keys.md and the JSON schema are made from its declaration.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// The table and the name: `material.young_modulus`.
    pub path: &'static str,
    /// The meaning, in Markdown.
    pub doc: &'static str,
    /// Empty for a pure number.
    pub unit: &'static str,
    /// The values that it takes.
    pub values: Values,
    /// What else is asked of a value, in Markdown.
    pub condition: &'static str,
    /// A constant default, as text; empty for a key without one. A scene with it has the identity
    /// of one without the key, so that runs of earlier versions can be resumed.
    pub default: &'static str,
    /// What applies if the key is not given and has no constant default, in Markdown.
    pub otherwise: &'static str,
    /// What it is, in a few words or as a symbol in ASCII, for the message that it is missing.
    pub what: &'static str,
    /// An example for that message.
    pub example: &'static str,
    /// When it may change after a run has begun.
    pub change: Change,
}

impl Key {
    /// A number without bounds, unit and default.
    pub const PLAIN: Self = Self {
        path: "",
        doc: "",
        unit: "",
        values: Values::Number(ANY),
        condition: "",
        default: "",
        otherwise: "",
        what: "",
        example: "",
        change: Change::Branch,
    };

    /// A number within these bounds.
    pub const fn number(path: &'static str, bounds: Bounds) -> Self {
        Self {
            path,
            values: Values::Number(bounds),
            ..Self::PLAIN
        }
    }

    /// With a symbol or a few words for the message that it is missing, a unit, and an example.
    pub const fn such_as(
        self,
        what: &'static str,
        unit: &'static str,
        example: &'static str,
    ) -> Self {
        Self {
            unit,
            what,
            example,
            ..self
        }
    }

    /// With this meaning.
    pub const fn doc(self, doc: &'static str) -> Self {
        Self { doc, ..self }
    }

    /// With what applies if it is not given.
    pub const fn otherwise(self, otherwise: &'static str) -> Self {
        Self { otherwise, ..self }
    }

    /// The name without the table.
    pub fn name(&self) -> &'static str {
        self.path
            .split_once('.')
            .map_or(self.path, |(_, name)| name)
    }

    /// The table; empty for a key above all tables.
    pub fn table(&self) -> &'static str {
        self.path.split_once('.').map_or("", |(table, _)| table)
    }

    /// What a configuration without this key lacks: `grains: the number of grains, such as …`.
    pub fn lacking(&self) -> String {
        let unit = match self.unit {
            "" => String::new(),
            unit => format!(" ({unit})"),
        };
        let (name, what, example) = (self.name(), self.what, self.example);
        format!("{name}: {what}{unit}, such as {name} = {example}")
    }

    /// The constant default of a number.
    pub fn default_number(&self) -> Option<f64> {
        self.default.parse().ok()
    }
}

/// E.
pub const YOUNG_MODULUS: Key = Key::number("material.young_modulus", POSITIVE)
    .such_as("E", "Pa", "1e9")
    .doc("Young's modulus E of the grains");
/// ν.
pub const POISSON_RATIO: Key = Key::number("material.poisson_ratio", POISSON)
    .such_as("nu", "", "0.2")
    .doc("Poisson's ratio ν of the grains");
/// ρ.
pub const DENSITY: Key = Key::number("material.density", POSITIVE)
    .such_as("rho", "kg/m³", "2500.0")
    .doc("density ρ of the grains");
/// m.
pub const MASS: Key = Key::number("material.mass", POSITIVE)
    .such_as("m", "kg, in 2D kg/m", "1.0")
    .doc("mass m of every grain, whatever its size, instead of ρ");
/// k_n of a linear spring.
pub const NORMAL_STIFFNESS: Key = Key::number("contact.normal_stiffness", POSITIVE)
    .such_as("k_n", "N/m, in 2D Pa", "1e8")
    .doc("normal stiffness k_n");
/// k_t of a linear spring.
pub const TANGENTIAL_STIFFNESS: Key = Key::number("contact.tangential_stiffness", POSITIVE)
    .such_as("k_t", "N/m, in 2D Pa", "3e7")
    .doc("tangential stiffness k_t, at most k_n")
    .otherwise("(2/7) k_n");
/// k_n of a spring F = k δ^(3/2).
pub const NORMAL_STIFFNESS_3_2: Key = Key {
    unit: "N/m^1.5, in 2D N/m^2.5",
    example: "1e10",
    ..NORMAL_STIFFNESS
};
/// k_t of a spring F = k δ^(1/2) t.
pub const TANGENTIAL_STIFFNESS_3_2: Key = Key {
    unit: "N/m^1.5, in 2D N/m^2.5",
    example: "3e9",
    ..TANGENTIAL_STIFFNESS
};
/// γ_n.
pub const NORMAL_DAMPING: Key = Key::number("contact.normal_damping", NOT_NEGATIVE)
    .such_as("gamma_n", "1/(m s)", "6e7")
    .doc("normal damping γ_n");
/// γ_t.
pub const TANGENTIAL_DAMPING: Key = Key::number("contact.tangential_damping", NOT_NEGATIVE)
    .such_as("gamma_t", "1/(m s)", "3e7")
    .doc("tangential damping γ_t")
    .otherwise("γ_n/2");
/// γ_t/γ_n.
pub const TANGENTIAL_DAMPING_RATIO: Key =
    Key::number("contact.tangential_damping_ratio", NOT_NEGATIVE)
        .such_as("gamma_t/gamma_n", "", "0.5")
        .doc("tangential over normal damping, γ_t/γ_n")
        .otherwise("0.5");
/// The speed of an impact.
pub const IMPACT_SPEED: Key = Key::number("contact.impact_speed", POSITIVE)
    .such_as(
        "the speed at which two equal spheres collide with that restitution",
        "m/s",
        "25.0",
    )
    .doc("with `restitution`: the speed at which two equal spheres collide with that restitution");
/// The diameter of the colliding spheres.
pub const IMPACT_DIAMETER: Key = Key::number("contact.impact_diameter", POSITIVE)
    .such_as("the diameter of those spheres", "m", "3e-3")
    .doc("with `impact_speed`: the diameter of those spheres");
/// α.
pub const DAMPING_RATIO: Key = Key::number("contact.damping_ratio", BELOW_ONE)
    .such_as("alpha", "", "0.1")
    .doc("normal and tangential damping ratio α");
/// The share of the tangential damper that acts on sliding contacts.
pub const SLIDING_DAMPING: Key = Key {
    default: "0.0",
    ..Key::number("contact.sliding_damping", SHARE)
        .such_as(
            "the share of the tangential damper that acts on sliding contacts",
            "",
            "1.0",
        )
        .doc("share of the tangential damper that acts on sliding contacts, too")
};
/// β of contacts that age.
pub const AGEING: Key = Key {
    default: "0.0",
    ..Key::number("contact.ageing", NOT_NEGATIVE)
        .such_as("beta", "", "0.02")
        .doc("growth β of friction with the age θ of a contact, μ_s (1 + β ln(1 + θ/θ_0))")
};
/// θ_0 of contacts that age.
pub const AGEING_TIME: Key = Key {
    condition: "with `ageing`",
    ..Key::number("contact.ageing_time", POSITIVE)
        .such_as("theta_0", "s", "1e-4")
        .doc("time θ_0 of ageing")
};
/// D of contacts that age.
pub const AGEING_SLIP: Key = Key {
    condition: "with `ageing`",
    ..Key::number("contact.ageing_slip", POSITIVE)
        .such_as("D", "m", "1e-6")
        .doc("slip D of a contact that makes it e times younger; without it slip does not")
        .otherwise("none")
};
/// The values of [`TANGENTIAL_HISTORY`].
pub const HISTORIES: [&str; 2] = ["displacement", "force"];
/// What a contact remembers of its tangential spring.
pub const TANGENTIAL_HISTORY: Key = Key {
    values: Values::Text(&HISTORIES),
    default: HISTORIES[0],
    change: Change::Never,
    ..Key::number("contact.tangential_history", ANY)
        .doc("history of the tangential spring: its displacement, or its force, rescaled while the contact area shrinks")
};
/// e.
pub const RESTITUTION: Key = Key::number("contact.restitution", UNIT)
    .such_as("e", "", "0.73")
    .doc("coefficient of restitution e, instead of the damping");

/// Reads the values of a law's keys from a configuration, and collects the errors.
pub trait KeyReader {
    /// A number within the key's bounds; `None` if it is not given.
    fn number(&mut self, key: &Key) -> Option<f64>;
    /// The word of a key that takes one of several; `None` stands for its default.
    fn choice(&mut self, _key: &Key) -> Option<&'static str> {
        None
    }
    /// A number that must be given; NaN if it is not.
    fn required(&mut self, key: &Key) -> f64;
    /// Ways to give one quantity, of which exactly one must be given. Returns its place; `what`
    /// names the ways.
    fn exactly_one(&mut self, keys: &[&Key], what: &str) -> usize;
    /// Refuses a key that means nothing beside the others.
    fn useless(&mut self, key: &Key, why: &str);
    /// Refuses the value of a key.
    fn refuse(&mut self, key: &Key, what: &str);
}
