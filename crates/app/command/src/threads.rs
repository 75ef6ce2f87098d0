//! Threads of a command.

use crate::Failure;

/// Threads for each core, at most: a job that was written for a larger machine would stand still, as idle threads look
/// for work on the cores that others need. Results do not depend on their number.
const FOR_EACH_CORE: usize = 8;

/// Runs `job` where parallel loops use `threads` threads, [no more](pool_size) than a few for each core, or one per
/// core.
///
/// Fails where the system refuses the threads, and where the job does.
pub fn in_pool<R: Send>(threads: Option<usize>, job: impl FnOnce() -> Result<R, Failure> + Send) -> Result<R, Failure> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, |asked| pool_size(asked, cores())))
        .build()?
        .install(job)
}

/// Number of threads used on a machine with `cores` cores when `asked` are requested.
///
/// ```
/// use weaver_command::pool_size;
/// assert_eq!([1, 16, 1000].map(|asked| pool_size(asked, 2)), [1, 16, 16]);
/// ```
pub fn pool_size(asked: usize, cores: usize) -> usize {
    asked.min(FOR_EACH_CORE * cores)
}

/// Cores that this process may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Remark where fewer threads are used than requested.
pub fn fewer_threads(asked: Option<usize>) -> Option<String> {
    let asked = asked?;
    let used = pool_size(asked, cores());
    (used < asked)
        .then(|| format!("--threads {asked}: {used} are used, as there are {} cores; results are the same", cores()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Promise (fits): threads that the machine cannot use are left out with a word, and results are the same.
    #[test]
    fn threads_are_no_more_than_cores_can_use() {
        for cores in [1, 2, 64] {
            let most = FOR_EACH_CORE * cores;
            assert_eq!([1, most, most + 1, 1024].map(|asked| pool_size(asked, cores)), [1, most, most, 1024.min(most)]);
        }
        assert_eq!(fewer_threads(None), None);
        assert_eq!(fewer_threads(Some(FOR_EACH_CORE * cores())), None);
        let said = fewer_threads(Some(FOR_EACH_CORE * cores() + 1)).unwrap();
        assert!(said.contains(&format!(": {} are used", FOR_EACH_CORE * cores())), "{said}");
        let used = in_pool(Some(1024), || Ok(rayon::current_num_threads())).ok();
        assert_eq!(used, Some(pool_size(1024, cores())));
    }
}
