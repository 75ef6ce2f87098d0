//! Experts that are right on half of the picture, of the clip, of the cameras, with the carried numbers that the router
//! needs.

use crate::routed::{Routed, Trained, shots};
use crate::wall::{self, Moment, PIXELS, Right};
use weaver_dynamic::hard_oracle;

/// Training moments, and others.
struct Shots {
    training: Vec<Moment>,
    held_out: Vec<Moment>,
}

impl Routed {
    /// The share of pixels at which the gate's first choice is the best expert.
    fn right(&self, right: Right, shots: &[Moment]) -> f64 {
        let of = |at: &Moment| {
            let [images, gate, photo] = self.shown(right, *at);
            let best = hard_oracle(&images, &photo);
            (0..PIXELS).filter(|i| usize::from(gate[PIXELS + i] > gate[*i]) == best[*i]).count()
        };
        shots.iter().map(of).sum::<usize>() as f64 / (PIXELS * shots.len()) as f64
    }
}

const TIMES: [f64; 6] = [0.0, 0.15, 0.3, 0.55, 0.7, 0.85];

/// Promise (results): experts that are right on half of the picture, of the clip, of the cameras are believed there;
/// time and cameras need the numbers made for them; no gate passes the best convex blend.
#[test]
fn half_of_the_picture_needs_weights_alone() {
    let shots = shots(&[-20.0, 0.0, 20.0], &[0.25, 0.75]);
    let routed = Routed::trained(wall::left, &shots, 60, Trained::Weights);
    let share = routed.right(wall::left, &shots);
    assert!(share > 0.9, "{share}");
}

/// Promise of `half_of_the_picture_needs_weights_alone`.
#[test]
fn half_of_the_clip_needs_time() {
    let shots = Shots { training: shots(&[-20.0, 20.0], &TIMES), held_out: shots(&[0.0], &[0.1, 0.2, 0.65, 0.9]) };
    let [all, alone] = [Trained::All, Trained::Weights].map(|which| {
        let routed = Routed::trained(wall::early, &shots.training, 240, which);
        routed.right(wall::early, &shots.held_out)
    });
    // Independent of time, each pixel is right at half of the moments.
    assert!(all > 0.9 && (alone - 0.5).abs() < 1e-9, "{all} {alone}");
}

/// Promise of `half_of_the_picture_needs_weights_alone`.
#[test]
fn half_of_the_cameras_needs_directions() {
    let angles = [-36.0, -24.0, -8.0, 8.0, 24.0, 36.0];
    let shots = Shots { training: shots(&angles, &[0.0]), held_out: shots(&[-30.0, 30.0], &[0.0]) };
    let [all, alone] = [Trained::All, Trained::Weights].map(|which| {
        let routed = Routed::trained(wall::from_the_left, &shots.training, 240, which);
        routed.right(wall::from_the_left, &shots.held_out)
    });
    assert!(all > 0.9 && alone < 0.65, "{all} {alone}");
}
