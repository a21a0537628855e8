//! The service: the real program under requests, faults, deaths and load. One program, so that it is
//! linked once and its tests share the cores.

mod backup;
mod compare_command;
mod dependency_rules;
mod faults;
mod isolation;
mod server_bytes;
mod server_charts;
mod server_contract;
mod server_errors;
mod server_guard;
mod server_jobs;
mod server_keys;
mod server_load;
mod server_malformed;
mod server_mutations;
mod server_restart;
mod server_sharing;
mod server_webhooks;
mod solutions;
