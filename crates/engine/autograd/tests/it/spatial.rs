//! Resizing, box filtering and rotary embedding: all linear.

use crate::strategies::cases;
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_autograd::{Tape, ops::RopeTable};

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn resizing(n in 0usize..3, h in 1usize..7, w in 1usize..7, hh in 1usize..9, ww in 1usize..9, align: bool, seed: u64) {
        let shape = [n, 2, h, w];
        adjoint_check(shape, seed, |x| x.bilinear(hh, ww, align));
        adjoint_check(shape, seed, |x| x.bicubic(hh, ww));
        adjoint_check(shape, seed, |x| x.bicubic_antialias(hh, ww));
        gradcheck(&[Input::normal(seed, shape)], |x| {
            vec![x[0].bilinear(hh, ww, align), x[0].bicubic(hh, ww), x[0].bicubic_antialias(hh, ww)]
        });
        // Constants stay.
        let tape = Tape::<f64>::new();
        let ones = tape.constant(&vec![1.0; n * 2 * h * w], shape);
        let resized = [ones.bilinear(hh, ww, align), ones.bicubic(hh, ww), ones.bicubic_antialias(hh, ww)];
        prop_assert!(resized.iter().all(|y| y.to_vec().iter().all(|y| (y - 1.0).abs() < 1e-13)));
    }

    #[test]
    fn box_filter(h in 1usize..7, w in 1usize..7, half in 0usize..3, seed: u64) {
        let k = 2 * half + 1;
        let x = Input::normal(seed, [1, 2, h, w]);
        adjoint_check(x.shape, seed, |x| x.avg_pool_same(k));
        gradcheck(std::slice::from_ref(&x), |x| vec![x[0].avg_pool_same(k)]);
        let tape = Tape::<f64>::new();
        for (at, y) in tape.constant(&x.data, x.shape).avg_pool_same(k).to_vec().into_iter().enumerate() {
            let (plane, i, j) = (at / (h * w), at / w % h, at % w);
            let rows = i.saturating_sub(half)..(i + half + 1).min(h);
            let inside: Vec<f64> = rows
                .flat_map(|i| (j.saturating_sub(half)..(j + half + 1).min(w)).map(move |j| (i, j)))
                .map(|(i, j)| x.data[(plane * h + i) * w + j])
                .collect();
            prop_assert!((y - inside.iter().sum::<f64>() / inside.len() as f64).abs() < 1e-12);
        }
    }

    #[test]
    fn rotary_embedding(batch in 0usize..3, heads in 1usize..3, quarter in 1usize..3, positions in prop::collection::vec([0usize..5, 0usize..5], 1..5), seed: u64) {
        let table = RopeTable::new(&positions, 4 * quarter, 100.0);
        let shape = [batch, positions.len(), heads, 4 * quarter];
        adjoint_check(shape, seed, |x| x.rope2d(&table));
        gradcheck(&[Input::normal(seed, shape)], |x| vec![x[0].rope2d(&table)]);
        // A rotation keeps lengths.
        let tape = Tape::<f64>::new();
        let x = tape.constant(&Input::normal(seed, shape).data, shape);
        let lengths = |x: weaver_autograd::Var<'_, f64>| x.square().sum_axis(3).to_vec();
        for (before, after) in lengths(x).into_iter().zip(lengths(x.rope2d(&table))) {
            prop_assert!((before - after).abs() < 1e-12);
        }
    }
}
