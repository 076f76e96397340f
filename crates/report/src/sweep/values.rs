//! Values of keys of the scenes: their order, their text, and their places on an axis.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use toml::Value;

use crate::curves::padded;
use crate::ticks::{self, Tick};
use gshear_analysis::moments::extent;

/// From this ratio of the greatest to the least value of a key on, its axis is logarithmic.
const WIDE: f64 = 10.0;

/// The values of a scene by their keys; its title and author are none of them.
pub fn values_of(scene: &str) -> BTreeMap<String, Value> {
    let mut values = BTreeMap::new();
    for (name, value) in scene.parse::<toml::Table>().unwrap_or_default() {
        match value {
            Value::Table(inner) => {
                let inner = inner.into_iter();
                values.extend(inner.map(|(key, value)| (format!("{name}.{key}"), value)));
            }
            _ if name == "title" || name == "author" => {}
            value => _ = values.insert(name, value),
        }
    }
    values
}

/// A value as text; empty without one.
pub fn text(value: Option<&Value>) -> String {
    match value {
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
        None => String::new(),
    }
}

/// A value in pages and figures.
pub fn shown(value: Option<&Value>) -> String {
    match number(value) {
        Some(x) if x != 0.0 && !(1e-3..1e6).contains(&x.abs()) => format!("{x:e}"),
        _ => text(value),
    }
}

pub fn number(value: Option<&Value>) -> Option<f64> {
    match value {
        Some(Value::Integer(value)) => Some(*value as f64),
        Some(Value::Float(value)) => Some(*value),
        _ => None,
    }
}

/// Numbers by their size, anything else by its text.
pub fn order(a: Option<&Value>, b: Option<&Value>) -> Ordering {
    match (number(a), number(b)) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        _ => text(a).cmp(&text(b)),
    }
}

/// Places of the values of a key on an axis.
pub struct Places<'a> {
    values: Vec<Option<&'a Value>>,
    /// `None` if some are no numbers, which lie side by side; whether the axis is logarithmic.
    pub numbers: Option<bool>,
}

impl<'a> Places<'a> {
    pub fn of(mut values: Vec<Option<&'a Value>>) -> Self {
        values.sort_by(|a, b| order(*a, *b));
        values.dedup();
        let numbers: Option<Vec<f64>> = values.iter().map(|value| number(*value)).collect();
        let is_logarithmic = numbers.map(|numbers| {
            let [low, high] = extent(numbers);
            low > 0.0 && high >= WIDE * low
        });
        Self {
            values,
            numbers: is_logarithmic,
        }
    }

    pub fn at(&self, value: Option<&Value>) -> f64 {
        let number = number(value).unwrap_or(f64::NAN);
        match self.numbers {
            Some(true) => number.log10(),
            Some(false) => number,
            None => {
                let place = self.values.iter().position(|known| *known == value);
                place.unwrap_or(0) as f64
            }
        }
    }

    pub fn range(&self) -> [f64; 2] {
        padded(self.values.iter().map(|value| self.at(*value)), 0.08)
    }

    pub fn ticks(&self, range: [f64; 2]) -> Vec<Tick> {
        match self.numbers {
            Some(false) => ticks::scientific(range, 8),
            // Few values are their own ticks.
            Some(true) if self.values.len() > 8 => ticks::decades(range[0], range[1], 8),
            _ => {
                let ticks = self.values.iter().map(|value| {
                    let short = shown(*value).chars().take(24).collect();
                    (self.at(*value), short)
                });
                ticks.collect()
            }
        }
    }
}
