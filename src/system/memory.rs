//! How much memory the machine has.

/// The bytes of memory that this process may use at most: the machine's, or fewer where a limit of
/// its control group says so. `None` where the system does not tell.
pub fn total() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let machine = read("/proc/meminfo").and_then(|text| kilobytes(&text, "MemTotal:"));
    let group = read("/sys/fs/cgroup/memory.max").and_then(|text| text.trim().parse().ok());
    machine.into_iter().chain(group).min()
}

/// The value of a line of `/proc/meminfo`, in bytes.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_meminfo_is_read() {
        let text = "MemTotal:       24576000 kB\nMemFree:          123 kB\n";
        assert_eq!(kilobytes(text, "MemTotal:"), Some(24_576_000 * 1024));
        assert_eq!(kilobytes(text, "MemAvailable:"), None);
        assert_eq!(kilobytes("MemTotal: many", "MemTotal:"), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn this_machine_has_memory() {
        assert!(total().is_some_and(|bytes| bytes > 1 << 26));
    }
}
