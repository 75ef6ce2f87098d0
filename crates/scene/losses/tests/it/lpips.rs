//! Perceptual distance: parity with the lpips package, and messages about weights that do not fit.

use crate::weights::weights;
use weaver_autograd::Tape;
use weaver_fixtures::Fixture;
use weaver_losses::Lpips;
use weaver_losses::lpips::{Network, Tensors};
use weaver_losses::metrics::PerceptualDistance;

fn parity(name: &str, network: Network) {
    let file = format!("lpips_{name}_f16.safetensors");
    let Some(tensors) = weights(&file) else { return };
    let lpips = Lpips::<f32>::from_tensors(network, &tensors, &file).unwrap();
    let fixture = Fixture::open("metrics.safetensors");
    for i in 0..3 {
        let (a, shape) = fixture.tensor(&format!("in.a{i}"));
        let b = fixture.f32(&format!("in.b{i}"));
        let tape = Tape::<f32>::new();
        let shape = [1, shape[0], shape[1], shape[2]];
        let (target, render) = (tape.constant(&a, shape), tape.leaf(&b, shape));
        let layers = lpips.layers(target, render).map(|term| term.item());
        fixture.assert_close(&format!("out.lpips_{name}{i}_layers"), &layers);
        let distance = lpips.between(&a, &b, [shape[2], shape[3]]);
        fixture.assert_close(&format!("out.lpips_{name}{i}"), &[distance as f32]);
        if i < 2 {
            lpips.distance(target, render).backward();
            fixture.assert_close(&format!("grad.lpips_{name}{i}.b"), &render.grad().unwrap());
        }
    }
}

#[test]
fn alex_equals_the_reference() {
    parity("alex", Network::Alex);
}

#[test]
fn vgg_equals_the_reference() {
    parity("vgg", Network::Vgg);
}

#[test]
fn weights_that_do_not_fit_are_named() {
    let mut tensors = Tensors::new();
    let load = |tensors: &Tensors| {
        Lpips::<f32>::from_tensors(Network::Alex, tensors, "alex.safetensors").unwrap_err().to_string()
    };
    assert_eq!(
        load(&tensors),
        "alex.safetensors: `net.slice1.0.weight`: expected a tensor of shape [64, 3, 11, 11], found none"
    );
    tensors.insert("net.slice1.0.weight".to_owned(), (vec![64, 3, 3, 3], vec![0.0; 64 * 27]));
    assert_eq!(
        load(&tensors),
        "alex.safetensors: `net.slice1.0.weight`: expected a tensor of shape [64, 3, 11, 11], \
         found one of shape [64, 3, 3, 3]"
    );
}
