//! `export`: a scene of [`made::real`], one of the tiers' that is made, or a room of very many triangles, as files that other
//! renderers and the command line can read:
//! NAME.glb with its camera, NAME-sky.exr and, in NAME.light.json, which sky and sun it has.

use crate::results::Failure;
use hemilux_engine::image::Picture;
use hemilux_engine::scene::made::{self, real};
use hemilux_engine::scene::{Environment, Sky};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Arguments {
    /// Which scene; `tessellated-N` is a room of about N triangles.
    scene: String,
    /// Folder for the files.
    #[arg(long)]
    out: PathBuf,
    /// Seed of the scenes that are made by chance.
    #[arg(long, default_value_t = 1)]
    scene_seed: u32,
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { scene: name, out, scene_seed } = arguments;
    std::fs::create_dir_all(out)?;
    if let Some(glb) = without_surroundings(name)? {
        return Ok(std::fs::write(out.join(format!("{name}.glb")), glb)?);
    }
    let all = real::all(*scene_seed);
    let scene = all.iter().find(|scene| scene.name == *name);
    let scene = scene.ok_or_else(|| format!("there is no scene {name}"))?;
    std::fs::write(out.join(format!("{name}.glb")), &scene.glb)?;
    let light = light(&scene.environment, name, out)?;
    let text = serde_json::to_string_pretty(&light)? + "\n";
    Ok(std::fs::write(out.join(format!("{name}.light.json")), text)?)
}

/// A scene that no light from far away shines into.
fn without_surroundings(name: &str) -> Result<Option<Vec<u8>>, Failure> {
    Ok(Some(match name {
        "blinds" => made::blinds(),
        "gallery" => made::gallery(),
        "hall" => made::hall(),
        "kitchen" => made::kitchen(),
        "shade" => made::shade(),
        _ => match name.strip_prefix("tessellated-") {
            Some(triangles) => made::tessellated_room(triangles.parse()?),
            None => return Ok(None),
        },
    }))
}

/// Writes the sky's map and says what the surroundings are.
fn light(environment: &Environment, name: &str, out: &Path) -> Result<Value, Failure> {
    let mut light = json!({});
    match &environment.sky {
        Sky::None => {}
        Sky::Map(placed) if placed.rotation == 0.0 => {
            let texels = placed.map.texels().iter().map(|texel| placed.scale * *texel);
            let map = Picture::new(placed.map.width(), placed.map.height(), texels.collect());
            let file = format!("{name}-sky.exr");
            std::fs::write(out.join(&file), map.to_exr()?)?;
            light["sky"] = json!(file);
        }
        _ => return Err(format!("the sky of {name} is no map, or a turned one").into()),
    }
    if let Some(sun) = environment.sun {
        light["sun"] = json!({
            "direction": sun.direction.to_array(),
            "irradiance": sun.irradiance.to_array(),
            "angular_radius": sun.angular_radius,
        });
    }
    Ok(light)
}
