//! Features of photos, one file per camera.

use super::sampling::{Lens, Sampling};
use crate::{LiftError, Observations};
use half::{bf16, f16};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use weaver_command::Failure;
use weaver_io::open_array;
use weaver_io::safetensors::{Array, Storage};

/// Channels in one read of the pass over pixels' lengths.
const BLOCK: usize = 64;
/// Most names in a message.
const NAMED: usize = 8;

/// The features of the cameras' photos: mapped files, resized to the cameras' images and undistorted.
#[derive(Debug)]
pub struct FeatureFiles {
    views: Vec<View>,
    channels: usize,
}

#[derive(Debug)]
struct View {
    array: Array,
    sampling: Sampling,
    /// Valid pixels of the camera's image; `None` if all are.
    counts: Option<Vec<bool>>,
}

impl FeatureFiles {
    /// Opens the files of a folder and matches them with photos by their stems; `counts` holds the valid pixels of each
    /// photo's camera image, `None` if all are.
    pub fn open(
        folder: &Path,
        stems: &[String],
        lenses: &[Lens],
        counts: Vec<Option<Vec<bool>>>,
    ) -> Result<Self, Failure> {
        let files = by_stem(folder, &["npy", "safetensors"])?;
        unmatched(folder, &files, stems)?;
        let missing: Vec<&str> = stems.iter().map(String::as_str).filter(|stem| !files.contains_key(*stem)).collect();
        if !missing.is_empty() {
            return Err(refused(folder, "features for each camera", &format!("none for {}", names(&missing))));
        }
        let mut views = Vec::with_capacity(stems.len());
        let mut first: Option<(PathBuf, usize)> = None;
        for ((stem, lens), counts) in stems.iter().zip(lenses).zip(counts) {
            let path = &files[stem];
            let array = open_array(path)?;
            let &[height, width, channels] = array.shape() else {
                return Err(refused(path, "an array [height, width, channels]", &format!("{:?}", array.shape())));
            };
            if height * width * channels == 0 {
                return Err(refused(path, "pixels with at least one channel", &format!("{:?}", array.shape())));
            }
            // Fails on a type that cannot be read.
            array.storage()?;
            let (other, expected) = first.get_or_insert_with(|| (path.clone(), channels));
            if channels != *expected {
                let expected = format!("{expected} channels, as {} has", other.display());
                return Err(refused(path, &expected, &channels.to_string()));
            }
            views.push(View { array, sampling: Sampling { from: [height, width], lens: *lens }, counts });
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

/// Refuses files without a camera of their name.
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

/// Error of an unexpected file or folder.
pub fn refused(path: &Path, expected: &str, found: &str) -> Failure {
    Failure::message(format!("{}: expected {expected}, found {found}", path.display()))
}

impl View {
    /// Some channels of all pixels of the file, `[pixels, channels]`; zeros for NaN and infinities.
    fn rows(&self, channels: Range<usize>) -> Result<Vec<f32>, LiftError> {
        let storage = self.array.storage().map_err(|e| LiftError::Source(Box::new(e)))?;
        let all = self.array.shape()[2];
        let mut rows = Vec::with_capacity(self.array.len() / all * channels.len());
        each(&storage, all, |_, row| {
            rows.extend(channels.clone().map(row).map(|x| if x.is_finite() { x } else { 0.0 }));
        });
        Ok(rows)
    }

    /// For each pixel of the file 1 if any of its channels is not finite, else 0.
    fn broken(&self) -> Result<Vec<f32>, LiftError> {
        let storage = self.array.storage().map_err(|e| LiftError::Source(Box::new(e)))?;
        let all = self.array.shape()[2];
        let mut broken = vec![0.0; self.array.len() / all];
        if !storage.is_finite() {
            each(&storage, all, |pixel, row| {
                broken[pixel] = if (0..all).all(|channel| row(channel).is_finite()) { 0.0 } else { 1.0 };
            });
        }
        Ok(broken)
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

    /// One over the length of each pixel's features; 0 for a pixel that is invalid or interpolates a value that is not
    /// finite.
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
        let mut broken = vec![0.0; factors.len()];
        view.sampling.sample(&view.broken()?, 1, &mut broken);
        for (pixel, (factor, (squares, broken))) in factors.iter_mut().zip(squares.into_iter().zip(broken)).enumerate()
        {
            let counts = view.counts.as_ref().is_none_or(|counts| counts[pixel]);
            *factor = match counts && broken == 0.0 {
                false => 0.0,
                true if squares > 0.0 => squares.sqrt().recip() as f32,
                true => 1.0,
            };
        }
        Ok(())
    }

    fn read(&mut self, view: usize, channels: Range<usize>, out: &mut [f32]) -> Result<(), LiftError> {
        let view = &self.views[view];
        let width = channels.len();
        view.sampling.sample(&view.rows(channels)?, width, out);
        Ok(())
    }
}
