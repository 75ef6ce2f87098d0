//! A ball from the inside: `cargo run -p weaver-mesh --example ball`.

use weaver_geometry::Pose;
use weaver_mesh::{DistanceField, RangeView};
use weaver_surfel::SurfelCamera;

fn main() -> Result<(), weaver_mesh::MeshError> {
    let camera = SurfelCamera::spherical([360, 180], [-1.57, 1.57]);
    let range = vec![2.0; camera.pixels()];
    let view = RangeView { camera: &camera, pose: Pose::IDENTITY, range: &range, normal: &[] };
    for voxel in [0.2, 0.1, 0.05] {
        let mesh = DistanceField::new(&[view], voxel, 3.0 * voxel)?.mesh();
        let exact = 16.0 * std::f64::consts::PI;
        println!("cells of {voxel} m: {} triangles, area {:.2} of {exact:.2} m^2", mesh.triangles.len(), mesh.area());
    }
    Ok(())
}
