//! Rectangles side by side in a square.

use super::GUTTER;
use super::charts::Chart;

/// Halvings of the range in which the scale of the charts is searched.
const HALVINGS: usize = 24;

/// The largest number of texels on a unit of the world at which all charts fit, and the texel of each one's corner;
/// none where they do not fit at any.
pub fn placed(charts: &[Chart], size: usize) -> Option<(f64, Vec<[usize; 2]>)> {
    let sides = |texels: f64| -> Vec<[usize; 2]> {
        let side = |length: f64| (length * texels).ceil() as usize + 2 * GUTTER;
        charts.iter().map(|chart| chart.size.to_array().map(side)).collect()
    };
    let area: f64 = charts.iter().map(|chart| chart.size.x * chart.size.y).sum();
    // No charts are larger than the picture.
    let (mut low, mut high) = (0.0, size as f64 / area.sqrt().max(f64::MIN_POSITIVE));
    let mut best = rows(&sides(low), size)?;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match rows(&sides(middle), size) {
            Some(places) => (low, best) = (middle, places),
            None => high = middle,
        }
    }
    Some((low, best))
}

/// The upper left corners of rectangles in rows, the highest first; none where they need more room.
fn rows(sides: &[[usize; 2]], size: usize) -> Option<Vec<[usize; 2]>> {
    let mut order: Vec<usize> = (0..sides.len()).collect();
    order.sort_by_key(|i| (std::cmp::Reverse(sides[*i][1]), *i));
    let mut places = vec![[0; 2]; sides.len()];
    let (mut x, mut y, mut row) = (0, 0, 0);
    for i in order {
        let [width, height] = sides[i];
        if x + width > size {
            (x, y, row) = (0, y + row, 0);
        }
        row = row.max(height);
        if width > size || y + row > size {
            return None;
        }
        places[i] = [x, y];
        x += width;
    }
    Some(places)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_stand_in_rows_apart() {
        let sides: Vec<[usize; 2]> = (0..40).map(|i| [3 + i % 7, 2 + i % 5]).collect();
        let places = rows(&sides, 40).unwrap();
        let apart = |i: usize, k: usize| {
            (0..2).any(|a| places[i][a] + sides[i][a] <= places[k][a] || places[k][a] + sides[k][a] <= places[i][a])
        };
        assert!((0..40).all(|i| (0..i).all(|k| apart(i, k))));
        assert!((0..40).all(|i| (0..2).all(|a| places[i][a] + sides[i][a] <= 40)));
        assert_eq!((rows(&sides, 20), rows(&[[50, 1]], 40)), (None, None));
    }
}
