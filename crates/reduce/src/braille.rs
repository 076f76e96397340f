//! A curve as lines of text, with the eight dots of Braille patterns as pixels.

use gshear_analysis::moments::extent;

/// Characters for the values beside the picture.
const GUTTER: usize = 10;

/// Draws the points as a line into so many characters: `[width, height]`, both with the values at
/// the axes. `unicode`: whether the terminal takes Braille patterns; otherwise stars.
pub fn plot(
    points: &[[f64; 2]],
    name: &str,
    over: &str,
    [width, height]: [usize; 2],
    unicode: bool,
) -> Vec<String> {
    let finite = |p: &&[f64; 2]| p.iter().all(|x| x.is_finite());
    let points: Vec<[f64; 2]> = points.iter().filter(finite).copied().collect();
    // The last line has the values of x.
    let (columns, rows) = (width.saturating_sub(GUTTER + 1), height.saturating_sub(1));
    if points.is_empty() || columns == 0 || rows < 2 {
        return Vec::new();
    }
    let [x, y] = [0, 1].map(|axis| {
        let [least, most] = extent(points.iter().map(|p| p[axis]));
        // A constant lies in the middle.
        let around = most.abs().max(1e-300) * 0.1;
        let margin = if most > least { 0.0 } else { around };
        [least - margin, most + margin]
    });
    let (wide, high) = (2 * columns, 4 * rows);
    let dots = dots(&points, [x, y], [wide, high]);
    let cell = |column: usize, row: usize| {
        let dot = |down: usize, right: usize| dots[(4 * row + down) * wide + 2 * column + right];
        match (pattern(dot), unicode) {
            (0, _) => ' ',
            (_, false) => '*',
            (pattern, true) => char::from_u32(0x2800 + pattern).unwrap_or('*'),
        }
    };
    let bar = if unicode { '│' } else { '|' };
    let mut lines: Vec<String> = (0..rows)
        .map(|row| {
            let label = match row {
                0 => number(y[1]),
                1 => name.to_string(),
                row if row == rows - 1 => number(y[0]),
                _ => String::new(),
            };
            let picture: String = (0..columns).map(|column| cell(column, row)).collect();
            format!("{label:>GUTTER$}{bar}{}", picture.trim_end())
        })
        .collect();
    let [from, to] = x.map(number);
    let middle = (columns + 1).saturating_sub(from.len() + to.len());
    lines.push(format!("{:GUTTER$}{from}{over:^middle$}{to}", ""));
    lines
}

/// The dots of a line through the points, `[high][wide]`; the axes run over `x` and `y`.
fn dots(points: &[[f64; 2]], [x, y]: [[f64; 2]; 2], [wide, high]: [usize; 2]) -> Vec<bool> {
    let place = |value: f64, [from, to]: [f64; 2], size: usize| {
        let part = (value - from) / (to - from);
        ((part * (size - 1) as f64).round() as usize).min(size - 1)
    };
    let mut dots = vec![false; wide * high];
    let mut before: Option<[usize; 2]> = None;
    for [at_x, at_y] in points {
        let now = [place(*at_x, x, wide), high - 1 - place(*at_y, y, high)];
        let from = before.unwrap_or(now);
        let steps = from[0]
            .abs_diff(now[0])
            .max(from[1].abs_diff(now[1]))
            .max(1);
        for k in 0..=steps {
            let [column, row] = [0, 1].map(|axis| {
                let (a, b) = (from[axis] as f64, now[axis] as f64);
                (a + (b - a) * k as f64 / steps as f64).round() as usize
            });
            dots[row * wide + column] = true;
        }
        before = Some(now);
    }
    dots
}

/// The number of a pattern; `dot(down, right)` of its four rows and two columns.
fn pattern(dot: impl Fn(usize, usize) -> bool) -> u32 {
    // The bits: three rows of the left and of the right column, then the fourth row.
    let bits: [[u32; 2]; 4] = [[0, 3], [1, 4], [2, 5], [6, 7]];
    let value = |down: usize, right: usize| u32::from(dot(down, right)) << bits[down][right];
    (0..4).map(|down| value(down, 0) | value(down, 1)).sum()
}

fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        1e-3..1e5 => format!("{value:.4}"),
        _ => format!("{value:.2e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_goes_from_corner_to_corner() {
        let points = [[0.0, 0.0], [1.0, 2.0]];
        let lines = plot(&points, "y", "x", [21, 6], true);
        assert_eq!(lines.len(), 6);
        let mut widths = lines.iter().map(|line| line.chars().count());
        assert!(widths.all(|width| width <= 21), "{lines:?}");
        assert!(lines[0].starts_with("    2.0000│"), "{lines:?}");
        assert!(lines[4].starts_with("         0│⡠"), "{lines:?}");
        // The dot at the upper right is the last of the top line.
        assert!(lines[0].ends_with('⠊'), "{lines:?}");
        assert_eq!(lines[5], format!("{:10}0 x  1.0000", ""));
    }

    #[test]
    fn a_constant_and_a_point_are_lines() {
        for points in [&[[0.0, 3.0], [1.0, 3.0]][..], &[[0.5, 3.0]]] {
            let lines = plot(points, "y", "x", [40, 7], false);
            let stars = lines.iter().filter(|line| line.contains('*')).count();
            assert_eq!(stars, 1, "{lines:?}");
        }
        assert!(plot(&[[f64::NAN, 1.0]], "y", "x", [40, 7], true).is_empty());
    }
}
