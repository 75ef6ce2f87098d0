//! Rows of parameters: the rows that a step updates, and the rows of a parameter that grows or shrinks.

use weaver_autograd::{ParamId, Params, Real, ReplaceError, Shape, Tape};

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

/// Source of a row of a grown or shrunk parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowSource {
    /// An old row, with its state in the optimizer. Named by two rows, it is duplicated with its moments.
    Keep(u32),
    /// The values of an old row, with moments of zero.
    Copy(u32),
    /// Nowhere: values of zero, to be set, and moments of zero.
    New,
}

/// Mapping of the rows of a parameter that grows or shrinks: for each new row, where it comes from.
///
/// Three things change together, in this order: the parameter ([`apply`](Self::apply)), the optimizer's moments
/// ([`AdamW::remap_rows`](crate::AdamW::remap_rows)) and its average ([`Ema::remap_rows`](crate::Ema::remap_rows)). The
/// values of new rows are set after the first.
///
/// ```
/// use weaver_autograd::Params;
/// use weaver_nn::{RowMap, RowSource};
/// let mut params = Params::<f32>::new();
/// let w = params.add("w", [3, 2], vec![0.0, 0.1, 1.0, 1.1, 2.0, 2.1]);
/// params.set_rows_vary(w);
/// let map = RowMap::new(3, vec![RowSource::Keep(2), RowSource::Copy(2), RowSource::New, RowSource::Keep(0)])?;
/// map.apply(&mut params, w)?;
/// assert_eq!(params.get(w).value(), [2.0, 2.1, 2.0, 2.1, 0.0, 0.0, 0.0, 0.1]);
/// # Ok::<(), weaver_nn::RowError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RowMap {
    sources: Vec<RowSource>,
    old_rows: usize,
}

impl RowMap {
    /// A map from a parameter of `old_rows` rows, given the source of every new row.
    ///
    /// # Errors
    /// When a source is not below `old_rows`.
    pub fn new(old_rows: usize, sources: Vec<RowSource>) -> Result<Self, RowError> {
        let out_of_range = sources.iter().find_map(|source| match *source {
            RowSource::Keep(row) | RowSource::Copy(row) if row as usize >= old_rows => Some(row),
            _ => None,
        });
        match out_of_range {
            Some(row) => Err(RowError::OutOfRange { row, total: old_rows }),
            None => Ok(Self { sources, old_rows }),
        }
    }

    /// A map that keeps the rows of a set, in their order, and drops the others.
    pub fn keeping(rows: &RowSet) -> Self {
        Self { sources: rows.rows.iter().copied().map(RowSource::Keep).collect(), old_rows: rows.total }
    }

    /// The source of every new row.
    pub fn sources(&self) -> &[RowSource] {
        &self.sources
    }

    /// Number of rows that the parameter had.
    pub fn old_rows(&self) -> usize {
        self.old_rows
    }

    /// Gives a parameter its new rows. Panics unless its rows [vary](Params::set_rows_vary), or if it has no values or
    /// has them in half precision.
    ///
    /// # Errors
    /// When the parameter does not have the rows that the map begins with.
    pub fn apply<T: Real>(&self, params: &mut Params<T>, id: ParamId) -> Result<(), RowError> {
        let (rows, width) = extent(params.get(id).shape());
        check(params, id, "row map", rows, self.old_rows)?;
        let values = self.rearranged(width, params.get(id).value(), true);
        Ok(params.replace(id, self.sources.len(), values)?)
    }

    /// Old rows of `width` numbers where they belong now, and zeros elsewhere.
    pub(crate) fn rearranged<T: Copy + Default>(&self, width: usize, old: &[T], with_copies: bool) -> Vec<T> {
        let mut new = vec![T::default(); self.sources.len() * width];
        for (new, source) in new.chunks_exact_mut(width.max(1)).zip(&self.sources) {
            match *source {
                RowSource::Keep(row) => new.copy_from_slice(&old[row as usize * width..][..width]),
                RowSource::Copy(row) if with_copies => new.copy_from_slice(&old[row as usize * width..][..width]),
                RowSource::Copy(_) | RowSource::New => {}
            }
        }
        new
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
        /// Its kind: `row map`, `row set`, `moments`, `gradient`, `average`.
        what: &'static str,
        /// The rows it must have.
        expected: usize,
        /// The rows it has.
        found: usize,
    },
    /// The numbers do not make up the rows.
    #[error(transparent)]
    Replace(#[from] ReplaceError),
}
