//! Perceptual distance: parity with the lpips package, a slow twin with weights drawn at random, and messages about weights that do not fit.

use crate::fixture::{Fixture, weights};
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::Input;
use weaver_losses::lpips::{Network, Tensors};
use weaver_losses::{Lpips, metrics};

fn parity(name: &str, network: Network) {
    let file = format!("lpips_{name}_f16.safetensors");
    let Some(tensors) = weights(&file) else { return };
    let lpips = Lpips::<f32>::from_tensors(network, &tensors, &file).unwrap();
    let fixture = Fixture::open("metrics.safetensors");
    for i in 0..3 {
        let (a, shape) = fixture.tensor(&format!("in.a{i}"));
        let b = fixture.data(&format!("in.b{i}"));
        let tape = Tape::<f32>::new();
        let shape = [1, shape[0], shape[1], shape[2]];
        let (target, render) = (tape.constant(&a, shape), tape.leaf(&b, shape));
        let layers = lpips.layers(target, render).map(|term| term.item());
        fixture.assert_close(&format!("out.lpips_{name}{i}_layers"), &layers);
        let distance = metrics::lpips(&lpips, &a, &b, [shape[2], shape[3]]);
        fixture.assert_close(&format!("out.lpips_{name}{i}"), &[distance as f32]);
        if i < 2 {
            lpips.distance(target, render).backward();
            fixture.assert_close(&format!("grad.lpips_{name}{i}.b"), &render.grad().unwrap());
        }
    }
}

#[test]
fn alex_equals_the_reference() {
    parity("alex", Network::Alex);
}

#[test]
fn vgg_equals_the_reference() {
    parity("vgg", Network::Vgg);
}

#[test]
fn weights_that_do_not_fit_are_named() {
    let mut tensors = Tensors::new();
    let load = |tensors: &Tensors| {
        Lpips::<f32>::from_tensors(Network::Alex, tensors, "alex.safetensors").unwrap_err().to_string()
    };
    assert_eq!(
        load(&tensors),
        "alex.safetensors: `net.slice1.0.weight`: expected a tensor of shape [64, 3, 11, 11], found none"
    );
    tensors.insert("net.slice1.0.weight".to_owned(), (vec![64, 3, 3, 3], vec![0.0; 64 * 27]));
    assert_eq!(
        load(&tensors),
        "alex.safetensors: `net.slice1.0.weight`: expected a tensor of shape [64, 3, 11, 11], \
         found one of shape [64, 3, 3, 3]"
    );
}

#[test]
fn weights_that_are_too_few_are_refused() {
    let mut tensors = drawn(&ALEX);
    tensors.get_mut("net.slice1.0.bias").unwrap().1.pop();
    let message = Lpips::<f32>::from_tensors(Network::Alex, &tensors, "a").unwrap_err().to_string();
    assert!(message.contains("`net.slice1.0.bias`: expected a tensor of shape [64]"), "{message}");
}

/// A convolution: its name, output channels, input channels, width of the kernel, stride and padding.
type Layer = (usize, [usize; 3], usize, usize);
/// Width and stride of the pooling in front of some convolutions.
type Stage<'a> = (Option<[usize; 2]>, &'a [Layer]);

/// AlexNet as torchvision has it.
const ALEX: [Stage<'_>; 5] = [
    (None, &[(0, [64, 3, 11], 4, 2)]),
    (Some([3, 2]), &[(3, [192, 64, 5], 1, 2)]),
    (Some([3, 2]), &[(6, [384, 192, 3], 1, 1)]),
    (None, &[(8, [256, 384, 3], 1, 1)]),
    (None, &[(10, [256, 256, 3], 1, 1)]),
];

fn drawn(stages: &[Stage<'_>; 5]) -> Tensors {
    let mut tensors = Tensors::new();
    let mut insert = |key: String, shape: Vec<usize>, least: f64, most: f64| {
        let numbers = Input::uniform(tensors.len() as u64, least, most, &shape[..]).data;
        tensors.insert(key, (shape, numbers.iter().map(|x| *x as f32).collect()));
    };
    for (i, (_, layers)) in stages.iter().enumerate() {
        for (index, [outputs, inputs, width], ..) in *layers {
            // About as large as what comes in, so that later layers see something.
            let most = (6.0 / (inputs * width * width) as f64).sqrt();
            let name = format!("net.slice{}.{index}", i + 1);
            insert(format!("{name}.weight"), vec![*outputs, *inputs, *width, *width], -most, most);
            insert(format!("{name}.bias"), vec![*outputs], -0.1, 0.1);
        }
        let features = layers.last().unwrap().1[0];
        insert(format!("lin{i}.model.1.weight"), vec![1, features, 1, 1], 0.0, 1.0);
    }
    tensors
}

/// Planes of numbers: how many, their height and width.
type Planes = (Vec<f64>, [usize; 3]);

fn convolved((x, [channels, height, width]): &Planes, layer: &Layer, weight: &[f32], bias: &[f32]) -> Planes {
    let (_, [outputs, _, kernel], stride, padding) = *layer;
    let side = |n: usize| (n + 2 * padding - kernel) / stride + 1;
    let size = [outputs, side(*height), side(*width)];
    let mut y = Vec::new();
    for (o, row, column) in places(size) {
        let mut sum = f64::from(bias[o]);
        for (c, i, j) in places([*channels, kernel, kernel]) {
            let at = (row * stride + i).checked_sub(padding).zip((column * stride + j).checked_sub(padding));
            if let Some((v, u)) = at.filter(|(v, u)| v < height && u < width) {
                sum +=
                    f64::from(weight[((o * channels + c) * kernel + i) * kernel + j]) * x[(c * height + v) * width + u];
            }
        }
        y.push(sum.max(0.0));
    }
    (y, size)
}

fn pooled((x, [channels, height, width]): &Planes, [window, stride]: [usize; 2]) -> Planes {
    let size = [*channels, (height - window) / stride + 1, (width - window) / stride + 1];
    let of = |(c, row, column): (usize, usize, usize)| {
        let inside = places([1, window, window]);
        let number =
            |(_, i, j): (usize, usize, usize)| x[(c * height + row * stride + i) * width + column * stride + j];
        inside.map(number).fold(f64::NEG_INFINITY, f64::max)
    };
    (places(size).map(of).collect(), size)
}

fn places([a, b, c]: [usize; 3]) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..a * b * c).map(move |i| (i / (b * c), i / c % b, i % c))
}

/// The five layers' terms by the definition.
fn slow_twin(
    stages: &[Stage<'_>; 5],
    tensors: &Tensors,
    a: &[f64],
    b: &[f64],
    [height, width]: [usize; 2],
) -> [f64; 5] {
    let normalized = |image: &[f64]| -> Planes {
        // The published constants are numbers of 32 bits.
        let [shift, scale] = [[-0.030_f32, -0.088, -0.188], [0.458, 0.448, 0.450]].map(|c| c.map(f64::from));
        let number =
            |(i, x): (usize, &f64)| (2.0 * x - 1.0 - shift[i / (height * width)]) / scale[i / (height * width)];
        (image.iter().enumerate().map(number).collect(), [3, height, width])
    };
    let mut both = [normalized(a), normalized(b)];
    std::array::from_fn(|i| {
        let (pool, layers) = stages[i];
        for x in &mut both {
            if let Some(pool) = pool {
                *x = pooled(x, pool);
            }
            for layer in layers {
                let of = |what: &str| &tensors[&format!("net.slice{}.{}.{what}", i + 1, layer.0)].1;
                *x = convolved(x, layer, of("weight"), of("bias"));
            }
        }
        let channels = &tensors[&format!("lin{i}.model.1.weight")].1;
        let pixels = both[0].1[1] * both[0].1[2];
        let of_pixel = |p: usize| -> f64 {
            let [a, b] = both.each_ref().map(|(x, _)| {
                let of_channel = x.iter().skip(p).step_by(pixels);
                let norm = of_channel.clone().map(|x| x * x).sum::<f64>().sqrt() + 1e-10;
                of_channel.map(|x| x / norm).collect::<Vec<_>>()
            });
            a.iter().zip(&b).zip(channels).map(|((a, b), w)| f64::from(*w) * (a - b) * (a - b)).sum()
        };
        (0..pixels).map(of_pixel).sum::<f64>() / pixels as f64
    })
}

#[test]
fn random_weights_give_what_a_slow_twin_gives() {
    let tensors = drawn(&ALEX);
    let lpips = Lpips::<f64>::from_tensors(Network::Alex, &tensors, "drawn").unwrap();
    assert_eq!(lpips.least_side(), 31);
    for size in [[31, 31], [47, 36]] {
        let [height, width] = size;
        let [a, b] = [7, 8].map(|seed| Input::uniform(seed, 0.0, 1.0, [3, height, width]).data);
        let expected = slow_twin(&ALEX, &tensors, &a, &b, size);
        let tape = Tape::<f64>::new();
        let [x, y] = [&a, &b].map(|image| tape.constant(image, [1, 3, height, width]));
        let found = lpips.layers(x, y).map(|term| term.item());
        for (found, expected) in found.iter().zip(expected) {
            assert!(expected > 1e-3 && (found - expected).abs() < 1e-9 * expected, "{size:?}: {found} and {expected}");
        }
        let sum: f64 = expected.iter().sum();
        assert!((metrics::lpips(&lpips, &a, &b, size) - sum).abs() < 1e-9 * sum);
        // Where nothing is masked it is the whole; of what is masked nothing counts, and the rest is for the pixels that are left.
        let mask = |inside: &dyn Fn(usize) -> bool| (0..height * width).map(inside).collect::<Vec<_>>();
        let masked = |a: &[f64], mask: &[bool]| metrics::lpips_masked(&lpips, a, &b, size, mask);
        assert_eq!(masked(&a, &mask(&|_| true)), Some(metrics::lpips(&lpips, &a, &b, size)));
        assert_eq!(masked(&a, &mask(&|_| false)), None);
        let part = mask(&|p| p % width < 12 && p / width < 20);
        let white = |image: &[f64]| -> Vec<f64> {
            image.iter().enumerate().map(|(i, x)| if part[i % part.len()] { *x } else { 1.0 }).collect()
        };
        let whole: f64 = slow_twin(&ALEX, &tensors, &white(&a), &white(&b), size).iter().sum();
        let expected = whole * (height * width) as f64 / 240.0;
        assert!((masked(&a, &part).unwrap() - expected).abs() < 1e-9 * expected);
    }
}
