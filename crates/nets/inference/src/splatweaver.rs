//! SplatWeaver with its weights.

use crate::{
    CameraSource, Checkpoint, Density, Error, GivenCameras, Joint, JointPrediction, Network, Photos, Prediction,
    Predictor, Pretrained, RunFolder, cameras_of, depth_to_points,
};
use std::path::Path;
use std::sync::Arc;
use weaver_autograd::{Params, Var};
use weaver_kernels::random::Stream;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_pose::CameraVars;
use weaver_router::{AllocationKind, Masked};
use weaver_scene::ActivatedGaussians;
use weaver_splat::{RasterSettings, Renderer};

/// SplatWeaver with its weights, ready to run without gradients.
#[derive(Debug)]
pub struct SplatWeaverPredictor {
    loaded: Pretrained<SplatWeaver>,
    allocation: AllocationKind,
    budget: f64,
    /// Experts that training used; empty where that is not known.
    trained: Vec<u8>,
}

impl Network for SplatWeaver {
    const NAME: &'static str = SplatWeaverPredictor::ARCHITECTURE;
    type Config = ModelConfig;

    fn check(config: &ModelConfig) -> Result<(), String> {
        config.check()
    }

    fn declare(config: ModelConfig, params: &mut Params<f32>) -> Self {
        Self::declare(config, params)
    }
}

impl SplatWeaverPredictor {
    /// The name of this model in checkpoints.
    pub const ARCHITECTURE: &str = "splatweaver";

    /// Pairs a model with weights. `allocation` and `budget` are used where a call does not say otherwise.
    pub fn new(
        model: impl Into<Arc<SplatWeaver>>,
        params: Params<f32>,
        allocation: AllocationKind,
        budget: f64,
    ) -> Self {
        Self { loaded: Pretrained::new(model, params), allocation, budget, trained: Vec::new() }
    }

    /// Says which experts the weights' training gave pixels to, so that [`Predictor::remark`] can name the others.
    #[must_use]
    pub fn with_trained_experts(self, trained: Vec<u8>) -> Self {
        Self { trained, ..self }
    }

    /// Opens the averaged weights of a training run's folder.
    ///
    /// # Errors
    /// When there is no checkpoint in the folder, or it is damaged or of another model.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self, Error> {
        Self::from_checkpoint(&Checkpoint::read(&RunFolder::at(folder.as_ref()).checkpoint_path())?)
    }

    /// The weights that come with this crate: trained on procedural scenes alone, for photos of 64 x 48 pixels with
    /// given or estimated cameras. `weights/README.md` describes how they were made, how good they are, and their
    /// limits.
    ///
    /// # Errors
    /// Never, unless the program is damaged.
    ///
    /// ```
    /// use weaver_inference::{Predictor, SplatWeaverPredictor};
    /// let predictor = SplatWeaverPredictor::built_in()?;
    /// assert_eq!(predictor.image_size(), [48, 64]);
    /// # Ok::<(), weaver_inference::Error>(())
    /// ```
    pub fn built_in() -> Result<Self, Error> {
        Self::from_checkpoint(&Checkpoint::built_in()?)
    }

    /// Builds the network that a checkpoint describes and fills in its averaged weights.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or a tensor is missing, of another shape, or unknown.
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, Error> {
        let loaded = Pretrained::from_checkpoint(checkpoint)?;
        let defaults = checkpoint.defaults();
        let name = defaults.allocation.as_deref().unwrap_or("dithered");
        let allocation = name.parse::<AllocationKind>().map_err(|e| checkpoint.wrong(e.to_string()))?;
        let (budget, trained) = (defaults.budget.unwrap_or(1.0), defaults.trained_experts.clone());
        Ok(Self { loaded, allocation, budget, trained })
    }

    /// The network.
    pub fn model(&self) -> &SplatWeaver {
        &self.loaded.network
    }

    /// Calls `watcher` with the path of each part of the model that is done.
    pub fn watch(&self, watcher: impl Fn(&str) + Send + 'static) {
        self.loaded.tape.watch(watcher);
    }

    /// Gives back the memory that the last prediction was made in.
    pub fn release(&mut self) {
        self.loaded.tape.reset();
        self.loaded.tape.pool().trim::<f32>();
    }
}

impl SplatWeaverPredictor {
    /// Predicts from the first `context` photos, while the backbone sees all of them; the cameras of the others come
    /// apart.
    fn run(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        source: CameraSource<'_>,
        density: Density,
        stream: Stream,
    ) -> Result<JointPrediction, Error> {
        let density = self.density(density)?;
        let kind = density.allocation.unwrap_or(self.allocation);
        let experts = self.max_per_pixel() + 1;
        let allocation = kind.allocation::<f32>(density.budget.unwrap_or(self.budget), experts)?;
        let Photos { planes, height, width, .. } = photos;
        let inside = photos.first(context).inside;
        let patch = self.model().config().patch;
        if planes.is_empty() || !height.is_multiple_of(patch) || !width.is_multiple_of(patch) {
            return Err(Error::Input(format!(
                "expected photos whose sides are multiples of {patch}, found {} of {width}x{height}",
                photos.views()
            )));
        }
        let views = photos.views();
        GivenCameras::check(source, context)?;
        self.loaded.tape.reset();
        let (model, tape, cx) = (&*self.loaded.network, &self.loaded.tape, self.loaded.context());
        Ok(tape.without_gradient(|| {
            let all = tape.constant(planes, [views, 3, height, width]);
            let encoded = model.encode(cx, all.reshape([1, views, 3, height, width]));
            let mut predicted = cameras_of(&encoded.cameras, photos);
            let targets = predicted.split_off(context);
            let photos = first_of(all, context);
            let given = GivenCameras::of(source, &predicted);
            let vars = match &given {
                Some(given) => self.loaded.camera_vars(&given.cameras),
                None => {
                    let CameraVars { viewmats, intrinsics } = encoded.scene_cameras(0);
                    CameraVars { viewmats: first_of(viewmats, context), intrinsics: first_of(intrinsics, context) }
                }
            };
            let mut dense = model.dense(cx, &encoded, 0, photos);
            let seen = given.as_ref().map_or(&[][..], |given| &given.seen);
            let mut points_used = Vec::new();
            if !seen.is_empty() {
                let correction = depth_to_points(&dense.depth.value(), [height, width], seen);
                dense.depth = dense.depth * tape.constant(&correction.factors(), [context, height, width]);
                points_used = correction.points;
            }
            let made = model.gaussians(cx, &dense, photos, &vars, &Masked { among: &*allocation, inside }, stream);
            let g = &made.gaussians;
            let prediction = Prediction {
                gaussians: ActivatedGaussians {
                    means: g.means.to_vec(),
                    scales: g.scales.to_vec(),
                    quats: g.quats.to_vec(),
                    opacities: g.opacities.to_vec(),
                    sh: g.colors.to_vec(),
                    degree: model.config().gaussians.sh_degree,
                },
                scaled_by: given.as_ref().and_then(|given| given.scaled_by),
                cameras: given.map_or_else(|| predicted.clone(), |given| given.cameras),
                predicted,
                depth: made.depth.to_vec(),
                counts: made.assignment.expert.to_vec(),
                density: made.assignment.density([height, width]),
                points_used,
                ..Prediction::default()
            };
            JointPrediction { prediction, targets }
        }))
    }
}

impl Predictor for SplatWeaverPredictor {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        density: Density,
        stream: Stream,
    ) -> Result<Prediction, Error> {
        Ok(self.run(photos, photos.views(), source, density, stream)?.prediction)
    }

    fn joint(&mut self) -> Option<&mut dyn Joint> {
        Some(self)
    }

    fn density(&self, asked: Density) -> Result<Density, Error> {
        asked.filled(self.allocation, self.budget, self.max_per_pixel())
    }

    fn remark(&self, density: Density) -> Option<String> {
        let kind = density.allocation.unwrap_or(self.allocation);
        let most = u8::try_from(self.max_per_pixel()).unwrap_or(u8::MAX);
        let untrained: Vec<String> = kind
            .experts(most)
            .filter(|expert| !self.trained.contains(expert))
            .map(|expert| expert.to_string())
            .collect();
        (!self.trained.is_empty() && !untrained.is_empty()).then(|| {
            format!(
                "allocation {kind} may give a pixel {} Gaussians, which these weights were never trained for: expect poor \
                 pictures; dithered, grid and random give one",
                untrained.join(" or ")
            )
        })
    }

    fn image_size(&self) -> [usize; 2] {
        let config = self.model().config();
        [config.height, config.width]
    }

    fn max_per_pixel(&self) -> usize {
        self.model().config().gaussians.max_per_pixel
    }

    fn raster_settings(&self) -> RasterSettings {
        self.model().config().raster.settings()
    }

    fn background(&self) -> [f32; 3] {
        self.model().config().raster.background.map(|c| c as f32)
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.loaded.renderer
    }
}

impl Joint for SplatWeaverPredictor {
    fn predict_jointly(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        density: Density,
        stream: Stream,
    ) -> Result<JointPrediction, Error> {
        self.run(photos, context, CameraSource::Predicted, density, stream)
    }
}

/// The rows of the first views.
fn first_of(all: Var<'_, f32>, views: usize) -> Var<'_, f32> {
    if all.shape()[0] == views { all } else { all.slice(0, 0, views) }
}
