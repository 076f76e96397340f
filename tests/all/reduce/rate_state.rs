//! `rate-state` on runs that are made of the law itself.

use std::path::{Path, PathBuf};

use gshear_analysis::rate_state::{DriveSegment, Evolution, RateStateLaw, RateStateSlider};
use gshear_dem::state::SeriesRow;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use super::fixture::{Fixture, TIME_STEP};
use super::results::assert_well_formed;
use super::{are_described, done, refused};

/// FR's with a and b exchanged: a law that weakens, k̄_c = 1.3 /m.
const LAW: RateStateLaw = RateStateLaw {
    evolution: Evolution::Slip,
    mu_star: 0.35,
    a: 0.0178,
    b: 0.0247,
    d_c: 0.0053,
    second: None,
    v_star: 0.02,
};
/// N.
const NORMAL_FORCE: f64 = 450.0;
/// N/m: k̄ = 2000 /m, so soft that a slip law sees something of a hold.
const STIFFNESS: f64 = 9e5;

const SLIDE: DriveSegment = DriveSegment {
    velocity: 0.02,
    duration: 2.0,
};

fn segment(velocity: f64, duration: f64) -> DriveSegment {
    DriveSegment { velocity, duration }
}

/// Slide-hold-slide, then a step up and one down.
fn protocol() -> Vec<DriveSegment> {
    let hold = |duration| segment(0.0, duration);
    vec![
        SLIDE,
        hold(1.0),
        SLIDE,
        hold(5.0),
        SLIDE,
        hold(25.0),
        SLIDE,
        segment(0.2, 0.3),
        SLIDE,
    ]
}

/// A run under a spring with rows every `interval` (s) and white noise of standard deviation σ in
/// μ.
fn run(drive: &[DriveSegment], interval: f64, sigma: f64, seed: u64) -> Fixture {
    let total: f64 = drive.iter().map(|s| s.duration).sum();
    let steps = (interval / TIME_STEP).round() as u64;
    let rows = (total / interval).round() as u64;
    let mut fixture = Fixture::small();
    fixture.series_step = (0..=rows).map(|row| row * steps).collect();
    let time: Vec<f64> = (0..=rows)
        .map(|row| (row * steps) as f64 * TIME_STEP)
        .collect();
    let mut slider = RateStateSlider::new(LAW, STIFFNESS / NORMAL_FORCE);
    slider.tolerance = 1e-10;
    let start = LAW.steady(drive[0].velocity);
    let states = slider.motion(drive, start, &time).expect("a motion");

    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = move || {
        let [u, v]: [f64; 2] = [1.0 - random.random::<f64>(), random.random()];
        (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
    };
    let mut of_drive = [vec![], vec![]];
    let (mut slip, mut friction) = (vec![], vec![]);
    for (t, state) in time.iter().zip(&states) {
        let (mut begin, mut driven, mut velocity) = (0.0, 0.0, 0.0);
        for s in drive {
            if *t > begin || begin == 0.0 {
                velocity = s.velocity;
            }
            driven += s.velocity * (t - begin).clamp(0.0, s.duration);
            begin += s.duration;
        }
        of_drive[0].push(velocity);
        of_drive[1].push(driven);
        slip.push(driven - (LAW.friction(*state) - 0.35) * NORMAL_FORCE / STIFFNESS);
        friction.push(LAW.friction(*state) + sigma * normal());
    }
    let rows = time.len();
    fixture.series = vec![vec![0.0; rows]; fixture.series.len()];
    let [velocity, displacement] = of_drive;
    for (name, values) in [
        ("stress_ratio", friction),
        ("normal_force", vec![NORMAL_FORCE; rows]),
        ("slip", slip),
        ("drive_velocity", velocity),
        ("drive_displacement", displacement),
    ] {
        *column(&mut fixture, name) = values;
    }
    fixture.spring = Some(STIFFNESS);
    fixture.digest = Some(format!("{seed:016x}"));
    fixture
}

fn column<'a>(fixture: &'a mut Fixture, name: &str) -> &'a mut Vec<f64> {
    let at = SeriesRow::COLUMNS
        .iter()
        .position(|column| column.name == name);
    &mut fixture.series[at.expect("a column")]
}

/// Writes a run into a folder of its own under `folder`.
fn written(folder: &Path, name: &str, fixture: &Fixture) -> String {
    let own = folder.join(name);
    std::fs::create_dir_all(&own).expect("a folder");
    fixture.write(&own.join("run.h5"));
    own.to_str().expect("UTF-8").to_string()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut paths: Vec<PathBuf> = entries.map(|e| e.expect("an entry").path()).collect();
    paths.sort();
    let name = |path: &PathBuf| {
        path.file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned()
    };
    paths.iter().map(name).collect()
}

fn json(folder: &Path) -> Value {
    let text = std::fs::read_to_string(folder.join("rate-state.json")).expect("JSON");
    serde_json::from_str(&text).expect("JSON")
}

/// Rows of a table after its head, as cells.
fn table(folder: &Path, name: &str) -> Vec<Vec<String>> {
    let mut reader = csv::Reader::from_path(folder.join(name)).expect("a table");
    let rows = reader.deserialize().collect::<Result<_, _>>();
    rows.expect("rows as long as the header")
}

/// Each 95 % interval, twice as long to either side, holds the law: 1e-4 that a right one does not;
/// and it is no longer than a share of it.
fn assert_near_the_law(fit: &Value, longest: f64) {
    let law = [
        ("a", LAW.a),
        ("b", LAW.b),
        ("d_c", LAW.d_c),
        ("mu_star", LAW.mu_star),
    ];
    for (name, made) in law {
        let number = |value: &Value| value.as_f64().expect("a number");
        let [low, high] = [0, 1].map(|k| number(&fit[name]["interval"][k]));
        let value = number(&fit[name]["value"]);
        assert!(low < value && value < high);
        let error = (value - made).abs();
        assert!(
            error < 2.0 * (high - low),
            "{name}: {value} ({low} … {high}) for {made}"
        );
        assert!(high - low < longest * made, "{name}: {low} … {high}");
    }
}

#[test]
fn realisations_give_the_law_that_they_are_made_of() {
    let folder = tempfile::tempdir().expect("a folder");
    let make = |seed| {
        let fixture = run(&protocol(), 4e-3, 4e-3, seed);
        written(folder.path(), &format!("seed-{seed}"), &fixture)
    };
    let runs = [1, 2, 3, 4].map(make);
    let out = folder.path().join("out");
    let mut arguments = vec!["rate-state"];
    arguments.extend(runs.iter().map(String::as_str));
    arguments.extend(["--out", out.to_str().expect("UTF-8")]);
    let said = done(&arguments);
    assert!(
        said.contains("experiment 0: 4 realisations, 9 segments, 2 velocity steps, 3 holds"),
        "{said}"
    );

    let expected = [
        "after-steps.csv",
        "fit.svg",
        "fits.csv",
        "healing.svg",
        "holds.csv",
        "holds.svg",
        "index.html",
        "rate-state.csv",
        "rate-state.json",
        "relaxations.csv",
        "reslides.svg",
        "segments.csv",
        "steps.csv",
        "steps.svg",
    ];
    let of_results = |name: &String| !name.ends_with("-metadata.json");
    let found: Vec<String> = names(&out).into_iter().filter(of_results).collect();
    assert_eq!(found, expected);
    let is_table = |name: &&str| Path::new(name).extension().is_some_and(|e| e == "csv");
    let tables: Vec<&str> = expected.into_iter().filter(|name| is_table(name)).collect();
    are_described(&out, &tables);
    for name in expected
        .iter()
        .filter(|name| Path::new(name).extension().is_some_and(|e| e == "svg"))
    {
        let path = out.join(name);
        assert_well_formed(&std::fs::read_to_string(&path).expect("text"), &path);
    }
    let found = json(&out);
    let fits = found["fits"].as_array().expect("fits");
    let named: Vec<&str> = fits
        .iter()
        .map(|f| f["fit"].as_str().expect("a name"))
        .collect();
    let events = ["velocity step", "velocity step", "hold", "hold", "hold"];
    let together = [
        "all",
        "all (jackknife)",
        "velocity steps",
        "slide-hold-slide",
    ];
    assert_eq!(named[..4], together);
    assert_eq!(named[4..], events);
    // By the slip law little evolves in a hold: those alone say less of b and D_c.
    for (fit, longest) in fits.iter().zip([0.1, 0.2, 0.1, f64::INFINITY]) {
        assert_near_the_law(&fit["laws"]["slip"], longest);
    }
    let chi = |law: &str| {
        fits[0]["laws"][law]["chi_squared"]
            .as_f64()
            .expect("a number")
    };
    assert!(chi("aging") > chi("slip") + 100.0);

    let experiment = &found["experiments"][0];
    assert_eq!(experiment["realisations"], 4);
    assert_eq!(experiment["runs"].as_array().expect("runs").len(), 4);
    assert_eq!(
        experiment["stiffness_over_normal_force"],
        STIFFNESS / NORMAL_FORCE
    );
    // Noise of 4e-3 in every run: 2e-3 in the mean, 8e-3 for two standard deviations among the
    // runs.
    let scatter = experiment["protocol"][0]["mu_ss"]["scatter"]
        .as_f64()
        .expect("a number");
    assert!((scatter / 2e-3 - 1.0).abs() < 0.2, "{scatter}");
    let rows = table(&out, "rate-state.csv");
    assert_eq!(rows.len(), 10_326);
    let bands = rows
        .iter()
        .map(|row| row[5].parse::<f64>().expect("a number").powi(2));
    let band = (bands.sum::<f64>() / rows.len() as f64).sqrt();
    assert!((band / 8e-3 - 1.0).abs() < 0.05, "{band}");
    // At the end of the step up everything has evolved: (a - b) ln(V_2/V_1), from four runs.
    let after = table(&out, "after-steps.csv");
    let number = |row: &[String], k: usize| row[k].parse::<f64>().expect("a number");
    let up: Vec<_> = after.iter().filter(|row| row[1] == "0.2").collect();
    assert!(after.iter().all(|row| row[4] == "4") && up.len() > 5);
    let [change, error] = [5, 6].map(|k| number(up.last().expect("pieces"), k));
    let net = (LAW.a - LAW.b) * 10f64.ln();
    assert!(
        error < 1e-3 && (change - net).abs() < 4.0 * error + 1e-4,
        "{change} ± {error} for {net}"
    );
    assert_eq!(
        [
            table(&out, "segments.csv").len(),
            table(&out, "steps.csv").len()
        ],
        [9, 2]
    );
    assert_eq!(
        [
            table(&out, "holds.csv").len(),
            table(&out, "fits.csv").len()
        ],
        [3, 18]
    );
}

/// One protocol for each law of sliding; a run that was stopped in its last segment; the law that
/// was asked for.
#[test]
fn protocols_are_fitted_together() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut up = run(&[SLIDE, segment(0.1, 0.5)], 2e-3, 0.0, 1);
    // While nothing touched the slider.
    up.series[1][700..703].fill(f64::NAN);
    let mut down = run(
        &[SLIDE, segment(0.005, 4.0), segment(0.01, 0.02)],
        2e-3,
        0.0,
        2,
    );
    down.digest = None;
    let runs = [
        written(folder.path(), "up", &up),
        written(folder.path(), "down", &down),
    ];
    let said = done(&["rate-state", &runs[0], &runs[1], "--law", "slip"]);
    let out = Path::new(&runs[0]).join("rate-state");
    // Its last segment has ten rows, too few to be one.
    assert!(
        said.contains("experiment 1: 1 realisation, 2 segments, 1 velocity steps, 0 holds"),
        "{said}"
    );
    let found = json(&out);
    let fits = found["fits"].as_array().expect("fits");
    assert_eq!(fits.len(), 3);
    let laws = fits[0]["laws"].as_object().expect("laws");
    assert_eq!(laws.keys().collect::<Vec<_>>(), ["slip"]);
    for (name, made) in [
        ("a", LAW.a),
        ("b", LAW.b),
        ("d_c", LAW.d_c),
        ("mu_star", LAW.mu_star),
    ] {
        let value = laws["slip"][name]["value"].as_f64().expect("a number");
        assert!((value / made - 1.0).abs() < 1e-3, "{name}: {value}");
    }
    assert!(names(&out).contains(&"fit-1.svg".to_string()));
    assert!(!names(&out).contains(&"holds.svg".to_string()));
}

/// Of a run, too, given parameters are predictions: its own law lies on the data, and another one
/// beside them. Only μ* is fitted, which its noise leaves to about 1e-4.
#[test]
fn given_parameters_are_predictions_for_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let noise = 1e-3;
    let path = written(folder.path(), "given", &run(&protocol(), 4e-3, noise, 5));
    let fit_of = |given: &str, law: &str| {
        let out = folder.path().join(format!("{law}-{}", given.len()));
        let words = ["--law", law, "--given", given];
        let to = ["--out", out.to_str().expect("UTF-8")];
        let said = done(&[&["rate-state", &path][..], &words, &to].concat());
        (said, json(&out)["fits"][0]["laws"][law].clone(), out)
    };
    let own = format!("a={},b={},d_c={}", LAW.a, LAW.b, LAW.d_c);
    let (said, fit, out) = fit_of(&own, "slip");
    assert!(said.contains("0.01780 (given)"), "{said}");
    assert_eq!(fit["given"], serde_json::json!(["a", "b", "d_c"]));
    for (name, made) in [("a", LAW.a), ("b", LAW.b), ("d_c", LAW.d_c)] {
        assert_eq!(fit[name]["value"].as_f64(), Some(made), "{fit}");
    }
    let mu_star = fit["mu_star"]["value"].as_f64().expect("a number");
    assert!((mu_star - LAW.mu_star).abs() < 2e-4, "{mu_star}");
    // The noise, of means of rows, and nothing besides.
    let rms = |fit: &Value| fit["rms"].as_f64().expect("a number");
    let of_noise = rms(&fit);
    assert!((0.3 * noise..noise).contains(&of_noise), "{fit}");
    assert!(names(&out).contains(&"fits.csv".to_string()));

    let other = format!("a={},b={},d_c={}", 2.0 * LAW.a, LAW.b, LAW.d_c);
    for (given, law) in [(&own, "aging"), (&other, "slip")] {
        let (_, fit, _) = fit_of(given, law);
        assert!(rms(&fit) > 2.0 * of_noise, "{law} {given}: {fit}");
    }
}

/// The plain report of a run under a spring leads to its rate and state.
#[test]
fn a_report_of_a_spring_has_its_fits() {
    let folder = tempfile::tempdir().expect("a folder");
    let stepped = run(&[SLIDE, segment(0.022, 0.3)], 4e-3, 3e-3, 3);
    let path = written(folder.path(), "stepped", &stepped);
    done(&["report", &path]);
    let report = Path::new(&path).join("report");
    let page = std::fs::read_to_string(report.join("index.html")).expect("a page");
    assert!(page.contains("href=\"rate-state/index.html\""), "{page}");
    let fits = std::fs::read_to_string(report.join("rate-state/index.html")).expect("a page");
    assert!(
        fits.contains("slip law") && fits.contains("aging law"),
        "{fits}"
    );
}

/// One small step in noise: it shows the direct effect, and not how friction evolves.
#[test]
fn what_the_data_do_not_determine_is_said_to_be_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let brief = run(&[SLIDE, segment(0.022, 0.3)], 4e-3, 3e-3, 3);
    let path = written(folder.path(), "brief", &brief);
    let said = done(&["rate-state", &path, "--law", "slip"]);
    let out = Path::new(&path).join("rate-state");
    let fit = &json(&out)["fits"][0]["laws"]["slip"];
    for name in ["b", "a_minus_b", "d_c"] {
        assert!(fit[name]["value"].is_null(), "{name} of {fit}");
    }
    let [low, high] = [0, 1].map(|k| fit["a"]["interval"][k].as_f64().expect("a number"));
    assert!(low < LAW.a && LAW.a < high, "{fit}");
    let mut reader = csv::Reader::from_path(out.join("fits.csv")).expect("a table");
    let names = reader.headers().expect("a header").clone();
    let row = reader.records().next().expect("a fit").expect("cells");
    let cell = |name: &str| &row[names.iter().position(|of| of == name).expect("a column")];
    for name in ["b", "d_c"] {
        assert_eq!(cell(name), "", "{name}");
    }
    // An interval remains, too wide to be of use.
    let [low, high] = ["b_low", "b_high"].map(|end| cell(end).parse::<f64>().expect("a number"));
    assert!(low < LAW.b - 1.0 && LAW.b + 1.0 < high, "{low} {high}");
    assert_eq!(cell("undetermined"), "b a_minus_b d_c");
    assert!(said.contains("not determined"), "{said}");
    let page = std::fs::read_to_string(out.join("index.html")).expect("a page");
    assert!(page.contains("b = not determined"));
}

#[test]
fn runs_that_are_no_tests_of_friction_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = || run(&[SLIDE, segment(0.2, 0.3)], 1e-2, 0.0, 1);
    let refusal = |name: &str, fixture: &Fixture, why: &str| {
        let path = written(folder.path(), name, fixture);
        let message = refused(&["rate-state", &path]);
        assert!(message.contains(&format!("{path}/run.h5: ")), "{message}");
        assert!(message.contains(why), "{message}");
        assert_eq!(names(Path::new(&path)), ["run.h5"]);
    };

    let mut fixture = made();
    fixture.spring = None;
    refusal(
        "velocity",
        &fixture,
        "attribute spring_stiffness is missing: rate-state needs a run whose top wall is pulled by a spring",
    );

    let steady = run(&[SLIDE], 1e-2, 0.0, 1);
    refusal(
        "steady",
        &steady,
        "is 2e-2 m/s all the time; rate-state needs a velocity step or a hold",
    );
    let brief = run(&[SLIDE, segment(0.2, 0.1), SLIDE], 1e-2, 0.0, 1);
    refusal(
        "brief",
        &brief,
        "segment 1 of the drive (2.0000e-1 m/s for 1.0000e-1 s) has 10 rows of the time series; it needs at least 20",
    );

    let mut fixture = made();
    column(&mut fixture, "drive_velocity")[7] = -0.02;
    refusal(
        "back",
        &fixture,
        "observables/drive_velocity: row 7 is -2e-2 m/s",
    );
    let mut fixture = made();
    for (name, jump) in [("drive_displacement", 1.0), ("drive_velocity", 0.01)] {
        let values = &mut column(&mut fixture, name)[100..];
        values.iter_mut().for_each(|x| *x += jump);
    }
    refusal(
        "jump",
        &fixture,
        "between row 99 and row 100 the drive moves by",
    );
    let mut fixture = made();
    fixture.series[2].iter_mut().for_each(|n| *n = 0.0);
    refusal(
        "free",
        &fixture,
        "observables/normal_force: its mean is 0e0 N",
    );

    let twice = written(folder.path(), "twice", &made());
    let again = written(folder.path(), "again", &made());
    assert!(refused(&["rate-state", &twice, &again]).contains("are the same run (equal digests)"));
    assert!(super::reduce(&["rate-state"]).status.code() == Some(2));
}
