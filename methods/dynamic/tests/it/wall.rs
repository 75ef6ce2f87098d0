//! A wall drawn by two experts in the same place, each in its true colors where it is right and with permuted channels
//! elsewhere.

use weaver_autograd::{Real, Tape};
use weaver_dynamic::Shot;
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};

pub const SIZE: [usize; 2] = [12, 16];
pub const PIXELS: usize = SIZE[0] * SIZE[1];
/// Gaussians of an expert.
pub const COUNT: usize = 63;
const DEPTH: f64 = 2.0;

/// Position of a camera on the arc, in degrees from the middle, and time.
#[derive(Clone, Copy)]
pub struct Moment {
    pub angle: f64,
    pub time: f64,
}

/// True if an expert is right about a Gaussian at x.
pub type Right = fn(usize, f64, Moment) -> bool;

pub fn owners() -> Vec<usize> {
    (0..2 * COUNT).map(|i| i / COUNT).collect()
}

fn place(i: usize) -> [f64; 2] {
    [0.25 * (i % 9) as f64 - 1.0, 0.25 * (i / 9) as f64 - 0.75]
}

fn color([x, y]: [f64; 2]) -> [f64; 3] {
    [0.8, 0.4 + 0.2 * (4.0 * x).sin(), 0.1 + 0.1 * (5.0 * y).cos()]
}

fn gaussians<'t, T: Real>(tape: &'t Tape<T>, colors: &[[f64; 3]]) -> GaussianVars<'t, T> {
    let n = colors.len();
    let of = |width: usize, value: &dyn Fn(usize, usize) -> f64| {
        tape.constant_with([n, width], |all| {
            all.iter_mut().enumerate().for_each(|(i, x)| *x = T::from_f64(value(i / width, i % width)));
        })
    };
    GaussianVars {
        means: of(3, &|i, axis| if axis < 2 { place(i % COUNT)[axis] } else { DEPTH }),
        quats: of(4, &|_, axis| if axis == 0 { 1.0 } else { 0.0 }),
        scales: of(3, &|_, _| 0.12),
        opacities: of(1, &|_, _| 0.9).reshape([n]),
        colors: of(3, &|i, channel| colors[i][channel]),
    }
}

pub fn shot<'a, 't, T: Real>(tape: &'t Tape<T>, pool: &'a WorkspacePool<T>, at: Moment) -> Shot<'a, 't, T> {
    let (sin, cos) = at.angle.to_radians().sin_cos();
    let numbers = |values: &[f64]| values.iter().map(|x| T::from_f64(*x)).collect::<Vec<_>>();
    // Turned about the middle of the wall.
    let view = [cos, 0.0, sin, -sin * DEPTH, 0.0, 1.0, 0.0, 0.0, -sin, 0.0, cos, DEPTH - cos * DEPTH];
    Shot {
        camera: CameraVars {
            viewmats: tape.constant(&numbers(&view), [1, 3, 4]),
            intrinsics: tape.constant(&numbers(&[16.0, 16.0, 8.0, 6.0]), [1, 4]),
        },
        time: at.time,
        size: SIZE,
        background: tape.constant(&numbers(&[0.1, 0.2, 0.3]), [3]),
        settings: RasterSettings::default(),
        workspaces: pool,
    }
}

/// Both experts' Gaussians.
pub fn experts<T: Real>(tape: &Tape<T>, right: Right, at: Moment) -> GaussianVars<'_, T> {
    let shown = |i: usize| {
        let [r, g, b] = color(place(i % COUNT));
        if right(i / COUNT, place(i % COUNT)[0], at) { [r, g, b] } else { [g, b, r] }
    };
    gaussians(tape, &(0..2 * COUNT).map(shown).collect::<Vec<_>>())
}

/// The photo `[P, 3]`.
pub fn photo<T: Real>(shot: &Shot<'_, '_, T>) -> Vec<T> {
    let tape = shot.background.tape();
    let truth = gaussians(tape, &(0..COUNT).map(|i| color(place(i))).collect::<Vec<_>>());
    let op = Rasterize::new(SIZE[1], SIZE[0], shot.settings, shot.workspaces).without_depth();
    op.apply(&truth, &shot.camera, shot.background).image.to_vec()
}

pub fn left(expert: usize, x: f64, _: Moment) -> bool {
    (x < 0.0) == (expert == 0)
}

pub fn early(expert: usize, _: f64, at: Moment) -> bool {
    (at.time < 0.5) == (expert == 0)
}

pub fn from_the_left(expert: usize, _: f64, at: Moment) -> bool {
    (at.angle < 0.0) == (expert == 0)
}
