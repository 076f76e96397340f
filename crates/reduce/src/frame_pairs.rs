//! Consecutive frames of a run, two by two, on all threads.

use std::mem::take;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use gshear_dem::failure::Failure;
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
    read: impl Fn(Range<usize>) -> Result<Vec<F>, Failure> + Sync,
    value: impl Fn(&mut B, [usize; 2], [&F; 2]) -> V + Sync + Send,
    mut write: impl FnMut(usize, Vec<V>) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let block = |first: usize| read(first..run.frames().min(first + run.block_length()));
    let pool = Pool::<B>::default();
    let (mut frames, mut first) = (block(0)?, 1);
    while first < run.frames() {
        let next = first + frames.len() - 1;
        let work = || -> Vec<V> {
            let pairs = frames.par_windows(2).enumerate();
            // Neighbouring pairs share a buffer; tasks stay small enough to keep all threads busy.
            let together = (frames.len() / (4 * rayon::current_num_threads())).clamp(1, 8);
            let value = |lent: &mut Lent<B>, (k, pair): (usize, &[F])| {
                let numbers = [first + k - 1, first + k];
                value(&mut lent.buffer, numbers, [&pair[0], &pair[1]])
            };
            let pairs = pairs.with_min_len(together);
            pairs.map_init(|| pool.lend(), value).collect()
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

/// Returned buffers; their number grows to the largest number lent at a time.
#[derive(Debug, Default)]
struct Pool<T>(Mutex<Vec<T>>);

/// A borrowed buffer, returned to the pool when dropped.
struct Lent<'a, T: Default> {
    pool: &'a Pool<T>,
    buffer: T,
}

impl<T: Default> Pool<T> {
    /// Lends a returned buffer, or a new one.
    fn lend(&self) -> Lent<'_, T> {
        let used = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        Lent {
            pool: self,
            buffer: used.unwrap_or_default(),
        }
    }
}

impl<T: Default> Drop for Lent<'_, T> {
    fn drop(&mut self) {
        let mut free = self.pool.0.lock().unwrap_or_else(PoisonError::into_inner);
        free.push(take(&mut self.buffer));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_back_is_lent_again() {
        let pool = Pool::<Vec<u8>>::default();
        pool.lend().buffer.push(7);
        let (first, second) = (pool.lend(), pool.lend());
        assert_eq!((&first.buffer[..], &second.buffer[..]), (&[7][..], &[][..]));
    }
}
