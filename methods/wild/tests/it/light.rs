//! Embeddings and colors: gradients, invariances under looks, and refusals.

use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_autograd::{Params, Real, Tape, Var, ops};
use weaver_nn::{Builder, Context, WeightInit};
use weaver_wild::{AppearanceEncoder, AppearanceEncoderConfig, LookDecoder, LookDecoderConfig, standardized};

const GRID: [usize; 2] = [2, 3];

fn encoder<T: Real>(params: &mut Params<T>, seed: u64) -> AppearanceEncoder {
    let config = AppearanceEncoderConfig {
        width: 8,
        heads: 2,
        blocks: 2,
        mlp_ratio: 2,
        layer_scale: 0.5,
        hidden: vec![6, 5],
        embedding: 4,
        init: WeightInit::FanIn,
    };
    AppearanceEncoder::new(Builder::new(params, seed).scope("appearance"), &config)
}

fn decoder<T: Real>(params: &mut Params<T>, seed: u64, sh_degree: usize, recolor: bool) -> LookDecoder {
    let config = LookDecoderConfig { features: 3, embedding: 4, hidden: 5, sh_degree, recolor };
    LookDecoder::new(Builder::new(params, seed).scope("looks"), config)
}

/// Gives every parameter a nonzero value, the zero-initialized ones too.
fn stir<T: Real>(params: &mut Params<T>, seed: u64) {
    let ids: Vec<_> = params.ids().collect();
    for (i, id) in ids.into_iter().enumerate() {
        let values = params.value_mut(id);
        let drawn = Input::uniform(seed ^ i as u64, -0.4, 0.4, [values.len()]).data;
        values.iter_mut().zip(drawn).for_each(|(to, x)| *to = T::from_f64(x));
    }
}

/// The formula of the colors, number by number.
fn colors_twin(params: &Params<f64>, maps: &Input, looks: &Input, plain: &Input, sh_degree: usize) -> Vec<f64> {
    let of = |name: &str| params.iter().find(|(_, p)| p.name() == format!("looks.{name}")).unwrap().1.value();
    let [views, features, height, width] = [0, 1, 2, 3].map(|axis| maps.shape[axis]);
    let (embedding, inputs, k) = (looks.shape[1], features + looks.shape[1], (sh_degree + 1).pow(2));
    let (first, last) = (of("gs_decoder.0.weight"), of("gs_decoder.2.weight"));
    let hidden = of("gs_decoder.0.bias").len();
    let mut all = Vec::new();
    for (j, view, y, x) in (0..looks.shape[0])
        .flat_map(|j| (0..views * height * width).map(move |p| (j, p)))
        .map(|(j, p)| (j, p / (height * width), p / width % height, p % width))
    {
        let look = &looks.data[j * embedding..][..embedding];
        let middle: Vec<f64> = (0..hidden)
            .map(|o| {
                let mut sum = of("gs_decoder.0.bias")[o];
                for (i, tap) in (0..inputs).flat_map(|i| (0..9).map(move |tap| (i, tap))) {
                    let (yy, xx) = ((y + tap / 3).wrapping_sub(1), (x + tap % 3).wrapping_sub(1));
                    if yy < height && xx < width {
                        let value = if i < features {
                            maps.data[((view * features + i) * height + yy) * width + xx]
                        } else {
                            look[i - features]
                        };
                        sum += first[(o * inputs + i) * 9 + tap] * value;
                    }
                }
                sum.max(0.0)
            })
            .collect();
        let six = |n: usize| {
            let row = &of("recolor.weight")[n * embedding..][..embedding];
            of("recolor.bias")[n] + row.iter().zip(look).map(|(w, e)| w * e).sum::<f64>()
        };
        for (n, c) in (0..k).flat_map(|n| (0..3).map(move |c| (n, c))) {
            let at = c * k + n;
            let row = &last[at * hidden..][..hidden];
            let raw = of("gs_decoder.2.bias")[at] + row.iter().zip(&middle).map(|(w, h)| w * h).sum::<f64>();
            let degree = n.isqrt();
            let factor = if degree == 0 { 1.0 } else { 0.1 * 0.25_f64.powi(degree as i32) };
            let photo = plain.data[((view * 3 + c) * height + y) * width + x];
            let own = if n == 0 { ((0.2 + six(c)) * photo + six(3 + c)) / 0.282_094_791_773_878_14 } else { 0.0 };
            all.push(2.0 * raw.tanh() * factor + own);
        }
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 32))]

    #[test]
    fn gradient_of_embeddings(photos in 1..3usize, seed in any::<u64>()) {
        let mut params = Params::<f64>::new();
        let network = encoder(&mut params, seed);
        let tokens = [Input::normal(seed, [photos, GRID[0] * GRID[1], 8])];
        gradcheck_with(Options { tolerance: 1e-6, ..Options::default() }, &tokens, |x| {
            vec![network.forward(Context::new(x[0].tape(), &params), x[0], GRID)]
        });
    }

    #[test]
    fn colors_equal_their_twin_and_have_its_gradient(
        looks in 1..3usize, views in 1..3usize, height in 1..4usize, width in 1..4usize, degree in 0..3usize, seed in any::<u64>(),
    ) {
        let mut params = Params::<f64>::new();
        let network = decoder(&mut params, seed, degree, true);
        stir(&mut params, seed);
        let inputs = [
            Input::normal(seed, [views, 3, height, width]),
            Input::normal(!seed, [looks, 4]),
            Input::normal(seed ^ 5, [views, 3, height, width]),
        ];
        let tape = Tape::new();
        let [maps, of_looks, plain] = [0, 1, 2].map(|i| tape.constant(&inputs[i].data, inputs[i].shape));
        let found = network.forward(Context::new(&tape, &params), maps, of_looks, plain);
        let expected = colors_twin(&params, &inputs[0], &inputs[1], &inputs[2], degree);
        prop_assert_eq!(found.shape().len(), expected.len());
        for (a, b) in found.to_vec().into_iter().zip(expected) {
            prop_assert!((a - b).abs() < 1e-12, "{} {}", a, b);
        }
        gradcheck_with(Options { tolerance: 1e-6, ..Options::default() }, &inputs, |x| {
            vec![network.forward(Context::new(x[0].tape(), &params), x[0], x[1], x[2])]
        });
    }
}

#[test]
fn a_new_decoder_gives_every_look_the_same_colors() {
    let mut params = Params::<f32>::new();
    let network = decoder(&mut params, 3, 1, true);
    let differ = |params: &Params<f32>| {
        let tape = Tape::new();
        let [maps, plain] = [0.0, 1.0]
            .map(|phase| tape.constant_with([2, 3, 4, 5], |x| (0..120).for_each(|i| x[i] = (i as f32 + phase).sin())));
        let looks = tape.constant(&[0.3, -2.0, 1.0, 0.1, 5.0, 0.2, -0.7, 3.0], [2, 4]);
        let colors = network.forward(Context::new(&tape, params), maps, looks, plain).to_vec();
        let (a, b) = colors.split_at(colors.len() / 2);
        a != b
    };
    assert!(!differ(&params));
    // Nonzero columns make looks differ.
    stir(&mut params, 9);
    assert!(differ(&params));
}

#[test]
fn colors_without_recoloring_are_bounded() {
    let mut params = Params::<f32>::new();
    let network = decoder(&mut params, 3, 1, false);
    params.ids().collect::<Vec<_>>().into_iter().for_each(|id| {
        params.value_mut(id).iter_mut().for_each(|x| *x *= 1e4);
    });
    let tape = Tape::new();
    let maps = tape.constant_with([1, 3, 6, 6], |x| x.iter_mut().enumerate().for_each(|(i, x)| *x = (i as f32).sin()));
    let looks = tape.constant(&[100.0, -200.0, 100.0, 50.0], [1, 4]);
    let colors = network.forward(Context::new(&tape, &params), maps, looks, maps).to_vec();
    for gaussian in colors.chunks(12) {
        // 0.5 plus and minus 0.5642 as displayed.
        assert!(gaussian[..3].iter().all(|c| c.abs() <= 2.0) && gaussian[3..].iter().all(|c| c.abs() <= 0.05));
    }
    assert!(colors.iter().any(|c| c.abs() > 1.99));
}

/// Photos are independent of each other and of their order.
#[test]
fn order_of_photos_does_not_matter() {
    let mut params = Params::<f32>::new();
    let network = encoder(&mut params, 1);
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let tokens =
        tape.constant(&Input::normal(3, [2, 6, 8]).data.iter().map(|x| *x as f32).collect::<Vec<_>>(), [2, 6, 8]);
    let [a, b] = [0, 1].map(|i| tokens.slice(0, i, 1));
    let swapped: Var<'_, f32> = ops::concat(&[b, a], 0);
    let (both, swapped) = (network.forward(cx, tokens, GRID).to_vec(), network.forward(cx, swapped, GRID).to_vec());
    assert_eq!([&both[4..], &both[..4]].concat(), swapped);
    assert_eq!(network.forward(cx, a, GRID).to_vec(), both[..4]);
}

/// A photo of one color is zero; pixels outside the mask do not enter the mean.
#[test]
fn a_photo_of_one_color_is_zero() {
    let flat: Vec<f32> = standardized(&[0.7; 12], None, 4);
    assert!(flat.iter().all(|x| x.abs() < 1e-5), "{flat:?}");
    // The mean of 0.2 and 0.4; the third pixel is far out.
    let found: Vec<f64> = standardized(&[0.2, 0.4, 9.0].repeat(3), Some(&[true, true, false]), 3);
    assert!((found[0] + 1.0).abs() < 1e-12 && (found[2] - 87.0).abs() < 1e-9, "{found:?}");
    let nothing: Vec<f64> = standardized(&[0.2, 0.4, 0.6].repeat(3), Some(&[false; 3]), 3);
    assert!((nothing[0] - 10.0).abs() < 1e-9, "{nothing:?}");
}

#[test]
#[should_panic(expected = "look_decoder")]
fn looks_of_another_width_are_refused() {
    let mut params = Params::<f32>::new();
    let network = decoder(&mut params, 3, 1, true);
    let tape = Tape::new();
    let maps = tape.constant(&[0.0; 12], [1, 3, 2, 2]);
    network.forward(Context::new(&tape, &params), maps, tape.constant(&[0.0; 5], [1, 5]), maps);
}

#[test]
#[should_panic(expected = "appearance_encoder")]
fn tokens_of_another_grid_are_refused() {
    let mut params = Params::<f32>::new();
    let network = encoder(&mut params, 3);
    let tape = Tape::new();
    network.forward(Context::new(&tape, &params), tape.constant(&[0.0; 40], [1, 5, 8]), GRID);
}
