//! Processes that share the batches of a step, here as threads.

use crate::scale::captured;
use crate::{PixelCnnRecipe, Silent, config};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use weaver_inference::RunFolder;
use weaver_ranks::threads;
use weaver_trainer::{Config, ConfigSource, Ranks, Registry, Session, claim_run};

/// A run of three steps of four batches.
fn batched() -> Config<PixelCnnRecipe> {
    let mut config = config(3);
    config.optimizer.accumulate = 4;
    config
}

/// The checksums of the weights after the run of each of some processes.
fn trained(count: usize, start: impl Fn() -> Session<PixelCnnRecipe> + Sync) -> Vec<String> {
    let run = |ranks: Arc<dyn Ranks>| {
        let mut session = start();
        session.share(ranks).unwrap();
        while session.advance().unwrap().is_some() {}
        session.checksum()
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = threads(count).into_iter().map(|ranks| scope.spawn(|| run(ranks))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    })
}

/// Weights do not depend on how many processes share the batches, nor on how many had shared them before the run went
/// on.
#[test]
fn any_number_of_processes_comes_to_the_same_bits() {
    let one = trained(1, || Session::new(batched()).unwrap());
    for count in [2, 3, 4] {
        assert_eq!(trained(count, || Session::new(batched()).unwrap()), vec![one[0].clone(); count]);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let mut first = Session::new(batched()).unwrap();
    (0..2).for_each(|_| _ = first.advance().unwrap().unwrap());
    first.save(&path).unwrap();
    assert_eq!(trained(2, || Session::resume(batched(), &path).unwrap()), vec![one[0].clone(); 2]);
    // Four batches are not one.
    assert_ne!(trained(1, || Session::new(config(3)).unwrap()), one);
}

/// The gradients of a step are the mean over its batches, drawn as in as many steps of one batch.
#[test]
fn batches_of_a_step_are_averaged() {
    let gradients = |accumulate: usize, step: usize| {
        let mut config = config(8);
        (config.optimizer.accumulate, config.optimizer.weight_decay) = (accumulate, 0.0);
        let mut session = Session::new(config).unwrap();
        for _ in 0..step {
            // A step without gradients leaves the weights as they are.
            let pending = session.gradients().unwrap().unwrap();
            session.reduce(|gradient| gradient.fill(0.0));
            session.update(pending).unwrap();
        }
        session.gradients().unwrap().unwrap();
        let mut all = Vec::new();
        session.reduce(|gradient| all.extend_from_slice(gradient));
        all
    };
    let mean: Vec<f32> = gradients(1, 0).iter().zip(gradients(1, 1)).map(|(a, b)| (a + b) * 0.5).collect();
    assert!(gradients(2, 0) == mean && mean.iter().any(|x| *x != 0.0));
}

/// Processes that read other captures, or would have nothing to do, are refused before the first step.
#[test]
fn processes_must_hold_the_same_run() {
    let folder = tempfile::tempdir().unwrap();
    let [mut here, mut there] = ["here", "there"].map(|name| captured(&folder.path().join(name), 0));
    let photo = folder.path().join("there/images/3.png");
    let mut image = weaver_io::Image::read(&photo, weaver_io::Background::White).unwrap();
    image.pixels[5] = 1.0 - image.pixels[5];
    image.write_png(&photo).unwrap();
    let (path, moved) = (here.data.folders[0].clone(), folder.path().join("moved"));
    for config in [&mut here, &mut there] {
        config.optimizer.accumulate = 2;
    }
    // Both sessions name the same folder, with other photos in it.
    let first = Session::new(here.clone()).unwrap();
    std::fs::rename(&path, &moved).unwrap();
    std::fs::rename(&there.data.folders[0], &path).unwrap();
    let second = Session::new(here).unwrap();
    let said: Vec<String> = std::thread::scope(|scope| {
        let sessions = [first, second].into_iter().zip(threads(2));
        let share = |(mut session, ranks): (Session<PixelCnnRecipe>, Arc<dyn Ranks>)| {
            scope.spawn(move || session.share(ranks).unwrap_err().to_string())
        };
        let threads: Vec<_> = sessions.map(share).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert!(said.iter().all(|said| said.starts_with("process 1: data.folders.0: expected")), "{said:?}");
    let mut alone = Session::new(config(2)).unwrap();
    let refused = alone.share(threads(2).remove(0)).unwrap_err().to_string();
    assert!(refused.contains("optimizer.accumulate") && refused.contains("found 1"), "{refused}");
}

/// The first process writes the folder that a run of one process writes; the others end with it.
#[test]
fn the_first_process_alone_writes() {
    let parent = tempfile::tempdir().unwrap();
    let registry = Registry::empty().with::<PixelCnnRecipe>();
    let entry = registry.find(None).unwrap();
    let settings = ["model.size=[16, 16]", "model.channels=4", "optimizer.accumulate=3"].map(String::from).to_vec();
    let resolved = entry.resolve(&ConfigSource { settings, steps: Some(3), ..ConfigSource::default() }).unwrap();
    let trained = |count: usize| {
        let path = parent.path().join(count.to_string());
        std::thread::scope(|scope| {
            for ranks in threads(count) {
                let (path, resolved) = (&path, &resolved);
                scope.spawn(move || {
                    let mut session = entry.start(resolved).unwrap();
                    session.share(ranks.clone()).unwrap();
                    if ranks.rank() > 0 {
                        return session.follow().unwrap();
                    }
                    let folder = claim_run(path, resolved).unwrap();
                    session.train(&folder, &mut Silent, &AtomicBool::new(false)).unwrap();
                });
            }
        });
        std::fs::read(RunFolder::at(&path).checkpoint_path()).unwrap()
    };
    assert!(trained(1) == trained(2));
}
