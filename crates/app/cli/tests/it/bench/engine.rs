//! Rows and figures of the engine.

use crate::in_process::splatweaver;
use serde_json::Value;
use std::collections::BTreeSet;

const ROWS: [&str; 15] = [
    "matmul/512",
    "matmul/1024",
    "matmul/2048",
    "matmul/1374x1024x4096",
    "matmul/2048x384x1536",
    "bmm/24x512x64x512",
    "attention/forward",
    "attention/forward_backward",
    "block/forward_backward",
    "vit/step",
    "conv3x3/forward_backward",
    "bilinear/forward_backward",
    "layer_norm/forward_backward",
    "gelu/forward_backward",
    "softmax/forward_backward",
];

#[test]
fn json_has_every_row_with_every_figure() {
    let done = splatweaver(&[&"bench", &"engine", &"--runs", &"1", &"--threads", &"2", &"--json"]).fine();
    let figures: Value = serde_json::from_str(&done.stdout).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<BTreeSet<_>>();
    assert_eq!(keys(&figures), BTreeSet::from(["threads", "peak_gflops", "copy_gbs", "rows"].map(String::from)));
    assert_eq!(figures["threads"], 2);
    let number = |value: &Value| value.as_f64().unwrap();
    let (peak, copy) = (number(&figures["peak_gflops"]), number(&figures["copy_gbs"]));
    let rows = figures["rows"].as_array().unwrap();
    assert!(rows.iter().map(|row| row["name"].as_str().unwrap()).eq(ROWS));
    for row in rows {
        assert_eq!(keys(row), BTreeSet::from(["name", "ms", "gflops", "gbs", "fraction_of_peak"].map(String::from)));
        let of_peak = match (row["gflops"].as_f64(), row["gbs"].as_f64()) {
            (Some(gflops), None) => gflops / peak,
            (None, Some(gbs)) => gbs / copy,
            _ => panic!("either arithmetic or memory: {row}"),
        };
        assert!((number(&row["fraction_of_peak"]) - of_peak).abs() < 1e-9 * of_peak && of_peak > 0.0, "{row}");
    }

    let product = &rows[0];
    let operations = number(&product["gflops"]) * number(&product["ms"]) * 1e6;
    assert!((operations / (2.0 * 512.0_f64.powi(3)) - 1.0).abs() < 1e-9, "{operations}");
}
