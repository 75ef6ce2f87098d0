//! The first view of a map.

use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, trajectory};
use weaver_view::Shot;

/// The place of the camera and the point that it looks at, meters from the first scan.
const VIEW: [DVec3; 2] = [DVec3::new(-14.0, 0.0, 9.0), DVec3::new(4.0, 0.0, 0.0)];

/// The first view of a map in meters: from behind and above the place of the first scan, z upward.
pub fn overview() -> Shot {
    let [eye, target] = VIEW;
    let intrinsics = Intrinsics { fx: 560.0, fy: 560.0, cx: 320.0, cy: 240.0 };
    let camera = Camera { pose: trajectory::look_at(eye, target, DVec3::Z), intrinsics, width: 640, height: 480 };
    Shot::new("behind the first scan", camera)
}
