//! Attention, placing and decoding against their formulas, one number at a time.

use glam::{DQuat, DVec3};
use proptest::prelude::*;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Pool, Tape};
use weaver_experts::{NeighborFusion, Neighbors, Origin, Parametrization, PatchOf, PixelOf, decode, place};
use weaver_nn::{Builder, Context};

/// W x + b of the layer called `name`.
fn linear(params: &Params<f64>, name: &str, x: &[f64]) -> Vec<f64> {
    let of = |kind: &str| params.get(params.find(&format!("{name}.{kind}")).unwrap()).value();
    let rows = of("weight").chunks(x.len()).zip(of("bias"));
    rows.map(|(w, b)| b + w.iter().zip(x).map(|(w, x)| w * x).sum::<f64>()).collect()
}

fn two_layers(params: &Params<f64>, name: &str, x: &[f64]) -> Vec<f64> {
    let hidden: Vec<f64> = linear(params, &format!("{name}.0"), x).iter().map(|h| h.max(0.0)).collect();
    linear(params, &format!("{name}.2"), &hidden)
}

fn assert_near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{found} against {expected}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 32))]

    #[test]
    fn fusion_is_vector_attention(n in 1..14usize, k in 0..5usize, seed in 0..1000u64) {
        const C: usize = 3;
        let mut params = Params::new();
        let fusion = NeighborFusion::new(Builder::new(&mut params, seed), C);
        let (x, means) = (Input::normal(seed, [n, C]).data, Input::normal(seed + 1, [n, 3]).data);
        let neighbors = Neighbors::search(&means, k, &Pool::new());
        let mut expected = Vec::new();
        for i in 0..n {
            let at = |v: &[f64], j: usize, width: usize| v[j * width..(j + 1) * width].to_vec();
            let query = linear(&params, "to_q", &at(&x, i, C));
            let (mut top, mut bottom) = ([0.0; C], [0.0; C]);
            for &j in &neighbors.index()[i * (k + 1)..(i + 1) * (k + 1)] {
                let j = j as usize;
                let offset: Vec<f64> = at(&means, j, 3).iter().zip(at(&means, i, 3)).map(|(j, i)| j - i).collect();
                let d = two_layers(&params, "pos_mlp", &offset);
                let (key, value) = (linear(&params, "to_k", &at(&x, j, C)), linear(&params, "to_v", &at(&x, j, C)));
                let relation: Vec<f64> = (0..C).map(|a| query[a] - key[a] + d[a]).collect();
                for (a, score) in two_layers(&params, "attn_mlp", &relation).into_iter().enumerate() {
                    top[a] += score.exp() * (value[a] + d[a]);
                    bottom[a] += score.exp();
                }
            }
            expected.extend((0..C).map(|a| top[a] / bottom[a]));
        }
        let tape = Tape::new();
        let (x, means) = (tape.constant(&x, [n, C]), tape.constant(&means, [n, 3]));
        assert_near(&fusion.forward(Context::new(&tape, &params), x, means, &neighbors).to_vec(), &expected);
    }

    #[test]
    fn placing_and_decoding_are_their_formulas(n in 1..6usize, kind in 0..3usize, seed in 0..1000u64) {
        let all = [Parametrization::published(), Parametrization::footprint(), Parametrization::patch()];
        let (parametrization, published, patch) = (all[kind], kind == 0, kind == 2);
        // Wide enough that both clamps of the raw scale are met.
        let slots = Input::uniform(seed, -5.0, 5.0, [n, 3 + 20]).data;
        let points = Input::normal(seed + 1, [n, 3]).data;
        let footprints = Input::uniform(seed + 2, 0.1, 1.0, [n]).data;
        let counts = Input::uniform(seed + 3, 0.04, 2.0, [n]).data;
        let colors = Input::uniform(seed + 4, 0.0, 1.0, [n, 3]).data;
        let extents = Input::uniform(seed + 5, 0.1, 1.0, [n, 3]).data;
        let turns: Vec<DQuat> = (Input::normal(seed + 6, [n, 4]).data.chunks(4))
            .map(|q| DQuat::from_xyzw(q[0], q[1], q[2], q[3]).normalize())
            .collect();
        let (mut means, mut scales, mut quats, mut opacities, mut sh) = (vec![], vec![], vec![], vec![], vec![]);
        for (i, raw) in slots.chunks(23).enumerate() {
            let f = footprints[i];
            let offset = DVec3::new(raw[0].tanh(), raw[1].tanh(), raw[2].tanh());
            let along = turns[i] * (2.0 * DVec3::from_slice(&extents[3 * i..]) * offset);
            for a in 0..3 {
                let reach = if published { 0.005 } else { 2.0 * f };
                means.push(points[3 * i + a] + if patch { along[a] } else { reach * offset[a] });
                let s = raw[4 + a];
                scales.push(if patch {
                    0.7 * extents[3 * i + a] * s.clamp(-3.0, 3.0).exp()
                } else if published {
                    (0.001 * s.exp().ln_1p()).min(0.4)
                } else {
                    0.7 * f * s.clamp(-3.0, 3.0).exp() / counts[i].sqrt()
                });
            }
            opacities.push(1.0 / (1.0 + (-raw[3]).exp()));
            let q = [raw[7], raw[8], raw[9], raw[10] + if published { 0.0 } else { 1.0 }];
            let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt() + 1e-8;
            let turned = turns[i] * DQuat::from_xyzw(q[0], q[1], q[2], q[3]);
            let q = if patch { turned.to_array() } else { q };
            quats.extend([q[3], q[0], q[1], q[2]].map(|x| x / norm));
            for k in 0..4 {
                for c in 0..3 {
                    let own = if !published && k == 0 { (colors[3 * i + c] - 0.5) / 0.282_094_791_773_878_14 } else { 0.0 };
                    sh.push(own + raw[11 + 4 * c + k] * if k == 0 { 1.0 } else { 0.025 });
                }
            }
        }
        let tape = Tape::new();
        let slots = tape.constant(&slots, [n, 23]);
        let footprint = tape.constant(&footprints, [n]);
        let (local_count, color) = (tape.constant(&counts, [n]), tape.constant(&colors, [n, 3]));
        let origin = if patch {
            let turns: Vec<f64> = turns.iter().flat_map(|q| [q.w, q.x, q.y, q.z]).collect();
            let (extents, rotation) = (tape.constant(&extents, [n, 3]), tape.constant(&turns, [n, 4]));
            Origin::Patch(PatchOf { extents, rotation, color })
        } else {
            Origin::Pixel(PixelOf { footprint, local_count, color })
        };
        let found = place(tape.constant(&points, [n, 3]), slots, Some(origin), parametrization);
        assert_near(&found.to_vec(), &means);
        let d = decode(found, slots.slice(1, 3, 20), 1, Some(origin), parametrization);
        assert_near(&d.scales.to_vec(), &scales);
        assert_near(&d.quats.to_vec(), &quats);
        assert_near(&d.opacities.to_vec(), &opacities);
        assert_near(&d.colors.to_vec(), &sh);
    }
}
