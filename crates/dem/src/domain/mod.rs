//! Exchange between ranks. No physics here names MPI: the ranks of an MPI job are in the crate
//! `gshear-mpi-exchange`.

mod exact_sum;
mod slabs;
mod solo;

pub use exact_sum::{Accumulator, FixedPoint};
pub(crate) use exact_sum::{LIMBS, MOST_COUNTED, nearest_whole};
pub use slabs::Slabs;
pub(crate) use slabs::most_ranks;
pub use solo::Solo;

/// The halo messages of a step with one neighbour: the records to send, and room for those to
/// receive. Records are `width` numbers each.
pub struct Link<'a> {
    /// The neighbour.
    pub rank: usize,
    /// Numbers in a record.
    pub width: usize,
    /// This rank's records.
    pub records: &'a [f64],
    /// Indices of the records to send.
    pub chosen: &'a [u32],
    /// Room for a copy of the chosen records.
    pub buffer: &'a mut [f64],
    /// Receives the neighbour's records.
    pub receive: &'a mut [f64],
}

/// Collective and point-to-point operations of a set of ranks. Calls are collective unless they say
/// otherwise.
pub trait Exchange {
    /// This rank's number, from 0. Not collective.
    fn rank(&self) -> usize;
    /// The number of ranks. Not collective.
    fn size(&self) -> usize;
    /// Sends `send[r]` to rank `r`, and returns the messages received, by rank.
    /// `send.len() == size()`.
    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>>;
    /// Exchanges records with the given neighbours, point to point; runs `meanwhile` once during
    /// the exchange.
    fn halo(&self, links: &mut [Link<'_>], meanwhile: &mut dyn FnMut());
    /// Element-wise sum over the ranks, wrapping, in place.
    fn sum(&self, values: &mut [i64]);
    /// [`Exchange::sum`] of a few values; runs `meanwhile` once during the sum.
    fn sum_during(&self, values: &mut [i64], meanwhile: &mut dyn FnMut());
    /// Sum over the ranks below this one.
    fn sum_below(&self, value: u64) -> u64;
    /// Greatest over the ranks.
    fn maximum(&self, value: f64) -> f64;
    /// The bytes of all ranks, by rank, on every rank.
    fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>>;
    /// The bytes of rank 0, on every rank.
    fn broadcast(&self, bytes: Vec<u8>) -> Vec<u8>;
    /// Waits for all ranks.
    fn barrier(&self);
}

/// The sum of a count over the ranks.
pub fn total(exchange: &dyn Exchange, value: u64) -> u64 {
    let mut one = [value as i64];
    exchange.sum(&mut one);
    one[0] as u64
}
