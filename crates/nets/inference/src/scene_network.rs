//! Networks that are predictors as they are: the shared part of their predictors.

use crate::{
    CameraSource, Density, Error, Joint, JointPrediction, Lights, Look, LookPrediction, Network, Photos, Prediction,
    Predictor, Pretrained,
};
use weaver_kernels::random::Stream;
use weaver_model::RasterConfig;
use weaver_splat::{RasterSettings, Renderer};

/// A network that predicts cameras and Gaussians of photos, without a choice of how many: with its weights, it is a
/// [`Predictor`].
pub trait SceneNetwork: Network {
    /// Height and width that it was trained at, pixels.
    fn image_size(&self) -> [usize; 2];

    /// Settings of drawing its Gaussians.
    fn raster(&self) -> &RasterConfig;

    /// Predicts from the first `context` photos, while cameras are predicted of all of them.
    ///
    /// # Errors
    /// When the photos' size or number, or the cameras, do not suit the network.
    fn run(
        model: &mut Pretrained<Self>,
        photos: Photos<'_>,
        context: usize,
        source: CameraSource<'_>,
    ) -> Result<JointPrediction, Error>;

    /// The same network as a model of light, if it is one.
    fn lights(_model: &mut Pretrained<Self>) -> Option<&mut dyn Lights> {
        None
    }
}

impl<N: SceneNetwork> Predictor for Pretrained<N> {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        density: Density,
        _stream: Stream,
    ) -> Result<Prediction, Error> {
        self.density(density)?;
        Ok(N::run(self, photos, photos.views(), source)?.prediction)
    }

    fn joint(&mut self) -> Option<&mut dyn Joint> {
        Some(self)
    }

    fn lights(&mut self) -> Option<&mut dyn Lights> {
        N::lights(self)
    }

    fn image_size(&self) -> [usize; 2] {
        self.network.image_size()
    }

    fn raster_settings(&self) -> RasterSettings {
        self.network.raster().settings()
    }

    fn background(&self) -> [f32; 3] {
        self.network.raster().background.map(|c| c as f32)
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }
}

impl<N: SceneNetwork> Joint for Pretrained<N> {
    fn predict_jointly(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        density: Density,
        _stream: Stream,
    ) -> Result<JointPrediction, Error> {
        self.density(density)?;
        N::run(self, photos, context, CameraSource::Predicted)
    }
}

/// A [`SceneNetwork`] that makes one geometry and its colors in the light of any photo.
pub trait LitNetwork: SceneNetwork {
    /// Predicts the Gaussians of photos once, and their colors under each of some looks, at least one.
    ///
    /// # Errors
    /// As [`SceneNetwork::run`], and for photos of a look that do not suit the network.
    fn run_lit(
        model: &mut Pretrained<Self>,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        looks: &[Look<'_>],
    ) -> Result<LookPrediction, Error>;
}

impl<N: LitNetwork> Lights for Pretrained<N> {
    fn predict_looks(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        looks: &[Look<'_>],
        _stream: Stream,
    ) -> Result<LookPrediction, Error> {
        N::run_lit(self, photos, source, looks)
    }
}
