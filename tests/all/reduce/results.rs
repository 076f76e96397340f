//! `dmin`, `phases` and `report`.

use std::path::{Path, PathBuf};

use gshear_dem::state::{Frame, SeriesRow};

use super::fixture::Fixture;
use super::{are_described, done, folder_with};

#[test]
fn dmin_is_written_for_every_frame() {
    let mut fixture = Fixture::sheared(16, 12, 7);
    // Frame 3 is an affine map of frame 2: simple shear, which keeps the period.
    fixture.frames[3] = Frame {
        step: 3000,
        ..fixture.frames[2].clone()
    };
    let length = fixture.grains.length;
    let Frame {
        position, image, ..
    } = &mut fixture.frames[3];
    for (r, image) in position.iter_mut().zip(image) {
        // The highest grains move by more than a period.
        let x = r[0] + 2.7 * r[1];
        r[0] = x.rem_euclid(length);
        *image += x.div_euclid(length) as i64;
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
    fixture.series[1] = tau;
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
    fixture.series[1] = (0..51).map(tau).collect();
    // S over the imposed N of 0.6 rises up to row 30 and falls then.
    let ratio = |row: usize| {
        if row <= 30 {
            row as f64
        } else {
            60.0 - row as f64
        }
    };
    let shear = SeriesRow::COLUMNS
        .iter()
        .position(|column| column.name == "shear_force")
        .expect("a column");
    fixture.series[shear] = (0..51).map(|row| 0.6 * ratio(row)).collect();
    let (folder, path) = folder_with(&fixture);
    let phases = |options: &[&str]| -> Vec<Vec<String>> {
        let mut arguments = vec!["phases", &path];
        arguments.extend(options);
        done(&arguments);
        let csv = std::fs::read_to_string(folder.path().join("phases.csv")).expect("the table");
        let row = |line: &str| line.split(',').map(String::from).collect();
        csv.lines().skip(1).map(row).collect()
    };
    let rows = |phases: &[Vec<String>]| -> Vec<[String; 4]> {
        let of = |row: &Vec<String>| [1, 3, 4, 9].map(|k| row[k].clone());
        phases.iter().map(of).collect()
    };
    assert_eq!(phases(&[]).len(), 50);
    // Of every second row, and of means over two, τ only rises.
    let second = phases(&["--every", "2"]);
    assert_eq!(rows(&second), [["stick", "0", "50", "25"]]);
    assert_eq!(second[0][6], "5000");
    let means = phases(&["--every", "2", "--average"]);
    assert_eq!(rows(&means), [["stick", "2", "50", "24"]]);
    // Rounded to multiples of 100, it is constant.
    assert_eq!(phases(&["--round", "100"]).len(), 0);
    let imposed = phases(&["--normal-force", "imposed"]);
    assert_eq!(
        rows(&imposed),
        [["stick", "0", "30", "30"], ["slip", "30", "50", "20"]]
    );
    let from = fixture.series[0][20].to_string();
    let late = phases(&["--normal-force", "imposed", "--from", &from]);
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
    let (folder, path) = folder_with(fixture);
    done(&["report", &path]);
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
        for end in ["svg", "csv"] {
            let name = format!("{figure}.{end}");
            assert!(names.contains(&name), "{name} is not in {names:?}");
        }
        assert!(page.contains(&format!(
            "<figure id=\"{figure}\">\n<svg role=\"img\" aria-label=\""
        )));
    }
    let ends_with = |end: &str| names.iter().filter(|name| name.ends_with(end)).count();
    let figures = page.matches("<svg ").count();
    assert_eq!([ends_with(".svg"), ends_with(".csv")], [figures; 2]);
    assert_eq!(ends_with(".csv-metadata.json"), figures);
    assert_eq!(ends_with(".json") + ends_with(".html"), figures + 2);
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
    let mut links: Vec<&str> = links.collect();
    assert!(
        links
            .iter()
            .all(|link| names.iter().any(|name| name == link))
    );
    links.sort_unstable();
    links.dedup();
    let ends = |end: &str| links.iter().filter(|link| link.ends_with(end)).count();
    assert_eq!([".csv", ".pdf", ".png"].map(ends), [figures; 3]);
    assert_eq!(summary["digest"], "00c0ffee00c0ffee");
    assert_eq!(summary["grains"], 192);
    let [earlier, later] = [0, 1].map(|k| summary["maps"]["frames"][k].as_u64().expect("a frame"));
    assert!(earlier < later && later < 20);
}

#[test]
fn a_summary_has_the_numbers_of_the_run() {
    let mut fixture = Fixture::small();
    // Strain 0 … 50, τ = 1 in the first half, then 2 and 4 in turn: mean 3, deviation 1 but for the
    // odd row.
    fixture.series[0] = (0..51).map(f64::from).collect();
    fixture.series[1] = (0..51)
        .map(|row| {
            if row < 25 {
                1.0
            } else {
                f64::from(2 + 2 * (row % 2))
            }
        })
        .collect();
    let (_, summary, _) = report_of(&fixture);
    // Rows 25 … 50: 13 times 4, 13 times 2.
    assert_eq!(summary["stress_ratio_latter_half"]["mean"], 3.0);
    assert_eq!(
        summary["stress_ratio_latter_half"]["standard_deviation"],
        1.0
    );
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
    assert_eq!(summary["maps"]["frames"], serde_json::json!([2, 3]));
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
    let rows = fixture.series[1].len();
    fixture.series[1] = (0..rows)
        .map(|row| 0.001 * row as f64 - 0.003 * (row % 2) as f64)
        .collect();
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
    fixture.series[1] = (0..51)
        .map(|row| match row {
            0..=10 => 0.2 * f64::from(row),
            11..=20 => 2.0 - 0.11 * f64::from(row - 10),
            40 => 1.3,
            row => 1.0 + 0.1 * f64::from(row % 2),
        })
        .collect();
    let (_, summary, _) = report_of(&fixture);
    assert_eq!(summary["largest_drop"]["rows"], serde_json::json!([40, 42]));
}

#[test]
fn a_step_of_the_drive_is_no_drop() {
    let mut fixture = Fixture::small();
    let named = |name: &str| SeriesRow::COLUMNS.iter().position(|of| of.name == name);
    let drive = named("drive_velocity").expect("a column");
    // τ falls by 5 where the velocity of the drive falls, by 8 while it rests, else by 2 at most.
    fixture.series[1] = (0..51)
        .map(|row| match row {
            20 => 1.0,
            30 => -2.0,
            40 => 4.0,
            row => 6.0 + f64::from(row % 2),
        })
        .collect();
    fixture.series[drive] = (0..51)
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
    assert!(page.contains("there are no maps") && page.contains("stopped early"));

    fixture.series.iter_mut().for_each(Vec::clear);
    fixture.series_step.clear();
    let (_, summary, _) = report_of(&fixture);
    assert!(summary["largest_drop"].is_null());
}
