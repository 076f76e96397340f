//! `compare`.

use super::fixture::Fixture;
use super::{done, folder_with, reduce, text};

#[test]
fn equal_runs_compare_equal() {
    let mut fixture = Fixture::small();
    fixture.series[7][3] = f64::NAN;
    fixture.frames[2].grains[5].velocity[1] = f64::NAN;
    let ((_a, a), (_b, b)) = (folder_with(&fixture), folder_with(&fixture));
    let told = done(&["compare", &a, &format!("{b}/run.h5")]);
    assert!(told.ends_with("equal\n"), "{told}");
}

/// What `compare` prints of a fixture and a changed one, which must differ.
fn difference(change: impl Fn(&mut Fixture)) -> String {
    let mut changed = Fixture::small();
    let (_a, a) = folder_with(&changed);
    change(&mut changed);
    let (_b, b) = folder_with(&changed);
    let output = reduce(&["compare", &a, &b]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let told = text(&output.stdout);
    assert!(told.ends_with("different\n"), "{told}");
    told
}

/// The fields that differ, by the third column, and their lines.
fn differing(told: &str) -> Vec<String> {
    let row = |line: &str| {
        let (name, rest) = (line.get(..24)?.trim(), line.get(24..)?);
        let count: u64 = rest.split_whitespace().nth(1)?.parse().ok()?;
        (count > 0).then(|| format!("{name} {count}"))
    };
    told.lines().filter_map(row).collect()
}

#[test]
fn compare_finds_a_single_bit() {
    let told = difference(|run| {
        let value = &mut run.frames[3].grains[17].position[0];
        *value = f64::from_bits(value.to_bits() ^ 1);
    });
    assert_eq!(differing(&told), ["position 1"]);
    assert!(told.contains("frame 3 grain 17 x"), "{told}");

    let told = difference(|run| run.frames[5].contacts[4].rolling_history *= -1.0);
    assert_eq!(differing(&told), ["c. rolling_history 1"]);
    let told = difference(|run| run.frames[1].grains[7].angular_velocity[2] = -0.0);
    assert_eq!(
        differing(&told),
        ["angular_velocity 1"],
        "the sign of zero is a bit too"
    );
    let told = difference(|run| run.series[1][20] += 1e-3);
    assert_eq!(differing(&told), ["stress_ratio 1"]);
    assert!(told.contains("row 20"), "{told}");
}

#[test]
fn compare_finds_what_is_missing() {
    let told = difference(|run| {
        run.frames.pop();
    });
    assert!(told.contains("number of frames: 6 against 5"), "{told}");
    let told = difference(|run| {
        run.frames[2].contacts.remove(3);
    });
    assert_eq!(differing(&told), ["contacts 1"]);
    let told = difference(|run| {
        run.series_step.truncate(40);
        run.series.iter_mut().for_each(|column| column.truncate(40));
    });
    assert!(
        told.contains("rows of the time series: 51 against 40"),
        "{told}"
    );
    let told = difference(|run| run.digest = Some("1".into()));
    assert!(
        told.contains("digest: 00c0ffee00c0ffee against 1"),
        "{told}"
    );
}
