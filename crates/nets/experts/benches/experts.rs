//! Time of the head, forward and backward, at the size of a training step.

use criterion::Criterion;
use std::time::Duration;
use weaver_autograd::{Params, Pool, Tape};
use weaver_experts::{CardinalityHead, HeadConfig, Parametrization, PixelInputs};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_router::{Allocation, AllocationRequest, Dithered, Quadtree};

const VIEWS: usize = 4;
const HEIGHT: usize = 48;
const WIDTH: usize = 64;
const PIXELS: usize = VIEWS * HEIGHT * WIDTH;

fn numbers(n: usize, purpose: &str) -> Vec<f32> {
    let stream = Stream::new(1, 0, purpose);
    (0..n as u64).map(|i| stream.uniform(i)).collect()
}

/// A bumpy surface seen by all views.
fn surface(n: usize) -> Vec<f32> {
    let mut points = numbers(3 * n, "surface");
    points.chunks_exact_mut(3).for_each(|p| p[2] = 1.0 + 0.2 * (7.0 * p[0]).sin() * (5.0 * p[1]).cos() + 0.01 * p[2]);
    points
}

/// Gaussians of pixels, and of cells.
fn heads(c: &mut Criterion) {
    head(c, "head", HeadConfig::tiny(), &Dithered { budget: 0.4, gamma: 0.7 });
    let patches = HeadConfig { parametrization: Parametrization::patch(), ..HeadConfig::tiny() };
    head(c, "head of cells", patches, &Quadtree { budget: 0.4 });
}

fn head(c: &mut Criterion, name: &str, config: HeadConfig, allocation: &dyn Allocation) {
    let mut params = Params::<f32>::new();
    let head = CardinalityHead::new(Builder::new(&mut params, 1).scope("gs_moe"), config);
    let features = numbers(PIXELS * 32, "features");
    let (points, colors) = (surface(PIXELS), numbers(PIXELS * 3, "colors"));
    let logits = numbers(PIXELS * 4, "logits");
    let pool = Pool::new();
    let photos = numbers(3 * PIXELS, "photos");
    let request = AllocationRequest {
        logits: &logits,
        energy: &logits[..PIXELS],
        photos: &photos,
        depth: None,
        views: VIEWS,
        height: HEIGHT,
        width: WIDTH,
        stream: Stream::new(1, 0, "allocation"),
        inside: None,
        gumbel: None,
        pool: &pool,
    };
    let assignment = allocation.allocate(&request);
    let mut tape = Tape::new();
    for backward in [false, true] {
        let pass = if backward { "backward" } else { "forward" };
        c.bench_function(&format!("{name}/{pass}"), |b| {
            b.iter(|| {
                {
                    let pixels = PixelInputs {
                        features: tape.leaf(&features, [PIXELS, 32]),
                        points: tape.leaf(&points, [PIXELS, 3]),
                        footprints: Some(tape.leaf(&features[..PIXELS], [PIXELS])),
                        colors: Some(tape.constant(&colors, [PIXELS, 3])),
                        height: HEIGHT,
                        width: WIDTH,
                    };
                    let g = head.gaussians(Context::new(&tape, &params), &pixels, &assignment, None).gaussians;
                    if backward {
                        let outputs = [g.means, g.scales, g.quats, g.opacities, g.colors];
                        let loss = outputs.map(|x| x.sum()).into_iter().reduce(|a, b| a + b);
                        loss.expect("five outputs").backward();
                    }
                }
                tape.reset();
            });
        });
    }
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    heads(&mut criterion);
    criterion.final_summary();
}
