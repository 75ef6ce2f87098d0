//! How far the pictures of a clip move, and how sharp they are.

use crate::pictures::Picture;

/// The longest side of a picture that points are followed in, pixels.
const FOLLOWED: usize = 400;
/// That of its smallest version, in which they are searched for.
const SEARCHED: usize = 100;
/// Pixels each way in the smallest version: that all points together are searched in, and each of them about there.
const COMMON: i32 = 8;
const OWN: i32 = 3;
/// Pixels by which larger versions correct it.
const NARROW: i32 = 2;
/// A patch reaches so many pixels from its point.
const RADIUS: i32 = 3;
/// Points along the longer side.
const POINTS: usize = 12;
/// Least points that tell a movement.
const FEW: usize = 8;
/// Mean square of the slope in its weaker direction from which a point can be followed, values of 255.
const TEXTURE: f32 = 9.0;
/// The most that a patch may differ where it is found again, over its variance.
const DIFFERENT: f32 = 0.5;
/// Mean square of differences that are noise, values of 255.
const NOISE: f32 = 4.0;
/// Once points have moved so far in the median, over the longer side, others are followed. A camera that is held still
/// moves less.
const STEP: f32 = 0.02;
/// Movement that stands for one too fast to be followed, and for a cut.
const JUMP: f32 = 0.08;

/// The mean square of the Laplacian of a gray picture.
pub fn sharpness(picture: &Picture) -> f32 {
    let (width, pixels) = (picture.width, &picture.pixels);
    if width < 3 || picture.height < 3 {
        return 0.0;
    }
    let mut sum = 0u64;
    for y in 1..picture.height - 1 {
        let row = |y: usize| &pixels[y * width..(y + 1) * width];
        let (above, here, below) = (row(y - 1), row(y), row(y + 1));
        let mut of_row = 0u32;
        // At most 1020 squared, of at most 4096 pixels.
        for x in 1..width - 1 {
            let around = i32::from(above[x]) + i32::from(below[x]) + i32::from(here[x - 1]) + i32::from(here[x + 1]);
            let curved = around - 4 * i32::from(here[x]);
            of_row += (curved * curved) as u32;
        }
        sum += u64::from(of_row);
    }
    (sum as f64 / ((width - 2) * (picture.height - 2)) as f64) as f32
}

/// Follows what pictures show from one to the next.
///
/// Points are followed from the picture in which they were chosen for as long as they can be, so that small errors do
/// not add up and a camera that trembles does not seem to travel.
#[derive(Debug, Default)]
pub struct Follower {
    anchor: Option<Anchor>,
    previous: Option<Vec<Picture>>,
    /// Movement of the picture when the points were chosen, and now.
    begun: f32,
    place: f32,
}

/// A picture, and points in it.
#[derive(Debug)]
struct Anchor {
    /// The picture, each version half as large as the one before.
    versions: Vec<Picture>,
    points: Vec<Point>,
}

#[derive(Clone, Copy, Debug)]
struct Point {
    at: [i32; 2],
    /// Its movement; `None` once it is lost.
    moved: Option<[i32; 2]>,
}

impl Follower {
    /// Movement of the picture in all with this one, in gray: the median over its points, over its longer side.
    pub fn follow(&mut self, picture: &Picture) -> f32 {
        let now = versions(picture);
        let Some(anchor) = &mut self.anchor else {
            self.anchor = Some(Anchor::new(now.clone()));
            self.previous = Some(now);
            return self.place;
        };
        let mut moved = anchor.moved_to(&now);
        if moved.is_none()
            && let Some(previous) = self.previous.take()
        {
            *anchor = Anchor::new(previous);
            self.begun = self.place;
            moved = anchor.moved_to(&now);
        }
        if let Some(moved) = moved {
            self.place = self.begun + moved;
        }
        if moved.is_none_or(|moved| moved >= STEP) {
            let fresh = Anchor::new(now.clone());
            // Where there is nothing to see, nothing is known to move.
            if moved.is_none() && anchor.points.len().max(fresh.points.len()) >= FEW {
                self.place += JUMP;
            }
            (self.begun, self.anchor) = (self.place, Some(fresh));
        }
        self.previous = Some(now);
        self.place
    }
}

impl Anchor {
    fn new(versions: Vec<Picture>) -> Self {
        let points = points(&versions[0], RADIUS << (versions.len() - 1));
        Self { versions, points }
    }

    /// The median of how far its points have moved, over the longer side; `None` when fewer than half of them are
    /// there.
    fn moved_to(&mut self, now: &[Picture]) -> Option<f32> {
        let same = |(a, b): (&Picture, &Picture)| (a.width, a.height) == (b.width, b.height);
        if self.points.len() < FEW || !self.versions.iter().zip(now).all(same) {
            return None;
        }
        let common = self.common(now.last()?);
        let smallest = now.len() - 1;
        for point in &mut self.points {
            let about = point.moved.map(|moved| [0, 1].map(|i| (moved[i] >> smallest) + common[i]));
            point.moved = about.and_then(|about| found(&self.versions, now, point.at, about));
        }
        let far = |[x, y]: [i32; 2]| f64::from(x).hypot(f64::from(y)) as f32;
        let mut far: Vec<f32> = self.points.iter().filter_map(|point| point.moved).map(far).collect();
        if 2 * far.len() < self.points.len() {
            return None;
        }
        far.sort_by(f32::total_cmp);
        Some(far[far.len() / 2] / now[0].width.max(now[0].height) as f32)
    }
}

impl Anchor {
    /// By how much more most points have moved in the smallest version: alone a point may be taken for one that looks
    /// alike.
    fn common(&self, now: &Picture) -> [i32; 2] {
        let smallest = self.versions.len() - 1;
        let patch = |point: &Point| {
            let moved = point.moved?.map(|x| x >> smallest);
            Some((Patch::new(&self.versions[smallest], point.at.map(|x| x >> smallest))?, moved))
        };
        let patches: Vec<(Patch, [i32; 2])> = self.points.iter().filter_map(patch).collect();
        let mut best = (f32::INFINITY, [0, 0]);
        for y in -COMMON..=COMMON {
            for x in -COMMON..=COMMON {
                let part = |(patch, moved): &(Patch, [i32; 2])| {
                    let difference = patch.difference(now, [moved[0] + x, moved[1] + y]);
                    difference.map_or(1.0, |difference| (difference as f32 / patch.variance.max(1) as f32).min(1.0))
                };
                let sum: f32 = patches.iter().map(part).sum();
                if sum < best.0 {
                    best = (sum, [x, y]);
                }
            }
        }
        best.1
    }
}

/// A picture and smaller versions of it.
fn versions(picture: &Picture) -> Vec<Picture> {
    let long = |picture: &Picture| picture.width.max(picture.height);
    let mut first = picture.clone();
    while long(&first) > FOLLOWED {
        first = half(&first);
    }
    let mut versions = vec![first];
    while let Some(last) = versions.last().filter(|last| long(last) > SEARCHED) {
        versions.push(half(last));
    }
    versions
}

fn half(picture: &Picture) -> Picture {
    let (width, height) = ((picture.width / 2).max(1), (picture.height / 2).max(1));
    let at = |x: usize, y: usize| {
        u16::from(picture.pixels[y.min(picture.height - 1) * picture.width + x.min(picture.width - 1)])
    };
    let mean = |x: usize, y: usize| (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4;
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| mean(2 * x, 2 * y) as u8)).collect();
    Picture { width, height, pixels }
}

/// The point of each cell of a picture that is most like a corner, where there is any, at least so far from its
/// borders.
fn points(picture: &Picture, border: i32) -> Vec<Point> {
    let (width, height) = (picture.width as i32, picture.height as i32);
    let cell = (width.max(height) / POINTS as i32).max(4);
    // The slope needs a pixel more.
    let border = border.max(RADIUS + 1);
    let mut points = Vec::new();
    for top in (border..height - border).step_by(cell as usize) {
        for left in (border..width - border).step_by(cell as usize) {
            let xs = || (left..(left + cell).min(width - border)).step_by(2);
            let all = (top..(top + cell).min(height - border)).step_by(2).flat_map(|y| xs().map(move |x| [x, y]));
            let best = all.map(|at| (corner(picture, at), at)).max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, at)) = best.filter(|(corner, _)| *corner >= TEXTURE) {
                points.push(Point { at, moved: Some([0, 0]) });
            }
        }
    }
    points
}

/// The smaller eigenvalue of the mean product of slopes around a point, as Shi and Tomasi (1994) rate what can be
/// followed.
fn corner(picture: &Picture, [x, y]: [i32; 2]) -> f32 {
    let width = picture.width;
    let (mut xx, mut xy, mut yy) = (0, 0, 0);
    for y in y - RADIUS..=y + RADIUS {
        for x in x - RADIUS..=x + RADIUS {
            let i = y as usize * width + x as usize;
            let value = |i: usize| i32::from(picture.pixels[i]);
            let (dx, dy) = (value(i + 1) - value(i - 1), value(i + width) - value(i - width));
            xx += dx * dx;
            xy += dx * dy;
            yy += dy * dy;
        }
    }
    // Differences are twice the slope.
    let mean = 1.0 / (4 * (2 * RADIUS + 1).pow(2)) as f32;
    let [xx, xy, yy] = [xx, xy, yy].map(|sum| sum as f32 * mean);
    0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt())
}

/// Movement of a point from one picture to another, near so much in their smallest versions; `None` if it is not there.
fn found(from: &[Picture], to: &[Picture], at: [i32; 2], mut about: [i32; 2]) -> Option<[i32; 2]> {
    let smallest = from.len() - 1;
    for level in (0..=smallest).rev() {
        let reach = if level == smallest { OWN } else { NARROW };
        let patch = Patch::new(&from[level], at.map(|x| x >> level))?;
        let (difference, best) = patch.nearest(&to[level], about, reach)?;
        if level == 0 {
            let most = DIFFERENT * patch.variance as f32 + NOISE * (SIDE * SIDE * SIDE * SIDE) as f32;
            return (difference as f32 <= most).then_some(best);
        }
        about = best.map(|x| 2 * x);
    }
    None
}

const SIDE: i32 = 2 * RADIUS + 1;

/// A square of a picture around a point.
struct Patch {
    at: [i32; 2],
    values: [[i32; SIDE as usize]; SIDE as usize],
    /// Its variance, times the square of its number of pixels.
    variance: i32,
}

impl Patch {
    fn new(picture: &Picture, at: [i32; 2]) -> Option<Self> {
        let corner = corner_of(picture, at)?;
        let row = |y: usize| std::array::from_fn(|x| i32::from(picture.pixels[corner + y * picture.width + x]));
        let values: [[i32; SIDE as usize]; SIDE as usize] = std::array::from_fn(row);
        let all = || values.iter().flatten();
        let (sum, squares): (i32, i32) = (all().sum(), all().map(|x| x * x).sum());
        Some(Self { at, values, variance: SIDE * SIDE * squares - sum * sum })
    }

    /// The least difference to a square that has moved about so far, and how far that one has moved.
    fn nearest(&self, picture: &Picture, about: [i32; 2], reach: i32) -> Option<(i32, [i32; 2])> {
        let rows = about[1] - reach..=about[1] + reach;
        let all = rows.flat_map(|y| (about[0] - reach..=about[0] + reach).map(move |x| [x, y]));
        all.filter_map(|moved| Some((self.difference(picture, moved)?, moved)))
            .min_by_key(|(difference, _)| *difference)
    }

    /// The variance of the difference to a square that has moved so far, times the square of its number of pixels;
    /// `None` beyond the picture. What became brighter as a whole does not differ.
    fn difference(&self, picture: &Picture, [x, y]: [i32; 2]) -> Option<i32> {
        let corner = corner_of(picture, [self.at[0] + x, self.at[1] + y])?;
        let (mut sum, mut squares) = (0, 0);
        for (row, values) in self.values.iter().enumerate() {
            let beside = &picture.pixels[corner + row * picture.width..][..SIDE as usize];
            for (a, b) in values.iter().zip(beside) {
                let difference = a - i32::from(*b);
                sum += difference;
                squares += difference * difference;
            }
        }
        Some(SIDE * SIDE * squares - sum * sum)
    }
}

/// Where a patch begins among the pixels, if it is in the picture.
fn corner_of(picture: &Picture, [x, y]: [i32; 2]) -> Option<usize> {
    let within = |at: i32, side: usize| at >= RADIUS && at + RADIUS < side as i32;
    let inside = within(x, picture.width) && within(y, picture.height);
    inside.then(|| (y - RADIUS) as usize * picture.width + (x - RADIUS) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    /// A texture of spots of several sizes, moved by so many pixels.
    fn texture(width: usize, height: usize, moved: [f32; 2]) -> Picture {
        let draws = Stream::new(5, 0, "spots");
        let mut pixels = vec![40i32; width * height];
        for i in 0..4000 {
            let draw = |c: u64| draws.uniform::<f32>(4 * i + c);
            let [x, y] = [2.0 * draw(0) - 0.5, 2.0 * draw(1) - 0.5];
            let [x, y] = [x * width as f32 + moved[0], y * width as f32 + moved[1]];
            let (bright, size) = (200.0 * draw(2) - 80.0, 0.5 + 6.0 * draw(3) * draw(3));
            for py in (y as i32 - 9).max(0)..(y as i32 + 9).min(height as i32) {
                for px in (x as i32 - 9).max(0)..(x as i32 + 9).min(width as i32) {
                    let far = (px as f32 - x).hypot(py as f32 - y);
                    pixels[py as usize * width + px as usize] += (bright * (-far * far / size).exp()) as i32;
                }
            }
        }
        Picture { width, height, pixels: pixels.into_iter().map(|x| x.clamp(0, 255) as u8).collect() }
    }

    /// Promise of `frames_are_spread_over_the_way_and_not_over_time`.
    #[test]
    fn movement_is_followed_far() {
        let mut follower = Follower::default();
        let mut place = 0.0;
        for i in 0..=40 {
            place = follower.follow(&texture(320, 180, [-6.0 * i as f32, 1.5 * i as f32]));
        }
        let true_place = 40.0 * 6.0f32.hypot(1.5) / 320.0;
        assert!((place / true_place - 1.0).abs() < 0.05, "{place} of {true_place}");
    }

    /// Promise of `frames_are_spread_over_the_way_and_not_over_time`.
    #[test]
    fn trembling_and_brightness_lead_nowhere() {
        let mut follower = Follower::default();
        let mut furthest = 0.0f32;
        for i in 0..60 {
            let mut picture = texture(320, 180, [[0.0, 3.0, -2.0][i % 3], [0.0, -2.0, 1.0][i % 3]]);
            picture.pixels.iter_mut().for_each(|value| *value = value.saturating_add((i % 7) as u8));
            furthest = furthest.max(follower.follow(&picture));
        }
        assert!(furthest < STEP, "{furthest}");
    }

    /// Promise of `frames_are_spread_over_the_way_and_not_over_time`.
    #[test]
    fn a_cut_is_a_jump_and_darkness_stands_still() {
        let mut follower = Follower::default();
        let dark = Picture { width: 160, height: 90, pixels: vec![3; 160 * 90] };
        assert_eq!(follower.follow(&texture(160, 90, [0.0; 2])), 0.0);
        assert_eq!(follower.follow(&dark), JUMP);
        for _ in 0..50 {
            assert_eq!(follower.follow(&dark), JUMP);
        }
        assert_eq!(follower.follow(&texture(160, 90, [0.0; 2])), 2.0 * JUMP);
        // Far from anything before.
        assert_eq!(follower.follow(&texture(160, 90, [77.0, 40.0])), 3.0 * JUMP);
        // Another size, as where two clips are joined; and pictures of hardly any pixels.
        assert_eq!(follower.follow(&texture(90, 160, [0.0; 2])), 4.0 * JUMP);
        for side in [1, 2, 3, 8] {
            let mut follower = Follower::default();
            let picture = Picture { width: side, height: side, pixels: vec![9; side * side] };
            assert_eq!((follower.follow(&picture), follower.follow(&picture), sharpness(&picture)), (0.0, 0.0, 0.0));
        }
    }

    #[test]
    fn blur_is_less_sharp() {
        let sharp = texture(320, 180, [0.0; 2]);
        let mut blurred = sharp.clone();
        for i in 4..blurred.pixels.len() {
            blurred.pixels[i] = (sharp.pixels[i - 4..=i].iter().map(|x| u32::from(*x)).sum::<u32>() / 5) as u8;
        }
        assert!(sharpness(&sharp) > 2.0 * sharpness(&blurred), "{} {}", sharpness(&sharp), sharpness(&blurred));
    }
}
