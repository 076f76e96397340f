//! Moves a batch of frames from the ranks that own the grains to the ranks that write them.

use super::checksums::{self, ContactWeights};
use super::collective::{IdBlocks, put_lists, take_lists};
use super::contact_quantities::{ContactTable, flags, numbers};
use super::layout::{FrameFormat, Quantity, elements};
use gshear_dem::state::{BoxEdges, ContactSample, GrainSample, body};
use std::ops::Range;

/// Assigns the parts of a batch to the ranks. Each rank writes one contiguous part in the order
/// of the file (by frame, then by id), which is also one box of a dataset of grains: whole frames
/// if there are at least as many frames as ranks, otherwise a block of ids of one frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BatchShares {
    pub frames: u64,
    pub grains: u64,
    pub ranks: u64,
}

/// What one rank writes of a batch.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BatchShare {
    pub frames: Range<u64>,
    pub ids: Range<u64>,
}

impl BatchShares {
    fn by_frame(&self) -> Option<IdBlocks> {
        (self.frames >= self.ranks).then(|| IdBlocks::new(self.frames, self.ranks))
    }

    /// With more ranks than frames: the first rank of a frame, and the blocks of ids of its ranks.
    fn of_frame(&self, frame: u64) -> (u64, IdBlocks) {
        let [first, end] =
            [frame, frame + 1].map(|frame| (frame * self.ranks).div_ceil(self.frames));
        (first, IdBlocks::new(self.grains, end - first))
    }

    pub fn of(&self, rank: usize) -> BatchShare {
        let (frames, ids) = if let Some(blocks) = self.by_frame() {
            (blocks.range(rank), 0..self.grains)
        } else {
            let frame = rank as u64 * self.frames / self.ranks;
            let (first, blocks) = self.of_frame(frame);
            (frame..frame + 1, blocks.range(rank - first as usize))
        };
        BatchShare { frames, ids }
    }
}

/// This rank's part of the buffered frames.
#[derive(Default)]
pub(crate) struct Frames {
    pub step: Vec<u64>,
    pub time: Vec<f64>,
    /// Edge vectors of the box.
    pub edges: Vec<BoxEdges>,
    /// Of each frame the numbers of its grains and contacts, the grains, and the contacts: as they
    /// are sent.
    bytes: Vec<u8>,
    /// Where each frame ends in them.
    ends: Vec<usize>,
}

impl Frames {
    pub fn len(&self) -> usize {
        self.step.len()
    }

    pub fn push(
        &mut self,
        step: u64,
        time: f64,
        edges: &BoxEdges,
        grains: &[GrainSample],
        contacts: &[ContactSample],
    ) {
        self.step.push(step);
        self.time.push(time);
        self.edges.push(*edges);
        put_lists(&mut self.bytes, grains, contacts);
        self.ends.push(self.bytes.len());
    }

    /// The edges of the boxes as the file has them: `of_box` numbers each, 3 at right angles or 9.
    pub(crate) fn edges_as_stored(&self, of_box: usize) -> Vec<f64> {
        match of_box {
            3 => (self.edges.iter())
                .flat_map(|edges| std::array::from_fn::<_, 3, _>(|axis| edges[axis][axis]))
                .collect(),
            _ => self.edges.as_flattened().as_flattened().to_vec(),
        }
    }

    /// Forgets all frames.
    pub fn clear(&mut self) {
        // The next batch is about as large; memory that grows would be copied again and again.
        let bytes = self.ends.last().copied().unwrap_or(0);
        self.step.clear();
        self.time.clear();
        self.edges.clear();
        self.ends.clear();
        self.bytes.clear();
        self.bytes.reserve(bytes);
    }

    /// Where a frame, or what follows the last one, begins in the bytes.
    fn start(&self, frame: u64) -> usize {
        match frame {
            0 => 0,
            _ => self.ends[frame as usize - 1],
        }
    }

    /// Returns a message to each rank, with what `bytes` has of the frames in the rank's share. The
    /// frames themselves are gone then.
    pub fn messages(&mut self, shares: &BatchShares) -> Vec<Vec<u8>> {
        match shares.by_frame() {
            Some(IdBlocks { ranks: 1, .. }) => vec![std::mem::take(&mut self.bytes)],
            Some(blocks) => (0..shares.ranks as usize)
                .map(|rank| {
                    let frames = blocks.range(rank);
                    self.bytes[self.start(frames.start)..self.start(frames.end)].to_vec()
                })
                .collect(),
            None => {
                let mut messages = vec![Vec::new(); shares.ranks as usize];
                for frame in 0..self.len() as u64 {
                    let (first, blocks) = shares.of_frame(frame);
                    let mut parts = vec![(Vec::new(), Vec::new()); blocks.ranks as usize];
                    let mut bytes = &self.bytes[self.start(frame)..self.start(frame + 1)];
                    let (grains, contacts) = take_lists::<GrainSample, ContactSample>(&mut bytes);
                    for grain in grains {
                        parts[blocks.holder(grain.id)].0.push(grain);
                    }
                    for contact in contacts {
                        parts[blocks.holder(contact.i)].1.push(contact);
                    }
                    let of_frame = messages[first as usize..].iter_mut();
                    for (message, (grains, contacts)) in of_frame.zip(&parts) {
                        put_lists(message, grains, contacts);
                    }
                }
                messages
            }
        }
    }
}

/// One rank's share of a batch, as columns.
pub(crate) struct ShareColumns {
    /// One array per entry of [`elements`], `[frame][id][width]` over the share.
    pub values: [Vec<f64>; 3],
    /// `[frame][id][3]` over the share.
    pub image: Vec<i32>,
    /// `[frame][id]` over the share, if frames say which grains are removed.
    pub removed: Vec<u8>,
    /// Of [`ContactTable::of`].
    pub contacts: Vec<ContactColumns>,
}

/// One rank's share of a table of contacts, as columns.
pub(crate) struct ContactColumns {
    /// Number of contacts of each frame of the share.
    pub counts: Vec<i64>,
    pub i: Vec<u32>,
    /// A flat wall is N, or N + 1.
    pub j: Vec<u32>,
    /// One array per entry of [`numbers`].
    pub forces: Vec<Vec<f64>>,
    /// One array per entry of [`flags`].
    pub flags: Vec<Vec<u8>>,
}

impl ShareColumns {
    /// Assembles the share of so many grains in all from one message of each rank. Panics if a
    /// grain is missing or anything occurs twice, which is a bug.
    pub fn assemble(
        messages: &[Vec<u8>],
        share: &BatchShare,
        grains: u64,
        form: FrameFormat,
    ) -> ShareColumns {
        let (frames, block) = (length(&share.frames) as usize, length(&share.ids) as usize);
        let bytes: usize = messages.iter().map(Vec::len).sum();
        let of_grains = frames * (16 * messages.len() + block * size_of::<GrainSample>());
        let room = bytes.saturating_sub(of_grains) / size_of::<ContactSample>();
        let room_of = |table| match table {
            ContactTable::Grains => room,
            ContactTable::Walls => 0,
        };
        let mut part = ShareColumns {
            values: elements(form.axes).map(|quantity| vec![0.0; frames * block * quantity.width]),
            image: vec![0; frames * block * 3],
            removed: vec![0; if form.removed { frames * block } else { 0 }],
            contacts: ContactTable::of(form)
                .map(|table| ContactColumns::new(form, room_of(table)))
                .collect(),
        };
        let mut rest: Vec<&[u8]> = messages.iter().map(|m| &m[..]).collect();
        let mut seen = vec![false; block];
        let mut samples: Vec<ContactSample> = Vec::new();
        let mut order: Vec<(u64, u32)> = Vec::new();
        for f in 0..frames {
            seen.fill(false);
            samples.clear();
            for rest in &mut rest {
                let (of_rank, contacts) = take_lists::<GrainSample, ContactSample>(rest);
                for grain in of_rank {
                    let n = (u64::from(grain.id) - share.ids.start) as usize;
                    assert!(!seen[n], "grain {} twice in a frame", grain.id);
                    seen[n] = true;
                    let at = f * block + n;
                    part.values[0][3 * at..][..3].copy_from_slice(&grain.position);
                    part.values[1][3 * at..][..3].copy_from_slice(&grain.velocity);
                    let image = &mut part.image[3 * at..][..3];
                    image.copy_from_slice(&grain.image.map(|of_axis| of_axis as i32));
                    if form.removed {
                        part.removed[at] = grain.removed as u8;
                    } else if grain.removed != 0 {
                        // As files of earlier versions say it, which are continued.
                        image[form.axes - 1] = 1;
                    }
                    let spin = &grain.angular_velocity;
                    match form.axes {
                        2 => part.values[2][at] = spin[2],
                        _ => part.values[2][3 * at..][..3].copy_from_slice(spin),
                    }
                }
                samples.extend(contacts);
            }
            if let Some(n) = seen.iter().position(|s| !s) {
                panic!("grain {} is not in a frame", share.ids.start + n as u64);
            }
            order.clear();
            let keys = samples
                .iter()
                .map(|c| u64::from(c.i) << 32 | u64::from(c.j));
            order.extend(keys.zip(0..));
            // The stable sort merges the sorted runs that the ranks send.
            order.sort_by_key(|&(key, _)| key);
            if let Some(twice) = order.windows(2).find(|w| w[0].0 == w[1].0) {
                let (i, j) = (twice[0].0 >> 32, twice[0].0 as u32);
                panic!("contact {i} {j} twice in a frame");
            }
            let ordered: Vec<&ContactSample> =
                order.iter().map(|&(_, n)| &samples[n as usize]).collect();
            for (table, columns) in ContactTable::of(form).zip(&mut part.contacts) {
                let is_of_wall = table == ContactTable::Walls;
                let of_table = ordered.iter().copied();
                let of_table = of_table.filter(|c| c.wall(grains as usize).is_some() == is_of_wall);
                columns.push(of_table, form);
            }
        }
        part
    }

    /// Returns the share's part of the checksums of each of its frames, in the order of
    /// [`crate::layout::frame_columns`], without those of the clock.
    pub fn checksums(&self, share: &BatchShare, form: FrameFormat) -> Vec<Vec<u64>> {
        let block = length(&share.ids) as usize;
        let of_width = [1, 3].map(|width| {
            let first = share.ids.start * width as u64;
            checksums::weights(first, block * width)
        });
        let (between_grains, with_walls) = self.contacts.split_first().expect("contacts of grains");
        let between_grains = between_grains.checksums(form);
        let with_walls: Vec<Vec<ContactSums>> = (with_walls.iter())
            .map(|columns| columns.checksums(form))
            .collect();
        let mut all = Vec::new();
        for (f, contacts) in between_grains.iter().enumerate() {
            let mut sums = Vec::new();
            for (Quantity { width, .. }, values) in elements(form.axes).iter().zip(&self.values) {
                let of_block = &values[f * block * width..][..block * width];
                let weights = &of_width[usize::from(*width == 3)];
                sums.push(checksums::of_numbers(weights, of_block));
            }
            sums.push(contacts.pairs);
            sums.extend(&contacts.numbers);
            sums.push(contacts.flags[0]);
            let of_block = &self.image[f * block * 3..][..block * 3];
            sums.push(checksums::of_images(&of_width[1], of_block));
            sums.extend(&contacts.flags[1..]);
            if form.removed {
                let of_block = &self.removed[f * block..][..block];
                sums.push(checksums::of_flags(&of_width[0], of_block));
            }
            for contacts in &with_walls {
                sums.push(contacts[f].pairs);
                sums.extend(contacts[f].numbers.iter().chain(&contacts[f].flags));
            }
            all.push(sums);
        }
        all
    }
}

/// The checksums of the contacts of a frame.
struct ContactSums {
    pairs: u64,
    /// Of [`numbers`].
    numbers: Vec<u64>,
    /// Of [`flags`].
    flags: Vec<u64>,
}

impl ContactColumns {
    /// With room for so many contacts.
    fn new(form: FrameFormat, contacts: usize) -> Self {
        let numbers = numbers(form);
        Self {
            counts: Vec::new(),
            i: Vec::with_capacity(contacts),
            j: Vec::with_capacity(contacts),
            forces: numbers
                .map(|quantity| Vec::with_capacity(contacts * quantity.width(form)))
                .collect(),
            flags: vec![Vec::with_capacity(contacts); flags(form).count()],
        }
    }

    /// The share's part of the checksums of each of its frames.
    fn checksums(&self, form: FrameFormat) -> Vec<ContactSums> {
        let weights = ContactWeights::new(&self.i, &self.j, form.axes);
        let mut begin = 0;
        let mut all = Vec::new();
        for &count in &self.counts {
            let rows = begin..begin + count as usize;
            begin = rows.end;
            let mut sums = ContactSums {
                pairs: weights.pairs(rows.clone()),
                numbers: Vec::new(),
                flags: Vec::new(),
            };
            for (quantity, values) in numbers(form).zip(&self.forces) {
                let width = quantity.width(form);
                let values = &values[rows.start * width..rows.end * width];
                let sum = weights.numbers(rows.clone(), values, width);
                sums.numbers.push(sum);
            }
            for flags in &self.flags {
                let sum = weights.flags(rows.clone(), &flags[rows.clone()]);
                sums.flags.push(sum);
            }
            all.push(sums);
        }
        all
    }

    /// Appends the contacts of one frame, in order.
    fn push<'a>(&mut self, contacts: impl Iterator<Item = &'a ContactSample>, form: FrameFormat) {
        let before = self.i.len();
        let numbers: Vec<_> = numbers(form).collect();
        let flags: Vec<_> = flags(form).collect();
        for c in contacts {
            self.i.push(c.i);
            self.j.push(c.j);
            for (column, quantity) in self.forces.iter_mut().zip(&numbers) {
                column.extend_from_slice(quantity.numbers(form, c));
            }
            for (column, quantity) in self.flags.iter_mut().zip(&flags) {
                column.push(quantity.flag(c));
            }
        }
        self.counts.push((self.i.len() - before) as i64);
    }

    /// The walls of a table of contacts with flat walls of so many grains.
    pub fn walls(&self, grains: u64) -> Vec<u8> {
        let walls = self
            .j
            .iter()
            .map(|j| body::BOTTOM as u8 + (u64::from(*j) - grains) as u8);
        walls.collect()
    }
}

pub(crate) fn length(range: &Range<u64>) -> u64 {
    range.end - range.start
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISKS: FrameFormat = FrameFormat::new(2, false);

    fn shares(frames: u64, grains: u64, ranks: u64) -> BatchShares {
        BatchShares {
            frames,
            grains,
            ranks,
        }
    }

    #[test]
    fn shares_follow_each_other_in_the_order_of_the_file() {
        for (frames, grains) in [(1, 5), (2, 1), (3, 10), (4, 7), (64, 3)] {
            for ranks in 1..=9 {
                let shares = shares(frames, grains, ranks);
                let mut places = Vec::new();
                for BatchShare { frames, ids } in (0..ranks as usize).map(|r| shares.of(r)) {
                    places.extend(frames.flat_map(|f| ids.clone().map(move |id| (f, id))));
                }
                let all = (0..frames).flat_map(|f| (0..grains).map(move |id| (f, id)));
                assert!(places.into_iter().eq(all), "{shares:?}");
            }
        }
    }

    #[test]
    fn everything_reaches_its_share() {
        let grain = |id: u32| GrainSample {
            id,
            removed: id % 2,
            position: [id.into(), 1.0, 0.0],
            velocity: [2.0, 3.0, 0.0],
            angular_velocity: [0.0, 0.0, 4.0],
            image: [id.into(), -1, 0],
        };
        let contact = |i, j| ContactSample {
            i,
            j,
            ..bytemuck::Zeroable::zeroed()
        };
        let mut frames = Frames::default();
        let grains: Vec<_> = (0..7).rev().map(grain).collect();
        // The flat walls are 7 and 8.
        let contacts = [[5, 8], [5, 6], [0, 3], [0, 7], [0, 1]].map(|[i, j]| contact(i, j));
        frames.push(0, 0.0, &[[0.0; 3]; 3], &grains, &contacts);
        frames.push(1, 1.0, &[[0.0; 3]; 3], &grains, &[]);
        for ranks in (1..=9).rev() {
            let shares = shares(2, 7, ranks);
            let (mut x, mut images) = (Vec::new(), Vec::new());
            let mut removed: Vec<u8> = Vec::new();
            let (mut pairs, mut counts, mut of_walls) = (Vec::new(), [0; 2], Vec::new());
            for (rank, message) in frames.messages(&shares).into_iter().enumerate() {
                let share = shares.of(rank);
                let form = FrameFormat {
                    removed: true,
                    walls: true,
                    ..DISKS
                };
                let part = ShareColumns::assemble(&[message], &share, 7, form);
                removed.extend(&part.removed);
                x.extend(part.values[0].chunks(3).map(|p| p[0]));
                images.extend(part.image.chunks(3).map(|p| [p[0], p[1]]));
                let [contacts, walls] = &part.contacts[..] else {
                    panic!("two tables");
                };
                pairs.extend(contacts.i.iter().copied().zip(contacts.j.clone()));
                of_walls.extend(walls.i.iter().copied().zip(walls.walls(7)));
                for (f, n) in share.frames.zip(&contacts.counts) {
                    counts[f as usize] += n;
                }
            }
            assert!(x.into_iter().eq((0..14).map(|n| f64::from(n % 7))));
            assert!(images.into_iter().eq((0..14).map(|n| [n % 7, -1])));
            assert!(removed.into_iter().eq((0..14).map(|n| n % 7 % 2)));
            assert_eq!((pairs, counts), (vec![(0, 1), (0, 3), (5, 6)], [3, 0]));
            assert_eq!(of_walls, [(0, 1), (5, 2)]);
        }
    }

    #[test]
    #[should_panic(expected = "grain 1 is not in a frame")]
    fn a_lost_grain_is_noticed() {
        let mut frames = Frames::default();
        let grain: GrainSample = bytemuck::Zeroable::zeroed();
        frames.push(0, 0.0, &[[0.0; 3]; 3], &[grain], &[]);
        let shares = shares(1, 2, 1);
        ShareColumns::assemble(&frames.messages(&shares), &shares.of(0), 2, DISKS);
    }
}
