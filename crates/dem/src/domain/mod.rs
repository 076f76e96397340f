//! The ranks: what they exchange. Physics never names MPI.

mod exact_sum;
mod slabs;
mod solo;

pub use exact_sum::{Accumulator, FixedPoint, LIMBS};
pub use slabs::{Slabs, most_ranks};
pub use solo::Solo;

/// One neighbour's halo messages in a step: the records that this rank sends and the place of those
/// that it receives. Records are `width` numbers each.
pub struct Link<'a> {
    /// The neighbour.
    pub rank: usize,
    /// Numbers in a record.
    pub width: usize,
    /// This rank's records.
    pub records: &'a [f64],
    /// The records to send, by their place.
    pub chosen: &'a [u32],
    /// Room for the chosen records, for an exchange that has to copy them.
    pub buffer: &'a mut [f64],
    /// Receives the neighbour's records.
    pub receive: &'a mut [f64],
}

/// Collective and point-to-point operations of a set of ranks. Every call is collective unless it says otherwise.
pub trait Exchange {
    fn rank(&self) -> usize;
    fn size(&self) -> usize;
    /// `send[r]` goes to rank `r`; the answer's `[r]` came from rank `r`. `send.len() == size()`.
    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>>;
    /// Point to point with the given neighbours; `meanwhile` runs once while the messages fly.
    fn halo(&self, links: &mut [Link<'_>], meanwhile: &mut dyn FnMut());
    /// Element-wise sum over the ranks, wrapping, in place.
    fn sum(&self, values: &mut [i64]);
    /// The same of a few values, while `meanwhile` runs, once.
    fn sum_during(&self, values: &mut [i64], meanwhile: &mut dyn FnMut());
    /// Sum over the ranks below this one.
    fn sum_below(&self, value: u64) -> u64;
    /// Greatest over the ranks.
    fn maximum(&self, value: f64) -> f64;
    /// Everybody's bytes, by rank, on every rank.
    fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>>;
    /// Rank 0's bytes, on every rank.
    fn broadcast(&self, bytes: Vec<u8>) -> Vec<u8>;
    fn barrier(&self);
}

/// Sum of one count over the ranks.
pub fn total(exchange: &dyn Exchange, value: u64) -> u64 {
    let mut one = [value as i64];
    exchange.sum(&mut one);
    one[0] as u64
}
