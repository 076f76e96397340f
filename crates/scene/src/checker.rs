//! Collects what is wrong with single values, so that the first problem in the order of the file is the one told.

use std::path::PathBuf;

use toml::Spanned;

use super::raw::{Flag, Number, Text, Whole, show};
use super::source::Input;
use gshear_dem::failure::Failure;
pub(super) use gshear_dem::laws::keys::Bounds;

/// A key that may have been given, with its path and its place.
pub(super) struct Key<T> {
    pub path: &'static str,
    pub given: Option<(usize, T)>,
}

impl<T> Key<T> {
    pub fn new(path: &'static str, raw: Option<Spanned<T>>) -> Self {
        Key {
            path,
            given: raw.map(|s| (s.span().start, s.into_inner())),
        }
    }

    pub fn offset(&self) -> Option<usize> {
        self.given.as_ref().map(|(offset, _)| *offset)
    }

    /// Name without the table.
    pub fn name(&self) -> &'static str {
        self.path.rsplit('.').next().unwrap_or(self.path)
    }

    fn table(&self) -> &'static str {
        self.path.split('.').next().unwrap_or(self.path)
    }
}

/// One pass over a configuration.
pub(super) struct Checker<'a> {
    input: Input<'a>,
    /// Where each table that was given begins.
    tables: Vec<(String, usize)>,
    problems: Vec<(usize, String)>,
}

impl<'a> Checker<'a> {
    pub fn new(input: Input<'a>, tables: Vec<(String, usize)>) -> Self {
        Checker {
            input,
            tables,
            problems: Vec::new(),
        }
    }

    /// `line 12` or `--set a.b=c`.
    pub fn mention(&self, offset: usize) -> String {
        self.input.mention(offset)
    }

    /// A path as of the text: from the folder of the configuration, or from here where it came with `--set`.
    pub fn resolve(&self, offset: usize, path: &str) -> PathBuf {
        match self.input.override_at(offset) {
            Some(_) => path.into(),
            None => self.input.source.folder().join(path),
        }
    }

    /// What is wrong with what a value stands for.
    pub fn failure(&self, offset: usize, path: &str, what: &str) -> Failure {
        self.input.failure(offset, path, what)
    }

    /// Notes a problem of a key that was given.
    pub fn refuse<T>(&mut self, key: &Key<T>, what: &str) {
        let offset = key.offset().unwrap_or(0);
        self.problems
            .push((offset, self.input.message(offset, key.path, what)));
    }

    /// Notes a problem that several keys cause, at the one set on the command line, else at the first that was given.
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
        let problem = match self.tables.iter().find(|(name, _)| name == table) {
            Some((_, at)) => (
                *at,
                format!("{}: [{table}] lacks {what}", self.input.place(*at)),
            ),
            None => {
                let name = self.input.source.name();
                (
                    usize::MAX,
                    format!("{name}: [{table}] is missing; it must have {what}"),
                )
            }
        };
        self.problems.push(problem);
    }

    /// A number within bounds, if given.
    pub fn number(&mut self, key: &Key<Number>, bounds: &Bounds) -> Option<f64> {
        let Number(x) = key.given.as_ref()?.1;
        if !x.is_finite() {
            self.refuse(key, &format!("must be a finite number, found {}", show(x)));
        } else if !(bounds.hold)(x) {
            self.refuse(key, &format!("{}, found {}", bounds.words, show(x)));
        }
        Some(x)
    }

    /// A number that must be given; `what` says what it is, with an example.
    pub fn required(&mut self, key: &Key<Number>, bounds: &Bounds, what: &str) -> f64 {
        self.number(key, bounds).unwrap_or_else(|| {
            self.lacks(key.table(), &format!("{}: {what}", key.name()));
            f64::NAN
        })
    }

    /// An integer in `from ..= to`, if given.
    pub fn whole(&mut self, key: &Key<Whole>, from: i64, to: i64) -> Option<i64> {
        let Whole(n) = key.given.as_ref()?.1;
        if n < from || n > to {
            let words = match to {
                i64::MAX => format!("must be {from} or greater, found {n}"),
                _ => format!("must lie in {from} … {to}, found {n}"),
            };
            self.refuse(key, &words);
        }
        Some(n)
    }

    /// An integer that must be given.
    pub fn required_whole(&mut self, key: &Key<Whole>, from: i64, to: i64, what: &str) -> i64 {
        self.whole(key, from, to).unwrap_or_else(|| {
            self.lacks(key.table(), &format!("{}: {what}", key.name()));
            from
        })
    }

    pub fn flag(&self, key: &Key<Flag>) -> Option<bool> {
        key.given.as_ref().map(|(_, Flag(b))| *b)
    }

    pub fn text(&self, key: &Key<Text>) -> Option<String> {
        key.given.as_ref().map(|(_, Text(s))| s.clone())
    }

    /// Ways to give one quantity: exactly one must be there. Returns which; `what` names the ways with their units.
    pub fn exactly_one(&mut self, keys: &[&Key<Number>], what: &str) -> usize {
        let mut given: Vec<(usize, usize)> = (0..keys.len())
            .filter_map(|k| keys[k].offset().map(|at| (at, k)))
            .collect();
        given.sort_unstable();
        if let [(first_at, first), (_, second), ..] = given[..] {
            let names: Vec<&str> = keys.iter().map(|k| k.name()).collect();
            let mut text = format!(
                "contradicts {} ({}); give exactly one of {}",
                keys[first].path,
                self.input.mention(first_at),
                names.join(", ")
            );
            let second_at = keys[second].offset().unwrap_or(0);
            if self.input.override_at(second_at).is_some() {
                text += &format!("; --set {}=none takes that one away", keys[first].path);
            }
            self.refuse(keys[second], &text);
        }
        match given.first() {
            Some((_, k)) => *k,
            None => {
                self.lacks(keys[0].table(), what);
                0
            }
        }
    }

    /// Ways to give one quantity, of which none may be there.
    pub fn at_most_one(&mut self, keys: &[&Key<Number>]) {
        if keys.iter().any(|key| key.given.is_some()) {
            self.exactly_one(keys, "");
        }
    }

    /// A key that means nothing here.
    pub fn useless<T>(&mut self, key: &Key<T>, why: &str) {
        if let Some(at) = key.offset() {
            let mut what = format!("{why}; leave it out");
            if self.input.override_at(at).is_some() {
                what += &format!("; --set {}=none takes it away", key.path);
            }
            self.refuse(key, &what);
        }
    }

    /// A problem of the whole configuration.
    pub fn out_of_range(&self, what: &str) -> Failure {
        Failure::input(format!("{}: {what}", self.input.source.name()))
    }

    /// Tells the first problem, if there is any.
    pub fn settle(&mut self) -> Result<(), Failure> {
        self.problems.sort_by_key(|(at, _)| *at);
        match self.problems.first() {
            Some((_, text)) => Err(Failure::input(text.clone())),
            None => Ok(()),
        }
    }
}
