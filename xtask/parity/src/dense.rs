//! The depth head and the unprojection.

use super::camera_head::check_cameras;
use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape};
use weaver_nn::{Builder, Context, WeightInit};
use weaver_pose::{cameras, unproject};
use weaver_vggt::{DenseTokens, DepthHead, DepthHeadConfig, DptConfig};

/// The sizes of a dense trunk, from their place in a file's configuration.
pub fn dpt(file: &Reference, dim: usize, at: &str) -> DptConfig {
    let channels = file.sizes(&format!("{at}out_channels"));
    let features = file.size(&format!("{at}features"));
    let out_channels = channels.try_into().expect("four levels");
    DptConfig { dim, out_channels, features, width: features / 2 }
}

pub fn run<T: Real>(file: Reference) -> Reference {
    let dpt = dpt(&file, file.size("dim_in"), "");
    let hidden = file.size("output_conv2_hidden");
    let config = DepthHeadConfig { dpt, hidden, log_depth_bounds: None, last: WeightInit::FanIn };
    let (height, width, views) = (file.size("image_h"), file.size("image_w"), file.size("views"));
    let mut params = Params::<T>::new();
    let head = DepthHead::new(Builder::new(&mut params, 0).scope("depth_head"), config);
    file.load(&mut params);
    let tape = Tape::<T>::new();
    let cx = Context::new(&tape, &params);
    let layers = [0, 1, 2, 3].map(|i| file.leaf(&tape, &format!("in.tokens{i}")));
    let grid = [file.size("grid_h"), file.size("grid_w")];
    let tokens = DenseTokens { layers: &layers, special: file.size("special_tokens"), grid, image: [height, width] };
    tape.without_gradient(|| {
        // The file has view 0 alone.
        let fused = head.trunk().fuse(cx, tokens);
        file.check("out.refinenet3", &fused[2].slice(0, 0, 1).value());
        file.check("out.refinenet4", &fused[3].slice(0, 0, 1).value());
        file.check("out.output_conv1", &head.trunk().trunk(cx, tokens).slice(0, 0, 1).value());
    });

    let maps = head.forward(cx, tokens);
    let depth = maps.depth.reshape([1, views, height, width]);
    let pose = file.leaf(&tape, "in.pose");
    let cameras = cameras(pose, height, width);
    let points = unproject(depth, cameras.viewmats, cameras.intrinsics, 0.0);
    check_cameras(&file, &cameras);
    let outputs = [(depth, "depth"), (maps.confidence, "conf"), (points, "points")];
    let mut loss = tape.scalar(T::ZERO);
    for (y, name) in outputs {
        file.check(&format!("out.{name}"), &y.value());
        loss = loss + file.weighted(y, &format!("cot.{name}"));
    }
    file.backward(loss);
    file.check_grad("grad.in.pose", pose);
    for (i, layer) in layers.iter().enumerate() {
        file.check_grad(&format!("grad.in.tokens{i}"), *layer);
    }
    file.check_params(&params, &tape);
    file
}
