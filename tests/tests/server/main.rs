//! The server: the real program over HTTP, under requests, faults, deaths and limits. One program, so
//! that it is linked once and its tests share the cores.

mod archives;
mod backup;
mod bytes;
mod charts;
mod connections;
mod contract;
mod errors;
mod faults;
mod guard;
mod isolation;
mod jobs;
mod kept_scenes;
mod keys;
mod malformed;
mod mutations;
mod restart;
mod sharing;
mod solutions;
mod surroundings;
mod webhooks;
