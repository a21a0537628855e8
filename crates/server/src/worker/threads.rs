//! The budget of threads, which all devices share: how many of them each one's jobs compute with.
//!
//! Shares are fixed when the server starts and as even as they can be. A device that is idle keeps
//! its share: one that lent it out would find it taken when its next job comes, and that job would
//! starve or the threads be more than there may be.

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// Room for the stack of each thread, bytes: as much as the first thread of a program has.
const STACK_BYTES: usize = 8 << 20;

/// Address space that the system's allocator reserves for each thread, bytes (glibc on 64 bits).
const ARENA_BYTES: usize = 64 << 20;

/// Address space that so many threads of a process reserve beside what they allocate, MiB; without a
/// number, as many as this process may use.
pub fn reserved_mb(threads: Option<usize>) -> u64 {
    let threads = threads.unwrap_or_else(available) as u64;
    threads * ((STACK_BYTES + ARENA_BYTES) >> 20) as u64
}

/// How many threads each of so many devices gets of `budget`: those that are left over go to the
/// first ones, and none gets less than one.
pub fn shares(budget: usize, devices: usize) -> Vec<usize> {
    let (each, left) = (budget / devices.max(1), budget % devices.max(1));
    (0..devices).map(|device| (each + usize::from(device < left)).max(1)).collect()
}

/// As many threads as this process may use: cores, less where its affinity or its cgroup's quota
/// allows less.
pub fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The threads that tasks compute on.
#[derive(Default)]
pub struct TaskThreads(Option<ThreadPool>);

impl TaskThreads {
    /// So many threads: those of the task before, where that had as many.
    ///
    /// # Errors
    /// Where the system does not give them.
    pub fn of(&mut self, threads: usize) -> Result<&ThreadPool, ThreadPoolBuildError> {
        let pool = match self.0.take().filter(|pool| pool.current_num_threads() == threads) {
            Some(pool) => pool,
            None => ThreadPoolBuilder::new()
                .num_threads(threads)
                .stack_size(STACK_BYTES)
                .thread_name(|index| format!("computes {index}"))
                .build()?,
        };
        Ok(self.0.insert(pool))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_add_up_to_the_budget_and_none_is_empty() {
        for budget in 1..20 {
            for devices in 1..20 {
                let shares = shares(budget, devices);
                assert_eq!(shares.iter().sum::<usize>(), budget.max(devices));
                assert!(shares[0] - shares[devices - 1] <= 1 && shares[devices - 1] >= 1);
            }
        }
        assert!(shares(8, 0).is_empty());
    }

    #[test]
    fn threads_are_kept_while_their_number_is_the_same() {
        let mut crew = TaskThreads::default();
        let first = crew.of(2).unwrap().install(|| std::thread::current().id());
        let all = |crew: &mut TaskThreads, threads| {
            let pool = crew.of(threads).unwrap();
            assert_eq!(pool.install(rayon::current_num_threads), threads);
            pool.broadcast(|_| std::thread::current().id())
        };
        assert!(all(&mut crew, 2).contains(&first));
        assert!(!all(&mut crew, 3).contains(&first));
    }
}
