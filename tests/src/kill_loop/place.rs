//! Where the servers of the loop live: their folder, their disk, and what is put back there.

use super::Chance;
use super::client::Stage;
use crate::server::{PATIENCE, Server, program, serve_command};
use crate::small_disk::SmallDisk;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Size of the disk where it is to be short, MiB.
pub const DISK_MIB: u32 = 96;
/// What the server keeps free, MiB.
const MIN_FREE_MIB: &str = "16";
/// How long the disk is short, and then not, ms.
const SHORT_MS: (u64, u64) = (500, 2500);
/// Bytes that may be left on a short disk: none, so that writes fail, or less than is kept free.
const LEFT: [u64; 3] = [0, 256 << 10, 8 << 20];

/// A data folder, perhaps on a small disk.
pub struct Place<'a> {
    folder: &'a Path,
    disk: Option<&'a SmallDisk>,
    /// Starts that ended at once.
    pub failed_starts: u64,
}

impl<'a> Place<'a> {
    /// A folder, and the disk that is mounted on it.
    pub fn new(folder: &'a Path, disk: Option<&'a SmallDisk>) -> Self {
        Self { folder, disk, failed_starts: 0 }
    }

    /// The command, run where the small disk is mounted if there is one.
    fn command(&self, command: &Command) -> Command {
        match self.disk {
            Some(disk) => disk.enter(command),
            None => {
                let mut plain = Command::new(command.get_program());
                plain.args(command.get_args());
                plain
            }
        }
    }

    /// A server. On a full disk it may take some tries.
    pub fn start(&mut self) -> Server {
        let arguments = ["--checkpoint-every-s", "1", "--min-free-mb", MIN_FREE_MIB];
        let deadline = Instant::now() + PATIENCE;
        loop {
            let mut command = self.command(&serve_command(self.folder, &arguments));
            if let Ok(server) = Server::try_spawn(&mut command) {
                return server;
            }
            assert!(self.disk.is_some() && Instant::now() < deadline, "the server does not start");
            self.failed_starts += 1;
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The data folder as this process sees it.
    fn seen_from_here(&self) -> PathBuf {
        self.disk.map_or(self.folder.to_owned(), SmallDisk::seen_from_here)
    }
}

/// How many jobs have succeeded, up to 200.
pub fn succeeded(server: &Server) -> usize {
    let listed = server.get("/v1/jobs?limit=200&state=succeeded").json();
    listed["jobs"].as_array().map_or(0, Vec::len)
}

/// Takes a backup of the running server, lets it go on until another job has ended, kills it, and
/// puts the database back to that of the backup; the files stay as they are. How many jobs had
/// ended meanwhile.
pub fn restore(stage: &Stage, place: &Place<'_>, server: Server) -> usize {
    let _nobody_sends = stage.sending.write().unwrap_or_else(PoisonError::into_inner);
    let backup = TempDir::new().expect("a temporary folder");
    let to = backup.path().join("backup");
    let mut command = Command::new(program());
    command.arg("backup").arg(&to).arg("--data-dir").arg(place.folder);
    let taken = place.command(&command).output().expect("the program runs");
    assert!(taken.status.success(), "{}", String::from_utf8_lossy(&taken.stderr));
    let ended = || succeeded(&server);
    let accepted = stage.accepted.lock().unwrap_or_else(PoisonError::into_inner).len();
    let before = ended();
    let deadline = Instant::now() + PATIENCE;
    while ended() == before && before < accepted && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(20));
    }
    let undone = ended() - before;
    server.kill();
    // Who puts a database back has room for it.
    let _room = place.disk.map(SmallDisk::keep_free);
    let folder = place.seen_from_here();
    for name in ["hemilux.sqlite-wal", "hemilux.sqlite-shm"] {
        // There may be none.
        let _ = fs::remove_file(folder.join(name));
    }
    fs::copy(to.join("hemilux.sqlite"), folder.join("hemilux.sqlite")).expect("it can be put back");
    stage.restores.fetch_add(1, Ordering::Relaxed);
    undone
}

/// Makes the disk short and gives the space back, in turns, until `over`; how often.
pub fn be_short(disk: &SmallDisk, seed: u64, over: &AtomicBool) -> u64 {
    let mut chance = Chance(seed.rotate_left(17) | 1);
    let mut shortages = 0;
    let wait = |ms: u64| {
        let end = Instant::now() + Duration::from_millis(ms);
        while Instant::now() < end && !over.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    while !over.load(Ordering::Relaxed) {
        wait(chance.between(SHORT_MS));
        disk.fill_but(LEFT[chance.between((0, LEFT.len() as u64 - 1)) as usize]);
        shortages += 1;
        wait(chance.between(SHORT_MS));
        disk.free();
    }
    shortages
}
