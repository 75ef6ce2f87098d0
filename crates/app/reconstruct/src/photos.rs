//! Photos to reconstruct from.

use std::path::{Path, PathBuf};
use weaver_io::{Project, ProjectKind};

/// Files and folders with cameras; a capture has one of them.
const CAMERAS: [&str; 7] =
    ["transforms.json", "transforms_train.json", "sparse", "cams", "cameras_sphere.npz", "cameras.npz", "cameras.txt"];

/// Photos to reconstruct from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Photos {
    /// Photos, folders of photos, and clips, whose cameras are estimated.
    Files(Vec<PathBuf>),
    /// A capture with cameras of its own: a folder, or a file of cameras.
    Capture(PathBuf),
    /// Photos that come with the program: bananas on a table.
    Demo,
}

impl Photos {
    /// The photos at some paths; a single path with cameras is a capture.
    ///
    /// ```
    /// use weaver_reconstruct::Photos;
    /// assert_eq!(Photos::at(["a/transforms.json"]), Photos::Files(vec!["a/transforms.json".into()]));
    /// ```
    pub fn at(paths: impl IntoIterator<Item = impl Into<PathBuf>>) -> Self {
        let paths: Vec<PathBuf> = paths.into_iter().map(Into::into).collect();
        match paths.as_slice() {
            [one] if is_capture(one) => Self::Capture(one.clone()),
            _ => Self::Files(paths),
        }
    }

    /// Files and folders that are read.
    pub fn paths(&self) -> &[PathBuf] {
        match self {
            Self::Files(paths) => paths,
            Self::Capture(path) => std::slice::from_ref(path),
            Self::Demo => &[],
        }
    }
}

/// True for a file of cameras, and for a folder with cameras.
fn is_capture(path: &Path) -> bool {
    // A path that cannot be read is named by who reads it.
    let of_project = match path.is_dir() {
        true => !matches!(Project::find(path), Ok(None) | Err(weaver_io::Error::Io { .. })),
        false => matches!(ProjectKind::of(path), Ok(Some(_))),
    };
    of_project
        || path.is_file() && path.extension().is_some_and(|e| e == "json")
        || CAMERAS.iter().any(|name| weaver_io::is_taken(path.join(name)))
}
