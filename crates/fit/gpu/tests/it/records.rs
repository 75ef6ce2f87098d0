//! The steps between Gaussians and images: splats, their order, and the lists of the tiles, against formulas in `f64`.

use crate::device::{rasterizer, render, rounded};
use crate::scene::Scene;
use proptest::prelude::*;
use weaver_gpu::{GpuWorkspace, Lists};
use weaver_splat::View;

/// sqrt(log2(e) / 2): p, q and r are stored times it.
const BITS: f64 = 0.849_321_800_288_019_1;

/// Depth, center, and p, q, r of sigma = (u^2 + v^2) / 2, u = p dx + q dy, v = r dy.
struct Splat {
    depth: f64,
    center: [f64; 2],
    factor: [f64; 3],
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

/// The rotation matrix of a quaternion wxyz of any length.
fn rotation(q: &[f64]) -> [[f64; 3]; 3] {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = [0, 1, 2, 3].map(|i| q[i] / length);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// By the formulas of docs/explain/rasterizer.md, through the covariance matrix.
fn splat(scene: &Scene<f64>, n: usize) -> Splat {
    let View { axes, shift, focal, principal, low, high, .. } = View::of(&scene.cameras(), 0);
    let mean = [0, 1, 2].map(|i| scene.means[3 * n + i]);
    let point = [0, 1, 2].map(|i| dot(axes[i], mean) + shift[i]);
    let slope = [0, 1].map(|i| point[i] / point[2]);
    let map = [0, 1].map(|i| {
        let bounded = slope[i].clamp(low[i], high[i]);
        [0, 1, 2].map(|j| focal[i] / point[2] * (axes[i][j] - bounded * axes[2][j]))
    });
    let turned = rotation(&scene.quats[4 * n..][..4]);
    let rows = map.map(|row| [0, 1, 2].map(|j| dot(row, [0, 1, 2].map(|i| turned[i][j])) * scene.scales[3 * n + j]));
    let blur = scene.settings.eps2d;
    let [xx, xy, yy] = [dot(rows[0], rows[0]) + blur, dot(rows[0], rows[1]), dot(rows[1], rows[1]) + blur];
    // Of the inverse covariance, det = xx yy - xy^2: p^2 = yy / det, p q = -xy / det, r^2 = 1 / yy.
    let p = (yy / (xx * yy - xy * xy)).sqrt();
    let factor = [p, -xy / yy * p, 1.0 / yy.sqrt()];
    Splat { depth: point[2], center: [0, 1].map(|i| focal[i] * slope[i] + principal[i]), factor }
}

/// The number whose order a depth key has.
fn depth_of(key: u32) -> f32 {
    f32::from_bits(if key >> 31 == 1 { key & 0x7fff_ffff } else { !key })
}

fn check(scene: &Scene<f64>, Lists { splats, keys, ids, owners, entry, starts }: &Lists) -> Result<(), TestCaseError> {
    let n = scene.opacities.len();
    let seen = keys[..n].iter().take_while(|key| **key != u32::MAX).count();
    prop_assert!(keys[..n].is_sorted());
    let mut all = ids[..n].to_vec();
    all.sort_unstable();
    prop_assert!(all.iter().enumerate().all(|(i, id)| i == *id as usize), "each Gaussian once");
    for place in 0..seen {
        let id = ids[place] as usize;
        prop_assert!(place == 0 || keys[place - 1] < keys[place] || ids[place - 1] < ids[place], "ties by index");
        let expected = splat(scene, id);
        let (key, exact) = (depth_of(keys[place]), expected.depth as f32);
        prop_assert!(key.to_bits().abs_diff(exact.to_bits()) <= 2, "key {key}, depth {exact}");
        let record = &splats[id];
        let size = expected.center.map(f64::abs).into_iter().fold(1.0, f64::max);
        for (i, center) in expected.center.iter().enumerate() {
            prop_assert!((f64::from(record[i]) - center).abs() <= 1e-5 * size, "center {} {center}", record[i]);
        }
        let [p, q, r] = expected.factor.map(|x| x * BITS);
        for (ours, theirs) in [(record[2], p), (record[3], q), (record[4], r)] {
            let size = if theirs == q { p.max(r).max(q.abs()) } else { theirs };
            prop_assert!((f64::from(ours) - theirs).abs() <= 1e-5 * size, "{ours} {theirs}");
        }
    }
    // Front to back in each tile, and nothing missing that adds to one of its pixels.
    let across = scene.width.div_ceil(16);
    let mut places = vec![usize::MAX; n];
    ids[..n].iter().enumerate().for_each(|(place, id)| places[*id as usize] = place);
    for tile in 0..across * scene.height.div_ceil(16) {
        let list: Vec<usize> = entry[starts[tile] as usize..starts[tile + 1] as usize]
            .iter()
            .map(|e| places[owners[*e as usize] as usize])
            .collect();
        prop_assert!(list.windows(2).all(|pair| pair[0] < pair[1]), "front to back");
        for (place, id) in ids[..n].iter().enumerate().filter(|(place, _)| list.binary_search(place).is_err()) {
            let Splat { depth, center, factor: [p, q, r] } = splat(scene, *id as usize);
            if place >= seen && depth < 1.001 * scene.settings.near {
                continue;
            }
            for pixel in 0..256 {
                let (x, y) = (tile % across * 16 + pixel % 16, tile / across * 16 + pixel / 16);
                let (dx, dy) = (x as f64 + 0.5 - center[0], y as f64 + 0.5 - center[1]);
                let (u, v) = (p * dx + q * dy, r * dy);
                let alpha = scene.opacities[*id as usize] * (-0.5 * (u * u + v * v)).exp();
                let inside = x < scene.width && y < scene.height;
                prop_assert!(!inside || alpha < 1.0001 / 255.0, "Gaussian {id} is missing in tile {tile}: {alpha}");
            }
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 32, failure_persistence: None, ..Default::default() })]

    #[test]
    fn splats_order_and_lists_are_those_of_the_formulas(
        seed: u64,
        n in 1_usize..200,
        size in (1_usize..80, 1_usize..60),
    ) {
        let Some(rasterizer) = rasterizer() else { return Ok(()) };
        let scene = rounded(&Scene::random(seed, n, 1, size, None).with_channels(0));
        let mut workspace = GpuWorkspace::default();
        render(&rasterizer, &mut workspace, &scene.to_f32());
        check(&scene, &workspace.lists(rasterizer.context()).unwrap())?;
    }
}
