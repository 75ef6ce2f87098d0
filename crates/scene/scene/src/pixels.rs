//! The bytes of pictures, in memory or kept elsewhere.

use std::fmt::Debug;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// Bytes that are kept outside of memory and read when they are needed, such as in a mapped file.
pub trait KeptBytes: AsRef<[u8]> + Debug + Send + Sync {
    /// Keeps other bytes in the same place; `None` where it has no room for them.
    fn beside(&self, bytes: &[u8]) -> Option<Arc<dyn KeptBytes>>;
}

/// The bytes of a picture: a slice of bytes, wherever they are.
///
/// ```
/// use weaver_scene::Pixels;
/// let pixels = Pixels::from(vec![255, 0, 0, 0, 255, 0]);
/// assert_eq!(pixels.chunks_exact(3).count(), 2);
/// assert_eq!(pixels.beside(vec![1, 2, 3]), Pixels::from(vec![1, 2, 3]));
/// ```
#[derive(Clone)]
pub enum Pixels {
    /// In memory.
    InMemory(Vec<u8>),
    /// Elsewhere; clones share them.
    Kept(Arc<dyn KeptBytes>),
}

impl Pixels {
    /// Other bytes in the place of these: a smaller version of a picture, for example. Without room there they stay in
    /// memory.
    pub fn beside(&self, bytes: Vec<u8>) -> Self {
        match self {
            Self::InMemory(_) => Self::InMemory(bytes),
            Self::Kept(kept) => kept.beside(&bytes).map_or(Self::InMemory(bytes), Self::Kept),
        }
    }

    /// The bytes in memory: copied there if they are elsewhere.
    pub fn into_vec(self) -> Vec<u8> {
        match self {
            Self::InMemory(bytes) => bytes,
            Self::Kept(kept) => (*kept).as_ref().to_vec(),
        }
    }
}

impl Deref for Pixels {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        match self {
            Self::InMemory(bytes) => bytes,
            Self::Kept(kept) => (**kept).as_ref(),
        }
    }
}

/// Bytes to change are in memory: they are copied there if they are elsewhere.
impl DerefMut for Pixels {
    fn deref_mut(&mut self) -> &mut [u8] {
        if let Self::Kept(kept) = self {
            *self = Self::InMemory((**kept).as_ref().to_vec());
        }
        match self {
            Self::InMemory(bytes) => bytes,
            Self::Kept(_) => unreachable!("they were brought to memory"),
        }
    }
}

impl<'a> IntoIterator for &'a Pixels {
    type Item = &'a u8;
    type IntoIter = std::slice::Iter<'a, u8>;
    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl From<Vec<u8>> for Pixels {
    fn from(bytes: Vec<u8>) -> Self {
        Self::InMemory(bytes)
    }
}

impl FromIterator<u8> for Pixels {
    fn from_iter<I: IntoIterator<Item = u8>>(bytes: I) -> Self {
        Self::InMemory(bytes.into_iter().collect())
    }
}

impl Default for Pixels {
    fn default() -> Self {
        Self::InMemory(Vec::new())
    }
}

impl PartialEq for Pixels {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

/// The number of bytes: nobody reads a megabyte of them.
impl Debug for Pixels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pixels({} bytes)", self.len())
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for Pixels {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (**self).serialize(serializer)
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Pixels {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Vec::deserialize(deserializer).map(Self::InMemory)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    struct Full(Vec<u8>);

    impl AsRef<[u8]> for Full {
        fn as_ref(&self) -> &[u8] {
            &self.0
        }
    }

    impl KeptBytes for Full {
        fn beside(&self, _: &[u8]) -> Option<Arc<dyn KeptBytes>> {
            None
        }
    }

    /// Changes stay with the copy; a full place does not lose bytes.
    #[test]
    fn kept_bytes_are_not_changed() {
        let kept = Pixels::Kept(Arc::new(Full(vec![1, 2, 3])));
        let mut changed = kept.clone();
        changed[1] = 7;
        assert_eq!((&kept[..], &changed[..]), (&[1, 2, 3][..], &[1, 7, 3][..]));
        assert_eq!(kept.beside(vec![4]), Pixels::from(vec![4]));
        assert_eq!(kept.into_vec(), [1, 2, 3]);
    }
}
