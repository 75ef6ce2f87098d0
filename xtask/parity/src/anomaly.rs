//! Video anomaly detection: UR-DMU, experts and gate, splatting, metrics.

use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape, Var, ops};
use weaver_nn::{Builder, Context};
use weaver_vad::losses::{bag_loss, deepmil_loss, magnitude_loss, smoothness, snippet_loss, sparsity};
use weaver_vad::metrics::{SNIPPET, ScoredVideo, frame_metrics};
use weaver_vad::{
    Expert, ExpertSizes, Gate, GateSizes, Rule, Splatting, UrDmu, UrDmuSizes, resample, topographic_peaks, window_peaks,
};

pub fn urdmu<T: Real>(file: Reference) -> Reference {
    let sizes = UrDmuSizes {
        features: file.size("features"),
        width: file.size("width"),
        layers: file.size("layers"),
        heads: file.size("heads"),
        head: file.size("head_dim"),
        hidden: file.size("ffn_hidden"),
        memory: file.size("memory"),
        score_hidden: file.size("head_hidden"),
        classes: 0,
    };
    let mut params = Params::<T>::new();
    let network = UrDmu::new(Builder::new(&mut params, 0), &sizes);
    file.load(&mut params);
    let tape = Tape::<T>::new();
    let pass = network.pass(
        Context::new(&tape, &params),
        file.constant(&tape, "in.x"),
        file.constant(&tape, "in.noise"),
        None,
    );
    let (terms, score) = (pass.terms(), bag_loss(pass.encoded.scores));
    let total = score + terms.total();
    for (key, value) in [
        ("encoded", pass.snippets),
        ("scores", pass.encoded.scores),
        ("A_att", pass.anomalous_on_abnormal),
        ("N_Aatt", pass.normal_on_abnormal),
        ("A_Natt", pass.anomalous_on_normal),
        ("N_att", pass.normal_on_normal),
        ("loss.score", score),
        ("loss.A_att", terms.anomalous_on_abnormal),
        ("loss.N_Aatt", terms.normal_on_abnormal),
        ("loss.N_att", terms.normal_on_normal),
        ("loss.A_Natt", terms.anomalous_on_normal),
        ("loss.triplet", terms.triplet),
        ("loss.kl", terms.divergence),
        ("loss.distance", terms.distance),
        ("loss.total", total),
    ] {
        file.check(&format!("out.{key}"), &value.value());
    }
    file.backward(total);
    file.check_params(&params, &tape);
    let tape = Tape::<T>::new();
    let tested = network.encode(Context::new(&tape, &params), file.constant(&tape, "in.x_test"));
    file.check("out.test.features", &tested.features.value());
    file.check("out.test.scores", &tested.scores.value());
    file
}

pub fn experts<T: Real>(file: Reference) -> Reference {
    let (count, width, time) = (file.size("experts"), file.size("width"), file.size("snippets"));
    let half = file.sizes("batch")[0];
    let mut params = Params::<T>::new();
    let rows = |name: String| file.shape(&format!("w.{name}.weight"))[0];
    let tower = |scope: &str| (0..4).map(|i| rows(format!("{scope}.score.{i}"))).collect();
    let sizes = ExpertSizes {
        width,
        hidden: rows("expert0.mlp.0".into()),
        heads: Some(file.size("expert_heads")),
        tower: tower("expert0"),
    };
    let experts: Vec<Expert> =
        (0..count).map(|e| Expert::new(Builder::new(&mut params, 0).scope(format!("expert{e}")), &sizes)).collect();
    let sizes = GateSizes {
        residual: false,
        width,
        experts: count,
        hidden: rows("gate.mlp.0".into()),
        heads: Some(file.size("gate_heads")),
        tower: tower("gate"),
    };
    let gate = Gate::new(Builder::new(&mut params, 0).scope("gate"), &sizes);
    file.load(&mut params);
    let tape = Tape::<T>::new();
    let (cx, z) = (Context::new(&tape, &params), file.constant(&tape, "in.z"));
    let scores: Vec<_> = experts.iter().map(|expert| expert.forward(cx, z).reshape([2 * half, time, 1])).collect();
    let scores = ops::concat(&scores, 2);
    let gated = gate.forward(cx, z, scores);
    let abnormal = gated.slice(0, half, half);
    let labels: Vec<T> = file.data("in.label");
    let (topk, splat) = (bag_loss(gated), snippet_loss(abnormal, &labels[half * time..]));
    let (smooth, sparse) = (smoothness(abnormal), sparsity(abnormal));
    let outputs: [(&str, Var<'_, T>); 9] = [
        ("expert_scores", scores),
        ("gate_scores", gated),
        ("loss.topk", topk),
        ("loss.splat", splat),
        ("loss.smooth", smooth),
        ("loss.sparse", sparse),
        ("loss.total", topk + splat + (smooth + sparse) * 8e-5),
        ("deepmil", deepmil_loss(scores.slice(2, 0, 1).reshape([2 * half, time]))),
        ("rtfm_magnitude", magnitude_loss(z)),
    ];
    let mut objective = tape.scalar(T::ZERO);
    for (key, value) in outputs {
        file.check(&format!("out.{key}"), &value.value());
        objective = objective + file.weighted(value, &format!("cot.{key}"));
    }
    file.backward(objective);
    file.check_params(&params, &tape);
    file
}

/// Peaks, labels, metrics and resampling, which are computed in one precision.
pub fn splatting_and_metrics<T: Real>(file: Reference) -> Reference {
    let numbers = |values: &[f64]| -> Vec<T> { values.iter().map(|x| T::from_f64(*x)).collect() };
    let curves: Vec<String> = file.keys().filter_map(|key| key.strip_prefix("in.curve")).map(String::from).collect();
    let (theta, least) = (file.number("theta"), file.number("least"));
    for n in curves {
        let scores: Vec<f64> = file.data(&format!("in.curve{n}"));
        let key = |what: &str| format!("out.curve{n}.{what}");
        let places: Vec<u32> = window_peaks(&scores, theta).into_iter().map(|at| at as u32).collect();
        file.check_indices(&key("peaks"), &places);
        let peaks = topographic_peaks(&scores, theta, least);
        file.check_indices(&key("topographic_peaks"), &peaks.iter().map(|peak| peak.at as u32).collect::<Vec<_>>());
        file.check(&key("prominence"), &numbers(&peaks.iter().map(|peak| peak.prominence).collect::<Vec<_>>()));
        for rule in Rule::ALL {
            let splatting = Splatting { rule, prominence: theta, least };
            file.check(&key(rule.letter()), &numbers(&splatting.labels(&scores)));
        }
    }
    let [scores, labels, of]: [Vec<f64>; 3] = ["in.scores", "in.labels", "in.video"].map(|key| file.data(key));
    let count = of.iter().fold(0.0, |most: f64, v| most.max(*v)) as usize + 1;
    let video = |v: usize| {
        let frames: Vec<usize> = (0..of.len()).filter(|i| of[*i] as usize == v).collect();
        let scores = frames.iter().step_by(SNIPPET).map(|i| scores[*i] as f32).collect();
        ScoredVideo { scores, labels: frames.iter().map(|i| labels[*i] > 0.0).collect() }
    };
    let found = frame_metrics(&(0..count).map(video).collect::<Vec<_>>());
    let precision = [found.ap, found.ap_abnormal].map(|ap| ap.map_or([f64::NAN; 2], |ap| [ap.trapezoid, ap.step]));
    let [auc, auc_abnormal, alarms] =
        [found.auc, found.auc_abnormal, found.false_alarms].map(|x| x.unwrap_or(f64::NAN));
    let [[trapezoid, step], [trapezoid_abnormal, step_abnormal]] = precision;
    let all = [auc, trapezoid, step, auc_abnormal, trapezoid_abnormal, step_abnormal, alarms];
    file.check("out.metrics", &numbers(&all));
    let resampled: Vec<String> =
        file.keys().filter_map(|key| key.strip_prefix("in.resample")).map(String::from).collect();
    for name in resampled {
        let segments = file.shape(&format!("out.resample{name}"))[0];
        let x: Vec<f32> = file.data::<f64>(&format!("in.resample{name}")).iter().map(|x| *x as f32).collect();
        let width = file.shape(&format!("in.resample{name}"))[1];
        let found: Vec<f64> = resample(&x, width, segments).into_iter().map(f64::from).collect();
        file.check(&format!("out.resample{name}"), &numbers(&found));
    }
    file
}
