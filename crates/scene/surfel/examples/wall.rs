//! A range image as characters: `cargo run -p weaver-surfel --example wall`.

use weaver_geometry::Pose;
use weaver_surfel::{Limits, RangeImages, Sight, SurfelCamera, SurfelWorkspace, Surfels};

fn main() -> Result<(), weaver_surfel::RasterError> {
    let mut surfels = Surfels::<f32>::default();
    let turn = std::f32::consts::FRAC_1_SQRT_2;
    for i in 0..8 {
        surfels.push([3.0 + 0.5 * i as f32, i as f32 - 4.0, 0.0], [turn, 0.0, -turn, 0.0], [-1.0, -0.5], 2.0);
    }
    let (camera, poses) = (SurfelCamera::spherical([96, 12], [-0.5, 0.5]), [Pose::IDENTITY]);
    let sight = Sight { surfels: surfels.slices(), camera: &camera, poses: &poses, limits: Limits::default() };
    let mut images = RangeImages::default();
    SurfelWorkspace::new().draw(&sight, &mut images)?;
    for row in images.mean_range().chunks(camera.width) {
        let digit = |r: &f32| if *r > 0.5 { char::from(b'0' + (*r as u8).min(9)) } else { '.' };
        println!("{}", row.iter().map(digit).collect::<String>());
    }
    Ok(())
}
