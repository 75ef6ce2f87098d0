//! Errors of photos, clips and videos.

use weaver_io::Advice;

/// Names in a line, at most.
const NAMED: usize = 8;

/// Why photos or a clip cannot be read, or a file of moving pictures cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// A path leads nowhere.
    #[error("{0}: no such file or folder")]
    Missing(String),
    /// A folder has no photos, a clip no frames to take, or ffmpeg refuses; the message names the file.
    #[error("{0}")]
    Input(String),
    /// A setting does not fit.
    #[error("{setting}: {message}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// Expected and found value.
        message: String,
        /// The remedy: another value.
        source: Advice,
    },
}

impl Error {
    pub(crate) fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    pub(crate) fn setting(setting: &'static str, message: impl Into<String>) -> Self {
        Self::Setting { setting, message: message.into(), source: Advice::Setting(setting) }
    }
}

/// The first of some names, and how many more there are.
pub(crate) fn some_of(names: impl ExactSizeIterator<Item = String>, between: &str) -> String {
    let more = names.len().saturating_sub(NAMED);
    let named = names.take(NAMED).collect::<Vec<_>>().join(between);
    if more > 0 { format!("{named} and {more} more") } else { named }
}
