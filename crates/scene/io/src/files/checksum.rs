//! Checksums of content.

use crate::{Error, Result};
use std::fmt;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

/// Bytes of a file that are read at once: a whole number of words.
const PART: usize = 1 << 16;

/// FNV-1a by whole words: detects content that was changed or exchanged, not content that was forged.
///
/// ```
/// use weaver_io::Checksum;
/// let of = |values: &[f32]| {
///     let mut sum = Checksum::default();
///     sum.floats(values);
///     sum.to_string()
/// };
/// assert_eq!(of(&[1.0, 2.0]), of(&[1.0, 2.0]));
/// assert_ne!(of(&[1.0, 2.0]), of(&[1.0, 2.5]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checksum(u64);

impl Default for Checksum {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Checksum {
    /// Adds a number.
    pub fn word(&mut self, word: u64) {
        // Folded, so that high bits, too, reach low ones.
        let mixed = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01b3);
        self.0 = mixed ^ (mixed >> 32);
    }

    /// Adds bytes and how many they are.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.word(bytes.len() as u64);
        self.part(bytes);
    }

    /// Adds the content of a file as [`bytes`](Self::bytes) does, a part at a time.
    ///
    /// # Errors
    /// When it cannot be read to its full length.
    pub fn file(&mut self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let mut read = || -> io::Result<()> {
            let mut file = File::open(path)?;
            let mut left = file.metadata()?.len();
            self.word(left);
            let mut buffer = vec![0; PART];
            while left > 0 {
                let part = &mut buffer[..left.min(PART as u64) as usize];
                file.read_exact(part)?;
                self.part(part);
                left -= part.len() as u64;
            }
            Ok(())
        };
        read().map_err(Error::io(path))
    }

    /// Adds bytes; others may follow only if these are whole words.
    fn part(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks();
        words.iter().for_each(|word| self.word(u64::from_le_bytes(*word)));
        rest.iter().for_each(|byte| self.word(u64::from(*byte)));
    }

    /// Adds the bits of numbers and how many they are.
    pub fn floats(&mut self, values: &[f32]) {
        self.word(values.len() as u64);
        values.iter().for_each(|x| self.word(u64::from(x.to_bits())));
    }
}

impl fmt::Display for Checksum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}
