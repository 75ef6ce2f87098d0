//! The best convex blend at each pixel, with the photo at hand: a bound that no router passes.

use weaver_kernels::Real;
use weaver_kernels::dense::gauss;

/// Most experts in a best blend of colors: three numbers lie in the hull of four points.
const MOST: usize = 4;
/// Flatness of a face, as a share of its points' squared distances, at which it adds nothing to a smaller one.
const FLAT: f64 = 1e-12;

/// The convex blend with the least squared error at each pixel: shares `[K, P]`, at least 0, that sum to 1 over the
/// experts, from pictures `[K, P, 3]` and the photo `[P, 3]`.
///
/// min |sum_k g_k I_k - photo|^2 over the simplex: least squares on every face of up to four experts, the best whose
/// shares are not negative.
///
/// ```
/// let images = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
/// let shares = weaver_studies::oracle::convex_oracle(&images, &[0.25; 3]);
/// assert_eq!(shares, [0.75, 0.25]);
/// ```
///
/// # Panics
/// Unless the pictures are some times as long as the photo, and there are at most 16 of them.
pub fn convex_oracle<T: Real>(images: &[T], photo: &[T]) -> Vec<f64> {
    let differences = Differences::new(images, photo);
    let experts = differences.experts;
    assert!(experts <= 16, "at most 16 experts, found {experts}");
    let faces: Vec<Vec<usize>> = (1..1_u32 << experts)
        .filter(|face| face.count_ones() as usize <= MOST)
        .map(|face| (0..experts).filter(|k| face >> k & 1 == 1).collect())
        .collect();
    let pixels = photo.len() / 3;
    let mut shares = vec![0.0; experts * pixels];
    for pixel in 0..pixels {
        let mut least = f64::INFINITY;
        for face in &faces {
            let Some((error, found)) = on_face(&differences, face, pixel) else { continue };
            if error < least {
                least = error;
                (0..experts).for_each(|k| shares[k * pixels + pixel] = 0.0);
                face.iter().zip(found).for_each(|(k, share)| shares[k * pixels + pixel] = share);
            }
        }
    }
    shares
}

/// Blend of pictures `[K, P, 3]` by shares `[K, P]`: `[P, 3]`.
///
/// # Panics
/// Unless there are three numbers for each share.
pub fn blend<T: Real>(images: &[T], shares: &[f64], pixels: usize) -> Vec<f64> {
    assert_eq!(images.len(), 3 * shares.len(), "three numbers for each of {} shares", shares.len());
    let mut sum = vec![0.0; 3 * pixels];
    for (images, shares) in images.chunks_exact(3 * pixels).zip(shares.chunks_exact(pixels)) {
        for (i, (to, image)) in sum.iter_mut().zip(images).enumerate() {
            *to += shares[i / 3] * image.to_f64();
        }
    }
    sum
}

/// Pictures minus the photo.
struct Differences {
    values: Vec<[f64; 3]>,
    experts: usize,
    pixels: usize,
}

impl Differences {
    fn new<T: Real>(images: &[T], photo: &[T]) -> Self {
        let whole = photo.len().is_multiple_of(3) && !photo.is_empty() && images.len().is_multiple_of(photo.len());
        assert!(whole, "pictures of the size of a photo with {} numbers, found {}", photo.len(), images.len());
        let of = |(image, photo): (&[T], &[T])| [0, 1, 2].map(|c| image[c].to_f64() - photo[c].to_f64());
        let values = images.chunks_exact(3).zip(photo.chunks_exact(3).cycle()).map(of).collect();
        Self { values, experts: images.len() / photo.len(), pixels: photo.len() / 3 }
    }

    fn at(&self, expert: usize, pixel: usize) -> [f64; 3] {
        self.values[expert * self.pixels + pixel]
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn squared(a: [f64; 3]) -> f64 {
    dot(a, a)
}

/// The squared error and shares of the best point in the plane through a face's experts; `None` if it is outside of the
/// face.
fn on_face(differences: &Differences, face: &[usize], pixel: usize) -> Option<(f64, Vec<f64>)> {
    let corner = differences.at(face[0], pixel);
    let edges: Vec<[f64; 3]> = face[1..]
        .iter()
        .map(|k| {
            let other = differences.at(*k, pixel);
            [0, 1, 2].map(|c| other[c] - corner[c])
        })
        .collect();
    let along = solved(&edges, corner)?;
    let mut shares = vec![1.0 - along.iter().sum::<f64>()];
    shares.extend(&along);
    if shares.iter().any(|share| *share < 0.0) {
        return None;
    }
    let mut left = corner;
    for (edge, share) in edges.iter().zip(&along) {
        (0..3).for_each(|c| left[c] += share * edge[c]);
    }
    Some((squared(left), shares))
}

/// The x that minimizes |corner + sum_i x_i edge_i|^2, by the normal equations; `None` for dependent edges.
fn solved(edges: &[[f64; 3]], corner: [f64; 3]) -> Option<Vec<f64>> {
    let mut matrix: Vec<f64> = edges.iter().flat_map(|edge| edges.iter().map(|other| dot(*edge, *other))).collect();
    let mut x: Vec<f64> = edges.iter().map(|edge| -dot(*edge, corner)).collect();
    gauss(&mut matrix, &mut x, |i, pivot| pivot > FLAT * squared(edges[i])).then_some(x)
}
