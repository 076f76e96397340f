//! The values of a part of a protocol, and which of them go together.

use std::ops::Bound;

use gshear_dem::laws::keys::{Bounds, Key, Values};

use crate::table::Table;
use crate::value::refusal;
use crate::words::show;

/// Natural strains beyond which a part is refused: e² times as long is no packing any more.
pub(crate) const STRAIN: Bounds = Bounds {
    from: Bound::Included(-2.0),
    to: Bound::Included(2.0),
};

/// Which keys of a part go together.
pub(crate) struct PartRules {
    /// The keys.
    pub table: Table,
    /// Keys that need another one: one of these.
    pub needs: &'static [(&'static Key, &'static [&'static Key])],
    /// Keys of which no two may be given.
    pub exclusive: &'static [&'static [&'static Key]],
}

/// The values of a part, by their names.
pub(crate) struct PartValues<'v>(pub &'v [(String, f64)]);

impl PartValues<'_> {
    pub fn value(&self, key: &Key) -> Option<f64> {
        let known = self.0.iter().find(|(name, _)| name == key.path);
        known.map(|(_, x)| *x)
    }

    pub fn has(&self, key: &Key) -> bool {
        self.value(key).is_some()
    }

    /// A value that must be a whole number.
    ///
    /// # Errors
    /// What was found instead.
    pub fn whole(&self, key: &Key) -> Result<Option<u64>, String> {
        match self.value(key) {
            Some(x) if x.fract() != 0.0 => Err(format!(
                "{} must be a whole number, found {}",
                key.path,
                show(x)
            )),
            value => Ok(value.map(|x| x as u64)),
        }
    }

    /// Refuses values out of range, and keys that do not go together.
    ///
    /// # Errors
    /// What is wrong, and what would be right.
    pub fn check(&self, rules: &PartRules) -> Result<(), String> {
        for (name, x) in self.0 {
            // Unknown keys have been refused.
            let known = rules.table.key(name);
            if let Some(Values::Number(range)) = known.map(|key| key.values)
                && let Some(what) = refusal(range, *x)
            {
                return Err(format!("{name} {what}"));
            }
        }
        for (key, others) in rules.needs {
            if self.has(key) && !others.iter().any(|other| self.has(other)) {
                let others: Vec<&str> = others.iter().map(|other| other.path).collect();
                let others = others.join(" or ");
                return Err(format!("{} needs {others}; give it as well", key.path));
            }
        }
        for keys in rules.exclusive {
            let given = keys.iter().filter(|key| self.has(key));
            if let [one, other, ..] = given.map(|key| key.path).collect::<Vec<_>>()[..] {
                return Err(format!("has both {one} and {other}; give one of them"));
            }
        }
        Ok(())
    }
}
