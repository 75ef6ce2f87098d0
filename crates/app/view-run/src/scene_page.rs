//! Scenes with their cameras and photos.

use crate::notes_file::{self, notes_file};
use crate::{Error, Features};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, PosedOptions};
use weaver_geometry::glam::{DMat3, DQuat, DVec3};
use weaver_geometry::{Similarity, Undistortion};
use weaver_io::{Bitmap, Drawing, SceneFormat, Transforms, is_taken, read_cameras, write_scene};
use weaver_scene::{Frame, Gaussians};
use weaver_view::{HtmlOptions, Look, Notes, Shot, Subject, film_html, html, photo_file, pictured};

/// Quality of photos that are served as libjpeg counts it.
const QUALITY: u8 = 82;
/// Gaussians from which on a page receives the most visible ones first, and the divisor for their number, the same as
/// in `.wsz`.
const LARGE_SCENE: usize = 250_000;
const BEGINNING: usize = 12;
/// Longest side of photos that are served, pixels.
const LARGE: usize = 1600;

/// A scene to look at, with cameras, photos and a report.
#[derive(Clone, Debug)]
pub struct ScenePage {
    /// Title of the page.
    pub title: String,
    /// The scene.
    pub gaussians: Gaussians,
    /// Rules of drawing it.
    pub look: Look,
    /// Cameras, and photos in memory.
    pub shots: Vec<Shot>,
    /// Photos on disk.
    pub gallery: Option<Gallery>,
    /// Features of the Gaussians, which a page compares with the features at a point.
    pub features: Option<Features>,
    /// The scene at other times, of one that moves.
    pub moving: Option<Moving>,
    /// The report of the run that made the scene.
    pub report: Option<PathBuf>,
    /// The file of the scene; edited ones are saved beside it, and [notes](crate::notes_file).
    pub file: Option<PathBuf>,
    /// Notes on the scene.
    pub notes: Notes,
    /// A scene of this name that lies over it, right of a slider.
    pub second: Option<(String, Gaussians)>,
}

/// A scene as a function of time, 0 to 1.
#[derive(Clone)]
pub struct Moving(Arc<dyn Fn(f64) -> Gaussians + Send + Sync>);

impl Moving {
    /// A scene that is a function of time.
    pub fn new(at: impl Fn(f64) -> Gaussians + Send + Sync + 'static) -> Self {
        Self(Arc::new(at))
    }

    /// The scene at a time.
    pub fn at(&self, time: f64) -> Gaussians {
        self.0(time)
    }
}

impl fmt::Debug for Moving {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Moving").finish_non_exhaustive()
    }
}

/// Photos on disk, one for each shot, which are read on request.
#[derive(Clone, Debug)]
pub struct Gallery {
    frames: Vec<Frame>,
    file: PathBuf,
}

impl ScenePage {
    /// A scene of this title without cameras.
    pub fn new(title: impl Into<String>, gaussians: Gaussians, look: Look) -> Self {
        let (title, shots) = (title.into(), Vec::new());
        let (gallery, features, moving) = (None, None, None);
        Self {
            title,
            gaussians,
            look,
            shots,
            gallery,
            features,
            moving,
            report: None,
            file: None,
            notes: Notes::default(),
            second: None,
        }
    }

    /// Adds the cameras of a file: transforms.json, a folder with a COLMAP model, or a RealEstate10K file. Photos are
    /// the files named in it, or files in `photos`, matched by the longest existing end of their paths. Held-out ones
    /// come first.
    ///
    /// # Errors
    /// When the file cannot be read, a distortion leaves no photo, or two photos have one file in `photos`.
    pub fn with_cameras(mut self, file: &Path, photos: Option<&Path>) -> Result<Self, Error> {
        let mut frames = read_cameras(file)?;
        let held_out = held_out_names(file);
        frames.sort_by_key(|frame| !held_out.contains(&frame.name));
        if let Some(folder) = photos {
            take_from(folder, &mut frames)?;
        }
        self.shots =
            frames.iter().map(|frame| shot(frame, file, held_out.contains(&frame.name))).collect::<Result<_, _>>()?;
        self.gallery = Some(Gallery { frames, file: file.into() });
        Ok(self)
    }

    /// True for a scene so large that a page shows its [beginning](Self::beginning) first. A scene with features or
    /// motion has none, since these go by the numbers of all Gaussians.
    pub fn has_beginning(&self) -> bool {
        self.gaussians.len() >= LARGE_SCENE && self.features.is_none() && self.moving.is_none()
    }

    /// The twelfth of the Gaussians that show most, by [`Gaussians::importance`].
    pub fn beginning(&self) -> Gaussians {
        let scene = &self.gaussians;
        scene.select(&scene.largest(&scene.importance(), scene.len().div_ceil(BEGINNING)))
    }

    /// The parts that a page is made of.
    pub fn subject(&self) -> Subject<'_> {
        let second = self.second.as_ref().map(|(name, gaussians)| (name.as_str(), gaussians));
        Subject { title: &self.title, gaussians: &self.gaussians, look: self.look, notes: Some(&self.notes), second }
    }

    /// The photo of a shot as a JPEG or PNG file, if it has one that can be read.
    pub fn photo(&self, i: usize) -> Option<Vec<u8>> {
        let shot = self.shots.get(i)?;
        if shot.photo.is_some() {
            return shot.photo.clone();
        }
        self.gallery.as_ref()?.photo(i)?.to_jpeg(QUALITY).ok()
    }

    /// The photo of a shot as it is in one file.
    fn small_photo(&self, i: usize) -> Option<Vec<u8>> {
        let shot = self.shots.get(i)?;
        if shot.photo.is_some() {
            return shot.photo.clone();
        }
        photo_file(&self.gallery.as_ref()?.photo(i)?).ok()
    }

    /// True if a shot has a photo.
    pub fn has_photo(&self, i: usize) -> bool {
        let on_disk = || self.gallery.as_ref().and_then(|gallery| gallery.frame(i));
        self.shots.get(i).is_some_and(|shot| shot.photo.is_some()) || on_disk().is_some()
    }

    /// One file with the scene, all cameras, and the photos of at most 32 of them: the held-out ones, then some of all
    /// others.
    ///
    /// # Errors
    /// As [`weaver_view::html`].
    pub fn html(&self, options: HtmlOptions) -> Result<String, Error> {
        Ok(html(&self.subject(), &self.small_shots(), options)?)
    }

    /// All shots, with the photos that belong into one file.
    fn small_shots(&self) -> Vec<Shot> {
        let with_photo: Vec<usize> = (0..self.shots.len()).filter(|i| self.has_photo(*i)).collect();
        let held_out: Vec<bool> = with_photo.iter().map(|i| self.shots[*i].held_out).collect();
        let chosen: Vec<usize> = pictured(&held_out).into_iter().map(|at| with_photo[at]).collect();
        let mut shots = self.shots.clone();
        for (i, shot) in shots.iter_mut().enumerate() {
            shot.photo = if chosen.contains(&i) { self.small_photo(i) } else { None };
        }
        shots
    }

    /// One file as [`html`](Self::html), with a moving scene at `moments` moments; a still scene as it is.
    ///
    /// # Errors
    /// As [`weaver_view::film_html`].
    pub fn film_html(&self, moments: usize, options: HtmlOptions) -> Result<String, Error> {
        let last = moments.max(2) - 1;
        let at = |moving: &Moving| (0..=last).map(|i| moving.at(i as f64 / last as f64)).collect();
        let moments: Vec<Gaussians> = self.moving.as_ref().map_or_else(Vec::new, at);
        Ok(film_html(&self.subject(), &moments, &self.small_shots(), options)?)
    }

    /// Saves the Gaussians that `dropped` does not mark in this format, beside the scene's file and under a name that
    /// is free, with the notes on them. With an up axis, the scene is turned so that it becomes -y, by the smallest
    /// turn; of the notes, the meters of a unit are then kept.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(
        &self,
        dropped: &[u8],
        format: SceneFormat,
        notes: &Notes,
        up: Option<DVec3>,
    ) -> Result<PathBuf, Error> {
        let file = self.file.clone().unwrap_or_else(|| "scene.ply".into());
        let notes = if up.is_some() { notes.turned() } else { notes.clone() };
        let stem = notes_file::stem(&file);
        let numbered = |number: usize| {
            let number = if number == 1 { String::new() } else { format!("-{number}") };
            file.with_file_name(format!("{stem}-edited{number}{}", format.file_name_end()))
        };
        let is_free = |path: &PathBuf| !is_taken(path) && (notes.is_empty() || !is_taken(notes_file(path)));
        let path = (1..).map(numbered).find(is_free).expect("one of infinitely many names is free");
        let kept: Vec<usize> =
            (0..self.gaussians.len()).filter(|i| dropped.get(*i).is_none_or(|byte| *byte == 0)).collect();
        let mut scene = self.gaussians.select(&kept);
        if let Some(up) = up {
            let rotation = DMat3::from_quat(DQuat::from_rotation_arc(up.normalize_or(DVec3::NEG_Y), DVec3::NEG_Y));
            scene = scene.transformed(&Similarity { scale: 1.0, rotation, translation: DVec3::ZERO });
        }
        write_scene(&path, &scene, Drawing::antialiased(self.look.settings.antialiased))?;
        if !notes.is_empty() {
            notes_file::write(&path, &notes)?;
        }
        Ok(path)
    }
}

impl Gallery {
    /// The frame of a photo that is a regular file: the end of a pipe or of a device may never come.
    fn frame(&self, i: usize) -> Option<&Frame> {
        self.frames.get(i).filter(|frame| frame.path.is_file())
    }

    /// A photo without distortion.
    fn photo(&self, i: usize) -> Option<Bitmap> {
        let frame = self.frame(i)?.clone();
        let options = PosedOptions { long_side: Some(LARGE), hold_out: HoldOut::Nothing, ..PosedOptions::default() };
        let photo = posed::load_frames(vec![frame], &self.file, &options).ok()?.pop()?.photo;
        Some(Bitmap { width: photo.camera.width, height: photo.camera.height, pixels: photo.rgb.into_vec() })
    }
}

/// Gives frames the files of a folder, each by the longest existing end of its path.
fn take_from(folder: &Path, frames: &mut [Frame]) -> Result<(), Error> {
    let mut taken: BTreeMap<PathBuf, PathBuf> = BTreeMap::new();
    for frame in frames {
        let parts: Vec<Component> = frame.path.components().filter(|c| matches!(c, Component::Normal(_))).collect();
        let mut ends = (0..parts.len()).map(|from| folder.join(parts[from..].iter().collect::<PathBuf>()));
        let found = ends.clone().find(|file| file.is_file());
        if let Some(file) = &found
            && let Some(other) = taken.insert(file.clone(), frame.path.clone()).filter(|other| *other != frame.path)
        {
            return Err(Error::Io(weaver_io::Error::Invalid {
                path: folder.into(),
                place: format!("photos {} and {}", other.display(), frame.path.display()),
                expected: "a file for each of them".into(),
                found: format!("{} for both", file.display()),
            }));
        }
        if let Some(file) = found.or_else(|| ends.next_back()) {
            frame.path = file;
        }
    }
    Ok(())
}

/// Names of photos that a transforms.json holds out.
fn held_out_names(file: &Path) -> Vec<String> {
    let is_json = file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let read = || Transforms::read(file).ok()?.test_filenames;
    if is_json { read().unwrap_or_default() } else { Vec::new() }
}

/// A camera as its photo is without distortion.
fn shot(frame: &Frame, file: &Path, held_out: bool) -> Result<Shot, Error> {
    let camera = match frame.distortion {
        None => frame.camera,
        Some(distortion) => {
            let undone = Undistortion::new(frame.camera, distortion).ok_or_else(|| weaver_io::Error::Invalid {
                path: file.into(),
                place: frame.name.clone(),
                expected: "a lens distortion that leaves a photo without blank borders".into(),
                found: format!("{distortion:?}"),
            })?;
            undone.to
        }
    };
    Ok(Shot { held_out, ..Shot::new(frame.name.clone(), camera) })
}
