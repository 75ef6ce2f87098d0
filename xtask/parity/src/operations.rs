//! Single operations: `<op>.in.*`, `<op>.cot`, `<op>.out` and `<op>.grad.*`. The kind of an operation follows from its
//! name, its sizes from the tensors, and its constants from the note in the metadata.

use super::camera_head::{intrinsics, matrices};
use super::reference::Reference;
use weaver_autograd::ops::{self, Activation, RopeTable};
use weaver_autograd::{Params, Real, Shape, Tape, Var};
use weaver_losses::quantiles;
use weaver_nn::{Builder, Context};
use weaver_router::gumbel_softmax_straight_through;
use weaver_vggt::{ResidualConvUnit, add_position};

/// One operation of the file.
struct Operation<'f> {
    file: &'f Reference,
    name: &'f str,
    note: &'f str,
}

/// The number after a word of the note, as in `stride 2`.
fn after(note: &str, word: &str) -> Option<f64> {
    let rest = note.split(word).nth(1)?.trim_start();
    let end = rest.find(|c: char| !(c.is_ascii_digit() || ".e-".contains(c))).unwrap_or(rest.len());
    rest[..end].trim_end_matches(['.', '-']).parse().ok()
}

impl Operation<'_> {
    fn key(&self, part: &str) -> String {
        format!("{}.{part}", self.name)
    }

    fn constant(&self, word: &str) -> f64 {
        after(self.note, word).unwrap_or_else(|| panic!("{}: no {word} in its note `{}`", self.name, self.note))
    }

    /// Height and width of the image of a note such as `image 56x84 (HxW)`.
    fn image(&self) -> [usize; 2] {
        let text = self.note.split("image ").nth(1).and_then(|rest| rest.split([' ', ',', ':']).next());
        let sides = text.and_then(|t| t.split_once('x')).map(|(h, w)| (h.parse(), w.parse()));
        match sides {
            Some((Ok(height), Ok(width))) => [height, width],
            _ => panic!("{}: no image size in its note `{}`", self.name, self.note),
        }
    }

    /// Runs `f` on the inputs called `names` and compares its result and their gradients.
    fn check<T: Real>(&self, names: &[&str], f: impl for<'t> Fn(&[Var<'t, T>]) -> Var<'t, T>) {
        let tape = Tape::<T>::new();
        let inputs: Vec<_> = names.iter().map(|name| self.file.leaf(&tape, &self.key(&format!("in.{name}")))).collect();
        let y = f(&inputs);
        self.file.check(&self.key("out"), &y.value());
        self.file.backward_with(y, &self.file.data(&self.key("cot")));
        for (x, name) in inputs.iter().zip(names) {
            self.file.check_grad(&self.key(&format!("grad.{name}")), *x);
        }
    }

    /// Rows and columns of the result.
    fn size(&self) -> [usize; 2] {
        let shape = self.file.shape(&self.key("out"));
        [shape[2], shape[3]]
    }

    fn run<T: Real>(&self) -> bool {
        let has_bias = self.file.has(&self.key("in.b"));
        let name = self.name;
        match name {
            "relu" => self.check::<T>(&["input"], |x| x[0].relu()),
            "silu" => self.check::<T>(&["input"], |x| x[0].silu()),
            "softplus" => self.check::<T>(&["input"], |x| x[0].softplus()),
            "sigmoid" => self.check::<T>(&["input"], |x| x[0].sigmoid()),
            "tanh" => self.check::<T>(&["input"], |x| x[0].tanh()),
            "linear" => self.check::<T>(&["x", "w", "b"], |x| ops::linear(x[0], x[1], Some(x[2]), Activation::None)),
            "huber" => self.check::<T>(&["x", "y"], |x| ops::huber(x[0], x[1], self.constant("delta"))),
            "rope2d" => self.rope::<T>(),
            "covariance" => self.covariance::<T>(),
            "unproject" => self.unproject::<T>(),
            "camera_encode" => self.encode::<T>(),
            "camera_decode_intrinsics" => self.decode_intrinsics::<T>(),
            "residual_conv_unit" => self.residual_unit::<T>(),
            "softmax_last" => self.check::<T>(&["x"], |x| x[0].softmax(x[0].shape().rank() - 1)),
            "softmax_dim1" => self.check::<T>(&["x"], |x| x[0].softmax(x[0].shape().rank() - 2)),
            "quat_to_mat_camera" => self.check::<T>(&["q"], |x| weaver_pose::rotation_from_xyzw(x[0])),
            "mat_to_quat" => self.check::<T>(&["m"], |x| weaver_pose::xyzw_from_rotation(x[0])),
            "cross_entropy" => {
                let labels = self.file.indices(&self.key("target"));
                self.check::<T>(&["x"], |x| ops::cross_entropy(x[0], &labels, self.constant("label smoothing")));
            }
            "gumbel_softmax" => self.check::<T>(&["x"], |x| {
                let noise = self.file.constant(x[0].tape(), &self.key("noise"));
                gumbel_softmax_straight_through(x[0], Some(noise), self.constant("temperature"))
            }),
            "camera_decode_extrinsics" => self.check::<T>(&["p"], |x| weaver_pose::cameras(x[0], 1, 1).viewmats),
            "dpt_pos_embed" => {
                let [height, width] = self.image();
                self.check::<T>(&["x"], |x| add_position(x[0], height, width));
            }
            "quantile" => {
                let list = self.note.split(" at ").nth(1).unwrap_or_default();
                let q: Vec<f64> = list.split(',').filter_map(|part| part.trim().parse().ok()).collect();
                self.check::<T>(&["x"], |x| quantiles(x[0], &q));
            }
            _ if name.starts_with("gelu") => self.check::<T>(&["input"], |x| x[0].gelu()),
            _ if name.starts_with("layer_norm") => {
                let eps = self.constant("eps");
                match has_bias {
                    true => self.check::<T>(&["x", "w", "b"], |x| x[0].layer_norm(Some((x[1], x[2])), eps)),
                    false => self.check::<T>(&["x"], |x| x[0].layer_norm(None, eps)),
                }
            }
            _ if name.starts_with("sdpa") => self.check::<T>(&["q", "k", "v"], |x| {
                let scale = 1.0 / (x[0].shape()[3] as f64).sqrt();
                let [q, k, v] = [x[0], x[1], x[2]].map(|x| x.permute(&[0, 2, 1, 3]));
                ops::attention(q, k, v, scale).permute(&[0, 2, 1, 3])
            }),
            _ if name.starts_with("conv_transpose2d") => {
                let stride = self.constant("stride") as usize;
                self.check::<T>(&["x", "w", "b"], |x| ops::conv_transpose2d(x[0], x[1], Some(x[2]), stride));
            }
            _ if name.starts_with("conv2d") => {
                let (stride, padding) = (self.constant("stride") as usize, self.constant("padding") as usize);
                let names = ["x", "w", "b"];
                let names = if has_bias { &names[..] } else { &names[..2] };
                self.check::<T>(names, |x| ops::conv2d(x[0], x[1], x.get(2).copied(), stride, padding));
            }
            _ if name.starts_with("bicubic_aa") => {
                let [h, w] = self.size();
                self.check::<T>(&["x"], |x| x[0].bicubic_antialias(h, w));
            }
            _ if name.starts_with("bicubic_plain") => {
                let [h, w] = self.size();
                self.check::<T>(&["x"], |x| x[0].bicubic(h, w));
            }
            _ if name.starts_with("bilinear_ac_") => {
                let ([h, w], aligned) = (self.size(), name.starts_with("bilinear_ac_true"));
                self.check::<T>(&["x"], |x| x[0].bilinear(h, w, aligned));
            }
            _ => return false,
        }
        true
    }

    /// x [batch, heads, tokens, dim] with positions of each batch entry's own.
    fn rope<T: Real>(&self) {
        let positions = self.file.indices(&self.key("positions"));
        let tokens = self.file.shape(&self.key("positions"))[1];
        self.check::<T>(&["x"], |x| {
            let (heads_last, dim) = (x[0].permute(&[0, 2, 1, 3]), x[0].shape()[3]);
            let turned: Vec<_> = (0..x[0].shape()[0])
                .map(|b| {
                    let of_entry = &positions[2 * tokens * b..2 * tokens * (b + 1)];
                    let of_entry: Vec<_> = of_entry.chunks(2).map(|p| [p[0] as usize, p[1] as usize]).collect();
                    heads_last.slice(0, b, 1).rope2d(&RopeTable::new(&of_entry, dim, self.constant("base")))
                })
                .collect();
            ops::concat(&turned, 0).permute(&[0, 2, 1, 3])
        });
    }

    /// The file has quaternions xyzw.
    fn covariance<T: Real>(&self) {
        self.check::<T>(&["s", "q"], |x| {
            let wxyz = ops::concat(&[x[1].slice(1, 3, 1), x[1].slice(1, 0, 3)], 1);
            weaver_splat::covariance(x[0], wxyz)
        });
    }

    /// The file has 3x3 matrices of intrinsics.
    fn unproject<T: Real>(&self) {
        let file = self.file;
        let tape = Tape::<T>::new();
        let (depth, viewmats) = (file.leaf(&tape, &self.key("in.d")), file.leaf(&tape, &self.key("in.e")));
        let shape = viewmats.shape();
        let views = &shape.dims()[..shape.rank() - 2];
        let k = intrinsics(&file.data(&self.key("in.k")));
        let intrinsics = tape.leaf(&k, Shape::new(&[views, &[4]].concat()));
        let maps = depth.reshape(&depth.shape().dims()[..depth.shape().rank() - 1]);
        let points = weaver_pose::unproject(maps, viewmats, intrinsics, 0.0);
        file.check(&self.key("out"), &points.value());
        file.backward_with(points, &file.data(&self.key("cot")));
        file.check_grad(&self.key("grad.d"), depth);
        file.check_grad(&self.key("grad.e"), viewmats);
        file.check(&self.key("grad.k"), &matrices(&intrinsics.grad().unwrap_or_default(), 0.0));
    }

    fn encode<T: Real>(&self) {
        let file = self.file;
        let tape = Tape::<T>::new();
        let viewmats = file.leaf(&tape, &self.key("in.e"));
        let shape = viewmats.shape();
        let views = &shape.dims()[..shape.rank() - 2];
        let k = intrinsics(&file.data(&self.key("in.k")));
        let intrinsics = tape.leaf(&k, Shape::new(&[views, &[4]].concat()));
        let [height, width] = self.image();
        let code = weaver_pose::encode(viewmats, intrinsics, height, width);
        file.check(&self.key("out"), &code.value());
        file.backward_with(code, &file.data(&self.key("cot")));
        file.check_grad(&self.key("grad.e"), viewmats);
        file.check(&self.key("grad.k"), &matrices(&intrinsics.grad().unwrap_or_default(), 0.0));
    }

    fn decode_intrinsics<T: Real>(&self) {
        let file = self.file;
        let tape = Tape::<T>::new();
        let code = file.leaf(&tape, &self.key("in.p"));
        let [height, width] = self.image();
        let rows = weaver_pose::cameras(code, height, width).intrinsics;
        file.check(&self.key("out"), &matrices(&rows.value(), 1.0));
        file.backward_with(rows, &intrinsics(&file.data(&self.key("cot"))));
        file.check_grad(&self.key("grad.p"), code);
    }

    fn residual_unit<T: Real>(&self) {
        let file = self.file;
        let tape = Tape::<T>::new();
        let x = file.leaf(&tape, &self.key("in.x"));
        let mut params = Params::<T>::new();
        let unit = ResidualConvUnit::new(Builder::new(&mut params, 0), x.shape()[1]);
        let names = [("conv1.weight", "w1"), ("conv1.bias", "b1"), ("conv2.weight", "w2"), ("conv2.bias", "b2")];
        let id = |params: &Params<T>, name: &str| params.find(name).expect("the unit has this parameter");
        for (name, key) in names {
            let id = id(&params, name);
            params.value_mut(id).copy_from_slice(&file.data(&self.key(&format!("in.{key}"))));
        }
        let y = unit.forward(Context::new(&tape, &params), x);
        file.check(&self.key("out"), &y.value());
        file.backward_with(y, &file.data(&self.key("cot")));
        file.check_grad(&self.key("grad.x"), x);
        for (name, key) in names {
            let gradient = tape.param_grad(id(&params, name)).map(|g| g.to_vec());
            file.check(&self.key(&format!("grad.{key}")), &gradient.unwrap_or_default());
        }
    }
}

pub fn run<T: Real>(file: Reference) -> Reference {
    let notes = file.operations.as_object().cloned().unwrap_or_default();
    for (name, note) in &notes {
        let operation = Operation { file: &file, name, note: note.as_str().unwrap_or_default() };
        if !operation.run::<T>() {
            file.fail(name, "an operation that is not known here".into());
        }
    }
    file
}

#[cfg(test)]
mod tests {
    use super::after;

    #[test]
    fn numbers_of_notes() {
        assert_eq!(after("last axis, eps 1e-05", "eps"), Some(1e-5));
        assert_eq!(after("last axis, eps 1e-6, no weight", "eps"), Some(1e-6));
        assert_eq!(after("3x3, stride 1, padding 1", "stride"), Some(1.0));
        assert_eq!(after("elementwise", "delta"), None);
    }
}
