//! Scenes in levels of detail.

use serde_json::Value;
use std::path::Path;
use weaver_io::{read_gaussians, write_gaussians};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

/// Gaussians along a wall of 8 x 4, in two colors.
fn wall(count: usize) -> Gaussians {
    let stream = Stream::new(5, 0, "wall");
    let draw = |k: u64, i: usize| stream.fork(k).uniform::<f32>(i as u64);
    Gaussians {
        means: (0..count).map(|i| [8.0 * draw(0, i), 4.0 * draw(1, i), 0.01 * draw(2, i)]).collect(),
        log_scales: vec![[-4.0, -4.0, -7.0]; count],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; count],
        opacity_logits: vec![2.0; count],
        sh: (0..count).flat_map(|i| [if draw(0, i) < 0.5 { -1.0 } else { 1.0 }; 3]).collect(),
        degree: 0,
    }
}

fn document(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn edited(path: &Path, edit: impl FnOnce(&mut Value)) -> String {
    let before = std::fs::read(path).unwrap();
    let mut document = document(path);
    edit(&mut document);
    std::fs::write(path, document.to_string()).unwrap();
    let error = read_gaussians(path).unwrap_err().to_string();
    std::fs::write(path, before).unwrap();
    error
}

/// The leaves of a tree: corners and spans.
fn leaves(node: &Value) -> Vec<Value> {
    match node["children"].as_array() {
        Some(children) => children.iter().flat_map(leaves).collect(),
        None => vec![node.clone()],
    }
}

fn corner(value: &Value) -> [f32; 3] {
    serde_json::from_value(value.clone()).unwrap()
}

/// Promise (kept): levels of a streamed scene hold what their boxes say, and its finest level is the scene.
#[test]
fn levels_are_where_the_tree_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall/lod-meta.json");
    std::fs::create_dir(folder.path().join("wall")).unwrap();
    let scene = wall(70_000);
    write_gaussians(&path, &scene).unwrap();
    let all = document(&path);
    assert_eq!(all["counts"], serde_json::json!([70_000, 17_500]));
    assert_eq!(all["lodLevels"], 2);
    let names: Vec<String> = serde_json::from_value(all["filenames"].clone()).unwrap();
    let parts: Vec<Gaussians> = names.iter().map(|name| read_gaussians(path.with_file_name(name)).unwrap()).collect();
    let mut counts = [0; 2];
    let leaves = leaves(&all["tree"]);
    assert_eq!(leaves.len(), 4);
    for leaf in leaves {
        let (min, max) = (corner(&leaf["bound"]["min"]), corner(&leaf["bound"]["max"]));
        for (level, count) in counts.iter_mut().enumerate() {
            let span = &leaf["lods"][level.to_string()];
            let number = |key: &str| span[key].as_u64().unwrap() as usize;
            let part = parts[number("file")].slice(number("offset")..number("offset") + number("count"));
            assert!(names[number("file")].starts_with(&format!("{level}_")));
            assert!(part.means.iter().all(|mean| (0..3).all(|i| (min[i]..=max[i]).contains(&mean[i]))));
            *count += part.len();
        }
    }
    assert_eq!(counts, [70_000, 17_500]);
    // The finest level, read by the folder, in the order of its leaves.
    let back = read_gaussians(folder.path().join("wall")).unwrap();
    let sum = |gaussians: &Gaussians| gaussians.means.iter().map(|m| f64::from(m[0])).sum::<f64>();
    assert!(back.len() == 70_000 && (sum(&back) - sum(&scene)).abs() < 0.01 * 70_000.0 * 1e-2);
}

#[test]
fn malformed_levels_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lod-meta.json");
    write_gaussians(&path, &wall(300)).unwrap();
    let refused = [
        (edited(&path, |d| d["version"] = 2.into()), "version: expected 1, found 2"),
        (edited(&path, |d| d["lodLevels"] = 0.into()), "lodLevels: expected from 1 to 64, found 0"),
        (
            edited(&path, |d| d["filenames"][0] = "../0_0/meta.json".into()),
            "filenames: expected names of files in this folder",
        ),
        (edited(&path, |d| d["filenames"][0] = "9_9/meta.json".into()), "9_9"),
        (edited(&path, |d| d["tree"]["lods"]["0"]["file"] = 7.into()), "file: expected a number below 1, found 7"),
        (
            edited(&path, |d| d["tree"]["lods"]["0"]["count"] = 301.into()),
            "a range of the 300 Gaussians of 0_0/meta.json",
        ),
        (
            edited(&path, |d| {
                let leaf = d["tree"].clone();
                d["tree"] = serde_json::json!({ "bound": leaf["bound"], "children": [leaf, leaf] });
            }),
            "expected each Gaussian of 0_0/meta.json in one leaf",
        ),
        (edited(&path, |d| d["tree"] = 3.into()), "the keys of streamed SOG"),
    ];
    for (error, expected) in refused {
        assert!(error.contains("lod-meta.json") || error.contains("9_9"), "{error}");
        assert!(error.contains(expected), "{error}");
    }
    std::fs::remove_file(folder.path().join("0_0/means_u.webp")).unwrap();
    let error = read_gaussians(&path).unwrap_err().to_string();
    assert!(error.contains("means_u.webp") && error.contains("No such file"), "{error}");
}

#[test]
fn a_replaced_scene_leaves_no_old_levels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lod-meta.json");
    write_gaussians(&path, &wall(30_000)).unwrap();
    assert!(folder.path().join("1_0").is_dir());
    write_gaussians(&path, &wall(100)).unwrap();
    assert!(!folder.path().join("1_0").exists());
    assert_eq!(read_gaussians(&path).unwrap().len(), 100);
    // A folder of others is not written into.
    let other = folder.path().join("other");
    std::fs::create_dir_all(other.join("0_0")).unwrap();
    std::fs::write(other.join("0_0/quats.webp"), "mine").unwrap();
    let error = write_gaussians(other.join("lod-meta.json"), &wall(100)).unwrap_err().to_string();
    assert!(error.contains("quats.webp"), "{error}");
    assert_eq!(std::fs::read(other.join("0_0/quats.webp")).unwrap(), b"mine");
}
