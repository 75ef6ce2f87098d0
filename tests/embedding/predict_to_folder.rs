//! Photos to a scene with the weights of a training run: `predict_to_folder RUN OUT`. The photos are synthetic.

use std::path::{Path, PathBuf};
use weaver_inference::{OutputFolder, PredictOptions, SplatWeaverPredictor, predict_to_folder};
use weaver_io::{Image, read_gaussians};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [run, out] = arguments.as_slice() else { return Err("expected RUN OUT".into()) };
    let out = Path::new(out);
    let photos: Vec<PathBuf> = (0..3).map(|view| photo(out, view)).collect::<Result<_, _>>()?;
    let out = OutputFolder::claim(out.join("result"), "example", &photos)?;

    let mut predictor = SplatWeaverPredictor::open(run)?;
    let report = predict_to_folder(&mut predictor, &photos, &PredictOptions::default(), &out)?;

    let scene = read_gaussians(out.path().join("scene.ply"))?;
    assert_eq!(scene.len(), report.gaussians);
    println!("{} Gaussians from {} photos", report.gaussians, photos.len());
    Ok(())
}

/// A photo of a board of squares, seen from a little further to the right each time.
fn photo(folder: &Path, view: usize) -> Result<PathBuf, weaver_io::Error> {
    let mut image = Image::filled(64, 48, [0.2, 0.3, 0.5]);
    for (i, pixel) in image.pixels.chunks_mut(3).enumerate() {
        if ((i % 64 + 3 * view) / 8 + i / 64 / 8) % 2 == 0 {
            pixel.copy_from_slice(&[0.9, 0.7, 0.3]);
        }
    }
    let path = folder.join(format!("photo-{view}.png"));
    image.write_png(&path)?;
    Ok(path)
}
