//! Cells of quadtrees: exact counts, no holes, and detail where the photos have it.

use proptest::prelude::*;
use weaver_autograd::Pool;
use weaver_kernels::random::Stream;
use weaver_router::{Allocation, AllocationRequest, Assignment, COARSEST, Cell, Quadtree, QuadtreeGrid, QuadtreeMix};

/// Photos of noise, whose strength is `detail` of the place.
fn photos([views, height, width]: [usize; 3], seed: u64, detail: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let stream = Stream::new(seed, 0, "photos");
    let at = |i: usize| {
        let noise = stream.uniform::<f64>(i as u64) - 0.5;
        0.5 + noise * detail(i / width % height, i % width)
    };
    (0..views * 3 * height * width).map(at).collect()
}

struct Scene {
    photos: Vec<f64>,
    inside: Option<Vec<bool>>,
    logits: Vec<f64>,
    size: [usize; 3],
    pool: Pool,
}

impl Scene {
    fn new(size: [usize; 3], photos: Vec<f64>) -> Self {
        let logits = vec![0.0; 4 * size.iter().product::<usize>()];
        Self { photos, inside: None, logits, size, pool: Pool::new() }
    }

    fn allocate(&self, allocation: &dyn Allocation<f64>, seed: u64) -> Assignment<f64> {
        let [views, height, width] = self.size;
        allocation.allocate(&AllocationRequest {
            logits: &self.logits,
            energy: &[],
            photos: &self.photos,
            depth: None,
            views,
            height,
            width,
            stream: Stream::new(seed, 0, "allocation"),
            inside: self.inside.as_deref(),
            gumbel: None,
            pool: &self.pool,
        })
    }

    /// Number of cells that each pixel belongs to.
    fn owners(&self, assignment: &Assignment<f64>) -> Vec<u32> {
        let [_, height, width] = self.size;
        let cells = assignment.cells.as_ref().unwrap();
        let mut owners = vec![0; assignment.expert.len()];
        for (pixel, _) in assignment.expert.iter().enumerate().filter(|(_, e)| **e > 0) {
            let view = pixel / (height * width);
            let cell = Cell { row: pixel / width % height, column: pixel % width, level: cells.level[pixel] };
            for row in cell.rows(height) {
                cell.columns(width).for_each(|column| owners[(view * height + row) * width + column] += 1);
            }
        }
        owners
    }

    /// Number of cells of the coarsest level.
    fn roots(&self) -> usize {
        let [views, height, width] = self.size;
        views * height.div_ceil(1 << COARSEST) * width.div_ceil(1 << COARSEST)
    }
}

fn size() -> impl Strategy<Value = [usize; 3]> {
    (1..4usize, 1..40usize, 1..40usize).prop_map(|(v, h, w)| [v, h, w])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    /// Budgets are met exactly and every pixel has one cell.
    #[test]
    fn budgets_are_met_exactly(
        size in size(), budget in 0.0..3.2f64, grid: bool, seed in 0..1000u64
    ) {
        let scene = Scene::new(size, photos(size, seed, |row, column| ((row + column) % 7) as f64 / 7.0));
        let allocation: Box<dyn Allocation<f64>> =
            if grid { Box::new(QuadtreeGrid { budget }) } else { Box::new(Quadtree { budget }) };
        let assignment = scene.allocate(&*allocation, seed);
        let pixels = size.iter().product::<usize>();
        let (most, spare) = if grid { (1, 2) } else { (3, 0) };
        let expected = ((budget * pixels as f64).floor() as usize).clamp(scene.roots(), most * pixels);
        let count = assignment.count();
        prop_assert!(count <= expected && count + spare >= expected, "{count}, not {expected}");
        prop_assert!(scene.owners(&assignment).iter().all(|&owners| owners == 1));
        let density = assignment.density([size[1], size[2]]);
        let sum = density.iter().map(|d| f64::from(*d)).sum::<f64>();
        prop_assert!(density.iter().all(|d| *d > 0.0) && (sum - count as f64).abs() < 1e-3, "{sum}, not {count}");
        prop_assert_eq!(&*scene.allocate(&*allocation, seed + 1).expert, &*assignment.expert);
    }

    #[test]
    fn what_a_mask_hides_gets_nothing_and_has_no_say(
        size in size(), budget in 0.0..3.0f64, part in 0.0..1.0f64, grid: bool, seed in 0..1000u64
    ) {
        let mut scene = Scene::new(size, photos(size, seed, |_, _| 1.0));
        let [_, height, width] = size;
        // Blocks of 5 x 5 pixels.
        let block = |p: usize| (p / (height * width) * 64 + p / width % height / 5 * 8 + p % width / 5) as u64;
        let stream = Stream::new(seed, 1, "mask");
        let inside: Vec<bool> = (0..size.iter().product()).map(|p| stream.uniform::<f64>(block(p)) < part).collect();
        scene.inside = Some(inside.clone());
        let allocation: Box<dyn Allocation<f64>> =
            if grid { Box::new(QuadtreeGrid { budget }) } else { Box::new(Quadtree { budget }) };
        let assignment = scene.allocate(&*allocation, seed);
        for (owners, inside) in scene.owners(&assignment).into_iter().zip(&inside) {
            prop_assert_eq!(owners, u32::from(*inside));
        }
        let counted = inside.iter().filter(|inside| **inside).count();
        prop_assert!(grid || assignment.count() <= 3 * counted);
        let plane = height * width;
        for (i, value) in scene.photos.iter_mut().enumerate() {
            if !inside[i / (3 * plane) * plane + i % plane] {
                *value = 1.0 - *value;
            }
        }
        prop_assert_eq!(&*scene.allocate(&*allocation, seed).expert, &*assignment.expert);
    }

    /// Training draws budgets and every number of gaussians.
    #[test]
    fn training_draws_budgets_and_counts(seed in 0..1000u64) {
        let size = [2, 16, 32];
        let scene = Scene::new(size, photos(size, seed, |row, _| row as f64 / 16.0));
        let counts: Vec<usize> = (0..40).map(|i| scene.allocate(&QuadtreeMix::default(), 100 * seed + i).count()).collect();
        let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
        prop_assert!(*least < 60 && *most > 400, "{:?}", counts);
        prop_assert!(counts.iter().all(|c| (20..=3 * 1024).contains(c)));
    }
}

#[test]
fn detail_gets_the_gaussians() {
    // Even on the left, noise on the right.
    let size = [2, 32, 64];
    let scene = Scene::new(size, photos(size, 1, |_, column| if column < 32 { 0.0 } else { 0.8 }));
    let count = |assignment: &Assignment<f64>, left: bool| -> usize {
        let of = |(pixel, e): (usize, &u8)| if (pixel % 64 < 32) == left { usize::from(*e) } else { 0 };
        assignment.expert.iter().enumerate().map(of).sum()
    };
    let adaptive = scene.allocate(&Quadtree { budget: 0.1 }, 0);
    assert!(count(&adaptive, true) * 5 < count(&adaptive, false), "{}", count(&adaptive, true));
    let grid = scene.allocate(&QuadtreeGrid { budget: 0.1 }, 0);
    let (left, right) = (count(&grid, true), count(&grid, false));
    assert!(left.abs_diff(right) <= 6, "{left} and {right}");
    let cells = grid.cells.as_ref().unwrap();
    let levels = grid.expert.iter().zip(cells.level.iter()).filter(|(e, _)| **e > 0).map(|(_, level)| *level);
    assert!(levels.clone().all(|level| (1..=2).contains(&level)), "two sizes of cells, of 4 and 16 pixels");
}

#[test]
fn two_gaussians_lie_on_both_sides_of_an_edge() {
    // One slanted edge through the middle of one cell.
    let size = [1, 16, 16];
    let mut image = vec![0.0; 3 * 256];
    for (i, pixel) in image.iter_mut().enumerate() {
        let (row, column) = (i % 256 / 16, i % 16);
        *pixel = if 2 * row + column > 23 { 1.0 } else { 0.0 };
    }
    let scene = Scene::new(size, image);
    let assignment = scene.allocate(&Quadtree { budget: 2.0 / 256.0 }, 0);
    assert_eq!((assignment.count(), assignment.expert[0]), (2, 2));
    let angle = assignment.cells.as_ref().unwrap().angle[0];
    assert!((angle - 2.0_f32.atan()).abs() < 0.1, "{angle}");
    let bands = Cell { row: 0, column: 0, level: 4 }.bands(2, angle);
    let right = (0..256).filter(|i| (bands.of(i / 16, i % 16) == 1) == (scene.photos[*i] > 0.5)).count();
    assert!(right >= 246, "{right} of 256 pixels lie in the band of their color");
}
