//! Laws that a program adds to those of the crate.

use gshear_dem::laws::{self, LAWS, LawKind, hooke};

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
