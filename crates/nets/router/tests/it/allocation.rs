//! Allocations: exact counts, the recipe's formulas, and names.

use proptest::prelude::*;
use std::sync::LazyLock;
use weaver_autograd::{Pool, Tape};
use weaver_kernels::random::Stream;
use weaver_router::{
    Allocation, AllocationError, AllocationKind, AllocationRequest, Argmax, Dithered, Fixed, Grid, Masked, Random,
    Sampled, TrainingMix,
};

/// Shared by all tests: memory that was used before must not change a result.
static POOL: LazyLock<Pool> = LazyLock::new(Pool::new);

fn request<'a>(logits: &'a [f64], energy: &'a [f64], size: [usize; 3], seed: u64) -> AllocationRequest<'a, f64> {
    let [views, height, width] = size;
    let stream = Stream::new(seed, 0, "allocation");
    AllocationRequest {
        logits,
        energy,
        photos: &[],
        depth: None,
        views,
        height,
        width,
        stream,
        inside: None,
        gumbel: None,
        pool: &POOL,
    }
}

fn normals(seed: u64, n: usize) -> Vec<f64> {
    let stream = Stream::new(seed, 1, "numbers");
    (0..n as u64).map(|i| stream.normal(i)).collect()
}

fn size() -> impl Strategy<Value = [usize; 3]> {
    (1..6usize, 1..20usize, 1..20usize).prop_map(|(v, h, w)| [v, h, w])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn budgets_are_met_exactly(size in size(), budget in 0.0..=1.0f64, gamma in 0.0..2.0f64, seed in 0..1000u64) {
        let pixels = size.iter().product::<usize>();
        let (logits, energy) = (normals(seed, 4 * pixels), vec![1.0; pixels]);
        let request = request(&logits, &energy, size, seed);
        let expected = (budget * pixels as f64).floor() as usize;
        let all: [Box<dyn Allocation<f64>>; 3] =
            [Box::new(Dithered { budget, gamma }), Box::new(Grid { budget }), Box::new(Random { budget })];
        for allocation in all {
            let assignment = allocation.allocate(&request);
            prop_assert_eq!(assignment.count(), expected, "{:?}", allocation);
            prop_assert!(assignment.expert.iter().all(|&e| e <= 1) && assignment.gate.is_none());
            prop_assert_eq!(&*allocation.allocate(&request).expert, &*assignment.expert);
        }
    }

    /// Only pixels that count get gaussians and the budget is for these.
    #[test]
    fn budgets_are_for_pixels_that_count(
        size in size(), budget in 0.0..=1.0f64, part in 0.0..=1.0f64, seed in 0..1000u64
    ) {
        let pixels = size.iter().product::<usize>();
        let (logits, energy) = (normals(seed, 4 * pixels), vec![1.0; pixels]);
        let inside: Vec<bool> = (0..pixels as u64).map(|p| Stream::new(seed, 2, "mask").uniform::<f64>(p) < part).collect();
        let counted = inside.iter().filter(|inside| **inside).count();
        let request = request(&logits, &energy, size, seed);
        let exact: [&dyn Allocation<f64>; 3] = [&Dithered { budget, gamma: 0.7 }, &Grid { budget }, &Random { budget }];
        for among in exact {
            let assignment = Masked { among, inside: Some(&inside) }.allocate(&request);
            prop_assert!(assignment.expert.iter().zip(&inside).all(|(e, inside)| *inside || *e == 0), "{:?}", among);
            prop_assert_eq!(assignment.count(), (budget * counted as f64).floor() as usize, "{:?}", among);
        }
        let others: [&dyn Allocation<f64>; 4] = [&Sampled, &Argmax, &Fixed { expert: 2 }, &TrainingMix::default()];
        for among in others {
            let masked = Masked { among, inside: Some(&inside) }.allocate(&request);
            prop_assert!(masked.expert.iter().zip(&inside).all(|(e, inside)| *inside || *e == 0), "{:?}", among);
            let free = Masked { among, inside: None }.allocate(&request);
            prop_assert_eq!(&*free.expert, &*among.allocate(&request).expert);
        }
    }

    #[test]
    fn dithering_is_the_recipe(
        views in 1..6usize, tiles in (1..4usize, 1..4usize), budget in 0.0..=1.0f64, seed in 0..1000u64
    ) {
        let (height, width) = (8 * tiles.0, 8 * tiles.1);
        let pixels = views * height * width;
        let (logits, energy) = (normals(seed, 4 * pixels), vec![1.0; pixels]);
        let found = Dithered { budget, gamma: 0.7 }.allocate(&request(&logits, &energy, [views, height, width], seed));

        // The pattern tiled over the whole image, then rolled down and right.
        let mut bayer = vec![vec![0.0]];
        for _ in 0..3 {
            let n = bayer.len();
            let quadrant = [[0.0, 2.0], [3.0, 1.0]];
            let row = |r: usize| (0..2 * n).map(|c| 4.0 * bayer[r % n][c % n] + quadrant[r / n][c / n]).collect();
            bayer = (0..2 * n).map(row).collect::<Vec<Vec<f64>>>();
        }
        let mut scored = Vec::new();
        for view in 0..views {
            let (down, right) = [(0, 0), (3, 5), (6, 2), (1, 7)][view % 4];
            let mut rolled = vec![vec![0.0; width]; height];
            for row in 0..height {
                for column in 0..width {
                    rolled[(row + down) % height][(column + right) % width] = (bayer[row % 8][column % 8] + 0.5) / 64.0;
                }
            }
            for row in rolled {
                for threshold in row {
                    let at = 4 * scored.len();
                    let score = 0.7 * (logits[at + 1] - logits[at]) - f64::ln(threshold);
                    scored.push((score, scored.len()));
                }
            }
        }
        // Stable: equal scores stay in pixel order.
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut expected = vec![0; pixels];
        scored[..(budget * pixels as f64).floor() as usize].iter().for_each(|&(_, pixel)| expected[pixel] = 1);
        prop_assert_eq!(&*found.expert, &*expected);
    }
}

#[test]
fn equal_scores_go_to_the_first_pixels() {
    // One view of one pixel per tile corner: all thresholds of a 1 x 1 image are the same, up to the shift of the view.
    let (logits, energy) = ([0.0; 32], [1.0; 8]);
    let request = request(&logits, &energy, [8, 1, 1], 0);
    let expert = Grid { budget: 0.5 }.allocate(&request).expert;
    // Views v and v + 4 share their threshold, the lower index is taken first.
    for view in 0..4 {
        assert!(expert[view] >= expert[view + 4]);
    }
    assert_eq!(expert.iter().map(|&e| usize::from(e)).sum::<usize>(), 4);
}

/// In views whose height is no multiple of the pattern's.
#[test]
fn every_view_starts_with_its_first_row() {
    let size = [5, 5, 7];
    let (logits, energy) = (vec![0.0; 4 * 175], vec![1.0; 175]);
    for budget in [0.2, 0.5, 0.8] {
        let expert = Grid { budget }.allocate(&request(&logits, &energy, size, 0)).expert;
        // Views 0 and 4 have the same pattern; at one threshold at most, budget may be left for the first alone.
        let differ = (0..35).filter(|pixel| expert[*pixel] != expert[4 * 35 + pixel]).count();
        assert!(differ <= 1, "budget {budget}: {differ} pixels");
    }
}

#[test]
fn a_grid_keeps_no_hole_wider_than_its_spacing() {
    let size = [1, 16, 16];
    let (logits, energy) = (vec![0.0; 4 * 256], vec![1.0; 256]);
    let expert = Grid { budget: 0.25 }.allocate(&request(&logits, &energy, size, 0)).expert;
    for row in 0..8 {
        for column in 0..8 {
            let block = [0, 1].map(|r| [0, 1].map(|c| expert[(2 * row + r) * 16 + 2 * column + c])).concat();
            assert_eq!(block.iter().sum::<u8>(), 1, "block {row}, {column}");
        }
    }
}

#[test]
fn the_density_follows_the_logit() {
    let size = [2, 32, 32];
    let pixels = 2048;
    // The right half prefers more.
    let logits: Vec<f64> = (0..pixels).flat_map(|p| [0.0, if p % 32 >= 16 { 1.0 } else { 0.0 }, 9.0, 9.0]).collect();
    let energy = vec![1.0; pixels];
    let expert = Dithered { budget: 0.3, gamma: 1.0 }.allocate(&request(&logits, &energy, size, 0)).expert;
    let right = expert.iter().enumerate().filter(|(p, e)| p % 32 >= 16 && **e == 1).count() as f64;
    let left = expert.iter().map(|&e| f64::from(e)).sum::<f64>() - right;
    // e times as many, up to half a level of the 64 thresholds on either side; a level is 16 pixels of each half.
    let e = std::f64::consts::E;
    assert!((right - e * left).abs() <= 16.0 * 0.5 * (1.0 + e), "{right} : {left}");
}

#[test]
fn samples_follow_the_softmax_and_given_noise_is_used() {
    let pixels = 20_000;
    let row = [2.5, 2.0, 0.0, 0.0];
    let (logits, energy) = (row.repeat(pixels), vec![1.0; pixels]);
    let mut request = request(&logits, &energy, [1, 100, 200], 3);
    let sampled = Sampled.allocate(&request);
    let total: f64 = row.iter().map(|l| l.exp()).sum();
    for (e, l) in row.iter().enumerate() {
        let share = sampled.expert.iter().filter(|&&x| usize::from(x) == e).count() as f64 / pixels as f64;
        assert!((share - l.exp() / total).abs() < 0.015, "expert {e}: {share}");
    }
    let noise = vec![0.0; logits.len()];
    request.gumbel = Some(&noise);
    assert_eq!(*Sampled.allocate(&request).expert, *Argmax.allocate(&request).expert);
    assert!(Argmax.allocate(&request).expert.iter().all(|&e| e == 0));
    assert_eq!(Fixed { expert: 2 }.allocate(&request).count(), 2 * pixels);

    // The choice that a gradient passes is the sampled one; a fixed one passes none.
    let tape = Tape::new();
    let logits = tape.constant(request.logits, [pixels, 4]);
    let choice = sampled.choice(logits, 0.5).unwrap().to_vec();
    assert!(choice.chunks(4).zip(sampled.expert.iter()).all(|(row, e)| row[usize::from(*e)] == 1.0));
    assert!(Fixed { expert: 2 }.allocate(&request).choice(logits, 0.5).is_none());
}

#[test]
fn of_equal_logits_the_first_wins() {
    let (logits, energy) = ([0.5, 2.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0], [1.0; 2]);
    assert_eq!(*Argmax.allocate(&request(&logits, &energy, [1, 1, 2], 0)).expert, [1, 0]);
}

#[test]
fn training_draws_budget_energy_and_pattern() {
    let size = [4, 24, 32];
    let pixels = 4 * 24 * 32;
    let energy: Vec<f64> = (0..pixels).map(|p| if p % 32 < 16 { 0.0 } else { 0.5 }).collect();
    let logits = vec![0.0; 4 * pixels];
    let mix = TrainingMix { dense: 0.0, ..TrainingMix::default() };
    let mut counts = std::collections::BTreeMap::new();
    let (mut even, mut uneven) = (0, 0);
    for seed in 0..200 {
        let assignment = mix.allocate(&request(&logits, &energy, size, seed));
        *counts.entry(assignment.count()).or_insert(0) += 1;
        let right = assignment.expert.iter().enumerate().filter(|(p, e)| p % 32 >= 16 && **e == 1).count();
        let share = right as f64 / assignment.count() as f64;
        assert!(share > 0.4, "energy never repels: {share}");
        if share < 0.53 { even += 1 } else { uneven += 1 }
    }
    let expected = [0.25, 0.4, 0.7].map(|share| (share * pixels as f64) as usize);
    assert!(counts.keys().copied().eq(expected));
    assert!((80..120).contains(&counts[&expected[1]]), "two of the four draws are 40 %: {counts:?}");
    assert!(even > 40 && uneven > 80, "{even} even, {uneven} uneven");
}

/// Promise of `every_preset_trains`.
#[test]
fn some_steps_of_training_give_every_pixel_as_many() {
    let (logits, energy) = (vec![0.0; 4 * 12], vec![1.0; 12]);
    let counts = |dense: f64| -> Vec<usize> {
        let mix = TrainingMix { dense, ..TrainingMix::default() };
        (0..300).map(|seed| mix.allocate(&request(&logits, &energy, [1, 3, 4], seed)).count()).collect()
    };
    let (never, some, always) = (counts(0.0), counts(0.25), counts(1.0));
    assert!(never.iter().all(|count| *count < 12));
    for expert in 1..=3 {
        let of = |counts: &[usize]| counts.iter().filter(|count| **count == 12 * expert).count();
        assert!((70..130).contains(&of(&always)) && (10..40).contains(&of(&some)), "{} {}", of(&always), of(&some));
    }
    // The other steps stay the same.
    assert!(never.iter().zip(&some).all(|(never, some)| never == some || some % 12 == 0));
}

/// Draws of each step, and the pixels with the highest ln(energy + 0.02)^gamma / threshold, written out pixel by pixel.
#[test]
fn training_is_the_recipe() {
    let [views, height, width] = [2, 11, 13];
    let pixels = views * height * width;
    let (logits, energy) = (vec![0.0; 4 * pixels], normals(1, pixels).iter().map(|x| x.abs()).collect::<Vec<_>>());
    let mix = TrainingMix { strongest: 0.9, dense: 0.0, ..TrainingMix::default() };
    for seed in 0..20 {
        let request = request(&logits, &energy, [views, height, width], seed);
        let [step, noise, ties] = [0, 1, 2].map(|purpose| request.stream.fork(purpose));
        let count = (mix.budgets[step.below(0, 4)] * pixels as f64) as usize;
        let gamma = if step.uniform::<f64>(1) < 0.3 { 0.0 } else { 0.9 * step.uniform::<f64>(2) };
        let (down, right) = (step.below(4, 8), step.below(5, 8));
        let score = |pixel: usize| {
            let (row, column) = (pixel / width % height, pixel % width);
            let pattern = (0..3).fold(0, |rank, bit| {
                let [r, c] = [row + 8 - down, column + 8 - right].map(|at| at >> bit & 1);
                4 * rank + [[0, 2], [3, 1]][r][c]
            });
            let noisy = step.uniform::<f64>(3) < 0.5;
            let threshold = if noisy { noise.uniform(pixel as u64) } else { (f64::from(pattern) + 0.5) / 64.0 };
            gamma * (energy[pixel] + 0.02).ln() - (threshold + 1e-6 * ties.uniform::<f64>(pixel as u64)).ln()
        };
        let mut order: Vec<usize> = (0..pixels).collect();
        order.sort_by(|a, b| score(*b).total_cmp(&score(*a)));
        let mut expected = vec![0; pixels];
        order[..count].iter().for_each(|pixel| expected[*pixel] = 1);
        assert_eq!(&*mix.allocate(&request).expert, &*expected, "seed {seed}");
    }
}

#[test]
fn a_budget_of_nothing_or_all_is_met() {
    let (logits, energy) = (normals(1, 4 * 12), vec![1.0; 12]);
    for (budget, expected) in [(0.0, 0), (1.0, 12)] {
        assert_eq!(Grid { budget }.allocate(&request(&logits, &energy, [1, 3, 4], 0)).count(), expected);
    }
}

#[test]
fn kinds_have_names_and_limits() {
    for name in ["sampled", "argmax", "dithered", "grid", "random", "fixed:0", "fixed:3"] {
        let kind: AllocationKind = name.parse().unwrap();
        assert_eq!(kind.to_string(), name);
        assert_eq!(kind.has_budget(), ["dithered", "grid", "random"].contains(&name));
        assert!(kind.allocation::<f32>(0.4, 4).is_ok());
        assert_eq!(kind.allocation::<f32>(1.5, 4).is_err(), kind.has_budget());
    }
    for name in ["", "Sampled", "fixed", "fixed:", "fixed:-1", "fixed:300"] {
        assert_eq!(name.parse::<AllocationKind>(), Err(AllocationError::Unknown(name.into())));
    }
    let error = AllocationKind::Fixed(4).allocation::<f32>(0.4, 4).unwrap_err();
    assert!(error.to_string().contains("at most 3"), "{error}");
    assert!(AllocationKind::Grid.allocation::<f32>(f64::NAN, 4).is_err());
}
