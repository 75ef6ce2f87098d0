//! A whole training step of fixed shape allocates nothing once it has run.

use crate::capture;
use weaver_autograd::{Params, Pool, Tape};
use weaver_data::{Layout, training_tuple};
use weaver_experts::Neighbors;
use weaver_kernels::random::Stream;
use weaver_model::SplatWeaver;
use weaver_nn::{AdamW, Context, Ema, Group, WarmupCosine, clip_factor, global_norm};
use weaver_router::AllocationKind;
use weaver_splat::WorkspacePool;
use weaver_trainer::losses::ImageNetworks;
use weaver_trainer::splatweaver::{Objective, SplatWeaverRecipe};
use weaver_trainer::{Example, Recipe, scenes};

type Config = weaver_trainer::Config<SplatWeaverRecipe>;

/// Steps after which every buffer has seen its largest size.
const WARM_UP: u64 = 3;

/// A step without the search for neighbors, which is measured apart.
const NO_SEARCH: &str = "model.gaussians.neighbor_attention=false";

fn everything(settings: &[&str]) -> Config {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    let mut config = Config::resolve(Some("micro"), None, &settings).unwrap();
    config.data.folders = capture::folders();
    config
}

/// Allocations of the first step of the stage `everything`, and of the one after the warm-up: loss, gradients,
/// clipping, optimizer, average and reset. It runs on a thread of the pool, so that work that the kernels hand to the
/// pool is counted, too.
fn allocations(config: &Config, allocation: &str) -> [u64; 2] {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let stage = &config.stages[1];
        let scenes = scenes::load(&config.data, SplatWeaverRecipe::image_size(&config.model)).unwrap();
        let layouts: Vec<Layout> = scenes.iter().map(Layout::of).collect();
        let (d, tuples) = (&config.data, Stream::new(config.seed, 0, "tuples"));
        let example = |i: u64| {
            let tuple = training_tuple(&layouts, tuples, i, d.pool, d.context_views, d.target_views);
            Example::new(&scenes[tuple.scene], &layouts[tuple.scene], tuple).unwrap()
        };
        let examples: Vec<Example> = (0..SplatWeaverRecipe::tuples(stage) as u64).map(example).collect();
        let kind: AllocationKind = allocation.parse().unwrap();
        let allocation = kind.allocation(stage.model.budget, config.model.gaussians.experts()).unwrap();

        let mut params = Params::new();
        let model = SplatWeaver::new(config.model.clone(), &mut params, config.seed);
        let o = &config.optimizer;
        let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: o.weight_decay };
        let mut optimizer = AdamW::new(vec![group], o.beta1, o.beta2, o.epsilon);
        let mut ema = Ema::new(&params, o.ema.expect("an average"));
        let schedule = WarmupCosine { warmup: stage.warmup as u64, total: stage.steps as u64, floor: stage.floor };
        let (mut tape, workspaces) = (Tape::new(), WorkspacePool::new());
        let start = params.clone();
        let mut step = |index: u64| {
            // The same weights each time: other Gaussians touch other numbers of tiles, which changes shapes.
            for (id, param) in start.iter() {
                params.value_mut(id).copy_from_slice(param.value());
            }
            let stream = Stream::new(config.seed, 0, "allocation");
            let objective = Objective {
                stage,
                ranking: true,
                allocation: &*allocation,
                networks: &ImageNetworks::default(),
                workspaces: &workspaces,
                stream,
            };
            let norm = {
                let terms = objective.terms(Context::new(&tape, &params), &model, &examples);
                let total = terms.total().unwrap();
                assert!(total.item().is_finite() && terms.gaussians_per_pixel > 0.0);
                total.backward();
                global_norm(&params, &tape)
            };
            assert!(norm.is_finite() && norm > 0.0);
            let rate = stage.rate * schedule.factor(index);
            optimizer.step_scaled(&mut params, &mut tape, rate, clip_factor(norm, o.clip));
            ema.update(&params);
            tape.reset();
        };
        let mut count = |index| allocation_counter::measure(|| step(index)).count_total;
        let first = count(0);
        (1..WARM_UP).for_each(|index| _ = count(index));
        [first, count(WARM_UP)]
    })
}

#[test]
fn a_step_allocates_nothing() {
    for allocation in ["fixed:1", "dithered"] {
        let [first, later] = allocations(&everything(&[NO_SEARCH]), allocation);
        assert!(first > 0, "the counter counts");
        assert_eq!(later, 0, "allocations of a step with {allocation}");
    }
}

#[test]
fn no_loss_allocates() {
    // Losses that the stage lacks: the published ones.
    let config = everything(&[
        NO_SEARCH,
        "stages.1.losses.pose.huber=10",
        "stages.1.losses.depth.rendered=0.1",
        "stages.1.model.allocation=sampled",
        "stages.1.losses.router.rank=0.01",
        "stages.1.losses.router.budget=0.01",
    ]);
    for allocation in ["fixed:2", "sampled"] {
        assert_eq!(allocations(&config, allocation)[1], 0, "allocations of a step with {allocation}");
    }
}

#[test]
fn the_search_for_neighbors_is_all_that_allocates() {
    let config = everything(&[]);
    let m = &config.model;
    // One Gaussian for each context pixel.
    let count = config.data.context_views * m.width * m.height;
    let stream = Stream::new(1, 0, "points");
    let points: Vec<f32> = (0..3 * count as u64).map(|i| stream.uniform(i)).collect();
    let (pool, searches) = (Pool::new(), config.stages[1].tuples as u64);
    let search = || drop(Neighbors::search(&points, m.gaussians.neighbors, &pool));
    let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let per_search = threads.install(|| {
        search();
        allocation_counter::measure(search).count_total
    });
    assert_eq!(allocations(&config, "fixed:1")[1], searches * per_search);
}
