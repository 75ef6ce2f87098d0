//! Files of Gaussians: the formats as a table, and reading and writing by it.

mod blocks;
mod convert;
pub(crate) mod fields;
mod format;
mod gltf;
mod ksplat;
mod order;
mod placement;
pub mod ply;
mod scene_file;
pub(crate) mod sog;
mod splat;
mod spz;
mod usd;
mod wsz;

pub use blocks::{Blocks, Chained, Changed};
pub use convert::{Conversion, ConvertError, Converted, Keep, Loss, Score, ScoreOf, convert};
pub use format::{SCENE_FORMATS, SceneFormat};
pub use scene_file::{Drawing, OpenScene, SceneFile};
pub use spz::spz_step;

use crate::files::atomic::atomic_write_checked;
use crate::files::content::Content;
use crate::files::file::{file_length, read_bytes};
use crate::{Error, Result};
use fields::check_lengths;
use format::{Reader, Writer};
use std::io::Write;
use std::path::Path;
use weaver_scene::Gaussians;

/// Files that name the others of a scene, for which its folder stands.
pub(crate) const SCENE_IN_FOLDER: [&str; 2] = [sog::META, sog::LOD_META];

/// Reads a file of Gaussians in one of the [formats](SCENE_FORMATS), with its settings for drawing them; its name
/// selects the format.
///
/// # Errors
/// On any other extension; when the file cannot be read, is malformed, or holds a value that a renderer cannot use.
pub fn read_scene(path: impl AsRef<Path>) -> Result<SceneFile> {
    open_scene(path)?.all()
}

/// Opens a file of Gaussians, as [`read_scene`] reads it, a block at a time where its format allows that.
///
/// # Errors
/// On any other extension; when the file cannot be read or is malformed. Faults of single Gaussians are reported when
/// they are read.
///
/// ```
/// use weaver_io::{Blocks, open_scene, write_gaussians};
/// use weaver_scene::Gaussians;
///
/// let path = std::env::temp_dir().join(format!("weaver-io-open-{}.ply", std::process::id()));
/// let one = Gaussians {
///     means: vec![[0.0; 3]],
///     log_scales: vec![[-3.0; 3]],
///     quats: vec![[1.0, 0.0, 0.0, 0.0]],
///     opacity_logits: vec![0.0],
///     sh: vec![0.0; 3],
///     degree: 0,
/// };
/// write_gaussians(&path, &one)?;
/// let scene = open_scene(&path)?;
/// assert_eq!(*scene.gaussians.block(0..1)?, one);
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn open_scene(path: impl AsRef<Path>) -> Result<OpenScene<'static>> {
    let path = path.as_ref();
    let within = SCENE_IN_FOLDER.map(|name| path.join(name)).into_iter().find(|file| file.is_file());
    let path = within.as_deref().unwrap_or(path);
    match SceneFormat::of(path)?.read {
        Reader::Blocks(open) => open(path, Content::open(path)?),
        Reader::Whole(read) => Ok(read(path, &read_bytes(path)?)?.into()),
    }
}

/// Reads a file of Gaussians in one of the [formats](SCENE_FORMATS); its name selects it.
///
/// # Errors
/// As [`read_scene`].
pub fn read_gaussians(path: impl AsRef<Path>) -> Result<Gaussians> {
    Ok(read_scene(path)?.gaussians)
}

/// Writes Gaussians in one of the [formats](SCENE_FORMATS), atomically; the file's name selects it.
///
/// PLY keeps every bit of numbers, glTF and USD of positions and harmonics; the other formats round.
///
/// # Errors
/// On any other extension, and on one that is only read; when the fields' lengths disagree, a value is not finite where
/// the format has no place for that, or the file cannot be written.
pub fn write_gaussians(path: impl AsRef<Path>, gaussians: &Gaussians) -> Result<()> {
    write_scene(path, gaussians, Drawing::default())
}

/// Writes Gaussians as [`write_gaussians`], with how they are to be drawn where the format has a place for it.
///
/// # Errors
/// As [`write_gaussians`].
pub fn write_scene(path: impl AsRef<Path>, gaussians: &Gaussians, drawing: Drawing) -> Result<()> {
    check_lengths(path.as_ref(), gaussians)?;
    write_blocks(path, gaussians, drawing)
}

/// Writes Gaussians as [`write_scene`], a block at a time where the format allows that.
///
/// # Errors
/// As [`write_gaussians`], and when a block cannot be had.
pub fn write_blocks(path: impl AsRef<Path>, gaussians: &dyn Blocks, drawing: Drawing) -> Result<()> {
    write_blocks_checked(path, gaussians, drawing, |written| {
        let read = |rows| written.gaussians.block(rows).map(drop);
        // A lossless format keeps every bit, and its values were checked on their way.
        if written.format.is_exact() { Ok(()) } else { written.gaussians.blocks().try_for_each(read) }
    })
}

/// A scene that was written, and has not taken its name yet.
pub struct WrittenScene {
    /// Its format.
    pub format: SceneFormat,
    /// The Gaussians as they are read.
    pub gaussians: Box<dyn Blocks>,
}

impl std::fmt::Debug for WrittenScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("WrittenScene").field("format", &self.format).field("len", &self.gaussians.len()).finish()
    }
}

/// Writes Gaussians as [`write_blocks`], and reads them again: the file takes its name only if `check` accepts them.
/// Where it fails, or the file cannot be read, `path` keeps its old content.
///
/// # Errors
/// As [`write_blocks`]; and the errors of reading and of `check`.
pub fn write_blocks_checked<T>(
    path: impl AsRef<Path>,
    gaussians: &dyn Blocks,
    drawing: Drawing,
    check: impl FnOnce(WrittenScene) -> Result<T>,
) -> Result<T> {
    let path = path.as_ref();
    let format = SceneFormat::of(path)?;
    // Messages call the file by its final name.
    let again = |file: &Path| -> Result<WrittenScene> {
        let gaussians = match format.read {
            Reader::Blocks(open) => open(path, Content::open(file)?)?.gaussians,
            Reader::Whole(read) => Box::new(read(path, &read_bytes(file)?)?.gaussians),
        };
        Ok(WrittenScene { format, gaussians })
    };
    let limited = limited(gaussians, format);
    let gaussians = limited.as_ref().map_or(gaussians, |limited| limited);
    match format.write {
        Writer::Blocks(write) => {
            atomic_write_checked(path, |w| write(path, gaussians, drawing, w), |file| check(again(file)?))
        }
        Writer::Stream(write) => {
            let all = gaussians.all()?;
            atomic_write_checked(path, |w| write(path, &all, drawing, w), |file| check(again(file)?))
        }
        Writer::Files(encode) => {
            let files = encode(path, &*gaussians.all()?, drawing)?;
            let gaussians = Box::new(sog::decode_files(path, &files)?.gaussians);
            let checked = check(WrittenScene { format, gaussians })?;
            sog::write_files(path, &files)?;
            Ok(checked)
        }
        Writer::None => Err(not_written(path, format)),
    }
}

/// Bytes of a written scene: of its file, or of all files that a format of several writes beside it.
///
/// # Errors
/// When one is not there.
pub fn scene_bytes(path: impl AsRef<Path>) -> Result<u64> {
    let path = path.as_ref();
    if SceneFormat::of(path)?.writes_one_file() {
        return file_length(path);
    }
    sog::names(path)?.iter().map(|name| file_length(path.with_file_name(name))).sum::<Result<u64>>()
}

/// Reads Gaussians from the bytes of a file in this format.
///
/// # Errors
/// As [`read_gaussians`]; messages name the format in place of a file. Files that it names are not found.
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
    let path = Path::new(format.extension);
    match format.read {
        Reader::Blocks(open) => open(path, Content::Memory(bytes.into()))?.gaussians.into_all(),
        Reader::Whole(read) => Ok(read(path, bytes)?.gaussians),
    }
}

/// Writes Gaussians in this format to a stream.
///
/// # Errors
/// As [`write_gaussians`]; messages name the format in place of a file. A format of several files cannot be written to
/// a stream.
pub fn write_gaussians_to(w: &mut dyn Write, format: SceneFormat, gaussians: &Gaussians) -> Result<()> {
    let path = Path::new(format.extension);
    check_lengths(path, gaussians)?;
    let limited = limited(gaussians, format);
    let gaussians: &dyn Blocks = limited.as_ref().map_or(gaussians, |limited| limited);
    match format.write {
        Writer::Blocks(write) => write(path, gaussians, Drawing::default(), w),
        Writer::Stream(write) => write(path, &*gaussians.all()?, Drawing::default(), w),
        Writer::Files(_) => Err(Error::invalid(path, "format", "one that is a single file", format)),
        Writer::None => Err(not_written(path, format)),
    }
}

fn not_written(path: &Path, format: SceneFormat) -> Error {
    let written: Vec<&str> = SCENE_FORMATS.iter().filter(|f| f.is_written()).map(|f| f.name).collect();
    let expected = format!("one that is written: {}", written.join(", "));
    Error::invalid(path, "format", expected, format_args!("{format}, which is read only"))
}

/// Gaussians without the harmonics that the format has no place for, if there are such.
fn limited(gaussians: &dyn Blocks, format: SceneFormat) -> Option<Changed<'_>> {
    let degree = format.degree;
    let change = Box::new(move |block: &Gaussians| block.with_degree(degree));
    (gaussians.degree() > degree).then_some(Changed { from: Box::new(gaussians), degree, change })
}
