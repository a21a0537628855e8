//! What is rendered: the project's own scenes, each with a reference of its own for noise, and
//! the path-traced reference where one is given.

use super::bench::Bench;
use super::variants::Variant;
use crate::results::Failure;
use crate::views::{imported, regions};
use hemilux_charts::accuracy::Reference;
use hemilux_charts::regions::Regions;
use hemilux_charts::sheet::reduced;
use hemilux_engine::image::Picture;
use hemilux_engine::scene::Scene;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::scene::made;
use std::path::Path;
use std::sync::Arc;

/// Seeds of the references' halves; measured runs count from 1.
const REFERENCE_SEEDS: [u64; 2] = [1_000_001, 1_000_002];
/// The first iterations of a reference, without all bounces yet, are left out.
const REFERENCE_BURN_IN: u64 = 32;

/// A scene seen by its first camera.
pub struct View {
    /// Short name, for files and tables.
    pub name: String,
    /// The scene.
    pub scene: Arc<Scene>,
    /// Seeds in times of the usual number: more where shots are cheap.
    pub effort: f64,
    /// Width and height, pixels.
    pub side: u32,
    /// Sub-pixel samples.
    pub samples: u32,
    /// Which pixels count.
    pub regions: Regions,
    /// What smooth pictures converge to, …
    pub smooth: Reference,
    /// … and flat ones.
    pub flat: Reference,
}

impl View {
    /// How many of `seeds` a variant gets: few where they take too long.
    pub fn seeds(&self, variant: &Variant, seeds: u64, slow_seeds: u64) -> u64 {
        if variant.starts_slowly() && self.effort <= 1.0 { seeds.min(slow_seeds) } else { seeds }
    }

    /// The reference that a variant's pictures converge to.
    pub fn reference(&self, variant: &Variant) -> &Reference {
        if variant.is_flat() { &self.flat } else { &self.smooth }
    }
}

/// The three scenes of the paper's kind, with references from long unbiased runs on the same
/// patches.
pub fn own(bench: &mut Bench) -> Result<Vec<View>, Failure> {
    let scenes = [
        ("cornell", made::cornell(), 1.5),
        ("cornell_phong", made::phong_cornell(), 1.0),
        ("office", made::office(), 0.75),
    ];
    let mut views = Vec::new();
    for (name, glb, effort) in scenes {
        if !bench.wants_scene(name) {
            continue;
        }
        bench.say(&format!("{name}: reference"));
        let scene = Arc::new(imported(&glb));
        let (side, samples) = (bench.size.side, bench.size.samples);
        let regions = regions(&scene, side, samples);
        let [smooth, flat] = references(bench, &scene)?;
        views.push(View { name: name.into(), scene, effort, side, samples, regions, smooth, flat });
    }
    Ok(views)
}

fn references(bench: &mut Bench, scene: &Arc<Scene>) -> Result<[Reference; 2], Failure> {
    let mut of = |options: &'static [(&'static str, &'static str)]| -> Result<Reference, Failure> {
        let variant = Variant::new("reference", options);
        let mut half = |seed| -> Result<Picture, Failure> {
            let size = bench.size;
            let mut job = bench.job(scene, size.side, size.samples, &variant);
            let drop = REFERENCE_BURN_IN.min(size.reference_shots / 16);
            job.options.insert("burn_in".into(), drop.to_string());
            job.seed = seed;
            Ok(bench.render(job, size.reference_shots / variant.shots_per_iteration())?.picture)
        };
        Ok(Reference::new(half(REFERENCE_SEEDS[0])?, half(REFERENCE_SEEDS[1])?))
    };
    Ok([of(&[])?, of(&[("reconstruction", "flat")])?])
}

/// The scene and the halves of a path-traced reference in a folder: `cornell-half-a.exr`,
/// `cornell-half-b.exr`; scene file by `--reference-scene`, else `../scenes/cornell.glb`.
pub fn path_traced(folder: &Path, scene: Option<&Path>, side: u32) -> Result<View, Failure> {
    let beside = folder.join("../scenes/cornell.glb");
    let path = scene.unwrap_or(&beside);
    let read = |path: &Path| {
        std::fs::read(path).map_err(|error| format!("cannot read {}: {error}", path.display()))
    };
    let scene = import(&read(path)?, &Resources::new(), &ImportLimits::default())?;
    if scene.cameras.is_empty() {
        return Err(format!("{} has no camera", path.display()).into());
    }
    let half = |name: &str| -> Result<Picture, Failure> {
        let picture = Picture::from_exr(&read(&folder.join(name))?)?;
        if picture.width != picture.height || picture.width < side {
            let (w, h) = (picture.width, picture.height);
            return Err(format!("{name} has {w}×{h} pixels; a square of {side} is wanted").into());
        }
        Ok(reduced(&picture, picture.width / side)?)
    };
    let halves = [half("cornell-half-a.exr")?, half("cornell-half-b.exr")?];
    if halves[0].width != side {
        return Err(format!("the reference's side is not a multiple of {side} pixels").into());
    }
    let samples = 16;
    let regions = regions(&scene, side, samples);
    let [a, b] = halves;
    Ok(View {
        name: "path-traced".into(),
        scene: Arc::new(scene),
        effort: 1.0,
        side,
        samples,
        regions,
        smooth: Reference::new(a.clone(), b.clone()),
        flat: Reference::new(a, b),
    })
}
