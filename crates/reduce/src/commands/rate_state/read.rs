//! Reads the record of an experiment from a run. Only this module knows the names of columns and
//! keys.

use gshear_analysis::moments::{extent, mean};
use gshear_analysis::rate_state::{DriveSegment, SliderRecord, of_drive};
use gshear_dem::failure::Result;
use gshear_store::run_reader::RunFile;

/// The load of a protocol that imposes more than velocities.
const IMPOSED: &str = "imposed_normal_force";
/// Loads are equal if their means over half a segment agree to this share: an oscillation is no
/// change.
const SAME_LOAD: f64 = 0.05;
/// Columns that a row must have. Friction is undefined where the slider touches nothing.
const MEASURED: [&str; 5] = [
    "stress_ratio",
    "normal_force",
    "slip",
    "drive_velocity",
    "drive_displacement",
];
/// Of velocities and of spins; recorded with `output.temperatures`.
const TEMPERATURES: [&str; 2] = ["granular_temperature", "spin_temperature"];
/// Smallest number of rows of the time series in a segment.
const FEWEST_ROWS: usize = 20;

/// Returns the record of a spring-driven run, from its first slide on. A last segment with too few
/// rows, as in a run that was stopped, is left out.
///
/// # Errors
/// No spring, no velocity step or hold, segments with too few rows.
pub fn record(run: &RunFile) -> Result<SliderRecord> {
    let spring = run.number("spring_stiffness").ok_or_else(|| {
        run.wrong(
            "parameters: attribute spring_stiffness is missing: rate-state needs a run whose top wall is pulled by a spring \
             (shear.spring_stiffness or shear.spring_number)",
        )
    })?;
    let series = run.series();
    let measured = MEASURED.map(|name| series.column(name));
    let whole: Vec<usize> = (0..series.rows())
        .filter(|row| measured.iter().all(|column| column[*row].is_finite()))
        .collect();
    let time = chosen(&series.time, &whole);
    let [friction, normal_force, slip, velocity, displacement] =
        measured.map(|column| chosen(column, &whole));
    let [temperature, spin_temperature] =
        TEMPERATURES.map(|name| scaled_temperature(run, name, &whole));
    if let Some(row) = (1..time.len()).find(|&row| time[row] <= time[row - 1]) {
        let name = "observables/stress_ratio/time";
        return Err(run.wrong(format!("{name}: does not increase at row {row}")));
    }
    let drive = of_drive(&time, &velocity, &displacement)
        .map_err(|what| run.wrong(format!("observables/drive_velocity: {what}")))?;
    // What comes before the first slide, perhaps under another load, is left out.
    let normal = &normal_force[velocity.iter().position(|v| *v > 0.0).unwrap_or(0)..];
    let force = mean(normal);
    if !time.is_empty() && (force.is_nan() || force <= 0.0) {
        return Err(run.wrong(format!(
            "observables/normal_force: its mean is {force:e} N, must be positive: the slider must press on the sample"
        )));
    }
    let record = SliderRecord {
        load: normal_force.iter().map(|n| n / force).collect(),
        temperature,
        spin_temperature,
        ..SliderRecord::of_run(spring / force, drive, [time, slip, friction])
    };
    let tested = tested(&record, "observables/drive_velocity").map_err(|what| run.wrong(what))?;
    if series.has(IMPOSED) {
        let imposed = chosen(series.column(IMPOSED), &whole);
        let first = record.time.partition_point(|t| *t < tested.time[0]);
        let place = format!("observables/{IMPOSED}");
        one_load(&tested, &imposed[first..], &place, "N").map_err(|what| run.wrong(what))?;
    }
    Ok(tested)
}

/// The values of a column in some rows.
fn chosen(column: &[f64], rows: &[usize]) -> Vec<f64> {
    rows.iter().map(|row| column[*row]).collect()
}

/// Refuses a load that changes: k̄ and the laws are of one normal force. `imposed` `[L]`, in the
/// `unit`, is from the `place`.
pub(super) fn one_load(
    record: &SliderRecord,
    imposed: &[f64],
    place: &str,
    unit: &str,
) -> Result<(), String> {
    let halves = (0..record.drive.len()).flat_map(|segment| record.halves(segment));
    let halves = halves.filter(|rows| !rows.is_empty());
    let means: Vec<f64> = halves.map(|rows| mean(&imposed[rows])).collect();
    let [least, greatest] = extent(means.iter().copied());
    let free = means.iter().any(|load| load.is_nan());
    if !free && greatest - least <= SAME_LOAD * greatest {
        return Ok(());
    }
    let what = if free {
        "no load is imposed in a part of the protocol".into()
    } else {
        format!("the load changes from {least:.4e} to {greatest:.4e} {unit}")
    };
    Err(format!(
        "{place}: {what}, but k/N and the laws are of one load; reduce runs whose mean load is constant \
         from the first slide on"
    ))
}

/// A column of temperatures over P d̄³, in 2D over P d̄², in some rows. NaN without the column or a
/// pressure.
fn scaled_temperature(run: &RunFile, name: &str, rows: &[usize]) -> Vec<f64> {
    let series = run.series();
    if !series.has(name) {
        return vec![f64::NAN; rows.len()];
    }
    let diameter = 2.0 * run.grains().mean_radius();
    let pressure = run.number("pressure").unwrap_or(f64::NAN);
    let unit = pressure * diameter.powi(run.dimension().axes() as i32);
    let temperatures = chosen(series.column(name), rows);
    temperatures.iter().map(|t| t / unit).collect()
}

/// Cuts the record to start at its first slide, and checks the number of segments and of their
/// rows. `drive`: where the motion of the drive is from.
pub(super) fn tested(record: &SliderRecord, drive: &str) -> Result<SliderRecord, String> {
    let Some(first) = record.drive.iter().position(|segment| !segment.is_hold()) else {
        return Err(format!(
            "{drive}: no velocity is above 0; rate-state needs a run that slides"
        ));
    };
    let mut end = record.drive.len();
    if record.rows(end - 1).len() < FEWEST_ROWS && end > first + 1 {
        end -= 1;
    }
    for segment in first..end {
        let rows = record.rows(segment).len();
        if rows < FEWEST_ROWS {
            let DriveSegment { velocity, duration } = record.drive[segment];
            return Err(format!(
                "segment {segment} of the drive ({velocity:.4e} m/s for {duration:.4e} s) has {rows} rows of the time series; it needs at least \
                 {FEWEST_ROWS}: write rows more often, or let it last longer"
            ));
        }
    }
    if end - first < 2 {
        return Err(format!(
            "{drive}: is {:e} m/s all the time; rate-state needs a velocity step or a hold",
            record.drive[first].velocity
        ));
    }
    Ok(record.cut(first..end))
}
