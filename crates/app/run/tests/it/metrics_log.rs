use serde::{Deserialize, Serialize};
use std::fs;
use weaver_run::{MetricsLog, read_metrics};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Record {
    step: usize,
    scene: String,
    psnr: Option<f32>,
}

fn record(step: usize) -> Record {
    Record { step, scene: "größe".into(), psnr: (step > 1).then_some(20.1 + step as f32) }
}

/// Records come back and a resumed run drops later ones.
#[test]
fn a_resumed_run_drops_later_records() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metrics.jsonl");
    let mut log = MetricsLog::open(&path, 0).unwrap();
    for step in [1, 10, 20] {
        log.append(&record(step)).unwrap();
    }
    assert_eq!(read_metrics::<Record>(&path).unwrap(), [record(1), record(10), record(20)]);
    let whole = fs::read_to_string(&path).unwrap();
    assert!(whole.starts_with("{\"step\":1,\"scene\":\"größe\",\"psnr\":null}\n"), "{whole}");

    drop(log);
    let mut log = MetricsLog::open(&path, 10).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), whole.lines().take(2).flat_map(|l| [l, "\n"]).collect::<String>());
    log.append(&record(20)).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), whole);
}

#[test]
fn a_log_cut_off_anywhere_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metrics.jsonl");
    let mut log = MetricsLog::open(&path, 0).unwrap();
    log.append(&record(1)).unwrap();
    let first = fs::read(&path).unwrap();
    log.append(&record(2)).unwrap();
    let whole = fs::read(&path).unwrap();
    drop(log);
    // Within `ö`, too, where the rest is no UTF-8. The line break alone may be missing.
    for length in first.len()..whole.len() {
        fs::write(&path, &whole[..length]).unwrap();
        let complete = usize::from(length + 1 == whole.len());
        assert_eq!(read_metrics::<Record>(&path).unwrap().len(), 1 + complete, "{length}");
        let mut log = MetricsLog::open(&path, 2).unwrap();
        let kept = if complete == 1 { &whole } else { &first };
        assert_eq!(&fs::read(&path).unwrap(), kept, "{length}");
        log.append(&record(3)).unwrap();
        assert_eq!(read_metrics::<Record>(&path).unwrap().last(), Some(&record(3)), "{length}");
    }
}

#[test]
#[should_panic(expected = "whole number `step`")]
fn a_record_needs_a_step() {
    let folder = tempfile::tempdir().unwrap();
    let mut log = MetricsLog::open(folder.path().join("metrics.jsonl"), 0).unwrap();
    let _ = log.append(&("step", 1));
}

#[test]
fn errors_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("missing/metrics.jsonl");
    let message = MetricsLog::open(&path, 0).unwrap_err().to_string();
    assert!(message.contains("missing/metrics.jsonl"), "{message}");
    let message = read_metrics::<Record>(&path).unwrap_err().to_string();
    assert!(message.contains("missing/metrics.jsonl"), "{message}");
}
