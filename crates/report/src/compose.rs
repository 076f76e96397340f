//! Figures composed of several figures.

use super::plot::NAMESPACE;

/// Returns a figure with `figures` in rows of `columns`; an empty one leaves its place blank.
pub fn grid_of(columns: usize, figures: &[String]) -> String {
    let sizes: Vec<[f64; 2]> = figures.iter().map(|figure| size_of(figure)).collect();
    let widest = |column: usize| {
        sizes
            .iter()
            .skip(column)
            .step_by(columns)
            .map(|s| s[0])
            .fold(0.0, f64::max)
    };
    let widths: Vec<f64> = (0..columns).map(widest).collect();
    let mut body = String::new();
    let mut y = 0.0;
    for (row, sizes) in figures.chunks(columns).zip(sizes.chunks(columns)) {
        let mut x = 0.0;
        for (figure, width) in row.iter().zip(&widths) {
            body += &figure.replacen(NAMESPACE, &format!("<svg x=\"{x}\" y=\"{y}\""), 1);
            x += width;
        }
        y += sizes.iter().map(|size| size[1]).fold(0.0, f64::max);
    }
    let width: f64 = widths.iter().sum();
    format!(
        "{NAMESPACE} width=\"{width}\" height=\"{y}\" viewBox=\"0 0 {width} {y}\">{body}</svg>\n"
    )
}

/// Width and height from the header of a figure.
fn size_of(svg: &str) -> [f64; 2] {
    ["width", "height"].map(|name| {
        let value = svg.split(&format!(" {name}=\"")).nth(1);
        let value = value.and_then(|rest| rest.split('"').next());
        value.and_then(|value| value.parse().ok()).unwrap_or(0.0)
    })
}

/// Joins consecutive disks of one colour without outline into one path, which halves the size of a
/// map.
pub fn gathered(svg: &str) -> String {
    let mut out = String::with_capacity(svg.len());
    let mut open: Option<&str> = None;
    for line in svg.split_inclusive('\n') {
        let disk = disk_of(line.trim_end());
        let fill = disk.map(|(.., fill)| fill);
        if open != fill && open.is_some() {
            out.push_str("\"/>\n");
        }
        if let Some((x, y, radius, fill)) = disk {
            if open != Some(fill) {
                out.push_str(&format!("<path fill=\"{fill}\" d=\""));
            }
            let (left, across) = (x - radius, 2 * radius);
            out.push_str(&format!(
                "M{left},{y}a{radius},{radius} 0 1 0 {across},0a{radius},{radius} 0 1 0 -{across},0"
            ));
        } else {
            out.push_str(line);
        }
        open = fill;
    }
    out
}

/// Centre, radius and fill, if the line of SVG is an opaque disk without outline.
fn disk_of(line: &str) -> Option<(i64, i64, i64, &str)> {
    let rest = line.strip_prefix("<circle cx=\"")?;
    let rest = rest.strip_suffix("\" stroke=\"none\" stroke-width=\"1\"/>")?;
    let (x, rest) = rest.split_once("\" cy=\"")?;
    let (y, rest) = rest.split_once("\" r=\"")?;
    let (radius, fill) = rest.split_once("\" opacity=\"1\" fill=\"")?;
    Some((x.parse().ok()?, y.parse().ok()?, radius.parse().ok()?, fill))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(width: f64, height: f64) -> String {
        format!("{NAMESPACE} width=\"{width}\" height=\"{height}\" viewBox=\"0 0 1 1\"></svg>\n")
    }

    #[test]
    fn figures_stand_in_rows_as_high_and_columns_as_wide_as_their_greatest() {
        let parts = [
            figure(100.0, 50.0),
            figure(80.0, 70.0),
            String::new(),
            figure(90.0, 20.0),
        ];
        let svg = grid_of(2, &parts);
        assert_eq!(size_of(&svg), [190.0, 90.0]);
        for place in ["x=\"0\" y=\"0\"", "x=\"100\" y=\"0\"", "x=\"100\" y=\"70\""] {
            assert_eq!(svg.matches(place).count(), 1, "{place}: {svg}");
        }
        assert_eq!(svg.matches("xmlns").count(), 1);
    }

    #[test]
    fn disks_of_a_colour_become_one_path_and_the_rest_stays() {
        let disk = |x: i64, fill: &str| {
            format!(
                "<circle cx=\"{x}\" cy=\"7\" r=\"3\" opacity=\"1\" fill=\"{fill}\" stroke=\"none\" stroke-width=\"1\"/>\n"
            )
        };
        let line = "<polyline points=\"1,2\"/>\n";
        let svg = disk(10, "#AAAAAA") + &disk(20, "#AAAAAA") + &disk(30, "#BBBBBB") + line;
        let circle = |left: i64| format!("M{left},7a3,3 0 1 0 6,0a3,3 0 1 0 -6,0");
        let wanted = format!(
            "<path fill=\"#AAAAAA\" d=\"{}{}\"/>\n<path fill=\"#BBBBBB\" d=\"{}\"/>\n{line}",
            circle(7),
            circle(17),
            circle(27)
        );
        assert_eq!(gathered(&svg), wanted);
    }
}
