//! Paths that a command writes.

use crate::Failure;
use clap::builder::{PathBufValueParser, TypedValueParser};
use std::ffi::OsStr;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use weaver_io::{check_output_file, check_output_folder};

/// Path that a command writes, as the type of its argument says; paths of every other type are read.
///
/// The command line checks all outputs beside all paths that are read before a command begins, so that no command has
/// its own check.
///
/// ```
/// use clap::Parser;
/// use weaver_command::Output;
///
/// #[derive(Parser)]
/// struct Film {
///     #[arg(long, value_parser = Output::file(&["gif"]))]
///     gif: Output,
/// }
/// assert!(Film::try_parse_from(["film", "--gif", "turn.gif"]).is_ok());
/// assert!(Film::try_parse_from(["film", "--gif", "photo.jpg"]).is_err());
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Output {
    path: PathBuf,
    kind: Kind,
}

/// Kind of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// A file whose name ends in one of these ways, or in any where none is named.
    File(&'static [&'static str]),
    /// A folder of results.
    Folder,
    /// Either, depending on the other arguments.
    Either(&'static [&'static str]),
}

impl Output {
    /// Parser of a file whose name ends with a dot and one of `endings`, in either case; with any ending where there
    /// are none.
    ///
    /// The ending keeps a mistyped name from replacing a file of another kind.
    pub fn file(endings: &'static [&'static str]) -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().try_map(move |path| match ends(&path, endings) {
            true => Ok(Self { path, kind: Kind::File(endings) }),
            false => Err(expected(endings)),
        })
    }

    /// Parser of a folder.
    pub fn folder() -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().map(|path| Self { path, kind: Kind::Folder })
    }

    /// Parser of a path to either a file, as [`file`](Self::file), or a folder.
    pub fn file_or_folder(endings: &'static [&'static str]) -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().map(move |path| Self { path, kind: Kind::Either(endings) })
    }

    /// The path, required to name a file.
    ///
    /// # Errors
    /// When its name has another ending.
    pub fn as_file(&self) -> Result<&Path, Failure> {
        match self.kind {
            Kind::Either(endings) if !ends(&self.path, endings) => {
                Err(Failure::Usage(format!("{}: {}", self.path.display(), expected(endings))))
            }
            _ => Ok(&self.path),
        }
    }

    /// Checks that it can be written by a command that reads these files and folders.
    ///
    /// # Errors
    /// As [`check_output_file`] and [`check_output_folder`].
    pub fn check(&self, read: &[PathBuf]) -> Result<(), Failure> {
        let is_file = match self.kind {
            Kind::File(_) => true,
            Kind::Folder => false,
            Kind::Either(endings) => ends(&self.path, endings) && !self.path.is_dir(),
        };
        match is_file {
            true => Ok(check_output_file(&self.path, read)?),
            false => Ok(check_output_folder(&self.path, read)?),
        }
    }
}

impl Deref for Output {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
}

impl AsRef<OsStr> for Output {
    fn as_ref(&self) -> &OsStr {
        self.path.as_os_str()
    }
}

impl AsRef<Path> for Output {
    fn as_ref(&self) -> &Path {
        &self.path
    }
}

/// True for a name with one of these endings.
fn ends(path: &Path, endings: &[&str]) -> bool {
    let found = path.extension();
    endings.is_empty() || found.is_some_and(|found| endings.iter().any(|ending| found.eq_ignore_ascii_case(ending)))
}

fn expected(endings: &[&str]) -> String {
    let endings: Vec<String> = endings.iter().map(|ending| format!(".{ending}")).collect();
    format!("expected a name that ends with {}", endings.join(" or "))
}
