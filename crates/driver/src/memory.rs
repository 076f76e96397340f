//! How many grains fit into the memory of the nodes of a run.

use std::collections::{BTreeMap, BTreeSet};

use gshear_mpi_exchange::Parallel;
use gshear_scene::packing::GrainLimit;
use gshear_store::{memory, provenance};

/// Bytes that a run takes for a grain, at least: about 500 are printed as "state … bytes per
/// grain".
const LEAST_BYTES: u64 = 400;

/// Greatest resident size of a process (bytes): of a run of few grains; for every grain of its
/// rank, disks and spheres; copies of the frames that wait to be written (docs/validation/speed.md,
/// "Memory").
pub(crate) const PROCESS_BYTES: f64 = 30e6;
pub(crate) const GRAIN_BYTES: [f64; 2] = [900.0, 1300.0];
pub(crate) const FRAME_COPIES: f64 = 3.0;

/// The same of rank 0 for K of a box of n disks or spheres: its factors for Newton's method, which
/// grow as a power of n; matrices as large as the dense one of which all eigenvalues are found.
pub(crate) const FACTOR_BYTES: [f64; 2] = [7e3, 8.7e3];
pub(crate) const FACTOR_POWER: [f64; 2] = [1.0, 4.0 / 3.0];
pub(crate) const DENSE_COPIES: f64 = 3.0;

/// The most grains for which all nodes together have memory. Collective.
pub(crate) fn limit(exchange: &dyn Parallel) -> GrainLimit {
    let mine = (provenance::host(), memory_here());
    let mine = serde_json::to_vec(&mine).expect("a name and a number");
    let all = exchange.gather(&mine);
    let nodes = all.iter().map(|text| serde_json::from_slice(text));
    limit_of(nodes.map(|node| node.expect("what a rank wrote")))
}

/// The limit of ranks on these nodes, each with its memory (bytes), if that is known.
fn limit_of(ranks: impl Iterator<Item = (String, Option<u64>)>) -> GrainLimit {
    // A node has its memory once, however many ranks it has.
    let nodes: BTreeMap<String, Option<u64>> = ranks.collect();
    let unlimited = GrainLimit::default();
    let Some(bytes) = nodes.values().copied().sum::<Option<u64>>() else {
        return unlimited;
    };
    let most = bytes / LEAST_BYTES;
    match u32::try_from(most) {
        Err(_) | Ok(u32::MAX) => unlimited,
        Ok(most) => {
            let place = match nodes.len() {
                1 => "this machine".into(),
                n => format!("{n} nodes"),
            };
            GrainLimit {
                most,
                reason: format!(
                    "fit into the memory of {place} ({:.1} GB, at least {LEAST_BYTES} bytes a grain)",
                    bytes as f64 / 1e9
                ),
            }
        }
    }
}

/// The hosts of all ranks, as bytes. Collective.
fn all_hosts(exchange: &dyn Parallel) -> Vec<Vec<u8>> {
    exchange.gather(provenance::host().as_bytes())
}

/// Number of hosts of the ranks. Collective.
pub(crate) fn hosts(exchange: &dyn Parallel) -> usize {
    let hosts: BTreeSet<Vec<u8>> = all_hosts(exchange).into_iter().collect();
    hosts.len().max(1)
}

/// Memory of the node with the fewest bytes for each of its ranks: bytes per rank, if that is
/// known. Collective.
pub(crate) fn per_rank(exchange: &dyn Parallel) -> Option<f64> {
    let mine = provenance::host();
    let all = all_hosts(exchange).into_iter();
    let here = all.filter(|host| *host == mine.as_bytes()).count();
    let bytes = memory_here().map_or(f64::INFINITY, |bytes| bytes as f64 / here.max(1) as f64);
    let least = -exchange.maximum(-bytes);
    least.is_finite().then_some(least)
}

/// The memory of this node (bytes), or of what the job or the process may have of it; `None` if the
/// system does not tell.
fn memory_here() -> Option<u64> {
    memory::total().map(|bytes| bytes as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_count_once() {
        let limit = |ranks: &[(&str, Option<u64>)]| {
            limit_of(ranks.iter().map(|(name, bytes)| ((*name).into(), *bytes)))
        };
        assert_eq!(limit(&[("a", Some(4000)), ("a", Some(4000))]).most, 10);
        assert_eq!(limit(&[("a", Some(4000)), ("b", Some(8000))]).most, 30);
        assert_eq!(limit(&[("a", Some(4000)), ("b", None)]).most, u32::MAX);
        assert_eq!(limit(&[("a", Some(u64::MAX / 2))]).most, u32::MAX);
        let expected = "fit into the memory of this machine (8.0 GB, at least 400 bytes a grain)";
        assert_eq!(limit(&[("a", Some(8_000_000_000))]).reason, expected);
    }
}
