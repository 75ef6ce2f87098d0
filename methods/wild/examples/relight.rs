//! Learns contrast and middle of drawn looks: pictures of one texture in different light, distinguished by a one-hot
//! embedding.

use weaver_autograd::{Params, Tape, ops};
use weaver_nn::{AdamW, Builder, Context, Group};
use weaver_wild::{LookDecoder, LookDecoderConfig, standardized};

const SIDE: usize = 16;
const LOOKS: usize = 3;

fn main() {
    let pixels = SIDE * SIDE;
    let texture: Vec<f32> = (0..3 * pixels).map(|i| 0.5 + 0.3 * (0.7 * i as f32).sin()).collect();
    let mut params = Params::<f32>::new();
    let config = LookDecoderConfig { features: 1, embedding: LOOKS, hidden: 4, sh_degree: 0, recolor: true };
    let decoder = LookDecoder::new(Builder::new(&mut params, 0).scope("looks"), config);
    let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.0 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-8);
    let mut tape = Tape::new();
    let plain = standardized(&texture, None, pixels);
    for step in 0..=300 {
        {
            let cx = Context::new(&tape, &params);
            let looks = tape.constant_with([LOOKS, LOOKS], |x| (0..LOOKS).for_each(|i| x[i * LOOKS + i] = 1.0));
            let maps = tape.constant(&vec![0.0; pixels], [1, 1, SIDE, SIDE]);
            let plain = tape.constant(&plain, [1, 3, SIDE, SIDE]);
            let shown = decoder.forward(cx, maps, looks, plain) * 0.2820948 + 0.5;
            let truth = tape.constant_with([LOOKS, pixels, 1, 3], |x| {
                for (i, x) in x.iter_mut().enumerate() {
                    let (look, pixel, channel) = (i / (3 * pixels), i / 3 % pixels, i % 3);
                    let tint = 0.4 + 0.3 * ((look + channel) % 3) as f32;
                    *x = tint * texture[channel * pixels + pixel];
                }
            });
            let loss = ops::huber(shown, truth, 1.0).mean();
            if step % 100 == 0 {
                println!("step {step:3}: loss {:.2e}", loss.item());
            }
            loss.backward();
        }
        optimizer.step(&mut params, &mut tape, 0.02);
        tape.reset();
    }
}
