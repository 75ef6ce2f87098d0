//! How well Gaussians are approximated through a wide lens: on the image by the derivative of the projection, on the
//! image by the unscented transform, and on the plane across their own direction, along rays. The reference is the
//! largest response along each ray.
//!
//! `cargo run --release -p weaver-geometry --example splats`

use weaver_geometry::glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use weaver_geometry::lens::{self, Lens, LensCamera};
use weaver_geometry::{Camera, Pose};

const SIDE: usize = 512;
const GAUSSIANS: u64 = 12;

/// A Gaussian in camera coordinates.
struct Gaussian {
    mean: DVec3,
    /// Axes times standard deviations, in columns.
    axes: DMat3,
}

impl Gaussian {
    fn covariance(&self) -> DMat3 {
        self.axes * self.axes.transpose()
    }

    /// The largest value along a ray.
    fn exact(&self, ray: DVec3) -> f64 {
        let precision = self.covariance().inverse();
        let (toward, own) = (precision * self.mean, precision * ray);
        let along = (toward.dot(ray) / own.dot(ray)).max(0.0);
        let off = along * ray - self.mean;
        (-0.5 * off.dot(precision * off)).exp()
    }

    /// On the plane across its direction.
    fn across_direction(&self, ray: DVec3) -> f64 {
        let direction = self.mean.normalize();
        let (a, b) = direction.any_orthonormal_pair();
        let cosine = ray.dot(direction);
        if cosine < 1e-6 {
            return 0.0;
        }
        let flat = |v: DVec3| DVec2::new(v.dot(a), v.dot(b));
        let columns =
            [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis].map(|axis| flat(axis) / self.mean.length());
        response(flat(ray) / cosine, columns.iter().map(|c| outer(*c)).fold(DMat2::ZERO, |sum, c| sum + c))
    }

    /// Mean and covariance on the image by the derivative of the projection.
    fn affine(&self, camera: &LensCamera) -> Option<(DVec2, DMat2)> {
        let (at, [x, y]) = (camera.see(self.mean)?.0, camera.gradients(self.mean)?);
        let flat = |v: DVec3| DVec2::new(x.dot(v), y.dot(v));
        let columns = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis].map(flat);
        Some((at, columns.iter().map(|c| outer(*c)).fold(DMat2::ZERO, |sum, c| sum + c)))
    }

    /// Mean and covariance on the image of seven points (alpha 1, beta 2, kappa 0, as in 3DGUT).
    fn unscented(&self, camera: &LensCamera) -> Option<(DVec2, DMat2)> {
        let axes = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis].map(|axis| axis * 3_f64.sqrt());
        let around = axes.iter().flat_map(|axis| [self.mean + *axis, self.mean - *axis]);
        let points: Vec<DVec2> = around.map(|p| Some(camera.see(p)?.0)).collect::<Option<_>>()?;
        let mean = points.iter().sum::<DVec2>() / 6.0;
        let center = camera.see(self.mean)?.0;
        let spread = points.iter().map(|p| outer(*p - mean) * (1.0 / 6.0)).fold(DMat2::ZERO, |sum, c| sum + c);
        Some((mean, spread + outer(center - mean) * 2.0))
    }
}

fn outer(v: DVec2) -> DMat2 {
    DMat2::from_cols(v * v.x, v * v.y)
}

fn response(way: DVec2, covariance: DMat2) -> f64 {
    (-0.5 * way.dot(covariance.inverse() * way)).exp()
}

/// Gaussians of a size, radians, at an angle from the axis.
fn gaussians(angle: f64, size: f64) -> Vec<Gaussian> {
    // Evenly spread: sums of fractions of multiples of irrational numbers.
    let fraction = |n: u64, i: u64| (n as f64 * (2.0 + i as f64).sqrt() + 0.618 * i as f64).fract();
    let one = |n: u64| {
        let normal = |i: u64| (0..6).map(|k| fraction(n + 1, 6 * i + k)).sum::<f64>() - 3.0;
        let around = DVec2::new(normal(0), normal(1)).normalize();
        let mean = 3.0 * (around * angle.sin()).extend(angle.cos());
        let rotation = DMat3::from_quat(DQuat::from_xyzw(normal(2), normal(3), normal(4), normal(5)).normalize());
        let scales = DVec3::new(normal(6), normal(7), normal(8)) * 0.5;
        Gaussian { mean, axes: rotation * DMat3::from_diagonal(3.0 * size * scales.exp()) }
    };
    (0..GAUSSIANS).map(one).collect()
}

fn main() {
    println!("sum of |difference| over sum of the reference, %, weighted by solid angle: derivative, unscented, rays");
    let fisheye = (Lens::EQUIDISTANT, lens::fisheye(std::f64::consts::PI, SIDE, SIDE), [SIDE, SIDE]);
    let sphere = (Lens::Equirectangular, lens::equirectangular(2 * SIDE, SIDE), [2 * SIDE, SIDE]);
    for (name, (lens, intrinsics, [width, height]), angles) in [
        ("fisheye of 180 degrees, from the axis", fisheye, [0.0, 45.0, 80.0, 88.0]),
        ("sphere, from the pole", sphere, [90.0, 45.0, 10.0, 2.0]),
    ] {
        let camera = LensCamera::new(Camera { pose: Pose::IDENTITY, intrinsics, width, height }, Some(lens));
        for angle in angles {
            for size in [0.5_f64, 2.0, 8.0] {
                let mut sums = [0.0; 4];
                for mut gaussian in gaussians(f64::to_radians(angle), size.to_radians()) {
                    if lens == Lens::Equirectangular {
                        // The angle is one from the pole.
                        let turn = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
                        gaussian = Gaussian { mean: turn * gaussian.mean, axes: turn * gaussian.axes };
                    }
                    let planes = [gaussian.affine(&camera), gaussian.unscented(&camera)];
                    for pixel in 0..width * height {
                        let at = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                        let Some(ray) = camera.point(at, 1.0) else { continue };
                        let weight = if lens == Lens::Equirectangular { ray.x.hypot(ray.z) } else { 1.0 };
                        let exact = gaussian.exact(ray);
                        let on_image = planes.map(|plane| plane.map_or(0.0, |(mean, s)| response(at - mean, s)));
                        let drawn = [on_image[0], on_image[1], gaussian.across_direction(ray)];
                        (0..3).for_each(|i| sums[i] += weight * (drawn[i] - exact).abs());
                        sums[3] += weight * exact;
                    }
                }
                let [a, b, c] = [0, 1, 2].map(|i| 100.0 * sums[i] / sums[3]);
                println!("{name}: {angle:2} degrees, size {size:3.1}: {a:6.2} {b:6.2} {c:6.2}");
            }
        }
    }
}
