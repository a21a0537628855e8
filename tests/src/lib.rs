//! Helpers of the tests across the whole product.

pub mod comparison;
pub mod iterations;
pub mod malformed;
pub mod scenes;
pub mod server;
pub mod twins;
