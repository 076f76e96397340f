//! `rate-state` on the tables of a laboratory: what they may look like, and what is refused.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use gshear_analysis::rate_state::{DriveSegment, Evolution, RateStateLaw, RateStateSlider};
use serde_json::Value;

use super::{are_described, done, refused};

const LAW: RateStateLaw = RateStateLaw {
    evolution: Evolution::Slip,
    mu_star: 0.6,
    a: 0.01,
    b: 0.008,
    d_c: 10e-6,
    second: None,
    v_star: 1e-6,
};
/// 1/m.
const STIFFNESS: f64 = 2e4;
/// MPa.
const NORMAL_STRESS: f64 = 25.0;

/// Time (s), displacement (m) and μ of a step up and a hold, a row every tenth of a second.
fn rows() -> Vec<[f64; 3]> {
    let segment = |velocity, duration| DriveSegment { velocity, duration };
    let drive = [
        segment(1e-6, 100.0),
        segment(1e-5, 30.0),
        segment(0.0, 50.0),
        segment(1e-5, 20.0),
    ];
    let time: Vec<f64> = (0..=2000).map(|k| 0.1 * f64::from(k)).collect();
    let slider = RateStateSlider::new(LAW, STIFFNESS);
    let states = slider
        .motion(&drive, LAW.steady(1e-6), &time)
        .expect("a motion");
    let rows = time.iter().zip(&states).map(|(&time, state)| {
        let mut begin = 0.0;
        let parts = drive.iter().map(|segment| {
            let within = (time - begin).clamp(0.0, segment.duration);
            begin += segment.duration;
            segment.velocity * within
        });
        [time, parts.sum(), LAW.friction(*state)]
    });
    rows.collect()
}

/// Writes rows of texts below a head.
fn written(folder: &Path, head: &str, row: impl Fn([f64; 3]) -> String) -> PathBuf {
    let mut text = format!("{head}\n");
    for values in rows() {
        writeln!(text, "{}", row(values)).expect("memory");
    }
    let path = folder.join("steps.txt");
    std::fs::write(&path, text).expect("a table");
    path
}

fn json(folder: &Path) -> Value {
    let text = std::fs::read_to_string(folder.join("rate-state.json")).expect("JSON");
    serde_json::from_str(&text).expect("JSON")
}

/// A line of names, what writes a row of time, displacement and friction, and options.
type Table<'a> = (&'a str, fn([f64; 3]) -> String, &'a [&'a str]);

/// The same experiment in other units and columns gives the same law.
#[test]
fn columns_and_units_are_those_that_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let tables: [Table<'_>; 3] = [
        (
            "# of a test\nt,lp,mu",
            |[t, x, mu]| format!("{t},{x:e},{mu}"),
            &[
                "--time",
                "t",
                "--displacement",
                "lp",
                "--friction",
                "mu",
                "--stiffness",
                "20:1/mm",
            ],
        ),
        (
            "Time (min)\tLP: (microns)\tTau\tSigma",
            |[t, x, mu]| {
                let (t, x) = (t / 60.0, 1e6 * x);
                format!("{t}\t{x}\t{}\t{}", mu * NORMAL_STRESS, NORMAL_STRESS * 1e3)
            },
            &[
                "--time",
                "Time (min):min",
                "--displacement",
                "LP: (microns):um",
                "--shear-stress",
                "Tau:MPa",
                "--normal-stress",
                "Sigma:kPa",
                "--stiffness",
                "500:MPa/mm",
            ],
        ),
        (
            "",
            |[t, x, mu]| format!("  {t}   {}  {mu} ", 1e3 * x),
            &[
                "--time",
                "1",
                "--displacement",
                "2:mm",
                "--friction",
                "3",
                "--stiffness",
                "0.02:1/um",
                "--changes",
                "100,130,180",
            ],
        ),
    ];
    for (head, row, options) in tables {
        let path = written(folder, head, row);
        let path = path.to_str().expect("UTF-8");
        let said = done(&[&["rate-state", path, "--law", "slip"][..], options].concat());
        let expected = "experiment 0: 1 realisation, 4 segments, 1 velocity steps, 1 holds, k/N = 2.0000e4 1/m";
        assert!(said.contains(expected), "{said}");
        let out = folder.join("steps-rate-state");
        let fit = &json(&out)["fits"][0]["laws"]["slip"];
        for (name, made) in [("a", LAW.a), ("b", LAW.b), ("d_c", LAW.d_c)] {
            let value = fit[name]["value"].as_f64().expect("a number");
            assert!((value / made - 1.0).abs() < 2e-3, "{head}: {name} {value}");
        }
        are_described(&out, &["fits.csv", "rate-state.csv", "holds.csv"]);
    }
}

/// With a, b and D_c given, both laws are predictions, and only μ* is fitted.
#[test]
fn given_parameters_are_predictions() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = written(folder.path(), "t,lp,mu", |[t, x, mu]| {
        format!("{t},{x:e},{mu}")
    });
    let path = path.to_str().expect("UTF-8");
    let options = [
        "--time",
        "t",
        "--displacement",
        "lp",
        "--friction",
        "mu",
        "--stiffness",
        "2e4",
    ];
    let given = ["--given", "a=0.01,b=0.008,d_c=1e-5"];
    let said = done(&[&["rate-state", path][..], &options, &given].concat());
    assert!(said.contains("0.01000 (given)"), "{said}");
    let out = folder.path().join("steps-rate-state");
    let fits = &json(&out)["fits"][0]["laws"];
    assert_eq!(fits["slip"]["given"], serde_json::json!(["a", "b", "d_c"]));
    let rms = |law: &str| fits[law]["rms"].as_f64().expect("a number");
    assert!(rms("slip") < 1e-6 && rms("aging") > 1e-4, "{fits}");
    // The curve of the slip law lies on the data.
    let mut reader = csv::Reader::from_path(out.join("rate-state.csv")).expect("a table");
    let rows: Vec<Vec<String>> = reader
        .deserialize()
        .collect::<Result<_, _>>()
        .expect("rows");
    for row in rows {
        let [mu, aging, slip] = [4, 6, 7].map(|k| row[k].parse::<f64>().expect("a number"));
        assert!((mu - slip).abs() < 1e-5 && aging.is_finite(), "{row:?}");
    }
    let figure = std::fs::read_to_string(out.join("holds.svg")).expect("a figure");
    assert!(figure.contains("given"), "{figure}");
}

#[test]
fn bad_tables_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bad.csv");
    let name = path.to_str().expect("UTF-8");
    let table = |change: &dyn Fn(&mut Vec<String>)| {
        let mut lines = vec!["t,lp,mu,sigma".to_string()];
        let rows = rows().into_iter();
        lines.extend(rows.map(|[t, x, mu]| format!("{t:.1},{x:e},{mu},1e6")));
        change(&mut lines);
        std::fs::write(&path, lines.join("\n")).expect("a table");
    };
    let columns = ["--time", "t", "--displacement", "lp", "--friction", "mu"];
    let stiff = ["--stiffness", "2e4"];
    let refusal = |options: &[&str], what: &str| {
        let message = refused(&[&["rate-state", name][..], options].concat());
        assert!(message.contains(&format!("{name}: {what}")), "{message}");
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("a folder").count(),
            1
        );
    };
    let all = [&columns[..], &stiff].concat();
    let with_load = [&all[..], &["--normal-stress", "sigma"]].concat();

    table(&|_| ());
    refusal(&[], "the table of an experiment needs --time NAME");
    refusal(
        &columns,
        "needs the stiffness of the machine: --stiffness VALUE:UNIT",
    );
    refusal(
        &[
            "--time",
            "t",
            "--displacement",
            "x",
            "--friction",
            "mu",
            "--stiffness",
            "1",
        ],
        "line 1: has no column \"x\"; there are \"t\", \"lp\", \"mu\", \"sigma\"",
    );
    refusal(
        &["--time", "t", "--friction", "mu", "--stiffness", "1"],
        "needs the motion of the load point",
    );
    refusal(
        &["--time", "t", "--displacement", "lp", "--stiffness", "1"],
        "needs the friction",
    );
    let of_stress = [&columns[..], &["--stiffness", "1:MPa/mm"]].concat();
    refusal(
        &of_stress,
        "a stiffness of the stress needs --normal-stress",
    );
    let early = [&all[..], &["--to", "50"]].concat();
    refusal(&early, "column lp: is ");
    let late = [&all[..], &["--from", "500"]].concat();
    refusal(&late, "has no rows");
    let changes = [&all[..], &["--changes", "130,100"]].concat();
    refusal(
        &changes,
        "column lp: the changes of the velocity must ascend within",
    );

    table(&|lines| lines[7] = "0.6,6e-7,x,1e6".into());
    refusal(&all, "line 8, column mu: \"x\" is not a number");
    table(&|lines| lines[7] = "0.6,6e-7,0.6".into());
    refusal(&all, "line 8: has 3 cells where the first line has 4");
    table(&|lines| lines[7] = "0.5,6e-7,0.6,1e6".into());
    refusal(&all, "line 8, column t: the time does not increase");
    table(&|lines| lines[7] = "0.6,6e-7,0.6,0".into());
    refusal(
        &with_load,
        "line 8, column sigma: the normal stress is 0, must be positive",
    );
    table(&|lines| {
        for line in &mut lines[1500..] {
            *line = line.replace(",1e6", ",2e6");
        }
    });
    refusal(
        &with_load,
        "column sigma: the load changes from 1.0000e6 to 2.0000e6 Pa",
    );
    table(&|lines| lines.clear());
    refusal(&all, "is empty");

    for (options, what) in [
        (
            &["--given", "c=1"][..],
            "\"c\" cannot be given; there are a, b, d_c, b_2, d_c_2",
        ),
        (
            &["--given", "a=-1"][..],
            "a must be a number greater than 0",
        ),
        (&["--given", "b_2=0.1"][..], "--given: b_2 needs --states 2"),
        (&["--given", "a=1,a=2"][..], "--given: a is given twice"),
        (
            &["--stiffness", "1:s"][..],
            "\"s\" is not a unit of stiffness",
        ),
        (
            &["--time", "t:parsec"][..],
            "\"parsec\" is not a unit of time",
        ),
    ] {
        let output = super::reduce(&[&["rate-state", name][..], options].concat());
        let message = super::text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(what), "{message}");
    }
}
