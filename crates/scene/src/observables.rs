//! Columns that a scene declares in the time series of a shear (`[[observable]]`), and those of
//! `log.csv`.

use std::sync::Arc;

use gshear_dem::boundary::Boundary;
use gshear_dem::columns::Column;
use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::keys::{Key, KeyReader, Values};
use gshear_dem::observables::{
    self, BadExpression, Expression, GrainReduction, Measure, Observable, ObservableColumn,
    ObservableKind, PlaneStress, Quantity, Reduction, Selection, quantities,
};
use gshear_dem::state::{TemperatureRow, body};

use crate::checker::Checker;
use crate::general::SCENE;
use crate::observable_keys::{BODIES, COMPONENTS, OBSERVABLE, ObservableKeys, REDUCTIONS};
use crate::output::OUTPUT;
use crate::scene::Scene;
use crate::schedule::Schedule;
use crate::value::{Entries, Value, refusal};
use crate::words::{known_names, list, meant, quoted_list};

/// The keys of a reduction over grains, of a plane and of a formula, besides name and unit.
static OF_GRAINS: [&Key; 8] = [
    &OBSERVABLE.quantity,
    &OBSERVABLE.reduce,
    &OBSERVABLE.grains,
    &OBSERVABLE.x,
    &OBSERVABLE.y,
    &OBSERVABLE.z,
    &OBSERVABLE.radius,
    &OBSERVABLE.condition,
];
static OF_PLANE: [&Key; 2] = [&OBSERVABLE.plane, &OBSERVABLE.component];
static OF_COLUMNS: [&Key; 1] = [&OBSERVABLE.expression];
static OF_KIND: [&Key; 1] = [&OBSERVABLE.kind];

/// Names that the time series has besides its columns.
const TAKEN: [&str; 3] = ["step", "time", "gshear"];
/// Characters of a name or a unit, at most.
const LONGEST_NAME: usize = 60;

/// Reads the observables and the columns of the log, and gives them to the shear.
pub(crate) fn check(c: &mut Checker<'_>, scene: &mut Scene) {
    let Some(shear) = &scene.stages.shear else {
        let why = "is of the time series of a shear at a rate, and this scene has no [shear]";
        c.useless(&SCENE.observable, why);
        return;
    };
    let given = match c.value(&SCENE.observable) {
        Some(Value::Tables(tables)) => tables.clone(),
        _ => Vec::new(),
    };
    let is_given = c.is_given(&SCENE.observable) || c.is_given(&OUTPUT.columns);
    if !is_given {
        return;
    }
    let schedule = Schedule::new(scene, shear, shear.height(&scene.sample));
    let context = Context {
        dimension: scene.dimension,
        boundary: shear.boundary,
        columns: schedule.columns,
        given: &given,
    };
    let mut observables: Vec<ObservableColumn> = Vec::new();
    for (n, entries) in given.iter().enumerate() {
        let entry = Entry { entries };
        match context.observable(entry, &observables) {
            Ok(observable) => observables.push(observable),
            Err(what) => {
                let label = match entry.text(&OBSERVABLE.name) {
                    Some(name) => format!("{name:?}"),
                    None => format!("number {}", n + 1),
                };
                c.refuse_entry(&SCENE.observable, n, &format!("{label}: {what}"));
                return;
            }
        }
    }
    let own = observables.iter().map(|own| own.column);
    let columns: Vec<Column> = schedule.columns.iter().copied().chain(own).collect();
    let log_columns = log_columns(c, &columns);
    let shear = scene.stages.shear.as_mut().expect("the shear of above");
    shear.log_columns = log_columns;
    shear.observables = observables;
}

/// The columns of `log.csv`, if they are chosen.
fn log_columns(c: &mut Checker<'_>, columns: &[Column]) -> Option<Vec<&'static str>> {
    let Some(Value::Names(chosen)) = c.value(&OUTPUT.columns) else {
        return None;
    };
    let names = chosen
        .iter()
        .enumerate()
        .map(|(n, name)| log_column(name, &chosen[..n], columns));
    let names: Result<Vec<_>, String> = names.collect();
    let problem = match names {
        Ok(names) if names.is_empty() => {
            "must name one column or more, such as [\"strain\", \"stress_ratio\"]".into()
        }
        Ok(names) => return Some(names),
        Err(problem) => problem,
    };
    c.refuse(&OUTPUT.columns, &problem);
    None
}

/// A column that `output.columns` names after those `before` it.
fn log_column(name: &str, before: &[String], columns: &[Column]) -> Result<&'static str, String> {
    if ["step", "time"].contains(&name) {
        return Err(format!("{name:?} comes first in every row; leave it out"));
    }
    if before.iter().any(|other| other == name) {
        return Err(format!("names {name:?} twice; leave one out"));
    }
    if let Some(column) = columns.iter().find(|column| column.name == name) {
        return Ok(column.name);
    }
    let known: Vec<&str> = columns.iter().map(|column| column.name).collect();
    if TemperatureRow::COLUMNS
        .iter()
        .any(|column| column.name == name)
    {
        return Err(format!(
            "{name:?} is a column with output.temperatures = true; give that as well"
        ));
    }
    let unknown = format!("{name:?} is no column of this run{}", meant(name, &known));
    Err(known_names(unknown, "its columns are", &known))
}

/// What an observable may refer to.
struct Context<'a> {
    dimension: Dimensions,
    boundary: &'a Boundary,
    /// Those of the program.
    columns: &'a [Column],
    /// All observables.
    given: &'a [Entries],
}

impl Context<'_> {
    /// An observable after those `before` it.
    fn observable(
        &self,
        entry: Entry<'_>,
        before: &[ObservableColumn],
    ) -> Result<ObservableColumn, String> {
        entry.check_values()?;
        let name = self.name(entry, before)?;
        let ways = [
            &OBSERVABLE.quantity,
            &OBSERVABLE.plane,
            &OBSERVABLE.expression,
            &OBSERVABLE.kind,
        ];
        let given: Vec<&Key> = ways.into_iter().filter(|key| entry.has(key)).collect();
        if let [one, other, ..] = given[..] {
            let [one, other] = [one, other].map(Key::name);
            return Err(format!("has both {one} and {other}; give one of them"));
        }
        let (unit, measure);
        if entry.has(&OBSERVABLE.expression) {
            entry.check_keys("an expression of columns", &OF_COLUMNS)?;
            unit = None;
            measure = Measure::Columns(self.expression(entry, before)?);
        } else if let Some(place) = entry.number(&OBSERVABLE.plane) {
            entry.check_keys("a plane", &OF_PLANE)?;
            let component = entry.named(&OBSERVABLE.component, &COMPONENTS);
            unit = Some("Pa".into());
            measure = Measure::Sample(Arc::new(PlaneStress { place, component }));
        } else if let Some(name) = entry.text(&OBSERVABLE.kind) {
            let kind = registered(name)?;
            let keys: Vec<&Key> = OF_KIND.iter().chain(kind.keys).copied().collect();
            entry.check_keys(&format!("the kind {name:?}"), &keys)?;
            unit = Column::new(kind.name, kind.unit, "").unit_in(self.dimension.axes());
            measure = Measure::Sample(entry.of_kind(kind, self.dimension)?);
        } else {
            entry.check_keys("a quantity of grains", &OF_GRAINS)?;
            let reduction = self.reduction(entry)?;
            unit = self.unit_of(&reduction, entry);
            measure = Measure::Sample(Arc::new(reduction));
        }
        let unit = match entry.text(&OBSERVABLE.unit) {
            Some(given) => given.trim(),
            None => unit.as_deref().unwrap_or("1"),
        };
        Ok(ObservableColumn {
            column: Column::own(name, unit, &entry.definition()),
            measure,
        })
    }

    /// The name of the column.
    fn name<'e>(&self, entry: Entry<'e>, before: &[ObservableColumn]) -> Result<&'e str, String> {
        let Some(name) = entry.text(&OBSERVABLE.name) else {
            return Err("lacks name: that of its column, such as name = \"speed\"".into());
        };
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if name.is_empty()
            || name.starts_with(|c: char| c.is_ascii_digit())
            || !name.chars().all(is_word)
            || name.len() > LONGEST_NAME
        {
            return Err(format!(
                "name must be of letters, digits and underscores, {LONGEST_NAME} at most, and must not begin with a digit"
            ));
        }
        if observables::is_reserved(name) {
            return Err("name is that of a function of formulas; give another one".into());
        }
        let of_program = Boundary::all_series_columns();
        let is_taken = of_program.iter().any(|column| column.name == name);
        if is_taken || TAKEN.contains(&name) {
            return Err("name is that of a column of the program; give another one".into());
        }
        if before.iter().any(|other| other.column.name == name) {
            return Err("name is that of an observable above; give another one".into());
        }
        if let Some(unit) = entry.text(&OBSERVABLE.unit)
            && (unit.trim().is_empty()
                || unit.chars().count() > LONGEST_NAME
                || unit.chars().any(char::is_control))
        {
            return Err(format!(
                "unit must have 1 to {LONGEST_NAME} characters in one line, such as unit = \"m/s\""
            ));
        }
        Ok(name)
    }

    /// A formula of columns.
    fn expression(
        &self,
        entry: Entry<'_>,
        before: &[ObservableColumn],
    ) -> Result<Expression, String> {
        let key = &OBSERVABLE.expression;
        let text = entry.text(key).unwrap_or_default();
        let mut known = vec!["time"];
        known.extend(self.columns.iter().map(|column| column.name));
        known.extend(before.iter().map(|own| own.column.name));
        Expression::parse(text, &known).map_err(|bad| {
            if let BadExpression::UnknownName { name, .. } = &bad {
                let names = self.given.iter();
                let mut names =
                    names.filter_map(|entries| Entry { entries }.text(&OBSERVABLE.name));
                if names.any(|other| other == name) {
                    return format!(
                        "expression: {name} is not an observable above this one; move it up"
                    );
                }
            }
            refused_formula(key, &bad, "column", &known)
        })
    }

    /// A formula of quantities of a grain.
    fn quantity(&self, key: &Key, text: &str) -> Result<Quantity, String> {
        let known: Vec<&str> = quantities(self.dimension)
            .map(|quantity| quantity.column.name)
            .collect();
        let formula = Expression::parse(text, &known)
            .map_err(|bad| refused_formula(key, &bad, "quantity of a grain", &known))?;
        Ok(Quantity::new(formula, self.dimension))
    }

    /// A reduction over grains.
    fn reduction(&self, entry: Entry<'_>) -> Result<GrainReduction, String> {
        let keys = &OBSERVABLE;
        let reduction = entry.named(&keys.reduce, &REDUCTIONS);
        let quantity = match (entry.text(&keys.quantity), reduction) {
            (Some(_), Reduction::Count) => {
                return Err(
                    "quantity does not apply to reduce = \"count\", which counts grains; leave it out, or give condition".into(),
                );
            }
            (Some(text), _) => Some(self.quantity(&keys.quantity, text)?),
            (None, Reduction::Count) => None,
            (None, _) => {
                return Err(
                    "lacks what it measures: quantity, reduce = \"count\", plane or expression"
                        .into(),
                );
            }
        };
        Ok(GrainReduction {
            selection: self.selection(entry)?,
            quantity,
            reduction,
        })
    }

    /// The grains that count.
    fn selection(&self, entry: Entry<'_>) -> Result<Selection, String> {
        let keys = &OBSERVABLE;
        let chosen = entry.named(&keys.grains, &BODIES);
        let there: Vec<u32> = self.boundary.bodies().chain([body::FREE]).collect();
        if chosen.iter().all(|body| !there.contains(body)) {
            let name = entry.text(&keys.grains).unwrap_or_default();
            return Err(format!(
                "grains = {name:?} are none: no grain of this sample belongs to such a wall; leave it out"
            ));
        }
        if self.dimension == Dimensions::Two && entry.has(&keys.z) {
            return Err("z does not apply to dimension = 2, whose last axis is y; give y".into());
        }
        let mut places = [None; 3];
        for (place, key) in places.iter_mut().zip([&keys.x, &keys.y, &keys.z]) {
            *place = entry.range(key)?;
            if let Some([from, to]) = place
                && from >= to
            {
                return Err(format!(
                    "{} must hold two numbers, the first less",
                    key.name()
                ));
            }
        }
        let condition = entry.text(&keys.condition);
        Ok(Selection {
            bodies: chosen.to_vec(),
            places,
            radii: entry.range(&keys.radius)?,
            condition: condition
                .map(|text| self.quantity(&keys.condition, text))
                .transpose()?,
        })
    }

    /// The unit of a reduction, if it is known.
    fn unit_of(&self, reduction: &GrainReduction, entry: Entry<'_>) -> Option<String> {
        if reduction.reduction == Reduction::Count {
            return None;
        }
        let text = entry.text(&OBSERVABLE.quantity)?.trim();
        let named = quantities(self.dimension).find(|quantity| quantity.column.name == text);
        named?.column.unit_in(self.dimension.axes())
    }
}

/// What is wrong with a formula of such names.
fn refused_formula(key: &Key, bad: &BadExpression, what: &str, known: &[&str]) -> String {
    let key = key.name();
    match bad {
        BadExpression::Syntax(problem) => format!("{key}: {problem}"),
        BadExpression::UnknownName { name, is_called } if *is_called => {
            let functions = observables::functions();
            let unknown = format!("{key}: {name} is no function{}", meant(name, &functions));
            known_names(unknown, "the functions are", &functions)
        }
        BadExpression::UnknownName { name, .. } => {
            let unknown = format!("{key}: {name} is no {what}{}", meant(name, known));
            known_names(unknown, "known are", known)
        }
    }
}

/// A kind that the program has registered.
fn registered(name: &str) -> Result<&'static ObservableKind, String> {
    observables::kind(name).ok_or_else(|| {
        let known: Vec<&str> = observables::all().map(|kind| kind.name).collect();
        if known.is_empty() {
            return format!(
                "kind {name:?} is none that this program has registered; start the program that has it, or give quantity, plane or expression"
            );
        }
        format!(
            "kind must be {}, found {name:?}{}",
            quoted_list(&known, "or"),
            meant(name, &known)
        )
    })
}

/// The keys and values of an observable.
#[derive(Clone, Copy)]
struct Entry<'e> {
    entries: &'e Entries,
}

impl<'e> Entry<'e> {
    fn value(self, key: &Key) -> Option<&'e Value> {
        let entry = self.entries.iter().find(|(name, _)| *name == key.name());
        entry.map(|(_, value)| value)
    }

    fn has(self, key: &Key) -> bool {
        self.value(key).is_some()
    }

    fn text(self, key: &Key) -> Option<&'e str> {
        match self.value(key)? {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    fn number(self, key: &Key) -> Option<f64> {
        match self.value(key)? {
            Value::Number(x) => Some(*x),
            _ => None,
        }
    }

    /// Two numbers, the first at most the second.
    fn range(self, key: &Key) -> Result<Option<[f64; 2]>, String> {
        match self.value(key) {
            Some(Value::Numbers(numbers)) => match numbers[..] {
                [from, to] if from <= to => Ok(Some([from, to])),
                _ => Err(format!(
                    "{} must hold two numbers, the first less",
                    key.name()
                )),
            },
            _ => Ok(None),
        }
    }

    /// What the word of a key names, which was checked, or the key's default.
    fn named<T: Copy>(self, key: &Key, known: &[(&str, T)]) -> T {
        let word = self.text(key).unwrap_or(key.default);
        let found = known.iter().find(|(name, _)| *name == word);
        found.expect("a word that the key takes").1
    }

    /// Refuses values that their keys do not take.
    fn check_values(self) -> Result<(), String> {
        for (name, value) in self.entries {
            // Unknown keys have been refused.
            let Some(key) = ObservableKeys::TABLE.key(name) else {
                continue;
            };
            let problem = match (value, key.values) {
                (Value::Numbers(list), Values::Numbers(bounds)) => {
                    list.iter().find_map(|x| refusal(bounds, *x))
                }
                (Value::Text(text), Values::Text(words)) if !words.is_empty() => {
                    let is_known = words.contains(&&**text);
                    (!is_known)
                        .then(|| format!("must be {}, found {text:?}", quoted_list(words, "or")))
                }
                _ => value.out_of_bounds(key),
            };
            if let Some(what) = problem {
                return Err(format!("{name} {what}"));
            }
        }
        Ok(())
    }

    /// Refuses keys that do not apply to what the observable is.
    fn check_keys(self, what: &str, keys: &[&Key]) -> Result<(), String> {
        let general = [&OBSERVABLE.name, &OBSERVABLE.unit];
        let applies = |name: &str| {
            let mut all = general.iter().chain(keys);
            all.any(|key| key.name() == name)
        };
        let other = self.entries.iter().find(|(name, _)| !applies(name));
        match other {
            None => Ok(()),
            Some((name, _)) => {
                let names: Vec<&str> = keys.iter().map(|key| key.name()).collect();
                let known = list(&names, "and");
                Err(format!(
                    "{name} does not apply to {what}, which takes {known}; leave it out"
                ))
            }
        }
    }

    /// The observable of a registered kind.
    fn of_kind(
        self,
        kind: &ObservableKind,
        dimension: Dimensions,
    ) -> Result<Arc<dyn Observable>, String> {
        let mut reader = EntryReader {
            entry: self,
            problem: None,
        };
        let observable = (kind.read)(&mut reader, dimension);
        match reader.problem {
            None => Ok(observable),
            Some(what) => Err(what),
        }
    }

    /// What it is, as the files describe it.
    fn definition(self) -> String {
        let general = [&OBSERVABLE.name, &OBSERVABLE.unit];
        let own = self
            .entries
            .iter()
            .filter(|(name, _)| general.iter().all(|key| key.name() != name));
        let own = own.map(|(name, value)| format!("{name} = {}", value.toml()));
        own.collect::<Vec<_>>().join(", ")
    }
}

/// Reads the keys of a registered kind from an observable.
struct EntryReader<'e> {
    entry: Entry<'e>,
    /// The first.
    problem: Option<String>,
}

impl EntryReader<'_> {
    fn note(&mut self, problem: String) {
        self.problem.get_or_insert(problem);
    }
}

impl KeyReader for EntryReader<'_> {
    fn number(&mut self, key: &Key) -> Option<f64> {
        self.entry.number(key)
    }

    fn choice(&mut self, key: &Key) -> Option<&'static str> {
        let Values::Text(words) = key.values else {
            return None;
        };
        let given = self.entry.text(key)?;
        words.iter().find(|word| **word == given).copied()
    }

    fn required(&mut self, key: &Key) -> f64 {
        self.number(key).unwrap_or_else(|| {
            self.note(format!("lacks {}", key.lacking()));
            f64::NAN
        })
    }

    fn exactly_one(&mut self, keys: &[&Key], what: &str) -> usize {
        let given: Vec<usize> = (0..keys.len())
            .filter(|k| self.entry.has(keys[*k]))
            .collect();
        match given[..] {
            [one] => one,
            [] => {
                self.note(format!("lacks {what}"));
                0
            }
            [one, other, ..] => {
                let [first, second] = [one, other].map(|k| keys[k].name());
                self.note(format!("has both {first} and {second}; give one of them"));
                one
            }
        }
    }

    fn useless(&mut self, key: &Key, why: &str) {
        if self.entry.has(key) {
            self.note(format!("{} {why}; leave it out", key.name()));
        }
    }

    fn refuse(&mut self, key: &Key, what: &str) {
        self.note(format!("{} {what}", key.name()));
    }
}
