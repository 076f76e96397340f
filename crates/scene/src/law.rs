//! The contact law: `[material]` and `[contact]`.

use std::f64::consts::PI;

use gshear_dem::contact::attraction::Attraction;
use gshear_dem::contact::jkr::Jkr;
use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::Result;
use gshear_dem::laws::keys::{BELOW_ONE, Change, Key, KeyReader, NOT_NEGATIVE, POSITIVE, Values};
use gshear_dem::laws::{self, Contact, Law, LawKind, hertz, lee_hurley};

use crate::checker::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MIN};
use crate::grains::Sample;
use crate::table::{law_keys, laws_with, table};
use crate::words::quoted_list;

/// The values of `contact.adhesion`.
const ADHESION_NAMES: [&str; 2] = ["dmt", "jkr"];

/// The names of the contact laws.
fn law_names() -> Vec<&'static str> {
    laws::all().map(|kind| kind.name).collect()
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
        /// attraction F_c of two grains that touch; packing does without
        attraction: Number(NOT_NEGATIVE) { unit: "N, in 2D N/m", default: "0.0" },
        /// surface energy γ: an attraction of 4πγR* (DMT), or JKR; 3D only
        surface_energy: Number(NOT_NEGATIVE) { unit: "J/m²", default: "0.0" },
        /// adhesion by the surface energy; 3D only, JKR with `hertz` and `hertz-tsuji`
        adhesion: Text(&ADHESION_NAMES) { default: ADHESION_NAMES[0] },
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
        let why = "gives the attraction of spheres; give disks contact.attraction (N/m)";
        c.useless(&CONTACT.surface_energy, why);
        c.useless(&CONTACT.adhesion, "is that of spheres");
    }
    let law = Law::read(kind, c);
    for (key, value) in law.given() {
        c.fill(key, *value);
    }
    let adheres = dimension == Dimensions::Three && is_jkr(c);
    if adheres && law.contact_modulus().is_none() {
        let what = format!(
            "\"jkr\" is between Hertzian spheres, and the law {:?} has none; choose the law \"hertz\" or \"hertz-tsuji\", or \"dmt\"",
            kind.name
        );
        c.refuse(&CONTACT.adhesion, &what);
    }
    let contact = contact_of(&law, adheres, &mut |key| match key.default {
        "" => c.number(key),
        _ => Some(c.number_or_default(key)),
    });
    c.required(&CONTACT.friction);
    if let Some((key, what)) = lacks_stiffness(&law, &contact) {
        c.refuse(key, &what);
    }
    Ok((law, contact))
}

/// Whether spheres of a surface energy adhere by JKR.
pub(crate) fn is_jkr(c: &mut Checker<'_>) -> bool {
    c.choice(&CONTACT.adhesion) == Some(ADHESION_NAMES[1])
}

/// k_r/R_r² and k_w/R_r² (N/m; Pa in 2D) of these contacts, if they have them.
pub(crate) fn turning_stiffnesses(law: &Law, contact: &Contact) -> [Option<f64>; 2] {
    let rolling = contact.rolling_stiffness.or(law.rolling_stiffness());
    [rolling, contact.twisting_stiffness.or(rolling)]
}

/// What contacts have beside their law, from the values of its keys; `adheres`: by JKR. A stiffness
/// that is given as the one that applies without it is that one, so that writing a default down
/// changes nothing, not even the limit of the time step.
pub(crate) fn contact_of(
    law: &Law,
    adheres: bool,
    number: &mut dyn FnMut(&Key) -> Option<f64>,
) -> Contact {
    let own = law.rolling_stiffness();
    let rolling_stiffness = number(&CONTACT.rolling_stiffness).filter(|k| Some(*k) != own);
    let rolling = rolling_stiffness.or(own);
    let twisting_stiffness = number(&CONTACT.twisting_stiffness).filter(|k| Some(*k) != rolling);
    let mut coefficient = |key| number(key).unwrap_or(0.0);
    let energy = coefficient(&CONTACT.surface_energy);
    let modulus = law.contact_modulus().filter(|_| adheres && energy > 0.0);
    Contact {
        friction: coefficient(&CONTACT.friction),
        rolling_friction: coefficient(&CONTACT.rolling_friction),
        rolling_damping_ratio: coefficient(&CONTACT.rolling_damping_ratio),
        twisting_friction: coefficient(&CONTACT.twisting_friction),
        twisting_damping_ratio: coefficient(&CONTACT.twisting_damping_ratio),
        attraction: Attraction {
            constant: coefficient(&CONTACT.attraction),
            per_radius: if adheres { 0.0 } else { 4.0 * PI * energy },
            jkr: modulus.map(|modulus| Jkr::new(energy, modulus)),
        },
        rolling_stiffness,
        twisting_stiffness,
        ..Contact::NONE
    }
}

/// The key of a friction that lacks the stiffness of its spring, and what to say of it.
pub(crate) fn lacks_stiffness(law: &Law, contact: &Contact) -> Option<(&'static Key, String)> {
    let [of_rolling, of_twisting] = turning_stiffnesses(law, contact);
    let (key, given) = if contact.rolling_friction > 0.0 && of_rolling.is_none() {
        (&CONTACT.rolling_friction, "rolling_stiffness")
    } else if contact.twisting_friction > 0.0 && of_twisting.is_none() {
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
pub(crate) fn check_attraction(
    c: &mut Checker<'_>,
    (law, contact): (&Law, &Contact),
    sample: &Sample,
) {
    let given = derived::attraction_under(0.0, contact, sample);
    let most = derived::pressure(law, sample, STIFFNESS_NUMBER_MIN) * sample.mean_section();
    if given > most {
        let of_all = [&CONTACT.attraction, &CONTACT.surface_energy];
        let unit = sample.by_dimension("N/m", "N");
        let what = format!(
            "mean grains attract each other by {given:.3e} {unit}, which presses them further together than the law {:?} takes; give less, for at most {most:.3e} {unit}, or a stiffer law",
            law.kind().name,
        );
        c.refuse_among(&of_all, &what);
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
        let (of, give) = match dimension {
            Dimensions::Three => ("disks", "with dimension = 3 give"),
            Dimensions::Two => ("spheres", "give dimension = 3, or"),
        };
        let others = quoted_list(others.map(|kind| kind.name), "or");
        c.refuse(key, &format!("is a law of {of}; {give} {others}"));
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
