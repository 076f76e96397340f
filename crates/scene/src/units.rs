//! Units in values: `"5 MPa"` where a key is in Pa. A value becomes the number in the unit of its
//! key, with the bits that the same number without a unit has.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::general::SCENE;
use super::keys::table;
use super::observable_keys::ObservableKeys;
use super::source::Input;
use super::table::{Table, unit};
use gshear_dem::failure::Result;
use gshear_dem::laws::{self, keys::Values};

/// Twice the exponents of m, kg and s: the laws have half powers of a metre.
type Dimension = [i32; 3];

const LENGTH: Dimension = [2, 0, 0];
const TIME: Dimension = [0, 0, 2];
const FORCE: Dimension = [2, 2, -4];
const PRESSURE: Dimension = [-2, 2, -4];

/// A unit: its dimension, the power of ten and the further factor that lead to SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Unit {
    dimension: Dimension,
    /// Twice the exponent.
    ten: i32,
    factor: f64,
}

/// A unit that has a symbol.
struct Symbol {
    name: &'static str,
    unit: Unit,
    /// Whether it takes a prefix.
    prefixed: bool,
}

/// `ten`: the exponent.
const fn symbol(name: &'static str, dimension: Dimension, ten: i32) -> Symbol {
    let ten = 2 * ten;
    Symbol {
        name,
        unit: Unit {
            dimension,
            ten,
            ..Unit::ONE
        },
        prefixed: true,
    }
}

const fn without_prefix(name: &'static str, dimension: Dimension, factor: f64) -> Symbol {
    Symbol {
        name,
        unit: Unit {
            dimension,
            factor,
            ..Unit::ONE
        },
        prefixed: false,
    }
}

const SYMBOLS: [Symbol; 11] = [
    symbol("m", LENGTH, 0),
    symbol("g", [0, 2, 0], -3),
    symbol("s", TIME, 0),
    symbol("N", FORCE, 0),
    symbol("Pa", PRESSURE, 0),
    symbol("J", [4, 2, -4], 0),
    symbol("Hz", [0, 0, -2], 0),
    symbol("bar", PRESSURE, 5),
    without_prefix("min", TIME, 60.0),
    without_prefix("h", TIME, 3600.0),
    Symbol {
        prefixed: false,
        ..symbol("t", [0, 2, 0], 3)
    },
];

/// Micro has two letters in Unicode, and one in ASCII.
const PREFIXES: [(&str, i32); 12] = [
    ("f", -15),
    ("p", -12),
    ("n", -9),
    ("u", -6),
    ("µ", -6),
    ("μ", -6),
    ("m", -3),
    ("c", -2),
    ("k", 3),
    ("M", 6),
    ("G", 9),
    ("T", 12),
];

/// The digit or sign that a raised character stands for, as in `m⁻²`.
fn raised(c: char) -> Option<char> {
    let mut characters = "⁰¹²³⁴⁵⁶⁷⁸⁹⁻".chars().zip("0123456789-".chars());
    let (_, plain) = characters.find(|(raised, _)| *raised == c)?;
    Some(plain)
}

/// What dimensions are called.
const NAMES: [(Dimension, &str); 12] = [
    (LENGTH, "a length"),
    ([4, 0, 0], "an area"),
    ([6, 0, 0], "a volume"),
    (TIME, "a time"),
    ([0, 0, -2], "a frequency"),
    ([0, 2, 0], "a mass"),
    ([-6, 2, 0], "a density"),
    ([2, 0, -2], "a velocity"),
    ([2, 0, -4], "an acceleration"),
    (FORCE, "a force"),
    ([0, 2, -4], "a force per length"),
    (PRESSURE, "a pressure"),
];

fn name_of(dimension: Dimension) -> &'static str {
    let known = NAMES.iter().find(|(named, _)| *named == dimension);
    known.map_or("a quantity of another kind", |(_, name)| name)
}

impl Unit {
    const ONE: Self = Self {
        dimension: [0; 3],
        ten: 0,
        factor: 1.0,
    };

    /// The unit of a text such as `kg/m³`, `N/m^1.5` or `1/(m s)`.
    ///
    /// # Errors
    /// The part that is not known.
    fn parse(text: &str) -> Result<Self, String> {
        let mut unit = Self::ONE;
        let mut rest = text.trim();
        let (mut divides, mut group) = (false, false);
        if rest.is_empty() {
            return Err(String::new());
        }
        while let Some(next) = rest.chars().next() {
            let after = &rest[next.len_utf8()..];
            match next {
                ' ' | '·' | '*' => rest = after,
                '/' if !divides => (divides, rest) = (true, after.trim_start()),
                '(' if divides && !group => (group, rest) = (true, after),
                ')' if group => (group, divides, rest) = (false, false, after),
                _ => {
                    let end = rest
                        .find([' ', '·', '*', '/', '(', ')'])
                        .unwrap_or(rest.len());
                    if end == 0 {
                        return Err(text.into());
                    }
                    let (factor, power) = Self::power(&rest[..end])?;
                    let sign = if divides { -1 } else { 1 };
                    unit = unit.times(factor, sign * power);
                    divides &= group;
                    rest = &rest[end..];
                }
            }
        }
        if divides || group {
            Err(text.into())
        } else {
            Ok(unit)
        }
    }

    /// A symbol with a prefix, and twice its exponent.
    fn power(text: &str) -> Result<(Self, i32), String> {
        let (name, exponent) = if let Some((name, exponent)) = text.split_once('^') {
            let twice = 2.0 * exponent.parse::<f64>().map_err(|_| text)?;
            if twice != twice.round() || twice.abs() > 24.0 {
                return Err(text.into());
            }
            (name, twice as i32)
        } else {
            let end = text.trim_end_matches(|c| raised(c).is_some()).len();
            let (name, exponent) = text.split_at(end);
            let exponent: String = exponent.chars().filter_map(raised).collect();
            match exponent.parse::<i32>() {
                _ if exponent.is_empty() => (name, 2),
                // Of few digits, as those behind `^` are.
                Ok(exponent) if exponent.abs() <= 12 => (name, 2 * exponent),
                _ => return Err(text.into()),
            }
        };
        if name == "1" {
            return Ok((Self::ONE, exponent));
        }
        if let Some(symbol) = SYMBOLS.iter().find(|symbol| symbol.name == name) {
            return Ok((symbol.unit, exponent));
        }
        let prefixed = PREFIXES.iter().find_map(|(prefix, ten)| {
            let name = name.strip_prefix(prefix)?;
            let mut all = SYMBOLS.iter().filter(|symbol| symbol.prefixed);
            let mut unit = all.find(|symbol| symbol.name == name)?.unit;
            unit.ten += 2 * ten;
            Some(unit)
        });
        Ok((prefixed.ok_or(text)?, exponent))
    }

    /// With a factor of twice this exponent.
    fn times(self, other: Self, twice: i32) -> Self {
        let mut dimension = self.dimension;
        for (exponent, more) in dimension.iter_mut().zip(other.dimension) {
            *exponent += more * twice / 2;
        }
        Self {
            dimension,
            ten: self.ten + other.ten * twice / 2,
            factor: self.factor * other.factor.powf(f64::from(twice) / 2.0),
        }
    }

    /// The number of this text, in SI units.
    fn convert(self, number: &str) -> Option<f64> {
        let plain = number.replace('_', "");
        let (mantissa, exponent) = match plain.split_once(['e', 'E']) {
            Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
            None => (&plain[..], 0),
        };
        // By the exponent of the text: "1.5 mm" has the bits of 1.5e-3.
        let exponent = exponent.checked_add(self.ten.div_euclid(2))?;
        let value: f64 = format!("{mantissa}e{exponent}").parse().ok()?;
        let half = match self.ten.rem_euclid(2) {
            0 => 1.0,
            _ => 10f64.sqrt(),
        };
        Some(value * self.factor * half)
    }
}

/// The number and the unit of a text that begins with a number and goes on; `None` of another text.
fn quantity(text: &str) -> Option<(&str, &str)> {
    let text = text.trim();
    let bytes = text.as_bytes();
    let mut end = usize::from(text.starts_with(['+', '-']));
    let first = end;
    end = end_of_digits(bytes, end);
    if bytes.get(end) == Some(&b'.') {
        end = end_of_digits(bytes, end + 1);
    }
    if !bytes[first..end].iter().any(u8::is_ascii_digit) {
        return None;
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let last = end_of_digits(bytes, end + 1 + sign);
        if last > end + 1 + sign {
            end = last;
        }
    }
    let (number, unit) = text.split_at(end);
    (!unit.trim().is_empty()).then_some((number, unit.trim()))
}

/// The end of the digits that begin here.
fn end_of_digits(bytes: &[u8], from: usize) -> usize {
    let digits = bytes[from..].iter();
    let digits = digits.take_while(|byte| byte.is_ascii_digit() || **byte == b'_');
    from + digits.count()
}

/// The keys of observables, a list of tables above all tables.
static OBSERVABLES: Table = ObservableKeys::TABLE;

/// What the units of a scene depend on.
struct UnitChoice<'l> {
    /// Whether its grains are spheres.
    spheres: bool,
    /// The law; `None`: any.
    law: Option<&'l str>,
}

impl UnitChoice<'_> {
    /// The units that a declaration has in a scene: those of its law and its dimension. Boxes,
    /// whose numbers may be in any consistent units, take values with units in SI.
    fn units(&self, declared: &str) -> Vec<String> {
        let mut units = Vec::new();
        for part in declared.split("; ") {
            let unit = match part.split_once(": ") {
                Some((law, _)) if self.law.is_some_and(|chosen| chosen != law) => continue,
                Some((_, unit)) => unit,
                None => part,
            };
            let unit = in_si(unit);
            units.push(match unit.split_once(", in 2D ") {
                Some((unit, _)) if self.spheres => unit.to_string(),
                Some((_, unit)) => unit.to_string(),
                None => unit.to_string(),
            });
        }
        units
    }
}

fn in_si(unit: &str) -> &str {
    match unit {
        "pressure" => "Pa",
        "force" => "N, in 2D N/m",
        "1/time" => "1/s",
        unit => unit,
    }
}

/// Whether values of a key may have units.
pub(super) fn applies(unit: &str) -> bool {
    let choice = UnitChoice {
        spheres: true,
        law: None,
    };
    let units = choice.units(unit);
    units.iter().all(|unit| Unit::parse(unit).is_ok())
}

/// The number of a value with a unit, as TOML.
fn converted(text: &str, units: &[String]) -> Result<String, String> {
    let (number, unit) = quantity(text).expect("a number and more");
    let wanted: Vec<Unit> = units.iter().filter_map(|u| Unit::parse(u).ok()).collect();
    if let Some(rest) = unit.strip_prefix(',')
        && rest.starts_with(|c: char| c.is_ascii_digit())
    {
        let point = format!("{number}.{rest}");
        let point = match quantity(&point) {
            Some(_) => format!("{point:?}"),
            None => point,
        };
        return Err(format!(
            "{text:?} has a comma; write the number with a point: {point}"
        ));
    }
    if units.iter().all(String::is_empty) || wanted.is_empty() {
        let percent = Unit {
            ten: -4,
            ..Unit::ONE
        };
        let plain = match percent.convert(number) {
            Some(value) if unit == "%" => format!("{value:?}"),
            _ => number.to_string(),
        };
        return Err(format!(
            "takes a number without a unit, found {text:?}; write {plain}"
        ));
    }
    let expected = units.join(" or ");
    let given = Unit::parse(unit).map_err(|part| {
        let hint = match &units_in_other_case(&part)[..] {
            [] => String::new(),
            near => format!(" (did you mean {}?)", near.join(" or ")),
        };
        format!("{text:?} has the unknown unit {part}{hint}; give a number in {expected}, such as \"5 {}\"", units[0])
    })?;
    if wanted.iter().all(|unit| unit.dimension != given.dimension) {
        return Err(format!(
            "is in {expected}, but {text:?} is {}; give {}, such as \"5 {}\"",
            name_of(given.dimension),
            name_of(wanted[0].dimension),
            units[0]
        ));
    }
    let value = given.convert(number).filter(|value| value.is_finite());
    let value = value.ok_or_else(|| format!("{text:?} is a number out of range"))?;
    Ok(format!("{value:?}"))
}

/// The units that are this text but for the case of its letters.
fn units_in_other_case(text: &str) -> Vec<String> {
    let mut units = Vec::new();
    for symbol in &SYMBOLS {
        if symbol.prefixed {
            units.extend(PREFIXES.map(|(prefix, _)| format!("{prefix}{}", symbol.name)));
        }
        units.push(symbol.name.to_string());
    }
    units.retain(|name| name.to_lowercase() == text.to_lowercase());
    units
}

/// A value that stands for a number and is a string that begins with one.
struct Quantity<'t, 'a> {
    /// The place of its key.
    at: usize,
    /// Its key, as messages name it.
    path: String,
    /// The units of the key.
    units: Vec<String>,
    value: &'t mut DeValue<'a>,
}

/// All of them in a tree, in its order.
fn quantities<'t, 'a>(tree: &'t mut DeTable<'a>) -> Vec<Quantity<'t, 'a>> {
    let dimension = tree.get("dimension").map(Spanned::get_ref);
    let dimension = dimension.and_then(|value| value.as_integer());
    let spheres = dimension.is_some_and(|number| number.as_str() == "3");
    let law = tree.get("contact").and_then(|table| {
        let law = table.get_ref().as_table()?.get("law")?;
        law.get_ref().as_str().map(str::to_string)
    });
    // The name of an unknown law is refused later.
    let law = law.filter(|law| laws::kind(law).is_some());
    let choice = UnitChoice {
        spheres,
        law: law.as_deref(),
    };
    let mut quantities = Vec::new();
    for (name, value) in tree.iter_mut() {
        if let Some(known) = table(name.get_ref()) {
            collect_in_table(known, value.get_mut(), &choice, &mut quantities);
        } else if name.get_ref() == SCENE.observable.path {
            collect_in_table(&OBSERVABLES, value.get_mut(), &choice, &mut quantities);
        }
    }
    quantities.retain(|found| {
        let text = found.value.as_str();
        text.is_some_and(|text| quantity(text).is_some())
    });
    quantities
}

/// Collects the values that stand for numbers in a table, or in the tables of a list.
fn collect_in_table<'t, 'a>(
    known: &Table,
    value: &'t mut DeValue<'a>,
    choice: &UnitChoice<'_>,
    quantities: &mut Vec<Quantity<'t, 'a>>,
) {
    let inner = match value {
        DeValue::Table(inner) => inner,
        DeValue::Array(tables) => {
            for table in tables.iter_mut() {
                collect_in_table(known, table.get_mut(), choice, quantities);
            }
            return;
        }
        _ => return,
    };
    for (name, value) in inner.iter_mut() {
        let Some(key) = known.key(name.get_ref()) else {
            continue;
        };
        let at = value.span().start;
        match (key.values, value.get_mut()) {
            (Values::Number(_), value) => quantities.push(Quantity {
                at,
                path: key.path.to_string(),
                units: choice.units(&unit(key)),
                value,
            }),
            (Values::Numbers(_), DeValue::Array(list)) => {
                let units = choice.units(&unit(key));
                for value in list.iter_mut() {
                    quantities.push(Quantity {
                        at,
                        path: key.path.to_string(),
                        units: units.clone(),
                        value: value.get_mut(),
                    });
                }
            }
            (Values::Parts(keys), DeValue::Array(parts)) => {
                for (n, part) in parts.iter_mut().enumerate() {
                    let DeValue::Table(part) = part.get_mut() else {
                        continue;
                    };
                    for (name, value) in part.iter_mut() {
                        let known = keys.iter().find(|key| name.get_ref() == key.path);
                        quantities.push(Quantity {
                            at,
                            path: format!("{}: part {}: {}", key.path, n + 1, name.get_ref()),
                            units: known.iter().map(|key| key.unit.to_string()).collect(),
                            value: value.get_mut(),
                        });
                    }
                }
            }
            // Pairs have keys of the table itself.
            (Values::Tables(_), value) => collect_in_table(known, value, choice, quantities),
            _ => {}
        }
    }
}

/// The numbers of all values with units, as TOML, in the order of [`put`].
///
/// # Errors
/// A unit that is unknown, or of another kind than that of the key.
pub(super) fn numbers(tree: &mut DeTable<'_>, input: &Input<'_>) -> Result<Vec<String>> {
    let mut numbers = Vec::new();
    for quantity in quantities(tree) {
        let text = quantity.value.as_str().expect("a string");
        let number = converted(text, &quantity.units)
            .map_err(|what| input.failure(quantity.at, &quantity.path, &what))?;
        numbers.push(number);
    }
    Ok(numbers)
}

/// Puts the numbers in the place of the values with units.
pub(super) fn put<'a>(tree: &mut DeTable<'a>, numbers: &'a [String]) {
    for (quantity, number) in quantities(tree).into_iter().zip(numbers) {
        *quantity.value = DeValue::parse(number).expect("a number").into_inner();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::cases;
    use crate::{Source, load};

    fn number(text: &str, unit: &str) -> Result<f64, String> {
        converted(text, &[unit.to_string()]).map(|text| text.parse().expect("a number"))
    }

    /// To the bit what the number in SI units is.
    #[test]
    fn every_prefix_is_a_power_of_ten() {
        for (text, unit, wanted) in [
            ("1.5 mm", "m", 1.5e-3),
            ("1.5mm", "m", 1.5e-3),
            ("0.3 fm", "m", 0.3e-15),
            ("0.3 pm", "m", 0.3e-12),
            ("0.7 nm", "m", 0.7e-9),
            ("0.7 um", "m", 0.7e-6),
            ("0.7 µm", "m", 0.7e-6),
            ("0.7 μm", "m", 0.7e-6),
            ("0.7 cm", "m", 0.7e-2),
            ("0.7 km", "m", 0.7e3),
            ("5 MPa", "Pa", 5e6),
            ("65e-1 GPa", "Pa", 65e8),
            ("1 TPa", "Pa", 1e12),
            ("1.013 bar", "Pa", 1.013e5),
            ("3 N/mm^2", "Pa", 3e6),
            ("3 N mm⁻²", "Pa", 3e6),
            ("3 N·m⁻¹⁰ m⁸", "Pa", 3.0),
            ("-1_000.5 kPa", "Pa", -1_000.5e3),
            ("2.65 g/cm³", "kg/m³", 2.65e3),
            ("2.65 t/m^3", "kg/m³", 2.65e3),
            ("7 mg", "kg", 7e-6),
            ("10 min", "s", 600.0),
            ("1.5 h", "s", 5400.0),
            ("20 ms", "s", 20e-3),
            ("0.1 mm/s", "m/s", 0.1e-3),
            ("2 m s^-1", "m/s", 2.0),
            ("9.81 m/s/s", "m/s²", 9.81),
            ("3 kN/m", "N/m", 3e3),
            ("3 J/m^2", "N/m", 3.0),
            ("5 Hz", "1/s", 5.0),
            ("4 1/(mm s)", "1/(m s)", 4e3),
            ("8 N/m^1.5", "N/m^1.5", 8.0),
        ] {
            assert_eq!(number(text, unit), Ok(wanted), "{text}");
        }
        let half = number("2 N/mm^1.5", "N/m^1.5").expect("a number");
        assert!((half / (2.0 * 10f64.powf(4.5)) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn other_units_are_refused() {
        for [text, unit, wanted] in cases(
            r#"
            5 mm | Pa | is in Pa, but "5 mm" is a length; give a pressure, such as "5 Pa"
            5 mpa | Pa | "5 mpa" has the unknown unit mpa (did you mean mPa or MPa?); give a number in Pa, such as "5 Pa"
            5 furlong | m | "5 furlong" has the unknown unit furlong; give a number in m, such as "5 m"
            5 m/ | m | "5 m/" has the unknown unit m/; give a number in m, such as "5 m"
            0.5 MPa |  | takes a number without a unit, found "0.5 MPa"; write 0.5
            1,5 mm | m | "1,5 mm" has a comma; write the number with a point: "1.5 mm"
            1,5 |  | "1,5" has a comma; write the number with a point: 1.5
            2.5 % |  | takes a number without a unit, found "2.5 %"; write 0.025
            5 m⁻ | m | "5 m⁻" has the unknown unit m⁻; give a number in m, such as "5 m"
            1e400 m | m | "1e400 m" is a number out of range
            "#,
        ) {
            assert_eq!(number(&text, &unit), Err(wanted), "{text}");
        }
    }

    #[test]
    fn only_texts_that_begin_with_a_number_have_a_unit() {
        for text in ["", "small", "none", "5", "1e-3", "-", "e5 m", "."] {
            assert_eq!(quantity(text), None, "{text}");
        }
        assert_eq!(quantity(" 5 eV "), Some(("5", "eV")));
        assert_eq!(quantity("5e3m"), Some(("5e3", "m")));
    }

    /// Every unit that is declared, in every law and dimension.
    #[test]
    fn declared_units_are_known() {
        let keys = crate::keys::TABLES.iter().flat_map(Table::keys);
        for key in keys.filter(|key| !key.unit.is_empty()) {
            let all = [true, false].map(|spheres| {
                let choice = UnitChoice { spheres, law: None };
                choice.units(&unit(key))
            });
            for unit in all.iter().flatten() {
                let parsed = Unit::parse(unit).unwrap_or_else(|_| panic!("{}", key.path));
                assert!(parsed.ten % 2 == 0 && parsed.factor == 1.0, "{}", key.path);
            }
        }
    }

    /// In a box numbers with units are those in SI, as those of its sample.
    #[test]
    fn units_of_a_box_are_si() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/bonfanti.toml");
        let source = Source::read(path).expect("a scene");
        let toml = |sets: [&str; 3]| load(&source, &sets.map(Into::into)).expect("a scene").toml;
        let plain = ["aqs.pressure=1e7", "relax.tolerance=2e-3", "relax.drag=50"];
        let units = [
            "aqs.pressure=10 MPa",
            "relax.tolerance=2 mN",
            "relax.drag=50 Hz",
        ];
        assert_eq!(toml(units), toml(plain));
    }

    #[test]
    fn scenes_with_units_are_those_without() {
        let text = "
            material = { young_modulus = 1e9, poisson_ratio = 0.2, density = 2500 }
            contact = { friction = 0.7, damping_ratio = 0.1 }
            sample = { grains = 1000, radius_min = 0.5e-6, radius_max = 1e-6, length = 48e-6 }
            load.stiffness_number = 1e4
        ";
        let plain = [
            "load.stiffness_number=none",
            "load.pressure=13.5e3",
            "sample.length=48e-6",
            "material.density=2500",
            "shear.protocol=[{velocity=0.1, distance=20e-3}, {velocity=0, time=10e-3}]",
            "bookkeeping.watchdog=600",
        ];
        let units = [
            "load.stiffness_number=none",
            "load.pressure=13.5 kPa",
            "sample.length=48 µm",
            "material.density=2.5 g/cm^3",
            "shear.protocol=[{velocity='10 cm/s', distance='20 mm'}, {velocity=0, time='10 ms'}]",
            "bookkeeping.watchdog=10 min",
        ];
        let scene = |sets: [&str; 6]| load(&Source::new("x", text), &sets.map(Into::into)).unwrap();
        let [plain, units] = [plain, units].map(scene);
        assert_eq!(plain.toml, units.toml);
        assert_eq!(plain, units);
    }

    #[test]
    fn the_unit_of_the_dimension_and_the_law_counts() {
        for (spheres, law, expected) in [
            (false, Some("hooke"), vec!["Pa"]),
            (true, Some("hooke"), vec!["N/m"]),
            (true, Some("mindlin"), vec!["N/m^1.5"]),
            (true, None, vec!["N/m", "N/m^1.5"]),
        ] {
            let choice = UnitChoice { spheres, law };
            let units = choice.units("hooke: N/m, in 2D Pa; mindlin: N/m^1.5");
            assert_eq!(units, expected);
        }
        let sets = ["load.stiffness_number=none", "load.normal_force=1 N"].map(Into::into);
        let expected = "--set load.normal_force=1 N: is in N/m, but \"1 N\" is a force; give a force per length, such as \"5 N/m\"";
        let refused = load(&Source::embedded(), &sets);
        assert_eq!(refused.unwrap_err().to_string(), expected);
    }
}
