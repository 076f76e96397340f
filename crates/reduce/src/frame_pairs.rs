//! Frames of a run, two by two, on all threads.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use gshear_analysis::dmin::{DefinedCounts, NonAffine, RADIUS};
use gshear_analysis::rattlers::RattlerRule;
use gshear_dem::failure::Result;
use gshear_dem::state::Frame;
use gshear_store::run_reader::{FrameFields, RunFile};
use rayon::prelude::*;

/// Returns the numbers of consecutive frames of a run, two by two.
pub fn consecutive(run: &RunFile) -> Vec<[usize; 2]> {
    (1..run.frames()).map(|t| [t - 1, t]).collect()
}

/// Two frames of a run with their numbers, the earlier first.
pub(crate) struct FramePair<'a, F> {
    pub numbers: [usize; 2],
    pub frames: [&'a F; 2],
}

/// What is computed of pairs of frames.
pub(crate) trait PairWork: Sync {
    /// A frame, as far as it is read.
    type Frame: Send + Sync;
    /// Reused from pair to pair.
    type Buffer: Default + Send;
    /// The result of a pair.
    type Value: Send;

    /// Reads the frames of a range.
    ///
    /// # Errors
    /// A damaged run.
    fn read(&self, range: Range<usize>) -> Result<Vec<Self::Frame>>;

    /// Computes the result of a pair.
    fn value(&self, buffer: &mut Self::Buffer, pair: FramePair<'_, Self::Frame>) -> Self::Value;
}

/// D²min between two frames, `[N]` (m²), and of how many free grains it is defined.
pub(crate) struct DminOfPairs<'a> {
    pub run: &'a RunFile,
    /// Of the neighbourhood (m).
    pub radius: f64,
    pub rattlers_by: RattlerRule,
}

impl<'a> DminOfPairs<'a> {
    /// With the neighbourhood and the rattlers of the paper.
    pub(crate) fn of_paper(run: &'a RunFile) -> Self {
        Self {
            run,
            radius: RADIUS * run.grains().mean_radius(),
            rattlers_by: RattlerRule::default(),
        }
    }
}

impl PairWork for DminOfPairs<'_> {
    type Frame = Frame;
    type Buffer = NonAffine;
    type Value = (Vec<f64>, DefinedCounts);

    fn read(&self, range: Range<usize>) -> Result<Vec<Frame>> {
        self.run.records_with(range, FrameFields::Pairs)
    }

    fn value(&self, non_affine: &mut NonAffine, pair: FramePair<'_, Frame>) -> Self::Value {
        let grains = self.run.grains();
        let interval = self.run.interval(pair.numbers, pair.frames);
        let mut dmin = vec![f64::NAN; grains.count()];
        non_affine.rattlers_by = self.rattlers_by;
        non_affine.between(grains, &interval, self.radius, &mut dmin);
        let counts = non_affine.defined(grains, interval.later(), &dmin);
        (dmin, counts)
    }
}

/// Passes to `write`, block by block, the number of a pair and the results of that pair of frames
/// and the following ones. `pairs`: numbers of the earlier and the later frame, ascending. Memory
/// holds some blocks of frames, whatever their number. A task inherits the buffer of an earlier
/// one, in which the lists of near grains of its last frames may still be valid.
///
/// # Errors
/// Those of reading and of `write`.
pub fn each<W: PairWork>(
    run: &RunFile,
    pairs: &[[usize; 2]],
    work: &W,
    mut write: impl FnMut(usize, Vec<W::Value>) -> Result<()>,
) -> Result<()> {
    // Returned buffers; their number grows to the largest number lent at a time.
    let pool: Mutex<Vec<W::Buffer>> = Mutex::default();
    let blocks: Vec<&[[usize; 2]]> = pairs.chunks(run.block_length()).collect();
    let mut needed = frames_of(blocks.first().copied().unwrap_or_default());
    let mut frames = load(&needed, work)?;
    let mut first = 0;
    for (k, block) in blocks.iter().enumerate() {
        needed = frames_of(blocks.get(k + 1).copied().unwrap_or_default());
        let missing: BTreeSet<usize> = needed
            .iter()
            .filter(|t| !frames.contains_key(t))
            .copied()
            .collect();
        // Reads the next block during the computation.
        let (following, values) = rayon::join(
            || load(&missing, work),
            || values(work, &pool, &frames, block),
        );
        write(first, values)?;
        first += block.len();
        frames.retain(|t, _| needed.contains(t));
        frames.extend(following?);
    }
    Ok(())
}

/// The results of the pairs of a block, on all threads.
fn values<W: PairWork>(
    work: &W,
    pool: &Mutex<Vec<W::Buffer>>,
    frames: &BTreeMap<usize, W::Frame>,
    block: &[[usize; 2]],
) -> Vec<W::Value> {
    // Neighbouring pairs share a buffer; tasks stay small enough to keep all threads busy.
    let together = (block.len() / (4 * rayon::current_num_threads())).clamp(1, 8);
    let tasks = block.par_chunks(together).flat_map_iter(|pairs| {
        let free = pool.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut buffer = free.unwrap_or_default();
        let mut values = Vec::with_capacity(pairs.len());
        for &numbers in pairs {
            let frames = numbers.map(|t| &frames[&t]);
            values.push(work.value(&mut buffer, FramePair { numbers, frames }));
        }
        let mut pool = pool.lock().unwrap_or_else(PoisonError::into_inner);
        pool.push(buffer);
        values
    });
    tasks.collect()
}

/// The numbers of the frames of some pairs.
fn frames_of(pairs: &[[usize; 2]]) -> BTreeSet<usize> {
    pairs.iter().flatten().copied().collect()
}

/// Reads frames by their numbers, in as few pieces as possible.
fn load<W: PairWork>(numbers: &BTreeSet<usize>, work: &W) -> Result<BTreeMap<usize, W::Frame>> {
    let numbers: Vec<usize> = numbers.iter().copied().collect();
    let mut frames = BTreeMap::new();
    for piece in numbers.chunk_by(|a, b| a + 1 == *b) {
        let range = piece[0]..piece[0] + piece.len();
        frames.extend(range.clone().zip(work.read(range)?));
    }
    Ok(frames)
}
