//! A built-in scene as Gaussians, with its truth.

use super::gaussians::{Labeled, fitted, id, predicted, surface};
use crate::Maps;
use weaver_command::Failure;
use weaver_data::Scene;
use weaver_geometry::Camera;
use weaver_inference::Predictor;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::ActivatedGaussians;
use weaver_splat::RasterSettings;

/// Size of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    pub photos: ProceduralOptions,
    /// Stride of the splats in every second view, pixels.
    pub step: usize,
}

impl Size {
    /// Nine photos to lift from, three to judge by, some 12,000 splats.
    pub const DEMO: Self = Self { photos: ProceduralOptions { width: 192, height: 144, views: 12 }, step: 3 };
}

/// Source of the Gaussians.
#[derive(Debug)]
pub enum Source {
    /// The scene's surfaces.
    Surface,
    /// A trained network.
    Predicted(Box<dyn Predictor>),
    /// A short fit.
    Fitted,
}

/// Cameras, with the truth of their pixels.
pub struct Views {
    pub cameras: Vec<Camera>,
    /// The thing at each pixel, 0 for the sky.
    pub ids: Vec<Vec<u32>>,
}

pub struct Stage {
    pub splats: ActivatedGaussians,
    /// The thing of each splat.
    pub labels: Vec<u32>,
    /// Number of things, and the sky.
    pub classes: usize,
    pub training: Views,
    pub held_out: Views,
    pub settings: RasterSettings,
}

impl Stage {
    pub fn new(seed: u64, Size { photos, step }: Size, source: &mut Source) -> Result<Self, Failure> {
        let scene = scene(seed, &photos);
        let mut settings = RasterSettings::default();
        let Labeled { gaussians: splats, labels } = match source {
            Source::Surface => surface(&scene, seed, step),
            Source::Predicted(predictor) => {
                settings = predictor.raster_settings();
                predicted(&mut **predictor, seed, photos.views)?
            }
            Source::Fitted => fitted(&scene, seed)?,
        };
        let [training, held_out] = [scene.training_views(), scene.held_out_views()].map(|which| views(&scene, &which));
        let most = training.ids.iter().chain(&held_out.ids).flatten().max().copied().unwrap_or(0);
        Ok(Self { splats, labels, classes: most as usize + 1, training, held_out, settings })
    }

    /// One channel per thing, 1 at its pixels.
    pub fn one_hot(&self) -> Maps<f32> {
        let views = self.training.ids.iter().map(|ids| one_hot(ids, self.classes)).collect();
        Maps { views, channels: self.classes }
    }
}

fn views(scene: &Scene, which: &[usize]) -> Views {
    let views = || which.iter().map(|v| &scene.views[*v]);
    let ids = views().map(|view| (0..view.camera.width * view.camera.height).map(|pixel| id(view, pixel)).collect());
    Views { cameras: views().map(|view| view.camera).collect(), ids: ids.collect() }
}

/// `[N, classes]`
pub fn one_hot(labels: &[u32], classes: usize) -> Vec<f32> {
    let mut rows = vec![0.0; labels.len() * classes];
    labels.iter().enumerate().for_each(|(i, label)| rows[i * classes + *label as usize] = 1.0);
    rows
}
