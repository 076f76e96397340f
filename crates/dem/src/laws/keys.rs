//! What the configuration may say about a contact law, declared once for everybody who reads it.

/// A range of finite numbers.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// Whether the range holds a number.
    pub hold: fn(f64) -> bool,
    /// The range in words: "must be …".
    pub words: &'static str,
}

/// x > 0.
pub const POSITIVE: Bounds = Bounds {
    hold: |x| x > 0.0,
    words: "must be greater than 0",
};
/// x ≥ 0.
pub const NOT_NEGATIVE: Bounds = Bounds {
    hold: |x| x >= 0.0,
    words: "must be 0 or greater",
};
/// 0 ≤ x < 1.
pub const BELOW_ONE: Bounds = Bounds {
    hold: |x| (0.0..1.0).contains(&x),
    words: "must lie in [0, 1)",
};
/// 0 < x ≤ 1.
pub const UNIT: Bounds = Bounds {
    hold: |x| x > 0.0 && x <= 1.0,
    words: "must lie in (0, 1]",
};
/// 0 ≤ x ≤ ½.
pub const POISSON: Bounds = Bounds {
    hold: |x| (0.0..=0.5).contains(&x),
    words: "must lie in [0, 0.5]",
};

/// A number of the configuration that a law takes.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// The table and the name: `material.young_modulus`.
    pub path: &'static str,
    /// The symbol and its unit, in ASCII for messages: `E (Pa)`.
    pub symbol: &'static str,
    /// A value as an example.
    pub example: &'static str,
    /// The range of its values.
    pub bounds: Bounds,
    /// What it is, for the documentation.
    pub doc: &'static str,
    /// The default in words; empty for a key without one.
    pub default: &'static str,
}

impl Key {
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
        example: &'static str,
        bounds: Bounds,
        doc: &'static str,
    ) -> Self {
        Self {
            path,
            symbol,
            example,
            bounds,
            doc,
            default: "",
        }
    }

    const fn default(mut self, words: &'static str) -> Self {
        self.default = words;
        self
    }
}

/// E.
pub const YOUNG_MODULUS: Key = Key::new(
    "material.young_modulus",
    "E (Pa)",
    "1e9",
    POSITIVE,
    "Young's modulus E of the grains",
);
/// ν.
pub const POISSON_RATIO: Key = Key::new(
    "material.poisson_ratio",
    "nu",
    "0.2",
    POISSON,
    "Poisson's ratio ν of the grains",
);
/// ρ.
pub const DENSITY: Key = Key::new(
    "material.density",
    "rho (kg/m^3)",
    "2500.0",
    POSITIVE,
    "density ρ of the grains",
);
/// m.
pub const MASS: Key = Key::new(
    "material.mass",
    "m (kg; kg/m in 2D)",
    "1.0",
    POSITIVE,
    "mass m of every grain, whatever its size, instead of ρ",
);
/// k_n of a linear spring.
pub const NORMAL_STIFFNESS: Key = Key::new(
    "contact.normal_stiffness",
    "k_n (N/m; per unit depth, which is Pa, in 2D)",
    "1e8",
    POSITIVE,
    "normal stiffness k_n",
);
/// k_t of a linear spring.
pub const TANGENTIAL_STIFFNESS: Key = Key::new(
    "contact.tangential_stiffness",
    "k_t (N/m; per unit depth, which is Pa, in 2D)",
    "3e7",
    POSITIVE,
    "tangential stiffness k_t, at most k_n",
)
.default("(2/7) k_n");
/// k_n of a spring F = k δ^(3/2).
pub const NORMAL_STIFFNESS_3_2: Key = Key {
    symbol: "k_n (N/m^1.5; per unit depth in 2D)",
    example: "1e10",
    ..NORMAL_STIFFNESS
};
/// k_t of a spring F = k δ^(1/2) t.
pub const TANGENTIAL_STIFFNESS_3_2: Key = Key {
    symbol: "k_t (N/m^1.5; per unit depth in 2D)",
    example: "3e9",
    ..TANGENTIAL_STIFFNESS
};
/// γ_n.
pub const NORMAL_DAMPING: Key = Key::new(
    "contact.normal_damping",
    "gamma_n (1/(m s))",
    "6e7",
    NOT_NEGATIVE,
    "normal damping γ_n",
);
/// γ_t.
pub const TANGENTIAL_DAMPING: Key = Key::new(
    "contact.tangential_damping",
    "gamma_t (1/(m s))",
    "3e7",
    NOT_NEGATIVE,
    "tangential damping γ_t",
)
.default("γ_n/2");
/// γ_t/γ_n.
pub const TANGENTIAL_DAMPING_RATIO: Key = Key::new(
    "contact.tangential_damping_ratio",
    "gamma_t/gamma_n",
    "0.5",
    NOT_NEGATIVE,
    "tangential over normal damping, γ_t/γ_n",
)
.default("0.5");
/// The speed of an impact.
pub const IMPACT_SPEED: Key = Key::new(
    "contact.impact_speed",
    "the speed (m/s) at which two equal spheres collide with that restitution",
    "25.0",
    POSITIVE,
    "with `restitution`: the speed at which two equal spheres collide with that restitution",
);
/// The diameter of the colliding spheres.
pub const IMPACT_DIAMETER: Key = Key::new(
    "contact.impact_diameter",
    "the diameter (m) of those spheres",
    "3e-3",
    POSITIVE,
    "with `impact_speed`: the diameter of those spheres",
);
/// α.
pub const DAMPING_RATIO: Key = Key::new(
    "contact.damping_ratio",
    "alpha",
    "0.1",
    BELOW_ONE,
    "normal and tangential damping ratio α",
);
/// e.
pub const RESTITUTION: Key = Key::new(
    "contact.restitution",
    "e",
    "0.73",
    UNIT,
    "coefficient of restitution e, instead of the damping",
);

/// The values of a law's keys, from whoever reads the configuration. Problems are noted there.
pub trait Values {
    /// A number within the key's bounds; `None` if it is not given.
    fn number(&mut self, key: &Key) -> Option<f64>;
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
