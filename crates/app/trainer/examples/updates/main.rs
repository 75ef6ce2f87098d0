//! Study of learned updates: a network corrects Adam's steps of a refinement, and is trained by photos that it does not
//! see.
//!
//! `cargo run --release -p weaver-trainer --example updates -- WEIGHTS UPDATES VARIANT CHOSEN.. -- OTHERS..`
//!
//! Trains on procedural scenes for UPDATES updates and writes the weights, or reads them if UPDATES is 0; then judges
//! held-out photos of two sets of captures. VARIANT is `all`, or the parts to leave out, joined by `+`: `attention`,
//! `neighbors`, `gradients`, `state`, `others` (photos that are not seen do not count in training), `moves` (of
//! density), `learning` (Adam alone). The weights that come with the program, given cameras, 0.3 Gaussians per pixel,
//! one thread.

mod network;
mod place;
mod training;

use network::{FEATURES, Network, OUTPUTS, Seen, Without};
use place::{Drawer, Place, STATE};
use std::path::PathBuf;
use std::time::Instant;
use training::Training;
use weaver_autograd::{Params, Tape};
use weaver_inference::{CameraSource, Density, Photos, Prediction, Predictor};
use weaver_kernels::random::Stream;
use weaver_nn::Context;
use weaver_splat::{RasterSettings, Renderer};
use weaver_trainer::{Error, EvalOptions, Source};

/// Gaussians per pixel.
const BUDGET: f64 = 0.3;
/// Steps that are judged.
const JUDGED: [usize; 5] = [16, 32, 60, 150, 300];

/// Parts that are left out.
#[derive(Clone, Copy, Debug, Default)]
struct Variant {
    without: Without,
    others: bool,
    moves: bool,
    learning: bool,
}

impl Variant {
    fn of(text: &str) -> Self {
        let has = |name: &str| text.split('+').any(|part| part == name);
        let without = Without {
            attention: has("attention"),
            neighbors: has("neighbors"),
            gradients: has("gradients"),
            state: has("state"),
        };
        Self { without, others: has("others"), moves: has("moves"), learning: has("learning") }
    }
}

fn density() -> Density {
    Density { budget: Some(BUDGET), ..Density::default() }
}

/// Takes all steps of a place, without recording.
fn correct(place: &mut Place, drawer: &mut Drawer, network: &Network, params: &Params<f32>, learned: bool) {
    let mut tape = Tape::new();
    while !place.done() {
        place.look(drawer);
        let seen = Seen::of(place, &network.without);
        let n = place.population.len();
        let mut head = vec![0.0; n * OUTPUTS];
        if learned {
            tape.reset();
            head = tape.without_gradient(|| {
                let features = tape.constant(&seen.features, [n, FEATURES]);
                let state = tape.constant(&place.state(), [n, STATE]);
                network.forward(Context::new(&tape, params), features, state, &place.neighbors).to_vec()
            });
        }
        place.apply(&seen.changes(&head));
        if !network.without.state {
            place.set_state(&network::state_of(&head));
        }
        if place.round_is_due() {
            place.move_density();
        }
    }
}

/// A predictor whose Gaussians are corrected.
#[derive(Debug)]
struct Corrected {
    inner: Box<dyn Predictor>,
    network: &'static Network,
    params: &'static Params<f32>,
    steps: usize,
    variant: Variant,
}

impl Predictor for Corrected {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        cameras: CameraSource<'_>,
        density: Density,
        stream: Stream,
    ) -> Result<Prediction, weaver_inference::Error> {
        let mut prediction = self.inner.predict(photos, cameras, density, stream)?;
        let mut place = Place::new(photos, &prediction, Vec::new(), self.steps, !self.variant.moves);
        let mut drawer = Drawer::new(self.inner.raster_settings(), self.inner.background());
        correct(&mut place, &mut drawer, self.network, self.params, !self.variant.learning);
        prediction.gaussians = place.gaussians().to_activated();
        Ok(prediction)
    }

    fn density(&self, asked: Density) -> Result<Density, weaver_inference::Error> {
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

/// Prints the quality of held-out photos of both sets after each number of steps.
fn judge(
    network: &'static Network,
    params: &'static Params<f32>,
    variant: Variant,
    sets: &[String],
) -> Result<(), Error> {
    println!("| steps | chosen on, dB | others, dB | seconds |\n|---|---|---|---|");
    for steps in JUDGED {
        let mut run = weaver_trainer::OpenRun::built_in()?;
        run.predictor = Box::new(Corrected { inner: run.predictor, network, params, steps, variant });
        let options = EvalOptions { density: density(), ..EvalOptions::default() };
        let start = Instant::now();
        let found = sets.split(|word| word == "--").filter(|set| !set.is_empty()).map(|set| {
            let source = Source::Folders(set.iter().map(PathBuf::from).collect());
            Ok(format!("{:.3}", run.evaluate(&source, &options, &mut |_, _| ())?.mean.psnr))
        });
        let found = found.collect::<Result<Vec<_>, Error>>()?;
        println!("| {steps} | {} | {:.1} |", found.join(" | "), start.elapsed().as_secs_f64());
    }
    Ok(())
}

fn main() -> Result<(), Error> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, updates, variant, sets @ ..] = &arguments[..] else {
        println!("expected WEIGHTS UPDATES VARIANT CHOSEN.. -- OTHERS..");
        return Ok(());
    };
    let updates: u64 = updates.parse().map_err(|_| Error::Input("UPDATES: expected a number".into()))?;
    let variant = Variant::of(variant);
    let failed = |error: std::io::Error| Error::Input(format!("{file}: {error}"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be had");
    pool.install(|| {
        let mut params = Params::new();
        let network = Network::new(&mut params, 0, variant.without);
        let ids: Vec<_> = params.ids().collect();
        if updates > 0 {
            Training::new(&network, variant)?.run(&mut params, updates);
            let numbers = ids.iter().flat_map(|id| params.get(*id).value());
            std::fs::write(file, numbers.flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>()).map_err(failed)?;
        } else if !variant.learning {
            let bytes = std::fs::read(file).map_err(failed)?;
            let mut numbers = bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
            for id in ids {
                params.value_mut(id).iter_mut().zip(&mut numbers).for_each(|(to, x)| *to = x);
            }
        }
        // The study ends with this.
        judge(Box::leak(Box::new(network)), Box::leak(Box::new(params)), variant, sets)
    })
}
