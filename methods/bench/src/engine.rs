//! `splatweaver bench engine`.

mod meter;
mod rows;
mod vit;

use crate::arguments::BenchEngine;
use meter::{Meter, Work};
use rows::ROWS;
use serde_json::{Value, json};
use weaver_command::{Console, Failure, Progress};
use weaver_kernels::peak;

pub fn run(arguments: &BenchEngine, console: &mut Console) -> Result<(), Failure> {
    let threads = rayon::current_num_threads();
    let mut report = Report {
        threads,
        peak_gflops: peak::fma_gflops_f32(threads),
        copy_gbs: peak::copy_gbs(threads),
        lines: Vec::with_capacity(ROWS.len()),
    };
    let meter = Meter::new(arguments.runs as usize);
    let mut progress = Progress::new("bench", 0, ROWS.len(), console);
    for (name, row) in ROWS {
        let (ms, work) = row(&meter);
        report.lines.push(Line { name, ms, work });
        progress.at(report.lines.len(), ROWS.len(), || name.into(), console);
    }
    progress.finish();
    console.print(&if arguments.json { serde_json::to_string_pretty(&report.json())? } else { report.table() })
}

/// All figures of a run.
struct Report {
    threads: usize,
    peak_gflops: f64,
    copy_gbs: f64,
    lines: Vec<Line>,
}

/// One measured row.
struct Line {
    name: &'static str,
    ms: f64,
    work: Work,
}

impl Line {
    /// Billions of operations per second, for work bound by arithmetic.
    fn gflops(&self) -> Option<f64> {
        match self.work {
            Work::Operations(n) => Some(n / self.ms / 1e6),
            Work::Bytes(_) => None,
        }
    }

    /// Billions of bytes per second, for work bound by memory.
    fn gbs(&self) -> Option<f64> {
        match self.work {
            Work::Bytes(n) => Some(n / self.ms / 1e6),
            Work::Operations(_) => None,
        }
    }
}

impl Report {
    fn fraction(&self, line: &Line) -> f64 {
        let arithmetic = line.gflops().map(|gflops| gflops / self.peak_gflops);
        arithmetic.or(line.gbs().map(|gbs| gbs / self.copy_gbs)).unwrap_or(f64::NAN)
    }

    fn json(&self) -> Value {
        let row = |line: &Line| {
            json!({
                "name": line.name,
                "ms": line.ms,
                "gflops": line.gflops(),
                "gbs": line.gbs(),
                "fraction_of_peak": self.fraction(line),
            })
        };
        json!({
            "threads": self.threads,
            "peak_gflops": self.peak_gflops,
            "copy_gbs": self.copy_gbs,
            "rows": self.lines.iter().map(row).collect::<Value>(),
        })
    }

    fn table(&self) -> String {
        let number = |x: Option<f64>| x.map_or(String::new(), |x| format!("{x:.1}"));
        let mut text = format!("{:<28}{:>10}{:>10}{:>8}{:>9}\n", "work, f32", "ms", "GFLOP/s", "GB/s", "of peak");
        for line in &self.lines {
            text += &format!(
                "{:<28}{:>10.3}{:>10}{:>8}{:>7.0} %\n",
                line.name,
                line.ms,
                number(line.gflops()),
                number(line.gbs()),
                100.0 * self.fraction(line)
            );
        }
        let threads = if self.threads == 1 { "1 thread".into() } else { format!("{} threads", self.threads) };
        text + &format!(
            "\nMedians on {threads}. Peaks measured in this run: {:.0} GFLOP/s of FMAs in registers, {:.1} GB/s copied in\n\
             memory. What fits into the caches can move faster than that.",
            self.peak_gflops, self.copy_gbs
        )
    }
}
