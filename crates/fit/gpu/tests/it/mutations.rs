//! Shaders that are wrong in one line: the comparisons of other tests notice.

use crate::device::{gradients, render};
use crate::scene::{Scene, relative};
use weaver_gpu::{Choice, Context, GpuError, GpuRasterizer, GpuWorkspace, Shader, adapters, sort_pairs, wgpu};

/// The rasterizer with `from` in place of `to` in the shader with this entry, or the error of opening it; `None`
/// without an adapter.
fn mutated(entry: &str, from: &str, to: &str) -> Option<Result<GpuRasterizer, GpuError>> {
    if adapters().is_empty() {
        println!("skipped: no adapter");
        return None;
    }
    let (entry, from, to) = (entry.to_string(), from.to_string(), to.to_string());
    let source = move |shader: &Shader| {
        let text = shader.source();
        if shader.entry != entry {
            return text;
        }
        assert!(text.contains(&from), "{entry} has no {from:?}");
        text.replace(&from, &to)
    };
    let context = Context::open_edited(&Choice::Number(0), wgpu::Limits::default(), &source);
    Some(context.map(GpuRasterizer::new))
}

/// True if images or gradients are further from the CPU's than rounding explains.
fn is_noticed(rasterizer: &GpuRasterizer) -> bool {
    let exact = Scene::random(31, 400, 1, (70, 50), Some(1)).with_channels(0);
    let (single, cotangents) = (exact.to_f32(), exact.cotangents(31));
    let mut workspace = GpuWorkspace::default();
    let (own, _) = render(rasterizer, &mut workspace, &single);
    let image = relative(&own.image, &exact.render().image, 0.0);
    let gradients = gradients(rasterizer, &mut workspace, &single, &cotangents.to_f32());
    let means = relative(&gradients[0], &exact.gradients(&cotangents)[0], 0.0);
    println!("image {image:.1e}, gradient of the means {means:.1e}");
    image > 1e-2 || means > 1e-2
}

#[test]
fn nothing_is_noticed_where_nothing_is_wrong() {
    let Some(rasterizer) = mutated("composite", "min(", "min(") else { return };
    assert!(!is_noticed(&rasterizer.unwrap()));
}

#[test]
fn a_sort_that_is_not_stable_is_noticed() {
    let forward = "for (var i = first; i < end; i++) {\n        let key";
    let backward = "for (var j = first; j < end; j++) {\n        let i = end - 1u - (j - first);\n        let key";
    let Some(rasterizer) = mutated("scatter", forward, backward) else { return };
    let keys: Vec<u32> = (0..3000).map(|i| i % 7).collect();
    let (mut sorted, mut values) = (keys.clone(), (0..3000).collect::<Vec<u32>>());
    sort_pairs(rasterizer.unwrap().context(), &mut sorted, &mut values, 4).unwrap();
    assert!(sorted.is_sorted(), "it still sorts");
    let mut expected: Vec<u32> = (0..3000).collect();
    expected.sort_by_key(|value| keys[*value as usize]);
    assert!(values != expected, "equal keys have kept their order");
}

#[test]
fn a_barrier_that_is_missing_is_noticed() {
    let barrier = "workgroupBarrier();\n        let before = any(open);";
    let Some(rasterizer) = mutated("composite", barrier, "let before = any(open);") else { return };
    assert!(is_noticed(&rasterizer.unwrap()));
}

#[test]
fn gradients_of_the_wrong_tile_are_noticed() {
    let (right, wrong) = ("view.grid.y + tile / view.grid.z", "view.grid.y + view.grid.w - 1u - tile / view.grid.z");
    let Some(rasterizer) = mutated("sum_moments", right, wrong) else { return };
    assert!(is_noticed(&rasterizer.unwrap()));
}

#[test]
fn entries_in_the_wrong_order_are_noticed() {
    let (right, wrong) = ("entry_at(at + 2u * lane, end)", "entry_at(at + 2u * (lane ^ 1u), end)");
    let Some(rasterizer) = mutated("sum_moments", right, wrong) else { return };
    assert!(is_noticed(&rasterizer.unwrap()));
}

#[test]
fn a_shader_that_is_refused_is_named() {
    let Some(refused) = mutated("composite", "var open = here;", "var open = nowhere;") else { return };
    let error = refused.unwrap_err();
    assert!(matches!(error, GpuError::Shader { file: "composite.wgsl", .. }), "{error}");
    let text = error.to_string();
    let adapter = &adapters()[0].name;
    assert!(text.contains("shaders/composite.wgsl") && text.contains("nowhere") && text.contains(adapter), "{text}");
}
