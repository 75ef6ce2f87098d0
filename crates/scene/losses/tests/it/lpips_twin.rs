//! Perceptual distance by its definition, loop for loop, on weights that are drawn, so that no file is needed.

use weaver_autograd::Tape;
use weaver_autograd::gradcheck::Input;
use weaver_losses::Lpips;
use weaver_losses::lpips::{Network, Tensors};
use weaver_losses::metrics::{self, PerceptualDistance};

/// A convolution of torchvision's AlexNet, with the window and stride of the pooling in front.
struct Layer {
    pool: Option<[usize; 2]>,
    index: usize,
    /// Output channels, input channels, the kernel's width.
    shape: [usize; 3],
    stride: usize,
    padding: usize,
}

const ALEX: [Layer; 5] = [
    Layer { pool: None, index: 0, shape: [64, 3, 11], stride: 4, padding: 2 },
    Layer { pool: Some([3, 2]), index: 3, shape: [192, 64, 5], stride: 1, padding: 2 },
    Layer { pool: Some([3, 2]), index: 6, shape: [384, 192, 3], stride: 1, padding: 1 },
    Layer { pool: None, index: 8, shape: [256, 384, 3], stride: 1, padding: 1 },
    Layer { pool: None, index: 10, shape: [256, 256, 3], stride: 1, padding: 1 },
];

impl Layer {
    fn key(&self, stage: usize, what: &str) -> String {
        format!("net.slice{}.{}.{what}", stage + 1, self.index)
    }
}

/// Weights about as large as their inputs, so that later layers see something.
fn drawn() -> Tensors {
    let mut tensors = Tensors::new();
    let mut insert = |key: String, shape: Vec<usize>, [least, most]: [f64; 2]| {
        let numbers = Input::uniform(tensors.len() as u64, least, most, &shape[..]).data;
        tensors.insert(key, (shape, numbers.iter().map(|x| *x as f32).collect()));
    };
    for (stage, layer) in ALEX.iter().enumerate() {
        let [outputs, inputs, width] = layer.shape;
        let most = (6.0 / (inputs * width * width) as f64).sqrt();
        insert(layer.key(stage, "weight"), vec![outputs, inputs, width, width], [-most, most]);
        insert(layer.key(stage, "bias"), vec![outputs], [-0.1, 0.1]);
        insert(format!("lin{stage}.model.1.weight"), vec![1, outputs, 1, 1], [0.0, 1.0]);
    }
    tensors
}

/// Planes of numbers: how many, their height and width.
pub struct Planes {
    pub x: Vec<f64>,
    pub size: [usize; 3],
}

fn places([a, b, c]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..a * b * c).map(move |i| [i / (b * c), i / c % b, i % c])
}

impl Planes {
    pub fn new(size: [usize; 3], of: impl Fn([usize; 3]) -> f64) -> Self {
        Self { x: places(size).map(of).collect(), size }
    }

    /// 0 outside.
    pub fn at(&self, [plane, row, column]: [usize; 3]) -> f64 {
        let [_, height, width] = self.size;
        if row < height && column < width { self.x[(plane * height + row) * width + column] } else { 0.0 }
    }

    fn pooled(&self, [window, stride]: [usize; 2]) -> Self {
        let [planes, height, width] = self.size;
        let side = |side: usize| (side - window) / stride + 1;
        Self::new([planes, side(height), side(width)], |[plane, row, column]| {
            let inside = places([1, window, window]);
            let number = |[_, i, j]: [usize; 3]| self.at([plane, row * stride + i, column * stride + j]);
            inside.map(number).fold(f64::NEG_INFINITY, f64::max)
        })
    }

    /// A convolution, and a rectifier.
    pub fn convolved(
        &self,
        [outputs, inputs, kernel]: [usize; 3],
        [stride, padding]: [usize; 2],
        weight: &[f32],
        bias: &[f32],
    ) -> Self {
        let side = |side: usize| (side + 2 * padding - kernel) / stride + 1;
        Self::new([outputs, side(self.size[1]), side(self.size[2])], |[output, row, column]| {
            let sum: f64 = places([inputs, kernel, kernel])
                .map(|[input, i, j]| {
                    let weight = weight[((output * inputs + input) * kernel + i) * kernel + j];
                    // Before the first row is far beyond the last one.
                    let [row, column] = [row * stride + i, column * stride + j].map(|x| x.wrapping_sub(padding));
                    f64::from(weight) * self.at([input, row, column])
                })
                .sum();
            (sum + f64::from(bias[output])).max(0.0)
        })
    }

    /// The features of a pixel over their length.
    fn direction(&self, row: usize, column: usize) -> Vec<f64> {
        let features = (0..self.size[0]).map(|plane| self.at([plane, row, column]));
        let length = features.clone().map(|x| x * x).sum::<f64>().sqrt() + 1e-10;
        features.map(|x| x / length).collect()
    }
}

/// The five layers' terms.
fn slow(tensors: &Tensors, a: &[f64], b: &[f64], [height, width]: [usize; 2]) -> [f64; 5] {
    // The published constants are numbers of 32 bits.
    let [shift, scale] = [[-0.030_f32, -0.088, -0.188], [0.458, 0.448, 0.450]].map(|c| c.map(f64::from));
    let mut both = [a, b].map(|image| {
        Planes::new([3, height, width], |[c, row, column]| {
            (2.0 * image[(c * height + row) * width + column] - 1.0 - shift[c]) / scale[c]
        })
    });
    std::array::from_fn(|stage| {
        let layer = &ALEX[stage];
        let [weight, bias] = ["weight", "bias"].map(|what| &tensors[&layer.key(stage, what)].1);
        for planes in &mut both {
            if let Some(pool) = layer.pool {
                *planes = planes.pooled(pool);
            }
            *planes = planes.convolved(layer.shape, [layer.stride, layer.padding], weight, bias);
        }
        let channels = &tensors[&format!("lin{stage}.model.1.weight")].1;
        let [_, height, width] = both[0].size;
        let of_pixel = |[_, row, column]: [usize; 3]| -> f64 {
            let [a, b] = both.each_ref().map(|planes| planes.direction(row, column));
            a.iter().zip(&b).zip(channels).map(|((a, b), w)| f64::from(*w) * (a - b) * (a - b)).sum()
        };
        places([1, height, width]).map(of_pixel).sum::<f64>() / (height * width) as f64
    })
}

pub fn assert_near(found: f64, expected: f64) {
    assert!(expected > 1e-3 && (found - expected).abs() < 1e-9 * expected, "{found} and {expected}");
}

/// Promise of `lpips_is_a_loss_and_a_figure`.
#[test]
fn drawn_weights_give_what_a_slow_twin_gives() {
    let tensors = drawn();
    let lpips = Lpips::<f64>::from_tensors(Network::Alex, &tensors, "drawn").unwrap();
    assert_eq!(lpips.least_side(), 31);
    for size in [[31, 31], [47, 36]] {
        let [height, width] = size;
        let [a, b] = [7, 8].map(|seed| Input::uniform(seed, 0.0, 1.0, [3, height, width]).data);
        let expected = slow(&tensors, &a, &b, size);
        let tape = Tape::<f64>::new();
        let [x, y] = [&a, &b].map(|image| tape.constant(image, [1, 3, height, width]));
        for (term, expected) in lpips.layers(x, y).iter().zip(expected) {
            assert_near(term.item(), expected);
        }
        assert_near(lpips.between(&a, &b, size), expected.iter().sum());
    }
}

/// Promise of `lpips_is_a_loss_and_a_figure`.
#[test]
fn of_what_is_masked_nothing_counts() {
    let tensors = drawn();
    let lpips = Lpips::<f64>::from_tensors(Network::Alex, &tensors, "drawn").unwrap();
    let size @ [height, width] = [36, 33];
    let [a, b] = [9, 10].map(|seed| Input::uniform(seed, 0.0, 1.0, [3, height, width]).data);
    let masked = |mask: &[bool]| metrics::lpips_masked(&lpips, &a, &b, size, mask);
    assert_eq!(masked(&vec![true; height * width]), Some(lpips.between(&a, &b, size)));
    assert_eq!(masked(&vec![false; height * width]), None);
    // The remaining part counts as much as if it were alone in the picture, for each of its pixels.
    let part: Vec<bool> = (0..height * width).map(|p| p % width < 12 && p / width < 20).collect();
    let white = |image: &[f64]| -> Vec<f64> {
        image.iter().enumerate().map(|(i, x)| if part[i % part.len()] { *x } else { 1.0 }).collect()
    };
    let whole: f64 = slow(&tensors, &white(&a), &white(&b), size).iter().sum();
    assert_near(masked(&part).unwrap(), whole * (height * width) as f64 / 240.0);
}

#[test]
fn weights_that_are_too_few_are_refused() {
    let mut tensors = drawn();
    tensors.get_mut("net.slice1.0.bias").unwrap().1.pop();
    let message = Lpips::<f32>::from_tensors(Network::Alex, &tensors, "a").unwrap_err().to_string();
    assert!(message.contains("`net.slice1.0.bias`: expected a tensor of shape [64]"), "{message}");
}
