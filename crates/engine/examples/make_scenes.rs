//! Writes the project's own scenes: `cargo run --release -p hemilux-engine --example make_scenes -- scenes`.

use hemilux_engine::scene::made;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder: PathBuf = std::env::args_os().nth(1).ok_or("usage: make_scenes FOLDER")?.into();
    std::fs::create_dir_all(&folder)?;
    for (name, bytes) in made::shipped() {
        let path = folder.join(name);
        std::fs::write(&path, &bytes)?;
        println!("{}: {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
