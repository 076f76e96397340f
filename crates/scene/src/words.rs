//! Words of configurations; numbers and lists in messages and in TOML.

use strsim::levenshtein;

/// Removes a key, so that the default or another key for the same quantity applies. In a file, it
/// removes the key of the file that is extended.
pub(crate) const TAKE_AWAY: &str = "none";
/// The key that names the file that a file extends.
pub(crate) const EXTENDS: &str = "extends";
/// The table of lists of values, which make several runs.
pub(crate) const SWEEP: &str = "sweep";

/// The shortest decimal that reads back to the same bits, without many zeros.
pub(crate) fn show(x: f64) -> String {
    if x.is_finite() && x.abs() >= 1e7 {
        format!("{x:e}")
    } else {
        format!("{x:?}")
    }
}

/// `a, b and c`.
pub(crate) fn list(names: &[impl AsRef<str>], and: &str) -> String {
    let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
    match names.split_last() {
        Some((last, [])) => (*last).into(),
        Some((last, others)) => format!("{} {and} {last}", others.join(", ")),
        None => String::new(),
    }
}

/// `"a", "b" and "c"`.
pub(crate) fn quoted_list(names: impl IntoIterator<Item = impl AsRef<str>>, and: &str) -> String {
    let quoted = names.into_iter().map(|name| format!("{:?}", name.as_ref()));
    list(&quoted.collect::<Vec<_>>(), and)
}

/// A part of the input in a message, in quotes: its beginning, if it is long.
pub(crate) fn quoted(text: &str) -> String {
    match text.char_indices().nth(LONGEST_QUOTE) {
        None => format!("{text:?}"),
        Some((end, _)) => format!("{:?}…", &text[..end]),
    }
}

/// The beginning of a line in a message.
pub(crate) fn shortened(line: &str) -> String {
    match line.char_indices().nth(LONGEST_QUOTE) {
        None => line.into(),
        Some((end, _)) => format!("{}…", &line[..end]),
    }
}

/// Characters.
const LONGEST_QUOTE: usize = 120;

/// `start; intro a, b, c`, with no semicolon after a question mark.
pub(crate) fn known_names(start: String, intro: &str, names: &[&str]) -> String {
    let names = names.join(", ");
    if start.ends_with('?') {
        let mut intro = intro.to_string();
        intro[..1].make_ascii_uppercase();
        format!("{start} {intro} {names}")
    } else {
        format!("{start}; {intro} {names}")
    }
}

/// What follows a message about a word that none of these names is: the one that is meant, perhaps.
pub(crate) fn meant(word: &str, names: &[&str]) -> String {
    nearest(word, names).map_or(String::new(), |near| format!("; did you mean {near}?"))
}

/// The name nearest by Levenshtein's distance, if it is near enough to be a misspelling.
pub(crate) fn nearest<'a>(word: &str, names: &[&'a str]) -> Option<&'a str> {
    let (distance, name) = names
        .iter()
        .map(|name| (levenshtein(word, name), *name))
        .min()?;
    (2 * distance <= word.chars().count().max(name.len())).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_far_name_is_not_suggested() {
        let names = ["radius_min", "length"];
        assert_eq!(nearest("radius", &names), Some("radius_min"));
        assert_eq!(nearest("gravity", &names), None);
    }
}
