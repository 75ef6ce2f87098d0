//! Drawn light and passers-by: the differences between photos of one place that were taken at different times.

use crate::Scene;
use std::ops::Range;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::Image;
use weaver_kernels::random::Stream;

/// The light in which a photo was taken: C' = clamp(gain_c C^gamma, 0, 1) of colors in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Factors of red, green and blue.
    pub gain: [f64; 3],
    /// The exponent.
    pub gamma: f64,
}

/// A rectangle of one color in front of everything.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occluder {
    /// First column and row, pixels.
    pub at: [usize; 2],
    /// Columns and rows.
    pub size: [usize; 2],
    /// Red, green and blue.
    pub color: [f32; 3],
}

/// The effect of a photo's moment on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Appearance {
    /// Its light.
    pub look: Look,
    /// Occluders in front.
    pub occluders: Vec<Occluder>,
}

/// Largest difference between a point's depth in a context view and that view's own depth there, as a part of the
/// latter.
const SAME_DEPTH: f64 = 0.02;

impl Look {
    /// The light that changes nothing.
    pub const PLAIN: Self = Self { gain: [1.0; 3], gamma: 1.0 };

    /// Draws exposure, tint and contrast: log gain_c in U(-0.7, 0.4) + U(-0.25, 0.25), the first common to all
    /// channels, and log gamma in U(-0.3, 0.3).
    pub fn drawn(stream: Stream) -> Self {
        let between = |i: u64, low: f64, high: f64| low + (high - low) * stream.uniform::<f64>(i);
        let exposure = between(0, -0.7, 0.4);
        let gain = [1, 2, 3].map(|channel| (exposure + between(channel, -0.25, 0.25)).exp());
        Self { gain, gamma: between(4, -0.3, 0.3).exp() }
    }

    /// A value of channel `channel` in this light.
    pub fn of(&self, value: f32, channel: usize) -> f32 {
        (self.gain[channel] * f64::from(value).powf(self.gamma)).clamp(0.0, 1.0) as f32
    }
}

/// Fills the columns of an image's plane `[H, W]` beside those that are `kept` with the mean of these.
///
/// The rest shows its light and nothing of the place. Panics unless `width` divides the plane.
///
/// ```
/// let mut plane = [1.0, 3.0, 9.0, 9.0];
/// weaver_data::appearance::keep_columns(&mut plane, 4, 0..2);
/// assert_eq!(plane, [1.0, 3.0, 2.0, 2.0]);
/// ```
pub fn keep_columns(plane: &mut [f32], width: usize, kept: Range<usize>) {
    assert_eq!(plane.len() % width, 0, "keep_columns: expected rows of {width} numbers, found {} numbers", plane.len());
    let sum: f64 = plane.chunks(width).flat_map(|row| &row[kept.clone()]).map(|x| f64::from(*x)).sum();
    let mean = (sum / (kept.len() * plane.len() / width).max(1) as f64) as f32;
    for row in plane.chunks_mut(width) {
        row[..kept.start].fill(mean);
        row[kept.end..].fill(mean);
    }
}

impl Appearance {
    /// Draws a look and up to `most` occluders, whose sides are 8 to 25 % of an image of `size` (width, height): a
    /// function of `stream` and these alone.
    ///
    /// ```
    /// use weaver_data::appearance::Appearance;
    /// use weaver_kernels::random::Stream;
    /// let drawn = |view: u64| Appearance::drawn(Stream::new(7, 0, "looks").fork(view), [64, 48], 3);
    /// assert_eq!(drawn(2), drawn(2));
    /// assert_ne!(drawn(2).look, drawn(3).look);
    /// assert!(drawn(2).look.gain.iter().all(|gain| (0.38..1.92).contains(gain)));
    /// ```
    pub fn drawn(stream: Stream, size: [usize; 2], most: usize) -> Self {
        let count = stream.fork(1).below(0, most + 1) as u64;
        let occluder = |i: u64| {
            let drawn = stream.fork(2).fork(i);
            let side = |axis: usize| {
                let share = 0.08 + 0.17 * drawn.uniform::<f64>(axis as u64);
                ((share * size[axis] as f64).round() as usize).clamp(1, size[axis])
            };
            let sides = [side(0), side(1)];
            let at = [0, 1].map(|axis| drawn.below(2 + axis as u64, size[axis] - sides[axis] + 1));
            Occluder { at, size: sides, color: [4, 5, 6].map(|i| drawn.uniform(i)) }
        };
        Self { look: Look::drawn(stream.fork(0)), occluders: (0..count).map(occluder).collect() }
    }

    /// The occluder that covers a pixel, the last one if there are several.
    pub fn occluder(&self, x: usize, y: usize) -> Option<&Occluder> {
        self.occluders
            .iter()
            .rev()
            .find(|o| (o.at[0]..o.at[0] + o.size[0]).contains(&x) && (o.at[1]..o.at[1] + o.size[1]).contains(&y))
    }

    /// The value of channel `channel` of a pixel whose plain value is `value`.
    pub fn of(&self, value: f32, channel: usize, [x, y]: [usize; 2]) -> f32 {
        self.occluder(x, y).map_or_else(|| self.look.of(value, channel), |occluder| occluder.color[channel])
    }

    /// The photo as it looks; pixels outside `inside` stay.
    pub fn photo(&self, plain: &Image, inside: Option<&[bool]>) -> Image {
        let mut photo = plain.clone();
        for (i, color) in photo.pixels.chunks_exact_mut(3).enumerate() {
            if inside.is_none_or(|inside| inside[i]) {
                let at = [i % plain.width, i / plain.width];
                color.iter_mut().enumerate().for_each(|(channel, x)| *x = self.of(*x, channel, at));
            }
        }
        photo
    }

    /// Mask of the pixels of an image of `size` (width, height) that no occluder covers.
    pub fn uncovered(&self, [width, height]: [usize; 2]) -> Vec<bool> {
        (0..width * height).map(|i| self.occluder(i % width, i / width).is_none()).collect()
    }
}

/// Mask of the pixels of a view that show something visible to at least one of `context`, or the sky; `None` unless
/// depth is known at every pixel.
///
/// A context view sees the surface of a pixel if its own depth there is within 2 % and its own pixel counts, as
/// `counts` says for the view's place in `context` and the pixel.
///
/// # Panics
/// If the scene has no such views.
pub fn seen(scene: &Scene, view: usize, context: &[usize], counts: impl Fn(usize, usize) -> bool) -> Option<Vec<bool>> {
    let exact = |i: usize| scene.views[i].instances.as_ref().and(scene.views[i].depth.as_deref());
    let depth = exact(view)?;
    let known: Option<Vec<&[f32]>> = context.iter().map(|&i| exact(i)).collect();
    let known = known?;
    let camera = &scene.views[view].camera;
    let to_world = camera.pose.inverse();
    let sees = |point: DVec3, i: usize| {
        let (other, depth) = (&scene.views[context[i]], known[i]);
        let local = other.camera.pose.apply(point);
        let pixel = other.camera.intrinsics.project(local);
        let (width, height) = (other.camera.width, other.camera.height);
        if local.z <= 0.0 || pixel.x < 0.0 || pixel.y < 0.0 || pixel.x >= width as f64 || pixel.y >= height as f64 {
            return false;
        }
        let at = pixel.y as usize * width + pixel.x as usize;
        let z = f64::from(depth[at]);
        z > 0.0 && (local.z - z).abs() < SAME_DEPTH * z && counts(i, at)
    };
    let shown = depth.iter().enumerate().map(|(i, z)| {
        let center = DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
        let point = || to_world.apply(camera.intrinsics.unproject(center, f64::from(*z)));
        *z <= 0.0 || (0..context.len()).any(|i| sees(point(), i))
    });
    Some(shown.collect())
}
