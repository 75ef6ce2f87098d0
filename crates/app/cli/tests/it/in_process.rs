//! Runs command lines in this process.

use std::ffi::{OsStr, OsString};
use weaver_cli::{Console, Interrupt};

/// Result of a command.
#[derive(Debug)]
pub struct Outcome {
    pub code: u8,
    pub stdout: String,
    pub stderr: String,
}

/// Runs `splatweaver` with these arguments on two threads.
pub fn splatweaver(arguments: &[&dyn AsRef<OsStr>]) -> Outcome {
    let mut line: Vec<OsString> = vec!["splatweaver".into()];
    line.extend(arguments.iter().map(|a| a.as_ref().to_owned()));
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let mut console = Console::new(&mut stdout, &mut stderr, false);
    let code = weaver_cli::run(line, &mut console, &Interrupt::new());
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Outcome { code, stdout: text(stdout), stderr: text(stderr) }
}

/// Runs `splatweaver` with the words of these parts, which spaces separate.
pub fn line(parts: &[&dyn AsRef<OsStr>]) -> Outcome {
    let parts: Vec<&str> = parts.iter().map(|part| part.as_ref().to_str().unwrap()).collect();
    let words: Vec<&str> = parts.iter().flat_map(|part| part.split(' ')).collect();
    splatweaver(&words.iter().map(|word| word as &dyn AsRef<OsStr>).collect::<Vec<_>>())
}

impl Outcome {
    /// The command succeeded.
    #[track_caller]
    pub fn fine(self) -> Self {
        assert_eq!(self.code, 0, "{}", self.stderr);
        self
    }

    /// The command ended with this code and one line of error that says all of these.
    #[track_caller]
    pub fn refused(self, code: u8, parts: &[&str]) -> Self {
        assert_eq!(self.code, code, "{self:?}");
        let errors: Vec<&str> = self.stderr.lines().filter(|l| l.starts_with("error: ")).collect();
        assert_eq!(errors.len(), 1, "{}", self.stderr);
        assert!(self.stderr.trim_end().ends_with(errors[0]) || code == 2, "{}", self.stderr);
        for part in parts {
            let error = with_slashes(errors[0]);
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
        assert!(self.stdout.is_empty(), "{}", self.stdout);
        self
    }
}

/// A message with the separators of paths that tests expect, which Windows has others of.
pub fn with_slashes(message: &str) -> String {
    if cfg!(windows) { message.replace('\\', "/") } else { message.into() }
}
