//! Small patches of depth that stand alone.

/// Pixels from which a patch stays, whoever agrees about it.
const LARGE: usize = 10;
/// Photos that must agree about one pixel of a smaller patch.
const WITNESSES: u8 = 3;
/// Logarithm of the ratio of inverse depths from which neighboring pixels are of different patches.
const JUMP: f32 = 0.05;

/// Makes inverse depths not a number in small patches that only two photos agree about, anywhere in them: that happens
/// by chance. `witnesses` are the photos that agree, for each pixel.
pub(crate) fn remove(w: &mut [f32], witnesses: &[u8], width: usize) {
    let mut seen = vec![false; w.len()];
    let mut patch = Vec::new();
    for first in 0..w.len() {
        if seen[first] || w[first].is_nan() {
            continue;
        }
        seen[first] = true;
        patch.clear();
        patch.push(first);
        let mut looked_at = 0;
        while let Some(&at) = patch.get(looked_at) {
            looked_at += 1;
            let x = at % width;
            let beside = [(x > 0).then(|| at - 1), (x + 1 < width).then_some(at + 1)];
            let above = [at.checked_sub(width), Some(at + width).filter(|next| *next < w.len())];
            for next in beside.into_iter().chain(above).flatten() {
                if !seen[next] && (w[next] / w[at]).ln().abs() < JUMP {
                    seen[next] = true;
                    patch.push(next);
                }
            }
        }
        if patch.len() < LARGE && patch.iter().all(|at| witnesses[*at] < WITNESSES) {
            patch.iter().for_each(|at| w[*at] = f32::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall, a near patch of 3 x 3 pixels on it in the corner, and one of 2 x 5 in the middle.
    fn picture() -> (Vec<f32>, usize) {
        let (width, height) = (12, 8);
        let near = |x: usize, y: usize| x < 3 && y < 3 || (5..10).contains(&x) && (3..5).contains(&y);
        let pixels = (0..width * height).map(|at| if near(at % width, at / width) { 0.5 } else { 0.2 });
        (pixels.collect(), width)
    }

    /// Promise (photos): depth of a small patch that only two photos agree about is left out.
    #[test]
    fn small_patches_with_two_witnesses_are_removed() {
        let (before, width) = picture();
        let mut w = before.clone();
        remove(&mut w, &vec![2; before.len()], width);
        for (at, (w, before)) in w.iter().zip(&before).enumerate() {
            let removed = at % width < 3 && at / width < 3;
            assert!(if removed { w.is_nan() } else { w == before }, "pixel {at}: {w}");
        }
    }

    #[test]
    fn one_pixel_with_three_witnesses_keeps_its_patch() {
        let (before, width) = picture();
        let (mut w, mut witnesses) = (before.clone(), vec![2; before.len()]);
        witnesses[width + 1] = 3;
        remove(&mut w, &witnesses, width);
        assert_eq!(w, before);
    }

    #[test]
    fn patches_do_not_go_around_the_edge() {
        let width = 6;
        let mut w: Vec<f32> =
            (0..5 * width).map(|at| if matches!(at % width, 0 | 5) { 1.0 } else { f32::NAN }).collect();
        remove(&mut w, &[2; 30], width);
        assert!(w.iter().all(|w| w.is_nan()), "two columns of 5 pixels are not one patch of 10");
    }

    #[test]
    fn what_nobody_agrees_about_stays_so() {
        let mut w = [f32::NAN; 12];
        remove(&mut w, &[0; 12], 4);
        assert!(w.iter().all(|w| w.is_nan()));
        remove(&mut [], &[], 4);
    }
}
