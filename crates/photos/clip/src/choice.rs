//! Which frames of a clip become photos: as many steps of the camera apart, and sharp.

/// Measurements of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Energy of the second derivatives; only compared with neighbors, which show the same.
    pub sharpness: f32,
    /// Movement of the picture since the first frame, along its way, over its longer side.
    pub place: f32,
}

/// Largest distance of a frame from its place, over the distance of two.
const REACH: f32 = 0.45;

/// Chooses at most `most` frames that are evenly spread over the way of the camera, at least `closest` apart, and the
/// sharp ones among those near each place.
///
/// A frame that is `u` times half a step away from its place counts with its sharpness times `1 - u^2 / 2`. Returns
/// rising numbers: one where the way is shorter than `closest`, none of no frames. No two of them show the same: a
/// picture that a clip repeats is at the place of the first.
///
/// # Panics
/// If `most` is 0.
pub fn choose(frames: &[Measured], most: usize, closest: f32) -> Vec<usize> {
    assert!(most > 0, "at least one frame");
    // A camera that goes back a little does not come to a new place.
    let furthest = |furthest: &mut f32, frame: &Measured| {
        *furthest = furthest.max(frame.place);
        Some(*furthest)
    };
    let places: Vec<f32> = frames.iter().scan(0.0, furthest).collect();
    let Some(way) = places.last() else { return Vec::new() };
    // What was rounded does not cost a step.
    let steps = ((way / closest + 1e-3) as usize).min(most - 1);
    if steps == 0 {
        return best(0..frames.len(), |i| frames[i].sharpness).into_iter().collect();
    }
    let step = way / steps as f32;
    let mut chosen: Vec<usize> = Vec::with_capacity(steps + 1);
    for target in (0..=steps).map(|i| i as f32 * step) {
        let first = chosen.last().map_or(0, |last| places.partition_point(|place| *place <= places[*last]));
        let from = places.partition_point(|place| *place < target - REACH * step).max(first);
        let to = places.partition_point(|place| *place <= target + REACH * step);
        let score = |i: usize| {
            let off = 2.0 * (places[i] - target) / step;
            frames[i].sharpness * (1.0 - 0.5 * off * off)
        };
        // Between two frames that are far apart there may be none.
        let near = best(from..to, score);
        let next =
            || best(to.saturating_sub(1).max(first)..(to + 1).min(frames.len()), |i| -(places[i] - target).abs());
        chosen.extend(near.or_else(next));
    }
    chosen
}

/// The first of those with the highest score.
fn best(numbers: std::ops::Range<usize>, score: impl Fn(usize) -> f32) -> Option<usize> {
    numbers.reduce(|best, next| if score(next) > score(best) { next } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(places: impl IntoIterator<Item = f32>) -> Vec<Measured> {
        places.into_iter().map(|place| Measured { sharpness: 1.0, place }).collect()
    }

    /// Promise (photos): frames of a clip are spread over the path of its camera, not over time; the sharpest near
    /// each place is taken, whatever a view shows; standing still and trembling lead nowhere, cuts are stepped over.
    #[test]
    fn frames_are_spread_over_the_way_and_not_over_time() {
        // Slow at first, then five times as fast, then still.
        let mut place = 0.0;
        let mut measured = vec![Measured { sharpness: 1.0, place }];
        for step in [0.002; 100].into_iter().chain([0.01; 80]).chain([0.0; 500]) {
            place += step;
            measured.push(Measured { sharpness: 1.0, place });
        }
        let chosen = choose(&measured, 11, 0.04);
        let places: Vec<f32> = chosen.iter().map(|i| measured[*i].place).collect();
        assert_eq!(chosen.len(), 11, "{places:?}");
        assert!(places.windows(2).all(|pair| (0.09..=0.11).contains(&(pair[1] - pair[0]))), "{places:?}");
        assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]) && chosen[0] == 0, "{chosen:?}");
        // As many as are `closest` apart where more are asked for.
        assert_eq!(choose(&measured, 1000, 0.04).len(), 26);
        assert_eq!(choose(&measured, 1000, 0.1).len(), 11);
        assert_eq!(choose(&measured, 2, 0.04).len(), 2);
        assert_eq!(choose(&measured, 1, 0.04).len(), 1);
    }

    /// The sharpest nearby is taken and what a view shows does not matter.
    ///
    /// Promise of `frames_are_spread_over_the_way_and_not_over_time`.
    #[test]
    fn the_sharpest_frame_nearby_is_taken() {
        let mut measured = frames((0..=200).map(|i| i as f32 * 0.005));
        // The second half shows a wall: everything is less sharp there, and nothing is left out.
        measured[100..].iter_mut().for_each(|frame| frame.sharpness = 0.01);
        // Every frame but one in five is blurred by motion.
        measured.iter_mut().enumerate().filter(|(i, _)| i % 5 != 3).for_each(|(_, frame)| frame.sharpness *= 0.3);
        let chosen = choose(&measured, 21, 0.04);
        assert_eq!(chosen.len(), 21);
        assert!(chosen.iter().all(|i| i % 5 == 3), "{chosen:?}");
        // A stretch in which all are blurred keeps its frames: what lies on both sides of it has to be joined.
        measured[60..90].iter_mut().for_each(|frame| frame.sharpness *= 0.1);
        let chosen = choose(&measured, 21, 0.04);
        assert!(chosen.iter().filter(|i| (60..90).contains(*i)).count() >= 2, "{chosen:?}");
        // What is sharp and far off its place is not worth as much as what is there.
        let mut measured = frames((0..=40).map(|i| i as f32 * 0.01));
        measured[28].sharpness = 1.2;
        assert_eq!(choose(&measured, 3, 0.04), [0, 20, 40]);
    }

    /// Standing still is one frame and jumps are stepped over.
    ///
    /// Promise of `frames_are_spread_over_the_way_and_not_over_time`.
    #[test]
    fn standing_still_is_one_frame() {
        let mut still = frames([0.0; 300]);
        still[77].sharpness = 2.0;
        assert_eq!(choose(&still, 120, 0.04), [77]);
        // Shaking on the spot is no way.
        let shaken = frames((0..300).map(|i| if i % 2 == 0 { 0.0 } else { 0.01 }));
        assert_eq!(choose(&shaken, 120, 0.04).len(), 1);
        // A cut: nothing lies between, and both sides are there.
        let cut = frames((0..20).map(|i| if i < 10 { 0.001 * i as f32 } else { 0.5 + 0.001 * i as f32 }));
        let chosen = choose(&cut, 120, 0.04);
        assert!(chosen.len() >= 2 && chosen.windows(2).all(|pair| pair[0] < pair[1]), "{chosen:?}");
        assert!(chosen.iter().any(|i| *i < 10) && chosen.iter().any(|i| *i >= 10), "{chosen:?}");
        // There and back: the way counts.
        let back = frames((0..=100).map(|i| 0.01 * i as f32));
        assert_eq!(choose(&back, 1000, 0.1).len(), 11);
        assert!(choose(&[], 9, 0.1).is_empty());
        assert_eq!(choose(&frames([0.0]), 9, 0.1), [0]);
    }
}
