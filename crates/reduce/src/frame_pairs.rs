//! Consecutive frames of a run, two by two, on all threads.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use gshear_dem::failure::Result;
use gshear_store::run_reader::RunFile;
use rayon::prelude::*;

/// Passes to `write`, block by block, the number of a frame and what `value` makes of that frame
/// and the following ones, each with the frame before it. Memory holds two blocks of frames,
/// whatever their number. A task inherits the buffer of an earlier one, in which the lists of near
/// grains of its last frames may still be valid.
///
/// # Errors
/// Those of `read` and `write`.
pub fn each<F: Send + Sync, B: Default + Send, V: Send>(
    run: &RunFile,
    read: impl Fn(Range<usize>) -> Result<Vec<F>> + Sync,
    value: impl Fn(&mut B, [usize; 2], [&F; 2]) -> V + Sync + Send,
    mut write: impl FnMut(usize, Vec<V>) -> Result<()>,
) -> Result<()> {
    let block = |first: usize| read(first..run.frames().min(first + run.block_length()));
    // Returned buffers; their number grows to the largest number lent at a time.
    let pool: Mutex<Vec<B>> = Mutex::default();
    let free = || pool.lock().unwrap_or_else(PoisonError::into_inner);
    let (mut frames, mut first) = (block(0)?, 1);
    while first < run.frames() {
        let next = first + frames.len() - 1;
        // Neighbouring pairs share a buffer; tasks stay small enough to keep all threads busy.
        let together = (frames.len() / (4 * rayon::current_num_threads())).clamp(1, 8);
        let task = |pairs: Vec<(usize, &[F])>| -> Vec<V> {
            let mut buffer = free().pop().unwrap_or_default();
            let pairs = pairs.into_iter();
            let values = pairs.map(|(k, pair)| {
                let numbers = [first + k - 1, first + k];
                value(&mut buffer, numbers, [&pair[0], &pair[1]])
            });
            let values = values.collect();
            free().push(buffer);
            values
        };
        let work = || -> Vec<V> {
            let pairs = frames.par_windows(2).enumerate();
            pairs.chunks(together).flat_map_iter(task).collect()
        };
        // Reads the next block during the computation.
        let (following, values) = rayon::join(|| block(next), work);
        if !values.is_empty() {
            write(first, values)?;
        }
        frames = frames.pop().into_iter().chain(following?).collect();
        first = next;
    }
    Ok(())
}
