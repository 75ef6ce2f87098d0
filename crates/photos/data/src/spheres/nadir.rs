//! What stands below the camera in all panoramas: a tripod, a logo, or nothing at all.

use weaver_geometry::glam::DVec3;
use weaver_io::{Bitmap, Panorama};

/// Angles to straight down that are looked at, degrees apart, and directions around it.
const RINGS: usize = 45;
const AROUND: usize = 60;
/// Panoramas that tell what is constant, at least.
const FEWEST: usize = 3;
/// Deviation over the panoramas, of values from 0 to 1, up to which a ring is the same in all of them.
const SAME: f64 = 0.03;
/// The next rings differ by this factor more, or all of the ground is alike.
const EDGE: f64 = 2.0;
/// Rings by which the surroundings are judged.
const BESIDE: usize = 4;
/// The least and the largest angle that is left out.
const LEAST: usize = 4;
const MOST: usize = 38;

/// Gray values around straight down, ring by ring from there.
pub(super) struct Below(Vec<f64>);

impl Below {
    pub fn of(panorama: &Panorama, photo: &Bitmap) -> Self {
        let value = |i: usize| {
            let down = ((i / AROUND) as f64 + 0.5).to_radians();
            let around = (i % AROUND) as f64 / AROUND as f64 * std::f64::consts::TAU;
            let direction = DVec3::new(down.sin() * around.sin(), down.cos(), down.sin() * around.cos());
            let Some(at) = panorama.pixel(direction) else { return 0.0 };
            let [x, y] = [(at.x as usize).min(photo.width - 1), (at.y as usize).min(photo.height - 1)];
            let pixel = &photo.pixels[3 * (y * photo.width + x)..][..3];
            pixel.iter().map(|x| f64::from(*x)).sum::<f64>() / 765.0
        };
        Self((0..RINGS * AROUND).map(value).collect())
    }
}

/// The angle around straight down within which all panoramas show the same, degrees; 0 if there is none, as where the
/// ground is alike everywhere.
pub(super) fn constant(all: &[&Below]) -> f64 {
    if all.len() < FEWEST {
        return 0.0;
    }
    let n = all.len() as f64;
    let deviation = |i: usize| {
        let mean = all.iter().map(|below| below.0[i]).sum::<f64>() / n;
        (all.iter().map(|below| (below.0[i] - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    let rings: Vec<f64> =
        (0..RINGS).map(|ring| (0..AROUND).map(|k| deviation(ring * AROUND + k)).sum::<f64>() / AROUND as f64).collect();
    let end = rings.iter().take_while(|ring| **ring <= SAME).count();
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len().max(1) as f64;
    let stands_out = mean(&rings[end..(end + BESIDE).min(RINGS)]) > EDGE * mean(&rings[..end]).max(0.5 * SAME);
    if (LEAST..=MOST).contains(&end) && stands_out { end as f64 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    /// Panoramas of a ground with grain, over which the same thing stands up to some degrees from straight down.
    fn below(number: usize, degrees: f64, ground: f64) -> Below {
        let (own, same) = (Stream::new(number as u64, 0, "test.ground"), Stream::new(99, 0, "test.tripod"));
        let value = |i: usize| match i / AROUND {
            ring if (ring as f64) < degrees => same.uniform::<f64>(i as u64),
            _ => 0.5 + ground * own.normal::<f64>(i as u64),
        };
        Below((0..RINGS * AROUND).map(value).collect())
    }

    /// Promise (photos): what stands below the camera in all panoramas is left out, and ground is not.
    #[test]
    fn the_same_thing_below_all_cameras_is_found() {
        let found = |count: usize, degrees: f64, ground: f64| {
            let all: Vec<Below> = (0..count).map(|i| below(i, degrees, ground)).collect();
            constant(&all.iter().collect::<Vec<_>>())
        };
        assert_eq!(found(6, 20.0, 0.1), 20.0);
        assert_eq!(found(6, 0.0, 0.1), 0.0, "nothing there");
        assert_eq!(found(6, 0.0, 0.001), 0.0, "a ground without any texture");
        assert_eq!(found(6, 2.0, 0.1), 0.0, "as little as chance");
        assert_eq!(found(2, 20.0, 0.1), 0.0, "too few to tell");
    }
}
