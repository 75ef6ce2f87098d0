//! Pictures of score curves.

use weaver_io::Image;

const WIDTH: usize = 960;
const HEIGHT: usize = 240;
const MARGIN: f32 = 12.0;
const BAND: [f32; 3] = [1.0, 0.86, 0.84];
const GRID: [f32; 3] = [0.88; 3];
const INK: [f32; 3] = [0.10, 0.28, 0.62];

/// The curves of a video, drawn over its anomalous parts.
#[derive(Clone, Debug, Default)]
pub struct Chart<'a> {
    /// The final curve, a score in [0, 1] for each snippet.
    pub scores: &'a [f32],
    /// Further curves, thin and in colors of their own.
    pub others: Vec<&'a [f32]>,
    /// Anomalous share of each snippet; empty if unknown.
    pub anomalous: Vec<f32>,
}

impl Chart<'_> {
    /// Draws time from left to right, scores 0 to 1 from bottom to top with lines at 0, 0.5 and 1, and a band behind
    /// anomalous snippets.
    pub fn draw(&self) -> Image {
        let mut image = Image::filled(WIDTH, HEIGHT, [1.0; 3]);
        let count = self.scores.len().max(1);
        let (left, right, top, bottom) = (MARGIN, WIDTH as f32 - MARGIN, MARGIN, HEIGHT as f32 - MARGIN);
        let x_of = |t: f32| left + t / count as f32 * (right - left);
        let y_of = |s: f32| bottom - s.clamp(0.0, 1.0) * (bottom - top);
        for (t, share) in self.anomalous.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            let (from, to) = (x_of(t as f32), x_of(t as f32 + 1.0));
            for x in from as usize..(to.ceil() as usize).min(WIDTH) {
                // Overlap of the pixel and the snippet.
                let inside = (to.min(x as f32 + 1.0) - from.max(x as f32)).clamp(0.0, 1.0);
                (top as usize..bottom as usize).for_each(|y| blend(&mut image, x, y, BAND, share * inside));
            }
        }
        for level in [0.0, 0.5, 1.0] {
            let y = y_of(level);
            line(&mut image, [[left, y], [right, y]], 1.0, GRID);
        }
        let mut curve = |scores: &[f32], width: f32, color: [f32; 3]| {
            let points: Vec<[f32; 2]> =
                scores.iter().enumerate().map(|(t, s)| [x_of(t as f32 + 0.5), y_of(*s)]).collect();
            points.windows(2).for_each(|pair| line(&mut image, [pair[0], pair[1]], width, color));
            if let [point] = points[..] {
                line(&mut image, [point, point], width, color);
            }
        };
        for (i, other) in self.others.iter().enumerate() {
            curve(other, 1.0, Self::color(i));
        }
        curve(self.scores, 2.4, INK);
        image
    }

    /// The color of curve `i` of the others.
    pub fn color(i: usize) -> [f32; 3] {
        const COLORS: [[f32; 3]; 6] = [
            [0.90, 0.55, 0.15],
            [0.25, 0.62, 0.35],
            [0.62, 0.40, 0.72],
            [0.75, 0.30, 0.35],
            [0.30, 0.65, 0.70],
            [0.55, 0.50, 0.35],
        ];
        COLORS[i % COLORS.len()]
    }
}

fn blend(image: &mut Image, x: usize, y: usize, color: [f32; 3], share: f32) {
    let pixel = &mut image.pixels[(y * image.width + x) * 3..][..3];
    pixel.iter_mut().zip(color).for_each(|(p, c)| *p += (c - *p) * share);
}

/// A line with soft edges: a pixel's coverage falls with the distance of its center from the line.
fn line(image: &mut Image, [a, b]: [[f32; 2]; 2], width: f32, color: [f32; 3]) {
    let reach = width / 2.0 + 1.0;
    let columns = (a[0].min(b[0]) - reach).max(0.0) as usize..((a[0].max(b[0]) + reach) as usize + 1).min(image.width);
    let rows = (a[1].min(b[1]) - reach).max(0.0) as usize..((a[1].max(b[1]) + reach) as usize + 1).min(image.height);
    let d = [b[0] - a[0], b[1] - a[1]];
    let length = (d[0] * d[0] + d[1] * d[1]).max(1e-9);
    for y in rows {
        for x in columns.clone() {
            let p = [x as f32 + 0.5 - a[0], y as f32 + 0.5 - a[1]];
            let along = ((p[0] * d[0] + p[1] * d[1]) / length).clamp(0.0, 1.0);
            let off = ((p[0] - along * d[0]).powi(2) + (p[1] - along * d[1]).powi(2)).sqrt();
            let share = (width / 2.0 + 0.5 - off).clamp(0.0, 1.0);
            if share > 0.0 {
                blend(image, x, y, color, share);
            }
        }
    }
}
