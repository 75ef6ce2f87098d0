//! Cameras that surfels are drawn by.

use std::f64::consts::{FRAC_PI_2, TAU};
use weaver_geometry::Intrinsics;
use weaver_geometry::glam::{DVec2, DVec3};

/// Projection of directions to an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// A pinhole: x right, y down, z forward.
    Pinhole(Intrinsics),
    /// Azimuth and elevation: x forward, y left, z up.
    Spherical(Spherical),
}

/// Azimuth and elevation as columns and rows: u = fx atan2(y, x) + cx, v = fy atan2(z, hypot(x, y)) + cy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spherical {
    /// Columns for each radian of azimuth; negative, as azimuth grows to the left.
    pub fx: f64,
    /// Rows for each radian of elevation; negative, as elevation grows upward.
    pub fy: f64,
    /// Column of azimuth 0.
    pub cx: f64,
    /// Row of elevation 0.
    pub cy: f64,
}

/// A lens and the size of its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelCamera {
    /// The projection.
    pub lens: Lens,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl SurfelCamera {
    /// A spherical camera all around, of `width` columns and `height` rows from the elevation `high` down to `low`, in
    /// radians.
    ///
    /// fx = -W / 2 pi, cx = W / 2, fy = -H / (high - low), cy = H high / (high - low).
    ///
    /// ```
    /// use weaver_geometry::glam::DVec3;
    /// let camera = weaver_surfel::SurfelCamera::spherical([360, 40], [-0.2, 0.2]);
    /// let pixel = camera.project(DVec3::new(5.0, 0.0, 0.0));
    /// assert_eq!((pixel.x, pixel.y), (180.0, 20.0));
    /// ```
    pub fn spherical([width, height]: [usize; 2], [low, high]: [f64; 2]) -> Self {
        let (w, h) = (width as f64, height as f64);
        let lens = Spherical { fx: -w / TAU, cx: w / 2.0, fy: -h / (high - low), cy: h * high / (high - low) };
        Self { lens: Lens::Spherical(lens), width, height }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The place of a point of the camera's frame on the image, in pixels; far off the image for a point behind a
    /// pinhole.
    pub fn project(&self, p: DVec3) -> DVec2 {
        match self.lens {
            Lens::Pinhole(_) if p.z < 1e-6 => DVec2::splat(-1e9),
            Lens::Pinhole(k) => k.project(p),
            Lens::Spherical(k) => {
                let (azimuth, elevation) = (p.y.atan2(p.x), p.z.atan2(p.x.hypot(p.y)));
                DVec2::new(k.fx * azimuth + k.cx, k.fy * elevation + k.cy)
            }
        }
    }

    /// The gradients of the column and of the row of [`project`](Self::project) with respect to the point.
    pub fn project_gradients(&self, p: DVec3) -> [DVec3; 2] {
        let gradients = match self.lens {
            Lens::Pinhole(_) if p.z < 1e-6 => return [DVec3::ZERO; 2],
            Lens::Pinhole(k) => {
                let by_z = p / p.z;
                [k.fx / p.z * DVec3::new(1.0, 0.0, -by_z.x), k.fy / p.z * DVec3::new(0.0, 1.0, -by_z.y)]
            }
            Lens::Spherical(k) => {
                let (flat, whole) = (p.x * p.x + p.y * p.y, p.length_squared());
                let across = flat.sqrt();
                let du = k.fx / flat * DVec3::new(-p.y, p.x, 0.0);
                let along = p.z / (whole * across);
                [du, k.fy * DVec3::new(-p.x * along, -p.y * along, across / whole)]
            }
        };
        gradients.map(|g| if g.is_finite() { g } else { DVec3::ZERO })
    }

    /// The direction of length 1 that is seen at a place of the image, in pixels.
    pub fn ray(&self, at: DVec2) -> DVec3 {
        match self.lens {
            Lens::Pinhole(k) => k.unproject(at, 1.0).normalize(),
            Lens::Spherical(k) => {
                let ((sin_az, cos_az), (sin_el, cos_el)) =
                    (((at.x - k.cx) / k.fx).sin_cos(), ((at.y - k.cy) / k.fy).sin_cos());
                DVec3::new(cos_az * cos_el, sin_az * cos_el, sin_el)
            }
        }
    }

    /// The direction at the center of a pixel.
    pub fn pixel_ray(&self, column: usize, row: usize) -> DVec3 {
        self.ray(DVec2::new(column as f64 + 0.5, row as f64 + 0.5))
    }

    /// The number of columns after which the image begins again, for spherical lenses.
    pub fn period(&self) -> Option<f64> {
        match self.lens {
            Lens::Pinhole(_) => None,
            Lens::Spherical(k) => Some(TAU * k.fx.abs()),
        }
    }

    /// Half the columns and half the rows that an ellipse covers at most, around its projected center, from half of its
    /// axes.
    ///
    /// The azimuths of the parallelogram around it are extreme at corners if it is beside the axis, and tan(elevation)
    /// = z / rho is bounded by the bounds of z and of rho. Else it is in a ball, which covers the rows e +- t and the
    /// columns +- asin(sin t / cos e) within the angle t of the elevation e, or all columns where it reaches around a
    /// pole.
    pub(crate) fn reach(&self, center: DVec3, axes: [DVec3; 2]) -> DVec2 {
        match self.lens {
            Lens::Spherical(k) => {
                let ball = || spherical_ball(&k, center, axes[0].length().max(axes[1].length()), self.height);
                spherical_ellipse(&k, center, axes).unwrap_or_else(ball)
            }
            Lens::Pinhole(_) => {
                let (at, near) = (self.project(center), 1e-3 * center.length());
                let corners = corners(axes).map(|corner| center + corner);
                match corners.iter().all(|corner| corner.z > near) {
                    true => corners.iter().fold(DVec2::ZERO, |most, c| most.max((self.project(*c) - at).abs())),
                    false => DVec2::splat(4e9),
                }
            }
        }
    }
}

/// The corners of the parallelogram around an ellipse.
fn corners([a, b]: [DVec3; 2]) -> [DVec3; 4] {
    [a + b, a - b, b - a, -a - b]
}

/// Half the columns and rows that a ball around a center covers.
fn spherical_ball(k: &Spherical, center: DVec3, radius: f64, height: usize) -> DVec2 {
    let distance = center.length();
    let angle = (radius / distance).min(1.0).asin();
    let elevation = center.z.atan2(center.x.hypot(center.y)).abs();
    let around = radius >= distance || elevation + angle >= FRAC_PI_2 - 1e-9;
    let across = (angle.sin() / elevation.cos()).min(1.0).asin() * k.fx.abs();
    let all_rows = 4.0 * height as f64 + 4.0 * k.fy.abs();
    DVec2::new(
        if around { TAU * k.fx.abs() } else { across },
        if radius < distance { angle * k.fy.abs() } else { all_rows },
    )
}

/// Half the columns and rows that an ellipse covers, if it is on one side of the axis.
fn spherical_ellipse(k: &Spherical, center: DVec3, axes: [DVec3; 2]) -> Option<DVec2> {
    let flat = center.x.hypot(center.y);
    let ahead = DVec3::new(center.x / flat, center.y / flat, 0.0);
    let aside = DVec3::new(-ahead.y, ahead.x, 0.0);
    let extent = |along: DVec3| along.dot(axes[0]).hypot(along.dot(axes[1]));
    let nearest = flat - extent(ahead);
    let corners = corners(axes).map(|corner| [flat + corner.dot(ahead), corner.dot(aside)]);
    // False for NaN, too.
    let beside = nearest > 1e-3 * flat && corners.iter().all(|[ahead, _]| *ahead > 1e-3 * flat);
    if !beside {
        return None;
    }
    let (side, rise) = (extent(aside), extent(DVec3::Z));
    let farthest = (flat + extent(ahead)).hypot(side);
    let steepest = |z: f64, rising: bool| z.atan2(if (z > 0.0) == rising { nearest } else { farthest });
    let elevation = center.z.atan2(flat);
    let rows = (steepest(center.z + rise, true) - elevation).max(elevation - steepest(center.z - rise, false));
    let across = corners.iter().map(|[ahead, aside]| aside.abs() / ahead).fold(0.0, f64::max).min(side / nearest);
    Some(DVec2::new(across.atan() * k.fx.abs(), rows * k.fy.abs()))
}
