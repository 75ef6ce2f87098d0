//! Alternatives to the mixture's router, trained alike: the same steps and loss.

use super::ROUTER;
use crate::Outcome;
use crate::alternatives::{MlpRouter, VolumeRouter};
use crate::table::Table;
use weaver_autograd::{Params, Tape, Var};
use weaver_data::film::Shot;
use weaver_dynamic::photometric;
use weaver_dynamic::run::Run;
use weaver_kernels::random::Stream;
use weaver_losses::metrics::psnr;
use weaver_nn::{AdamW, Builder, Context, Group};
use weaver_splat::GaussianVars;

/// Rates of the two, each the better of two rates with ideal experts.
const RATES: [f64; 2] = [0.01, 0.2];

enum Router {
    Pixel(MlpRouter),
    Volume(VolumeRouter),
}

impl Router {
    /// The mixture `[P, 3]`; experts are frozen.
    fn image<'t>(&self, tape: &'t Tape<f32>, params: &Params<f32>, run: &Run, shot: &Shot) -> Var<'t, f32> {
        let drawn = run.mixture().shot(tape, &shot.camera, shot.time);
        // Frozen experts, drawn on another tape.
        let (other, cx) = (Tape::new(), Context::new(tape, params));
        let copied = |x: Var<'_, f32>| tape.constant(&x.value(), x.shape());
        let list = other.without_gradient(|| run.mixture().list(Context::new(&other, run.params()), shot.time));
        match self {
            Self::Pixel(router) => {
                let experts = other.without_gradient(|| {
                    let own = run.mixture().shot(&other, &shot.camera, shot.time);
                    run.mixture().router().gated(Context::new(&other, run.params()), &list, &own).images
                });
                router.gated(cx, copied(experts), &drawn).image
            }
            Self::Volume(router) => {
                let list = GaussianVars {
                    means: copied(list.means),
                    quats: copied(list.quats),
                    scales: copied(list.scales),
                    opacities: copied(list.opacities),
                    colors: copied(list.colors),
                };
                router.image(cx, &list, &drawn)
            }
        }
    }
}

pub fn compared(run: &Run, table: &Table) -> Outcome {
    let film = run.film();
    let (training, size) = (film.training(), film.size);
    for (name, rate) in ["pixel router", "volume router"].into_iter().zip(RATES) {
        let mut params = Params::<f32>::new();
        let b = Builder::new(&mut params, run.settings().seed);
        let router = match name {
            "pixel router" => Router::Pixel(MlpRouter::new(b, run.settings().experts.len(), 64)),
            _ => Router::Volume(VolumeRouter::new(b, run.mixture().counts().iter().sum())),
        };
        let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.0 };
        let (mut optimizer, mut tape) = (AdamW::new(vec![group], 0.9, 0.999, 1e-8), Tape::new());
        for step in 0..ROUTER {
            let stream = Stream::new(run.settings().seed, step as u64, "study.shot");
            let shot = &film.shots[training[stream.below(0, training.len())]];
            {
                let image = router.image(&tape, &params, run, shot);
                let photo = tape.constant(&shot.image(size)?.pixels, [size[0] * size[1], 3]);
                photometric(image, photo, size).backward();
            }
            optimizer.step(&mut params, &mut tape, rate);
            tape.reset();
        }
        let mean = |camera: bool, time: bool| -> Outcome<f64> {
            let asked = film.shots.iter().filter(|shot| (shot.held_out.camera, shot.held_out.time) == (camera, time));
            // The number of judged training photos matches the evaluation of runs.
            let step = if camera || time { 1 } else { training.len().div_ceil(32) };
            let all = asked.step_by(step).map(|shot| {
                let tape = Tape::new();
                let image = tape.without_gradient(|| router.image(&tape, &params, run, shot).to_vec());
                shot.image(size).map(|photo| psnr(&image, &photo.pixels))
            });
            let all: Vec<f64> = all.collect::<Result<_, _>>()?;
            Ok(all.iter().sum::<f64>() / all.len() as f64)
        };
        let figures = [mean(true, false)?, mean(false, true)?, mean(false, false)?];
        table.row(name, &figures.map(|psnr| format!("{psnr:.2}")));
    }
    Ok(())
}
