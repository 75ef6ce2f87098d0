use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Params, Real, Tape, Var};
use weaver_fixtures::Fixture;
use weaver_nn::{Builder, Context};
use weaver_vggt::{Aggregator, AggregatorConfig, BackboneInit, VisionTransformerConfig};

#[test]
fn parity() {
    let file = Fixture::open("aggregator_micro.safetensors");
    let encoder =
        VisionTransformerConfig { patch: 14, dim: 24, depth: 1, heads: 2, mlp_ratio: 2, registers: 4, table: [5, 5] };
    let config = AggregatorConfig { encoder, rounds: 3, heads: 2, mlp_ratio: 2, registers: 4, layers: vec![0, 1, 2] };
    let mut params = Params::<f32>::new();
    let mut b = Builder::new(&mut params, 0);
    let aggregator = Aggregator::new(b.scope("aggregator"), config, BackboneInit::PUBLISHED);
    file.load(&mut params);
    let tape = Tape::new();
    let images = file.leaf(&tape, "in.images");
    let out = aggregator.forward(Context::new(&tape, &params), images);
    let mut loss = tape.scalar(0.0);
    for (round, tokens) in out.layers.iter().enumerate() {
        file.assert_close(&format!("out.round{round}"), &tokens.value());
        loss = loss + (*tokens * file.constant(&tape, &format!("cot.round{round}"))).sum();
    }
    let last: Vec<f32> = file.f32("out.round2").chunks(11 * 48).flat_map(|view| view[..48].to_vec()).collect();
    let worst = out.camera.value().iter().zip(&last).fold(0.0, |m: f32, (a, b)| m.max((a - b).abs()));
    assert!(worst < 1e-4, "camera tokens differ by {worst}");
    loss.backward();
    file.assert_close("grad.in.images", &images.grad().unwrap());
    file.assert_gradients(&params, &tape);
}

fn micro<T: Real>(layers: &[usize]) -> (Aggregator, Params<T>) {
    let encoder =
        VisionTransformerConfig { patch: 2, dim: 8, depth: 1, heads: 2, mlp_ratio: 1, registers: 1, table: [2, 2] };
    let config = AggregatorConfig { encoder, rounds: 2, heads: 2, mlp_ratio: 1, registers: 1, layers: layers.to_vec() };
    let mut params = Params::new();
    let aggregator = Aggregator::new(Builder::new(&mut params, 7), config, BackboneInit::FROM_SCRATCH);
    (aggregator, params)
}

fn all<'t>(aggregator: &Aggregator, cx: Context<'t, '_, f64>, images: Var<'t, f64>) -> Vec<Var<'t, f64>> {
    let out = aggregator.forward(cx, images);
    out.layers.into_iter().chain([out.camera]).collect()
}

#[test]
fn gradients_of_images_and_every_weight() {
    let (aggregator, params) = micro::<f64>(&[0, 1, 1]);
    let params = &params;
    let images = Input::uniform(1, 0.0, 1.0, [2, 2, 3, 4, 4]);
    gradcheck(std::slice::from_ref(&images), |x| all(&aggregator, Context::new(x[0].tape(), params), x[0]));
    let ids: Vec<_> = params.iter().map(|(id, _)| id).collect();
    crate::check_weights(params, &ids, |cx| {
        let images = cx.tape.constant(&images.data, images.shape);
        all(&aggregator, cx, images)[1]
    });
}

/// Repeats are the same tensor; the camera tokens are the last round's even without a request.
#[test]
fn requested_layers() {
    let images = Input::uniform(1, 0.0, 1.0, [1, 2, 3, 4, 6]);
    let tape = Tape::<f64>::new();
    let images = tape.constant(&images.data, images.shape);
    let (aggregator, params) = micro(&[0, 1]);
    let both = aggregator.forward(Context::new(&tape, &params), images);
    let tape = Tape::<f64>::new();
    let images = tape.constant(&images.to_vec(), images.shape());
    let (aggregator, params) = micro(&[0, 0, 0]);
    let repeated = aggregator.forward(Context::new(&tape, &params), images);
    assert_eq!((both.special, both.grid, both.layers[0].shape().dims()), (2, [2, 3], &[1, 2, 8, 16][..]));
    for layer in &repeated.layers {
        assert_eq!(layer.to_vec(), both.layers[0].to_vec());
    }
    let first_of_views: Vec<f64> = both.layers[1].to_vec().chunks(8 * 16).flat_map(|v| v[..16].to_vec()).collect();
    assert_eq!(repeated.camera.to_vec(), first_of_views);
    assert_eq!(repeated.camera.to_vec(), both.camera.to_vec());
}

/// Views other than the first are interchangeable, and a scene does not see its batch; one view alone runs.
#[test]
fn views_and_scenes() {
    let (aggregator, params) = micro::<f64>(&[1]);
    let run = |order: &[usize], scenes: usize| {
        let view = |v: &usize| Input::uniform(*v as u64, 0.0, 1.0, [3 * 4 * 4]).data;
        let images: Vec<f64> = order.iter().flat_map(view).collect();
        let tape = Tape::new();
        let images = tape.constant(&images, [scenes, order.len() / scenes, 3, 4, 4]);
        aggregator.forward(Context::new(&tape, &params), images).layers[0].to_vec()
    };
    let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    let n = 6 * 16;
    let (abc, acb, bac) = (run(&[1, 2, 3], 1), run(&[1, 3, 2], 1), run(&[2, 1, 3], 1));
    assert!(near(&abc[..n], &acb[..n]) && near(&abc[n..2 * n], &acb[2 * n..]), "swapping views 1 and 2");
    assert!(!near(&abc[..n], &bac[n..2 * n]), "the first view is special");
    let two = run(&[1, 2, 3, 4, 5, 6], 2);
    assert!(near(&two[..3 * n], &abc) && near(&two[3 * n..], &run(&[4, 5, 6], 1)));
    assert_eq!(run(&[1], 1).len(), n);
}
