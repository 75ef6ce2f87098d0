//! A smooth path of a camera through keyframes.

use crate::Frame;
use weaver_geometry::glam::{DMat3, DQuat, DVec3, DVec4};
use weaver_geometry::{Camera, Intrinsics, Pose};

/// Keyframes of a camera, and the smooth path through them.
///
/// Between two keys, centers and lenses follow a cubic Bezier curve, and rotations follow one on the sphere of unit
/// quaternions (K. Shoemake, "Animating rotation with quaternion curves", 1985). For keys `p` at times `t`, with
/// `h_i = t_{i+1} - t_i` and the slopes `d_i = (p_{i+1} - p_i) / h_i`, the tangent at a key is
///
/// `m_i = (h_i d_{i-1} + h_{i-1} d_i) / (h_{i-1} + h_i)`,
///
/// which for equal times is that of E. Catmull and R. Rom, "A class of local interpolating splines", 1974. The first
/// and last tangents are the slopes there. The control points are `p_i`, `p_i + m_i h_i / 3`,
/// `p_{i+1} - m_{i+1} h_i / 3` and `p_{i+1}`. For rotations, differences are logarithms of quotients and sums are
/// products with exponentials. Focal lengths are interpolated as logarithms.
///
/// ```
/// use weaver_geometry::{Camera, Intrinsics, Pose, glam::{DMat3, DVec3}};
/// use weaver_scene::{Frame, Keyframes};
///
/// let intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
/// let key = |seconds: f64, x: f64| {
///     let pose = Pose::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0));
///     Frame { time: Some(seconds), ..Frame::new("key", Camera { pose, intrinsics, width: 64, height: 48 }) }
/// };
/// let path = Keyframes::new(&[key(0.0, 0.0), key(2.0, 1.0)])?;
/// assert!((path.at(1.0).pose.center().x - 0.5).abs() < 1e-12);
/// assert!(Keyframes::new(&[key(0.0, 0.0), key(0.0, 1.0)]).is_err());
/// # Ok::<(), weaver_scene::InvalidKeys>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframes {
    keys: Vec<Key>,
    size: [usize; 2],
}

/// Keys that are no path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InvalidKeys {
    /// The place in the list, as `frames[2].time`.
    pub place: String,
    /// The expected value.
    pub expected: String,
    /// The value found.
    pub found: String,
}

impl std::fmt::Display for InvalidKeys {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: expected {}, found {}", self.place, self.expected, self.found)
    }
}

impl std::error::Error for InvalidKeys {}

/// A camera at a time, as the curves take it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    time: f64,
    center: DVec3,
    /// From the camera's axes to the world's.
    turn: DQuat,
    /// Logarithms of fx and fy, then cx and cy.
    lens: DVec4,
}

/// The change from one key to the next, or the tangent at a key, per second.
#[derive(Clone, Copy)]
struct Slope {
    center: DVec3,
    turn: DVec3,
    lens: DVec4,
}

impl Keyframes {
    /// Keys of cameras with a [`Frame::time`] in seconds. Times must increase, and all pictures have one size.
    ///
    /// # Errors
    /// When there are fewer than two keys, or a time or a size is not as it must be.
    pub fn new(frames: &[Frame]) -> Result<Self, InvalidKeys> {
        let invalid =
            |place: String, expected: &str, found: String| InvalidKeys { place, expected: expected.into(), found };
        let [first, _, ..] = frames else {
            return Err(invalid("frames".into(), "at least two keys", frames.len().to_string()));
        };
        let size = [first.camera.width, first.camera.height];
        let mut keys: Vec<Key> = Vec::with_capacity(frames.len());
        for (i, frame) in frames.iter().enumerate() {
            let Camera { pose, intrinsics: k, width, height } = frame.camera;
            let place = |key: &str| format!("frames[{i}].{key}");
            let time = frame.time.filter(|time| time.is_finite());
            let found = || frame.time.map_or("nothing".into(), |time| time.to_string());
            let time = time.ok_or_else(|| invalid(place("time"), "a time in seconds", found()))?;
            if let Some(last) = keys.last().filter(|last| last.time >= time) {
                return Err(invalid(place("time"), &format!("a time after {}", last.time), found()));
            }
            if [width, height] != size {
                let expected = format!("{} x {}, as frames[0] has", size[0], size[1]);
                return Err(invalid(place("w, h"), &expected, format!("{width} x {height}")));
            }
            let turn = DQuat::from_mat3(&pose.rotation.transpose());
            keys.push(Key { time, center: pose.center(), turn, lens: DVec4::new(k.fx.ln(), k.fy.ln(), k.cx, k.cy) });
        }
        Ok(Self { keys, size })
    }

    /// Seconds from the first key to the last one.
    pub fn seconds(&self) -> f64 {
        self.keys[self.keys.len() - 1].time - self.keys[0].time
    }

    /// The camera so many seconds after the first key; before the first and after the last key it stands still.
    pub fn at(&self, seconds: f64) -> Camera {
        let time = seconds.clamp(0.0, self.seconds()) + self.keys[0].time;
        let i = self.keys.partition_point(|key| key.time <= time).clamp(1, self.keys.len() - 1) - 1;
        let (a, b) = (&self.keys[i], &self.keys[i + 1]);
        let (h, from, to) = (b.time - a.time, self.tangent(i), self.tangent(i + 1));
        let u = ((time - a.time) / h).clamp(0.0, 1.0);
        let center =
            bezier([a.center, a.center + from.center * h / 3.0, b.center - to.center * h / 3.0, b.center], |p, q| {
                p.lerp(q, u)
            });
        let lens =
            bezier([a.lens, a.lens + from.lens * h / 3.0, b.lens - to.lens * h / 3.0, b.lens], |p, q| p.lerp(q, u));
        let turned = |q: DQuat, by: DVec3| q * DQuat::from_scaled_axis(by);
        let turn = bezier(
            [a.turn, turned(a.turn, from.turn * h / 3.0), turned(b.turn, -to.turn * h / 3.0), b.turn],
            |p, q| turned(p, u * turn_between(p, q)),
        );
        let rotation = DMat3::from_quat(turn.normalize()).transpose();
        let [width, height] = self.size;
        let intrinsics = Intrinsics { fx: lens.x.exp(), fy: lens.y.exp(), cx: lens.z, cy: lens.w };
        Camera { pose: Pose::new(rotation, -(rotation * center)), intrinsics, width, height }
    }

    /// `count` cameras at equal steps of time, from the first key to the last one.
    pub fn frames(&self, count: usize) -> Vec<Frame> {
        let step = self.seconds() / (count.max(2) - 1) as f64;
        (0..count).map(|i| Frame::new(format!("{i:04}"), self.at(i as f64 * step))).collect()
    }

    fn slope(&self, i: usize) -> Slope {
        let (a, b) = (&self.keys[i], &self.keys[i + 1]);
        let h = b.time - a.time;
        Slope { center: (b.center - a.center) / h, turn: turn_between(a.turn, b.turn) / h, lens: (b.lens - a.lens) / h }
    }

    fn tangent(&self, i: usize) -> Slope {
        let last = self.keys.len() - 1;
        if i == 0 || i == last {
            return self.slope(i.min(last - 1));
        }
        let (before, after) = (self.slope(i - 1), self.slope(i));
        let [h, next] = [i - 1, i].map(|i| self.keys[i + 1].time - self.keys[i].time);
        let share = h / (h + next);
        Slope {
            center: before.center.lerp(after.center, share),
            turn: before.turn.lerp(after.turn, share),
            lens: before.lens.lerp(after.lens, share),
        }
    }
}

/// De Casteljau's construction with a way to go from one point to another.
fn bezier<T: Copy>([a, b, c, d]: [T; 4], go: impl Fn(T, T) -> T) -> T {
    let (ab, bc, cd) = (go(a, b), go(b, c), go(c, d));
    go(go(ab, bc), go(bc, cd))
}

/// The shorter turn from one rotation to another, axis times angle, in the axes of the first.
fn turn_between(from: DQuat, to: DQuat) -> DVec3 {
    let turn = from.conjugate() * to;
    if turn.w < 0.0 { (-turn).to_scaled_axis() } else { turn.to_scaled_axis() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::trajectory;

    fn key(time: f64, eye: [f64; 3], target: [f64; 3], fx: f64) -> Frame {
        let pose = trajectory::look_at(DVec3::from(eye), DVec3::from(target), DVec3::NEG_Y);
        let intrinsics = Intrinsics { fx, fy: fx, cx: 32.0, cy: 24.0 };
        Frame { time: Some(time), ..Frame::new("", Camera { pose, intrinsics, width: 64, height: 48 }) }
    }

    fn keys() -> Vec<Frame> {
        vec![
            key(1.0, [0.0, 0.0, -3.0], [0.0; 3], 60.0),
            key(2.5, [2.0, -0.5, -2.0], [0.1, 0.0, 0.0], 40.0),
            key(3.0, [3.0, -1.0, 1.0], [0.0, 0.2, 0.0], 50.0),
            key(6.0, [-1.0, 0.5, 2.0], [0.0; 3], 60.0),
        ]
    }

    fn differ(a: &Camera, b: &Camera) -> f64 {
        let turn = (a.pose.rotation - b.pose.rotation).to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
        turn + a.pose.center().distance(b.pose.center()) + (a.intrinsics.fx - b.intrinsics.fx).abs()
    }

    #[test]
    fn a_path_passes_its_keys_without_a_jerk() {
        let path = Keyframes::new(&keys()).unwrap();
        assert!((path.seconds() - 5.0).abs() < 1e-12);
        for key in keys() {
            let t = key.time.unwrap() - 1.0;
            assert!(differ(&path.at(t), &key.camera) < 1e-9, "{t}");
            // Velocities before and after a key agree.
            if t > 0.0 && t < 5.0 {
                let step = 1e-5;
                let [before, after] = [(t - step, t), (t, t + step)].map(|(from, to)| {
                    let (a, b) = (path.at(from), path.at(to));
                    ((b.pose.center() - a.pose.center()) / step, (b.pose.rotation - a.pose.rotation) * (1.0 / step))
                });
                assert!(before.0.distance(after.0) < 1e-3, "{} and {}", before.0, after.0);
                assert!((before.1 - after.1).to_cols_array().iter().all(|x| x.abs() < 1e-3), "{t}");
            }
        }
    }

    #[test]
    fn equal_times_give_catmull_and_rom() {
        let mut frames = keys();
        frames.iter_mut().zip(0..).for_each(|(frame, i)| frame.time = Some(f64::from(i)));
        let path = Keyframes::new(&frames).unwrap();
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| frames[i].camera.pose.center());
        // The uniform spline in its usual form, at the middle of the second part.
        let expected = (-a + 9.0 * b + 9.0 * c - d) / 16.0;
        assert!(path.at(1.5).pose.center().distance(expected) < 1e-12);
    }

    #[test]
    fn frames_are_at_equal_times() {
        let path = Keyframes::new(&keys()).unwrap();
        let frames = path.frames(11);
        assert_eq!((frames.len(), frames[3].name.as_str()), (11, "0003"));
        assert!(differ(&frames[3].camera, &path.at(1.5)) < 1e-12);
        assert!(differ(&frames[10].camera, &keys()[3].camera) < 1e-9);
    }

    #[test]
    fn keys_that_contradict_are_named() {
        let said = |change: &dyn Fn(&mut Vec<Frame>)| {
            let mut frames = keys();
            change(&mut frames);
            Keyframes::new(&frames).unwrap_err().to_string()
        };
        assert_eq!(said(&|f| f.truncate(1)), "frames: expected at least two keys, found 1");
        assert_eq!(said(&|f| f.clear()), "frames: expected at least two keys, found 0");
        assert_eq!(said(&|f| f[2].time = Some(2.5)), "frames[2].time: expected a time after 2.5, found 2.5");
        assert_eq!(said(&|f| f[1].time = None), "frames[1].time: expected a time in seconds, found nothing");
        assert_eq!(said(&|f| f[1].time = Some(f64::NAN)), "frames[1].time: expected a time in seconds, found NaN");
        assert_eq!(
            said(&|f| f[3].camera.width = 65),
            "frames[3].w, h: expected 64 x 48, as frames[0] has, found 65 x 48"
        );
    }
}
