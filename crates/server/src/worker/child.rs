//! The inside of a device's own process, `hemilux device-worker`: orders come by standard input,
//! what it says goes by standard output. It ends when its standard input does, so that a server
//! that is killed leaves nothing behind.

use super::perform::{ROOM, Switches, perform};
use super::wire::{self, Order};
use crate::memory;
use rustix::process::{Resource, Rlimit, setrlimit};
use std::fs::File;
use std::io::{self, BufReader};
use std::sync::Arc;
use tokio::sync::mpsc;

/// Runs tasks on the device until the server hangs up or the device breaks. `memory_mb` bounds
/// the process's address space, MiB.
///
/// # Errors
/// Where the process cannot be set up.
pub fn run(device: &str, memory_mb: Option<u64>) -> io::Result<()> {
    if let Some(limit) = memory_mb {
        let bytes = Some(limit << 20);
        setrlimit(Resource::As, Rlimit { current: bytes, maximum: bytes })?;
    }
    memory::offer_to_the_kernel(memory::DEVICE_GOES_EARLY);
    // Whatever else writes to standard output must not get between messages.
    let mut pipe = File::from(rustix::io::dup(io::stdout())?);
    rustix::stdio::dup2_stdout(io::stderr())?;

    let switches = Arc::new(Switches::default());
    let (tasks, orders) = (std::sync::mpsc::channel(), switches.clone());
    std::thread::Builder::new().name("orders".into()).spawn(move || {
        let mut pipe = BufReader::new(io::stdin());
        while let Ok(Some(message)) = wire::read::<Order>(&mut pipe, None) {
            match message.header {
                Order::Run(task) => {
                    // No receiver: the device broke, and the process is about to end.
                    let _ = tasks.0.send((*task, message.parts));
                }
                Order::Stop { run, wants_picture } => orders.stop(run, wants_picture),
                Order::SnapshotKept { run, slower } => orders.snapshot_kept(run, slower),
                Order::CheckpointKept { run, micros } => orders.checkpoint_kept(run, micros),
            }
        }
        // The server is gone or wants no more; nothing here is worth keeping.
        std::process::exit(0);
    })?;
    let (sender, mut events) = mpsc::channel(ROOM);
    let writer = std::thread::Builder::new().name("said".into()).spawn(move || {
        while let Some(message) = events.blocking_recv() {
            if wire::write(&mut pipe, &message).is_err() {
                std::process::exit(0);
            }
        }
    })?;
    perform(device, &tasks.1, &switches, &sender);
    drop(sender);
    let _ = writer.join();
    Ok(())
}
