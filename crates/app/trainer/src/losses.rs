//! The loss of a step: its terms by name, and the losses that models share.

use crate::example::{Example, rotation_row, translation_row};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;
use std::path::{Path, PathBuf};
use weaver_autograd::{List, Shape, Var, ops};
use weaver_geometry::{Camera, pose_code};
use weaver_inference::Photos;
use weaver_losses::{self as losses, Lpips, Perceptual};
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_scene::{intrinsics_row, viewmat};

/// Number of terms that are kept without allocating.
const MOST_TERMS: usize = 12;

/// One loss: a sum over tuples, each with the weight `share`.
#[derive(Debug)]
struct Term<'t> {
    name: &'static str,
    weight: f64,
    share: f64,
    sum: Var<'t, f32>,
}

/// The terms of a loss, by name.
#[derive(Debug, Default)]
pub struct Terms<'t> {
    terms: SmallVec<[Term<'t>; MOST_TERMS]>,
    /// Gaussians per context pixel; 0 in a stage that renders nothing.
    pub gaussians_per_pixel: f32,
}

impl<'t> Terms<'t> {
    /// Adds one tuple's loss, which counts `share` in the mean, unless its weight is 0; `value` is not computed then.
    pub fn add(&mut self, name: &'static str, weight: f64, share: f64, value: impl FnOnce() -> Var<'t, f32>) {
        if weight != 0.0 {
            let value = value();
            match self.terms.iter_mut().find(|term| term.name == name) {
                Some(term) => term.sum = term.sum + value,
                None => self.terms.push(Term { name, weight, share, sum: value }),
            }
        }
    }

    /// The weighted sum; `None` without terms.
    pub fn total(&self) -> Option<Var<'t, f32>> {
        self.terms.iter().map(|term| term.sum * (term.weight * term.share)).reduce(|a, b| a + b)
    }

    /// Names and means over the tuples, before weights.
    pub fn values(&self) -> impl Iterator<Item = (&'static str, f32)> {
        self.terms.iter().map(|term| (term.name, term.sum.item() * term.share as f32))
    }
}

/// Losses on rendered images against photos.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImageLosses {
    /// Weight of the mean squared error of the renders.
    #[schemars(range(min = 0.0))]
    pub mse: f64,
    /// Weight of (1 - SSIM) / 2 of the renders.
    #[schemars(range(min = 0.0))]
    pub ssim: f64,
    /// Weight of LPIPS of the renders; needs `lpips_weights`.
    #[schemars(range(min = 0.0))]
    pub lpips: f64,
    /// File with the VGG or AlexNet weights of LPIPS.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lpips_weights: Option<PathBuf>,
    /// Weight of absolute differences in the features of VGG-19, as 2Xplat is published (0.2); needs
    /// `perceptual_weights`.
    #[schemars(range(min = 0.0))]
    pub perceptual: f64,
    /// File with MatConvNet's weights of VGG-19 under torchvision's names.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub perceptual_weights: Option<PathBuf>,
}

/// The networks that compare renders with photos, where a stage needs them.
#[derive(Debug, Default)]
pub struct ImageNetworks {
    /// The network of LPIPS.
    pub lpips: Option<Lpips<f32>>,
    /// The network of the perceptual loss.
    pub perceptual: Option<Perceptual<f32>>,
}

impl ImageLosses {
    /// Adds the losses of one tuple's renders `image` against `truth`, both `[V, 3, H, W]`; the tuple counts `share`.
    /// The render counts as exact at pixels outside of the mask (`inside` `[V, H, W]`), and losses are per pixel
    /// inside.
    pub fn add<'t>(
        &self,
        terms: &mut Terms<'t>,
        share: f64,
        networks: &ImageNetworks,
        [image, truth]: [Var<'t, f32>; 2],
        inside: Option<&[bool]>,
    ) {
        let image = inside.map_or(image, |inside| right_outside(image, truth, inside));
        let per_pixel = |loss: Var<'t, f32>| match inside {
            Some(inside) => loss * (inside.len() as f64 / inside.iter().filter(|i| **i).count().max(1) as f64),
            None => loss,
        };
        terms.add("mse", self.mse, share, || per_pixel(losses::mse(image, truth)));
        terms.add("ssim", self.ssim, share, || per_pixel((losses::ssim(image, truth).mean() * -1.0 + 1.0) * 0.5));
        if let Some(lpips) = &networks.lpips {
            terms.add("lpips", self.lpips, share, || per_pixel(lpips.distance(image, truth).mean()));
        }
        if let Some(perceptual) = &networks.perceptual {
            terms.add("perceptual", self.perceptual, share, || per_pixel(perceptual.loss(image, truth)));
        }
    }

    /// The weights of all terms by their keys.
    pub fn weights(&self) -> [(&'static str, f64); 4] {
        [
            ("image.mse", self.mse),
            ("image.ssim", self.ssim),
            ("image.lpips", self.lpips),
            ("image.perceptual", self.perceptual),
        ]
    }

    /// The files of networks, by their keys, of terms that have a weight.
    pub fn files(&self) -> [(&'static str, Option<&Path>); 2] {
        [
            ("lpips_weights", self.lpips_weights.as_deref().filter(|_| self.lpips > 0.0)),
            ("perceptual_weights", self.perceptual_weights.as_deref().filter(|_| self.perceptual > 0.0)),
        ]
    }

    /// Checks that networks have files; `key` is where the weights are in the configuration.
    ///
    /// # Errors
    /// When a term has a weight and its network no file.
    pub fn check(&self, key: &str) -> Result<(), String> {
        for (name, weight, file) in
            [("lpips", self.lpips, &self.lpips_weights), ("perceptual", self.perceptual, &self.perceptual_weights)]
        {
            if weight > 0.0 && file.is_none() {
                return Err(format!("{key}.{name}_weights: expected a file, since {name} is not 0, found nothing"));
            }
        }
        Ok(())
    }
}

/// Losses on predicted cameras against those of the data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PoseLosses {
    /// Weight of the L1 distance of translation, quaternion and field of view of the emitted cameras.
    #[schemars(range(min = 0.0))]
    pub l1: f64,
    /// Weight of the Huber loss on the pose codes over all iterations, as published.
    #[schemars(range(min = 0.0))]
    pub huber: f64,
    /// Weight of the mean angle in radians between the predicted and the true rotation from one camera to another, over
    /// all pairs.
    #[schemars(range(min = 0.0))]
    pub rotation: f64,
    /// Weight of the Huber loss (0.1) on the translation from one camera to another, over all pairs.
    #[schemars(range(min = 0.0))]
    pub translation: f64,
    /// Weight of the squared error of the focal lengths in image widths.
    #[schemars(range(min = 0.0))]
    pub focal: f64,
    /// Weight of the L1 distance of the codes, before they are made relative to the first camera, to the cameras in the
    /// scene's own frame; off with endless scenes, which do not come back.
    #[schemars(range(min = 0.0))]
    pub absolute: f64,
}

/// Output of a camera head: for each refinement, pose codes `[B, V, 9]`, and the cameras of the last one.
#[derive(Clone, Copy, Debug)]
pub struct PoseCodes<'a, 't> {
    /// The cameras of the last refinement: viewmats `[B, V, 3, 4]`, intrinsics `[B, V, 4]`.
    pub cameras: CameraVars<'t>,
    /// The codes as the head emits them.
    pub emitted: &'a List<Var<'t, f32>>,
    /// The codes in the frame of the network's own choice.
    pub raw: &'a List<Var<'t, f32>>,
}

impl PoseLosses {
    /// 2Xplat's published weights for the poses of pairs, on top of the distance of pose codes, which teaches cameras
    /// from scratch.
    pub fn relative(absolute: f64) -> Self {
        Self { l1: 2.0, absolute, rotation: 0.1, translation: 10.0, focal: 0.5, ..Self::default() }
    }

    /// The sum of the weights; 0 trains no cameras.
    pub fn sum(&self) -> f64 {
        self.l1 + self.huber + self.absolute + self.rotation + self.translation + self.focal
    }

    /// Adds the losses of the examples' cameras, for as many views as there are codes: the context's, or the targets'
    /// as well. Poses in the scene's own frame exist for the context alone.
    pub fn add<'t>(
        &self,
        terms: &mut Terms<'t>,
        cx: Context<'t, '_, f32>,
        codes: PoseCodes<'_, 't>,
        examples: &[Example],
    ) {
        let shape = codes.emitted[0].shape();
        let [scenes, views] = [shape[0], shape[1]];
        let code = |camera: &Camera| pose_code::encode(camera).map(|x| x as f32);
        let true_cameras = || examples.iter().flat_map(|e| &e.cameras[..views]);
        let truth = || rows(cx, true_cameras().map(code), shape);
        terms.add("pose", self.l1, 1.0, || losses::l1_pose(codes.emitted, truth()));
        terms.add("pose_huber", self.huber, 1.0, || {
            let truth = truth();
            let teacher: List<_> = codes.emitted.iter().map(|_| truth).collect();
            losses::huber_pose(codes.emitted, &teacher, 1.0)
        });
        let CameraVars { viewmats, intrinsics } = codes.cameras;
        let true_viewmats = || rows(cx, true_cameras().map(|c| viewmat(&c.pose)), [scenes, views, 3, 4]);
        terms.add("pose_rotation", self.rotation, 1.0, || {
            let [[found, _], [truth, _]] = [viewmats, true_viewmats()].map(weaver_pose::relative_poses);
            losses::rotation_angles(found, truth).mean()
        });
        terms.add("pose_translation", self.translation, 1.0, || {
            let [[_, found], [_, truth]] = [viewmats, true_viewmats()].map(weaver_pose::relative_poses);
            ops::huber(found, truth, 0.1).mean()
        });
        terms.add("pose_focal", self.focal, 1.0, || {
            let truth = rows(cx, true_cameras().map(intrinsics_row), [scenes, views, 4]);
            losses::focal_error(intrinsics, truth, examples[0].cameras[0].width)
        });
        terms.add("pose_absolute", self.absolute, 1.0, || {
            let poses = || examples.iter().flat_map(|e| &e.absolute);
            let context = examples[0].context().len();
            let rotations = rows(cx, poses().map(rotation_row), [scenes, context, 3, 3]);
            let translations = rows(cx, poses().map(translation_row), [scenes, context, 3]);
            let of_context = |first: usize, count: usize| {
                codes.raw.iter().map(move |c| c.slice(1, 0, context).slice(2, first, count))
            };
            let own_rotations: List<_> = of_context(3, 4).map(weaver_pose::rotation_from_xyzw).collect();
            let own_translations: List<_> = of_context(0, 3).collect();
            losses::absolute_pose(&own_rotations, &own_translations, rotations, translations)
        });
    }
}

/// Losses on depth where the data knows it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DepthLosses {
    /// Weight of the L1 distance of the logarithms of predicted and known depth.
    #[schemars(range(min = 0.0))]
    pub log_l1: f64,
    /// Weight of the squared error of the rendered depth, as published.
    #[schemars(range(min = 0.0))]
    pub rendered: f64,
}

impl DepthLosses {
    /// Adds the loss of predicted `depth` `[C, H, W]` against `known`, 0 where unknown.
    pub fn add_predicted<'t>(&self, terms: &mut Terms<'t>, share: f64, depth: Var<'t, f32>, known: Var<'t, f32>) {
        terms.add("depth", self.log_l1, share, || losses::sparse_log_depth_l1(depth.ln(), known, 1.0));
    }

    /// Adds the loss of the rendered `depth` `[V, H, W]`, with the context as the first C views.
    pub fn add_rendered<'t>(
        &self,
        terms: &mut Terms<'t>,
        cx: Context<'t, '_, f32>,
        share: f64,
        depth: impl FnOnce() -> Var<'t, f32>,
        example: &Example,
    ) {
        terms.add("rendered_depth", self.rendered, share, || {
            let depth = depth();
            let views = example.context().len();
            let own = depth.slice(0, 0, views);
            let known = cx.tape.constant(&example.depth, own.shape());
            // The published loss trusts a teacher's depth by its confidence. Known depth has none: near depth is
            // trusted most, unknown depth not at all.
            let confidence = example.depth.iter().map(|d| [if *d > 0.0 { 1.0 / d } else { 0.0 }]);
            losses::masked_depth_mse(own, known, rows(cx, confidence, known.shape()), 0.3)
        });
    }
}

/// An image `[V, 3, H, W]` where `inside` `[V, H, W]`, and `truth` elsewhere.
fn right_outside<'t>(image: Var<'t, f32>, truth: Var<'t, f32>, inside: &[bool]) -> Var<'t, f32> {
    let shape = image.shape();
    let pixels = shape[2] * shape[3];
    let weights = image.tape().constant_with(shape, |all| {
        for (planes, inside) in all.chunks_mut(3 * pixels).zip(inside.chunks(pixels)) {
            planes.iter_mut().enumerate().for_each(|(i, x)| *x = f32::from(inside[i % pixels]));
        }
    });
    image * weights + truth * (weights * -1.0 + 1.0)
}

/// The data's cameras as constants on the tape.
pub fn camera_constants<'t>(cx: Context<'t, '_, f32>, cameras: &[Camera]) -> CameraVars<'t> {
    CameraVars {
        viewmats: rows(cx, cameras.iter().map(|c| viewmat(&c.pose)), [cameras.len(), 3, 4]),
        intrinsics: rows(cx, cameras.iter().map(intrinsics_row), [cameras.len(), 4]),
    }
}

/// Photos as a constant `[V, 3, H, W]`.
pub fn photo_constant<'t>(cx: Context<'t, '_, f32>, photos: Photos<'_>) -> Var<'t, f32> {
    cx.tape.constant(photos.planes, [photos.views(), 3, photos.height, photos.width])
}

/// The context photos of some examples as one constant `[B, V, 3, H, W]`.
pub fn photo_constants<'t>(cx: Context<'t, '_, f32>, examples: &[Example]) -> Var<'t, f32> {
    let photos = examples[0].context_photos();
    cx.tape.constant_with([examples.len(), photos.views(), 3, photos.height, photos.width], |all| {
        for (to, example) in all.chunks_mut(photos.planes.len()).zip(examples) {
            to.copy_from_slice(example.context_photos().planes);
        }
    })
}

/// A constant made row by row.
fn rows<'t, const N: usize>(
    cx: Context<'t, '_, f32>,
    rows: impl Iterator<Item = [f32; N]>,
    shape: impl Into<Shape>,
) -> Var<'t, f32> {
    cx.tape.constant_with(shape, |all| all.chunks_exact_mut(N).zip(rows).for_each(|(to, row)| to.copy_from_slice(&row)))
}
