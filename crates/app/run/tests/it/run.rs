use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_io::safetensors::Tensors;
use weaver_run::{Error, Folder, Job, Kind, Log, Rhythm, Run, Save, Scalar, StepReport, read_records};

const KIND: Kind = Kind { command: "count", settings: "run.json", results: &["result.txt"] };

/// Counts, and fails at a given step, if any.
#[derive(Debug)]
struct Count {
    done: usize,
    of: usize,
    rhythm: Rhythm,
    fails_at: Option<usize>,
    saved: Vec<usize>,
}

impl Count {
    fn new(of: usize, log: Log) -> Self {
        let rhythm = Rhythm { log, save: Save::Steps(4) };
        Self { done: 0, of, rhythm, fails_at: None, saved: Vec::new() }
    }
}

impl Job for Count {
    type Error = Error;

    fn steps(&self) -> [usize; 2] {
        [self.done, self.of]
    }

    fn step(&mut self) -> Result<StepReport, Error> {
        if self.fails_at == Some(self.done + 1) {
            return Err(Error::complete("failed"));
        }
        self.done += 1;
        let x = self.done as f64;
        let scalars = vec![Scalar::mean("square", x * x), Scalar::last("count", x)];
        let stage = if self.done <= 5 { "first" } else { "second" };
        Ok(StepReport { step: self.done, of: self.of, stage: stage.into(), loss: x, scalars })
    }

    fn state(&mut self) -> Result<Tensors, Error> {
        self.saved.push(self.done);
        let mut tensors = Tensors::default();
        tensors.insert("done", &[1], vec![self.done as u64]);
        Ok(tensors)
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), Error> {
        self.done = state.values::<u64>("done", &[1])?[0] as usize;
        Ok(())
    }

    fn rhythm(&self) -> Rhythm {
        self.rhythm
    }
}

fn begin(path: &Path, job: Count) -> Run<Count> {
    let inputs: [&str; 0] = [];
    let folder = Folder::claim(path, KIND, inputs).unwrap();
    folder.store(&job.of).unwrap();
    Run::begin(folder, job)
}

/// Steps, losses and counts of a log.
fn logged(path: &Path) -> Vec<(usize, f64, f64)> {
    let records = read_records(path.join(Folder::LOG)).unwrap();
    let value = |record: &weaver_run::Record, name| record.value(name).unwrap();
    records.iter().map(|record| (record.step, value(record, "loss"), value(record, "count"))).collect()
}

#[test]
fn a_run_that_is_stopped_goes_on_from_its_checkpoint() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("run");
    let stop = AtomicBool::new(false);
    let mut run = begin(&path, Count::new(10, Log::Every(1)));
    let mut seen = Vec::new();
    let complete = run.advance(&stop, |report| {
        seen.push(report.step);
        stop.store(report.step == 6, Ordering::Relaxed);
        Ok(())
    });
    assert!(!complete.unwrap() && seen == [1, 2, 3, 4, 5, 6]);
    assert_eq!(run.job.saved, [4, 6], "every fourth step, and where it was stopped");
    let inputs: [&str; 0] = [];
    let refused = Folder::claim(&path, KIND, inputs).unwrap_err();
    assert!(matches!(&refused, Error::RunExists { folder, .. } if *folder == path), "{refused}");
    drop(run);

    let of = Folder::settings(&path, KIND, "a count").unwrap();
    let mut run = Run::resume(Folder::reopen(&path, KIND).unwrap(), Count::new(of, Log::Every(1))).unwrap();
    assert!(run.advance(&AtomicBool::new(false), |_| Ok(())).unwrap());
    assert_eq!((run.job.done, &run.job.saved[..]), (10, &[8, 10][..]));
    let steps: Vec<usize> = logged(&path).iter().map(|record| record.0).collect();
    assert_eq!(steps, (1..=10).collect::<Vec<_>>());
    // A complete one has nothing left to do, and nothing to save.
    assert!(run.advance(&AtomicBool::new(false), |_| Ok(())).unwrap());
    assert_eq!(run.job.saved, [8, 10]);
}

#[test]
fn the_first_free_folder_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(Folder::free(folder.path(), "micro"), folder.path().join("micro-1"));
    fs::create_dir(folder.path().join("micro-1")).unwrap();
    assert_eq!(Folder::free(folder.path(), "micro"), folder.path().join("micro-2"));
}

#[test]
fn a_step_that_fails_leaves_the_last_checkpoint() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("run");
    let job = Count { fails_at: Some(7), ..Count::new(10, Log::Every(1)) };
    let mut run = begin(&path, job);
    run.advance(&AtomicBool::new(false), |_| Ok(())).unwrap_err();
    drop(run);
    let mut run = Run::resume(Folder::reopen(&path, KIND).unwrap(), Count::new(10, Log::Every(1))).unwrap();
    assert_eq!(run.job.done, 4);
    run.advance(&AtomicBool::new(false), |_| Ok(())).unwrap();
    let steps: Vec<usize> = logged(&path).iter().map(|record| record.0).collect();
    assert_eq!(steps, (1..=10).collect::<Vec<_>>(), "steps 5 and 6 once");
}

#[test]
fn records_are_means_over_steps_or_single_steps() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("means");
    // Four records of ten steps: every third, and the last.
    begin(&path, Count::new(10, Log::Means(4))).advance(&AtomicBool::new(false), |_| Ok(())).unwrap();
    assert_eq!(logged(&path), [(3, 2.0, 3.0), (6, 5.0, 6.0), (9, 8.0, 9.0), (10, 10.0, 10.0)]);
    let text = fs::read_to_string(path.join(Folder::LOG)).unwrap();
    assert!(text.starts_with("{\"step\":3,\"stage\":\"first\",\"loss\":2.0,\"seconds\":"), "{text}");
    let path = parent.path().join("single");
    begin(&path, Count::new(10, Log::Every(4))).advance(&AtomicBool::new(false), |_| Ok(())).unwrap();
    assert_eq!(logged(&path), [(1, 1.0, 1.0), (4, 4.0, 4.0), (8, 8.0, 8.0)]);
}

/// A page has a curve for each number and for the loss of each stage.
#[test]
fn pages_have_curves_for_all_numbers() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("run");
    let mut run = begin(&path, Count::new(10, Log::Every(1)));
    run.advance(&AtomicBool::new(false), |_| Ok(())).unwrap();
    let mut page = weaver_run::Page::new("Count");
    let html = page.curves(&run.folder.records().unwrap(), &[("count", "numbers so far")]).html();
    for title in ["loss, first", "loss, second", "seconds", "square", "numbers so far"] {
        assert!(html.contains(&format!("<figcaption>{title} (last ")), "{title}: {html}");
    }
    assert_eq!(html.matches("<figure class=\"curve\"").count(), 5);
}

#[test]
fn logs_of_earlier_versions_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(Folder::LOG);
    let line =
        r#"{"step":7,"stage":"pose","loss":0.5,"terms":[["mse",0.25],["pose",null]],"rate":0.001,"seconds":2.0}"#;
    fs::write(&path, format!("{line}\nnot a record\n")).unwrap();
    let records = read_records(&path).unwrap();
    assert_eq!((records.len(), records[0].step, records[0].stage.as_str()), (1, 7, "pose"));
    let value = |name| records[0].value(name);
    assert_eq!([value("loss"), value("loss/mse"), value("rate")], [Some(0.5), Some(0.25), Some(0.001)]);
    assert_eq!(value("loss/pose"), None);
}
