//! The training losses.

use super::reference::Reference;
use weaver_autograd::ops::huber;
use weaver_autograd::{Pool, Real, Tape, Var};
use weaver_kernels::order::quantile;
use weaver_losses::*;
use weaver_router::gumbel_softmax_straight_through;
use weaver_wavelet::{EnergyMap, Wavelet};

/// [B, V, E, H, W] as rows of pixels, [B V H W, E].
fn rows<T: Real>(x: Var<'_, T>) -> Var<'_, T> {
    let experts = x.shape()[2];
    let x = x.permute(&[0, 1, 3, 4, 2]);
    x.reshape([x.shape().len() / experts, experts])
}

/// Inputs of the losses.
struct Setting<'f> {
    file: &'f Reference,
    quantiles: Vec<f64>,
    targets: Vec<f64>,
}

fn numbers(file: &Reference, key: &str) -> Vec<f64> {
    let list = file.config[key].as_array().unwrap_or_else(|| panic!("config {key}: expected a list"));
    list.iter().map(|v| v.as_f64().unwrap_or_else(|| panic!("config {key}: expected numbers"))).collect()
}

impl Setting<'_> {
    /// The mean over the scenes of the ranking loss of each.
    fn ranking<'t, T: Real>(&self, logits: Var<'t, T>) -> Var<'t, T> {
        let (energy, scenes) = (self.file.data::<T>("out.energy"), self.file.size("batch"));
        let (rows, pixels) = (rows(logits), energy.len() / scenes);
        let smoothing = self.file.number("label_smoothing");
        let losses = energy.chunks(pixels).enumerate().map(|(b, energy)| {
            let energy = logits.tape().constant(energy, [pixels]);
            ranking_cross_entropy(rows.slice(0, b * pixels, pixels), energy, &self.quantiles, smoothing)
        });
        losses.reduce(|sum, loss| sum + loss).expect("at least one scene") * (1.0 / scenes as f64)
    }

    /// The one-hot choice `[P, E]`.
    fn choice<'t, T: Real>(&self, logits: Var<'t, T>) -> Var<'t, T> {
        let noise = rows(self.file.constant(logits.tape(), "in.gumbel"));
        gumbel_softmax_straight_through(rows(logits), Some(noise), self.file.number("temperature"))
    }

    fn budget<'t, T: Real>(&self, choice: Var<'t, T>) -> Var<'t, T> {
        share_budget(choice, &self.targets) * (self.file.number("budget_factor") / 5.0)
    }

    /// Both losses on routing, weighted.
    fn expert<'t, T: Real>(&self, logits: Var<'t, T>) -> Var<'t, T> {
        (self.ranking(logits) + self.budget(self.choice(logits))) * self.file.number("weights.expert")
    }

    /// A loss of the logits, its value and gradient.
    fn on_logits<T: Real>(&self, name: &str, loss: impl for<'t> Fn(Var<'t, T>) -> Var<'t, T>) {
        let tape = Tape::<T>::new();
        let logits = self.file.leaf(&tape, "in.logits");
        let value = loss(logits);
        self.file.check(&format!("out.{name}"), &[value.item()]);
        self.file.backward(value);
        self.file.check_grad(&format!("grad.{name}.logits"), logits);
    }
}

pub fn run<T: Real>(file: Reference) -> Reference {
    let (scenes, views) = (file.size("batch"), file.size("views"));
    let (height, width) = (file.size("image_h"), file.size("image_w"));
    let quantiles = numbers(&file, "quantiles");
    let setting = Setting { file: &file, quantiles, targets: numbers(&file, "budget_targets") };

    let mut energy = vec![T::ZERO; scenes * views * height * width];
    EnergyMap::<T>::new(Wavelet::Db2, [height, width]).compute(&file.data("in.images"), &Pool::new(), &mut energy);
    file.check("out.energy", &energy);
    let expected: Vec<T> = file.data("out.energy");
    let mut classes = vec![0; expected.len()];
    let pixels = expected.len() / scenes;
    for (energy, classes) in expected.chunks(pixels).zip(classes.chunks_mut(pixels)) {
        frequency_targets(energy, &setting.quantiles, &Pool::new(), classes);
    }
    file.check_indices("out.target", &classes);
    let thresholds =
        expected.chunks(pixels).flat_map(|scene| setting.quantiles.iter().map(|q| quantile(&mut scene.to_vec(), *q)));
    file.check("out.quantiles", &thresholds.collect::<Vec<_>>());

    setting.on_logits::<T>("rank", |logits| setting.ranking(logits));
    setting.on_logits::<T>("budget", |logits| setting.budget(setting.choice(logits)));
    setting.on_logits::<T>("budget_hinge_tau03", |logits| global_budget(setting.choice(logits), 0.3));
    setting.on_logits::<T>("budget_hinge_tau99", |logits| global_budget(setting.choice(logits), 0.99));
    setting.on_logits::<T>("expert_loss_001", |logits| setting.expert(logits));
    let tape = Tape::<T>::new();
    let free = file.leaf(&tape, "out.choice");
    file.backward(setting.budget(rows(free)));
    file.check_grad("grad.budget.choice", free);

    let tape = Tape::<T>::new();
    let logits = file.leaf(&tape, "in.logits");
    let choice = setting.choice(logits);
    let experts = choice.shape()[1];
    let planes = choice.reshape([scenes, views, height, width, experts]).permute(&[0, 1, 4, 2, 3]);
    file.check("out.choice", &planes.value());
    file.check("out.choice_mean", &choice.mean_axis(0).value());

    let codes = |who: &str| -> Vec<Var<'_, T>> {
        (0..)
            .map(|i| format!("in.{who}{i}"))
            .take_while(|key| file.has(key))
            .map(|key| file.leaf(&tape, &key))
            .collect()
    };
    let (student, teacher) = (codes("pose"), codes("teacher_pose"));
    let teacher: Vec<_> = teacher.iter().map(|code| code.detach()).collect();
    let delta = file.number("huber_delta");
    file.check("out.huber_elementwise", &huber(student[0], teacher[0], delta).value());
    let pose = huber_pose(&student, &teacher, delta);
    file.check("out.pose", &[pose.item()]);
    file.backward(pose);
    for (i, code) in student.iter().enumerate() {
        file.check_grad(&format!("grad.pose.pose{i}"), *code);
    }

    let maps = [scenes * views, height, width];
    let render_depth = file.leaf(&tape, "in.render_depth");
    let teacher_depth = file.constant(&tape, "in.teacher_depth").reshape(maps);
    let confidence = file.constant(&tape, "in.teacher_conf");
    let q = file.number("conf_quantile");
    let thresholds: Vec<T> =
        confidence.value().chunks(height * width).map(|view| quantile(&mut view.to_vec(), q)).collect();
    file.check("out.conf_threshold", &thresholds);
    let trusted: Vec<u32> = confidence
        .value()
        .chunks(height * width)
        .zip(&thresholds)
        .flat_map(|(view, threshold)| view.iter().map(|c| u32::from(c > threshold)).collect::<Vec<_>>())
        .collect();
    file.check_indices("out.conf_mask", &trusted);
    let depth = masked_depth_mse(render_depth.reshape(maps), teacher_depth, confidence.reshape(maps), q);
    file.check("out.depth", &[depth.item()]);
    file.backward(depth);
    file.check_grad("grad.depth.render_depth", render_depth);

    let render = file.leaf(&tape, "in.render");
    let image = mse(render, file.constant(&tape, "in.images"));
    file.check("out.mse", &[image.item()]);
    file.backward(image);
    file.check_grad("grad.mse.render", render);

    let weight = |name: &str| file.number(&format!("weights.{name}"));
    let total = image * weight("mse") + pose * weight("pose") + depth * weight("depth") + setting.expert(logits);
    file.check("out.total", &[total.item()]);
    file
}
