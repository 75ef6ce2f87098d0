//! Vectors that are kept between calls and only grow.

use weaver_kernels::pages;

/// A vector grown to at least `len` elements, and its first `len`.
pub(crate) fn grown<U: Default>(values: &mut Vec<U>, len: usize) -> &mut [U] {
    if values.len() < len {
        values.reserve_exact(len - values.len());
        // Most of it will be read in no order.
        pages::prefer_huge(values.spare_capacity_mut());
        values.resize_with(len, U::default);
    }
    &mut values[..len]
}
