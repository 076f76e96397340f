//! Movies of a run: the pictures of a report, frame after frame on the same scales.

use rayon::prelude::*;
use resvg::tiny_skia::Pixmap;

use super::drawing;
pub use super::frame_picture::Field;
use super::frame_picture::FramePicture;
use super::map::{self, Map};
use super::packing::Packing;
use gshear_analysis::dmin;
use gshear_analysis::moments::{distinct, extent};
use gshear_dem::failure::Result;
use gshear_dem::state::Frame;
use gshear_scene::Dimensions;
use gshear_store::run_reader::{RunFile, RunStage};

/// Most pixels across a movie unless more are asked for.
pub const WIDEST: u32 = 1280;

/// The pixels of a frame, three bytes each, by rows from above.
pub struct Picture {
    /// Width and height; even, as films need them.
    pub size: [u32; 2],
    /// Red, green and blue.
    pub rgb: Vec<u8>,
}

/// A frame that is drawn.
struct Shown {
    number: usize,
    frame: Frame,
    /// `[N]` D²min since the frame before (m²), NaN without one; empty if it is not drawn.
    dmin: Vec<f64>,
}

/// The frames of a movie, and what is the same in all of them.
pub struct Movie<'a> {
    run: &'a RunFile,
    fields: Vec<Field>,
    numbers: Vec<usize>,
    /// Distance of the numbers.
    stride: usize,
    strains: Vec<f64>,
    /// What is seen: ranges across and upwards (m).
    view: [[f64; 2]; 2],
    /// Ends of the scales, as of `fields`.
    ranges: Vec<[f64; 2]>,
}

impl<'a> Movie<'a> {
    /// Finds the view and the scales that hold all frames of these numbers. Reads every frame.
    ///
    /// # Errors
    /// A damaged run.
    pub fn new(run: &'a RunFile, fields: &[Field], numbers: Vec<usize>) -> Result<Self> {
        let stride = numbers.windows(2).map(|pair| pair[1] - pair[0]).next();
        let fields = distinct(fields.iter().copied());
        let mut movie = Self {
            run,
            ranges: vec![extent([]); fields.len()],
            fields,
            stride: stride.unwrap_or(1),
            numbers,
            strains: run.frame_strains()?,
            view: [extent([]); 2],
        };
        let mut whole = Extents {
            view: movie.view,
            ranges: movie.ranges.clone(),
        };
        movie.each(|movie, frames| {
            frames
                .iter()
                .for_each(|shown| movie.extend(&mut whole, shown));
            Ok(())
        })?;
        (movie.view, movie.ranges) = (whole.view, whole.ranges);
        Ok(movie)
    }

    /// Whether its pictures have no shades, as those of spheres have.
    pub fn is_flat(&self) -> bool {
        self.run.dimension() == Dimensions::Two
    }

    /// The number of frames.
    pub fn frames(&self) -> usize {
        self.numbers.len()
    }

    /// Draws the frames, on all threads, and passes them to `write` one after the other. `width` in
    /// pixels; `None` for that of the pictures, up to [`WIDEST`].
    ///
    /// # Errors
    /// A damaged run, those of `write`.
    pub fn draw(
        &self,
        width: Option<u32>,
        mut write: impl FnMut(Picture) -> Result<()>,
    ) -> Result<()> {
        self.each(|movie, frames| {
            let drawn = frames.par_iter().map(|shown| movie.picture(shown, width));
            let mut drawn = drawn.collect::<Result<Vec<_>, _>>()?.into_iter();
            drawn.try_for_each(&mut write)
        })
    }

    /// Reads the frames, as many at a time as there are threads.
    fn each(&self, mut take: impl FnMut(&Self, &[Shown]) -> Result<()>) -> Result<()> {
        let has_dmin = self.fields.contains(&Field::Dmin);
        let mut last: Option<(usize, Frame)> = None;
        if has_dmin && let Some(number) = self.numbers[0].checked_sub(self.stride) {
            last = Some((number, self.run.frame(number)?));
        }
        for numbers in self.numbers.chunks(rayon::current_num_threads().max(1)) {
            let read = numbers.iter().map(|number| self.run.frame(*number));
            let read = read.collect::<Result<Vec<_>>>()?;
            // The first of them is the one before these.
            let earlier = last.iter().map(|(number, frame)| (*number, frame));
            let all: Vec<(usize, &Frame)> =
                earlier.chain(numbers.iter().copied().zip(&read)).collect();
            let before = all.len() - numbers.len();
            let places = (0..numbers.len()).into_par_iter();
            let dmin = places.map(|k| match (has_dmin, (before + k).checked_sub(1)) {
                (false, _) => Vec::new(),
                (true, Some(earlier)) => self.dmin(all[earlier], all[before + k]),
                (true, None) => vec![f64::NAN; self.run.grains().count()],
            });
            let dmin: Vec<Vec<f64>> = dmin.collect();
            let frames = numbers.iter().zip(read).zip(dmin);
            let frames = frames.map(|((&number, frame), dmin)| Shown {
                number,
                frame,
                dmin,
            });
            let mut frames: Vec<Shown> = frames.collect();
            take(self, &frames)?;
            last = frames.pop().map(|shown| (shown.number, shown.frame));
        }
        Ok(())
    }

    /// Returns D²min between two frames, each with its number, `[N]` (m²).
    fn dmin(&self, earlier: (usize, &Frame), later: (usize, &Frame)) -> Vec<f64> {
        let interval = self
            .run
            .interval([earlier.0, later.0], [earlier.1, later.1]);
        dmin::between(self.run.grains(), &interval)
    }

    /// Disks between walls are drawn as maps, all else as seen from outside.
    fn frame_picture<'f>(&'f self, frame: &'f Frame) -> Box<dyn FramePicture + 'f> {
        if !self.run.has_disks_between_walls() {
            return Box::new(Packing::new(self.run, frame));
        }
        let grains = self.run.grains();
        let centre = [0.5 * frame.cell.periods[0], 0.5 * self.run.height()];
        let view = map::view_of(grains, frame, centre);
        Box::new(Map::new(grains, frame, view))
    }

    /// Extends a view and scales to those of a frame.
    fn extend(&self, whole: &mut Extents, shown: &Shown) {
        let picture = self.frame_picture(&shown.frame);
        for (all, own) in whole.view.iter_mut().zip(picture.view()) {
            *all = joined(*all, own);
        }
        for (all, field) in whole.ranges.iter_mut().zip(&self.fields) {
            *all = joined(*all, picture.range(*field, &shown.dmin));
        }
    }

    /// The pictures of a frame, below each other if they are wide, else side by side.
    fn picture(&self, shown: &Shown, width: Option<u32>) -> Result<Picture> {
        let fields = self.fields.iter().zip(&self.ranges);
        let drawn = fields.map(|(field, range)| self.drawn(*field, *range, shown));
        let drawn: Vec<String> = drawn.collect();
        let mut parts = rasterised(&drawn, 1.0)?;
        let below = 2 * parts[0].width() >= 3 * parts[0].height();
        let own = size_of(&parts, below)[0];
        let width = width.unwrap_or(own.min(WIDEST));
        if width != own {
            parts = rasterised(&drawn, width as f32 / own as f32)?;
        }
        let whole = size_of(&parts, below);
        let size = whole.map(|side| side + side % 2);
        let mut rgb = vec![255; 3 * size[0] as usize * size[1] as usize];
        let mut corner = [0, 0];
        for part in &parts {
            for (k, pixel) in part.pixels().iter().enumerate() {
                let [x, y] = [k as u32 % part.width(), k as u32 / part.width()];
                let at = ((corner[1] + y) * size[0] + corner[0] + x) as usize;
                rgb[3 * at..][..3].copy_from_slice(&[pixel.red(), pixel.green(), pixel.blue()]);
            }
            let axis = usize::from(below);
            corner[axis] += [part.width(), part.height()][axis];
        }
        Ok(Picture { size, rgb })
    }

    fn title(&self, number: usize) -> String {
        let time = self.run.frame_times()[number];
        match self.run.stage() {
            RunStage::Shear if !self.run.boundary().has_top() => {
                format!("frame {number}, time {time:.4e} s")
            }
            RunStage::Newtonian => format!("frame {number}, time {time:.4e}"),
            _ => format!("frame {number}, γ = {:.3} %", 100.0 * self.strains[number]),
        }
    }

    /// A picture as SVG.
    fn drawn(&self, field: Field, range: [f64; 2], shown: &Shown) -> String {
        // Without a defined value any scale will do.
        let has_values = range[0] < range[1];
        let range = if has_values { range } else { [0.0, 1.0] };
        let mut picture = self.frame_picture(&shown.frame);
        picture.set_view(self.view);
        picture.draw(field, range, &shown.dmin, &self.title(shown.number))
    }
}

/// The view and the scales of some frames.
struct Extents {
    /// Ranges across and upwards (m).
    view: [[f64; 2]; 2],
    /// Ends of the scales, by field.
    ranges: Vec<[f64; 2]>,
}

/// The range of two ranges together, as far as they are finite.
fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    extent(a.into_iter().chain(b).filter(|x| x.is_finite()))
}

/// The pixels of figures, on this scale.
fn rasterised(figures: &[String], scale: f32) -> Result<Vec<Pixmap>> {
    let figures = figures.iter();
    figures.map(|svg| drawing::pixels(svg, scale)).collect()
}

/// Width and height of pictures below each other, or side by side.
fn size_of(parts: &[Pixmap], below: bool) -> [u32; 2] {
    let widths = parts.iter().map(Pixmap::width);
    let heights = parts.iter().map(Pixmap::height);
    if below {
        [widths.max().unwrap_or(0), heights.sum()]
    } else {
        [widths.sum(), heights.max().unwrap_or(0)]
    }
}
