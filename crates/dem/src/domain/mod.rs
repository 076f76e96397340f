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

/// A halo message to a neighbour, for which one of its own comes back. Records are `width` numbers
/// each.
#[derive(Debug, Clone, Copy)]
pub struct HaloMessage<'a> {
    /// The neighbour.
    pub rank: usize,
    /// Numbers in a record.
    pub width: usize,
    /// This rank's records.
    pub records: &'a [f64],
    /// Indices of the records to send.
    pub chosen: &'a [u32],
    /// How many numbers come back.
    pub expected: usize,
}

/// Collective and point-to-point operations of a set of ranks. Calls are collective unless they say
/// otherwise.
pub trait Exchange {
    /// This rank's number, from 0. Not collective.
    fn rank(&self) -> usize;
    /// The number of ranks. Not collective.
    fn size(&self) -> usize;
    /// Whether a message between neighbours takes about a microsecond: sent band by band, it is
    /// hidden by the forces of a band. Others are sent for several bands together. The same on all
    /// ranks. Not collective.
    fn is_near(&self) -> bool;
    /// Sends `send[r]` to rank `r`, and returns the messages received, by rank.
    /// `send.len() == size()`.
    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>>;
    /// Sends a copy of records to a neighbour, point to point. [`Exchange::end_halo`] must follow
    /// before the next; two messages may be under way with a rank that is both neighbours.
    fn begin_halo(&self, message: HaloMessage<'_>);
    /// Waits for the neighbour's message that belongs to the first under way to it, and calls
    /// `read` once with its numbers.
    fn end_halo(&self, rank: usize, read: &mut dyn FnMut(&[f64]));
    /// Element-wise sum over the ranks, wrapping, in place.
    fn sum(&self, values: &mut [i64]);
    /// Begins an [`Exchange::sum`] of a few values, at most one at a time, and only halo messages
    /// until [`Exchange::end_sum`].
    fn begin_sum(&self, values: &[i64]);
    /// Waits for the sum of these values.
    fn end_sum(&self, values: &mut [i64]);
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
