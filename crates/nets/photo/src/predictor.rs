//! The network with its weights.

use crate::{Comparison, MOST_PHOTOS, PhotoConfig, PhotoNetwork, Prior};
use std::sync::Arc;
use weaver_autograd::Params;
use weaver_geometry::Camera;
use weaver_inference::{
    CameraSource, Checkpoint, Density, Error, GivenCameras, Network, Photos, Prediction, Predictor, Pretrained,
    Resizable,
};
use weaver_kernels::random::Stream;
use weaver_router::AllocationKind;
use weaver_scene::ActivatedGaussians;
use weaver_splat::{RasterSettings, Renderer};

/// The network with its weights, ready to run without gradients.
///
/// It needs cameras with the points that their photos show ([`CameraSource::GivenWithPoints`]): photos are compared
/// around these. The budget is per pixel that is kept ([`DepthMaps::kept`](crate::DepthMaps::kept)).
#[derive(Debug)]
pub struct PhotoPredictor {
    loaded: Pretrained<PhotoNetwork>,
    allocation: AllocationKind,
    budget: f64,
    size: [usize; 2],
}

impl Network for PhotoNetwork {
    const NAME: &'static str = "photo";
    type Config = PhotoConfig;

    fn check(config: &PhotoConfig) -> Result<(), String> {
        config.check()
    }

    fn declare(config: PhotoConfig, params: &mut Params<f32>) -> Self {
        Self::declare(config, params)
    }
}

impl PhotoPredictor {
    /// Pairs a network with weights. `allocation` and `budget` are used where a call does not say otherwise.
    pub fn new(
        network: impl Into<Arc<PhotoNetwork>>,
        params: Params<f32>,
        allocation: AllocationKind,
        budget: f64,
    ) -> Self {
        let network = network.into();
        let size = [network.config().height, network.config().width];
        Self { loaded: Pretrained::new(network, params), allocation, budget, size }
    }

    /// The untrained network: the photos' colors on the depth of comparison.
    pub fn untrained(config: PhotoConfig, allocation: AllocationKind, budget: f64) -> Self {
        let mut params = Params::new();
        let network = PhotoNetwork::new(config, &mut params, 0);
        Self::new(network, params, allocation, budget)
    }

    /// Builds the network that a checkpoint describes and fills in its averaged weights.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or a tensor is missing, of another shape, or unknown.
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, Error> {
        let Pretrained { network, params, .. } = Pretrained::<PhotoNetwork>::from_checkpoint(checkpoint)?;
        let defaults = checkpoint.defaults();
        let name = defaults.allocation.as_deref().unwrap_or("quadtree");
        let allocation = name.parse::<AllocationKind>().map_err(|e| checkpoint.wrong(e.to_string()))?;
        Ok(Self::new(network, params, allocation, defaults.budget.unwrap_or(1.0)))
    }

    /// Predicts from photos with cameras and a comparison of them.
    ///
    /// # Errors
    /// When the density does not suit the model.
    pub fn predict_compared(
        &mut self,
        photos: Photos<'_>,
        cameras: &[Camera],
        comparison: &Comparison,
        density: Density,
        stream: Stream,
    ) -> Result<Prediction, Error> {
        let density = self.density(density)?;
        let kind = density.allocation.unwrap_or(self.allocation);
        let experts = self.max_per_pixel() + 1;
        let allocation = kind.allocation::<f32>(density.budget.unwrap_or(self.budget), experts)?;
        let prior = Prior::new(photos, cameras, comparison);
        self.loaded.tape.reset();
        let (network, tape, cx) = (&*self.loaded.network, &self.loaded.tape, self.loaded.context());
        Ok(tape.without_gradient(|| {
            let colors = tape.constant(photos.planes, [prior.views(), 3, photos.height, photos.width]);
            let dense = network.dense(cx, &prior, colors);
            let made = network.gaussians(cx, (&dense, &prior), colors, photos.inside, &*allocation, stream);
            let (scale, g) = (prior.scale as f32, &made.gaussians);
            let scaled = |mut lengths: Vec<f32>| {
                lengths.iter_mut().for_each(|x| *x *= scale);
                lengths
            };
            Prediction {
                gaussians: ActivatedGaussians {
                    means: scaled(g.means.to_vec()),
                    scales: scaled(g.scales.to_vec()),
                    quats: g.quats.to_vec(),
                    opacities: g.opacities.to_vec(),
                    sh: g.colors.to_vec(),
                    degree: network.config().gaussians.sh_degree,
                },
                cameras: cameras.to_vec(),
                depth: scaled(dense.log_depth.exp().to_vec()),
                counts: made.assignment.expert.to_vec(),
                density: made.assignment.density(prior.size),
                remarks: unsure(&dense.log_spread.to_vec()).into_iter().collect(),
                ..Prediction::default()
            }
        }))
    }
}

/// Mean spread of log depth above which a prediction is called unsure.
const UNSURE: f32 = 0.15;

/// A warning where the network expects large errors of depth.
fn unsure(log_spread: &[f32]) -> Option<String> {
    let mean = log_spread.iter().map(|u| u.exp()).sum::<f32>() / log_spread.len().max(1) as f32;
    (mean > UNSURE).then(|| {
        let percent = 100.0 * mean;
        format!("warning: photos agree about little: depth is expected to be wrong by {percent:.0} % in the mean")
    })
}

impl Predictor for PhotoPredictor {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        density: Density,
        stream: Stream,
    ) -> Result<Prediction, Error> {
        self.density(density)?;
        let views = photos.views();
        if !(2..=MOST_PHOTOS).contains(&views) {
            return Err(Error::Input(format!(
                "expected 2 to {MOST_PHOTOS} photos, whose depth is compared, found {views}"
            )));
        }
        GivenCameras::check(source, views)?;
        let CameraSource::GivenWithPoints { cameras, points } = source else {
            let found = if source.given().is_some() { "cameras without points" } else { "none" };
            let expected = "expected cameras with the points that their photos show, as photos are matched by";
            return Err(Error::Input(format!("{expected}, found {found}")));
        };
        let comparison = Comparison::of(photos, cameras, points)?;
        self.predict_compared(photos, cameras, &comparison, density, stream)
    }

    fn resizable(&mut self) -> Option<&mut dyn Resizable> {
        Some(self)
    }

    fn density(&self, asked: Density) -> Result<Density, Error> {
        asked.filled(self.allocation, self.budget, self.max_per_pixel())
    }

    fn needs_points(&self) -> bool {
        true
    }

    fn image_size(&self) -> [usize; 2] {
        self.size
    }

    fn max_per_pixel(&self) -> usize {
        self.loaded.network.config().gaussians.max_per_pixel
    }

    fn raster_settings(&self) -> RasterSettings {
        self.loaded.network.config().raster.settings()
    }

    fn background(&self) -> [f32; 3] {
        self.loaded.network.config().raster.background.map(|c| c as f32)
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.loaded.renderer
    }
}

impl Resizable for PhotoPredictor {
    fn resize(&mut self, size: [usize; 2]) {
        self.size = size;
    }
}
