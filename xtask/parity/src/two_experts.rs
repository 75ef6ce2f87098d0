//! 2Xplat: attention with cameras, rays, the loss on cameras, the appearance expert.

use super::reference::Reference;
use weaver_autograd::ops::{self, RopeTable};
use weaver_autograd::{Params, Real, Tape, Var};
use weaver_losses::{focal_error, rotation_angles};
use weaver_nn::{Builder, Context, Projections, projective_attention, turned_attention};
use weaver_pose::{CameraVars, Rays, average_frame, projections, relative_poses};
use weaver_two_experts::{OpacityDegree, Parametrization, Pyramid, PyramidConfig};

/// Base of the frequencies by which positions turn.
const BASE: f64 = 100.0;

/// The cameras of a file.
fn cameras_of<'t, T: Real>(file: &Reference, tape: &'t Tape<T>) -> CameraVars<'t, T> {
    CameraVars { viewmats: file.leaf(tape, "in.w2c"), intrinsics: file.leaf(tape, "in.intrinsics") }
}

fn check_camera_gradients<T: Real>(file: &Reference, cameras: &CameraVars<'_, T>) {
    file.check_grad("grad.in.w2c", cameras.viewmats);
    file.check_grad("grad.in.intrinsics", cameras.intrinsics);
}

/// The file has heads before tokens.
fn tokens_first<T: Real>(x: Var<'_, T>) -> Var<'_, T> {
    x.permute(&[0, 2, 1, 3])
}

pub fn attention<T: Real>(file: Reference) -> Reference {
    let [batch, views] = ["batch", "views"].map(|key| file.size(key));
    let size = [file.size("height"), file.size("width")];
    let [rows, columns, registers] = ["rows", "columns", "registers"].map(|key| file.size(key));
    let patches = (0..rows * columns).map(|i| [i % columns + 1, i / columns + 1]);
    let of_view: Vec<[usize; 2]> = std::iter::repeat_n([0, 0], registers).chain(patches).collect();
    let turns = RopeTable::new(&of_view.repeat(views), file.size("head") / 2, BASE);
    let tape = Tape::<T>::new();
    let qkv = ["q", "k", "v"].map(|name| file.leaf(&tape, &format!("in.{name}")));
    let cameras = cameras_of(&file, &tape);
    let attend = |cameras| {
        let [matrices, inverses] = projections(cameras, size);
        let [q, k, v] = qkv.map(tokens_first);
        let y = projective_attention(q, k, v, &Projections { matrices, inverses }, &turns);
        ([matrices, inverses], tokens_first(y))
    };
    let ([matrices, inverses], y) = attend(&cameras);
    file.check("out.matrices", &matrices.value());
    file.check("out.inverses", &inverses.value());
    file.check("out.prope", &y.value());
    // The world moved: w2c * world.
    let worlds = file.constant(&tape, "in.world");
    let moved: Vec<Var<'_, T>> = (0..batch)
        .map(|b| {
            let world = worlds.slice(0, b, 1).reshape([3, 4]);
            let viewmats = cameras.viewmats.detach().slice(0, b, 1).reshape([3 * views, 4]);
            let turned = viewmats.slice(1, 0, 3).matmul(world).reshape([views, 3, 4]);
            let shift = viewmats.slice(1, 3, 1).reshape([views, 3, 1]);
            let translation = turned.slice(2, 3, 1) + shift;
            ops::concat(&[turned.slice(2, 0, 3), translation], 2).reshape([1, views, 3, 4])
        })
        .collect();
    let moved = CameraVars { viewmats: ops::concat(&moved, 0), intrinsics: cameras.intrinsics.detach() };
    file.check("out.moved", &attend(&moved).1.value());
    let view = ["q", "k", "v"].map(|name| file.leaf(&tape, &format!("in.view_{name}")));
    let [q, k, v] = view.map(tokens_first);
    let turned = tokens_first(turned_attention(q, k, v, &RopeTable::new(&of_view, file.size("head"), BASE)));
    file.check("out.turned", &turned.value());
    file.backward(file.weighted(y, "cot.prope") + file.weighted(turned, "cot.turned"));
    for (i, name) in ["q", "k", "v"].into_iter().enumerate() {
        file.check_grad(&format!("grad.in.{name}"), qkv[i]);
        file.check_grad(&format!("grad.in.view_{name}"), view[i]);
    }
    check_camera_gradients(&file, &cameras);
    file
}

pub fn rays<T: Real>(file: Reference) -> Reference {
    let [views, height, width] = ["views", "height", "width"].map(|key| file.size(key));
    let tape = Tape::<T>::new();
    let cameras = cameras_of(&file, &tape);
    let rays = Rays::new(&cameras, [height, width]);
    let leaf = file.leaf(&tape, "in.distance");
    let distance = leaf.reshape([views, height * width, 1]);
    let [map, points] = [rays.map(file.constant(&tape, "in.photos")), rays.points(distance)]
        .map(|rows| rows.permute(&[0, 2, 1]).reshape([views, rows.shape()[2], height, width]));
    let found = [("ray_map", map), ("points", points), ("depth", rays.depth(distance))];
    let mut loss = tape.scalar(T::ZERO);
    for (name, y) in found {
        file.check(&format!("out.{name}"), &y.value());
        loss = loss + file.weighted(y, &format!("cot.{name}"));
    }
    file.backward(loss);
    file.check_grad("grad.in.distance", leaf);
    check_camera_gradients(&file, &cameras);
    file
}

pub fn cameras<T: Real>(file: Reference) -> Reference {
    let width = file.size("width");
    let tape = Tape::<T>::new();
    let cameras = cameras_of(&file, &tape);
    let truth = CameraVars {
        viewmats: file.constant(&tape, "in.true_w2c"),
        intrinsics: file.constant(&tape, "in.true_intrinsics"),
    };
    let terms = |viewmats, intrinsics| {
        let ([r, t], [r_true, t_true]) = (relative_poses(viewmats), relative_poses(truth.viewmats));
        let angles = rotation_angles(r, r_true);
        let focal = focal_error(intrinsics, truth.intrinsics, width);
        (angles, [angles.mean(), ops::huber(t, t_true, file.number("huber")).mean(), focal])
    };
    let (angles, found) = terms(cameras.viewmats, cameras.intrinsics);
    file.check("out.angles", &angles.value());
    let mut total = tape.scalar(T::ZERO);
    for (name, term) in ["rotation", "translation", "intrinsics"].into_iter().zip(found) {
        file.check(&format!("out.{name}"), &term.value());
        total = total + term * file.number(&format!("weights.{name}"));
    }
    file.check("out.total", &total.value());
    let at_truth = terms(truth.viewmats, truth.intrinsics).1.map(|term| term.item());
    file.check("out.at_truth", &at_truth);
    // [R | t] inverted by transposition.
    let (batch, views) = (file.size("batch"), file.size("views"));
    let transposed = cameras.viewmats.slice(3, 0, 3).permute(&[0, 1, 3, 2]);
    let centers = transposed.matmul(cameras.viewmats.slice(3, 3, 1)) * -1.0;
    let c2w = ops::concat(&[transposed, centers], 3).reshape([batch, views, 3, 4]);
    let middle = average_frame(c2w, file.size("context"));
    file.check("out.frame", &middle.frame.value());
    file.check("out.scale", &middle.scale.value());
    // The file spells it otherwise.
    file.check(concat!("out.normali", "sed_c2w"), &middle.cameras.value());
    file.backward(file.weighted(total, "cot.total") + file.weighted(middle.cameras, concat!("cot.normali", "sed_c2w")));
    check_camera_gradients(&file, &cameras);
    file
}

pub fn pyramid<T: Real>(file: Reference) -> Reference {
    let config = PyramidConfig {
        patch: file.size("patch"),
        width: file.sizes("widths")[0],
        blocks: file.sizes("blocks").try_into().expect("three levels"),
        head: file.size("head"),
        mlp_ratio: file.size("mlp_ratio"),
        registers: file.size("registers"),
        group: file.size("group"),
        features: file.size("features"),
        cameras: true,
        world_rays: true,
        opacity: OpacityDegree::Two,
        gain: 1.0,
    };
    let mut params = Params::<T>::new();
    let network = Pyramid::new(Builder::new(&mut params, 0), config);
    file.load(&mut params);
    let tape = Tape::<T>::new();
    let (cameras, photos) = (cameras_of(&file, &tape), file.leaf(&tape, "in.photos"));
    let (raw, features) = network.forward(Context::new(&tape, &params), photos, &cameras);
    for (i, level) in features.levels.iter().enumerate() {
        file.check(&format!("out.stage{}", i + 1), &level.value());
    }
    file.check("out.features", &features.map.value());
    file.check("out.raw", &raw.raw.value());
    let (gaussians, _) = raw.gaussians(Parametrization::Published, cameras.intrinsics, photos);
    file.check("out.means", &gaussians.means.value());
    file.check("out.scales", &gaussians.scales.value());
    file.check("out.sh", &gaussians.colors.value());
    let opacities = raw.opacities().seen_from(gaussians.means, raw.rays.origins.slice(0, 0, 1));
    file.check("out.opacities", &opacities.value());
    let loss = file.weighted(raw.raw, "cot.raw")
        + file.weighted(opacities, "cot.opacities")
        + file.weighted(gaussians.means, "cot.means");
    file.backward(loss);
    file.check_grad("grad.in.photos", photos);
    check_camera_gradients(&file, &cameras);
    file.check_params(&params, &tape);
    file
}
