//! Lists of neighbors and parts of them.

use weaver_autograd::Pool;
use weaver_experts::Neighbors;
use weaver_kernels::random::Stream;

/// A part has the lists of its own and the reverse lists that belong to them.
#[test]
fn parts_have_lists_and_reverse_lists() {
    let stream = Stream::new(3, 0, "points");
    let points: Vec<f32> = (0..3 * 40).map(|i| stream.normal(i)).collect();
    let all = Neighbors::search(&points, 4, &Pool::new());
    let part = all.part(10..30).part(5..12);
    assert_eq!((part.len(), part.among(), part.per_gaussian()), (7, 40, 5));
    assert_eq!(part.index(), &all.index()[15 * 5..22 * 5]);
}
