//! Text of HTML and SVG: what must be escaped, and the marks `_{…}` and `^{…}`.

use gshear_dem::failure::printable;

/// Text with its subscripts and superscripts as HTML.
pub fn marked(text: &str) -> String {
    let text = escape(text);
    let (mut out, mut rest) = (String::new(), &*text);
    while let Some((before, mark, inner, after)) = next_mark(rest) {
        let tag = if mark == '_' { "sub" } else { "sup" };
        out += &format!("{before}<{tag}>{inner}</{tag}>");
        rest = after;
    }
    out + rest
}

/// Text between tags. Own code because three replacements are not worth a crate.
pub fn escape(text: &str) -> String {
    printable(text)
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// Text before the next mark, the mark, its content, and the text after it.
pub(crate) fn next_mark(text: &str) -> Option<(&str, char, &str, &str)> {
    let at = text.find("_{").into_iter().chain(text.find("^{")).min()?;
    let end = at + text[at..].find('}')?;
    Some((
        &text[..at],
        text[at..].chars().next()?,
        &text[at + 2..end],
        &text[end + 1..],
    ))
}
