//! Runs the published checkpoints: photos in; cameras, depth and Gaussians out.

mod estimate;
mod load;
mod photos;
mod teacher;

pub use load::{CONFIG, Network, Opened};
pub use photos::Framing;
pub use teacher::{Geometry, Teacher};

use crate::predict_to_folder::{self as folder, ONE_PHOTO, PredictReport};
use crate::{CameraSource, Density, Error, Photos, Prediction, Predictor, SplatWeaverPredictor, planar};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use weaver_autograd::Params;
use weaver_data::capture::{self, PhotoCameras};
use weaver_geometry::glam::DVec2;
use weaver_io::safetensors::Mapped;
use weaver_io::safetensors::Tensors;
use weaver_io::{Advice, Image, Observe, OutputFolder, Part, Stage};
use weaver_kernels::random::Stream;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_router::AllocationKind;
use weaver_scene::PointCloud;
use weaver_splat::{AnyRasterizer, Renderer};
use weaver_vggt::Vggt;

/// Options of a published checkpoint.
#[derive(Clone, Debug)]
pub struct Options {
    /// Height and width of the network's images; the configuration's otherwise.
    pub size: Option<[usize; 2]>,
    /// Framing of photos at that size.
    pub framing: Framing,
    /// Cameras, depth and points only, though there may be a Gaussian head.
    pub geometry: bool,
    /// Cameras of the photos, as in [`PredictOptions::cameras`](crate::PredictOptions::cameras); for networks that make
    /// Gaussians. Photos are then cut as these cameras are, and of `framing` only the size counts.
    pub cameras: Option<PathBuf>,
    /// Allocation of Gaussians to pixels, and their number: sampled from the router, as published, by default.
    pub density: Density,
    /// Seed of the router's noise.
    pub seed: u64,
    /// The rasterizer.
    pub rasterizer: AnyRasterizer<f32>,
    /// True if products with bf16 matrices round the other factor to bf16, too, where the processor is faster at that.
    pub bf16_products: bool,
}

/// Progress of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The part that is running.
    pub stage: &'static str,
    /// Work done so far, in transformer blocks of one view.
    pub done: usize,
    /// All work of the run, in transformer blocks of one view.
    pub total: usize,
}

/// Cost per view of the depth head and of the Gaussian head, in transformer blocks.
const DENSE: [usize; 2] = [7, 13];

/// Counts the finished parts of the network and reports them to `observer`. After the backbone, nine tenths of the
/// weights are no longer needed, and their pages are released.
fn watcher(
    config: &ModelConfig,
    views: usize,
    gaussians: bool,
    weights: Mapped,
    observer: impl Fn(Progress) + Send + 'static,
) -> impl Fn(&str) + Send + 'static {
    let blocks = config.backbone.encoder_depth + 2 * config.backbone.rounds;
    let dense = DENSE[0] + if gaussians { DENSE[1] } else { 0 };
    let total = views * (blocks + dense);
    let done = AtomicUsize::new(0);
    move |path: &str| {
        if path == "camera_head" {
            weights.forget();
        }
        let (stage, work) = match path {
            p if p.contains("patch_embed.blocks.") => ("patches", views),
            p if p.contains("_blocks.") => ("aggregator", views),
            "camera_head" => ("cameras", 0),
            "depth_head" => ("depth", DENSE[0]),
            "gaussian_param_head" => ("Gaussians", DENSE[1]),
            _ => return,
        };
        let done = (done.fetch_add(work, Ordering::Relaxed) + work).min(total);
        observer(Progress { stage, done, total });
    }
}

/// As [`run`], with its progress shown by an observer, which another thread calls.
///
/// # Errors
/// As [`run`].
pub fn run_observed(
    weights: &Path,
    images: &[PathBuf],
    options: &Options,
    out: &OutputFolder,
    observe: &mut (dyn Observe + Send),
    writing: impl FnOnce(),
) -> Result<PredictReport, Error> {
    const LABEL: &str = "infer";
    let (sender, receiver) = mpsc::channel::<Progress>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            for (i, Progress { stage, done, total }) in receiver.iter().enumerate() {
                if i == 0 {
                    observe.begin(&Stage { label: LABEL, done: 0, total, stops_after: None });
                }
                let _ = observe.progress(&Part { label: LABEL, done, total, note: stage.into() });
            }
        });
        let tell = move |progress| {
            // Sending fails only when the receiving thread is gone, and then there is nothing to show.
            let _ = sender.send(progress);
        };
        run(weights, images, options, out, tell, writing)
    })
}

/// Runs a checkpoint on photos and writes the results into the folder `out`. `observer` receives the progress;
/// `writing` is called once, before the first file is written.
///
/// # Errors
/// When the checkpoint or the photos cannot be read or do not fit, memory does not suffice, or the output cannot be
/// written.
pub fn run(
    weights: &Path,
    images: &[PathBuf],
    options: &Options,
    out: &OutputFolder,
    observer: impl Fn(Progress) + Send + 'static,
    writing: impl FnOnce(),
) -> Result<PredictReport, Error> {
    folder::check_prediction_folder(out, images)?;
    out.check(["points.ply", "depth.safetensors"])?;
    let opened = Opened::new(weights, !options.geometry)?;
    let config = opened.config.clone();
    let size = options.size.unwrap_or([config.height, config.width]);
    if let Some(side) = size.iter().find(|side| **side == 0 || !side.is_multiple_of(config.patch)) {
        return Err(Error::ImageSize { patch: config.patch, side: *side, source: Advice::Setting("image size") });
    }
    let size = photos::size_of(images, size, config.patch, options.framing)?;
    let gaussians = opened.has_gaussians;
    let needed = estimate::bytes(&opened, images.len(), size);
    estimate::check(needed, weaver_io::available_memory(), gaussians)?;
    let mut given = match &options.cameras {
        Some(file) if !gaussians => {
            let file = file.display();
            return Err(Error::Input(format!("cameras {file}: expected a network that makes Gaussians with them")));
        }
        file => {
            file.as_deref().map(|file| capture::load_cameras(file, images, [size[1], size[0]], false)).transpose()?
        }
    };
    let photos = match &mut given {
        Some(given) => std::mem::take(&mut given.images),
        None => photos::read(images, size, config.patch, options.framing)?,
    };
    let (network, params) = opened.load(options.bf16_products)?;
    let planes = planar(&photos);
    let watcher = watcher(&config, photos.len(), gaussians, opened.weights().clone(), observer);
    let mut remarks = vec![format!("{} photos at {}x{}", photos.len(), size[1], size[0])];
    if photos.len() == 1 {
        remarks.push(ONE_PHOTO.to_string());
    }
    let scene = Scene { paths: images, photos: &photos, planes: &planes, given: given.as_ref(), size, out };
    let mut report = match network {
        Network::SplatWeaver(model) => scene.with_gaussians(model, params, options, watcher, writing)?,
        Network::Vggt(vggt) => scene.geometry(&vggt, &params, watcher, writing)?,
    };
    remarks.append(&mut report.remarks);
    Ok(PredictReport { remarks, ..report })
}

/// The inputs of a run, and where its results go.
struct Scene<'a> {
    paths: &'a [PathBuf],
    photos: &'a [Image],
    /// The photos as the network has them, `[V, 3, H, W]`.
    planes: &'a [f32],
    /// Their cameras, where they were given.
    given: Option<&'a PhotoCameras>,
    size: [usize; 2],
    out: &'a OutputFolder,
}

impl Scene<'_> {
    /// Cameras and Gaussians.
    fn with_gaussians(
        &self,
        model: Box<SplatWeaver>,
        params: Params<f32>,
        options: &Options,
        watcher: impl Fn(&str) + Send + 'static,
        writing: impl FnOnce(),
    ) -> Result<PredictReport, Error> {
        let mut predictor = SplatWeaverPredictor::new(*model, params, AllocationKind::Sampled, PUBLISHED_BUDGET);
        *predictor.renderer() = Renderer::new(options.rasterizer.clone());
        let density = predictor.density(options.density)?;
        predictor.watch(watcher);
        let [height, width] = self.size;
        let stream = Stream::new(options.seed, 0, "inference");
        let photos = Photos { planes: self.planes, inside: None, height, width };
        let source = match self.given {
            Some(PhotoCameras { cameras, points, .. }) => CameraSource::GivenWithPoints { cameras, points },
            None => CameraSource::Predicted,
        };
        let prediction = predictor.predict(photos, source, density, stream)?;
        predictor.release();
        let renders = predictor.render(&prediction, &prediction.cameras)?;
        writing();
        folder::write(self.out, self.paths, self.photos, &renders, &prediction)?;
        folder::write_summary(self.out, &predictor)?;
        let allocation = density.allocation.unwrap_or(AllocationKind::Sampled);
        let cameras = if self.given.is_some() { "given" } else { "predicted" };
        let mut remarks = folder::how_scaled(&prediction);
        remarks.push(format!("cameras {cameras}, allocation {allocation}"));
        Ok(folder::report([self.photos, &renders], None, &prediction, remarks, self.out.path()))
    }

    /// Cameras, depth and points.
    fn geometry(
        &self,
        vggt: &Vggt,
        params: &Params<f32>,
        watcher: impl Fn(&str) + Send + 'static,
        writing: impl FnOnce(),
    ) -> Result<PredictReport, Error> {
        let ([height, width], views) = (self.size, self.photos.len());
        let Geometry { cameras, depth, confidence } = Geometry::of(vggt, params, self.planes, self.size, watcher)?;
        let prediction = Prediction { cameras: cameras.clone(), predicted: cameras, depth, ..Prediction::default() };
        writing();
        let points = self.write_points(&prediction, &confidence)?;
        folder::write_geometry(self.out, self.paths, self.photos, &prediction)?;
        let mut tensors = Tensors::default();
        tensors.insert("confidence", &[views, height, width], confidence);
        tensors.insert("depth", &[views, height, width], prediction.depth);
        tensors.write(self.out.file("depth.safetensors")?)?;
        let remarks = vec![format!("cameras, depth and {points} points; no Gaussians")];
        let overview = self.out.path().join("overview.png");
        Ok(PredictReport { gaussians: 0, gaussians_per_pixel: 0.0, psnr: None, remarks, overview })
    }

    /// Writes points.ply and returns the number of points.
    fn write_points(&self, prediction: &Prediction, confidence: &[f32]) -> Result<usize, Error> {
        let mut points = PointCloud::default();
        for (v, (photo, camera)) in self.photos.iter().zip(&prediction.cameras).enumerate() {
            let pixels = photo.width * photo.height;
            let view = &confidence[v * pixels..][..pixels];
            let threshold = weaver_kernels::order::quantile(&mut view.to_vec(), 1.0 - TRUSTED);
            for i in (0..pixels).filter(|i| view[*i] >= threshold) {
                let depth = f64::from(prediction.depth[v * pixels + i]);
                // The published networks place a pixel at its corner.
                let pixel = DVec2::new((i % photo.width) as f64, (i / photo.width) as f64);
                points.positions.push(camera.unproject(pixel, depth).as_vec3().to_array());
                points.colors.push([0, 1, 2].map(|c| (photo.pixels[3 * i + c] * 255.0).round() as u8));
            }
        }
        weaver_io::ply::write_points(self.out.file("points.ply")?, &points)?;
        Ok(points.len())
    }
}

/// Share of the pixels of each view that become points: the most confident.
const TRUSTED: f64 = 0.7;
/// The budget that the published model was trained to, for allocations that have one.
pub(crate) const PUBLISHED_BUDGET: f64 = 0.3;
