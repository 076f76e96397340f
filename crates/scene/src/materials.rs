//! Several materials: `[[material]]`, and `[[contact.pair]]` for pairs that differ.

use std::sync::Arc;

use gshear_dem::adhesions::AdhesionKind;
use gshear_dem::failure::Result;
use gshear_dem::laws::keys::{
    AGEING, AGEING_SLIP, AGEING_TIME, BELOW_ONE, DENSITY, FROM_ONE, Key, KeyReader, POISSON_RATIO,
    TANGENTIAL_HISTORY, Values, YOUNG_MODULUS,
};
use gshear_dem::laws::{Contact, Law};
use gshear_dem::state::{GrainState, Masses, body};

use crate::checker::Checker;
use crate::insertion::material_stream;
use crate::law::{
    CONTACT, ContactKeys, PAIR, adhesion_of, contact_of, lacks_stiffness, pair_keys,
    turning_stiffnesses,
};
use crate::sample::{SAMPLE, boundary};
use crate::table::{Table, adhesion_keys, laws_with, table};
use crate::value::{Entries, Value};
use crate::words::quoted_list;

table! {
    /// The material of the grains; several are given as `[[material]]`, the first of them that of
    /// all grains that have no other.
    MATERIAL: MaterialKeys "material" All Never {
        /// its name, by which other keys call it
        name: Text(&[]) { condition: "with several materials", otherwise: "none" },
        /// share of the inserted grains that have it, by number; the first has the rest
        fraction: Number(BELOW_ONE) { condition: "not of the first", otherwise: "0" },
        /// type of its free atoms in `sample.packing`
        atom_type: Whole(FROM_ONE) {
            otherwise: "1 of the first, 4 of the second, 5 of the third, …",
        },
    }
}

/// All materials but the first, as [`crate::keys`] reads them.
pub(crate) static OTHERS: Key = Key {
    path: "material",
    doc: "all materials but the first",
    values: Values::Tables(|| MaterialKeys::TABLE.keys()),
    ..Key::PLAIN
};

/// The materials of a scene, and the laws between their grains.
#[derive(Debug, Clone, PartialEq)]
pub struct Materials {
    /// The names; of a single material it may be empty.
    pub names: Vec<String>,
    /// The law of each ordered pair: that of materials i and j is at i n + j.
    pub laws: Vec<(Law, Contact)>,
    /// The masses of the grains.
    pub masses: Masses,
    /// Share of the inserted grains that have each but the first.
    fractions: Vec<f64>,
    /// Type of the atoms of each in a packing.
    pub(crate) atom_types: Vec<i64>,
    /// That of the walls, if they have one of their own.
    pub wall: Option<u64>,
    /// That of the larger grains of a binary mixture, if it is given.
    large: Option<u64>,
}

impl Materials {
    /// μ_s of grains of these materials.
    pub(crate) fn friction(&self, [i, j]: [u64; 2]) -> f64 {
        let materials = self.laws.len().isqrt();
        let (_, contact) = &self.laws[i as usize * materials + j as usize];
        contact.friction
    }

    /// Gives inserted grains their materials. `largest`: the greatest radius (m).
    pub fn give(&self, seed: u64, largest: f64, grains: &mut [GrainState]) {
        for g in grains {
            g.material = self.inserted(seed, g.id, g.radius == largest);
        }
    }

    /// The material of an inserted grain.
    fn inserted(&self, seed: u64, id: u32, is_largest: bool) -> u64 {
        if let Some(large) = self.large {
            return if is_largest { large } else { 0 };
        }
        if self.fractions.iter().all(|part| *part == 0.0) {
            return 0;
        }
        let mut left = material_stream(seed, id)();
        for (k, part) in self.fractions.iter().enumerate() {
            if left < *part {
                return k as u64 + 1;
            }
            left -= part;
        }
        0
    }

    /// The material of the atoms of this type.
    pub(crate) fn of_type(&self, atom_type: i64) -> Option<u64> {
        let material = self.atom_types.iter().position(|own| *own == atom_type)?;
        Some(material as u64)
    }
}

/// The type of the atoms of grains of this body and material, in packings and exports: 1 free, 2
/// and 3 the walls, from 4 on free grains of the other materials.
pub fn atom_type(body: u32, material: u64) -> u32 {
    match (body, material) {
        (body::FREE, 1..) => material as u32 + 3,
        (body, _) => body + 1,
    }
}

/// The keys of one material but the first, or of one pair.
struct Listed {
    entries: Entries,
    /// Where it is, for messages: `material 2`.
    place: String,
}

impl Listed {
    fn number(&self, key: &Key) -> Option<f64> {
        match self.value(key)? {
            Value::Number(x) => Some(*x),
            _ => None,
        }
    }

    fn value(&self, key: &Key) -> Option<&Value> {
        let entry = self.entries.iter().find(|(name, _)| *name == key.name());
        entry.map(|(_, value)| value)
    }
}

/// The tables of a list, in their order.
fn tables(c: &Checker<'_>, key: &Key, called: &str, first: usize) -> Vec<Listed> {
    let Some(Value::Tables(tables)) = c.value(key) else {
        return Vec::new();
    };
    let numbered = tables.iter().enumerate();
    numbered
        .map(|(n, entries)| Listed {
            entries: entries.clone(),
            place: format!("{called} {}", n + first),
        })
        .collect()
}

/// Refuses numbers out of their bounds, and keys that the law does not take or that differ from
/// table to table.
fn check_entries(c: &mut Checker<'_>, law: &Law, list: &Key, declared: &Table, given: &[Listed]) {
    let adhesion = adhesion_of(c);
    for listed in given {
        for (name, value) in &listed.entries {
            let Some(key) = declared.key(name) else {
                continue;
            };
            let is_own = law.kind().keys.iter().any(|own| own.path == key.path);
            let what = if let Some(what) = value.out_of_bounds(key) {
                what
            } else if [
                CONTACT.law.path,
                CONTACT.pair.path,
                CONTACT.adhesion.path,
                TANGENTIAL_HISTORY.path,
                AGEING.path,
                AGEING_TIME.path,
                AGEING_SLIP.path,
            ]
            .contains(&key.path)
            {
                "is the same for all pairs".into()
            } else if let Some(kind) = adhesion
                && adhesion_keys().any(|other| other.path == key.path)
                && kind.keys.iter().all(|own| own.path != key.path)
            {
                let name = kind.name;
                format!("does not apply to the adhesion {name:?}; leave it out")
            } else if is_own || laws_with(key).is_empty() {
                continue;
            } else {
                let name = law.kind().name;
                format!("does not apply to the law {name:?}; leave it out")
            };
            c.refuse(list, &format!("{}: {name} {what}", listed.place));
        }
    }
}

/// An entry of `contact.pair`.
struct PairEntry {
    /// The numbers of its two materials.
    materials: [usize; 2],
    table: Listed,
}

impl PairEntry {
    /// Whether it is that of two materials, in either order.
    fn is_of(&self, pair: [usize; 2]) -> bool {
        let [i, j] = pair;
        self.materials == [i, j] || self.materials == [j, i]
    }
}

/// The value that `contact.pair` gives for two materials, in either order.
fn pair_number(entries: &[PairEntry], pair: [usize; 2], key: &Key) -> Option<f64> {
    let entry = entries.iter().find(|entry| entry.is_of(pair))?;
    entry.table.number(key)
}

/// What is given of several materials, and of pairs of them.
struct MaterialTables<'r> {
    /// All materials but the first.
    others: &'r [Listed],
    pairs: &'r [PairEntry],
    names: &'r [String],
    densities: &'r [f64],
    /// The law of `[contact]`, with the elastic constants of the first material.
    law: &'r Law,
    /// What all grains adhere by.
    adhesion: Option<&'static AdhesionKind>,
}

impl MaterialTables<'_> {
    /// The law and the contacts of two materials. `like`: those of like grains of the two, `None`
    /// while these are read.
    fn read(
        &self,
        c: &mut Checker<'_>,
        pair: [usize; 2],
        like: Option<[&(Law, Contact); 2]>,
    ) -> (Law, Contact) {
        let mut reader = PairReader {
            c,
            tables: self,
            pair,
            like,
        };
        let law = Law::read(self.law.kind(), &mut reader);
        let mut contact = contact_of(&law, &mut |key| reader.number(key));
        if let Some(adhesion) = self.adhesion {
            contact.adhesion = (adhesion.read)(&mut reader, &law);
        }
        let [i, j] = pair;
        contact.relative_densities = [1.0, self.densities[j] / self.densities[i]];
        if let Some((key, what)) = lacks_stiffness(&law, &contact) {
            reader.refuse(key, &what);
        }
        (law, contact)
    }
}

/// Reads the values of a pair of materials: what `contact.pair` or a material has, and of unlike
/// materials the mean of what their like pairs have.
struct PairReader<'r, 'a> {
    c: &'r mut Checker<'a>,
    tables: &'r MaterialTables<'r>,
    pair: [usize; 2],
    /// The law and the contacts of like grains of the two materials; `None` while these are read.
    like: Option<[&'r (Law, Contact); 2]>,
}

impl PairReader<'_, '_> {
    /// The value of a key of `[material]`.
    fn material_number(&self, k: usize, key: &Key) -> Option<f64> {
        match k.checked_sub(1) {
            None => self.c.given_number(key),
            Some(k) => self.tables.others[k].number(key),
        }
    }

    fn elastic(&self, k: usize) -> Option<Elastic> {
        Some(Elastic {
            young_modulus: self.material_number(k, &YOUNG_MODULUS)?,
            poisson_ratio: self.material_number(k, &POISSON_RATIO)?,
        })
    }

    /// The value of a key of `[contact]` for like grains of a material, given or not.
    fn like_number(&self, like: &(Law, Contact), k: usize, key: &Key) -> Option<f64> {
        let (law, contact) = like;
        let [rolling, twisting] = turning_stiffnesses(law, contact);
        match key.path {
            path if path == CONTACT.rolling_stiffness.path => rolling,
            path if path == CONTACT.twisting_stiffness.path => twisting,
            _ => law.value(key).or_else(|| self.given([k, k], key)),
        }
    }

    /// The value that is given for two materials, or in `[contact]` for all.
    fn given(&self, pair: [usize; 2], key: &Key) -> Option<f64> {
        let given = pair_number(self.tables.pairs, pair, key);
        given.or_else(|| self.c.given_number(key))
    }

    /// The value of a key of `[contact]` for the pair.
    fn contact_number(&self, key: &Key) -> Option<f64> {
        let Some([one, other]) = self.like else {
            return self.given(self.pair, key);
        };
        if let Some(given) = pair_number(self.tables.pairs, self.pair, key) {
            return Some(given);
        }
        let [i, j] = self.pair;
        let one = self.like_number(one, i, key)?;
        let other = self.like_number(other, j, key)?;
        Some(geometric_mean(one, other))
    }
}

impl KeyReader for PairReader<'_, '_> {
    fn number(&mut self, key: &Key) -> Option<f64> {
        if key.table() != MaterialKeys::TABLE.name {
            return self.contact_number(key);
        }
        let [i, j] = self.pair;
        if i == j || ![YOUNG_MODULUS.path, POISSON_RATIO.path].contains(&key.path) {
            return self.material_number(i, key);
        }
        let effective = effective(self.elastic(i)?, self.elastic(j)?);
        Some(if key.path == YOUNG_MODULUS.path {
            effective.young_modulus
        } else {
            effective.poisson_ratio
        })
    }

    /// All pairs have the same.
    fn choice(&mut self, key: &Key) -> Option<&'static str> {
        self.c.choice(key)
    }

    fn required(&mut self, key: &Key) -> f64 {
        self.number(key).unwrap_or_else(|| {
            let place = match self.pair {
                [0, 0] => return self.c.required(key),
                [0, k] | [k, _] => &self.tables.others[k - 1].place,
            };
            let what = format!("{place} lacks {}", key.lacking());
            self.c.refuse(&OTHERS, &what);
            f64::NAN
        })
    }

    fn exactly_one(&mut self, keys: &[&Key], what: &str) -> usize {
        self.c.exactly_one(keys, what)
    }

    fn useless(&mut self, _: &Key, _: &str) {}

    fn refuse(&mut self, key: &Key, what: &str) {
        let [i, j] = self.pair.map(|k| &self.tables.names[k]);
        let what = format!("{i:?} and {j:?}: {} {what}", key.name());
        self.c.refuse_among(&[&CONTACT.pair, key], &what);
    }
}

fn geometric_mean(a: f64, b: f64) -> f64 {
    if a == b { a } else { (a * b).sqrt() }
}

fn harmonic_mean(a: f64, b: f64) -> f64 {
    2.0 / (1.0 / a + 1.0 / b)
}

/// The elastic constants of a material.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Elastic {
    /// E (Pa).
    young_modulus: f64,
    /// ν.
    poisson_ratio: f64,
}

impl Elastic {
    /// E/(1-ν²).
    fn normal(&self) -> f64 {
        let nu = self.poisson_ratio;
        self.young_modulus / (1.0 - nu * nu)
    }

    /// E/((1+ν)(2-ν)).
    fn tangential(&self) -> f64 {
        let nu = self.poisson_ratio;
        self.young_modulus / ((1.0 + nu) * (2.0 - nu))
    }
}

/// The material whose like pairs have the stiffnesses of an unlike pair: 1/E* and 1/G* are the sums
/// of (1-ν²)/E and of 2(1+ν)(2-ν)/E of both.
fn effective(a: Elastic, b: Elastic) -> Elastic {
    if a == b {
        return a;
    }
    let normal = harmonic_mean(a.normal(), b.normal());
    let ratio = harmonic_mean(a.tangential(), b.tangential()) / normal;
    // Of one material (1-ν)/(2-ν).
    let nu = ((1.0 - 2.0 * ratio) / (1.0 - ratio)).clamp(0.0, 0.5);
    Elastic {
        young_modulus: normal * (1.0 - nu * nu),
        poisson_ratio: nu,
    }
}

/// The materials of a scene whose first has this law and whose contacts are these.
pub(crate) fn check(c: &mut Checker<'_>, law: &Law, contact: &Contact) -> Result<Materials> {
    let others = tables(c, &OTHERS, "material", 2);
    let mut all = Materials {
        names: vec![c.text(&MATERIAL.name).unwrap_or_default().into()],
        laws: vec![(law.clone(), contact.clone())],
        masses: law.masses(),
        fractions: Vec::new(),
        atom_types: vec![c.whole(&MATERIAL.atom_type).unwrap_or(1)],
        wall: None,
        large: None,
    };
    if others.is_empty() {
        let why = "names one of several [[material]], but there is one material";
        let keys = [&CONTACT.pair, &SAMPLE.wall_material, &SAMPLE.large_material];
        c.all_useless(&keys, why);
        if c.number(&MATERIAL.fraction).is_some_and(|part| part > 0.0) {
            let what = "all grains have the only material; leave it out";
            c.refuse(&MATERIAL.fraction, what);
        }
        return Ok(all);
    }
    check_entries(c, law, &OTHERS, &MaterialKeys::TABLE, &others);
    check_others(c, &others, &mut all);
    let pairs = check_pairs(c, law, &all.names);
    c.settle()?;
    all.wall = named(c, &SAMPLE.wall_material, &all.names);
    all.large = named(c, &SAMPLE.large_material, &all.names);
    if all.wall.is_none()
        && boundary(c).has_planes()
        && let Some(walls) = c.choice(&SAMPLE.walls)
    {
        let names = quoted_list(&all.names, "or");
        let what = format!(
            "sample.walls = {walls:?} needs a material where there are several; give {names}"
        );
        c.refuse(&SAMPLE.wall_material, &what);
    }
    let densities_of_others = others
        .iter()
        .map(|material| material.number(&DENSITY).unwrap_or(f64::NAN));
    let densities: Vec<f64> = std::iter::once(c.known(&DENSITY))
        .chain(densities_of_others)
        .collect();
    if densities.iter().any(|density| density.is_nan()) {
        c.refuse(&OTHERS, "each material must have a density (kg/m³)");
        c.settle()?;
    }
    let tables = MaterialTables {
        others: &others,
        pairs: &pairs,
        names: &all.names,
        densities: &densities,
        law,
        adhesion: adhesion_of(c),
    };
    let count = all.names.len();
    let like: Vec<_> = (0..count).map(|k| tables.read(c, [k, k], None)).collect();
    let mut laws = Vec::new();
    for i in 0..count {
        for j in 0..count {
            laws.push(if i == j {
                like[i].clone()
            } else {
                tables.read(c, [i, j], Some([&like[i], &like[j]]))
            });
        }
    }
    c.settle()?;
    all.laws = laws;
    fill_pairs(c, law, &like, &all.names, pairs);
    all.masses = Masses::Densities(Arc::from(densities));
    Ok(all)
}

/// Fills in what like pairs have by default where `[contact]`, whose defaults are filled in too,
/// says something else. What unlike pairs have follows from that.
fn fill_pairs(
    c: &mut Checker<'_>,
    law_of_all: &Law,
    like: &[(Law, Contact)],
    names: &[String],
    mut pairs: Vec<PairEntry>,
) {
    let keys = pair_keys();
    for (k, (law, _)) in like.iter().enumerate() {
        for &(key, value) in law.given() {
            if key.table() != ContactKeys::TABLE.name {
                continue;
            }
            let is_given = c.is_given(key) || pair_number(&pairs, [k, k], key).is_some();
            if is_given || law_of_all.value(key) == Some(value) {
                continue;
            }
            let known = pairs.iter().position(|entry| entry.is_of([k, k]));
            let place = known.unwrap_or_else(|| {
                let both = Value::Names(vec![names[k].clone(); 2]);
                pairs.push(PairEntry {
                    materials: [k, k],
                    table: Listed {
                        entries: vec![(PAIR.name().into(), both)],
                        place: String::new(),
                    },
                });
                pairs.len() - 1
            });
            let entries = &mut pairs[place].table.entries;
            entries.push((key.name().into(), Value::Number(value)));
            entries.sort_by_key(|(name, _)| keys.iter().position(|key| key.name() == name));
        }
    }
    if !pairs.is_empty() {
        let tables = pairs.into_iter().map(|entry| entry.table.entries);
        c.fill(&CONTACT.pair, Value::Tables(tables.collect()));
    }
}

/// Names, fractions and types of the other materials.
fn check_others(c: &mut Checker<'_>, others: &[Listed], all: &mut Materials) {
    if all.names[0].is_empty() {
        let what = "each of several materials needs a name; the first has none";
        c.refuse(&OTHERS, what);
    }
    for (k, table) in others.iter().enumerate() {
        let name = match table.value(&MATERIAL.name) {
            Some(Value::Text(name)) => name.clone(),
            _ => String::new(),
        };
        if name.is_empty() || all.names.contains(&name) {
            let place = &table.place;
            let what = format!("{place} needs a name of its own, such as name = \"steel\"");
            c.refuse(&OTHERS, &what);
        }
        all.names.push(name);
        all.fractions
            .push(table.number(&MATERIAL.fraction).unwrap_or(0.0));
        let type_of_atoms = match table.value(&MATERIAL.atom_type) {
            Some(Value::Whole(n)) => *n,
            _ => atom_type(body::FREE, k as u64 + 1).into(),
        };
        if all.atom_types.contains(&type_of_atoms) {
            let what = format!("{}: another has the atom_type {type_of_atoms}", table.place);
            c.refuse(&OTHERS, &what);
        }
        all.atom_types.push(type_of_atoms);
    }
    let sum: f64 = all.fractions.iter().sum();
    if sum > 1.0 {
        let what =
            format!("the fractions add up to {sum}; they must leave the first the rest of 1");
        c.refuse(&OTHERS, &what);
    }
    if c.number(&MATERIAL.fraction).is_some_and(|part| part > 0.0) {
        let what = "the first material has the grains that have no other; leave it out";
        c.refuse(&MATERIAL.fraction, what);
    }
    if c.is_given(&SAMPLE.packing) && sum > 0.0 {
        let what = "a fraction applies to inserted grains, but the grains come from sample.packing; give material.atom_type";
        c.refuse(&OTHERS, what);
    }
    if c.is_given(&SAMPLE.large_material) && sum > 0.0 {
        c.refuse(&SAMPLE.large_material, "decides which grains have which material, and so does material.fraction; leave one out");
    }
}

/// The entries of `contact.pair` with the numbers of their materials.
fn check_pairs(c: &mut Checker<'_>, law: &Law, names: &[String]) -> Vec<PairEntry> {
    let tables = tables(c, &CONTACT.pair, "pair", 1);
    check_entries(c, law, &CONTACT.pair, &ContactKeys::TABLE, &tables);
    let mut entries: Vec<PairEntry> = Vec::new();
    for table in tables {
        for key in law.kind().keys {
            let is_given = key.table() == ContactKeys::TABLE.name && table.number(key).is_some();
            let has_default = law.default_of(key).is_some() || !key.default.is_empty();
            if is_given && !c.is_given(key) && !has_default {
                let name = key.name();
                let what = "must be given in [contact] as well, for the other pairs";
                c.refuse(&CONTACT.pair, &format!("{}: {name} {what}", table.place));
            }
        }
        let Some(materials) = numbers_of_materials(&table, names) else {
            let (place, names) = (&table.place, quoted_list(names, "and"));
            let what = format!("{place}: materials must be a list of two names of {names}");
            c.refuse(&CONTACT.pair, &what);
            continue;
        };
        if entries.iter().any(|entry| entry.is_of(materials)) {
            let place = &table.place;
            let what = format!("{place}: these two materials have an entry already; give one");
            c.refuse(&CONTACT.pair, &what);
        }
        entries.push(PairEntry { materials, table });
    }
    entries
}

/// The numbers of the two materials that an entry of `contact.pair` names.
fn numbers_of_materials(table: &Listed, names: &[String]) -> Option<[usize; 2]> {
    let Some(Value::Names(given)) = table.value(&PAIR) else {
        return None;
    };
    let [one, other] = &given[..] else {
        return None;
    };
    Some([
        names.iter().position(|name| name == one)?,
        names.iter().position(|name| name == other)?,
    ])
}

/// The material that a key names.
fn named(c: &mut Checker<'_>, key: &Key, names: &[String]) -> Option<u64> {
    let name = c.text(key)?.to_string();
    let material = names.iter().position(|known| *known == name);
    if material.is_none() {
        let what = format!("must be {}, found {name:?}", quoted_list(names, "or"));
        c.refuse(key, &what);
    }
    material.map(|k| k as u64)
}

#[cfg(test)]
mod tests {
    use gshear_dem::contact::stiffness::SpringState;
    use gshear_dem::dimension::Three;

    use super::*;
    use crate::identity::identity;
    use crate::insertion::Lattice;
    use crate::sample::Origin;
    use crate::testing::overrides;
    use crate::{Scene, Source, load};

    const MIXTURE: &str = r#"
        dimension = 3
        material = [
            { name = "glass", young_modulus = 65e9, poisson_ratio = 0.22, density = 2500 },
            { name = "steel", young_modulus = "200 GPa", poisson_ratio = 0.3, density = 7800, fraction = 0.3 },
        ]
        contact.law = "hertz-tsuji"
        contact.friction = 0.4
        contact.restitution = 0.8
        contact.pair = [{ materials = ["steel", "steel"], friction = 0.1, restitution = 0.5 }]
        sample = { grains = 4000, radius_min = "0.8 mm", radius_max = 1e-3, length = 0.016, width = 0.016 }
        load.pressure = 1e5
        shear = { inertial_number = 1e-2, strain = 0.02 }
    "#;

    fn mixture(sets: &str) -> Result<Scene> {
        load(&Source::new("mixture.toml", MIXTURE), &overrides(sets))
    }

    /// F_n = (4/3) E* √R* δ^(3/2) and k_t = 8 G* √(R*δ) of unlike spheres (K. L. Johnson, Contact
    /// Mechanics, eqs 4.22 and 7.42), and √0.4·0.1 of the frictions of like ones.
    #[test]
    fn unlike_spheres_have_the_stiffness_of_their_moduli() {
        let scene = mixture("").expect("a scene");
        let force = scene.force::<Three>();
        let (radii, overlap) = ([0.8e-3, 1e-3], 1e-6);
        let small: f64 = radii[0] * radii[1] / (radii[0] + radii[1]);
        let state = |materials, slip| SpringState {
            materials,
            radii,
            overlap,
            history: [slip, 0.0, 0.0],
            torques: [0.0; 4],
            age: 0.0,
            limits: [None; 3],
        };
        let compliance = |e: f64, nu: f64| (1.0 - nu * nu) / e;
        let modulus = 1.0 / (compliance(65e9, 0.22) + compliance(200e9, 0.3));
        let shear = |e: f64, nu: f64| 2.0 * (2.0 - nu) * (1.0 + nu) / e;
        let shear = 1.0 / (shear(65e9, 0.22) + shear(200e9, 0.3));
        let normal = 4.0 / 3.0 * modulus * small.sqrt() * overlap.powf(1.5);
        for materials in [[0, 1], [1, 0]] {
            let stuck = force.derivatives(&state(materials, 1e-12));
            assert!((stuck.normal / normal - 1.0).abs() < 1e-12);
            let k_t = 8.0 * shear * (small * overlap).sqrt();
            assert!((stuck.tangential.along / k_t - 1.0).abs() < 1e-12);
            let slid = force.derivatives(&state(materials, 1e-3));
            let friction = slid.tangential.value[0].abs() / normal;
            assert!((friction - 0.04f64.sqrt()).abs() < 1e-12, "{friction}");
        }
        let like = |k| force.derivatives(&state([k, k], 1e-3));
        let [glass, steel] = [0, 1].map(|k| like(k).tangential.value[0] / like(k).normal);
        assert!((glass.abs() - 0.4).abs() < 1e-12 && (steel.abs() - 0.1).abs() < 1e-12);
    }

    /// As many grains of each material as their fractions say, within four standard errors,
    /// whatever their size; and all larger grains of a binary mixture by volume.
    #[test]
    fn grains_have_the_materials_that_are_asked_for() {
        let made = |scene: &Scene| {
            let walls = scene.plane_shear("s").expect("walls");
            let Origin::Insertion(sizes) = &walls.origin else {
                panic!("inserted");
            };
            let lattice = Lattice::new(scene.seed, &scene.sample, sizes);
            let made = |rank, ranks| {
                let mut grains = lattice.insert(rank, ranks);
                let largest = scene.sample.radius_max;
                scene.materials.give(scene.seed, largest, &mut grains);
                grains
            };
            let whole = made(0, 1);
            let parts: Vec<_> = (0..3).flat_map(|r| made(r, 3)).collect();
            assert_eq!(whole, parts);
            whole
        };
        let grains = made(&mixture("").expect("a scene"));
        let of_steel = grains.iter().filter(|g| g.material == 1).count() as f64;
        assert!((of_steel / 4000.0 - 0.3).abs() < 4.0 * (0.21f64 / 4000.0).sqrt());
        let text = MIXTURE.replace(", fraction = 0.3", "");
        let sets = "sample.sizes=binary sample.large_fraction=0.5
            sample.large_fraction_by=volume sample.large_material=steel";
        let scene = load(&Source::new("s", &text), &overrides(sets)).expect("a scene");
        let grains = made(&scene);
        let is_large = |r: f64| r == scene.sample.radius_max;
        let mut materials = grains.iter().map(|g| (g.material == 1, is_large(g.radius)));
        assert!(materials.all(|(is_steel, is_large)| is_steel == is_large));
        let volume = |large: bool| -> f64 {
            let alike = grains.iter().filter(|g| is_large(g.radius) == large);
            alike.map(|g| g.radius.powi(3)).sum()
        };
        let share = volume(true) / (volume(true) + volume(false));
        assert!((share - 0.5).abs() < 0.03, "{share}");
    }

    /// What is written is read again as the same scene.
    #[test]
    fn what_is_written_is_the_same_scene() {
        let hertz = "contact.law=hertz contact.impact_speed=1.0 contact.impact_diameter=2e-3";
        for sets in ["", hertz] {
            let scene = mixture(sets).expect("a scene");
            let again = load(&Source::new("s", &scene.toml), &[]).expect("a scene");
            assert_eq!(again.toml, scene.toml);
            assert_eq!(again.materials.laws, scene.materials.laws);
            assert_eq!(identity(&again), identity(&scene));
        }
        let scene = mixture("").expect("a scene");
        let other = MIXTURE.replace("friction = 0.1", "friction = 0.2");
        let other = load(&Source::new("s", &other), &[]).expect("a scene");
        assert_ne!(identity(&other), identity(&scene));
    }

    /// Two materials, of which `pairs` says what differs, with this law.
    fn two(law: &str, keys: &str, pairs: &str) -> Result<Scene> {
        let dimension = if law == "lee-hurley" { 2 } else { 3 };
        let text = format!(
            "dimension = {dimension}\n{}",
            r#"
            material = [
                { name = "a", density = 2500.0 ELASTIC },
                { name = "b", density = 5000.0 ELASTIC2, fraction = 0.3 },
            ]
            contact = { law = "LAW", friction = 0.4, KEYS, pair = [PAIRS] }
            sample = { grains = 4000, radius_min = 8e-4, radius_max = 1e-3, length = 0.016 WIDTH }
            load.pressure = 100.0
            shear = { inertial_number = 1e-2, strain = 0.02 }
            "#
        );
        let elastic = |modulus: &str| match law {
            "hooke" | "mindlin" => String::new(),
            _ => format!(", young_modulus = {modulus}, poisson_ratio = 0.2"),
        };
        let text = text
            .replace("ELASTIC2", &elastic("4e8"))
            .replace("ELASTIC", &elastic("1e8"))
            .replace("LAW", law)
            .replace("KEYS", keys)
            .replace("PAIRS", pairs)
            .replace(
                "WIDTH",
                if dimension == 3 {
                    ", width = 0.016"
                } else {
                    ""
                },
            );
        load(&Source::new("two.toml", text), &[])
    }

    /// The values of a key of like grains of both materials, and of unlike grains.
    fn values_of(scene: &Scene, key: &str) -> [f64; 3] {
        [0, 3, 1].map(|pair| {
            let (law, contact) = &scene.materials.laws[pair];
            match key {
                "rolling_stiffness" => turning_stiffnesses(law, contact)[0].expect("has one"),
                "twisting_stiffness" => turning_stiffnesses(law, contact)[1].expect("has one"),
                _ => {
                    let mut given = law.given().iter();
                    given
                        .find(|(known, _)| known.name() == key)
                        .expect("a value")
                        .1
                }
            }
        })
    }

    /// Every key of `[contact]` whose default follows from others, left at it by one like pair or
    /// by both: unlike grains have the geometric mean of what the like ones have, and writing down
    /// what `[contact]` had by default changes nothing.
    #[test]
    fn unlike_grains_have_the_mean_of_what_like_ones_have_by_default() {
        let roll = "rolling_friction = 0.1, twisting_friction = 0.1";
        let bb = |keys: &str| format!(r#"{{ materials = ["b", "b"], {keys} }}"#);
        let hooke = "damping_ratio = 0.1, normal_stiffness = 1000.0";
        let impact = "restitution = 0.5, impact_speed = 1.0, impact_diameter = 2e-3";
        for (law, keys, pair, key) in [
            (
                "hooke",
                hooke,
                "tangential_stiffness = 1000.0",
                "tangential_stiffness",
            ),
            (
                "hooke",
                hooke,
                "normal_stiffness = 3000.0",
                "tangential_stiffness",
            ),
            (
                "hooke",
                &format!("{hooke}, {roll}"),
                "rolling_stiffness = 9.0",
                "rolling_stiffness",
            ),
            (
                "hooke",
                &format!("{hooke}, {roll}"),
                "rolling_stiffness = 9.0",
                "twisting_stiffness",
            ),
            (
                "hooke",
                &format!("{hooke}, {roll}"),
                "twisting_stiffness = 9.0",
                "twisting_stiffness",
            ),
            (
                "mindlin",
                "normal_stiffness = 1e6",
                "tangential_stiffness = 9e5",
                "tangential_stiffness",
            ),
            (
                "hertz",
                "normal_damping = 1e6",
                "tangential_damping = 9e6",
                "tangential_damping",
            ),
            (
                "hertz",
                "normal_damping = 1e6",
                "normal_damping = 4e6",
                "tangential_damping",
            ),
            ("hertz", impact, "friction = 0.1", "tangential_damping"),
            (
                "hertz-tsuji",
                "restitution = 0.5",
                "tangential_damping_ratio = 0.9",
                "tangential_damping_ratio",
            ),
            (
                "lee-hurley",
                "damping_ratio = 0.1, rolling_friction = 0.1",
                "friction = 0.3",
                "rolling_stiffness",
            ),
            (
                "lee-hurley",
                "damping_ratio = 0.1",
                "sliding_damping = 0.5",
                "sliding_damping",
            ),
        ] {
            let case = format!("{law} {pair} {key}");
            let scene = two(law, keys, &bb(pair)).unwrap_or_else(|e| panic!("{case}: {e}"));
            let [a, b, unlike] = values_of(&scene, key);
            assert!(a != b, "{case}");
            assert_eq!(unlike, geometric_mean(a, b), "{case}");
            let again = load(&Source::new("s", &scene.toml), &[]).expect("a scene");
            assert_eq!(format!("{again:?}"), format!("{scene:?}"), "{case}");
            // Of like pairs that have none of their own.
            let default = format!("{key} = {a:?}");
            if !pair.contains("normal") && pair.contains(key) {
                let scene_with = two(law, &format!("{keys}, {default}"), &bb(pair));
                let laws = scene_with.expect("a scene").materials.laws;
                assert_eq!(laws, scene.materials.laws, "{case}");
            }
        }
    }

    /// A mean that the pair cannot have is refused with the names of the pair.
    #[test]
    fn a_mean_beyond_the_bounds_of_the_pair_is_refused() {
        let pair = r#"{ materials = ["a", "b"], normal_stiffness = 10.0 }"#;
        let keys = "damping_ratio = 0.1, normal_stiffness = 1000.0";
        let said = two("hooke", keys, pair).expect_err("refused").to_string();
        for part in [
            r#""a" and "b": tangential_stiffness"#,
            "normal_stiffness = 10.0]",
        ] {
            assert!(said.contains(part), "{said}");
        }
    }

    /// The equivalent material has the E* and G* of the pair (K. L. Johnson, Contact Mechanics,
    /// eqs 4.20 and 7.36).
    #[test]
    fn the_equivalent_material_has_the_moduli_of_the_pair() {
        let [glass, rubber, other] =
            [[65e9, 0.22], [1e7, 0.49], [66e9, 0.1]].map(|[young_modulus, poisson_ratio]| {
                Elastic {
                    young_modulus,
                    poisson_ratio,
                }
            });
        for pair in [[glass, rubber], [rubber, glass], [glass, other]] {
            let same = effective(pair[0], pair[1]);
            for modulus in [Elastic::normal, Elastic::tangential] {
                let sum = 1.0 / modulus(&pair[0]) + 1.0 / modulus(&pair[1]);
                assert!((2.0 / modulus(&same) / sum - 1.0).abs() < 1e-12, "{pair:?}");
            }
        }
        assert_eq!(effective(glass, glass), glass);
    }
}
