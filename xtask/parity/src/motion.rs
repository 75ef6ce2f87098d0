//! MoE-GS: the four models of motion and their regularizers.

use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape, Var, ops};
use weaver_dynamic::{Code, CodeConfig, Field, FieldConfig, Keys, KeysConfig, Motion, Moved, Poly, Start};
use weaver_nn::{Builder, Context};

pub fn run<T: Real>(file: Reference) -> Reference {
    // The file spells a word otherwise, and holds some of our parameters as inputs, without gradients.
    let file = file
        .with_word(concat!("cent", "re"), "center")
        .with_word("in.field.", "w.field.")
        .with_word("in.code.", "w.code.");
    let count = file.shape("w.poly.center")[0];
    let (positions, sizes) = (file.data::<f64>("w.code.mean"), vec![1.0; count]);
    let start = Start { positions: &positions, sizes: &sizes, opacity: 0.5 };
    let corners: Vec<f64> = file.data("in.box");
    let mut params = Params::<T>::new();
    let mut root = Builder::new(&mut params, 0);
    let config = FieldConfig {
        bounds: [0, 1].map(|i| [0, 1, 2].map(|axis| corners[3 * i + axis])),
        resolution: file.sizes("resolution").try_into().expect("four resolutions"),
        levels: file.size("levels"),
        channels: file.size("channels"),
        width: file.size("width"),
    };
    let field = Field::new(root.scope("field"), &start, config);
    let config = CodeConfig {
        code: file.shape("w.code.z")[1],
        table: file.shape("w.code.table").try_into().expect("rows and columns"),
        moments: ["coarse_rows", "fine_rows"].map(|key| file.size(key)),
        width: file.size("width"),
        neighbors: file.size(concat!("neighbo", "urs")),
    };
    let code = Code::new(root.scope("code"), &start, config);
    let frames = file.sizes("frames");
    let config = KeysConfig {
        frames: frames.iter().max().expect("frames") + 1,
        interval: file.size("interval"),
        pad: file.number("pad"),
        margin: file.number("var_pad"),
    };
    let keys = Keys::new(root.scope("keys"), &start, config);
    let poly = Poly::new(root.scope("poly"), &start, &vec![0.0; count]);
    file.load(&mut params);

    let tape = Tape::<T>::new();
    let cx = Context::new(&tape, &params);
    let times = file.config["times"].as_array().expect("a list of times");
    let times: Vec<f64> = times.iter().map(|time| time.as_f64().expect("a number")).collect();
    let at = |model: &dyn Motion<T>| -> Vec<Moved<'_, T>> { times.iter().map(|time| model.at(cx, *time)).collect() };
    let of_keys: Vec<Moved<'_, T>> = frames.iter().map(|frame| keys.at_frame(cx, *frame as f64)).collect();
    let mut loss = tape.scalar(T::ZERO);
    for (name, all) in [("field", at(&field)), ("code", at(&code)), ("keys", of_keys), ("poly", at(&poly))] {
        for part in ["means", "scales", "quats", "opacities"] {
            let rows = all.iter().map(|moved| match part {
                "means" => moved.means,
                "scales" => moved.scales,
                "quats" => moved.quats,
                _ => moved.opacities.reshape([count, 1]),
            });
            let rows: Vec<Var<'_, T>> = rows.collect();
            let shape = file.shape(&format!("out.{name}.{part}"));
            let stacked = ops::concat(&rows, 0).reshape(shape.as_slice());
            file.check(&format!("out.{name}.{part}"), &stacked.value());
            loss = loss + file.weighted(stacked, &format!("cot.{name}.{part}"));
        }
    }
    let regularizers = [
        ("field.rough_space", field.roughness(cx, false)),
        ("field.rough_time", field.roughness(cx, true)),
        ("field.time_l1", field.stir(cx)),
        ("code.smooth", code.smoothness(cx)),
    ];
    for (name, value) in regularizers {
        file.check(&format!("out.{name}"), &value.value());
        loss = loss + file.weighted(value, &format!("cot.{name}"));
    }
    file.backward(loss);
    file.check_params(&params, &tape);
    file
}
