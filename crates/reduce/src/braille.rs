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
    size: [usize; 2],
    unicode: bool,
) -> Vec<String> {
    let [width, height] = size;
    let points = points.iter().copied();
    let points: Vec<[f64; 2]> = points
        .filter(|point| point.iter().all(|x| x.is_finite()))
        .collect();
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
    let mut dots = Dots::new([2 * columns, 4 * rows]);
    dots.draw(&points, x, y);
    let bar = if unicode { '│' } else { '|' };
    let mut lines: Vec<String> = (0..rows)
        .map(|row| {
            let label = match row {
                0 => number(y[1]),
                1 => name.to_string(),
                row if row == rows - 1 => number(y[0]),
                _ => String::new(),
            };
            let cells = (0..columns).map(|column| match (dots.pattern(column, row), unicode) {
                (0, _) => ' ',
                (_, false) => '*',
                (pattern, true) => char::from_u32(0x2800 + pattern).unwrap_or('*'),
            });
            let picture: String = cells.collect();
            format!("{label:>GUTTER$}{bar}{}", picture.trim_end())
        })
        .collect();
    let [from, to] = x.map(number);
    let middle = (columns + 1).saturating_sub(from.len() + to.len());
    lines.push(format!("{:GUTTER$}{from}{over:^middle$}{to}", ""));
    lines
}

/// Dots of a picture.
struct Dots {
    /// Number of dots across and upwards.
    size: [usize; 2],
    /// `[high][wide]`, from above.
    set: Vec<bool>,
}

impl Dots {
    fn new(size: [usize; 2]) -> Self {
        Self {
            size,
            set: vec![false; size[0] * size[1]],
        }
    }

    /// Draws a line through the points; the axes run over `x` and `y`.
    fn draw(&mut self, points: &[[f64; 2]], x: [f64; 2], y: [f64; 2]) {
        let [wide, high] = self.size;
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
                self.set[row * wide + column] = true;
            }
            before = Some(now);
        }
    }

    /// The number of the pattern of a character, of four rows and two columns of dots.
    fn pattern(&self, column: usize, row: usize) -> u32 {
        // The bits: three rows of the left and of the right column, then the fourth row.
        let bits: [[u32; 2]; 4] = [[0, 3], [1, 4], [2, 5], [6, 7]];
        let mut pattern = 0;
        for (down, bits) in bits.iter().enumerate() {
            for (right, bit) in bits.iter().enumerate() {
                let dot = self.set[(4 * row + down) * self.size[0] + 2 * column + right];
                pattern |= u32::from(dot) << bit;
            }
        }
        pattern
    }
}

/// The number of the dot at a value on an axis.
fn place(value: f64, ends: [f64; 2], size: usize) -> usize {
    let part = (value - ends[0]) / (ends[1] - ends[0]);
    ((part * (size - 1) as f64).round() as usize).min(size - 1)
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
