//! Checksums of the numbers in `run.h5`, so that damage in its data is noticed when it is read.
//!
//! A checksum is Σ w(k) b_k modulo 2^64 over the mixed bits b_k of the numbers, where w(k) is an odd
//! number made from the place k of the number. It depends neither on the order of the sum nor on
//! the ranks that hold the numbers, and a change of one number always changes it.

use std::collections::BTreeMap;

use super::parameter::Parameter;
use gshear_analysis::frame_scalars::FrameScalars;
use xxhash_rust::xxh3::xxh3_64;

/// Group of the checksums.
pub const GROUP: &str = "checksums";
/// `[T][columns]`: of the datasets [`frame_columns`] of every frame.
pub const FRAMES: &str = "checksums/frames";
/// `[R]`: of step, time and all columns of every row of the time series.
pub const ROWS: &str = "checksums/rows";
/// `[L']`: of step and all columns of every row of the scalars of frames.
pub const SCALARS: &str = "checksums/scalars";
/// Attribute of `parameters`: of all other attributes.
pub const OF_PARAMETERS: &str = "checksum";
/// Of what never changes: id, body, radius, mass, edges of the box.
pub const CONSTANTS: &str = "checksums/constants";

/// The weight of a place (SplitMix64, odd).
pub fn weight(place: u64) -> u64 {
    let mut z = place.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) | 1
}

/// The bits of a number, mixed so that round numbers, too, differ in their last bits. Numbers with
/// different bits stay different.
fn mixed(x: f64) -> u64 {
    let bits = x.to_bits();
    let bits = (bits ^ (bits >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    bits ^ (bits >> 32)
}

/// Of numbers that follow each other from the place `first` on.
pub fn of_sequence(first: u64, values: &[f64]) -> u64 {
    let terms = values.iter().zip(first..);
    terms.fold(0, |sum: u64, (x, place)| {
        sum.wrapping_add(weight(place).wrapping_mul(mixed(*x)))
    })
}

/// Of images that follow each other from the place `first` on.
pub fn of_images(first: u64, images: &[i32]) -> u64 {
    let terms = images.iter().zip(first..);
    terms.fold(0, |sum: u64, (&image, place)| {
        sum.wrapping_add(weight(place).wrapping_mul(u64::from(image as u32)))
    })
}

/// Of what never changes of the grains `first`, `first` + 1, …, and of the edges of the box.
pub fn of_constants(
    first: u64,
    id: &[u32],
    body: &[u8],
    [radius, mass]: [&[f64]; 2],
    edges: &[f64],
) -> [u64; 5] {
    let id: Vec<f64> = id.iter().map(|&id| id.into()).collect();
    let body: Vec<f64> = body.iter().map(|&body| body.into()).collect();
    let of = |values: &[f64]| of_sequence(first, values);
    [
        of(&id),
        of(&body),
        of(radius),
        of(mass),
        of_sequence(0, edges),
    ]
}

/// The place of a contact, wherever its row is.
pub fn place_of(i: u32, j: u32) -> u64 {
    u64::from(i) << 32 | u64::from(j)
}

/// Of the pairs of grains alone.
pub fn of_pairs(places: &[u64]) -> u64 {
    places
        .iter()
        .fold(0, |sum: u64, &place| sum.wrapping_add(weight(place)))
}

/// Of a column of contacts, `width` numbers each.
pub fn of_contacts(places: &[u64], values: &[f64], width: usize) -> u64 {
    let mut sum = 0u64;
    for (&place, values) in places.iter().zip(values.chunks_exact(width)) {
        let of_contact = weight(place);
        for (x, part) in values.iter().zip(0..) {
            let weight = of_contact.wrapping_add(2 * part);
            sum = sum.wrapping_add(weight.wrapping_mul(mixed(*x)));
        }
    }
    sum
}

/// Of flags of contacts.
pub fn of_flags(places: &[u64], flags: &[u8]) -> u64 {
    let terms = places.iter().zip(flags);
    terms.fold(0, |sum: u64, (&place, &flag)| {
        sum.wrapping_add(weight(place).wrapping_mul(flag.into()))
    })
}

/// Of a row of the time series, whose columns have these names in the file.
pub fn of_row<'a>(step: u64, time: f64, columns: impl Iterator<Item = (&'a str, f64)>) -> u64 {
    let named = |name: &str, bits: u64| weight(xxh3_64(name.as_bytes())).wrapping_mul(bits);
    let numbers = columns.map(|(name, x)| named(name, mixed(x)));
    [named("step", step), named("time", mixed(time))]
        .into_iter()
        .chain(numbers)
        .fold(0, u64::wrapping_add)
}

/// Of the step, the time and the edges of the box of a frame; files of earlier versions have no
/// `edges`.
pub fn of_clock(step: u64, time: f64, edges: &[f64]) -> u64 {
    let of_edges = weight(xxh3_64(b"edges")).wrapping_mul(of_sequence(0, edges));
    of_row(step, time, std::iter::empty()).wrapping_add(of_edges)
}

/// Of a row of the scalars of frames.
pub fn of_scalars(step: u64, scalars: &FrameScalars) -> u64 {
    let names = FrameScalars::COLUMNS.map(|column| column.name);
    // They have no time of their own.
    of_row(step, 0.0, names.into_iter().zip(scalars.columns()))
}

/// Of attributes, as hexadecimal digits.
pub fn of_parameters(parameters: &BTreeMap<String, Parameter>) -> String {
    let mut bytes = Vec::new();
    for (name, value) in parameters {
        let (kind, content) = match value {
            Parameter::Text(text) => (b't', text.as_bytes().to_vec()),
            Parameter::Integer(value) => (b'i', value.to_le_bytes().to_vec()),
            Parameter::Number(value) => (b'n', value.to_le_bytes().to_vec()),
            Parameter::Numbers(values) => {
                (b'v', values.iter().flat_map(|x| x.to_le_bytes()).collect())
            }
        };
        for part in [name.as_bytes(), &[kind], &content] {
            bytes.extend((part.len() as u64).to_le_bytes());
            bytes.extend(part);
        }
    }
    format!("{:016x}", xxh3_64(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Any change of one number, and any exchange of two different ones, changes the sum.
    #[test]
    fn changes_are_seen() {
        let values: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.1 - 1.0).collect();
        let whole = of_sequence(7, &values);
        let parts = of_sequence(7, &values[..20]).wrapping_add(of_sequence(27, &values[20..]));
        assert_eq!(whole, parts);
        for k in 0..50 {
            for bit in 0..64 {
                let mut flipped = values.clone();
                flipped[k] = f64::from_bits(flipped[k].to_bits() ^ 1 << bit);
                assert_ne!(of_sequence(7, &flipped), whole);
            }
        }
        for k in 1..50 {
            let mut exchanged = values.clone();
            exchanged.swap(0, k);
            assert_ne!(of_sequence(7, &exchanged), whole);
        }
        let row = |step, time, x| of_row(step, time, [("a", x), ("b", 2.0)].into_iter());
        assert_ne!(row(1, 2.0, 3.0), row(2, 2.0, 3.0));
        assert_ne!(row(1, 2.0, 3.0), row(1, 2.5, 3.0));
        assert_ne!(row(1, 2.0, 3.0), row(1, 2.0, 3.5));
    }

    #[test]
    fn contacts_count_by_their_ids() {
        let places = [place_of(1, 2), place_of(1, 3), place_of(4, 5)];
        let back = [places[2], places[0], places[1]];
        assert_eq!(of_pairs(&places), of_pairs(&back));
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let moved = [5.0, 6.0, 1.0, 2.0, 3.0, 4.0];
        assert_eq!(
            of_contacts(&places, &values, 2),
            of_contacts(&back, &moved, 2)
        );
        assert_ne!(
            of_contacts(&places, &values, 2),
            of_contacts(&places, &moved, 2)
        );
        assert_ne!(
            of_contacts(&places, &[1.0, 2.0, 3.0], 1),
            of_contacts(&places, &[2.0, 1.0, 3.0], 1)
        );
        assert_eq!(of_flags(&places, &[0, 1, 0]), of_flags(&back, &[0, 0, 1]));
        assert_ne!(of_flags(&places, &[0, 1, 0]), of_flags(&places, &[1, 0, 0]));
        assert_ne!(
            of_pairs(&places),
            of_pairs(&[places[0], places[1], place_of(4, 6)])
        );
    }
}
