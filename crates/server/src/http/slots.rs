//! Slots for what may go on at the same time: so many in all, and so many for each who takes them, so that nobody has them all. There
//! are those for connections, which go by address, and those for uploads, which go by caller.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Which limit leaves no slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoSlot {
    /// That of all together.
    All,
    /// That of whoever asks.
    Own,
}

#[derive(Default)]
struct Taken {
    all: u64,
    by_name: HashMap<String, u64>,
}

/// The slots that are taken, counted.
#[derive(Clone)]
pub struct Slots {
    taken: Arc<Mutex<Taken>>,
    /// How many there are.
    pub most: u64,
    /// How many there are for each name.
    pub most_each: u64,
}

/// A slot, until dropped.
pub struct Slot {
    slots: Slots,
    name: String,
}

impl Slots {
    /// So many slots, and so many for each name.
    pub fn new(most: u64, most_each: u64) -> Self {
        Self { taken: Arc::default(), most, most_each }
    }

    /// A slot for whoever has that name; an empty one stands for everyone together, to whom only
    /// the limit of all applies.
    ///
    /// # Errors
    /// Which limit leaves none.
    pub fn take(&self, name: &str) -> Result<Slot, NoSlot> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if taken.all >= self.most {
            return Err(NoSlot::All);
        }
        if !name.is_empty() {
            let own = taken.by_name.entry(name.to_owned()).or_default();
            if *own >= self.most_each {
                return Err(NoSlot::Own);
            }
            *own += 1;
        }
        taken.all += 1;
        drop(taken);
        Ok(Slot { slots: self.clone(), name: name.to_owned() })
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut taken = self.slots.taken.lock().unwrap_or_else(PoisonError::into_inner);
        taken.all -= 1;
        if let Some(own) = taken.by_name.get_mut(&self.name) {
            *own -= 1;
            if *own == 0 {
                taken.by_name.remove(&self.name);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_has_all_slots_and_each_comes_back() {
        let slots = Slots::new(3, 2);
        let held = [slots.take("a"), slots.take("a")];
        assert!(held.iter().all(Result::is_ok));
        assert_eq!(slots.take("a").err(), Some(NoSlot::Own));
        let other = slots.take("b");
        assert!(other.is_ok());
        assert_eq!(slots.take("c").err(), Some(NoSlot::All));
        drop(held);
        assert!(slots.take("a").is_ok());
        drop(other);
        let taken = slots.taken.lock().unwrap();
        assert_eq!((taken.all, taken.by_name.len()), (0, 0));
    }

    #[test]
    fn those_who_are_not_told_apart_share_the_whole() {
        let slots = Slots::new(3, 1);
        let held: Vec<_> = (0..3).map(|_| slots.take("")).collect();
        assert!(held.iter().all(Result::is_ok));
        assert_eq!(slots.take("").err(), Some(NoSlot::All));
    }
}
