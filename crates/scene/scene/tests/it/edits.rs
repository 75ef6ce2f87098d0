//! Gaussians chosen, joined, cropped and pruned.

use weaver_scene::{Gaussians, Region};

/// A row of `n` Gaussians along x, a unit apart; each has its number in every harmonic and as its opacity logit.
fn row(n: usize, degree: usize) -> Gaussians {
    let k = 3 * (degree + 1) * (degree + 1);
    Gaussians {
        means: (0..n).map(|i| [i as f32, 0.0, 0.0]).collect(),
        log_scales: vec![[0.0, -1.0, -2.0]; n],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logits: (0..n).map(|i| i as f32).collect(),
        sh: (0..n * k).map(|i| (i / k) as f32).collect(),
        degree,
    }
}

#[test]
fn selection_takes_every_field_along() {
    let chosen = row(5, 1).select(&[3, 0, 3]);
    assert!(chosen.lengths_agree());
    assert_eq!((chosen.means[0], &chosen.opacity_logits[..]), ([3.0, 0.0, 0.0], &[3.0, 0.0, 3.0][..]));
    assert!(chosen.sh[..12].iter().all(|x| *x == 3.0) && chosen.sh[12..24].iter().all(|x| *x == 0.0));
}

#[test]
fn degrees_fall_and_rise() {
    let two = row(3, 2);
    let one = two.with_degree(1);
    assert!(one.lengths_agree() && one.sh[..12] == two.sh[..12] && one.sh[12..24] == two.sh[27..39]);
    let raised = one.with_degree(2);
    assert!(raised.lengths_agree() && raised.sh[39..54].iter().all(|x| *x == 0.0));
    assert_eq!(raised.with_degree(1), one);
}

#[test]
fn parts_are_joined_at_the_largest_degree() {
    let joined = Gaussians::joined(&[row(2, 0), row(3, 2), Gaussians::default()]);
    assert!(joined.lengths_agree());
    assert_eq!((joined.len(), joined.degree), (5, 2));
    assert_eq!(joined.select(&[2, 3, 4]), row(3, 2));
    assert_eq!(joined.slice(2..5), row(3, 2));
    assert_eq!(joined.slice(0..2), row(2, 0).with_degree(2));
    assert_eq!(Gaussians::joined(&[]), Gaussians::default());
}

#[test]
fn regions_keep_what_lies_within() {
    let gaussians = row(6, 0);
    assert_eq!(gaussians.inside(&Region::Box { min: [1.0, -1.0, -1.0], max: [3.5, 1.0, 1.0] }), [1, 2, 3]);
    assert_eq!(gaussians.inside(&Region::Sphere { center: [5.0, 0.0, 0.0], radius: 2.0 }), [3, 4, 5]);
}

#[test]
fn importance_is_opacity_times_area() {
    let gaussians = row(3, 0);
    // Of the scales exp(0), exp(-1) and exp(-2), the two largest.
    let area = (-1.0_f32).exp();
    for (i, found) in gaussians.importance().iter().enumerate() {
        let opacity = 1.0 / (1.0 + (-(i as f32)).exp());
        assert!((found - area * opacity).abs() < 1e-6, "{i}: {found}");
    }
    assert_eq!(gaussians.largest(&gaussians.importance(), 2), [1, 2]);
    assert_eq!(gaussians.largest(&[1.0, 1.0, 0.0], 1), [0]);
    assert_eq!(gaussians.largest(&[0.0; 3], 9), [0, 1, 2]);
}

#[test]
fn a_planted_floater_is_found() {
    let mut gaussians = row(200, 0);
    // Unequal distances, so that there is a spread.
    gaussians.means.iter_mut().enumerate().for_each(|(i, m)| m[1] = (i % 7) as f32 * 0.3);
    gaussians.means[77] = [0.0, 500.0, 0.0];
    let kept = gaussians.without_floaters();
    assert!(!kept.contains(&77), "{kept:?}");
    assert!(kept.len() >= 190, "{}", kept.len());
    assert_eq!(row(8, 0).without_floaters().len(), 8);
}

/// The color of harmonics over all directions, sampled, beside the sum of squares that it is by Parseval's theorem.
#[test]
fn a_difference_of_colors_is_a_mean_over_directions() {
    let a = row(1, 0);
    let b = Gaussians { sh: (0..27).map(|i| (i as f32 * 1.3).sin() * 0.2).collect(), degree: 2, ..row(1, 2) };
    let found = a.difference(&b).color;
    let n = 4000;
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let mean: f64 = (0..n)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / n as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let basis = weaver_geometry::sh::basis(2, [r * cos, r * sin, z], |x: f64| x);
            let color = |g: &Gaussians, c: usize| {
                (0..g.coefficients()).map(|k| basis[k] * f64::from(g.sh[3 * k + c])).sum::<f64>()
            };
            (0..3).map(|c| (color(&a, c) - color(&b, c)).powi(2)).sum::<f64>() / 3.0
        })
        .sum::<f64>()
        / n as f64;
    assert!((found.mean - mean.sqrt()).abs() < 1e-4, "{} {}", found.mean, mean.sqrt());
    assert_eq!((found.mean, b.difference(&a).color), (found.largest, found));
    assert_eq!(Gaussians::default().difference(&Gaussians::default()), Default::default());
}
