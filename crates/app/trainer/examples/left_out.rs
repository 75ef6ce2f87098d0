//! Study of stopping by left-out photos: for each place, the number of refinement steps at which its photos, left out
//! in turn, are predicted best.
//!
//! `cargo run --release -p weaver-trainer --example left_out -- STEPS,STEPS,.. DIR..`
//!
//! Each photo of a prediction is left out of one refinement, and judges it after each number of steps; the number with
//! the best mean then refines on all. Prints PSNR on held-out photos after each number, and after that choice. The
//! weights that come with the program, given cameras, 0.3 Gaussians per pixel, one thread; DIR are captures.

use std::path::PathBuf;
use weaver_geometry::Camera;
use weaver_inference::{CameraSource, Density, Effort, Photos, Prediction, Predictor, Refined};
use weaver_kernels::random::Stream;
use weaver_losses::metrics::psnr;
use weaver_splat::{RasterSettings, Renderer};
use weaver_trainer::{Error, EvalOptions, Source};

type InferenceError = weaver_inference::Error;
type Predicted = Result<Prediction, InferenceError>;

/// Gaussians per pixel.
const BUDGET: f64 = 0.3;

/// A predictor that returns a given prediction.
#[derive(Debug, Default)]
struct Again {
    prediction: Prediction,
    size: [usize; 2],
    settings: RasterSettings,
    background: [f32; 3],
    renderer: Renderer,
}

impl Predictor for Again {
    fn predict(&mut self, _: Photos<'_>, _: CameraSource<'_>, _: Density, _: Stream) -> Predicted {
        Ok(self.prediction.clone())
    }

    fn image_size(&self) -> [usize; 2] {
        self.size
    }

    fn raster_settings(&self) -> RasterSettings {
        self.settings
    }

    fn background(&self) -> [f32; 3] {
        self.background
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }
}

/// A predictor whose Gaussians are refined, by a fixed number of steps or by the best number for left-out photos.
#[derive(Debug)]
struct Stopped {
    inner: Box<dyn Predictor>,
    steps: Vec<usize>,
}

impl Stopped {
    /// The prediction refined on some of the photos.
    fn refined(&self, prediction: &Prediction, photos: Photos<'_>, used: &[usize], steps: usize) -> Predicted {
        let each = 3 * photos.height * photos.width;
        let planes: Vec<f32> = used.iter().flat_map(|i| &photos.planes[i * each..][..each]).copied().collect();
        let cameras: Vec<Camera> = used.iter().map(|i| prediction.cameras[*i]).collect();
        let again = Again {
            prediction: Prediction { cameras: cameras.clone(), ..prediction.clone() },
            size: self.inner.image_size(),
            settings: self.inner.raster_settings(),
            background: self.inner.background(),
            renderer: Renderer::default(),
        };
        let mut refined = Refined::new(Box::new(again), self.inner.image_size(), Effort::Steps(steps));
        let photos = Photos { planes: &planes, inside: None, ..photos };
        refined.predict(photos, CameraSource::Given(&cameras), Density::default(), Stream::new(0, 0, "none"))
    }

    /// PSNR of a photo that takes no part.
    fn left_out(
        &mut self,
        prediction: &Prediction,
        photos: Photos<'_>,
        photo: usize,
        steps: usize,
    ) -> Result<f64, InferenceError> {
        let used: Vec<usize> = (0..photos.views()).filter(|i| *i != photo).collect();
        let refined = self.refined(prediction, photos, &used, steps)?;
        // The first photo that takes part is the origin.
        let camera = prediction.cameras[photo];
        let camera = Camera { pose: camera.pose.relative_to(&prediction.cameras[used[0]].pose), ..camera };
        let (settings, background) = (self.inner.raster_settings(), self.inner.background());
        let drawn = self.inner.renderer().render(&refined.gaussians, &[camera], background, &settings);
        let drawn = drawn.map_err(|error| InferenceError::Input(error.to_string()))?;
        let pixels = photos.height * photos.width;
        let planes = &photos.planes[3 * pixels * photo..];
        let truth: Vec<f32> = (0..3 * pixels).map(|i| planes[i % 3 * pixels + i / 3]).collect();
        Ok(psnr(&drawn[0], &truth))
    }

    /// The best number of steps for left-out photos.
    fn chosen(&mut self, prediction: &Prediction, photos: Photos<'_>) -> Result<usize, InferenceError> {
        let mut best = (f64::NEG_INFINITY, 0);
        for steps in self.steps.clone() {
            let judged = (0..photos.views()).map(|photo| self.left_out(prediction, photos, photo, steps));
            let sum: f64 = judged.sum::<Result<f64, _>>()?;
            if sum > best.0 {
                best = (sum, steps);
            }
        }
        Ok(best.1)
    }
}

impl Predictor for Stopped {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        cameras: CameraSource<'_>,
        density: Density,
        stream: Stream,
    ) -> Predicted {
        let prediction = self.inner.predict(photos, cameras, density, stream)?;
        let steps = if let [steps] = self.steps[..] { steps } else { self.chosen(&prediction, photos)? };
        let all: Vec<usize> = (0..photos.views()).collect();
        self.refined(&prediction, photos, &all, steps)
    }

    fn density(&self, asked: Density) -> Result<Density, InferenceError> {
        self.inner.density(asked)
    }

    fn image_size(&self) -> [usize; 2] {
        self.inner.image_size()
    }

    fn max_per_pixel(&self) -> usize {
        self.inner.max_per_pixel()
    }

    fn raster_settings(&self) -> RasterSettings {
        self.inner.raster_settings()
    }

    fn background(&self) -> [f32; 3] {
        self.inner.background()
    }

    fn renderer(&mut self) -> &mut Renderer {
        self.inner.renderer()
    }
}

fn main() -> Result<(), Error> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [steps, folders @ ..] = &arguments[..] else {
        println!("expected STEPS,STEPS,.. DIR..");
        return Ok(());
    };
    let number = |text: &str| text.parse().map_err(|_| Error::Input(format!("STEPS: expected a number, found {text}")));
    let steps = steps.split(',').map(number).collect::<Result<Vec<usize>, Error>>()?;
    let source = Source::Folders(folders.iter().map(PathBuf::from).collect());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be had");
    println!("| steps | PSNR | of each capture |\n|---|---|---|");
    for steps in steps.iter().map(|steps| vec![*steps]).chain([steps.clone()]) {
        pool.install(|| judge(steps, &source))?;
    }
    Ok(())
}

fn judge(steps: Vec<usize>, source: &Source) -> Result<(), Error> {
    let name = if let [steps] = steps[..] { steps.to_string() } else { "chosen".into() };
    let mut run = weaver_trainer::OpenRun::built_in()?;
    run.predictor = Box::new(Stopped { inner: run.predictor, steps });
    let density = Density { budget: Some(BUDGET), ..Density::default() };
    let found = run.evaluate(source, &EvalOptions { density, ..EvalOptions::default() }, &mut |_, _| ())?;
    let each: Vec<String> = (found.scenes.iter())
        .map(|scene| format!("{} {:.2}", scene.name.as_deref().unwrap_or("mean"), scene.psnr))
        .collect();
    println!("| {name} | {:.3} | {} |", found.mean.psnr, each.join(", "));
    Ok(())
}
