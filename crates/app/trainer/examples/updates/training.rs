//! Training of the network on places without end.

use crate::network::{FEATURES, Network, OUTPUTS, Seen, state_of};
use crate::place::{Drawer, Loss, NUMBERS, Place, STATE, Shot, WIDTHS, shots};
use crate::{Variant, density};
use std::time::Instant;
use weaver_autograd::{Params, Tape, Var};
use weaver_data::{Layout, Sampler};
use weaver_inference::{CameraSource, Predictor};
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Context, Group, clip_factor, global_norm};
use weaver_procedural::{ProceduralOptions, varied_scene};
use weaver_trainer::{Error, Example};

/// Numbers of steps of the places in training.
const STEPS: [usize; 4] = [16, 32, 60, 150];
/// Steps between looks at the photos that judge, at most.
const WINDOW: usize = 8;
/// Places that are corrected side by side, and the number that a training step goes on with.
const PLACES: usize = 16;
const BATCH: usize = 4;
/// Weight of a photo that the steps see among the judging photos.
const SEEN: f32 = 0.2;
/// Training steps between windows that Adam takes as well, to be compared.
const COMPARED: u64 = 8;
/// Training steps between reports.
const REPORTED: u64 = 150;
const RATE: f64 = 2e-3;
/// Decibels of a difference of logarithms of squared errors.
const DECIBELS: f64 = 10.0 / std::f64::consts::LN_10;

/// Places under way, and the tools to make and correct them.
#[derive(Debug)]
pub struct Training<'n> {
    network: &'n Network,
    variant: Variant,
    predictor: Box<dyn Predictor>,
    drawer: Drawer,
    places: Vec<Place>,
    made: u64,
    /// Gains of windows over Adam, decibels.
    better: Vec<f64>,
}

/// Steps of a window on the tape: the features, the head and its numbers.
type Window<'t> = Vec<(Seen, Var<'t>, Vec<f32>)>;

impl<'n> Training<'n> {
    pub fn new(network: &'n Network, variant: Variant) -> Result<Self, Error> {
        let predictor = weaver_trainer::OpenRun::built_in()?.predictor;
        let drawer = Drawer::new(predictor.raster_settings(), predictor.background());
        Ok(Self { network, variant, predictor, drawer, places: Vec::new(), made: 0, better: Vec::new() })
    }

    /// Trains for `updates` updates, and prints a comparison of windows with Adam's.
    pub fn run(&mut self, params: &mut Params<f32>, updates: u64) {
        let all = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 1e-4 };
        let mut optimizer = AdamW::new(vec![all], 0.9, 0.99, 1e-8);
        let (mut tape, start) = (Tape::new(), Instant::now());
        for update in 0..updates {
            self.refill();
            tape.reset();
            let chosen = Stream::new(3, update, "updates.batch").permutation(self.places.len());
            let terms = chosen.into_iter().take(BATCH).flat_map(|at| {
                let mut place = self.places.swap_remove(at);
                let terms = self.window(&mut place, &tape, params, update);
                self.places.push(place);
                let last = self.places.len() - 1;
                self.places.swap(at, last);
                terms
            });
            if let Some(loss) = terms.reduce(|a, b| a + b) {
                loss.backward();
                let done = update as f64 / updates as f64;
                let rate = RATE * (0.5 + 0.5 * (std::f64::consts::PI * done).cos()).max(0.02);
                let factor = clip_factor(global_norm(params, &tape), 1.0);
                optimizer.step_scaled(params, &mut tape, rate, factor);
            }
            self.places.retain(|place| !place.done());
            if (update + 1).is_multiple_of(REPORTED) {
                self.report(update + 1, start.elapsed().as_secs_f64());
            }
        }
    }

    fn report(&mut self, updates: u64, seconds: f64) {
        let count = self.better.len() as f64;
        let mean = self.better.iter().sum::<f64>() / count;
        let error = self.better.iter().map(|b| (b - mean).powi(2)).sum::<f64>().sqrt() / count;
        println!(
            "{updates} updates, {} places, {seconds:.0} s: windows {mean:+.3} +- {error:.3} dB beside Adam",
            self.made
        );
        self.better.clear();
    }

    /// Makes new places in place of finished ones.
    fn refill(&mut self) {
        while self.places.len() < PLACES {
            self.made += 1;
            let place = self.place(self.made);
            self.places.extend(place);
        }
    }

    /// A procedural scene, predicted by the network from four photos; `None` where the prediction is next to empty.
    fn place(&mut self, number: u64) -> Option<Place> {
        let stream = Stream::new(1, number, "updates.place");
        let [height, width] = self.predictor.image_size();
        let scene = varied_scene(stream.bits(0), &ProceduralOptions { width, height, views: 10 });
        let tuple = Sampler::Nearest { pool: 7 }.tuple(&[Layout::of(&scene)], stream, number, 4, 3);
        let (example, _) = Example::for_evaluation(&scene, tuple).ok().filter(|(_, measured)| *measured)?;
        let source = CameraSource::Given(example.context());
        let prediction = self.predictor.predict(example.context_photos(), source, density(), stream.fork(9)).ok()?;
        let steps = STEPS[stream.below(1, STEPS.len())];
        let targets = shots(example.photos(), &example.cameras).split_off(4);
        let found = || Place::new(example.context_photos(), &prediction, targets, steps, !self.variant.moves);
        (prediction.gaussians.len() >= 100).then(found)
    }

    /// Goes on with a place by a few steps, and returns the terms of the loss: heads times their gradients.
    fn window<'t>(
        &mut self,
        place: &mut Place,
        tape: &'t Tape<f32>,
        params: &Params<f32>,
        update: u64,
    ) -> Vec<Var<'t>> {
        let by_adam = update.is_multiple_of(COMPARED).then(|| place.copied());
        let n = place.population.len();
        let mut window = Window::new();
        let mut state = tape.constant(&place.state(), [n, STATE]);
        while !(window.len() == WINDOW || place.round_is_due() && !window.is_empty() || place.done()) {
            place.look(&mut self.drawer);
            let seen = Seen::of(place, &self.network.without);
            let features = tape.constant(&seen.features, [n, FEATURES]);
            let head = self.network.forward(Context::new(tape, params), features, state, &place.neighbors);
            let values = head.to_vec();
            if !self.network.without.state {
                state = head.slice(1, OUTPUTS - STATE, STATE).tanh();
                place.set_state(&state_of(&values));
            }
            place.apply(&seen.changes(&values));
            window.push((seen, head, values));
        }
        let (slopes, error) = self.judged(place, update);
        if let Some(mut other) = by_adam {
            for _ in 0..window.len() {
                other.look(&mut self.drawer);
                let seen = Seen::of(&mut other, &self.network.without);
                other.apply(&seen.changes(&vec![0.0; n * OUTPUTS]));
            }
            let adam = self.judged(&other, update).1;
            self.better.push((adam - error) * DECIBELS);
        }
        if place.round_is_due() {
            place.move_density();
        }
        // The later effect of a change is taken to equal its immediate effect.
        let terms = window.into_iter().map(|(seen, head, values)| (head, seen.pull_back(&values, &slopes)));
        let finite = terms.filter(|(_, gradient)| gradient.iter().all(|x| x.is_finite()));
        finite.map(|(head, gradient)| (head * tape.constant(&gradient, [n, OUTPUTS])).sum()).collect()
    }

    /// Gradients `[N, 23]` of the logarithm of the squared error of the photos that judge, and that logarithm.
    fn judged(&mut self, place: &Place, number: u64) -> (Vec<f32>, f64) {
        let (mut sum, mut error) = (vec![0.0; place.population.len() * NUMBERS], 0.0);
        let judges = if self.variant.others { &place.context } else { &place.targets };
        let weight = 1.0 / judges.len() as f32;
        let mut all: Vec<(&Shot, f32)> = judges.iter().map(|shot| (shot, weight)).collect();
        if !self.variant.others {
            let seen = Stream::new(2, number, "updates.judge").below(1, place.context.len());
            all.push((&place.context[seen], SEEN));
        }
        let mut gradients: [Vec<f32>; 6] = Default::default();
        for (i, (shot, weight)) in all.into_iter().enumerate() {
            let mse = self.drawer.gradients(
                &place.population,
                shot,
                Loss::LogSquare,
                Default::default(),
                None,
                &mut gradients,
            );
            if i < judges.len() {
                error += f64::from(weight) * mse.max(1e-6).ln();
            }
            let mut from = 0;
            for (gradients, width) in gradients.iter().zip(WIDTHS) {
                for (row, to) in gradients.chunks_exact(width).zip(sum.chunks_exact_mut(NUMBERS)) {
                    row.iter().zip(&mut to[from..]).for_each(|(g, to)| *to += weight * g);
                }
                from += width;
            }
        }
        (sum, error)
    }
}
