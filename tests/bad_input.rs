//! Every file of `bad_input/` is refused with the very message that it carries.

mod common;

use gshear::config::{Source, load};
use gshear::failure::Failure;

#[test]
fn load_tells_what_is_wrong() {
    common::each_bad_input(
        |path| match Source::read(path).and_then(|source| load(&source, &[])) {
            Ok(_) => "no error".into(),
            Err(Failure::Input(message)) => message,
            Err(other) => format!("not a bad input: {other:?}"),
        },
    );
}
