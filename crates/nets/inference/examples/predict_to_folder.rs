//! Photos to a scene with the weights of a training run:
//! `cargo run --release -p weaver-inference --example predict_to_folder -- RUN OUT PHOTOS...`

use std::path::PathBuf;
use weaver_inference::{Error, OutputFolder, PredictOptions, SplatWeaverPredictor, predict_to_folder};

fn main() -> Result<(), Error> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [run, out, photos @ ..] = arguments.as_slice() else {
        return Err(Error::Input("expected RUN OUT PHOTOS...".into()));
    };
    let mut predictor = SplatWeaverPredictor::open(run)?;
    let out = OutputFolder::claim(out, "predict", photos)?;
    let report = predict_to_folder(&mut predictor, photos, &PredictOptions::default(), &out)?;
    println!("{} Gaussians; see {}", report.gaussians, report.overview.display());
    Ok(())
}
