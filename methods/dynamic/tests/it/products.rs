//! Gradients and scores of the router by sparse products.

use crate::wall::{self, COUNT, Moment, PIXELS, SIZE};
use std::sync::Mutex;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Tape};
use weaver_dynamic::{PixelRouter, RouterConfig, Score, photometric, scores};
use weaver_nn::{Builder, Context};
use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
use weaver_splat::{GaussianVars, Images, Workspace, WorkspacePool, rasterize};

const AT: Moment = Moment { angle: 15.0, time: 0.4 };

/// The gradient by w is sum_u b_k T_i alpha_i, b_k = G_k / tau (g_k - sum_j G_j g_j), g_k = dl/dI I_k.
#[test]
fn the_gradient_by_weights_is_a_sparse_product() {
    let tau = 0.5;
    let config = RouterConfig { temperature: tau, ..RouterConfig::default() };
    let mut params = Params::<f64>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 3), &wall::owners(), config);
    let noise = Input::uniform(5, -0.5, 0.5, [4 * COUNT]).data;
    params.value_mut(router.base()).iter_mut().zip(noise).for_each(|(x, n)| *x += n);
    let (tape, pool) = (Tape::new(), WorkspacePool::new());
    let shot = wall::shot(&tape, &pool, AT);
    let gaussians = wall::experts(&tape, wall::left, AT);
    let gated = router.gated(Context::new(&tape, &params), &gaussians, &shot);
    let image = gated.image.retain_grad();
    photometric(image, tape.constant(&wall::photo(&shot), [PIXELS, 3]), SIZE).backward();
    let (by_image, gate, images) = (image.grad().unwrap(), gated.gate.to_vec(), gated.images.to_vec());
    let along =
        |k: usize, u: usize| (0..3).map(|c| by_image[3 * u + c] * images[3 * (k * PIXELS + u) + c]).sum::<f64>();
    let mixed = |u: usize| (0..2).map(|k| gate[k * PIXELS + u] * along(k, u)).sum::<f64>();
    let found = tape.param_grad(router.base()).unwrap().to_vec();
    for (k, rows) in router.rows().iter().enumerate() {
        let b: Vec<f64> = (0..PIXELS).map(|u| gate[k * PIXELS + u] / tau * (along(k, u) - mixed(u))).collect();
        let own = gaussians.gathered(rows);
        let [means, quats, scales, opacities] =
            [own.means, own.quats, own.scales, own.opacities].map(|values| values.to_vec());
        let scene = GaussianSlices {
            means: &means,
            quats: &quats,
            scales: &scales,
            opacities: &opacities,
            color: Color::None,
            features: None,
            groups: None,
        };
        let [viewmats, intrinsics] = [shot.camera.viewmats, shot.camera.intrinsics].map(|values| values.to_vec());
        let cameras = CameraSlices {
            viewmats: &viewmats,
            intrinsics: &intrinsics,
            background: &[0.0; 3],
            width: SIZE[1],
            height: SIZE[0],
            model: Model::Pinhole,
        };
        let (mut workspace, mut alpha) = (Workspace::new(), [0.0; PIXELS]);
        let drawn = Images { image: &mut [], alpha: &mut alpha, depth: None, features: None };
        rasterize(&scene, &cameras, &shot.settings, &mut workspace, drawn).unwrap();
        let sums = Mutex::new(vec![0.0; rows.len()]);
        workspace.for_each_hit(|pixel, i, weight, _| sums.lock().unwrap()[i] += b[pixel] * weight).unwrap();
        for (row, sum) in rows.iter().zip(sums.into_inner().unwrap()) {
            let found = found[2 * *row as usize];
            assert!((found - sum).abs() < 1e-15 + 1e-11 * sum.abs(), "{row}: {found} {sum}");
        }
    }
    assert!(found.iter().step_by(2).filter(|g| g.abs() > 1e-7).count() > COUNT, "most of them are seen");
}

/// Cached renders are gated as new ones: pictures, and gradients by all parameters of the router.
///
/// Promise of `products_are_drawings`.
#[test]
fn what_was_seen_is_gated_as_what_is_drawn() {
    let mut params = Params::<f64>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 3), &wall::owners(), RouterConfig::default());
    for id in params.ids().collect::<Vec<_>>() {
        let noise = Input::uniform(5, -0.5, 0.5, params.get(id).shape()).data;
        params.value_mut(id).iter_mut().zip(noise).for_each(|(x, n)| *x += n);
    }
    let pool = WorkspacePool::new();
    let run = |again: bool| {
        let tape = Tape::new();
        let cx = Context::new(&tape, &params);
        let (gaussians, shot) = (wall::experts(&tape, wall::left, AT), wall::shot(&tape, &pool, AT));
        let gated = if again {
            let seen = router.see(&gaussians, &shot, &mut Workspace::new()).unwrap();
            assert!(seen.bytes() > 8 * (8 * PIXELS));
            router.gated_again(cx, &seen, &shot)
        } else {
            router.gated(cx, &gaussians, &shot)
        };
        photometric(gated.image, tape.constant(&wall::photo(&shot), [PIXELS, 3]), SIZE).backward();
        let mut all = [gated.image, gated.images, gated.alphas, gated.maps, gated.gate].map(|x| x.to_vec()).to_vec();
        all.extend(params.ids().map(|id| tape.param_grad(id).expect("a gradient").to_vec()));
        all
    };
    for (part, (drawn, again)) in run(false).iter().zip(run(true)).enumerate() {
        assert_eq!(drawn.len(), again.len(), "{part}");
        assert!(drawn.iter().any(|x| *x != 0.0), "{part}");
        for (a, b) in drawn.iter().zip(again) {
            assert!((a - b).abs() < 1e-13 + 1e-11 * a.abs(), "{part}: {a} {b}");
        }
    }
}

/// One Gaussian behind the camera and one too faint to be drawn.
const BEHIND: usize = 6;
const FAINT: usize = COUNT + 30;

fn with_hidden(tape: &Tape<f32>) -> GaussianVars<'_, f32> {
    let all = wall::experts(tape, wall::left, AT);
    let (mut means, mut opacities) = (all.means.to_vec(), all.opacities.to_vec());
    means[3 * BEHIND + 2] = -30.0;
    opacities[FAINT] = 0.99 / 255.0;
    let (means, opacities) = (tape.constant(&means, [2 * COUNT, 3]), tape.constant(&opacities, [2 * COUNT]));
    GaussianVars { means, opacities, ..all }
}

/// Gaussians out of sight, and too faint ones: their scores are zero, and without them no bit changes.
#[test]
fn what_is_worth_nothing_can_go() {
    let workspaces = WorkspacePool::new();
    let mut params = Params::<f32>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 3), &wall::owners(), RouterConfig::default());
    let noise = Input::uniform(5, -0.5, 0.5, [4 * COUNT]).data;
    params.value_mut(router.base()).iter_mut().zip(noise).for_each(|(x, n)| *x += n as f32);
    for score in [Score::Contribution, Score::Sensitivity] {
        let found = scores(&router, &params, score, &|cx| (with_hidden(cx.tape), wall::shot(cx.tape, &workspaces, AT)));
        assert_eq!([found[BEHIND], found[FAINT]], [0.0, 0.0], "{score:?}");
        assert!(found.iter().filter(|score| **score > 0.0).count() > COUNT, "{score:?}");
    }
    let kept: Vec<u32> = (0..2 * COUNT as u32).filter(|row| ![BEHIND, FAINT].contains(&(*row as usize))).collect();
    let owners: Vec<usize> = kept.iter().map(|row| *row as usize / COUNT).collect();
    let mut fewer_params = Params::<f32>::new();
    let fewer = PixelRouter::new(Builder::new(&mut fewer_params, 3), &owners, RouterConfig::default());
    let own: Vec<f32> =
        kept.iter().flat_map(|row| params.get(router.base()).value()[2 * *row as usize..][..2].to_vec()).collect();
    fewer_params.value_mut(fewer.base()).copy_from_slice(&own);
    let bits = |router: &PixelRouter, params: &Params<f32>, rows: &[u32]| {
        let tape = Tape::new();
        let gaussians = with_hidden(&tape).gathered(rows);
        let shot = wall::shot(&tape, &workspaces, AT);
        let gated = router.gated(Context::new(&tape, params), &gaussians, &shot);
        [gated.gate.to_vec(), gated.image.to_vec()]
    };
    let everything: Vec<u32> = (0..2 * COUNT as u32).collect();
    assert_eq!(bits(&router, &params, &everything), bits(&fewer, &fewer_params, &kept));
}
