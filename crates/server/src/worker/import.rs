//! Imports of uploaded scenes and maps of skies, each in a process of its own. What is in them is hostile: a small
//! file may decode to gigabytes, and an allocation that fails ends the process. So the server
//! starts `hemilux import-worker`, which bounds its own memory and time, reads the scene from its
//! standard input and writes what it found to its standard output; however it ends, the server
//! goes on and says what became of the scene.

use super::process::{in_words, own_program};
use super::scenes::{SceneRefusal, describe, describe_map, load_from, options};
use crate::api::environments::EnvironmentMap;
use crate::api::scenes::{Scene, SceneFormat};
use crate::failpoints;
use crate::memory;
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest record of a scene, bytes: names of cameras, variants, animations and scenes, warnings.
const MAX_RECORD_BYTES: u64 = 1 << 20;
/// What is read of the process's last words, bytes.
const MAX_WORDS_BYTES: u64 = 4 << 10;
/// Pauses between looks at whether the process has ended; each twice as long as the last.
const LOOK_EVERY: (Duration, Duration) = (Duration::from_millis(1), Duration::from_millis(20));
/// Processor seconds beyond the deadline: the server ends the process first, if it still runs.
const SPARE_CPU_S: u64 = 5;
/// What a sender can do about a scene that no importer should end over.
const FIX_FILE: &str = "the file is probably damaged; check it with a glTF validator";
/// What a sender can do about a map that no importer should end over.
const FIX_MAP: &str = "the file is probably damaged; save it again as OpenEXR or Radiance HDR";

/// Bounds on one import.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct ImportBounds {
    /// Most triangles.
    #[arg(long)]
    pub max_triangles: usize,
    /// Most memory, MiB of address space.
    #[arg(long)]
    pub memory_mb: u64,
    /// Longest time, seconds.
    #[arg(long)]
    pub seconds: u64,
}

/// What is in an uploaded file, as its sender says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum FileKind {
    /// A glTF file.
    Gltf,
    /// A glTF file with the resources that it names, packed together.
    Bundle,
    /// A map of a sky.
    Sky,
}

impl FileKind {
    /// Its name on the command line.
    fn word(self) -> &'static str {
        match self {
            Self::Gltf => "gltf",
            Self::Bundle => "bundle",
            Self::Sky => "sky",
        }
    }
}

impl From<SceneFormat> for FileKind {
    fn from(format: SceneFormat) -> Self {
        match format {
            SceneFormat::Gltf => Self::Gltf,
            SceneFormat::Bundle => Self::Bundle,
        }
    }
}

/// Why there is no description of an upload.
#[derive(Debug)]
pub enum ImportError {
    /// The file cannot be used.
    Refused(SceneRefusal),
    /// The server could not look at it.
    Trouble(io::Error),
}

impl From<io::Error> for ImportError {
    fn from(error: io::Error) -> Self {
        Self::Trouble(error)
    }
}

/// What the process found out.
#[derive(Serialize, Deserialize)]
enum Finding {
    Scene(Scene),
    Map(EnvironmentMap),
    Refused(SceneRefusal),
    /// Its input could not be read.
    Unread(String),
}

/// Imports the scene that is the content of `file` and says what it holds. Blocks until the
/// process that does it has ended, at most for the bounds' time.
///
/// # Errors
/// [`ImportError`]: the scene is refused, or the system gave no process.
pub fn describe_apart(
    file: &File,
    id: String,
    format: SceneFormat,
    bounds: ImportBounds,
) -> Result<Scene, ImportError> {
    let size = file.metadata()?.len();
    match find_out(file, &id, format.into(), bounds)? {
        Finding::Scene(scene) => {
            Ok(Scene { id, format, size, created_at: crate::clock::now(), ..scene })
        }
        _ => Err(other_finding()),
    }
}

/// As [`describe_apart`], of a map of a sky.
///
/// # Errors
/// As [`describe_apart`].
pub fn describe_map_apart(
    file: &File,
    id: String,
    bounds: ImportBounds,
) -> Result<EnvironmentMap, ImportError> {
    let size = file.metadata()?.len();
    match find_out(file, &id, FileKind::Sky, bounds)? {
        Finding::Map(map) => {
            Ok(EnvironmentMap { id, size, created_at: crate::clock::now(), ..map })
        }
        _ => Err(other_finding()),
    }
}

fn other_finding() -> ImportError {
    ImportError::Trouble(io::Error::other("the importer answered another question"))
}

/// What a process of its own finds in a file: a scene or a map.
fn find_out(
    file: &File,
    id: &str,
    kind: FileKind,
    bounds: ImportBounds,
) -> Result<Finding, ImportError> {
    let mut child = Ended(start(file, kind, bounds)?);
    let output = listen(child.0.stdout.take(), MAX_RECORD_BYTES)?;
    let words = listen(child.0.stderr.take(), MAX_WORDS_BYTES)?;
    let status = wait(&mut child.0, Duration::from_secs(bounds.seconds))?;
    let heard = |bytes: JoinHandle<Vec<u8>>| bytes.join().unwrap_or_default();
    let (output, words) = (heard(output), heard(words));
    let words = String::from_utf8_lossy(&words);
    if !words.trim().is_empty() {
        tracing::warn!(id, said = words.trim(), "from the import of an upload");
    }
    let finding = serde_json::from_slice(&output).ok();
    match (status, finding) {
        (Some(status), Some(finding)) if status.success() => match finding {
            Finding::Refused(refusal) => Err(ImportError::Refused(refusal)),
            Finding::Unread(error) => Err(ImportError::Trouble(io::Error::other(error))),
            finding => Ok(finding),
        },
        // Where the system runs out of memory it ends imports first, which says nothing of this one.
        (Some(status), _) if status.signal() == Some(9) => {
            let how = format!("the import of an upload ended with {}", in_words(status));
            Err(ImportError::Trouble(io::Error::other(how)))
        }
        (status, _) => {
            let refusal = why_it_ended(status, &words, (kind, bounds));
            tracing::warn!(id, %refusal, "the import of an upload was ended");
            Err(ImportError::Refused(refusal))
        }
    }
}

/// A process that is over when this is dropped, whatever went wrong meanwhile.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        // It mostly is over already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(mut file: &File, kind: FileKind, bounds: ImportBounds) -> io::Result<Child> {
    // Both descriptors share one position.
    file.rewind()?;
    let mut command = Command::new(own_program()?);
    command.args(["import-worker", "--kind", kind.word()]);
    let ImportBounds { max_triangles, memory_mb, seconds } = bounds;
    command.args(["--max-triangles", &max_triangles.to_string()]);
    command.args(["--memory-mb", &memory_mb.to_string(), "--seconds", &seconds.to_string()]);
    // A group of its own: Ctrl-C in a terminal is for the server, which then ends in order.
    command.stdin(file.try_clone()?).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
    command.spawn()
}

/// Reads a pipe of the process up to `most` bytes and then lets go of it, so that a process that
/// says more fails to.
fn listen(pipe: Option<impl Read + Send + 'static>, most: u64) -> io::Result<JoinHandle<Vec<u8>>> {
    std::thread::Builder::new().name("import".into()).spawn(move || {
        let mut bytes = Vec::new();
        // What was read before an error is what there is.
        let _ = pipe.map(|pipe| pipe.take(most).read_to_end(&mut bytes));
        bytes
    })
}

/// How the process ended; `None` where it had to be ended for its time.
fn wait(child: &mut Child, most: Duration) -> io::Result<Option<ExitStatus>> {
    let deadline = Instant::now() + most;
    let mut pause = LOOK_EVERY.0;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if Instant::now() >= deadline {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(pause);
        pause = (2 * pause).min(LOOK_EVERY.1);
    }
}

/// What the sender is told about a process that ended without an answer.
fn why_it_ended(
    status: Option<ExitStatus>,
    words: &str,
    (kind, bounds): (FileKind, ImportBounds),
) -> SceneRefusal {
    let (fix_memory, fix_time, fix_file) = match kind {
        FileKind::Gltf | FileKind::Bundle => (
            "send smaller images and fewer objects; who runs the server can allow more with --import-memory-mb",
            "send a simpler scene; who runs the server can allow more with --import-seconds",
            FIX_FILE,
        ),
        FileKind::Sky => (
            "send a map of fewer texels; who runs the server can allow more with --import-memory-mb",
            "send a map of fewer texels; who runs the server can allow more with --import-seconds",
            FIX_MAP,
        ),
    };
    let ImportBounds { memory_mb, seconds, .. } = bounds;
    let cpu_time_is_up = |status: ExitStatus| status.signal() == Some(24);
    let (what, fix) = match status {
        Some(status) if words.contains("memory allocation of") => (
            format!(
                "importing it takes more than the {memory_mb} MiB of memory that it may have ({})",
                in_words(status)
            ),
            fix_memory,
        ),
        Some(status) if !cpu_time_is_up(status) => {
            (format!("the importer ended with {}", in_words(status)), fix_file)
        }
        _ => (
            format!("importing it takes more than the {seconds} seconds that it may have"),
            fix_time,
        ),
    };
    SceneRefusal { at: "file".into(), what, fix: fix.into(), too_large: false }
}

/// The inside of the process: imports what comes by standard input and says what it is.
///
/// # Errors
/// Where the process cannot be bounded or heard.
pub fn run(kind: FileKind, bounds: ImportBounds) -> io::Result<()> {
    bound_myself(bounds)?;
    let finding = match look(kind, bounds.max_triangles) {
        Ok(Ok(finding)) => finding,
        Ok(Err(refusal)) => Finding::Refused(refusal),
        Err(error) => Finding::Unread(error.to_string()),
    };
    let mut record = serde_json::to_vec(&finding)?;
    if record.len() as u64 > MAX_RECORD_BYTES {
        record = serde_json::to_vec(&Finding::Refused(SceneRefusal {
            at: "nodes".into(),
            what: format!(
                "names of cameras, variants, animations and scenes take more than {MAX_RECORD_BYTES} bytes"
            ),
            fix: "send fewer of them, with shorter names".into(),
            too_large: true,
        }))?;
    }
    io::stdout().write_all(&record)?;
    io::stdout().flush()
}

fn look(kind: FileKind, max_triangles: usize) -> io::Result<Result<Finding, SceneRefusal>> {
    let mut file = File::from(rustix::io::dup(io::stdin())?);
    let size = file.metadata()?.len();
    failpoints::pass("import", || format!("{size} bytes")).map_err(io::Error::other)?;
    let format = match kind {
        FileKind::Gltf => SceneFormat::Gltf,
        FileKind::Bundle => SceneFormat::Bundle,
        FileKind::Sky => {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes)?;
            return Ok(describe_map(String::new(), &bytes).map(Finding::Map));
        }
    };
    let scene = load_from(&mut file, format, &options(max_triangles, None))?;
    Ok(scene.map(|scene| Finding::Scene(describe(String::new(), format, size, &scene))))
}

/// Bounds memory and time, lets the kernel end this process before any other, and ties it to the
/// thread of the server that waits for it.
fn bound_myself(bounds: ImportBounds) -> io::Result<()> {
    let set =
        |resource, most| setrlimit(resource, Rlimit { current: Some(most), maximum: Some(most) });
    set(Resource::As, bounds.memory_mb << 20)?;
    set(Resource::Cpu, bounds.seconds + SPARE_CPU_S)?;
    set(Resource::Core, 0)?;
    memory::offer_to_the_kernel(memory::IMPORT_GOES_FIRST);
    #[cfg(target_os = "linux")]
    {
        use rustix::process::{Signal, set_parent_process_death_signal};
        set_parent_process_death_signal(Some(Signal::KILL))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: ImportBounds = ImportBounds { max_triangles: 1, memory_mb: 768, seconds: 60 };

    #[test]
    fn every_end_is_said_with_what_to_do() {
        let status = |raw| Some(ExitStatus::from_raw(raw));
        let cases = [
            (
                status(6),
                "memory allocation of 12884901888 bytes failed",
                "768 MiB",
                "--import-memory-mb",
            ),
            (status(6), "fatal runtime error: stack overflow", "signal 6", "validator"),
            (status(24), "", "60 seconds", "--import-seconds"),
            (None, "", "60 seconds", "--import-seconds"),
            (status(1 << 8), "", "exit status: 1", "validator"),
        ];
        for (status, words, what, fix) in cases {
            let refusal = why_it_ended(status, words, (FileKind::Gltf, BOUNDS));
            assert!(refusal.what.contains(what), "{refusal}");
            assert!(refusal.fix.contains(fix), "{refusal}");
            let of_map = why_it_ended(status, words, (FileKind::Sky, BOUNDS));
            assert_eq!(of_map.what, refusal.what);
            assert!(!of_map.fix.contains("glTF") && !of_map.fix.contains("scene"), "{of_map}");
        }
    }

    #[test]
    fn no_more_is_heard_than_may_be_said() {
        let said = listen(Some(io::repeat(b'x')), 100).unwrap().join().unwrap();
        assert_eq!(said.len(), 100);
        assert!(listen(None::<File>, 100).unwrap().join().unwrap().is_empty());
    }
}
