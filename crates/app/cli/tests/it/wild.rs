//! The third model of the command line: trained on photos in different light, judged by looks, used with them, and
//! refused where it lacks an ability.

use crate::in_process::{line, splatweaver};
use crate::run::Run;

#[test]
fn a_place_is_shown_in_the_light_of_photos() {
    let (one, folder) = (Run::shared(), tempfile::tempdir().unwrap());
    let (data, run) = (one.data(), folder.path().join("wild"));
    let line: [&dyn AsRef<std::ffi::OsStr>; 11] =
        [&"train", &"--model", &"wild", &"--preset", &"micro", &"--steps", &"10", &"--data", &data, &"--out", &run];
    let said = splatweaver(&line).fine();
    assert!(run.join("samples").read_dir().unwrap().count() > 0, "{}", said.stdout);
    let report = std::fs::read_to_string(run.join("report.html")).unwrap();
    assert!(report.contains("row shows the view in that of two photos"));

    let judged = |flags: &[&str]| {
        let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"eval", &"--run", &run, &"--json"];
        flags.iter().for_each(|flag| line.push(flag));
        let text = splatweaver(&line).fine().stdout;
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    };
    let (half, own) = (judged(&["--light-of", "half"]), judged(&["--light-of", "own"]));
    assert_eq!((half["look"].as_str(), own["look"].as_str()), (Some("half"), Some("own")));
    assert!(half["mean"]["look"]["psnr_fitted"].as_f64().unwrap() >= half["mean"]["psnr"].as_f64().unwrap() - 1e-9);
    assert_ne!(half["mean"]["psnr"], own["mean"]["psnr"]);
    assert_eq!(half["mean"]["psnr_nearest"], own["mean"]["psnr_nearest"]);
    // Photos as they were taken are others.
    assert_ne!(judged(&["--as-taken"])["mean"]["psnr_nearest"], judged(&[])["mean"]["psnr_nearest"]);

    // In one table with a model without light, both are judged by photos as they were taken.
    let other = one.path();
    let both: [&dyn AsRef<std::ffi::OsStr>; 8] =
        [&"eval", &"--run", &other, &"--run", &run, &"--data", &data, &"--json"];
    let said = splatweaver(&both).fine();
    assert!(said.stderr.contains("photos as they were taken"), "{}", said.stderr);
    let rows: serde_json::Value = serde_json::from_str(&said.stdout).unwrap();
    let alone = judged(&["--as-taken", "--data", data.to_str().unwrap()]);
    assert_eq!(rows[1]["evaluation"]["mean"], alone["mean"]);
    assert_eq!(rows[0]["evaluation"]["mean"]["psnr_nearest"], alone["mean"]["psnr_nearest"]);

    let mut names: Vec<_> = std::fs::read_dir(data.join("images")).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    let out = folder.path().join("lights");
    let line: [&dyn AsRef<std::ffi::OsStr>; 13] = [
        &"infer",
        &"--run",
        &run,
        &names[0],
        &names[1],
        &"--light",
        &names[2],
        &"--to",
        &names[3],
        &"--light-steps",
        &"3",
        &"-o",
        &out,
    ];
    let said = splatweaver(&line).fine().stdout;
    assert!(said.contains("looks.png"), "{said}");
    let scenes: Vec<_> =
        ["00", "01", "02"].map(|i| weaver_io::read_gaussians(out.join(format!("looks/{i}.ply"))).unwrap()).into();
    let first = weaver_io::read_gaussians(out.join("scene.ply")).unwrap();
    assert_eq!(scenes[0], first);
    for scene in &scenes {
        assert_eq!((&scene.means, &scene.opacity_logits), (&first.means, &first.opacity_logits));
    }
    assert!(scenes[0] != scenes[1] && scenes[1] != scenes[2]);
    // Photo, three renders, photo: two rows, each picture enlarged to at least 128 pixels.
    let strip = weaver_io::Image::read(out.join("looks.png"), weaver_io::Background::White).unwrap();
    assert_eq!((strip.width, strip.height), (5 * 128, 2 * 128));
}

#[test]
fn what_does_not_know_about_light_says_so() {
    let (one, folder) = (Run::shared(), tempfile::tempdir().unwrap());
    let (data, run, out) = (one.data(), one.path(), folder.path().join("out"));
    let mut names: Vec<_> = std::fs::read_dir(data.join("images")).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    let photo = &names[0];
    splatweaver(&[&"eval", &"--run", &run, &"--light-of", &"half"]).refused(1, &["does not know about light"]);
    splatweaver(&[&"eval", &"--run", &run, &"--light-of", &"left"]).refused(2, &["expected half, own, none or wrong"]);
    splatweaver(&[&"infer", &"--run", &run, photo, &"--light", photo, &"-o", &out])
        .refused(1, &["does not know about light"]);
    splatweaver(&[&"infer", &"--run", &run, photo, &"--to", photo, &"-o", &out])
        .refused(2, &["required arguments were not provided"]);
    line(&[&"infer --run", &run, photo, &"--light", photo, &"--to", photo, &"--light-steps 1 -o", &out])
        .refused(2, &["--light-steps"]);
    splatweaver(&[&"infer", &"--run", &run, photo, &"--light", photo, &"--budget", &"0.4", &"-o", &out])
        .refused(2, &["--light: expected neither"]);
    let missing = folder.path().join("missing.jpg");
    splatweaver(&[&"infer", &"--run", &run, photo, &"--light", &missing, &"-o", &out]).refused(1, &["missing.jpg"]);
}
