//! The interface of every trained model: photos to Gaussians, and Gaussians to pictures.

use crate::{Error, ViewOpacity};
use std::borrow::Cow;
use std::fmt;
use weaver_data::SparsePoints;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_io::{Advice, Image};
use weaver_kernels::random::Stream;
use weaver_router::AllocationKind;
use weaver_scene::ActivatedGaussians;
use weaver_splat::{RasterSettings, Renderer};

/// Photos of one size, in the layout of the networks.
#[derive(Clone, Copy, Debug)]
pub struct Photos<'a> {
    /// Colors from 0 to 1, `[V, 3, H, W]`.
    pub planes: &'a [f32],
    /// Mask `[V, H, W]` of the pixels that count; others get no Gaussians; `None` if all do.
    pub inside: Option<&'a [bool]>,
    /// Height H, pixels.
    pub height: usize,
    /// Width W, pixels.
    pub width: usize,
}

impl Photos<'_> {
    /// Number of photos V.
    pub fn views(&self) -> usize {
        self.planes.len() / (3 * self.width * self.height).max(1)
    }

    /// The first of them.
    pub fn first(self, views: usize) -> Self {
        let pixels = views * self.width * self.height;
        Self { planes: &self.planes[..3 * pixels], inside: self.inside.map(|inside| &inside[..pixels]), ..self }
    }
}

/// Source of the cameras that the Gaussians are built with.
#[derive(Clone, Copy, Debug)]
pub enum CameraSource<'a> {
    /// The network's own.
    Predicted,
    /// These, in the frame of camera 0 and in training units.
    Given(&'a [Camera]),
    /// These, in the frame of camera 0 and in units of their own: they are scaled so that the mean distance of the
    /// centers to camera 0 equals the predicted cameras'.
    GivenUnscaled(&'a [Camera]),
    /// These and the points that their photos show, in the frame of camera 0 and in units of their own: they are scaled
    /// so that the mean distance from camera 0 to the points is 1, as in training, and depth is brought to the points
    /// ([`depth_to_points`](crate::depth_to_points())). Where no photo shows a point, as
    /// [`CameraSource::GivenUnscaled`].
    GivenWithPoints {
        /// The cameras of the photos.
        cameras: &'a [Camera],
        /// The points, with a list of visible ones for each photo.
        points: &'a SparsePoints,
    },
}

impl<'a> CameraSource<'a> {
    /// The cameras that are given, in any units.
    pub fn given(self) -> Option<&'a [Camera]> {
        match self {
            Self::Predicted => None,
            Self::Given(cameras) | Self::GivenUnscaled(cameras) | Self::GivenWithPoints { cameras, .. } => {
                Some(cameras)
            }
        }
    }

    /// The same source with other cameras in place of the given ones.
    #[must_use]
    pub fn with_cameras(self, cameras: &'a [Camera]) -> Self {
        match self {
            Self::Predicted => self,
            Self::Given(_) => Self::Given(cameras),
            Self::GivenUnscaled(_) => Self::GivenUnscaled(cameras),
            Self::GivenWithPoints { points, .. } => Self::GivenWithPoints { cameras, points },
        }
    }
}

/// Allocation of Gaussians to pixels, and their number; `None` leaves the choice to the predictor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Density {
    /// Allocation of Gaussians to pixels.
    pub allocation: Option<AllocationKind>,
    /// Gaussians per pixel, for allocations that have a budget.
    pub budget: Option<f64>,
}

impl Density {
    /// This density with gaps filled by `allocation` and, where that has one, `budget`; checked for a model of at most
    /// `most` Gaussians per pixel.
    ///
    /// # Errors
    /// When the model has no such allocation, or the allocation has no budget.
    pub fn filled(self, allocation: AllocationKind, budget: f64, most: usize) -> Result<Self, Error> {
        let allocation = self.allocation.unwrap_or(allocation);
        match self.budget {
            Some(budget) if !allocation.has_budget() => {
                Err(Error::NoBudget { allocation, budget, source: Advice::Setting("budget") })
            }
            asked => {
                let budget = asked.or_else(|| allocation.has_budget().then_some(budget));
                allocation.allocation::<f32>(budget.unwrap_or(0.0), most + 1)?;
                Ok(Self { allocation: Some(allocation), budget })
            }
        }
    }
}

/// The prediction of a model from some photos.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// The Gaussians, in the frame of camera 0.
    pub gaussians: ActivatedGaussians,
    /// Their opacities, where these depend on the view; the Gaussians' own opacities then have the mean logit over the
    /// cameras.
    pub view_opacity: Option<ViewOpacity>,
    /// The cameras that the Gaussians were built with: the network's, or the given ones.
    pub cameras: Vec<Camera>,
    /// The network's own cameras; empty for a model that predicts none.
    pub predicted: Vec<Camera>,
    /// Depth along the optical axis `[V, H, W]`.
    pub depth: Vec<f32>,
    /// Gaussians of each pixel `[V, H, W]`; a cell's are counted at its first pixel.
    pub counts: Vec<u8>,
    /// Gaussians per pixel around each pixel `[V, H, W]`: of a cell, its number over its pixels.
    pub density: Vec<f32>,
    /// The factor that given cameras in units of their own were multiplied by.
    pub scaled_by: Option<f64>,
    /// For each view, how many points its depth was brought to; empty where cameras came without points.
    pub points_used: Vec<usize>,
    /// Remarks of the model on its own prediction, such as that it is unsure of depth.
    pub remarks: Vec<String>,
}

impl Prediction {
    /// The Gaussians as a camera sees them.
    pub fn seen_by(&self, camera: &Camera) -> Cow<'_, ActivatedGaussians> {
        ViewOpacity::of(self.view_opacity.as_ref(), &self.gaussians, camera)
    }

    /// The factor that gives cameras in units of their own the predicted cameras' mean distance to camera 0; 1 where
    /// nothing was predicted or a camera stands still.
    pub fn scale_to_predicted(&self, cameras: &[Camera]) -> f64 {
        self.scaled_by.unwrap_or_else(|| spread_ratio(&self.predicted, cameras))
    }

    /// The factor that gives cameras the mean distance to camera 0 of those that the Gaussians were built with; 1 where
    /// either stand still.
    pub fn scale_to_used(&self, cameras: &[Camera]) -> f64 {
        spread_ratio(&self.cameras, cameras)
    }
}

/// A prediction from some photos, and where further ones were taken.
#[derive(Clone, Debug)]
pub struct JointPrediction {
    /// The prediction from the first photos.
    pub prediction: Prediction,
    /// The cameras of the others, in the same frame.
    pub targets: Vec<Camera>,
}

/// The light that a place is shown in, for models of light.
#[derive(Clone, Copy, Debug)]
pub enum Look<'a> {
    /// No light is given.
    Unknown,
    /// The light of a photo.
    Of(Photos<'a>),
    /// Between the light of two photos: a part of the second, 0 to 1.
    Between(Photos<'a>, Photos<'a>, f32),
}

/// A prediction, and its Gaussians' colors in different light.
#[derive(Clone, Debug)]
pub struct LookPrediction {
    /// The Gaussians, with the first look's colors.
    pub prediction: Prediction,
    /// For each look, colors as [`ActivatedGaussians::sh`] has them.
    pub colors: Vec<Vec<f32>>,
}

/// A trained model with its weights.
///
/// A predictor owns all its data, so that a server or a binding to another language can hold one for as long as it
/// likes. Predictions are the same bits at any number of threads.
pub trait Predictor: fmt::Debug + Send {
    /// Predicts the Gaussians of a scene from its photos. `stream` feeds allocations that draw random numbers.
    ///
    /// # Errors
    /// When the photos' size or number, the cameras or the density do not suit the model.
    fn predict(
        &mut self,
        photos: Photos<'_>,
        cameras: CameraSource<'_>,
        density: Density,
        stream: Stream,
    ) -> Result<Prediction, Error>;

    /// The same model as a [`Joint`] one, if it is.
    fn joint(&mut self) -> Option<&mut dyn Joint> {
        None
    }

    /// The same model as a model of light, if it is one.
    fn lights(&mut self) -> Option<&mut dyn Lights> {
        None
    }

    /// The same model as one for photos of any size, if it is one.
    fn resizable(&mut self) -> Option<&mut dyn Resizable> {
        None
    }

    /// The density that [`Predictor::predict`] would use for this request: gaps filled, the whole checked. Both fields
    /// are `None` for a model without that choice.
    ///
    /// # Errors
    /// When the model has no such allocation, or the allocation has no budget.
    fn density(&self, asked: Density) -> Result<Density, Error> {
        match asked {
            Density { allocation: None, budget: None } => Ok(asked),
            _ => Err(Error::Input("this model does not let the number of Gaussians be chosen".into())),
        }
    }

    /// A warning before predictions with this density, such as that its weights were never trained for it.
    fn remark(&self, _density: Density) -> Option<String> {
        None
    }

    /// True if given cameras must come with the points that their photos show
    /// ([`CameraSource::GivenWithPoints`]).
    fn needs_points(&self) -> bool {
        false
    }

    /// Height and width that the model was trained at, pixels.
    fn image_size(&self) -> [usize; 2];

    /// The most Gaussians that a pixel can get.
    fn max_per_pixel(&self) -> usize {
        1
    }

    /// Settings of drawing the model's Gaussians.
    fn raster_settings(&self) -> RasterSettings {
        RasterSettings::default()
    }

    /// The color where nothing is.
    fn background(&self) -> [f32; 3] {
        [1.0; 3]
    }

    /// The renderer of Gaussians; another one may be put in its place.
    fn renderer(&mut self) -> &mut Renderer;

    /// Renders a prediction with the model's settings: one image per camera, values clamped to [0, 1].
    ///
    /// # Errors
    /// When sizes do not fit or there are too many Gaussians for one call.
    fn render(&mut self, prediction: &Prediction, cameras: &[Camera]) -> Result<Vec<Image>, Error> {
        let (background, settings) = (self.background(), self.raster_settings());
        // All cameras in one drawing, but where each sees other opacities.
        let at_once = if prediction.view_opacity.is_some() { 1 } else { cameras.len().max(1) };
        let mut rendered = Vec::with_capacity(cameras.len());
        for cameras in cameras.chunks(at_once) {
            let seen = prediction.seen_by(&cameras[0]);
            rendered.extend(self.renderer().render(&seen, cameras, background, &settings)?);
        }
        let image = |(mut pixels, camera): (Vec<f32>, &Camera)| {
            pixels.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
            Image { width: camera.width, height: camera.height, pixels }
        };
        Ok(rendered.into_iter().zip(cameras).map(image).collect())
    }
}

/// A model that also predicts the cameras of further photos, beside the ones that its Gaussians are made of.
pub trait Joint {
    /// Predicts the Gaussians of a scene from the first `context` photos, and the cameras of all of them at once: the
    /// model has then seen the photos that its pictures are compared with, though they affect the Gaussians through the
    /// cameras alone.
    ///
    /// # Errors
    /// As [`Predictor::predict`].
    fn predict_jointly(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        density: Density,
        stream: Stream,
    ) -> Result<JointPrediction, Error>;
}

/// A model that takes photos of any size.
pub trait Resizable {
    /// Takes photos of this height and width from now on.
    fn resize(&mut self, size: [usize; 2]);
}

/// A model of light. By default, [`Predictor::predict`] shows a place in the light of the first photo.
pub trait Lights {
    /// Predicts the Gaussians of a scene once, and their colors under each of some looks, at least one.
    ///
    /// # Errors
    /// As [`Predictor::predict`], and for photos of a look that do not suit the model.
    fn predict_looks(
        &mut self,
        photos: Photos<'_>,
        cameras: CameraSource<'_>,
        looks: &[Look<'_>],
        stream: Stream,
    ) -> Result<LookPrediction, Error>;
}

impl dyn Predictor + '_ {
    /// The model as a [`Joint`] one.
    ///
    /// # Errors
    /// For models that do not.
    pub fn as_joint(&mut self) -> Result<&mut dyn Joint, Error> {
        self.joint().ok_or_else(|| Error::Input("this model does not say where further photos were taken".into()))
    }

    /// The model as a model of light.
    ///
    /// # Errors
    /// For models that do not.
    pub fn as_lights(&mut self) -> Result<&mut dyn Lights, Error> {
        self.lights().ok_or_else(|| Error::Input("this model does not know about light: it has no looks".into()))
    }
}

/// Mean distance of the centers to camera 0: predicted over given. 1 where either stands still.
pub(crate) fn spread_ratio(predicted: &[Camera], given: &[Camera]) -> f64 {
    let spread = |cameras: &[Camera]| -> f64 {
        let origin = cameras.first().map_or(DVec3::ZERO, |c| c.pose.center());
        cameras.iter().map(|c| c.pose.center().distance(origin)).sum()
    };
    let ratio = spread(predicted) / spread(given);
    if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 }
}

/// Mask `[V, H, W]` of the pixels that count, joined from each view's; `None` if all do.
pub(crate) fn inside_of<'a>(
    views: impl Iterator<Item = Option<&'a [bool]>> + Clone,
    pixels: usize,
) -> Option<Vec<bool>> {
    let mut all = views.clone().any(|inside| inside.is_some()).then(Vec::new)?;
    views.for_each(|inside| match inside {
        Some(inside) => all.extend(inside),
        None => all.resize(all.len() + pixels, true),
    });
    Some(all)
}

/// Images of one size as planes `[V, 3, H, W]`, as [`Photos`] have them.
///
/// ```
/// use weaver_inference::planar;
/// use weaver_io::{Advice, Image};
/// let image = Image { width: 2, height: 1, pixels: vec![0.1, 0.2, 0.3, 0.4, 0.5, 0.6] };
/// assert_eq!(planar([&image]), [0.1, 0.4, 0.2, 0.5, 0.3, 0.6]);
/// ```
pub fn planar<'a>(images: impl IntoIterator<Item = &'a Image>) -> Vec<f32> {
    let mut planes = Vec::new();
    for image in images {
        (0..3).for_each(|channel| planes.extend(image.pixels.iter().skip(channel).step_by(3)));
    }
    planes
}
