//! Test helpers.

pub mod twins;
