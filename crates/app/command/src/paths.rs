//! The paths of a command line, checked together before the command begins.

use crate::{Failure, Output};
use clap::ArgMatches;
use std::path::PathBuf;

/// The paths among a command's arguments. The type of an argument marks written paths; all others are read.
#[derive(Clone, Debug, Default)]
pub struct Paths {
    /// Files and folders that are read.
    pub read: Vec<PathBuf>,
    /// Files and folders that are written.
    pub written: Vec<Output>,
}

impl Paths {
    /// The paths of a command and of its second word. `C` is a type of arguments that may name a file which is read.
    pub fn of<C: Clone + Into<Option<PathBuf>> + Send + Sync + 'static>(matches: &ArgMatches) -> Self {
        let mut paths = Self::default();
        let mut level = Some(matches);
        while let Some(matches) = level {
            for id in matches.ids() {
                paths.read.extend(values::<PathBuf>(matches, id.as_str()));
                paths.read.extend(values::<C>(matches, id.as_str()).into_iter().filter_map(Into::into));
                paths.written.extend(values::<Output>(matches, id.as_str()));
            }
            level = matches.subcommand().map(|(_, matches)| matches);
        }
        paths
    }

    /// Checks that each output can be written and replaces nothing that is read.
    ///
    /// # Errors
    /// The first output that cannot.
    pub fn check(&self) -> Result<(), Failure> {
        self.written.iter().try_for_each(|output| output.check(&self.read))
    }
}

/// The values of an argument, if it has this type.
fn values<T: Clone + Send + Sync + 'static>(matches: &ArgMatches, id: &str) -> Vec<T> {
    // An error says that it has another type, or is a group.
    matches.try_get_many(id).ok().flatten().into_iter().flatten().cloned().collect()
}
