//! Features of photos, one file per camera.

use crate::failure::Failure;
use half::{bf16, f16};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use weaver_geometry::Camera;
use weaver_io::{Storage, Weight, open_array};
use weaver_kernels::resample::Resample;
use weaver_lift::{LiftError, Observations};

/// Channels that are looked at together to find the lengths of pixels.
const BLOCK: usize = 64;
/// Names in a message, at most.
const NAMED: usize = 8;

/// The features of the cameras' photos: mapped files, resized to the cameras' images.
#[derive(Debug)]
pub struct FeatureFiles {
    views: Vec<View>,
    channels: usize,
}

#[derive(Debug)]
struct View {
    array: Weight,
    /// `[height, width]` of the file, and of the camera's image.
    from: [usize; 2],
    to: [usize; 2],
}

impl FeatureFiles {
    /// Opens the files of a folder and matches them with cameras by their stems.
    pub fn open(folder: &Path, stems: &[String], cameras: &[Camera]) -> Result<Self, Failure> {
        let files = by_stem(folder, &["npy", "safetensors"])?;
        unmatched(folder, &files, stems)?;
        let missing: Vec<&str> = stems.iter().map(String::as_str).filter(|stem| !files.contains_key(*stem)).collect();
        if !missing.is_empty() {
            return Err(refused(folder, "features for each camera", &format!("none for {}", names(&missing))));
        }
        let mut views = Vec::with_capacity(stems.len());
        let mut first: Option<(PathBuf, usize)> = None;
        for (stem, camera) in stems.iter().zip(cameras) {
            let path = &files[stem];
            let array = open_array(path)?;
            let &[height, width, channels] = array.shape() else {
                return Err(refused(path, "an array [height, width, channels]", &format!("{:?}", array.shape())));
            };
            if height * width * channels == 0 {
                return Err(refused(path, "pixels with at least one channel", &format!("{:?}", array.shape())));
            }
            // Of a type that can be read.
            array.storage()?;
            let (other, expected) = first.get_or_insert_with(|| (path.clone(), channels));
            if channels != *expected {
                let expected = format!("{expected} channels, as {} has", other.display());
                return Err(refused(path, &expected, &channels.to_string()));
            }
            views.push(View { array, from: [height, width], to: [camera.height, camera.width] });
        }
        let channels = first.map_or(0, |(_, channels)| channels);
        Ok(Self { views, channels })
    }
}

/// The files of a folder by their stems.
pub fn by_stem(folder: &Path, extensions: &[&str]) -> Result<BTreeMap<String, PathBuf>, Failure> {
    let mut files: BTreeMap<String, PathBuf> = BTreeMap::new();
    for path in weaver_io::list_files(folder, extensions)? {
        let stem = path.file_stem().map_or(String::new(), |stem| stem.to_string_lossy().into_owned());
        if let Some(other) = files.insert(stem, path.clone()) {
            return Err(refused(&path, "one file for each camera", &format!("{} as well", other.display())));
        }
    }
    Ok(files)
}

/// Refuses files that no camera has the name of.
pub fn unmatched(folder: &Path, files: &BTreeMap<String, PathBuf>, stems: &[String]) -> Result<(), Failure> {
    let others: Vec<&str> = files.keys().map(String::as_str).filter(|file| !stems.iter().any(|s| s == file)).collect();
    if others.is_empty() {
        return Ok(());
    }
    let cameras: Vec<&str> = stems.iter().map(String::as_str).collect();
    let expected = format!("files named as the cameras ({})", names(&cameras));
    Err(refused(folder, &expected, &format!("also {}", names(&others))))
}

fn names(all: &[&str]) -> String {
    let shown = all[..all.len().min(NAMED)].join(", ");
    if all.len() > NAMED { format!("{shown} and {} more", all.len() - NAMED) } else { shown }
}

/// A file or folder that is not as it should be.
pub fn refused(path: &Path, expected: &str, found: &str) -> Failure {
    Failure::message(format!("{}: expected {expected}, found {found}", path.display()))
}

impl View {
    /// Some channels as planes `[channels, height, width]` of the file; zeros for what is not a number.
    fn planes(&self, channels: Range<usize>) -> Result<Vec<f32>, LiftError> {
        let storage = self.array.storage().map_err(|e| LiftError::Source(Box::new(e)))?;
        let (pixels, all) = (self.from[0] * self.from[1], self.array.shape()[2]);
        let mut planes = vec![0.0; pixels * channels.len()];
        each(&storage, all, |pixel, row| {
            for (plane, channel) in channels.clone().enumerate() {
                let x = row(channel);
                planes[plane * pixels + pixel] = if x.is_finite() { x } else { 0.0 };
            }
        });
        Ok(planes)
    }

    /// For each pixel of the file 1 if any of its channels is not a number, else 0.
    fn broken(&self) -> Result<Vec<f32>, LiftError> {
        let storage = self.array.storage().map_err(|e| LiftError::Source(Box::new(e)))?;
        let all = self.array.shape()[2];
        let mut broken = vec![0.0; self.from[0] * self.from[1]];
        if !storage.is_finite() {
            each(&storage, all, |pixel, row| {
                broken[pixel] = if (0..all).all(|channel| row(channel).is_finite()) { 0.0 } else { 1.0 };
            });
        }
        Ok(broken)
    }

    /// Planes at the size of the camera's image: bilinear, corners not aligned.
    fn resized(&self, planes: Vec<f32>) -> Vec<f32> {
        if self.from == self.to {
            return planes;
        }
        let count = planes.len() / (self.from[0] * self.from[1]);
        let mut resized = vec![0.0; count * self.to[0] * self.to[1]];
        Resample::bilinear(self.from, self.to, false).forward(&planes, &mut resized);
        resized
    }
}

/// Runs `body` with each pixel and its channels.
fn each(storage: &Storage, channels: usize, mut body: impl FnMut(usize, &dyn Fn(usize) -> f32)) {
    fn rows<E: Copy>(
        values: &[E],
        channels: usize,
        wide: fn(E) -> f32,
        body: &mut impl FnMut(usize, &dyn Fn(usize) -> f32),
    ) {
        for (pixel, row) in values.chunks_exact(channels).enumerate() {
            body(pixel, &|channel| wide(row[channel]));
        }
    }
    match storage {
        Storage::F32(slice) => rows(slice.as_ref(), channels, |x: f32| x, &mut body),
        Storage::Widened(values) => rows(values, channels, |x: f32| x, &mut body),
        Storage::F16(slice) => rows(slice.as_ref(), channels, f16::to_f32, &mut body),
        Storage::Bf16(slice) => rows(slice.as_ref(), channels, bf16::to_f32, &mut body),
    }
}

impl Observations<f32> for FeatureFiles {
    fn channels(&self) -> usize {
        self.channels
    }

    /// One over the length of each pixel's features; 0 where any number that it is made of is none.
    fn factors(&mut self, view: usize, factors: &mut [f32]) -> Result<(), LiftError> {
        let mut squares = vec![0.0_f64; factors.len()];
        let mut out = Vec::new();
        for first in (0..self.channels).step_by(BLOCK) {
            let channels = first..self.channels.min(first + BLOCK);
            out.resize(factors.len() * channels.len(), 0.0);
            self.read(view, channels.clone(), &mut out)?;
            for (sum, row) in squares.iter_mut().zip(out.chunks_exact(channels.len())) {
                *sum += row.iter().map(|x| f64::from(*x) * f64::from(*x)).sum::<f64>();
            }
        }
        let view = &self.views[view];
        let broken = view.resized(view.broken()?);
        for ((factor, squares), broken) in factors.iter_mut().zip(squares).zip(broken) {
            *factor = match broken > 0.0 {
                true => 0.0,
                false if squares > 0.0 => squares.sqrt().recip() as f32,
                false => 1.0,
            };
        }
        Ok(())
    }

    fn read(&mut self, view: usize, channels: Range<usize>, out: &mut [f32]) -> Result<(), LiftError> {
        let view = &self.views[view];
        let width = channels.len();
        let planes = view.resized(view.planes(channels)?);
        let pixels = view.to[0] * view.to[1];
        weaver_kernels::parallel::for_chunks(out, 1024 * width, |chunk, rows| {
            for (i, row) in rows.chunks_exact_mut(width).enumerate() {
                let pixel = chunk * 1024 + i;
                row.iter_mut().enumerate().for_each(|(c, x)| *x = planes[c * pixels + pixel]);
            }
        });
        Ok(())
    }
}
