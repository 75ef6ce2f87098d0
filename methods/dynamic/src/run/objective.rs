//! Losses of the stages.

use crate::run::mixture::Mixture;
use crate::run::{ExpertKind, RunError, RunSettings, Stage};
use crate::{Seen, distillation, photometric};
use std::sync::Arc;
use weaver_autograd::{Params, Tape, Var};
use weaver_data::film::Shot;
use weaver_nn::Context;
use weaver_splat::Rasterize;

/// The loss of a stage on one photo. Experts by photos: mean |a - b| for a field, with a share of structural similarity
/// for the others, and the expert's regularizer. The router: both, of the mixture of the photo's `seen` renders.
/// Distillation: [`distillation`], and the expert's regularizer.
pub(crate) fn objective<'t>(
    tape: &'t Tape<f32>,
    (mixture, params, teacher): (&Mixture, &Params<f32>, Option<&Params<f32>>),
    settings: &RunSettings,
    stage: Stage,
    shot: &Shot,
    seen: impl FnOnce() -> Result<Arc<Seen<f32>>, RunError>,
) -> Result<Var<'t, f32>, RunError> {
    let cx = Context::new(tape, params);
    let size = [shot.camera.height, shot.camera.width];
    let pixels = size[0] * size[1];
    let bytes = shot.pixels.bytes()?;
    let photo = tape.constant_with([pixels, 3], |to| {
        to.iter_mut().zip(&*bytes).for_each(|(to, byte)| *to = f32::from(*byte) / 255.0);
    });
    Ok(match stage {
        Stage::Router { .. } => {
            let seen = seen()?;
            let gated = mixture.router().gated_again(cx, &seen, &mixture.shot(tape, &shot.camera, shot.time));
            photometric(gated.image, photo, size)
        }
        Stage::Expert { index, .. } => {
            let image = expert(cx, mixture, index, shot);
            let by_photo = match settings.experts[index] {
                ExpertKind::Field => (image - photo).abs().mean(),
                _ => photometric(image, photo, size),
            };
            regularized(cx, mixture, index, by_photo)
        }
        Stage::Distil { index, lambda, .. } => {
            // The teacher has other parameters, and so another tape: this one holds the student's.
            let told = mixture.pictures(teacher.unwrap_or(params), &shot.camera, shot.time)?;
            let gate = tape.constant(&told.gate[index * pixels..][..pixels], [pixels]);
            let mixed = tape.constant(&told.mixture, [pixels, 3]);
            let image = expert(cx, mixture, index, shot);
            regularized(cx, mixture, index, distillation(image, gate, [photo, mixed], lambda, size))
        }
    })
}

/// An expert's picture `[P, 3]`.
fn expert<'t>(cx: Context<'t, '_, f32>, mixture: &Mixture, index: usize, shot: &Shot) -> Var<'t, f32> {
    let drawn = mixture.shot(cx.tape, &shot.camera, shot.time);
    let [height, width] = drawn.size;
    let op = Rasterize::new(width, height, drawn.settings, drawn.workspaces).without_depth();
    let gaussians = mixture.experts()[index].at(cx, shot.time);
    op.apply(&gaussians, &drawn.camera, drawn.background).image.reshape([height * width, 3])
}

fn regularized<'t>(cx: Context<'t, '_, f32>, mixture: &Mixture, index: usize, loss: Var<'t, f32>) -> Var<'t, f32> {
    let regularizer = mixture.experts()[index].motion().regularizer(cx);
    regularizer.map_or(loss, |regularizer| loss + regularizer)
}
