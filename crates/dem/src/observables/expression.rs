//! Formulas of a scene, such as `0.5*mass*speed^2` or `shear_force / normal_force - 0.3`.
//!
//! They are read as in Python and in books: `-x^2` is `-(x^2)`, `2^3^2` is `2^9`, and operators of
//! one rank go from left to right. (exmex, the crate for formulas that is kept up, reads these two
//! otherwise, has no `1e-3` and no call within a call.)
//!
//! A comparison is 1 where it holds and 0 where not, and so are `&&` and `||`.

use std::f64::consts::PI;

/// Characters of a formula, at most.
const LONGEST: usize = 2000;
/// Parentheses and signs within each other, at most.
const DEEPEST: usize = 50;

/// A formula, ready to be evaluated.
#[derive(Debug, Clone)]
pub struct Expression {
    text: String,
    /// In the order of a stack machine.
    program: Vec<Instruction>,
    /// Names in the order of their first use.
    names: Vec<String>,
}

/// Why a text is no formula.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BadExpression {
    /// It has a name that is not known, of a function if that is said.
    UnknownName {
        /// The name.
        name: String,
        /// Whether it is called, as a function is.
        is_called: bool,
    },
    /// What is wrong, and what would be right.
    Syntax(String),
}

#[derive(Debug, Clone, Copy)]
enum Instruction {
    Number(f64),
    /// The number of a name.
    Name(usize),
    Negate,
    Not,
    Square,
    Binary(fn(f64, f64) -> f64),
    Unary(fn(f64) -> f64),
}

/// A function of one number.
struct Unary {
    name: &'static str,
    apply: fn(f64) -> f64,
}

const fn unary(name: &'static str, apply: fn(f64) -> f64) -> Unary {
    Unary { name, apply }
}

/// A function of two numbers.
struct Binary {
    name: &'static str,
    apply: fn(f64, f64) -> f64,
}

const fn binary(name: &'static str, apply: fn(f64, f64) -> f64) -> Binary {
    Binary { name, apply }
}

const UNARY: [Unary; 13] = [
    unary("abs", f64::abs),
    unary("sqrt", f64::sqrt),
    unary("exp", f64::exp),
    unary("log", f64::ln),
    unary("log10", f64::log10),
    unary("sin", f64::sin),
    unary("cos", f64::cos),
    unary("tan", f64::tan),
    unary("atan", f64::atan),
    unary("floor", f64::floor),
    unary("ceil", f64::ceil),
    unary("round", f64::round_ties_even),
    unary("sign", sign),
];

const BINARY: [Binary; 3] = [
    binary("min", least),
    binary("max", greatest),
    binary("atan2", f64::atan2),
];

/// The names of the functions.
pub fn functions() -> Vec<&'static str> {
    let unary = UNARY.iter().map(|function| function.name);
    let binary = BINARY.iter().map(|function| function.name);
    unary.chain(binary).collect()
}

/// The constants by their names.
const CONSTANTS: [(&str, f64); 1] = [("pi", PI)];

/// Whether a name stands for a function or a constant.
pub fn is_reserved(name: &str) -> bool {
    functions().contains(&name) || CONSTANTS.iter().any(|(constant, _)| *constant == name)
}

/// -1, 0 or 1.
fn sign(x: f64) -> f64 {
    if x == 0.0 || x.is_nan() {
        x
    } else {
        x.signum()
    }
}

/// NaN if one of both is.
fn least(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

/// NaN if one of both is.
fn greatest(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

fn truth(holds: bool) -> f64 {
    if holds { 1.0 } else { 0.0 }
}

/// An operator between two numbers.
struct Operator {
    symbol: &'static str,
    /// Those of a greater rank come first.
    rank: u8,
    apply: fn(f64, f64) -> f64,
}

const fn operator(symbol: &'static str, rank: u8, apply: fn(f64, f64) -> f64) -> Operator {
    Operator {
        symbol,
        rank,
        apply,
    }
}

/// The rank of a sign and of `!`: below that of a power, above that of a product.
const SIGN: u8 = 6;
const POWER: u8 = 7;
const COMPARISON: u8 = 3;

/// Longer symbols stand before their beginnings.
const OPERATORS: [Operator; 13] = [
    operator("||", 1, |a, b| truth(a != 0.0 || b != 0.0)),
    operator("&&", 2, |a, b| truth(a != 0.0 && b != 0.0)),
    operator("<=", COMPARISON, |a, b| truth(a <= b)),
    operator(">=", COMPARISON, |a, b| truth(a >= b)),
    operator("==", COMPARISON, |a, b| truth(a == b)),
    operator("!=", COMPARISON, |a, b| truth(a != b)),
    operator("<", COMPARISON, |a, b| truth(a < b)),
    operator(">", COMPARISON, |a, b| truth(a > b)),
    operator("+", 4, |a, b| a + b),
    operator("-", 4, |a, b| a - b),
    operator("*", 5, |a, b| a * b),
    operator("/", 5, |a, b| a / b),
    operator("^", POWER, f64::powf),
];

impl Expression {
    /// Reads a formula of these names.
    ///
    /// # Errors
    /// A text that is no formula, or a name that is not known.
    pub fn parse(text: &str, known: &[impl AsRef<str>]) -> Result<Self, BadExpression> {
        if text.len() > LONGEST {
            let what = format!("has more than {LONGEST} characters; split it");
            return Err(BadExpression::Syntax(what));
        }
        let mut parser = Parser {
            text,
            at: 0,
            depth: 0,
            known: &|name| known.iter().any(|known| known.as_ref() == name),
            program: Vec::new(),
            names: Vec::new(),
        };
        parser.expression(0)?;
        parser.skip_spaces();
        if parser.at < text.len() {
            return Err(parser.expected("an operator"));
        }
        let Parser { program, names, .. } = parser;
        Ok(Self {
            text: text.into(),
            program,
            names,
        })
    }

    /// The names that it uses, in the order in which [`Self::evaluate`] takes their values.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Its value. `value`: of a name, by its place in [`Self::names`].
    pub fn evaluate(&self, value: impl Fn(usize) -> f64) -> f64 {
        // While one operand is read, each expression around it has one more that waits.
        let mut stack = [0.0; DEEPEST + 1];
        let mut top = 0;
        for instruction in &self.program {
            match *instruction {
                Instruction::Number(x) => {
                    stack[top] = x;
                    top += 1;
                }
                Instruction::Name(name) => {
                    stack[top] = value(name);
                    top += 1;
                }
                Instruction::Negate => stack[top - 1] = -stack[top - 1],
                Instruction::Not => stack[top - 1] = truth(stack[top - 1] == 0.0),
                Instruction::Square => stack[top - 1] *= stack[top - 1],
                Instruction::Unary(apply) => stack[top - 1] = apply(stack[top - 1]),
                Instruction::Binary(apply) => {
                    top -= 1;
                    stack[top - 1] = apply(stack[top - 1], stack[top]);
                }
            }
        }
        stack[0]
    }
}

/// By their texts.
impl PartialEq for Expression {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

/// Reads a text by the ranks of its operators (Pratt's method).
struct Parser<'t> {
    text: &'t str,
    /// Byte of the next character.
    at: usize,
    depth: usize,
    known: &'t dyn Fn(&str) -> bool,
    program: Vec<Instruction>,
    names: Vec<String>,
}

impl<'t> Parser<'t> {
    fn rest(&self) -> &'t str {
        &self.text[self.at..]
    }

    fn skip_spaces(&mut self) {
        let rest = self.rest();
        self.at += rest.len() - rest.trim_start().len();
    }

    /// Whether the text goes on with these characters, which are passed then.
    fn takes(&mut self, symbol: &str) -> bool {
        self.skip_spaces();
        let found = self.rest().starts_with(symbol);
        if found {
            self.at += symbol.len();
        }
        found
    }

    /// The problem that something else comes next than what may.
    fn expected(&self, what: &str) -> BadExpression {
        let rest = self.rest();
        let found = match rest.chars().next() {
            None => "the end".into(),
            Some('*') => "'*' (a power is x^2)".into(),
            Some('=') => "= (a comparison is ==)".into(),
            Some(next) => format!("{next:?}"),
        };
        let before = self.text[..self.at].trim_end();
        BadExpression::Syntax(if before.is_empty() {
            format!("must begin with {what}, found {found}")
        } else {
            format!("expected {what} after {before:?}, found {found}")
        })
    }

    /// An expression of operators of at least this rank.
    fn expression(&mut self, least: u8) -> Result<(), BadExpression> {
        self.depth += 1;
        if self.depth > DEEPEST {
            let what = format!("has more than {DEEPEST} parentheses or signs within each other");
            return Err(BadExpression::Syntax(what));
        }
        self.operand()?;
        let mut has_comparison = false;
        loop {
            self.skip_spaces();
            let rest = self.rest();
            let next = OPERATORS.iter().find(|next| rest.starts_with(next.symbol));
            let Some(next) = next.filter(|next| next.rank >= least) else {
                break;
            };
            if next.rank == COMPARISON && std::mem::replace(&mut has_comparison, true) {
                let before = self.text[..self.at].trim_end();
                let what = format!("compares again after {before:?}; join two comparisons with &&");
                return Err(BadExpression::Syntax(what));
            }
            self.at += next.symbol.len();
            let first = self.program.len();
            if next.rank == POWER {
                // From right to left, and with a sign of the exponent.
                self.expression(SIGN)?;
            } else {
                self.expression(next.rank + 1)?;
            }
            // x^2 is x*x, as everywhere, to the bit.
            if next.rank == POWER && matches!(self.program[first..], [Instruction::Number(2.0)]) {
                self.program.truncate(first);
                self.program.push(Instruction::Square);
            } else {
                self.program.push(Instruction::Binary(next.apply));
            }
        }
        self.depth -= 1;
        Ok(())
    }

    /// A number, a name, a call, a sign or an expression in parentheses.
    fn operand(&mut self) -> Result<(), BadExpression> {
        if self.takes("(") {
            self.expression(0)?;
            return self.close();
        }
        if self.takes("-") {
            self.expression(SIGN)?;
            self.program.push(Instruction::Negate);
            return Ok(());
        }
        if self.takes("+") {
            return self.expression(SIGN);
        }
        if !self.rest().starts_with("!=") && self.takes("!") {
            self.expression(SIGN)?;
            self.program.push(Instruction::Not);
            return Ok(());
        }
        if let Some(number) = self.number() {
            self.program.push(Instruction::Number(number));
            return Ok(());
        }
        let name = self.name();
        if name.is_empty() {
            return Err(self.expected("a number, a name or \"(\""));
        }
        let begin = self.at;
        if self.takes("(") {
            return self.call(name);
        }
        self.at = begin;
        if let Some((_, value)) = CONSTANTS.iter().find(|(constant, _)| *constant == name) {
            self.program.push(Instruction::Number(*value));
            return Ok(());
        }
        if !(self.known)(name) {
            return Err(BadExpression::UnknownName {
                name: name.into(),
                is_called: false,
            });
        }
        let place = self.names.iter().position(|known| known == name);
        let place = place.unwrap_or_else(|| {
            self.names.push(name.into());
            self.names.len() - 1
        });
        self.program.push(Instruction::Name(place));
        Ok(())
    }

    /// The arguments of a function.
    fn call(&mut self, name: &str) -> Result<(), BadExpression> {
        if let Some(function) = UNARY.iter().find(|function| function.name == name) {
            self.expression(0)?;
            self.close()?;
            self.program.push(Instruction::Unary(function.apply));
            return Ok(());
        }
        if let Some(function) = BINARY.iter().find(|function| function.name == name) {
            self.expression(0)?;
            if !self.takes(",") {
                return Err(self.expected("\",\" and a second number"));
            }
            self.expression(0)?;
            self.close()?;
            self.program.push(Instruction::Binary(function.apply));
            return Ok(());
        }
        Err(BadExpression::UnknownName {
            name: name.into(),
            is_called: true,
        })
    }

    fn close(&mut self) -> Result<(), BadExpression> {
        if self.takes(")") {
            Ok(())
        } else {
            Err(self.expected("an operator or \")\""))
        }
    }

    /// A number without sign, such as 2, .5 or 1.5e-3.
    fn number(&mut self) -> Option<f64> {
        self.skip_spaces();
        let bytes = self.rest().as_bytes();
        let digits = |from: usize| {
            let digits = bytes[from..]
                .iter()
                .take_while(|byte| byte.is_ascii_digit());
            from + digits.count()
        };
        let mut end = digits(0);
        if bytes.get(end) == Some(&b'.') {
            end = digits(end + 1);
        }
        if let Some(b'e' | b'E') = bytes.get(end) {
            let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
            let first = end + 1 + sign;
            if first <= bytes.len() && digits(first) > first {
                end = digits(first);
            }
        }
        let number = self.rest()[..end].parse().ok()?;
        self.at += end;
        Some(number)
    }

    /// A name: letters, digits and underscores; it does not start with a digit.
    fn name(&mut self) -> &'t str {
        self.skip_spaces();
        let rest = self.rest();
        let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        if rest.starts_with(|c: char| c.is_ascii_digit()) {
            return "";
        }
        self.at += end;
        &rest[..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [&str; 3] = ["x", "y", "v_x"];

    fn value(text: &str) -> f64 {
        let formula = Expression::parse(text, &KNOWN).unwrap_or_else(|e| panic!("{text}: {e:?}"));
        let values = [3.0, 0.5, -2.0];
        let of_names: Vec<f64> = (formula.names().iter())
            .map(|name| values[KNOWN.iter().position(|known| known == name).expect("known")])
            .collect();
        formula.evaluate(|name| of_names[name])
    }

    /// The values are those of Python's `eval` with `**` for `^`.
    #[test]
    fn formulas_are_read_as_in_books() {
        for (text, expected) in [
            ("-x^2", -9.0),
            ("2^3^2", 512.0),
            ("2*x^-1", 2.0 / 3.0),
            ("1 - 2 - 3", -4.0),
            ("12/3/2", 2.0),
            ("2*x/4*y", 0.75),
            ("7 - -x", 10.0),
            ("1.5e-3*x + .5E1", 5.0045),
            ("(1 + x)*(2 - y)", 6.0),
            ("max(x, min(y, v_x)) + 1", 4.0),
            ("max(min(x, y), min(y, 2))^2*4", 1.0),
            ("sqrt(x^2 + 16)", 5.0),
            ("abs(v_x) - sign(v_x)", 3.0),
            ("x > 2 && y <= 0.5", 1.0),
            ("x < 2 || !(y == 0.5)", 0.0),
            ("1 + (x >= 3)*2 != 3", 0.0),
            ("x + 1 > 2 * y", 1.0),
            ("cos(pi) + atan2(0, 1)", -1.0),
            ("2e3", 2000.0),
            ("-2^-2", -0.25),
            ("--x", 3.0),
        ] {
            assert_eq!(value(text), expected, "{text}");
        }
        assert_eq!(value("0.1*x^2").to_bits(), (0.1f64 * (3.0 * 3.0)).to_bits());
        assert!(value("max(sqrt(-1), 1)").is_nan() && value("min(1, 0/0)").is_nan());
    }

    #[test]
    fn what_is_wrong_is_said() {
        let refused = |text: &str| Expression::parse(text, &KNOWN).expect_err(text);
        let said = |text: &str| match refused(text) {
            BadExpression::Syntax(what) => what,
            BadExpression::UnknownName { name, .. } => panic!("{text}: {name}"),
        };
        assert_eq!(
            said(""),
            r#"must begin with a number, a name or "(", found the end"#
        );
        assert_eq!(
            said("x +"),
            r#"expected a number, a name or "(" after "x +", found the end"#
        );
        assert_eq!(said("x y"), r#"expected an operator after "x", found 'y'"#);
        assert_eq!(
            said("x**2"),
            r#"expected a number, a name or "(" after "x*", found '*' (a power is x^2)"#
        );
        assert_eq!(
            said("x = 2"),
            r#"expected an operator after "x", found = (a comparison is ==)"#
        );
        assert_eq!(
            said("(x + 1"),
            r#"expected an operator or ")" after "(x + 1", found the end"#
        );
        assert_eq!(
            said("max(x)"),
            r#"expected "," and a second number after "max(x", found ')'"#
        );
        assert_eq!(
            said("1 < x < 2"),
            r#"compares again after "1 < x"; join two comparisons with &&"#
        );
        assert_eq!(said("2x"), r#"expected an operator after "2", found 'x'"#);
        assert!(said(&"(".repeat(1000)).contains("parentheses"));
        assert!(said(&"-".repeat(1000)).contains("signs"));
        assert!(said(&"x+".repeat(5000)).contains("characters"));
        let unknown = |name: &str, is_called| BadExpression::UnknownName {
            name: name.into(),
            is_called,
        };
        assert_eq!(refused("x + z"), unknown("z", false));
        assert_eq!(refused("sinus(x)"), unknown("sinus", true));
        assert_eq!(refused("sin"), unknown("sin", false));
        assert!(matches!(refused("µ"), BadExpression::Syntax(_)));
    }

    /// The stack holds the deepest formula.
    #[test]
    fn deep_formulas_have_room() {
        let deep = |levels: usize| format!("{}2^2{}", "1+(".repeat(levels), ")".repeat(levels));
        assert_eq!(value(&deep(24)), 28.0);
        let calls = |levels: usize| format!("{}1{}", "max(0,".repeat(levels), ")".repeat(levels));
        assert_eq!(value(&calls(49)), 1.0);
        for text in [deep(25), calls(50)] {
            assert!(Expression::parse(&text, &KNOWN).is_err());
        }
    }
}
