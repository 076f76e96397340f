//! One rank, without messages.

use super::{Exchange, Link};

/// A single rank.
pub struct Solo;

impl Exchange for Solo {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
        send
    }

    fn halo(&self, links: &mut [Link<'_>], meanwhile: &mut dyn FnMut()) {
        debug_assert!(links.is_empty(), "a single rank has no neighbours");
        meanwhile();
    }

    fn sum(&self, _values: &mut [i64]) {}

    fn sum_during(&self, _values: &mut [i64], meanwhile: &mut dyn FnMut()) {
        meanwhile();
    }

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
