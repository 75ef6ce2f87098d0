//! The order of names with numbers.

use std::cmp::Ordering;
use std::ffi::OsStr;

/// The order of names in which runs of digits compare as numbers, and all else byte by byte: `scan9`, `scan10`,
/// `scan11`.
///
/// Where zeros in front make numbers equally long, this is the order of bytes; so it is for names that differ in such
/// zeros alone.
///
/// ```
/// use weaver_io::natural_order;
/// let mut names = ["10.bin", "2.bin", "1.bin", "02.bin"];
/// names.sort_by(|a, b| natural_order(a.as_ref(), b.as_ref()));
/// assert_eq!(names, ["1.bin", "02.bin", "2.bin", "10.bin"]);
/// ```
pub fn natural_order(a: &OsStr, b: &OsStr) -> Ordering {
    let (a, b) = (a.as_encoded_bytes(), b.as_encoded_bytes());
    parts(a).cmp(parts(b)).then_with(|| a.cmp(b))
}

/// A part of a name: its first byte, then how many digits its number has without zeros in front, and these.
type Part<'a> = (u8, usize, &'a [u8]);

fn parts(name: &[u8]) -> impl Iterator<Item = Part<'_>> {
    name.chunk_by(|a, b| a.is_ascii_digit() && b.is_ascii_digit()).map(|part| match part[0].is_ascii_digit() {
        true => {
            let number = &part[part.iter().take_while(|digit| **digit == b'0').count()..];
            // All numbers begin as one byte, so that the values decide.
            (b'0', number.len(), number)
        }
        false => (part[0], 0, &[][..]),
    })
}
