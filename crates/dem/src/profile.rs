//! What each rank did: counts of grains, pairs and messages, and processor time.

use std::ops::Range;

use bytemuck::allocation::pod_collect_to_vec;

use crate::clock::StepPhase;
use crate::columns::joined_names;
use crate::dimension::Dimension;
use crate::domain::{Exchange, Traffic};
use crate::state::{Contacts, Share};
use crate::system::System;

crate::columns! {
    /// What a rank did since its clock began. Grains and pairs are those of the last list.
    pub struct RankProfile {
        /// the rank
        rank: "1",
        /// its threads
        threads: "1",
        /// processors that it may run on
        processors: "1",
        /// bands of its grains
        bands: "1",
        /// steps
        steps: "1",
        /// lists of pairs that were made
        lists: "1",
        /// the greatest gap of a listed pair
        listed_gap: "m",
        /// start of its slab
        from: "m",
        /// end of its slab
        to: "m",
        /// grains that it owns
        grains: "1",
        /// grains of its neighbours that are in pairs with these
        ghosts: "1",
        /// pairs of the list with a grain that it owns
        pairs: "1",
        /// pairs of a grain and a ghost, which both ranks evaluate
        pairs_across_ranks: "1",
        /// pairs of grains of two threads
        pairs_across_threads: "1",
        /// blocks of up to sixteen pairs in the list
        blocks: "1",
        /// blocks that were evaluated, summed over the steps
        evaluated_blocks: "1",
        /// messages sent to neighbours
        messages: "1",
        /// bytes of these
        message_bytes: "B",
        /// sums over the ranks, one a step
        sums: "1",
        /// bytes that it gave to them
        sum_bytes: "B",
        /// other operations of all ranks: lists, rows, files
        other_operations: "1",
        /// processor time of kicks, drift and contact forces by one thread alone
        forces: "s",
        /// processor time of halo messages without waits
        halo: "s",
        /// processor time of walls and sums without waits
        sums_and_walls: "s",
        /// processor time of lists by one thread alone, with waits
        rebuild: "s",
        /// processor time of output, with waits
        output: "s",
        /// processor time of all threads in regions of parallel work of steps
        parallel: "s",
        /// processor time of the longest piece of each of these regions
        longest: "s",
        /// processor time of all threads in regions of parallel work of lists
        parallel_rebuild: "s",
        /// processor time of the longest piece of each of these regions
        longest_rebuild: "s",
        /// processor time of waits for messages
        waits_for_messages: "s",
        /// processor time of waits for sums
        waits_for_sums: "s",
        /// processor time of waits in other operations
        other_waits: "s",
    }
}

impl RankProfile {
    /// Of this rank. `traffic`: since the clock of the system began. `processors`: on which this
    /// rank may run.
    pub fn of<D: Dimension>(
        exchange: &dyn Exchange,
        system: &System<D>,
        traffic: Traffic,
        processors: usize,
    ) -> Self {
        let (contacts, slabs) = (&system.contacts, &system.slabs);
        let within = contacts.shares.iter().map(Share::blocks);
        let [mut across_threads, mut across_ranks] = [0; 2];
        for others in &contacts.others {
            across_threads += listed(contacts, others.start..others.inner);
            across_ranks += listed(contacts, others.inner..others.end);
        }
        let pairs = across_threads
            + across_ranks
            + within.map(|blocks| listed(contacts, blocks)).sum::<usize>();
        let work = system.clock.work().unwrap_or_default();
        let [motion, halo, forces, walls, rebuild, output] = [
            StepPhase::Motion,
            StepPhase::Exchange,
            StepPhase::Contacts,
            StepPhase::Walls,
            StepPhase::Rebuild,
            StepPhase::Output,
        ]
        .map(|phase| work[phase as usize]);
        let step = [motion, halo, forces, walls];
        let [for_messages, for_sums, others] = traffic.waits.map(|time| 1e-9 * time as f64);
        let me = exchange.rank();
        let counts = [me, system.pool.threads(), processors, system.bands()];
        let [rank, threads, processors, bands] = counts.map(|count| count as f64);
        Self {
            rank,
            threads,
            processors,
            bands,
            steps: system.clock.steps() as f64,
            lists: system.list.rebuilds as f64,
            listed_gap: system.list.listed_gap(),
            from: slabs.cuts[me],
            to: slabs.cuts[me + 1],
            grains: system.owned() as f64,
            ghosts: slabs.ghosts() as f64,
            pairs: pairs as f64,
            pairs_across_ranks: across_ranks as f64,
            pairs_across_threads: across_threads as f64,
            blocks: contacts.blocks() as f64,
            evaluated_blocks: system.evaluated_blocks() as f64,
            messages: traffic.messages[0] as f64,
            message_bytes: traffic.messages[1] as f64,
            sums: traffic.sums[0] as f64,
            sum_bytes: traffic.sums[1] as f64,
            other_operations: traffic.others as f64,
            forces: motion.alone + forces.alone,
            halo: halo.alone - for_messages,
            sums_and_walls: walls.alone - for_sums,
            rebuild: rebuild.alone,
            output: output.alone,
            parallel: step.iter().map(|work| work.parallel).sum(),
            longest: step.iter().map(|work| work.longest).sum(),
            parallel_rebuild: rebuild.parallel,
            longest_rebuild: rebuild.longest,
            waits_for_messages: for_messages,
            waits_for_sums: for_sums,
            other_waits: others,
        }
    }

    /// The rows of all ranks as CSV, with the names of the columns. Collective.
    pub fn table(&self, exchange: &dyn Exchange) -> String {
        let mut text = joined_names(&Self::COLUMNS, ",");
        for bytes in exchange.gather(bytemuck::bytes_of(self)) {
            for row in pod_collect_to_vec::<u8, Self>(&bytes) {
                let values: Vec<String> = row.columns().iter().map(f64::to_string).collect();
                text += &format!("\n{}", values.join(","));
            }
        }
        text
    }
}

/// Number of pairs in some blocks, without those of a grain and itself that fill up the last ones.
fn listed(contacts: &Contacts, blocks: Range<usize>) -> usize {
    let blocks = contacts.pairs.blocks()[blocks].iter();
    let lanes = blocks.flat_map(|block| block.i.iter().zip(&block.j));
    lanes.filter(|(i, j)| i != j).count()
}
