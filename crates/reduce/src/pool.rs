//! A pool of buffers for parallel tasks. A task inherits the content of a returned buffer, such as
//! lists of near grains.

use std::mem::take;
use std::sync::{Mutex, PoisonError};

/// Returned buffers; their number grows to the largest number lent at a time.
#[derive(Debug, Default)]
pub struct Pool<T>(Mutex<Vec<T>>);

/// A borrowed buffer, returned to the pool when dropped.
pub struct Lent<'a, T: Default> {
    pool: &'a Pool<T>,
    pub buffer: T,
}

impl<T: Default> Pool<T> {
    /// Lends a returned buffer, or a new one.
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
