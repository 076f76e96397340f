//! The contact law: `[material]` and `[contact]`.

use super::{Checker, DAMPING, Key, NOT_NEGATIVE, POSITIVE, UNIT, key};
use crate::config::checker::Bounds;
use crate::config::derived;
use crate::config::raw::{self, Number, Text, show};
use crate::config::scene::*;
use crate::config::write::DampingChoice;
use crate::state::Masses;

const POISSON: Bounds = Bounds {
    hold: |x| (0.0..=0.5).contains(&x),
    words: "must lie in [0, 0.5]",
};

/// What of `[contact]` only some laws have: of disks with a damping ratio, of linear springs, of spheres.
struct Keys {
    law: Key<Text>,
    young_modulus: Key<Number>,
    poisson_ratio: Key<Number>,
    density: Key<Number>,
    mass: Key<Number>,
    normal_stiffness: Key<Number>,
    tangential_stiffness: Key<Number>,
    normal_damping: Key<Number>,
    tangential_damping: Key<Number>,
    impact_speed: Key<Number>,
    impact_diameter: Key<Number>,
    damping_ratio: Key<Number>,
    restitution: Key<Number>,
}

const LEE_HURLEY: &str = Law::NAMES[0];
const HOOKE: &str = Law::NAMES[1];
const HERTZ: &str = Law::NAMES[2];
const MINDLIN: &str = Law::NAMES[3];

impl Keys {
    /// Which laws know a key.
    fn owners(&self) -> [(&Key<Number>, &'static [&'static str]); 11] {
        [
            (&self.young_modulus, &[LEE_HURLEY, HERTZ]),
            (&self.poisson_ratio, &[LEE_HURLEY, HERTZ]),
            (&self.mass, &[MINDLIN]),
            (&self.normal_stiffness, &[HOOKE, MINDLIN]),
            (&self.tangential_stiffness, &[HOOKE, MINDLIN]),
            (&self.normal_damping, &[HERTZ]),
            (&self.tangential_damping, &[HERTZ]),
            (&self.impact_speed, &[HERTZ]),
            (&self.impact_diameter, &[HERTZ]),
            (&self.damping_ratio, &[LEE_HURLEY, HOOKE]),
            (&self.restitution, &[LEE_HURLEY, HOOKE, HERTZ]),
        ]
    }
}

/// The law with its constants, what all contacts have, and how the damping was given.
pub(super) fn check(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    material: raw::Material,
    contact: raw::Contact,
) -> (Law, Contact, DampingChoice) {
    let friction = key!(contact.friction);
    let rolling_friction = key!(contact.rolling_friction);
    let rolling_damping = key!(contact.rolling_damping_ratio);
    let keys = Keys {
        law: key!(contact.law),
        young_modulus: key!(material.young_modulus),
        poisson_ratio: key!(material.poisson_ratio),
        density: key!(material.density),
        mass: key!(material.mass),
        normal_stiffness: key!(contact.normal_stiffness),
        tangential_stiffness: key!(contact.tangential_stiffness),
        normal_damping: key!(contact.normal_damping),
        tangential_damping: key!(contact.tangential_damping),
        impact_speed: key!(contact.impact_speed),
        impact_diameter: key!(contact.impact_diameter),
        damping_ratio: key!(contact.damping_ratio),
        restitution: key!(contact.restitution),
    };
    let name = name(c, dimension, &keys);
    if dimension == Dimensions::Three {
        let why = "rolling resistance is between disks; with dimension = 3 there is none";
        c.useless(&rolling_friction, why);
        c.useless(&rolling_damping, why);
    } else if name == Some(MINDLIN) {
        let why = "the law \"mindlin\" has no rolling resistance";
        c.useless(&rolling_friction, why);
        c.useless(&rolling_damping, why);
    }
    let (law, damping_ratio, choice) = match name {
        Some(HERTZ) => {
            let (spheres, choice) = spheres(c, &keys);
            (Law::Hertz(spheres), 0.0, choice)
        }
        Some(MINDLIN) => {
            let springs = mindlin_springs(c, &keys);
            (Law::Mindlin(springs), 0.0, DampingChoice::Undamped)
        }
        _ => {
            let law = match name {
                Some(HOOKE) => Law::Hooke(springs(c, &keys)),
                // Of an unknown law nobody knows what it needs.
                _ => Law::LeeHurley(self::material(c, &keys, name.is_some())),
            };
            let (ratio, choice) = damping_ratio(c, &keys);
            (law, ratio, choice)
        }
    };
    let contact = Contact {
        friction: c.required(&friction, &NOT_NEGATIVE, "mu_s, such as friction = 0.7"),
        rolling_friction: c.number(&rolling_friction, &NOT_NEGATIVE).unwrap_or(0.0),
        damping_ratio,
        rolling_damping_ratio: c.number(&rolling_damping, &DAMPING).unwrap_or(0.0),
    };
    (law, contact, choice)
}

/// The law's name, `None` where it is unknown; refuses what only other laws have.
fn name(c: &mut Checker<'_>, dimension: Dimensions, keys: &Keys) -> Option<&'static str> {
    let law = &keys.law;
    let default = match dimension {
        Dimensions::Two => LEE_HURLEY,
        Dimensions::Three => HERTZ,
    };
    let name = c.text(law).unwrap_or_else(|| default.into());
    let Some(known) = Law::NAMES.into_iter().find(|known| *known == name) else {
        let names = quoted(&Law::NAMES);
        c.refuse(law, &format!("unknown law {name:?}; there are {names}"));
        return None;
    };
    match (known, dimension) {
        (LEE_HURLEY, Dimensions::Three) => c.refuse(
            law,
            "is a law of disks; with dimension = 3 give \"hertz\", \"hooke\" or \"mindlin\"",
        ),
        (HERTZ, Dimensions::Two) => c.refuse(
            law,
            "is a law of spheres; give dimension = 3, or \"lee-hurley\", \"hooke\" or \"mindlin\"",
        ),
        _ => {}
    }
    for (key, owners) in keys.owners() {
        if key.given.is_none() || owners.contains(&known) {
            continue;
        }
        let place = law
            .offset()
            .map_or("the default".into(), |at| c.mention(at));
        let choose = match owners {
            [_] => "that law",
            _ => "one of those",
        };
        let mut what = format!(
            "means nothing to the law {name:?} ({place}), only to {}; leave it out, or choose {choose} with contact.law",
            quoted(owners)
        );
        if place.starts_with("--set") {
            what += &format!("; --set {}=none takes it away", key.path);
        }
        c.refuse(key, &what);
    }
    Some(known)
}

/// `"a", "b" and "c"`.
fn quoted(names: &[&str]) -> String {
    let names: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
    match names.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} and {last}", others.join(", ")),
        None => String::new(),
    }
}

fn density(c: &mut Checker<'_>, keys: &Keys) -> f64 {
    c.required(
        &keys.density,
        &POSITIVE,
        "rho (kg/m^3), such as density = 2500.0",
    )
}

fn young_modulus(c: &mut Checker<'_>, keys: &Keys) -> f64 {
    let what = "E (Pa), such as young_modulus = 1e9";
    c.required(&keys.young_modulus, &POSITIVE, what)
}

fn poisson_ratio(c: &mut Checker<'_>, keys: &Keys) -> f64 {
    let what = "nu, such as poisson_ratio = 0.2";
    c.required(&keys.poisson_ratio, &POISSON, what)
}

fn material(c: &mut Checker<'_>, keys: &Keys, needed: bool) -> Material {
    Material {
        young_modulus: if needed {
            young_modulus(c, keys)
        } else {
            f64::NAN
        },
        poisson_ratio: if needed {
            poisson_ratio(c, keys)
        } else {
            f64::NAN
        },
        density: density(c, keys),
    }
}

fn springs(c: &mut Checker<'_>, keys: &Keys) -> Springs {
    let what = "k_n (N/m; per unit depth, which is Pa, in 2D), such as normal_stiffness = 1e8";
    let [normal_stiffness, tangential_stiffness] = stiffnesses(c, keys, what);
    Springs {
        normal_stiffness,
        tangential_stiffness,
        density: density(c, keys),
    }
}

fn mindlin_springs(c: &mut Checker<'_>, keys: &Keys) -> MindlinSprings {
    let what = "k_n (N/m^1.5; per unit depth in 2D), such as normal_stiffness = 1e10";
    let [normal_stiffness, tangential_stiffness] = stiffnesses(c, keys, what);
    let (density, mass) = (&keys.density, &keys.mass);
    let chosen = c.exactly_one(
        &[density, mass],
        "the masses: density (rho, kg/m^3), such as density = 2500.0, or mass (kg; kg/m in 2D), the same for all grains",
    );
    let masses = match (c.number(density, &POSITIVE), c.number(mass, &POSITIVE)) {
        (_, Some(mass)) if chosen == 1 => Masses::Equal(mass),
        (density, _) => Masses::Density(density.unwrap_or(f64::NAN)),
    };
    MindlinSprings {
        normal_stiffness,
        tangential_stiffness,
        masses,
    }
}

/// k_n and k_t; `what` asks for k_n.
fn stiffnesses(c: &mut Checker<'_>, keys: &Keys, what: &str) -> [f64; 2] {
    let k_n = c.required(&keys.normal_stiffness, &POSITIVE, what);
    let k_t = c.number(&keys.tangential_stiffness, &POSITIVE);
    if let Some(k_t) = k_t.filter(|&k_t| k_t > k_n) {
        let words = format!("must lie in (0, normal_stiffness = {}]", show(k_n));
        c.refuse(
            &keys.tangential_stiffness,
            &format!("{words}, found {}", show(k_t)),
        );
    }
    [k_n, k_t.unwrap_or(2.0 / 7.0 * k_n)]
}

fn damping_ratio(c: &mut Checker<'_>, keys: &Keys) -> (f64, DampingChoice) {
    let (ratio, restitution) = (&keys.damping_ratio, &keys.restitution);
    let chosen = c.exactly_one(
        &[ratio, restitution],
        "the damping: damping_ratio (alpha), such as damping_ratio = 0.1, or restitution",
    );
    match (c.number(ratio, &DAMPING), c.number(restitution, &UNIT)) {
        (_, Some(e)) if chosen == 1 => (derived::damping_ratio(e), DampingChoice::Restitution(e)),
        (alpha, _) => (alpha.unwrap_or(0.0), DampingChoice::Ratio),
    }
}

fn spheres(c: &mut Checker<'_>, keys: &Keys) -> (Spheres, DampingChoice) {
    let mut spheres = Spheres {
        young_modulus: young_modulus(c, keys),
        poisson_ratio: poisson_ratio(c, keys),
        density: density(c, keys),
        normal_damping: 0.0,
        tangential_damping: 0.0,
    };
    let (normal, restitution) = (&keys.normal_damping, &keys.restitution);
    let chosen = c.exactly_one(
        &[normal, restitution],
        "the damping: normal_damping (gamma_n, 1/(m s)), such as normal_damping = 6e7, or restitution with impact_speed (m/s) and impact_diameter (m)",
    );
    let gamma_n = c.number(normal, &NOT_NEGATIVE).unwrap_or(0.0);
    let choice = if chosen == 1 {
        let e = c.number(restitution, &UNIT).unwrap_or(1.0);
        let speed = "the speed (m/s) at which two equal spheres collide with that restitution, such as impact_speed = 25.0";
        let speed = c.required(&keys.impact_speed, &POSITIVE, speed);
        let diameter = "the diameter (m) of those spheres, such as impact_diameter = 3e-3";
        let diameter = c.required(&keys.impact_diameter, &POSITIVE, diameter);
        spheres.normal_damping = derived::impact_damping(&spheres, e, speed, diameter);
        DampingChoice::Impact { e, speed, diameter }
    } else {
        let why =
            "says at what the restitution is measured, and normal_damping is given instead of it";
        c.useless(&keys.impact_speed, why);
        c.useless(&keys.impact_diameter, why);
        spheres.normal_damping = gamma_n;
        DampingChoice::Ratio
    };
    let gamma_t = c.number(&keys.tangential_damping, &NOT_NEGATIVE);
    if gamma_t.is_some_and(|gamma_t| gamma_t > 0.0) && spheres.normal_damping == 0.0 {
        c.refuse(
            &keys.tangential_damping,
            "must be 0 where normal_damping is 0: contacts that slow each other down across do so along n as well",
        );
    }
    spheres.tangential_damping = gamma_t.unwrap_or(0.5 * spheres.normal_damping);
    (spheres, choice)
}
