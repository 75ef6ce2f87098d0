//! Loss of drawn surfels against a measured range image.

use crate::Frame;
use crate::drawn_normals::Rays;
use rayon::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_surfel::RangeImages;

/// The targets of drawn normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NormalTarget {
    /// The normals of the drawn ranges, which change with them.
    Drawn,
    /// Normals of the scan's points by principal components.
    Measured,
}

/// The pixels in the mean of the range term.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RangeMean {
    /// All of the image, as published. The fewer pixels are measured, the less ranges weigh beside the other terms,
    /// which are means over measured ones.
    Image,
    /// The measured pixels.
    Measured,
}

/// Weights of the terms of the loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Pixels in the mean of the range differences, whose weight is 1.
    pub range: RangeMean,
    /// Weight of -log opacity.
    pub opacity: f64,
    /// Weight of 1 - n.m, for the mean normal n and the target's m.
    pub normal: f64,
    /// Source of the target normals m.
    pub target: NormalTarget,
}

/// Gradients with respect to drawn images, reused from step to step.
#[derive(Clone, Debug, Default)]
pub(crate) struct ImageGradients {
    pub range: Vec<f32>,
    pub opacity: Vec<f32>,
    pub normal: Vec<f32>,
    /// Gradient with respect to the mean range.
    mean: Vec<f32>,
    ranges: Vec<f32>,
}

/// The loss, and the mean of |r' - r| over valid pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapLoss {
    /// The loss without its term of scales.
    pub total: f64,
    /// Mean difference of ranges over covered pixels, meters.
    pub range: f64,
}

/// L = (1 / P) sum |r' - r| + w_o mean(-log A) + w_n mean(1 - n.m) over valid pixels, with r' = sum w r / A and P valid
/// pixels, or all; fills the gradients.
///
/// With m = A m' of length A, as in the published method, and n = sum w n_i / A, the product is (sum w n_i).m'.
pub(crate) fn map_loss(
    frame: &Frame,
    images: &RangeImages<f32>,
    rays: &Rays,
    weights: &LossWeights,
    to: &mut ImageGradients,
) -> MapLoss {
    let (pixels, width) = (frame.range.len(), frame.camera.width);
    for (column, numbers) in [(&mut to.range, 1), (&mut to.opacity, 1), (&mut to.normal, 3), (&mut to.mean, 1)] {
        column.resize(numbers * pixels, 0.0);
    }
    to.ranges.clear();
    let drawn = images.range.iter().zip(&images.opacity);
    to.ranges.extend(drawn.map(|(range, a)| if *a > 0.0 { range / a.max(1e-10) } else { 0.0 }));
    let n = frame.pixels.len() as f64;
    let averaged = match weights.range {
        RangeMean::Image => pixels as f64,
        RangeMean::Measured => n,
    };
    let ImageGradients { range, opacity, normal, mean, ranges } = to;
    let rows = opacity.par_chunks_mut(width).zip(normal.par_chunks_mut(3 * width)).zip(mean.par_chunks_mut(width));
    let row_of = |(row, ((opacity, normal), mean)): (usize, RowGradients<'_>)| {
        opacity.fill(0.0);
        normal.fill(0.0);
        mean.fill(0.0);
        let mut sums = Sums::default();
        let first = frame.pixels.partition_point(|pixel| (*pixel as usize) < row * width);
        for (i, pixel) in frame.pixels.iter().enumerate().skip(first) {
            let at = *pixel as usize;
            let Some(x) = at.checked_sub(row * width).filter(|x| *x < width) else { break };
            let a = images.opacity[at];
            sums.opacity -= f64::from(a.max(1e-10)).ln();
            sums.normal += 1.0;
            if a <= 0.0 {
                sums.missed += f64::from(frame.range[at]);
                continue;
            }
            let difference = ranges[at] - frame.range[at];
            sums.range += f64::from(difference.abs());
            sums.met += 1.0;
            mean[x] = difference.signum() / averaged as f32;
            opacity[x] = -(weights.opacity / n) as f32 / a;
            if weights.normal == 0.0 {
                continue;
            }
            let Some(target) = target_of(frame, rays, ranges, weights.target, (i, at)) else { continue };
            let drawn = vector(&images.normal, at);
            sums.normal -= drawn.dot(target);
            let gradient = (target * (-weights.normal / n)).to_array().map(|d| d as f32);
            normal[3 * x..3 * x + 3].copy_from_slice(&gradient);
        }
        sums
    };
    let sums: Vec<Sums> = rows.enumerate().map(row_of).collect();
    let Sums { range: difference, missed, met, opacity: logs, normal: turned } = Sums::of(&sums);
    if weights.normal > 0.0 && weights.target == NormalTarget::Drawn {
        // Gradients of drawn normals go into the ranges of their neighbors.
        for at in frame.pixels.iter().map(|pixel| *pixel as usize) {
            rays.normal_backward(ranges, at, vector(&images.normal, at) * (-weights.normal / n), mean);
        }
    }
    let rows = range.par_chunks_mut(width).zip(opacity.par_chunks_mut(width)).zip(mean.par_chunks(width));
    rows.enumerate().for_each(|(row, ((range, opacity), mean))| {
        for (x, d) in mean.iter().enumerate() {
            let a = images.opacity[row * width + x];
            range[x] = if a > 0.0 { d / a } else { 0.0 };
            opacity[x] -= range[x] * ranges[row * width + x];
        }
    });
    let total = (difference + missed) / averaged + weights.opacity * logs / n + weights.normal * turned / n;
    MapLoss { total, range: difference / met.max(1.0) }
}

/// Gradients of a row with respect to opacity, normals and mean range.
type RowGradients<'a> = ((&'a mut [f32], &'a mut [f32]), &'a mut [f32]);

/// Sums over the pixels of a row.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    range: f64,
    /// Sum of measured ranges at uncovered pixels.
    missed: f64,
    met: f64,
    opacity: f64,
    normal: f64,
}

impl Sums {
    /// The sums over all rows, in their order.
    fn of(rows: &[Self]) -> Self {
        rows.iter().fold(Self::default(), |sum, row| Self {
            range: sum.range + row.range,
            missed: sum.missed + row.missed,
            met: sum.met + row.met,
            opacity: sum.opacity + row.opacity,
            normal: sum.normal + row.normal,
        })
    }
}

/// The target of the normal at the i-th point, in a pixel.
fn target_of(
    frame: &Frame,
    rays: &Rays,
    ranges: &[f32],
    target: NormalTarget,
    (i, pixel): (usize, usize),
) -> Option<DVec3> {
    match target {
        NormalTarget::Drawn => rays.normal(ranges, pixel),
        NormalTarget::Measured => frame.normals.get(i).copied(),
    }
}

fn vector(normals: &[f32], pixel: usize) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|k| f64::from(normals[3 * pixel + k])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;
    use weaver_surfel::SurfelCamera;

    #[test]
    fn gradients_agree_with_differences() {
        let camera = SurfelCamera::spherical([8, 5], [-0.5, 0.5]);
        let rays = Rays::new(&camera);
        let kinds = [(1, NormalTarget::Drawn, RangeMean::Image), (2, NormalTarget::Measured, RangeMean::Measured)];
        for (seed, target, range) in kinds {
            let stream = Stream::new(seed, 0, "images");
            let many = |k: u64, n: u64| (0..n).map(|i| stream.uniform::<f32>(8 * i + k)).collect::<Vec<_>>();
            let opacity: Vec<f32> = many(0, 40).iter().map(|a| 0.3 + 0.6 * a).collect();
            let ranges: Vec<f32> = many(1, 40).iter().map(|r| 4.0 + r).collect();
            let sums = ranges.iter().zip(&opacity).map(|(r, a)| r * a).collect();
            let images = RangeImages { range: sums, opacity, normal: many(2, 120) };
            let pixels: Vec<u32> = (0..40).filter(|i| i % 7 != 3).collect();
            let measured = many(3, 40);
            let frame = Frame {
                camera,
                // Offsets from the drawn ranges exceed the step of the differences.
                range: (0..40).map(|i| if i % 7 != 3 { ranges[i] + 0.1 + measured[i] } else { 0.0 }).collect(),
                points: vec![DVec3::X; pixels.len()],
                normals: pixels.iter().map(|i| rays.normal(&[2.0; 40], *i as usize).unwrap_or(DVec3::Z)).collect(),
                pixels,
            };
            let weights = LossWeights { range, opacity: 0.4, normal: 0.7, target };
            let mut gradients = ImageGradients::default();
            map_loss(&frame, &images, &rays, &weights, &mut gradients);
            let loss = |images: &RangeImages<f32>| {
                map_loss(&frame, images, &rays, &weights, &mut ImageGradients::default()).total
            };
            let check = |field: fn(&mut RangeImages<f32>) -> &mut Vec<f32>, own: &[f32], what: &str| {
                for (i, own) in own.iter().enumerate() {
                    let at = |by: f32| {
                        let mut moved = images.clone();
                        field(&mut moved)[i] += by;
                        loss(&moved)
                    };
                    let slope = (at(2e-3) - at(-2e-3)) / 4e-3;
                    assert!((slope - f64::from(*own)).abs() < 2e-3, "{target:?} {what} {i}: {slope} {own}");
                }
            };
            check(|images| &mut images.range, &gradients.range, "range");
            check(|images| &mut images.normal, &gradients.normal, "normal");
            check(|images| &mut images.opacity, &gradients.opacity, "opacity");
        }
    }
}
