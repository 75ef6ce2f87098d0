//! Image metrics, and LPIPS with its gradient.

use super::reference::Reference;
use std::path::Path;
use weaver_autograd::{Real, Tape};
use weaver_io::safetensors::Tensors as File;
use weaver_losses::lpips::{Network, Tensors};
use weaver_losses::{Covariance, Lpips, metrics, mse, ssim_with};

/// LPIPS with the weights in a folder, or why not.
pub fn lpips<T: Real>(name: &str, network: Network, folder: Option<&Path>) -> Result<Lpips<T>, String> {
    let folder = folder.ok_or("no folder of LPIPS weights; give --weights")?;
    let path = folder.join(format!("lpips_{name}_f16.safetensors"));
    let file = File::read(&path).map_err(|e| e.to_string())?;
    let widened = |(key, tensor): (&String, &weaver_io::safetensors::Tensor)| {
        tensor.data.widened().map(|data| (key.clone(), (tensor.shape.clone(), data.into_owned())))
    };
    let tensors: Tensors = file.tensors.iter().filter_map(widened).collect();
    Lpips::from_tensors(network, &tensors, &path.display().to_string()).map_err(|e| e.to_string())
}

pub fn run<T: Real>(file: Reference, weights: Option<&Path>) -> Reference {
    let pairs = (0..).take_while(|i| file.has(&format!("in.a{i}"))).count();
    for i in 0..pairs {
        let (a, b): (Vec<T>, Vec<T>) = (file.data(&format!("in.a{i}")), file.data(&format!("in.b{i}")));
        let shape = file.shape(&format!("in.a{i}"));
        let images = [1, shape[0], shape[1], shape[2]];
        let tape = Tape::<T>::new();
        let (target, render) = (tape.constant(&a, images), tape.leaf(&b, images));
        let clamped: [Vec<T>; 2] = [&a, &b].map(|x| x.iter().map(|x| x.max(T::ZERO).min(T::ONE)).collect());
        file.check(&format!("out.psnr{i}"), &[metrics::psnr(&clamped[0], &clamped[1])]);
        file.check(&format!("out.mse{i}"), &[mse(target, render).item()]);
        let similarity = metrics::ssim(&a, &b, [shape[0], shape[1], shape[2]]);
        file.check(&format!("out.ssim{i}"), &[similarity]);
        let gradient = format!("grad.ssim{i}.b");
        if file.has(&gradient) {
            file.backward(ssim_with(target, render, Covariance::Sample));
            file.check_grad(&gradient, render);
        }
    }
    for (name, network) in [("alex", Network::Alex), ("vgg", Network::Vgg)] {
        match lpips::<T>(name, network, weights) {
            Ok(lpips) => (0..pairs).for_each(|i| distance(&file, &lpips, name, i)),
            Err(message) => {
                for key in file.keys().filter(|key| key.contains(&format!("lpips_{name}"))) {
                    file.fail(key, message.clone());
                }
            }
        }
    }
    file
}

fn distance<T: Real>(file: &Reference, lpips: &Lpips<T>, name: &str, i: usize) {
    let shape = file.shape(&format!("in.a{i}"));
    let images = [1, shape[0], shape[1], shape[2]];
    let tape = Tape::<T>::new();
    let target = tape.constant(&file.data(&format!("in.a{i}")), images);
    let render = tape.leaf(&file.data(&format!("in.b{i}")), images);
    let layers = lpips.layers(target, render).map(|term| term.item());
    file.check(&format!("out.lpips_{name}{i}_layers"), &layers);
    let distance = lpips.distance(target, render);
    file.check(&format!("out.lpips_{name}{i}"), &[distance.item()]);
    let gradient = format!("grad.lpips_{name}{i}.b");
    if file.has(&gradient) {
        file.backward(distance);
        file.check_grad(&gradient, render);
    }
}
