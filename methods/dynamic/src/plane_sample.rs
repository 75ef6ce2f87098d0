//! Bilinear samples of a plane of features.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

/// Points in a parallel task.
const GRAIN: usize = 256;

#[derive(Debug)]
struct PlaneSample;

/// Place of a point: the first of its four cells, its offset beyond the cell, and the derivative of the offset.
struct Place<T> {
    cell: usize,
    x: T,
    y: T,
    /// Cells per unit of each coordinate; 0 for a clamped coordinate.
    slope: [T; 2],
}

impl<T: Real> Place<T> {
    fn of([u, v]: [T; 2], [rows, columns]: [usize; 2]) -> Self {
        let along = |coordinate: T, count: usize| {
            let half = T::from_f64((count - 1) as f64 / 2.0);
            let inside = coordinate >= -T::ONE && coordinate <= T::ONE;
            let clamped = coordinate.max(-T::ONE).min(T::ONE);
            let at = (clamped + T::ONE) * half;
            let first = (at.to_f64() as usize).min(count - 2);
            (first, at - T::from_usize(first), if inside { half } else { T::ZERO })
        };
        let ((column, x, by_u), (row, y, by_v)) = (along(u, columns), along(v, rows));
        Self { cell: row * columns + column, x, y, slope: [by_u, by_v] }
    }

    /// The four cells and their weights.
    fn corners(&self, columns: usize) -> [(usize, T); 4] {
        let (x, y, c) = (self.x, self.y, self.cell);
        [
            (c, (T::ONE - x) * (T::ONE - y)),
            (c + 1, x * (T::ONE - y)),
            (c + columns, (T::ONE - x) * y),
            (c + columns + 1, x * y),
        ]
    }
}

fn sizes(plane: Shape) -> (usize, [usize; 2]) {
    (plane[0], [plane[1], plane[2]])
}

impl<T: Real> Op<T> for PlaneSample {
    fn name(&self) -> &'static str {
        "plane_sample"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let fits = ins.len() == 2 && ins[0].rank() == 3 && ins[1].rank() == 2 && ins[1][1] == 2;
        let large = |plane: &Shape| plane[0] > 0 && plane[1] > 1 && plane[2] > 1;
        ensure_shape!(fits && large(&ins[0]), "a plane [C, rows, columns], at least 2 x 2, and places [N, 2]");
        Ok(Shapes::one([ins[1][0], ins[0][0]]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (channels, size) = sizes(ins[0].shape());
        let (plane, places, cells) = (&*ins[0], &*ins[1], size[0] * size[1]);
        parallel::for_chunks(&mut outs[0], GRAIN * channels, |chunk, out| {
            for (i, features) in out.chunks_exact_mut(channels).enumerate() {
                let at = 2 * (chunk * GRAIN + i);
                let corners = Place::of([places[at], places[at + 1]], size).corners(size[1]);
                for (channel, feature) in features.iter_mut().enumerate() {
                    let map = &plane[channel * cells..][..cells];
                    *feature = T::ZERO;
                    corners.iter().for_each(|(cell, weight)| *feature += *weight * map[*cell]);
                }
            }
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let (channels, size) = sizes(ins[0].shape());
        let (plane, places, cells) = (&*ins[0], &*ins[1], size[0] * size[1]);
        let slopes = &*douts[0];
        let [of_plane, of_places] = dins else { return };
        if let Some(gradient) = of_plane {
            // One channel after the other in each task, points in their order: no sum depends on threads.
            parallel::for_chunks(gradient.accumulator(), cells, |channel, map| {
                for (point, place) in places.chunks_exact(2).enumerate() {
                    let slope = slopes[point * channels + channel];
                    for (cell, weight) in Place::of([place[0], place[1]], size).corners(size[1]) {
                        map[cell] += weight * slope;
                    }
                }
            });
        }
        if let Some(gradient) = of_places {
            parallel::for_chunks(gradient.accumulator(), 2 * GRAIN, |chunk, all| {
                for (i, to) in all.chunks_exact_mut(2).enumerate() {
                    let point = chunk * GRAIN + i;
                    let place = Place::of([places[2 * point], places[2 * point + 1]], size);
                    let (mut by_u, mut by_v) = (T::ZERO, T::ZERO);
                    for (channel, slope) in slopes[point * channels..][..channels].iter().enumerate() {
                        let map = &plane[channel * cells + place.cell..];
                        let [a, b, c, d] = [map[0], map[1], map[size[1]], map[size[1] + 1]];
                        by_u += *slope * ((T::ONE - place.y) * (b - a) + place.y * (d - c));
                        by_v += *slope * ((T::ONE - place.x) * (c - a) + place.x * (d - b));
                    }
                    to[0] += by_u * place.slope[0];
                    to[1] += by_v * place.slope[1];
                }
            });
        }
    }
}

/// Features `[N, C]` of a plane `[C, rows, columns]` at places `[N, 2]`: the first coordinate runs along the columns,
/// the second along the rows, both from -1 at the middle of the first cell to 1 at the middle of the last.
///
/// Between cells features are bilinear; beyond the border they are constant. Differentiable in plane and places; a
/// coordinate beyond the border has no gradient.
///
/// # Panics
/// Unless the plane has at least two rows and two columns.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let plane = tape.constant(&[0.0, 1.0, 10.0, 11.0], [1, 2, 2]);
/// let places = tape.constant(&[-1.0, -1.0, 0.0, 1.0, 3.0, 0.0], [3, 2]);
/// assert_eq!(weaver_dynamic::plane_sample(plane, places).to_vec(), [0.0, 10.5, 6.0]);
/// ```
#[track_caller]
pub fn plane_sample<'t, T: Real>(plane: Var<'t, T>, places: Var<'t, T>) -> Var<'t, T> {
    let [features] = plane.tape().apply(PlaneSample, &[plane, places]);
    features
}
