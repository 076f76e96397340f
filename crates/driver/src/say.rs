//! Messages to the terminal. A closed or full output does not end a run, because its results are
//! files; it ends a command whose result is what it prints.

use std::io::{ErrorKind, Write};

use console::Term;
use gshear_dem::failure::{Failure, Result, printable};
use gshear_mpi_exchange::Parallel;
use gshear_store::collective::on_root;
use rustix::fs::{Mode, OFlags};

/// Prints a line, if standard output is neither closed nor full; on a terminal folded to its width.
pub fn say(line: &str) {
    let line = fold_for(&Term::stdout(), &printable(line));
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

/// Prints a line to standard error, if that is neither closed nor full; on a terminal folded to its
/// width.
pub fn say_error(line: &str) {
    let line = fold_for(&Term::stderr(), &printable(line));
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Prints a result, which other programs read as well, as it is but for control characters, on the
/// first rank. A reader that has closed its pipe, such as `head -1`, is no failure. Collective.
///
/// # Errors
/// Standard output that cannot be written, such as a file on a full disk, on every rank.
pub(crate) fn print(exchange: &dyn Parallel, text: &str) -> Result<()> {
    on_root(exchange, || {
        let mut output = std::io::stdout().lock();
        match writeln!(output, "{}", printable(text)).and_then(|()| output.flush()) {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => {
                Err(Failure::other(format!("standard output: {e}")))
            }
            _ => Ok(()),
        }
    })
}

/// Folds a text to the width of a terminal; files and pipes get the text as it is.
pub fn fold_for(term: &Term, text: &str) -> String {
    match width(term) {
        Some(width) => fold(text, width),
        None => text.into(),
    }
}

/// Characters of a line of a terminal; `None` of files and pipes.
pub(crate) fn width(term: &Term) -> Option<usize> {
    if !term.is_term() {
        return None;
    }
    let (_, own) = term.size_checked()?;
    let width = launcher_width().unwrap_or(own);
    // A character in the last column would break the line on some terminals.
    Some(usize::from(width).saturating_sub(1))
}

/// The present width of the terminal of Open MPI's mpirun, if it started this rank on the same
/// machine: the terminal that it gives a rank keeps the size which that one had at the start.
fn launcher_width() -> Option<u16> {
    std::env::var_os("OMPI_COMM_WORLD_RANK")?;
    let launcher = std::os::unix::process::parent_id();
    (1..=2).find_map(|stream| {
        let path = format!("/proc/{launcher}/fd/{stream}");
        // Not as the terminal that controls this process.
        let flags = OFlags::WRONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let opened = rustix::fs::open(path, flags, Mode::empty()).ok()?;
        let size = rustix::termios::tcgetwinsize(opened).ok()?;
        (size.ws_col > 0).then_some(size.ws_col)
    })
}

/// Breaks lines of more than `width` characters between words. What follows stands under the second
/// column of a line such as `steps       about 380000` or `shear: I = 2e-4`, and is indented by two
/// characters in others. Longer words stay whole.
pub(crate) fn fold(text: &str, width: usize) -> String {
    let lines = text.split('\n').map(|line| fold_line(line, width));
    lines.collect::<Vec<_>>().join("\n")
}

/// Heads of the lines of a run that have one blank before the second column.
const HEADS: [&str; 3] = ["shear: ", "drive: ", "birth: "];

/// The place of the first character from `start` on that is not blank.
fn after_blanks(characters: &[char], start: usize) -> Option<usize> {
    let place = characters[start..].iter().position(|c| *c != ' ')?;
    Some(start + place)
}

fn fold_line(line: &str, width: usize) -> String {
    if line.chars().count() <= width {
        return line.into();
    }
    let characters: Vec<char> = line.chars().collect();
    let first = after_blanks(&characters, 0).unwrap_or(0);
    let headed = HEADS.iter().find(|head| line.starts_with(**head));
    let second = match headed {
        Some(head) => Some(head.len()),
        None => {
            let gap = characters[first..]
                .windows(2)
                .position(|two| *two == [' '; 2]);
            gap.and_then(|gap| after_blanks(&characters, first + gap))
        }
    };
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
        let text = "time        prepare about 20s, shear about 51s\n\
                    disk        about 166 MB\n            \
                    run.h5 161 MB (1001 frames, 10006 rows)";
        let folded = "time        prepare about 20s, shear\n            about 51s\n\
                      disk        about 166 MB\n            \
                      run.h5 161 MB (1001 frames,\n            10006 rows)";
        assert_eq!(fold(text, 39), folded);
        assert_eq!(fold(text, 80), text);
        let text = "shear: I = 2.0000e-4, V = 1.5e-2 m/s\npack:  at rest after 347000 steps";
        let folded = "shear: I = 2.0000e-4, V =\n       1.5e-2 m/s\npack:  at rest after\n       347000 steps";
        assert_eq!(fold(text, 25), folded);
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
