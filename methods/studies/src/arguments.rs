//! Positional arguments of a study.

use crate::Outcome;
use std::str::FromStr;

/// Arguments that are not read yet.
#[derive(Debug)]
pub struct Arguments(std::vec::IntoIter<String>);

impl Arguments {
    pub fn new(words: impl IntoIterator<Item = String>) -> Self {
        Self(words.into_iter().collect::<Vec<_>>().into_iter())
    }

    /// The next argument, if there is one.
    pub fn optional<T: FromStr>(&mut self, expected: &str) -> Outcome<Option<T>> {
        let Some(word) = self.0.next() else { return Ok(None) };
        let value = word.parse().map_err(|_| format!("expected {expected}, found {word}"))?;
        Ok(Some(value))
    }

    /// The next argument.
    pub fn required<T: FromStr>(&mut self, expected: &str) -> Outcome<T> {
        self.optional(expected)?.ok_or_else(|| format!("expected {expected}, found nothing").into())
    }

    /// All remaining arguments.
    pub fn rest<T: FromStr>(mut self, expected: &str) -> Outcome<Vec<T>> {
        std::iter::from_fn(|| self.optional(expected).transpose()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_told_by_their_places() {
        let arguments = |words: &str| Arguments::new(words.split_whitespace().map(String::from));
        let mut read = arguments("runs 0 1 2");
        assert_eq!(read.required::<String>("a folder").unwrap(), "runs");
        assert_eq!(read.rest::<u64>("seeds").unwrap(), [0, 1, 2]);
        assert_eq!(arguments("x").required::<u64>("a seed").unwrap_err().to_string(), "expected a seed, found x");
        assert_eq!(arguments("").required::<u64>("a seed").unwrap_err().to_string(), "expected a seed, found nothing");
        assert_eq!(arguments("").optional::<u64>("a seed").unwrap(), None);
    }
}
