//! Logged moments of a run, and the curves that they make.

use crate::{Page, StepReport, read_metrics};
use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Map, Value};
use std::path::Path;

/// A logged moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Steps done.
    pub step: usize,
    /// Name of the stage; empty where there is only one.
    pub stage: String,
    /// Numbers by their names, the loss and the seconds of steps among them.
    pub values: Vec<(String, f64)>,
}

impl Record {
    /// The number of this name.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.values.iter().find(|(other, _)| other == name).map(|(_, value)| *value)
    }

    /// A record from an object of a log. Logs of earlier versions have losses as a list of pairs, `terms`.
    fn of(object: &Map<String, Value>) -> Option<Self> {
        let step = object.get("step")?.as_u64()? as usize;
        let stage = object.get("stage").and_then(Value::as_str).unwrap_or_default().to_string();
        let numbers = object.iter().filter(|(name, _)| *name != "step");
        let numbers = numbers.filter_map(|(name, value)| Some((name.clone(), value.as_f64()?)));
        let terms = object.get("terms").and_then(Value::as_array).into_iter().flatten();
        let terms = terms.filter_map(|pair| Some((format!("loss/{}", pair[0].as_str()?), pair[1].as_f64()?)));
        Some(Self { step, stage, values: numbers.chain(terms).collect() })
    }
}

/// An object of a log, the step first. Numbers that are not finite become null.
impl Serialize for Record {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let mut object = to.serialize_map(None)?;
        object.serialize_entry("step", &self.step)?;
        if !self.stage.is_empty() {
            object.serialize_entry("stage", &self.stage)?;
        }
        for (name, value) in &self.values {
            // A number that was of 32 bits is written as such, which takes fewer digits.
            match f64::from(*value as f32) == *value {
                true => object.serialize_entry(name, &(*value as f32))?,
                false => object.serialize_entry(name, value)?,
            }
        }
        object.end()
    }
}

/// Reads a log; lines that are no records, such as an incomplete last one after a crash, are skipped.
///
/// # Errors
/// When the file cannot be read.
pub fn read_records(path: impl AsRef<Path>) -> weaver_io::Result<Vec<Record>> {
    let objects: Vec<Map<String, Value>> = read_metrics(path)?;
    Ok(objects.iter().filter_map(Record::of).collect())
}

impl Page {
    /// Adds a curve for every number of a log under a heading. The loss of a run with several stages has a curve for
    /// each, since each stage defines it differently. `names` are pairs of a name in the log and a readable name.
    pub fn curves(&mut self, records: &[Record], names: &[(&str, &str)]) -> &mut Self {
        self.heading(2, "Curves");
        let mut stages: Vec<&str> = Vec::new();
        let mut numbers: Vec<&str> = Vec::new();
        for record in records {
            if !stages.contains(&record.stage.as_str()) {
                stages.push(&record.stage);
            }
            for (name, _) in &record.values {
                if !numbers.contains(&name.as_str()) {
                    numbers.push(name);
                }
            }
        }
        for name in numbers {
            let title = names.iter().find(|(key, _)| *key == name).map_or(name.replace('_', " "), |n| n.1.into());
            let points = |stage: Option<&str>| -> Vec<(usize, f64)> {
                let own = records.iter().filter(|record| stage.is_none_or(|stage| record.stage == stage));
                own.filter_map(|record| record.value(name).map(|value| (record.step, value))).collect()
            };
            if name == "loss" && stages.len() > 1 {
                stages.iter().for_each(|stage| {
                    self.curve(&format!("{title}, {stage}"), points(Some(stage)));
                });
            } else {
                self.curve(&title, points(None));
            }
        }
        self
    }
}

/// Sums over steps, for a record with their means.
#[derive(Debug, Default)]
pub(crate) struct Mean {
    loss: f64,
    sums: Vec<(String, f64, bool)>,
    count: usize,
}

impl Mean {
    pub fn add(&mut self, report: &StepReport) {
        self.loss += report.loss;
        self.count += 1;
        for scalar in &report.scalars {
            match self.sums.iter_mut().find(|(name, ..)| *name == scalar.name) {
                Some((_, sum, true)) => *sum += scalar.value,
                Some((_, last, false)) => *last = scalar.value,
                None => self.sums.push((scalar.name.to_string(), scalar.value, scalar.averaged)),
            }
        }
    }

    /// The record of the added steps; the sums then begin anew.
    pub fn take(&mut self, report: &StepReport, seconds: f64) -> Record {
        let Self { loss, sums, count } = std::mem::take(self);
        let over = 1.0 / count as f64;
        let own = sums.into_iter().map(|(name, sum, averaged)| (name, if averaged { sum * over } else { sum }));
        let first = [("loss".to_string(), loss * over), ("seconds".to_string(), seconds)];
        Record { step: report.step, stage: report.stage.clone(), values: first.into_iter().chain(own).collect() }
    }
}
