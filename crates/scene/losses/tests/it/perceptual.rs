//! The perceptual loss by its definition, loop for loop, on weights that are drawn, and its gradient.

use crate::lpips_twin::{Planes, assert_near};
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::Input;
use weaver_losses::Perceptual;
use weaver_losses::lpips::Tensors;

/// VGG-19 up to its fifth block: outputs, whether a pooling stands in front, and whether the layer is compared.
const CONVOLUTIONS: [(usize, usize, bool, bool); 14] = [
    (0, 64, false, false),
    (2, 64, false, true),
    (5, 128, true, false),
    (7, 128, false, true),
    (10, 256, true, false),
    (12, 256, false, true),
    (14, 256, false, false),
    (16, 256, false, false),
    (19, 512, true, false),
    (21, 512, false, true),
    (23, 512, false, false),
    (25, 512, false, false),
    (28, 512, true, false),
    (30, 512, false, true),
];

/// Weights that keep numbers about as large as they come in.
fn drawn() -> Tensors {
    let mut tensors = Tensors::new();
    let mut inputs = 3;
    for (index, outputs, ..) in CONVOLUTIONS {
        let most = (6.0 / (9 * inputs) as f64).sqrt();
        for (what, shape, most) in [("weight", vec![outputs, inputs, 3, 3], most), ("bias", vec![outputs], 0.1)] {
            let numbers = Input::uniform(tensors.len() as u64, -most, most, &shape[..]).data;
            let numbers = numbers.iter().map(|x| *x as f32).collect();
            tensors.insert(format!("features.{index}.{what}"), (shape, numbers));
        }
        inputs = outputs;
    }
    tensors
}

fn slow(tensors: &Tensors, a: &[f64], b: &[f64], [height, width]: [usize; 2]) -> f64 {
    let mean = [123.68, 116.779, 103.939];
    let mut both = [a, b].map(|image| {
        Planes::new([3, height, width], |[c, row, column]| 255.0 * image[(c * height + row) * width + column] - mean[c])
    });
    let apart = |[a, b]: &[Planes; 2]| a.x.iter().zip(&b.x).map(|(a, b)| (a - b).abs()).sum::<f64>() / a.x.len() as f64;
    let mut sum = apart(&both);
    let mut shares = [1.0 / 2.6, 1.0 / 4.8, 1.0 / 3.7, 1.0 / 5.6, 10.0 / 1.5].into_iter();
    for (index, _, pooled, compared) in CONVOLUTIONS {
        let [(shape, weight), (_, bias)] = ["weight", "bias"].map(|what| &tensors[&format!("features.{index}.{what}")]);
        for planes in &mut both {
            if pooled {
                let [count, height, width] = planes.size;
                *planes = Planes::new([count, height / 2, width / 2], |[plane, row, column]| {
                    let four = [[0, 0], [0, 1], [1, 0], [1, 1]];
                    four.map(|[i, j]| planes.at([plane, 2 * row + i, 2 * column + j])).iter().sum::<f64>() / 4.0
                });
            }
            *planes = planes.convolved([shape[0], shape[1], 3], [1, 1], weight, bias);
        }
        if compared {
            sum += apart(&both) * shares.next().unwrap();
        }
    }
    sum / 255.0
}

/// Promise (results): 2Xplat's perceptual loss is its definition, trains through the trainer, and refuses other
/// weights by name.
#[test]
fn drawn_weights_give_what_a_slow_twin_gives() {
    let tensors = drawn();
    let loss = Perceptual::<f64>::from_tensors(&tensors, "drawn").unwrap();
    let size @ [height, width] = [17, 20];
    let [a, b] = [3, 4].map(|seed| Input::uniform(seed, 0.0, 1.0, [3, height, width]).data);
    let mut tape = Tape::<f64>::new();
    let value = |tape: &Tape<f64>, a: &[f64], b: &[f64]| {
        let [x, y] = [a, b].map(|image| tape.leaf(image, [1, 3, height, width]));
        let loss = loss.loss(x, y);
        loss.backward();
        (loss.item(), [x.grad().unwrap().to_vec(), y.grad().unwrap().to_vec()])
    };
    let (found, gradients) = value(&tape, &a, &b);
    assert_near(found, slow(&tensors, &a, &b, size));
    // Along a direction in each image: a slope by all pixels at once, as a network of this size allows.
    for (of, gradient) in gradients.iter().enumerate() {
        let along = Input::uniform(5, -1.0, 1.0, [3, height, width]).data;
        let slope: f64 = gradient.iter().zip(&along).map(|(g, d)| g * d).sum();
        let mut moved = |step: f64| {
            let mut images = [a.clone(), b.clone()];
            images[of].iter_mut().zip(&along).for_each(|(x, d)| *x += step * d);
            tape.reset();
            value(&tape, &images[0], &images[1]).0
        };
        let difference = (moved(1e-7) - moved(-1e-7)) / 2e-7;
        assert!((slope - difference).abs() < 1e-5 * slope.abs().max(1e-3), "{of}: {slope} {difference}");
    }
    tape.reset();
    assert_eq!(value(&tape, &a, &a).0, 0.0);
}

#[test]
fn weights_that_do_not_fit_are_named() {
    let mut tensors = drawn();
    tensors.remove("features.21.weight");
    let message = Perceptual::<f32>::from_tensors(&tensors, "vgg19.safetensors").unwrap_err().to_string();
    assert_eq!(
        message,
        "vgg19.safetensors: `features.21.weight`: expected a tensor of shape [512, 512, 3, 3], found none"
    );
}
