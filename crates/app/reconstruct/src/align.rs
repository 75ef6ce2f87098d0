//! Cameras of further photos of a finished scene, found by drawing it.

use crate::Error;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weaver_data::posed::PosedPhoto;
use weaver_fit::FitRasterizer;
use weaver_fit::align::{AlignLoss, Aligned, Method, Options, Outcome, Photo, Scene, align, mean_square, unit};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::colmap::Model;
use weaver_io::{Image, Observe, OutputFolder, Part, PhotoFile, Stage, Transforms, relative_path, write_text};
use weaver_scene::{ActivatedGaussians, Frame, stems};
use weaver_splat::{RasterSettings, Workspace, render};

const CAMERAS: &str = "transforms.json";
const REPORT: &str = "align.json";
const MODEL: &str = "sparse/0";
/// Longest side of the pictures by which [`closest_views`] compares, pixels.
const SIDE: usize = 64;

/// Photos to align with a scene.
#[derive(Clone, Debug)]
pub struct AlignRequest<'a> {
    /// The scene.
    pub gaussians: &'a ActivatedGaussians,
    /// The color behind it.
    pub background: [f32; 3],
    /// Settings of drawing it.
    pub settings: RasterSettings,
    /// The photos, each with its first guess.
    pub photos: &'a [PosedPhoto],
    /// Options of the descent.
    pub options: Options,
    /// The loss of the descent.
    pub loss: AlignLoss,
    /// Draws and differentiates.
    pub rasterizer: Arc<dyn FitRasterizer>,
}

/// An aligned photo, as align.json lists it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AlignedPhoto {
    /// Turn of the camera from its guess, degrees.
    pub degrees: f64,
    /// Way of the camera from its guess, over the mean depth.
    pub distance_over_depth: f64,
    /// The loss at the guess and at the end.
    pub loss: [f64; 2],
    /// `kept`, or the reason why the guess was kept.
    pub outcome: String,
    /// Name of the photo.
    pub photo: String,
    /// PSNR from the guess and from the camera that was found, decibels.
    pub psnr: [f64; 2],
}

/// Aligned photos; displayed as a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AlignedPhotos(pub Vec<AlignedPhoto>);

/// Claims the folder of an alignment that reads these files.
///
/// # Errors
/// When there are files in it that are not of an alignment.
pub fn claim_alignment<'a>(
    folder: &Path,
    read: impl Iterator<Item = &'a PathBuf>,
) -> Result<OutputFolder, weaver_io::Error> {
    let out = OutputFolder::claim(folder, "align", read)?;
    out.check([CAMERAS, REPORT])?;
    out.check(Model::FILES.map(|name| format!("{MODEL}/{name}")))?;
    Ok(out)
}

/// Moves the cameras of photos until the scene shows each photo, and writes transforms.json, a COLMAP model in
/// sparse/0, the folder renders and align.json.
///
/// # Errors
/// When a photo does not fit the loss, a file is in the way, or the rasterizer refuses.
pub fn align_photos(
    request: &AlignRequest<'_>,
    out: &OutputFolder,
    observe: &mut dyn Observe,
) -> Result<AlignedPhotos, Error> {
    let AlignRequest { gaussians, background, settings, photos, options, loss, rasterizer } = request;
    let pictures = stems(&photos.iter().map(|photo| named(photo, photo.photo.camera)).collect::<Vec<_>>());
    out.check(pictures.iter().map(|stem| picture(stem)))?;
    let unit = unit(photos.iter().map(|photo| Pose::center(&photo.photo.camera.pose)));
    let scene = Scene { gaussians: gaussians.as_slices(), background: *background, settings: *settings, unit };
    let mut compare = loss.function();
    let (mut frames, mut images, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    observe.begin(&Stage { label: "align", done: 0, total: photos.len(), stops_after: None });
    for (i, photo) in photos.iter().enumerate() {
        let pixels: Vec<f32> = photo.photo.rgb.iter().map(|b| f32::from(*b) / 255.0).collect();
        let one = [Photo { pixels: &pixels, mask: photo.photo.mask.as_deref(), camera: photo.photo.camera }];
        let failed = |source| Error::Align { photo: photo.frame.path.clone(), source };
        let mut found = align(&**rasterizer, &scene, &one, options, &mut compare).map_err(failed)?;
        // Whatever was compared: decibels of all that masks leave, which users know.
        let decibels = |camera: Camera| -> Result<f64, Error> {
            let still = Options { steps: 0, ..Options::of(Method::NoPoSplat) };
            let moved = [Photo { camera, ..one[0] }];
            let drawn = align(&**rasterizer, &scene, &moved, &still, mean_square).map_err(failed)?;
            Ok(-10.0 * drawn[0].loss[0].max(1e-10).log10())
        };
        let Aligned { camera, image, loss, moved: [degrees, distance_over_depth], outcome, .. } = found.remove(0);
        let psnr = [decibels(photo.photo.camera)?, decibels(camera)?];
        let (name, outcome) = (photo.photo.name.clone(), kept(outcome));
        rows.push(AlignedPhoto { degrees, distance_over_depth, loss, outcome, photo: name, psnr });
        frames.push(moved_frame(photo, camera, out)?);
        let pixels = image.iter().map(|x| x.clamp(0.0, 1.0)).collect();
        images.push(Image { width: camera.width, height: camera.height, pixels });
        let note = photo.photo.name.clone();
        let _ = observe.progress(&Part { label: "align", done: i + 1, total: photos.len(), note });
    }
    for (image, stem) in images.iter().zip(stems(&frames)) {
        image.write_png(out.file(picture(&stem))?)?;
    }
    Model::from_frames(&frames).write_binary(out.files(MODEL, Model::FILES)?)?;
    let aligned = AlignedPhotos(rows);
    write_text(out.file(REPORT)?, &aligned.json())?;
    Transforms { frames, ..Transforms::default() }.write(out.file(CAMERAS)?)?;
    Ok(aligned)
}

/// For each photo the camera from which the scene looks most like it, by small pictures; `frames` is not empty.
///
/// # Errors
/// When a photo cannot be read, or the rasterizer refuses.
pub fn closest_views(
    gaussians: &ActivatedGaussians,
    frames: &[Frame],
    photos: &[PathBuf],
    background: [f32; 3],
    settings: &RasterSettings,
) -> Result<Vec<Frame>, Error> {
    let mut workspace = Workspace::new();
    let mut views = Vec::with_capacity(frames.len());
    for frame in frames {
        let small = frame.camera.shrunk(SIDE);
        let image = render(gaussians, &[small], background, settings, &mut workspace)?.concat();
        views.push((frame.camera, small, image));
    }
    let mut guesses = Vec::with_capacity(photos.len());
    for path in photos {
        let photo = PhotoFile::at(path)?.over(background);
        let mut best = (f64::INFINITY, views[0].0);
        for (camera, small, image) in &views {
            let pixels = photo.resize_whole(small.width, small.height)?.pixels;
            let square = |(a, b): (&f32, &u8)| f64::from(a - f32::from(*b) / 255.0).powi(2);
            let error = image.iter().zip(&pixels).map(square).sum::<f64>() / image.len() as f64;
            if error < best.0 {
                best = (error, *camera);
            }
        }
        let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        guesses.push(Frame { path: path.clone(), ..Frame::new(name, best.1) });
    }
    Ok(guesses)
}

fn picture(stem: &str) -> String {
    format!("renders/{stem}.png")
}

fn named(photo: &PosedPhoto, camera: Camera) -> Frame {
    Frame::new(photo.frame.path.display().to_string(), camera)
}

/// The frame of a photo with the pose and the focal lengths that were found.
fn moved_frame(photo: &PosedPhoto, aligned: Camera, out: &OutputFolder) -> Result<Frame, Error> {
    let Camera { intrinsics, pose, .. } = aligned;
    // The photo on disk has a size and distortion of its own; its focal lengths change as those of the photo without.
    let (file, before) = (photo.frame.camera, photo.photo.camera.intrinsics);
    let Intrinsics { fx, fy, .. } = file.intrinsics;
    let (fx, fy) = (fx * intrinsics.fx / before.fx, fy * intrinsics.fy / before.fy);
    let camera = Camera { pose, intrinsics: Intrinsics { fx, fy, ..file.intrinsics }, ..file };
    // Relative, so that results and photos can be moved together.
    let name = |path: &PathBuf| relative_path(out.path(), path);
    Ok(Frame {
        distortion: photo.frame.distortion,
        mask: photo.frame.mask.as_ref().map(name).transpose()?.map(PathBuf::from),
        time: photo.frame.time,
        number: photo.frame.number,
        ..Frame::new(name(&photo.frame.path)?, camera)
    })
}

fn kept(outcome: Outcome) -> String {
    match outcome {
        Outcome::Found => "kept".into(),
        Outcome::Flat => "guess kept: the photo, or the scene under it, has one color".into(),
        Outcome::Unseen(0.0) => "failed: nothing seen".into(),
        Outcome::Unseen(share) => format!("failed: the scene covers {:.1} % of the photo", 100.0 * share),
        Outcome::NotBetter => "failed: no camera near the guess is better".into(),
    }
}

impl AlignedPhotos {
    /// The content of align.json.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("numbers and text are JSON")
    }
}

impl fmt::Display for AlignedPhotos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.0.iter().map(|row| row.photo.chars().count()).max().unwrap_or(0).max("photo".len());
        writeln!(f, "{:<width$}  dB before   after  degrees  of the depth", "photo")?;
        for AlignedPhoto { photo, psnr: [before, after], degrees, distance_over_depth, outcome, .. } in &self.0 {
            writeln!(
                f,
                "{photo:<width$}  {before:>9.2}  {after:>6.2}  {degrees:>7.3}  {distance_over_depth:>12.4}  {outcome}"
            )?;
        }
        Ok(())
    }
}
