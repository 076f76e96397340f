//! Mean, spread and extent of values, and groups of equals.

/// Mean and spread of some values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Number of values.
    pub count: f64,
    /// Mean; NaN without values.
    pub mean: f64,
    /// Sum of the squared deviations from the mean.
    pub squares: f64,
}

impl Moments {
    /// Computes them; the order of the values decides how sums are rounded.
    pub fn of(values: &[f64]) -> Self {
        let mean = mean(values);
        let squares = values.iter().map(|value| (value - mean) * (value - mean));
        Self {
            count: values.len() as f64,
            mean,
            squares: squares.sum(),
        }
    }

    /// Standard deviation of the sample; 0 of a single value.
    pub fn deviation(&self) -> f64 {
        (self.squares / (self.count - 1.0).max(1.0)).sqrt()
    }

    /// Standard deviation of the values as a whole population.
    pub fn population_deviation(&self) -> f64 {
        (self.squares / self.count).sqrt()
    }

    /// Standard error of the mean; NaN of a single value.
    pub fn error(&self) -> f64 {
        (self.squares / (self.count - 1.0) / self.count).sqrt()
    }
}

/// Returns the mean; NaN without values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the means of x and y of points, and the sums of (x - x̄)² and of (x - x̄)(y - ȳ), whose
/// ratio is the slope of the least-squares line.
pub(crate) fn joint_moments(points: &[[f64; 2]]) -> ([f64; 2], [f64; 2]) {
    let n = points.len() as f64;
    let [x, y] = [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / n);
    let spread = points.iter().map(|p| (p[0] - x) * (p[0] - x)).sum();
    let both = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    ([x, y], [spread, both])
}

/// Returns the least and the greatest value, NaN left out; ∞ and -∞ without values.
pub fn extent(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
    for value in values {
        (low, high) = (low.min(value), high.max(value));
    }
    [low, high]
}

/// Returns the items in groups of those that are the same as the first of the group, in the order
/// of their first items.
pub fn grouped<T>(
    items: impl IntoIterator<Item = T>,
    same: impl Fn(&T, &T) -> bool,
) -> Vec<Vec<T>> {
    let mut groups: Vec<Vec<T>> = Vec::new();
    for item in items {
        match groups.iter_mut().find(|group| same(&group[0], &item)) {
            Some(group) => group.push(item),
            None => groups.push(vec![item]),
        }
    }
    groups
}

/// The items without repetitions, in the order of their first occurrences.
pub fn distinct<T: PartialEq>(items: impl IntoIterator<Item = T>) -> Vec<T> {
    let groups = grouped(items, PartialEq::eq).into_iter();
    groups.map(|mut group| group.swap_remove(0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_and_extents_of_few_values() {
        let moments = Moments::of(&[1.0, 3.0, 5.0]);
        assert_eq!((moments.mean, moments.squares), (3.0, 8.0));
        assert_eq!(moments.deviation(), 2.0);
        assert_eq!(moments.error(), (4.0_f64 / 3.0).sqrt());
        assert_eq!(Moments::of(&[2.0]).deviation(), 0.0);
        assert!(Moments::of(&[2.0]).error().is_nan() && mean(&[]).is_nan());
        assert_eq!(extent([2.0, f64::NAN, -1.0]), [-1.0, 2.0]);
    }

    #[test]
    fn groups_are_in_the_order_of_their_first_items() {
        let groups = grouped([3, 1, 13, 4, 11], |a, b| a % 10 == b % 10);
        assert_eq!(groups, [vec![3, 13], vec![1, 11], vec![4]]);
        assert_eq!(distinct([3, 1, 3, 4, 1]), [3, 1, 4]);
    }
}
