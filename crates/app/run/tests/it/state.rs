use weaver_autograd::{Params, Tape};
use weaver_io::safetensors::Tensors;
use weaver_nn::{AdamW, Context, Ema, Group, Moments, RAdam};
use weaver_run::state::{
    is_of_optimizer, optimizer_state, put_average, put_optimizer, put_params, take_average, take_optimizer, take_params,
};

fn params() -> Params<f32> {
    let mut params = Params::new();
    params.add("a", [2, 3], vec![0.5, -1.0, 2.0, 0.0, 1.5, 3.0]);
    params.add("b", [2], vec![1.0, -2.0]);
    params
}

fn adam(params: &Params<f32>) -> AdamW<f32> {
    AdamW::new(vec![Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.01 }], 0.9, 0.99, 1e-8)
}

/// A step along the gradient of the sum of squares of one parameter or both.
fn descend(params: &mut Params<f32>, tape: &mut Tape<f32>, both: bool) {
    let cx = Context::new(tape, params);
    let [a, b] = ["a", "b"].map(|name| cx.param(params.find(name).unwrap()));
    let loss = if both { a.square().sum() + b.square().sum() } else { a.square().sum() };
    loss.backward();
}

/// Parameters averages and moments come back to the bit.
#[test]
fn states_come_back_to_the_bit() {
    let mut ours = params();
    let (mut optimizer, mut average) = (adam(&ours), Ema::new(&ours, 0.9));
    let mut tape = Tape::new();
    for step in 0..5 {
        descend(&mut ours, &mut tape, step > 1);
        optimizer.step(&mut ours, &mut tape, 0.01);
        average.update(&ours);
        tape.reset();
    }
    let mut tensors = Tensors::default();
    put_params(&mut tensors, "param.", &ours);
    put_average(&mut tensors, "ema.", &ours, &average);
    put_optimizer(&mut tensors, &ours, &optimizer);
    assert_eq!(tensors.values::<u64>("moment_steps.b", &[1]).unwrap(), [3], "b has had a gradient three times");

    let mut theirs = params();
    let (mut other, mut other_average) = (adam(&theirs), Ema::new(&theirs, 0.9));
    take_params(&tensors, "param.", &mut theirs).unwrap();
    take_average(&tensors, "ema.", &theirs, average.steps(), &mut other_average).unwrap();
    take_optimizer(&tensors, &theirs, &mut other).unwrap();
    for _ in 0..2 {
        for (params, optimizer, average) in
            [(&mut ours, &mut optimizer, &mut average), (&mut theirs, &mut other, &mut other_average)]
        {
            descend(params, &mut tape, true);
            optimizer.step(params, &mut tape, 0.01);
            average.update(params);
            tape.reset();
        }
    }
    let bits = |params: &Params<f32>| params.iter().map(|(_, param)| param.value().to_vec()).collect::<Vec<_>>();
    assert_eq!(bits(&ours), bits(&theirs));
    assert!(average.state(&ours).eq(other_average.state(&theirs)));
}

/// Parameters that are not finite are refused by name.
#[test]
fn parameters_that_are_not_finite_are_refused() {
    for value in [f32::NAN, f32::INFINITY] {
        let mut broken = params();
        let id = broken.ids().next().unwrap();
        broken.value_mut(id)[0] = value;
        let mut tensors = Tensors::default();
        put_params(&mut tensors, "", &broken);
        let message = take_params(&tensors, "", &mut params()).unwrap_err().to_string();
        assert!(message.contains("tensor a: expected finite numbers"), "{message}");
    }
}

#[test]
fn optimizers_of_earlier_checkpoints_are_read() {
    let (first, second) = (vec![0.1, 0.2, 0.3, 0.4, 0.5, 0.6], vec![1.0; 6]);
    let moments = || {
        let mut tensors = Tensors::default();
        tensors.insert("optimizer.first.a", &[6], first.clone());
        tensors.insert("optimizer.second.a", &[6], second.clone());
        tensors
    };
    let mut of_moving_scenes = moments();
    of_moving_scenes.insert("optimizer.steps.a", &[1], vec![9_u64]);
    let mut of_detectors = moments();
    of_detectors.metadata.insert("vad.optimizer.steps".into(), "a=9,b=3".into());
    let expected = (9, Moments { first: first.clone(), second: second.clone() });
    for tensors in [of_moving_scenes, of_detectors] {
        assert!(tensors.tensors.keys().all(|key| is_of_optimizer(key)));
        let state = optimizer_state(&tensors).unwrap();
        assert_eq!(state.into_iter().collect::<Vec<_>>(), [("a".to_string(), expected.clone())]);
        let params = params();
        take_optimizer(&tensors, &params, &mut RAdam::new(params.ids().collect(), 0.9, 0.999, 1e-8)).unwrap();
    }
    let error = optimizer_state(&moments()).unwrap_err().to_string();
    assert!(error.contains("optimizer.steps.a"), "{error}");
    let mut strange = moments();
    strange.metadata.insert("vad.optimizer.steps".into(), "b=3".into());
    let error = optimizer_state(&strange).unwrap_err().to_string();
    assert!(error.contains("vad.optimizer.steps") && error.contains("no steps of a"), "{error}");
}

#[test]
fn a_state_of_other_parameters_is_refused_by_name() {
    let ours = params();
    let mut tensors = Tensors::default();
    tensors.insert("moment1.c", &[1], vec![0.0_f32]);
    tensors.insert("moment2.c", &[1], vec![0.0_f32]);
    tensors.insert("moment_steps.c", &[1], vec![1_u64]);
    let error = take_optimizer(&tensors, &ours, &mut adam(&ours)).unwrap_err().to_string();
    assert!(error.contains("optimizer") && error.contains('c'), "{error}");
}
