//! `dmin`, `phases` and `report`.

use std::path::{Path, PathBuf};

use gshear_analysis::dmin::NonAffine;
use gshear_analysis::interval::Interval;
use gshear_analysis::rattlers::RattlerRule;
use gshear_dem::state::Frame;

use super::fixture::{Fixture, STEPS_PER_ROW, TIME_STEP, column, strain_of};
use super::{are_described, done, folder_with, reduce, refused, text};

#[test]
fn dmin_is_written_for_every_frame() {
    let mut fixture = Fixture::sheared(16, 12, 7);
    // Frame 3 is an affine map of frame 2: simple shear, which keeps the period.
    fixture.frames[3] = Frame {
        step: 3000,
        ..fixture.frames[2].clone()
    };
    let length = fixture.length;
    for grain in &mut fixture.frames[3].grains {
        // The highest grains move by more than a period.
        let [x, y, _] = grain.position;
        let x = x + 2.7 * y;
        grain.position[0] = x.rem_euclid(length);
        grain.image[0] += x.div_euclid(length) as i64;
    }
    let (folder, path) = folder_with(&fixture);
    done(&["dmin", &path, "--threads", "2"]);
    let mut files = std::fs::read_dir(folder.path())
        .expect("a folder")
        .flatten();
    assert!(!files.any(|file| file.path().extension().is_some_and(|of| of == "part")));

    let file = hdf5::File::open(folder.path().join("reduced.h5")).expect("reduced.h5");
    let values = file
        .dataset("dmin/value")
        .expect("values")
        .read_2d::<f64>()
        .expect("[T][N]");
    let strain = file
        .dataset("dmin/strain")
        .expect("strain")
        .read_1d::<f64>()
        .expect("[T]");
    assert_eq!((values.dim(), strain.len()), ((7, 192), 7));
    assert!(values.row(0).iter().all(|value| value.is_nan()));
    let radius = fixture.grains.mean_radius();
    for t in 1..7 {
        let mut contacts = vec![0; 192];
        for contact in &fixture.frames[t - 1].contacts {
            contacts[contact.i as usize] += 1;
            contacts[contact.j as usize] += 1;
        }
        for n in 0..192 {
            let few = contacts[n] <= if fixture.grains.body[n] == 0 { 2 } else { 1 };
            assert_eq!(values[[t, n]].is_nan(), few, "frame {t} grain {n}");
            if t == 3 && !few {
                assert!(
                    values[[t, n]] <= 1e-24 * radius * radius,
                    "grain {n}: {:e}",
                    values[[t, n]]
                );
            }
        }
    }
    assert!(values.iter().any(|value| *value > 1e-9 * radius * radius));

    let elsewhere = folder.path().join("elsewhere");
    done(&[
        "dmin",
        &path,
        "--threads",
        "1",
        "--out",
        elsewhere.to_str().expect("UTF-8"),
    ]);
    let file = hdf5::File::open(elsewhere.join("reduced.h5")).expect("reduced.h5");
    let again = file
        .dataset("dmin/value")
        .expect("values")
        .read_2d::<f64>()
        .expect("[T][N]");
    let bits = |values: &ndarray::Array2<f64>| {
        values
            .iter()
            .map(|value| value.to_bits())
            .collect::<Vec<_>>()
    };
    assert!(bits(&values) == bits(&again), "threads reach the numbers");
}

/// Lags in frames, strain and time, a window, and other rattlers, against the function that the
/// default calls, on the two frames alone.
#[test]
fn dmin_is_of_the_frames_and_grains_that_are_asked_for() {
    let fixture = Fixture::sheared(16, 12, 7);
    let (folder, path) = folder_with(&fixture);
    let (grains, frames) = (&fixture.grains, &fixture.frames);
    let expected = |rule: RattlerRule, from: usize, to: usize| -> Vec<u64> {
        let mut non_affine = NonAffine::default();
        non_affine.rattlers_by = rule;
        let mut values = vec![0.0; grains.count()];
        let radius = 5.0 * grains.mean_radius();
        let interval = Interval::between_walls([&frames[from], &frames[to]]);
        non_affine.between(grains, &interval, radius, &mut values);
        values.into_iter().map(f64::to_bits).collect()
    };
    let read = |options: &[&str]| -> Reduced {
        let mut arguments = vec!["dmin", &path];
        arguments.extend(options);
        let told = done(&arguments);
        let file = hdf5::File::open(folder.path().join("reduced.h5")).expect("reduced.h5");
        let numbers = |name: &str| file.dataset(name).expect(name).read_raw().expect(name);
        let value = file.dataset("dmin/value").expect("values");
        Reduced {
            told,
            frame: numbers("dmin/frame"),
            earlier: numbers("dmin/earlier"),
            value: value.read_2d().expect("[R][N]"),
        }
    };
    let bits = |found: &Reduced, row: usize| -> Vec<u64> {
        found
            .value
            .row(row)
            .iter()
            .map(|value| value.to_bits())
            .collect()
    };
    let paper = RattlerRule::LeeHurley;
    let balance = RattlerRule::Balance { friction: true };
    // All lags are three frames.
    let strain = strain_of(3 * 10 * STEPS_PER_ROW, fixture.height).to_string();
    let time = (3.0 * 10.0 * STEPS_PER_ROW as f64 * TIME_STEP).to_string();
    for (options, rule) in [
        (&["--lag", "3"][..], paper),
        (&["--lag-strain", &strain], paper),
        (&["--lag-time", &time], paper),
        (&["--lag", "3", "--rattlers", "balance"], balance),
        (&["--lag", "3", "--rattlers", "none"], RattlerRule::None),
    ] {
        let found = read(options);
        assert_eq!(found.frame, [0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(found.earlier, [-1, -1, -1, 0, 1, 2, 3], "{options:?}");
        for t in 0..7 {
            if t < 3 {
                assert!(found.value.row(t).iter().all(|value| value.is_nan()));
            } else {
                assert!(
                    bits(&found, t) == expected(rule, t - 3, t),
                    "{options:?} frame {t}"
                );
            }
        }
    }
    let found = read(&["--window", "1..5", "--rattlers", "none"]);
    assert_eq!((&found.frame[..], &found.earlier[..]), (&[5][..], &[1][..]));
    assert!(bits(&found, 0) == expected(RattlerRule::None, 1, 5));
    let all = "D²min is defined for 100.0 % of the free grains\n";
    assert!(found.told.contains(all), "{}", found.told);

    // The causes are counted: free grains with two contacts or fewer.
    let told = read(&["--window", "1..5"]).told;
    let mut contacts = vec![0; grains.count()];
    for contact in &frames[1].contacts {
        contacts[contact.i as usize] += 1;
        contacts[contact.j as usize] += 1;
    }
    let free: Vec<usize> = (0..grains.count())
        .filter(|n| grains.body[*n] == 0)
        .collect();
    let few = free.iter().filter(|n| contacts[**n] <= 2).count();
    let share = 100.0 * few as f64 / free.len() as f64;
    let words = format!("of the free grains, {share:.1} % are rattlers\n");
    assert!(few > 0 && told.contains(&words), "{told}");
    let tight = read(&["--cutoff", "1.5", "--rattlers", "none", "--window", "0..1"]).told;
    assert!(tight.contains("have too few neighbours"), "{tight}");

    for (options, words) in [
        (
            &["--window", "5..9"][..],
            "has 7 frames; --window 5..9 needs",
        ),
        (&["--lag", "9"], "--lag 9: the run has 7 frames"),
        (&["--lag-strain", "0.5"], "give a lesser lag"),
    ] {
        let mut arguments = vec!["dmin", &path];
        arguments.extend(options);
        let message = refused(&arguments);
        assert!(message.contains(words), "{message}");
    }
    for options in [
        &["--lag", "2", "--window", "1..5"][..],
        &["--window", "5..1"],
    ] {
        let mut arguments = vec!["dmin", &path];
        arguments.extend(options);
        assert_eq!(reduce(&arguments).status.code(), Some(2), "{options:?}");
    }
}

/// What `dmin` has said and written.
struct Reduced {
    told: String,
    frame: Vec<i64>,
    earlier: Vec<i64>,
    value: ndarray::Array2<f64>,
}

#[test]
fn phases_are_tabulated() {
    let mut fixture = Fixture::small();
    let tau: Vec<f64> = (0..51)
        .map(|row| {
            if row < 20 {
                f64::from(row)
            } else {
                100.0 - 0.25 * f64::from(row)
            }
        })
        .collect();
    fixture.series[column("normal_force")].fill(0.5);
    fixture.set_stress_ratio(tau);
    let (folder, path) = folder_with(&fixture);
    let told = done(&["phases", &path]);
    assert!(told.contains("largest drop: Δτ_p = -7.5000e0"), "{told}");
    are_described(folder.path(), &["phases.csv"]);
    let csv = std::fs::read_to_string(folder.path().join("phases.csv")).expect("the table");
    let rows: Vec<Vec<&str>> = csv
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect())
        .collect();
    assert_eq!(rows.len(), 2);
    assert_eq!(rows[0][..7], ["0", "stick", "long", "0", "20", "0", "2000"]);
    assert_eq!(
        rows[1][..7],
        ["1", "slip", "long", "20", "50", "2000", "5000"]
    );
    assert_eq!(
        (rows[0][9], rows[0][11], rows[1][11]),
        ("20", "95.0", "-7.5")
    );
    assert_eq!(rows[1][8].parse(), Ok(fixture.series[0][50]));
}

/// Phases of τ read in other ways. τ: 0, 3, 1, 4, 2, 5, … in 51 rows, rising by 1 every two rows.
#[test]
fn phases_are_of_tau_as_it_is_asked_for() {
    let mut fixture = Fixture::sheared(16, 12, 6);
    let tau = |row: usize| (row / 2 + 3 * (row % 2)) as f64;
    fixture.series[column("normal_force")].fill(0.5);
    fixture.set_stress_ratio((0..51).map(tau).collect());
    let (folder, path) = folder_with(&fixture);
    let phases = |path: &str, options: &[&str]| -> Vec<Vec<String>> {
        let mut arguments = vec!["phases", path];
        arguments.extend(options);
        done(&arguments);
        let csv = std::fs::read_to_string(Path::new(path).join("phases.csv"));
        let row = |line: &str| line.split(',').map(String::from).collect();
        csv.expect("the table").lines().skip(1).map(row).collect()
    };
    let rows = |phases: &[Vec<String>]| -> Vec<[String; 4]> {
        let of = |row: &Vec<String>| [1, 3, 4, 9].map(|k| row[k].clone());
        phases.iter().map(of).collect()
    };
    assert_eq!(phases(&path, &[]).len(), 50);
    // Of every second row, and of means over two, τ only rises.
    let second = phases(&path, &["--every", "2"]);
    assert_eq!(rows(&second), [["stick", "0", "50", "25"]]);
    assert_eq!(second[0][6], "5000");
    let means = phases(&path, &["--every", "2", "--average"]);
    assert_eq!(rows(&means), [["stick", "2", "50", "24"]]);
    // Rounded to multiples of 100, it is constant.
    assert_eq!(phases(&path, &["--round", "100"]).len(), 0);
    drop(folder);

    // S over the imposed N of 0.6 rises up to row 30 and falls then.
    let ratio = |row: usize| {
        if row <= 30 {
            row as f64
        } else {
            60.0 - row as f64
        }
    };
    fixture.series[column("shear_force")] = (0..51).map(|row| 0.6 * ratio(row)).collect();
    let (_folder, path) = folder_with(&fixture);
    let imposed = phases(&path, &["--normal-force", "imposed"]);
    assert_eq!(
        rows(&imposed),
        [["stick", "0", "30", "30"], ["slip", "30", "50", "20"]]
    );
    let from = fixture.series[0][20].to_string();
    let late = phases(&path, &["--normal-force", "imposed", "--from", &from]);
    assert_eq!(
        rows(&late),
        [["stick", "20", "30", "10"], ["slip", "30", "50", "20"]]
    );
    let told = done(&["phases", &path, "--normal-force", "imposed"]);
    let counted = "per interval: 0.0400 phases, 0.0200 cycles of a stick and a slip (50 intervals)";
    assert!(told.contains(counted), "{told}");
}

/// Checks that tags are nested and closed, that attributes are quoted, and that no `<` or `&`
/// stands alone.
pub fn assert_well_formed(xml: &str, file: &Path) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = xml;
    while let Some(at) = rest.find('<') {
        let words = &rest[..at];
        for entity in words.match_indices('&').map(|(at, _)| &words[at..]) {
            let known = ["&lt;", "&gt;", "&amp;", "&quot;", "&apos;"];
            assert!(
                known.iter().any(|known| entity.starts_with(known)),
                "{}: {entity}",
                file.display()
            );
        }
        let end = at
            + rest[at..]
                .find('>')
                .unwrap_or_else(|| panic!("{}: an open tag", file.display()));
        let tag = &rest[at + 1..end];
        rest = &rest[end + 1..];
        assert!(
            !tag.contains('<') && tag.matches('"').count().is_multiple_of(2),
            "{}: <{tag}>",
            file.display()
        );
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "{}: </{name}>", file.display());
        } else if !tag.ends_with('/') && !tag.starts_with('!') {
            // What is between the tags of a script is no text.
            if tag == "script" {
                let end = rest.find("</script>").expect("the end of a script");
                rest = &rest[end..];
            }
            open.push(tag.split_whitespace().next().expect("a name"));
        }
    }
    assert!(
        open.is_empty(),
        "{}: {open:?} are not closed",
        file.display()
    );
}

/// Makes a report and returns the names of its files, each of them checked.
fn report_of(fixture: &Fixture) -> (Vec<String>, serde_json::Value, String) {
    report_with(fixture, &[])
}

/// [`report_of`] with options.
fn report_with(fixture: &Fixture, options: &[&str]) -> (Vec<String>, serde_json::Value, String) {
    let (folder, path) = folder_with(fixture);
    done(&[&["report", &path], options].concat());
    let entries = std::fs::read_dir(folder.path().join("report")).expect("the report");
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("an entry").path())
        .collect();
    files.sort();
    let is_page = |file: &&PathBuf| file.extension().is_some_and(|e| e == "svg" || e == "html");
    for file in files.iter().filter(is_page) {
        assert_well_formed(&std::fs::read_to_string(file).expect("text"), file);
    }
    let read = |name: &str| {
        std::fs::read_to_string(folder.path().join("report").join(name)).expect("text")
    };
    let summary = serde_json::from_str(&read("summary.json")).expect("JSON");
    let names = files.iter().map(|file| {
        file.file_name()
            .expect("a name")
            .to_str()
            .expect("UTF-8")
            .to_string()
    });
    (names.collect(), summary, read("index.html"))
}

#[test]
fn a_report_has_every_figure_and_needs_nothing_else() {
    let fixture = Fixture::sheared(16, 12, 20);
    let (names, summary, page) = report_of(&fixture);
    for figure in [
        "dilation",
        "dmin",
        "fabric",
        "force-change",
        "force-distribution",
        "force-network-after",
        "force-network-before",
        "fraction-profile",
        "largest-drop",
        "pair-correlation",
        "phase-histogram",
        "stress-strain",
        "velocity-profile",
    ] {
        let name = format!("{figure}.svg");
        assert!(names.contains(&name), "{name} is not in {names:?}");
        assert!(
            page.contains(&format!("<li><a href=\"#{figure}\">")),
            "{figure}"
        );
        assert!(page.contains(&format!(
            "<figure id=\"{figure}\">\n<svg role=\"img\" aria-label=\""
        )));
    }
    let ends_with = |end: &str| names.iter().filter(|name| name.ends_with(end)).count();
    let figures = page.matches("<svg ").count();
    assert_eq!([".svg", ".pdf", ".png"].map(ends_with), [figures, 0, 0]);
    assert_eq!(ends_with(".csv-metadata.json"), ends_with(".csv"));
    assert_eq!(
        ends_with(".json") + ends_with(".html"),
        ends_with(".csv") + 2
    );
    // The numbers of figures of the time series are in one table, once.
    let captions = page.split("<figcaption>").skip(1);
    let of_series = captions.filter(|caption| caption.contains("href=\"series.csv\""));
    assert_eq!(of_series.count() + ends_with(".csv") - 1, figures);
    assert!(names.contains(&"series.csv".into()) && !names.contains(&"dilation.csv".into()));
    assert!(page.contains("Made up &lt;for&gt; tests &amp; nothing else"));
    // The name of SVG is no address.
    let links = page.replace("\"http://www.w3.org/2000/svg\"", "");
    assert!(
        !links.contains("http") && !links.contains("src="),
        "the page stands alone"
    );
    let links = page
        .split("href=\"")
        .skip(1)
        .filter_map(|of| of.split('"').next());
    for link in links {
        let is_there = match link.strip_prefix('#') {
            Some(id) => page.contains(&format!(" id=\"{id}\"")),
            None => names.iter().any(|name| name == link),
        };
        assert!(is_there, "{link}");
    }
    assert_eq!(summary["digest"], "00c0ffee00c0ffee");
    assert_eq!(summary["grains"], 192);
    let [earlier, later] = [0, 1].map(|k| summary["maps"]["steps"][k].as_u64().expect("a step"));
    assert!(earlier < later && later < 20_000);
}

#[test]
fn a_summary_has_the_numbers_of_the_run() {
    let mut fixture = Fixture::small();
    // Strain 0 … 50, τ = 1 in the first half, then 2 under N = 3 and 4 under N = 1 in turn.
    fixture.series[0] = (0..51).map(f64::from).collect();
    let later = |row: u32| row >= 25;
    fixture.series[column("normal_force")] = (0..51)
        .map(|row| if later(row) && row % 2 == 0 { 3.0 } else { 1.0 })
        .collect();
    let tau = |row| match row {
        row if !later(row) => 1.0,
        row => f64::from(2 + 2 * (row % 2)),
    };
    fixture.set_stress_ratio((0..51).map(tau).collect());
    let (_, summary, page) = report_of(&fixture);
    // Rows 25 … 50: 13 times S = 4, 13 times S = 6. ⟨S⟩/⟨N⟩ = 5/2, S - τN = ±1.5 over ⟨N⟩ = 2.
    let stress = &summary["stress_ratio_latter_half"];
    assert_eq!(
        (&stress["mean"], &stress["standard_deviation"]),
        (&2.5.into(), &0.75.into())
    );
    // These residuals alternate, so that pairs of rows have no scatter.
    assert_eq!(stress["standard_error"], 0.0);
    assert!(page.contains("<td>2.5000 ± 0.0000, 0.7500</td>"), "{page}");
    assert_eq!(
        summary["phases"]["stick"],
        serde_json::json!({ "long": 1, "short": 12 })
    );
    assert_eq!(
        summary["phases"]["slip"],
        serde_json::json!({ "long": 0, "short": 13 })
    );
    assert_eq!(summary["largest_drop"]["delta_tau"], -2.0);
    // The first slip ends the start.
    assert_eq!(summary["largest_drop"]["rows"], serde_json::json!([27, 28]));
    // Frames are every tenth row.
    let maps = &summary["maps"];
    assert_eq!(maps["steps"], serde_json::json!([2000, 3000]));
    // The page says so: what is shown is not the drop, which ends at another τ.
    assert_eq!(maps["stress_ratio"], serde_json::json!([1.0, 2.0]));
    for (name, state, tau) in [
        (
            "force-network-before",
            "at the last frame before the drop: step 2000, ",
            "τ = 1.0000, ",
        ),
        (
            "force-network-after",
            "at the first frame after the drop: step 3000, ",
            "τ = 2.0000, ",
        ),
    ] {
        let shown = figure(&page, name);
        assert!(shown.contains(state) && shown.contains(tau), "{name}");
    }
    assert!(page.contains("The maps show the frames around the largest drop, which is shorter"));
}

/// The part of a page that shows a figure.
fn figure<'a>(page: &'a str, name: &str) -> &'a str {
    let begin = page.split(&format!("<figure id=\"{name}\">")).nth(1);
    begin
        .and_then(|of| of.split("</figure>").next())
        .expect(name)
}

/// A flow without a phase of 2 % of the range of τ: the curve in the colour of the axes, and no
/// colour in the legend that does not occur.
#[test]
fn a_curve_of_small_phases_is_drawn_in_ink() {
    let mut fixture = Fixture::sheared(16, 12, 30);
    let tau = |row: usize| 0.001 * row as f64 - 0.003 * (row % 2) as f64;
    fixture.set_stress_ratio((0..fixture.series[1].len()).map(tau).collect());
    let (_, _, page) = report_of(&fixture);
    let shown = figure(&page, "stress-strain");
    let widest = shown.lines().filter(|line| line.starts_with("<polyline"));
    let widest = widest.max_by_key(|line| line.len()).expect("a curve");
    assert!(widest.contains("#22262B"), "{}", &widest[..200]);
    assert!(
        !shown.contains("#8A9199"),
        "grey is nearly invisible on dark paper"
    );
    assert!(!shown.contains("\nstick\n") && !shown.contains("\nslip\n"));
    // Those around the largest drop occur.
    let shown = figure(&page, "largest-drop");
    assert!(shown.contains("\nstick\n") && shown.contains("\nslip\n"));
}

/// τ overshoots at the start of a flow; its largest drop is one of the flow.
#[test]
fn the_overshoot_of_the_start_is_no_drop() {
    let mut fixture = Fixture::small();
    let tau = |row| match row {
        0..=10 => 0.2 * f64::from(row),
        11..=20 => 2.0 - 0.11 * f64::from(row - 10),
        40 => 1.3,
        row => 1.0 + 0.1 * f64::from(row % 2),
    };
    fixture.set_stress_ratio((0..51).map(tau).collect());
    let (_, summary, _) = report_of(&fixture);
    assert_eq!(summary["largest_drop"]["rows"], serde_json::json!([40, 42]));
}

#[test]
fn a_step_of_the_drive_is_no_drop() {
    let mut fixture = Fixture::small();
    // τ falls by 5 where the velocity of the drive falls, by 8 while it rests, else by 2 at most.
    let tau = |row| match row {
        20 => 1.0,
        30 => -2.0,
        40 => 4.0,
        row => 6.0 + f64::from(row % 2),
    };
    fixture.set_stress_ratio((0..51).map(tau).collect());
    fixture.series[column("drive_velocity")] = (0..51)
        .map(|row| match row {
            0..20 => 2.0,
            28..32 => 0.0,
            _ => 1.0,
        })
        .collect();
    let (_, summary, page) = report_of(&fixture);
    assert_eq!(summary["largest_drop"]["rows"], serde_json::json!([39, 40]));
    assert!(page.contains("slip (mm)") && page.contains("id=\"slip-rate\""));
}

/// `info`, `report` and `watch` say the same of a run that failed, was stopped or was killed.
#[test]
fn what_has_become_of_a_run_is_said_alike() {
    let fixture = Fixture {
        digest: None,
        ..Fixture::small()
    };
    let (folder, path) = folder_with(&fixture);
    for (state, message, words) in [
        (
            "failed",
            "\"2 grains <have left>\"",
            "failed: 2 grains <have left> (stage shear)",
        ),
        ("stopped", "null", "stopped at a checkpoint before its end"),
        // Nothing holds a lock.
        ("running", "null", "killed: its process is gone"),
    ] {
        let status = format!(
            r#"{{"version":1,"state":"{state}","message":{message},"run_id":"a","title":"","stage":"shear","step":1,
            "steps":2,"fraction":null,"strain":null,"stress_ratio":null,"solid_fraction":null,"shear_stress":null,
            "speed":null,"seconds_left":null,"seconds":1.0,"grains":1,"ranks":1,"host":"","pid":1,"started":"",
            "updated":""}}"#
        );
        std::fs::write(folder.path().join("status.json"), status).expect("written");
        let info = done(&["info", &path]);
        assert!(info.contains(&format!("state     {words}\n")), "{info}");
        let watched = done(&["watch", &path]);
        let name = words.split(':').next().expect("a word");
        let name = name.split(' ').next().expect("a word");
        assert!(watched.starts_with(&format!("{name}: ")), "{watched}");
        assert!(state != "failed" || watched.contains(words), "{watched}");
        done(&["report", &path, "--no-replay"]);
        let page = std::fs::read_to_string(folder.path().join("report/index.html"));
        let page = page.expect("a page");
        let escaped = words.replace('<', "&lt;").replace('>', "&gt;");
        assert!(
            page.contains(&format!("a run of gshear-mpi, {escaped}.")),
            "{page}"
        );
        assert!(page.contains(&format!("<tr><th>State</th><td>{escaped}</td></tr>")));
    }
}

#[test]
fn figures_have_the_formats_that_are_asked_for() {
    let fixture = Fixture::sheared(16, 12, 20);
    let (names, _, page) = report_with(&fixture, &["--formats", "png,pdf"]);
    let figures = page.matches("<svg ").count();
    let ends_with = |end: &str| names.iter().filter(|name| name.ends_with(end)).count();
    assert_eq!(
        [".svg", ".pdf", ".png"].map(ends_with),
        [0, figures, figures]
    );
    assert!(page.contains("<a href=\"dmin.png\">dmin.png</a>, <a href=\"dmin.pdf\">"));
    let (_folder, path) = folder_with(&fixture);
    let refused = reduce(&["report", &path, "--formats", "svg,jpg"]);
    let said = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("must be svg, pdf or png"), "{said}");
}

#[test]
fn a_report_of_next_to_nothing_says_so() {
    let mut fixture = Fixture::small();
    fixture.frames.clear();
    fixture.digest = None;
    let (names, summary, page) = report_of(&fixture);
    assert!(
        !names.contains(&"dmin.svg".to_string())
            && names.contains(&"stress-strain.svg".to_string())
    );
    assert!(summary["maps"].is_null() && summary["digest"].is_null());
    assert!(page.contains("there are no maps") && page.contains("unfinished: no digest"));

    fixture.series.iter_mut().for_each(Vec::clear);
    fixture.series_step.clear();
    let (_, summary, _) = report_of(&fixture);
    assert!(summary["largest_drop"].is_null());
}
