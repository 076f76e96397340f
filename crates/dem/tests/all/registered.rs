//! Laws and observables that a program adds to those of the crate.

use std::sync::Arc;

use gshear_dem::laws::{self, LAWS, LawKind, hooke};
use gshear_dem::observables::{self, Observable, ObservableKind, SampleView, Total};

const OWN: LawKind = LawKind {
    name: "of the program",
    ..hooke::KIND
};

/// One test, because laws are registered once in a process.
#[test]
fn a_program_adds_laws_once() {
    let again = |own| std::panic::catch_unwind(|| laws::register(own)).is_err();
    assert!(again(&[&hooke::KIND]), "a name that another law has");
    assert!(again(&[&OWN, &OWN]), "a name twice");
    assert!(laws::kind(OWN.name).is_none());

    laws::register(&[&OWN]);
    assert!(laws::kind(OWN.name).is_some());
    assert_eq!(laws::all().count(), LAWS.len() + 1);
    assert!(again(&[&OWN]), "a second call");
}

#[derive(Debug)]
struct Nothing;

impl Observable for Nothing {
    fn value(&self, _: &SampleView, _: &[Total]) -> f64 {
        0.0
    }
}

const NOTHING: ObservableKind = ObservableKind {
    name: "nothing",
    summary: "0",
    unit: "1",
    keys: &[],
    read: |_, _| Arc::new(Nothing),
};

/// One test, because observables are registered once in a process.
#[test]
fn a_program_adds_observables_once() {
    let again = |own| std::panic::catch_unwind(|| observables::register(own)).is_err();
    assert!(again(&[&NOTHING, &NOTHING]), "a name twice");
    assert!(observables::kind(NOTHING.name).is_none());

    observables::register(&[&NOTHING]);
    let kind = observables::kind(NOTHING.name).map(|kind| kind.summary);
    assert_eq!(kind, Some("0"));
    assert_eq!(observables::all().count(), 1);
    assert!(again(&[&NOTHING]), "a second call");
}
