//! Photos without cameras: cameras by matching, as a capture on disk.

mod context;
mod doubt;
mod fisheye;
mod focal_lengths;
mod learned_weights;
mod loading;
mod masks;
mod model;
mod order;
mod picture;
mod summary;

use crate::capture::PhotoMasks;
use crate::spheres::{Face, PhotoSet, SphereOptions};
use crate::unreadable::{Fault, Needed, without_unreadable};
use crate::{Error, Placement, remarks};
pub use context::EstimatedContext;
pub use doubt::Doubt;
pub use learned_weights::{built_in_matcher, read_matcher};
use loading::{Loaded, lenses_of, load};
use masks::PhotoMask;
use model::UPRIGHT;
use order::is_sequence;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
pub use summary::{CameraSummary, CamerasSummary};
use weaver_geometry::Distortion;
use weaver_geometry::glam::DVec2;
use weaver_io::colmap::Model;
use weaver_io::{Bitmap, OutputFolder, PhotoFile, Transforms};
use weaver_scene::Frame;
use weaver_sfm::{
    Confidence, Estimate, EstimateOptions, Find, LeftOut, Observation, PairMatcher, Photo, estimate_fisheye,
};

/// The folder of COLMAP's model.
const SPARSE: &str = "sparse/0";
/// The file that makes a folder a capture.
const TRANSFORMS: &str = "transforms.json";
/// The diagonal of the film that focal lengths are compared by, millimeters.
const FILM: f64 = 43.266_615;
/// Standard deviation of given focal lengths, as a part of them: cameras round them, and crop.
const TOLD: f64 = 0.05;

/// Options of estimating the cameras of photo files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatePhotosOptions {
    /// Photos are shrunk to this longest side for matching, pixels.
    pub long_side: usize,
    /// The focal length of all photos, in pixels of a photo whose longer side is 1; `None` takes it from the files, and
    /// estimates it if they have none.
    pub focal: Option<f64>,
    /// True if the focal length in the files is used.
    pub exif: bool,
    /// True if photos share a lens, and with it one factor on their focal lengths, if they have the same proportions,
    /// since the longer side of a crop is another one, and the same focal length in their files. Otherwise each has its
    /// own.
    pub shared: bool,
    /// The radial distortion to find.
    pub distortion: Find,
    /// True if photos are known to follow one another, as frames of a clip do; otherwise their names decide. Of many
    /// photos each is then compared with those before and behind it, too.
    pub sequence: bool,
    /// Panoramas among the photos.
    pub spheres: SphereOptions,
    /// True if the photos are of one fisheye lens, whose focal length and distortion are found.
    pub fisheye: bool,
    /// True if a learned matcher takes a second look where photos are left out or cameras are in doubt, but of a
    /// fisheye.
    pub weak_pairs: bool,
}

impl Default for EstimatePhotosOptions {
    fn default() -> Self {
        Self {
            long_side: 640,
            focal: None,
            exif: true,
            shared: true,
            distortion: Find::Told,
            sequence: false,
            spheres: SphereOptions::default(),
            fisheye: false,
            weak_pairs: false,
        }
    }
}

/// Photos with estimated cameras.
#[derive(Clone, Debug)]
pub struct EstimatedPhotos {
    /// The photos that can be read.
    pub paths: Vec<PathBuf>,
    /// Remarks for the user: the photos that cannot be read, and data of the others that were changed or ignored.
    pub remarks: Vec<String>,
    /// The photos as they were matched.
    images: Vec<Bitmap>,
    /// Width and height of the files once they are upright.
    pub(crate) sizes: Vec<(usize, usize)>,
    /// Photos whose size leaves the EXIF rotation ambiguous.
    pub(crate) ambiguous: Vec<bool>,
    /// Where they were brought.
    pub(crate) placement: Placement,
    /// The masks of photos that have one in a file.
    masks: Vec<Option<PhotoMask>>,
    /// True for photos that are only located.
    located: Vec<bool>,
    /// True if any was to be only located, also one that cannot be read.
    holds_out: bool,
    /// The lens of each: a number, without gaps, but for faces of panoramas.
    lens_of: Vec<usize>,
    /// Faces of panoramas.
    pub(crate) faces: Vec<Option<Face>>,
    /// When photos were taken, seconds, by their paths: frames of clips. None at first.
    pub times: BTreeMap<PathBuf, f64>,
    /// Cameras and points; pixels belong to the photos as they were matched.
    pub estimate: Estimate,
}

/// Estimates the cameras of photo files by matching them.
///
/// ```no_run
/// use weaver_data::{EstimatePhotosOptions, OutputFolder, estimate_photos};
///
/// let photos = ["a.jpg", "b.jpg", "c.jpg"].map(Into::into);
/// let found = estimate_photos(&photos, &[false; 3], &EstimatePhotosOptions::default())?;
/// println!("{} of 3 photos have a camera: {:?}", found.placed().len(), found.confidence());
/// found.write(&OutputFolder::claim("capture", "example", &photos)?)?;
/// # Ok::<(), weaver_data::Error>(())
/// ```
///
/// Where `located` is true, a photo finds no points: its camera is found from the others' points.
///
/// Photos that cannot be read, or whose name is not UTF-8, are left out and named in [`EstimatedPhotos::remarks`].
///
/// # Errors
/// When these are too many ([`Error::Unreadable`]), or fewer than two others are left.
///
/// # Panics
/// If `located` is not as long as `paths`.
pub fn estimate_photos(
    paths: &[PathBuf],
    located: &[bool],
    options: &EstimatePhotosOptions,
) -> Result<EstimatedPhotos, Error> {
    estimate_masked_photos(paths, located, None, options)
}

/// Estimates the cameras of photo files as [`estimate_photos`] does, from nothing that masks leave out.
///
/// # Errors
/// As [`estimate_photos`]; also when a photo has no mask, or one of another size, and when masks leave nothing of any
/// photo.
///
/// # Panics
/// If `located` or the masks are not as many as `paths`.
pub fn estimate_masked_photos(
    paths: &[PathBuf],
    located: &[bool],
    masks: Option<&PhotoMasks>,
    options: &EstimatePhotosOptions,
) -> Result<EstimatedPhotos, Error> {
    estimate_set(&PhotoSet::new(paths, located, masks.cloned()), options)
}

/// Estimates the cameras of photo files as [`estimate_masked_photos`] does, of panoramas by their faces: these stand in
/// one place, are turned by right angles, and have exact focal lengths and no distortion.
///
/// # Errors
/// As [`estimate_masked_photos`].
pub fn estimate_set(set: &PhotoSet, options: &EstimatePhotosOptions) -> Result<EstimatedPhotos, Error> {
    let PhotoSet { paths, located, faces, .. } = set;
    let masks = set.masks.as_ref();
    let holds_out = located.contains(&true);
    let load = |(i, path): (usize, &PathBuf)| load(path, masks.map(|masks| &masks.masks[i]), options);
    let loaded: Vec<Result<Loaded, Fault>> = paths.par_iter().enumerate().map(load).collect();
    let needed = Needed { least: 2, all: paths.len() };
    let (loaded, unreadable) = without_unreadable(paths.iter().map(PathBuf::as_path), loaded, needed)?;
    let of_readable = |i: usize| loaded[i].is_some();
    let located: Vec<bool> = (0..paths.len()).filter(|i| of_readable(*i)).map(|i| located[i]).collect();
    let of_mask = |i: usize| masks.and_then(|masks| PhotoMask::of(&masks.masks[i]));
    let faces: Vec<Option<Face>> = (0..paths.len()).filter(|i| of_readable(*i)).map(|i| faces[i].clone()).collect();
    let mask_files: Vec<Option<PhotoMask>> = (0..paths.len()).filter(|i| of_readable(*i)).map(of_mask).collect();
    let paths: Vec<PathBuf> = (0..paths.len()).filter(|i| of_readable(*i)).map(|i| paths[i].clone()).collect();
    let mut loaded: Vec<Loaded> = loaded.into_iter().flatten().collect();
    let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    let focals: Vec<Option<f64>> = loaded.iter().map(|loaded| loaded.exif_focal).collect();
    let (focals, outliers) = focal_lengths::without_outliers(&names, &focals);
    let transparent = loaded.iter().zip(&names).filter(|(loaded, _)| loaded.transparent);
    let transparent = remarks::transparent(&transparent.map(|(_, name)| name.clone()).collect::<Vec<_>>());
    let transparent = transparent.filter(|_| masks.is_none());
    let covered = masks::covered(&names, &loaded)?;
    if options.fisheye {
        fisheye::prepare(&paths, &faces, &mut loaded)?;
    }
    let lens_of = lenses_of(&loaded, &focals, &faces, options.shared);
    let photo = |i: usize| {
        let Loaded { image, mask, .. } = &loaded[i];
        let photo = Photo::new(&image.pixels[..], [image.height, image.width]);
        let (w, h) = (image.width as f64, image.height as f64);
        let focal = options.focal.map(|f| f * w.max(h)).or(focals[i].map(|mm| mm / FILM * w.hypot(h)));
        let focal = faces[i].as_ref().map(|face| face.focal * w).or(focal);
        let mounted = Face::mounted(&faces, i);
        Photo { focal, located: located[i], lens: lens_of[i], mask: mask.as_deref(), mounted, ..photo }
    };
    let photos: Vec<Photo<'_>> = (0..loaded.len()).map(photo).collect();
    let focal_deviation = if options.focal.is_some() { 0.0 } else { TOLD };
    let sequence = options.sequence || is_sequence(&Face::photos(&paths, &faces));
    let settings =
        EstimateOptions { focal_deviation, sequence, distortion: options.distortion, ..EstimateOptions::default() };
    let (estimate, contradicted) = match options.fisheye {
        true => (estimate_fisheye(&photos, &settings), None),
        false => {
            let matcher = options.weak_pairs.then(built_in_matcher).transpose()?;
            let matcher = matcher.as_ref().map(|matcher| matcher as &dyn PairMatcher);
            focal_lengths::estimate(&photos, &settings, matcher)
        }
    };
    let unused = masks.and_then(|masks| masks.remark.clone());
    let remarks = [unreadable, outliers, transparent, unused, covered, contradicted].into_iter().flatten().collect();
    let sizes = loaded.iter().map(|loaded| loaded.size).collect();
    let ambiguous = loaded.iter().map(|loaded| loaded.ambiguous).collect();
    let images = loaded.into_iter().map(|loaded| loaded.image).collect();
    let masks = mask_files;
    let placement = Placement::default();
    Ok(EstimatedPhotos {
        paths,
        remarks,
        images,
        sizes,
        ambiguous,
        placement,
        masks,
        located,
        holds_out,
        lens_of,
        faces,
        times: BTreeMap::new(),
        estimate,
    })
}

impl EstimatedPhotos {
    /// The photos that have a camera.
    pub fn placed(&self) -> Vec<PathBuf> {
        let placed = self.paths.iter().zip(&self.estimate.cameras).filter(|(_, camera)| camera.is_ok());
        placed.map(|(path, _)| path.clone()).collect()
    }

    /// The photos that have none, and why; a panorama is one photo here.
    pub fn left_out(&self) -> Vec<(&Path, LeftOut)> {
        let whole = (0..self.paths.len()).filter(|i| Face::mounted(&self.faces, *i).is_none_or(|m| m.on == *i));
        let path = |i: usize| self.faces[i].as_ref().map_or(self.paths[i].as_path(), |face| &face.panorama);
        whole.filter_map(|i| Some((path(i), self.estimate.cameras[i].err()?))).collect()
    }

    /// The photos that a second look placed; a panorama is one photo here.
    pub fn placed_by_second_look(&self) -> Vec<&Path> {
        let whole =
            self.estimate.second_look.iter().filter(|i| Face::mounted(&self.faces, **i).is_none_or(|m| m.on == **i));
        whole.map(|i| self.faces[*i].as_ref().map_or(self.paths[*i].as_path(), |face| &face.panorama)).collect()
    }

    /// Confidence in the cameras.
    pub fn confidence(&self) -> Confidence {
        self.estimate.confidence()
    }

    /// Number of lenses that the photos were taken to have: one if all have the same proportions and no different focal
    /// lengths, and share it. Faces of panoramas have none.
    pub fn lenses(&self) -> usize {
        let usual = self.lens_of.iter().zip(&self.faces).filter(|(_, face)| face.is_none());
        usual.map(|(lens, _)| lens + 1).max().unwrap_or(0)
    }

    /// The focal length of the first camera over the longer side of its photo; not a number without a camera.
    pub fn focal(&self) -> f64 {
        let first = self.estimate.cameras.iter().find_map(|camera| camera.ok());
        first.map_or(f64::NAN, |c| c.intrinsics.fx / c.width.max(c.height) as f64)
    }

    /// The square of the distance of a photo's corner from the axis, over the focal length, in the first photo with a
    /// camera; not a number without one.
    pub fn corner(&self) -> f64 {
        let first = self.estimate.cameras.iter().find_map(|camera| camera.ok());
        first.map_or(f64::NAN, |c| 0.25 * (c.width as f64).hypot(c.height as f64).powi(2) / c.intrinsics.fx.powi(2))
    }

    /// The field of view of a fisheye across the longer side of its photos, degrees, and its k1 to k4; `None` if none
    /// was found.
    pub fn fisheye(&self) -> Option<(f64, [f64; 4])> {
        let cameras = self.estimate.cameras.iter().zip(&self.estimate.distortion);
        cameras.filter_map(|(camera, distortion)| Some((camera.ok()?, (*distortion)?))).find_map(
            |(camera, distortion)| {
                let Distortion::Fisheye { k } = distortion else { return None };
                Some((fisheye::field_of_view(&camera, k), k))
            },
        )
    }

    /// Checks that a folder has a place for the files of [`write`](Self::write) for these photos: to be called before
    /// they are matched.
    ///
    /// # Errors
    /// Names the first file that is not to be replaced, or the first folder of photos whose path from there is not
    /// UTF-8.
    pub fn check(out: &OutputFolder, paths: &[PathBuf]) -> Result<(), Error> {
        out.check([TRANSFORMS, "points.png", CamerasSummary::NAME])?;
        out.check(Model::FILES.map(|name| format!("{SPARSE}/{name}")))?;
        out.check_folder(UPRIGHT)?;
        for folder in paths.iter().filter_map(|path| path.parent()) {
            weaver_io::relative_path(out.path(), Path::new(".").join(folder))?;
        }
        Ok(())
    }

    /// Writes a capture into a folder: transforms.json, which names the located photos as those for testing, a COLMAP
    /// model with points in sparse/0, [`picture`](Self::picture) as points.png and [`summary`](Self::summary) as
    /// cameras.json. Returns the photos that the cameras are of. The folder then holds all of these, or its old
    /// content.
    ///
    /// Photos stay where they are and are named relative to the folder, so that both can be moved together; a
    /// distortion that was found is named with their cameras, and so are masks. Photos whose size leaves the EXIF
    /// rotation ambiguous are written to upright/, and masks whose black counts to masks/, as others read them.
    ///
    /// # Errors
    /// When a file cannot be written, or is not to be replaced; when photos cannot be read again.
    pub fn write(&self, out: &OutputFolder) -> Result<Vec<PathBuf>, Error> {
        let frames = self.frames(out.path())?;
        let mut staged = out.staged()?;
        for (number, frame) in &frames {
            if self.written_to(*number).is_some() {
                PhotoFile::at(&self.paths[*number])?.read()?.write_png(staged.file(&frame.name)?)?;
            }
            if let (Some(PhotoMask { file, inverted: true }), Some(name)) = (&self.masks[*number], &frame.mask) {
                let name = name.to_string_lossy();
                PhotoFile::at(file)?.over([0.0; 3]).inverted().read()?.write_png(staged.file(name)?)?;
            }
        }
        self.model(&frames).write_binary(staged.files(SPARSE, Model::FILES)?)?;
        self.picture().write_png(staged.file("points.png")?)?;
        self.summary().write(staged.file(CamerasSummary::NAME)?)?;
        let tested = |(number, frame): &(usize, Frame)| self.located[*number].then(|| frame.name.clone());
        // Also if none of them could be placed: none of the others is to be held out in their place.
        let test_filenames = self.holds_out.then(|| frames.iter().filter_map(tested).collect());
        let frames: Vec<Frame> = frames.into_iter().map(|(_, frame)| frame).collect();
        let paths = frames.iter().map(|frame| frame.path.clone()).collect();
        let origin = self.placement.origin;
        Transforms { frames, test_filenames, origin, ..Transforms::default() }.write(staged.file(TRANSFORMS)?)?;
        // Without its images no reader takes a model for one.
        staged.commit(&[&format!("{SPARSE}/images.bin"), TRANSFORMS])?;
        Ok(paths)
    }

    /// Error of an observation, pixels; `None` in photos without a camera.
    fn off(&self, o: &Observation) -> Option<f64> {
        let camera = self.estimate.cameras[o.camera].ok()?;
        let p = camera.pose.apply(self.estimate.points[o.point]);
        if let Some(Distortion::Fisheye { k }) = self.estimate.distortion[o.camera] {
            return Some(fisheye::lens(&camera, k).project(p)?.distance(o.pixel));
        }
        let at = DVec2::new(p.x, p.y) / p.z;
        let at = self.estimate.distortion[o.camera].map_or(at, |distortion| distortion.distort(at));
        Some(camera.intrinsics.project(at.extend(1.0)).distance(o.pixel))
    }
}
