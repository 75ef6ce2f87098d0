//! Commands for a shell, as text.

use std::borrow::Cow;
use std::ffi::{OsStr, OsString};
use std::fmt::{self, Write as _};
use std::path::Path;

/// A command that is printed for a user to paste, or for a shell to read: each word is quoted where it has to be.
///
/// Words that stand in the source are given by [`new`](Self::new) and [`then`](Self::then), which take nothing else;
/// all others by [`word`](Self::word) and [`path`](Self::path), which quote them. The text is always one line: control
/// characters, and bytes that are no text, become escapes in `$'...'`.
///
/// ```
/// use weaver_io::ShellCommand;
/// let fit = |folder: &str| ShellCommand::new("splatweaver fit --resume").path(folder).to_string();
/// assert_eq!(fit("a/b-1"), "splatweaver fit --resume a/b-1");
/// assert_eq!(fit("my fits/it's"), r"splatweaver fit --resume 'my fits/it'\''s'");
/// assert_eq!(fit("two\nlines"), r"splatweaver fit --resume $'two\012lines'");
/// assert_eq!(fit("-x"), "splatweaver fit --resume ./-x");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShellCommand {
    text: String,
    posix: bool,
}

impl ShellCommand {
    /// A command that begins with these words, which need no quotes.
    pub fn new(words: &'static str) -> Self {
        Self { text: words.into(), posix: true }
    }

    /// Adds words that need no quotes.
    pub fn then(mut self, words: &'static str) -> Self {
        self.text.push(' ');
        self.text.push_str(words);
        self
    }

    /// Adds a word.
    pub fn word(mut self, word: impl AsRef<OsStr>) -> Self {
        let bytes = bytes(word.as_ref());
        self.text.push(' ');
        match std::str::from_utf8(&bytes) {
            Ok(text) if !text.is_empty() && text.chars().all(is_plain) => self.text.push_str(text),
            Ok(text) if !text.contains(char::is_control) => {
                self.text.push('\'');
                self.text.push_str(&text.replace('\'', r"'\''"));
                self.text.push('\'');
            }
            _ => {
                self.posix = false;
                escape(&bytes, &mut self.text);
            }
        }
        self
    }

    /// Adds the path of a file or folder. One that begins with a dash is given from the working folder, so that it is
    /// no flag.
    pub fn path(self, path: impl AsRef<Path>) -> Self {
        let path = path.as_ref();
        let dashed = bytes(path.as_os_str()).first() == Some(&b'-');
        if !dashed {
            return self.word(path);
        }
        // A slash by every system: shells on Windows take a backslash for an escape.
        let mut word = OsString::from("./");
        word.push(path);
        self.word(word)
    }

    /// A path as one word, for texts that name an addition to a command.
    pub fn quoted(path: impl AsRef<Path>) -> String {
        Self::new("").path(path).text.trim_start().into()
    }

    /// False if a word needs `$'...'`, which interactive shells support and a plain `sh` may not.
    pub fn is_posix(&self) -> bool {
        self.posix
    }
}

impl fmt::Display for ShellCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

fn is_plain(c: char) -> bool {
    c.is_ascii_alphanumeric() || "/._-+,=:@%".contains(c)
}

/// Adds bytes as one word with escapes: text as it is, all else by three octal digits each.
fn escape(bytes: &[u8], to: &mut String) {
    to.push_str("$'");
    for chunk in bytes.utf8_chunks() {
        for c in chunk.valid().chars() {
            if c.is_control() {
                escape_bytes(c.encode_utf8(&mut [0; 4]).as_bytes(), to);
            } else {
                to.extend(matches!(c, '\'' | '\\').then_some('\\'));
                to.push(c);
            }
        }
        escape_bytes(chunk.invalid(), to);
    }
    to.push('\'');
}

fn escape_bytes(bytes: &[u8], to: &mut String) {
    for byte in bytes {
        // Writing to a string cannot fail.
        let _ = write!(to, "\\{byte:03o}");
    }
}

/// The bytes of a word.
#[cfg(unix)]
fn bytes(word: &OsStr) -> Cow<'_, [u8]> {
    std::os::unix::ffi::OsStrExt::as_bytes(word).into()
}

/// The bytes of a word, as text.
#[cfg(not(unix))]
fn bytes(word: &OsStr) -> Cow<'_, [u8]> {
    word.to_string_lossy().into_owned().into_bytes().into()
}
