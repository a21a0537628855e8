//! The time that records get.

/// Milliseconds since 1970 by the wall clock. For people and for sorting: it jumps, so nothing
/// that a promise hangs on is decided by it.
pub fn now_ms() -> i64 {
    let now = crate::clock::now().as_millisecond();
    #[cfg(test)]
    let now = now + CLOCK_JUMP_MS.get();
    now
}

#[cfg(test)]
thread_local! {
    /// How far the wall clock of this test has jumped.
    pub static CLOCK_JUMP_MS: std::cell::Cell<i64> = const { std::cell::Cell::new(0) };
}
