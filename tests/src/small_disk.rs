//! A small disk that outlives the servers on it: a tmpfs in a mount namespace that a sleeping
//! process keeps.

use crate::server::PATIENCE;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Bytes written at once while the disk is filled.
const STEP: usize = 4 << 10;
/// Runs the command after it such that the kernel kills it when the thread that started it ends,
/// however that does. It comes after what changes user or namespace, which would undo it.
const DIES_WITH_US: [&str; 3] = ["setpriv", "--pdeathsig", "KILL"];

/// The disk. It goes when this is dropped and no server is left on it. Where the test is killed, it
/// goes with the servers on it, since all of these end with the threads that started them.
pub struct SmallDisk {
    keeper: Child,
    folder: PathBuf,
    /// Held by whoever fills it, gives the space back or needs it to stay free.
    filling: Mutex<()>,
}

impl SmallDisk {
    /// Whether the system allows the mount namespaces that it takes.
    pub fn is_allowed() -> bool {
        let allowed = Command::new("unshare").arg("-rm").args(DIES_WITH_US).arg("true").output();
        allowed.is_ok_and(|output| output.status.success())
    }

    /// Mounts a disk of `mib` MiB on `folder`, for this disk's own servers alone. `None` where the
    /// system allows no mount namespaces.
    ///
    /// # Panics
    /// Where the system allows namespaces but no disk appears.
    pub fn mount(folder: &Path, mib: u32) -> Option<Self> {
        if !Self::is_allowed() {
            return None;
        }
        let mount = format!("mount -t tmpfs -o size={mib}m none \"$0\" && exec sleep infinity");
        let mut keeper = Command::new("unshare");
        keeper.arg("-rm").args(DIES_WITH_US).args(["sh", "-c", &mount]).arg(folder);
        let disk = Self {
            keeper: keeper.stdin(Stdio::null()).spawn().expect("unshare runs"),
            folder: folder.to_owned(),
            filling: Mutex::default(),
        };
        let deadline = Instant::now() + PATIENCE;
        while !disk.is_mounted() {
            assert!(Instant::now() < deadline, "no disk appears");
            std::thread::sleep(Duration::from_millis(5));
        }
        Some(disk)
    }

    fn is_mounted(&self) -> bool {
        let mounts = fs::read_to_string(format!("/proc/{}/mounts", self.keeper.id()));
        let folder = self.folder.to_string_lossy();
        mounts.is_ok_and(|text| text.lines().any(|line| line.split(' ').nth(1) == Some(&*folder)))
    }

    /// The command that runs `command` where this disk is mounted.
    pub fn enter(&self, command: &Command) -> Command {
        let keeper = self.keeper.id().to_string();
        let mut entering = Command::new("nsenter");
        entering.args(["-t", &keeper, "-U", "-m", "--preserve-credentials"]).args(DIES_WITH_US);
        entering.arg(command.get_program()).args(command.get_args());
        entering
    }

    /// The disk's folder as this process sees it.
    pub fn seen_from_here(&self) -> PathBuf {
        let folder = self.folder.strip_prefix("/").unwrap_or(&self.folder);
        Path::new(&format!("/proc/{}/root", self.keeper.id())).join(folder)
    }

    fn ballast(&self) -> PathBuf {
        self.seen_from_here().join("ballast")
    }

    fn alone(&self) -> MutexGuard<'_, ()> {
        self.filling.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Fills the disk until at most `left` bytes are free.
    ///
    /// # Panics
    /// Where the disk cannot be written for another reason than being full.
    pub fn fill_but(&self, left: u64) {
        let _alone = self.alone();
        let mut file = File::create(self.ballast()).expect("a file on the small disk");
        let free = |file: &File| {
            let disk = rustix::fs::fstatvfs(file).expect("a disk says what is free");
            disk.f_bavail * disk.f_frsize
        };
        while free(&file) > left {
            // Servers write, too, and may have taken the last of it.
            if let Err(full) = file.write_all(&[0; STEP]) {
                assert_eq!(full.kind(), ErrorKind::StorageFull, "{full}");
                break;
            }
        }
    }

    /// Gives the space back.
    ///
    /// # Panics
    /// Where the disk cannot be written.
    pub fn free(&self) {
        drop(self.keep_free());
    }

    /// Gives the space back; nobody fills the disk for as long as what this returns lives.
    ///
    /// # Panics
    /// Where the disk cannot be written.
    pub fn keep_free(&self) -> MutexGuard<'_, ()> {
        let alone = self.alone();
        match fs::remove_file(self.ballast()) {
            Err(error) if error.kind() != ErrorKind::NotFound => panic!("cannot free it: {error}"),
            _ => alone,
        }
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = self.keeper.kill();
        let _ = self.keeper.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skips::skipped;
    use std::io::Read;
    use tempfile::TempDir;

    #[test]
    fn a_small_disk_is_full_where_it_says_so() {
        let folder = TempDir::new().unwrap();
        let Some(disk) = SmallDisk::mount(folder.path(), 2) else {
            skipped("the system allows no mount namespaces");
            return;
        };
        disk.fill_but(64 << 10);
        let file = disk.seen_from_here().join("file");
        assert!(fs::write(&file, vec![0; 32 << 10]).is_ok());
        assert!(fs::write(&file, vec![0; 128 << 10]).is_err());
        disk.free();
        assert!(fs::write(&file, vec![0; 1 << 20]).is_ok());
        assert!(!folder.path().join("file").exists(), "it is for its own servers alone");
        // Nobody fills it while somebody needs the space.
        let kept = disk.keep_free();
        std::thread::scope(|scope| {
            scope.spawn(|| disk.fill_but(0));
            std::thread::sleep(Duration::from_millis(100));
            let is_written = fs::write(&file, vec![0; 3 << 19]);
            drop(kept);
            assert!(is_written.is_ok(), "{is_written:?}");
        });
        assert!(fs::write(disk.seen_from_here().join("another"), vec![0; 32 << 10]).is_err());
    }

    #[test]
    fn a_small_disk_goes_with_the_thread_that_mounted_it() {
        let folder = TempDir::new().unwrap();
        let on_it = |folder: &Path| {
            let disk = SmallDisk::mount(folder, 2)?;
            let says_and_stays = "echo here; exec sleep infinity";
            let mut inside = disk.enter(Command::new("sh").args(["-c", says_and_stays]));
            let mut inside = inside.stdout(Stdio::piped()).spawn().unwrap();
            inside.stdout.take().unwrap().read_exact(&mut [0; 5]).unwrap();
            let keeper = disk.keeper.id();
            // As where a test is killed: nothing is dropped.
            std::mem::forget(disk);
            Some((keeper, inside))
        };
        let path = folder.path();
        let Some((keeper, mut inside)) =
            std::thread::scope(|scope| scope.spawn(|| on_it(path)).join().unwrap())
        else {
            skipped("the system allows no mount namespaces");
            return;
        };
        let mounts = format!("/proc/{keeper}/mounts");
        let deadline = Instant::now() + PATIENCE;
        while fs::read_to_string(&mounts).is_ok_and(|text| !text.is_empty())
            || inside.try_wait().unwrap().is_none()
        {
            assert!(Instant::now() < deadline, "it is still there");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
