//! A network with its weights, shared by the predictors of all models.

use crate::{Checkpoint, Error, Photos, WeightSet};
use serde::de::DeserializeOwned;
use std::fmt::Debug;
use std::sync::Arc;
use weaver_autograd::{Params, Tape};
use weaver_geometry::Camera;
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_scene::{CameraRows, CameraSlices, Model};
use weaver_splat::Renderer;

/// A network that checkpoints describe.
pub trait Network: Debug + Send + Sync + Sized {
    /// Its name in checkpoints.
    const NAME: &'static str;
    /// Its sizes and switches, as checkpoints hold them.
    type Config: DeserializeOwned;

    /// Checks a configuration that was read.
    ///
    /// # Errors
    /// The key, the expected and the found value.
    fn check(config: &Self::Config) -> Result<(), String>;

    /// Declares the parameters of a network whose weights will be loaded.
    fn declare(config: Self::Config, params: &mut Params<f32>) -> Self;
}

/// A network with its weights, a tape to run it on without gradients, and the rasterizer of its Gaussians.
#[derive(Debug)]
pub struct Pretrained<N> {
    /// The network.
    pub network: Arc<N>,
    /// Its weights.
    pub params: Params<f32>,
    /// The tape of its passes.
    pub tape: Tape<f32>,
    /// The renderer of its Gaussians.
    pub renderer: Renderer,
}

impl<N> Pretrained<N> {
    /// Pairs a network with weights.
    pub fn new(network: impl Into<Arc<N>>, params: Params<f32>) -> Self {
        Self { network: network.into(), params, tape: Tape::new(), renderer: Renderer::default() }
    }

    /// The context in which layers run.
    pub fn context(&self) -> Context<'_, '_, f32> {
        Context::new(&self.tape, &self.params)
    }

    /// Cameras `[V, 3, 4]` and `[V, 4]` as the network takes them.
    pub fn camera_vars(&self, cameras: &[Camera]) -> CameraVars<'_, f32> {
        let (rows, views) = (CameraRows::new(cameras), cameras.len());
        CameraVars {
            viewmats: self.tape.constant(&rows.viewmats, [views, 3, 4]),
            intrinsics: self.tape.constant(&rows.intrinsics, [views, 4]),
        }
    }
}

impl<N: Network> Pretrained<N> {
    /// Builds the network that a checkpoint describes and fills in its averaged weights.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or a tensor is missing, of another shape, or unknown.
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, Error> {
        let config: N::Config = checkpoint.model_config(N::NAME)?;
        N::check(&config).map_err(|message| checkpoint.wrong(message))?;
        let mut params = Params::new();
        let network = N::declare(config, &mut params);
        checkpoint.fill(&mut params, WeightSet::Averaged)?;
        Ok(Self::new(network, params))
    }
}

/// The cameras that a network says, of photos of this size.
pub fn cameras_of(said: &CameraVars<'_, f32>, photos: Photos<'_>) -> Vec<Camera> {
    let Photos { width, height, .. } = photos;
    let (viewmats, intrinsics) = (&said.viewmats.value(), &said.intrinsics.value());
    CameraSlices { viewmats, intrinsics, background: &[], width, height, model: Model::Pinhole }.to_cameras()
}
