//! From photo files to a scene on disk: Gaussians, cameras, renders, maps of depth and of Gaussians per pixel.

use crate::pictures::{count_picture, depth_picture, row, stack};
use crate::{CameraSource, Density, Error, Photos, Prediction, Predictor, push_planar};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_data::capture::{self, Crop};
use weaver_geometry::Camera;
use weaver_io::colmap::Model;
use weaver_io::{Image, Transforms};
use weaver_kernels::random::Stream;
use weaver_scene::Frame;

/// How to reconstruct.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Cameras of the photos: a transforms.json, or a folder with a COLMAP model. Photos are matched by file name.
    pub cameras: Option<PathBuf>,
    /// Which pixels get Gaussians, and how many.
    pub density: Density,
    /// Seed of allocations that draw random numbers.
    pub seed: u64,
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Gaussians of the scene.
    pub gaussians: usize,
    /// Gaussians per pixel.
    pub gaussians_per_pixel: f64,
    /// Mean PSNR of the renders of the input views against the photos, dB, if there are Gaussians to render.
    pub psnr: Option<f64>,
    /// What the reader should know.
    pub remarks: Vec<String>,
    /// The overview picture: a row of input, render, depth and Gaussians per pixel for each photo.
    pub overview: PathBuf,
}

/// Runs a predictor on photos and writes the scene into the folder `out`.
///
/// # Errors
/// When the photos or the cameras cannot be read or do not fit together, or the output cannot be written.
pub fn reconstruct(
    predictor: &mut dyn Predictor,
    images: &[PathBuf],
    options: &Options,
    out: &Path,
) -> Result<Report, Error> {
    let [height, width] = predictor.image_size();
    let photos = capture::load_images(images, width, height)?;
    let mut remarks = Vec::new();
    if photos.len() == 1 {
        remarks.push(ONE_PHOTO.to_string());
    }
    let given = options.cameras.as_deref().map(|file| read_cameras(file, images, width, height)).transpose()?;
    let density = predictor.density(options.density)?;
    let mut planes = Vec::new();
    photos.iter().for_each(|photo| push_planar(&mut planes, photo));
    let source = match &given {
        Some(cameras) => CameraSource::GivenUnscaled(cameras),
        None => CameraSource::Predicted,
    };
    let stream = Stream::new(options.seed, 0, "inference");
    let prediction = predictor.predict(Photos { planes: &planes, height, width }, source, density, stream)?;
    if let Some(factor) = prediction.scaled_by {
        remarks.push(format!(
            "the given cameras' centers were scaled by {factor:.4}, so that their mean distance to camera 0 equals that of the predicted ones"
        ));
    }
    let cameras = if given.is_some() { "given" } else { "predicted" };
    let allocation = density.allocation.map_or(String::new(), |kind| format!(", allocation {kind}"));
    remarks.push(format!("cameras {cameras}{allocation}"));
    let renders = predictor.render(&prediction.gaussians, &prediction.cameras)?;
    write(out, images, &photos, &renders, &prediction)?;
    Ok(report(&photos, &renders, &prediction, remarks, out))
}

/// The remark on a single photo.
pub(crate) const ONE_PHOTO: &str = "warning: one photo only: depth rests on a single view";

/// The figures of a scene.
pub(crate) fn report(
    photos: &[Image],
    renders: &[Image],
    prediction: &Prediction,
    remarks: Vec<String>,
    out: &Path,
) -> Report {
    let psnr = |(photo, render): (&Image, &Image)| weaver_losses::metrics::psnr(&render.pixels, &photo.pixels);
    let gaussians = prediction.gaussians.opacities.len();
    Report {
        gaussians,
        gaussians_per_pixel: gaussians as f64 / prediction.counts.len() as f64,
        psnr: Some(photos.iter().zip(renders).map(psnr).sum::<f64>() / photos.len() as f64),
        remarks,
        overview: out.join("overview.png"),
    }
}

/// Writes pictures, Gaussians and cameras.
pub(crate) fn write(
    out: &Path,
    paths: &[PathBuf],
    photos: &[Image],
    renders: &[Image],
    prediction: &Prediction,
) -> Result<(), Error> {
    for part in ["input", "render", "depth", "experts", "sparse/0"] {
        weaver_io::create_folder(out.join(part))?;
    }
    let names = unique_names(paths);
    let mut rows = Vec::new();
    for (v, (photo, render)) in photos.iter().zip(renders).enumerate() {
        let name = &names[v];
        photo.write_png(out.join("input").join(name))?;
        render.write_png(out.join("render").join(name))?;
        depth_picture(prediction, v, photo).write_png(out.join("depth").join(name))?;
        count_picture(prediction, v, photo).write_png(out.join("experts").join(name))?;
        rows.push(row(photo, render, prediction, v));
    }
    stack(&rows.iter().collect::<Vec<_>>()).write_png(out.join("overview.png"))?;
    weaver_io::write_ply(out.join("scene.ply"), &prediction.gaussians.to_stored())?;
    write_cameras(out, &names, &prediction.cameras)
}

/// Writes pictures of depth, and cameras, where there are no Gaussians.
pub(crate) fn write_geometry(
    out: &Path,
    paths: &[PathBuf],
    photos: &[Image],
    prediction: &Prediction,
) -> Result<(), Error> {
    for part in ["input", "depth", "sparse/0"] {
        weaver_io::create_folder(out.join(part))?;
    }
    let names = unique_names(paths);
    let mut rows = Vec::new();
    for (v, (photo, name)) in photos.iter().zip(&names).enumerate() {
        let depth = depth_picture(prediction, v, photo);
        photo.write_png(out.join("input").join(name))?;
        depth.write_png(out.join("depth").join(name))?;
        rows.push(Image::mosaic(&[photo, &depth]));
    }
    stack(&rows.iter().collect::<Vec<_>>()).write_png(out.join("overview.png"))?;
    write_cameras(out, &names, &prediction.cameras)
}

/// Writes transforms.json and a COLMAP model.
fn write_cameras(out: &Path, names: &[String], cameras: &[Camera]) -> Result<(), Error> {
    let frames = |folder: &str| -> Vec<Frame> {
        names.iter().zip(cameras).map(|(name, camera)| Frame::new(format!("{folder}{name}"), *camera)).collect()
    };
    Transforms { frames: frames("input/"), ..Transforms::default() }.write(out.join("transforms.json"))?;
    Model::from_frames(&frames("")).write_binary(out.join("sparse/0"))?;
    Ok(())
}

/// File names for the photos' pictures, numbered where two photos have the same name.
fn unique_names(paths: &[PathBuf]) -> Vec<String> {
    let stems: Vec<String> =
        paths.iter().map(|p| p.file_stem().map_or("photo".into(), |s| s.to_string_lossy().into_owned())).collect();
    let repeated = |s: &String| stems.iter().filter(|t| *t == s).count() > 1;
    stems
        .iter()
        .enumerate()
        .map(|(i, s)| if repeated(s) { format!("{i:03}-{s}.png") } else { format!("{s}.png") })
        .collect()
}

/// The cameras of the photos, cropped as the photos are, in the frame of the first.
fn read_cameras(file: &Path, photos: &[PathBuf], width: usize, height: usize) -> Result<Vec<Camera>, Error> {
    let base = |name: &str| Path::new(name).file_name().map_or(name.to_string(), |n| n.to_string_lossy().into_owned());
    let known: BTreeMap<String, Camera> =
        weaver_io::read_cameras(file)?.into_iter().map(|frame| (base(&frame.name), frame.camera)).collect();
    let cameras = photos
        .iter()
        .map(|photo| {
            let name = base(&photo.to_string_lossy());
            let Camera { pose, intrinsics, width: w, height: h } = *known.get(&name).ok_or_else(|| {
                Error::Input(format!("{}: {name}: expected a camera for this photo, found none", file.display()))
            })?;
            let found = Image::dimensions(photo)?;
            if found != (w, h) {
                return Err(Error::Input(format!(
                    "{}: expected an image of its camera's size {w}x{h}, found {}x{}",
                    photo.display(),
                    found.0,
                    found.1
                )));
            }
            let crop = Crop::centered(w, h, width, height);
            Ok(Camera { pose, intrinsics: crop.intrinsics(&intrinsics), width, height })
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let first = cameras[0].pose;
    Ok(cameras.into_iter().map(|c| Camera { pose: c.pose.relative_to(&first), ..c }).collect())
}
