//! The paper's numbers and statements next to those of our runs.

use super::drops;
use super::studied::{Size, Studied};
use gshear_analysis::correlate::{CONFIGURATIONS, Length, Quantity, Subject};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::ranges::ValueRange;
use gshear_analysis::regions::{GrReading, Reduction};
use gshear_analysis::spearman::Correlation;
use gshear_store::table::Table;

use Length::{All, Long, Short};
use Quantity::{DminMax, DminSum, Duration, TopMax, TopSum};

/// Coefficients from this value on are called moderate. The paper says weak, moderate and strong
/// without numbers.
const MODERATE: f64 = 0.4;
/// Coefficients from this value on are called strong.
const STRONG: f64 = 0.6;

/// A line of the table.
pub struct QuotedNumber {
    /// Label of the run.
    pub run: String,
    /// The quantity or statement.
    pub what: String,
    /// The paper's value.
    pub paper: String,
    /// The run's value.
    pub ours: String,
}

/// Returns the lines of every run, one run after the other.
pub fn of(runs: &[Studied]) -> Vec<QuotedNumber> {
    runs.iter().flat_map(of_run).collect()
}

/// Returns the content of `numbers.csv`.
pub fn csv(numbers: &[QuotedNumber]) -> String {
    Table::of(numbers)
        .column("run", |number| &number.run)
        .column("what", |number| &number.what)
        .column("paper", |number| &number.paper)
        .column("ours", |number| &number.ours)
        .quoted()
        .csv()
}

fn of_run(run: &Studied) -> Vec<QuotedNumber> {
    let mut lines: Vec<(String, String, String)> = basics(run);
    lines.extend(drop(run));
    lines.extend(statements(run));
    let number = |(what, paper, ours)| QuotedNumber {
        run: run.label.clone(),
        what,
        paper,
        ours,
    };
    lines.into_iter().map(number).collect()
}

fn known(value: Option<f64>) -> String {
    value.map_or("unknown".into(), |value| format!("{value:.3e}"))
}

/// QuotedNumber of phases in the paper, by size and friction (sections 4 and 5, appendix C), each
/// in about 130,000 intervals.
fn phases_of_paper(run: &Studied) -> Option<f64> {
    let of_friction = match run.size {
        Size::Small => [18e3, 46e3, 52e3, 42e3],
        Size::Large => [12e3, 31e3, 31e3, 26e3],
    };
    let frictions = [0.1, 0.3, 0.5, 0.7];
    let k = frictions
        .iter()
        .position(|mu| run.friction.is_some_and(|ours| (ours - mu).abs() < 1e-9))?;
    Some(of_friction[k])
}

fn basics(run: &Studied) -> Vec<(String, String, String)> {
    let (grains, step, onset) = match run.size {
        Size::Small => ("about 1,000", "7.2e-7", "2.2 %"),
        Size::Large => ("about 5,000", "1.8e-6", "5.4 %"),
    };
    let regime = &run.regime;
    let intervals = regime.tau.len().saturating_sub(1);
    let span = regime.strain.last().copied().unwrap_or(0.0)
        - regime.strain.first().copied().unwrap_or(0.0);
    let phases = regime.phases.len();
    let share = phases as f64 / intervals.max(1) as f64;
    let counted = phases_of_paper(run);
    let paper = |of: fn(f64) -> String| counted.map_or("not given".into(), of);
    let [mean, deviation] = mean_and_deviation(&regime.tau);
    let line = |what: &str, paper: &str, ours: String| (what.to_string(), paper.to_string(), ours);
    vec![
        line("disks", grains, run.grains.count().to_string()),
        line("inertial number I", "4e-6", known(run.inertial_number)),
        line("stiffness number κ", "1e4", known(run.stiffness_number)),
        line(
            "Δγ between frames",
            step,
            format!("{:.3e}", span / intervals.max(1) as f64),
        ),
        line(
            "regime begins at γ",
            onset,
            format!("{:.3} %", 100.0 * run.onset),
        ),
        line(
            "intervals in the regime",
            "about 130,000",
            intervals.to_string(),
        ),
        line(
            "phases in the regime",
            &paper(|n| format!("about {n}")),
            phases.to_string(),
        ),
        line(
            "phases per interval",
            &paper(|n| format!("about {:.2}", n / 130e3)),
            format!("{share:.3}"),
        ),
        line(
            "long phases (t_p > 3Δγ)",
            "not given",
            regime
                .phases
                .iter()
                .filter(|p| p.phase.is_long())
                .count()
                .to_string(),
        ),
        line(
            "τ in the regime, mean and deviation",
            "similar for all μ_s; small and large similar, deviation smaller in the large",
            format!("{mean:.3}, {deviation:.3}"),
        ),
    ]
}

/// Mean and standard deviation.
pub fn mean_and_deviation(values: &[f64]) -> [f64; 2] {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>();
    [mean, (square / count).sqrt()]
}

/// GR regions around the largest drop.
pub struct DropRegions {
    /// Mean number in the intervals of Stage I.
    pub before: f64,
    /// Least number in the intervals of Stage II.
    pub least: f64,
}

/// Returns the GR regions around the largest drop; `None` without one.
pub fn drop_regions(run: &Studied, reduction: Reduction) -> Option<DropRegions> {
    let [before, during, _] = run.event.as_ref()?.stages.intervals();
    let reading = GrReading {
        reduction,
        min_points: run.choices.regions.min_points,
    };
    let count = |row: usize| run.regime.scalars[row].regions(reading);
    Some(DropRegions {
        before: before.clone().map(count).sum::<f64>() / before.count().max(1) as f64,
        least: during.map(count).fold(f64::INFINITY, f64::min),
    })
}

/// Returns by how many intervals the fastest decrease of τ in Stage II comes after the first
/// interval of Stages I and II whose g_t10%D²min is ten times that of the first one; `None` if none
/// is.
pub fn drop_lag(run: &Studied) -> Option<i64> {
    let [before, during, _] = run.event.as_ref()?.stages.intervals();
    let (tau, scalars) = (&run.regime.tau, &run.regime.scalars);
    let top = |row: usize| scalars[row].dmin_top_tenth;
    let first = top(*before.start());
    let rise = (*before.start()..=*during.end()).find(|row| top(*row) > 10.0 * first)?;
    let change = |row: usize| tau[row] - tau[row - 1];
    let fastest = during.min_by(|a, b| change(*a).total_cmp(&change(*b)))?;
    Some(fastest as i64 - rise as i64)
}

fn drop(run: &Studied) -> Vec<(String, String, String)> {
    let Some(event) = &run.event else {
        return Vec::new();
    };
    let strain = |row: usize| format!("{:.4} %", 100.0 * run.regime.strain[row]);
    let stages = &event.stages;
    let [from, to] = stages.drops[0];
    let paper = match (run.size, run.friction) {
        (Size::Small, Some(0.7)) => "10.0555 % to 10.0575 %",
        (Size::Large, Some(0.7)) => "9.380 % to 9.384 %",
        _ => "not given",
    };
    let scalars = &run.regime.scalars;
    let [before, during, _] = stages.intervals();
    let square = run.grains.mean_radius().powi(2);
    let greatest = |of: fn(&FrameScalars) -> f64| {
        let values = during.clone().map(|row| of(&scalars[row]));
        values.fold(f64::NAN, f64::max) / square
    };
    let rho = |rows: std::ops::RangeInclusive<usize>| {
        rows.map(|row| scalars[row].stress_dmin_rho)
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let line = |what: &str, paper: &str, ours: String| (what.to_string(), paper.to_string(), ours);
    let mut lines = vec![
        line(
            "largest drop, with its stages",
            paper,
            format!("{} to {}", strain(stages.begin), strain(stages.end)),
        ),
        line(
            "largest slip",
            "not given",
            format!(
                "Δτ_p = {:.4} from {} to {}",
                run.regime.tau[to] - run.regime.tau[from],
                strain(from),
                strain(to)
            ),
        ),
        line("next largest slips", "not given", drops::next(run)),
        line(
            "great slips in Stage II",
            if run.size == Size::Large { "2" } else { "1" },
            stages.drops.len().to_string(),
        ),
        line(
            "ρ of |Δσ_p| with D²min, greatest in Stage I, II",
            "low, high at the beginning",
            format!("{:.2}, {:.2}", rho(before.clone()), rho(during.clone())),
        ),
        line(
            "gD²min/r̄² and g_t10%D²min/r̄², greatest in Stage II",
            "almost the same in the small and the large sample",
            format!(
                "{:.2e}, {:.2e}",
                greatest(|s| s.dmin_greatest),
                greatest(|s| s.dmin_top_tenth)
            ),
        ),
        line(
            "intervals by which Δτ lags behind g_t10%D²min",
            "it lags",
            drop_lag(run).map_or("no rise".into(), |lag| lag.to_string()),
        ),
    ];
    for (reduction, words) in [
        (Reduction::Net, "net change"),
        (Reduction::Losses, "losses alone"),
        (Reduction::GreatestLoss, "greatest loss"),
    ] {
        let Some(DropRegions { before, least }) = drop_regions(run, reduction) else {
            continue;
        };
        lines.push(line(
            &format!("GR regions by {words}: mean of Stage I, least of Stage II"),
            "multiple, 1 (small) or few (large)",
            format!("{before:.1}, {least}"),
        ));
    }
    lines
}

/// A statement that one correlation is stronger than another in some ranges.
struct PaperComparison {
    what: &'static str,
    stronger: Subject,
    weaker: Subject,
    /// Greatest and least |Δτ| of the ranges, for slip.
    within: [f64; 2],
}

fn statements(run: &Studied) -> Vec<(String, String, String)> {
    let of = Subject::Phase;
    let comparisons = [
        (
            "mg_t10%: all phases rather than intervals",
            of(TopMax, All),
            Subject::TopTenth,
            [f64::INFINITY, 1e-3],
        ),
        (
            "sg_t10%: all phases rather than intervals",
            of(TopSum, All),
            Subject::TopTenth,
            [f64::INFINITY, 1e-3],
        ),
        (
            "mg_t10%: long rather than all phases",
            of(TopMax, Long),
            of(TopMax, All),
            [f64::INFINITY, 1e-4],
        ),
        (
            "sg_t10%: long rather than all phases",
            of(TopSum, Long),
            of(TopSum, All),
            [f64::INFINITY, 1e-4],
        ),
        (
            "mg_t10%: long rather than short phases",
            of(TopMax, Long),
            of(TopMax, Short),
            [f64::INFINITY, 1e-4],
        ),
        (
            "sg_t10%: long rather than short phases",
            of(TopSum, Long),
            of(TopSum, Short),
            [f64::INFINITY, 1e-4],
        ),
        (
            "long phases: mg_t10% rather than mg",
            of(TopMax, Long),
            of(DminMax, Long),
            [f64::INFINITY, 1e-5],
        ),
        (
            "long phases: sg_t10% rather than sg",
            of(TopSum, Long),
            of(DminSum, Long),
            [f64::INFINITY, 1e-5],
        ),
        (
            "long phases: sg_t10% rather than mg_t10%",
            of(TopSum, Long),
            of(TopMax, Long),
            [f64::INFINITY, 1e-5],
        ),
    ];
    let comparisons = comparisons.map(|(what, stronger, weaker, within)| PaperComparison {
        what,
        stronger,
        weaker,
        within,
    });
    let mut lines: Vec<_> = comparisons
        .iter()
        .map(|comparison| compare(run, comparison))
        .collect();

    for subject in [Subject::Greatest, Subject::TopTenth] {
        let words = match subject {
            Subject::Greatest => "gD²min",
            _ => "g_t10%D²min",
        };
        for (paper, where_, within) in [
            ("weak", "slip, Δτ < -1e-2", slip([f64::INFINITY, 1e-2])),
            ("moderate", "slip, -1e-2 < Δτ < -1e-3", slip([1e-2, 1e-3])),
            ("moderate", "stick, 1e-3 < Δτ < 1e-2", stick([1e-2, 1e-3])),
        ] {
            let what = format!("intervals, {words}, {where_}");
            lines.push((what, paper.into(), words_of(run, subject, within)));
        }
    }
    for quantity in [DminMax, DminSum, TopMax, TopSum] {
        lines.push((
            format!("all phases, {}, slip, Δτ_p < -1e-3", quantity.name()),
            "moderate to strong".into(),
            words_of(run, of(quantity, All), slip([f64::INFINITY, 1e-3])),
        ));
    }
    for quantity in [TopMax, TopSum] {
        for (within, paper, where_) in [
            ([f64::INFINITY, 1e-2], "strong", "Δτ_p < -1e-2"),
            ([1e-2, 1e-5], "mostly moderate", "-1e-2 < Δτ_p < 0"),
        ] {
            lines.push((
                format!("long phases, {}, {where_}", quantity.name()),
                paper.into(),
                words_of(run, of(quantity, Long), slip(within)),
            ));
        }
        lines.push((
            format!("short phases, {}, slip and stick", quantity.name()),
            "not strong".into(),
            words_of(run, of(quantity, Short), ANY),
        ));
    }
    let paper = match run.friction {
        Some(mu) if mu < 0.4 => "weak or insignificant",
        _ => "moderate",
    };
    for (what, paper, length, within) in [
        (
            "long stick phases, t_p, Δτ_p > 1e-3",
            paper,
            Long,
            stick([f64::INFINITY, 1e-3]),
        ),
        (
            "long stick phases, t_p, Δτ_p > 1e-4",
            paper,
            Long,
            stick([f64::INFINITY, 1e-4]),
        ),
        (
            "long slip phases, t_p",
            "weak",
            Long,
            slip([f64::INFINITY, 1e-5]),
        ),
        (
            "short slip phases, t_p",
            "weak",
            Short,
            slip([f64::INFINITY, 1e-5]),
        ),
        (
            "short stick phases, t_p",
            "weak",
            Short,
            stick([f64::INFINITY, 1e-5]),
        ),
    ] {
        let found = words_of(run, of(Duration, length), within);
        lines.push((what.into(), paper.into(), found));
    }
    let unit = run.grains.mean_radius().powi(2);
    for quantity in CONFIGURATIONS {
        let found = [TopMax, TopSum]
            .into_iter()
            .flat_map(|by| run.regime.correlate_by(by, unit, quantity));
        let what = format!(
            "long phases, {}, ranges of mg_t10% and sg_t10%",
            quantity.name()
        );
        lines.push((what, "weak or insignificant".into(), described(found)));
    }
    lines
}

fn compare(run: &Studied, comparison: &PaperComparison) -> (String, String, String) {
    let [stronger, weaker] =
        [comparison.stronger, comparison.weaker].map(|subject| run.regime.correlate(subject));
    let within = slip(comparison.within);
    let pairs = stronger.iter().zip(&weaker).filter(|((range, a), (_, b))| {
        within.contains(range) && a.is_significant() && b.is_significant()
    });
    let (mut holds, mut all) = (0, 0);
    for ((_, a), (_, b)) in pairs {
        all += 1;
        holds += usize::from(a.rho.abs() > b.rho.abs());
    }
    let [_, small] = comparison.within;
    let what = format!("slip, {} (Δτ < -{small:.0e})", comparison.what);
    let ours = if all == 0 {
        "no range in which both are significant".into()
    } else {
        format!("stronger in {holds} of {all} {}", run.choices.bins.name())
    };
    (what, "stronger".into(), ours)
}

/// Ranges that a statement is about.
#[derive(Clone, Copy)]
struct Within {
    /// 1 for stick, -1 for slip; `None` for both.
    sign: Option<f64>,
    /// The greatest and the least |Δτ|.
    great: f64,
    small: f64,
}

impl Within {
    fn contains(self, range: &ValueRange) -> bool {
        self.sign.is_none_or(|sign| range.farther * sign > 0.0)
            && range.farther.abs() <= self.great * 1.001
            && range.nearer.abs() >= self.small * 0.999
    }
}

fn slip([great, small]: [f64; 2]) -> Within {
    Within {
        sign: Some(-1.0),
        great,
        small,
    }
}

fn stick(within: [f64; 2]) -> Within {
    Within {
        sign: Some(1.0),
        ..slip(within)
    }
}

/// Every range.
const ANY: Within = Within {
    sign: None,
    great: f64::INFINITY,
    small: 0.0,
};

/// Returns the significant coefficients of a subject in the ranges `within`.
fn words_of(run: &Studied, subject: Subject, within: Within) -> String {
    let found = run.regime.correlate(subject).into_iter();
    described(found.filter(|(range, _)| within.contains(range)))
}

/// Returns |ρ| of every significant range, with the end of the range nearer to zero, the word for
/// it and the number of pairs.
fn described(found: impl Iterator<Item = (ValueRange, Correlation)>) -> String {
    let word = |rho: f64| match rho {
        rho if rho < MODERATE => "weak",
        rho if rho < STRONG => "moderate",
        _ => "strong",
    };
    let significant = found.filter(|(_, c)| c.is_significant());
    let words: Vec<String> = significant
        .map(|(range, c)| {
            let (rho, from) = (c.rho.abs(), range.nearer);
            format!("{rho:.2} {} (from {from:.1e}, {})", word(rho), c.count)
        })
        .collect();
    match words.is_empty() {
        true => "no significant range".into(),
        false => words.join("; "),
    }
}
