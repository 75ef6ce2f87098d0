//! Arrays of lanes, element by element.

/// `[f(0), f(1), ..]`. Unlike the standard library's ways, and like all code on lanes must be, inlined for certain:
/// use it as `each!(3, |i| ..)`.
#[inline(always)]
pub(crate) fn build<X: Copy, const N: usize>(f: impl Fn(usize) -> X) -> [X; N] {
    let mut out = [f(0); N];
    for (i, x) in out.iter_mut().enumerate().skip(1) {
        *x = f(i);
    }
    out
}

/// An array of so many elements, from a closure on the index that is always inlined.
macro_rules! each {
    ($count:expr, |$i:ident| $body:expr) => {
        $crate::each::build::<_, { $count }>(
            #[inline(always)]
            |$i: usize| $body,
        )
    };
}
pub(crate) use each;
