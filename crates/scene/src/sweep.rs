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
pub const MOST_RUNS: usize = 10_000;

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
}

/// A key, the values it takes as TOML, and where the table has it.
struct Axis {
    offset: usize,
    place: String,
    path: String,
    /// As the file has them, and as of `--set`.
    values: Vec<[String; 2]>,
}

/// The runs of a configuration with a sweep, `None` of one without: every value with every other,
/// the last key changing fastest.
///
/// # Errors `Failure::Input` where the table is none, has an unknown key, or something else than
/// lists of different values.
pub fn members(source: &Source) -> Result<Option<Vec<Member>>> {
    let input = source.input();
    let mut found = None;
    for part in &source.parts {
        // What is not TOML is said by whoever reads the rest of it.
        let Ok(mut tree) = DeTable::parse(&part.padded).map(Spanned::into_inner) else {
            return Ok(None);
        };
        found = found.or(tree.remove_entry(SWEEP));
    }
    let found = found.filter(|(_, value)| value.get_ref().as_str() != Some(TAKE_AWAY));
    let Some((key, value)) = found else {
        return Ok(None);
    };
    let refuse = |offset, path: &str, what: &str| refuse(&input, offset, path, what);
    let at = key.span().start;
    let DeValue::Table(table) = value.get_ref() else {
        let what =
            "is a table; write [sweep] and under it lists of values, such as seed = [1, 2, 3]";
        return refuse(at, "", what);
    };
    let mut found = Vec::new();
    leaves(table, "", &mut found);
    found.sort_by_key(|(offset, ..)| *offset);
    let axes = axes(&input, found)?;
    if axes.is_empty() {
        let what = "is empty; give lists of values, such as seed = [1, 2, 3]";
        return refuse(at, "", what);
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
        return refuse(last.offset, &last.path, &what);
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
fn refuse<T>(input: &Input<'_>, offset: usize, path: &str, what: &str) -> Result<T> {
    let path = match path {
        "" => SWEEP.to_string(),
        path => format!("{SWEEP}.{path}"),
    };
    Err(input.failure(offset, &path, what))
}

/// The keys of a sweep with their values, from their places, paths and lists.
fn axes(
    input: &Input<'_>,
    found: Vec<(usize, String, &Spanned<DeValue<'_>>)>,
) -> Result<Vec<Axis>> {
    let refuse = |offset, path: &str, what: &str| refuse(input, offset, path, what);
    let mut axes: Vec<Axis> = Vec::new();
    let mut runs = 1usize;
    for (offset, path, value) in found {
        let key = match resolve(&path) {
            Ok(key) => key,
            Err(what) => return refuse(offset, &path, &what),
        };
        let list = value.get_ref().as_array().filter(|list| !list.is_empty());
        let Some(list) = list else {
            let what = "must be a list of one value or more, such as [0.1, 0.3]";
            return refuse(offset, &path, what);
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
            return refuse(offset, &path, &what);
        }
        let both = |v: &Spanned<DeValue<'_>>| {
            let text = input.source.slice(v.span()).to_string();
            let file = v.get_ref().as_str().filter(|_| path == PACKING);
            let given = match file.filter(|file| *file != TAKE_AWAY) {
                // A path of --set is from the working directory.
                Some(file) => {
                    let file = input.folder(offset).join(file);
                    Value::from(file.display().to_string()).to_string()
                }
                None => text.clone(),
            };
            [text, given]
        };
        let values: Vec<[String; 2]> = list.iter().map(both).collect();
        let mut seen = HashMap::new();
        for [text, _] in &values {
            let Some(first) = seen.insert(in_units_of(key, text), text) else {
                continue;
            };
            let what = if first == text {
                format!("has {} twice", shortened(text))
            } else {
                let (first, again) = (shortened(first), shortened(text));
                format!("has {first} twice, as {again}, too; give each value once")
            };
            return refuse(offset, &path, &what);
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

/// A value of a key in the units of the key, the same text for all its spellings: `1e3`, `1000.0`
/// and `"1 kPa"`. What is no value of the key, which is refused later, stays as it is.
fn in_units_of(key: &Key, text: &str) -> String {
    let line = Source::new("", format!("{} = {text}", key.path));
    let value = || {
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
        Some(
            match KeyValue::read(key.values, table.remove(key.name())?) {
                Ok(value) => format!("{value:?}"),
                Err(_) => return None,
            },
        )
    };
    value().unwrap_or_else(|| text.to_string())
}

/// What to say of a sweep that is run as if it were one scene.
pub(super) fn not_one_run(source: &Source) -> Result<String> {
    let runs = members(source)?.map_or(0, |members| members.len());
    Ok(format!(
        "makes {runs} runs of this scene; --sweep list shows them, --sweep N runs the N-th of them, --sweep all one after the other"
    ))
}

/// Keys with dots may be written in quotes or, as TOML has it, as tables in tables.
fn leaves<'a, 'b>(
    table: &'b DeTable<'a>,
    above: &str,
    found: &mut Vec<(usize, String, &'b Spanned<DeValue<'a>>)>,
) {
    for (key, value) in table {
        let path = match above {
            "" => key.get_ref().to_string(),
            above => format!("{above}.{}", key.get_ref()),
        };
        match value.get_ref() {
            DeValue::Table(inner) => leaves(inner, &path, found),
            _ => found.push((key.span().start, path, value)),
        }
    }
}

fn product(axes: &[Axis]) -> Vec<Member> {
    let short = |axis: &Axis| axis.path.rsplit('.').next().unwrap_or_default().to_string();
    let name = |axis: &Axis| match axes.iter().filter(|of| short(of) == short(axis)).count() {
        1 => short(axis),
        _ => axis.path.replace('.', "-"),
    };
    let mut members = vec![Member::default()];
    for axis in axes {
        let name = name(axis);
        let longer = |member: &Member, [text, value]: &[String; 2]| {
            let own = format!("{name}-{}", in_a_path(text));
            let mut member = member.clone();
            member.set.push(format!("{}={value}", axis.path));
            member.places.push(axis.place.clone());
            member.name = match &member.name[..] {
                "" => own,
                before => format!("{before}_{own}"),
            };
            member
        };
        let each = |member| axis.values.iter().map(move |value| longer(member, value));
        members = members.iter().flat_map(each).collect();
    }
    members
}

/// A value as part of the name of a folder.
fn in_a_path(value: &str) -> String {
    let plain = |c: char| match c {
        c if c.is_alphanumeric() || "+-.".contains(c) => c,
        _ => '-',
    };
    value.trim_matches(['"', '\'']).chars().map(plain).collect()
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
