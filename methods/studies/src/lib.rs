//! Studies of the published methods: the programs behind docs/results. The README lists them with their arguments.
//!
//! Beside them are parts for studies only: [`alternatives`] to the router of moving scenes, and the [`oracle`] of the
//! best blend.

pub mod alternatives;
mod arguments;
mod fragments;
mod ideal;
mod ladder;
mod motion;
pub mod oracle;
mod pictures;
mod table;

use arguments::Arguments;
use std::error::Error;

/// Result of a study.
pub type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// A study.
type Study = fn(Arguments) -> Outcome;

/// The studies by their names.
const STUDIES: [(&str, Study); 5] = [
    ("ideal", ideal::run),
    ("motion", motion::run),
    ("ladder", ladder::run),
    ("pictures", pictures::run),
    ("fragments", fragments::run),
];

/// Runs the study named by the first word, with the others as its arguments.
///
/// # Errors
/// When there is no such study, and as the study's.
pub fn run(words: impl IntoIterator<Item = String>) -> Outcome {
    let mut arguments = Arguments::new(words);
    let names = STUDIES.map(|(name, _)| name).join(", ");
    let name: String = arguments.required(&names)?;
    let (_, study) =
        STUDIES.iter().find(|(known, _)| *known == name).ok_or(format!("expected {names}; found {name}"))?;
    study(arguments)
}
