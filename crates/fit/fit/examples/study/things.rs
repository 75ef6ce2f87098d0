//! Things planted before photos, and how much of them a fit has found.

use weaver_fit::{Fit, Photo};
use weaver_kernels::random::Stream;

/// Kinds of things.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Kind {
    /// An ellipse of an eighth of the photo.
    Ellipse,
    /// A rectangle of an eighth of the photo that may reach beyond its border.
    Card,
    /// Some forty leaves in one part of the photo.
    Leaves,
    /// A smooth blob that reaches into the photo from its border.
    Finger,
}

/// Kinds that follow one another where all are planted.
const ALL: [Kind; 4] = [Kind::Ellipse, Kind::Card, Kind::Leaves, Kind::Finger];

/// Planted things: the photos' pixels that show them.
pub struct Things {
    /// For each photo: its kind and pixels, if there is one.
    pub of: Vec<Option<(Kind, Vec<bool>)>>,
}

impl Things {
    /// Puts a thing of its own before every so many photos, of one kind after another or ellipses alone. It shows a
    /// part of one of the `shown` photos, upside down.
    pub fn plant(photos: &mut [Photo], every: usize, shown: &[Photo], all_kinds: bool) -> Self {
        let count = photos.len();
        let mut of = vec![None; count];
        for i in (0..count).step_by(every) {
            let kind = if all_kinds { ALL[i / every % ALL.len()] } else { Kind::Ellipse };
            let stream = Stream::new(0, i as u64, "planted");
            let other = &shown[(i + shown.len() / 2) % shown.len()];
            let (width, height) = (photos[i].camera.width, photos[i].camera.height);
            let inside: Vec<bool> = (0..width * height)
                .map(|at| {
                    let (x, y) = ((at % width) as f64 / width as f64, (at / width) as f64 / height as f64);
                    is_inside(kind, [x, y], &stream)
                })
                .collect();
            for at in (0..width * height).filter(|at| inside[*at]) {
                // A finger is out of focus: one color.
                let (column, row) =
                    if kind == Kind::Finger { (width / 2, height / 2) } else { (at % width, at / width) };
                let (ox, oy) = (column * other.camera.width / width, (height - 1 - row) * other.camera.height / height);
                let from = oy * other.camera.width + ox;
                photos[i].rgb[3 * at..3 * at + 3].copy_from_slice(&other.rgb[3 * from..3 * from + 3]);
            }
            of[i] = Some((kind, inside));
        }
        Self { of }
    }

    /// Masks the things, as somebody who knows them would.
    pub fn mask(&self, photos: &mut [Photo]) {
        for (photo, thing) in photos.iter_mut().zip(&self.of) {
            let Some((_, inside)) = thing else { continue };
            let own = photo.mask.get_or_insert_with(|| vec![true; inside.len()]);
            own.iter_mut().zip(inside).for_each(|(counts, inside)| *counts &= !inside);
        }
    }

    /// The part of the things that is left out, the part of the left-out pixels that are things, and the part of photos
    /// without one that is left out; with `each`, also the first two of every thing.
    pub fn found(&self, fit: &Fit, each: bool) -> String {
        let [mut hits, mut things, mut hidden_there, mut wrong, mut elsewhere] = [0; 5];
        let mut rows = String::new();
        for (photo, thing) in self.of.iter().enumerate() {
            let camera = fit.photo(photo).camera;
            let hidden = fit.transients(photo).map(|found| found.at_size(camera.width, camera.height));
            let hidden = hidden.unwrap_or_else(|| vec![false; camera.width * camera.height]);
            let count = |of: &dyn Fn(usize) -> bool| (0..hidden.len()).filter(|at| of(*at)).count();
            let Some((kind, inside)) = thing else {
                wrong += count(&|at| hidden[at]);
                elsewhere += hidden.len();
                continue;
            };
            let own = [count(&|at| hidden[at] && inside[at]), count(&|at| inside[at]), count(&|at| hidden[at])];
            if each {
                rows += &format!("; {kind:?} {:.2} {:.2}", ratio(own[0], own[1]), ratio(own[0], own[2]));
            }
            hits += own[0];
            things += own[1];
            hidden_there += own[2];
        }
        format!(
            "recall {:.3}, precision {:.3}, elsewhere {:.4}{rows}",
            ratio(hits, things),
            ratio(hits, hidden_there),
            ratio(wrong, elsewhere)
        )
    }
}

fn ratio(part: usize, whole: usize) -> f64 {
    part as f64 / whole.max(1) as f64
}

/// True if a place, from 0 to 1 each way, is in a thing.
fn is_inside(kind: Kind, [x, y]: [f64; 2], stream: &Stream) -> bool {
    let random = |i: u64| stream.uniform::<f64>(i);
    let ellipse = |cx: f64, cy: f64, rx: f64, ry: f64| ((x - cx) / rx).powi(2) + ((y - cy) / ry).powi(2) < 1.0;
    match kind {
        Kind::Ellipse => ellipse(0.25 + 0.5 * random(0), 0.25 + 0.5 * random(1), 0.2, 0.2),
        Kind::Card => (x - random(0)).abs() < 0.2 && (y - random(1)).abs() < 0.2,
        Kind::Leaves => (0..40).any(|leaf| {
            let [dx, dy, size, shape] = [2, 3, 4, 5].map(|i| random(6 * leaf + i));
            let [cx, cy] = [0.6 * random(0) + 0.4 * dx, 0.6 * random(1) + 0.4 * dy];
            let size = 0.02 + 0.03 * size;
            ellipse(cx, cy, size * (0.5 + shape), size * (1.5 - shape))
        }),
        Kind::Finger => ellipse(random(0), 0.0, 0.2, 0.45) || ellipse(0.0, random(1), 0.25, 0.1),
    }
}
