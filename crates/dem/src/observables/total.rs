//! What is summed of the terms of an observable.

use crate::domain::{Exchange, LongSum, WORDS};

/// Integers of a total in a reduction over ranks.
const INTEGERS: usize = WORDS + 1;

/// Number, exact sum and extremes of some terms, in whatever order they come.
#[derive(Debug, Clone)]
pub struct Total {
    count: i64,
    sum: LongSum,
    least: f64,
    greatest: f64,
}

impl Default for Total {
    fn default() -> Self {
        Self {
            count: 0,
            sum: LongSum::default(),
            least: f64::INFINITY,
            greatest: f64::NEG_INFINITY,
        }
    }
}

impl Total {
    /// Adds a term. One that is not finite makes all that follows NaN, but the count.
    pub fn add(&mut self, term: f64) {
        self.count();
        self.sum.add(term);
        // 0 and -0 are the same, whichever comes first.
        let term = term + 0.0;
        self.least = self.least.min(term);
        self.greatest = self.greatest.max(term);
    }

    /// Counts a term without a value.
    pub fn count(&mut self) {
        self.count += 1;
    }

    /// The number of terms.
    pub fn terms(&self) -> u64 {
        self.count.unsigned_abs()
    }

    /// The exact sum, rounded once; 0 without terms.
    pub fn sum(&self) -> f64 {
        self.sum.value()
    }

    /// The sum over the number of terms; NaN without any.
    pub fn mean(&self) -> f64 {
        self.sum() / self.count as f64
    }

    /// The least term; NaN without any.
    pub fn least(&self) -> f64 {
        self.of_terms(self.least)
    }

    /// The greatest term; NaN without any.
    pub fn greatest(&self) -> f64 {
        self.of_terms(self.greatest)
    }

    fn of_terms(&self, extreme: f64) -> f64 {
        if self.count == 0 || self.sum().is_nan() {
            f64::NAN
        } else {
            extreme
        }
    }

    /// Adds the terms of another total.
    pub(crate) fn merge(&mut self, other: Self) {
        self.count += other.count;
        self.sum.merge(other.sum);
        self.least = self.least.min(other.least);
        self.greatest = self.greatest.max(other.greatest);
    }

    /// Makes totals those of all ranks, in one message, and a further two for each with `extremes`.
    /// Collective.
    pub(crate) fn over_ranks(exchange: &dyn Exchange, totals: &mut [Self], extremes: bool) {
        let mut message = vec![0i64; totals.len() * INTEGERS];
        for (total, integers) in totals.iter().zip(message.chunks_mut(INTEGERS)) {
            integers[0] = total.count;
            total.sum.write(&mut integers[1..]);
        }
        exchange.sum(&mut message);
        for (total, integers) in totals.iter_mut().zip(message.chunks(INTEGERS)) {
            total.count = integers[0];
            total.sum = LongSum::read(&integers[1..]);
            if extremes {
                total.least = -exchange.maximum(-total.least);
                total.greatest = exchange.maximum(total.greatest);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(terms: &[f64]) -> Total {
        let mut total = Total::default();
        terms.iter().for_each(|term| total.add(*term));
        total
    }

    #[test]
    fn nothing_has_no_mean() {
        let nothing = Total::default();
        assert_eq!((nothing.terms(), nothing.sum()), (0, 0.0));
        assert!(
            [nothing.mean(), nothing.least(), nothing.greatest()]
                .iter()
                .all(|x| x.is_nan())
        );
        let undefined = of(&[1.0, f64::NAN]);
        assert_eq!(undefined.terms(), 2);
        assert!(
            [undefined.sum(), undefined.least(), undefined.greatest()]
                .iter()
                .all(|x| x.is_nan())
        );
    }

    #[test]
    fn the_order_does_not_matter() {
        let terms = [0.1, -0.0, 3.0, 0.0, 1e30, -7.5];
        let all = of(&terms);
        let mut parts = of(&terms[3..]);
        parts.merge(of(&terms[..3]));
        for (a, b) in [
            (all.sum(), parts.sum()),
            (all.mean(), parts.mean()),
            (all.least(), parts.least()),
            (all.greatest(), parts.greatest()),
            (of(&[-0.0, 0.0]).least(), of(&[0.0, -0.0]).least()),
        ] {
            assert_eq!(a.to_bits(), b.to_bits());
        }
        assert_eq!([all.least(), all.greatest()], [-7.5, 1e30]);
    }
}
