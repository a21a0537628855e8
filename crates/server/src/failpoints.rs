//! Named places where a test makes the program fail, wait or die.
//!
//! The environment variable `HEMILUX_FAILPOINTS` holds rules, `;` between them, or `@` and the
//! path of a file with rules that is read anew at every point, so that a test can mend what it
//! broke. A rule reads `point=action` or `point(about)=action`; the latter holds where what the
//! point is about contains the text in brackets. `point=last:MILLISECONDS` says how long a pause of
//! that name lasts, `clock=jump:SECONDS` sets the wall clock by which things expire off. Without the
//! variable a point costs the read of one static.
//!
//! Not the `fail` crate: its points are compiled in by a cargo feature, so tests would run another
//! program than the one that is shipped.

use jiff::SignedDuration;
use std::sync::OnceLock;
use std::time::Duration;

/// The variable.
pub const VARIABLE: &str = "HEMILUX_FAILPOINTS";

/// A failure that was asked for.
#[derive(Debug, thiserror::Error)]
#[error("failpoint {0}")]
pub struct Injected(&'static str);

/// Does at `point` what the rules say; `about` tells passings of the point apart.
///
/// # Errors
/// [`Injected`] where the rule says `error`.
pub fn pass(point: &'static str, about: impl FnOnce() -> String) -> Result<(), Injected> {
    let Some(rules) = rules() else { return Ok(()) };
    match action(&rules, point, &about()) {
        Some(action) => act(point, action),
        None => Ok(()),
    }
}

/// How far a test has set the wall clock off.
pub fn clock_jump() -> SignedDuration {
    let Some(rules) = rules() else { return SignedDuration::ZERO };
    let seconds = action(&rules, "clock", "").and_then(|action| action.strip_prefix("jump:"));
    let seconds = seconds.map(|seconds| seconds.parse().expect("jump:SECONDS"));
    SignedDuration::from_secs(seconds.unwrap_or(0))
}

/// How long the pause of that name lasts: `usual`, or what the rules say.
pub fn lasting(point: &'static str, usual: Duration) -> Duration {
    let Some(rules) = rules() else { return usual };
    let millis = action(&rules, point, "").and_then(|action| action.strip_prefix("last:"));
    millis.and_then(|ms| ms.parse().ok()).map_or(usual, Duration::from_millis)
}

/// The rules as they are now; none where the variable is not set.
fn rules() -> Option<String> {
    static RULES: OnceLock<Option<String>> = OnceLock::new();
    let rules = RULES.get_or_init(|| std::env::var(VARIABLE).ok()).as_ref()?;
    Some(match rules.strip_prefix('@') {
        Some(path) => std::fs::read_to_string(path).unwrap_or_default(),
        None => rules.clone(),
    })
}

/// The action of the first rule that holds.
fn action<'a>(rules: &'a str, point: &str, about: &str) -> Option<&'a str> {
    rules.split(';').find_map(|rule| {
        let (place, action) = rule.trim().rsplit_once('=')?;
        let holds = match place.split_once('(') {
            Some((name, text)) => name == point && about.contains(text.strip_suffix(')')?),
            None => place == point,
        };
        holds.then_some(action)
    })
}

fn act(point: &'static str, action: &str) -> Result<(), Injected> {
    eprintln!("failpoint {point}: {action}");
    match action.split_once(':').unwrap_or((action, "")) {
        ("abort", _) => std::process::abort(),
        ("panic", _) => panic!("failpoint {point}"),
        ("sleep", ms) => {
            let ms = ms.parse().expect("sleep:MILLISECONDS");
            std::thread::sleep(Duration::from_millis(ms));
            Ok(())
        }
        ("overflow", _) => {
            overflow(0);
            Ok(())
        }
        ("exhaust", _) => exhaust(),
        ("error", _) => Err(Injected(point)),
        _ => panic!("{VARIABLE}: there is no action {action:?}"),
    }
}

/// Recurses until the stack ends.
#[allow(unconditional_recursion, reason = "that is what it is for")]
fn overflow(depth: u64) -> u64 {
    let here = std::hint::black_box([depth; 64]);
    overflow(depth + 1) + here[63]
}

/// Takes memory until there is none.
fn exhaust() -> ! {
    let mut taken: Vec<Vec<u8>> = Vec::new();
    loop {
        taken.push(std::hint::black_box(vec![1; 64 << 20]));
    }
}

#[cfg(test)]
mod tests {
    use super::action;

    #[test]
    fn the_first_rule_that_holds_acts() {
        let rules = "claim=error; render(seed 7)=abort; render=sleep:20";
        assert_eq!(action(rules, "claim", ""), Some("error"));
        assert_eq!(action(rules, "render", "seed 7, attempt 1"), Some("abort"));
        assert_eq!(action(rules, "render", "seed 8, attempt 1"), Some("sleep:20"));
        assert_eq!(action(rules, "claimed", ""), None);
        assert_eq!(action("", "claim", ""), None);
    }
}
