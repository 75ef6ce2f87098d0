//! Training tuples varied: crops, mirror images, colors, order.

use crate::Example;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_data::Tuple;
use weaver_io::Image;
use weaver_kernels::random::Stream;

/// Variation of training tuples from the photos; none by default. Evaluation never has any.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Augmentation {
    /// Sides of the smallest crop, as a fraction of the photo's: each tuple draws one about the middle, for all of its
    /// photos. 1 crops nothing.
    #[schemars(range(min = 0.25, max = 1.0))]
    pub crop: f64,
    /// Fraction of the tuples that are mirrored, photos and cameras alike.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub flip: f64,
    /// Largest distance of brightness, contrast and saturation from 1: each tuple draws three factors, for all of its
    /// photos.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1))]
    pub color: f64,
    /// True if the context's order is random, so that any view may be the first: for samplers that keep an order.
    pub order: bool,
}

impl Default for Augmentation {
    fn default() -> Self {
        Self { crop: 1.0, flip: 0.0, color: 0.0, order: false }
    }
}

/// Luma of a color.
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

impl Augmentation {
    /// The tuple, with its context in another order if the setting says so.
    #[must_use]
    pub fn ordered(&self, tuple: Tuple, stream: Stream) -> Tuple {
        if !self.order {
            return tuple;
        }
        let order = stream.fork(0).permutation(tuple.context.len());
        Tuple { context: order.into_iter().map(|i| tuple.context[i]).collect(), ..tuple }
    }

    /// Varies an example: its photos with their masks and depth, and its cameras.
    ///
    /// The draws come from `stream` alone. A variation that is off leaves every bit as it is.
    pub fn apply(&self, example: &mut Example, stream: Stream) {
        let drawn = |purpose: u64| stream.uniform::<f64>(purpose);
        let side = 1.0 - (1.0 - self.crop) * drawn(1);
        if side < 1.0 {
            crop(example, side);
        }
        if drawn(2) < self.flip {
            mirror(example);
        }
        if self.color > 0.0 {
            let factor = |purpose: u64| (1.0 + self.color * (2.0 * drawn(purpose) - 1.0)) as f32;
            recolor(example, [factor(3), factor(4), factor(5)]);
        }
    }
}

/// Width and height of an example's photos.
fn size(example: &Example) -> [usize; 2] {
    [example.cameras[0].width, example.cameras[0].height]
}

/// Cuts the middle out of each photo, its sides `side` of the photo's, and enlarges it to the photo's size.
fn crop(example: &mut Example, side: f64) {
    let [width, height] = size(example);
    let pixels = width * height;
    let (w, h) = (width as f64, height as f64);
    let [left, top] = [w, h].map(|length| length * (1.0 - side) / 2.0);
    let part = [left, top, w - left, h - top];
    let resized = |plane: &[f32]| -> Vec<f32> {
        let pixels = plane.iter().flat_map(|x| [*x; 3]).collect();
        Image { width, height, pixels }.resize(width, height, part).pixels.into_iter().step_by(3).collect()
    };
    // The source of each pixel, for data of single pixels, which is not interpolated.
    let from = |i: usize| {
        let place = |at: usize, start: f64| (start + (at as f64 + 0.5) * side) as usize;
        place(i / width, top).min(height - 1) * width + place(i % width, left).min(width - 1)
    };
    let masks: Option<Vec<Vec<f32>>> = example.inside.as_ref().map(|inside| {
        let plane = |view: &[bool]| view.iter().map(|inside| f32::from(*inside)).collect::<Vec<f32>>();
        inside.chunks(pixels).map(|view| resized(&plane(view))).collect()
    });
    for (i, plane) in example.images.chunks_mut(pixels).enumerate() {
        plane.copy_from_slice(&resized(plane));
        if let Some(masks) = &masks {
            // Masked pixels are white, and pixels on the border have a share of it.
            for (x, inside) in plane.iter_mut().zip(&masks[i / 3]) {
                *x = if *inside >= 0.5 { ((*x - (1.0 - inside)) / inside).clamp(0.0, 1.0) } else { 1.0 };
            }
        }
    }
    example.inside = masks.map(|masks| masks.concat().into_iter().map(|inside| inside >= 0.5).collect());
    for depth in example.depth.chunks_mut(pixels) {
        let before = depth.to_vec();
        depth.iter_mut().enumerate().for_each(|(i, depth)| *depth = before[from(i)]);
    }
    for camera in &mut example.cameras {
        camera.intrinsics = camera.intrinsics.cropped(left, top).resized(1.0 / side, 1.0 / side);
    }
}

/// The example as if it had been photographed in a mirror.
fn mirror(example: &mut Example) {
    let [width, _] = size(example);
    example.images.chunks_mut(width).for_each(<[f32]>::reverse);
    example.depth.chunks_mut(width).for_each(<[f32]>::reverse);
    example.inside.iter_mut().for_each(|inside| inside.chunks_mut(width).for_each(<[bool]>::reverse));
    example.cameras.iter_mut().for_each(|camera| *camera = camera.mirrored());
    example.absolute.iter_mut().for_each(|pose| *pose = pose.mirrored());
}

/// Changes brightness, contrast about the middle, and saturation of unmasked pixels.
fn recolor(example: &mut Example, [brightness, contrast, saturation]: [f32; 3]) {
    let [width, height] = size(example);
    let pixels = width * height;
    for (view, planes) in example.images.chunks_mut(3 * pixels).enumerate() {
        let inside = example.inside.as_ref().map(|inside| &inside[view * pixels..][..pixels]);
        for i in (0..pixels).filter(|i| inside.is_none_or(|inside| inside[*i])) {
            let color = [0, 1, 2].map(|c| (brightness * planes[c * pixels + i] - 0.5) * contrast + 0.5);
            let gray: f32 = color.iter().zip(LUMA).map(|(c, weight)| c * weight).sum();
            for (c, x) in color.into_iter().enumerate() {
                planes[c * pixels + i] = (gray + saturation * (x - gray)).clamp(0.0, 1.0);
            }
        }
    }
}
