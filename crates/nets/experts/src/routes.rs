//! The pixels of each expert, and the pixel of each Gaussian.

use weaver_autograd::{Buffer, List, Pool};

/// The pixels of each expert, and the pixel of each Gaussian.
///
/// Gaussians are ordered by expert, then pixel; the Gaussians of a pixel are adjacent.
#[derive(Debug)]
pub struct Routes {
    /// The pixels with Gaussians: expert 1's in pixel order, then expert 2's, ...
    pub routed: Buffer<u32>,
    /// Number of pixels of each of the experts 1 to M.
    pub counts: List<usize>,
    /// For each Gaussian, the position of its pixel in `routed` `[N]`.
    pub source: Buffer<u32>,
    /// For each Gaussian, its pixel `[N]`.
    pub pixel: Buffer<u32>,
}

impl Routes {
    /// The routes of an assignment (`expert` `[P]`) to experts 0 to M = `max_per_pixel`. Panics if a
    /// pixel has a higher expert.
    pub fn new(expert: &[u8], max_per_pixel: usize, pool: &Pool) -> Self {
        let mut counts: List<usize> = std::iter::repeat_n(0, max_per_pixel + 1).collect();
        for &e in expert {
            assert!(
                usize::from(e) <= max_per_pixel,
                "a pixel is assigned to expert {e}, the largest is {max_per_pixel}"
            );
            counts[usize::from(e)] += 1;
        }
        counts.remove(0);
        let gaussians = counts.iter().zip(1..).map(|(count, e)| count * e).sum();
        let mut routed = pool.buffer::<u32>(counts.iter().sum());
        let (mut source, mut pixel) = (pool.buffer::<u32>(gaussians), pool.buffer::<u32>(gaussians));
        let (mut route, mut gaussian) = (0, 0);
        for e in 1..=max_per_pixel {
            for (p, _) in expert.iter().enumerate().filter(|(_, chosen)| usize::from(**chosen) == e) {
                source[gaussian..gaussian + e].fill(route as u32);
                pixel[gaussian..gaussian + e].fill(p as u32);
                routed[route] = p as u32;
                route += 1;
                gaussian += e;
            }
        }
        Self { routed, counts, source, pixel }
    }

    /// Number of Gaussians N.
    pub fn gaussians(&self) -> usize {
        self.pixel.len()
    }

    /// The pixels of each expert 1 to M.
    pub fn by_expert(&self) -> impl Iterator<Item = &[u32]> {
        let mut rest = &*self.routed;
        self.counts.iter().map(move |&count| {
            let (own, others) = rest.split_at(count);
            rest = others;
            own
        })
    }

    /// The expert of each routed pixel.
    pub fn experts(&self) -> impl Iterator<Item = usize> {
        self.counts.iter().zip(1..).flat_map(|(&count, expert)| std::iter::repeat_n(expert, count))
    }

    /// True if no pixel has more than one Gaussian, so that Gaussians and routed pixels are the same list.
    pub fn is_single(&self) -> bool {
        self.routed.len() == self.pixel.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussians_are_ordered_by_expert_then_pixel() {
        let pool = Pool::new();
        let routes = Routes::new(&[2, 0, 1, 3, 1, 2], 3, &pool);
        assert_eq!(*routes.routed, [2, 4, 0, 5, 3]);
        assert_eq!(*routes.counts, [2, 2, 1]);
        assert_eq!(*routes.source, [0, 1, 2, 2, 3, 3, 4, 4, 4]);
        assert_eq!(*routes.pixel, [2, 4, 0, 0, 5, 5, 3, 3, 3]);
        let lists: Vec<_> = routes.by_expert().collect();
        assert_eq!(lists, [&[2, 4][..], &[0, 5], &[3]]);
        assert_eq!(Routes::new(&[0, 0], 3, &pool).gaussians(), 0);
    }
}
