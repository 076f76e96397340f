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

/// Computes all points, one after the other. Returns them as Markdown, and the number of lines that
/// do not hold.
pub fn markdown(points: &[Point]) -> (String, usize) {
    let (mut out, mut broken) = (String::new(), 0);
    for (title, lines) in points {
        let start = Instant::now();
        let lines = lines();
        println!("{title}: {:.1} s", start.elapsed().as_secs_f64());
        write!(
            out,
            "\n## {title}\n\n| test | expected | result |\n| --- | --- | --- |\n"
        )
        .expect("into a string");
        for l in lines {
            broken += usize::from(!l.holds);
            let mark = if l.holds { "" } else { " **not as expected**" };
            // An unescaped bar would end the cell.
            let cells = [&l.done, &l.expected, &l.found].map(|cell| cell.replace('|', "\\|"));
            writeln!(out, "| {} | {} | {}{mark} |", cells[0], cells[1], cells[2])
                .expect("into a string");
        }
    }
    (out, broken)
}
