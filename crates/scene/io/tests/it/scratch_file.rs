//! Pictures that are kept in a file without a name.

use std::thread;
use weaver_io::ScratchFile;

/// Promise (photos): pictures that are kept on disk come back byte by byte, whoever else writes meanwhile, and leave no
/// file behind.
#[test]
fn kept_pictures_are_what_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let scratch = ScratchFile::new(folder.path()).unwrap();
    let picture = |seed: usize| (0..10_000 + seed).map(|i| (i * 31 + seed * 7) as u8).collect::<Vec<u8>>();
    let kept: Vec<_> = thread::scope(|scope| {
        let keep = |seed: usize| {
            let kept = scratch.keep(&picture(2 * seed)).unwrap();
            let smaller = kept.beside(picture(2 * seed + 1));
            [kept, smaller]
        };
        let threads: Vec<_> = (0..8).map(|seed| scope.spawn(move || keep(seed))).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    let names = || std::fs::read_dir(folder.path()).unwrap().count();
    // On Windows it has a name that ends with it.
    assert_eq!(names(), usize::from(cfg!(windows)));
    drop(scratch);
    for (seed, kept) in kept.iter().enumerate() {
        assert!(kept[..] == picture(seed)[..], "{seed}");
    }
    assert!(kept[3].clone() == kept[3] && kept[3] != kept[4]);
    assert_eq!(kept[0].beside(Vec::new()).len(), 0);
    drop(kept);
    assert_eq!(names(), 0);
}

#[test]
fn a_folder_that_is_missing_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = ScratchFile::new(&folder.path().join("missing")).unwrap_err().to_string();
    assert!(error.contains("missing"), "{error}");
}
