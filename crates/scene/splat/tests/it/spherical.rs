//! Another primitive and another camera on the same tiles: round spots on a sphere, seen in an equirectangular image.
//!
//! A spot has the direction d, the concentration k and the opacity o; in the direction w (of length 1) its alpha is
//! o 2^(-k (1 - d . w)).

use proptest::prelude::*;
use std::f64::consts::{LN_2, PI};
use weaver_autograd::Tape;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Vector};
use weaver_kernels::random::Stream;
use weaver_splat::tiles::{ALPHA_MIN, Footprint, Projected, Projection, Response, TRANSMITTANCE_END, record};
use weaver_splat::{PixelSums, Primitive, RasterSettings, RasterizePrimitives, TileSide, TilesPool};

/// Numbers of a spot: direction 3, concentration, opacity, color 3, depth.
const NUMBERS: usize = 9;
type Spot = [f64; NUMBERS];

/// Slots of a record, beside depth and color.
mod slot {
    pub const DIRECTION: usize = 0;
    pub const CONCENTRATION: usize = 3;
    pub const OPACITY: usize = 4;
    pub const TOP: usize = 11;
    pub const BOTTOM: usize = 12;
    pub const LEFT: usize = 13;
    pub const RIGHT: usize = 14;
}

/// The image of the whole sphere, and the spots on it.
struct Sphere {
    width: f64,
    height: f64,
    spots: Vec<Spot>,
}

impl Sphere {
    /// The direction of a point of the image.
    fn direction(&self, x: f64, y: f64) -> [f64; 3] {
        let (longitude, latitude) = ((x / self.width - 0.5) * 2.0 * PI, (y / self.height - 0.5) * PI);
        [latitude.cos() * longitude.sin(), latitude.sin(), latitude.cos() * longitude.cos()]
    }

    /// The record of a spot, if it is bright enough to be seen.
    fn record(&self, spot: &Spot) -> Option<[f64; LANES]> {
        let [x, y, z, concentration, opacity, red, green, blue, depth] = *spot;
        // 1 - d . w where alpha falls to the visible minimum, and the angle from d there.
        let reach = (opacity / ALPHA_MIN).log2() / concentration;
        if reach < 0.0 {
            return None;
        }
        let angle = if reach < 2.0 { (1.0 - reach).acos() + 1e-9 } else { PI };
        let (longitude, latitude) = (x.atan2(z), y.clamp(-1.0, 1.0).asin());
        let row = |latitude: f64| (latitude / PI + 0.5) * self.height;
        let column = |longitude: f64| (longitude / (2.0 * PI) + 0.5) * self.width;
        // Around a pole, all columns.
        let half = if latitude.abs() + angle < PI / 2.0 { (angle.sin() / latitude.cos()).asin() + 1e-9 } else { PI };
        let mut numbers = [0.0; LANES];
        numbers[slot::DIRECTION..][..5].copy_from_slice(&[x, y, z, concentration, opacity]);
        numbers[record::DEPTH] = depth;
        numbers[record::COLOR..][..3].copy_from_slice(&[red, green, blue]);
        numbers[slot::TOP] = row(latitude - angle);
        numbers[slot::BOTTOM] = row(latitude + angle);
        numbers[slot::LEFT] = column(longitude - half);
        numbers[slot::RIGHT] = column(longitude + half);
        Some(numbers)
    }
}

/// Spots on the tape: one tensor `[N, 9]`.
#[derive(Debug)]
struct Spots;

impl Primitive<f64> for Spots {
    const NAME: &'static str = "rasterize_spots";
    const TENSORS: &'static [usize] = &[NUMBERS];
    type Seen<'a> = Sphere;

    fn views(&self) -> usize {
        1
    }

    fn seen(&self, tensors: &[&[f64]], size: [usize; 2]) -> Sphere {
        let [width, height] = size.map(|side| side as f64);
        Sphere { width, height, spots: tensors[0].as_chunks().0.to_vec() }
    }

    fn backward(sphere: &Sphere, _view: usize, n: usize, sums: &PixelSums<f64>, gradient: &mut [f64]) {
        let (spot, [x, y, z, away, g, ..]) = (&sphere.spots[n], sums.shape);
        let along = LN_2 * spot[3];
        let [red, green, blue] = sums.color;
        let own = [along * x, along * y, along * z, -LN_2 * away, g / spot[4], red, green, blue, sums.depth];
        gradient.iter_mut().zip(own).for_each(|(sum, x)| *sum += x);
    }
}

impl<T: Real> Projection<T> for Sphere {
    type State<V: Lanes<Scalar = T>> = ();

    fn begin<V: Lanes<Scalar = T>>(&self, _view: usize) {}

    fn project<V: Lanes<Scalar = T>>(&self, (): &mut (), first: usize, count: usize) -> Projected<V> {
        let record = |i: usize| self.spots[first..first + count].get(i).and_then(|spot| self.record(spot));
        Projected::from_records(std::array::from_fn(|i| record(i).map(|numbers| numbers.map(T::from_f64))))
    }
}

impl Footprint for Sphere {
    #[inline(always)]
    fn rows<V: Lanes>(&self, columns: &[V; LANES]) -> (V, V) {
        (columns[slot::TOP], columns[slot::BOTTOM])
    }

    #[inline(always)]
    fn span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> (V, V, V::Mask) {
        let touched = bottom.ge(columns[slot::TOP]).and(columns[slot::BOTTOM].ge(top));
        (columns[slot::LEFT], columns[slot::RIGHT], touched)
    }

    #[inline(always)]
    fn second_span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> Option<(V, V, V::Mask)> {
        let (left, right, touched) = self.span(columns, top, bottom);
        // The image is periodic: a place beyond one end of a row is at the other.
        let around = V::constant(self.width).or(V::zero().ge(left), V::constant(-self.width));
        Some((left + around, right + around, touched))
    }
}

impl Response for Sphere {
    const SUMS: usize = 5;
    type Loaded<V: Vector> = [V; 5];
    /// w, and 1 - d . w.
    type Sample<V: Vector> = ([V; 3], V);
    type Column<V: Vector> = V;
    type Line<V: Vector> = V;

    #[inline(always)]
    fn column<V: Vector>(&self, x: V) -> V {
        x
    }

    #[inline(always)]
    fn line<V: Vector>(&self, y: V) -> V {
        y
    }

    #[inline(always)]
    fn load<V: Vector>(&self, record: &[V::Scalar; LANES]) -> [V; 5] {
        std::array::from_fn(|k| V::splat(record[k]))
    }

    #[inline(always)]
    fn at<V: Vector>(&self, spot: &[V; 5], &x: &V, &y: &V) -> (V, ([V; 3], V)) {
        let (x, y) = (x.to_array(), y.to_array());
        let directions: Vec<_> = (0..LANES).map(|lane| self.direction(x[lane].to_f64(), y[lane].to_f64())).collect();
        let w: [V; 3] = std::array::from_fn(|axis| V::from_fn(|lane| V::Scalar::from_f64(directions[lane][axis])));
        let away = V::constant(1.0) - (spot[0] * w[0] + spot[1] * w[1] + spot[2] * w[2]);
        ((-spot[slot::CONCENTRATION] * away).exp2() * spot[slot::OPACITY], (w, away))
    }

    #[inline(always)]
    fn backward<V: Vector>(&self, &(w, away): &([V; 3], V), g: V, sums: &mut [V]) {
        for (sum, x) in sums.iter_mut().zip([g * w[0], g * w[1], g * w[2], g * away, g]) {
            *sum = *sum + x;
        }
    }
}

/// Color, alpha and depth of each pixel, five numbers; which spots blend there, front to back, is given.
fn blend(sphere: &Sphere, size: (usize, usize), visible: &[Vec<usize>]) -> Vec<f64> {
    let pixel = |(i, visible): (usize, &Vec<usize>)| {
        let w = sphere.direction((i % size.0) as f64 + 0.5, (i / size.0) as f64 + 0.5);
        let mut light = 1.0;
        let mut sums = [0.0; 5];
        for &n in visible {
            let alpha = alpha(&sphere.spots[n], w);
            let [.., red, green, blue, depth] = sphere.spots[n];
            [red, green, blue, 1.0, depth].iter().zip(&mut sums).for_each(|(x, sum)| *sum += light * alpha * x);
            light *= 1.0 - alpha;
        }
        sums
    };
    visible.iter().enumerate().flat_map(pixel).collect()
}

fn alpha(spot: &Spot, w: [f64; 3]) -> f64 {
    let away = 1.0 - (spot[0] * w[0] + spot[1] * w[1] + spot[2] * w[2]);
    spot[4] * (-spot[3] * away).exp2()
}

/// The spots that blend at each pixel, by the rules: every spot at every pixel, no tiles, no bounds.
fn visible(sphere: &Sphere, (width, height): (usize, usize)) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..sphere.spots.len()).collect();
    order.sort_by(|&a, &b| (sphere.spots[a][8] as f32).total_cmp(&(sphere.spots[b][8] as f32)));
    let pixel = |i: usize| {
        let w = sphere.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let (mut light, mut visible) = (1.0, Vec::new());
        for &n in &order {
            let alpha = alpha(&sphere.spots[n], w);
            if alpha < ALPHA_MIN {
                continue;
            }
            light *= 1.0 - alpha;
            if light <= TRANSMITTANCE_END {
                break;
            }
            visible.push(n);
        }
        visible
    };
    (0..width * height).map(pixel).collect()
}

fn random(seed: u64, n: usize, (width, height): (usize, usize)) -> Sphere {
    let stream = Stream::new(seed, 0, "splat.sphere");
    let spot = |n: usize| {
        let normal = |i: usize| stream.normal::<f64>((NUMBERS * n + i) as u64);
        let d: [f64; 3] = std::array::from_fn(normal);
        let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [x, y, z] = d.map(|x| x / length);
        let opacity = 0.97 / (1.0 + (-2.0 * normal(4)).exp());
        [x, y, z, 30.0 * (2.0 * normal(3)).exp(), opacity, normal(5), normal(6), normal(7), 3.0 + normal(8).abs()]
    };
    Sphere { width: width as f64, height: height as f64, spots: (0..n).map(spot).collect() }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 16, failure_persistence: None, ..Default::default() })]

    #[test]
    fn spots_on_a_sphere(
        seed: u64,
        n in 1_usize..40,
        size in (1_usize..70, 1_usize..40),
        side in prop::sample::select(vec![TileSide::Sixteen, TileSide::ThirtyTwo]),
    ) {
        let mut sphere = random(seed, n, size);
        let pixels = size.0 * size.1;
        let tape = Tape::<f64>::new();
        let spots = tape.leaf(sphere.spots.as_flattened(), [n, NUMBERS]);
        let settings = RasterSettings { tile: side, ..RasterSettings::default() };
        let op = RasterizePrimitives::new(Spots, [size.0, size.1], settings, &TilesPool::new());
        let drawn = op.apply(&[spots], tape.constant(&[0.0; 3], [3]));
        let [image, alpha, depth] = [drawn.image, drawn.alpha, drawn.depth].map(|image| image.to_vec());
        let visible = visible(&sphere, size);
        for (i, expected) in blend(&sphere, size, &visible).chunks(5).enumerate() {
            let own = [image[3 * i], image[3 * i + 1], image[3 * i + 2], alpha[i], depth[i]];
            prop_assert!(own.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{own:?} {expected:?}");
        }

        let stream = Stream::new(seed, 1, "splat.sphere");
        let weights: Vec<f64> = (0..5 * pixels as u64).map(|i| stream.normal(i)).collect();
        let parts = [(drawn.image, 0..3), (drawn.alpha, 3..4), (drawn.depth, 4..5)].map(|(image, range)| {
            let weights: Vec<f64> = weights.chunks(5).flat_map(|pixel| pixel[range.clone()].to_vec()).collect();
            (image * tape.constant(&weights, image.shape())).sum()
        });
        parts.into_iter().reduce(|sum, part| sum + part).unwrap().backward();
        let gradients = spots.grad().unwrap().to_vec();
        let spots = sphere.spots.clone();
        let mut loss = |n: usize, k: usize, by: f64| -> f64 {
            let before = sphere.spots[n][k];
            sphere.spots[n][k] += by;
            let sum = blend(&sphere, size, &visible).iter().zip(&weights).map(|(a, b)| a * b).sum();
            sphere.spots[n][k] = before;
            sum
        };
        for (n, spot) in spots.into_iter().enumerate().take(6) {
            for (k, own) in gradients[NUMBERS * n..][..NUMBERS].iter().copied().enumerate() {
                // Alpha changes over directions as far apart as the concentration is large.
                let step = if k < 3 { 1e-4 / spot[3] } else { 1e-5 * spot[k].abs().max(0.1) };
                let slope = (loss(n, k, step) - loss(n, k, -step)) / (2.0 * step);
                prop_assert!((own - slope).abs() < 1e-5 * (1.0 + slope.abs()), "spot {n}, number {k}: {own} {slope}");
            }
        }
    }
}
