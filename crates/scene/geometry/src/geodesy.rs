//! Places on the Earth: latitude and longitude, geocentric axes, and frames whose axes are east, north and up.

use crate::Pose;
use glam::{DMat3, DVec3};

/// Semi-major axis of the ellipsoid of WGS 84, meters.
const EQUATOR: f64 = 6_378_137.0;
/// Flattening of that ellipsoid.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Square of its first eccentricity.
const E2: f64 = FLATTENING * (2.0 - FLATTENING);
/// Steps of the latitude's fixed point; each gains more than two digits near the ground.
const STEPS: usize = 8;

/// A place on the Earth, by WGS 84.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Geographic {
    /// Degrees to the north of the equator.
    pub latitude: f64,
    /// Degrees to the east of Greenwich.
    pub longitude: f64,
    /// Meters above the ellipsoid, or above whatever its source measures from.
    pub altitude: f64,
}

impl Geographic {
    /// The place in geocentric axes, meters: x to latitude and longitude 0, z to the north pole.
    ///
    /// ```
    /// use weaver_geometry::geodesy::Geographic;
    /// let place = Geographic { latitude: 0.0, longitude: 90.0, altitude: 10.0 };
    /// assert!((place.to_geocentric().y - 6_378_147.0).abs() < 1e-8);
    /// ```
    pub fn to_geocentric(&self) -> DVec3 {
        let (sin, cos) = self.latitude.to_radians().sin_cos();
        let (sin_l, cos_l) = self.longitude.to_radians().sin_cos();
        let normal = EQUATOR / (1.0 - E2 * sin * sin).sqrt();
        let out = (normal + self.altitude) * cos;
        DVec3::new(out * cos_l, out * sin_l, (normal * (1.0 - E2) + self.altitude) * sin)
    }

    /// The inverse of [`to_geocentric`](Self::to_geocentric), for places away from the center of the Earth.
    pub fn from_geocentric(place: DVec3) -> Self {
        let out = place.x.hypot(place.y);
        let mut latitude = place.z.atan2(out * (1.0 - E2));
        for _ in 0..STEPS {
            let sin = latitude.sin();
            latitude = (place.z + E2 * EQUATOR / (1.0 - E2 * sin * sin).sqrt() * sin).atan2(out);
        }
        let (sin, cos) = latitude.sin_cos();
        // The projection on the ellipsoid's normal, which the poles do not divide by zero.
        let root = (1.0 - E2 * sin * sin).sqrt();
        let altitude = out * cos + place.z * sin - EQUATOR * root;
        Self { latitude: latitude.to_degrees(), longitude: place.y.atan2(place.x).to_degrees(), altitude }
    }

    /// The transform from geocentric axes to a frame at this place with the axes east, north and up.
    pub fn east_north_up(&self) -> Pose {
        let (sin, cos) = self.latitude.to_radians().sin_cos();
        let (sin_l, cos_l) = self.longitude.to_radians().sin_cos();
        let east = DVec3::new(-sin_l, cos_l, 0.0);
        let north = DVec3::new(-sin * cos_l, -sin * sin_l, cos);
        let up = DVec3::new(cos * cos_l, cos * sin_l, sin);
        let rotation = DMat3::from_cols(east, north, up).transpose();
        Pose::new(rotation, -(rotation * self.to_geocentric()))
    }

    /// Another place, in the frame at this place with the axes east, north and up; meters.
    pub fn to_local(&self, other: &Self) -> DVec3 {
        self.east_north_up().apply(other.to_geocentric())
    }
}

/// The origin of a world of meters whose axes are east, north and up, in the frame that its coordinates came from.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(untagged))]
pub enum Origin {
    /// A place on the Earth.
    Geographic(Geographic),
    /// A point of a survey's frame: what is added to coordinates of the world.
    Local {
        /// x, y, z.
        offset: [f64; 3],
    },
}
