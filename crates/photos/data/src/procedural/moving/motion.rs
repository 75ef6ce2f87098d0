//! How solids move: functions of time, which goes from 0 to 1.

use super::super::solid::Solid;
use std::f64::consts::TAU;
use std::ops::Range;
use weaver_geometry::glam::DVec3;

/// A way to move, away from where a solid is at rest.
#[derive(Clone, Debug)]
pub(super) enum Motion {
    /// A cubic of time, and a steady turn: coefficients of the Chebyshev polynomials of degree 1, 2 and 3 over the
    /// clip, whose lengths bound the path; radians over the clip.
    Cubic { path: [DVec3; 3], turn: f64 },
    /// A smooth curve through keys that are equally far apart in time, from 0 to 1.
    Keys(Vec<DVec3>),
    /// To and fro: the farthest that it goes, cycles over the clip, and radians at which it begins.
    Shake { swing: DVec3, cycles: f64, phase: f64 },
    /// Lifted by so much as a pulse of this width passes its place; the pulse goes from beyond 0 to beyond 1.
    Pulse { lift: DVec3, place: f64, width: f64 },
    /// There for this time alone.
    Present(Range<f64>),
}

/// A solid that moves.
#[derive(Clone, Debug)]
pub(super) struct Mover {
    /// Kind of the motion, from 1.
    pub kind: u8,
    /// As it is at rest.
    pub solid: Solid,
    pub motion: Motion,
}

impl Mover {
    /// The solid at a time, if it is in the world then.
    pub fn at(&self, time: f64) -> Option<Solid> {
        let (by, angle) = self.motion.at(time)?;
        Some(Solid { shape: self.solid.shape.moved(by, angle), texture: self.solid.texture.clone() })
    }
}

impl Motion {
    /// Displacement of a solid from its rest, and its rotation.
    fn at(&self, time: f64) -> Option<(DVec3, f64)> {
        match self {
            Self::Cubic { path: [a, b, c], turn } => {
                let s = 2.0 * time - 1.0;
                Some((*a * s + *b * (2.0 * s * s - 1.0) + *c * (4.0 * s * s - 3.0) * s, turn * time))
            }
            Self::Keys(keys) => Some((through(keys, time), 0.0)),
            Self::Shake { swing, cycles, phase } => Some((*swing * (TAU * cycles * time + phase).sin(), 0.0)),
            Self::Pulse { lift, place, width } => {
                let top = (1.0 + 6.0 * width) * time - 3.0 * width;
                Some((*lift * (-((place - top) / width).powi(2)).exp(), 0.0))
            }
            Self::Present(when) => when.contains(&time).then_some((DVec3::ZERO, 0.0)),
        }
    }
}

/// The cubic Hermite spline through keys with the slopes of Catmull and Rom, `(p_{n+1} - p_{n-1}) / 2`; at the ends
/// one-sided slopes.
fn through(keys: &[DVec3], time: f64) -> DVec3 {
    let last = keys.len() - 1;
    let x = time.clamp(0.0, 1.0) * last as f64;
    let n = (x as usize).min(last.saturating_sub(1));
    let d = x - n as f64;
    let key = |i: usize| keys[i.min(last)];
    let slope = |i: usize| {
        let (from, to) = (i.saturating_sub(1), (i + 1).min(last));
        (key(to) - key(from)) / (to - from).max(1) as f64
    };
    let (d2, d3) = (d * d, d * d * d);
    key(n) * (2.0 * d3 - 3.0 * d2 + 1.0)
        + slope(n) * (d3 - 2.0 * d2 + d)
        + key(n + 1) * (3.0 * d2 - 2.0 * d3)
        + slope(n + 1) * (d3 - d2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_passed_without_a_jump_or_a_kink() {
        let keys: Vec<DVec3> = [0.0, 1.0, -0.5, 2.0].map(|x| DVec3::new(x, -2.0 * x, 1.0)).to_vec();
        for (i, key) in keys.iter().enumerate() {
            assert!(through(&keys, i as f64 / 3.0).distance(*key) < 1e-12);
        }
        let speed = |t: f64| (through(&keys, t + 1e-6) - through(&keys, t)) / 1e-6;
        for i in [1.0, 2.0] {
            assert!(speed(i / 3.0).distance(speed(i / 3.0 - 1e-6)) < 1e-3);
        }
        // Between equal keys a straight line stays one.
        let line: Vec<DVec3> = (0..4).map(|i| DVec3::X * f64::from(i)).collect();
        assert!(through(&line, 0.4).distance(DVec3::X * 1.2) < 1e-12);
    }

    /// A pulse comes from beyond one end and leaves at the other.
    #[test]
    fn a_pulse_passes_from_end_to_end() {
        let lift = |place, time| {
            let pulse = Motion::Pulse { lift: DVec3::Z, place, width: 0.15 };
            pulse.at(time).unwrap().0.z
        };
        for place in [0.0, 0.5, 1.0] {
            let highest = (0..=100).map(|i| lift(place, f64::from(i) / 100.0)).fold(0.0, f64::max);
            assert!(highest > 0.95 && lift(place, 0.0) < 1e-3 && lift(place, 1.0) < 1e-3, "{place}: {highest}");
        }
    }

    /// A cubic has no fourth difference and stays within the lengths of its coefficients.
    #[test]
    fn cubics_are_smooth_and_bounded() {
        let path = [DVec3::new(0.3, 0.1, 0.0), DVec3::new(-0.1, 0.2, 0.0), DVec3::new(0.05, 0.0, 0.2)];
        let bound: f64 = path.iter().map(|c| c.length()).sum();
        let cubic = Motion::Cubic { path, turn: 2.0 };
        let at = |i: i32| cubic.at(f64::from(i) / 20.0).unwrap().0;
        let differences = |i: i32| at(i) - 4.0 * at(i + 1) + 6.0 * at(i + 2) - 4.0 * at(i + 3) + at(i + 4);
        assert!((0..=16).all(|i| differences(i).length() < 1e-12));
        assert!((0..=20).all(|i| at(i).length() <= bound));
        assert!((at(0) - 3.0 * at(1) + 3.0 * at(2) - at(3)).length() > 1e-4, "a cubic, and no less");
    }
}
