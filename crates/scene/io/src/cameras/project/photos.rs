//! The photos that another program's file names.

use crate::{list_folders, list_photos};
use std::path::{Path, PathBuf};

/// Folders within folders that are searched.
const DEPTH: usize = 2;

/// The photos around a file of cameras.
pub(super) struct PhotoFinder {
    folder: PathBuf,
    photos: Vec<PathBuf>,
}

impl PhotoFinder {
    /// The photos in the folder of a file, in folders there, and in `images` beside it.
    pub fn beside(file: &Path) -> Self {
        let parent = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = parent.to_path_buf();
        let mut photos = Vec::new();
        collect(&folder, DEPTH, &mut photos);
        let beside = folder.join("../images");
        if beside.is_dir() {
            collect(&beside, 0, &mut photos);
        }
        Self { folder, photos }
    }

    /// The folder of the file.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The photo of a name: a path from the file's folder or from the root, else the photo that shares the most names
    /// at the end of its path, else one with another extension, or with any where the name has none.
    ///
    /// # Errors
    /// When several fit equally well: their paths.
    pub fn find(&self, name: &str) -> Result<Option<PathBuf>, String> {
        // Of the other system, too.
        let name = name.replace('\\', "/");
        let direct = self.folder.join(&name);
        if direct.is_file() {
            return Ok(Some(direct));
        }
        let wanted: Vec<&str> = name.split('/').rev().filter(|part| !part.is_empty()).collect();
        let Some((file, folders)) = wanted.split_first() else { return Ok(None) };
        let same_name = self.best(folders, |photo| photo.file_name().is_some_and(|own| own == *file))?;
        if same_name.is_some() {
            return Ok(same_name);
        }
        let stem = Path::new(file).file_stem().unwrap_or_default();
        self.best(folders, |photo| photo.file_stem().is_some_and(|own| own == stem || own == *file))
    }

    /// Of the photos that fit, the one with most folders in common.
    fn best(&self, folders: &[&str], fits: impl Fn(&Path) -> bool) -> Result<Option<PathBuf>, String> {
        let shared = |photo: &Path| {
            let own = photo.parent().into_iter().flat_map(Path::components).rev();
            own.zip(folders).take_while(|(own, wanted)| own.as_os_str() == **wanted).count()
        };
        let fitting: Vec<(usize, &PathBuf)> =
            self.photos.iter().filter(|photo| fits(photo)).map(|photo| (shared(photo), photo)).collect();
        let most = fitting.iter().map(|(shared, _)| *shared).max();
        let best: Vec<&PathBuf> =
            fitting.iter().filter(|(shared, _)| Some(*shared) == most).map(|(_, photo)| *photo).collect();
        match best[..] {
            [] => Ok(None),
            [one] => Ok(Some(one.clone())),
            _ => Err(best.iter().map(|photo| photo.display().to_string()).collect::<Vec<_>>().join(", ")),
        }
    }
}

/// Adds the photos of a folder and of those in it. Folders that cannot be read have none.
fn collect(folder: &Path, depth: usize, photos: &mut Vec<PathBuf>) {
    photos.extend(list_photos(folder).unwrap_or_default());
    if depth > 0 {
        for inner in list_folders(folder).unwrap_or_default() {
            collect(&inner, depth - 1, photos);
        }
    }
}
