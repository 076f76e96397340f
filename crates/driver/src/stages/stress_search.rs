//! Stress control in strain steps: a quasi-Newton search for the lengths of the box at which the
//! relaxed packing has the wanted stresses.

use nalgebra::{Matrix3, Vector3};

use gshear_dem::dimension::Dimension;
use gshear_dem::failure::{Failure, Result};
use gshear_scene::{Deformation, StrainPart, StressControl};

use super::strain::Strain;
use crate::header::{Corrected, Correction, Moduli, Search};

/// Relaxations in a strain step after which its stresses are given up.
const MOST_CORRECTIONS: usize = 60;
/// Greatest factor by which a correction changes the moduli along its strain, up or down.
const MOST_CHANGE: f64 = 4.0;

impl<D: Dimension> Strain<'_, D> {
    /// The stresses that the present strain step controls.
    fn controls(&self) -> Vec<StressControl> {
        match &self.quasi_static.deformation {
            Deformation::Biaxial => {
                let lateral = std::array::from_fn(|axis| axis < D::UP);
                vec![StressControl {
                    measured: lateral,
                    moved: lateral,
                    stress: self.quasi_static.pressure.unwrap_or(f64::NAN),
                }]
            }
            Deformation::Protocol(parts) => {
                let place = StrainPart::of_step(parts, self.progress.steps + 1);
                place.map_or(Vec::new(), |(n, _)| parts[n].controls().collect())
            }
            Deformation::SimpleShear | Deformation::PureShear | Deformation::Compression(_) => {
                Vec::new()
            }
        }
    }

    /// The wanted stresses of this strain step, on the straight line to those that the part reaches
    /// in so many strain steps.
    pub(super) fn wanted_stresses(&mut self, steps: u64) -> [f64; 3] {
        let mut wanted = [0.0; 3];
        let controls = self.controls();
        if controls.is_empty() {
            return wanted;
        }
        let stress = self.observed().normal_stress;
        for (wanted, control) in wanted.iter_mut().zip(&controls) {
            let now = measured(control, stress);
            *wanted = now + (control.stress - now) / steps as f64;
        }
        wanted
    }

    /// Gives the box these lengths, and begins to search for the wanted stresses; `corrected`: from
    /// the strains of the last strain step.
    pub(super) fn begin_to_correct(
        &mut self,
        mut lengths: [f64; 3],
        wanted: [f64; 3],
        corrected: Option<Corrected>,
    ) -> Result<Option<Search>> {
        let controls = self.controls();
        if controls.is_empty() {
            if lengths != self.assembly.system.cell.lengths::<D>() {
                self.stretch_within(lengths)?;
            }
            return Ok(Some(Search::Rest));
        }
        let Corrected { moduli, strain } = corrected.unwrap_or(Corrected {
            moduli: Moduli::stiff(self.stiff()),
            strain: [0.0; 3],
        });
        lengthen(&mut lengths, &controls, strain);
        self.stretch_within(lengths)?;
        Ok(Some(Search::Stresses(Correction {
            count: 0,
            wanted,
            total: strain,
            by: [0.0; 3],
            moduli,
            excess: None,
        })))
    }

    /// Begins the next correction of the stresses; `None` if they are the wanted ones.
    pub(super) fn correct(&mut self, mut correction: Correction) -> Result<Option<Search>> {
        let most = self.quasi_static.aqs.pressure_step;
        let controls = self.controls();
        let stress = self.observed().normal_stress;
        let wanted = correction.wanted;
        let mut excess = [0.0; 3];
        for (k, control) in controls.iter().enumerate() {
            excess[k] = measured(control, stress) - wanted[k];
        }
        if let Some(before) = correction.excess {
            let fallen = std::array::from_fn(|k| before[k] - excess[k]);
            correction.moduli.update(correction.by, fallen);
        }
        let greatest = wanted.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let furthest = excess.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        if furthest <= self.quasi_static.pressure_tolerance * greatest {
            let strain = correction.total.map(|x| x.clamp(-2.0 * most, 2.0 * most));
            let mut stretched = self.stretched();
            stretched.corrected = Some(Corrected {
                moduli: correction.moduli,
                strain,
            });
            self.progress.stretched = Some(stretched);
            return Ok(None);
        }
        if correction.count == MOST_CORRECTIONS {
            return Err(Failure::numbers(format!(
                "strain step {}: a stress differs from {greatest:.4e} by {furthest:.1e} after {MOST_CORRECTIONS} corrections; \
                 give a greater aqs.pressure_tolerance, or a smaller aqs.strain_step or aqs.pressure_step",
                self.progress.steps + 1
            )));
        }
        let stiff = self.stiff();
        correction.by = correction.moduli.strains(excess, stiff, most);
        correction.count += 1;
        correction.excess = Some(excess);
        for (total, by) in correction.total.iter_mut().zip(correction.by) {
            *total += by;
        }
        let mut lengths = self.assembly.system.cell.lengths::<D>();
        lengthen(&mut lengths, &controls, correction.by);
        self.stretch_within(lengths)?;
        Ok(Some(Search::Stresses(correction)))
    }
}

/// The stress of a control, by the normal stresses along the axes.
fn measured(control: &StressControl, stress: [f64; 3]) -> f64 {
    let axes = (0..3).filter(|axis| control.measured[*axis]);
    let count = axes.clone().count() as f64;
    axes.map(|axis| stress[axis]).sum::<f64>() / count
}

/// Makes the lengths along the axes of each control longer by its part.
fn lengthen(lengths: &mut [f64; 3], controls: &[StressControl], by: [f64; 3]) {
    for (control, by) in controls.iter().zip(by) {
        for (length, is_moved) in lengths.iter_mut().zip(control.moved) {
            if is_moved {
                *length *= 1.0 + by;
            }
        }
    }
}

impl Moduli {
    /// Uncoupled axes of this modulus.
    fn stiff(modulus: f64) -> Self {
        let mut moduli = [[0.0; 3]; 3];
        for (axis, row) in moduli.iter_mut().enumerate() {
            row[axis] = modulus;
        }
        Self(moduli)
    }

    fn matrix(self) -> Matrix3<f64> {
        Matrix3::from_fn(|k, l| self.0[k][l])
    }

    /// Updates the moduli by a measured fall of the stresses, by Broyden's method (C. G. Broyden,
    /// Math. Comp. 19, 577, 1965). After a rearrangement the packing may appear very soft, or the
    /// modulus negative: then all moduli change by one factor.
    fn update(&mut self, by: [f64; 3], fallen: [f64; 3]) {
        let (by, fallen) = (Vector3::from(by), Vector3::from(fallen));
        let before = self.matrix();
        let expected = before * by;
        let ratio = by.dot(&fallen) / by.dot(&expected);
        let after = if (1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&ratio) {
            before + (fallen - expected) * by.transpose() / by.norm_squared()
        } else if ratio > 0.0 {
            before * ratio.clamp(1.0 / MOST_CHANGE, MOST_CHANGE)
        } else {
            before * MOST_CHANGE
        };
        self.0 = std::array::from_fn(|k| std::array::from_fn(|l| after[(k, l)]));
    }

    /// The strains that remove the excess of stress, none greater than `most`. Moduli that would
    /// increase it are replaced by stiff ones.
    fn strains(&mut self, excess: [f64; 3], stiff: f64, most: f64) -> [f64; 3] {
        let excess = Vector3::from(excess);
        let found = self.matrix().lu().solve(&excess);
        let falls = found.filter(|strains| strains.dot(&excess) > 0.0);
        let strains = falls.unwrap_or_else(|| {
            *self = Self::stiff(stiff);
            excess / stiff
        });
        let greatest = strains.amax();
        let share = if greatest > most {
            most / greatest
        } else {
            1.0
        };
        (strains * share).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The stresses of a linear packing with coupled axes are found in few corrections.
    #[test]
    fn coupled_stresses_are_found() {
        let elastic = Matrix3::new(1.0, 0.4, 0.3, 0.4, 1.2, 0.35, 0.3, 0.35, 0.8);
        for stiff in [0.5, 1.0, 3.0] {
            let mut moduli = Moduli::stiff(stiff);
            let mut excess = Vector3::new(1e-3, -2e-3, 0.5e-3);
            let mut trials = 0;
            while excess.amax() > 1e-9 {
                let by = moduli.strains(excess.into(), stiff, 1e-2);
                let after = excess - elastic * Vector3::from(by);
                moduli.update(by, (excess - after).into());
                excess = after;
                trials += 1;
                assert!(trials <= 12, "{stiff}: {excess:?}");
            }
        }
    }

    /// Corrections are bounded, and reduce the excess.
    #[test]
    fn corrections_are_bounded_and_fall() {
        let mut moduli = Moduli([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(moduli.strains([0.5, 0.0, 0.0], 2.0, 0.1), [0.1, 0.0, 0.0]);
        assert_eq!(moduli, Moduli::stiff(2.0));
        moduli.update([0.1, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        assert_eq!(moduli, Moduli::stiff(8.0));
    }
}
