//! Times of the router's forward and backward pass and of the allocations, at the size of a training step.

use criterion::Criterion;
use std::time::Duration;
use weaver_autograd::{Params, Pool, Tape};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_router::{
    Allocation, AllocationRequest, Dithered, Quadtree, QuadtreeGrid, Router, Sampled, gumbel_softmax_straight_through,
};

const VIEWS: usize = 4;
const HEIGHT: usize = 48;
const WIDTH: usize = 64;
const PIXELS: usize = VIEWS * HEIGHT * WIDTH;

fn numbers(n: usize, purpose: &str) -> Vec<f32> {
    let stream = Stream::new(1, 0, purpose);
    (0..n as u64).map(|i| stream.uniform(i)).collect()
}

fn allocate(c: &mut Criterion) {
    let (logits, pool) = (numbers(PIXELS * 4, "logits"), Pool::new());
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
    let strategies: [(&str, &dyn Allocation); 4] = [
        ("allocate/dithered", &Dithered { budget: 0.4, gamma: 0.7 }),
        ("allocate/sampled", &Sampled),
        ("allocate/quadtree", &Quadtree { budget: 0.1 }),
        ("allocate/quadtree grid", &QuadtreeGrid { budget: 0.1 }),
    ];
    for (name, strategy) in strategies {
        c.bench_function(name, |b| b.iter(|| strategy.allocate(&request)));
    }
}

fn route(c: &mut Criterion) {
    let mut params = Params::<f32>::new();
    let router = Router::new(Builder::new(&mut params, 1), 32, 16, 4);
    let features = numbers(PIXELS * 32, "features");
    let mut tape = Tape::new();
    c.bench_function("router and choice, forward and backward", |b| {
        b.iter(|| {
            {
                let features = tape.leaf(&features, [PIXELS, 32]);
                let logits = router.forward(Context::new(&tape, &params), features);
                gumbel_softmax_straight_through(logits, None, 0.5).square().sum().backward();
            }
            tape.reset();
        });
    });
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    allocate(&mut criterion);
    route(&mut criterion);
    criterion.final_summary();
}
