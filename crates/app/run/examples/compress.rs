//! A run of one's own: `cargo run --release -p weaver-run --example compress`. A picture becomes the weights of waves;
//! the run stops halfway, goes on to the bits of an uninterrupted one, and writes runs/compress/report.html.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use weaver_autograd::{Params, Tape};
use weaver_io::{Image, safetensors::Tensors};
use weaver_nn::{AdamW, Context, Group};
use weaver_run::{Error, Folder, Job, Kind, Page, Run, StepReport, state};

const KIND: Kind = Kind { command: "compress", settings: "run.json", results: &[] };
const SIDE: usize = 48;
const WAVES: usize = 12 * 12;

struct Picture {
    params: Params<f32>,
    optimizer: AdamW<f32>,
    steps: [usize; 2],
    drawn: Vec<f32>,
}

fn picture(steps: usize) -> Picture {
    let mut params = Params::new();
    let weights = params.add("weights", [WAVES, 3], vec![0.0; WAVES * 3]);
    let groups = vec![Group { params: vec![weights], lr_scale: 1.0, weight_decay: 0.0 }];
    Picture { params, optimizer: AdamW::new(groups, 0.9, 0.99, 1e-8), steps: [0, steps], drawn: Vec::new() }
}

impl Job for Picture {
    type Error = Error;
    fn steps(&self) -> [usize; 2] {
        self.steps
    }
    fn step(&mut self) -> Result<StepReport, Error> {
        let pixels = (0..SIDE * SIDE).map(|i| [i % SIDE, i / SIDE].map(|x| x as f32 / SIDE as f32));
        let wave = |k: usize, x: f32| (k as f32 * std::f32::consts::PI * x).cos();
        let waves = pixels.clone().flat_map(|[x, y]| (0..WAVES).map(move |k| wave(k % 12, x) * wave(k / 12, y)));
        let colors = pixels.flat_map(|[x, y]| [x, y, f32::from((x - 0.5).hypot(y - 0.5) < 0.3)]);
        let mut tape = Tape::new();
        let waves = tape.constant(&waves.collect::<Vec<_>>(), [SIDE * SIDE, WAVES]);
        let colors = tape.constant(&colors.collect::<Vec<_>>(), [SIDE * SIDE, 3]);
        let drawn = waves.matmul(Context::new(&tape, &self.params).param(self.params.find("weights").unwrap()));
        let loss = (drawn - colors).square().mean();
        let value = f64::from(loss.item());
        self.drawn = drawn.value().to_vec();
        loss.backward();
        self.optimizer.step(&mut self.params, &mut tape, 0.01);
        self.steps[0] += 1;
        Ok(StepReport { step: self.steps[0], of: self.steps[1], loss: value, ..StepReport::default() })
    }
    fn state(&mut self) -> Result<Tensors, Error> {
        let mut tensors = Tensors::default();
        tensors.metadata.insert("step".into(), self.steps[0].to_string());
        state::put_params(&mut tensors, "", &self.params);
        state::put_optimizer(&mut tensors, &self.params, &self.optimizer);
        Ok(tensors)
    }
    fn restore(&mut self, from: &Tensors) -> Result<(), Error> {
        self.steps[0] = from.metadata["step"].parse().expect("a checkpoint of this example");
        state::take_params(from, "", &mut self.params)?;
        Ok(state::take_optimizer(from, &self.params, &mut self.optimizer)?)
    }
}

fn main() -> Result<(), Error> {
    let (path, stop) = (std::path::Path::new("runs/compress"), AtomicBool::new(false));
    let folder = Folder::claim(path, KIND, [] as [&str; 0])?;
    folder.store(&300)?;
    Run::begin(folder, picture(300)).advance(&stop, |report| {
        stop.store(report.step == 150, Relaxed);
        Ok(())
    })?;
    let steps = Folder::settings(path, KIND, "a picture")?;
    let mut run = Run::resume(Folder::reopen(path, KIND)?, picture(steps))?;
    run.advance(&AtomicBool::new(false), |_| Ok(()))?;
    let mut alone = picture(300);
    (0..300).try_for_each(|_| alone.step().map(drop))?;
    assert_eq!(run.job.drawn, alone.drawn, "the same bits");
    let image = Image { width: SIDE, height: SIDE, pixels: run.job.drawn };
    run.folder.report(Page::new("Compress").picture("drawn", &image).curves(&run.folder.records()?, &[]))
}
