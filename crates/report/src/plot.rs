//! A pair of axes to draw on, with the SVG backend of plotters.

#![allow(
    clippy::missing_panics_doc,
    reason = "drawing into a string does not fail"
)]

use plotters::backend::{DrawingBackend, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontTransform, IntoFont, RGBColor, ShapeStyle, TextStyle};

use super::colour::{GREY, INK, PALE, Scale, WHITE};
use super::text::{escape, next_mark};
use super::ticks::{self, Tick};

/// Canvas units per pixel. plotters has integer coordinates only, so it draws on a larger canvas
/// that the SVG header scales down.
const CANVAS: f64 = 10.0;
const FONT: f64 = 13.0;
/// Height of a row of a legend (px).
const LEGEND_ROW: f64 = 20.0;
/// Height of the letters of the names of axes (px).
const LARGE_FONT: f64 = FONT + 1.0;
/// The beginning of every figure.
const NAMESPACE: &str = "<svg xmlns=\"http://www.w3.org/2000/svg\"";

/// Size of a figure and position of its axes (px).
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Width and height.
    pub size: [f64; 2],
    /// Margin outside the axes: left, top, right, bottom.
    pub margin: [f64; 4],
}

impl Layout {
    /// A layout of this size, with this margin on the left and usual ones elsewhere.
    pub const fn new(size: [f64; 2], left: f64) -> Self {
        let margin = [left, 36.0, 24.0, 58.0];
        Self { size, margin }
    }

    /// The layout with more room above the axes if a legend needs several rows.
    pub(crate) fn with_legend<'n>(self, names: impl Iterator<Item = &'n str>) -> Self {
        let rows = self.legend_rows(names).last().map_or(0, |(row, _)| *row);
        let more = LEGEND_ROW * rows as f64;
        let ([width, height], [left, top, right, bottom]) = (self.size, self.margin);
        Self {
            size: [width, height + more],
            margin: [left, top + more, right, bottom],
        }
    }

    /// The row of each entry of a legend, from 0 on, and its width (px); in several rows all are as
    /// wide as the widest.
    fn legend_rows<'n>(&self, names: impl Iterator<Item = &'n str>) -> Vec<(usize, f64)> {
        let room = self.size[0] - self.margin[0];
        let widths: Vec<f64> = names.map(legend_width).collect();
        if widths.iter().sum::<f64>() <= room {
            return widths.into_iter().map(|width| (0, width)).collect();
        }
        let widest = widths.iter().copied().fold(0.0, f64::max);
        let in_a_row = ((room / widest) as usize).max(1);
        let entries = 0..widths.len();
        entries.map(|k| (k / in_a_row, widest)).collect()
    }
}

/// Width of an entry of a legend, with the space after it (px).
fn legend_width(name: &str) -> f64 {
    let length = name.chars().filter(|c| !"_^{}".contains(*c)).count();
    28.0 + 7.2 * length as f64 + 22.0
}

/// A figure being drawn. Data coordinates run over `x` and `y`; sizes and line widths are in
/// pixels.
pub struct Plot<'a> {
    backend: SVGBackend<'a>,
    layout: Layout,
    x: [f64; 2],
    y: [f64; 2],
    /// How a page reads places off the axes, as attributes of the figure.
    readings: String,
}

/// Draws a figure and returns it as SVG. In text `_{…}` sets a subscript and `^{…}` a superscript.
pub fn figure(layout: Layout, x: [f64; 2], y: [f64; 2], draw: impl FnOnce(&mut Plot)) -> String {
    let mut svg = String::new();
    let size = layout.size.map(|side| (side * CANVAS) as u32);
    let mut plot = Plot {
        backend: SVGBackend::with_string(&mut svg, (size[0], size[1])),
        layout,
        x,
        y,
        readings: String::new(),
    };
    let whole = [[0.0, 0.0], layout.size];
    plot.pixel_box(whole, WHITE, 1.0);
    draw(&mut plot);
    certain(plot.backend.present());
    let readings = std::mem::take(&mut plot.readings);
    drop(plot);
    let [width, height] = layout.size;
    let body = svg.find('>').map_or("", |end| &svg[end + 1..]);
    let header = format!(
        "{NAMESPACE} width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {} {}\" \
         stroke-linejoin=\"round\" stroke-linecap=\"round\"{readings}>",
        size[0], size[1]
    );
    header + &without_defaults(&typeset(body))
}

/// The SVG without attributes that say what holds without them: a third of a map.
fn without_defaults(svg: &str) -> String {
    svg.replace(" opacity=\"1\"", "")
        .replace(" stroke=\"none\" stroke-width=\"1\"", "")
        .replace(" stroke=\"none\"", "")
}

/// Takes the outcome of drawing into the string.
fn certain<E: std::fmt::Debug>(drawn: Result<(), E>) {
    drawn.expect("drawing into a string does not fail");
}

impl Plot<'_> {
    /// Pixel of a data point.
    fn pixel(&self, point: [f64; 2]) -> [f64; 2] {
        let [x, y] = point;
        let [[left, top], [right, bottom]] = self.frame();
        [
            left + (right - left) * ((x - self.x[0]) / (self.x[1] - self.x[0])),
            bottom - (bottom - top) * ((y - self.y[0]) / (self.y[1] - self.y[0])),
        ]
    }

    /// Upper left and lower right corner of the axes (px).
    fn frame(&self) -> [[f64; 2]; 2] {
        let Layout {
            size: [width, height],
            margin: [left, top, right, bottom],
        } = self.layout;
        [[left, top], [width - right, height - bottom]]
    }

    /// Returns the number of pixels per unit of x.
    pub fn scale(&self) -> f64 {
        let [[left, _], [right, _]] = self.frame();
        (right - left) / (self.x[1] - self.x[0])
    }

    fn path(&self, points: &[[f64; 2]]) -> Vec<(i32, i32)> {
        let points = points.iter();
        points.map(|point| to_canvas(self.pixel(*point))).collect()
    }

    /// Draws a line through data points.
    pub fn line(&mut self, points: &[[f64; 2]], colour: RGBColor, width: f64) {
        let path = self.path(points);
        certain(self.backend.draw_path(path, &stroke(colour, width)));
    }

    /// Fills a polygon of data points.
    pub fn area(&mut self, points: &[[f64; 2]], colour: RGBColor, opacity: f64) {
        let path = self.path(points);
        certain(self.backend.fill_polygon(path, &colour.mix(opacity)));
    }

    /// Draws a disk around a data point, with an outline if given; `radius` in pixels.
    pub fn disk(
        &mut self,
        centre: [f64; 2],
        radius: f64,
        fill: RGBColor,
        outline: Option<RGBColor>,
    ) {
        let centre = to_canvas(self.pixel(centre));
        let radius = (radius * CANVAS).round() as u32;
        certain(self.backend.draw_circle(centre, radius, &fill, true));
        if let Some(outline) = outline {
            let line = stroke(outline, 0.5);
            certain(self.backend.draw_circle(centre, radius, &line, false));
        }
    }

    /// Draws a dashed vertical line over the whole height.
    pub fn vertical_line(&mut self, x: f64, colour: RGBColor) {
        let [[_, top], [_, bottom]] = self.frame();
        let [x, _] = self.pixel([x, self.y[0]]);
        let mut y = top;
        while y < bottom {
            self.pixel_line([[x, y], [x, (y + 5.0).min(bottom)]], colour, 1.2);
            y += 9.0;
        }
    }

    /// Fills a band over the whole height.
    pub fn band(&mut self, from: f64, to: f64, colour: RGBColor, opacity: f64) {
        let [[left, top], [right, bottom]] = self.frame();
        let [a, b] = [from, to].map(|x| self.pixel([x, self.y[0]])[0].clamp(left, right));
        self.pixel_box([[a, top], [b, bottom]], colour, opacity);
    }

    /// Writes text at the top beside a place on the x axis, on the side with more room.
    pub fn note(&mut self, x: f64, text: &str) {
        let [[left, top], [right, _]] = self.frame();
        let [x, _] = self.pixel([x, self.y[0]]);
        let (side, x) = if x > 0.5 * (left + right) {
            (HPos::Right, x - 7.0)
        } else {
            (HPos::Left, x + 7.0)
        };
        self.text([x, top + 8.0], text, (side, VPos::Top));
    }

    /// Paints over everything drawn outside the axes. To be called before [`Self::axes`].
    pub(crate) fn clip(&mut self) {
        let [[left, top], [right, bottom]] = self.frame();
        let [width, height] = self.layout.size;
        for edge in [
            [[0.0, 0.0], [left, height]],
            [[right, 0.0], [width, height]],
            [[0.0, 0.0], [width, top]],
            [[0.0, bottom], [width, height]],
        ] {
            self.pixel_box(edge, WHITE, 1.0);
        }
    }

    /// Draws pale lines at the ticks. To be called before the data are drawn.
    pub fn grid(&mut self, x: &[Tick], y: &[Tick]) {
        let [[left, top], [right, bottom]] = self.frame();
        for (value, _) in x {
            let [at, _] = self.pixel([*value, self.y[0]]);
            self.pixel_line([[at, top], [at, bottom]], PALE, 0.8);
        }
        for (value, _) in y {
            let [_, at] = self.pixel([self.x[0], *value]);
            self.pixel_line([[left, at], [right, at]], PALE, 0.8);
        }
    }

    /// Draws the edges of a box of pixels.
    fn outline(&mut self, corners: [[f64; 2]; 2], width: f64) {
        let [[left, top], [right, bottom]] = corners;
        let [a, b, c, d] = [[left, top], [right, top], [right, bottom], [left, bottom]];
        for side in [[a, b], [b, c], [c, d], [d, a]] {
            self.pixel_line(side, INK, width);
        }
    }

    /// Draws the axes with ticks and labels.
    pub fn axes(&mut self, x: &[Tick], y: &[Tick], x_label: &str, y_label: &str) {
        let [[left, top], [right, bottom]] = self.frame();
        let readings = [reading(x, self.x, x_label), reading(y, self.y, y_label)];
        if let [Some(x), Some(y)] = readings {
            let [left, top, right, bottom] = [left, top, right, bottom].map(|edge| edge * CANVAS);
            self.readings = format!(
                " data-frame=\"{left} {top} {right} {bottom}\" data-x=\"{x}\" data-y=\"{y}\""
            );
        }
        self.outline([[left, top], [right, bottom]], 1.0);
        for (value, label) in x {
            let [at, _] = self.pixel([*value, self.y[0]]);
            self.pixel_line([[at, bottom], [at, bottom + 5.0]], INK, 1.0);
            self.text([at, bottom + 9.0], label, (HPos::Center, VPos::Top));
        }
        for (value, label) in y {
            let [_, at] = self.pixel([self.x[0], *value]);
            self.pixel_line([[left - 5.0, at], [left, at]], INK, 1.0);
            self.text([left - 9.0, at], label, (HPos::Right, VPos::Center));
        }
        let below = [f64::midpoint(left, right), bottom + 30.0];
        let place = (HPos::Center, VPos::Top);
        self.text_in(font(LARGE_FONT, &INK), below, x_label, place);
        self.vertical_text([16.0, f64::midpoint(top, bottom)], y_label);
    }

    /// Draws colour samples and their names above the axes, from the left; in several rows if
    /// `Layout::with_legend` has made room for them.
    pub fn legend(&mut self, entries: &[(RGBColor, &str)]) {
        let [[left, top], _] = self.frame();
        let rows = self
            .layout
            .legend_rows(entries.iter().map(|(_, name)| *name));
        let above = rows.last().map_or(0, |(row, _)| *row);
        let has_room = top >= 2.0 * 14.0 + LEGEND_ROW * above as f64;
        let above = if has_room { above } else { 0 };
        let (mut x, mut last) = (left, 0);
        for ((colour, name), (row, width)) in entries.iter().zip(rows) {
            let (row, width) = if has_room {
                (row, width)
            } else {
                (0, legend_width(name))
            };
            x = if row == last { x } else { left };
            last = row;
            let y = top - 14.0 - LEGEND_ROW * (above - row) as f64;
            self.pixel_box([[x, y - 3.0], [x + 22.0, y + 3.0]], *colour, 1.0);
            self.text([x + 28.0, y], name, (HPos::Left, VPos::Center));
            x += width;
        }
    }

    /// Draws a colour bar to the right of the axes; `ticks` lie on 0 … 1.
    pub(crate) fn colour_bar(&mut self, scale: &Scale, ticks: &[Tick], label: &str) {
        const PIECES: usize = 128;
        let [[_, top], [right, bottom]] = self.frame();
        let (left, right) = (right + 18.0, right + 36.0);
        let height = bottom - top;
        // Pieces overlap: each reaches down to the end and is covered by the next, so that no seam
        // shows.
        for piece in (0..PIECES).rev() {
            let upper = bottom - height * (piece + 1) as f64 / PIECES as f64;
            let colour = scale.at((piece as f64 + 0.5) / PIECES as f64);
            self.pixel_box([[left, upper], [right, bottom]], colour, 1.0);
        }
        self.outline([[left, top], [right, bottom]], 0.8);
        for (value, text) in ticks {
            let y = bottom - height * value;
            self.pixel_line([[right, y], [right + 4.0, y]], INK, 0.8);
            self.text([right + 8.0, y], text, (HPos::Left, VPos::Center));
        }
        let x = self.layout.size[0] - 14.0;
        self.vertical_text([x, f64::midpoint(top, bottom)], label);
    }

    /// [`Self::colour_bar`] of values from `low` to `high`. `{}` in the label is the place of an SI
    /// prefix.
    pub(crate) fn colour_bar_of(&mut self, scale: &Scale, range: [f64; 2], label: &str) {
        let [low, high] = range;
        let (factor, prefix) = if label.contains("{}") {
            ticks::prefix(high.abs().max(low.abs()))
        } else {
            (1.0, "")
        };
        let [low, high] = [low * factor, high * factor];
        let ticks = ticks::on_bar(ticks::round(low, high, 6), low, high);
        self.colour_bar(scale, &ticks, &label.replace("{}", prefix));
    }

    /// Writes a line of text above the axes, left aligned.
    pub fn title(&mut self, text: &str) {
        let [[left, top], _] = self.frame();
        self.text([left, top - 14.0], text, (HPos::Left, VPos::Center));
    }

    /// Writes a line of text above the legend.
    pub fn heading(&mut self, text: &str) {
        let [[left, top], _] = self.frame();
        self.text([left, top - 36.0], text, (HPos::Left, VPos::Center));
    }

    /// Writes text in the middle of axes without data.
    pub(crate) fn empty_note(&mut self, text: &str) {
        let [[left, top], [right, bottom]] = self.frame();
        let middle = [f64::midpoint(left, right), f64::midpoint(top, bottom)];
        let place = (HPos::Center, VPos::Center);
        self.text_in(font(LARGE_FONT, &GREY), middle, text, place);
    }

    fn pixel_line(&mut self, ends: [[f64; 2]; 2], colour: RGBColor, width: f64) {
        let [from, to] = ends.map(to_canvas);
        certain(self.backend.draw_line(from, to, &stroke(colour, width)));
    }

    fn pixel_box(&mut self, corners: [[f64; 2]; 2], colour: RGBColor, opacity: f64) {
        let [a, b] = corners.map(to_canvas);
        certain(self.backend.draw_rect(a, b, &colour.mix(opacity), true));
    }

    fn text(&mut self, at: [f64; 2], text: &str, place: (HPos, VPos)) {
        self.text_in(font(FONT, &INK), at, text, place);
    }

    fn text_in(&mut self, style: TextStyle, at: [f64; 2], text: &str, (x, y): (HPos, VPos)) {
        let style = style.pos(Pos::new(x, y));
        certain(self.backend.draw_text(text, &style, to_canvas(at)));
    }

    fn vertical_text(&mut self, at: [f64; 2], text: &str) {
        let style = font(LARGE_FONT, &INK).transform(FontTransform::Rotate270);
        self.text_in(style, at, text, (HPos::Center, VPos::Center));
    }
}

/// Returns how a page reads an axis: whether its scale is logarithmic, the numbers at its ends in
/// the unit of the label, and the label. `None` if two ticks do not say.
fn reading(ticks: &[Tick], ends: [f64; 2], label: &str) -> Option<String> {
    let mut numbers = ticks.iter().filter_map(TickNumber::new);
    let (first, last) = (numbers.next()?, numbers.next_back()?);
    let (x0, x1) = (first.place, last.place);
    let (a, b) = (first.value, last.value);
    let [low, high] = ends.map(|x| a + (b - a) * (x - x0) / (x1 - x0));
    let kind = if first.is_logarithmic {
        "log"
    } else {
        "linear"
    };
    let plain: String = label.chars().filter(|c| !"^_{}".contains(*c)).collect();
    let label = escape(&plain);
    Some(format!("{kind} {low} {high} {label}"))
}

/// The number that a tick shows.
struct TickNumber {
    /// On the axis.
    place: f64,
    /// Whether the label is a power of ten, of which `value` is the exponent.
    is_logarithmic: bool,
    value: f64,
}

impl TickNumber {
    /// `None` of words.
    fn new(tick: &Tick) -> Option<Self> {
        let (place, text) = tick;
        let text = text.replace('−', "-");
        let exponent = text.strip_prefix("10^{");
        let value = match exponent {
            Some(exponent) => exponent.strip_suffix('}')?.parse().ok()?,
            // As 5·10^{-4}.
            None => {
                let text = text.replace("·10^{", "e");
                text.trim_end_matches('}').parse().ok()?
            }
        };
        Some(Self {
            place: *place,
            is_logarithmic: exponent.is_some(),
            value,
        })
    }
}

/// plotters divides font sizes by 1.24 for SVG; this undoes it.
fn font(size: f64, colour: &RGBColor) -> TextStyle<'_> {
    TextStyle::from(("Helvetica, Arial, sans-serif", size * 1.24 * CANVAS).into_font())
        .color(colour)
}

/// Converts pixels to canvas coordinates.
fn to_canvas(at: [f64; 2]) -> (i32, i32) {
    at.map(|x| (x * CANVAS).round() as i32).into()
}

fn stroke(colour: RGBColor, width: f64) -> ShapeStyle {
    ShapeStyle {
        color: colour.to_rgba(),
        filled: false,
        stroke_width: (width * CANVAS).round().max(1.0) as u32,
    }
}

/// Sets `_{…}` and `^{…}` as subscripts and superscripts. plotters ends every text with a line
/// break, so each line holds one text.
fn typeset(svg: &str) -> String {
    let mut out = String::with_capacity(svg.len());
    for line in svg.split_inclusive('\n') {
        let mut rest = line;
        let mut shifted = false;
        while let Some((before, mark, inner, after)) = next_mark(rest) {
            let (down, up) = if mark == '_' {
                ("0.3em", "-0.219em")
            } else {
                ("-0.55em", "0.4015em")
            };
            out.push_str(before);
            if shifted {
                out.push_str("</tspan>");
            }
            out.push_str(&format!(
                "<tspan dy=\"{down}\" font-size=\"0.73em\">{inner}</tspan>"
            ));
            shifted = !after.trim_end().is_empty();
            if shifted {
                out.push_str(&format!("<tspan dy=\"{up}\">"));
            }
            // Renderers drop a space at the beginning of a tspan; a no-break space stays.
            rest = after;
            if shifted && let Some(spaced) = after.strip_prefix(' ') {
                out.push('\u{a0}');
                rest = spaced;
            }
        }
        out.push_str(if shifted {
            rest.trim_end_matches('\n')
        } else {
            rest
        });
        if shifted {
            out.push_str("</tspan>\n");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_and_powers_are_set_and_undone() {
        let set = typeset("|Δτ_{p}|/r^{2}\n<a b_=\"c\"/>\n");
        let expected = "|Δτ<tspan dy=\"0.3em\" font-size=\"0.73em\">p</tspan><tspan dy=\"-0.219em\">|/r</tspan>\
                        <tspan dy=\"-0.55em\" font-size=\"0.73em\">2</tspan>\n<a b_=\"c\"/>\n";
        assert_eq!(set, expected);
    }

    #[test]
    fn points_land_on_their_pixels() {
        let layout = Layout {
            size: [200.0, 100.0],
            margin: [50.0, 10.0, 50.0, 40.0],
        };
        let svg = figure(layout, [0.0, 10.0], [-1.0, 1.0], |plot| {
            assert_eq!(plot.scale(), 10.0);
            plot.line(&[[0.0, -1.0], [10.0, 1.0], [5.0, 0.0]], INK, 2.0);
        });
        assert!(
            svg.contains("points=\"500,600 1500,100 1000,350 \""),
            "{svg}"
        );
        assert!(svg.contains("stroke-width=\"20\"") && svg.contains("viewBox=\"0 0 2000 1000\""));
    }

    /// The numbers at the ends of an axis, in the unit of its label.
    #[test]
    fn pages_read_axes_off_their_ticks() {
        let ticks = [(0.001, "−1".to_string()), (0.003, "1".to_string())];
        let read = reading(&ticks, [0.0, 0.004], "x_{a} (mm)");
        assert_eq!(read.unwrap(), "linear -2 2 xa (mm)");
        let decades = ticks::decades(-2.5, 1.0, 8);
        assert_eq!(reading(&decades, [-2.5, 1.0], "N").unwrap(), "log -2.5 1 N");
        assert_eq!(reading(&ticks[..1], [0.0, 1.0], "x"), None);
        let words = [(0.0, "a".into()), (1.0, "b".into())];
        assert_eq!(reading(&words, [0.0, 1.0], "x"), None);
    }
}
