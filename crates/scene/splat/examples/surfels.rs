//! Surfels seen all around: `cargo run --release -p weaver-splat --example surfels [PICTURE]`.
//!
//! A surfel is a flat Gaussian: the points m + u a + v b with the tangent vectors a and b have the alpha o exp(-(u^2 +
//! v^2) / 2) (Huang et al., 2D Gaussian Splatting, 2024, section 4; without its low-pass filter). A spherical camera
//! draws them, with the depth at which each ray meets them. Writes surfels.png (image and depth); panics where
//! gradients differ from central differences.

use std::f64::consts::{LOG2_E, PI, TAU};
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_io::Image;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Vector};
use weaver_kernels::random::Stream;
use weaver_splat::tiles::{ALPHA_MIN, Footprint, Projected, Projection, Response, record};
use weaver_splat::{PixelSums, Primitive, RasterSettings, RasterizePrimitives, TilesPool};

/// Surfels, and the spherical cameras that see them.
#[derive(Clone, Debug)]
struct Surfels(Vec<Pose>);

/// Surfels with their numbers.
#[derive(Debug)]
struct Seen<'a, T> {
    /// Means `[N, 3]`, tangents a and b `[N, 6]`, opacities `[N]`, colors `[N, 3]`.
    tensors: [&'a [T]; 4],
    cameras: &'a [Pose],
    width: f64,
    height: f64,
}

/// Places in a record, beside depth and color: the inverse K of H = [a b m], by rows.
const INVERSE: [usize; 9] = [0, 1, 2, 3, 4, 5, 6, 11, 12];
const OPACITY: usize = 13;
/// Angle between the center and the rim of the visible part.
const ANGLE: usize = 14;

fn vector<T: Real>(x: &[T]) -> DVec3 {
    DVec3::new(x[0].to_f64(), x[1].to_f64(), x[2].to_f64())
}

impl<T: Real> Seen<'_, T> {
    /// The inverse of H = [a b m] in the coordinates of a camera.
    fn inverse(&self, view: usize, n: usize) -> DMat3 {
        let ([means, tangents, ..], Pose { rotation, translation }) = (self.tensors, self.cameras[view]);
        let [a, b] = [0, 3].map(|at| rotation * vector(&tangents[6 * n + at..]));
        DMat3::from_cols(a, b, rotation * vector(&means[3 * n..]) + translation).inverse()
    }

    fn record(&self, view: usize, n: usize) -> Option<[f64; LANES]> {
        let inverse = self.inverse(view, n);
        let [a, b, m] = [0, 1, 2].map(|column| inverse.inverse().col(column).length());
        let opacity = self.tensors[2][n].to_f64();
        let reach = (2.0 * (opacity / ALPHA_MIN).ln()).max(0.0).sqrt() * a.hypot(b);
        let mut numbers = [0.0; LANES];
        INVERSE.iter().zip(inverse.transpose().to_cols_array()).for_each(|(place, x)| numbers[*place] = x);
        numbers[OPACITY] = opacity;
        numbers[ANGLE] = if reach < m { (reach / m).asin() + 1e-9 } else { PI };
        numbers[record::DEPTH] = m;
        vector(&self.tensors[3][3 * n..]).write_to_slice(&mut numbers[record::COLOR..]);
        (opacity >= ALPHA_MIN && numbers.iter().all(|x| x.is_finite())).then_some(numbers)
    }

    /// Left, right, top and bottom of the outline, in pixels.
    fn outline<V: Lanes>(&self, columns: &[V; LANES]) -> [V; 4] {
        let (inverse, angle) = (INVERSE.map(|place| columns[place].to_array()), columns[ANGLE].to_array());
        let sides: [[f64; 4]; LANES] = std::array::from_fn(|lane| {
            let inverse = DMat3::from_cols_array(&inverse.map(|x| x[lane].to_f64())).transpose();
            let DVec3 { x, y, z } = inverse.inverse().z_axis;
            let (longitude, latitude, angle) = (x.atan2(z), y.atan2(x.hypot(z)), angle[lane].to_f64());
            let around_a_pole = latitude.abs() + angle >= PI / 2.0;
            let half = if around_a_pole { PI } else { (angle.sin() / latitude.cos()).asin() + 1e-9 };
            let [left, right] = [-half, half].map(|by| ((longitude + by) / TAU + 0.5) * self.width);
            let [top, bottom] = [-angle, angle].map(|by| ((latitude + by) / PI + 0.5) * self.height);
            [left, right, top, bottom]
        });
        std::array::from_fn(|side| V::from_fn(|lane| V::Scalar::from_f64(sides[lane][side])))
    }
}

impl<T: Real> Primitive<T> for Surfels {
    const NAME: &'static str = "rasterize_surfels";
    const TENSORS: &'static [usize] = &[3, 6, 1, 3];
    type Seen<'a> = Seen<'a, T>;

    fn views(&self) -> usize {
        self.0.len()
    }

    fn seen<'a>(&'a self, tensors: &[&'a [T]], [width, height]: [usize; 2]) -> Seen<'a, T> {
        let tensors = std::array::from_fn(|i| tensors[i]);
        Seen { tensors, cameras: &self.0, width: width as f64, height: height as f64 }
    }

    fn backward(seen: &Seen<'_, T>, view: usize, n: usize, sums: &PixelSums<T>, gradient: &mut [T]) {
        let transposed = seen.inverse(view, n).transpose();
        let sum = |row: usize| vector(&sums.shape[3 * row..]);
        // K = H^-1: dH = -K^T dK K^T.
        let dcolumns = -(transposed * DMat3::from_cols(sum(0), sum(1), sum(2)).transpose() * transposed);
        let dcolumns = seen.cameras[view].rotation.transpose() * dcolumns;
        let by_position = [dcolumns.z_axis, dcolumns.x_axis, dcolumns.y_axis].map(|d| d.to_array());
        gradient.iter_mut().zip(by_position.as_flattened()).for_each(|(sum, d)| *sum += T::from_f64(*d));
        gradient[9] += sums.shape[9] / seen.tensors[2][n];
        (0..3).for_each(|c| gradient[10 + c] += sums.color[c]);
    }
}

impl<T: Real> Projection<T> for Seen<'_, T> {
    type State<V: Lanes<Scalar = T>> = usize;

    fn begin<V: Lanes<Scalar = T>>(&self, view: usize) -> usize {
        view
    }

    fn project<V: Lanes<Scalar = T>>(&self, view: &mut usize, first: usize, count: usize) -> Projected<V> {
        let records: [_; LANES] = std::array::from_fn(|i| (i < count).then(|| self.record(*view, first + i)).flatten());
        Projected::from_records(records.map(|record| record.map(|numbers| numbers.map(T::from_f64))))
    }
}

impl<T: Real> Footprint for Seen<'_, T> {
    fn rows<V: Lanes>(&self, columns: &[V; LANES]) -> (V, V) {
        let [.., highest, lowest] = self.outline(columns);
        (highest, lowest)
    }

    fn span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> (V, V, V::Mask) {
        let [left, right, highest, lowest] = self.outline(columns);
        (left, right, bottom.ge(highest).and(lowest.ge(top)))
    }

    fn second_span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> Option<(V, V, V::Mask)> {
        let (left, right, touched) = self.span(columns, top, bottom);
        // The image is periodic: a place beyond one end of a row is at the other.
        let around = V::constant(self.width).or(V::zero().ge(left), V::constant(-self.width));
        Some((left + around, right + around, touched))
    }
}

/// Intersections of the rays of a vector of pixels with a surfel.
#[derive(Clone, Copy)]
struct Hit<V> {
    direction: [V; 3],
    u: V,
    v: V,
    distance: V,
}

impl<T: Real> Response for Seen<'_, T> {
    /// The gradient with respect to K, by rows, and to the logarithm of the opacity.
    const SUMS: usize = 10;
    type Loaded<V: Vector> = ([V; 9], V);
    type Sample<V: Vector> = Hit<V>;
    /// Sine and cosine of the longitude.
    type Column<V: Vector> = [V; 2];
    /// Sine and cosine of the latitude.
    type Line<V: Vector> = [V; 2];

    fn column<V: Vector>(&self, x: V) -> [V; 2] {
        sine_and_cosine(x, self.width, TAU)
    }

    fn line<V: Vector>(&self, y: V) -> [V; 2] {
        sine_and_cosine(y, self.height, PI)
    }

    #[inline(always)]
    fn load<V: Vector>(&self, record: &[V::Scalar; LANES]) -> ([V; 9], V) {
        (INVERSE.map(|place| V::splat(record[place])), V::splat(record[OPACITY]))
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        (k, opacity): &([V; 9], V),
        &[sin_lon, cos_lon]: &[V; 2],
        &[sin_lat, cos_lat]: &[V; 2],
    ) -> (V, Hit<V>) {
        let direction = [cos_lat * sin_lon, sin_lat, cos_lat * cos_lon];
        // u a + v b + m = distance d, so that (u, v, 1) / distance = K d.
        let [p, q, r] = [0, 3, 6].map(|i| k[i] * direction[0] + k[i + 1] * direction[1] + k[i + 2] * direction[2]);
        // No hit behind the camera, nor where the ray is parallel.
        let least = V::constant(1e-6);
        let distance = r.max(least).recip();
        let (u, v) = (p * distance, q * distance);
        let alpha = (V::constant(-0.5 * LOG2_E) * (u * u + v * v)).exp2_times(*opacity).only(r.gt(least));
        (alpha, Hit { direction, u, v, distance })
    }

    #[inline(always)]
    fn depth<V: Vector>(&self, hit: &Hit<V>, _center: V) -> V {
        hit.distance
    }

    #[inline(always)]
    fn backward<V: Vector>(&self, &Hit { direction, u, v, distance }: &Hit<V>, g: V, sums: &mut [V]) {
        let outer = [-(g * u), -(g * v), g * (u * u + v * v)];
        for (i, sum) in sums[..9].iter_mut().enumerate() {
            *sum = *sum + outer[i / 3] * distance * direction[i % 3];
        }
        sums[9] = sums[9] + g;
    }

    #[inline(always)]
    fn depth_backward<V: Vector>(&self, hit: &Hit<V>, g: V, sums: &mut [V]) {
        let by_inverse = -(g * hit.distance * hit.distance);
        sums[6..9].iter_mut().zip(hit.direction).for_each(|(sum, d)| *sum = *sum + by_inverse * d);
    }
}

/// Sine and cosine of the angles at places along an image whose `size` pixels go over the angle `whole`.
fn sine_and_cosine<V: Vector>(at: V, size: f64, whole: f64) -> [V; 2] {
    let angle = ((at * V::constant(1.0 / size) - V::constant(0.5)) * V::constant(whole)).to_array();
    [V::from_fn(|lane| angle[lane].sin()), V::from_fn(|lane| angle[lane].cos())]
}

/// Surfels on a shell around the origin, which face it roughly: means, tangents, opacities, colors, background.
fn shell(seed: u64, n: usize, side: f64) -> Vec<Input> {
    let stream = Stream::new(seed, 0, "surfels");
    let normal = |n: usize, k: usize| stream.normal::<f64>((16 * n + k) as u64);
    let vector = |n: usize, k: usize| DVec3::new(normal(n, k), normal(n, k + 1), normal(n, k + 2));
    let mut tensors = [const { Vec::new() }; 4];
    for n in 0..n {
        let away = vector(n, 0).normalize();
        let tilted = away + 0.3 * vector(n, 3);
        let a = tilted.cross(vector(n, 6)).normalize() * side;
        tensors[0].extend((away * (2.0 + 0.5 * normal(n, 10).abs())).to_array());
        tensors[1].extend([a, tilted.normalize().cross(a) * (1.0 + 0.2 * normal(n, 9))].map(|v| v.to_array()).concat());
        tensors[2].push(0.9 / (1.0 + (-normal(n, 11)).exp()));
        tensors[3].extend((0.5 + 0.5 * away).to_array());
    }
    let inputs = tensors.iter().zip([3, 6, 1, 3]).map(|(data, numbers)| Input::new(data, [n, numbers]));
    inputs.chain([Input::new(&[0.1, 0.2, 0.3], [3])]).collect()
}

/// Checks the gradients of image, alpha and depth by central differences, from two cameras.
///
/// # Panics
///
/// If they disagree.
pub fn check(seed: u64) {
    let turned = Pose::new(DMat3::from_rotation_y(0.9), DVec3::new(0.1, -0.2, 0.3));
    let surfels = Surfels(vec![Pose::IDENTITY, turned]);
    let pool = TilesPool::new();
    let options = Options { duplicates: false, seed, ..Options::default() };
    gradcheck_with(options, &shell(seed, 5, 0.8), |x| {
        let op = RasterizePrimitives::new(surfels.clone(), [20, 10], RasterSettings::default(), &pool);
        let drawn = op.apply(&x[..4], x[4]);
        vec![drawn.image, drawn.alpha, drawn.depth]
    });
}

#[allow(dead_code, reason = "a test includes this file and calls the check alone")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (path, tape) = (std::env::args().nth(1).unwrap_or("surfels.png".into()), Tape::<f32>::new());
    let single = |input: &Input| input.data.iter().map(|x| *x as f32).collect::<Vec<_>>();
    let x: Vec<_> = shell(0, 400, 0.2).iter().map(|input| tape.constant(&single(input), input.shape)).collect();
    let (surfels, [width, height]) = (Surfels(vec![Pose::IDENTITY]), [640, 320]);
    let op = RasterizePrimitives::new(surfels, [width, height], RasterSettings::default(), &TilesPool::new());
    let drawn = op.apply(&x[..4], x[4]);
    let depth = drawn.expected_depth().to_vec().into_iter().flat_map(|z| [1.0 - z / 4.0; 3]).collect();
    let pictures = [drawn.image.to_vec(), depth].map(|pixels| Image { width, height, pixels });
    Image::mosaic(&pictures.each_ref()).write_png(&path)?;
    (0..4).for_each(check);
    println!("{path}; gradients agree");
    Ok(())
}
