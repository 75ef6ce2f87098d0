//! Scenes a block at a time: the same as whole.

use std::path::Path;
use weaver_io::{Blocks, Chained, Changed, Drawing, open_scene, read_gaussians, write_blocks, write_gaussians};
use weaver_scene::Gaussians;

/// More than two blocks.
const MANY: usize = 2 * (1 << 14) + 5;
const BLOCKWISE: [&str; 6] = ["a.ply", "a.splat", "a.spz", "a.v4.spz", "a.glb", "a.gltf"];

fn sample(n: usize, degree: usize) -> Gaussians {
    let k = (degree + 1) * (degree + 1);
    let value = |i: usize| (i as f32 * 0.37).sin();
    Gaussians {
        means: (0..n).map(|i| [value(i), value(i + 1), (i % 1000) as f32]).collect(),
        log_scales: (0..n).map(|i| [value(i), -3.0, -4.5]).collect(),
        quats: (0..n).map(|i| [1.0, value(i), 0.1, 0.2]).collect(),
        opacity_logits: (0..n).map(value).collect(),
        sh: (0..n * k * 3).map(value).collect(),
        degree,
    }
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

/// Promise of `files_in_blocks_have_the_bytes_of_whole_ones`.
#[test]
fn any_part_of_a_file_is_that_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    for name in BLOCKWISE.iter().chain(&["a.compressed.ply", "a.usda", "a.usdz"]) {
        let path = folder.path().join(name);
        write_gaussians(&path, &sample(300, 1)).unwrap();
        let whole = read_gaussians(&path).unwrap();
        let opened = open_scene(&path).unwrap().gaussians;
        assert_eq!((opened.len(), opened.degree()), (300, whole.degree), "{name}");
        for rows in [0..0, 3..7, 299..300, 0..300] {
            assert!(*opened.block(rows.clone()).unwrap() == whole.slice(rows.clone()), "{name}, {rows:?}");
        }
    }
}

/// Promise (kept): a scene that passes through in blocks has the bytes of the whole one, within the memory of a
/// block; faults are named by their place in the file.
#[test]
fn files_in_blocks_have_the_bytes_of_whole_ones() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, blocks] = ["whole", "blocks"].map(|name| folder.path().join(name));
    [&whole, &blocks].iter().for_each(|path| std::fs::create_dir(path).unwrap());
    let scene = sample(MANY, 1);
    for from in BLOCKWISE {
        let source = folder.path().join(from);
        write_gaussians(&source, &scene).unwrap();
        let read = read_gaussians(&source).unwrap();
        for to in BLOCKWISE {
            write_gaussians(whole.join(to), &read).unwrap();
            write_blocks(blocks.join(to), &*open_scene(&source).unwrap().gaussians, Drawing::default()).unwrap();
            assert!(bytes(&whole.join(to)) == bytes(&blocks.join(to)), "{from} to {to}");
        }
    }
}

/// Whole, this scene takes 24 MB in each of three forms: as bytes, as a table, as Gaussians.
///
/// Promise of `files_in_blocks_have_the_bytes_of_whole_ones`.
#[test]
fn memory_is_that_of_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["from.ply", "to.ply"].map(|name| folder.path().join(name));
    write_gaussians(&from, &sample(100_000, 3)).unwrap();
    let used = |act: &dyn Fn()| allocation_counter::measure(act).bytes_max;
    let copied = || write_blocks(&to, &*open_scene(&from).unwrap().gaussians, Drawing::default()).unwrap();
    let passing = used(&copied);
    assert!(passing < 20_000_000, "{passing}");
    assert!(bytes(&from) == bytes(&to));
    let reading = used(&|| drop(read_gaussians(&from).unwrap()));
    assert!((23_000_000..44_000_000).contains(&reading), "{reading}");
    let described = used(&|| drop(weaver_io::info(&from).unwrap()));
    assert!(described < 20_000_000, "{described}");
}

#[test]
fn changes_and_chains_are_those_of_the_whole() {
    let [one, two] = [sample(MANY, 0), sample(50, 2)];
    let whole = Gaussians::joined(&[one.clone(), two.clone()]);
    let chained = Chained(vec![Box::new(one), Box::new(two)]);
    assert!((chained.len(), chained.degree()) == (MANY + 50, 2));
    for rows in [0..10, MANY - 3..MANY + 4, MANY..MANY + 50, 0..MANY + 50] {
        assert!(*chained.block(rows.clone()).unwrap() == whole.slice(rows));
    }
    let changed = Changed { from: Box::new(chained), degree: 1, change: Box::new(|block| block.with_degree(1)) };
    assert!(*changed.all().unwrap() == whole.with_degree(1));
}

/// Promise of `files_in_blocks_have_the_bytes_of_whole_ones`.
#[test]
fn faults_are_named_by_their_place_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["from.ply", "to.splat"].map(|name| folder.path().join(name));
    write_gaussians(&from, &sample(MANY, 0)).unwrap();
    // Seventeen numbers of a Gaussian, the last four its rotation.
    let mut broken = bytes(&from);
    let place = broken.len() - 4 * (17 * (MANY - 20_000) - 14);
    broken[place..place + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&from, broken).unwrap();
    std::fs::write(&to, "before").unwrap();
    let opened = open_scene(&from).unwrap().gaussians;
    let message = write_blocks(&to, &*opened, Drawing::default()).unwrap_err().to_string();
    assert!(message.contains("from.ply: vertex 20000, rotation: expected finite numbers"), "{message}");
    assert_eq!(bytes(&to), b"before");
    // The file is shorter than when it was opened.
    let cut = bytes(&from)[..1000].to_vec();
    std::fs::write(&from, cut).unwrap();
    let message = opened.block(0..MANY).unwrap_err().to_string();
    assert!(message.contains("from.ply"), "{message}");
}

#[test]
fn long_headers_are_read_to_their_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    write_gaussians(&path, &sample(3, 0)).unwrap();
    let plain = bytes(&path);
    let remarks = format!("ply\n{}", "comment end_header is not here\n".repeat(3000));
    std::fs::write(&path, [remarks.as_bytes(), &plain[4..]].concat()).unwrap();
    assert!(read_gaussians(&path).unwrap() == sample(3, 0));
    std::fs::write(&path, "ply\n".to_string() + &"comment\n".repeat(9000)).unwrap();
    let message = read_gaussians(&path).unwrap_err().to_string();
    assert!(message.contains("header line 9002: expected end_header before the end of the file"), "{message}");
}
