//! Cuts points along a bend into blocks, and prints the photos and points of each.

use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_reconstruct::partition::{BlockOptions, Sight, Sights, blocks};

fn main() -> Result<(), weaver_reconstruct::partition::BlockError> {
    let place = |i: usize| {
        let angle = 0.01 * i as f64;
        DVec3::new(100.0 * angle.sin(), 0.0, 100.0 * angle.cos())
    };
    let points: Vec<[f32; 3]> = (0..300).map(|i| (place(i) * 1.05).as_vec3().to_array()).collect();
    // A camera at every fifth place, which sees the points within ten places.
    let cameras: Vec<(Pose, Vec<u32>)> = (0..60)
        .map(|c| {
            let pose = Pose { translation: -place(5 * c), ..Pose::IDENTITY };
            let seen = (0..300).filter(|i: &u32| (*i as i32 - 5 * c as i32).abs() <= 10).collect();
            (pose, seen)
        })
        .collect();
    let photos: Vec<Sight> = cameras
        .iter()
        .enumerate()
        .map(|(i, (pose, visible))| Sight { pose: *pose, visible, held_out: i % 8 == 0 })
        .collect();
    let found = blocks(&Sights { points: &points, photos: &photos }, &BlockOptions { count: 4, share: 0.05 })?;
    for (number, block) in found.iter().enumerate() {
        println!("block {number}: {} photos, {} points, {} its own", block.photos.len(), block.points.len(), block.own);
    }
    Ok(())
}
