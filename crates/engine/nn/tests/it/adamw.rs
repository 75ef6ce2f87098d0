//! AdamW and averages: against numbers that are simulated one by one, through files.

use proptest::prelude::*;
use std::collections::BTreeMap;
use weaver_autograd::{ParamId, Params, Tape};
use weaver_io::safetensors::Tensors;
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Ema, Group, Moments, Optimizer};

const WIDTH: usize = 3;
const BETAS: [f64; 2] = [0.9, 0.99];
const DECAY: f64 = 0.98;

/// A parameter of rows, its optimizer and its average.
struct Run {
    params: Params<f64>,
    id: ParamId,
    optimizer: AdamW<f64>,
    ema: Ema<f64>,
    tape: Tape<f64>,
}

fn numbers(count: usize, seed: u64) -> Vec<f64> {
    (0..count as u64).map(|i| Stream::new(seed, 0, "rows").normal(i)).collect()
}

impl Run {
    fn new(rows: usize) -> Self {
        let mut params = Params::new();
        let id = params.add("w", [rows, WIDTH], numbers(rows * WIDTH, 0));
        let group = Group { params: vec![id], lr_scale: 0.5, weight_decay: 0.1 };
        let ema = Ema::new(&params, DECAY);
        Self { params, id, optimizer: AdamW::new(vec![group], BETAS[0], BETAS[1], 1e-8), ema, tape: Tape::new() }
    }

    fn step(&mut self, gradient: &[f64]) {
        let constant = self.tape.constant(gradient, self.params.get(self.id).shape());
        (self.tape.param(&self.params, self.id) * constant).sum().backward();
        self.optimizer.step_scaled(&mut self.params, &mut self.tape, 0.02, 0.5);
        self.tape.reset();
        self.ema.update(&self.params);
    }

    /// Everything that a run consists of, to a file.
    fn write(&self) -> tempfile::NamedTempFile {
        let (mut tensors, params) = (Tensors::default(), &self.params);
        let shape = params.get(self.id).shape();
        tensors.insert("param.w", shape.dims(), params.get(self.id).value().to_vec());
        for (name, average) in self.ema.state(params) {
            tensors.insert(format!("ema.{name}"), shape.dims(), average.to_vec());
        }
        for (name, steps, moments) in self.optimizer.state(params) {
            tensors.insert(format!("moment1.{name}"), shape.dims(), moments.first.clone());
            tensors.insert(format!("moment2.{name}"), shape.dims(), moments.second.clone());
            tensors.insert(format!("steps.{name}"), &[2], vec![steps, self.ema.steps()]);
        }
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        tensors.write(file.path()).expect("written");
        file
    }

    /// A run from a file.
    fn read(file: &tempfile::NamedTempFile) -> Self {
        let tensors = Tensors::read(file.path()).expect("read");
        let shape = tensors.tensors["param.w"].shape.clone();
        let mut run = Self::new(shape[0]);
        let values = |key: &str| tensors.values::<f64>(&format!("{key}.w"), &shape).expect("of the shape").to_vec();
        run.params.value_mut(run.id).copy_from_slice(&values("param"));
        let (mut averages, mut state) = (BTreeMap::new(), BTreeMap::new());
        averages.insert("w".to_string(), values("ema"));
        let mut steps = [0; 2];
        if tensors.tensors.contains_key("moment1.w") {
            let moments = Moments { first: values("moment1"), second: values("moment2") };
            steps.copy_from_slice(tensors.values("steps.w", &[2]).expect("steps"));
            state.insert("w".to_string(), (steps[0], moments));
        }
        run.ema.set_state(&run.params, steps[1], averages).expect("averages fit");
        run.optimizer.set_state(&run.params, state).expect("moments fit");
        run
    }
}

/// Values, both moments and averages.
type Twin = Vec<[f64; 4]>;

fn step(twin: &mut Twin, t: u64, gradient: &[f64]) {
    let [correction1, correction2] = BETAS.map(|beta| 1.0 - beta.powf(t as f64));
    let k = (t - 1) as f64;
    let decay = DECAY.min((k + 1.0) / (k + 10.0));
    for ([p, m, v, a], g) in twin.iter_mut().zip(gradient) {
        let g = 0.5 * g;
        *m = BETAS[0] * *m + (1.0 - BETAS[0]) * g;
        *v = BETAS[1] * *v + (1.0 - BETAS[1]) * g * g;
        let rate = 0.01 / correction1;
        *p = *p * (1.0 - 0.01 * 0.1) - rate * *m / (v.sqrt() * (1.0 / correction2.sqrt()) + 1e-8);
        *a = decay * *a + (1.0 - decay) * *p;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    #[test]
    fn a_parameter_is_its_numbers_simulated_one_by_one(
        rows in 1..12usize,
        stored in prop::collection::vec(any::<bool>(), 1..14),
        seed: u64,
    ) {
        let mut run = Run::new(rows);
        let mut twin: Twin = numbers(rows * WIDTH, 0).into_iter().map(|x| [x, 0.0, 0.0, x]).collect();
        for (t, stored) in (1..).zip(stored) {
            let gradient = numbers(rows * WIDTH, seed ^ t);
            run.step(&gradient);
            step(&mut twin, t, &gradient);
            if stored {
                run = Run::read(&run.write());
            }
            let all = |which: usize| Vec::from_iter(twin.iter().map(|n| n[which]));
            prop_assert_eq!(run.params.get(run.id).value(), all(0));
            for (_, steps, moments) in run.optimizer.state(&run.params) {
                prop_assert_eq!((steps, &moments.first, &moments.second), (t, &all(1), &all(2)));
            }
            for (_, average) in run.ema.state(&run.params) {
                prop_assert_eq!(average, all(3));
            }
        }
    }
}
