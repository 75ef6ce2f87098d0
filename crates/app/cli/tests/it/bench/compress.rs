//! Methods of compression, and files of other programs beside them.

use crate::compare::gaussians;
use crate::in_process::splatweaver;
use serde_json::Value;
use std::ffi::OsStr;
use weaver_io::write_gaussians;

/// Promise (scenes): files that other programs wrote of a scene are judged like the methods.
#[test]
fn files_of_others_are_rows_beside_the_methods() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (scene, peer, page) = (path("scene.ply"), path("theirs.v4.spz"), path("page.html"));
    write_gaussians(&scene, &gaussians()).unwrap();
    write_gaussians(&peer, &gaussians()).unwrap();
    let bench = |more: &[&dyn AsRef<OsStr>]| {
        let mut line: Vec<&dyn AsRef<OsStr>> = vec![&"bench", &"compress", &scene, &"--methods", &"spz4"];
        line.extend(more);
        splatweaver(&line)
    };
    let done = bench(&[&"--peer", &peer, &"--html", &page, &"--json"]).fine();
    let rows: Value = serde_json::from_str(&done.stdout).unwrap();
    // The same bytes as the method writes: the same figures.
    for key in ["bytes", "bits_per_gaussian", "psnr", "gaussians"] {
        assert!(rows[0][key].is_number() && rows[0][key] == rows[1][key], "{key}: {rows}");
    }
    assert_eq!(rows[1]["method"].as_str(), peer.to_str());
    assert!(rows[1]["encode_seconds"].is_null());
    assert!(std::fs::read_to_string(&page).unwrap().contains("theirs.v4.spz"));
    let several = "expected a format of one file, whose size counts, found sog-folder";
    bench(&[&"--peer", &"a/meta.json"]).refused(2, &["meta.json", several]);
    bench(&[&scene, &"--peer", &peer]).refused(2, &["--peer: expected one SCENE, found 2"]);
    assert_ne!(bench(&[&"--peer", &peer, &"--html", &peer]).code, 0);
    assert_eq!(weaver_io::read_gaussians(&peer).unwrap().len(), 24);
}
