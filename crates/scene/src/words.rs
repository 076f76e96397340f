//! Numbers and lists in messages and in TOML.

/// The shortest decimal that reads back to the same bits, without many zeros.
pub fn show(x: f64) -> String {
    if x.is_finite() && x.abs() >= 1e7 {
        format!("{x:e}")
    } else {
        format!("{x:?}")
    }
}

/// `a, b and c`.
pub fn list(names: &[impl AsRef<str>], and: &str) -> String {
    let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
    match names.split_last() {
        Some((last, [])) => (*last).into(),
        Some((last, others)) => format!("{} {and} {last}", others.join(", ")),
        None => String::new(),
    }
}

/// A part of the input in a message, in quotes: its beginning, if it is long.
pub fn quoted(text: &str) -> String {
    match text.char_indices().nth(LONGEST_QUOTE) {
        None => format!("{text:?}"),
        Some((end, _)) => format!("{:?}…", &text[..end]),
    }
}

/// The beginning of a line in a message.
pub fn shortened(line: &str) -> String {
    match line.char_indices().nth(LONGEST_QUOTE) {
        None => line.into(),
        Some((end, _)) => format!("{}…", &line[..end]),
    }
}

/// Characters.
const LONGEST_QUOTE: usize = 120;
