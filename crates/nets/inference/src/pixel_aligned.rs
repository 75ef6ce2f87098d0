//! The predictor of any network that makes one Gaussian of every pixel, with cameras that are given.

use crate::{CameraSource, Density, Error, GivenCameras, Photos, Prediction, Predictor, Pretrained};
use std::fmt::Debug;
use std::sync::Arc;
use weaver_autograd::{Params, Var};
use weaver_kernels::random::Stream;
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_scene::ActivatedGaussians;
use weaver_splat::{GaussianVars, Renderer};

/// Output of such a network for V photos.
#[derive(Clone, Copy, Debug)]
pub struct PixelAligned<'t> {
    /// Depth along the optical axis `[V, H, W]`.
    pub depth: Var<'t, f32>,
    /// A Gaussian for each pixel, V H W of them, in the frame of the cameras.
    pub gaussians: GaussianVars<'t, f32>,
}

/// A network that turns photos and their cameras into one Gaussian for every pixel.
pub trait PixelAlignedNetwork: Debug + Send + Sync {
    /// Height and width of the photos, pixels.
    fn image_size(&self) -> [usize; 2];

    /// Runs the network on photos `[V, 3, H, W]` in [0, 1] that `cameras` took.
    fn forward<'t>(
        &self,
        cx: Context<'t, '_, f32>,
        photos: Var<'t, f32>,
        cameras: &CameraVars<'t, f32>,
    ) -> PixelAligned<'t>;
}

/// A [`PixelAlignedNetwork`] with its weights, ready to run without gradients. It needs given cameras; where these come
/// with points, the points set their scale, and depth stays the network's own.
#[derive(Debug)]
pub struct PixelAlignedPredictor<N>(Pretrained<N>);

impl<N: PixelAlignedNetwork> PixelAlignedPredictor<N> {
    /// Pairs a network with weights.
    pub fn new(network: Arc<N>, params: Params<f32>) -> Self {
        Self(Pretrained::new(network, params))
    }
}

impl<N: PixelAlignedNetwork> Predictor for PixelAlignedPredictor<N> {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        density: Density,
        _stream: Stream,
    ) -> Result<Prediction, Error> {
        self.density(density)?;
        let (views, size) = (photos.views(), [photos.height, photos.width]);
        let [height, width] = self.0.network.image_size();
        if views == 0 || size != [height, width] {
            let found = format!("{views} of {}x{}", photos.width, photos.height);
            return Err(Error::Input(format!("expected photos of {width}x{height} pixels, found {found}")));
        }
        GivenCameras::check(source, views)?;
        let Some(GivenCameras { cameras, scaled_by, .. }) = GivenCameras::of(source, &[]) else {
            return Err(Error::Input("expected given cameras, for this model predicts none, found none".into()));
        };
        let inside = photos.inside;
        self.0.tape.reset();
        let tape = &self.0.tape;
        Ok(tape.without_gradient(|| {
            let photos = tape.constant(photos.planes, [views, 3, height, width]);
            let vars = self.0.camera_vars(&cameras);
            let PixelAligned { depth, gaussians: g } = self.0.network.forward(self.0.context(), photos, &vars);
            let [means, scales, quats, opacities, sh] =
                [g.means, g.scales, g.quats, g.opacities, g.colors].map(|x| x.to_vec());
            let degree = g.colors.shape()[1].isqrt() - 1;
            let gaussians = ActivatedGaussians { means, scales, quats, opacities, sh, degree };
            Prediction { cameras, scaled_by, ..one_for_each(gaussians, depth.to_vec(), inside) }
        }))
    }

    fn image_size(&self) -> [usize; 2] {
        self.0.network.image_size()
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.0.renderer
    }
}

/// The prediction of one Gaussian for each pixel, of those pixels that count; its cameras are still missing.
pub fn one_for_each(mut gaussians: ActivatedGaussians, depth: Vec<f32>, inside: Option<&[bool]>) -> Prediction {
    let mut counts = vec![1; depth.len()];
    if let Some(inside) = inside {
        counts.iter_mut().zip(inside).for_each(|(count, inside)| *count = u8::from(*inside));
        let ActivatedGaussians { means, scales, quats, opacities, sh, .. } = &mut gaussians;
        for rows in [means, scales, quats, opacities, sh] {
            *rows = of_pixels(rows, inside);
        }
    }
    let density = counts.iter().map(|count| f32::from(*count)).collect();
    Prediction { gaussians, depth, counts, density, ..Prediction::default() }
}

/// The rows of pixels that count.
pub fn of_pixels(rows: &[f32], inside: &[bool]) -> Vec<f32> {
    let width = rows.len() / inside.len().max(1);
    let kept = rows.chunks(width.max(1)).zip(inside).filter(|(_, inside)| **inside);
    kept.flat_map(|(row, _)| row.iter().copied()).collect()
}
