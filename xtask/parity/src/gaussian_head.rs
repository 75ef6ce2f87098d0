//! The Gaussian head, stage by stage.

use super::dense::dpt;
use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape, Var, ops};
use weaver_experts::{CardinalityHead, HeadConfig, NeighborConfig, Neighbors, Parametrization, PixelInputs, decode};
use weaver_kernels::random::Stream;
use weaver_model::Guidance;
use weaver_nn::{Builder, Context};
use weaver_router::{Allocation, AllocationRequest, Assignment, Sampled};
use weaver_splat::GaussianVars;
use weaver_vggt::{DenseTokens, FeatureHead, FeatureHeadConfig};
use weaver_wavelet::{Wavelet, analysis, luma};

/// The choice of experts by a file's recorded noise.
#[derive(Debug)]
pub struct Recorded<T> {
    pub noise: Vec<T>,
}

impl<T: Real> Allocation<T> for Recorded<T> {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        Sampled.allocate(&AllocationRequest { gumbel: Some(&self.noise), ..*request })
    }
}

/// Quaternions wxyz as the files have them, xyzw.
pub fn xyzw<T: Real>(quats: Var<'_, T>) -> Var<'_, T> {
    ops::concat(&[quats.slice(1, 1, 3), quats.slice(1, 0, 1)], 1)
}

/// Harmonics [N, K, 3] as the files have them, [N, 3, K].
pub fn color_major<T: Real>(sh: Var<'_, T>) -> Var<'_, T> {
    sh.permute(&[0, 2, 1])
}

/// Maps [V, C, H, W] as rows [V H W, C].
fn rows<T: Real>(maps: Var<'_, T>) -> Var<'_, T> {
    let s = maps.shape();
    maps.permute(&[0, 2, 3, 1]).reshape([s[0] * s[2] * s[3], s[1]])
}

/// Rows [V H W, C] as maps [V, C, H, W].
pub fn maps<'t, T: Real>(rows: Var<'t, T>, [views, height, width]: [usize; 3]) -> Var<'t, T> {
    let channels = rows.shape()[1];
    rows.reshape([views, height, width, channels]).permute(&[0, 3, 1, 2])
}

fn named<'t, T: Real>(d: &GaussianVars<'t, T>) -> [(&'static str, Var<'t, T>); 4] {
    [("scales", d.scales), ("quats", xyzw(d.quats)), ("opacities", d.opacities), ("sh", color_major(d.colors))]
}

pub fn run<T: Real>(file: Reference) -> Reference {
    let (views, height, width) = (file.size("views"), file.size("image_h"), file.size("image_w"));
    let (degree, pixels) = (file.size("sh_degree"), views * height * width);
    let dpt = dpt(&file, file.size("dim_in"), "");
    assert_eq!(dpt.width, file.size("feature_channels"), "channels of the maps are half of those of the trunk");
    let parametrization =
        Parametrization::Published { offset_reach: file.number("xyz_bias"), scale_multiplier: 0.001, scale_max: 0.4 };
    let neighbors = NeighborConfig {
        count: file.size("k"),
        projector: file.size("pixel_projector"),
        width: file.size("predictor_width"),
        zero_head: false,
    };
    let config = HeadConfig {
        features: dpt.width,
        router_hidden: file.size("gate_hidden"),
        max_per_pixel: 3,
        sh_degree: degree,
        neighbors: Some(neighbors),
        expert_output_gain: 1.0,
        parametrization,
    };
    let mut params = Params::<T>::new();
    let mut root = Builder::new(&mut params, 0);
    let feature_config = FeatureHeadConfig { dpt, merger: Some(file.size("merger_hidden")) };
    let features = FeatureHead::new(root.scope("gaussian_param_head"), feature_config);
    let mut scope = root.scope("gaussian_param_head");
    let guidance = Guidance::new(&mut scope, Wavelet::Db2, file.size("wave_hidden"), dpt.width);
    let head = CardinalityHead::new(scope.scope("gs_moe"), config);
    file.load(&mut params);

    let tape = Tape::<T>::new();
    let cx = Context::new(&tape, &params);
    let layers = [0, 1, 2, 3].map(|i| file.leaf(&tape, &format!("in.tokens{i}")));
    let grid = [file.size("grid_h"), file.size("grid_w")];
    let tokens = DenseTokens { layers: &layers, special: file.size("special_tokens"), grid, image: [height, width] };
    let images = file.leaf(&tape, "in.images");
    let photos = images.reshape([views, 3, height, width]);
    tape.without_gradient(|| {
        file.check("out.trunk", &features.trunk().trunk(cx, tokens).value());
        file.check("out.bands", &analysis(luma(photos), Wavelet::Db2).slice(1, 1, 3).value());
    });
    let seen = features.forward(cx, tokens, photos);
    let mask = guidance.forward(cx, photos);
    let expert_features = seen.features.retain_grad();
    let routed = expert_features + seen.embedding * mask;
    for (name, y) in [("mask_A", mask), ("E", seen.embedding), ("F", expert_features), ("F_router", routed)] {
        file.check(&format!("out.{name}"), &y.value());
    }
    let logits = head.router.forward(cx, rows(routed));
    let size = [views, height, width];
    let planes = maps(logits, size).retain_grad();
    file.check("out.logits", &planes.value());
    // The file's gradient is with respect to the planes, so the rest goes on from them.
    let logits = rows(planes);

    let request = AllocationRequest {
        logits: &logits.to_vec(),
        energy: &[],
        photos: &[],
        depth: None,
        views,
        height,
        width,
        stream: Stream::new(0, 0, "unused"),
        inside: None,
        gumbel: None,
        pool: tape.pool(),
    };
    let mut assignment = Recorded { noise: file.data("in.gumbel") }.allocate(&request);
    let assigned: Vec<u32> = assignment.expert.iter().map(|e| u32::from(*e)).collect();
    if file.check_indices("out.assigned", &assigned) {
        // The few entries that may differ would change the number of rows from here on.
        let expected = file.indices("out.assigned");
        assignment.expert.iter_mut().zip(expected).for_each(|(e, expected)| *e = expected as u8);
    }
    let choice = assignment.choice(logits, file.number("temperature"));
    let points = file.leaf(&tape, "in.points");
    let inputs = PixelInputs {
        features: rows(expert_features),
        points: points.reshape([pixels, 3]),
        footprints: None,
        colors: None,
        height,
        width,
    };
    let proposed = head.propose(cx, &inputs, &assignment, choice);
    file.check_indices("out.gaussian_pixel", &proposed.pixel);
    let feature = proposed.feature.expect("the head has attention over neighbors");
    file.check("out.slots", &ops::concat(&[proposed.means, proposed.theta, feature], 1).value());
    let neighbors = Neighbors::search(&proposed.means.value(), neighbors.count, tape.pool());
    file.check_rows("out.knn", neighbors.index(), neighbors.index().len() / proposed.pixel.len().max(1));
    let predictor = head.predictor().expect("the head has attention over neighbors");
    tape.without_gradient(|| {
        let attended = predictor.attend(cx, proposed.means, proposed.theta, feature, &neighbors);
        file.check("out.pt", &attended.value());
    });
    let theta = predictor.forward(cx, proposed.means, proposed.theta, feature, &neighbors).retain_grad();
    file.check("out.theta", &theta.value());

    let decoded = decode(proposed.means, theta, degree, None, parametrization);
    let mut loss = tape.scalar(T::ZERO);
    for (name, y) in named(&decoded).into_iter().chain([("means", proposed.means)]) {
        file.check(&format!("out.{name}"), &y.value());
        loss = loss + file.weighted(y, &format!("cot.{name}"));
    }
    file.check("out.loss", &[loss.item()]);
    file.backward(loss);
    file.check_grad("grad.stage.theta", theta);
    file.check_grad("grad.stage.logits", planes);
    file.check_grad("grad.stage.F", expert_features);
    file.check_grad("grad.in.points", points);
    file.check_grad("grad.in.images", images);
    for (i, layer) in layers.iter().enumerate() {
        file.check_grad(&format!("grad.in.tokens{i}"), *layer);
    }
    file.check_params(&params, &tape);
    edges::<T>(&file, degree, parametrization);
    file
}

/// Decoding alone, of parameters at the edges of their ranges.
fn edges<T: Real>(file: &Reference, degree: usize, parametrization: Parametrization) {
    if !file.has("edge.theta") {
        return;
    }
    let tape = Tape::<T>::new();
    let theta = file.constant(&tape, "edge.theta");
    let rows = theta.shape()[0];
    let means = tape.constant(&vec![T::ZERO; 3 * rows], [rows, 3]);
    let decoded = decode(means, theta, degree, None, parametrization);
    for (name, y) in named(&decoded) {
        file.check(&format!("edge.{name}"), &y.value());
    }
    file.check("edge.covariances", &weaver_splat::covariance(decoded.scales, decoded.quats).value());
}
