//! The machine that measures, in words.

use serde::{Deserialize, Serialize};

/// What figures depend on besides the program. Fields that the system doesn't tell are empty or null.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// The processor's name.
    pub processor: String,
    /// Hardware threads that this process may use.
    pub threads: usize,
    /// Memory, bytes.
    pub memory_bytes: Option<u64>,
    /// Operating system and architecture.
    pub system: String,
    /// The kernel's release.
    pub kernel: String,
}

impl Machine {
    /// This one.
    pub fn this() -> Self {
        let line_of = |path: &str, field: &str| -> Option<String> {
            let text = std::fs::read_to_string(path).ok()?;
            let (_, value) = text
                .lines()
                .filter_map(|line| line.split_once(':'))
                .find(|(name, _)| name.trim() == field)?;
            Some(value.trim().to_owned())
        };
        let memory_kib = line_of("/proc/meminfo", "MemTotal")
            .and_then(|value| value.split_whitespace().next()?.parse::<u64>().ok());
        Self {
            processor: line_of("/proc/cpuinfo", "model name").unwrap_or_default(),
            threads: threads(),
            memory_bytes: memory_kib.map(|kib| kib << 10),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            kernel: std::fs::read_to_string("/proc/sys/kernel/osrelease")
                .map(|text| text.trim().to_owned())
                .unwrap_or_default(),
        }
    }
}

/// Hardware threads that this process may use.
pub(super) fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_same_each_time() {
        let machine = Machine::this();
        assert_eq!(machine, Machine::this());
        assert!(machine.threads >= 1 && machine.system.contains(std::env::consts::ARCH));
        #[cfg(target_os = "linux")]
        assert!(
            machine.memory_bytes.is_some_and(|b| b > 1 << 20) && !machine.kernel.is_empty(),
            "{machine:?}"
        );
    }
}
