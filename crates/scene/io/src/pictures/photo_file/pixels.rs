//! The pixels of a file, all of them or fewer.

/// What a file holds, of 8 bits.
pub(super) struct Pixels {
    /// Width and height of the file.
    pub whole: (usize, usize),
    /// How many of its pixels each way became one.
    pub shrink: usize,
    /// Width and height after that, rounded up.
    pub size: (usize, usize),
    /// `[height, width, channels]`.
    pub values: Vec<u8>,
    /// 3, or 4 with alpha.
    pub channels: usize,
}

impl Pixels {
    /// Whether a pixel is not opaque.
    pub fn is_transparent(&self) -> bool {
        self.channels == 4 && self.values.as_chunks::<4>().0.iter().any(|pixel| pixel[3] < 255)
    }
}
