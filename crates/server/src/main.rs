//! The `hemilux` program.
fn main() {}
