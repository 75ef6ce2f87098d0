//! Words of a shell's command line.

/// Text as one word of a POSIX shell's command line.
///
/// ```
/// use weaver_command::quoted;
/// assert_eq!(["a/b-1.ply", "my photos", "it's"].map(quoted), ["a/b-1.ply", "'my photos'", r"'it'\''s'"]);
/// ```
pub fn quoted(text: impl AsRef<str>) -> String {
    let text = text.as_ref();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+,=:@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text.into() } else { format!("'{}'", text.replace('\'', r"'\''")) }
}
