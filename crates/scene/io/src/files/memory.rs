//! Available memory.

/// Less memory than some work needs.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "memory: expected {:.1} GB, found {:.1} GB available; {advice}",
    *needed as f64 / 1e9,
    *available as f64 / 1e9
)]
pub struct TooLittleMemory {
    /// Bytes that are needed.
    pub needed: u64,
    /// Bytes that are available.
    pub available: u64,
    /// Advice how less would be needed.
    pub advice: String,
}

/// Checks that so many bytes are available; `advice` says how less would be needed. Without enough, an allocation would
/// end the process.
///
/// # Errors
/// When they are not. A system that does not report its memory passes.
pub fn check_memory(needed: u64, advice: &str) -> Result<(), TooLittleMemory> {
    match available_memory() {
        Some(available) if available < needed => Err(TooLittleMemory { needed, available, advice: advice.into() }),
        _ => Ok(()),
    }
}

/// The number of bytes that can be used without swapping, if the system reports it.
///
/// On Linux this is the available memory, or the rest of the process's control group, whichever is less.
pub fn available_memory() -> Option<u64> {
    let system = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| available(&text));
    let number = |path: &str| std::fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let group = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(most, used)| most.saturating_sub(used));
    system.into_iter().chain(group).min()
}

/// The line `MemAvailable: N kB`.
fn available(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
}

/// The largest resident memory of this process so far, in millions of bytes; `None` where the system has no such figure
/// (Linux has).
pub fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meminfo_is_understood() {
        assert_eq!(available("MemTotal:  8 kB\nMemAvailable:   12345 kB\n"), Some(12345 * 1024));
        assert_eq!(available("MemTotal:  8 kB\n"), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn memory_in_use_counts() {
        let taken = vec![1_u8; 50_000_000];
        let mb = peak_mb().unwrap();
        assert!((50.0..1e6).contains(&mb), "{mb}");
        drop(std::hint::black_box(taken));
        // The system's count is off by some pages for each processor.
        assert!(peak_mb().unwrap() >= 0.98 * mb, "a peak does not fall");
    }
}
