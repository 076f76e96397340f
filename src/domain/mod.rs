//! The ranks: what they exchange. Physics never names MPI.

mod exact_sum;
mod node;
mod slabs;
mod solo;
mod world;

use bytemuck::Pod;

pub use exact_sum::{Accumulator, FixedPoint, LIMBS};
pub use slabs::{Slabs, most_ranks};
pub use solo::Solo;
pub use world::World;

/// What a rank says to a neighbour in every step, `chosen` of its records, which are of `f64` alone, and where the other's land.
pub struct Link<'a, R> {
    pub rank: usize,
    pub records: &'a [R],
    pub chosen: &'a [u32],
    /// As many as are chosen: room for them where the message needs it.
    pub buffer: &'a mut [R],
    pub receive: &'a mut [R],
}

/// The verbs of a set of ranks. Every call is collective unless it says otherwise.
pub trait Exchange {
    fn rank(&self) -> usize;
    fn size(&self) -> usize;
    /// The communicator for parallel HDF5; `None` where there is only this process.
    fn communicator(&self) -> Option<mpi::ffi::MPI_Comm>;
    /// `send[r]` goes to rank `r`; the answer's `[r]` came from rank `r`. `send.len() == size()`.
    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>>;
    /// Point to point with the given neighbours; `meanwhile` runs while the messages fly.
    fn halo<R: Pod>(&self, links: &mut [Link<'_, R>], meanwhile: impl FnOnce());
    /// Element-wise sum over the ranks, wrapping, in place.
    fn sum(&self, values: &mut [i64]);
    /// The same of a few values, while `meanwhile` runs.
    fn sum_during(&self, values: &mut [i64], meanwhile: impl FnOnce());
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
pub fn total(exchange: &impl Exchange, value: u64) -> u64 {
    let mut one = [value as i64];
    exchange.sum(&mut one);
    one[0] as u64
}
