//! The `hemilux` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    hemilux::cli::main()
}
