//! Deterministic parallel loops: work is cut into chunks whose borders depend on the problem alone,
//! never on the number of threads, and every chunk owns its part of the output.

use std::ops::Range;

/// Runs `body` on the ranges `[0, grain)`, `[grain, 2 grain)`, ... of `0..n`, in parallel.
///
/// Which thread runs which range is not fixed; the ranges are. A `body` that writes only what its
/// range owns therefore gives the same bits at any thread count. Allocates nothing.
pub fn for_ranges(n: usize, grain: usize, body: impl Fn(Range<usize>) + Sync) {
    fn split(chunks: Range<usize>, run: &(impl Fn(usize) + Sync)) {
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

/// Cuts `out` into chunks of `size` elements (the last may be shorter) and runs `body(index, chunk)`
/// on each, in parallel. Allocates nothing.
pub fn for_chunks<T: Send>(out: &mut [T], size: usize, body: impl Fn(usize, &mut [T]) + Sync) {
    fn split<T: Send>(out: &mut [T], first: usize, size: usize, body: &(impl Fn(usize, &mut [T]) + Sync)) {
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
