//! Error of a method at time budgets against two independent halves of a reference:
//! `budget SCENE.glb SIZE HALF_A.exr HALF_B.exr MASK METHOD CAMERA SECONDS,… [key=value …]`.
//!
//! The squared error is mean((x − A)(x − B)), free of the reference's own noise. MASK names a file
//! of one byte a pixel (0: counts, 1: counts, on an edge, 2: sees an emitter), or is `-`: then
//! pixels brighter than all reflections of the scene are left out. Seconds like `i5` are
//! iterations. `OUT=path.exr` writes the last picture.

use hemilux_engine::device;
use hemilux_engine::image::{Exposure, Picture};
use hemilux_engine::render::{CameraChoice, Limits, RenderRequest, Unobserved, render};
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use std::sync::Arc;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, size, a, b, mask, method, camera, budgets] = &arguments[..8] else {
        panic!("too few arguments")
    };
    let bytes = std::fs::read(scene).expect("the scene can be read");
    let scene = Arc::new(
        import(&bytes, &Resources::default(), &ImportLimits::default()).expect("the scene is good"),
    );
    let side: u32 = size.parse().expect("size");
    let picture = |path: &String| {
        (path != "-").then(|| Picture::from_exr(&std::fs::read(path).unwrap()).unwrap())
    };
    let halves = picture(a).zip(picture(b));
    let mask = if mask == "-" {
        halves.as_ref().map(|(a, _)| {
            let bright = |x: i32, y: i32| {
                let inside = x >= 0 && y >= 0 && x < side as i32 && y < side as i32;
                inside && a.pixels[(y * side as i32 + x) as usize].max_element() > 12.0
            };
            let around =
                |x: i32, y: i32| (-2..=2).any(|dy| (-2..=2).any(|dx| bright(x + dx, y + dy)));
            let all = (0..side as i32).flat_map(|y| (0..side as i32).map(move |x| (x, y)));
            all.map(|(x, y)| if around(x, y) { 2 } else { 0 }).collect::<Vec<u8>>()
        })
    } else {
        Some(std::fs::read(mask).expect("the mask can be read"))
    };
    let mut options = std::collections::BTreeMap::new();
    let (mut out, mut seed) = (None, 1);
    for setting in &arguments[8..] {
        match setting.split_once('=').expect("key=value") {
            ("OUT", path) => out = Some(path.to_string()),
            ("SEED", number) => seed = number.parse().unwrap(),
            (key, value) => {
                options.insert(key.to_string(), value.to_string());
            }
        }
    }
    let mut device = device::open("cpu").expect("there is a processor");
    for budget in budgets.split(',') {
        let limits = match budget.strip_prefix('i') {
            Some(count) => Limits { iterations: count.parse().ok(), ..Limits::default() },
            None => Limits { seconds: budget.parse().ok(), ..Limits::default() },
        };
        let request = RenderRequest {
            scene: scene.clone(),
            camera: CameraChoice::Index(camera.parse().unwrap()),
            width: side,
            height: side,
            method: method.clone(),
            limits,
            seed,
            options: options.clone(),
        };
        let before = cpu_seconds();
        let rendered = render(device.as_mut(), &request, &mut Unobserved).expect("renders");
        let cpu = cpu_seconds() - before;
        let stats = &rendered.stats;
        print!(
            "{budget:>5}: wall {:.3} cpu {cpu:.3} it {} est {:?}",
            stats.seconds_solve,
            stats.iterations,
            stats.estimated_error.map(|e| (e * 1e4).round() / 1e4)
        );
        if let (Some((a, b)), Some(mask)) = (&halves, &mask) {
            let (mut sum, mut count, mut bias, mut squares) = (0.0, 0.0, 0.0, [0.0f64; 2]);
            let triples = rendered.picture.pixels.iter().zip(&a.pixels).zip(&b.pixels);
            for (((x, a), b), mask) in triples.zip(mask).filter(|(_, mask)| **mask < 2) {
                let (da, db) = ((*x - *a).as_dvec3(), (*x - *b).as_dvec3());
                squares[*mask as usize] += da.dot(db);
                bias += (da + db).element_sum() * 0.5;
                sum += f64::from((*a + *b).element_sum()) * 0.5;
                count += 3.0;
            }
            let mean = sum / count;
            let root = |x: f64| (x / count).max(0.0).sqrt() / mean * 100.0;
            print!(
                " rRMSE {:.2} % (off edges {:.2}, edges {:.2}) bias {:+.2} %",
                root(squares[0] + squares[1]),
                root(squares[0]),
                root(squares[1]),
                bias / sum * 100.0
            );
        }
        println!();
        for (name, value) in &stats.diagnostics {
            print!("  {name} {value:.4}");
        }
        println!("  patches {} shots {}", stats.patches, stats.shots);
        if let Some(out) = &out {
            rendered.picture.write(out.as_ref(), Exposure::Auto).expect("written");
            let png = out.replace(".exr", ".png");
            rendered.picture.write(png.as_ref(), Exposure::Auto).expect("written");
        }
    }
}

/// Processor seconds of this process so far.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |at: usize| fields.get(at).and_then(|t| t.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}
