//! Who runs tasks for a worker: a thread of the server, or a process of the device's own.

use super::perform::{ROOM, Switches, perform};
use super::process::{ExecutorEnd, Process};
use super::threads;
use super::wire::{ExecutorEvent, Message, Order, Task};
use crate::artifacts::Content;
use crate::config::{Config, Isolation};
use std::io;
use std::sync::Arc;
use tokio::sync::mpsc;

/// A device with whoever runs tasks on it.
pub struct Executor {
    events: mpsc::Receiver<Message<ExecutorEvent>>,
    body: Body,
    runs: u64,
}

enum Body {
    Process(Process),
    Thread { tasks: std::sync::mpsc::Sender<(Task, Vec<Content>)>, switches: Arc<Switches> },
}

impl Executor {
    /// Starts to open a device; [`ExecutorEvent::Ready`] or [`ExecutorEvent::NoDevice`] follows.
    ///
    /// # Errors
    /// Where the system gives no process or thread.
    pub fn start(device: &str, config: &Config) -> io::Result<Self> {
        let (body, events) = match config.isolation {
            Isolation::Process => {
                // Threads reserve address space that they may never use.
                let reserved_mb = threads::reserved_mb(config.threads);
                let memory_mb = config.device_memory_mb(device).map(|mb| mb + reserved_mb);
                let large_parts = config.data_dir.join("tmp");
                let (process, events) =
                    Process::start(device, memory_mb, config.log_format, large_parts)?;
                (Body::Process(process), events)
            }
            Isolation::Thread => {
                let (sender, events) = mpsc::channel(ROOM);
                let (tasks, waiting) = std::sync::mpsc::channel();
                let switches = Arc::new(Switches::default());
                let (id, inside) = (device.to_owned(), switches.clone());
                std::thread::Builder::new()
                    .name(format!("renders {device}"))
                    .spawn(move || perform(&id, &waiting, &inside, &sender))?;
                (Body::Thread { tasks, switches }, events)
            }
        };
        Ok(Self { events, body, runs: 0 })
    }

    /// The number of the next task.
    pub fn next_run(&mut self) -> u64 {
        self.runs += 1;
        self.runs
    }

    /// Gives an order.
    pub fn order(&self, order: Message<Order>) {
        match (&self.body, order.header) {
            (Body::Process(process), header) => {
                process.order(Message { header, parts: order.parts });
            }
            (Body::Thread { tasks, .. }, Order::Run(task)) => {
                // A thread that is gone shows by its silence.
                let _ = tasks.send((*task, order.parts));
            }
            (Body::Thread { switches, .. }, Order::Stop { run, wants_picture }) => {
                switches.stop(run, wants_picture);
            }
            (Body::Thread { switches, .. }, Order::SnapshotKept { run, slower }) => {
                switches.snapshot_kept(run, slower);
            }
            (Body::Thread { switches, .. }, Order::CheckpointKept { run, micros }) => {
                switches.checkpoint_kept(run, micros);
            }
        }
    }

    /// What it says next; `None` where it is gone.
    pub async fn hear(&mut self) -> Option<Message<ExecutorEvent>> {
        self.events.recv().await
    }

    /// Whether it ended while nothing was asked of it.
    pub fn is_gone(&self) -> bool {
        self.events.is_closed()
    }

    /// Ends it whatever it does. A thread cannot be ended: it is left behind, and stops when it
    /// next asks whether to.
    pub fn kill(&mut self) {
        match &mut self.body {
            Body::Process(process) => process.kill(),
            Body::Thread { switches, .. } => switches.abandon(),
        }
    }

    /// Lets it end and says how it did.
    pub fn end(&mut self) -> ExecutorEnd {
        match &mut self.body {
            Body::Process(process) => process.end(),
            Body::Thread { .. } => "its thread ended".to_owned().into(),
        }
    }
}
