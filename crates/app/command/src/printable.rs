//! Text that is safe to print: file names may hold sequences that move the cursor of a terminal or change its colors
//! and title.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Text with control characters, other than ends of lines and tabs, as escapes `\u001b`, which also JSON reads as the
/// same characters.
///
/// ```
/// assert_eq!(weaver_command::printable("a\u{1b}[31m.ply\n"), "a\\u001b[31m.ply\n");
/// ```
pub fn printable(text: &str) -> Cow<'_, str> {
    let escaped = |c: char| c.is_control() && c != '\n' && c != '\t';
    if !text.contains(escaped) {
        return text.into();
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if escaped(c) {
            // Writing to a string cannot fail.
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        } else {
            out.push(c);
        }
    }
    out.into()
}

/// The lines of a text with letters or digits, joined to one, without decoration.
pub fn one_line(text: &str) -> String {
    let lines = text.lines().map(str::trim).filter(|line| line.chars().any(char::is_alphanumeric));
    lines.collect::<Vec<_>>().join("; ")
}
