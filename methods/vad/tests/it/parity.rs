//! Reference numbers of the networks and their losses, in f64.

use weaver_autograd::{Params, Tape, Var, ops};
use weaver_fixtures::{Fixture, Tolerance, gradient_statistics};
use weaver_nn::{Builder, Context};
use weaver_vad::losses::{bag_loss, deepmil_loss, magnitude_loss, smoothness, snippet_loss, sparsity};
use weaver_vad::{Expert, ExpertSizes, Gate, GateSizes, UrDmu, UrDmuSizes};

/// Promise (results): UR-DMU, experts and gate compute the same as reference implementations, in f64, gradients
/// included.
#[test]
fn urdmu_equals_the_reference() {
    let file = Fixture::open("vad_urdmu.safetensors").with(Tolerance::DOUBLE);
    let sizes = UrDmuSizes {
        features: 12,
        width: 16,
        layers: 2,
        heads: 2,
        head: 8,
        hidden: 14,
        memory: 17,
        score_hidden: 10,
        classes: 0,
    };
    let mut params = Params::<f64>::new();
    let network = UrDmu::new(Builder::declaring(&mut params), &sizes);
    let mut drawn = Params::<f64>::new();
    let network_of = UrDmu::new(Builder::new(&mut drawn, 0), &sizes);
    assert_eq!(network.sizes(), network_of.sizes());
    load(&file, &mut drawn);
    let params = drawn;
    let tape = Tape::<f64>::new();
    let cx = Context::new(&tape, &params);
    let pass = network.pass(cx, file.constant(&tape, "in.x"), file.constant(&tape, "in.noise"), None);
    let check = |key: &str, x: Var<'_, f64>| file.assert_close(&format!("out.{key}"), &x.value());
    check("encoded", pass.snippets);
    check("scores", pass.encoded.scores);
    check("A_att", pass.anomalous_on_abnormal);
    check("N_Aatt", pass.normal_on_abnormal);
    check("A_Natt", pass.anomalous_on_normal);
    check("N_att", pass.normal_on_normal);
    let (terms, score) = (pass.terms(), bag_loss(pass.encoded.scores));
    check("loss.score", score);
    check("loss.A_att", terms.anomalous_on_abnormal);
    check("loss.N_Aatt", terms.normal_on_abnormal);
    check("loss.N_att", terms.normal_on_normal);
    check("loss.A_Natt", terms.anomalous_on_normal);
    check("loss.triplet", terms.triplet);
    check("loss.kl", terms.divergence);
    check("loss.distance", terms.distance);
    let total = score + terms.total();
    check("loss.total", total);
    total.backward();
    assert_gradients(&file, &params, &tape);

    let tape = Tape::<f64>::new();
    let tested = network.encode(Context::new(&tape, &params), file.constant(&tape, "in.x_test"));
    file.assert_close("out.test.features", &tested.features.value());
    file.assert_close("out.test.scores", &tested.scores.value());
}

/// The published sizes have the published number of parameters.
#[test]
fn published_numbers_of_parameters() {
    let mut params = Params::<f32>::new();
    UrDmu::new(Builder::declaring(&mut params), &UrDmuSizes::published(1024));
    assert_eq!(params.count(), 6_492_929);
    let mut params = Params::<f32>::new();
    Expert::new(Builder::declaring(&mut params), &ExpertSizes::published(1024));
    assert_eq!(params.count(), 5_949_953);
}

/// Promise of `urdmu_equals_the_reference`.
#[test]
fn experts_and_gate_equal_the_reference() {
    let file = Fixture::open("vad_experts.safetensors").with(Tolerance::DOUBLE);
    let mut params = Params::<f64>::new();
    let sizes = ExpertSizes { width: 16, hidden: 8, heads: Some(2), tower: vec![12, 8, 6, 4] };
    let experts: Vec<Expert> =
        (0..3).map(|e| Expert::new(Builder::new(&mut params, 0).scope(format!("expert{e}")), &sizes)).collect();
    let sizes =
        GateSizes { width: 16, experts: 3, hidden: 16, heads: Some(4), tower: vec![16, 12, 8, 6], residual: false };
    let gate = Gate::new(Builder::new(&mut params, 0).scope("gate"), &sizes);
    load(&file, &mut params);
    let tape = Tape::<f64>::new();
    let cx = Context::new(&tape, &params);
    let z = file.constant(&tape, "in.z");
    let scores: Vec<_> = experts.iter().map(|expert| expert.forward(cx, z).reshape([4, 20, 1])).collect();
    let scores = ops::concat(&scores, 2);
    let gated = gate.forward(cx, z, scores);
    file.assert_close("out.expert_scores", &scores.value());
    file.assert_close("out.gate_scores", &gated.value());

    let abnormal = gated.slice(0, 2, 2);
    let labels = file.f64("in.label");
    let (topk, splat) = (bag_loss(gated), snippet_loss(abnormal, &labels[2 * 20..]));
    let (smooth, sparse) = (smoothness(abnormal), sparsity(abnormal));
    let total = topk + splat + (smooth + sparse) * 8e-5;
    let deepmil = deepmil_loss(scores.slice(2, 0, 1).reshape([4, 20]));
    let magnitude = magnitude_loss(z);
    for (key, value) in [
        ("out.loss.topk", topk),
        ("out.loss.splat", splat),
        ("out.loss.smooth", smooth),
        ("out.loss.sparse", sparse),
        ("out.loss.total", total),
        ("out.deepmil", deepmil),
        ("out.rtfm_magnitude", magnitude),
    ] {
        file.assert_close(key, &value.value());
    }
    fn weighted<'t>(file: &Fixture, key: &str, x: Var<'t, f64>) -> Var<'t, f64> {
        (x * x.tape().constant(&file.f64(key), x.shape())).sum()
    }
    let objective = weighted(&file, "cot.expert_scores", scores)
        + weighted(&file, "cot.gate_scores", gated)
        + weighted(&file, "cot.loss.total", total)
        + weighted(&file, "cot.deepmil", deepmil)
        + weighted(&file, "cot.rtfm_magnitude", magnitude);
    objective.backward();
    assert_gradients(&file, &params, &tape);
}

/// Permuting experts and their columns of the gate's input changes nothing.
#[test]
fn the_gate_does_not_care_for_the_order_of_experts() {
    let mut params = Params::<f64>::new();
    let gate = Gate::new(Builder::new(&mut params, 3), &GateSizes::published(16, 3));
    let mut permuted = params.clone();
    let order = [2, 0, 1];
    for (row, from) in permuted
        .value_mut(gate.input().weight)
        .chunks_exact_mut(3)
        .zip(params.get(gate.input().weight).value().chunks_exact(3))
    {
        order.iter().enumerate().for_each(|(to, source)| row[to] = from[*source]);
    }
    let z: Vec<f64> = (0..5 * 16).map(|i| (i as f64 * 0.37).sin()).collect();
    let scores: Vec<f64> = (0..5 * 3).map(|i| (i as f64 * 0.91).sin().abs()).collect();
    let reordered: Vec<f64> = scores.chunks_exact(3).flat_map(|row| order.map(|source| row[source])).collect();
    let run = |params: &Params<f64>, scores: &[f64]| {
        let tape = Tape::<f64>::new();
        let (z, scores) = (tape.constant(&z, [1, 5, 16]), tape.constant(scores, [1, 5, 3]));
        gate.forward(Context::new(&tape, params), z, scores).to_vec()
    };
    let (a, b) = (run(&params, &scores), run(&permuted, &reordered));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
    assert_ne!(a, run(&params, &reordered));
}

/// Loads every parameter from the file, which has no others.
fn load(file: &Fixture, params: &mut Params<f64>) {
    file.load(params);
    assert_eq!(params.len(), file.keys().filter(|key| key.starts_with("w.")).count(), "every weight has a parameter");
}

/// Every gradient: in full if the file holds it, and its norm, sum and weighted sum.
fn assert_gradients(file: &Fixture, params: &Params<f64>, tape: &Tape<f64>) {
    for (id, param) in params.iter() {
        let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("{}: no gradient", param.name()));
        let full = format!("grad.w.{}", param.name());
        if file.has(&full) {
            file.assert_close(&full, &gradient);
        }
        file.assert_close(&format!("gradstat.w.{}", param.name()), &gradient_statistics(&gradient));
    }
}
