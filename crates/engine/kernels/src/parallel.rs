//! Deterministic parallel loops over ranges and chunks.
//!
//! Chunk boundaries depend on the problem size alone, never on the number of threads, and every chunk owns its part of
//! the output. Results are therefore the same bits at any number of threads.
//!
//! Loops call their bodies through a pointer, once for each chunk. So the code of a division among threads exists once
//! for each type of element, not for each loop, which made up an eighth of what the compiler was given.

use rayon::prelude::*;
use std::marker::PhantomData;
use std::ops::Range;

/// Runs `body` on the ranges `[0, grain)`, `[grain, 2 grain)`, ... of `0..n`, in parallel.
///
/// The ranges are fixed; which thread runs which range is not. A `body` that writes only the data of its range gives
/// the same bits at any number of threads. Allocates nothing.
pub fn for_ranges(n: usize, grain: usize, body: impl Fn(Range<usize>) + Sync) {
    fn split(chunks: Range<usize>, run: &(dyn Fn(usize) + Sync)) {
        match chunks.len() {
            0 => {}
            1 => run(chunks.start),
            n => {
                let middle = chunks.start + n / 2;
                rayon::join(|| split(chunks.start..middle, run), || split(middle..chunks.end, run));
            }
        }
    }
    let grain = grain.max(1);
    split(0..n.div_ceil(grain), &|chunk| {
        body(chunk * grain..((chunk + 1) * grain).min(n));
    });
}

/// Splits `out` into chunks of `size` elements (the last may be shorter) and runs `body(index, chunk)` on each, in
/// parallel. Allocates nothing.
pub fn for_chunks<T: Send>(out: &mut [T], size: usize, body: impl Fn(usize, &mut [T]) + Sync) {
    fn split<T: Send>(out: &mut [T], first: usize, size: usize, body: &(dyn Fn(usize, &mut [T]) + Sync)) {
        let chunks = out.len().div_ceil(size);
        match chunks {
            0 => {}
            1 => body(first, out),
            n => {
                let (a, b) = out.split_at_mut(n / 2 * size);
                rayon::join(|| split(a, first, size, body), || split(b, first + n / 2, size, body));
            }
        }
    }
    split(out, 0, size.max(1), &body);
}

/// Copies a slice to another of the same length, in parallel if it is long.
///
/// # Panics
///
/// If the lengths differ.
pub fn copy<T: Copy + Send + Sync>(from: &[T], to: &mut [T]) {
    /// Elements of a task.
    const GRAIN: usize = 1 << 15;
    assert_eq!(from.len(), to.len(), "copy: lengths");
    for_chunks(to, GRAIN, |chunk, to| to.copy_from_slice(&from[chunk * GRAIN..][..to.len()]));
}

/// Copies `row` to every row of `to`, in parallel.
pub fn fill_rows<T: Copy + Send + Sync>(row: &[T], to: &mut [T]) {
    let len = row.len().max(1);
    for_chunks(to, (1_usize << 15).div_ceil(len) * len, |_, to| {
        to.chunks_exact_mut(len).for_each(|to| to.copy_from_slice(row));
    });
}

/// Splits `a` into chunks of `a_size` and `b` into equally many chunks of `b_size`, and runs `body(index, a_chunk,
/// b_chunk)` on each pair, in parallel.
///
/// # Panics
///
/// If the numbers of chunks differ.
pub fn for_chunks2<T: Send, U: Send>(
    a: &mut [T],
    a_size: usize,
    b: &mut [U],
    b_size: usize,
    body: impl Fn(usize, &mut [T], &mut [U]) + Sync + Send,
) {
    let (a_size, b_size) = (a_size.max(1), b_size.max(1));
    assert_eq!(a.len().div_ceil(a_size), b.len().div_ceil(b_size), "two outputs of unequal chunk counts");
    let chunks = a.par_chunks_mut(a_size).zip(b.par_chunks_mut(b_size));
    chunks.enumerate().for_each(|(i, (a, b))| body(i, a, b));
}

/// An output in which the parts of different tasks are interleaved, so that the slice cannot be split between them.
pub(crate) struct Interleaved<'a, T> {
    start: *mut T,
    len: usize,
    lent: PhantomData<&'a mut [T]>,
}

#[allow(unsafe_code)]
// SAFETY: elements are accessed only through `slice` and `pointer`, whose callers keep tasks apart.
unsafe impl<T: Send> Sync for Interleaved<'_, T> {}

impl<'a, T> Interleaved<'a, T> {
    pub(crate) fn new(data: &'a mut [T]) -> Self {
        Self { start: data.as_mut_ptr(), len: data.len(), lent: PhantomData }
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// A pointer to element `at`. Writing through it is sound only if no other task accesses the same element.
    pub(crate) fn pointer(&self, at: usize) -> *mut T {
        assert!(at <= self.len, "a part beyond the end of the output");
        self.start.wrapping_add(at)
    }

    /// The elements `at..at + len`.
    ///
    /// # Safety
    /// No other slice of these elements may be in use at the same time.
    #[allow(unsafe_code, clippy::mut_from_ref)]
    pub(crate) unsafe fn slice(&self, at: usize, len: usize) -> &mut [T] {
        assert!(at <= self.len && len <= self.len - at, "a part beyond the end of the output");
        // SAFETY: the part lies inside the borrowed slice, and the caller promises that no other task uses it.
        unsafe { std::slice::from_raw_parts_mut(self.start.add(at), len) }
    }
}
