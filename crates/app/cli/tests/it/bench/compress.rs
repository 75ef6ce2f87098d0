//! Methods of compression, and files of other programs beside them.

use crate::compare::gaussians;
use crate::in_process::splatweaver;
use serde_json::Value;
use weaver_io::write_gaussians;

#[test]
fn files_of_others_are_rows_beside_the_methods() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (scene, peer, page) = (path("scene.ply"), path("theirs.v4.spz"), path("page.html"));
    write_gaussians(&scene, &gaussians()).unwrap();
    write_gaussians(&peer, &gaussians()).unwrap();
    let bench: [&dyn AsRef<std::ffi::OsStr>; 5] = [&"bench", &"compress", &scene, &"--methods", &"spz4"];
    let done = splatweaver(&[&bench[..], &[&"--peer", &peer, &"--html", &page, &"--json"]].concat()).fine();
    let rows: Value = serde_json::from_str(&done.stdout).unwrap();
    // The same bytes as the method writes: the same figures.
    for key in ["bytes", "bits_per_gaussian", "psnr", "gaussians"] {
        assert!(rows[0][key].is_number() && rows[0][key] == rows[1][key], "{key}: {rows}");
    }
    assert_eq!((&rows[1]["method"], &rows[1]["encode_seconds"]), (&peer.to_str().unwrap().into(), &Value::Null));
    assert!(std::fs::read_to_string(&page).unwrap().contains("theirs.v4.spz"));
    let wrong = |arguments: &[&dyn AsRef<std::ffi::OsStr>], expected: &str| {
        let done = splatweaver(&[&bench[..], arguments].concat());
        assert!(done.code == 2 && done.stderr.contains(expected), "{}: {}", done.code, done.stderr);
    };
    wrong(
        &[&"--peer", &"a/meta.json"],
        "meta.json: expected a format of one file, whose size counts, found sog-folder",
    );
    wrong(&[&scene, &"--peer", &peer], "--peer: expected one SCENE, found 2");
    let done = splatweaver(&[&bench[..], &[&"--peer", &peer, &"--html", &peer]].concat());
    assert!(done.code != 0 && peer.exists(), "{}", done.stderr);
}
