//! The operations between ranks, on real ranks: this test starts itself under mpirun, as
//! [`program`].

#[path = "../common/mod.rs"]
mod common;
mod program;

use std::process::ExitCode;

use common::{on_ranks, rank_arguments, rank_program, run_tests, succeed};

fn main() -> ExitCode {
    if let Some(arguments) = rank_arguments() {
        program::run(&arguments);
        return ExitCode::SUCCESS;
    }
    run_tests(&[
        (
            "operations_hold_on_any_number_of_ranks",
            operations_hold_on_any_number_of_ranks,
        ),
        (
            "starts_without_mpirun_as_one_rank",
            starts_without_mpirun_as_one_rank,
        ),
        (
            "a_panic_ends_every_rank_with_its_message",
            a_panic_ends_every_rank_with_its_message,
        ),
        ("an_abort_keeps_its_exit_code", an_abort_keeps_its_exit_code),
    ])
}

fn operations_hold_on_any_number_of_ranks() {
    // More than eight sum as a tree.
    for ranks in [1, 2, 3, 5, 11] {
        let output = succeed(&mut on_ranks(ranks));
        assert_eq!(
            String::from_utf8_lossy(&output.stdout).trim(),
            format!("ranks {ranks}")
        );
    }
}

fn starts_without_mpirun_as_one_rank() {
    let [test, as_rank] = rank_program();
    let output = succeed(common::start(test).arg(as_rank));
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "ranks 1");
}

fn a_panic_ends_every_rank_with_its_message() {
    for ranks in [1, 3] {
        let output = on_ranks(ranks).arg("panic").output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        assert_eq!(
            String::from_utf8_lossy(&output.stderr)
                .matches("the last rank panics")
                .count(),
            1
        );
    }
}

fn an_abort_keeps_its_exit_code() {
    let output = on_ranks(2).arg("abort").output().unwrap();
    assert_eq!(output.status.code(), Some(3));
}
