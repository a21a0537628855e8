//! The command line.

mod backup;
mod compare;
mod devices;
mod files;
mod health;
mod keys;
mod process;
mod render;
mod scene_files;
mod serve;
mod settings;

use crate::config::Config;
use crate::telemetry::{self, LogFormat};
use crate::worker::import::{self, FileKind, ImportBounds};
use clap::{Parser, Subcommand};
use process::{Failure, print};
use std::process::ExitCode;

/// Global illumination: a render server and a command-line renderer.
#[derive(Parser)]
#[command(name = "hemilux", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Answer jobs over HTTP.
    Serve(Box<Config>),
    /// Render one picture.
    Render(Box<render::Arguments>),
    /// Compare methods on one scene: error against time, pictures side by side.
    Compare(Box<compare::Arguments>),
    /// List what the methods can be set to.
    Settings(settings::Arguments),
    /// List the devices of this machine.
    Devices,
    /// Ask a running server whether it can take jobs; exit code 1 if it cannot.
    Health(health::Arguments),
    /// Make, list and end API keys.
    Keys(keys::Arguments),
    /// Copy a data folder, beside the server that runs on it or without one.
    Backup(backup::Backup),
    /// Put a backup into an empty data folder.
    Restore(backup::Restore),
    /// Print the API's description (OpenAPI, YAML).
    Openapi,
    /// Run jobs on a device for the server that started this and holds its pipes.
    #[command(hide = true)]
    DeviceWorker {
        /// The device's id.
        device: String,
        /// Most memory, MiB of address space.
        #[arg(long)]
        memory_mb: Option<u64>,
        /// How the log is written.
        #[arg(long, value_enum, default_value_t)]
        log_format: LogFormat,
    },
    /// Import the file on standard input for the server that started this.
    #[command(hide = true)]
    ImportWorker {
        /// What is in it.
        #[arg(long, value_enum)]
        kind: FileKind,
        /// Bounds.
        #[command(flatten)]
        bounds: ImportBounds,
    },
}

/// Runs the program. Exit codes: 0 done, 1 failed, 2 wrong usage.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let (format, default) = match &arguments.command {
        Command::Serve(config) => (config.log_format, "info"),
        // It writes to the log of the server that started it.
        Command::DeviceWorker { log_format, .. } => (*log_format, "info"),
        _ => (LogFormat::Text, "warn"),
    };
    let _telemetry = telemetry::start(format, default);
    let done = match arguments.command {
        Command::Serve(config) => serve::run(*config),
        Command::Render(arguments) => render::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Settings(arguments) => settings::run(&arguments),
        Command::Devices => devices::run(),
        Command::Health(arguments) => health::run(&arguments),
        Command::Keys(arguments) => keys::run(arguments),
        Command::Backup(arguments) => backup::take(&arguments),
        Command::Restore(arguments) => backup::restore(&arguments),
        Command::Openapi => print(&crate::http::description()),
        Command::DeviceWorker { device, memory_mb, .. } => {
            crate::worker::child::run(&device, memory_mb).map_err(Failure::failed)
        }
        Command::ImportWorker { kind, bounds } => {
            import::run(kind, bounds).map_err(Failure::failed)
        }
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("hemilux: {}", failure.message);
            ExitCode::from(failure.code)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Arguments;
    use clap::CommandFactory;

    #[test]
    fn the_readme_names_every_setting_of_the_server() {
        let readme = include_str!("../../../../README.md");
        let program = Arguments::command();
        let serve = program.find_subcommand("serve").unwrap();
        let flags: Vec<_> = serve.get_arguments().filter_map(|flag| flag.get_long()).collect();
        assert!(flags.len() > 40, "{flags:?}");
        let is_named = |flag: &&str| readme.contains(&format!("`--{flag}`"));
        let missing: Vec<_> = flags.into_iter().filter(|flag| !is_named(flag)).collect();
        assert!(missing.is_empty(), "{missing:?}");
    }
}
