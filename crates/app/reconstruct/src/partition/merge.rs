//! Fits of blocks joined.

use super::Region;
use weaver_scene::Gaussians;

/// The Gaussians of each fit whose centers lie in its region, one fit after the other, with harmonics up to the
/// largest degree among them.
///
/// ```
/// use weaver_reconstruct::partition::{Cut, Region, merged};
/// use weaver_scene::Gaussians;
/// let side = |above| Region { cuts: vec![Cut { normal: [1.0, 0.0, 0.0], offset: 0.0, above }] };
/// let fit = Gaussians {
///     means: vec![[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
///     log_scales: vec![[-3.0; 3]; 2],
///     quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
///     opacity_logits: vec![0.0; 2],
///     sh: vec![0.0; 6],
///     degree: 0,
/// };
/// // Both fits have both Gaussians; the scene has each once.
/// assert_eq!(merged(&[(side(false), fit.clone()), (side(true), fit.clone())]), fit);
/// ```
pub fn merged(fits: &[(Region, Gaussians)]) -> Gaussians {
    let own = |(region, fit): &(Region, Gaussians)| {
        let inside: Vec<usize> = (0..fit.len()).filter(|i| region.contains(fit.means[*i])).collect();
        fit.select(&inside)
    };
    Gaussians::joined(&fits.iter().map(own).collect::<Vec<_>>())
}
