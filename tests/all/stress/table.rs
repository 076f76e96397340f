//! The table of the stress tests: what each test does, what it expects, and the result.

use std::fmt::Write;
use std::time::Instant;

/// A title, and the function that computes the lines under it.
pub type Point = (&'static str, fn() -> Vec<Line>);

/// One line of the table.
#[derive(Debug, Clone)]
pub struct Line {
    done: String,
    expected: String,
    found: String,
    holds: bool,
}

/// A line of the table. `holds`: whether the result is as expected.
pub fn line(
    done: impl Into<String>,
    expected: impl Into<String>,
    found: impl Into<String>,
    holds: bool,
) -> Line {
    Line {
        done: done.into(),
        expected: expected.into(),
        found: found.into(),
        holds,
    }
}

/// Panics if a line does not hold.
pub fn check(lines: &[Line]) {
    assert!(!lines.is_empty());
    for l in lines {
        println!(
            "{} | expected: {} | result: {}",
            l.done, l.expected, l.found
        );
    }
    let broken: Vec<_> = lines.iter().filter(|l| !l.holds).collect();
    assert!(broken.is_empty(), "{broken:#?}");
}

/// Computes all points, one after the other. Returns them as CSV, and the number of lines that do
/// not hold.
pub fn csv(points: &[Point]) -> (String, usize) {
    let mut out = String::from("point,test,expected,result,holds\n");
    let mut broken = 0;
    for (title, lines) in points {
        let start = Instant::now();
        let lines = lines();
        println!("{title}: {:.1} s", start.elapsed().as_secs_f64());
        for l in lines {
            broken += usize::from(!l.holds);
            let cells = [*title, &l.done, &l.expected, &l.found].map(quoted);
            writeln!(out, "{},{}", cells.join(","), l.holds).expect("into a string");
        }
    }
    (out, broken)
}

/// A cell of a CSV file.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}
