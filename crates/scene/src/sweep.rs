//! `[sweep]`: lists of values for keys of the configuration, and the runs that they make together.

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

    /// The run that has a value of one more axis; `name`: of the axis in folders.
    fn with(&self, axis: &Axis, name: &str, value: &AxisValue) -> Self {
        let own = format!("{name}-{}", in_a_path(&value.text));
        let mut member = self.clone();
        member.set.push(format!("{}={}", axis.path, value.set));
        member.places.push(axis.place.clone());
        member.name = match &self.name[..] {
            "" => own,
            before => format!("{before}_{own}"),
        };
        member
    }
}

/// A key, the values it takes as TOML, and where the table has it.
struct Axis {
    offset: usize,
    place: String,
    path: String,
    values: Vec<AxisValue>,
}

impl Axis {
    /// The name of its key without the table.
    fn key_name(&self) -> &str {
        self.path.rsplit('.').next().unwrap_or_default()
    }
}

/// A value of an axis.
struct AxisValue {
    /// As the file has it.
    text: String,
    /// As of `--set`.
    set: String,
}

impl AxisValue {
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
        AxisValue { text, set }
    }
}

/// A key in the table of a sweep.
struct Leaf<'t, 'v> {
    offset: usize,
    path: String,
    value: &'t Spanned<DeValue<'v>>,
}

/// The runs of a configuration with a sweep, `None` of one without: every value with every other,
/// the last key changing fastest.
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
    let mut leaves = Vec::new();
    collect_leaves(table, "", &mut leaves);
    leaves.sort_by_key(|leaf| leaf.offset);
    let axes = axes(&input, leaves)?;
    if axes.is_empty() {
        let what = "is empty; give lists of values, such as seed = [1, 2, 3]";
        return Err(failure(&input, at, "", what));
    }
    let all = product(&axes);
    let mut seen = HashSet::new();
    let last = &axes[axes.len() - 1];
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
        return Err(failure(&input, last.offset, &last.path, &what));
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
fn failure(input: &Input<'_>, offset: usize, path: &str, what: &str) -> Failure {
    let path = match path {
        "" => SWEEP.to_string(),
        path => format!("{SWEEP}.{path}"),
    };
    input.failure(offset, &path, what)
}

/// The keys of a sweep with their lists of values.
fn axes(input: &Input<'_>, leaves: Vec<Leaf<'_, '_>>) -> Result<Vec<Axis>> {
    let mut axes: Vec<Axis> = Vec::new();
    let mut runs = 1usize;
    for leaf in leaves {
        let Leaf {
            offset,
            path,
            value,
        } = leaf;
        let key = resolve(&path).map_err(|what| failure(input, offset, &path, &what))?;
        let list = value.get_ref().as_array().filter(|list| !list.is_empty());
        let Some(list) = list else {
            let what = "must be a list of one value or more, such as [0.1, 0.3]";
            return Err(failure(input, offset, &path, what));
        };
        // Before anything is done for each of them.
        runs = runs.saturating_mul(list.len());
        if runs > MOST_RUNS {
            let so_far = match axes.len() {
                0 => String::new(),
                _ => format!(" with the lists before it {runs} runs,"),
            };
            let what = format!(
                "has {} values,{so_far} more than the {MOST_RUNS} runs that a sweep may have; give shorter lists, or split the sweep into several files",
                list.len()
            );
            return Err(failure(input, offset, &path, &what));
        }
        let values: Vec<AxisValue> = list
            .iter()
            .map(|value| AxisValue::read(input, offset, &path, value))
            .collect();
        if let Some(what) = repetition(key, &values) {
            return Err(failure(input, offset, &path, &what));
        }
        axes.push(Axis {
            offset,
            place: format!("{}: {SWEEP}", input.place(offset)),
            path,
            values,
        });
    }
    Ok(axes)
}

/// What to say of the first value of a key that is given twice, if one is.
fn repetition(key: &Key, values: &[AxisValue]) -> Option<String> {
    let mut seen = HashMap::new();
    for AxisValue { text, .. } in values {
        let Some(first) = seen.insert(in_units_of(key, text), text) else {
            continue;
        };
        return Some(if first == text {
            format!("has {} twice", shortened(text))
        } else {
            let (first, again) = (shortened(first), shortened(text));
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
        "makes {runs} runs of this scene; --sweep list shows them, --sweep N runs the N-th of them, --sweep all one after the other"
    ))
}

/// Keys with dots may be written in quotes or, as TOML has it, as tables in tables.
fn collect_leaves<'t, 'v>(table: &'t DeTable<'v>, above: &str, leaves: &mut Vec<Leaf<'t, 'v>>) {
    for (key, value) in table {
        let path = match above {
            "" => key.get_ref().to_string(),
            above => format!("{above}.{}", key.get_ref()),
        };
        match value.get_ref() {
            DeValue::Table(inner) => collect_leaves(inner, &path, leaves),
            _ => leaves.push(Leaf {
                offset: key.span().start,
                path,
                value,
            }),
        }
    }
}

/// Every value of an axis with every value of the others.
fn product(axes: &[Axis]) -> Vec<Member> {
    let mut members = vec![Member::default()];
    for axis in axes {
        let alike = axes
            .iter()
            .filter(|other| other.key_name() == axis.key_name());
        let name = match alike.count() {
            1 => axis.key_name().to_string(),
            _ => axis.path.replace('.', "-"),
        };
        members = members
            .iter()
            .flat_map(|member| {
                let values = axis.values.iter();
                values.map(|value| member.with(axis, &name, value))
            })
            .collect();
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
            "#,
        ) {
            assert_eq!(message(&sweep), wanted);
        }
        assert!(message("[sweep]\nsede = [1]").starts_with("sweep.sede: unknown key"));
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
