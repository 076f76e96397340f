//! The reference of the configuration, made from the declarations of its keys: the tables of
//! docs/reference/config.md and the JSON schema docs/scene.schema.json. `make docs` writes both.

use std::ops::Bound;

use gshear_dem::adhesions::ADHESIONS;
use gshear_dem::columns::Column;
use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::LAWS;
use gshear_dem::laws::keys::{ANY, Bounds, Integers, Key, Values};
use gshear_dem::observables::{GrainQuantity, functions, quantities};
use serde_json::{Map, Value, json};

use crate::general::SCENE;
use crate::keys::{TABLES, TOP, tables};
use crate::law::CONTACT;
use crate::materials::MaterialKeys;
use crate::observable_keys::ObservableKeys;
use crate::part_keys::PartKeys;
use crate::protocol::{SHEAR, WITHOUT_TOP};
use crate::quasi_static::AQS;
use crate::strain_protocol::StrainPartKeys;
use crate::table::{laws_with, unit};
use crate::units;
use crate::value::{MAGNITUDES, Value as KeyValue};
use crate::words::{EXTENDS, SWEEP, TAKE_AWAY, list};

/// Begins the generated part of docs/reference/keys.md.
const BEGIN: &str = "<!-- keys: generated -->";
/// Ends it.
const END: &str = "<!-- end of keys -->";

/// The column that a footnote belongs to.
#[derive(PartialEq)]
enum TableColumn {
    Default,
    Allowed,
}

/// A remark on several keys.
struct Footnote {
    mark: char,
    column: TableColumn,
    /// With spaces between them.
    paths: &'static str,
    text: &'static str,
}

const FOOTNOTES: [Footnote; 4] = [
    Footnote {
        mark: '¹',
        column: TableColumn::Default,
        paths: "material.density material.mass contact.damping_ratio contact.restitution
            contact.normal_damping load.stiffness_number load.pressure load.normal_force
            shear.inertial_number shear.velocity",
        text: "Give exactly one of each group:

- `density`, or with the law mindlin `mass`;
- `damping_ratio`, `restitution` (neither with the law mindlin); with the law hertz
  `normal_damping`, or `restitution` with `impact_speed` and `impact_diameter`;
- `stiffness_number`, `pressure`, `normal_force`;
- `inertial_number`, `velocity`, or `protocol`, which also replaces `strain`.",
    },
    Footnote {
        mark: '²',
        column: TableColumn::Allowed,
        paths: "sample.grains sample.length",
        text:
            "The packed sample must have room for its walls (`wall_thickness`) and five mean diameters d̄
between them. Its height is N π⟨R²⟩/(0.84 L_x), in 3D N (4/3)π⟨R³⟩/(0.64 L_x L_y).",
    },
    Footnote {
        mark: '³',
        column: TableColumn::Default,
        paths: "time.step",
        text: "The default is a tenth of √(m_min/k_n,max), or the stability limit if that is less.
Intervals of output are rounded to whole steps, so that output never changes the trajectory. An
interval that is a whole number of `series_strain` is rounded to as many rows of the time series, so
that a frame falls on a row.",
    },
    Footnote {
        mark: '⁴',
        column: TableColumn::Default,
        paths: "sample.grains sample.radius_min sample.radius_max sample.length sample.width",
        text: "Required without `sample.packing`. With it they follow from the file; if given, they
must match it.",
    },
];

/// The meaning of a key, with the laws that take it.
fn doc(key: &Key) -> String {
    let doc = key.doc.trim_start();
    let laws: Vec<&str> = laws_with(key).into_iter().map(|(law, _)| law).collect();
    match laws[..] {
        [law] => format!("{doc}; law {law} only"),
        _ if laws.is_empty() || laws.len() == LAWS.len() => doc.into(),
        _ => format!("{doc}; laws {}", list(&laws, "and")),
    }
}

/// The keys in Markdown, a section for each table, with their footnotes, between the markers of
/// docs/reference/keys.md.
pub fn key_tables() -> String {
    let mut page = format!("{BEGIN}\n");
    for table in tables() {
        let heading = match table.name {
            "" => "Above all tables".into(),
            name => format!("`[{name}]`"),
        };
        page += &format!(
            "\n### {heading}\n\n| key | meaning (unit) | default | allowed | change |\n| --- | --- | --- | --- | --- |\n"
        );
        for key in table.keys() {
            let cells = [
                format!("`{}`", key.path),
                with_unit(doc(key), &unit(key)),
                marked(default(key), key, TableColumn::Default),
                marked(allowed(key), key, TableColumn::Allowed),
                key.change.name().into(),
            ];
            page += &row(&cells);
        }
    }
    page += "\n### Footnotes\n";
    for Footnote { mark, text, .. } in &FOOTNOTES {
        page += &format!("\n{mark} {text}\n");
    }
    for (list, keys) in [
        (&SHEAR.protocol, PartKeys::TABLE.own),
        (&AQS.protocol, StrainPartKeys::TABLE.own),
    ] {
        page += &part_table(list, keys);
    }
    page += &observable_table();
    page += &quantity_table();
    page + "\n" + END
}

/// The keys of an observable in Markdown.
fn observable_table() -> String {
    let mut table = format!(
        "\n### Keys of an `[[{}]]`\n\n| key | meaning (unit) | default | allowed |\n| --- | --- | --- | --- |\n",
        SCENE.observable.path
    );
    for key in ObservableKeys::TABLE.own {
        let cells = [
            format!("`{}`", key.name()),
            with_unit(doc(key), key.unit),
            default(key),
            allowed(key),
        ];
        table += &row(&cells);
    }
    table
}

/// The quantities of a grain that formulas of observables name.
fn quantity_table() -> String {
    let mut table = String::from(
        "\n### Quantities of a grain\n\n| name | meaning (unit) | |\n| --- | --- | --- |\n",
    );
    let of_disks: Vec<GrainQuantity> = quantities(Dimensions::Two).collect();
    for quantity in quantities(Dimensions::Three) {
        let Column {
            name, unit, doc, ..
        } = quantity.column;
        let unit = match unit {
            "1" => "",
            "m s-1" => "m/s",
            "rad s-1" => "rad/s",
            "kg" => "kg, in 2D kg/m",
            "J" => "J, in 2D J/m",
            "N" => "N, in 2D N/m",
            unit => unit,
        };
        let only = if of_disks.contains(&quantity) {
            ""
        } else {
            "3D only"
        };
        let cells = [
            format!("`{name}`"),
            with_unit(doc.into(), unit),
            only.into(),
        ];
        table += &row(&cells);
    }
    let functions: Vec<String> = functions().iter().map(|name| format!("`{name}`")).collect();
    table + &format!("\nFunctions of formulas: {}.\n", functions.join(", "))
}

/// The keys of a part of a list in Markdown.
fn part_table(list: &Key, keys: &[&Key]) -> String {
    let mut table = format!(
        "\n### Keys of a part of `{}`\n\n| key | meaning (unit) | allowed |\n| --- | --- | --- |\n",
        list.path
    );
    for key in keys {
        let cells = [
            format!("`{}`", key.path),
            with_unit(doc(key), key.unit),
            allowed(key),
        ];
        table += &row(&cells);
    }
    table
}

/// A meaning, and the unit if there is one.
fn with_unit(meaning: String, unit: &str) -> String {
    if unit.is_empty() {
        meaning
    } else {
        format!("{meaning} ({unit})")
    }
}

/// A row of a table.
fn row(cells: &[String]) -> String {
    let mut row = String::from("|");
    for text in cells {
        row += &match &text[..] {
            "" => " |".into(),
            text => format!(" {text} |"),
        };
    }
    row + "\n"
}

/// A cell with the marks of its footnotes.
fn marked(cell: String, key: &Key, column: TableColumn) -> String {
    let notes = FOOTNOTES.iter().filter(|note| {
        note.column == column && note.paths.split_whitespace().any(|path| path == key.path)
    });
    let marks = notes.map(|note| note.mark.to_string());
    let words = (!cell.is_empty()).then_some(cell);
    words.into_iter().chain(marks).collect::<Vec<_>>().join(" ")
}

fn default(key: &Key) -> String {
    match KeyValue::default_of(key) {
        None => key.otherwise.into(),
        Some(text @ KeyValue::Text(_)) => format!("`{}`", text.toml()),
        Some(value) => value.toml().trim_end_matches(".0").into(),
    }
}

fn allowed(key: &Key) -> String {
    let values = match key.values {
        Values::Number(bounds) => bounds.formula(),
        Values::Whole(Integers { from, to }) => match to {
            i64::MAX => format!("integer ≥ {from}"),
            _ if to == from + 1 => format!("{from}, {to}"),
            _ => format!("integer {from} … {to}"),
        },
        Values::Flag => String::new(),
        Values::Word(_) => {
            let [disks, spheres] = [Dimensions::Two, Dimensions::Three]
                .map(|dimension| quoted(&named(key, dimension)));
            format!("2D: {disks}; 3D: {spheres}")
        }
        Values::Text([]) if key.condition.is_empty() => "any string".into(),
        Values::Text(names) => quoted(names),
        Values::Numbers(bounds) if bounds == ANY => String::new(),
        Values::Numbers(bounds) => format!("each {}", bounds.formula()),
        Values::Names | Values::Parts(_) | Values::Tables(_) => String::new(),
    };
    match (&values[..], key.condition) {
        (_, "") => values,
        ("", condition) => condition.into(),
        (_, condition) => format!("{values}, {condition}"),
    }
}

/// The names of the laws or adhesions that a key takes in a dimension.
fn named(key: &Key, dimension: Dimensions) -> Vec<&'static str> {
    let laws = LAWS.iter().map(|kind| (kind.name, kind.dimensions));
    let adhesions = ADHESIONS.iter().map(|kind| (kind.name, kind.dimensions));
    let all: Vec<_> = if key.path == CONTACT.law.path {
        laws.collect()
    } else {
        adhesions.collect()
    };
    all.into_iter()
        .filter(|(_, dimensions)| dimensions.contains(&dimension))
        .map(|(name, _)| name)
        .collect()
}

/// Strings of TOML as code.
fn quoted(names: &[&str]) -> String {
    let names: Vec<String> = names.iter().map(|name| format!("`{name:?}`")).collect();
    names.join(", ")
}

/// The JSON schema (draft 2020-12) of a configuration. It has kinds and ranges of all keys; which
/// of them exclude or require each other is checked by [`load`](crate::load) only, and so is the
/// kind of a unit. Every key takes `"none"`, which removes the key of the file that is extended.
pub fn json_schema() -> String {
    let mut properties = object(&TOP.keys());
    for table in &TABLES {
        let mut schema = json!({
            "description": table.about.trim(),
            "type": ["object", "string"],
            "pattern": none(),
            "properties": object(&table.keys()),
            "additionalProperties": unknown(),
        });
        if table.name == MaterialKeys::TABLE.name {
            schema["type"] = json!(["object", "array", "string"]);
            schema["items"] = json!({
                "type": "object",
                "properties": object(&table.keys()),
                "additionalProperties": unknown(),
            });
        }
        properties.insert(table.name.into(), schema);
    }
    let sweep = json!({
        "description": "lists of values for keys; every combination is a run",
        "type": ["object", "string"],
        "pattern": none(),
        "properties": {
            "seeds": {
                "description": "number of seeds: 3 stands for seed = [1, 2, 3]",
                "type": "integer",
                "minimum": 1,
            },
            "zip": {
                "description": "lists of the same length whose values belong together; several such tables as [[sweep.zip]]",
                "type": ["object", "array"],
                "items": { "type": "object" },
                "additionalProperties": { "type": ["array", "object"] },
            },
        },
        "additionalProperties": { "type": ["array", "object"] },
    });
    properties.insert(SWEEP.into(), sweep);
    let extends = json!({
        "description": "another configuration, whose keys this one has but for those it gives itself; a path from the folder of this file",
        "type": "string",
    });
    properties.insert(EXTENDS.into(), extends);
    let schema = json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scene of gshear-mpi",
        "description": "A configuration of gshear-mpi; docs/reference/config.md describes it.",
        "type": "object",
        "properties": properties,
        "additionalProperties": unknown(),
    });
    format!("{schema:#}\n")
}

/// The schema of a key that is not known, which no value fits. Checkers underline the key: with
/// `false` they underline its whole table (Taplo).
fn unknown() -> Value {
    json!({ "not": { "description": "unknown key; docs/reference/keys.md lists the keys" } })
}

fn object(keys: &[&Key]) -> Map<String, Value> {
    let properties = keys.iter().map(|key| (key.name().into(), schema(key)));
    properties.collect()
}

/// The schema of a key.
fn schema(key: &Key) -> Value {
    let with_unit = units::applies(&unit(key));
    let mut schema = match key.values {
        Values::Number(bounds) => number(bounds, with_unit),
        Values::Whole(Integers { from, to }) => {
            let mut schema = json!({ "type": "integer", "minimum": from });
            if to < i64::MAX {
                schema["maximum"] = to.into();
            }
            schema
        }
        Values::Flag => json!({ "type": "boolean" }),
        Values::Text([]) => json!({ "type": "string" }),
        Values::Text(names) => words(names),
        Values::Word(names) => words(&names()),
        Values::Numbers(bounds) => {
            json!({ "type": "array", "items": number(bounds, with_unit), "minItems": 1 })
        }
        Values::Names => json!({ "type": "array", "items": { "type": "string" } }),
        Values::Parts(keys) => {
            let mut items = part(keys);
            if key.path == SHEAR.protocol.path {
                items["allOf"] = rules_of_shear(keys);
            }
            json!({ "type": "array", "items": items, "minItems": 1 })
        }
        Values::Tables(keys) => {
            json!({ "type": "array", "items": entries(&keys()), "minItems": 1 })
        }
    };
    match key.values {
        Values::Text(_) | Values::Word(_) => {}
        Values::Number(_) if with_unit => {
            schema["pattern"] = format!("{}|{}", none(), quantity()).into();
        }
        _ => {
            schema["type"] = json!([schema["type"], "string"]);
            schema["pattern"] = none().into();
        }
    }
    schema["description"] = description(key).into();
    if let Some(default) = KeyValue::default_of(key) {
        schema["default"] = serde_json::from_str(&default.toml()).unwrap_or(Value::Null);
    }
    schema
}

/// One of these words.
fn words(names: &[&str]) -> Value {
    let names: Value = names.iter().copied().chain([TAKE_AWAY]).collect();
    json!({ "enum": names })
}

/// The schema of the tables of a list with these keys.
fn entries(keys: &[&Key]) -> Value {
    let keys: Vec<&Key> = keys
        .iter()
        .filter(|key| !matches!(key.values, Values::Tables(_)))
        .copied()
        .collect();
    json!({ "type": "object", "properties": object(&keys), "additionalProperties": unknown() })
}

/// The meaning of a key with its unit.
fn description(key: &Key) -> String {
    match &unit(key)[..] {
        "" => doc(key),
        unit => format!("{} ({unit})", doc(key)),
    }
}

/// The string that removes a key.
fn none() -> String {
    format!("^{TAKE_AWAY}$")
}

/// A number with a unit.
fn quantity() -> &'static str {
    r"^\s*[+-]?([0-9][0-9_]*\.?[0-9_]*|\.[0-9][0-9_]*)([eE][+-]?[0-9]+)?\s*[^\s0-9.,_+-].*$"
}

fn number(Bounds { from, to }: Bounds, with_unit: bool) -> Value {
    let mut schema = json!({ "type": "number" });
    if with_unit {
        schema = json!({ "type": ["number", "string"], "pattern": quantity() });
    }
    let [least, most] = MAGNITUDES;
    match from {
        Bound::Included(x) => schema["minimum"] = x.into(),
        Bound::Excluded(0.0) => schema["minimum"] = least.into(),
        Bound::Excluded(x) => schema["exclusiveMinimum"] = x.into(),
        Bound::Unbounded => schema["minimum"] = (-most).into(),
    }
    match to {
        Bound::Included(x) => schema["maximum"] = x.into(),
        Bound::Excluded(x) => schema["exclusiveMaximum"] = x.into(),
        Bound::Unbounded => schema["maximum"] = most.into(),
    }
    schema
}

/// A part of a protocol with these keys.
fn part(keys: &[&Key]) -> Value {
    let mut properties = Map::new();
    for key in keys {
        let Values::Number(range) = key.values else {
            continue;
        };
        let mut schema = number(range, units::applies(key.unit));
        schema["description"] = description(key).into();
        properties.insert(key.path.into(), schema);
    }
    json!({
        "type": "object",
        "properties": properties,
        "additionalProperties": unknown(),
    })
}

/// Which keys of a part of a shear go together.
fn rules_of_shear(keys: &[&Key]) -> Value {
    // A part below a free surface has no key of a top wall.
    let without_top: Map<String, Value> = keys
        .iter()
        .filter(|key| WITHOUT_TOP.iter().all(|other| other.path != key.path))
        .map(|key| (key.path.into(), json!(false)))
        .collect();
    let mut drives = required(&["velocity", "strain_amplitude", "shear_stress"]);
    drives.push(json!({ "properties": without_top }));
    json!([
        { "oneOf": drives },
        { "oneOf": required(&["distance", "time", "cycles"]) },
    ])
}

/// For each of these keys a schema that requires it.
fn required(names: &[&str]) -> Vec<Value> {
    let schemas = names.iter().map(|name| json!({ "required": [name] }));
    schemas.collect()
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::*;
    use crate::table::Table;

    fn keys() -> impl Iterator<Item = &'static Key> {
        tables().flat_map(Table::keys)
    }

    fn root() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
    }

    fn read(path: &str) -> String {
        std::fs::read_to_string(root().join(path)).expect("a file of the repository")
    }

    /// The page with the present tables of keys between its markers.
    fn page() -> String {
        let page = read("docs/reference/keys.md");
        let (before, rest) = page.split_once(BEGIN).expect("the first marker");
        let (_, after) = rest.split_once(END).expect("the last marker");
        format!("{before}{}{after}", key_tables())
    }

    #[test]
    fn the_reference_is_up_to_date() {
        let stale = "is not what the declarations of the keys give; run `make docs`";
        assert!(
            read("docs/reference/keys.md") == page(),
            "docs/reference/keys.md {stale}"
        );
        let schema = read("docs/scene.schema.json");
        assert!(schema == json_schema(), "docs/scene.schema.json {stale}");
    }

    /// Called by `make docs`.
    #[test]
    #[ignore = "writes docs/reference/keys.md and docs/scene.schema.json"]
    fn write_the_reference() {
        let write = |path: &str, text| std::fs::write(root().join(path), text).expect("written");
        write("docs/reference/keys.md", page());
        write("docs/scene.schema.json", json_schema());
    }

    #[test]
    fn every_key_is_documented() {
        for key in keys() {
            assert!(!key.doc.contains('|'), "{} breaks the table", key.path);
            let range = !allowed(key).is_empty() || matches!(key.values, Values::Flag);
            assert!(range, "{} has no range", key.path);
            let default = KeyValue::default_of(key).is_some();
            assert_eq!(default, !key.default.is_empty(), "{}", key.path);
        }
        for note in &FOOTNOTES {
            for path in note.paths.split_whitespace() {
                assert!(keys().any(|key| key.path == path), "{path}");
            }
        }
    }

    /// Every number has a unit, but for these, which are pure numbers.
    #[test]
    fn every_quantity_has_a_unit() {
        let pure = "
            material.fraction material.poisson_ratio contact.friction contact.rolling_friction
            contact.rolling_damping_ratio contact.twisting_friction contact.twisting_damping_ratio
            contact.damping_ratio contact.restitution contact.sliding_damping contact.ageing
            contact.tangential_damping_ratio sample.radius_exponent sample.passing
            sample.large_fraction sample.radii_weights sample.solid_fraction sample.aspect
            sample.replicate sample.wall_thickness load.stiffness_number load.incline
            load.solid_fraction pack.friction pack.drag pack.tolerance
            shear.inertial_number shear.strain shear.spring_number output.frame_strain
            output.frame_start output.series_strain output.checkpoint_strain
            aqs.strain_step aqs.pressure_tolerance aqs.pressure_step aqs.birth_precision
            aqs.until_imaginary
            newtonian.growth_times analysis.strain analysis.start bookkeeping.skin";
        let without = keys()
            .filter(|key| matches!(key.values, Values::Number(_) | Values::Numbers(_)))
            .filter(|key| key.unit.is_empty());
        let found: Vec<&str> = without.map(|key| key.path).collect();
        assert_eq!(found, pure.split_whitespace().collect::<Vec<_>>());
    }
}
