//! The paper's numbers and statements next to those of our runs.

use super::drops;
use super::studied::{Size, Studied};
use gshear_analysis::correlate::{CONFIGURATIONS, Length, Quantity, Subject};
use gshear_analysis::ranges::ValueRange;
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
    ]
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
    let least = |rows: std::ops::RangeInclusive<usize>| {
        rows.map(|row| scalars[row].regions)
            .fold(f64::INFINITY, f64::min)
    };
    let [before, during, _] = stages.intervals();
    let mean = before.clone().map(|row| scalars[row].regions).sum::<f64>()
        / before.clone().count().max(1) as f64;
    let rho = |rows: std::ops::RangeInclusive<usize>| {
        rows.map(|row| scalars[row].stress_dmin_rho)
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let line = |what: &str, paper: &str, ours: String| (what.to_string(), paper.to_string(), ours);
    vec![
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
            "GR regions in Stage I, mean",
            "multiple",
            format!("{mean:.1}"),
        ),
        line(
            "GR regions in Stage II, least",
            "1 (small), few (large)",
            format!("{}", least(during.clone())),
        ),
        line(
            "ρ of |Δσ_p| with D²min, greatest in Stage I, II",
            "low, high at the beginning",
            format!("{:.2}, {:.2}", rho(before), rho(during)),
        ),
    ]
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
            [1e-1, 1e-3],
        ),
        (
            "sg_t10%: all phases rather than intervals",
            of(TopSum, All),
            Subject::TopTenth,
            [1e-1, 1e-3],
        ),
        (
            "mg_t10%: long rather than all phases",
            of(TopMax, Long),
            of(TopMax, All),
            [1e-1, 1e-4],
        ),
        (
            "sg_t10%: long rather than all phases",
            of(TopSum, Long),
            of(TopSum, All),
            [1e-1, 1e-4],
        ),
        (
            "mg_t10%: long rather than short phases",
            of(TopMax, Long),
            of(TopMax, Short),
            [1e-1, 1e-4],
        ),
        (
            "sg_t10%: long rather than short phases",
            of(TopSum, Long),
            of(TopSum, Short),
            [1e-1, 1e-4],
        ),
        (
            "long phases: mg_t10% rather than mg",
            of(TopMax, Long),
            of(DminMax, Long),
            [1e-1, 1e-5],
        ),
        (
            "long phases: sg_t10% rather than sg",
            of(TopSum, Long),
            of(DminSum, Long),
            [1e-1, 1e-5],
        ),
        (
            "long phases: sg_t10% rather than mg_t10%",
            of(TopSum, Long),
            of(TopMax, Long),
            [1e-1, 1e-5],
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

    let slip = |range: &ValueRange, [great, small]: [f64; 2]| {
        range.farther < 0.0 && -range.farther <= great * 1.001 && -range.nearer >= small * 0.999
    };
    for (quantity, words) in [(TopMax, "mg_t10%"), (TopSum, "sg_t10%")] {
        for (within, paper, where_) in [
            ([1e-1, 1e-2], "strong", "Δτ_p < -1e-2"),
            ([1e-2, 1e-5], "mostly moderate", "-1e-2 < Δτ_p < 0"),
        ] {
            let found = run.regime.correlate(of(quantity, Long));
            let found = found.into_iter().filter(|(range, _)| slip(range, within));
            lines.push((
                format!("long phases, {words}, {where_}"),
                paper.into(),
                words_of(found),
            ));
        }
    }
    let sticks = run.regime.correlate(of(Duration, Long));
    let sticks = sticks
        .into_iter()
        .filter(|(range, _)| range.nearer >= 1e-3 * 0.999);
    let paper = match run.friction {
        Some(mu) if mu < 0.4 => "weak or insignificant",
        _ => "moderate",
    };
    lines.push((
        "long stick phases, t_p, 1e-3 < Δτ_p < 1e-1".into(),
        paper.into(),
        words_of(sticks),
    ));
    let unit = run.grains.mean_radius().powi(2);
    for quantity in CONFIGURATIONS {
        let found = [TopMax, TopSum]
            .into_iter()
            .flat_map(|by| run.regime.correlate_by(by, unit, quantity));
        let what = format!(
            "long phases, {}, ranges of mg_t10% and sg_t10%",
            quantity.name()
        );
        lines.push((what, "weak or insignificant".into(), words_of(found)));
    }
    lines
}

fn compare(run: &Studied, comparison: &PaperComparison) -> (String, String, String) {
    let [great, small] = comparison.within;
    let [stronger, weaker] =
        [comparison.stronger, comparison.weaker].map(|subject| run.regime.correlate(subject));
    let within = |range: &ValueRange| {
        range.farther < 0.0 && -range.farther <= great * 1.001 && -range.nearer >= small * 0.999
    };
    let pairs = stronger
        .iter()
        .zip(&weaker)
        .filter(|((range, a), (_, b))| within(range) && a.is_significant() && b.is_significant());
    let (mut holds, mut all) = (0, 0);
    for ((_, a), (_, b)) in pairs {
        all += 1;
        holds += usize::from(a.rho.abs() > b.rho.abs());
    }
    let what = format!(
        "slip, {} (-{great:.0e} < Δτ < -{small:.0e})",
        comparison.what
    );
    let ours = if all == 0 {
        "no range in which both are significant".into()
    } else {
        format!("stronger in {holds} of {all} half-decades")
    };
    (what, "stronger".into(), ours)
}

/// Counts the significant coefficients that are weak, moderate and strong, and gives the greatest.
fn words_of(found: impl Iterator<Item = (ValueRange, Correlation)>) -> String {
    let significant: Vec<f64> = found
        .filter(|(_, c)| c.is_significant())
        .map(|(_, c)| c.rho.abs())
        .collect();
    if significant.is_empty() {
        return "no significant range".into();
    }
    let count = |low: f64, high: f64| {
        significant
            .iter()
            .filter(|rho| (low..high).contains(*rho))
            .count()
    };
    let greatest = significant.iter().copied().fold(0.0, f64::max);
    format!(
        "of {} significant ranges {} weak, {} moderate, {} strong; greatest |ρ| = {greatest:.2}",
        significant.len(),
        count(0.0, MODERATE),
        count(MODERATE, STRONG),
        count(STRONG, f64::INFINITY)
    )
}
