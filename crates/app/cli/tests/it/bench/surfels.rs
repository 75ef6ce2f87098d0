//! Surfels in range images.

use crate::in_process::splatweaver;
use serde_json::Value;

#[test]
fn surfels_stand_beside_ellipsoids() {
    let done = splatweaver(&[&"bench", &"surfels", &"--size", &"8x64", &"--runs", &"1", &"--json"]).fine();
    let figures: Value = serde_json::from_str(&done.stdout).unwrap();
    let rows = figures["rows"].as_array().unwrap();
    assert_eq!([&rows[0]["primitive"], &rows[1]["primitive"]], ["surfels", "ellipsoids"]);
    assert!(figures["surfels"].as_u64().unwrap() > 50, "{figures}");
    assert!(figures["keyframe_s"].as_f64() > Some(0.0) && figures["scan_s"].as_f64() > Some(0.0), "{figures}");
    for row in rows {
        let pairs = row["pairs"].as_f64().unwrap();
        assert!(pairs > 100.0 && row["evaluated"].as_f64().unwrap() >= pairs, "{row}");
    }
    let done = splatweaver(&[&"bench", &"surfels", &"--density", &"2"]);
    assert_eq!(done.code, 1);
    assert!(done.stderr.contains("density: expected a share above 0 up to 1, found 2"), "{}", done.stderr);
}
