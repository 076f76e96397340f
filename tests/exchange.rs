//! The verbs between ranks, on real ranks.

mod common;

use common::{example, mpirun, succeed};
use std::process::Command;

#[test]
fn verbs_hold_on_any_number_of_ranks() {
    for ranks in [1, 2, 3, 5] {
        let output = succeed(&mut mpirun(ranks, example("exchange_check")));
        assert_eq!(
            String::from_utf8_lossy(&output.stdout).trim(),
            format!("ranks {ranks}")
        );
    }
}

#[test]
fn starts_without_mpirun_as_one_rank() {
    let output = succeed(&mut Command::new(example("exchange_check")));
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "ranks 1");
}

#[test]
fn a_panic_ends_every_rank_with_its_message() {
    for ranks in [1, 3] {
        let output = mpirun(ranks, example("exchange_check"))
            .arg("panic")
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1));
        assert_eq!(
            String::from_utf8_lossy(&output.stderr)
                .matches("the last rank panics")
                .count(),
            1
        );
    }
}

#[test]
fn an_abort_keeps_its_exit_code() {
    let output = mpirun(2, example("exchange_check"))
        .arg("abort")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3));
}
