//! The contact law: `[material]` and `[contact]`.

use gshear_dem::adhesions::{self, ADHESIONS, AdhesionKind};
use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::Result;
use gshear_dem::laws::keys::{BELOW_ONE, Change, Key, KeyReader, NOT_NEGATIVE, POSITIVE, Values};
use gshear_dem::laws::{self, Contact, Law, LawKind, hertz, lee_hurley};

use crate::checker::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MIN};
use crate::grains::Sample;
use crate::table::{adhesion_keys, law_keys, laws_with, table};
use crate::words::{list, quoted_list};

/// The names of the contact laws.
fn law_names() -> Vec<&'static str> {
    laws::all().map(|kind| kind.name).collect()
}

/// The names of the adhesions.
fn adhesion_names() -> Vec<&'static str> {
    adhesions::all().map(|kind| kind.name).collect()
}

table! {
    /// The contacts of the grains.
    CONTACT: ContactKeys "contact" All Branch {
        /// contact law
        law: Word(law_names) {
            otherwise: "`\"lee-hurley\"`, in 3D `\"hertz\"`",
            change: Change::Never,
        },
        /// sliding friction μ_s
        friction: Number(NOT_NEGATIVE) { what: "mu_s", example: "0.7" },
        /// rolling friction μ_r; in 2D not with the law mindlin
        rolling_friction: Number(NOT_NEGATIVE) { default: "0.0" },
        /// rolling stiffness k_r/R_r²
        rolling_stiffness: Number(POSITIVE) {
            unit: "N/m, in 2D Pa",
            otherwise: "k_t of `hooke`, πE*/4 of `lee-hurley` (A15); of other laws it must be given",
        },
        /// rolling damping ratio η_r
        rolling_damping_ratio: Number(BELOW_ONE) { default: "0.0" },
        /// twisting friction μ_w; 3D only
        twisting_friction: Number(NOT_NEGATIVE) { default: "0.0" },
        /// twisting stiffness k_w/R_r²; 3D only
        twisting_stiffness: Number(POSITIVE) { unit: "N/m", otherwise: "that of rolling" },
        /// twisting damping ratio η_w; 3D only
        twisting_damping_ratio: Number(BELOW_ONE) { default: "0.0" },
        /// adhesion, in 2D by default a constant attraction; JKR with `hertz` and `hertz-tsuji`
        adhesion: Word(adhesion_names) { default: ADHESIONS[0].name },
        /// pairs of materials with other values of these keys
        pair: Tables(pair_keys) { condition: "with several materials", otherwise: "none" },
    }
}

/// The two materials of an entry of `contact.pair`.
pub(crate) static PAIR: Key = Key {
    path: "materials",
    doc: "names of the two materials, which may be the same",
    values: Values::Names,
    ..Key::PLAIN
};

/// The keys of an entry of `contact.pair`.
pub(crate) fn pair_keys() -> Vec<&'static Key> {
    let mut keys = ContactKeys::TABLE.keys();
    keys.push(&PAIR);
    keys
}

/// The law with its constants, and what all contacts have. With several materials these are the
/// values of `[contact]`, with the elastic constants of the first.
pub(crate) fn check(c: &mut Checker<'_>) -> Result<(Law, Contact)> {
    let kind = choose(c)?;
    let dimension = c.dimension;
    if dimension == Dimensions::Two {
        if !kind.rolling {
            let rolling = [
                &CONTACT.rolling_friction,
                &CONTACT.rolling_stiffness,
                &CONTACT.rolling_damping_ratio,
            ];
            let law = kind.name;
            let why = format!("the law {law:?} has no rolling resistance between disks");
            c.all_useless(&rolling, &why);
        }
        let twisting = [
            &CONTACT.twisting_friction,
            &CONTACT.twisting_stiffness,
            &CONTACT.twisting_damping_ratio,
        ];
        c.all_useless(&twisting, "disks do not twist");
    }
    let law = Law::read(kind, c);
    for (key, value) in law.given() {
        c.fill(key, *value);
    }
    let mut contact = contact_of(&law, &mut |key| match key.default {
        "" => c.number(key),
        _ => Some(c.number_or_default(key)),
    });
    if let Some(adhesion) = choose_adhesion(c, &law) {
        contact.adhesion = (adhesion.read)(c, &law);
        for key in adhesion.keys.iter().filter(|key| !key.default.is_empty()) {
            c.number_or_default(key);
        }
    }
    c.required(&CONTACT.friction);
    if let Some((key, what)) = lacks_stiffness(&law, &contact) {
        c.refuse(key, &what);
    }
    Ok((law, contact))
}

/// The adhesion that is named, by default the first of the dimension; `None` if there is no such
/// one.
pub(crate) fn adhesion_of(c: &mut Checker<'_>) -> Option<&'static AdhesionKind> {
    let (key, dimension) = (&CONTACT.adhesion, c.dimension);
    let first = adhesions::all().find(|kind| kind.dimensions.contains(&dimension))?;
    if first.name == key.default || c.is_given(key) {
        c.choice(key).and_then(adhesions::kind)
    } else {
        Some(first)
    }
}

/// The adhesion of the scene; `None` if it does not fit the dimension or the law. Refuses what only
/// other adhesions take.
fn choose_adhesion(c: &mut Checker<'_>, law: &Law) -> Option<&'static AdhesionKind> {
    let key = &CONTACT.adhesion;
    let kind = adhesion_of(c)?;
    if !kind.dimensions.contains(&c.dimension) {
        let [_, others] = grains_of(c.dimension);
        c.useless(key, &format!("is that of {others}"));
        return None;
    }
    let mut seen = Vec::new();
    for other in adhesion_keys() {
        let is_own = kind.keys.iter().any(|own| own.path == other.path);
        if !is_own && c.is_given(other) && !seen.contains(&other.path) {
            seen.push(other.path);
            refuse_key_of_another_adhesion(c, kind, other);
        }
    }
    if let Some(what) = (kind.unfit)(law) {
        c.refuse(key, &what);
        return None;
    }
    Some(kind)
}

/// What the grains of a dimension are called, and those of the other.
fn grains_of(dimension: Dimensions) -> [&'static str; 2] {
    match dimension {
        Dimensions::Two => ["disks", "spheres"],
        Dimensions::Three => ["spheres", "disks"],
    }
}

/// Refuses a key that the adhesion does not take.
fn refuse_key_of_another_adhesion(c: &mut Checker<'_>, kind: &AdhesionKind, other: &Key) {
    let (key, dimension) = (&CONTACT.adhesion, c.dimension);
    let owners: Vec<&AdhesionKind> = adhesions::all()
        .filter(|owner| owner.keys.iter().any(|own| own.path == other.path))
        .collect();
    let names: Vec<&str> = owners.iter().map(|owner| owner.name).collect();
    let mut owners = owners.iter();
    let what = if owners.any(|owner| owner.dimensions.contains(&dimension)) {
        format!(
            "does not apply to the adhesion {:?} ({}), only to {}; leave it out, or choose {} = {:?}",
            kind.name,
            c.mention(key, "the default"),
            quoted_list(&names, "and"),
            key.path,
            names[0],
        )
    } else {
        let [grains, others] = grains_of(dimension);
        let own: Vec<&str> = kind.keys.iter().map(|own| own.path).collect();
        format!(
            "applies to {others} only (adhesion {}); leave it out, or give {grains} {}",
            quoted_list(&names, "or"),
            list(&own, "or"),
        )
    };
    c.refuse_useless(other, &what);
}

/// k_r/R_r² and k_w/R_r² (N/m; Pa in 2D) of these contacts, if they have them.
pub(crate) fn turning_stiffnesses(law: &Law, contact: &Contact) -> [Option<f64>; 2] {
    let rolling = contact.rolling_stiffness.or(law.rolling_stiffness());
    [rolling, contact.twisting_stiffness.or(rolling)]
}

/// What contacts have beside their law but for the adhesion, from the values of its keys. A
/// stiffness that is given as the one that applies without it is that one, so that writing a
/// default down changes nothing, not even the limit of the time step.
pub(crate) fn contact_of(law: &Law, number: &mut dyn FnMut(&Key) -> Option<f64>) -> Contact {
    let own = law.rolling_stiffness();
    let rolling_stiffness = number(&CONTACT.rolling_stiffness).filter(|k| Some(*k) != own);
    let rolling = rolling_stiffness.or(own);
    let twisting_stiffness = number(&CONTACT.twisting_stiffness).filter(|k| Some(*k) != rolling);
    Contact {
        friction: number(&CONTACT.friction).unwrap_or(0.0),
        rolling_friction: number(&CONTACT.rolling_friction).unwrap_or(0.0),
        rolling_damping_ratio: number(&CONTACT.rolling_damping_ratio).unwrap_or(0.0),
        twisting_friction: number(&CONTACT.twisting_friction).unwrap_or(0.0),
        twisting_damping_ratio: number(&CONTACT.twisting_damping_ratio).unwrap_or(0.0),
        rolling_stiffness,
        twisting_stiffness,
        ..Contact::NONE
    }
}

/// The key of a friction that lacks the stiffness of its spring, and what to say of it.
pub(crate) fn lacks_stiffness(law: &Law, contact: &Contact) -> Option<(&'static Key, String)> {
    let [rolling, twisting] = turning_stiffnesses(law, contact);
    let (key, given) = if contact.rolling_friction > 0.0 && rolling.is_none() {
        (&CONTACT.rolling_friction, "rolling_stiffness")
    } else if contact.twisting_friction > 0.0 && twisting.is_none() {
        (&CONTACT.twisting_friction, "twisting_stiffness")
    } else {
        return None;
    };
    let what = format!(
        "needs {given} (N/m), such as {given} = 1e6: the law {:?} has none of its own",
        law.kind().name
    );
    Some((key, what))
}

/// Refuses an attraction that presses mean grains further together than the law takes.
pub(crate) fn check_attraction(c: &mut Checker<'_>, law: &Law, contact: &Contact, sample: &Sample) {
    let given = derived::attraction_under(0.0, contact, sample);
    let most = derived::pressure(law, sample, STIFFNESS_NUMBER_MIN) * sample.mean_section();
    if given > most {
        let keys: Vec<&Key> = adhesion_keys().collect();
        let unit = sample.by_dimension("N/m", "N");
        let what = format!(
            "mean grains attract each other by {given:.3e} {unit}, which presses them further together than the law {:?} takes; give less, for at most {most:.3e} {unit}, or a stiffer law",
            law.kind().name,
        );
        c.refuse_among(&keys, &what);
    }
}

/// The law that is named; refuses what only other laws take.
fn choose(c: &mut Checker<'_>) -> Result<&'static LawKind> {
    let (key, dimension) = (&CONTACT.law, c.dimension);
    let default = match dimension {
        Dimensions::Two => lee_hurley::KIND.name,
        Dimensions::Three => hertz::KIND.name,
    };
    let name = if c.is_given(key) {
        c.choice(key)
    } else {
        c.fill(key, default);
        Some(default)
    };
    let Some(kind) = name.and_then(laws::kind) else {
        c.settle()?;
        unreachable!("an unknown law is refused");
    };
    if !kind.dimensions.contains(&dimension) {
        let others = laws::all().filter(|kind| kind.dimensions.contains(&dimension));
        let (grains, give) = match dimension {
            Dimensions::Three => ("disks", "with dimension = 3 give"),
            Dimensions::Two => ("spheres", "give dimension = 3, or"),
        };
        let others = quoted_list(others.map(|kind| kind.name), "or");
        c.refuse(key, &format!("is a law of {grains}; {give} {others}"));
    }
    let mut seen = Vec::new();
    for other in law_keys() {
        let owners = laws_with(other);
        let is_own = owners.iter().any(|(name, _)| *name == kind.name);
        if !c.is_given(other) || is_own || seen.contains(&other.path) {
            continue;
        }
        seen.push(other.path);
        let choose = match owners[..] {
            [_] => "that law",
            _ => "one of those",
        };
        let what = format!(
            "does not apply to the law {:?} ({}), only to {}; leave it out, or choose {choose} with {}",
            kind.name,
            c.mention(key, "the default"),
            quoted_list(owners.iter().map(|(name, _)| *name), "and"),
            key.path
        );
        c.refuse_useless(other, &what);
    }
    Ok(kind)
}
