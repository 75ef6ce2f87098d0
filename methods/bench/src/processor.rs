//! Processor time of the process.

/// Processor seconds of all threads of this process so far, a software device's included; `None` without
/// `/proc/self/stat`.
pub fn seconds() -> Option<f64> {
    /// Clock ticks per second in `/proc`: always 100 on Linux, independent of the kernel's own clock.
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name before it, in parentheses, may hold anything.
    let mut fields = stat.rsplit(')').next()?.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::seconds;
    use std::time::{Duration, Instant};

    /// Two ticks, for which even a crowded machine has time within a minute.
    #[test]
    fn time_that_is_spent_counts() {
        let (begin, started) = (seconds().unwrap(), Instant::now());
        while seconds().unwrap() < begin + 0.02 {
            assert!(started.elapsed() < Duration::from_secs(60), "no time was counted in a minute");
            std::hint::spin_loop();
        }
    }
}
