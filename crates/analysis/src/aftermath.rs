//! What becomes of a growing pair in a periodic box under Newton's equations: catastrophe or
//! saturation (BO section IV, figure 5).

/// What the motion has become at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Aftermath {
    /// Grains have moved so far that they have lost or changed contacts.
    Catastrophe,
    /// The growth has ended at small displacements.
    Saturation,
    /// Displacements are still those of the linear growth.
    Growing,
}

impl Aftermath {
    /// Returns the name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Aftermath::Catastrophe => "catastrophe",
            Aftermath::Saturation => "saturation",
            Aftermath::Growing => "growing",
        }
    }
}

/// Root mean square displacement over the mean diameter from which the motion is a catastrophe: an
/// overlap is a few hundredths of a diameter.
pub(crate) const CATASTROPHE: f64 = 1e-2;
/// The same up to which it is still the linear growth.
pub const LINEAR: f64 = 1e-5;
/// Share of the time, at the end, of which means are taken: without damping the packing vibrates.
const END: f64 = 0.1;

gshear_dem::columns! {
    /// Changes over Newton's equations. Values at the end are means over the last tenth of the
    /// time.
    pub struct BoxChange {
        /// pressure at the start of Newton's equations
        pressure_before: "Pa",
        /// shear stress at the start
        stress_before: "Pa",
        /// shear stress at the end less that at the start
        stress_change: "Pa",
        /// |change of the shear stress| over the pressure before
        change_over_pressure: "1",
        /// |change of the shear stress| over its size before
        change_over_stress: "1",
        /// change of the pressure over the pressure before
        pressure_change: "1",
        /// change of the elastic energy over that before
        energy_change: "1",
        /// change of the number of contacts over that before
        contacts_change: "1",
        /// root mean square displacement over the mean diameter
        displacement: "1",
        /// time since the start until a root mean square displacement of 1e-5 mean diameters; NaN
        /// without
        linear_until: "s",
        /// the same of 1e-2 mean diameters, a catastrophe
        catastrophe_at: "s",
    }
}

/// Columns of the time series, `[L]` each.
#[derive(Debug, Clone, Copy)]
pub struct BoxSeries<'a> {
    /// Times, ascending.
    pub time: &'a [f64],
    /// Mean square displacement.
    pub msd: &'a [f64],
    /// Shear stress.
    pub stress: &'a [f64],
    /// Pressure.
    pub pressure: &'a [f64],
    /// Elastic energy.
    pub energy: &'a [f64],
    /// Number of contacts.
    pub contacts: &'a [f64],
}

impl BoxChange {
    /// Compares the end of the series with its first row; `None` without rows.
    pub fn of(series: BoxSeries<'_>, mean_diameter: f64) -> Option<Self> {
        let (&first, &last) = (series.time.first()?, series.time.last()?);
        let begin = last - END * (last - first);
        let from = series.time.partition_point(|t| *t < begin);
        let [pressure, stress, energy, contacts, msd] = [
            series.pressure,
            series.stress,
            series.energy,
            series.contacts,
            series.msd,
        ]
        .map(|column| Ends {
            before: column[0],
            after: mean_in_time(&series.time[from..], &column[from..]),
        });
        let change = stress.after - stress.before;
        let [linear_until, catastrophe_at] = [LINEAR, CATASTROPHE].map(|displacement| {
            let msd = (displacement * mean_diameter).powi(2);
            let row = series.msd.iter().position(|m| *m >= msd);
            row.map_or(f64::NAN, |row| series.time[row] - first)
        });
        Some(Self {
            pressure_before: pressure.before,
            stress_before: stress.before,
            stress_change: change,
            change_over_pressure: change.abs() / pressure.before,
            change_over_stress: change.abs() / stress.before.abs(),
            pressure_change: pressure.relative_change(),
            energy_change: energy.relative_change(),
            contacts_change: contacts.relative_change(),
            displacement: msd.after.sqrt() / mean_diameter,
            linear_until,
            catastrophe_at,
        })
    }

    /// Judges by the displacement.
    pub fn aftermath(&self) -> Aftermath {
        if self.displacement >= CATASTROPHE {
            Aftermath::Catastrophe
        } else if self.displacement > LINEAR {
            Aftermath::Saturation
        } else {
            Aftermath::Growing
        }
    }
}

/// A column at the start and at the end.
struct Ends {
    before: f64,
    after: f64,
}

impl Ends {
    fn relative_change(&self) -> f64 {
        self.after / self.before - 1.0
    }
}

/// Mean by the trapezoidal rule, because rows are not at equal intervals; of one row its value.
fn mean_in_time(time: &[f64], values: &[f64]) -> f64 {
    let whole = time[time.len() - 1] - time[0];
    if whole <= 0.0 {
        return values[values.len() - 1];
    }
    let intervals = 0..time.len() - 1;
    let parts = intervals.map(|k| 0.5 * (values[k] + values[k + 1]) * (time[k + 1] - time[k]));
    parts.sum::<f64>() / whole
}

#[cfg(test)]
mod tests {
    use super::Aftermath::{Catastrophe, Growing, Saturation};
    use super::*;

    /// The change over a series of mean square displacement, stress, pressure, energy and number
    /// of contacts.
    fn change(time: &[f64], [msd, stress, pressure, energy, contacts]: [&[f64]; 5]) -> BoxChange {
        let series = BoxSeries {
            time,
            msd,
            stress,
            pressure,
            energy,
            contacts,
        };
        BoxChange::of(series, DIAMETER).expect("rows")
    }

    const DIAMETER: f64 = 2.0;

    /// A stress that falls from 4 to 3 and vibrates about it, on uneven rows.
    #[test]
    fn changes_are_of_the_mean_at_the_end() {
        let row = |k: u32| f64::from(k) + if k.is_multiple_of(3) { 0.3 } else { 0.0 };
        let time: Vec<f64> = (0..2001).map(row).collect();
        let column = |before: f64, after: f64| -> Vec<f64> {
            let vibrating = |t: &f64| after + 0.2 * (std::f64::consts::TAU * t / 20.0).sin();
            let at = |t: &f64| if *t < 1000.0 { before } else { vibrating(t) };
            time.iter().map(at).collect()
        };
        let (stress, pressure) = (column(-4.0, -3.0), column(50.0, 45.0));
        let (energy, contacts) = (column(10.0, 8.0), column(400.0, 380.0));
        let of = |msd: f64| {
            let msd = vec![msd; time.len()];
            change(&time, [&msd, &stress, &pressure, &energy, &contacts])
        };
        let change = of(4e-2);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-3, "{a} {b}");
        assert_eq!((change.pressure_before, change.stress_before), (50.0, -4.0));
        near(change.stress_change, 1.0);
        near(change.change_over_pressure, 0.02);
        near(change.change_over_stress, 0.25);
        near(change.pressure_change, -0.1);
        near(change.energy_change, -0.2);
        near(change.contacts_change, -0.05);
        near(change.displacement, 0.1);
        assert_eq!((change.linear_until, change.catastrophe_at), (0.0, 0.0));
        let found = [4e-2, 4e-6, 4e-12].map(|msd| of(msd).aftermath());
        assert_eq!(found, [Catastrophe, Saturation, Growing]);
    }

    /// A displacement that grows by a factor e in every unit of time, from 1e-8 diameters on.
    #[test]
    fn times_are_those_of_the_displacement() {
        let time: Vec<f64> = (0..1800).map(|k| 5.0 + 0.01 * f64::from(k)).collect();
        let msd = |t: &f64| (1e-8 * DIAMETER * (t - 5.0).exp()).powi(2);
        let msd: Vec<f64> = time.iter().map(msd).collect();
        let of = |rows: usize| {
            let ones = vec![1.0; rows];
            change(&time[..rows], [&msd[..rows], &ones, &ones, &ones, &ones])
        };
        let whole = of(time.len());
        let within = |found: f64, factor: f64| {
            let late = found - factor.ln();
            assert!((0.0..0.01 + 1e-9).contains(&late), "{found} {factor}");
        };
        within(whole.linear_until, 1e3);
        within(whole.catastrophe_at, 1e6);
        let short = of(1000);
        assert_eq!(short.linear_until.to_bits(), whole.linear_until.to_bits());
        assert!(short.catastrophe_at.is_nan());
    }
}
