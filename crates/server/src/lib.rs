//! The job service: HTTP in front, a pool of devices behind, everything promised on disk between.
//!
//! A job's path: [`http`] accepts it, the [`store`] keeps it, the [`queue`] hands it to a
//! [`worker`], which owns a device and renders; pictures go to [`artifacts`], [`events`] wake
//! whoever follows. They all work with what is [`shared`]; [`service`] starts them; [`cli`] is the
//! program around it.

#![cfg_attr(not(test), warn(clippy::too_many_lines))]

pub mod access;
pub mod api;
pub mod archive;
pub mod artifacts;
pub mod backup;
pub mod builtin;
pub mod bundle;
pub mod cli;
pub mod clock;
pub mod config;
pub mod data_folder;
pub mod descriptors;
pub mod disk;
pub mod events;
pub mod failpoints;
pub mod hash;
pub mod http;
pub mod job_state;
pub mod key_watch;
pub mod leases;
pub mod memory;
pub mod metrics;
pub mod networks;
pub mod pool;
pub mod queue;
pub mod retention;
pub mod service;
pub mod shared;
pub mod store;
pub mod telemetry;
pub mod trace_context;
pub mod webhooks;
pub mod worker;

/// What a panic said.
pub(crate) fn panic_text(panic: &(dyn std::any::Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message")
}
