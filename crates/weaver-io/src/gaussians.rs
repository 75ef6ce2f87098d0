//! Files of Gaussians: the formats as a table, and reading and writing by it.

pub(crate) mod fields;
pub mod ply;
mod splat;
mod spz;
mod wsz;

use crate::files::atomic::atomic_write_checked;
use crate::files::file::read_bytes;
use crate::{Error, Result};
use fields::check_lengths;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::io::Write;
use std::path::Path;
use std::str::FromStr;
use weaver_scene::Gaussians;

/// A format of files of Gaussians.
#[derive(Clone, Copy)]
pub struct SceneFormat {
    /// What it is called.
    pub name: &'static str,
    /// How the names of its files end, after a point.
    pub extension: &'static str,
    /// What it keeps of Gaussians.
    pub keeps: &'static str,
    /// Decodes a file, whose path is for messages.
    read: fn(&Path, &[u8]) -> Result<Gaussians>,
    /// Encodes Gaussians of which all fields have the same length.
    write: fn(&Path, &Gaussians, &mut dyn Write) -> Result<()>,
}

/// The formats that are read and written. A further one is a file beside these and a row here.
pub const SCENE_FORMATS: [SceneFormat; 5] = [
    SceneFormat { name: "ply", extension: "ply", keeps: "every bit", read: ply::decode, write: ply::encode },
    SceneFormat {
        name: "compressed",
        extension: "compressed.ply",
        keeps: "11 bits of a coordinate in blocks of 256, 8 of colors; in another order",
        read: ply::decode,
        write: ply::encode_compressed,
    },
    SceneFormat {
        name: "splat",
        extension: "splat",
        keeps: "positions and scales, 8 bits of the rest; no harmonics",
        read: splat::decode,
        write: splat::encode,
    },
    SceneFormat {
        name: "spz",
        extension: "spz",
        keeps: "24 bits of a coordinate, 8 of the rest",
        read: spz::decode,
        write: spz::encode,
    },
    SceneFormat {
        name: "wsz",
        extension: "wsz",
        keeps: "what is seen, in a third of the bits of spz with harmonics; in another order",
        read: wsz::decode,
        write: wsz::encode,
    },
];

impl SceneFormat {
    /// The format of a file by its name: the longest extension that it ends with.
    ///
    /// # Errors
    /// On any other extension.
    ///
    /// ```
    /// use weaver_io::SceneFormat;
    ///
    /// assert_eq!(SceneFormat::of("a.ply".as_ref())?.name, "ply");
    /// assert_eq!(SceneFormat::of("A.COMPRESSED.PLY".as_ref())?.name, "compressed");
    /// # Ok::<(), weaver_io::Error>(())
    /// ```
    pub fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().to_lowercase());
        let ends = |format: &&Self| name.strip_suffix(format.extension).is_some_and(|stem| stem.ends_with('.'));
        let found = SCENE_FORMATS.iter().filter(ends).max_by_key(|format| format.extension.len());
        found.copied().ok_or_else(|| {
            let found =
                path.extension().map_or("no extension".into(), |e| format!(".{}", e.to_string_lossy().to_lowercase()));
            Error::invalid(path, "file name", Self::extensions(), found)
        })
    }

    /// The extensions, for messages and help: `.ply, .splat, .spz or .wsz`.
    pub fn extensions() -> String {
        let all: Vec<String> = SCENE_FORMATS.iter().map(|format| format!(".{}", format.extension)).collect();
        let (last, others) = all.split_last().expect("there are formats");
        format!("{} or {last}", others.join(", "))
    }
}

impl fmt::Debug for SceneFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("SceneFormat").field(&self.name).finish()
    }
}

impl fmt::Display for SceneFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for SceneFormat {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for SceneFormat {}

impl FromStr for SceneFormat {
    type Err = String;

    /// The format of this name.
    fn from_str(name: &str) -> std::result::Result<Self, String> {
        let found = SCENE_FORMATS.iter().find(|format| format.name == name).copied();
        found.ok_or_else(|| {
            let names: Vec<&str> = SCENE_FORMATS.iter().map(|format| format.name).collect();
            format!("expected one of {}, found {name:?}", names.join(", "))
        })
    }
}

impl Serialize for SceneFormat {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

impl<'de> Deserialize<'de> for SceneFormat {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// Reads a file of Gaussians in one of the [formats](SCENE_FORMATS); its name selects it.
///
/// # Errors
/// On any other extension; when the file cannot be read, is malformed, or holds a value that a renderer cannot use.
pub fn read_gaussians(path: impl AsRef<Path>) -> Result<Gaussians> {
    let path = path.as_ref();
    (SceneFormat::of(path)?.read)(path, &read_bytes(path)?)
}

/// Writes Gaussians in one of the [formats](SCENE_FORMATS), atomically; the file's name selects it.
///
/// PLY keeps every bit, the other formats round.
///
/// # Errors
/// On any other extension; when the fields' lengths disagree, a value is not finite where the format has no place for that, or the
/// file cannot be written.
pub fn write_gaussians(path: impl AsRef<Path>, gaussians: &Gaussians) -> Result<()> {
    let path = path.as_ref();
    let format = SceneFormat::of(path)?;
    check_lengths(path, gaussians)?;
    atomic_write_checked(path, |w| (format.write)(path, gaussians, w))
}

/// Reads Gaussians from the bytes of a file in this format.
///
/// # Errors
/// As [`read_gaussians`]; messages name the format in place of a file.
///
/// ```
/// use weaver_io::{SceneFormat, read_gaussians_from, write_gaussians_to};
/// use weaver_scene::Gaussians;
///
/// let spz: SceneFormat = "spz".parse()?;
/// let mut bytes = Vec::new();
/// write_gaussians_to(&mut bytes, spz, &Gaussians::default())?;
/// assert!(read_gaussians_from(&bytes, spz)?.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn read_gaussians_from(bytes: &[u8], format: SceneFormat) -> Result<Gaussians> {
    (format.read)(Path::new(format.extension), bytes)
}

/// Writes Gaussians in this format to a stream.
///
/// # Errors
/// As [`write_gaussians`]; messages name the format in place of a file.
pub fn write_gaussians_to(w: &mut dyn Write, format: SceneFormat, gaussians: &Gaussians) -> Result<()> {
    let path = Path::new(format.extension);
    check_lengths(path, gaussians)?;
    (format.write)(path, gaussians, w)
}
