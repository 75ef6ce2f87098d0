//! Rows of parameters: which ones a step updates.

use weaver_autograd::{ParamId, Params, Real, Shape, Tape};

/// Some of the rows of a parameter (the entries of its first dimension), in ascending order.
///
/// ```
/// use weaver_nn::RowSet;
/// let visible = RowSet::from_mask(&[true, false, true]);
/// assert_eq!((visible.rows(), visible.total()), (&[0, 2][..], 3));
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RowSet {
    rows: Vec<u32>,
    total: usize,
}

impl RowSet {
    /// The rows named in a list of any order, among `total`.
    ///
    /// # Errors
    /// When a row is not below `total`.
    pub fn new(total: usize, mut rows: Vec<u32>) -> Result<Self, RowError> {
        rows.sort_unstable();
        rows.dedup();
        match rows.last() {
            Some(&row) if row as usize >= total => Err(RowError::OutOfRange { row, total }),
            _ => Ok(Self { rows, total }),
        }
    }

    /// The rows whose entry in the mask is true; the mask has one for every row.
    pub fn from_mask(mask: &[bool]) -> Self {
        let rows = (0..).zip(mask).filter(|(_, chosen)| **chosen).map(|(row, _)| row).collect();
        Self { rows, total: mask.len() }
    }

    /// The rows of a parameter whose gradient on the tape is not zero throughout: none of them where no gradient
    /// reached it.
    pub fn with_gradient<T: Real>(params: &Params<T>, tape: &Tape<T>, id: ParamId) -> Self {
        let (total, width) = extent(params.get(id).shape());
        let Some(gradient) = tape.param_grad(id).filter(|_| width > 0) else { return Self { rows: Vec::new(), total } };
        let moved = |row: &[T]| row.iter().any(|g| *g != T::ZERO);
        let rows = (0..).zip(gradient.chunks_exact(width)).filter(|(_, row)| moved(row)).map(|(row, _)| row).collect();
        Self { rows, total }
    }

    /// The rows, in ascending order.
    pub fn rows(&self) -> &[u32] {
        &self.rows
    }

    /// Number of rows to choose from.
    pub fn total(&self) -> usize {
        self.total
    }
}

/// The rows of a shape, and the numbers in each; a scalar is one row of one number.
pub(crate) fn extent(shape: Shape) -> (usize, usize) {
    if shape.rank() == 0 { (1, 1) } else { (shape[0], shape.dims()[1..].iter().product()) }
}

/// Fails unless `what` has the expected number of rows.
pub(crate) fn check<T: Real>(
    params: &Params<T>,
    id: ParamId,
    what: &'static str,
    expected: usize,
    found: usize,
) -> Result<(), RowError> {
    let name = || params.get(id).name().to_string();
    if expected == found { Ok(()) } else { Err(RowError::Length { name: name(), what, expected, found }) }
}

/// Why rows do not fit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RowError {
    /// A row that does not exist is named.
    #[error("expected rows below {total}, found {row}")]
    OutOfRange {
        /// The row.
        row: u32,
        /// Number of rows.
        total: usize,
    },
    /// Something that belongs to a parameter has another number of rows.
    #[error("{what} of parameter `{name}`: expected {expected} rows, found {found}")]
    Length {
        /// The parameter's name.
        name: String,
        /// Its kind: `row set`, `moments`, `gradient`.
        what: &'static str,
        /// The rows it must have.
        expected: usize,
        /// The rows it has.
        found: usize,
    },
}
