//! Equality with the official training losses, values and gradients.

use weaver_autograd::ops::straight_through;
use weaver_autograd::{Pool, Tape, Var};
use weaver_fixtures::Fixture;
use weaver_kernels::order::quantile;
use weaver_losses::*;

const TARGETS: [f64; 3] = [0.2, 0.02, 0.02];
const QUANTILES: [f64; 3] = [0.76, 0.96, 0.98];

fn file() -> Fixture {
    Fixture::open("losses_tiny.safetensors")
}

fn leaf<'t>(tape: &'t Tape<f32>, fixture: &Fixture, key: &str) -> Var<'t> {
    let (data, shape) = fixture.tensor(key);
    tape.leaf(&data, &shape[..])
}

/// [B, V, E, H, W] as rows of pixels, [B V H W, E].
fn rows(x: Var<'_>) -> Var<'_> {
    let x = x.permute(&[0, 1, 3, 4, 2]);
    x.reshape([x.shape().len() / 4, 4])
}

/// The mean over the scenes of the ranking loss of each.
fn ranking<'t>(logits: Var<'t>, fixture: &Fixture) -> Var<'t> {
    let (energy, shape) = fixture.tensor("out.energy");
    let pixels = energy.len() / shape[0];
    let rows = rows(logits);
    let scenes = energy.chunks(pixels).enumerate().map(|(b, energy)| {
        let energy = logits.tape().constant(energy, [pixels]);
        ranking_cross_entropy(rows.slice(0, b * pixels, pixels), energy, &QUANTILES, 0.1)
    });
    let count = shape[0] as f64;
    scenes.reduce(|sum, scene| sum + scene).unwrap() * (1.0 / count)
}

/// The one-hot choice with the straight-through gradient of softmax((logits + noise) / 0.5).
fn choice<'t>(logits: Var<'t>, fixture: &Fixture) -> Var<'t> {
    let soft = ((logits + leaf(logits.tape(), fixture, "in.gumbel").detach()) * 2.0).softmax(2);
    straight_through(soft, leaf(logits.tape(), fixture, "out.choice").detach())
}

#[track_caller]
fn check(fixture: &Fixture, name: &str, loss: Var<'_>, by: &str, x: Var<'_>) {
    fixture.assert_close(&format!("out.{name}"), &[loss.item()]);
    loss.backward();
    fixture.assert_close(&format!("grad.{name}.{by}"), &x.grad().unwrap());
}

#[test]
fn ranking_targets() {
    let fixture = file();
    let (energy, shape) = fixture.tensor("out.energy");
    let pixels = energy.len() / shape[0];
    let mut classes = vec![0; energy.len()];
    for (energy, classes) in energy.chunks(pixels).zip(classes.chunks_mut(pixels)) {
        frequency_targets(energy, &QUANTILES, &Pool::new(), classes);
    }
    assert_eq!(classes.iter().map(|c| *c as f32).collect::<Vec<_>>(), fixture.f32("out.target"));
    let thresholds = energy.chunks(pixels).flat_map(|scene| QUANTILES.map(|q| quantile(&mut scene.to_vec(), q)));
    fixture.assert_close("out.quantiles", &thresholds.collect::<Vec<_>>());
}

#[test]
fn quantiles_on_the_tape() {
    let fixture = Fixture::open("ops.safetensors");
    let tape = Tape::new();
    let x = leaf(&tape, &fixture, "quantile.in.x");
    let y = quantiles(x, &[0.3, 0.76, 0.96, 0.98]);
    fixture.assert_close("quantile.out", &y.value());
    y.backward_with(&fixture.f32("quantile.cot"));
    fixture.assert_close("quantile.grad.x", &x.grad().unwrap());
}

#[test]
fn ranking_and_budget() {
    let fixture = file();
    let on_logits = |name: &str, loss: &dyn for<'t> Fn(Var<'t>) -> Var<'t>| {
        let tape = Tape::new();
        let logits = leaf(&tape, &fixture, "in.logits");
        check(&fixture, name, loss(logits), "logits", logits);
    };
    on_logits("rank", &|logits| ranking(logits, &fixture));
    on_logits("budget", &|logits| share_budget(rows(choice(logits, &fixture)), &TARGETS));
    on_logits("budget_hinge_tau03", &|logits| global_budget(rows(choice(logits, &fixture)), 0.3));
    on_logits("budget_hinge_tau99", &|logits| global_budget(rows(choice(logits, &fixture)), 0.99));
    on_logits("expert_loss_001", &|logits| {
        (ranking(logits, &fixture) + share_budget(rows(choice(logits, &fixture)), &TARGETS)) * 0.01
    });
    let tape = Tape::new();
    let free = leaf(&tape, &fixture, "out.choice");
    check(&fixture, "budget", share_budget(rows(free), &TARGETS), "choice", free);
}

#[test]
fn pose_depth_image_and_total() {
    let fixture = file();
    let tape = Tape::new();
    let code = |who: &str, i: usize| leaf(&tape, &fixture, &format!("in.{who}{i}"));
    let student: Vec<_> = (0..4).map(|i| code("pose", i)).collect();
    let teacher: Vec<_> = (0..4).map(|i| code("teacher_pose", i).detach()).collect();
    let pose = huber_pose(&student, &teacher, 1.0);
    check(&fixture, "pose", pose, "pose0", student[0]);
    for (i, code) in student.iter().enumerate().skip(1) {
        fixture.assert_close(&format!("grad.pose.pose{i}"), &code.grad().unwrap());
    }

    let (height, width) = (12, 15);
    let views = |key: &str| leaf(&tape, &fixture, key);
    let flat = |x: Var<'_>| x.shape().len() / (height * width);
    let depth = views("in.render_depth");
    let teacher = views("in.teacher_depth").detach();
    let confidence = views("in.teacher_conf").detach();
    let shape = [flat(depth), height, width];
    let depth_loss = masked_depth_mse(depth.reshape(shape), teacher.reshape(shape), confidence.reshape(shape), 0.3);
    check(&fixture, "depth", depth_loss, "render_depth", depth);

    let render = views("in.render");
    let image_loss = mse(render, views("in.images").detach());
    check(&fixture, "mse", image_loss, "render", render);

    let logits = views("in.logits");
    let budget = share_budget(rows(choice(logits, &fixture)), &TARGETS);
    let total = image_loss + pose * 10.0 + depth_loss * 0.1 + (ranking(logits, &fixture) + budget) * 0.01;
    fixture.assert_close("out.total", &[total.item()]);
}
