//! The 8 x 8 Bayer matrix: 64 thresholds in an order that spreads any number of them evenly.

/// Side of the pattern.
pub const SIDE: usize = 8;

/// Where the pattern starts in views 0, 1, 2, 3 (then again), so that views do not keep the same pixels.
const SHIFTS: [(usize, usize); 4] = [(0, 0), (3, 5), (6, 2), (1, 7)];

/// The rank, 0 to 63, of cell (row, column): B' = [[4B, 4B + 2], [4B + 3, 4B + 1]], three times from B = 0.
const RANKS: [[u8; SIDE]; SIDE] = ranks();

const fn ranks() -> [[u8; SIDE]; SIDE] {
    const QUADRANT: [[u8; 2]; 2] = [[0, 2], [3, 1]];
    let mut table = [[0; SIDE]; SIDE];
    let mut row = 0;
    while row < SIDE {
        let mut column = 0;
        while column < SIDE {
            let mut bit = 0;
            while bit < 3 {
                // The last doubling sets four whole copies side by side: it is the highest bit of a position and adds
                // the smallest amount.
                let quadrant = QUADRANT[(row >> bit) & 1][(column >> bit) & 1];
                table[row][column] += quadrant << (2 * (2 - bit));
                bit += 1;
            }
            column += 1;
        }
        row += 1;
    }
    table
}

/// The threshold (rank + 1/2) / 64 of a pixel under the pattern tiled over the image and moved down by `shift.0` and
/// right by `shift.1`.
pub fn threshold(row: usize, column: usize, shift: (usize, usize)) -> f64 {
    let back = |at: usize, by: usize| (at + SIDE - by % SIDE) % SIDE;
    (f64::from(RANKS[back(row, shift.0)][back(column, shift.1)]) + 0.5) / (SIDE * SIDE) as f64
}

/// The shift of the pattern in a view.
pub fn view_shift(view: usize) -> (usize, usize) {
    SHIFTS[view % SHIFTS.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_matrix_is_the_recursive_one() {
        let mut matrix = vec![vec![0_u8]];
        for _ in 0..3 {
            let n = matrix.len();
            let mut next = vec![vec![0; 2 * n]; 2 * n];
            for r in 0..2 * n {
                for c in 0..2 * n {
                    next[r][c] = 4 * matrix[r % n][c % n] + [[0, 2], [3, 1]][r / n][c / n];
                }
            }
            matrix = next;
        }
        assert_eq!(matrix, RANKS.map(|row| row.to_vec()));
        let mut all: Vec<u8> = RANKS.concat();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..64));
        // The middles of 64 equal parts of [0, 1].
        assert_eq!([threshold(0, 0, (0, 0)), threshold(1, 0, (0, 0))], [0.5 / 64.0, 48.5 / 64.0]);
    }

    #[test]
    fn a_shift_moves_the_pattern_down_and_right() {
        for (row, column) in [(0, 0), (2, 9), (7, 4), (13, 30)] {
            assert_eq!(threshold(row + 3, column + 5, (3, 5)), threshold(row, column, (0, 0)));
            assert_eq!(threshold(row + 8, column, (3, 5)), threshold(row, column, (3, 5)));
        }
    }
}
