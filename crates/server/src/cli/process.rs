//! What commands have to do with their process: what it prints, how it ends, whose its files are.

use std::io::Write;

/// Makes what this process creates readable for its own user alone: the database holds the secrets
/// of webhooks, the folder everyone's scenes and pictures.
pub fn keep_files_private() {
    rustix::process::umask(rustix::fs::Mode::RWXG | rustix::fs::Mode::RWXO);
}

/// Why the program ends without success.
#[derive(Debug)]
pub struct Failure {
    /// What is said on standard error.
    pub message: String,
    /// The exit code.
    pub code: u8,
}

impl Failure {
    /// The work failed: exit code 1.
    pub fn failed(message: impl ToString) -> Self {
        Self { message: message.to_string(), code: 1 }
    }

    /// The program was asked for something that cannot be: exit code 2.
    pub fn usage(message: impl ToString) -> Self {
        Self { message: message.to_string(), code: 2 }
    }
}

/// What runs the one task of a command that serves nobody.
pub fn runtime() -> Result<tokio::runtime::Runtime, Failure> {
    tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::failed)
}

/// Prints; a reader that went away is no failure.
pub fn print(text: &str) -> Result<(), Failure> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::failed(error)),
        _ => Ok(()),
    }
}
