//! Ops in `f32` against numbers computed in `f64` by PyTorch; see tests/fixtures/README.md.

use safetensors::{SafeTensors, tensor::TensorView};
use weaver_autograd::ops::{self, Activation, RopeTable};
use weaver_autograd::{Shape, Tape, Var};

struct Fixture {
    bytes: Vec<u8>,
    /// Of every output and gradient, what `f32` alone costs: relative L2, and largest error over largest value.
    errors: serde_json::Value,
}

impl Fixture {
    fn read() -> Self {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/fixtures/ops.safetensors");
        let bytes = std::fs::read(path).expect("the fixture is part of the repository");
        let (_, header) = SafeTensors::read_metadata(&bytes).expect("a safetensors header");
        let text = header.metadata().as_ref().expect("metadata")["f32_error"].clone();
        Self { bytes, errors: serde_json::from_str(&text).expect("JSON") }
    }

    fn file(&self) -> SafeTensors<'_> {
        SafeTensors::deserialize(&self.bytes).expect("a safetensors file")
    }

    fn numbers<U>(&self, key: &str, number: impl Fn([u8; 4]) -> U) -> (Vec<U>, Shape) {
        let file = self.file();
        let tensor: TensorView<'_> = file.tensor(key).unwrap_or_else(|_| panic!("no {key} in the fixture"));
        let (words, _) = tensor.data().as_chunks::<4>();
        (words.iter().map(|w| number(*w)).collect(), Shape::new(tensor.shape()))
    }

    fn floats(&self, key: &str) -> (Vec<f32>, Shape) {
        self.numbers(key, f32::from_le_bytes)
    }

    fn integers(&self, key: &str) -> Vec<u32> {
        self.numbers(key, u32::from_le_bytes).0
    }

    /// Both measures of the difference are within 20 times what `f32` alone costs, or 1e-5.
    fn agrees(&self, key: &str, found: &[f32]) {
        let expected = self.floats(key).0;
        assert_eq!(found.len(), expected.len(), "{key}: size");
        let pairs = || found.iter().zip(&expected).map(|(a, b)| (f64::from(*a), f64::from(*b)));
        let norm = |sum: f64| sum.sqrt().max(1e-30);
        let relative =
            pairs().map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt() / norm(pairs().map(|(_, b)| b * b).sum());
        let largest = |f: fn((f64, f64)) -> f64| pairs().map(f).fold(0.0, f64::max);
        let peak = largest(|(a, b)| (a - b).abs()) / largest(|(_, b)| b.abs()).max(1e-30);
        for (found, which) in [(relative, 0), (peak, 1)] {
            let alone = self.errors[key][which].as_f64().unwrap_or_else(|| panic!("no error of {key}"));
            let allowed = (20.0 * alone).max(1e-5);
            assert!(found <= allowed, "{key}: error {found:.2e}, allowed {allowed:.2e}");
        }
    }

    /// Runs `f` on the inputs called `names` and compares its result and all gradients.
    fn check<F>(&self, op: &str, names: &[&str], f: F)
    where
        F: for<'t> Fn(&[Var<'t, f32>]) -> Var<'t, f32>,
    {
        let tape = Tape::<f32>::new();
        let leaf = |name: &&str| {
            let (data, shape) = self.floats(&format!("{op}.in.{name}"));
            tape.leaf(&data, shape)
        };
        let inputs: Vec<_> = names.iter().map(leaf).collect();
        let y = f(&inputs);
        assert_eq!(y.shape(), self.floats(&format!("{op}.out")).1, "{op}: shape");
        self.agrees(&format!("{op}.out"), &y.value());
        y.backward_with(&self.floats(&format!("{op}.cot")).0);
        for (x, name) in inputs.iter().zip(names) {
            self.agrees(&format!("{op}.grad.{name}"), &x.grad().expect("a gradient"));
        }
    }
}

#[test]
fn elementwise() {
    let fixture = Fixture::read();
    fixture.check("gelu_erf", &["input"], |x| x[0].gelu());
    fixture.check("relu", &["input"], |x| x[0].relu());
    fixture.check("silu", &["input"], |x| x[0].silu());
    fixture.check("softplus", &["input"], |x| x[0].softplus());
    fixture.check("sigmoid", &["input"], |x| x[0].sigmoid());
    fixture.check("tanh", &["input"], |x| x[0].tanh());
    fixture.check("huber", &["x", "y"], |x| ops::huber(x[0], x[1], 1.0));
}

#[test]
fn normalizations() {
    let fixture = Fixture::read();
    fixture.check("layer_norm_1e5", &["x", "w", "b"], |x| x[0].layer_norm(Some((x[1], x[2])), 1e-5));
    fixture.check("layer_norm_1e6", &["x", "w", "b"], |x| x[0].layer_norm(Some((x[1], x[2])), 1e-6));
    fixture.check("layer_norm_noaffine", &["x"], |x| x[0].layer_norm(None, 1e-6));
    fixture.check("softmax_last", &["x"], |x| x[0].softmax(2));
    fixture.check("softmax_dim1", &["x"], |x| x[0].softmax(1));
    let labels = fixture.integers("cross_entropy.target");
    fixture.check("cross_entropy", &["x"], |x| ops::cross_entropy(x[0], &labels, 0.1));
}

#[test]
fn layers() {
    let fixture = Fixture::read();
    fixture.check("linear", &["x", "w", "b"], |x| ops::linear(x[0], x[1], Some(x[2]), Activation::None));
    let heads_first = |x: &[Var<'_, f32>]| x[0].shape()[3] as f64;
    for op in ["sdpa", "sdpa_cross"] {
        fixture.check(op, &["q", "k", "v"], |x| {
            let [q, k, v] = [x[0], x[1], x[2]].map(|x| x.permute(&[0, 2, 1, 3]));
            ops::attention(q, k, v, 1.0 / heads_first(x).sqrt()).permute(&[0, 2, 1, 3])
        });
    }
    // Both batch entries have the same positions.
    let positions = fixture.integers("rope2d.positions");
    let (first, second) = positions.split_at(positions.len() / 2);
    assert_eq!(first, second);
    let positions: Vec<_> = first.as_chunks::<2>().0.iter().map(|p| p.map(|p| p as usize)).collect();
    let table = RopeTable::new(&positions, 16, 100.0);
    fixture.check("rope2d", &["x"], |x| x[0].permute(&[0, 2, 1, 3]).rope2d(&table).permute(&[0, 2, 1, 3]));
}

#[test]
fn convolutions() {
    let fixture = Fixture::read();
    for (op, stride, padding) in [
        ("conv2d_k3s1p1", 1, 1),
        ("conv2d_k3s2p1_even", 2, 1),
        ("conv2d_k3s2p1_odd", 2, 1),
        ("conv2d_k14s14", 14, 0),
        ("conv2d_k1", 1, 0),
        ("conv2d_k7p3", 1, 3),
        ("conv2d_k5p2", 1, 2),
    ] {
        fixture.check(op, &["x", "w", "b"], |x| ops::conv2d(x[0], x[1], Some(x[2]), stride, padding));
    }
    fixture.check("conv2d_nobias", &["x", "w"], |x| ops::conv2d(x[0], x[1], None, 1, 1));
    fixture.check("conv_transpose2d_k4", &["x", "w", "b"], |x| ops::conv_transpose2d(x[0], x[1], Some(x[2]), 4));
    fixture.check("conv_transpose2d_k2", &["x", "w", "b"], |x| ops::conv_transpose2d(x[0], x[1], Some(x[2]), 2));
    fixture.check("residual_conv_unit", &["x", "w1", "b1", "w2", "b2"], |x| {
        let positive = x[0].relu();
        let hidden = ops::conv2d(positive, x[1], Some(x[2]), 1, 1).relu();
        ops::conv2d(hidden, x[3], Some(x[4]), 1, 1) + positive
    });
}

#[test]
fn resizes() {
    let fixture = Fixture::read();
    for op in ["bicubic_aa_down", "bicubic_aa_up", "bicubic_aa_mixed", "bicubic_aa_up_far"] {
        let to = fixture.floats(&format!("{op}.out")).1;
        fixture.check(op, &["x"], |x| x[0].bicubic_antialias(to[2], to[3]));
    }
    fixture.check("bicubic_plain", &["x"], |x| x[0].bicubic(4, 5));
    for (align, name) in [(true, "true"), (false, "false")] {
        for case in ["up", "down", "x14_8", "one"] {
            let op = format!("bilinear_ac_{name}_{case}");
            let to = fixture.floats(&format!("{op}.out")).1;
            fixture.check(&op, &["x"], |x| x[0].bilinear(to[2], to[3], align));
        }
    }
    fixture.check("bilinear_ac_true_scale2", &["x"], |x| x[0].bilinear(2 * x[0].shape()[2], 2 * x[0].shape()[3], true));
}

/// The hard choice with the gradient of the soft one.
#[test]
fn gumbel_softmax() {
    let fixture = Fixture::read();
    let (noise, shape) = fixture.floats("gumbel_softmax.noise");
    fixture.check("gumbel_softmax", &["x"], |x| {
        let tape = x[0].tape();
        let soft = ((x[0] + tape.constant(&noise, shape)) * 2.0).softmax(1);
        let chosen =
            |row: &[f32]| row.iter().map(|p| f32::from(*p >= row.iter().copied().fold(0.0, f32::max))).collect();
        let hard: Vec<f32> = soft.to_vec().chunks(shape[1]).flat_map(|row| -> Vec<f32> { chosen(row) }).collect();
        ops::straight_through(soft, tape.constant(&hard, shape))
    });
}
