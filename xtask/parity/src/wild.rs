//! WildSplatter: embeddings, standardized photos, colors, masked losses, scale and shift.

use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape};
use weaver_geometry::Similarity;
use weaver_geometry::glam::DVec3;
use weaver_losses::{masked_mse, masked_ssim};
use weaver_nn::{Builder, Context, WeightInit};
use weaver_wild::{AppearanceEncoder, AppearanceEncoderConfig, LookDecoder, LookDecoderConfig, standardized};

pub fn run<T: Real>(file: Reference) -> Reference {
    // The file spells it otherwise.
    let file =
        file.with_word(concat!("recolo", "ur"), "recolor").with_word(concat!("standardi", "sed"), "standardized");
    let (features, embedding) = (file.size("features"), file.size("embedding"));
    let mut params = Params::<T>::new();
    let config = AppearanceEncoderConfig {
        width: file.size("dim"),
        heads: file.size("heads"),
        blocks: 1,
        mlp_ratio: file.size("mlp_ratio"),
        layer_scale: file.number("layer_scale"),
        hidden: vec![16],
        embedding,
        init: WeightInit::FanIn,
    };
    let encoder = AppearanceEncoder::new(Builder::new(&mut params, 0), &config);
    let (hidden, sh_degree) = (file.size("hidden"), file.size("sh_degree"));
    let config = LookDecoderConfig { features, embedding, hidden, sh_degree, recolor: true };
    let decoder = LookDecoder::new(Builder::new(&mut params, 0), config);
    file.load(&mut params);

    let tape = Tape::<T>::new();
    let cx = Context::new(&tape, &params);
    let (tokens, maps) = (file.leaf(&tape, "in.tokens"), file.leaf(&tape, "in.features"));
    let looks = encoder.forward(cx, tokens, [file.size("rows"), file.size("columns")]);
    file.check("out.embedding", &looks.value());
    let pixels = file.size("width") * file.size("height");
    let mask: Vec<bool> = file.mask("in.photo_mask");
    let plain = standardized(&file.data::<T>("in.photos"), Some(&mask), pixels);
    file.check("out.standardized", &plain);
    let plain = tape.constant(&plain, file.shape("in.photos").as_slice());
    let colors = decoder.forward(cx, maps, looks, plain);
    file.check("out.sh", &colors.value());
    let published = decoder.published(cx, maps, looks);
    file.check("out.sh_published", &published.value());

    let (render, target) = (file.leaf(&tape, "in.render"), file.constant(&tape, "in.target"));
    let mse = masked_mse(render, target, &file.mask("in.mask"));
    let mut holes = vec![true; 2 * pixels];
    for image in holes.chunks_mut(pixels) {
        image[..2].fill(false);
    }
    let ssim = masked_ssim(render, target, &holes).mean();
    file.check("out.masked_mse", &mse.value());
    file.check("out.masked_ssim", &ssim.value());

    let points = |key: &str| -> Vec<DVec3> { file.data::<f64>(key).chunks(3).map(DVec3::from_slice).collect() };
    let weights: Vec<f64> = file.data("in.points_weight");
    let found = Similarity::fit_scale_and_shift(&points("in.points"), &points("in.points_seen"), &weights, 1e-6)
        .expect("the file's points determine it");
    let [x, y, z] = found.translation.to_array();
    file.check("out.scale_shift", &[found.scale, x, y, z]);

    let loss = file.weighted(colors, "cot.sh")
        + file.weighted(published, "cot.sh_published")
        + file.weighted(looks, "cot.embedding")
        + file.weighted(mse, "cot.masked_mse")
        + file.weighted(ssim, "cot.masked_ssim");
    file.backward(loss);
    for (key, leaf) in [("tokens", tokens), ("features", maps), ("render", render)] {
        file.check_grad(&format!("grad.in.{key}"), leaf);
    }
    file.check_params(&params, &tape);
    file
}
