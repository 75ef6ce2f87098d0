use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Params, Real, Tape, Var};
use weaver_fixtures::Fixture;
use weaver_nn::{Builder, Context, Init, WeightInit};
use weaver_pose::cameras;
use weaver_vggt::{CameraHead, CameraHeadConfig};

const MICRO: CameraHeadConfig = CameraHeadConfig {
    dim: 48,
    depth: 2,
    heads: 4,
    mlp_ratio: 2,
    iterations: 4,
    weight: WeightInit::TruncatedNormal(0.02),
    token: Init::Normal(0.02),
    layer_scale: 0.01,
    base_fov: None,
    relative: false,
};

#[test]
fn parity() {
    let file = Fixture::open("camera_head_micro.safetensors");
    let mut params = Params::<f32>::new();
    let head = CameraHead::new(Builder::new(&mut params, 0).scope("camera_head"), MICRO);
    file.load(&mut params);
    let tape = Tape::new();
    let tokens = file.leaf(&tape, "in.tokens");
    let estimates = head.forward(Context::new(&tape, &params), tokens.slice(2, 0, 1).reshape([1, 3, 48]));
    let mut loss = tape.scalar(0.0);
    for (i, estimate) in estimates.iter().enumerate() {
        file.assert_close(&format!("out.pose{i}"), &estimate.code.value());
        loss = loss + (estimate.code * file.constant(&tape, &format!("cot.pose{i}"))).sum();
    }
    let c = cameras(estimates[3].code, 28, 42);
    file.assert_close("out.extrinsics", &c.viewmats.value());
    loss = loss + (c.viewmats * file.constant(&tape, "cot.extrinsics")).sum();
    let matrices: Vec<f32> =
        c.intrinsics.value().chunks(4).flat_map(|k| [k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 1.0]).collect();
    file.assert_close("out.intrinsics", &matrices);
    let cotangent: Vec<f32> = file.f32("cot.intrinsics").chunks(9).flat_map(|k| [k[0], k[4], k[2], k[5]]).collect();
    loss = loss + (c.intrinsics * tape.constant(&cotangent, [1, 3, 4])).sum();
    loss.backward();
    file.assert_close("grad.in.tokens", &tokens.grad().unwrap());
    file.assert_gradients(&params, &tape);
}

fn micro<T: Real>(base_fov: Option<f64>, relative: bool) -> (CameraHead, Params<T>) {
    let config = CameraHeadConfig {
        dim: 6,
        depth: 1,
        heads: 2,
        mlp_ratio: 1,
        iterations: 2,
        weight: WeightInit::TruncatedNormal(0.3),
        token: Init::Normal(0.5),
        layer_scale: 0.5,
        base_fov,
        relative,
    };
    let mut params = Params::new();
    let head = CameraHead::new(Builder::new(&mut params, 3), config);
    (head, params)
}

/// A single refinement: the later ones hold the code so far constant, which differences would see.
#[test]
fn gradients_of_the_first_refinement() {
    for (base, relative) in [(None, false), (Some(1.0), true)] {
        let (head, params) = micro::<f64>(base, relative);
        let params = &params;
        gradcheck(&[Input::normal(1, [2, 3, 6])], |x| {
            let estimates = head.forward(Context::new(x[0].tape(), params), x[0]);
            vec![estimates[0].raw, estimates[0].code]
        });
    }
}

/// Within a refinement the gradient is the increment's alone.
#[test]
fn refinements_do_not_see_one_another() {
    let (head, params) = micro::<f64>(Some(1.0), false);
    let bias = params.find("pose_branch.fc2.bias").unwrap();
    let tape = Tape::new();
    let tokens = Input::normal(1, [1, 2, 6]);
    let estimates = head.forward(Context::new(&tape, &params), tape.constant(&tokens.data, tokens.shape));
    estimates[1].raw.backward_with(&[1.0; 18]);
    // The bias enters both increments, the gradient only the second: 1 for each of the two views.
    assert_eq!(tape.param_grad(bias).unwrap().to_vec(), [2.0; 9]);
    assert!(tape.param_grad(params.find("empty_pose_tokens").unwrap()).is_none());
}

#[test]
fn base_code_counts_once() {
    let (head, mut params) = micro::<f64>(Some(1.0), true);
    for name in ["pose_branch.fc2.weight", "pose_branch.fc2.bias"] {
        let id = params.find(name).unwrap();
        params.value_mut(id).fill(0.0);
    }
    let tape = Tape::new();
    let tokens = Input::normal(1, [1, 2, 6]);
    let estimates = head.forward(Context::new(&tape, &params), tape.constant(&tokens.data, tokens.shape));
    assert_eq!(estimates.len(), 2);
    let base = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0].repeat(2);
    for estimate in &estimates {
        assert_eq!((estimate.raw.to_vec(), estimate.code.to_vec()), (base.clone(), base.clone()));
    }
}

/// Camera 0 of every scene is the identity after each refinement, in single precision and to the bit.
#[test]
fn gauge_of_the_first_camera() {
    let (head, params) = micro::<f32>(Some(1.0), true);
    let tape = Tape::new();
    let tokens: Vec<f32> = Input::normal(1, [2, 3, 6]).data.iter().map(|x| *x as f32).collect();
    let codes: Vec<Var<'_, f32>> = head
        .forward(Context::new(&tape, &params), tape.constant(&tokens, [2, 3, 6]))
        .iter()
        .map(|estimate| estimate.code)
        .collect();
    for code in codes {
        for scene in code.value().chunks(27) {
            assert_eq!(&scene[..7], &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
            assert!(scene[9..12].iter().any(|t| *t != 0.0) && scene[15] > 0.0);
        }
        let viewmats = cameras(code, 48, 64).viewmats;
        assert_eq!(&viewmats.value()[..12], &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    }
}
