//! Each model learns the same paths from positions alone: a cubic, a wave, a jump, neighbors that move against each
//! other.

use weaver_autograd::{Params, Tape};
use weaver_dynamic::{Code, CodeConfig, Field, FieldConfig, Keys, KeysConfig, Motion, Poly, Start};
use weaver_nn::{AdamW, Builder, Context, Group};

const FRAMES: usize = 16;
const PATHS: [&str; 4] = ["cubic", "wave", "jump", "against"];

/// Position of Gaussian i at a time: two of each kind.
fn truth(i: usize, t: f64) -> [f64; 3] {
    let base = [0.5 * (i / 2) as f64 - 0.75, 0.02 * (i % 2) as f64, 0.0];
    let shift = match PATHS[i / 2] {
        "cubic" => t * t * t - 0.5 * t,
        "wave" => 0.3 * (12.0 * t).sin(),
        "jump" => f64::from(u8::from(t > 0.5)) * 0.4,
        _ => (if i.is_multiple_of(2) { 0.3 } else { -0.3 }) * (6.0 * t).sin(),
    };
    [base[0], base[1] + shift, base[2]]
}

fn main() {
    let count = 2 * PATHS.len();
    let positions: Vec<f64> = (0..count).flat_map(|i| truth(i, 0.0)).collect();
    let start = Start { positions: &positions, sizes: &vec![0.05; count], opacity: 0.5 };
    let mut params = Params::<f32>::new();
    let mut root = Builder::new(&mut params, 0);
    let bounds = [[-1.0; 3], [1.0; 3]];
    let field = FieldConfig { bounds, resolution: [16, 16, 8, 8], levels: 2, channels: 8, width: 32 };
    let code = CodeConfig { code: 8, table: [16, 16], moments: [4, 16], width: 32, neighbors: 3 };
    let keys = KeysConfig { frames: FRAMES, interval: 2, pad: 0.0, margin: 3.0 };
    let models: [(&str, Box<dyn Motion<f32>>); 4] = [
        ("field", Box::new(Field::new(root.scope("field"), &start, field))),
        ("code", Box::new(Code::new(root.scope("code"), &start, code))),
        ("keys", Box::new(Keys::new(root.scope("keys"), &start, keys))),
        ("poly", Box::new(Poly::new(root.scope("poly"), &start, &vec![0.5; count]))),
    ];
    println!("{:<8}{}", "model", PATHS.map(|path| format!("{path:>10}")).concat());
    let mut tape = Tape::new();
    for (name, model) in models {
        let own = params.iter().filter(|(_, p)| p.name().starts_with(name)).map(|(id, _)| id).collect();
        let group = Group { params: own, lr_scale: 1.0, weight_decay: 0.0 };
        let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-12);
        let mut errors = [0.0; PATHS.len()];
        for step in 0..=2000 {
            let t = (step * 7 % FRAMES) as f64 / FRAMES as f64;
            {
                let means = model.at(Context::new(&tape, &params), t).means;
                let wanted: Vec<f32> = (0..count).flat_map(|i| truth(i, t)).map(|x| x as f32).collect();
                let squares = (means - tape.constant(&wanted, [count, 3])).square();
                if step > 2000 - FRAMES {
                    for (i, square) in squares.value().chunks(3).enumerate() {
                        errors[i / 2] += square.iter().map(|x| f64::from(*x)).sum::<f64>() / (2 * FRAMES) as f64;
                    }
                }
                squares.mean().backward();
            }
            optimizer.step(&mut params, &mut tape, 0.01);
            tape.reset();
        }
        println!("{name:<8}{}", errors.map(|e| format!("{:>10.4}", e.sqrt())).concat());
    }
}
