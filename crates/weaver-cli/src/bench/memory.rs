//! Peak memory of the process.

/// The largest resident memory of this process so far, in millions of bytes; `None` where the system does not tell
/// (it does on Linux).
pub fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

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
