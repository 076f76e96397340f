//! Files of figures: SVG for pages and the web, PDF for papers, PNG for slides.

use std::borrow::Cow;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Arc, LazyLock};

use gshear_dem::failure::{Failure, Result};
use gshear_store::text_writer;
use rayon::prelude::*;
use resvg::tiny_skia::{Pixmap, Transform};
use svg2pdf::usvg::{Options, Tree, fontdb::Database};
use svg2pdf::{ConversionOptions, PageOptions};
use ttf_parser::Face;

/// Pixels of a PNG per pixel of the figure, if that gives no more than these pixels.
const SCALE: f32 = 2.0;
const MOST_PIXELS: f32 = 3e6;

/// The fonts of PDF and PNG, which are the same on every machine.
static FONTS: LazyLock<Arc<Database>> = LazyLock::new(|| {
    let mut fonts = Database::new();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans::bold().to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    Arc::new(fonts)
});

/// The format of a file of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// For pages.
    Svg,
    /// For papers.
    Pdf,
    /// For slides.
    Png,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Svg, Self::Pdf, Self::Png];

    /// How the names of its files end.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Svg => "svg",
            Self::Pdf => "pdf",
            Self::Png => "png",
        }
    }

    /// The content of the file of a figure.
    fn drawn(self, svg: &str) -> Result<Vec<u8>, Box<dyn Error>> {
        match self {
            Self::Svg => Ok(svg.into()),
            Self::Pdf => {
                let (pages, options) = (PageOptions::default(), ConversionOptions::default());
                let pdf = svg2pdf::to_pdf(&tree(svg)?, options, pages);
                Ok(in_order(&pdf.map_err(|e| e.to_string())?))
            }
            Self::Png => {
                let tree = tree(svg)?;
                let area = tree.size().width() * tree.size().height();
                let scale = SCALE.min((MOST_PIXELS / area).sqrt()).max(1.0);
                Ok(rendered(&tree, scale)?.encode_png()?)
            }
        }
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let format = Self::ALL.into_iter().find(|format| format.ending() == text);
        format.ok_or_else(|| "must be svg, pdf or png".into())
    }
}

/// Writes figures (path that ends in `.svg`, and the SVG) in some formats. Returns the number of
/// files.
///
/// # Errors
/// If a file cannot be written.
pub fn write_all(figures: &[(PathBuf, &str)], formats: &[Format]) -> Result<usize> {
    let written = figures
        .par_iter()
        .map(|(path, svg)| write(path, svg, formats));
    written.sum()
}

/// [`write_all`] of one figure.
///
/// # Errors
/// If a file cannot be written.
pub fn write(path: &Path, svg: &str, formats: &[Format]) -> Result<usize> {
    for format in formats {
        let drawn = format
            .drawn(svg)
            .map_err(|why| Failure::other(format!("{}: cannot be drawn: {why}", path.display())))?;
        text_writer::write(&path.with_extension(format.ending()), drawn)?;
    }
    Ok(formats.len())
}

fn tree(svg: &str) -> Result<Tree, svg2pdf::usvg::Error> {
    let options = Options {
        fontdb: FONTS.clone(),
        font_family: "DejaVu Sans".into(),
        ..Options::default()
    };
    Tree::from_str(&with_macrons_apart(svg), &options)
}

fn rendered(tree: &Tree, scale: f32) -> Result<Pixmap, &'static str> {
    let size = tree.size().to_int_size();
    let [width, height] =
        [size.width(), size.height()].map(|length| (length as f32 * scale) as u32);
    let pixels = Pixmap::new(width, height);
    let mut pixels = pixels.ok_or("it has no size")?;
    let enlarged = Transform::from_scale(scale, scale);
    resvg::render(tree, enlarged, &mut pixels.as_mut());
    Ok(pixels)
}

/// Returns the pixels of a figure, `scale` of them per pixel of the figure.
///
/// # Errors
/// A drawing without a size.
pub fn pixels(svg: &str, scale: f32) -> Result<Pixmap> {
    let pixels = match tree(svg) {
        Ok(tree) => rendered(&tree, scale).map_err(str::to_string),
        Err(why) => Err(why.to_string()),
    };
    pixels.map_err(|why| Failure::other(format!("cannot be drawn: {why}")))
}

/// The PDF with the lines of a dictionary that lead to other objects in order: svg2pdf writes those
/// of the resources in the order of a hash map, which differs from run to run. No object moves.
fn in_order(pdf: &[u8]) -> Vec<u8> {
    let mut lines: Vec<&[u8]> = pdf.split_inclusive(|&byte| byte == b'\n').collect();
    for entries in lines.chunk_by_mut(|a, b| is_reference(a) && is_reference(b)) {
        entries.sort_unstable();
    }
    lines.concat()
}

/// Whether a line of a dictionary leads to another object.
fn is_reference(line: &[u8]) -> bool {
    line.starts_with(b"  ") && line.ends_with(b" 0 R\n")
}

/// Combined with the letter before it, and by itself.
const COMBINING_MACRON: char = '\u{304}';
const MACRON: char = 'ˉ';

/// The SVG with macrons as characters of their own in texts with indices or powers.
///
/// usvg 0.45 loses what consists of several glyphs, such as r̄, behind a `tspan`
/// (<https://github.com/linebender/resvg/pull/929>). 0.46 does not, but svg2pdf does not take it
/// yet.
fn with_macrons_apart(svg: &str) -> Cow<'_, str> {
    if !svg.contains(COMBINING_MACRON) {
        return Cow::Borrowed(svg);
    }
    let mut out = String::with_capacity(svg.len() + 200);
    for line in svg.split_inclusive('\n') {
        // A text is a line of its own.
        if line.starts_with('<') || !line.contains("<tspan") {
            out.push_str(line);
            continue;
        }
        for part in line.split_inclusive('>') {
            let (text, tag) = part.split_at(part.find('<').unwrap_or(part.len()));
            let mut letters = text.chars().peekable();
            while let Some(letter) = letters.next() {
                out.push(letter);
                if letters.next_if_eq(&COMBINING_MACRON).is_some() {
                    out.push_str(&macron_over(letter));
                }
            }
            out.push_str(tag);
        }
    }
    Cow::Owned(out)
}

/// A macron, moved back over the middle of the letter before it; what follows begins behind the
/// letter.
fn macron_over(letter: char) -> String {
    let face = Face::parse(dejavu::sans::regular(), 0).expect("the font is sound");
    let em = f64::from(face.units_per_em());
    let glyphs = [letter, MACRON].map(|letter| face.glyph_index(letter).unwrap_or_default());
    let [wide, bar] =
        glyphs.map(|glyph| f64::from(face.glyph_hor_advance(glyph).unwrap_or_default()) / em);
    let [back, on] = [-f64::midpoint(wide, bar), (wide - bar) / 2.0];
    let bounds = face.glyph_bounding_box(glyphs[0]);
    let top = bounds.map_or(0, |bounds| bounds.y_max);
    let higher = (top - face.x_height().unwrap_or(top)).max(0);
    let lift = f64::from(higher) / em;
    // The second shift needs a character, here one of no width.
    format!(
        "<tspan dx=\"{back:.4}em {on:.4}em\" dy=\"-{lift:.4}em {lift:.4}em\">{MACRON}\u{200b}</tspan>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::SLIP;
    use crate::plot::{Layout, figure};
    use plotters::style::RGBColor;

    /// The pixels of the PNG, and the PDF, of a figure.
    fn written(svg: &str) -> (Pixmap, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.svg");
        assert_eq!(write(&path, svg, &Format::ALL).unwrap(), 3);
        let image = Pixmap::load_png(path.with_extension("png")).unwrap();
        (image, std::fs::read(path.with_extension("pdf")).unwrap())
    }

    /// A figure has its size, its text and its colours in every format.
    #[test]
    fn every_format_shows_the_figure() {
        let layout = Layout {
            size: [300.0, 200.0],
            margin: [50.0, 20.0, 20.0, 50.0],
        };
        let svg = figure(layout, [0.0, 1.0], [0.0, 1.0], |plot| {
            plot.disk([0.5, 0.5], 20.0, SLIP, None);
            plot.axes(&[], &[], "γ", "|Δτ_{p}| (Pa)");
        });
        let (image, pdf) = written(&svg);
        assert_eq!((image.width(), image.height()), (600, 400));
        // The middle of the axes: (50 + 115, 20 + 65) px.
        let middle = image.pixel(330, 170).unwrap();
        let middle = RGBColor(middle.red(), middle.green(), middle.blue());
        assert_eq!(middle, SLIP);
        let dark = |x: u32, y: u32| image.pixel(x, y).is_some_and(|p| p.red() < 128);
        let below = (0..600).filter(|x| (360..400).any(|y| dark(*x, y))).count();
        assert!(below > 5, "no letter below the axis");
        assert!(pdf.starts_with(b"%PDF-"));
        let has = |part: &[u8]| pdf.windows(part.len()).any(|at| at == part);
        assert!(has(b"DejaVuSans"), "the font is embedded");
        assert!(has(b"/MediaBox [0 0 300 200]") || has(b"/MediaBox[0 0 300 200]"));
    }

    /// Transparent groups are objects of their own.
    #[test]
    fn a_pdf_is_the_same_every_time() {
        let group =
            |k: u32| format!("<g opacity=\"0.{k}\"><circle r=\"{k}\"/><circle r=\"2\"/></g>");
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"30\" height=\"30\">{}</svg>",
            (11..40).map(group).collect::<String>()
        );
        assert_eq!(written(&svg).1, written(&svg).1);
    }

    /// Pixels of a text of 40 px, darker than half.
    fn inked(text: &str) -> Vec<bool> {
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"300\" height=\"80\">\n\
             <rect width=\"300\" height=\"80\" fill=\"white\"/>\n\
             <text x=\"10\" y=\"60\" font-size=\"40\" font-family=\"sans-serif\">\n{text}\n</text>\n</svg>\n"
        );
        let pixels = written(&svg).0;
        pixels.pixels().iter().map(|p| p.red() < 128).collect()
    }

    /// The same pixels behind an index as in a text without one, but for a macron that lies about a
    /// pixel from where the font has it.
    #[test]
    fn letters_with_a_macron_are_drawn_behind_an_index() {
        let plain = inked("a/r\u{304}²x");
        let behind = inked("a<tspan dy=\"0em\">/r\u{304}²x</tspan>");
        let bare = inked("a/r²x");
        let differ =
            |one: &[bool], other: &[bool]| one.iter().zip(other).filter(|(a, b)| a != b).count();
        let macron = differ(&plain, &bare);
        assert!(macron > 100, "{macron}");
        let apart = differ(&plain, &behind);
        assert!(4 * apart < 3 * macron, "{apart} of {macron}");
    }
}
