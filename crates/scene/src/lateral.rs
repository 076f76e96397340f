//! What parts of `shear.protocol` impose on the lengths of a cell without walls across its height.

use gshear_dem::boundary::Boundary;
use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::keys::Key;
use gshear_dem::protocol::{Course, Lateral, LateralAxis, Part};

use crate::part_keys::PART;
use crate::part_values::PartValues;

/// The keys of an axis.
struct AxisKeys {
    stress: &'static Key,
    end: &'static Key,
    strain: &'static Key,
}

/// Along x, and in 3D along y.
static AXES: [AxisKeys; 2] = [
    AxisKeys {
        stress: &PART.stress_xx,
        end: &PART.stress_xx_end,
        strain: &PART.strain_xx,
    },
    AxisKeys {
        stress: &PART.stress_yy,
        end: &PART.stress_yy_end,
        strain: &PART.strain_yy,
    },
];

/// The keys that change the lengths across the height.
pub(crate) static LATERAL_KEYS: [&Key; 8] = [
    &PART.mean_pressure,
    &PART.mean_pressure_end,
    &PART.stress_xx,
    &PART.stress_xx_end,
    &PART.strain_xx,
    &PART.stress_yy,
    &PART.stress_yy_end,
    &PART.strain_yy,
];

impl PartValues<'_> {
    /// What moves the lengths across the height, and the mean stress (Pa) if they follow that.
    pub(crate) fn lateral(&self) -> Option<(Lateral, Option<Course>)> {
        if let Some(from) = self.value(&PART.mean_pressure) {
            let mean = Course {
                from,
                to: self.value(&PART.mean_pressure_end).unwrap_or(from),
                wave: None,
            };
            return Some((Lateral::Isotropic, Some(mean)));
        }
        if !LATERAL_KEYS.iter().any(|key| self.has(key)) {
            return None;
        }
        let axis = |keys: &AxisKeys| match (self.value(keys.stress), self.value(keys.strain)) {
            (Some(from), _) => LateralAxis::Stress(Course {
                from,
                to: self.value(keys.end).unwrap_or(from),
                wave: None,
            }),
            (None, Some(strain)) => LateralAxis::Strain(strain),
            (None, None) => LateralAxis::Fixed,
        };
        Some((Lateral::Axes([axis(&AXES[0]), axis(&AXES[1])]), None))
    }

    /// Refuses lengths that the sample does not have, or that cannot change.
    ///
    /// # Errors
    /// What is wrong, and what would be right.
    pub(crate) fn check_lateral(
        &self,
        boundary: &Boundary,
        dimension: Dimensions,
    ) -> Result<(), String> {
        let mut given = LATERAL_KEYS.iter().filter(|key| self.has(key));
        let Some(first) = given.next() else {
            return Ok(());
        };
        if !boundary.is_periodic() {
            return Err(format!(
                "{} changes the lengths of a cell without walls, but sample.boundary = {:?}; leave it out, or give sample.boundary = \"periodic\"",
                first.path, boundary.key
            ));
        }
        let of_y = [&PART.stress_yy, &PART.stress_yy_end, &PART.strain_yy];
        if let Some(key) = of_y.into_iter().find(|key| self.has(key))
            && dimension == Dimensions::Two
        {
            return Err(format!(
                "{} is of the second horizontal axis of a sample of spheres; in 2D, y is the height: give pressure or wall_velocity",
                key.path
            ));
        }
        Ok(())
    }
}

/// Gives all parts lengths across the height, if some part changes them: without a key they stay.
pub(crate) fn give_all(parts: &mut [Part]) {
    if parts.iter().all(|part| part.imposed.lateral.is_none()) {
        return;
    }
    for part in parts {
        let fixed = Lateral::Axes([LateralAxis::Fixed; 2]);
        part.imposed.lateral.get_or_insert(fixed);
    }
}

/// The stresses (Pa) that a part imposes along the axes across the height.
pub(crate) fn stresses(part: &Part) -> impl Iterator<Item = &Course> {
    let axes = match &part.imposed.lateral {
        Some(Lateral::Axes(axes)) => &axes[..],
        Some(Lateral::Isotropic) | None => &[],
    };
    axes.iter().filter_map(|axis| match axis {
        LateralAxis::Stress(course) => Some(course),
        LateralAxis::Fixed | LateralAxis::Strain(_) => None,
    })
}
