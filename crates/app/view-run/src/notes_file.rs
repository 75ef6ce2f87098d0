//! Notes in a file beside their scene.

use crate::Error;
use std::path::{Path, PathBuf};
use weaver_io::write_text;
use weaver_view::Notes;

/// The file for the notes on a scene in this file: `NAME.view.json` for `NAME.ply`, `NAME.compressed.ply` and the like.
///
/// ```
/// use std::path::Path;
/// let file = weaver_view_run::notes_file(Path::new("run/scene.compressed.ply"));
/// assert_eq!(file, Path::new("run/scene.view.json"));
/// ```
pub fn notes_file(scene: &Path) -> PathBuf {
    scene.with_file_name(format!("{}.view.json", stem(scene)))
}

/// The name of a scene's file up to its first dot.
pub(crate) fn stem(scene: &Path) -> String {
    let name = scene.file_name().map_or("scene".into(), |name| name.to_string_lossy());
    name.split('.').next().filter(|stem| !stem.is_empty()).unwrap_or("scene").to_string()
}

/// Reads the notes beside a scene; none where there is no file.
#[cfg(feature = "command")]
pub(crate) fn read(scene: &Path) -> Result<Notes, Error> {
    let path = notes_file(scene);
    if !path.is_file() {
        return Ok(Notes::default());
    }
    Notes::parse(&weaver_io::read_text(&path)?).map_err(|error| {
        let weaver_view::InvalidNotes { place, expected, found } = error;
        Error::Io(weaver_io::Error::Invalid { path, place, expected: expected.into(), found })
    })
}

/// Writes notes beside a scene and returns their file.
pub(crate) fn write(scene: &Path, notes: &Notes) -> Result<PathBuf, Error> {
    let path = notes_file(scene);
    write_text(&path, &notes.to_text())?;
    Ok(path)
}
