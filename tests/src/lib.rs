//! Helpers of the tests across the whole product.

pub mod blocks;
pub mod bombs;
pub mod comparison;
pub mod devices;
pub mod halves;
pub mod import_graph;
pub mod iterations;
pub mod keys;
pub mod kill_loop;
pub mod load;
pub mod malformed;
pub mod mutate;
pub mod oracle;
pub mod rendering;
pub mod replicas;
pub mod rooms_by_chance;
pub mod scenes;
pub mod server;
pub mod skips;
pub mod small_disk;
pub mod sources;
pub mod stability;
pub mod twins;
