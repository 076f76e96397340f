//! Movies of a run: the pictures of a report, frame after frame on the same scales.

use std::str::FromStr;

use rayon::prelude::*;
use resvg::tiny_skia::Pixmap;

use super::drawing;
use super::map::{self, Map};
use super::picture::{self, Packing};
use gshear_analysis::dmin::{self, RADIUS};
use gshear_analysis::event;
use gshear_analysis::moments::{distinct, extent};
use gshear_dem::failure::Result;
use gshear_dem::state::{Frame, FrameRecords};
use gshear_scene::Dimensions;
use gshear_store::run_reader::{RunFile, RunStage};

/// Most pixels across a movie unless more are asked for.
pub const WIDEST: u32 = 1280;

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Normal forces of the contacts.
    Force,
    /// D²min of the grains since the frame before.
    Dmin,
    /// Velocity of the grains along x.
    Velocity,
}

impl FromStr for Field {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "force" => Ok(Self::Force),
            "dmin" => Ok(Self::Dmin),
            "velocity" => Ok(Self::Velocity),
            _ => Err("write force, dmin or velocity".into()),
        }
    }
}

/// The pixels of a frame, three bytes each, by rows from above.
pub struct Picture {
    /// Width and height; even, as films need them.
    pub size: [u32; 2],
    /// Red, green and blue.
    pub rgb: Vec<u8>,
}

/// The grains of a frame, as far as pictures need them.
enum Content {
    /// Disks between walls, which are drawn as maps.
    Disks(Frame),
    /// Anything else.
    Packing(FrameRecords),
}

/// A frame that is drawn.
struct Shown {
    number: usize,
    content: Content,
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
        let (mut view, mut ranges) = (movie.view, movie.ranges.clone());
        movie.each(|movie, frames| {
            for shown in frames {
                let (seen, found) = movie.extents(shown);
                let all = view.iter_mut().chain(&mut ranges);
                for (all, own) in all.zip(seen.into_iter().chain(found)) {
                    *all = extent(all.iter().copied().chain(own).filter(|x| x.is_finite()));
                }
            }
            Ok(())
        })?;
        (movie.view, movie.ranges) = (view, ranges);
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
        let read = |number: usize| Ok((number, self.read(number)?));
        let before = self.numbers[0].checked_sub(self.stride);
        let mut last = before.filter(|_| has_dmin).map(read).transpose()?;
        for numbers in self.numbers.chunks(rayon::current_num_threads().max(1)) {
            let contents = numbers.iter().map(|number| self.read(*number));
            let contents = contents.collect::<Result<Vec<_>>>()?;
            let before = |k: usize| match k.checked_sub(1) {
                Some(k) => Some((numbers[k], &contents[k])),
                None => last.as_ref().map(|(number, content)| (*number, content)),
            };
            let dmin = |k: usize| match before(k) {
                _ if !has_dmin => Vec::new(),
                Some((at, before)) => self.dmin([at, numbers[k]], [before, &contents[k]]),
                None => vec![f64::NAN; self.run.grains().count()],
            };
            let dmin: Vec<Vec<f64>> = (0..numbers.len()).into_par_iter().map(dmin).collect();
            let frames = numbers.iter().zip(contents).zip(dmin);
            let frames = frames.map(|((&number, content), dmin)| Shown {
                number,
                content,
                dmin,
            });
            let mut frames: Vec<Shown> = frames.collect();
            take(self, &frames)?;
            last = frames.pop().map(|shown| (shown.number, shown.content));
        }
        Ok(())
    }

    fn read(&self, number: usize) -> Result<Content> {
        Ok(if self.is_map() {
            Content::Disks(self.run.frame(number)?)
        } else {
            Content::Packing(self.run.records(number..number + 1)?.swap_remove(0))
        })
    }

    fn is_map(&self) -> bool {
        self.run.dimension() == Dimensions::Two && self.run.has_walls()
    }

    /// Returns D²min between two frames, `[N]` (m²).
    fn dmin(&self, numbers: [usize; 2], frames: [&Content; 2]) -> Vec<f64> {
        let grains = self.run.grains();
        match frames {
            [Content::Disks(before), Content::Disks(now)] => dmin::between(grains, before, now),
            [Content::Packing(before), Content::Packing(now)] => {
                let interval = self.run.interval(numbers, [before, now]);
                let radius = RADIUS * grains.mean_radius();
                event::between_frames(self.run.dimension().axes(), grains, &interval, radius)
            }
            _ => unreachable!("all frames are of one kind"),
        }
    }

    /// The view of a frame, and the ranges of the fields.
    fn extents(&self, shown: &Shown) -> ([[f64; 2]; 2], Vec<[f64; 2]>) {
        let is_undefined = shown.dmin.iter().all(|x| x.is_nan());
        match &shown.content {
            Content::Disks(frame) => {
                let grains = self.run.grains();
                let centre = [0.5 * grains.length, 0.5 * self.run.height()];
                let view = map::view_of(grains, frame, centre);
                let map = Map::new(grains, frame, view);
                let range = |field: &Field| match field {
                    Field::Force => [0.0, map::scale_of_forces(&[frame])],
                    Field::Dmin if is_undefined => [f64::NAN; 2],
                    Field::Dmin => map.range_of_dmin(&shown.dmin),
                    Field::Velocity => picture::range_of(frame.velocity.iter().map(|v| v[0])),
                };
                (view, self.fields.iter().map(range).collect())
            }
            Content::Packing(frame) => {
                let packing = Packing::new(self.run, frame);
                let range = |field: &Field| match field {
                    Field::Force => [0.0, packing.greatest_force()],
                    Field::Dmin if is_undefined => [f64::NAN; 2],
                    Field::Dmin => packing.range_of_levels(&self.values(*field, shown, frame)),
                    Field::Velocity => packing.range_of(&self.values(*field, shown, frame)),
                };
                (packing.view, self.fields.iter().map(range).collect())
            }
        }
    }

    /// The values of the grains that a picture of a packing shows.
    fn values(&self, field: Field, shown: &Shown, frame: &FrameRecords) -> Vec<f64> {
        let square = self.run.grains().mean_radius().powi(2);
        match field {
            Field::Dmin => shown.dmin.iter().map(|d| (d / square).log10()).collect(),
            _ => frame.grains.iter().map(|grain| grain.velocity[0]).collect(),
        }
    }

    /// The pictures of a frame, below each other if they are wide, else side by side.
    fn picture(&self, shown: &Shown, width: Option<u32>) -> Result<Picture> {
        let fields = self.fields.iter().zip(&self.ranges);
        let drawn = fields.map(|(field, range)| self.drawn(*field, *range, shown));
        let drawn: Vec<String> = drawn.collect();
        let pixels = |scale: f32| -> Result<Vec<Pixmap>> {
            let drawn = drawn.iter();
            drawn.map(|svg| drawing::pixels(svg, scale)).collect()
        };
        let mut parts = pixels(1.0)?;
        let below = 2 * parts[0].width() >= 3 * parts[0].height();
        let own = size_of(&parts, below)[0];
        let width = width.unwrap_or(own.min(WIDEST));
        if width != own {
            parts = pixels(width as f32 / own as f32)?;
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
            RunStage::Shear if self.run.has_free_surface() => {
                format!("frame {number}, time {time:.4e} s")
            }
            RunStage::Newtonian => format!("frame {number}, time {time:.4e}"),
            _ => format!("frame {number}, γ = {:.3} %", 100.0 * self.strains[number]),
        }
    }

    /// A picture as SVG.
    fn drawn(&self, field: Field, range: [f64; 2], shown: &Shown) -> String {
        let title = self.title(shown.number);
        // Without a defined value any scale will do.
        let has_values = range[0] < range[1];
        let range = if has_values { range } else { [0.0, 1.0] };
        match &shown.content {
            Content::Disks(frame) => {
                let map = Map::new(self.run.grains(), frame, self.view);
                match field {
                    Field::Force => map.forces(range[1], &title),
                    Field::Dmin => map.dmin(&shown.dmin, range, &title),
                    Field::Velocity => map.velocity(range, &title),
                }
            }
            Content::Packing(frame) => {
                let mut packing = Packing::new(self.run, frame);
                (packing.view, packing.title) = (self.view, title);
                let label = match field {
                    Field::Force => return packing.forces(range[1]),
                    Field::Dmin => ("log_{10} D²_{min}/r̄²", ""),
                    Field::Velocity => ("velocity along x", "m/s"),
                };
                packing.grains(&self.values(field, shown, frame), range, label)
            }
        }
    }
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
