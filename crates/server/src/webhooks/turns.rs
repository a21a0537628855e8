//! Whose message is sent next. Lanes (a caller and a receiver) take turns, owner by owner, and
//! each may have only so many messages under way: a receiver that never answers holds up its own
//! lane and nothing else. A lane whose receiver cannot be reached rests; meanwhile its other
//! messages wait, at no cost to their attempts, and then one of them shows whether it is back.

use crate::store::outbox::Lane;
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Messages under way in a lane whose receiver answers; one where it did not, the last time.
const OF_A_LANE: usize = 4;
/// Messages under way to a host, whoever sends them.
const TO_A_HOST: usize = 8;
/// Messages under way of an owner.
const OF_AN_OWNER: usize = 16;
/// Messages under way beyond which only owners who have none get another.
const TOTAL: usize = 64;
/// Messages under way, in any case.
const MOST: usize = 256;
/// How long a lane rests first; it doubles.
const FIRST_REST: Duration = Duration::from_secs(2);
/// The longest rest: so long after a receiver has come back at most, it is noticed.
const LONGEST_REST: Duration = Duration::from_secs(300);
/// Lanes and owners that are remembered; beyond it those are forgotten with nothing under way.
const MAX_REMEMBERED: usize = 20_000;

#[derive(Clone, Copy, Default)]
struct LaneState {
    last_turn: u64,
    under_way: usize,
    /// Failures to reach the receiver since it was reached last.
    failures: u32,
    rests_until: Option<Instant>,
}

#[derive(Clone, Copy, Default)]
struct OwnerState {
    last_turn: u64,
    under_way: usize,
}

/// The turns of all lanes.
#[derive(Default)]
pub struct Turns {
    turn: u64,
    lanes: HashMap<Lane, LaneState>,
    owners: HashMap<String, OwnerState>,
    to_hosts: HashMap<String, usize>,
    under_way: usize,
}

impl Turns {
    /// The lanes whose turn it is, among those with a message that is `due`; a lane comes more
    /// than once where it may have more than one message under way. Each counts as under way
    /// until [`Turns::ended`] or [`Turns::had_none`] takes it back.
    pub fn next(&mut self, due: &[Lane], now: Instant) -> Vec<Lane> {
        self.forget_idle(now);
        let mut picked = Vec::new();
        // Whose last turn is longest ago goes first: the owner, then the lane.
        while let Some(lane) = due
            .iter()
            .filter(|lane| self.may_go(lane, now))
            .min_by_key(|lane| (self.owner(&lane.owner).last_turn, self.lane(lane).last_turn))
        {
            self.turn += 1;
            self.under_way += 1;
            *self.to_hosts.entry(lane.host.clone()).or_default() += 1;
            let owner = self.owners.entry(lane.owner.clone()).or_default();
            *owner = OwnerState { last_turn: self.turn, under_way: owner.under_way + 1 };
            let state = self.lanes.entry(lane.clone()).or_default();
            (state.last_turn, state.under_way) = (self.turn, state.under_way + 1);
            picked.push(lane.clone());
        }
        picked
    }

    /// A message of that lane is no longer under way; whether its receiver was `reached`.
    pub fn ended(&mut self, lane: &Lane, reached: bool, now: Instant) {
        self.had_none(lane);
        let state = self.lanes.entry(lane.clone()).or_default();
        if reached {
            (state.failures, state.rests_until) = (0, None);
        } else if state.rests_until.is_none_or(|end| end <= now) {
            // What was under way together fails together, and counts once.
            let rest = FIRST_REST.saturating_mul(1 << state.failures.min(16)).min(LONGEST_REST);
            state.failures = state.failures.saturating_add(1);
            state.rests_until = Some(now + rest);
        }
    }

    /// There was no message in that lane after all.
    pub fn had_none(&mut self, lane: &Lane) {
        let less = |count: &mut usize| *count = count.saturating_sub(1);
        less(&mut self.under_way);
        if let Some(state) = self.lanes.get_mut(lane) {
            less(&mut state.under_way);
        }
        if let Some(owner) = self.owners.get_mut(&lane.owner) {
            less(&mut owner.under_way);
        }
        if let Some(count) = self.to_hosts.get_mut(&lane.host) {
            less(count);
            if *count == 0 {
                self.to_hosts.remove(&lane.host);
            }
        }
    }

    fn lane(&self, lane: &Lane) -> LaneState {
        self.lanes.get(lane).copied().unwrap_or_default()
    }

    fn owner(&self, owner: &str) -> OwnerState {
        self.owners.get(owner).copied().unwrap_or_default()
    }

    fn may_go(&self, lane: &Lane, now: Instant) -> bool {
        let (state, owner) = (self.lane(lane), self.owner(&lane.owner));
        let of_the_lane = if state.failures > 0 { 1 } else { OF_A_LANE };
        let total = if owner.under_way == 0 { MOST } else { TOTAL };
        state.rests_until.is_none_or(|end| end <= now)
            && state.under_way < of_the_lane
            && owner.under_way < OF_AN_OWNER
            && self.to_hosts.get(&lane.host).is_none_or(|count| *count < TO_A_HOST)
            && self.under_way < total
    }

    /// Keeps memory bounded however many lanes there are. What is forgotten is the order of
    /// turns and, where that does not suffice, which receivers rest.
    fn forget_idle(&mut self, now: Instant) {
        if self.lanes.len() > MAX_REMEMBERED {
            self.lanes.retain(|_, s| s.under_way > 0 || s.rests_until.is_some_and(|end| end > now));
        }
        if self.lanes.len() > MAX_REMEMBERED {
            self.lanes.retain(|_, state| state.under_way > 0);
        }
        if self.owners.len() > MAX_REMEMBERED {
            self.owners.retain(|_, state| state.under_way > 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lane(owner: &str, host: &str) -> Lane {
        Lane { owner: owner.into(), host: host.into() }
    }

    fn of(picked: &[Lane], wanted: &Lane) -> usize {
        picked.iter().filter(|lane| *lane == wanted).count()
    }

    #[test]
    fn lanes_and_owners_take_turns() {
        let mut turns = Turns::default();
        let now = Instant::now();
        let due = [lane("a", "1"), lane("a", "2"), lane("b", "3")];
        let picked = turns.next(&due, now);
        // The first three are one of each owner and then the other lane of the first.
        assert_eq!(picked[0].owner, "a");
        assert_eq!(picked[1], due[2]);
        assert_eq!((of(&picked[..4], &due[0]), of(&picked[..4], &due[1])), (1, 1));
        for lane in &due {
            assert_eq!(of(&picked, lane), OF_A_LANE);
        }
        // Nothing more until something ends, and then whose turn was longest ago.
        assert!(turns.next(&due, now).is_empty());
        turns.ended(&due[0], true, now);
        assert_eq!(turns.next(&due, now), [due[0].clone()]);
    }

    #[test]
    fn a_receiver_that_never_answers_holds_up_nobody_else() {
        let mut turns = Turns::default();
        let mut now = Instant::now();
        // One owner with more silent receivers than there are places.
        let silent: Vec<Lane> = (0..100).map(|n| lane("a", &format!("silent-{n}"))).collect();
        assert_eq!(turns.next(&silent, now).len(), OF_AN_OWNER);
        // Many such owners use up the whole total; who has nothing under way still goes at once.
        let crowd: Vec<Lane> = (0..20)
            .flat_map(|owner| {
                (0..4).map(move |host| lane(&format!("o{owner}"), &format!("h{host}")))
            })
            .collect();
        turns.next(&crowd, now);
        let mut due = crowd.clone();
        due.push(lane("b", "good"));
        assert!(of(&turns.next(&due, now), &lane("b", "good")) > 0);
        // A lane that fails rests, longer each time; then one message goes, not four.
        let mut turns = Turns::default();
        let bad = [lane("a", "bad")];
        let first = turns.next(&bad, now);
        assert_eq!(first.len(), OF_A_LANE);
        for lane in &first {
            turns.ended(lane, false, now);
        }
        let mut rest = FIRST_REST;
        for _ in 0..12 {
            assert!(turns.next(&bad, now + rest - Duration::from_millis(1)).is_empty());
            now += rest;
            assert_eq!(turns.next(&bad, now).len(), 1, "after {rest:?}");
            turns.ended(&bad[0], false, now);
            rest = (2 * rest).min(LONGEST_REST);
        }
        // The same receiver is open to others, and to this one again once it answers.
        assert!(!turns.next(&[lane("b", "bad")], now).is_empty());
        now += rest;
        assert_eq!(turns.next(&bad, now).len(), 1);
        turns.ended(&bad[0], true, now);
        assert_eq!(turns.next(&bad, now).len(), OF_A_LANE);
    }

    #[test]
    fn counts_return_to_nothing_and_memory_is_bounded() {
        let mut turns = Turns::default();
        let now = Instant::now();
        for n in 0..3 * MAX_REMEMBERED {
            let due = [lane(&format!("o{n}"), &format!("h{n}"))];
            let picked = turns.next(&due, now);
            assert_eq!(picked.len(), OF_A_LANE);
            turns.ended(&picked[0], n % 2 == 0, now);
            picked[1..].iter().for_each(|lane| turns.had_none(lane));
        }
        assert_eq!((turns.under_way, turns.to_hosts.len()), (0, 0));
        assert!(
            turns.lanes.len() <= MAX_REMEMBERED + 1 && turns.owners.len() <= MAX_REMEMBERED + 1
        );
    }
}
