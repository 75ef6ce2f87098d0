//! Failures of a command: a one-line message and an exit code.

use std::error::Error;
use std::io;

/// Why a command stopped.
#[derive(Debug)]
pub enum Failure {
    /// Wrong usage: exit code 2.
    Usage(String),
    /// Something went wrong: exit code 1, or 2 where the arguments turn out not to fit together.
    Error(Box<dyn Error + Send + Sync>),
    /// Standard output was closed, as by `head`: exit code 0.
    OutputClosed,
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
        Self::Error(format!("standard output: {error}").into())
    }

    /// A failure with this message and exit code 1.
    pub fn message(text: impl Into<String>) -> Self {
        Self::Error(text.into().into())
    }

    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::OutputClosed => 0,
            Self::Error(error) => explained(error.as_ref()).map_or(1, |(code, _)| code),
            Self::Usage(_) => 2,
        }
    }

    /// The message, in one line, causes included.
    pub fn line(&self) -> Option<String> {
        match self {
            Self::OutputClosed => None,
            Self::Usage(message) => Some(message.clone()),
            Self::Error(error) => {
                Some(explained(error.as_ref()).map_or_else(|| joined(error.as_ref()), |(_, line)| line))
            }
        }
    }
}

/// The exit code and the message of library errors that are best explained in terms of flags.
fn explained(error: &(dyn Error + 'static)) -> Option<(u8, String)> {
    use weaver_inference::Error as Inference;
    use weaver_trainer::Error as Training;
    let training = error.downcast_ref::<Training>();
    if let Some(Training::RunExists { .. }) = training {
        return Some((2, format!("{error}; give another --out, or continue it with --resume")));
    }
    if let Some(weaver_fit_run::RunError::RunExists { .. }) = error.downcast_ref() {
        return Some((2, format!("{error}; give another --out, or continue it with --resume")));
    }
    if let Some(weaver_dynamic_run::RunError::RunExists { .. }) = error.downcast_ref() {
        return Some((2, format!("{error}; give another --out, or continue it with --resume")));
    }
    if let Some(output) = refused_output(error) {
        return Some((2, format!("{output}; give another --out")));
    }
    if let Some(weaver_dynamic_run::RunError::Setting { .. }) = error.downcast_ref() {
        return Some((2, format!("--{error}")));
    }
    let inference = match training {
        Some(Training::Inference(error)) => Some(error),
        _ => error.downcast_ref::<Inference>(),
    };
    match inference? {
        Inference::NoBudget { .. } => Some((2, format!("--{error}"))),
        Inference::ImageSize { patch, side } => {
            Some((2, format!("--size: expected multiples of {patch}, found {side}")))
        }
        Inference::Memory { gaussians, .. } => {
            let third =
                if *gaussians { "--geometry (cameras, depth and points only)" } else { "closing other programs" };
            Some((1, format!("{error}; fewer photos, a smaller --size or {third} reduces it")))
        }
        _ => None,
    }
}

/// The refusal to write where something would be lost, if an error is one.
fn refused_output<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a weaver_io::Error> {
    use weaver_data::Error as Data;
    use weaver_dynamic_run::RunError as Dynamic;
    use weaver_fit_run::RunError as Fit;
    use weaver_inference::Error as Inference;
    use weaver_trainer::Error as Training;
    let file = if let Some(error) = error.downcast_ref() {
        error
    } else if let Some(Fit::File(error)) = error.downcast_ref() {
        error
    } else if let Some(Dynamic::File(error)) = error.downcast_ref() {
        error
    } else if let Some(Training::Io(error) | Training::Inference(Inference::Io(error))) = error.downcast_ref() {
        error
    } else if let Some(Inference::Io(error)) = error.downcast_ref() {
        error
    } else if let Some(Data::Format(error)) = error.downcast_ref() {
        error
    } else {
        return None;
    };
    matches!(file, weaver_io::Error::Output { .. }).then_some(file)
}

/// The error and its causes in one line, without causes that its text already contains and without decoration.
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
    let lines = text.lines().map(str::trim).filter(|line| line.chars().any(char::is_alphanumeric));
    lines.collect::<Vec<_>>().join("; ")
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

    #[test]
    fn a_closed_pipe_is_no_error() {
        let failure = Failure::output(io::ErrorKind::BrokenPipe.into());
        assert_eq!((failure.exit_code(), failure.line()), (0, None));
        let failure = Failure::output(io::ErrorKind::StorageFull.into());
        assert_eq!(failure.exit_code(), 1);
    }
}
