//! The parts of a film.

use super::pixels::Pixels;
use crate::Error;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_io::{Checksum, Image};

/// Times closer than this are the same.
pub(super) const SAME_TIME: f64 = 1e-6;

/// Photos of a scene that moves, by calibrated cameras, each with its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// The name of the film in reports.
    pub name: String,
    /// Height and width of every photo.
    pub size: [usize; 2],
    /// The photos, by time, and by viewpoint within one time.
    pub shots: Vec<Shot>,
    /// Points on surfaces, where known, scene units.
    pub points: Vec<FilmPoint>,
    /// Color of the background, sRGB in [0, 1].
    pub background: [f32; 3],
    /// Remarks for the user about how it was loaded.
    pub remarks: Vec<String>,
}

/// One photo of a film.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Name in errors and reports.
    pub name: String,
    /// Its camera, with intrinsics for the film's size.
    pub camera: Camera,
    /// The number of the camera; photos of a hand-held one have one each.
    pub viewpoint: usize,
    /// When it was taken, from 0 to 1.
    pub time: f64,
    /// Its pixels.
    pub pixels: Pixels,
    /// Kind of motion at each pixel's center, `[H, W]`, of a procedural film: 0 is nothing that moves, others are
    /// numbers into [`MOTIONS`](super::MOTIONS).
    pub motion: Option<Vec<u8>>,
    /// Its part in evaluation.
    pub held_out: HeldOut,
}

/// The part of a photo in evaluation: of those that are trained on, none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeldOut {
    /// Nothing is trained on from where it was taken.
    pub camera: bool,
    /// Nothing is trained on from when it was taken.
    pub time: bool,
}

/// A point on a surface that may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmPoint {
    /// Where it was, scene units.
    pub position: DVec3,
    /// sRGB in [0, 1].
    pub color: [f32; 3],
    /// When it was there, from 0 to 1.
    pub time: f64,
}

impl HeldOut {
    /// True if the photo is trained on.
    ///
    /// ```
    /// use weaver_data::film::HeldOut;
    /// assert!(HeldOut::default().trained() && !HeldOut { camera: false, time: true }.trained());
    /// ```
    pub fn trained(&self) -> bool {
        !self.camera && !self.time
    }
}

impl Film {
    /// A checksum of cameras, times, and pixels as they are trained on; of photos that are not kept in memory the
    /// length of the file takes the place of the pixels.
    ///
    /// # Errors
    /// When a file is there no more.
    pub fn checksum(&self) -> Result<Checksum, Error> {
        let mut sum = Checksum::default();
        for shot in &self.shots {
            let Camera { pose, intrinsics: k, .. } = &shot.camera;
            let numbers = pose.rotation.to_cols_array().into_iter().chain(pose.translation.to_array());
            numbers.chain([k.fx, k.fy, k.cx, k.cy, shot.time]).for_each(|x| sum.word(x.to_bits()));
            sum.word(u64::from(shot.held_out.trained()));
            match &shot.pixels {
                Pixels::Kept(bytes) => sum.bytes(bytes),
                Pixels::Stored { file, .. } => sum.word(weaver_io::file_length(file.path())?),
            }
        }
        Ok(sum)
    }
}

impl Shot {
    /// The photo of a film of this size (height and width), values divided by 255.
    ///
    /// # Errors
    /// When it is in a file that cannot be read any more.
    ///
    /// # Panics
    /// When the size is not its own.
    pub fn image(&self, [height, width]: [usize; 2]) -> Result<Image, Error> {
        Ok(Image::from_bytes(width, height, &self.pixels.bytes()?))
    }
}

impl Film {
    /// Indices of the photos to train on.
    pub fn training(&self) -> Vec<usize> {
        self.indices(true)
    }

    /// Indices of the photos kept for evaluation.
    pub fn held_out(&self) -> Vec<usize> {
        self.indices(false)
    }

    fn indices(&self, trained: bool) -> Vec<usize> {
        (0..self.shots.len()).filter(|&i| self.shots[i].held_out.trained() == trained).collect()
    }

    /// The times at which there are photos, ascending, each once.
    pub fn times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self.shots.iter().map(|shot| shot.time).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    /// The size that learning rates of positions go by, scene units: 1.1 times the largest distance of a training
    /// camera from the mean of their centers, as in 3DGS.
    ///
    /// Of a single viewpoint the median distance to the points; 1 where there are none.
    pub fn extent(&self) -> f64 {
        let centers: Vec<DVec3> = self.training().iter().map(|&i| self.shots[i].camera.pose.center()).collect();
        let Some(first) = centers.first() else { return 1.0 };
        // Equal centers may have a mean that differs in its last bits.
        if centers.iter().any(|center| center != first) {
            let mean = centers.iter().sum::<DVec3>() / centers.len() as f64;
            return 1.1 * centers.iter().map(|center| center.distance(mean)).fold(0.0, f64::max);
        }
        let mut distances: Vec<f64> = self.points.iter().map(|point| point.position.distance(*first)).collect();
        distances.sort_by(f64::total_cmp);
        distances.get(distances.len() / 2).copied().unwrap_or(1.0)
    }
}
