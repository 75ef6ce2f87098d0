//! Observability of a motion in a corridor: `cargo run -p weaver-lidar --example corridor`.

use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_lidar::{GeometricSettings, PatchTree, register};

fn main() {
    for length in [4.0, 12.0, 40.0] {
        let mut points = Vec::new();
        for i in 0..400 {
            let x = (f64::from(i) / 400.0 - 0.5) * length;
            for k in 0..10 {
                let t = f64::from(k) / 5.0 - 1.0;
                points.extend([DVec3::new(x, -1.0, t), DVec3::new(x, 1.0, t), DVec3::new(x, t, -1.0)]);
            }
        }
        let tree = PatchTree::new(&points);
        let smallest = match register(&points, &tree, &Pose::IDENTITY, &GeometricSettings::default()) {
            Ok(registered) => format!("smallest eigenvalue {:.3e}", registered.equations.eigenvalues()[0]),
            Err(lost) => lost.to_string(),
        };
        println!("{length} m without ends: {smallest}");
    }
}
