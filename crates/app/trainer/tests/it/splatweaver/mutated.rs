//! Mutated configurations: refused or read, without a panic, in little memory.

use crate::mutations::{files, mutate};
use std::panic::{AssertUnwindSafe, catch_unwind};
use weaver_kernels::random::Stream;
use weaver_trainer::Config;
use weaver_trainer::splatweaver::SplatWeaverRecipe;

/// Memory that a reader may hold: a multiple of its input, and a constant.
const TIMES: u64 = 64;
const MORE: u64 = 4 << 20;

/// Promise of `readers_bear_any_file`.
#[test]
fn configurations_bear_any_text() {
    if std::env::var("WEAVER_READER").is_ok_and(|reader| !"toml".contains(&reader)) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.toml");
    let whole = Config::<SplatWeaverRecipe>::resolve(Some("micro"), None, &[]).unwrap().to_toml();
    let (mut faults, mut refused) = (Vec::new(), 0);
    for number in 0..files() {
        let mut bytes = whole.clone().into_bytes();
        mutate(&mut bytes, Stream::new(number, 0, "toml"));
        std::fs::write(&path, &bytes).unwrap();
        let mut read = None;
        let used = allocation_counter::measure(|| {
            let resolve = || Config::<SplatWeaverRecipe>::resolve(None, Some(&path), &[]).is_ok();
            read = catch_unwind(AssertUnwindSafe(resolve)).ok();
        });
        refused += u64::from(read == Some(false));
        let most = TIMES * bytes.len() as u64 + MORE;
        if read.is_none() || used.bytes_max > most {
            faults.push(format!("file {number}: panic {}, {} bytes held", read.is_none(), used.bytes_max));
        }
    }
    println!("toml: {} files, {refused} refused, {} faults", files(), faults.len());
    assert!(refused * 10 > files(), "{refused} refused");
    assert!(faults.is_empty(), "{}", faults[..faults.len().min(5)].join("\n"));
}
