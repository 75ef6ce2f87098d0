//! Where the Gaussians of a run begin.

use crate::{ByPhotos, Coverage, Error, Initial, RunSettings};
use std::time::Instant;
use weaver_fit::{FitError, FitSettings, KnownDepth, init, sky};
use weaver_scene::{Gaussians, Photo, PointCloud};
use weaver_stereo::{Stereo, StereoSettings};

/// Photos that are fitted, the capture's points, and which of them each photo sees.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub photos: &'a [Photo],
    pub points: &'a PointCloud,
    pub visible: &'a [Vec<u32>],
    /// True if the depth of photos is asked for: it is a loss, and no file has it.
    pub finds_depth: bool,
}

impl Seen<'_> {
    /// Depth is found between pinholes.
    fn are_pinholes(&self) -> bool {
        self.photos.iter().all(|photo| photo.lens.is_none())
    }
}

/// Gaussians to begin with.
#[derive(Debug, Default)]
pub(crate) struct Start {
    pub gaussians: Gaussians,
    pub coverage: Coverage,
    /// True if photos were searched for some of them: the run keeps them, to go on from.
    pub searched: bool,
    /// Depth of photos that others agree about, by the number of the photo, where it is asked for.
    pub depths: Vec<(usize, KnownDepth)>,
}

/// Photos whose depth is found, at most: each takes about half a second of a core, and few show the surfaces of many.
pub(crate) const PHOTOS: usize = 60;
/// Part of the time of a run that finding depth may take.
const SHARE: f64 = 0.15;
/// Longest side of photos in the timed rehearsal, pixels. Time grows with the number of pixels, so that a small
/// rehearsal predicts it.
const REHEARSAL: usize = 50;
/// Photos from which Gaussians begin on surfaces that photos agree about. Nine photos began 0.8 dB better on points in
/// the mean, even at a high coverage; from 12 to 20 on it makes little difference.
pub(crate) const FEWEST: usize = 13;
/// Mean coverage from which Gaussians begin on surfaces: the captures on which this was measured to pay have 0.49 and
/// more.
const COVERAGE: f64 = 0.4;

impl Start {
    /// The start by the settings. Choices that they leave to the photos are written to them. `given` are the Gaussians
    /// of a file, or of an earlier start of the run, which are as large as they are meant to be.
    ///
    /// # Errors
    /// When there is nothing to begin with.
    pub fn of(settings: &mut RunSettings, seen: Seen<'_>, given: Option<&Gaussians>) -> Result<Self, Error> {
        let start = match given {
            Some(given) => Self { gaussians: init::from_gaussians(given, &settings.fit)?, ..Self::default() },
            None => Self::before_sky(settings, seen)?,
        };
        let asked = seen.finds_depth && !seen.points.is_empty() && seen.are_pinholes();
        if !asked || !start.depths.is_empty() {
            return Ok(start);
        }
        Ok(Self { depths: Found::search(settings, seen).depths(), ..start })
    }

    /// A start from photos and points, with a sky behind it.
    fn before_sky(settings: &mut RunSettings, seen: Seen<'_>) -> Result<Self, Error> {
        let start = Self::unbounded(settings, seen)?;
        let gaussians = init::bounded(start.gaussians, seen.photos);
        // What is drawn at random stands everywhere.
        let asked = settings.by_photos.contains(&ByPhotos::Sky) && settings.init != Initial::Random;
        if !asked || seen.points.is_empty() {
            return Ok(Self { gaussians, ..start });
        }
        let shell = sky(seen.photos, &gaussians, &settings.fit);
        let searched = start.searched || !shell.is_empty();
        Ok(Self { gaussians: Gaussians::joined(&[gaussians, shell]), searched, ..start })
    }

    fn unbounded(settings: &mut RunSettings, seen: Seen<'_>) -> Result<Self, Error> {
        let fit = settings.fit.clone();
        if settings.init == Initial::Auto && settings.by_photos.contains(&ByPhotos::Start) && !seen.points.is_empty() {
            let asked = seen.photos.len() >= FEWEST && seen.are_pinholes();
            let dense = if asked { Self::dense(settings, seen)? } else { Self::default() };
            settings.init = if dense.coverage.mean() >= COVERAGE { Initial::Dense } else { Initial::Points };
            return Ok(match settings.init {
                Initial::Dense => dense,
                _ => Self { gaussians: init::from_points(seen.points, &fit)?, searched: false, ..dense },
            });
        }
        let gaussians = match settings.init {
            Initial::Dense if !seen.are_pinholes() => {
                let expected = "points or random for photos that keep their lens".into();
                return Err(FitError::Setting { key: "init", expected, found: "dense".into() }.into());
            }
            Initial::Dense => return Self::dense(settings, seen),
            Initial::Given => init::from_gaussians(&Gaussians::default(), &fit)?,
            Initial::Random => init::random(seen.photos, &fit)?,
            Initial::Auto if seen.points.is_empty() => init::random(seen.photos, &fit)?,
            Initial::Points | Initial::Auto => init::from_points(seen.points, &fit)?,
        };
        Ok(Self { gaussians, ..Self::default() })
    }

    /// On the surface that photos agree about, those of them that show most, and on the points that it does not show.
    fn dense(settings: &mut RunSettings, seen: Seen<'_>) -> Result<Self, Error> {
        let found = Found::search(settings, seen);
        let fit = &settings.fit;
        let depths = if seen.finds_depth { found.depths() } else { Vec::new() };
        let Found { stereo, photos } = &found;
        let names = photos.iter().map(|n| seen.photos[*n].name.clone());
        let coverage = Coverage(names.zip(stereo.coverage()).collect());
        let mut gaussians = stereo.surface().gaussians(init::room(fit));
        let points = stereo.unexplained();
        if gaussians.is_empty() || !points.is_empty() {
            // Where both are too many, each gets half of the room.
            let points = if gaussians.is_empty() { seen.points } else { &points };
            let half = FitSettings { gaussians: fit.gaussians.div_ceil(2), ..fit.clone() };
            let sparse = init::from_points(points, &half)?;
            let room = init::room(fit).saturating_sub(sparse.len());
            if gaussians.len() > room {
                gaussians = stereo.surface().gaussians(room);
            }
            gaussians = Gaussians::joined(&[gaussians, sparse]);
        }
        Ok(Self { gaussians: init::from_gaussians(&gaussians, fit)?, coverage, searched: true, depths })
    }
}

/// Depth that photos agree about.
struct Found {
    stereo: Stereo,
    /// The numbers of the photos.
    photos: Vec<usize>,
}

impl Found {
    /// Finds the depth of the photos that show most.
    fn search(settings: &mut RunSettings, seen: Seen<'_>) -> Self {
        let count = *settings.depth_photos.get_or_insert_with(|| photos_in_time(settings.minutes, seen));
        let poses: Vec<_> = seen.photos.iter().map(|photo| photo.camera.pose).collect();
        let numbers = weaver_stereo::best_photos(&poses, seen.points, seen.visible, count);
        let photos: Vec<&Photo> = numbers.iter().map(|n| &seen.photos[*n]).collect();
        let visible: Vec<Vec<u32>> = numbers.iter().map(|n| seen.visible[*n].clone()).collect();
        let settings = StereoSettings { seed: settings.fit.seed, ..StereoSettings::default() };
        Self { stereo: Stereo::of(&photos, seen.points, &visible, &settings), photos: numbers }
    }

    fn depths(&self) -> Vec<(usize, KnownDepth)> {
        let depth = |(at, number): (usize, &usize)| {
            let (depth, size) = self.stereo.depth(at);
            (*number, KnownDepth { size, depth })
        };
        self.photos.iter().enumerate().map(depth).collect()
    }
}

/// Photos whose depth is found in its share of the run's time, as extrapolated from small photos: fewer than all show
/// fewer surfaces, and any surfaces are better than points where steps are few.
fn photos_in_time(minutes: Option<f64>, seen: Seen<'_>) -> usize {
    let Some(minutes) = minutes else { return PHOTOS };
    let usual = StereoSettings::default();
    let start = Instant::now();
    let rehearsal = StereoSettings { long_side: REHEARSAL, ..usual };
    // Photos that follow one another show the same, so that their depth is searched for.
    let photos = seen.photos.len().min(FEWEST);
    Stereo::of(&seen.photos[..photos], seen.points, &seen.visible[..photos], &rehearsal);
    let camera = &seen.photos[0].camera;
    let side = |most: usize| camera.width.max(camera.height).min(most) as f64;
    let larger = side(usual.long_side) / side(REHEARSAL);
    let of_photo = larger * larger * start.elapsed().as_secs_f64() / photos as f64;
    ((SHARE * 60.0 * minutes / of_photo.max(1e-9)) as usize).clamp(FEWEST, PHOTOS)
}
