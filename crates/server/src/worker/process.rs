//! A process of a device's own: a job that panics, aborts, overflows its stack, loses the device
//! or takes all the memory ends that process, not the server.

use super::perform::ROOM;
use super::wire::{self, ExecutorEvent, Message, Order};
use crate::telemetry::LogFormat;
use std::io::{self, BufReader, BufWriter};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc as std_mpsc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// How long a process that is told to go may take before it is killed.
const PARTING: Duration = Duration::from_millis(500);

/// How a process or a thread of a device ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExecutorEnd {
    /// How, in words.
    pub how: String,
    /// Whether somebody else killed it without a word (signal 9), as the system does for want of
    /// memory.
    pub was_killed: bool,
}

impl From<String> for ExecutorEnd {
    fn from(how: String) -> Self {
        Self { how, was_killed: false }
    }
}

/// The process of a device.
pub struct Process {
    child: Child,
    /// Whether the server ended it.
    is_ended: bool,
    orders: Option<std_mpsc::Sender<Message<Order>>>,
}

impl Process {
    /// Starts the process and listens to it; the large parts of what it says go to files in a
    /// folder.
    ///
    /// # Errors
    /// Where the system gives no process or thread.
    pub fn start(
        device: &str,
        memory_mb: Option<u64>,
        log_format: LogFormat,
        large_parts: PathBuf,
    ) -> io::Result<(Self, mpsc::Receiver<Message<ExecutorEvent>>)> {
        let mut command = Command::new(own_program()?);
        command.args(["device-worker", device]);
        if log_format == LogFormat::Json {
            command.args(["--log-format", "json"]);
        }
        if let Some(limit) = memory_mb {
            command.args(["--memory-mb", &limit.to_string()]);
        }
        // A group of its own: Ctrl-C in a terminal is for the server, which then ends in order.
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).process_group(0);
        let mut child = command.spawn()?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        let missing = || io::Error::other("the process has no pipes");
        let (input, output) = (input.ok_or_else(missing)?, output.ok_or_else(missing)?);

        let (sender, events) = mpsc::channel(ROOM);
        std::thread::Builder::new().name(format!("said {device}")).spawn(move || {
            let mut pipe = BufReader::new(output);
            loop {
                match wire::read::<ExecutorEvent>(&mut pipe, Some(&large_parts)) {
                    Ok(Some(message)) => {
                        if sender.blocking_send(message).is_err() {
                            return;
                        }
                    }
                    Ok(None) => return,
                    Err(error) => {
                        tracing::warn!(%error, "a device's process broke off");
                        return;
                    }
                }
            }
        })?;
        let (orders, waiting) = std_mpsc::channel();
        let name = format!("orders {device}");
        std::thread::Builder::new().name(name).spawn(move || pass_on(input, &waiting))?;
        Ok((Self { child, is_ended: false, orders: Some(orders) }, events))
    }

    /// Sends an order. One that does not arrive is noticed by the process's end.
    pub fn order(&self, order: Message<Order>) {
        if let Some(orders) = &self.orders {
            let _ = orders.send(order);
        }
    }

    /// Ends the process at once.
    pub fn kill(&mut self) {
        self.is_ended = true;
        // It may be gone already.
        let _ = self.child.kill();
    }

    /// Lets the process end, or ends it, and says how it ended.
    pub fn end(&mut self) -> ExecutorEnd {
        drop(self.orders.take());
        let deadline = Instant::now() + PARTING;
        let status = loop {
            match self.child.try_wait() {
                Ok(Some(status)) => break Ok(status),
                Ok(None) if Instant::now() < deadline => {
                    std::thread::sleep(Duration::from_millis(2));
                }
                Ok(None) => {
                    self.kill();
                    break self.child.wait();
                }
                Err(error) => break Err(error),
            }
        };
        match status {
            Ok(status) => ExecutorEnd {
                how: format!("its process ended with {}", in_words(status)),
                was_killed: status.signal() == Some(9) && !self.is_ended,
            },
            Err(error) => format!("its process cannot be asked how it ended: {error}").into(),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

/// Writes orders to the process, beside whoever gives them: a process that does not read must
/// not hold them up.
fn pass_on(pipe: ChildStdin, orders: &std_mpsc::Receiver<Message<Order>>) {
    let mut pipe = BufWriter::new(pipe);
    while let Ok(order) = orders.recv() {
        if let Err(error) = wire::write(&mut pipe, &order) {
            tracing::warn!(%error, "an order did not reach a device's process");
            return;
        }
    }
}

/// The program of device and import processes, where it is not that of the server.
static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Makes another program than the one that runs that of device and import processes, once: for
/// programs that have the server in them and no such commands.
pub fn use_program(path: PathBuf) {
    let _ = PROGRAM.set(path);
}

/// This program, also where its file was replaced while it runs.
pub(super) fn own_program() -> io::Result<PathBuf> {
    if let Some(program) = PROGRAM.get() {
        return Ok(program.clone());
    }
    let running = PathBuf::from("/proc/self/exe");
    if running.exists() { Ok(running) } else { std::env::current_exe() }
}

/// How a process ended.
pub(super) fn in_words(status: ExitStatus) -> String {
    match status.signal() {
        Some(6) => "signal 6 (abort: out of memory, a stack overflow or an internal fault)".into(),
        Some(9) => "signal 9 (killed, perhaps by the system for want of memory)".into(),
        Some(signal @ (7 | 11)) => format!("signal {signal} (an invalid memory access)"),
        Some(signal) => format!("signal {signal}"),
        None => status.to_string(),
    }
}
