//! How well an eigenvector predicts where grains move (BO): the overlap of two fields over the
//! grains.

/// Returns the overlap Σab/√(Σa² Σb²) of two non-negative fields over the grains, `[N]`; grains
/// where either field is not finite are left out.
///
/// It is 1 if one field is a multiple of the other; [`by_chance`] is that of independent fields.
pub fn overlap(a: &[f64], b: &[f64]) -> f64 {
    let sums = ProductSums::new(a, b);
    sums.ab / (sums.aa * sums.bb).sqrt()
}

/// Returns the [`overlap`] that two independent fields of these values would have:
/// ⟨a⟩⟨b⟩/√(⟨a²⟩⟨b²⟩), over the grains where both are finite.
pub fn by_chance(a: &[f64], b: &[f64]) -> f64 {
    let sums = ProductSums::new(a, b);
    sums.a * sums.b / (sums.count as f64 * (sums.aa * sums.bb).sqrt())
}

/// Sums over the grains where both fields are finite.
struct ProductSums {
    count: usize,
    a: f64,
    b: f64,
    aa: f64,
    ab: f64,
    bb: f64,
}

impl ProductSums {
    fn new(a: &[f64], b: &[f64]) -> Self {
        let pairs = a.iter().zip(b);
        let known: Vec<(&f64, &f64)> = pairs
            .filter(|(a, b)| a.is_finite() && b.is_finite())
            .collect();
        Self {
            count: known.len(),
            a: known.iter().map(|(a, _)| *a).sum(),
            b: known.iter().map(|(_, b)| *b).sum(),
            aa: known.iter().map(|(a, _)| *a * *a).sum(),
            ab: known.iter().map(|(a, b)| *a * *b).sum(),
            bb: known.iter().map(|(_, b)| *b * *b).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlaps_of_equal_and_of_separate_fields() {
        assert_eq!(overlap(&[1.0, 2.0, f64::NAN], &[2.0, 4.0, 9.0]), 1.0);
        assert_eq!(overlap(&[1.0, 0.0], &[0.0, 3.0]), 0.0);
        // ⟨a⟩⟨b⟩ = 1/2 · 3/2, ⟨a²⟩⟨b²⟩ = 1/2 · 9/2.
        assert_eq!(by_chance(&[1.0, 0.0, 7.0], &[0.0, 3.0, f64::NAN]), 0.5);
    }
}
