//! Scenes of very many triangles: what `hemilux render` holds of each.

use hemilux_engine::scene::made;
use hemilux_engine::transport;
use hemilux_tests::load::try_peak_mib;
use hemilux_tests::server::program;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Triangles of two rooms.
const TRIANGLES: [usize; 2] = [100_000, 500_000];
/// Most bytes that a triangle more may take: 500 of the job, those of the file, and those of the
/// scene with its vertices.
const MOST_BYTES: f64 = 500.0 + 40.0 + 100.0;

/// Bytes at the peak of a render of a file's first picture.
fn peak(file: &Path, picture: &Path) -> f64 {
    let mut child = Command::new(program())
        .arg("render")
        .arg(file)
        .args(["--method", "hemilux", "--device", "cpu", "--size", "64x64"])
        .args(["--iterations", "1", "--quiet", "--output"])
        .arg(picture)
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    let mut peak = 0.0;
    let ended = loop {
        if let Some(ended) = child.try_wait().expect("it can be waited for") {
            break ended;
        }
        // Nothing is said of a process that has just ended.
        peak = try_peak_mib(child.id()).unwrap_or(peak);
        std::thread::sleep(Duration::from_millis(2));
    };
    assert!(ended.success(), "{ended}");
    peak * f64::from(1 << 20)
}

#[test]
fn a_triangle_more_takes_no_more_than_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let peaks = TRIANGLES.map(|triangles| {
        let file = folder.path().join(format!("{triangles}.glb"));
        std::fs::write(&file, made::tessellated_room(triangles)).expect("there is room");
        peak(&file, &folder.path().join("picture.png"))
    });
    let more = (TRIANGLES[1] - TRIANGLES[0]) as f64;
    let each = (peaks[1] - peaks[0]) / more;
    let said = TRIANGLES.map(|triangles| {
        let said =
            transport::needed_bytes("hemilux", &Default::default(), triangles as u64, [64, 64]);
        said.expect("it is known") as f64
    });
    println!("{each:.0} bytes a triangle, peaks of {peaks:?} bytes, {said:?} said");
    assert!(each > 100.0, "{each}: it was not measured");
    assert!(each < MOST_BYTES, "{each}");
    assert!(each < (said[1] - said[0]) / more, "{each} for {said:?}");
}
