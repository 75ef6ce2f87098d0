//! Photographs a procedural scene as a capture of its own, with photos as large as wanted:
//! `cargo run --release -p weaver-data --example large_capture DIR WIDTH HEIGHT VIEWS [SEED]`.
//!
//! Writes photos, exact cameras (transforms.json) and points on surfaces (points3D.ply, up to 400 from each view's
//! depth), which `splatweaver fit DIR` and other programs read as they read any capture.

use std::path::Path;
use weaver_data::procedural::{ProceduralOptions, varied_scene};
use weaver_geometry::glam::DVec2;
use weaver_io::Transforms;
use weaver_scene::{Frame, PointCloud};

/// Of the grid from which points of a view are taken, in each direction.
const ACROSS: usize = 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, width, height, views, seed @ ..] = arguments.as_slice() else {
        return Err("expected DIR WIDTH HEIGHT VIEWS [SEED]".into());
    };
    let options = ProceduralOptions { width: width.parse()?, height: height.parse()?, views: views.parse()? };
    let seed = seed.first().map_or(Ok(0), |seed| seed.parse())?;
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder.join("images"))?;

    let (mut transforms, mut points) = (Transforms::default(), PointCloud::default());
    for (i, view) in varied_scene(seed, &options).views.iter().enumerate() {
        let name = format!("images/{i:04}.png");
        view.image.write_png(folder.join(&name))?;
        transforms.frames.push(Frame::new(name, view.camera));
        let depth = view.depth.as_deref().unwrap_or_default();
        for (row, column) in (0..ACROSS).flat_map(|row| (0..ACROSS).map(move |column| (row, column))) {
            let (x, y) =
                ((2 * column + 1) * options.width / (2 * ACROSS), (2 * row + 1) * options.height / (2 * ACROSS));
            let pixel = y * options.width + x;
            let z = depth.get(pixel).copied().unwrap_or(0.0);
            if z > 0.0 {
                let place = view.camera.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), z.into());
                points.positions.push(place.as_vec3().to_array());
                points.colors.push(std::array::from_fn(|c| (255.0 * view.image.pixels[3 * pixel + c]).round() as u8));
            }
        }
    }
    weaver_io::ply::write_points(folder.join("points3D.ply"), &points)?;
    transforms.write(folder.join("transforms.json"))?;
    println!("{} photos, {} points", transforms.frames.len(), points.positions.len());
    Ok(())
}
