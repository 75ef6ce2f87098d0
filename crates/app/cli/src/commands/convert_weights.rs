//! `splatweaver convert-weights`.

use clap::Args;
use serde_json::json;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use weaver_command::{Console, Failure, Interrupt, Output, Progress};
use weaver_inference::Checkpoint;
use weaver_io::TorchCheckpoint;
use weaver_io::safetensors::write_weights;

/// Turns a PyTorch checkpoint (.pt, .pth, .ckpt, .bin) into safetensors, or a run's checkpoint into small weights.
///
/// Of a PyTorch checkpoint only the tensors are read; code in the file is never executed. Of a run's
/// checkpoint.safetensors the averaged weights are kept, with 16 bits.
#[derive(Args, Debug)]
#[command(after_help = "Example:
  splatweaver convert-weights model.ckpt -o model.safetensors
  splatweaver convert-weights runs/mine/checkpoint.safetensors -o mine.safetensors")]
pub struct ConvertWeights {
    /// The checkpoint
    pub file: PathBuf,
    /// The safetensors file to write
    #[arg(short, long, value_name = "FILE", value_parser = Output::file(&["safetensors"]))]
    pub out: Output,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

pub fn run(arguments: &ConvertWeights, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    if arguments.file.extension().is_some_and(|e| e == "safetensors") {
        let compact = Checkpoint::read(&arguments.file)?.compact()?;
        compact.write(&arguments.out)?;
        let count = compact.tensors.len();
        let text = format!("{count} tensors of 16 bits, for inference only: {}", arguments.out.display());
        return console.answer(arguments.json, &[&arguments.out], json!({ "tensors": count }), &text);
    }
    let mut checkpoint = TorchCheckpoint::open(&arguments.file)?;
    let planned = checkpoint.tensors()?;
    let total = planned.len();
    let stop = interrupt.watch_after("this tensor");
    let mut progress = Progress::new("convert", 0, total, console);
    let mut done = 0;
    let written = write_weights(&arguments.out, &Default::default(), &planned, |tensor, out| {
        if stop.load(Ordering::Relaxed) {
            return Err(io::Error::new(io::ErrorKind::Interrupted, "interrupted; nothing was written"));
        }
        checkpoint.write(&tensor.name, out)?;
        done += 1;
        progress.at(done, total, || tensor.name.clone(), console);
        Ok(())
    });
    progress.finish();
    written?;
    for remark in checkpoint.remarks() {
        console.note(remark);
    }
    let bytes: usize = planned.iter().map(|tensor| tensor.bytes()).sum();
    let text = format!("{total} tensors, {:.2} GB: {}", bytes as f64 / 1e9, arguments.out.display());
    console.answer(arguments.json, &[&arguments.out], json!({ "tensors": total, "bytes": bytes }), &text)
}
