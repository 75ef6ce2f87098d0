//! Processor time of the process.

/// Seconds that the threads of this process have run so far, those of a software device included; `None` where the system does
/// not tell in the way of Linux.
pub fn seconds() -> Option<f64> {
    /// Of a second, which is what Linux counts in, whatever the kernel's own clock.
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
