//! Scenes with real light on real materials, each with what surrounds it: what files from outside
//! bring along and a closed box of diffuse walls does not. Not shipped; measured by
//! `hemilux-bench real-light` and looked at by tests.

mod checker;
mod courtyard;
mod foliage;
mod mirrors;
mod odd_room;
mod parts;
mod random_room;
mod screens;
mod water;
mod window;

pub use checker::checker;
pub use courtyard::courtyard;
pub use foliage::{LEAVES, foliage};
pub use mirrors::mirrors;
pub use odd_room::odd_room;
pub use parts::RealScene;
pub use random_room::{random_room, sunny_room};
pub use screens::screens;
pub use water::water;
pub use window::{glazed, window};
#[cfg(test)]
pub use window::{lamp_beside_window, wide_window};

/// All of them, the random ones by a seed.
pub fn all(seed: u32) -> Vec<RealScene> {
    vec![
        window(),
        glazed(0.0),
        mirrors(),
        water(),
        foliage(LEAVES, seed),
        checker(),
        screens(seed),
        courtyard(seed),
        courtyard(seed + 1),
    ]
}

#[cfg(test)]
mod tests;
