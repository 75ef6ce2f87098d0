//! Help texts and shell completions.

use crate::in_process::splatweaver;

#[test]
fn every_command_explains_itself_with_an_example() {
    let photos = ["train", "eval", "infer", "fit", "cameras", "reconstruct", "compare"];
    let scenes = [
        "render",
        "align",
        "lift",
        "query",
        "vad",
        "lidar",
        "mesh",
        "eval-trajectory",
        "eval-mesh",
        "image",
        "info",
        "convert",
        "bench",
        "config",
        "completions",
        "man",
    ];
    for command in photos.into_iter().chain(scenes) {
        let done = splatweaver(&[&command, &"--help"]).fine();
        assert!(done.stdout.contains(&format!("Usage: splatweaver {command}")), "{}", done.stdout);
        assert!(done.stdout.contains(&format!("  splatweaver {command} ")) || command == "train", "{}", done.stdout);
        assert!(done.stdout.contains("Example") && done.stderr.is_empty(), "{}", done.stdout);
        let all = splatweaver(&[&"--help"]).fine();
        assert!(all.stdout.contains(&format!("  {command} ")), "{}", all.stdout);
    }
}

#[test]
fn every_subject_of_bench_explains_itself() {
    for subject in ["raster", "fit", "surfels", "engine"] {
        let done = splatweaver(&[&"bench", &subject, &"--help"]).fine();
        assert!(done.stdout.contains(&format!("Usage: splatweaver bench {subject}")), "{}", done.stdout);
        assert!(done.stdout.contains(&format!("  splatweaver bench {subject} --")), "{}", done.stdout);
    }
}

#[test]
fn the_version_is_the_package_s() {
    let done = splatweaver(&[&"--version"]).fine();
    assert_eq!(done.stdout.trim(), format!("splatweaver {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn wrong_usage_is_code_2() {
    let wrong: [&[&dyn AsRef<std::ffi::OsStr>]; 16] = [
        &[],
        &[&"trian"],
        &[&"eval"],
        &[&"eval", &"--run", &"x", &"--cameras", &"stolen"],
        &[&"eval", &"--run", &"x", &"--unseen", &"--data", &"y"],
        &[&"train", &"--resume", &"x", &"--init", &"y"],
        &[&"eval", &"--run", &"x", &"--threads", &"100000"],
        &[&"eval", &"--run", &"x", &"--threads", &"0"],
        &[&"render", &"x.ply", &"-o", &"y"],
        &[&"render", &"x.ply", &"-o", &"y", &"--orbit", &"3", &"--cameras", &"c.json"],
        &[&"render", &"x.ply", &"-o", &"y", &"--orbit", &"3", &"--background", &"red"],
        &[&"bench"],
        &[&"bench", &"raster"],
        &[&"bench", &"raster", &"--synthetic", &"10,0,10"],
        &[&"bench", &"raster", &"--synthetic", &"10,10,10", &"--workload", &"x"],
        &[&"bench", &"engine", &"--runs", &"0"],
    ];
    for line in wrong {
        let done = splatweaver(line);
        assert_eq!(done.code, 2);
        assert!(done.stdout.is_empty() && !done.stderr.is_empty());
    }
}

#[test]
fn shells_get_their_completions() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let done = splatweaver(&[&"completions", &shell]).fine();
        assert!(done.stdout.contains("splatweaver") && done.stdout.contains("budget"), "{shell}");
    }
}

/// Promise (options): every command has a page of the manual, printed or written.
#[test]
fn every_command_has_a_page_of_the_manual() {
    let page = splatweaver(&[&"man", &"fit"]).fine();
    assert!(page.stdout.contains(".TH splatweaver-fit 1") && page.stdout.contains("gaussians"), "{}", page.stdout);
    assert!(splatweaver(&[&"man", &"dynamic", &"train"]).fine().stdout.contains("splatweaver\\-dynamic\\-train"));
    assert!(splatweaver(&[&"man"]).fine().stdout.contains("reconstruct"));
    let wrong = splatweaver(&[&"man", &"nothing"]);
    assert_eq!((wrong.code, wrong.stdout.is_empty()), (2, true));
    assert!(wrong.stderr.contains("nothing"), "{}", wrong.stderr);
    let pages = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("man1");
    splatweaver(&[&"man", &"--out", &pages]).fine();
    let commands = weaver_cli::program();
    for command in commands.get_subcommands().filter(|command| !command.is_hide_set()) {
        assert!(pages.join(format!("splatweaver-{}.1", command.get_name())).is_file(), "{}", command.get_name());
    }
}
