//! Relative poses of all pairs of cameras.

use weaver_autograd::{Real, Var};

/// For all ordered pairs of different cameras, X_ij = w2c_i w2c_j^-1: rotations `[B, N (N - 1), 9]` and translations
/// `[B, N (N - 1), 3]`.
///
/// R_ij = R_i R_j^T, t_ij = t_i - R_ij t_j, rows (i, j) in order. `viewmats` [R | t] `[B, N, 3, 4]`. Differentiable,
/// the entries of R taken as independent. A common rigid motion of the world changes neither.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let at = |x: f64| [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// let [_, t] = weaver_pose::relative_poses(tape.constant(&[at(1.0), at(3.0)].concat(), [1, 2, 3, 4]));
/// assert_eq!(t.to_vec(), [-2.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
/// ```
#[track_caller]
pub fn relative_poses<T: Real>(viewmats: Var<'_, T>) -> [Var<'_, T>; 2] {
    let shape = viewmats.shape();
    let fits = shape.rank() == 4 && shape.dims()[2..] == [3, 4];
    viewmats.tape().ensure_shapes(fits, "relative_poses", "viewmats [B, N, 3, 4]", &[shape]);
    let [batch, n] = [shape[0], shape[1]];
    let (rotations, translations) = (viewmats.slice(3, 0, 3), viewmats.slice(3, 3, 1));
    let stacked = rotations.reshape([batch, 3 * n, 3]);
    let pairs = stacked.matmul_with(stacked, false, true).reshape([batch, n, 3, n, 3]).permute(&[0, 1, 3, 2, 4]);
    // R_i R_j^T t_j, where -R_j^T t_j is the center of camera j.
    let centers = rotations.matmul_with(translations, true, false).reshape([batch, n, 3]);
    let turned = stacked.matmul_with(centers, false, true).reshape([batch, n, 3, n]).permute(&[0, 1, 3, 2]);
    let own = translations.reshape([batch, n, 1, 3]).expand([batch, n, n, 3]);
    let of_others =
        |b: usize| (0..n * n).filter(move |pair| pair / n != pair % n).map(move |pair| (b * n * n + pair) as u32);
    let rows: Vec<u32> = (0..batch).flat_map(of_others).collect();
    let count = n * n.saturating_sub(1);
    [(pairs, 9), (own - turned, 3)]
        .map(|(all, width)| all.reshape([batch * n * n, width]).gather_rows(&rows).reshape([batch, count, width]))
}
