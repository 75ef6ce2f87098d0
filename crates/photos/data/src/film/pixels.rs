//! The pixels of a film's photos, in memory or in files.

use crate::Error;
use std::borrow::Cow;
use weaver_io::PhotoFile;

/// The pixels of a photo `[H, W, 3]`, sRGB as displayed.
#[derive(Clone, Debug)]
pub enum Pixels {
    /// In memory.
    Kept(Vec<u8>),
    /// In a file, which is read on demand.
    Stored {
        /// The file.
        file: PhotoFile,
        /// Height and width that it is shrunk to.
        size: [usize; 2],
    },
}

impl Pixels {
    /// The bytes `[H, W, 3]`.
    ///
    /// # Errors
    /// When they are in a file that cannot be read any more.
    ///
    /// ```
    /// # use weaver_data::film::Pixels;
    /// assert_eq!(Pixels::Kept(vec![255, 0, 0]).bytes()?, [255, 0, 0].as_slice());
    /// # Ok::<(), weaver_data::Error>(())
    /// ```
    pub fn bytes(&self) -> Result<Cow<'_, [u8]>, Error> {
        Ok(match self {
            Self::Kept(bytes) => Cow::Borrowed(bytes),
            Self::Stored { file, size: [height, width] } => Cow::Owned(file.resize_whole(*width, *height)?.pixels),
        })
    }
}

/// Equal if the pixels are equal, in memory or in files; unreadable pixels equal nothing.
impl PartialEq for Pixels {
    fn eq(&self, other: &Self) -> bool {
        matches!((self.bytes(), other.bytes()), (Ok(a), Ok(b)) if a == b)
    }
}
