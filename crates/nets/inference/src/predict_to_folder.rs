//! From photo files to a scene on disk: Gaussians, cameras, renders, maps of depth and of Gaussians per pixel.

use crate::pictures::{density_picture, depth_picture, row, stack};
use crate::predictor::inside_of;
use crate::{CameraSource, Density, Error, Looks, Photos, Prediction, Predictor, planar};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use weaver_data::capture::{self, PhotoCameras};
use weaver_geometry::Camera;
use weaver_io::colmap::Model;
use weaver_io::{Image, OutputFolder, Transforms};
use weaver_kernels::random::Stream;
use weaver_losses::metrics;
use weaver_scene::Frame;

/// PredictOptions of a prediction from photo files.
#[derive(Clone, Debug, Default)]
pub struct PredictOptions {
    /// Cameras of the photos: a transforms.json, or a folder with a COLMAP model. Photos are matched by the ends of
    /// their paths; points of the model scale the cameras and repair depth
    /// ([`load_cameras`](weaver_data::capture::load_cameras)).
    pub cameras: Option<PathBuf>,
    /// True if photos have masks ([`load_readable_images`](weaver_data::capture::load_readable_images)): pixels outside
    /// get no Gaussians, and do not count in the PSNR.
    pub masks: bool,
    /// Allocation of Gaussians to pixels, and their number.
    pub density: Density,
    /// The light in which the place is shown, for models of light.
    pub looks: Option<Looks>,
    /// Seed of allocations that draw random numbers.
    pub seed: u64,
}

/// Summary of the written files.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictReport {
    /// Gaussians of the scene.
    pub gaussians: usize,
    /// Gaussians per pixel.
    pub gaussians_per_pixel: f64,
    /// Mean PSNR of the renders of the input views against the photos, dB, if there are Gaussians to render.
    pub psnr: Option<f64>,
    /// Remarks for the user.
    pub remarks: Vec<String>,
    /// The overview picture: a row of input, render, depth and Gaussians per pixel for each photo.
    pub overview: PathBuf,
}

impl PredictReport {
    /// The figures as JSON.
    pub fn json(&self) -> Value {
        let Self { gaussians, gaussians_per_pixel, psnr, remarks, .. } = self;
        json!({ "gaussians": gaussians, "gaussians_per_pixel": gaussians_per_pixel, "psnr": psnr, "remarks": remarks })
    }

    /// The figures in words, and the files in the folder of the results with a word for each; `others` were made
    /// besides.
    pub fn text(&self, folder: &Path, others: &[(&str, &str)]) -> String {
        let (gaussians, per_pixel) = (self.gaussians, self.gaussians_per_pixel);
        let figures = self.psnr.map(|psnr| {
            format!("{gaussians} Gaussians, {per_pixel:.3} per pixel; the input views come back at {psnr:.2} dB")
        });
        let found: &[_] = match self.psnr {
            Some(_) => &[("scene", "scene.ply")],
            None => &[("points", "points.ply"), ("cameras", "transforms.json")],
        };
        let files = found.iter().chain(&[("overview", "overview.png")]).chain(others);
        let lines = files.map(|(word, name)| format!("{word}: {}", folder.join(name).display()));
        figures.into_iter().chain(lines).collect::<Vec<_>>().join("\n")
    }
}

/// Runs a predictor on photos and writes the scene into the folder `out`.
///
/// # Errors
/// When the photos or the cameras cannot be read or do not fit together, or the output cannot be written; before any
/// work where a file is in the way.
pub fn predict_to_folder(
    predictor: &mut dyn Predictor,
    images: &[PathBuf],
    options: &PredictOptions,
    out: &OutputFolder,
) -> Result<PredictReport, Error> {
    check_prediction_folder(out, images)?;
    let [height, width] = predictor.image_size();
    let with_cameras = |file| capture::load_cameras(file, images, [width, height], options.masks);
    let mut given = options.cameras.as_deref().map(with_cameras).transpose()?;
    let mut remarks = Vec::new();
    let mut readable = images.to_vec();
    let (photos, inside): (Vec<Image>, Vec<Option<Vec<bool>>>) = match &mut given {
        Some(given) => (std::mem::take(&mut given.images), std::mem::take(&mut given.inside)),
        None => {
            let loaded = capture::load_readable_images(images, options.masks, width, height)?;
            remarks.extend(loaded.remark.map(|remark| format!("warning: {remark}")));
            readable = loaded.paths;
            loaded.images.into_iter().unzip()
        }
    };
    let inside = inside_of(inside.iter().map(Option::as_deref), height * width);
    if photos.len() == 1 {
        remarks.push(ONE_PHOTO.to_string());
    }
    let density = predictor.density(options.density)?;
    let planes = planar(&photos);
    let source = match &given {
        Some(PhotoCameras { cameras, points, .. }) => CameraSource::GivenWithPoints { cameras, points },
        None => CameraSource::Predicted,
    };
    let stream = Stream::new(options.seed, 0, "inference");
    let all = Photos { planes: &planes, inside: inside.as_deref(), height, width };
    let shown = options.looks.as_ref().map(|looks| looks.predict(predictor, all, source, stream)).transpose()?;
    let prediction = match &shown {
        Some(shown) => shown.prediction.prediction.clone(),
        None => predictor.predict(all, source, density, stream)?,
    };
    remarks.extend(how_scaled(&prediction));
    remarks.extend(prediction.remarks.iter().cloned());
    let cameras = if given.is_some() { "given" } else { "predicted" };
    let allocation = density.allocation.map_or(String::new(), |kind| format!(", allocation {kind}"));
    remarks.push(format!("cameras {cameras}{allocation}"));
    remarks.extend(prediction.view_opacity.is_some().then(|| ONE_OPACITY.to_string()));
    let renders = predictor.render(&prediction, &prediction.cameras)?;
    write(out, &readable, &photos, &renders, &prediction)?;
    write_summary(out, predictor)?;
    if let (Some(looks), Some(shown)) = (&options.looks, shown) {
        remarks.push(format!("in the light of {}, which the photos may not have", looks.from.display()));
        shown.write(predictor, out)?;
    }
    Ok(report([&photos, &renders], inside.as_deref(), &prediction, remarks, out.path()))
}

/// Remarks on the scaling of given cameras and of depth.
pub(crate) fn how_scaled(prediction: &Prediction) -> Vec<String> {
    let Some(factor) = prediction.scaled_by else { return Vec::new() };
    let used = &prediction.points_used;
    if used.iter().all(|n| *n == 0) {
        return vec![format!(
            "the given cameras' centers were scaled by {factor:.4}, so that their mean distance to camera 0 equals that of the predicted ones"
        )];
    }
    let counts: Vec<String> = used.iter().map(ToString::to_string).collect();
    vec![
        format!(
            "the given cameras' centers were scaled by {factor:.4}, so that the mean distance from camera 0 to the points that the photos see is 1"
        ),
        format!("depth was brought to the points that came with the cameras, photo by photo: {}", counts.join(", ")),
    ]
}

/// The remark on a single photo.
pub(crate) const ONE_PHOTO: &str = "warning: one photo only: depth rests on a single view";

/// The remark on a file that cannot hold opacities that depend on the view.
const ONE_OPACITY: &str = "opacities depend on the view: scene.ply has those of the mean logit over the photos' cameras, scene.safetensors all numbers";

/// The figures of a scene.
pub(crate) fn report(
    [photos, renders]: [&[Image]; 2],
    inside: Option<&[bool]>,
    prediction: &Prediction,
    remarks: Vec<String>,
    out: &Path,
) -> PredictReport {
    let psnr = |(v, (photo, render)): (usize, (&Image, &Image))| {
        let Some(inside) = inside else { return Some(metrics::psnr(&render.pixels, &photo.pixels)) };
        let pixels = photo.width * photo.height;
        let planes = [render, photo].map(|image| planar([image]));
        metrics::psnr_masked(&planes[0], &planes[1], &inside[v * pixels..][..pixels])
    };
    let measured: Vec<f64> = photos.iter().zip(renders).enumerate().filter_map(psnr).collect();
    let gaussians = prediction.gaussians.opacities.len();
    PredictReport {
        gaussians,
        gaussians_per_pixel: gaussians as f64 / prediction.counts.len() as f64,
        psnr: (!measured.is_empty()).then(|| measured.iter().sum::<f64>() / measured.len() as f64),
        remarks,
        overview: out.join("overview.png"),
    }
}

/// Writes pictures, Gaussians and cameras.
pub(crate) fn write(
    out: &OutputFolder,
    paths: &[PathBuf],
    photos: &[Image],
    renders: &[Image],
    prediction: &Prediction,
) -> Result<(), Error> {
    let names = unique_names(paths);
    let mut rows = Vec::new();
    for (v, (photo, render)) in photos.iter().zip(renders).enumerate() {
        let picture = |part: &str| out.file(format!("{part}/{}", names[v]));
        photo.write_png(picture("input")?)?;
        render.write_png(picture("render")?)?;
        depth_picture(prediction, v, photo).write_png(picture("depth")?)?;
        density_picture(prediction, v, photo).write_png(picture("experts")?)?;
        rows.push(row(photo, render, prediction, v));
    }
    stack(&rows.iter().collect::<Vec<_>>()).write_png(out.file("overview.png")?)?;
    weaver_io::write_gaussians(out.file("scene.ply")?, &prediction.gaussians.to_stored())?;
    if let Some(opacity) = &prediction.view_opacity {
        opacity.write(&prediction.gaussians, &out.file("scene.safetensors")?)?;
    }
    write_cameras(out, &names, &prediction.cameras)
}

/// Writes how the scene is drawn, for those who draw it from its file.
pub(crate) fn write_summary(out: &OutputFolder, predictor: &dyn Predictor) -> Result<(), Error> {
    let settings = predictor.raster_settings();
    let summary = serde_json::json!({
        "antialiased": settings.antialiased,
        "near": settings.near,
        "alpha_max": settings.alpha_max,
        "background": predictor.background(),
    });
    Ok(weaver_io::write_text(out.file("summary.json")?, &format!("{summary:#}\n"))?)
}

/// Writes pictures of depth, and cameras, where there are no Gaussians.
pub(crate) fn write_geometry(
    out: &OutputFolder,
    paths: &[PathBuf],
    photos: &[Image],
    prediction: &Prediction,
) -> Result<(), Error> {
    let names = unique_names(paths);
    let mut rows = Vec::new();
    for (v, (photo, name)) in photos.iter().zip(&names).enumerate() {
        let depth = depth_picture(prediction, v, photo);
        photo.write_png(out.file(format!("input/{name}"))?)?;
        depth.write_png(out.file(format!("depth/{name}"))?)?;
        rows.push(Image::mosaic(&[photo, &depth]));
    }
    stack(&rows.iter().collect::<Vec<_>>()).write_png(out.file("overview.png")?)?;
    write_cameras(out, &names, &prediction.cameras)
}

/// Writes transforms.json and a COLMAP model.
fn write_cameras(out: &OutputFolder, names: &[String], cameras: &[Camera]) -> Result<(), Error> {
    let frames = |folder: &str| -> Vec<Frame> {
        names.iter().zip(cameras).map(|(name, camera)| Frame::new(format!("{folder}{name}"), *camera)).collect()
    };
    // The network saw all of them.
    let test_filenames = Some(Vec::new());
    Transforms { frames: frames("input/"), test_filenames, ..Transforms::default() }
        .write(out.file("transforms.json")?)?;
    Model::from_frames(&frames("")).write_binary(out.files("sparse/0", Model::FILES)?)?;
    Ok(())
}

/// Checks that a folder has a place for the files that [`predict_to_folder`] writes for these photos: to be called
/// before long work.
///
/// # Errors
/// Names the first file that is not to be replaced.
pub fn check_prediction_folder(out: &OutputFolder, images: &[PathBuf]) -> Result<(), Error> {
    out.check(FILES)?;
    let names = unique_names(images);
    PARTS.iter().try_for_each(|part| out.check(names.iter().map(|name| format!("{part}/{name}"))))?;
    Ok(())
}

/// Files of a result that do not depend on the photos' names.
const FILES: [&str; 7] = [
    "transforms.json",
    "scene.ply",
    "overview.png",
    "summary.json",
    "sparse/0/cameras.bin",
    "sparse/0/images.bin",
    "sparse/0/points3D.bin",
];
/// Folders of pictures.
const PARTS: [&str; 4] = ["input", "render", "depth", "experts"];

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
