//! The `hemilux` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    quieten_mesa();
    hemilux::cli::main()
}

/// Mesa's device-select layer asks Wayland which adapter shows the desktop, and prints an error
/// for every look at the adapters where there is no desktop. A render server shows nothing.
fn quieten_mesa() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: nothing else runs yet that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
