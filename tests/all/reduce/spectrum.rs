//! `spectrum` on matrix files.

use std::fs;
use std::path::Path;

use super::fixture::Fixture;
use super::{are_described, done, folder_with, reduce, refused, text};

/// 2 on the diagonal and two blocks of pairs, 1 ± 2i and 4 ± 0.5i, over masses of 2.
const K: &str = "%%MatrixMarket matrix coordinate real general
% a comment
6 6 10
1 1 2.0
1 2 4
2 1 -4
2 2 2.0
3 3 8
3 4 1.0
4 3 -1.0
4 4 8
5 5 4e0

6 6 -2
";
const M: &str = "%%MatrixMarket matrix array integer symmetric
6 6
2
0
0
0
0
0
2
0
0
0
0
2
0
0
0
2
0
0
2
0
2
";

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    fs::write(&path, text).expect("a file");
    path.to_str().expect("UTF-8").to_string()
}

/// Real and imaginary parts and verdicts of spectrum.csv.
fn table(folder: &Path) -> Vec<(f64, f64, String)> {
    let text = fs::read_to_string(folder.join("spectrum.csv")).expect("spectrum.csv");
    let line = |line: &str| {
        let words: Vec<&str> = line.split(',').collect();
        let number = |at: usize| words[at].parse::<f64>().expect("a number");
        (number(0), number(1), words[2].to_string())
    };
    text.lines().skip(1).map(line).collect()
}

#[test]
fn eigenvalues_and_vectors_of_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let (k, m) = (
        write(folder.path(), "K.mtx", K),
        write(folder.path(), "M.mtx", M),
    );
    let to = out.to_str().expect("UTF-8");
    let exact = [
        (1.0, 2.0),
        (4.0, 0.5),
        (2.0, 0.0),
        (-1.0, 0.0),
        (1.0, -2.0),
        (4.0, -0.5),
    ];
    for how in ["--dense", "--all-pairs"] {
        let said = done(&[
            "spectrum", "--matrix", &k, "--mass", &m, how, "--group", "2", "--out", to,
        ]);
        assert!(
            said.contains("2 real, 4 in pairs, 0 doubtful, 0 zero"),
            "{said}"
        );
        assert!(
            how == "--dense" || said.contains("2 found, 2 counted by the winding"),
            "{said}"
        );
        are_described(&out, &["spectrum.csv"]);
        let rows = table(&out);
        assert_eq!(rows.len(), 6);
        for (re, im) in exact {
            let is = |row: &&(f64, f64, String)| (row.0 - re).hypot(row.1 - im) < 1e-13;
            let row = rows.iter().find(is).expect("it is there");
            assert_eq!(row.2, if im == 0.0 { "real" } else { "pair" });
        }
    }
    let said = done(&[
        "spectrum", "--matrix", &k, "--mass", &m, "--shift", "3.9,-0.4", "--count", "1", "--out",
        to,
    ]);
    assert!(said.contains("1 eigenvalues"), "{said}");
    let rows = table(&out);
    assert!((rows[0].0 - 4.0).hypot(rows[0].1 + 0.5) < 1e-13);

    let file = hdf5::File::open(out.join("spectrum.h5")).expect("spectrum.h5");
    let vectors = file.dataset("eigenvector").expect("eigenvector");
    assert_eq!(vectors.shape(), [1, 6, 2]);
    let v: Vec<f64> = vectors.read_raw().expect("numbers");
    // (8 v₃ + v₄) / 2 = λ v₃ of λ = 4 - i/2: v₄ = -i v₃, and nothing elsewhere.
    let (a, b) = ([v[4], v[5]], [v[6], v[7]]);
    assert!((b[0] - a[1]).abs() < 1e-12 && (b[1] + a[0]).abs() < 1e-12);
    assert!((a[0].hypot(a[1]) - 0.5f64.sqrt()).abs() < 1e-12);
    assert!(out.join("spectrum.svg").exists());
}

#[test]
fn bad_matrices_are_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let good = write(folder.path(), "K.mtx", K);
    let header = "%%MatrixMarket matrix coordinate real general\n";
    for (text, message) in [
        ("", "line 1: must be %%MatrixMarket"),
        (
            "%%MatrixMarket matrix coordinate complex general\n",
            "line 1: complex: must be",
        ),
        (
            &format!("{header}2 2\n"),
            "line 2: must hold rows, columns and number of entries",
        ),
        (
            &format!("{header}2 2 2\n1 1 1\n"),
            "line 4: the file ends after 1 of 2 entries",
        ),
        (
            &format!("{header}2 2 1\n1 3 1\n"),
            "line 3: row 1, column 3: the matrix is 2 × 2",
        ),
        (
            &format!("{header}2 2 1\n0 1 1\n"),
            "line 3: row 0, column 1",
        ),
        (
            &format!("{header}2 2 1\n1 1 one\n"),
            "line 3: value one: must be a number",
        ),
        (&format!("{header}2 2 1\n1 1\n"), "line 3: value missing"),
        (
            &format!("{header}2 2 1\n1 1 nan\n"),
            "line 3: value NaN: must be finite",
        ),
        (
            &format!("{header}2 2 1\n1 1 1\n2 2 1\n"),
            "line 4: more than the 1 entries",
        ),
        (
            &format!("{header}2 3 1\n1 1 1\n"),
            "2 × 3: K must be square",
        ),
    ] {
        let bad = write(folder.path(), "bad.mtx", text);
        let said = refused(&["spectrum", "--matrix", &bad]);
        assert!(said.contains("bad.mtx") && said.contains(message), "{said}");
    }
    for (text, message) in [
        (
            format!("{header}2 2 2\n1 1 1\n2 2 1\n"),
            "2 masses: K has 6 unknowns",
        ),
        (
            format!("{header}6 6 1\n1 2 1\n"),
            "row 1, column 2: M must be diagonal",
        ),
        (
            format!("{header}6 6 1\n1 1 1\n"),
            "row 2: mass 0 must be positive",
        ),
    ] {
        let bad = write(folder.path(), "bad.mtx", &text);
        let said = refused(&["spectrum", "--matrix", &good, "--mass", &bad]);
        assert!(said.contains("bad.mtx") && said.contains(message), "{said}");
    }
    let bad = write(folder.path(), "bad.mtx", &format!("{header}6 1 1\n5 1 1\n"));
    let said = refused(&["spectrum", "--matrix", &good, "--null", &bad]);
    assert!(said.contains("must be a null vector"), "{said}");
    assert!(refused(&["spectrum", "--matrix", "/no/such.mtx"]).contains("/no/such.mtx"));
    let left: Vec<_> = fs::read_dir(folder.path()).expect("a folder").collect();
    assert_eq!(left.len(), 2, "{left:?}");
}

/// A contact whose damper left no force adds as little as one that is not there; a frame whose K is
/// not finite is named, and the others go on.
#[test]
fn stability_of_frames_with_idle_contacts_and_after_one_that_fails() {
    let mut fixture = Fixture::small();
    let idle = &mut fixture.frames[1].contacts[5];
    idle.idle = 1;
    idle.normal_force = 0.0;
    idle.tangential_force = [0.0; 3];
    idle.tangential_history = [0.0; 3];
    idle.rolling_history = 0.0;
    idle.sliding = 1;
    let (folder, path) = folder_with(&fixture);
    done(&["stability", &path]);
    let rows = |folder: &Path| -> Vec<String> {
        let table = fs::read_to_string(folder.join("stability.csv")).expect("a table");
        table.lines().skip(1).map(String::from).collect()
    };
    let sound = rows(folder.path());
    assert_eq!(sound.len(), 6);

    fixture.frames[1].contacts.remove(5);
    fixture.frames[3].contacts[0].tangential_history[0] = f64::NAN;
    let (folder, path) = folder_with(&fixture);
    let output = reduce(&["stability", &path]);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(message.contains("frame 3 (step 3000)"), "{message}");
    for (t, (row, sound)) in rows(folder.path()).iter().zip(&sound).enumerate() {
        assert_eq!(row.ends_with(",NaN"), t == 3, "{row}");
        assert!(t == 3 || row == sound, "{row}\n{sound}");
    }
}
