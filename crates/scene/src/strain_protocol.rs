//! The parts of a protocol of strain steps: tests of a laboratory on a periodic cell, of which each
//! axis has a strain or a stress imposed.

use std::ops::Bound;

use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::keys::{ANY, Bounds, Key, POSITIVE};

use crate::part_values::{PartRules, PartValues, STRAIN};
use crate::table::table;
use crate::words::show;

/// Whole numbers.
const COUNT: Bounds = Bounds {
    from: Bound::Included(1.0),
    to: Bound::Included(1e6),
};

table! {
    /// The keys of a part of the protocol of strain steps.
    STRAIN_PART: StrainPartKeys Branch {
        /// change of γ: the images above are displaced along x
        shear_strain: Number(ANY) {},
        /// strain of L_x, -ln(L_x/L_x,0) with L_x,0 at the start of the part: compression is
        /// positive, as of stresses
        strain_xx: Number(STRAIN) {},
        /// the same of L_y
        strain_yy: Number(STRAIN) {},
        /// the same of L_z; in 3D
        strain_zz: Number(STRAIN) {},
        /// strain of the volume, of which axes without a key of their own have equal shares; 0 is a
        /// constant volume
        volume_strain: Number(STRAIN) { condition: "without a stress" },
        /// normal stress along x at the end of the part, reached by L_x along a straight line; the
        /// present one is held
        stress_xx: Number(POSITIVE) { unit: "pressure", condition: "instead of `strain_xx`" },
        /// the same along y
        stress_yy: Number(POSITIVE) { unit: "pressure", condition: "instead of `strain_yy`" },
        /// the same along z; in 3D
        stress_zz: Number(POSITIVE) { unit: "pressure", condition: "instead of `strain_zz`" },
        /// mean of the normal stresses at the end of the part, reached along a straight line by
        /// equal strains of the axes without a key of their own
        pressure: Number(POSITIVE) {
            unit: "pressure",
            condition: "instead of `volume_strain`",
        },
        /// the strains are amplitudes: they go to their values, to the opposite ones and back to 0
        /// along straight lines, so many times
        cycles: Number(COUNT) { condition: "a whole number, with a strain" },
        /// number of strain steps of a part without strains; with one it follows from
        /// `aqs.strain_step`
        steps: Number(COUNT) { condition: "a whole number" },
    }
}

/// Which keys of a part go together.
static RULES: PartRules = PartRules {
    table: StrainPartKeys::TABLE,
    needs: &[(
        &STRAIN_PART.cycles,
        &[
            &STRAIN_PART.shear_strain,
            &STRAIN_PART.strain_xx,
            &STRAIN_PART.strain_yy,
            &STRAIN_PART.strain_zz,
            &STRAIN_PART.volume_strain,
        ],
    )],
    exclusive: &[
        &[&STRAIN_PART.strain_xx, &STRAIN_PART.stress_xx],
        &[&STRAIN_PART.strain_yy, &STRAIN_PART.stress_yy],
        &[&STRAIN_PART.strain_zz, &STRAIN_PART.stress_zz],
        &[&STRAIN_PART.volume_strain, &STRAIN_PART.pressure],
        &[&STRAIN_PART.volume_strain, &STRAIN_PART.stress_xx],
        &[&STRAIN_PART.volume_strain, &STRAIN_PART.stress_yy],
        &[&STRAIN_PART.volume_strain, &STRAIN_PART.stress_zz],
    ],
};

/// Strains and stresses of the axes.
static STRAINS: [&Key; 3] = [
    &STRAIN_PART.strain_xx,
    &STRAIN_PART.strain_yy,
    &STRAIN_PART.strain_zz,
];
static STRESSES: [&Key; 3] = [
    &STRAIN_PART.stress_xx,
    &STRAIN_PART.stress_yy,
    &STRAIN_PART.stress_zz,
];

/// A part of a protocol of strain steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrainPart {
    /// γ, by which the images above are displaced.
    pub shear: f64,
    /// Natural strains of the axes, compression positive.
    pub strain: [f64; 3],
    /// See [`Self::controls`].
    controls: [Option<StressControl>; 3],
    /// How often the strains go to their values, to the opposite ones and back; 0: only there.
    pub cycles: u64,
    /// Number of strain steps.
    pub steps: u64,
}

/// A mean of normal stresses, and the axes whose equal strains bring it to a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StressControl {
    /// The axes of whose normal stresses it is the mean.
    pub measured: [bool; 3],
    /// The axes that are strained.
    pub moved: [bool; 3],
    /// The stress.
    pub stress: f64,
}

impl StrainPart {
    /// The share of the strains after so many steps of the part, -1 to 1.
    pub fn share(&self, step: u64) -> f64 {
        if self.cycles == 0 {
            return step as f64 / self.steps as f64;
        }
        let quarter = self.steps / (4 * self.cycles);
        let phase = (step % (4 * quarter)) as f64 / quarter as f64;
        if phase <= 1.0 {
            phase
        } else if phase <= 3.0 {
            2.0 - phase
        } else {
            phase - 4.0
        }
    }

    /// The stresses that it brings to values.
    pub fn controls(&self) -> impl Iterator<Item = StressControl> + use<> {
        self.controls.into_iter().flatten()
    }

    /// The part that has a strain step, counted from 1, and the number of the step in it.
    pub fn of_step(parts: &[Self], step: u64) -> Option<(usize, u64)> {
        let mut within = step;
        for (n, part) in parts.iter().enumerate() {
            if within <= part.steps {
                return Some((n, within));
            }
            within -= part.steps;
        }
        None
    }

    /// The parts that have begun after so many strain steps.
    pub(crate) fn begun(parts: &[Self], steps: u64) -> &[Self] {
        let count = match (steps, Self::of_step(parts, steps)) {
            (0, _) => 0,
            (_, Some((n, _))) => n + 1,
            (_, None) => parts.len(),
        };
        &parts[..count]
    }

    /// γ after so many strain steps.
    pub fn shear_after(parts: &[Self], steps: u64) -> f64 {
        let mut shear = 0.0;
        let mut left = steps;
        for part in parts {
            let within = left.min(part.steps);
            shear += part.shear * part.share(within);
            left -= within;
        }
        shear
    }

    /// The greatest compressive strain of each axis within the part, as far as it is imposed.
    pub(crate) fn most_compressed(&self, axis: usize) -> f64 {
        let strain = self.strain[axis];
        if self.cycles > 0 {
            strain.abs()
        } else {
            strain.max(0.0)
        }
    }
}

/// The parts of a protocol in this dimension, with strain steps of at most `strain_step`.
///
/// # Errors
/// What is wrong with which part, and what would be right.
pub(crate) fn parts(
    given: &[Vec<(String, f64)>],
    dimension: Dimensions,
    strain_step: f64,
) -> Result<Vec<StrainPart>, String> {
    if given.is_empty() {
        return Err("has no parts; give one or more, such as { shear_strain = 0.1 }".into());
    }
    let mut parts = Vec::new();
    for (n, values) in given.iter().enumerate() {
        let part = PartValues(values).strain_part(dimension, strain_step);
        parts.push(part.map_err(|what| format!("part {}: {what}", n + 1))?);
    }
    Ok(parts)
}

impl PartValues<'_> {
    fn strain_part(&self, dimension: Dimensions, strain_step: f64) -> Result<StrainPart, String> {
        self.check(&RULES)?;
        let axes = dimension.axes();
        for key in [STRAINS, STRESSES].iter().flat_map(|keys| &keys[axes..]) {
            if self.has(key) {
                return Err(format!("{} needs dimension = 3; leave it out", key.path));
            }
        }
        let mut strain = STRAINS.map(|key| self.value(key).unwrap_or(0.0));
        let is_free = std::array::from_fn(|axis| {
            axis < axes && !self.has(STRAINS[axis]) && !self.has(STRESSES[axis])
        });
        let free = is_free.iter().filter(|is_free| **is_free).count();
        for key in [&STRAIN_PART.volume_strain, &STRAIN_PART.pressure] {
            if self.has(key) && free == 0 {
                return Err(format!(
                    "{} needs an axis without a strain and a stress of its own; leave one of them out",
                    key.path
                ));
            }
        }
        if let Some(of_volume) = self.value(&STRAIN_PART.volume_strain) {
            let share = (of_volume - strain.iter().sum::<f64>()) / free as f64;
            for axis in (0..axes).filter(|axis| is_free[*axis]) {
                strain[axis] = share;
            }
        }
        let mut controls: [Option<StressControl>; 3] = std::array::from_fn(|axis| {
            let alone = std::array::from_fn(|other| other == axis);
            let stress = self.value(STRESSES[axis])?;
            Some(StressControl {
                measured: alone,
                moved: alone,
                stress,
            })
        });
        if let Some(stress) = self.value(&STRAIN_PART.pressure) {
            // A free axis has no control of its own.
            let place = controls.iter_mut().find(|control| control.is_none());
            *place.expect("a free axis") = Some(StressControl {
                measured: std::array::from_fn(|axis| axis < axes),
                moved: is_free,
                stress,
            });
        }
        let shear = self.value(&STRAIN_PART.shear_strain).unwrap_or(0.0);
        let greatest = strain.iter().fold(shear.abs(), |most, x| most.max(x.abs()));
        Ok(StrainPart {
            shear,
            strain,
            controls,
            cycles: self.whole(&STRAIN_PART.cycles)?.unwrap_or(0),
            steps: self.steps(greatest, strain_step)?,
        })
    }

    /// Number of strain steps of a part whose greatest strain is this.
    fn steps(&self, greatest: f64, strain_step: f64) -> Result<u64, String> {
        let given = self.whole(&STRAIN_PART.steps)?;
        if greatest == 0.0 {
            return given.ok_or_else(|| {
                "lacks a strain, such as shear_strain = 0.1, or steps for a stress, such as steps = 10"
                    .into()
            });
        }
        if given.is_some() {
            return Err(
                "steps is of parts without strains; leave it out, and give aqs.strain_step".into(),
            );
        }
        // Of a strain that is a whole number of steps but for rounding, no step more.
        let once = (greatest / strain_step * (1.0 - 1e-12)).ceil().max(1.0);
        let cycles = self.value(&STRAIN_PART.cycles);
        let steps = once * cycles.map_or(1.0, |cycles| 4.0 * cycles);
        if steps > MOST_STEPS {
            return Err(format!(
                "takes {steps:.1e} strain steps of {}; give a greater aqs.strain_step",
                show(strain_step)
            ));
        }
        Ok(steps as u64)
    }
}

/// Greatest number of strain steps of a part.
const MOST_STEPS: f64 = 1e9;

#[cfg(test)]
mod tests {
    use super::*;

    fn part(values: &[(&str, f64)], dimension: Dimensions) -> Result<StrainPart, String> {
        let values: Vec<_> = (values.iter())
            .map(|(name, x)| (name.to_string(), *x))
            .collect();
        parts(&[values], dimension, 1e-3).map(|parts| parts[0])
    }

    /// The strains of a part go there, and those of cycles to the opposite, and back.
    #[test]
    fn strains_go_along_straight_lines() {
        let once = part(&[("shear_strain", -0.0025)], Dimensions::Two).expect("a part");
        assert_eq!((once.steps, once.cycles), (3, 0));
        assert_eq!([0, 3].map(|step| once.share(step)), [0.0, 1.0]);
        let twice = part(&[("strain_yy", 2e-3), ("cycles", 2.0)], Dimensions::Two);
        let twice = twice.expect("a part");
        assert_eq!(twice.steps, 16);
        let shares: Vec<f64> = (0..=16).map(|step| twice.share(step)).collect();
        let cycle = [0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5];
        assert_eq!(shares, [&cycle[..], &cycle, &[0.0]].concat());
        let parts = [once, twice];
        for (step, place) in [(1, (0, 1)), (3, (0, 3)), (4, (1, 1)), (19, (1, 16))] {
            assert_eq!(StrainPart::of_step(&parts, step), Some(place));
        }
        assert_eq!(StrainPart::of_step(&parts, 20), None);
    }

    /// Axes without a key of their own share the strain of the volume, and the pressure.
    #[test]
    fn free_axes_share_the_volume_and_the_pressure() {
        let undrained = [("strain_zz", 0.02), ("volume_strain", 0.0)];
        let undrained = part(&undrained, Dimensions::Three).expect("a part");
        assert_eq!(undrained.strain, [-0.01, -0.01, 0.02]);
        assert_eq!(undrained.controls, [None; 3]);
        let constant = [("strain_zz", 0.02), ("stress_xx", 2.0), ("pressure", 3.0)];
        let constant = part(&constant, Dimensions::Three).expect("a part");
        let found: Vec<_> = constant.controls().collect();
        let own = StressControl {
            measured: [true, false, false],
            moved: [true, false, false],
            stress: 2.0,
        };
        let mean = StressControl {
            measured: [true; 3],
            moved: [false, true, false],
            stress: 3.0,
        };
        assert_eq!(found, [own, mean]);
    }

    #[test]
    fn parts_that_contradict_themselves_are_refused() {
        for (values, what) in [
            (&[][..], "part 1: lacks a strain"),
            (&[("pressure", 1.0)], "part 1: lacks a strain"),
            (
                &[("strain_zz", 0.1)],
                "part 1: strain_zz needs dimension = 3",
            ),
            (
                &[("strain_xx", 0.1), ("stress_xx", 1.0)],
                "part 1: has both strain_xx and stress_xx",
            ),
            (
                &[("strain_xx", 0.1), ("strain_yy", 0.1), ("pressure", 1.0)],
                "part 1: pressure needs an axis without",
            ),
            (
                &[("shear_strain", 0.1), ("cycles", 1.5)],
                "part 1: cycles must be a whole number, found 1.5",
            ),
            (
                &[("shear_strain", 0.1), ("steps", 5.0)],
                "part 1: steps is of parts without strains",
            ),
            (
                &[("pressure", 1.0), ("cycles", 2.0)],
                "part 1: cycles needs",
            ),
            (
                &[("shear_strain", 1e30)],
                "part 1: takes 1.0e33 strain steps",
            ),
        ] {
            let found = part(values, Dimensions::Two).expect_err("refused");
            assert!(found.starts_with(what), "{values:?}: {found}");
        }
    }
}
