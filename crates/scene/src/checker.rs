//! Collects the problems of a configuration; the first in the order of the file is reported.

use std::path::PathBuf;

use super::key::Key;
use super::kind::{Flag, Kind, Number, Text, Whole};
use super::source::Input;
use super::words::{list, show};
use gshear_dem::failure::Failure;

/// One pass over a configuration.
pub(super) struct Checker<'a> {
    input: Input<'a>,
    /// Where each table that was given begins.
    tables: Vec<(String, usize)>,
    problems: Vec<(usize, String)>,
    /// Places and paths of the keys that do not apply, which are reported together.
    useless: Vec<(usize, &'static str)>,
}

impl<'a> Checker<'a> {
    pub fn new(input: Input<'a>, tables: Vec<(String, usize)>) -> Self {
        Checker {
            input,
            tables,
            problems: Vec::new(),
            useless: Vec::new(),
        }
    }

    /// `line 12` or `--set a.b=c`.
    pub fn mention(&self, offset: usize) -> String {
        self.input.mention(offset)
    }

    /// The path that a value names, relative to the folder of the file that gives it; one given by
    /// `--set` is relative to the working directory.
    pub fn resolve(&self, offset: usize, path: &str) -> PathBuf {
        match self.input.override_at(offset) {
            Some(_) => path.into(),
            None => self.input.folder(offset).join(path),
        }
    }

    /// A problem of what a value names, such as a file.
    pub fn failure(&self, offset: usize, path: &str, what: &str) -> Failure {
        self.input.failure(offset, path, what)
    }

    /// Notes a problem of a key that was given.
    pub fn refuse<T: Kind>(&mut self, key: &Key<T>, what: &str) {
        let offset = key.offset().unwrap_or(0);
        self.problems
            .push((offset, self.input.message(offset, key.declared.path, what)));
    }

    /// Notes a problem that several keys cause: at the one given by `--set`, otherwise at the first
    /// that was given.
    pub fn refuse_among(&mut self, places: &[(&str, Option<usize>)], what: &str) {
        let given = || {
            places
                .iter()
                .filter_map(|(path, at)| at.map(|at| (*path, at)))
        };
        let place = given()
            .find(|(_, at)| self.input.override_at(*at).is_some())
            .or_else(|| given().next());
        let (path, at) = place.unwrap_or(("", 0));
        self.problems.push((at, self.input.message(at, path, what)));
    }

    /// Notes that a table lacks what it must have.
    pub fn lacks(&mut self, table: &str, what: &str) {
        let problem = if let Some((_, at)) = self.tables.iter().find(|(name, _)| name == table) {
            (
                *at,
                format!("{}: [{table}] lacks {what}", self.input.place(*at)),
            )
        } else {
            let name = self.input.source.name();
            (
                usize::MAX,
                format!("{name}: [{table}] is missing; it must have {what}"),
            )
        };
        self.problems.push(problem);
    }

    /// A number, if given.
    pub fn number(&mut self, key: &Key<Number>) -> Option<f64> {
        let Number(x) = *key.value()?;
        let bounds = key.declared.range;
        if !x.is_finite() {
            self.refuse(key, &format!("must be a finite number, found {}", show(x)));
        } else if !bounds.hold(x) {
            self.refuse(key, &format!("{}, found {}", bounds.words(), show(x)));
        }
        Some(x)
    }

    /// A number, or the default that its key declares.
    pub fn number_or_default(&mut self, key: &Key<Number>) -> f64 {
        self.number(key)
            .or(key.declared.default)
            .expect("a key with a default")
    }

    /// A number that must be given; NaN if it is not.
    pub fn required(&mut self, key: &Key<Number>) -> f64 {
        self.number(key).unwrap_or_else(|| {
            self.lacks(key.declared.table(), &key.declared.lacking());
            f64::NAN
        })
    }

    /// An integer, if given.
    pub fn whole(&mut self, key: &Key<Whole>) -> Option<i64> {
        let Whole(n) = *key.value()?;
        let range = key.declared.range;
        if n < range.from || n > range.to {
            self.refuse(key, &format!("{}, found {n}", range.words()));
        }
        Some(n)
    }

    /// A number of things, or the default that its key declares.
    pub fn count(&mut self, key: &Key<Whole>) -> u64 {
        self.whole(key)
            .or(key.declared.default)
            .expect("a key with a default")
            .unsigned_abs()
    }

    /// A number of things that must be given.
    pub fn required_count(&mut self, key: &Key<Whole>) -> u64 {
        let n = self.whole(key).unwrap_or_else(|| {
            self.lacks(key.declared.table(), &key.declared.lacking());
            key.declared.range.from
        });
        n.unsigned_abs()
    }

    /// True or false, if given.
    pub fn flag(&self, key: &Key<Flag>) -> Option<bool> {
        key.value().map(|Flag(b)| *b)
    }

    /// True or false, or the default that its key declares.
    pub fn flag_or_default(&self, key: &Key<Flag>) -> bool {
        self.flag(key)
            .or(key.declared.default)
            .expect("a key with a default")
    }

    /// A string, if given.
    pub fn text(&self, key: &Key<Text>) -> Option<String> {
        key.value().map(|Text(s)| s.clone())
    }

    /// One of the names that a key declares; `None` if it is not given or has another value.
    pub fn choice(&mut self, key: &Key<Text>) -> Option<&'static str> {
        let Text(given) = key.value()?;
        let names = key.declared.range;
        let known = names.iter().find(|name| *name == given);
        if known.is_none() {
            let names: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
            let what = format!("must be {}, found {given:?}", list(&names, "or"));
            self.refuse(key, &what);
        }
        known.copied()
    }

    /// One of the names that a key declares, `default` if it is not given; `None` if it has another
    /// value.
    pub fn choice_or(&mut self, key: &Key<Text>, default: &'static str) -> Option<&'static str> {
        match key.is_given() {
            true => self.choice(key),
            false => Some(default),
        }
    }

    /// [`choice_or`](Self::choice_or), with the default that the key declares.
    pub fn choice_or_default(&mut self, key: &Key<Text>) -> Option<&'static str> {
        let default = key.declared.default.expect("a key with a default");
        self.choice_or(key, default)
    }

    /// Ways to give one quantity: exactly one must be there. Returns which; `what` names the ways
    /// with their units.
    pub fn exactly_one(&mut self, keys: &[&Key<Number>], what: &str) -> usize {
        let mut given: Vec<(usize, usize)> = (0..keys.len())
            .filter_map(|k| keys[k].offset().map(|at| (at, k)))
            .collect();
        given.sort_unstable();
        if let [(first_at, first), (_, second), ..] = given[..] {
            let names: Vec<&str> = keys.iter().map(|k| k.declared.name()).collect();
            let second_at = keys[second].offset().unwrap_or(0);
            let mut text = format!(
                "contradicts {} ({}); give exactly one of {}",
                keys[first].declared.path,
                self.input.mention_beside(first_at, second_at),
                names.join(", ")
            );
            if self.input.override_at(second_at).is_some() {
                text += &format!(
                    "; --set {}=none takes that one away",
                    keys[first].declared.path
                );
            } else if self.input.is_extended(second_at)
                && !self.input.are_beside(first_at, second_at)
            {
                text += &format!(
                    "; {} = \"none\" in {} takes this one away",
                    keys[second].declared.path,
                    self.input.source.name()
                );
            }
            self.refuse(keys[second], &text);
        }
        if let Some((_, k)) = given.first() {
            *k
        } else {
            self.lacks(keys[0].declared.table(), what);
            0
        }
    }

    /// Ways to give one quantity, of which none may be there.
    pub fn at_most_one(&mut self, keys: &[&Key<Number>]) {
        if keys.iter().any(|key| key.is_given()) {
            self.exactly_one(keys, "");
        }
    }

    /// Refuses a key that does not apply; `why` says when it does.
    pub fn useless<T: Kind>(&mut self, key: &Key<T>, why: &str) {
        self.refuse_useless(key, &format!("{why}; leave it out"));
    }

    /// Refuses a key that does not apply; `what` says why and what to do. Adds how to take it away
    /// where leaving it out is not enough.
    pub fn refuse_useless<T: Kind>(&mut self, key: &Key<T>, what: &str) {
        let Some(at) = key.offset() else { return };
        let path = key.declared.path;
        let input = &self.input;
        let more = if input.is_extended(at) {
            let name = input.source.name();
            format!("; {path} = \"none\" in {name} takes it away")
        } else if !input.overrides.is_empty() {
            format!("; --set {path}=none takes it away")
        } else {
            String::new()
        };
        self.useless.push((at, path));
        self.refuse(key, &format!("{what}{more}"));
    }

    /// A problem of the whole configuration.
    pub fn out_of_range(&self, what: &str) -> Failure {
        Failure::input(format!("{}: {what}", self.input.source.name()))
    }

    /// Fails with the first problem, if there is any; if it is a key that does not apply, with all such
    /// keys.
    pub fn settle(&mut self) -> Result<(), Failure> {
        self.problems.sort_by_key(|(at, _)| *at);
        self.useless.sort_unstable();
        let Some((at, text)) = self.problems.first() else {
            return Ok(());
        };
        let mut text = text.clone();
        if self.useless.iter().any(|(of, _)| of == at) {
            let others = self.useless.iter().filter(|(of, _)| of != at);
            let others: Vec<String> = others
                .map(|(at, path)| match self.input.override_at(*at) {
                    Some(_) => self.input.place(*at),
                    None => format!("{path} ({})", self.input.place(*at)),
                })
                .collect();
            if !others.is_empty() {
                text += &format!("; likewise {}", list(&others, "and"));
            }
            let of_base = |(at, _): &&(usize, &str)| self.input.is_extended(*at);
            if let Some((_, path)) = self.useless.iter().find(of_base)
                && !self.input.is_extended(*at)
            {
                let name = self.input.source.name();
                text += &format!("; {path} = \"none\" in {name} takes such a key of a base away");
            }
        }
        Err(Failure::input(text))
    }
}
