//! MoE-GS: three experts, their features, the gate, the mixture, the losses, and the importance of each Gaussian.

use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape, ops};
use weaver_dynamic::{PixelRouter, RouterConfig, Score, Shot, distillation, photometric, scores};
use weaver_losses::{ssim, ssim_zero_padded};
use weaver_nn::{Builder, Context};
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};

pub fn run<T: Real>(file: Reference) -> Reference {
    // The file spells it otherwise.
    let file = file.with_word(concat!("colo", "urs"), "colors");
    let (width, height) = (file.size("width"), file.size("height"));
    let (size, pixels) = ([height, width], width * height);
    let settings = RasterSettings {
        near: file.number("near"),
        alpha_max: file.number("alpha_max"),
        eps2d: file.number("eps2d"),
        ..RasterSettings::default()
    };
    let owners: Vec<usize> = file.indices("in.expert").into_iter().map(|owner| owner as usize).collect();
    let config = RouterConfig { temperature: file.number("tau"), background_weight: file.number("background_weight") };
    let mut params = Params::<T>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 0), &owners, config);
    file.load(&mut params);
    let workspaces = WorkspacePool::new();

    let tape = Tape::<T>::new();
    let cx = Context::new(&tape, &params);
    let (gaussians, shot) = list(&file, cx.tape, size, settings, &workspaces);
    let gated = router.gated(cx, &gaussians, &shot);
    // Elsewhere a rule of drawing is within rounding.
    let safe = file.mask("safe");
    let at = |per_pixel: usize| {
        let safe = &safe;
        move |i: usize| safe[i / per_pixel % pixels]
    };
    file.check_where("out.image_per_expert", &gated.images.value(), at(3));
    file.check_where("out.alpha_per_expert", &gated.alphas.value(), at(1));
    file.check_where("out.maps", &gated.maps.value(), at(3));
    file.check_where("out.logit", &gated.logits.value(), at(1));
    file.check_where("out.gate", &gated.gate.value(), at(1));
    file.check_where("out.image", &gated.image.value(), at(3));

    let target = file.constant(&tape, "in.target").reshape([pixels, 3]);
    let [shown, truth] = [gated.image, target].map(|image| image.reshape([1, height, width, 3]).permute(&[0, 3, 1, 2]));
    let loss = photometric(gated.image, target, size);
    file.check("out.l1", &(gated.image - target).abs().mean().value());
    file.check("out.ssim_valid", &ssim(shown, truth).value());
    file.check("out.ssim_zero_padded", &ssim_zero_padded(shown, truth).value());
    file.check("out.photometric", &loss.value());
    let distilled = distillation(
        gated.images.slice(0, 1, 1).reshape([pixels, 3]),
        gated.gate.slice(0, 1, 1).reshape([pixels]),
        [target, gated.image],
        file.number("distil_lambda"),
        size,
    );
    file.check("out.distil_expert_1", &distilled.value());

    // One light for all experts: each one's colors in the drawing of the whole list.
    let black = tape.constant(&[T::ZERO; 3], [3]);
    let shares: Vec<_> = (0..router.rows().len())
        .map(|expert| {
            let own = tape.constant_with([owners.len(), 1], |all| {
                all.iter_mut().zip(&owners).for_each(|(x, owner)| *x = if *owner == expert { T::ONE } else { T::ZERO });
            });
            let colors = gaussians.colors * own.expand([owners.len(), 3]);
            let op = Rasterize::new(width, height, settings, &workspaces).without_depth();
            op.apply(&GaussianVars { colors, ..gaussians }, &shot.camera, black)
        })
        .collect();
    let images: Vec<_> = shares.iter().map(|share| share.image.reshape([1, pixels, 3])).collect();
    file.check_where("out.joint_per_expert", &ops::concat(&images, 0).value(), at(3));
    file.check_where("out.joint_transmittance", &(shares[0].alpha * -1.0 + 1.0).value(), at(1));

    let total = file.weighted(gated.image.reshape([height, width, 3]), "cot.image")
        + file.weighted(gated.maps.reshape([router.rows().len(), height, width, 3]), "cot.maps")
        + file.weighted(gated.logits.reshape([router.rows().len(), height, width]), "cot.logit")
        + file.weighted(loss, "cot.photometric");
    file.backward(total);
    file.check_params(&params, &tape);

    for (key, score) in [("contribution", Score::Contribution), ("sensitivity", Score::Sensitivity)] {
        let found = scores(&router, &params, score, &|cx| list(&file, cx.tape, size, settings, &workspaces));
        file.check(&format!("out.{key}"), &found);
    }
    file
}

/// The file's list of Gaussians and its shot, on a tape.
fn list<'a, 't, T: Real>(
    file: &Reference,
    tape: &'t Tape<T>,
    size: [usize; 2],
    settings: RasterSettings,
    workspaces: &'a WorkspacePool<T>,
) -> (GaussianVars<'t, T>, Shot<'a, 't, T>) {
    let of = |name: &str| file.constant(tape, &format!("in.{name}"));
    let [means, quats, scales, opacities, colors] = ["means", "quats", "scales", "opacities", "colors"].map(of);
    let camera = CameraVars { viewmats: of("viewmat").reshape([1, 3, 4]), intrinsics: of("K").reshape([1, 4]) };
    let shot = Shot { camera, time: file.number("time"), size, background: of("background"), settings, workspaces };
    (GaussianVars { means, quats, scales, opacities, colors }, shot)
}
