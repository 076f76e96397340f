//! How μ relaxes in holds, averaged over the holds of one kind in all realisations.

use super::slider_record::SliderRecord;
use super::steps_and_holds::{Line, reload_stiffness};
use crate::moments::{Moments, grouped, mean};

/// Times since the start of a hold at which μ is averaged, over powers of ten.
const MANTISSAS: [f64; 2] = [1.0, 3.0];
/// The value at t is that of a line in ln t through the rows from t/`WINDOW` to t·`WINDOW`.
const WINDOW: f64 = 1.2;
/// Share of the slide before a hold over whose end μ and T are averaged.
const LAST: f64 = 0.01;
/// Holds are of one kind if velocities and durations agree to this share.
const SAME: f64 = 1e-3;
const FIRST_DECADE: i32 = -9;
const LAST_DECADE: i32 = 9;

/// Holds of one duration after one velocity, at one time since their start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relaxation {
    /// V_i (m/s).
    pub before: f64,
    /// t_hold (s).
    pub duration: f64,
    /// Mean k̄ of the spring (1/m).
    pub stiffness: f64,
    /// Mean k̄ of layer and spring together as the reslides show it (`reload_stiffness`, 1/m);
    /// NaN if no slide follows.
    pub reload: f64,
    /// Time since the start of the hold (s).
    pub time: f64,
    /// Number of holds averaged.
    pub holds: usize,
    /// Mean of μ less that at the end of the slide before.
    pub change: f64,
    /// Standard error of `change`, from the scatter among the holds; NaN for a single one.
    pub error: f64,
    /// Mean granular temperature, as in [`SliderRecord`].
    pub temperature: f64,
    /// That of the spins.
    pub spin_temperature: f64,
}

impl Relaxation {
    /// The change by the direct effect alone, -a ln(1 + k̄ V_i t/a): at a constant state the slider
    /// creeps and unloads what holds it. `stiffness` is k̄ (1/m): of the spring, or of the reload.
    pub fn of_direct_effect(&self, a: f64, stiffness: f64) -> f64 {
        -a * (stiffness * self.before * self.time / a).ln_1p()
    }
}

/// A hold of one record: its velocity before, its duration, and its rows as time since its start,
/// change of μ, and both temperatures.
struct Course {
    before: f64,
    duration: f64,
    stiffness: f64,
    reload: Option<f64>,
    rows: Vec<[f64; 4]>,
}

impl Course {
    /// The change and both temperatures at a time.
    fn at(&self, time: f64) -> Option<[f64; 3]> {
        let rows = self.rows.iter();
        let rows: Vec<&[f64; 4]> = rows
            .filter(|row| time / WINDOW <= row[0] && row[0] <= time * WINDOW)
            .collect();
        if rows.is_empty() {
            return None;
        }
        let [mean_change, temperature, spin_temperature] =
            [1, 2, 3].map(|k| rows.iter().map(|row| row[k]).sum::<f64>() / rows.len() as f64);
        // A mean would be that of earlier times at the end of a hold, which cuts the window.
        let points = rows.iter().map(|row| [(row[0] / time).ln(), row[1]]);
        let line = Line::fit(&points.collect::<Vec<_>>());
        let change = line.map_or(mean_change, |line| line.intercept);
        Some([change, temperature, spin_temperature])
    }
}

fn courses(record: &SliderRecord) -> Vec<Course> {
    let segments = (1..record.drive.len()).filter_map(|segment| {
        let (slide, hold) = (record.drive[segment - 1], record.drive[segment]);
        if slide.is_hold() || !hold.is_hold() {
            return None;
        }
        let begin = record.begin(segment);
        let last = record.rows(segment - 1);
        let mut late = last.clone();
        let first = late.find(|row| record.time[*row] >= begin - LAST * slide.duration);
        let start = record.mean_friction(first.unwrap_or(last.end)..last.end);
        let rows = record.rows(segment).map(|row| {
            let change = record.friction[row] - start;
            let temperature = record.temperature[row];
            let spin_temperature = record.spin_temperature[row];
            [
                record.time[row] - begin,
                change,
                temperature,
                spin_temperature,
            ]
        });
        Some(Course {
            before: slide.velocity,
            duration: hold.duration,
            stiffness: record.stiffness,
            reload: reload_stiffness(record, segment + 1),
            rows: rows.collect(),
        })
    });
    segments.collect()
}

/// Returns the averages over the holds of all records, at 1 and 3 times powers of ten and at the
/// end, in the order in which kinds of holds first occur.
pub fn relaxations(records: &[SliderRecord]) -> Vec<Relaxation> {
    let groups = grouped(records.iter().flat_map(courses), |a, b| {
        is_near(a.before, b.before) && is_near(a.duration, b.duration)
    });
    groups.iter().flat_map(|group| averages(group)).collect()
}

/// Whether two values agree to the share [`SAME`].
fn is_near(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME * a.abs().max(b.abs())
}

/// The averages over holds of one kind.
fn averages(group: &[Course]) -> Vec<Relaxation> {
    let duration = group[0].duration;
    let reloads: Vec<f64> = group.iter().filter_map(|course| course.reload).collect();
    let stiffnesses: Vec<f64> = group.iter().map(|course| course.stiffness).collect();
    let decades = FIRST_DECADE..=LAST_DECADE;
    let times = decades.flat_map(|k| MANTISSAS.map(|m| m * 10f64.powi(k)));
    let before = times.filter(|t| *t < duration * (1.0 - SAME));
    let averages = before.chain([duration]).filter_map(|time| {
        let means = group.iter().filter_map(|course| course.at(time));
        let means: Vec<[f64; 3]> = means.collect();
        let [changes, temperatures, spin_temperatures] =
            [0, 1, 2].map(|k| means.iter().map(|row| row[k]).collect::<Vec<f64>>());
        let moments = Moments::of(&changes);
        // At shorter times than those between rows there is nothing to average.
        (changes.len() == group.len()).then(|| Relaxation {
            before: group[0].before,
            duration,
            stiffness: mean(&stiffnesses),
            reload: mean(&reloads),
            time,
            holds: changes.len(),
            change: moments.mean,
            error: moments.error(),
            temperature: mean(&temperatures),
            spin_temperature: mean(&spin_temperatures),
        })
    });
    averages.collect()
}
