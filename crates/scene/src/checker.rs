//! Collects the problems of a configuration; the first in the order of the file is reported. Keeps
//! the values, and fills in those that were not given.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::str::FromStr;

use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::laws::keys::{Key, KeyReader, Values};

use crate::source::Input;
use crate::value::{Value, refusal};
use crate::words::{list, quoted_list};

/// The values that were given, by their paths, with their places.
pub(crate) type Given = BTreeMap<&'static str, (usize, Value)>;

/// One pass over a configuration.
pub(crate) struct Checker<'a> {
    input: Input<'a>,
    /// Where each table that was given begins, and each table of a list.
    tables: BTreeMap<String, usize>,
    given: Given,
    /// Defaults and values that follow from others.
    filled: BTreeMap<&'static str, Value>,
    /// Keys that do not apply.
    omitted: BTreeSet<&'static str>,
    problems: Vec<(usize, String)>,
    /// Keys that were given and do not apply, which are reported together.
    useless: Vec<UselessKey>,
    /// Disks, until it is known that the scene has spheres.
    pub(crate) dimension: Dimensions,
}

/// A key that was given and does not apply.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct UselessKey {
    at: usize,
    path: &'static str,
}

impl<'a> Checker<'a> {
    pub(crate) fn new(input: Input<'a>, tables: BTreeMap<String, usize>, given: Given) -> Self {
        Checker {
            input,
            tables,
            given,
            filled: BTreeMap::new(),
            omitted: BTreeSet::new(),
            problems: Vec::new(),
            useless: Vec::new(),
            dimension: Dimensions::Two,
        }
    }

    /// The value, if given.
    pub(crate) fn value(&self, key: &Key) -> Option<&Value> {
        self.given.get(key.path).map(|(_, value)| value)
    }

    pub(crate) fn is_given(&self, key: &Key) -> bool {
        self.given.contains_key(key.path)
    }

    pub(crate) fn offset(&self, key: &Key) -> Option<usize> {
        self.given.get(key.path).map(|(offset, _)| *offset)
    }

    /// Gives a key the value that `scene.toml` is to have.
    pub(crate) fn fill(&mut self, key: &Key, value: impl Into<Value>) {
        self.filled.insert(key.path, value.into());
    }

    /// Keeps keys that do not apply out of `scene.toml`.
    pub(crate) fn omit(&mut self, keys: &[&Key]) {
        self.omitted.extend(keys.iter().map(|key| key.path));
    }

    /// The value that `scene.toml` has.
    pub(crate) fn written(&self, key: &Key) -> Option<&Value> {
        if self.omitted.contains(key.path) {
            return None;
        }
        self.filled.get(key.path).or_else(|| self.value(key))
    }

    /// `line 12` or `--set a.b=c`, where a key is given.
    pub(crate) fn mention(&self, key: &Key, otherwise: &str) -> String {
        match self.offset(key) {
            Some(at) => self.input.mention(at),
            None => otherwise.into(),
        }
    }

    /// The path that a key's value names, relative to the folder of the file that gives it; one
    /// given by `--set` is relative to the working directory.
    pub(crate) fn resolve(&self, key: &Key, path: &str) -> PathBuf {
        let offset = self.offset(key).unwrap_or(0);
        match self.input.override_at(offset) {
            Some(_) => path.into(),
            None => self.input.folder(offset).join(path),
        }
    }

    /// Notes a problem of the n-th table of a list above all tables, from 0.
    pub(crate) fn refuse_entry(&mut self, list: &Key, n: usize, what: &str) {
        let of_list = self.offset(list).unwrap_or(0);
        let own = self.tables.get(&format!("{} {}", list.path, n + 1));
        let at = match own {
            Some(at) if self.input.override_at(of_list).is_none() => *at,
            _ => of_list,
        };
        let message = self.input.message(at, list.path, what);
        self.problems.push((at, message));
    }

    /// A problem of what a key's value names, such as a file.
    pub(crate) fn failure(&self, key: &Key, what: &str) -> Failure {
        let offset = self.offset(key).unwrap_or(0);
        self.input.failure(offset, key.path, what)
    }

    /// Notes a problem that several keys cause: at the one given by `--set`, otherwise at the first
    /// that was given.
    pub(crate) fn refuse_among(&mut self, keys: &[&Key], what: &str) {
        let given: Vec<(&str, usize)> = keys
            .iter()
            .filter_map(|key| Some((key.path, self.offset(key)?)))
            .collect();
        let by_set = given
            .iter()
            .find(|(_, at)| self.input.override_at(*at).is_some());
        let (path, at) = *by_set.or(given.first()).unwrap_or(&("", 0));
        self.problems.push((at, self.input.message(at, path, what)));
    }

    /// Notes that a table lacks what it must have.
    pub(crate) fn lacks(&mut self, table: &str, what: &str) {
        let problem = match self.tables.get(table) {
            Some(&at) => {
                let place = self.input.place(at);
                (at, format!("{place}: [{table}] lacks {what}"))
            }
            None => {
                let name = self.input.source.name();
                let what = format!("{name}: [{table}] is missing; it must have {what}");
                (usize::MAX, what)
            }
        };
        self.problems.push(problem);
    }

    /// The default that a key declares, which is filled in.
    fn default<T: FromStr + Copy + Into<Value>>(&mut self, key: &Key) -> T {
        let Ok(value) = key.default.parse::<T>() else {
            unreachable!("{} has a default of its kind", key.path)
        };
        self.fill(key, value);
        value
    }

    /// A number that is given, without a check.
    pub(crate) fn given_number(&self, key: &Key) -> Option<f64> {
        match self.value(key) {
            Some(Value::Number(x)) if !x.is_nan() => Some(*x),
            _ => None,
        }
    }

    /// A number that is given and was checked; NaN if it is not.
    pub(crate) fn known(&self, key: &Key) -> f64 {
        self.given_number(key).unwrap_or(f64::NAN)
    }

    /// A number, or the default that its key declares.
    pub(crate) fn number_or_default(&mut self, key: &Key) -> f64 {
        self.number(key).unwrap_or_else(|| self.default(key))
    }

    /// Numbers that must be given, one or more; `what`: each of them.
    pub(crate) fn required_list(&mut self, key: &Key, what: &str) -> Vec<f64> {
        let (Some(Value::Numbers(given)), Values::Numbers(bounds)) = (self.value(key), key.values)
        else {
            self.lacks(key.table(), &key.lacking());
            return Vec::new();
        };
        let given = given.clone();
        let is_refused = given.iter().any(|x| refusal(bounds, *x).is_some());
        if given.is_empty() || is_refused {
            let each = bounds.words();
            let what = format!("must hold one {what} or more, each of which {each}");
            self.refuse(key, &what);
        }
        given
    }

    /// An integer, if given.
    pub(crate) fn whole(&mut self, key: &Key) -> Option<i64> {
        let given = self.value(key)?;
        let &Value::Whole(n) = given else { return None };
        if let Some(what) = given.out_of_bounds(key) {
            self.refuse(key, &what);
        }
        Some(n)
    }

    /// A number of things, or the default that its key declares.
    pub(crate) fn count(&mut self, key: &Key) -> u64 {
        let given = self.whole(key).map(i64::unsigned_abs);
        given.unwrap_or_else(|| self.default(key))
    }

    /// A number of things that must be given; 0 if it is not.
    pub(crate) fn required_count(&mut self, key: &Key) -> u64 {
        let n = self.whole(key).unwrap_or_else(|| {
            self.lacks(key.table(), &key.lacking());
            0
        });
        n.unsigned_abs()
    }

    /// True or false, if given.
    pub(crate) fn flag(&self, key: &Key) -> Option<bool> {
        match self.value(key)? {
            Value::Flag(b) => Some(*b),
            _ => unreachable!("{} is true or false", key.path),
        }
    }

    /// True or false, or the default that its key declares.
    pub(crate) fn flag_or_default(&mut self, key: &Key) -> bool {
        self.flag(key).unwrap_or_else(|| self.default(key))
    }

    /// A string, if given.
    pub(crate) fn text(&self, key: &Key) -> Option<&str> {
        match self.value(key)? {
            Value::Text(s) => Some(s),
            _ => unreachable!("{} is a string", key.path),
        }
    }

    /// One of the names that a key declares, or its default; `None` if it is not given and has no
    /// default, or has another value.
    pub(crate) fn choice(&mut self, key: &Key) -> Option<&'static str> {
        let Some(given) = self.text(key) else {
            if key.default.is_empty() {
                return None;
            }
            self.fill(key, key.default);
            return Some(key.default);
        };
        let names = match key.values {
            Values::Text(names) => names.to_vec(),
            Values::Word(names) => names(),
            _ => unreachable!("{} is a string", key.path),
        };
        let known = names.iter().find(|name| **name == given);
        if known.is_none() {
            let what = format!("must be {}, found {given:?}", quoted_list(&names, "or"));
            self.refuse(key, &what);
        }
        known.copied()
    }

    /// What the [`choice`](Self::choice) names.
    pub(crate) fn named<T: Copy>(&mut self, key: &Key, names: &[(&str, T)]) -> Option<T> {
        let chosen = self.choice(key)?;
        let known = names.iter().find(|(name, _)| *name == chosen);
        known.map(|(_, value)| *value)
    }

    /// Ways to give one quantity, of which none may be there.
    pub(crate) fn at_most_one(&mut self, keys: &[&Key]) {
        if keys.iter().any(|key| self.is_given(key)) {
            self.exactly_one(keys, "");
        }
    }

    /// Refuses keys that do not apply, and omits their defaults; `why` says when they do.
    pub(crate) fn all_useless(&mut self, keys: &[&Key], why: &str) {
        for key in keys {
            self.useless(key, why);
        }
    }

    /// Refuses a key that does not apply; `what` says why and what to do. Adds how to take it away
    /// where leaving it out is not enough.
    pub(crate) fn refuse_useless(&mut self, key: &Key, what: &str) {
        self.omit(&[key]);
        let Some(at) = self.offset(key) else { return };
        let path = key.path;
        let input = &self.input;
        let more = if input.is_extended(at) {
            let name = input.source.name();
            format!("; {path} = \"none\" in {name} takes it away")
        } else if !input.overrides.is_empty() {
            format!("; --set {path}=none takes it away")
        } else {
            String::new()
        };
        self.useless.push(UselessKey { at, path });
        self.refuse(key, &format!("{what}{more}"));
    }

    /// A problem of the whole configuration.
    pub(crate) fn out_of_range(&self, what: &str) -> Failure {
        Failure::input(format!("{}: {what}", self.input.source.name()))
    }

    /// Notes a problem of a key, and returns the first problem.
    pub(crate) fn refused(&mut self, key: &Key, what: &str) -> Failure {
        self.refuse(key, what);
        self.first_problem().expect("at least that one")
    }

    /// Fails with the first problem, if there is any.
    pub(crate) fn settle(&mut self) -> Result<()> {
        self.first_problem().map_or(Ok(()), Err)
    }

    /// The first problem; if it is a key that does not apply, all such keys.
    fn first_problem(&mut self) -> Option<Failure> {
        self.problems.sort_by_key(|(at, _)| *at);
        self.useless.sort_unstable();
        let (at, text) = self.problems.first()?;
        let mut text = text.clone();
        if self.useless.iter().any(|key| key.at == *at) {
            let others: Vec<String> = self
                .useless
                .iter()
                .filter(|key| key.at != *at)
                .map(|key| self.mention_useless(key))
                .collect();
            if !others.is_empty() {
                text += &format!("; likewise {}", list(&others, "and"));
            }
            let in_base = self
                .useless
                .iter()
                .find(|key| self.input.is_extended(key.at));
            if let Some(key) = in_base
                && !self.input.is_extended(*at)
            {
                let (path, name) = (key.path, self.input.source.name());
                text += &format!("; {path} = \"none\" in {name} takes such a key of a base away");
            }
        }
        Some(Failure::input(text))
    }

    /// Key and place of a key that does not apply; of a `--set` the place has the key.
    fn mention_useless(&self, key: &UselessKey) -> String {
        let place = self.input.place(key.at);
        match self.input.override_at(key.at) {
            Some(_) => place,
            None => format!("{} ({place})", key.path),
        }
    }
}

impl KeyReader for Checker<'_> {
    fn number(&mut self, key: &Key) -> Option<f64> {
        let (Some(&Value::Number(x)), Values::Number(bounds)) = (self.value(key), key.values)
        else {
            return None;
        };
        if let Some(what) = refusal(bounds, x) {
            self.refuse(key, &what);
        }
        Some(x)
    }

    fn choice(&mut self, key: &Key) -> Option<&'static str> {
        Checker::choice(self, key)
    }

    fn required(&mut self, key: &Key) -> f64 {
        self.number(key).unwrap_or_else(|| {
            self.lacks(key.table(), &key.lacking());
            f64::NAN
        })
    }

    /// `what` names the ways with their units.
    fn exactly_one(&mut self, keys: &[&Key], what: &str) -> usize {
        let mut given: Vec<(usize, usize)> = (0..keys.len())
            .filter_map(|k| self.offset(keys[k]).map(|at| (at, k)))
            .collect();
        given.sort_unstable();
        if let [(first_at, first), (second_at, second), ..] = given[..] {
            let names: Vec<&str> = keys.iter().map(|k| k.name()).collect();
            let mut text = format!(
                "contradicts {} ({}); give exactly one of {}",
                keys[first].path,
                self.input.mention_beside(first_at, second_at),
                names.join(", ")
            );
            if self.input.override_at(second_at).is_some() {
                text += &format!("; --set {}=none takes that one away", keys[first].path);
            } else if self.input.is_extended(second_at)
                && !self.input.are_beside(first_at, second_at)
            {
                let (path, name) = (keys[second].path, self.input.source.name());
                text += &format!("; {path} = \"none\" in {name} takes this one away");
            }
            self.refuse(keys[second], &text);
        }
        if let Some((_, first)) = given.first() {
            *first
        } else {
            self.lacks(keys[0].table(), what);
            0
        }
    }

    /// Omits the default of the key, too; `why` says when it applies.
    fn useless(&mut self, key: &Key, why: &str) {
        self.refuse_useless(key, &format!("{why}; leave it out"));
    }

    fn refuse(&mut self, key: &Key, what: &str) {
        let offset = self.offset(key).unwrap_or(0);
        let message = self.input.message(offset, key.path, what);
        self.problems.push((offset, message));
    }
}
