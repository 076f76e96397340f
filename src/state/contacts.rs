//! The canonical half list and what the contacts remember, in blocks of eight pairs.

use crate::contact::ContactLaw;
use crate::simd::{LANES, Row};

use super::ContactState;

/// Pairs of local grains that touch or may come to, each once, in order of (id of i, id of j), i the lower id.
///
/// The last block is filled up with a grain that touches nothing. The list's extent never reaches the numbers:
/// pairs that do not touch add nothing.
#[derive(Debug, Default)]
pub struct Contacts {
    /// Pairs, without those that fill up the last block.
    pub pairs: usize,
    pub i: Vec<[u32; LANES]>,
    pub j: Vec<[u32; LANES]>,
    /// R_i + R_j and R_i (m) of every block.
    pub geometry: Vec<[Row; 2]>,
    /// `ContactLaw::PARAMETERS` rows per block.
    pub parameters: Vec<Row>,
    /// `ContactLaw::HISTORY` rows per block.
    pub history: Vec<Row>,
    /// Lanes that touched when the forces were last computed.
    pub touching: Vec<u8>,
}

impl Contacts {
    /// Replaces the list by the sorted `pairs` of local indices; `filler` is a grain that touches nothing.
    pub fn replace<C: ContactLaw>(
        &mut self,
        law: &C,
        pairs: &[[u32; 2]],
        radius: &[f64],
        filler: u32,
    ) {
        let blocks = pairs.len().div_ceil(LANES);
        self.pairs = pairs.len();
        self.i.clear();
        self.i.resize(blocks, [filler; LANES]);
        self.j.clear();
        self.j.resize(blocks, [filler; LANES]);
        self.geometry.clear();
        self.geometry
            .resize(blocks, [Row([-1.0; LANES]), Row([0.0; LANES])]);
        self.parameters.clear();
        self.parameters.resize(blocks * C::PARAMETERS, Row::ZERO);
        self.history.clear();
        self.history.resize(blocks * C::HISTORY, Row::ZERO);
        self.touching.clear();
        self.touching.resize(blocks, 0);
        let mut numbers = vec![0.0; C::PARAMETERS];
        for (k, &[i, j]) in pairs.iter().enumerate() {
            let (block, lane) = (k / LANES, k % LANES);
            let (r_i, r_j) = (radius[i as usize], radius[j as usize]);
            self.i[block][lane] = i;
            self.j[block][lane] = j;
            self.geometry[block][0].0[lane] = r_i + r_j;
            self.geometry[block][1].0[lane] = r_i;
            law.parameters(r_i, r_j, &mut numbers);
            for (row, &number) in self.parameters[block * C::PARAMETERS..]
                .iter_mut()
                .zip(&numbers)
            {
                row.0[lane] = number;
            }
        }
    }

    /// The touching contacts with local indices, in list order.
    pub fn touching(&self) -> impl Iterator<Item = Touching> + '_ {
        self.touching
            .iter()
            .enumerate()
            .flat_map(move |(block, &mask)| {
                (0..LANES)
                    .filter(move |lane| mask >> lane & 1 == 1)
                    .map(move |lane| Touching {
                        block,
                        lane,
                        i: self.i[block][lane] as usize,
                        j: self.j[block][lane] as usize,
                    })
            })
    }

    /// What a touching contact remembers.
    pub fn state<C: ContactLaw>(&self, at: Touching, id: &[u32]) -> ContactState {
        let mut history = [0.0; 3];
        let rows = &self.history[at.block * C::HISTORY..(at.block + 1) * C::HISTORY];
        for (to, row) in history.iter_mut().zip(rows) {
            *to = row.0[at.lane];
        }
        ContactState {
            i: id[at.i],
            j: id[at.j],
            history: C::history_to_state(history),
        }
    }

    /// Gives the pairs of the list their history back. `remembered` is sorted by (i, j); pairs that are not in it start anew.
    pub fn remember<C: ContactLaw>(&mut self, remembered: &[ContactState], id: &[u32]) {
        let mut rest = remembered.iter().peekable();
        for k in 0..self.pairs {
            let (block, lane) = (k / LANES, k % LANES);
            let pair = (
                id[self.i[block][lane] as usize],
                id[self.j[block][lane] as usize],
            );
            while rest.next_if(|c| (c.i, c.j) < pair).is_some() {}
            if let Some(contact) = rest.next_if(|c| (c.i, c.j) == pair) {
                let history = C::history_from_state(contact.history);
                let rows = &mut self.history[block * C::HISTORY..(block + 1) * C::HISTORY];
                for (row, from) in rows.iter_mut().zip(history) {
                    row.0[lane] = from;
                }
                self.touching[block] |= 1 << lane;
            }
        }
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        use std::mem::size_of;
        (self.i.capacity() + self.j.capacity()) * size_of::<[u32; LANES]>()
            + self.geometry.capacity() * size_of::<[Row; 2]>()
            + (self.parameters.capacity() + self.history.capacity()) * size_of::<Row>()
            + self.touching.capacity()
    }
}

/// Place of a touching contact in the list, and its grains.
#[derive(Debug, Clone, Copy)]
pub struct Touching {
    pub block: usize,
    pub lane: usize,
    pub i: usize,
    pub j: usize,
}
