//! Scenes in files and in folders of results, with their companions.

use crate::{Features, ScenePage, notes_file, overview};
use std::path::{Path, PathBuf};
use weaver_command::{DrawingOptions, Failure, LiftedFile};
use weaver_io::{SceneFile, SceneFormat, read_scene};
use weaver_view::Look;

/// Scenes in folders, the best first: of fits and networks, of lidar runs, and a scene in many files.
const RESULTS: [&str; 4] = ["scene.ply", MAP, "meta.json", "lod-meta.json"];
/// The map of a lidar run.
const MAP: &str = "map.ply";
/// Features that were lifted to the scene of a folder.
const LIFTED: &str = "lifted.safetensors";

/// A scene and its companions, as files.
#[derive(Clone, Copy, Debug)]
pub struct SceneFiles<'a> {
    /// A file of Gaussians, or the folder of a result.
    pub scene: &'a Path,
    /// Its cameras; the folder's transforms.json otherwise.
    pub cameras: Option<&'a Path>,
    /// The folder of the cameras' photos.
    pub photos: Option<&'a Path>,
    /// Rules of drawing it, in place of the summary's.
    pub drawing: DrawingOptions,
}

impl<'a> SceneFiles<'a> {
    /// A file of Gaussians or the folder of a result, as it is.
    pub fn of(scene: &'a Path) -> Self {
        Self { scene, cameras: None, photos: None, drawing: DrawingOptions::default() }
    }

    /// True for the folder of a scene that [`page`](Self::page) reads.
    pub fn has_scene(&self) -> bool {
        self.scene.join(RESULTS[0]).exists()
    }

    /// Reads the scene with its cameras and its report.
    ///
    /// # Errors
    /// When there is no scene, or a file cannot be read.
    pub fn page(&self) -> Result<ScenePage, Failure> {
        let folder = self.scene.is_dir().then_some(self.scene);
        let within = |name: &str| folder.map(|folder| folder.join(name)).filter(|path| path.exists());
        let file = match folder {
            Some(folder) => RESULTS.iter().find_map(|name| within(name)).ok_or_else(|| {
                let (folder, names) = (folder.display(), RESULTS.join(", "));
                Failure::message(format!("{folder}: expected a folder with one of {names}, found none of them"))
            })?,
            None if self.scene.exists() => self.scene.to_path_buf(),
            None => {
                let (path, formats) = (self.scene.display(), SceneFormat::extensions());
                return Err(Failure::message(format!(
                    "{path}: expected a file of Gaussians ({formats}) or the folder of a result, found neither"
                )));
            }
        };
        let SceneFile { gaussians, drawing } = read_scene(&file)?;
        let (background, settings) = self.drawing.beside(&file, drawing)?;
        let named = folder.unwrap_or(&file);
        let absolute = std::path::absolute(named).unwrap_or_else(|_| named.into());
        let title = absolute.file_name().map_or("scene".into(), |name| name.to_string_lossy().into_owned());
        let mut page = ScenePage::new(title, gaussians, Look { background, settings, ..Look::default() });
        if let Some(cameras) = self.cameras.map(PathBuf::from).or_else(|| within("transforms.json")) {
            page = page.with_cameras(&cameras, self.photos)?;
        }
        if file.ends_with(MAP) {
            page.shots.push(overview());
            page.look.meters = Some(1.0);
        }
        page.notes = notes_file::read(&file)?;
        page.look.meters = page.notes.meters().or(page.look.meters);
        page.report = within("report.html");
        page.file = Some(file);
        Ok(page)
    }

    /// The features in `file`, or those of the folder, if any were lifted to its `gaussians` Gaussians.
    ///
    /// # Errors
    /// When the file cannot be read, or has features of another number of Gaussians.
    pub fn features(&self, file: Option<&Path>, gaussians: usize) -> Result<Option<Features>, Failure> {
        let beside = || Some(self.scene.join(LIFTED)).filter(|path| path.is_file());
        let Some(path) = file.map(PathBuf::from).or_else(beside) else { return Ok(None) };
        let lifted = LiftedFile::read(&path, self.scene, gaussians)?;
        Ok(Some(Features::new(lifted.features().to_vec(), lifted.channels)))
    }
}
