//! A model whose parameters grow and shrink: runs of it are stored, resumed, taken as a start and read for inference.

use proptest::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use weaver_autograd::{ParamId, Params};
use weaver_inference::{Checkpoint, Predictor, WeightSet};
use weaver_kernels::random::Stream;
use weaver_nn::{Context, RowMap, RowSource};
use weaver_trainer::{Config, Error, Example, NoSettings, Recipe, Session, StageConfig, Step, Terms, TrainedRows};

const WIDTH: usize = 3;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
struct CloudConfig {
    /// True if the rows of the points vary.
    rows_vary: bool,
}

/// Points `[N, 3]` that are drawn to the colors of photos, and one factor on all of them.
#[derive(Debug)]
struct Cloud {
    points: ParamId,
    factor: ParamId,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct CloudRecipe;

impl Recipe for CloudRecipe {
    const ARCHITECTURE: &'static str = "cloud";
    const PRESETS: &'static [&'static str] = &["small"];
    type Network = Cloud;
    type Model = CloudConfig;
    type Stage = NoSettings;
    type Losses = NoSettings;
    type Evaluation = NoSettings;

    fn preset(name: &str) -> Option<Config<Self>> {
        let stage = StageConfig::new(name, 8, 0.02, NoSettings {});
        Some(Config::new(name, CloudConfig { rows_vary: true }, vec![stage], NoSettings {}))
    }

    fn image_size(_: &CloudConfig) -> [usize; 2] {
        [16, 16]
    }

    fn build(model: &CloudConfig, params: &mut Params<f32>, seed: u64) -> Cloud {
        let normal = |i| Stream::new(seed, 0, "points").normal(i);
        let points = params.add("points", [2, WIDTH], (0..2 * WIDTH as u64).map(normal).collect());
        if model.rows_vary {
            params.set_rows_vary(points);
        }
        Cloud { points, factor: params.add("factor", [1], vec![1.0]) }
    }

    fn objective<'t>(
        cx: Context<'t, '_, f32>,
        network: &Cloud,
        _step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error> {
        let mut terms = Terms::default();
        let [points, factor] = [network.points, network.factor].map(|id| cx.tape.param(cx.params, id));
        let color = cx.tape.constant(&examples[0].images[..WIDTH], [1, WIDTH]).expand(points.shape());
        terms
            .add("color", 1.0, 1.0, || (points * factor.reshape([1, 1]).expand(points.shape()) - color).square().sum());
        Ok(terms)
    }

    /// After every other step: rows are kept, duplicated, dropped and added, up to nine.
    fn resize(cloud: &Cloud, config: &Config<Self>, step: usize, rows: &mut TrainedRows<'_>) -> Result<(), Error> {
        if !config.model.rows_vary || step % 2 == 1 {
            return Ok(());
        }
        let stream = Stream::new(config.seed, step as u64, "rows");
        let old = rows.params().get(cloud.points).shape()[0];
        let gradient: f32 = rows.gradient(cloud.points).expect("the loss reaches the points").iter().sum();
        let source = |i: u64| match stream.below(2 * i, 3) {
            0 => RowSource::Keep(stream.below(2 * i + 1, old) as u32),
            1 => RowSource::Copy(stream.below(2 * i + 1, old) as u32),
            _ => RowSource::New,
        };
        let sources = (0..1 + stream.below(99, 9) as u64).map(source).collect();
        let map = RowMap::new(old, sources).expect("sources are old rows");
        rows.remap(cloud.points, &map, |row, numbers| numbers.fill(gradient * 0.1 + row as f32))
    }

    fn predictor(_: Arc<Cloud>, _: Params<f32>, _: &Config<Self>) -> Result<Box<dyn Predictor>, Error> {
        Err(Error::Input("points without Gaussians".into()))
    }

    fn from_checkpoint(_: &Checkpoint) -> Result<Box<dyn Predictor>, Error> {
        Err(Error::Input("points without Gaussians".into()))
    }
}

fn config(seed: u64) -> Config<CloudRecipe> {
    Config { seed, ..CloudRecipe::preset("small").unwrap() }
}

fn trained(config: Config<CloudRecipe>, steps: usize, path: &Path) -> Session<CloudRecipe> {
    let mut session = Session::new(config).unwrap();
    (0..steps).for_each(|_| _ = session.advance().unwrap().unwrap());
    session.save(path).unwrap();
    session
}

fn rows(params: &Params<f32>) -> usize {
    params.get(params.find("points").unwrap()).shape()[0]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 64, failure_persistence: None, ..Default::default() })]

    /// A resumed run has the rows and the bits of an uninterrupted one.
    #[test]
    fn a_resumed_run_has_the_same_rows_and_bits(seed in 0_u64..1000, stop in 1_usize..8) {
        let folder = tempfile::tempdir().unwrap();
        let [middle, end, again] = ["middle", "end", "again"].map(|name| folder.path().join(name));
        let mut whole = trained(config(seed), stop, &middle);
        let mut resumed = Session::<CloudRecipe>::resume(config(seed), &middle).unwrap();
        prop_assert_eq!(rows(resumed.params()), rows(whole.params()));
        for (session, path) in [(&mut whole, &end), (&mut resumed, &again)] {
            while session.advance().unwrap().is_some() {}
            session.save(path).unwrap();
        }
        // Values, moments and averages alike.
        prop_assert_eq!(std::fs::read(&end).unwrap(), std::fs::read(&again).unwrap());
    }
}

/// The step at which a run with this seed has other rows than a new one, and its checkpoint.
fn grown(folder: &Path) -> (Session<CloudRecipe>, std::path::PathBuf) {
    let path = folder.join("grown.safetensors");
    let session = trained(config(2), 4, &path);
    assert_ne!(rows(session.params()), 2, "choose another seed");
    (session, path)
}

#[test]
fn a_grown_run_is_read_for_inference_and_as_a_start() {
    let folder = tempfile::tempdir().unwrap();
    let (session, path) = grown(folder.path());
    let mut params = Params::new();
    CloudRecipe::build(&CloudConfig { rows_vary: true }, &mut params, 0);
    Checkpoint::read(&path).unwrap().fill(&mut params, WeightSet::Averaged).unwrap();
    assert_eq!(rows(&params), rows(session.params()));
    let mut next = Session::new(Config { init: Some(path), ..config(5) }).unwrap();
    assert_eq!(
        next.params().get(next.params().find("points").unwrap()).value(),
        params.get(params.find("points").unwrap()).value()
    );
    while next.advance().unwrap().is_some() {}
}

/// Rows that do not vary and rows of another width stay loud.
#[test]
fn other_rows_and_widths_stay_loud() {
    let folder = tempfile::tempdir().unwrap();
    let (session, path) = grown(folder.path());
    let checkpoint = Checkpoint::read(&path).unwrap();
    let built = |rows_vary: bool| {
        let mut params = Params::new();
        CloudRecipe::build(&CloudConfig { rows_vary }, &mut params, 0);
        params
    };
    let refused = |mut params: Params<f32>, checkpoint: &Checkpoint| {
        let message = checkpoint.fill(&mut params, WeightSet::Trained).unwrap_err().to_string();
        assert!(message.contains("grown.safetensors"), "{message}");
        message
    };
    let message = refused(built(false), &checkpoint);
    let found = format!("expected [2, 3], found [{}, 3]", rows(session.params()));
    assert!(message.contains("param.points") && message.contains(&found), "{message}");

    // Other columns; an average of other rows than the values.
    let stored = |name: &str, shape: &[usize]| {
        let mut tensors = checkpoint.tensors().clone();
        tensors.insert(name, shape, vec![0.0_f32; shape.iter().product()]);
        tensors.write(&path).unwrap();
        Checkpoint::read(&path).unwrap()
    };
    for (name, shape) in [("param.points", &[4, 2][..]), ("param.points", &[6]), ("ema.points", &[1, 3])] {
        let message = refused(built(true), &stored(name, shape));
        assert!(message.contains(name) && message.contains(&format!("found {shape:?}")), "{message}");
    }
}
