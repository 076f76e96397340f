//! Collective operations around a file: agreement on failures, and redistribution of records to the
//! ranks that write them.

use bytemuck::Pod;
use gshear_dem::domain::Exchange;
use gshear_dem::failure::{Failure, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ops::Range;
use std::path::Path;

/// Makes all ranks fail together. Returns this rank's value if no rank has failed. Collective.
///
/// # Errors
/// The failure of the lowest rank that has failed, on every rank.
pub fn agree<T>(exchange: &dyn Exchange, result: Result<T>) -> Result<T> {
    let kinds = [Failure::Input, Failure::Numbers, Failure::Other];
    let mut local = Vec::new();
    if let Err(failure) = &result {
        local.push(match failure {
            Failure::Input(_) => 0,
            Failure::Numbers(_) => 1,
            Failure::Other(_) => 2,
        });
        local.extend_from_slice(failure.to_string().as_bytes());
    }
    match exchange.gather(&local).iter().find(|m| !m.is_empty()) {
        None => result,
        Some(message) => {
            let text = String::from_utf8_lossy(&message[1..]);
            Err(kinds[usize::from(message[0])](text.into_owned()))
        }
    }
}

/// Whether rank 0 finds a file or a folder at this path. Collective.
///
/// # Errors
/// [`Failure::Other`] if the system does not tell.
pub fn exists(exchange: &dyn Exchange, path: &Path) -> Result<bool> {
    told_by_root(exchange, || {
        path.try_exists()
            .map_err(|e| Failure::other(format!("{}: cannot be looked up: {e}", path.display())))
    })
}

/// Lets rank 0 alone compute a value, which the other ranks do not get. All ranks fail together.
/// Collective.
///
/// # Errors
/// The failure of rank 0.
pub fn on_root<T: Default>(
    exchange: &dyn Exchange,
    compute: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let computed = match exchange.rank() {
        0 => compute(),
        _ => Ok(T::default()),
    };
    agree(exchange, computed)
}

/// [`on_root`], and the value on every rank. Collective.
///
/// # Errors
/// The failure of rank 0.
pub fn told_by_root<T: Default + Serialize + DeserializeOwned>(
    exchange: &dyn Exchange,
    compute: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let value = on_root(exchange, compute)?;
    Ok(of_root(exchange, &value))
}

/// Returns the value of rank 0. Collective.
///
/// # Panics
/// If a number in it is not finite.
pub fn of_root<T: Serialize + DeserializeOwned>(exchange: &dyn Exchange, value: &T) -> T {
    const SOUND: &str = "texts and finite numbers";
    let bytes = serde_json::to_vec(value).expect(SOUND);
    serde_json::from_slice(&exchange.broadcast(bytes)).expect(SOUND)
}

/// The first failure in a sequence of collective calls. The other ranks would wait for a rank that
/// leaves the sequence early, so every rank notes its failures and continues.
#[derive(Default)]
pub(crate) struct CollectiveOutcome(Option<Failure>);

impl CollectiveOutcome {
    /// A sequence of one call.
    pub fn of(result: Result<()>) -> Self {
        Self(result.err())
    }

    /// Stores the failure of a call, unless an earlier call has failed already.
    pub fn note(&mut self, result: Result<()>) {
        if let Err(failure) = result {
            self.0.get_or_insert(failure);
        }
    }

    /// Ends the sequence. Collective.
    ///
    /// # Errors
    /// As [`agree`].
    pub fn agree(self, exchange: &dyn Exchange) -> Result<()> {
        agree(exchange, self.0.map_or(Ok(()), Err))
    }
}

/// Equal blocks of the ids 0 … N-1: rank r of P holds r N/P ≤ id < (r+1) N/P, rounded down.
#[derive(Debug, Clone, Copy)]
pub struct IdBlocks {
    /// Number of ids N.
    pub grains: u64,
    /// Number of ranks P.
    pub ranks: u64,
}

impl IdBlocks {
    /// Blocks of so many ids for so many ranks.
    pub fn new(grains: u64, ranks: u64) -> Self {
        Self { grains, ranks }
    }

    /// Blocks of so many ids, one for each rank.
    pub fn of(exchange: &dyn Exchange, grains: u64) -> Self {
        Self::new(grains, exchange.size() as u64)
    }

    /// Returns the ids of a rank.
    pub fn range(&self, rank: usize) -> Range<u64> {
        let rank = rank as u128;
        let (grains, ranks) = (u128::from(self.grains), u128::from(self.ranks));
        let [start, end] = [rank, rank + 1].map(|r| (r * grains / ranks) as u64);
        start..end
    }

    /// Returns the rank that holds `id`; those of flat walls, from `grains` on, the last one.
    pub fn holder(&self, id: u32) -> usize {
        let id = u64::from(id).min(self.grains - 1);
        (((id + 1) * self.ranks - 1) / self.grains) as usize
    }

    /// Sends every record to the rank that holds its id. The received records are grouped by
    /// sender. Collective.
    pub fn redistribute<T: Pod>(
        &self,
        exchange: &dyn Exchange,
        records: &[T],
        id: impl Fn(&T) -> u32,
    ) -> Vec<T> {
        let mut send = vec![Vec::new(); exchange.size()];
        for record in records {
            send[self.holder(id(record))].extend_from_slice(bytemuck::bytes_of(record));
        }
        let received = exchange.all_to_all(send);
        let records = received.iter().flat_map(|bytes| records_of(bytes));
        records.collect()
    }
}

/// Returns the records of all ranks on every rank, sorted by `key`. Collective.
pub fn gathered<R: Pod, K: Ord>(exchange: &dyn Exchange, own: &[R], key: fn(&R) -> K) -> Vec<R> {
    let all = exchange.gather(bytemuck::cast_slice(own));
    let mut all: Vec<R> = all.iter().flat_map(|bytes| records_of(bytes)).collect();
    all.sort_unstable_by_key(key);
    all
}

/// Reads records from bytes of any alignment.
pub fn records_of<T: Pod>(bytes: &[u8]) -> impl Iterator<Item = T> {
    let pieces = bytes.chunks_exact(size_of::<T>());
    debug_assert!(pieces.remainder().is_empty());
    pieces.map(bytemuck::pod_read_unaligned)
}

/// Appends two lists to a message.
pub fn put_lists<A: Pod, B: Pod>(message: &mut Vec<u8>, a: &[A], b: &[B]) {
    message.extend_from_slice(bytemuck::bytes_of(&[a.len() as u64, b.len() as u64]));
    message.extend_from_slice(bytemuck::cast_slice(a));
    message.extend_from_slice(bytemuck::cast_slice(b));
}

/// Splits off the next two lists from a message that [`put_lists`] made.
pub fn take_lists<'m, A: Pod, B: Pod>(
    rest: &mut &'m [u8],
) -> (
    impl Iterator<Item = A> + use<'m, A, B>,
    impl Iterator<Item = B> + use<'m, A, B>,
) {
    let counts: [u64; 2] = bytemuck::pod_read_unaligned(take(rest, 16));
    let a = take(rest, counts[0] as usize * size_of::<A>());
    let b = take(rest, counts[1] as usize * size_of::<B>());
    (records_of(a), records_of(b))
}

/// Appends bytes, and before them their number.
pub(crate) fn put_bytes(message: &mut Vec<u8>, bytes: &[u8]) {
    message.extend_from_slice(bytemuck::bytes_of(&(bytes.len() as u64)));
    message.extend_from_slice(bytes);
}

/// Splits off the next bytes from a message that [`put_bytes`] made.
pub(crate) fn take_bytes<'m>(rest: &mut &'m [u8]) -> &'m [u8] {
    let length: u64 = bytemuck::pod_read_unaligned(take(rest, size_of::<u64>()));
    take(rest, length as usize)
}

/// Splits off so many bytes.
fn take<'m>(rest: &mut &'m [u8], length: usize) -> &'m [u8] {
    let (bytes, later) = rest.split_at(length);
    *rest = later;
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_dem::domain::Solo;

    #[test]
    fn blocks_hold_every_id_once() {
        for grains in [1, 2, 3, 7, 10, 1000] {
            for ranks in 1..=12 {
                let blocks = IdBlocks { grains, ranks };
                let mut next = 0;
                for rank in 0..ranks as usize {
                    let range = blocks.range(rank);
                    assert_eq!(range.start, next);
                    next = range.end;
                    assert!(range.into_iter().all(|id| blocks.holder(id as u32) == rank));
                }
                assert_eq!(next, grains);
            }
        }
    }

    #[test]
    fn failures_keep_their_kind() {
        for failure in [
            Failure::input("a"),
            Failure::numbers("b"),
            Failure::other("c"),
        ] {
            assert_eq!(agree::<()>(&Solo, Err(failure.clone())), Err(failure));
        }
        assert_eq!(agree(&Solo, Ok(3)), Ok(3));
    }
}
