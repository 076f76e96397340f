//! Files of movies: MP4 through ffmpeg, or an animated PNG with its frames as a numbered series.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use png::{
    AdaptiveFilterType, BitDepth, ColorType, Compression, Encoder, EncodingError, FilterType,
    Writer,
};

use super::movie::Picture;
use gshear_dem::failure::Result;
use gshear_store::disk::unwritten;
use gshear_store::text_writer::{self, PartFile};

const FFMPEG: &str = "ffmpeg";
/// Steps of a channel that look alike.
const ALIKE: u8 = 8;

/// Whether ffmpeg is in `PATH`.
pub fn has_ffmpeg() -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(FFMPEG).is_file())
}

/// A movie that is being written, under another name until it is finished.
pub struct MovieFile {
    path: PathBuf,
    frames: u32,
    rate: u16,
    is_flat: bool,
    written: u32,
    sink: Option<Sink>,
}

enum Sink {
    Mp4(Child, PartFile),
    // Its encoder writes whole chunks, and would lose the errors of a buffer that it drops.
    Png(Box<Writer<File>>, Option<Palette>, PartFile),
}

impl MovieFile {
    /// A movie of so many frames, `rate` of them per second. The ending of its name decides what it
    /// is: `.mp4` or `.png`. A PNG that `is_flat`, without shades, has 256 colours.
    pub fn new(path: &Path, frames: usize, rate: u16, is_flat: bool) -> Self {
        Self {
            path: path.into(),
            frames: frames as u32,
            rate,
            is_flat,
            written: 0,
            sink: None,
        }
    }

    /// The folder of the series beside an animated PNG.
    fn series(&self) -> PathBuf {
        self.path.with_extension("")
    }

    /// Adds a frame; all have the size of the first.
    ///
    /// # Errors
    /// A file that cannot be written, a failure of ffmpeg.
    pub fn frame(&mut self, picture: &Picture) -> Result<()> {
        if self.sink.is_none() {
            self.sink = Some(
                if self.path.extension().is_some_and(|ending| ending == "mp4") {
                    self.encoder(picture.size)?
                } else {
                    self.animation(picture)?
                },
            );
        }
        match self.sink.as_mut() {
            Some(Sink::Mp4(child, _)) => {
                let input = child.stdin.as_mut();
                let added = input.map_or(Ok(()), |input| input.write_all(&picture.rgb));
                // What ffmpeg says when it ends explains a broken pipe.
                if let Err(e) = added
                    && e.kind() != ErrorKind::BrokenPipe
                {
                    return Err(unwritten(&self.path, &e));
                }
            }
            Some(Sink::Png(writer, palette, _)) => {
                let pixels = match palette {
                    Some(palette) => Cow::Owned(palette.indices(&picture.rgb)),
                    None => Cow::Borrowed(&*picture.rgb),
                };
                let added = writer.write_image_data(&pixels);
                added.map_err(|e| unwritten(&self.path, &e))?;
                let still = still(picture.size, palette.as_ref(), &pixels);
                let still = still.map_err(|e| unwritten(&self.path, &e))?;
                let name = format!("{:05}.png", self.written);
                text_writer::write(&self.series().join(name), still)?;
            }
            None => {}
        }
        self.written += 1;
        Ok(())
    }

    /// Starts ffmpeg, which reads the pixels of frames.
    fn encoder(&self, size: [u32; 2]) -> Result<Sink> {
        let [width, height] = size;
        let part = PartFile::create(&self.path)?;
        let mut command = Command::new(FFMPEG);
        command
            .args("-loglevel error -y -f rawvideo -pix_fmt rgb24".split(' '))
            .args(["-video_size", &format!("{width}x{height}")])
            .args(["-framerate", &self.rate.to_string(), "-i", "-"])
            // What every player and browser shows.
            .args("-pix_fmt yuv420p -movflags +faststart -f mp4".split(' '))
            .arg(part.part())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let child = command.spawn();
        let child = child.map_err(|e| unwritten(&self.path, &format!("{FFMPEG}: {e}")))?;
        Ok(Sink::Mp4(child, part))
    }

    fn animation(&self, first: &Picture) -> Result<Sink> {
        text_writer::refuse_linked_folder(&self.series())?;
        let palette = self.is_flat.then(|| Palette::of(&first.rgb));
        let part = PartFile::create(&self.path)?;
        let file = OpenOptions::new().write(true).open(part.part());
        let encoder = encoder_of(part.checked(file)?, first.size, palette.as_ref());
        let writer = self.animated(encoder);
        let writer = writer.map_err(|e| unwritten(&self.path, &e))?;
        Ok(Sink::Png(Box::new(writer), palette, part))
    }

    /// The writer of all frames.
    fn animated(&self, mut encoder: Encoder<'_, File>) -> Result<Writer<File>, EncodingError> {
        encoder.set_animated(self.frames, 0)?;
        encoder.set_frame_delay(1, self.rate)?;
        encoder.write_header()
    }

    /// Ends the movie and gives it its name. Returns its path, and the folder of the series.
    ///
    /// # Errors
    /// As of [`MovieFile::frame`].
    pub fn finish(mut self) -> Result<Vec<PathBuf>> {
        let mut written = vec![self.path.clone()];
        let part = match self.sink.take() {
            Some(Sink::Mp4(child, part)) => {
                // Closes its input.
                let ended = child.wait_with_output();
                let ended = ended.map_err(|e| unwritten(&self.path, &e))?;
                if !ended.status.success() {
                    let said = String::from_utf8_lossy(&ended.stderr);
                    let last = said.lines().last().unwrap_or_default();
                    let what = format!("{FFMPEG} ended with {}: {last}", ended.status);
                    return Err(unwritten(&self.path, &what));
                }
                part
            }
            Some(Sink::Png(writer, _, part)) => {
                writer.finish().map_err(|e| unwritten(&self.path, &e))?;
                written.push(self.series());
                part
            }
            None => return Ok(Vec::new()),
        };
        part.finish()?;
        Ok(written)
    }
}

/// The most frequent colours of the first frame, which has all of its scale; with a byte per pixel
/// a movie takes less than half.
struct Palette {
    colours: Vec<[u8; 3]>,
    /// Of colours that have been looked up.
    nearest: HashMap<[u8; 3], u8>,
}

impl Palette {
    fn of(rgb: &[u8]) -> Self {
        let mut counts: HashMap<[u8; 3], usize> = HashMap::new();
        for pixel in rgb.as_chunks().0 {
            *counts.entry(*pixel).or_default() += 1;
        }
        let mut counts: Vec<([u8; 3], usize)> = counts.into_iter().collect();
        counts.sort_unstable_by_key(|(colour, count)| (usize::MAX - count, *colour));
        // Of colours that look alike only the first, so that the whole scale finds room.
        let mut seen = HashSet::new();
        counts.retain(|(colour, _)| seen.insert(colour.map(|channel| channel / ALIKE)));
        counts.truncate(256);
        Self {
            colours: counts.into_iter().map(|(colour, _)| colour).collect(),
            nearest: HashMap::new(),
        }
    }

    fn indices(&mut self, rgb: &[u8]) -> Vec<u8> {
        let Self { colours, nearest } = self;
        let pixels = rgb.as_chunks().0.iter().map(|pixel| {
            *nearest.entry(*pixel).or_insert_with(|| {
                let near = (0..colours.len()).min_by_key(|k| squared_distance(colours[*k], *pixel));
                near.unwrap_or(0) as u8
            })
        });
        pixels.collect()
    }
}

/// The square of the distance of two colours.
fn squared_distance(a: [u8; 3], b: [u8; 3]) -> u32 {
    (0..3).map(|k| u32::from(a[k].abs_diff(b[k])).pow(2)).sum()
}

fn encoder_of<'a, W: Write>(to: W, size: [u32; 2], palette: Option<&Palette>) -> Encoder<'a, W> {
    let mut encoder = Encoder::new(to, size[0], size[1]);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Best);
    match palette {
        Some(palette) => {
            encoder.set_color(ColorType::Indexed);
            encoder.set_palette(palette.colours.as_flattened().to_vec());
            encoder.set_filter(FilterType::NoFilter);
        }
        None => {
            encoder.set_color(ColorType::Rgb);
            encoder.set_adaptive_filter(AdaptiveFilterType::Adaptive);
        }
    }
    encoder
}

/// A frame as a PNG of its own.
fn still(
    size: [u32; 2],
    palette: Option<&Palette>,
    pixels: &[u8],
) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut writer = encoder_of(&mut bytes, size, palette).write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}
