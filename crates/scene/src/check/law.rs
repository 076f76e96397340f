//! The contact law: `[material]` and `[contact]`.

use crate::checker::Checker;
use crate::key::{Declared, Key};
use crate::kind::{Number, Text};
use crate::law_keys::{law_keys, laws_with};
use crate::raw::{self, KeyTable};
use crate::words::list;
use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::keys::{self, KeyReader};
use gshear_dem::laws::{self, Contact, LAWS, Law, LawKind, lee_hurley};

/// The values of the laws' keys, as the configuration has them.
struct Given<'c, 'a> {
    checker: &'c mut Checker<'a>,
    values: Vec<(&'static str, usize, f64)>,
}

impl Given<'_, '_> {
    fn key(&self, key: &keys::LawKey) -> Key<Number> {
        let given = self.values.iter().find(|(path, ..)| *path == key.path);
        Key {
            declared: Declared::from(key),
            given: given.map(|&(_, at, x)| (at, Number(x))),
        }
    }
}

impl KeyReader for Given<'_, '_> {
    fn number(&mut self, key: &keys::LawKey) -> Option<f64> {
        let given = self.key(key);
        self.checker.number(&given)
    }

    fn required(&mut self, key: &keys::LawKey) -> f64 {
        let given = self.key(key);
        self.checker.required(&given)
    }

    fn exactly_one(&mut self, keys: &[&keys::LawKey], what: &str) -> usize {
        let given: Vec<Key<Number>> = keys.iter().map(|key| self.key(key)).collect();
        self.checker
            .exactly_one(&given.iter().collect::<Vec<_>>(), what)
    }

    fn useless(&mut self, key: &keys::LawKey, why: &str) {
        let given = self.key(key);
        self.checker.useless(&given, why);
    }

    fn refuse(&mut self, key: &keys::LawKey, what: &str) {
        let given = self.key(key);
        self.checker.refuse(&given, what);
    }
}

/// The law with its constants, and what all contacts have.
pub(super) fn check(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    material: &raw::Material,
    contact: &raw::Contact,
) -> (Law, Contact) {
    let raw::Contact {
        law: name,
        friction,
        rolling_friction,
        rolling_damping_ratio,
        of_laws,
    } = contact;
    let tables = [
        (raw::Material::NAME, &material.of_laws),
        (raw::Contact::NAME, of_laws),
    ];
    let values = tables.into_iter().flat_map(|(table, given)| {
        given.iter().filter_map(move |(name, value)| {
            let key = law_keys().find(|key| key.table() == table && key.name() == name)?;
            Some((key.path, value.span().start, value.get_ref().0))
        })
    });
    let values = values.collect();
    let mut given = Given { checker: c, values };
    let kind = choose(&mut given, dimension, name);
    let limits = |c: &mut Checker<'_>| Contact {
        friction: c.required(friction),
        rolling_friction: c.number_or_default(rolling_friction),
        rolling_damping_ratio: c.number_or_default(rolling_damping_ratio),
    };
    let Some(kind) = kind else {
        // What an unknown law needs is not known; the problem of its name stops the scene.
        let law = Law::of(&lee_hurley::KIND, UNKNOWN);
        return (law, limits(c));
    };
    let why = match (dimension, kind.rolling) {
        (Dimensions::Three, _) => {
            Some("rolling resistance is between disks; with dimension = 3 there is none".into())
        }
        (Dimensions::Two, false) => {
            Some(format!("the law {:?} has no rolling resistance", kind.name))
        }
        (Dimensions::Two, true) => None,
    };
    if let Some(why) = why {
        given.checker.useless(rolling_friction, &why);
        given.checker.useless(rolling_damping_ratio, &why);
    }
    let law = Law::read(kind, &mut given);
    (law, limits(c))
}

const UNKNOWN: lee_hurley::Material = lee_hurley::Material {
    young_modulus: f64::NAN,
    poisson_ratio: f64::NAN,
    density: f64::NAN,
    damping_ratio: f64::NAN,
    sliding_damping: f64::NAN,
};

/// The law of this name, `None` if it is unknown; refuses what only other laws take.
fn choose(
    given: &mut Given<'_, '_>,
    dimension: Dimensions,
    law: &Key<Text>,
) -> Option<&'static LawKind> {
    let default = match dimension {
        Dimensions::Two => lee_hurley::KIND.name,
        Dimensions::Three => laws::hertz::KIND.name,
    };
    let name = given.checker.choice_or(law, default)?;
    let kind = laws::kind(name)?;
    if !kind.dimensions.contains(&dimension) {
        let others: Vec<&str> = LAWS
            .iter()
            .filter(|kind| kind.dimensions.contains(&dimension))
            .map(|kind| kind.name)
            .collect();
        let (of, give) = match dimension {
            Dimensions::Three => ("disks", "with dimension = 3 give"),
            Dimensions::Two => ("spheres", "give dimension = 3, or"),
        };
        let what = format!("is a law of {of}; {give} {}", quoted(&others, "or"));
        given.checker.refuse(law, &what);
    }
    let mut seen = Vec::new();
    for key in law_keys() {
        let owners = laws_with(key);
        let known = given.key(key);
        if known.given.is_none() || owners.contains(&kind.name) || seen.contains(&key.path) {
            continue;
        }
        seen.push(key.path);
        let place = law
            .offset()
            .map_or("the default".into(), |at| given.checker.mention(at));
        let choose = match owners[..] {
            [_] => "that law",
            _ => "one of those",
        };
        let what = format!(
            "does not apply to the law {name:?} ({place}), only to {}; leave it out, or choose {choose} with {}",
            quoted(&owners, "and"),
            law.declared.path
        );
        given.checker.refuse_useless(&known, &what);
    }
    Some(kind)
}

/// `"a", "b" and "c"`.
fn quoted(names: &[&str], and: &str) -> String {
    let names: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
    list(&names, and)
}
