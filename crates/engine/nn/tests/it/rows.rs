//! Steps of some rows of a parameter: against rows that are simulated one by one.

use proptest::prelude::*;
use std::collections::BTreeMap;
use weaver_autograd::{ParamId, Params, Tape};
use weaver_io::safetensors::Tensors;
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Ema, Group, Moments, RowError, RowSet, StateError};

const WIDTH: usize = 3;
const BETAS: [f64; 2] = [0.9, 0.99];
const DECAY: f64 = 0.98;

/// An event of a parameter, with a seed for the details.
#[derive(Clone, Copy, Debug)]
enum Event {
    StepOfAll,
    StepOfSome,
    Store,
}

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

    fn rows(&self) -> usize {
        self.params.get(self.id).shape()[0]
    }

    fn gradient(&mut self, gradient: &[f64]) {
        self.tape.reset();
        let constant = self.tape.constant(gradient, self.params.get(self.id).shape());
        (self.tape.param(&self.params, self.id) * constant).sum().backward();
    }

    fn step(&mut self, gradient: &[f64], rows: Option<&RowSet>) -> Result<(), RowError> {
        self.gradient(gradient);
        self.optimizer.step_rows(&mut self.params, &mut self.tape, 0.02, 0.5, |_| rows)?;
        self.tape.reset();
        self.ema.update(&self.params);
        Ok(())
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
            tensors.insert(format!("row_steps.{name}"), &[moments.row_steps.len()], moments.row_steps.clone());
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
            let rows = tensors.tensors["row_steps.w"].shape.clone();
            let row_steps = tensors.values("row_steps.w", &rows).expect("steps").to_vec();
            let moments = Moments { first: values("moment1"), second: values("moment2"), row_steps };
            steps.copy_from_slice(tensors.values("steps.w", &[2]).expect("steps"));
            state.insert("w".to_string(), (steps[0], moments));
        }
        run.ema.set_state(&run.params, steps[1], averages).expect("averages fit");
        run.optimizer.set_state(&run.params, state).expect("moments fit");
        run
    }
}

/// A row alone: values, both moments and averages, and when it last took part.
#[derive(Clone, Debug)]
struct Twin {
    numbers: [[f64; 4]; WIDTH],
    last_step: u64,
}

impl Twin {
    fn new(values: &[f64], step: u64) -> Self {
        Self { numbers: std::array::from_fn(|i| [values[i], 0.0, 0.0, values[i]]), last_step: step }
    }

    fn step(&mut self, t: u64, gradient: &[f64]) {
        let [correction1, correction2] = BETAS.map(|beta| 1.0 - beta.powf(t as f64));
        let skipped = (t - 1 - self.last_step) as f64;
        self.last_step = t;
        for ([p, m, v, _], g) in self.numbers.iter_mut().zip(gradient) {
            if skipped > 0.0 {
                *m *= BETAS[0].powf(skipped);
                *v *= BETAS[1].powf(skipped);
            }
            let g = 0.5 * g;
            *m = BETAS[0] * *m + (1.0 - BETAS[0]) * g;
            *v = BETAS[1] * *v + (1.0 - BETAS[1]) * g * g;
            let rate = 0.01 / correction1;
            *p = *p * (1.0 - 0.01 * 0.1) - rate * *m / (v.sqrt() * (1.0 / correction2.sqrt()) + 1e-8);
        }
    }

    fn average(&mut self, t: u64) {
        let k = (t - 1) as f64;
        let decay = DECAY.min((k + 1.0) / (k + 10.0));
        self.numbers.iter_mut().for_each(|[p, _, _, a]| *a = decay * *a + (1.0 - decay) * *p);
    }
}

fn some_rows(total: usize, stream: Stream) -> RowSet {
    let share: f64 = stream.uniform(1000);
    RowSet::from_mask(&Vec::from_iter((0..total as u64).map(|row| stream.uniform::<f64>(row) < share)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    #[test]
    fn a_parameter_is_its_rows_simulated_one_by_one(
        rows in 1..12usize,
        events in prop::collection::vec(
            prop_oneof![
                2 => Just(Event::StepOfAll), 4 => Just(Event::StepOfSome), 1 => Just(Event::Store)
            ],
            1..14,
        ),
        seed: u64,
    ) {
        let mut run = Run::new(rows);
        let mut twins: Vec<Twin> = numbers(rows * WIDTH, 0).chunks(WIDTH).map(|row| Twin::new(row, 0)).collect();
        let mut t = 0;
        for (i, event) in events.into_iter().enumerate() {
            let stream = Stream::new(seed, i as u64, "events");
            let rows = run.rows();
            match event {
                Event::StepOfAll | Event::StepOfSome => {
                    t += 1;
                    let gradient = numbers(rows * WIDTH, seed ^ t);
                    let chosen = matches!(event, Event::StepOfSome).then(|| some_rows(rows, stream));
                    run.step(&gradient, chosen.as_ref()).expect("equally many rows");
                    for (row, twin) in twins.iter_mut().enumerate() {
                        if chosen.as_ref().is_none_or(|set| set.rows().contains(&(row as u32))) {
                            twin.step(t, &gradient[row * WIDTH..][..WIDTH]);
                        }
                        twin.average(t);
                    }
                }
                Event::Store => run = Run::read(&run.write()),
            }
            let param = run.params.get(run.id);
            prop_assert_eq!(param.shape(), [twins.len(), WIDTH].into());
            let all = |which: usize| Vec::from_iter(twins.iter().flat_map(|twin| twin.numbers.map(|n| n[which])));
            prop_assert_eq!(param.value(), all(0));
            for (_, steps, moments) in run.optimizer.state(&run.params) {
                prop_assert_eq!((steps, &moments.first, &moments.second), (t, &all(1), &all(2)));
            }
            for (_, average) in run.ema.state(&run.params) {
                prop_assert_eq!(average, all(3));
            }
        }
    }

    #[test]
    fn every_row_chosen_is_the_dense_step(rows in 1..12usize, steps in 1..6u64, seed: u64) {
        let (mut dense, mut sparse) = (Run::new(rows), Run::new(rows));
        for t in 0..steps {
            let gradient = numbers(rows * WIDTH, seed ^ t);
            let all = RowSet::new(rows, (0..rows as u32).rev().collect()).expect("rows below the length");
            sparse.step(&gradient, Some(&all)).expect("equally many rows");
            dense.gradient(&gradient);
            dense.optimizer.step_scaled(&mut dense.params, &mut dense.tape, 0.02, 0.5);
        }
        prop_assert_eq!(dense.params.get(dense.id).value(), sparse.params.get(sparse.id).value());
        let moments = |run: &Run| run.optimizer.state(&run.params).map(|(_, t, m)| (t, m.clone())).collect::<Vec<_>>();
        prop_assert_eq!(moments(&dense), moments(&sparse));
    }

    /// The stated difference from dense AdamW: the moments agree up to rounding, the values of skipped rows do not
    /// move.
    #[test]
    fn skipped_rows_and_gradients_of_zero(skipped in 1..20usize, seed: u64) {
        let (mut dense, mut sparse) = (Run::new(1), Run::new(1));
        let (first, zero) = (numbers(WIDTH, seed), [0.0; WIDTH]);
        for run in [&mut dense, &mut sparse] {
            run.step(&first, None).expect("one row");
        }
        let before = sparse.params.get(sparse.id).value().to_vec();
        for _ in 0..skipped {
            dense.step(&zero, None).expect("one row");
            sparse.step(&zero, Some(&RowSet::from_mask(&[false]))).expect("one row");
        }
        prop_assert_eq!(sparse.params.get(sparse.id).value(), before);
        for run in [&mut dense, &mut sparse] {
            run.step(&zero, None).expect("one row");
        }
        let moments = |run: &Run| {
            let list: Vec<f64> = run.optimizer.state(&run.params).flat_map(|(_, _, m)| [&m.first[..], &m.second].concat()).collect();
            list
        };
        for (a, b) in moments(&dense).into_iter().zip(moments(&sparse)) {
            prop_assert!((a - b).abs() <= 1e-14 * a.abs(), "{} {}", a, b);
        }
    }
}

#[test]
fn rows_with_a_gradient() {
    let mut run = Run::new(3);
    assert_eq!(RowSet::with_gradient(&run.params, &run.tape, run.id), RowSet::from_mask(&[false; 3]));
    run.gradient(&[0.0, 0.0, 0.0, 0.0, -1.0, 0.0, f64::NAN, 0.0, 0.0]);
    assert_eq!(RowSet::with_gradient(&run.params, &run.tape, run.id), RowSet::from_mask(&[false, true, true]));
}

#[test]
fn what_does_not_fit_is_named() {
    assert_eq!(RowSet::new(3, vec![0, 3]).unwrap_err().to_string(), "expected rows below 3, found 3");

    let mut run = Run::new(3);
    let gradient = [1.0; 9];
    run.step(&gradient, None).expect("equally many rows");
    let before = run.params.get(run.id).value().to_vec();
    let message = run.step(&gradient, Some(&RowSet::from_mask(&[true; 4]))).unwrap_err().to_string();
    assert_eq!(message, "row set of parameter `w`: expected 3 rows, found 4");
    assert_eq!(run.params.get(run.id).value(), before, "nothing is changed");

    let moments = Moments { first: vec![0.0; 9], second: vec![0.0; 9], row_steps: vec![1; 4] };
    let state = BTreeMap::from([("w".to_string(), (1, moments))]);
    let error = run.optimizer.set_state(&run.params, state).unwrap_err();
    assert_eq!(error, StateError::RowSteps { name: "w".into(), expected: 3, found: 4 });
}
