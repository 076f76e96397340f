//! Buffers that are lent to pieces of work and taken back: what they hold, such as lists of near grains, serves the next piece.

use std::mem::take;
use std::sync::{Mutex, PoisonError};

/// As many buffers as were ever lent at a time.
#[derive(Debug, Default)]
pub struct Pool<T>(Mutex<Vec<T>>);

/// A buffer on loan; goes back when it is dropped.
pub struct Lent<'a, T: Default> {
    pool: &'a Pool<T>,
    pub buffer: T,
}

impl<T: Default> Pool<T> {
    /// One that was used before, or a new one.
    pub fn lend(&self) -> Lent<'_, T> {
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
