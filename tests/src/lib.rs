//! Test helpers.

pub mod malformed;
