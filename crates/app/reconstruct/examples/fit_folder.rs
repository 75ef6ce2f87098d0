//! Fits a capture in half a minute: `fit_folder CAPTURE OUT`.

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use weaver_fit::{FitSettings, Judge};
use weaver_reconstruct::{Run, RunSettings};
use weaver_splat::CpuRasterizer;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(capture), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err("expected the folder of a capture, and one for the results".into());
    };
    let settings = RunSettings { minutes: Some(0.5), ..RunSettings::new(capture, FitSettings::default()) };
    let mut run = Run::create(out.as_ref(), settings, None, Judge::default(), Arc::new(CpuRasterizer))?;
    run.advance(&AtomicBool::new(false), |_| {})?;
    println!("{:#?}", run.finish()?);
    Ok(())
}
