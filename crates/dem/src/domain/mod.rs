//! Exchange between ranks. No physics here names MPI: the ranks of an MPI job are in the crate
//! `gshear-mpi-exchange`.

mod exact_sum;
mod long_sum;
mod slabs;
mod solo;

pub use exact_sum::{Accumulator, FixedPoint};
pub(crate) use exact_sum::{LIMBS, MOST_COUNTED, nearest_whole};
pub use long_sum::LongSum;
pub(crate) use long_sum::WORDS;
pub use slabs::Slabs;
pub(crate) use slabs::most_ranks;
pub use solo::Solo;

/// A halo message to a neighbour, for which one of its own comes back.
#[derive(Clone, Copy)]
pub struct HaloMessage<'a> {
    /// The neighbour.
    pub rank: usize,
    /// How many numbers are sent.
    pub length: usize,
    /// Writes them, into as many places.
    pub write: &'a dyn Fn(&mut [f64]),
    /// How many numbers come back.
    pub expected: usize,
}

/// What a rank has sent, and how long it has waited for others.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Messages of records to neighbours, and their bytes.
    pub messages: [u64; 2],
    /// Sums of a step, and the bytes of this rank's terms.
    pub sums: [u64; 2],
    /// Other collective operations.
    pub others: u64,
    /// Processor time (ns) of waits for messages, for sums, and in other operations; 0 if it is not
    /// counted.
    pub waits: [u64; 3],
}

impl Traffic {
    /// What was sent since then.
    #[must_use]
    pub fn since(&self, then: &Self) -> Self {
        let less = |now: [u64; 2], then: [u64; 2]| [now[0] - then[0], now[1] - then[1]];
        Self {
            messages: less(self.messages, then.messages),
            sums: less(self.sums, then.sums),
            others: self.others - then.others,
            waits: std::array::from_fn(|k| self.waits[k] - then.waits[k]),
        }
    }
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
    /// Sends numbers to a neighbour, point to point. [`Exchange::end_halo`] must follow
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
    /// What this rank has sent until now; nothing where it is not counted. Not collective.
    fn traffic(&self) -> Traffic {
        Traffic::default()
    }
}

/// The sum of a count over the ranks.
pub fn total(exchange: &dyn Exchange, value: u64) -> u64 {
    let mut one = [value as i64];
    exchange.sum(&mut one);
    one[0] as u64
}
