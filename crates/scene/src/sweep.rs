//! `[sweep]`: lists of values for keys of the configuration, and the runs that they make together.
//!
//! ```toml
//! [sweep]
//! seeds = 3                            # seed = [1, 2, 3]
//! "contact.friction" = [0.1, 0.5]      # each with every value of the others
//! [sweep.zip]                          # the first with the first, the second with the second
//! "load.pressure" = ["1 kPa", "2 kPa"]
//! "shear.velocity" = [0.1, 0.2]
//! ```

use std::collections::{HashMap, HashSet};

use toml::de::{DeTable, DeValue};
use toml::{Spanned, Value};

use super::keys::resolve;
use super::source::{Input, Source};
use super::units;
use super::value::Value as KeyValue;
use super::words::{SWEEP, TAKE_AWAY, shortened};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::laws::keys::Key;

/// Runs of a sweep. All are listed, and checked before the first one runs.
const MOST_RUNS: usize = 10_000;

/// Longest name of a folder (bytes).
const LONGEST_NAME: usize = 255;
/// The key whose values are paths from the folder of the file.
const PACKING: &str = "sample.packing";
/// The table, or the tables, of keys whose values are paired.
const ZIP: &str = "zip";
/// The number of seeds, which stand for the seeds from 1 on.
const SEEDS: &str = "seeds";

/// A run of a sweep.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Member {
    /// Of its folder: `friction-0.7_seed-2`.
    pub name: String,
    /// Its values, as of `--set`.
    pub set: Vec<String>,
    /// Where the file has each of them, as messages name a place.
    pub places: Vec<String>,
}

impl Member {
    /// A failure whose message names the place in the file instead of a `--set` that no one gave.
    pub fn place(&self, failure: Failure) -> Failure {
        let Failure::Input(mut message) = failure else {
            return failure;
        };
        for (set, place) in self.set.iter().zip(&self.places) {
            message = message.replace(&format!("--set {set}"), &format!("{place}: {set}"));
        }
        Failure::Input(message)
    }

    /// The run that has a value of one more key; `name`: of the key in folders.
    fn with(&self, key: &SweptKey, name: &str, value: &KeyText) -> Self {
        let own = format!("{name}-{}", in_a_path(&value.text));
        let mut member = self.clone();
        member.set.push(format!("{}={}", key.path, value.set));
        member.places.push(key.place.clone());
        member.name = match &self.name[..] {
            "" => own,
            before => format!("{before}_{own}"),
        };
        member
    }
}

/// A key whose values meet those of the other axes, or several keys whose values are paired.
struct Axis {
    keys: Vec<SweptKey>,
}

impl Axis {
    /// Number of values of each of its keys.
    fn len(&self) -> usize {
        self.keys[0].values.len()
    }
}

/// A key of a sweep and its values.
struct SweptKey {
    offset: usize,
    /// Where the table has it, as messages name a place.
    place: String,
    /// Its name in the table of the sweep, such as `zip.contact.friction`.
    label: String,
    /// Its name in a configuration.
    path: String,
    declared: &'static Key,
    values: Vec<KeyText>,
}

impl SweptKey {
    /// The name of the key without the table.
    fn name(&self) -> &str {
        self.path.rsplit('.').next().unwrap_or_default()
    }
}

/// A value of a key.
struct KeyText {
    /// As the file has it.
    text: String,
    /// As of `--set`.
    set: String,
}

impl KeyText {
    /// A value in the list of a key, which is at this offset.
    fn read(input: &Input<'_>, offset: usize, path: &str, value: &Spanned<DeValue<'_>>) -> Self {
        let text = input.source.slice(value.span()).to_string();
        let set = match value.get_ref().as_str() {
            // A path of --set is from the working directory.
            Some(file) if path == PACKING && file != TAKE_AWAY => {
                let file = input.folder(offset).join(file);
                Value::from(file.display().to_string()).to_string()
            }
            _ => text.clone(),
        };
        Self { text, set }
    }
}

/// A key in the table of a sweep.
struct Leaf<'t, 'v> {
    offset: usize,
    /// From the table of the sweep on.
    label: String,
    value: &'t Spanned<DeValue<'v>>,
}

impl<'t, 'v> Leaf<'t, 'v> {
    /// The leaves of a table in the order of the file. Keys with dots may be written in quotes or,
    /// as TOML has it, as tables in tables.
    fn of(table: &'t DeTable<'v>, above: &str) -> Vec<Self> {
        let mut leaves = Vec::new();
        Self::collect(table, above, &mut leaves);
        leaves.sort_by_key(|leaf| leaf.offset);
        leaves
    }

    fn collect(table: &'t DeTable<'v>, above: &str, leaves: &mut Vec<Self>) {
        for (key, value) in table {
            let label = match above {
                "" => key.get_ref().to_string(),
                above => format!("{above}.{}", key.get_ref()),
            };
            let offset = key.span().start;
            match value.get_ref() {
                DeValue::Table(inner) => Self::collect(inner, &label, leaves),
                _ => leaves.push(Self {
                    offset,
                    label,
                    value,
                }),
            }
        }
    }

    /// The name of the key in a configuration.
    fn path(&self) -> &str {
        let in_zip = self.label.strip_prefix(ZIP);
        let path = in_zip.and_then(|path| path.strip_prefix('.'));
        path.unwrap_or(&self.label)
    }
}

/// The runs of a configuration with a sweep, `None` of one without: every value with every other,
/// paired values together; the last key changes fastest.
///
/// # Errors
/// `Failure::Input` where the table is none, has an unknown key, or something else than
/// lists of different values.
pub fn members(source: &Source) -> Result<Option<Vec<Member>>> {
    let input = source.input();
    let mut sweep = None;
    for part in &source.parts {
        // What is not TOML is said by whoever reads the rest of it.
        let Ok(mut tree) = DeTable::parse(&part.padded).map(Spanned::into_inner) else {
            return Ok(None);
        };
        sweep = sweep.or(tree.remove_entry(SWEEP));
    }
    let Some((key, value)) = sweep else {
        return Ok(None);
    };
    if value.get_ref().as_str() == Some(TAKE_AWAY) {
        return Ok(None);
    }
    let at = key.span().start;
    let DeValue::Table(table) = value.get_ref() else {
        let what =
            "is a table; write [sweep] and under it lists of values, such as seed = [1, 2, 3]";
        return Err(failure(&input, at, "", what));
    };
    let axes = axes(&input, groups(&input, table)?)?;
    if axes.is_empty() {
        let what = "is empty; give lists of values, such as seed = [1, 2, 3]";
        return Err(failure(&input, at, "", what));
    }
    let all = product(&axes);
    let mut seen = HashSet::new();
    let last = &axes[axes.len() - 1].keys[0];
    for Member { name, .. } in &all {
        let what = if name.len() > LONGEST_NAME {
            format!(
                "gives a run a folder whose name has {} characters, more than {LONGEST_NAME}; make the values shorter, or split the sweep",
                name.len()
            )
        } else if !seen.insert(name) {
            let name = shortened(name);
            format!("gives two runs the name {name}; make the values shorter")
        } else {
            continue;
        };
        return Err(failure(&input, last.offset, &last.label, &what));
    }
    Ok(Some(all))
}

/// Whether an override (`sweep=none`) takes the sweep of the file away.
pub fn takes_sweep_away(set: &str) -> bool {
    let parts = set
        .split_once('=')
        .map(|(path, value)| (path.trim(), value.trim()));
    parts == Some((SWEEP, TAKE_AWAY))
}

/// A failure at a key of the table; of the table itself if there is none.
fn failure(input: &Input<'_>, offset: usize, label: &str, what: &str) -> Failure {
    let path = match label {
        "" => SWEEP.to_string(),
        label => format!("{SWEEP}.{label}"),
    };
    input.failure(offset, &path, what)
}

/// The keys of a sweep in the order of the file: each by itself, those of a table `zip` together.
fn groups<'t, 'v>(input: &Input<'_>, table: &'t DeTable<'v>) -> Result<Vec<Vec<Leaf<'t, 'v>>>> {
    let is_zip = |leaf: &Leaf<'_, '_>| leaf.label == ZIP || leaf.label.starts_with("zip.");
    let mut groups: Vec<Vec<_>> = Leaf::of(table, "")
        .into_iter()
        .filter(|leaf| !is_zip(leaf))
        .map(|leaf| vec![leaf])
        .collect();
    if let Some((key, value)) = table.get_key_value(ZIP) {
        let at = key.span().start;
        let wrong = || {
            let what = "must be a table of lists that belong together, such as [sweep.zip], or several of them: [[sweep.zip]]";
            failure(input, at, ZIP, what)
        };
        let tables = match value.get_ref() {
            DeValue::Table(table) => vec![table],
            DeValue::Array(tables) => {
                let tables = tables.iter().map(|table| table.get_ref().as_table());
                tables.collect::<Option<_>>().ok_or_else(wrong)?
            }
            _ => return Err(wrong()),
        };
        for table in tables {
            let leaves = Leaf::of(table, ZIP);
            if leaves.is_empty() {
                let what = "is empty; give lists that belong together, such as seed = [1, 2]";
                return Err(failure(input, at, ZIP, what));
            }
            groups.push(leaves);
        }
    }
    groups.sort_by_key(|leaves| leaves[0].offset);
    Ok(groups)
}

/// The axes of a sweep with their lists of values.
fn axes(input: &Input<'_>, groups: Vec<Vec<Leaf<'_, '_>>>) -> Result<Vec<Axis>> {
    let mut axes: Vec<Axis> = Vec::new();
    let mut runs = 1usize;
    for leaves in groups {
        let mut keys: Vec<SweptKey> = Vec::new();
        for leaf in leaves {
            let refused = |what: &str| failure(input, leaf.offset, &leaf.label, what);
            let key = swept_key(input, &leaf, keys.is_empty().then_some((runs, axes.len())))?;
            let mut known = axes.iter().flat_map(|axis| &axis.keys).chain(&keys);
            if let Some(other) = known.find(|other| other.path == key.path) {
                let place = input.place(other.offset);
                return Err(refused(&format!(
                    "gives {} values, as {SWEEP}.{} ({place}) does; give them once",
                    key.path, other.label
                )));
            }
            if let Some(first) = keys.first()
                && first.values.len() != key.values.len()
            {
                return Err(refused(&format!(
                    "has {} values and {SWEEP}.{} {}; paired lists have the same length",
                    key.values.len(),
                    first.label,
                    first.values.len()
                )));
            }
            keys.push(key);
        }
        let axis = Axis { keys };
        runs *= axis.len();
        if let Some(what) = repetition(&axis) {
            let SweptKey { offset, label, .. } = &axis.keys[0];
            return Err(failure(input, *offset, label, &what));
        }
        axes.push(axis);
    }
    Ok(axes)
}

/// The key of a leaf with its values. `before`: the runs that the axes before it make, and the
/// number of these axes, if it is the first of its axis.
fn swept_key(
    input: &Input<'_>,
    leaf: &Leaf<'_, '_>,
    before: Option<(usize, usize)>,
) -> Result<SweptKey> {
    let refused = |what: &str| failure(input, leaf.offset, &leaf.label, what);
    let (runs_before, axes_before) = before.unwrap_or((1, 0));
    // Before anything is done for each of them.
    let counted = |values: usize| {
        let runs = runs_before.saturating_mul(values);
        if runs <= MOST_RUNS {
            return Ok(());
        }
        let so_far = match axes_before {
            0 => String::new(),
            _ => format!(" with the lists before it {runs} runs,"),
        };
        Err(refused(&format!(
            "has {values} values,{so_far} more than the {MOST_RUNS} runs that a sweep may have; give shorter lists, or split the sweep into several files"
        )))
    };
    let (path, values) = if leaf.label == SEEDS {
        let count = leaf.value.get_ref().as_integer();
        let count = count.and_then(|n| usize::from_str_radix(n.as_str(), n.radix()).ok());
        let Some(count) = count.filter(|count| *count > 0) else {
            return Err(refused(
                "must be the number of seeds, such as 3 for the seeds 1, 2 and 3",
            ));
        };
        counted(count)?;
        let seeds = (1..=count).map(|seed| KeyText {
            text: seed.to_string(),
            set: seed.to_string(),
        });
        ("seed", seeds.collect())
    } else {
        let path = leaf.path();
        resolve(path).map_err(|what| refused(&what))?;
        let list = leaf.value.get_ref().as_array();
        let Some(list) = list.filter(|list| !list.is_empty()) else {
            return Err(refused(
                "must be a list of one value or more, such as [0.1, 0.3]",
            ));
        };
        counted(list.len())?;
        let values = list.iter();
        let values = values.map(|value| KeyText::read(input, leaf.offset, path, value));
        (path, values.collect())
    };
    Ok(SweptKey {
        offset: leaf.offset,
        place: format!("{}: {SWEEP}", input.place(leaf.offset)),
        label: leaf.label.clone(),
        path: path.into(),
        declared: resolve(path).map_err(|what| refused(&what))?,
        values,
    })
}

/// What to say of the first value, or the first values that are paired, that an axis has twice.
fn repetition(axis: &Axis) -> Option<String> {
    let mut seen = HashMap::new();
    for k in 0..axis.len() {
        let texts = axis.keys.iter().map(|key| &key.values[k].text[..]);
        let text = texts.collect::<Vec<_>>().join(" with ");
        let values = axis.keys.iter();
        let values = values.map(|key| in_units_of(key.declared, &key.values[k].text));
        let Some(first) = seen.insert(values.collect::<Vec<_>>(), text.clone()) else {
            continue;
        };
        return Some(if first == text {
            format!("has {} twice", shortened(&text))
        } else {
            let (first, again) = (shortened(&first), shortened(&text));
            format!("has {first} twice, as {again}, too; give each value once")
        });
    }
    None
}

/// A value of a key in the units of the key, the same text for all its spellings: `1e3`, `1000.0`
/// and `"1 kPa"`. What is no value of the key, which is refused later, stays as it is.
fn in_units_of(key: &Key, text: &str) -> String {
    match read_value(key, text) {
        Some(value) => format!("{value:?}"),
        None => text.to_string(),
    }
}

/// The value of a key that a text of TOML gives, if it is one.
fn read_value(key: &Key, text: &str) -> Option<KeyValue> {
    let line = Source::new("", format!("{} = {text}", key.path));
    let mut tree = DeTable::parse(&line.parts[0].padded).ok()?.into_inner();
    let numbers = units::numbers(&mut tree, &line.input()).ok()?;
    units::put(&mut tree, &numbers);
    let mut table = tree;
    if !key.table().is_empty() {
        let DeValue::Table(inner) = table.remove(key.table())?.into_inner() else {
            return None;
        };
        table = inner;
    }
    KeyValue::read(key.values, table.remove(key.name())?).ok()
}

/// What to say of a sweep that is run as if it were one scene.
pub(super) fn not_one_run(source: &Source) -> Result<String> {
    let runs = members(source)?.map_or(0, |members| members.len());
    Ok(format!(
        "makes {runs} runs of this scene; --sweep list shows them, --sweep N runs the N-th of them, --sweep all one after the other, or with --jobs several at a time"
    ))
}

/// Every value of an axis with every value of the others.
fn product(axes: &[Axis]) -> Vec<Member> {
    let mut members = vec![Member::default()];
    for axis in axes {
        let names = axis.keys.iter().map(|key| {
            let all = axes.iter().flat_map(|axis| &axis.keys);
            match all.filter(|other| other.name() == key.name()).count() {
                1 => key.name().to_string(),
                _ => key.path.replace('.', "-"),
            }
        });
        let names: Vec<String> = names.collect();
        let mut longer = Vec::with_capacity(members.len() * axis.len());
        for member in &members {
            for k in 0..axis.len() {
                let keys = axis.keys.iter().zip(&names);
                longer.push(keys.fold(member.clone(), |member, (key, name)| {
                    member.with(key, name, &key.values[k])
                }));
            }
        }
        members = longer;
    }
    members
}

/// A value as part of the name of a folder.
fn in_a_path(value: &str) -> String {
    let characters = value.trim_matches(['"', '\'']).chars();
    characters
        .map(|c| match c {
            c if c.is_alphanumeric() || "+-.".contains(c) => c,
            _ => '-',
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load;
    use crate::testing::cases;

    fn with(sweep: &str) -> Source {
        let scene = include_str!("../../../configs/plane-shear-2d.toml");
        Source::new("sweep.toml", format!("{scene}\n{sweep}\n"))
    }

    fn names(sweep: &str) -> Vec<String> {
        let members = members(&with(sweep)).expect("a sweep").expect("a sweep");
        members.into_iter().map(|member| member.name).collect()
    }

    fn message(sweep: &str) -> String {
        let refused = members(&with(sweep)).expect_err("refused").to_string();
        refused.split_once(": ").expect("a place").1.to_string()
    }

    #[test]
    fn every_value_meets_every_other_in_the_order_of_the_file() {
        let sweep = "[sweep]\nseed = [2, 1]\n\"contact.friction\" = [0.1, 0.30]";
        let wanted = [
            "seed-2_friction-0.1",
            "seed-2_friction-0.30",
            "seed-1_friction-0.1",
            "seed-1_friction-0.30",
        ];
        assert_eq!(names(sweep), wanted);
        let source = with(sweep);
        let members = members(&source).expect("a sweep").expect("a sweep");
        assert_eq!(members[1].set, ["seed=2", "contact.friction=0.30"]);
        let scene = load(&source.of_member(), &members[1].set).expect("a scene");
        assert_eq!((scene.seed, scene.contact.friction), (2, 0.3));
    }

    #[test]
    fn dotted_keys_are_tables_in_tables() {
        assert_eq!(
            names(
                "[sweep]\ncontact.friction = [0.1]\n[sweep.shear]\nstrain = [0.2, 0.3]\n[sweep.output]\nframe_strain=[1e-3]\n[sweep.pack]\nfriction = [0.5]"
            ),
            [
                "contact-friction-0.1_strain-0.2_frame_strain-1e-3_pack-friction-0.5",
                "contact-friction-0.1_strain-0.3_frame_strain-1e-3_pack-friction-0.5"
            ]
        );
        let titles = names("[sweep]\ntitle = ['a/b c', \"ü\"]");
        assert_eq!(titles, ["title-a-b-c", "title-ü"]);
    }

    #[test]
    fn paired_values_belong_together() {
        let paired = "[sweep]\n\"contact.friction\" = [0.1, 0.2]\n[sweep.zip]\nload.stiffness_number = [1e4, 2e4, 2e4]\nseed = [5, 6, 5]";
        let rows = [
            "stiffness_number-1e4_seed-5",
            "stiffness_number-2e4_seed-6",
            "stiffness_number-2e4_seed-5",
        ];
        let wanted = ["0.1", "0.2"]
            .map(|friction| rows.map(|row| format!("friction-{friction}_{row}")))
            .concat();
        assert_eq!(names(paired), wanted);
        let runs = members(&with(paired)).expect("a sweep").expect("a sweep");
        assert_eq!(
            runs[4].set,
            [
                "contact.friction=0.2",
                "load.stiffness_number=2e4",
                "seed=6"
            ]
        );
        // Two pairs, each with every one of the other; written in a line.
        let two = "[sweep]\nzip = [{ seed = [1, 2], title = ['a', 'b'] }, { \"contact.friction\" = [0.1, 0.2], \"shear.strain\" = [1, 2] }]";
        assert_eq!(
            names(two),
            [
                "seed-1_title-a_friction-0.1_strain-1",
                "seed-1_title-a_friction-0.2_strain-2",
                "seed-2_title-b_friction-0.1_strain-1",
                "seed-2_title-b_friction-0.2_strain-2"
            ]
        );
    }

    #[test]
    fn seeds_are_counted() {
        let counted = members(&with("[sweep]\nseeds = 3\ntitle = ['a', 'b']"));
        let listed = members(&with("[sweep]\nseed = [1, 2, 3]\ntitle = ['a', 'b']"));
        assert_eq!(counted.expect("a sweep"), listed.expect("a sweep"));
    }

    #[test]
    fn a_scene_without_a_sweep_has_none() {
        assert_eq!(members(&with("")).expect("no sweep"), None);
        assert_eq!(members(&Source::new("x", "[[[")).expect("no sweep"), None);
    }

    #[test]
    fn bad_sweeps() {
        for [sweep, wanted] in cases(
            r#"
            [sweep] | sweep: is empty; give lists of values, such as seed = [1, 2, 3]
            [sweep]\nseed = 3 | sweep.seed: must be a list of one value or more, such as [0.1, 0.3]
            [sweep]\nseed = [] | sweep.seed: must be a list of one value or more, such as [0.1, 0.3]
            [sweep]\nseed = [1, 2, 1] | sweep.seed: has 1 twice
            [sweep]\nseed = [16, 0x10] | sweep.seed: has 16 twice, as 0x10, too; give each value once
            [sweep]\n"load.pressure" = ["1 kPa", "1000 Pa"] | sweep.load.pressure: has "1 kPa" twice, as "1000 Pa", too; give each value once
            [sweep]\n"load.pressure" = [2e3, "1 kPa", 1_000] | sweep.load.pressure: has "1 kPa" twice, as 1_000, too; give each value once
            [sweep]\n"contact.friction" = [0.1, 0.10] | sweep.contact.friction: has 0.1 twice, as 0.10, too; give each value once
            [sweep]\n"shear.protocol" = [[{velocity="1 m/s", time=1}], [{time="1000 ms", velocity=1.0}]] | sweep.shear.protocol: has [{velocity="1 m/s", time=1}] twice, as [{time="1000 ms", velocity=1.0}], too; give each value once
            [sweep]\ntitle = ['a', "a"] | sweep.title: has 'a' twice, as "a", too; give each value once
            [sweep]\ntitle = ['a/b', 'a b'] | sweep.title: gives two runs the name title-a-b; make the values shorter
            [sweep]\nzip = 3 | sweep.zip: must be a table of lists that belong together, such as [sweep.zip], or several of them: [[sweep.zip]]
            [sweep]\nzip = [3] | sweep.zip: must be a table of lists that belong together, such as [sweep.zip], or several of them: [[sweep.zip]]
            [sweep.zip] | sweep.zip: is empty; give lists that belong together, such as seed = [1, 2]
            [sweep.zip]\nseed = 3 | sweep.zip.seed: must be a list of one value or more, such as [0.1, 0.3]
            [sweep.zip]\nseed = [1, 2]\ntitle = ['a'] | sweep.zip.title: has 1 values and sweep.zip.seed 2; paired lists have the same length
            [sweep.zip]\nseed = [1, 2, 0x1]\ntitle = ['a', 'b', "a"] | sweep.zip.seed: has 1 with 'a' twice, as 0x1 with "a", too; give each value once
            [sweep]\nseeds = 0 | sweep.seeds: must be the number of seeds, such as 3 for the seeds 1, 2 and 3
            [sweep]\nseeds = [1, 2] | sweep.seeds: must be the number of seeds, such as 3 for the seeds 1, 2 and 3
            [sweep]\nseeds = 100000 | sweep.seeds: has 100000 values, more than the 10000 runs that a sweep may have; give shorter lists, or split the sweep into several files
            "#,
        ) {
            assert_eq!(message(&sweep), wanted);
        }
        for twice in [
            "[sweep]\nseed = [1]\n[sweep.zip]\nseed = [2, 3]",
            "[sweep]\nseed = [1]\nseeds = 2",
        ] {
            let said = message(twice);
            assert!(
                said.contains("gives seed values, as sweep.seed ("),
                "{said}"
            );
        }
        assert!(message("[sweep]\nsede = [1]").starts_with("sweep.sede: unknown key"));
        assert!(message("[sweep.zip]\nsede = [1]").starts_with("sweep.zip.sede: unknown key"));
        assert!(message("[sweep]\n'contact.fricton' = [1]").contains("did you mean friction?"));
    }

    /// Neighbouring integers beyond 2⁵³ are different values, though their doubles are not.
    #[test]
    fn large_seeds_are_different() {
        let two = names("[sweep]\nseed = [9007199254740992, 9007199254740993]");
        assert_eq!(two.len(), 2);
    }

    /// Told before they are made, whether its runs are listed or it is run as one scene.
    #[test]
    fn sweeps_of_too_many_runs() {
        let list = |n: usize| {
            let values: Vec<String> = (0..n).map(|k| k.to_string()).collect();
            format!("[{}]", values.join(","))
        };
        let many = format!("[sweep]\nseed = {}", list(1_300_000));
        let expected = "sweep.seed: has 1300000 values, more than the 10000 runs that a sweep may have; give shorter lists, or split the sweep into several files";
        assert_eq!(message(&many), expected);
        let run = load(&with(&many), &[]).expect_err("refused").to_string();
        assert!(run.ends_with(expected), "{run}");
        let product = format!(
            "[sweep]\nseed = {}\n'shear.strain' = {}",
            list(100),
            list(101)
        );
        let expected = "sweep.shear.strain: has 101 values, with the lists before it 10100 runs, more than the 10000 runs that a sweep may have; give shorter lists, or split the sweep into several files";
        assert_eq!(message(&product), expected);
        let most = format!("[sweep]\nseed = {}", list(MOST_RUNS));
        assert_eq!(names(&most).len(), MOST_RUNS);
    }

    #[test]
    fn a_sweep_is_not_one_run() {
        let refused = load(&with("[sweep]\nseed = [1, 2]"), &[]).expect_err("refused");
        let said = "sweep: makes 2 runs of this scene; --sweep list";
        assert!(refused.to_string().contains(said), "{refused}");
    }
}
