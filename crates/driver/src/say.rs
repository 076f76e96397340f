//! Messages to the terminal. A closed or full output does not end a run, because its results are
//! files.

use std::io::Write;

use console::Term;

/// Prints a line, if standard output is neither closed nor full; on a terminal folded to its width.
pub fn say(line: &str) {
    let line = fold_for(&Term::stdout(), line);
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

/// Prints a line to standard error, if that is neither closed nor full; on a terminal folded to its
/// width.
pub fn say_error(line: &str) {
    let line = fold_for(&Term::stderr(), line);
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Prints a text that other programs read as well, as it is, if standard output is neither closed nor
/// full.
pub fn say_verbatim(text: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{text}");
}

/// [`fold`] to the width of a terminal; files and pipes get the text as it is.
pub fn fold_for(term: &Term, text: &str) -> String {
    match term.size_checked().filter(|_| term.is_term()) {
        // A character in the last column would break the line on some terminals.
        Some((_, width)) => fold(text, usize::from(width).saturating_sub(1)),
        None => text.into(),
    }
}

/// Breaks lines of more than `width` characters between words. What follows stands under the second
/// column of a line such as `steps       about 380000`, and is indented by two characters in others.
/// Longer words stay whole.
pub fn fold(text: &str, width: usize) -> String {
    let lines: Vec<String> = text
        .split('\n')
        .map(|line| fold_line(line, width))
        .collect();
    lines.join("\n")
}

fn fold_line(line: &str, width: usize) -> String {
    if line.chars().count() <= width {
        return line.into();
    }
    let characters: Vec<char> = line.chars().collect();
    let blank = |at: usize| characters.get(at) == Some(&' ');
    let first = (0..characters.len()).find(|at| !blank(*at)).unwrap_or(0);
    let gap = (first..characters.len()).find(|at| blank(*at) && blank(at + 1));
    let second = gap.and_then(|gap| (gap..characters.len()).find(|at| !blank(*at)));
    let (start, indent) = match second.filter(|second| *second <= width / 2) {
        Some(second) => (second, second),
        None if first > 0 && first <= width / 2 => (first, first),
        None => (first, first.min(width / 2) + 2),
    };
    let rest: String = characters[start..].iter().collect();
    let mut folded: String = characters[..start].iter().collect();
    let (mut taken, mut fresh) = (start, true);
    for word in rest.split(' ').filter(|word| !word.is_empty()) {
        let length = word.chars().count();
        if !fresh && taken + 1 + length > width {
            folded += "\n";
            folded += &" ".repeat(indent);
            (taken, fresh) = (indent, true);
        }
        if !fresh {
            folded += " ";
            taken += 1;
        }
        folded += word;
        (taken, fresh) = (taken + length, false);
    }
    folded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_folded_under_their_second_column() {
        let text = "time        packing about 20s, shear about 51s\n\
                    disk        about 166 MB\n            \
                    run.h5 161 MB (1001 frames, 10006 rows)";
        let folded = "time        packing about 20s, shear\n            about 51s\n\
                      disk        about 166 MB\n            \
                      run.h5 161 MB (1001 frames,\n            10006 rows)";
        assert_eq!(fold(text, 39), folded);
        assert_eq!(fold(text, 80), text);
    }

    #[test]
    fn messages_are_folded_between_words() {
        let text = "error: a/long/path/to/a/scene/that/is/long.toml:3: must be 0";
        let folded = "error:\n  a/long/path/to/a/scene/that/is/long.toml:3:\n  must be 0";
        assert_eq!(fold(text, 20), folded);
        assert_eq!(fold("", 20), "");
        assert_eq!(fold("a b", 0), "a\n  b");
    }

    /// No line is longer than the width but a single word, and no word is lost.
    #[test]
    fn nothing_is_lost() {
        let text = "results in out/a; law:   one two  three four    five six seven eight";
        for width in 0..80 {
            let folded = fold(text, width);
            let words =
                |text: &str| -> Vec<String> { text.split_whitespace().map(String::from).collect() };
            assert_eq!(words(&folded), words(text), "{width}");
            for line in folded.lines() {
                let alone = line.split_whitespace().count() == 1;
                assert!(alone || line.chars().count() <= width, "{width}: {folded}");
            }
        }
    }
}
