//! Weights of learned networks, read by name and checked.

use super::FoundTensor;
use std::error::Error;
use std::fmt;

/// A tensor that is not as a network needs it.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct WeightsFault {
    /// Its name.
    pub tensor: String,
    /// The shape that the network needs.
    pub expected: Vec<usize>,
    /// Its shape, or words.
    pub found: String,
}

impl fmt::Display for WeightsFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: expected {:?}, found {}", self.tensor, self.expected, self.found)
    }
}

impl Error for WeightsFault {}

/// Tensors by name.
pub(super) struct Reader<'a> {
    pub tensor: &'a dyn Fn(&str) -> FoundTensor,
}

impl Reader<'_> {
    /// A tensor of this shape.
    pub fn get(&self, name: &str, expected: &[usize]) -> Result<Vec<f32>, WeightsFault> {
        let fault = |found: String| WeightsFault { tensor: name.into(), expected: expected.into(), found };
        let (shape, values) = (self.tensor)(name).map_err(fault)?;
        if shape != expected || values.len() != expected.iter().product::<usize>() {
            return Err(fault(format!("{shape:?}")));
        }
        if values.iter().any(|x| !x.is_finite()) {
            return Err(fault("numbers that are not finite".into()));
        }
        Ok(values)
    }
}
