//! Ops of training: gradients by differences, values by slow references.

use proptest::prelude::*;
use std::sync::Arc;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Tape, Var};
use weaver_codec::gaussian_rate;
use weaver_compression::{HashGrid, HashLevel, binary_through, gaussian_bits};
use weaver_kernels::random::Stream;

/// Random levels over random axes.
fn levels(seed: u64, count: usize) -> Vec<HashLevel> {
    let stream = Stream::new(seed, 0, "test.levels");
    let level = |i: u64| {
        let axes = [vec![0], vec![2, 1], vec![0, 2], vec![0, 1, 2]][stream.below(3 * i, 4)].clone();
        let (resolution, rows) = (1 + stream.below(3 * i + 1, 20) as u32, 1 << stream.below(3 * i + 2, 6));
        HashLevel { axes, resolution, rows }
    };
    (0..count as u64).map(level).collect()
}

/// Positions in the unit cube, some on its faces and some outside.
fn positions(seed: u64, count: usize) -> Vec<[f64; 3]> {
    let stream = Stream::new(seed, 0, "test.positions");
    let at = |i: u64| match stream.below(2 * i, 8) {
        0 => 0.0,
        1 => 1.0,
        2 => -0.3,
        _ => stream.uniform(2 * i + 1),
    };
    (0..count as u64).map(|i| [at(3 * i), at(3 * i + 1), at(3 * i + 2)]).collect()
}

/// The features of a position at a level, corner by corner by definition: the product over axes of 1 - |distance|.
fn by_definition(level: &HashLevel, position: [f64; 3], table: &[f64], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0; width];
    let places = position.map(|x| x.clamp(0.0, 1.0) * f64::from(level.resolution));
    let along = |axis: usize| if level.axes.contains(&axis) { 0..=level.resolution } else { 0..=0 };
    for x in along(0) {
        for y in along(1) {
            for z in along(2) {
                let point = [x, y, z];
                let near = |axis: &usize| (1.0 - (places[*axis] - f64::from(point[*axis])).abs()).max(0.0);
                let weight: f64 = level.axes.iter().map(near).product();
                let row = &table[level.row(point) * width..][..width];
                sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += weight * x);
            }
        }
    }
    sums
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, ..ProptestConfig::default() })]

    /// Promise (scenes): the hash grid, rates and signs of HAC-lite have their gradients and values.
    #[test]
    fn hash_grids_are_what_their_definition_says(count in 0_usize..5, many in 0_usize..4, width in 1_usize..4, seed: u64) {
        let (levels, positions) = (levels(seed, many), positions(seed, count));
        let grid = Arc::new(HashGrid::new(&levels, &positions));
        let table = Input::normal(seed, [grid.rows(), width]);
        gradcheck(std::slice::from_ref(&table), |x| vec![grid.look_up(x[0])]);
        let tape = Tape::<f64>::new();
        let found = grid.look_up(tape.constant(&table.data, table.shape)).to_vec();
        let mut expected = Vec::new();
        for position in &positions {
            let mut rest = &table.data[..];
            for level in &levels {
                let (own, others) = rest.split_at(level.rows * width);
                expected.extend(by_definition(level, *position, own, width));
                rest = others;
            }
        }
        prop_assert_eq!(found.len(), expected.len());
        prop_assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9), "{:?} {:?}", found, expected);
        // The form without a tape has the same bits.
        let mut plain = vec![f64::NAN; found.len()];
        grid.features(&table.data, &mut plain);
        prop_assert_eq!(plain, found);
    }

    /// Promise of `hash_grids_are_what_their_definition_says`.
    #[test]
    fn gaussian_bits_have_their_gradients(rows in 0_usize..6, columns in 1_usize..5, seed: u64) {
        let shape = [rows, columns];
        let inputs = [
            Input::uniform(seed, -2.0, 2.0, shape),
            Input::uniform(seed ^ 1, -2.0, 2.0, shape),
            Input::uniform(seed ^ 2, 0.5, 3.0, shape),
            Input::uniform(seed ^ 3, 0.2, 2.0, shape),
        ];
        let bits = |x: &[Var<'_, f64>]| gaussian_bits(x[0], x[1], x[2], x[3]).to_vec();
        // Above the least probability, whichever inputs are one tensor.
        gradcheck(&inputs, |x| vec![gaussian_bits(x[0] * 0.5, x[1] * 0.5, x[2].square() + 1.0, x[3].square() + 0.5)]);
        let tape = Tape::<f64>::new();
        let vars: Vec<_> = inputs.iter().map(|x| tape.constant(&x.data, x.shape)).collect();
        let rate = |i: usize| gaussian_rate(inputs[0].data[i], inputs[1].data[i], inputs[2].data[i], inputs[3].data[i]).bits;
        prop_assert_eq!(bits(&vars), (0..rows * columns).map(rate).collect::<Vec<_>>());
    }

    /// Promise of `hash_grids_are_what_their_definition_says`.
    #[test]
    fn signs_pass_gradients_within_one(rows in 0_usize..6, columns in 1_usize..5, seed: u64) {
        let input = Input::normal(seed, [rows, columns]);
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&input.data, input.shape);
        let y = binary_through(x);
        let slopes = Input::normal(seed ^ 1, [rows, columns]).data;
        y.backward_with(&slopes);
        let found = x.grad().unwrap_or_default();
        for (i, (x, y)) in input.data.iter().zip(y.to_vec()).enumerate() {
            prop_assert_eq!(y, if *x < 0.0 { -1.0 } else { 1.0 });
            prop_assert_eq!(found[i], if x.abs() < 1.0 { slopes[i] } else { 0.0 });
        }
    }
}
