//! WildSplatter's network: effects and invariances of looks, and gradients of its parameters.

use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Tape, Var};
use weaver_geometry::glam::DVec3;
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_wild::{Surface, Wild, WildConfig, WildParametrization};

const VIEWS: usize = 2;

fn config(recolor: bool) -> WildConfig {
    let mut config = WildConfig::preset("micro").unwrap();
    config.gaussians.recolor = recolor;
    config
}

/// A network without zero parameters.
fn network(recolor: bool) -> (Wild, Params<f32>) {
    configured(config(recolor))
}

fn configured(config: WildConfig) -> (Wild, Params<f32>) {
    let mut params = Params::new();
    let network = Wild::new(config, &mut params, 3);
    for id in params.ids().collect::<Vec<_>>() {
        let values = params.value_mut(id);
        let noise = Input::uniform(values.len() as u64, -0.05, 0.05, [values.len()]).data;
        values.iter_mut().zip(noise).for_each(|(x, noise)| *x += noise as f32);
    }
    (network, params)
}

fn photos<'t>(tape: &'t Tape<f32>, network: &Wild, count: usize, seed: u64) -> Var<'t, f32> {
    let WildConfig { width, height, .. } = network.config();
    let shape = [count, 3, *height, *width];
    let data: Vec<f32> = Input::uniform(seed, 0.0, 1.0, shape).data.iter().map(|x| *x as f32).collect();
    tape.constant(&data, shape)
}

fn cameras<'t>(tape: &'t Tape<f32>, network: &Wild) -> CameraVars<'t> {
    let (w, h) = (network.config().width as f32, network.config().height as f32);
    // The second camera is turned about y by a right angle.
    let first = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let second = [0.0, 0.0, -1.0, 0.1, 0.0, 1.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.3];
    CameraVars {
        viewmats: tape.constant(&[first, second].concat(), [VIEWS, 3, 4]),
        intrinsics: tape.constant(&[w, w, w / 2.0, h / 2.0].repeat(VIEWS), [VIEWS, 4]),
    }
}

fn surface<'t>(cx: Context<'t, '_, f32>, network: &Wild) -> Surface<'t> {
    let shown = photos(cx.tape, network, VIEWS, 1);
    let size = [network.config().height, network.config().width];
    let encoded = network.encode(cx, shown.reshape([1, VIEWS, 3, size[0], size[1]]));
    let depth = network.depth(cx, &encoded, 0, VIEWS, size);
    network.surface(cx, (&encoded, 0), shown, None, depth, &cameras(cx.tape, network))
}

/// Promise of `geometry_is_the_same_under_every_look`.
#[test]
fn looks_change_colors_and_nothing_else() {
    for recolor in [true, false] {
        let (network, params) = network(recolor);
        let tape = Tape::new();
        let cx = Context::new(&tape, &params);
        let made = surface(cx, &network);
        let looks = network.embed(cx, photos(&tape, &network, 3, 7));
        let colors = network.colors(cx, &made, looks);
        let n = VIEWS * network.config().width * network.config().height;
        assert_eq!(colors.shape().dims(), [3, n, 4, 3]);
        let [a, b] = [0, 1].map(|i| network.colors(cx, &made, looks.slice(0, i, 1)).to_vec());
        assert_ne!(a, b);
        // Each look counts for itself, to the bit.
        assert_eq!([a, b].concat(), colors.to_vec()[..2 * n * 12]);
        // The surface does not depend on looks: the tape has no gradient.
        let tape = Tape::new();
        let cx = Context::new(&tape, &params);
        let made = surface(cx, &network);
        let embedding = network.config().looks.embedding;
        let leaf = tape.leaf(&vec![0.3; embedding], [1, embedding]);
        network.colors(cx, &made, leaf);
        (made.means.sum() + made.quats.sum() + made.scales.sum() + made.opacities.sum() + made.depth.sum()).backward();
        assert_eq!(leaf.grad(), None);
    }
}

/// As published, Gaussians lie behind the depth, by less than 1, and their scales are bounded by the pixel's width
/// there.
///
/// Promise (results): WildSplatter as published: Gaussians behind the depth, scales in bounds, predictions laid over
/// the data's points by scale and shift.
#[test]
fn published_gaussians_lie_behind_the_depth() {
    let mut published = config(true);
    published.gaussians.parametrization = WildParametrization::Published;
    let (network, params) = configured(published);
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let shown = photos(&tape, &network, VIEWS, 1);
    let size = [network.config().height, network.config().width];
    let encoded = network.encode(cx, shown.reshape([1, VIEWS, 3, size[0], size[1]]));
    let depth = network.depth(cx, &encoded, 0, VIEWS, size);
    let made = network.surface(cx, (&encoded, 0), shown, None, depth, &cameras(&tape, &network));
    let (before, after, scales) = (depth.to_vec(), made.depth.to_vec(), made.scales.to_vec());
    assert!(before.iter().zip(&after).all(|(a, b)| a < b && *b < a + 1.0));
    let pixel = 2.0 / size[1] as f32 * 0.1;
    assert!(scales.iter().enumerate().all(|(i, s)| *s > 0.0 && *s < 30.0 * pixel * after[i / 3]));
}

#[test]
fn surfaces_are_placed_elsewhere() {
    let (network, params) = network(true);
    let tape = Tape::new();
    let made = surface(Context::new(&tape, &params), &network);
    let placed = made.placed(2.0, DVec3::new(1.0, 0.0, -3.0));
    let (before, after) = (made.means.to_vec(), placed.means.to_vec());
    assert!(before.iter().zip(&after).enumerate().all(|(i, (a, b))| 2.0 * a + [1.0, 0.0, -3.0][i % 3] == *b));
    assert!(made.scales.to_vec().iter().zip(placed.scales.to_vec()).all(|(a, b)| 2.0 * a == b));
    assert_eq!(made.quats.to_vec(), placed.quats.to_vec());
}

/// The unknown look is zero, and pictures train all parameters of colors.
#[test]
fn no_look_is_zero_and_colors_are_taught() {
    for parametrization in [WildParametrization::Footprint, WildParametrization::Published] {
        let mut config = config(true);
        config.gaussians.parametrization = parametrization;
        pictures_teach_all_that_makes_colors(&configured(config));
    }
}

fn pictures_teach_all_that_makes_colors((network, params): &(Wild, Params<f32>)) {
    let tape = Tape::new();
    let cx = Context::new(&tape, params);
    let made = surface(cx, network);
    assert!(network.no_look(cx).to_vec().iter().all(|x| *x == 0.0));
    let colors = network.colors(cx, &made, network.embed(cx, photos(&tape, network, 1, 9)));
    (colors.square().sum() + made.scales.square().sum() + made.means.square().sum() + made.opacities.square().sum())
        .backward();
    for (id, param) in params.iter() {
        let name = param.name();
        if ["appearance.", "looks.", "gaussian_param_head.", "depth_head."].iter().any(|part| name.starts_with(part)) {
            let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("{name} has no gradient"));
            // A shift of all keys changes no attention, and one of all queries hardly any.
            let free = name.ends_with("k_norm.bias") || name.contains("output_conv2.2");
            assert!(free || gradient.iter().any(|g| *g != 0.0), "{name} is not reached");
        }
    }
}

/// Harmonics are rotated to the world with their camera: the turned second camera changes its harmonics, the first does
/// not.
#[test]
fn harmonics_are_turned_with_their_camera() {
    let (network, params) = network(false);
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let shown = photos(&tape, &network, VIEWS, 1);
    let size = [network.config().height, network.config().width];
    let encoded = network.encode(cx, shown.reshape([1, VIEWS, 3, size[0], size[1]]));
    let depth = network.depth(cx, &encoded, 0, VIEWS, size);
    let turned = cameras(&tape, &network);
    let rows = [1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3];
    let straight =
        CameraVars { viewmats: tape.constant(&[rows, rows].concat(), [VIEWS, 3, 4]), intrinsics: turned.intrinsics };
    let look = network.embed(cx, photos(&tape, &network, 1, 9));
    let [a, b] = [&turned, &straight].map(|cameras| {
        let made = network.surface(cx, (&encoded, 0), shown, None, depth, cameras);
        (network.colors(cx, &made, look).to_vec(), made.quats.to_vec())
    });
    let half = a.0.len() / 2;
    assert_eq!(a.0[..half], b.0[..half]);
    for (turned, straight) in a.0[half..].chunks(12).zip(b.0[half..].chunks(12)) {
        for d in [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.36, 0.48, 0.8]] {
            // A direction d of the camera is R^T d in the world, R with rows (0 0 -1), (0 1 0), (1 0 0).
            let world = [d[2], d[1], -d[0]];
            for c in 0..3 {
                let of = |k: &[f32], d| {
                    harmonics(d).iter().enumerate().map(|(i, y)| y * f64::from(k[3 * i + c])).sum::<f64>()
                };
                assert!((of(turned, world) - of(straight, d)).abs() < 1e-5);
            }
        }
    }
    assert_eq!(a.1[..half / 3], b.1[..half / 3]);
    assert_ne!(a.1[half / 3..], b.1[half / 3..]);
}

/// The first harmonics, as everywhere in this field.
fn harmonics([x, y, z]: [f64; 3]) -> [f64; 4] {
    let first = 0.488_602_511_902_919_9;
    [0.282_094_791_773_878_14, -first * y, first * z, -first * x]
}

#[test]
fn what_is_out_of_range_is_named() {
    let wrong = |change: &dyn Fn(&mut WildConfig)| {
        let mut config = config(true);
        change(&mut config);
        config.check().unwrap_err()
    };
    let cases: [(String, &str); 6] = [
        (wrong(&|c| c.looks.embedding = 0), "model.looks.embedding: expected 1 to 1000000, found 0"),
        (wrong(&|c| c.looks.hidden = vec![8, 0]), "model.looks.hidden: expected 1 to 1000000, found 0"),
        (wrong(&|c| c.gaussians.sh_degree = 5), "model.gaussians.sh_degree: expected 0 to 4, found 5"),
        (wrong(&|c| c.dense.channels = 6), "model.dense.channels: expected a positive multiple of 4, found 6"),
        (wrong(&|c| c.dense.layers[1] = 99), "model.dense.layers: expected rounds below backbone.rounds"),
        (wrong(&|c| c.gaussians.scale = 0.0), "model.gaussians.scale: expected a positive number, found 0"),
    ];
    for (found, expected) in cases {
        assert!(found.starts_with(expected), "{found}");
    }
}
