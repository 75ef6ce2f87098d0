//! Failures of a command: a one-line message and an exit code.

use crate::printable::{one_line, printable};
use std::error::Error;
use std::io;
use weaver_io::{Advice, TooLittleMemory};

/// Why a command stopped.
#[derive(Debug)]
pub enum Failure {
    /// Wrong usage: exit code 2.
    Usage(String),
    /// Something went wrong: exit code 1, or 75 where another machine, or the same one later, may do better: too little
    /// memory, a full disk, a file system that does not answer.
    Error(Box<dyn Error + Send + Sync>),
    /// Standard output was closed, as by `head`: exit code 0.
    OutputClosed,
}

/// The exit code of failures that are the machine's: `EX_TEMPFAIL` of sysexits.
const MACHINE: u8 = 75;

/// True if the machine is the cause of a failure, not the input.
fn is_of_machine(error: &(dyn Error + 'static)) -> bool {
    use io::ErrorKind as Kind;
    let kind = error.downcast_ref::<io::Error>().map(io::Error::kind);
    let passing = [
        Kind::StorageFull,
        Kind::QuotaExceeded,
        Kind::OutOfMemory,
        Kind::TimedOut,
        Kind::StaleNetworkFileHandle,
        Kind::ResourceBusy,
    ];
    kind.is_some_and(|kind| passing.contains(&kind))
        || error.is::<TooLittleMemory>()
        || error.source().is_some_and(is_of_machine)
}

impl<E: Error + Send + Sync + 'static> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Error(Box::new(error))
    }
}

impl Failure {
    /// For errors of writing to standard output.
    pub fn output(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe {
            return Self::OutputClosed;
        }
        io::Error::new(error.kind(), format!("standard output: {error}")).into()
    }

    /// A failure with this message and exit code 1.
    pub fn message(text: impl Into<String>) -> Self {
        Self::Error(text.into().into())
    }

    /// The failure as the error of a function that the caller hands over.
    pub fn into_error(self) -> Box<dyn Error + Send + Sync> {
        match self {
            Self::Error(error) => error,
            other => other.line().unwrap_or_default().into(),
        }
    }

    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::OutputClosed => 0,
            Self::Error(error) => match Advice::of(error.as_ref()) {
                Some(Advice::LessMemory { .. } | Advice::SmallerNetwork) => MACHINE,
                Some(_) => 2,
                None if is_of_machine(error.as_ref()) => MACHINE,
                None => 1,
            },
            Self::Usage(_) => 2,
        }
    }

    /// The message, in one line, causes or else the remedy included.
    pub fn line(&self) -> Option<String> {
        let text = match self {
            Self::OutputClosed => return None,
            Self::Usage(message) => message.clone(),
            Self::Error(error) => match Advice::of(error.as_ref()) {
                None => joined(error.as_ref()),
                Some(advice) => advised(&error.to_string(), advice),
            },
        };
        Some(printable(&one_line(&text)).into_owned())
    }
}

/// The message with its remedy in terms of flags.
fn advised(message: &str, advice: Advice) -> String {
    match advice {
        Advice::OtherOutput => format!("{message}; results can go elsewhere"),
        Advice::Resume => format!("{message}; give another --out, or go on with it by --resume"),
        Advice::Setting(name) => match message.strip_prefix(name) {
            Some(rest) => format!("--{}{rest}", flag(name)),
            None => message.into(),
        },
        Advice::LessMemory { gaussians } => {
            let third =
                if gaussians { "--geometry (cameras, depth and points only)" } else { "closing other programs" };
            format!("{message}; fewer photos, a smaller --size or {third} reduces it")
        }
        Advice::SmallerNetwork => format!("{message}; smaller sizes in the section `model` reduce it"),
        _ => message.into(),
    }
}

/// The flag of a setting.
fn flag(setting: &str) -> String {
    match setting {
        "image size" => "size".into(),
        name => name.replace('_', "-"),
    }
}

/// The error and its causes, without causes that its text already contains.
fn joined(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = error.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("{text}")]
    struct Layer {
        text: &'static str,
        source: Option<Box<Layer>>,
    }

    #[test]
    fn causes_follow_once_and_in_one_line() {
        let inner = Layer { text: "disk full", source: None };
        let middle = Layer { text: "a.ply: disk full", source: Some(Box::new(inner)) };
        let outer = Layer { text: "line 1\n  |\n  ^\nkey", source: Some(Box::new(middle)) };
        let failure = Failure::from(outer);
        assert_eq!(failure.line().unwrap(), "line 1; key: a.ply: disk full");
        assert_eq!(failure.exit_code(), 1);
    }

    /// Errors of every kind stay one line of plain text around a name with a line break or an escape.
    ///
    /// Promise of `names_do_not_steer_the_terminal`.
    #[test]
    fn errors_are_one_line_of_plain_text() {
        let message = "a\n\u{1b}[2Jb.ply: expected x";
        let source = io::Error::from(io::ErrorKind::NotFound);
        for failure in [
            Failure::Usage(message.into()),
            Failure::message(message),
            weaver_io::Error::Io { path: message.into(), source }.into(),
            weaver_io::OutputFolder::claim(message, "x", ["/"]).unwrap_err().into(),
        ] {
            let line = failure.line().unwrap();
            assert!(line.contains(r"a; \u001b[2Jb.ply: expected x") && !line.contains(char::is_control), "{line:?}");
        }
    }

    #[test]
    fn remedies_are_flags() {
        #[derive(Debug, thiserror::Error)]
        #[error("{text}: expected more")]
        struct Refused {
            text: &'static str,
            source: Advice,
        }
        #[derive(Debug, thiserror::Error)]
        #[error(transparent)]
        struct Wrapped(Refused);
        let says = |text, source| {
            let failure = Failure::from(Wrapped(Refused { text, source }));
            (failure.exit_code(), failure.line().unwrap())
        };
        let name = "image size";
        assert_eq!(says(name, Advice::Setting(name)), (2, "--size: expected more".into()));
        let flag = "background_weight";
        assert_eq!(says(flag, Advice::Setting(flag)), (2, "--background-weight: expected more".into()));
        assert_eq!(says("a", Advice::Complete), (2, "a: expected more".into()));
        assert_eq!(says("a", Advice::OtherOutput), (2, "a: expected more; results can go elsewhere".into()));
        let (code, line) = says("a", Advice::LessMemory { gaussians: true });
        assert!(code == 75 && line.contains("--geometry"), "{line}");
    }

    #[test]
    fn failures_of_the_machine_may_be_tried_again() {
        #[derive(Debug, thiserror::Error)]
        #[error("a.ply: {source}")]
        struct Writing {
            source: io::Error,
        }
        let code = |kind: io::ErrorKind| Failure::from(Writing { source: kind.into() }).exit_code();
        assert_eq!([io::ErrorKind::StorageFull, io::ErrorKind::NotFound].map(code), [75, 1]);
        let little = TooLittleMemory { needed: 2, available: 1, advice: String::new() };
        assert_eq!(Failure::from(little).exit_code(), 75);
    }

    #[test]
    fn a_closed_pipe_is_no_error() {
        let failure = Failure::output(io::ErrorKind::BrokenPipe.into());
        assert_eq!((failure.exit_code(), failure.line()), (0, None));
        let code = |kind: io::ErrorKind| Failure::output(kind.into()).exit_code();
        assert_eq!([io::ErrorKind::StorageFull, io::ErrorKind::PermissionDenied].map(code), [75, 1]);
    }
}
