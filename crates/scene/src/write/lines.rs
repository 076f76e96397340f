//! Lines of TOML.

use crate::key::Key;
use crate::kind::{Flag, Kind, Number, Numbers, Text, Whole};
use crate::raw::KeyTable;
use crate::words::show;

/// Lines of TOML.
pub(super) struct Lines(pub String);

impl Lines {
    pub fn line(&mut self, text: &str) {
        self.0.push_str(text);
        self.0.push('\n');
    }

    /// Begins a table. Returns its keys.
    pub fn table<T: KeyTable>(&mut self) -> T {
        self.line(&format!("\n[{}]", T::NAME));
        T::default()
    }

    /// Gives a key a value, written as TOML.
    pub fn give<T: Kind>(&mut self, key: &Key<T>, value: &str) {
        self.line(&format!("{} = {value}", key.declared.name()));
    }

    pub fn number(&mut self, key: &Key<Number>, x: f64) {
        self.give(key, &show(x));
    }

    pub fn whole(&mut self, key: &Key<Whole>, n: u64) {
        self.give(key, &n.to_string());
    }

    pub fn flag(&mut self, key: &Key<Flag>, b: bool) {
        self.give(key, &b.to_string());
    }

    pub fn text(&mut self, key: &Key<Text>, s: &str) {
        self.give(key, &toml::Value::String(s.into()).to_string());
    }

    pub fn numbers(&mut self, key: &Key<Numbers>, list: &[String]) {
        self.give(key, &format!("[{}]", list.join(", ")));
    }

    /// A comment on what follows from the keys.
    pub fn derived(&mut self, symbol: &str, x: f64, unit: &str) {
        self.line(format!("# {symbol} = {x:?} {unit}").trim_end());
    }
}
