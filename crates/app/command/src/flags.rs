//! Flags that several commands have.

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::ops::{Bound, RangeBounds};

/// Upper limit on threads, since each costs memory.
pub const MOST_THREADS: i64 = 1024;

/// Upper limit on seeds, which TOML must be able to hold.
pub const MOST_SEED: u64 = i64::MAX as u64;

/// Where Gaussians are drawn.
#[derive(Args, Clone, Debug, Default)]
pub struct DeviceFlag {
    /// Where Gaussians are drawn and differentiated: on the processor, on the fastest GPU, or on one that `splatweaver
    /// info
    /// --devices` lists, by its number or a part of its name [default: cpu]
    #[arg(long, value_name = "cpu|gpu|gpu:N|NAME")]
    pub device: Option<String>,
}

/// A page that follows a run.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct LiveFlag {
    /// Shows the run in the browser while it goes on, at an address that is printed
    #[arg(long)]
    pub live: bool,
    /// Port that the page is served at [default: a free one]
    #[arg(long, value_name = "N", requires = "live", value_parser = clap::value_parser!(u16).range(1..))]
    pub port: Option<u16>,
}

/// Number of threads.
#[derive(Args, Clone, Copy, Debug)]
pub struct Threads {
    /// Threads. Does not change results [default: one per core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=MOST_THREADS))]
    pub threads: Option<u16>,
}

impl Threads {
    /// The number of threads; `None`, the default, is one per core.
    pub fn count(self) -> Option<usize> {
        self.threads.map(usize::from)
    }
}

/// A parser of one of some names, each with its value and its line of help.
pub fn choice<T: Clone + Send + Sync + 'static>(
    choices: &'static [(&'static str, T, &'static str)],
) -> impl TypedValueParser<Value = T> {
    let names = choices.iter().map(|(name, _, help)| PossibleValue::new(name).help(*help));
    PossibleValuesParser::new(names).map(|given| {
        let found = choices.iter().find(|(name, ..)| *name == given);
        found.map(|(_, value, _)| value.clone()).expect("clap accepts these names alone")
    })
}

/// Rows and columns of a range image, with an x between.
///
/// # Errors
/// A sentence about other text, and about rows beyond 4 to 1024 or columns beyond 16 to 8192.
pub fn rows_and_columns(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once('x').and_then(|(h, w)| Some([h.parse().ok()?, w.parse().ok()?]));
    let within = |sides: &[usize; 2]| (4..=1024).contains(&sides[0]) && (16..=8192).contains(&sides[1]);
    sides
        .filter(within)
        .ok_or(format!("expected rows from 4 to 1024 and columns from 16 to 8192, as 64x1024; found {text}"))
}

/// A parser of numbers in a range; `expected` is the sentence about any other text.
///
/// ```
/// use clap::{Arg, Command};
/// use weaver_command::number;
/// let parser = number(0.2..=20.0, "expected a number from 0.2 to 20");
/// let command = Command::new("fit").arg(Arg::new("focal").value_parser(parser));
/// assert!(command.clone().try_get_matches_from(["fit", "0.75"]).is_ok());
/// assert!(command.try_get_matches_from(["fit", "75"]).unwrap_err().to_string().contains("from 0.2 to 20"));
/// ```
pub fn number(
    range: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
    expected: impl Into<String>,
) -> impl TypedValueParser<Value = f64> {
    let expected = expected.into();
    move |text: &str| text.parse::<f64>().ok().filter(|number| range.contains(number)).ok_or_else(|| expected.clone())
}

/// A parser of positive numbers.
pub fn positive() -> impl TypedValueParser<Value = f64> {
    number((Bound::Excluded(0.0), Bound::Included(f64::MAX)), "expected a positive number")
}

/// A parser of numbers between 0 and 1.
pub fn fraction() -> impl TypedValueParser<Value = f64> {
    number((Bound::Excluded(0.0), Bound::Excluded(1.0)), "expected a number above 0 and below 1")
}

/// A parser of pictures of a video per second: `--fps`.
pub fn rate() -> impl TypedValueParser<Value = f64> {
    number(0.1..=1000.0, "expected a number from 0.1 to 1000")
}
