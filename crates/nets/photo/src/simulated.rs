//! Depth as comparison would find it, drawn from true depth: training on it costs no comparison.

use crate::comparison::Comparison;
use crate::prior::Transfer;
use weaver_geometry::Camera;
use weaver_inference::Photos;
use weaver_kernels::parallel;
use weaver_kernels::random::Stream;

/// Other photos that must see a place.
const WITNESSES: usize = 2;
/// Logarithm of the ratio of depths up to which a photo sees a place.
const SEES: f64 = 0.02;
/// Standard deviation of luma around a pixel below which comparison finds nothing; each scene draws its own between.
const EVEN: [f64; 2] = [0.008, 0.04];
/// Pixels around one whose luma counts, each way.
const AROUND: usize = 2;
/// Logarithm of the ratio of depths at an edge, beside which little is found.
const EDGE: f32 = 0.05;
/// Part of the pixels beside an edge that are found nevertheless.
const BESIDE_EDGES: f64 = 0.4;
/// Standard deviation of the error of depth, pixels between the photos.
const ERROR: f64 = 0.15;
/// Largest error, as a logarithm of depth.
const LARGEST: f64 = 0.01;
/// Share of the scenes in which blobs are taken away, and of those in which nothing but points is left.
const BLOBS: f64 = 0.5;
const NOTHING: f64 = 0.1;
/// Blobs of a photo, their radius over its width, and the share of them that get a wrong depth instead.
const COUNT: usize = 6;
const RADIUS: [f64; 2] = [0.04, 0.2];
const WRONG: f64 = 0.1;
/// Points of a photo for each hundred pixels of its width; they need one other photo that sees them.
const POINTS: f64 = 60.0;

/// The photos of a scene, and the draws that they share.
struct Scene<'a> {
    photos: Photos<'a>,
    cameras: &'a [Camera],
    depth: &'a [f32],
    /// Least deviation of luma.
    even: f32,
    blobs: bool,
    nothing: bool,
}

impl Comparison {
    /// Depth that comparison would find of V photos whose true depth `[V, H, W]` is known, 0 where it is infinite or
    /// unknown: the depth, with a small error, where two other photos see a place with some texture, away from edges;
    /// and points that one other photo sees. In some scenes blobs of it are missing, a few have a wrong depth, or only
    /// points are left, so that a network learns to complete and to doubt. The same stream gives the same bits.
    ///
    /// # Panics
    /// When sizes do not fit.
    pub fn simulated(photos: Photos<'_>, cameras: &[Camera], depth: &[f32], stream: Stream) -> Self {
        let pixels = photos.height * photos.width;
        assert!(
            cameras.len() == photos.views() && depth.len() == cameras.len() * pixels,
            "a camera and depth for each"
        );
        let [low, high] = EVEN;
        let scene = Scene {
            photos,
            cameras,
            depth,
            even: (low * (high / low).powf(stream.uniform(0))) as f32,
            blobs: stream.uniform::<f64>(1) < BLOBS,
            nothing: stream.uniform::<f64>(2) < NOTHING,
        };
        let mut found = vec![0.0; depth.len()];
        parallel::for_chunks(&mut found, pixels, |view, found| scene.view(view, stream.fork(view as u64), found));
        Self { depth: found }
    }
}

impl Scene<'_> {
    fn of(&self, view: usize) -> &[f32] {
        let pixels = self.photos.height * self.photos.width;
        &self.depth[view * pixels..][..pixels]
    }

    fn view(&self, view: usize, stream: Stream, found: &mut [f32]) {
        let depth = self.of(view);
        let [errors, edges, blobs, points] = [0, 1, 2, 3].map(|purpose| stream.fork(purpose));
        let luma = self.luma(view);
        let center = self.cameras[view].pose.center();
        let others: Vec<(usize, Transfer<'_>)> = (0..self.cameras.len())
            .filter(|other| *other != view)
            .map(|other| (other, Transfer::new(&self.cameras[view], &self.cameras[other])))
            .collect();
        let baseline = others.iter().map(|(other, _)| self.cameras[*other].pose.center().distance(center)).sum::<f64>()
            / others.len().max(1) as f64;
        // The change of log depth, over depth, that moves a point by a pixel between photos.
        let unit = 1.0 / (baseline * self.cameras[view].intrinsics.fx).max(1e-9);
        let witnesses: Vec<usize> = (0..depth.len()).map(|at| self.witnesses(at, depth[at], &others)).collect();
        let error = |at: usize| {
            let size = ERROR * unit * f64::from(depth[at]) * errors.normal::<f64>(at as u64);
            depth[at] * size.clamp(-LARGEST, LARGEST).exp() as f32
        };
        if !self.nothing {
            for (at, found) in found.iter_mut().enumerate().filter(|(at, _)| witnesses[*at] >= WITNESSES) {
                let beside = self.beside_edge(view, at) && edges.uniform::<f64>(at as u64) > BESIDE_EDGES;
                if self.deviation(&luma, at) > self.even && !beside {
                    *found = error(at);
                }
            }
            if self.blobs {
                self.take_away(blobs, depth, found);
            }
        }
        for i in 0..(POINTS * self.photos.width as f64 / 100.0) as u64 {
            let at = points.below(i, depth.len());
            if witnesses[at] > 0 && self.deviation(&luma, at) > self.even {
                found[at] = error(at);
            }
        }
    }

    /// The number of other photos that see the point of a pixel.
    fn witnesses(&self, at: usize, z: f32, others: &[(usize, Transfer<'_>)]) -> usize {
        if z <= 0.0 {
            return 0;
        }
        let sees = |(other, there): &&(usize, Transfer<'_>)| {
            there.pixel(at, z.ln()).filter(|seen| seen.inside).is_some_and(|seen| {
                let theirs = f64::from(self.of(*other)[seen.index()]);
                theirs > 0.0 && (seen.depth / theirs).ln().abs() < SEES
            })
        };
        others.iter().filter(sees).count()
    }

    fn luma(&self, view: usize) -> Vec<f32> {
        let pixels = self.photos.height * self.photos.width;
        let planes = &self.photos.planes[3 * view * pixels..][..3 * pixels];
        (0..pixels).map(|at| (planes[at] + planes[pixels + at] + planes[2 * pixels + at]) / 3.0).collect()
    }

    /// Rows and columns around a pixel.
    fn around(&self, at: usize, reach: usize) -> impl Iterator<Item = usize> + use<> {
        let (height, width) = (self.photos.height, self.photos.width);
        let (row, column) = (at / width, at % width);
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(width);
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(height);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }

    /// Standard deviation of luma around a pixel.
    fn deviation(&self, luma: &[f32], at: usize) -> f32 {
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        for x in self.around(at, AROUND).map(|i| luma[i]) {
            (sum, squares, count) = (sum + x, squares + x * x, count + 1.0);
        }
        (squares / count - (sum / count) * (sum / count)).max(0.0).sqrt()
    }

    fn beside_edge(&self, view: usize, at: usize) -> bool {
        let depth = self.of(view);
        let jumps = |other: f32| other <= 0.0 || (other / depth[at]).ln().abs() > EDGE;
        self.around(at, 1).any(|i| jumps(depth[i]))
    }

    /// Takes away the depth of some disks, and gives a few a wrong one.
    fn take_away(&self, stream: Stream, depth: &[f32], found: &mut [f32]) {
        let width = self.photos.width as f64;
        for blob in 0..COUNT {
            let draw = stream.fork(blob as u64);
            let center = draw.below(0, found.len());
            let [low, high] = RADIUS.map(|r| r * width);
            let radius = low + (high - low) * draw.uniform::<f64>(1);
            let wrong = draw.uniform::<f64>(2) < WRONG;
            let factor = (if draw.uniform::<f64>(3) < 0.5 { 1.0 } else { -1.0 }) * (0.1 + 0.4 * draw.uniform::<f64>(4));
            let place = |at: usize| [(at / self.photos.width) as f64, (at % self.photos.width) as f64];
            let [y, x] = place(center);
            for (at, found) in found.iter_mut().enumerate() {
                let [row, column] = place(at);
                if (row - y).hypot(column - x) < radius {
                    *found = if wrong && *found > 0.0 { depth[at] * factor.exp() as f32 } else { 0.0 };
                }
            }
        }
    }
}
