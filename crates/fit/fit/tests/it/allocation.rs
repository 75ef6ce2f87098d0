//! A step of sizes seen before allocates nothing (but for an array of rows where cameras are refined).

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use weaver_fit::{Fit, FitSettings, Photo, init};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};

/// Counts the allocations of each thread.
struct Counting;

thread_local!(static COUNT: Cell<usize> = const { Cell::new(0) });

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[allow(unsafe_code)]
// SAFETY: the system allocator does the work.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        // SAFETY: passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: passed on.
        unsafe { System.dealloc(start, layout) }
    }
}

/// Three views of one size, with stripes.
fn photos() -> Vec<Photo> {
    let (width, height) = (48, 40);
    let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 24.0, cy: 20.0 };
    let photo = |i: usize| {
        let pose = Pose { translation: DVec3::new(0.1 * i as f64, 0.0, 0.0), ..Pose::IDENTITY };
        let camera = Camera { pose, intrinsics, width, height };
        let rgb = (0..3 * width * height).map(|k| if (k / 12 + i).is_multiple_of(2) { 220 } else { 40 }).collect();
        Photo { name: i.to_string(), camera, rgb, mask: Some(vec![true; width * height]), lens: None }
    };
    (0..3).map(photo).collect()
}

#[test]
fn a_step_allocates_nothing_once_growth_has_ended() {
    let mut settings =
        FitSettings { steps: 200, gaussians: 400, sh_interval: 0.01, exposure: true, ..Default::default() };
    (settings.density.rounds, settings.density.until) = (40, 0.5);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread pool");
    let count = pool.install(|| {
        let initial = init::random(&photos(), &settings).expect("Gaussians");
        let mut fit = Fit::new(photos(), &initial, settings).expect("a fit");
        let steps = |fit: &mut Fit, until: usize| {
            let before = COUNT.get();
            while fit.steps_done() < until {
                fit.step().expect("a step");
            }
            COUNT.get() - before
        };
        assert!(steps(&mut fit, 180) > 0, "a counter that counts");
        // Lists of the rasterizer grow as long as Gaussians spread: the same steps twice have sizes seen before.
        let state = fit.state();
        steps(&mut fit, 200);
        fit.restore(&state).expect("a state of this fit");
        steps(&mut fit, 200)
    });
    assert_eq!(count, 0);
}
