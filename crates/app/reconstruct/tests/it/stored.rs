//! Settings that come from a file.

use crate::{capture, settings};
use serde_json::{Value, json};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_fit::{Judge, Thinning};
use weaver_reconstruct::{Error, Run};
use weaver_splat::CpuRasterizer;

fn resumed(folder: &Path) -> Result<Run, Error> {
    Run::resume(folder, Judge::default(), Arc::new(CpuRasterizer))
}

/// The numbers of a value, as paths to them.
fn numbers(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Number(_) => found.push(path.into()),
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, item)| numbers(item, &format!("{path}/{i}"), found))
        }
        Value::Object(items) => items.iter().for_each(|(key, item)| numbers(item, &format!("{path}/{key}"), found)),
        _ => {}
    }
}

/// Promise (fits): whatever number stands in a stored run.json, going on is refused with the key or goes on; nothing
/// panics.
#[test]
fn no_stored_number_panics() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 4);
    let mut settings = settings(&data);
    (settings.minutes, settings.most_rounds, settings.views) = (Some(1e-6), Some(3), Some(3));
    (settings.long_side, settings.compress, settings.least_steps) = (Some(40), Some(1.0), 20);
    settings.fit.thinned = vec![Thinning::new(3, 4)];
    drop(Run::create(&out, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap());
    let file = out.join("run.json");
    let stored: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let mut paths = Vec::new();
    numbers(&stored, "", &mut paths);
    assert!(paths.len() > 50, "{paths:?}");
    let text = |path: &str, hostile: &Value| {
        let mut other = stored.clone();
        *other.pointer_mut(path).unwrap() = hostile.clone();
        other.to_string()
    };
    let hostile =
        [json!(-1), json!(0), json!(1e300), json!(-1e300), json!(u64::MAX), json!(4_000_000_000_u32), json!(0.5)];
    for path in &paths {
        for hostile in &hostile {
            std::fs::write(&file, text(path, hostile)).unwrap();
            let result = catch_unwind(AssertUnwindSafe(|| -> Result<(), Error> {
                let mut run = resumed(&out)?;
                let stop = AtomicBool::new(false);
                run.advance(&stop, |report| stop.store(report.step > 1, Ordering::Relaxed))
            }));
            let _ = std::fs::remove_file(out.join("checkpoint.safetensors"));
            assert!(result.is_ok(), "{path}: {hostile}");
        }
    }
    for (path, hostile) in
        [("/save_every", json!(-1)), ("/save_every", json!(1e300)), ("/minutes", json!(0)), ("/compress", json!(9))]
    {
        std::fs::write(&file, text(path, &hostile)).unwrap();
        let error = resumed(&out).unwrap_err().to_string();
        assert!(error.contains("run.json") && error.contains(&path[1..]), "{error}");
    }
}
