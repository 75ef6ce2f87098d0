//! `splatweaver convert-weights`.

use crate::arguments::ConvertWeights;
use crate::{Console, Interrupt};
use std::io;
use std::sync::atomic::Ordering;
use weaver_command::{Failure, Progress};
use weaver_inference::Checkpoint;
use weaver_io::TorchCheckpoint;
use weaver_io::safetensors::write_weights;

pub fn run(arguments: &ConvertWeights, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    weaver_io::check_output_file(&arguments.out, [&arguments.file])?;
    if arguments.file.extension().is_some_and(|e| e == "safetensors") {
        let compact = Checkpoint::read(&arguments.file)?.compact()?;
        compact.write(&arguments.out)?;
        let (count, out) = (compact.tensors.len(), arguments.out.display());
        return console.print(&format!("{count} tensors of 16 bits, for inference only: {out}"));
    }
    let mut checkpoint = TorchCheckpoint::open(&arguments.file)?;
    let planned = checkpoint.tensors()?;
    let total = planned.len();
    let stop = interrupt.watch();
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
    console.print(&format!("{total} tensors, {:.2} GB: {}", bytes as f64 / 1e9, arguments.out.display()))
}
