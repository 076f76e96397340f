//! One rank, without messages.

use super::{Exchange, HaloMessage};

/// A single rank.
pub struct Solo;

impl Exchange for Solo {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn is_near(&self) -> bool {
        true
    }

    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
        send
    }

    fn begin_halo(&self, message: HaloMessage<'_>) {
        unreachable!("a single rank has no neighbour {}", message.rank);
    }

    fn end_halo(&self, rank: usize, _read: &mut dyn FnMut(&[f64])) {
        unreachable!("a single rank has no neighbour {rank}");
    }

    fn sum(&self, _values: &mut [i64]) {}

    fn begin_sum(&self, _values: &[i64]) {}

    fn end_sum(&self, _values: &mut [i64]) {}

    fn sum_below(&self, _value: u64) -> u64 {
        0
    }

    fn maximum(&self, value: f64) -> f64 {
        value
    }

    fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        vec![bytes.to_vec()]
    }

    fn broadcast(&self, bytes: Vec<u8>) -> Vec<u8> {
        bytes
    }

    fn barrier(&self) {}
}
