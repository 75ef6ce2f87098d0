//! Commands that are printed to be pasted.

use std::ffi::OsString;
use std::process::Command;
use weaver_io::ShellCommand;

/// The words that a shell makes of a command that prints its words, an end of line behind each.
fn words(shell: &str, command: &ShellCommand) -> Option<Vec<u8>> {
    let done = Command::new(shell).arg("-c").arg(command.to_string()).output().ok()?;
    assert!(done.status.success(), "{command}: {}", String::from_utf8_lossy(&done.stderr));
    Some(done.stdout)
}

/// A shell takes every word for the word that it was, on one line.
///
/// Promise (files): a printed command is read by a shell as it was meant, whatever its words hold, on one line.
#[test]
fn a_shell_reads_the_words_that_were_meant() {
    let mut all: Vec<OsString> = [
        "plain/a-b_1.ply",
        "with a blank",
        "it's",
        "",
        "$(touch x) `y` $HOME \"z\" \\",
        "a;b|c&d>e<f*g?h[i]~#!",
        "\u{e9}\u{1f600}",
        "two\nlines\n",
        "\u{1b}[31m\t\u{7f}\u{9b}1",
        "\n'\\8",
    ]
    .map(OsString::from)
    .to_vec();
    #[cfg(unix)]
    all.push(std::os::unix::ffi::OsStringExt::from_vec(b"a\xffb'\n1".to_vec()));
    for word in &all {
        let command = ShellCommand::new("printf %s.").word(word).then("last");
        let text = command.to_string();
        assert!(!text.contains(char::is_control), "{text:?}");
        let shell = if command.is_posix() { "sh" } else { "bash" };
        let Some(found) = words(shell, &command) else { continue };
        let expected = [word.as_encoded_bytes(), b".last."].concat();
        assert_eq!(found, expected, "{text}");
    }
}

/// A word that a plain `sh` may not read is recognized.
///
/// Promise of `a_shell_reads_the_words_that_were_meant`.
#[test]
fn words_with_line_breaks_are_for_some_shells_only() {
    let of = |word: &str| ShellCommand::new("ls").word(word).word("b");
    assert!(of("a b'c").is_posix() && !of("a\nb").is_posix() && !of("a\u{1b}b").is_posix());
}

/// A path that begins with a dash is no flag.
///
/// Promise of `a_shell_reads_the_words_that_were_meant`.
#[test]
fn paths_are_no_flags() {
    assert_eq!(ShellCommand::new("ls").path("-l").path("a-l").to_string(), "ls ./-l a-l");
}
