//! The second model of the command line: trained, evaluated beside the first, used, and refused where it lacks an
//! ability.

use crate::in_process::{line, splatweaver};
use crate::run::Run;
use std::path::Path;

/// A run of a few steps on the shared capture.
fn train(data: &Path, out: &Path) {
    line(&[&"train --model two-experts --preset micro --steps 5 --data", &data, &"--out", &out]).fine();
}

/// Promise (results): models are evaluated in one table; an impossible request to a model is refused with both
/// numbers.
#[test]
fn two_models_are_told_apart_in_one_table() {
    let (one, folder) = (Run::shared(), tempfile::tempdir().unwrap());
    let two = folder.path().join("two");
    train(&one.data(), &two);
    let (data, first) = (one.data(), one.path());
    let table = splatweaver(&[&"eval", &"--run", &two, &"--run", &first, &"--data", &data]).fine().stdout;
    let rows = |name: &str| table.lines().filter(|line| line.starts_with(name)).count();
    let [first_name, second_name] = [&first, &two].map(|path| path.display().to_string());
    assert!(rows(&first_name) == 1 && rows(&second_name) == 1 && rows("nearest photo") == 1, "{table}");
    let json = |flags: &[&str]| {
        let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"eval", &"--run", &two, &"--json", &"--data", &data];
        flags.iter().for_each(|flag| line.push(flag));
        let text = splatweaver(&line).fine().stdout;
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    };
    let (data_cameras, joint) = (json(&[]), json(&["--targets", "joint"]));
    assert_eq!(data_cameras["cameras"], "predicted");
    assert!(joint["cameras"].as_str().unwrap().contains("held-out photos as well"));
    assert_ne!(data_cameras["mean"]["psnr"], joint["mean"]["psnr"]);
    splatweaver(&[&"eval", &"--run", &two, &"--run", &first]).refused(2, &["--data or --unseen"]);
    splatweaver(&[&"eval", &"--run", &two, &"--data", &data, &"--cameras", &"given", &"--targets", &"joint"])
        .refused(2, &["--targets joint: expected --cameras predicted"]);
    splatweaver(&[&"eval", &"--run", &two, &"--data", &data, &"--budget", &"0.4"])
        .refused(1, &["does not let the number of Gaussians be chosen"]);

    let photos = data.join("images");
    let mut names: Vec<_> = std::fs::read_dir(&photos).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.sort();
    let out = folder.path().join("scene");
    splatweaver(&[&"infer", &"--run", &two, &names[0], &names[1], &"-o", &out]).fine();
    assert_eq!(weaver_io::read_gaussians(out.join("scene.ply")).unwrap().means.len(), 2 * 32 * 32);
    splatweaver(&[&"infer", &"--run", &two, &names[0], &names[1], &names[2], &"-o", &folder.path().join("other")])
        .refused(1, &["expected photos in multiples of 2, or one alone, found 3"]);
}
