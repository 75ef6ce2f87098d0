//! Cameras of other programs' projects: Metashape, RealityScan, Bundler, OpenSfM.

mod bundler;
mod lens;
mod metashape;
mod opensfm;
mod photos;
mod realityscan;

use crate::cameras::colmap::{Model, Point};
use crate::files::file::without_mark;
use crate::{Error, Result, list_files, read_part};
use photos::PhotoFinder;
use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use weaver_geometry::geodesy::{Geographic, Origin};
use weaver_geometry::glam::DVec3;
use weaver_scene::Frame;

/// Bytes at the start of a file that show what it is.
const HEAD: u64 = 4096;
/// Names of the files in a folder that may be a project.
const EXTENSIONS: [&str; 4] = ["xml", "csv", "out", "json"];
/// Distance of the cameras from the origin, over their extent, from which 32-bit numbers would round visibly.
const FAR: f64 = 100.0;
/// Distances from the Earth's center that are near its surface, meters.
const NEAR_GROUND: std::ops::Range<f64> = 6.33e6..6.42e6;

/// A program whose cameras are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProjectKind {
    /// Agisoft Metashape: File, Export, Export Cameras, Agisoft XML.
    Metashape,
    /// RealityScan and RealityCapture: Export, Registration, Internal/External camera parameters (CSV).
    RealityScan,
    /// Bundler, also as others write it: `.out` with a list of photos beside it.
    Bundler,
    /// OpenSfM and OpenDroneMap: `reconstruction.json`.
    OpenSfm,
}

impl ProjectKind {
    /// The program that a file is of, by its content; `None` for any other file.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn of(path: impl AsRef<Path>) -> Result<Option<Self>> {
        let path = path.as_ref();
        let about = std::fs::metadata(path).map_err(Error::io(path))?;
        if !about.is_file() {
            return Ok(None);
        }
        let length = about.len().min(HEAD);
        let head = read_part(path, 0..length)?;
        let text = String::from_utf8_lossy(without_mark(&head));
        let text = text.trim_start();
        // Blanks between the brackets: OpenSfM indents.
        let list: String = text.chars().filter(|c| !c.is_whitespace()).take(2).collect();
        Ok(if text.starts_with("# Bundle file") {
            Some(Self::Bundler)
        } else if text.starts_with('<') && text.contains("<document") && text.contains("<chunk") {
            Some(Self::Metashape)
        } else if realityscan::is_header(text) {
            Some(Self::RealityScan)
        } else {
            (list == "[{" && text.contains('"')).then_some(Self::OpenSfm)
        })
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Metashape => "Metashape",
            Self::RealityScan => "RealityScan",
            Self::Bundler => "Bundler",
            Self::OpenSfm => "OpenSfM",
        }
    }
}

/// The cameras of a project, and its points where the file has some.
#[derive(Clone, Debug, PartialEq)]
pub struct Project {
    /// The program.
    pub kind: ProjectKind,
    /// The photos that have a pose, in the order of the file.
    pub frames: Vec<Frame>,
    /// World positions of points.
    pub points: Vec<[f64; 3]>,
    /// Their sRGB colors.
    pub colors: Vec<[u8; 3]>,
    /// For each frame the points that it observes: pixel and index. Empty lists where the file names none.
    pub observations: Vec<Vec<([f64; 2], u32)>>,
    /// The origin of the world, where the file's own coordinates are of another frame.
    pub origin: Option<Origin>,
    /// Remarks for the user.
    pub remarks: Vec<String>,
}

impl Project {
    /// Reads a file of a [known kind](ProjectKind) and locates its photos.
    ///
    /// A photo is looked for by the path in the file; then by its name, with this or another extension, in the file's
    /// folder, in folders two levels deep there, and in `images` beside the folder. Photos without a pose are left out
    /// and named in [`remarks`](Self::remarks).
    ///
    /// Where cameras are far from the origin, as geocentric positions and those of a national grid are, the world is
    /// moved to their middle, and [`origin`](Self::origin) tells where that is. Geocentric axes become east, north
    /// and up.
    ///
    /// # Errors
    /// When the file is of another kind or malformed, a photo is missing or named twice, a lens is of a model that
    /// cannot be undone, or poses are of several worlds.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::parse(path.as_ref(), true)
    }

    /// As [`read`](Self::read), where photos may be missing if the file has their sizes.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_cameras(path: impl AsRef<Path>) -> Result<Self> {
        Self::parse(path.as_ref(), false)
    }

    /// The file of a project in a folder, if there is one.
    ///
    /// # Errors
    /// When the folder cannot be read, or has several.
    pub fn find(folder: impl AsRef<Path>) -> Result<Option<PathBuf>> {
        let folder = folder.as_ref();
        let mut found: Vec<PathBuf> = Vec::new();
        for file in list_files(folder, &EXTENSIONS)? {
            if ProjectKind::of(&file)?.is_some() {
                found.push(file);
            }
        }
        match found.len() {
            0 | 1 => Ok(found.pop()),
            _ => {
                let names = found.iter().map(|file| file.file_name().unwrap_or_default().to_string_lossy());
                let names = names.collect::<Vec<_>>().join(", ");
                Err(Error::invalid(folder, "cameras", "one file of cameras; name the one to read", names))
            }
        }
    }

    fn parse(path: &Path, with_photos: bool) -> Result<Self> {
        let Some(kind) = ProjectKind::of(path)? else {
            let expected = "cameras of Metashape (XML), RealityScan (CSV), Bundler (.out) or OpenSfM (JSON)";
            return Err(Error::invalid(path, "content", expected, "another file"));
        };
        let source = Source { path, photos: PhotoFinder::beside(path), with_photos };
        let mut project = match kind {
            ProjectKind::Metashape => metashape::read(&source)?,
            ProjectKind::RealityScan => realityscan::read(&source)?,
            ProjectKind::Bundler => bundler::read(&source)?,
            ProjectKind::OpenSfm => opensfm::read(&source)?,
        };
        if project.frames.is_empty() {
            let expected = "at least one photo with a pose: align the photos before you export";
            return Err(Error::invalid(path, "cameras", expected, "none"));
        }
        project.check_names(path)?;
        project.observations.resize(project.frames.len(), Vec::new());
        project.move_to_origin();
        Ok(project)
    }

    /// A project of frames alone.
    fn new(kind: ProjectKind, frames: Vec<Frame>) -> Self {
        let (points, colors, observations, origin, remarks) = Default::default();
        Self { kind, frames, points, colors, observations, origin, remarks }
    }

    /// Checks that no two cameras are of one photo.
    fn check_names(&self, path: &Path) -> Result<()> {
        let mut seen = BTreeMap::new();
        for (i, frame) in self.frames.iter().enumerate() {
            if let Some(before) = seen.insert(&frame.path, i) {
                let (expected, name) = ("each photo once; rename or remove one", &frame.name);
                let found = format!("{name:?} of cameras {} and {}", before + 1, i + 1);
                return Err(Error::invalid(path, "photos", expected, found));
            }
        }
        Ok(())
    }

    /// Names the photos without a pose, if there are any.
    fn remark_unposed(&mut self, path: &Path, names: &[String]) {
        const LISTED: usize = 12;
        if let Some(more) = names.len().checked_sub(1) {
            let listed = names[..names.len().min(LISTED)].join(", ");
            let more = (more + 1).saturating_sub(LISTED);
            let and = if more > 0 { format!(" and {more} more") } else { String::new() };
            self.remarks.push(format!("{}: photos without a pose are not used: {listed}{and}", path.display()));
        }
    }

    /// Moves the world to the middle of the cameras where these are far away.
    fn move_to_origin(&mut self) {
        let centers: Vec<DVec3> = self.frames.iter().map(|frame| frame.camera.pose.center()).collect();
        let middle = centers.iter().sum::<DVec3>() / centers.len() as f64;
        let extent = centers.iter().map(|center| center.distance(middle)).fold(0.0, f64::max);
        if self.origin.is_some() || middle.length() <= FAR * extent.max(1.0) {
            return;
        }
        let (origin, to_world) = if NEAR_GROUND.contains(&middle.length()) {
            let place = Geographic::from_geocentric(middle);
            (Origin::Geographic(place), place.east_north_up())
        } else {
            let offset = middle.round();
            let moved = weaver_geometry::Pose { translation: -offset, ..weaver_geometry::Pose::IDENTITY };
            (Origin::Local { offset: offset.to_array() }, moved)
        };
        let from_world = to_world.inverse();
        self.frames.iter_mut().for_each(|frame| frame.camera.pose = frame.camera.pose.compose(&from_world));
        self.points.iter_mut().for_each(|point| *point = to_world.apply(DVec3::from(*point)).to_array());
        self.origin = Some(origin);
    }

    /// The project as a model of COLMAP: photos whose lens is the same to the bit share a camera.
    pub fn to_model(&self) -> Model {
        let mut model = Model::from_frames(&self.frames);
        let points = self.points.iter().zip(&self.colors).zip(1..);
        model.points =
            points.map(|((xyz, rgb), id)| Point { id, xyz: *xyz, rgb: *rgb, error: 0.0, track: Vec::new() }).collect();
        for (image, seen) in model.images.iter_mut().zip(&self.observations) {
            for (pixel, point) in seen {
                model.points[*point as usize].track.push((image.id, image.points.len() as u32));
                image.points.push((pixel[0], pixel[1], Some(u64::from(*point) + 1)));
            }
        }
        model
    }
}

/// A file being read.
struct Source<'a> {
    path: &'a Path,
    photos: PhotoFinder,
    /// True if photos that are not there are an error.
    with_photos: bool,
}

impl Source<'_> {
    fn invalid(&self, place: impl Display, expected: impl Display, found: impl Display) -> Error {
        Error::invalid(self.path, place, expected, found)
    }

    /// The photo that the file names, as a frame whose camera is still to be set, with the size of the photo unless the
    /// file has one.
    fn photo(
        &self,
        place: &str,
        name: &str,
        size: Option<(usize, usize)>,
    ) -> Result<(String, PathBuf, (usize, usize))> {
        let found = self.photos.find(name).map_err(|several| {
            self.invalid(place, "one photo of this name", format!("several of {name:?}: {several}"))
        })?;
        match (found, size) {
            (Some(photo), size) => {
                let size = match size {
                    Some(size) => size,
                    None => crate::PhotoFile::at(&photo)?.stored_size(),
                };
                Ok((crate::relative_path(self.photos.folder(), &photo)?, photo, size))
            }
            (None, Some(size)) if !self.with_photos => {
                let name = name.replace('\\', "/");
                Ok((name.clone(), self.photos.folder().join(name), size))
            }
            (None, _) => {
                let of = if self.with_photos { "" } else { ", whose size is not in this file" };
                let folder = self.photos.folder().display();
                let expected = format!("the photo {name:?} in {folder}, in folders there, or in images beside it{of}");
                Err(self.invalid(place, expected, "no such file"))
            }
        }
    }
}
