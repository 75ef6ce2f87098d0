//! Training of the router and its alternatives, and their figures on the held-out camera.

use super::frames::{FRAMES, seen};
use super::world::{CAMERAS, EXPERTS, HELD_OUT, PIXELS, SIZE, World};
use crate::alternatives::{MlpRouter, VolumeRouter};
use crate::oracle::blend;
use weaver_autograd::{Params, Tape, Var};
use weaver_dynamic::{Gated, PixelRouter, RouterConfig, Score, Shot, hard_oracle, photometric, scores};
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Builder, Context, Group, RAdam};
use weaver_splat::{GaussianVars, Rasterize};

/// Steps of the published run, and the factor on its rates at the end.
const RUN: f64 = 10_000.0;
const FALL: f64 = 0.01;
/// Difference in some channel above which experts are distinct at a pixel; difference of squared errors below which
/// they are equally good.
const DIFFER: f64 = 2.0 / 255.0;
const EQUAL: f64 = 1e-4;

/// The experts' pictures and the photo of one shot.
pub struct View {
    pub images: Vec<f32>,
    pub photo: Vec<f32>,
}

/// All shots, `[camera][frame]`.
pub fn views(world: &World) -> Vec<Vec<View>> {
    let owners = world.owners();
    let mut params = Params::new();
    let router = PixelRouter::new(Builder::new(&mut params, 0), &owners, RouterConfig::default());
    let view = |camera: usize, frame: usize| {
        let tape = Tape::new();
        let shot = world.shot(&tape, camera, frame);
        let op = Rasterize::new(SIZE[1], SIZE[0], shot.settings, shot.workspaces).without_depth();
        let photo = op.apply(&world.true_gaussians(&tape, frame), &shot.camera, shot.background).image.to_vec();
        let gaussians = world.expert_gaussians(&tape, frame);
        let cx = Context::new(&tape, &params);
        View { images: tape.without_gradient(|| router.gated(cx, &gaussians, &shot).images.to_vec()), photo }
    };
    (0..CAMERAS).map(|camera| (0..FRAMES).map(|frame| view(camera, frame)).collect()).collect()
}

/// The camera and the frame of a step: any but those held out.
fn chosen(seed: u64, step: u64) -> (usize, usize) {
    let stream = Stream::new(seed, step, "shots");
    let camera = stream.below(0, CAMERAS - 1);
    (camera + usize::from(camera >= HELD_OUT), 2 * stream.below(1, FRAMES / 2))
}

/// A router, and the Gaussians that it draws.
pub struct Routed {
    pub params: Params<f32>,
    pub router: PixelRouter,
    pub rows: Vec<u32>,
    config: RouterConfig,
}

impl Routed {
    pub fn new(world: &World, config: RouterConfig, seed: u64) -> Self {
        let mut params = Params::new();
        let owners = world.owners();
        let router = PixelRouter::new(Builder::new(&mut params, seed), &owners, config);
        Self { params, router, rows: (0..owners.len() as u32).collect(), config }
    }

    /// The same router on a selection of its Gaussians.
    pub fn pruned(&self, world: &World, rows: &[u32]) -> Self {
        let owners = world.owners();
        let kept: Vec<u32> = rows.iter().map(|row| self.rows[*row as usize]).collect();
        let own: Vec<usize> = kept.iter().map(|row| owners[*row as usize]).collect();
        let mut params = Params::new();
        let router = PixelRouter::new(Builder::new(&mut params, 0), &own, self.config);
        for id in params.ids().collect::<Vec<_>>() {
            let old = self.params.iter().find(|(_, p)| p.name() == params.get(id).name()).expect("the same names").1;
            let values: Vec<f32> = if id == router.base() || id == router.time() {
                let width = old.value().len() / self.rows.len();
                rows.iter().flat_map(|row| old.value()[*row as usize * width..][..width].to_vec()).collect()
            } else {
                old.value().to_vec()
            };
            params.value_mut(id).copy_from_slice(&values);
        }
        Self { params, router, rows: kept, config: self.config }
    }

    fn drawn<'a, 't>(
        &self,
        world: &'a World,
        tape: &'t Tape<f32>,
        [camera, frame]: [usize; 2],
    ) -> (GaussianVars<'t, f32>, Shot<'a, 't, f32>) {
        (world.expert_gaussians(tape, frame).gathered(&self.rows), world.shot(tape, camera, frame))
    }

    /// Steps with the published rates; `w_alone` freezes the weights of directions and time.
    pub fn train(&mut self, world: &World, views: &[Vec<View>], steps: std::ops::Range<u64>, seed: u64, w_alone: bool) {
        let (base, time) = (self.router.base(), self.router.time());
        let trained = self.params.ids().filter(|id| !w_alone || *id != time).collect();
        let mut optimizer = RAdam::new(trained, 0.9, 0.999, 1e-8);
        let mut tape = Tape::new();
        for step in steps {
            let (camera, frame) = chosen(seed, step);
            {
                let (gaussians, shot) = self.drawn(world, &tape, [camera, frame]);
                let image = self.router.gated(Context::new(&tape, &self.params), &gaussians, &shot).image;
                loss(&tape, image, &views[camera][frame]).backward();
            }
            let before = w_alone.then(|| self.params.get(base).value().to_vec());
            let rate = 0.5 * FALL.powf(step as f64 / RUN);
            optimizer.step(&mut self.params, &mut tape, |id| if id == base { rate } else { 0.05 });
            if let Some(before) = before {
                let rows = self.params.value_mut(base).chunks_mut(2).zip(before.chunks(2));
                rows.for_each(|(row, before)| row[1] = before[1]);
            }
            tape.reset();
        }
    }

    /// The gate on the held-out camera with a temperature of choice, and its picture.
    pub fn shown(&self, world: &World, temperature: f64) -> impl Fn(usize) -> (Vec<f64>, Vec<f64>) {
        move |frame| {
            let tape = Tape::new();
            let (gaussians, shot) = self.drawn(world, &tape, [HELD_OUT, frame]);
            tape.without_gradient(|| {
                let Gated { logits, images, .. } =
                    self.router.gated(Context::new(&tape, &self.params), &gaussians, &shot);
                let gate = (logits * (1.0 / temperature)).softmax(0).to_vec();
                let gate: Vec<f64> = gate.into_iter().map(f64::from).collect();
                (blend(&images.to_vec(), &gate, PIXELS), gate)
            })
        }
    }

    /// A score over all training shots.
    pub fn scores(&self, world: &World, score: Score) -> Vec<f64> {
        let mut sum = vec![0.0; self.rows.len()];
        for camera in (0..CAMERAS).filter(|camera| *camera != HELD_OUT) {
            for frame in (0..FRAMES).filter(|frame| seen(*frame)) {
                let own = scores(&self.router, &self.params, score, &|cx| self.drawn(world, cx.tape, [camera, frame]));
                sum.iter_mut().zip(own).for_each(|(to, own)| *to += own);
            }
        }
        sum
    }
}

fn loss<'t>(tape: &'t Tape<f32>, image: Var<'t, f32>, view: &View) -> Var<'t, f32> {
    photometric(image, tape.constant(&view.photo, [PIXELS, 3]), SIZE)
}

/// Trains parameters with Adam at one rate, on the pictures of a shot from `draw`.
fn fit(
    params: &mut Params<f32>,
    views: &[Vec<View>],
    [rate, steps]: [f64; 2],
    seed: u64,
    draw: impl for<'t> Fn(Context<'t, '_, f32>, [usize; 2]) -> Var<'t, f32>,
) {
    let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.0 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.999, 1e-8);
    let mut tape = Tape::new();
    for step in 0..steps as u64 {
        let (camera, frame) = chosen(seed, step);
        loss(&tape, draw(Context::new(&tape, params), [camera, frame]), &views[camera][frame]).backward();
        optimizer.step(params, &mut tape, rate);
        tape.reset();
    }
}

/// A trained perceptron on pixels: its figures on the held-out camera.
pub fn by_pixels(world: &World, views: &[Vec<View>], training: [f64; 2], seed: u64) -> Held {
    let mut params = Params::new();
    let router = MlpRouter::new(Builder::new(&mut params, seed), EXPERTS.len(), 64);
    fit(&mut params, views, training, seed, |cx, [camera, frame]| {
        let images = cx.tape.constant(&views[camera][frame].images, [EXPERTS.len(), PIXELS, 3]);
        router.gated(cx, images, &world.shot(cx.tape, camera, frame)).image
    });
    held(&views[HELD_OUT], |frame| {
        let tape = Tape::new();
        let images = tape.constant(&views[HELD_OUT][frame].images, [EXPERTS.len(), PIXELS, 3]);
        let shown = router.gated(Context::new(&tape, &params), images, &world.shot(&tape, HELD_OUT, frame));
        (wide(shown.image), wide(shown.gate))
    })
}

/// One trained number for each Gaussian of the merged scene: its figures on the held-out camera.
pub fn by_volume(world: &World, views: &[Vec<View>], training: [f64; 2], seed: u64) -> Held {
    let mut params = Params::new();
    let router = VolumeRouter::new(Builder::new(&mut params, seed), EXPERTS.len() * world.count());
    fit(&mut params, views, training, seed, |cx, [camera, frame]| {
        router.image(cx, &world.expert_gaussians(cx.tape, frame), &world.shot(cx.tape, camera, frame))
    });
    held(&views[HELD_OUT], |frame| {
        let tape = Tape::new();
        let shot = world.shot(&tape, HELD_OUT, frame);
        let cx = Context::new(&tape, &params);
        (wide(router.image(cx, &world.expert_gaussians(&tape, frame), &shot)), Vec::new())
    })
}

fn wide(x: Var<'_, f32>) -> Vec<f64> {
    x.to_vec().into_iter().map(f64::from).collect()
}

/// Figures of the held-out camera: dB on frames seen and unseen, and the share of pixels with a right first choice of
/// the gate, if there is a gate.
#[derive(Clone, Copy, Default)]
pub struct Held {
    pub seen: f64,
    pub unseen: f64,
    pub right: Option<f64>,
}

/// Evaluates pictures `[P, 3]` and gates `[K, P]` (or nothing) of each frame.
pub fn held(views: &[View], shown: impl Fn(usize) -> (Vec<f64>, Vec<f64>)) -> Held {
    let (mut decibels, mut right, mut told) = ([0.0; 2], 0, 0);
    for (frame, view) in views.iter().enumerate() {
        let (image, gate) = shown(frame);
        let squares = image.iter().zip(&view.photo).map(|(a, b)| (a - f64::from(*b)).powi(2));
        let mean = squares.sum::<f64>() / image.len() as f64;
        decibels[frame % 2] -= 10.0 * mean.log10() / (FRAMES / 2) as f64;
        let best = hard_oracle(&view.images, &view.photo);
        for (pixel, best) in best.into_iter().enumerate().filter(|_| !gate.is_empty()) {
            let color = |k: usize| &view.images[3 * (k * PIXELS + pixel)..][..3];
            let spread = |c: usize| {
                let all = || (0..EXPERTS.len()).map(|k| f64::from(color(k)[c]));
                all().fold(0.0, f64::max) - all().fold(1.0, f64::min)
            };
            if (0..3).all(|c| spread(c) <= DIFFER) {
                continue;
            }
            let photo = &view.photo[3 * pixel..][..3];
            let error = |k: usize| color(k).iter().zip(photo).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 3.0;
            let share = |k: usize| gate[k * PIXELS + pixel];
            let first = (0..EXPERTS.len()).fold(0, |first, k| if share(k) > share(first) { k } else { first });
            told += 1;
            right += usize::from(error(first) <= error(best) + EQUAL);
        }
    }
    Held { seen: decibels[0], unseen: decibels[1], right: (told > 0).then(|| right as f64 / f64::from(told)) }
}
