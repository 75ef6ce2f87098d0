//! The formats of files of Gaussians as a table.

use super::blocks::Blocks;
use super::order::nearby;
use super::scene_file::{Drawing, OpenScene, SceneFile};
use super::sog::{self, LOD_META, META};
use super::{gltf, ksplat, ply, splat, spz, usd, wsz};
use crate::files::content::Content;
use crate::{Error, Result};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::io::Write;
use std::path::Path;
use std::str::FromStr;
use weaver_geometry::sh::MAX_DEGREE;
use weaver_scene::Gaussians;

/// A format of files of Gaussians.
#[derive(Clone, Copy)]
pub struct SceneFormat {
    /// Its name.
    pub name: &'static str,
    /// End of its files' names, after a point, or the whole name.
    pub extension: &'static str,
    /// The properties of Gaussians that it keeps.
    pub keeps: &'static str,
    /// The numbers of Gaussians in the order in which they are written, if that is another.
    pub(super) order: Option<fn(&Gaussians) -> Vec<usize>>,
    /// The largest degree of harmonics that it holds; those beyond are left out.
    pub degree: usize,
    pub(super) read: Reader,
    pub(super) write: Writer,
}

/// Decoder of a file; the path is for messages.
#[derive(Clone, Copy)]
pub(super) enum Reader {
    /// Reads parts on demand.
    Blocks(for<'a> fn(&Path, Content<'a>) -> Result<OpenScene<'a>>),
    /// Of all at once.
    Whole(fn(&Path, &[u8]) -> Result<SceneFile>),
}

/// Encoder of Gaussians; all their fields have the same length.
#[derive(Clone, Copy)]
pub(super) enum Writer {
    /// To a stream, a block at a time; the path is for messages.
    Blocks(fn(&Path, &dyn Blocks, Drawing, &mut dyn Write) -> Result<()>),
    /// To a stream.
    Stream(fn(&Path, &Gaussians, Drawing, &mut dyn Write) -> Result<()>),
    /// To this file and others beside it, which are held in memory.
    Files(fn(&Path, &Gaussians, Drawing) -> Result<Vec<sog::File>>),
    /// Not at all.
    None,
}

/// The formats that are read and written. A further one is a file beside these and a row here.
pub const SCENE_FORMATS: [SceneFormat; 14] = [
    SceneFormat {
        name: "ply",
        extension: "ply",
        keeps: "every bit",
        order: None,
        degree: MAX_DEGREE,
        read: Reader::Blocks(ply::open),
        write: Writer::Blocks(ply::encode),
    },
    SceneFormat {
        name: "compressed",
        extension: "compressed.ply",
        keeps: "11 bits of a coordinate in blocks of 256, 8 of colors; in another order",
        order: Some(by_place),
        degree: MAX_DEGREE,
        read: Reader::Blocks(ply::open),
        write: Writer::Stream(ply::encode_compressed),
    },
    SceneFormat {
        name: "splat",
        extension: "splat",
        keeps: "positions and scales, 8 bits of the rest; no harmonics",
        order: None,
        degree: 0,
        read: Reader::Blocks(splat::open),
        write: Writer::Blocks(splat::encode),
    },
    SceneFormat {
        name: "spz",
        extension: "spz",
        keeps: "24 bits of a coordinate, 8 of the rest",
        order: None,
        degree: MAX_DEGREE,
        read: Reader::Blocks(spz::open),
        write: Writer::Blocks(spz::encode),
    },
    SceneFormat {
        name: "spz4",
        extension: "v4.spz",
        keeps: "as spz, in version 4",
        order: None,
        degree: MAX_DEGREE,
        read: Reader::Blocks(spz::open),
        write: Writer::Blocks(spz::encode_zstd),
    },
    SceneFormat {
        name: "sog",
        extension: "sog",
        keeps: "16 bits of a coordinate, 8 of the rest by tables, a palette of harmonics; in another order",
        order: Some(by_place),
        degree: 3,
        read: Reader::Whole(sog::decode),
        write: Writer::Stream(sog::encode),
    },
    SceneFormat {
        name: "sog-folder",
        extension: META,
        keeps: "as sog, a folder of pictures beside this file",
        order: Some(by_place),
        degree: 3,
        read: Reader::Whole(sog::decode_folder),
        write: Writer::Files(sog::encode_folder),
    },
    SceneFormat {
        name: "sog-streamed",
        extension: LOD_META,
        keeps: "as sog, in levels of detail, for viewers that load what they show; in another order",
        order: Some(sog::streamed_order),
        degree: 3,
        read: Reader::Whole(sog::decode_streamed),
        write: Writer::Files(sog::encode_streamed),
    },
    SceneFormat {
        name: "glb",
        extension: "glb",
        keeps: "32-bit floats of everything; up is +y",
        order: None,
        degree: 3,
        read: Reader::Blocks(gltf::open),
        write: Writer::Blocks(gltf::encode_glb),
    },
    SceneFormat {
        name: "gltf",
        extension: "gltf",
        keeps: "as glb, in one text file a third larger",
        order: None,
        degree: 3,
        read: Reader::Blocks(gltf::open),
        write: Writer::Blocks(gltf::encode_gltf),
    },
    SceneFormat {
        name: "usda",
        extension: "usda",
        keeps: "as glb, in text of three times the size",
        order: None,
        degree: MAX_DEGREE,
        read: Reader::Blocks(usd::open_usda),
        write: Writer::Blocks(usd::encode_usda),
    },
    SceneFormat {
        name: "usdz",
        extension: "usdz",
        keeps: "as usda, in a package",
        order: None,
        degree: MAX_DEGREE,
        read: Reader::Blocks(usd::open_usdz),
        write: Writer::Blocks(usd::encode_usdz),
    },
    SceneFormat {
        name: "ksplat",
        extension: "ksplat",
        keeps: "read only",
        order: None,
        degree: 2,
        read: Reader::Whole(ksplat::decode),
        write: Writer::None,
    },
    SceneFormat {
        name: "wsz",
        extension: "wsz",
        keeps: "more of what shows more, in a tenth of the bits of ply with harmonics; in another order",
        order: Some(wsz::order),
        degree: MAX_DEGREE,
        read: Reader::Whole(wsz::decode),
        write: Writer::Stream(wsz::encode),
    },
];

/// Gaussians along a curve through space.
fn by_place(gaussians: &Gaussians) -> Vec<usize> {
    nearby(&gaussians.means)
}

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
        let ends = |format: &&Self| match format.extension {
            META | LOD_META => name == format.extension,
            extension => name.strip_suffix(extension).is_some_and(|stem| stem.ends_with('.')),
        };
        let found = SCENE_FORMATS.iter().filter(ends).max_by_key(|format| format.extension.len());
        found.copied().ok_or_else(|| {
            let found =
                path.extension().map_or("no extension".into(), |e| format!(".{}", e.to_string_lossy().to_lowercase()));
            Error::invalid(path, "file name", Self::extensions(), found)
        })
    }

    /// The numbers of Gaussians in the order in which they are written.
    pub fn order(&self, gaussians: &Gaussians) -> Vec<usize> {
        self.order.map_or_else(|| (0..gaussians.len()).collect(), |order| order(gaussians))
    }

    /// True if a scene is written to one file, and so to a stream.
    pub fn writes_one_file(&self) -> bool {
        matches!(self.write, Writer::Blocks(_) | Writer::Stream(_))
    }

    /// True if a scene is written a block at a time, so that it need not fit into memory.
    pub fn writes_blocks(&self) -> bool {
        matches!(self.write, Writer::Blocks(_))
    }

    /// True if reading gives the very numbers that were written.
    pub fn is_exact(&self) -> bool {
        self.name == "ply"
    }

    /// True if the format is written at all.
    pub fn is_written(&self) -> bool {
        !matches!(self.write, Writer::None)
    }

    /// End of its files' names: `.ply`, or a whole name such as `meta.json`.
    pub fn file_name_end(&self) -> String {
        if [META, LOD_META].contains(&self.extension) { self.extension.into() } else { format!(".{}", self.extension) }
    }

    /// The extensions, for messages and help: `.ply, .splat or .spz`.
    pub fn extensions() -> String {
        let all: Vec<String> = SCENE_FORMATS.iter().map(Self::file_name_end).collect();
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
