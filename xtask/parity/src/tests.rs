//! The files of the repository pass; differences are found, and distinguished from rectifiers that rounding flipped.

use super::*;
use weaver_autograd::{Params, Tape};
use weaver_io::safetensors::Tensors;
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_vggt::ResidualConvUnit;

fn failures(file: &Path) -> Vec<String> {
    let (lines, _) = compare_in::<f32>(file, None);
    if lines.iter().any(|line| line.verdict == Verdict::Unknown) {
        return Vec::new();
    }
    assert!(lines.len() >= 6, "{}: only {} comparisons", file.display(), lines.len());
    lines.iter().filter(|line| line.verdict == Verdict::Fail).map(Line::text).collect()
}

/// The files in the repository, and on machines that have them all the others.
#[test]
fn everything_equals_its_reference() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let shared = std::env::var_os("WEAVER_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
    let mut files = files_below(&root.join("tests/fixtures")).unwrap();
    match files_below(&shared.join("fixtures")) {
        Ok(more) => files.extend(more),
        Err(_) => println!("skipped: no data ({})", shared.join("fixtures").display()),
    }
    for file in files {
        let failures = failures(&file);
        // Without weights there is no LPIPS to compare.
        let known = |line: &String| line.contains("lpips") && find_weights(&file, None).is_none();
        let failures: Vec<_> = failures.into_iter().filter(|line| !known(line)).collect();
        assert!(failures.is_empty(), "{}:\n{}", file.display(), failures.join("\n"));
    }
}

/// Every module has a comparison with the files of the repository alone.
#[test]
fn every_module_has_a_file_in_the_repository() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures");
    let modules =
        ["dinov2", "aggregator", "camera_head", "dpt_depth", "splatweaver_head"].map(|name| format!("{name}_micro"));
    let files = modules.iter().map(String::as_str).chain(["end_to_end_tiny"]);
    let bytes: u64 = files.map(|name| folder.join(format!("{name}.safetensors")).metadata().expect(name).len()).sum();
    assert!(bytes < 3_000_000, "{bytes} bytes");
}

#[test]
fn a_difference_is_found_and_so_is_what_was_left_out() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/wavelet.safetensors");
    let mut tensors = Tensors::read(&file).unwrap();
    let mut bands = tensors.values::<f32>("out.haar.16x20.low", &[1, 1, 8, 10]).unwrap().to_vec();
    bands[3] *= 1.001;
    tensors.insert("out.haar.16x20.low", &[1, 1, 8, 10], bands);
    tensors.insert("out.haar.16x20.unheard_of", &[1], vec![1.0f32]);
    let folder = tempfile::tempdir().unwrap();
    let changed = folder.path().join("wavelet.safetensors");
    tensors.write(&changed).unwrap();
    let failures = failures(&changed);
    assert_eq!(failures.len(), 2, "{failures:?}");
    assert!(failures[0].contains("out.haar.16x20.low") && failures[1].contains("unheard_of"), "{failures:?}");
    assert!(command(&[folder.path().display().to_string()]).is_err());
}

#[test]
fn missing_modules_fail_only_if_strict() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("surfels.safetensors");
    Tensors::default().write(&file).unwrap();
    let comparison = compare(&file, None, of_lpips);
    assert_eq!(keys(&comparison, Verdict::Unknown), ["surfels"]);
    assert!(comparison.lines[0].text().contains("not implemented"), "{comparison:?}");
    let path = folder.path().display().to_string();
    assert!(command(std::slice::from_ref(&path)).is_ok());
    assert!(command(&[path, "--strict".into()]).is_err());
}

const CHANNELS: usize = 2;
const SIDE: usize = 6;
const UNIT: &str = "residual_conv_unit";
/// Column and row of the sum that is all but 0.
const AT: [usize; 2] = [2, 3];

/// A file about a residual unit with `w1`, `b1`, ... of random numbers. One of the sums that its rectifier sees is as
/// close to 0 as a bias in f32 can bring it, and the cotangents about it are small, so that they change gradients a
/// little.
fn balanced_on_zero(seed: u64) -> Tensors {
    let stream = Stream::new(seed, 0, "numbers");
    let mut drawn = 0..;
    let mut numbers = |count: usize| -> Vec<f32> { drawn.by_ref().take(count).map(|i| stream.normal(i)).collect() };
    let (image, kernel) = ([1, CHANNELS, SIDE, SIDE], [CHANNELS, CHANNELS, 3, 3]);
    let pixels = SIDE * SIDE;
    let (x, w1, w2) = (numbers(CHANNELS * pixels), numbers(CHANNELS * 18), numbers(CHANNELS * 18));
    let (mut b1, b2, mut cot) = (numbers(CHANNELS), numbers(CHANNELS), numbers(CHANNELS * pixels));
    let wide = |values: &[f32]| values.iter().map(|x| f64::from(*x)).collect::<Vec<_>>();
    let tape = Tape::<f64>::new();
    let sums = weaver_autograd::ops::conv2d(
        tape.constant(&wide(&x), image).relu(),
        tape.constant(&wide(&w1), kernel),
        None,
        1,
        1,
    );
    b1[0] = -sums.to_vec()[AT[1] * SIDE + AT[0]] as f32;
    for (i, cot) in cot.iter_mut().enumerate() {
        let (column, row) = (i % SIDE, i % pixels / SIDE);
        if column.abs_diff(AT[0]) <= 1 && row.abs_diff(AT[1]) <= 1 {
            *cot *= 1e-3;
        }
    }

    let mut params = Params::<f64>::new();
    let unit = ResidualConvUnit::new(Builder::new(&mut params, 0), CHANNELS);
    let names = [("conv1.weight", "w1"), ("conv1.bias", "b1"), ("conv2.weight", "w2"), ("conv2.bias", "b2")];
    let mut tensors = Tensors::default();
    for ((name, key), values) in names.iter().zip([&w1, &b1, &w2, &b2]) {
        let id = params.find(name).unwrap();
        params.value_mut(id).copy_from_slice(&wide(values));
        tensors.insert(format!("{UNIT}.in.{key}"), params.get(id).shape().dims(), values.clone());
    }
    let tape = Tape::<f64>::new();
    let leaf = tape.leaf(&wide(&x), image);
    let y = unit.forward(Context::new(&tape, &params), leaf);
    let single = |values: &[f64]| values.iter().map(|x| *x as f32).collect::<Vec<_>>();
    tensors.insert(format!("{UNIT}.out"), &image, single(&y.to_vec()));
    y.backward_with(&wide(&cot));
    tensors.insert(format!("{UNIT}.grad.x"), &image, single(&leaf.grad().unwrap()));
    for (name, key) in names {
        let id = params.find(name).unwrap();
        let gradient = single(&tape.param_grad(id).unwrap());
        tensors.insert(format!("{UNIT}.grad.{key}"), params.get(id).shape().dims(), gradient);
    }
    tensors.insert(format!("{UNIT}.in.x"), &image, x);
    tensors.insert(format!("{UNIT}.cot"), &image, cot);
    tensors.metadata.insert("item".into(), "ops".into());
    tensors.metadata.insert("operations".into(), format!("{{\"{UNIT}\": \"\"}}"));
    tensors
}

fn keys(comparison: &Comparison, verdict: Verdict) -> Vec<&str> {
    comparison.lines.iter().filter(|line| line.verdict == verdict).map(|line| line.key.as_str()).collect()
}

/// A flipped rectifier is recognized, and excuses no other difference.
///
/// Promise (kept): only rectifiers of LPIPS may flip where numbers of reference implementations are compared.
#[test]
fn a_flipped_rectifier_excuses_only_itself() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("unit.safetensors");
    let write = |tensors: &Tensors| tensors.write(&file).unwrap();
    // Rounding in f32 depends on the machine; on none do all of these round as in f64.
    let flipping = |tensors: &Tensors| {
        write(tensors);
        !compare(&file, None, |_| true).flips.is_empty()
    };
    let mut tensors = (0..100).map(balanced_on_zero).find(flipping).expect("a file with a flip");
    let lenient = compare(&file, None, |_| true);
    assert_eq!(keys(&lenient, Verdict::Fail), [""; 0], "{lenient:#?}");
    let flipped = keys(&lenient, Verdict::Flip);
    assert!(flipped.contains(&"residual_conv_unit.grad.b1"), "{lenient:#?}");
    let line = lenient.lines.iter().find(|line| line.verdict == Verdict::Flip).unwrap();
    for part in ["1 rectifier flipped", "in f64"] {
        assert!(line.remark.contains(part), "{}", line.remark);
    }
    let path = folder.path().display().to_string();
    assert!(of_lpips("grad_lpips.stage.image_raw") && !flipped.iter().any(|key| of_lpips(key)));

    let strict = compare(&file, None, of_lpips);
    assert_eq!(keys(&strict, Verdict::Fail), flipped);
    assert!(command(std::slice::from_ref(&path)).is_err());

    // A wrong gradient stays a failure beside flipped ones.
    let key = format!("{UNIT}.grad.w2");
    let shape = [CHANNELS, CHANNELS, 3, 3];
    let mut gradient = tensors.values::<f32>(&key, &shape).unwrap().to_vec();
    gradient.iter_mut().for_each(|g| *g *= 1.001);
    tensors.insert(key.clone(), &shape, gradient);
    write(&tensors);
    let wrong = compare(&file, None, |_| true);
    assert_eq!(keys(&wrong, Verdict::Fail), [key.as_str()]);
    assert_eq!(keys(&wrong, Verdict::Flip), flipped);
    assert!(command(&[path]).is_err());
}
