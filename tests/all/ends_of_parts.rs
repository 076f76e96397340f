//! Parts of a protocol that a condition ends, through the real program: where they end, that they
//! are then parts of that duration to the last bit, and the contracts.

use std::path::Path;

use crate::common::protocols::{Case, DISKS, DISKS_WITHOUT_WALLS, SPHERES_UNDER_A_SPRING};
use crate::common::{Outcome, avx2, gshear_mpi, reducer, same_run, succeed};
use gshear_store::run_reader::{Parameter, RunFile};

/// A part, and the conditions that end it.
struct Part {
    /// What is imposed.
    imposed: &'static str,
    /// The longest duration (s).
    time: f64,
    /// Keys and values.
    until: &'static [(&'static str, f64)],
}

/// Checks in each part, and rows.
const CHECKS: u64 = 40;

/// The options of a scene with a protocol of these parts.
fn options(case: &Case, parts: &[String]) -> Vec<String> {
    let mut sets = case.sets();
    sets.pop();
    sets.push(format!("shear.protocol=[{}]", parts.join(", ")));
    sets.into_iter().map(|set| format!("--set={set}")).collect()
}

/// With conditions.
fn conditional(parts: &[Part]) -> Vec<String> {
    let text = |part: &Part| {
        let until = part.until.iter();
        let until: String = until.map(|(key, x)| format!(", {key} = {x:e}")).collect();
        let Part { imposed, time, .. } = part;
        let checks = if until.is_empty() {
            String::new()
        } else {
            format!(", until_checks = {CHECKS}")
        };
        format!("{{ {imposed}, time = {time:e}{until}{checks} }}")
    };
    parts.iter().map(text).collect()
}

fn run(case: &Case, folder: &Path, ranks: usize, parts: &[String], more: &[&str]) -> Outcome {
    let mut arguments = vec![case.scene.to_string()];
    arguments.extend(options(case, parts));
    arguments.push(format!("--set=output.series_rows={CHECKS}"));
    arguments.extend(more.iter().map(ToString::to_string));
    gshear_mpi(ranks, folder, &arguments)
}

/// The steps with which the parts begin, and the last step.
fn begins(run: &RunFile) -> Vec<u64> {
    let Some(Parameter::Numbers(begins)) = run.parameters().get("part_begins") else {
        panic!("no part_begins: {:?}", run.parameters());
    };
    let last = run.series().step.last().expect("a row");
    let begins = begins.iter().map(|step| *step as u64);
    begins.chain([*last]).collect()
}

/// Whether a condition is true at a row of a part, whose rows are these.
fn is_true(run: &RunFile, key: &str, limit: f64, rows: &[usize], row: usize) -> bool {
    let column = |name: &str| run.series().column(name);
    let (ratio, rate) = (column("stress_ratio"), column("slip_rate"));
    let slip = column("slip");
    match key {
        "until_stress_ratio_below" => ratio[row] < limit,
        "until_stress_ratio_above" => ratio[row] > limit,
        "until_drop" => {
            let before = rows.iter().filter(|other| **other <= row);
            let most = before.map(|other| ratio[*other]).fold(f64::NAN, f64::max);
            most - ratio[row] > limit
        }
        "until_slip_rate_below" => rate[row] < limit,
        "until_slip_rate_above" => rate[row] > limit,
        "until_slip" => (slip[row] - slip[rows[0]]).abs() > limit,
        _ => panic!("{key}"),
    }
}

/// Runs parts with conditions. At least `early` of them end early.
fn ends(case: &Case, parts: &[Part], early: usize) {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let protocol = conditional(parts);
    let whole = run(case, &at("one"), 1, &protocol, &[]);
    let expected = whole.digest();
    let one = RunFile::open(&at("one")).expect("a run");
    let begins = begins(&one);
    let Some(Parameter::Number(step)) = one.parameters().get("time_step") else {
        panic!("no time_step: {:?}", one.parameters());
    };

    // A part ends a step after the first row at which one of its conditions is true.
    let mut found = 0;
    let mut planned = Vec::new();
    for (n, part) in parts.iter().enumerate() {
        let (first, end) = (begins[n], begins[n + 1]);
        let steps = one.series().step.iter().enumerate();
        let of_part = steps.filter(|(_, step)| (first..end).contains(step));
        let rows: Vec<usize> = of_part.map(|(row, _)| row).collect();
        let is_over = |row: usize| {
            let mut until = part.until.iter();
            until.any(|(key, limit)| is_true(&one, key, *limit, &rows, row))
        };
        let all = (part.time / step).round() as u64;
        let over = rows.iter().skip(1).find(|row| is_over(**row));
        let is_early = end - first < all;
        match over {
            Some(row) if is_early => {
                assert_eq!(one.series().step[*row] + 1, end, "part {n}");
                let said = format!("shear: part {} ends after step {end}: ", n + 1);
                assert!(whole.text.contains(&said), "{}", whole.text);
                found += 1;
            }
            Some(row) => assert_eq!(Some(row), rows.last(), "part {n} goes on"),
            None => assert!(!is_early, "part {n} of {all} steps ends at {end}"),
        }
        planned.push(format!(
            "{{ {}, time = {:?} }}",
            part.imposed,
            (end - first) as f64 * step
        ));
    }
    assert!(found >= early, "{found} parts ended early: {begins:?}");

    // The same durations without conditions.
    let of_durations = run(case, &at("planned"), 1, &planned, &[]);
    assert_eq!(of_durations.digest(), expected);

    // Ranks, threads, instruction sets and output; stops around the end of the first part, and
    // within the others.
    let quiet = [
        "--set=output.series_rows=0",
        "--set=output.energy=false",
        avx2(),
    ];
    let quiet = run(case, &at("quiet"), 2, &protocol, &quiet);
    assert_eq!(quiet.digest(), expected, "2 ranks without rows");
    let threads = ["--threads=2", "--set=bookkeeping.rebuild_every=7"];
    let threads = run(case, &at("threads"), 3, &protocol, &threads);
    assert_eq!(threads.digest(), expected, "3 ranks of 2 threads");
    same_run(&at("one"), &at("threads"));
    let mut stops = vec![begins[1] / 2, begins[1] - 2];
    stops.extend([begins[1] - 1, begins[1], begins[1] + 1]);
    stops.extend((1..parts.len()).map(|n| begins[n] + (begins[n + 1] - begins[n]) / 2));
    stops.dedup();
    for (k, stop) in stops.iter().enumerate() {
        let stop = format!("--stop-at={stop}");
        let outcome = if k == 0 {
            run(case, &at("broken"), 1, &protocol, &[&stop])
        } else {
            let resume = format!("--resume={}", at("broken").display());
            gshear_mpi(1 + k % 3, &at("broken"), &[resume, stop])
        };
        assert_eq!(outcome.code, 75, "{}", outcome.text);
    }
    let resume = format!("--resume={}", at("broken").display());
    assert_eq!(gshear_mpi(2, &at("broken"), &[resume]).digest(), expected);
    same_run(&at("one"), &at("broken"));
}

#[test]
fn of_disks() {
    let parts = [
        // 0.3 m/s for 17 checks of 1e-8 s each.
        Part {
            imposed: "velocity = 0.3",
            time: 4e-7,
            until: &[("until_slip", 5e-8)],
        },
        Part {
            imposed: "velocity = 0.3, pressure = 7e5",
            time: 4e-7,
            until: &[("until_drop", 1e-3), ("until_stress_ratio_below", -1.0)],
        },
        Part {
            imposed: "shear_stress = 2e5",
            time: 2e-7,
            until: &[
                ("until_slip_rate_above", 0.301),
                ("until_slip_rate_below", 0.299),
            ],
        },
        Part {
            imposed: "velocity = 0.3, wall_velocity = 0",
            time: 1e-7,
            until: &[("until_slip", 1.0)],
        },
    ];
    ends(&DISKS, &parts, 3);
}

/// The first parts of runs under a spring.
const UP_TO_A_STRENGTH: Part = Part {
    imposed: "velocity = 3",
    time: 5e-4,
    until: &[("until_stress_ratio_above", 0.05)],
};
const UP_TO_A_DROP: Part = Part {
    imposed: "velocity = 3, pressure = 1.1e5",
    time: 4e-4,
    until: &[("until_drop", 0.005)],
};

#[test]
fn of_spheres_under_a_spring() {
    let parts = [
        UP_TO_A_STRENGTH,
        UP_TO_A_DROP,
        Part {
            imposed: "velocity = 0, pressure = 1.1e5",
            time: 2e-4,
            until: &[("until_slip_rate_below", 0.5)],
        },
    ];
    ends(&SPHERES_UNDER_A_SPRING, &parts, 2);
}

#[test]
fn of_disks_without_walls() {
    let parts = [
        Part {
            imposed: "velocity = 3",
            time: 4e-7,
            until: &[("until_slip", 5e-7)],
        },
        Part {
            imposed: "velocity = -3, pressure = 7e5",
            time: 4e-7,
            until: &[("until_stress_ratio_below", 0.0), ("until_drop", 0.01)],
        },
        Part {
            imposed: "velocity = 0, pressure = 7e5",
            time: 5e-8,
            until: &[("until_stress_ratio_above", 10.0)],
        },
    ];
    ends(&DISKS_WITHOUT_WALLS, &parts, 2);
}

/// A window over the end of a part is replayed with the same bits, from a checkpoint before it.
#[test]
fn an_end_is_replayed() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts = [
        UP_TO_A_STRENGTH,
        UP_TO_A_DROP,
        Part {
            imposed: "velocity = 0, pressure = 1.1e5",
            time: 1e-4,
            until: &[],
        },
    ];
    let case = SPHERES_UNDER_A_SPRING;
    let kept = [
        "--set=output.keep_checkpoints=true",
        "--set=output.frame_rows=40",
    ];
    let at = folder.path().join("run");
    run(&case, &at, 2, &conditional(&parts), &kept).digest();
    let whole = RunFile::open(&at).expect("a run");
    let begins = begins(&whole);
    let series = whole.series();
    // From the middle of the second part, which ends early, to the middle of the third.
    let [from, to] = [1, 2].map(|n| {
        let middle = begins[n] + (begins[n + 1] - begins[n]) / 2;
        series.time[series.step.partition_point(|step| *step < middle)]
    });
    let mut replay = reducer();
    replay.arg("replay").arg(&at);
    replay.arg(format!("--time={from}..{to}"));
    replay.arg("--out").arg(folder.path().join("again"));
    let said = String::from_utf8(succeed(&mut replay).stdout).expect("text");
    assert!(said.contains("to the last bit"), "{said}");
}
