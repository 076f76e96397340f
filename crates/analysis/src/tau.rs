//! The series of τ in which phases are found: which of its rows, and how τ is computed. LH give
//! τ = S/N at every Δγ and leave the rest open.

use std::num::NonZeroUsize;

/// How the series of τ is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TauReading {
    /// Every so many rows of the time series are one interval.
    pub every: NonZeroUsize,
    /// Whether τ is ⟨S⟩/⟨N⟩ over the rows of an interval, instead of its value at the end.
    pub average: bool,
    /// τ is rounded to multiples of this; `None`: not at all.
    pub round: Option<f64>,
}

/// The forces whose ratio is τ.
#[derive(Debug, Clone, Copy)]
pub struct WallForces<'a> {
    /// `[L]` S of every row.
    pub shear: &'a [f64],
    /// `[L]` N of every row.
    pub normal: &'a [f64],
}

impl TauReading {
    /// Returns the rows at the ends of the intervals, ascending, and τ there. With averages the
    /// first interval has ended `every` rows after row 0.
    pub fn of(&self, forces: WallForces<'_>) -> (Vec<usize>, Vec<f64>) {
        let WallForces { shear, normal } = forces;
        let every = self.every.get();
        let first = if self.average { every } else { 0 };
        let rows: Vec<usize> = (first..shear.len()).step_by(every).collect();
        let values = rows.iter().map(|&row| {
            let from = if self.average { row + 1 - every } else { row };
            let [shear, normal] =
                [shear, normal].map(|forces| forces[from..=row].iter().sum::<f64>());
            let tau = shear / normal;
            match self.round {
                Some(unit) => (tau / unit).round() * unit,
                None => tau,
            }
        });
        let values = values.collect();
        (rows, values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(tau: &[f64], every: usize, average: bool, round: Option<f64>) -> (Vec<usize>, Vec<f64>) {
        let every = NonZeroUsize::new(every).expect("one or more");
        let reading = TauReading {
            every,
            average,
            round,
        };
        let normal = vec![1.0; tau.len()];
        let forces = WallForces {
            shear: tau,
            normal: &normal,
        };
        reading.of(forces)
    }

    /// A row with N near zero weighs by its forces.
    #[test]
    fn an_average_is_the_ratio_of_the_mean_forces() {
        let reading = TauReading {
            every: NonZeroUsize::new(2).expect("one or more"),
            average: true,
            round: None,
        };
        let forces = WallForces {
            shear: &[0.0, 1.0, 2.0],
            normal: &[0.0, 3.0, -1.0],
        };
        assert_eq!(reading.of(forces), (vec![2], vec![1.5]));
    }

    const TAU: [f64; 8] = [0.0, 1.0, 2.0, 6.0, 4.0, 3.0, 8.0, 9.0];

    #[test]
    fn values_are_of_the_interval_that_ends_there() {
        let all: Vec<usize> = (0..8).collect();
        assert_eq!(of(&TAU, 1, false, None), (all.clone(), TAU.to_vec()));
        assert_eq!(of(&[], 1, false, None), (vec![], vec![]));
        assert_eq!(
            of(&TAU, 3, false, None),
            (vec![0, 3, 6], vec![0.0, 6.0, 8.0])
        );
        assert_eq!(of(&TAU, 3, true, None), (vec![3, 6], vec![3.0, 5.0]));
        let rounded = vec![0.0, 0.0, 2.5, 5.0, 5.0, 2.5, 7.5, 10.0];
        assert_eq!(of(&TAU, 1, false, Some(2.5)), (all, rounded));
    }
}
