//! Frames of a run, two by two, on all threads.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use gshear_dem::failure::Result;
use gshear_store::run_reader::RunFile;
use rayon::prelude::*;

/// Returns the numbers of consecutive frames of a run, two by two.
pub fn consecutive(run: &RunFile) -> Vec<[usize; 2]> {
    (1..run.frames()).map(|t| [t - 1, t]).collect()
}

/// Passes to `write`, block by block, the number of a pair and what `value` makes of that pair of
/// frames and the following ones. `pairs`: numbers of the earlier and the later frame, ascending.
/// Memory holds some blocks of frames, whatever their number. A task inherits the buffer of an
/// earlier one, in which the lists of near grains of its last frames may still be valid.
///
/// # Errors
/// Those of `read` and `write`.
pub fn each<F: Send + Sync, B: Default + Send, V: Send>(
    run: &RunFile,
    pairs: &[[usize; 2]],
    read: impl Fn(Range<usize>) -> Result<Vec<F>> + Sync,
    value: impl Fn(&mut B, [usize; 2], [&F; 2]) -> V + Sync + Send,
    mut write: impl FnMut(usize, Vec<V>) -> Result<()>,
) -> Result<()> {
    // Returned buffers; their number grows to the largest number lent at a time.
    let pool: Mutex<Vec<B>> = Mutex::default();
    let free = || pool.lock().unwrap_or_else(PoisonError::into_inner);
    let blocks: Vec<&[[usize; 2]]> = pairs.chunks(run.block_length()).collect();
    let mut needed = frames_of(blocks.first().copied().unwrap_or_default());
    let mut frames = load(&needed, &read)?;
    let mut first = 0;
    for (k, block) in blocks.iter().enumerate() {
        needed = frames_of(blocks.get(k + 1).copied().unwrap_or_default());
        let missing: BTreeSet<usize> = needed
            .iter()
            .filter(|t| !frames.contains_key(t))
            .copied()
            .collect();
        // Neighbouring pairs share a buffer; tasks stay small enough to keep all threads busy.
        let together = (block.len() / (4 * rayon::current_num_threads())).clamp(1, 8);
        let task = |pairs: &[[usize; 2]]| -> Vec<V> {
            let mut buffer = free().pop().unwrap_or_default();
            let of_pair = |numbers: &[usize; 2]| {
                let both = numbers.map(|t| &frames[&t]);
                value(&mut buffer, *numbers, both)
            };
            let values = pairs.iter().map(of_pair).collect();
            free().push(buffer);
            values
        };
        let work = || -> Vec<V> { block.par_chunks(together).flat_map_iter(task).collect() };
        // Reads the next block during the computation.
        let (following, values) = rayon::join(|| load(&missing, &read), work);
        write(first, values)?;
        first += block.len();
        frames.retain(|t, _| needed.contains(t));
        frames.extend(following?);
    }
    Ok(())
}

/// The numbers of the frames of some pairs.
fn frames_of(pairs: &[[usize; 2]]) -> BTreeSet<usize> {
    pairs.iter().flatten().copied().collect()
}

/// Reads frames by their numbers, in as few pieces as possible.
fn load<F>(
    numbers: &BTreeSet<usize>,
    read: &impl Fn(Range<usize>) -> Result<Vec<F>>,
) -> Result<BTreeMap<usize, F>> {
    let numbers: Vec<usize> = numbers.iter().copied().collect();
    let mut frames = BTreeMap::new();
    for piece in numbers.chunk_by(|a, b| a + 1 == *b) {
        let range = piece[0]..piece[0] + piece.len();
        frames.extend(range.clone().zip(read(range)?));
    }
    Ok(frames)
}
