//! Photos of a film of any layout before they are read.

use super::pixels::Pixels;
use super::shots::{Film, FilmPoint, HeldOut, SAME_TIME, Shot};
use crate::Error;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use weaver_geometry::Camera;
use weaver_io::PhotoFile;

/// Largest difference of a photo's aspect from its camera's, which is of another size: the rounding of sizes to whole
/// pixels.
const SAME_ASPECT: f64 = 0.02;

/// A photo before it is read.
#[derive(Clone, Debug)]
pub(super) struct Take {
    pub photo: PathBuf,
    /// For some size of the photo.
    pub camera: Camera,
    /// When, in any unit.
    pub moment: f64,
    /// Kept from training.
    pub test: bool,
}

/// The photos of a film, not all of them at the same time nor by the same camera.
#[derive(Clone, Debug)]
pub(super) struct Roll {
    pub takes: Vec<Take>,
    pub points: Vec<FilmPoint>,
    pub background: [f32; 3],
    pub remarks: Vec<String>,
    /// The file or folder that says when photos were taken.
    pub clock: PathBuf,
    /// Divisor of moments.
    pub duration: f64,
    /// The longer side of its photos where nothing else is said.
    pub usual_size: Option<usize>,
}

/// A moment that a file gives under a key.
///
/// # Errors
/// When it is missing, negative or not finite.
pub(super) fn moment(file: &Path, key: &str, given: Option<f64>) -> Result<f64, Error> {
    let valid = given.filter(|moment| moment.is_finite() && *moment >= 0.0);
    valid.ok_or_else(|| {
        let found = given.map_or("nothing".into(), |moment| moment.to_string());
        Error::unexpected(file, key, "a finite number from 0", found)
    })
}

/// The largest moment, which becomes 1.
pub(super) fn last_moment(takes: &[Take]) -> f64 {
    takes.iter().map(|take| take.moment).fold(0.0, f64::max)
}

impl Roll {
    /// Reads the photos, shrunk to a longer side of `size` if they are larger; no more than `most` bytes of them stay
    /// in memory.
    ///
    /// # Errors
    /// When there are not two cameras and two times, nothing is trained on, or a photo is missing or not of the size of
    /// the others or the shape of its camera.
    pub fn developed(self, folder: &Path, size: Option<usize>, most: usize) -> Result<Film, Error> {
        let viewpoints = self.viewpoints();
        self.check(folder, &viewpoints)?;
        let files = self.files()?;
        let whole = files[0].size();
        let [height, width] = shrunk(whole, size.or(self.usual_size));
        let times: Vec<f64> = self.takes.iter().map(|take| take.moment / self.duration).collect();
        let kept = (most / (3 * height * width)).min(files.len());
        let mut trained: Vec<f64> = self.of_takes(false).map(|i| times[i]).collect();
        trained.sort_by(f64::total_cmp);
        let read = |i: usize| -> Result<Shot, Error> {
            let (take, time) = (&self.takes[i], times[i]);
            let file = files[i].clone().over(self.background);
            // The choice of kept photos is the same at any number of threads.
            let pixels = match i < kept {
                true => Pixels::Kept(file.resize_whole(width, height)?.pixels),
                false => Pixels::Stored { file, size: [height, width] },
            };
            let Camera { pose, intrinsics, width: w, height: h } = take.camera;
            let intrinsics = intrinsics.resized(width as f64 / w as f64, height as f64 / h as f64);
            let camera = Camera { pose, intrinsics, width, height };
            let held_out = HeldOut { camera: take.test, time: take.test && !near(&trained, time) };
            let name = take.photo.strip_prefix(folder).unwrap_or(&take.photo).display().to_string();
            let name = name.replace(std::path::MAIN_SEPARATOR, "/");
            Ok(Shot { name, camera, viewpoint: viewpoints[i], time, pixels, motion: None, held_out })
        };
        let shots: Vec<Result<Shot, Error>> = (0..files.len()).into_par_iter().map(read).collect();
        let mut shots = shots.into_iter().collect::<Result<Vec<_>, _>>()?;
        shots.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.viewpoint.cmp(&b.viewpoint)));
        let mut remarks = self.remarks;
        if whole != (width, height) {
            let (w, h) = whole;
            remarks.push(format!("{}: photos of {w}x{h} are shrunk to {width}x{height}", folder.display()));
        }
        if kept < files.len() {
            let (others, all) = (files.len() - kept, files.len());
            remarks.push(format!("{}: {others} of {all} photos are read whenever they are needed", folder.display()));
        }
        let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned();
        let Self { points, background, .. } = self;
        Ok(Film { name, size: [height, width], shots, points, background, remarks })
    }

    fn of_takes(&self, test: bool) -> impl Iterator<Item = usize> {
        (0..self.takes.len()).filter(move |&i| self.takes[i].test == test)
    }

    /// The number of each photo's camera: equal ones have the same.
    fn viewpoints(&self) -> Vec<usize> {
        let mut known: Vec<&Camera> = Vec::new();
        let mut numbers = Vec::with_capacity(self.takes.len());
        for Take { camera, .. } in &self.takes {
            let number = known.iter().position(|other| *other == camera).unwrap_or(known.len());
            if number == known.len() {
                known.push(camera);
            }
            numbers.push(number);
        }
        numbers
    }

    fn check(&self, folder: &Path, viewpoints: &[usize]) -> Result<(), Error> {
        let cameras = viewpoints.iter().max().map_or(0, |last| last + 1);
        if cameras < 2 {
            return Err(Error::unexpected(folder, "cameras", "at least two", format!("{cameras}")));
        }
        if self.of_takes(false).next().is_none() {
            return Err(Error::unexpected(folder, "photos to train on", "at least one", "none"));
        }
        let first = self.takes[0].moment;
        if self.takes.iter().all(|take| take.moment == first) {
            let found = format!("{first} for all {} photos", self.takes.len());
            return Err(Error::unexpected(&self.clock, "times", "at least two", found));
        }
        Ok(())
    }

    /// The photos' headers, after their sizes were compared.
    fn files(&self) -> Result<Vec<PhotoFile>, Error> {
        let open = |take: &Take| {
            let Take { photo, camera, .. } = take;
            if !photo.is_file() {
                return Err(Error::unexpected(photo, "photo", "a file", "nothing"));
            }
            Ok(PhotoFile::at(photo)?.for_camera(camera.width, camera.height))
        };
        let files: Vec<Result<PhotoFile, Error>> = self.takes.par_iter().map(open).collect();
        let files = files.into_iter().collect::<Result<Vec<_>, _>>()?;
        let (first, whole) = (&self.takes[0].photo, files[0].size());
        for (file, Take { photo, camera, .. }) in files.iter().zip(&self.takes) {
            let (w, h) = file.size();
            let found = format!("{w}x{h}");
            if (w, h) != whole {
                let expected = format!("{}x{}, that of {}", whole.0, whole.1, first.display());
                return Err(Error::unexpected(photo, "photo size", expected, found));
            }
            let stretch = (w * camera.height) as f64 / (h * camera.width) as f64;
            if (stretch - 1.0).abs() > SAME_ASPECT {
                let expected = format!("the shape of its camera's {}x{}", camera.width, camera.height);
                return Err(Error::unexpected(photo, "photo size", expected, found));
            }
        }
        Ok(files)
    }
}

/// True if one of some ascending times is this one.
fn near(times: &[f64], time: f64) -> bool {
    let next = times.partition_point(|&other| other < time - SAME_TIME);
    times.get(next).is_some_and(|other| *other <= time + SAME_TIME)
}

/// Height and width of a photo whose longer side is at most `longest`.
fn shrunk((width, height): (usize, usize), longest: Option<usize>) -> [usize; 2] {
    let side = width.max(height);
    let Some(longest) = longest.filter(|longest| *longest < side) else { return [height, width] };
    [height, width].map(|x| ((x * longest) as f64 / side as f64).round().max(1.0) as usize)
}
