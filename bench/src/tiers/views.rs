//! What the method is measured on: views that differ in what makes light hard, and references for
//! them by path tracing, kept in files for the next time.

use crate::real_view::kind_of;
use crate::results::Failure;
use crate::views::imported;
use glam::Vec3;
use hemilux_charts::accuracy::{Judged, Reference, error};
use hemilux_charts::regions::Regions;
use hemilux_engine::device::Device;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{
    CameraChoice, Limits, RenderRequest, Rendered, Unobserved, choose_camera,
};
use hemilux_engine::sampling::SparsePixels;
use hemilux_engine::scene::{Camera, Material, Scene, Triangle, Vertex, made};
use hemilux_engine::transport::render;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Seeds of a reference's halves; judged runs count from 1.
const REFERENCE_SEEDS: [u64; 2] = [1_000_001, 1_000_002];

/// Views whose references take so many times as long to tell pictures apart.
const DARK: [&str; 5] = ["corridor", "lights", "white", "shade", "gallery"];
const LONGER: f64 = 3.0;

/// A scene with the camera that looks at it.
pub struct View {
    /// Its name, also of files.
    pub name: String,
    /// What is hard about it.
    pub why: &'static str,
    /// The scene; its first camera is the view's.
    pub scene: Arc<Scene>,
    /// Width and height of the picture, pixels.
    pub side: u32,
}

impl View {
    pub fn new(name: &str, why: &'static str, scene: Scene, side: u32) -> Self {
        Self { name: name.into(), why, scene: Arc::new(scene), side }
    }

    /// A job on the view.
    pub fn request(
        &self,
        method: &str,
        limits: Limits,
        seed: u64,
        options: &[(&str, &str)],
    ) -> RenderRequest {
        let text = |(name, value): &(&str, &str)| ((*name).to_string(), (*value).to_string());
        RenderRequest {
            limits,
            seed,
            options: options.iter().map(text).collect::<BTreeMap<_, _>>(),
            ..RenderRequest::new(self.scene.clone(), method, [self.side; 2])
        }
    }

    /// The reference, or one pixel of each square of so many pixels of it: from the folder, or traced
    /// for so many seconds a half and put there.
    pub fn truth(
        &self,
        device: &mut dyn Device,
        folder: &Path,
        (seconds, squares): (f64, u32),
    ) -> Result<Truth, Failure> {
        let mut halves = Vec::new();
        let kind = kind_of(squares);
        for (seed, half) in REFERENCE_SEEDS.into_iter().zip(["a", "b"]) {
            let path = folder.join(format!("{}-{}-{kind}{half}.exr", self.name, self.side));
            if let Ok(bytes) = std::fs::read(&path) {
                halves.push(Picture::from_exr(&bytes)?);
                continue;
            }
            eprintln!("{}: reference, half {half}", self.name);
            let longer = if DARK.contains(&self.name.as_str()) { LONGER } else { 1.0 };
            let limits = Limits::seconds(seconds * longer);
            let sparse = [("pixel_squares", &*squares.to_string())];
            let request = self.request("ray-traced", limits, seed, &sparse);
            let picture = render(device, &request, &mut Unobserved)?.picture;
            std::fs::write(&path, picture.to_exr()?)?;
            halves.push(picture);
        }
        let (camera, _) = choose_camera(&self.scene, &CameraChoice::First, [self.side; 2])?;
        let size = (self.side, self.side);
        // Where an emitter covers a thousandth of a pixel its noise would be that of the picture.
        let regions = Regions::new(&self.scene, &camera, size, 16, 1).beside_no_emitter(self.side);
        let [mut counted, ..] = regions.masks;
        let traced = SparsePixels::new(squares).mask([self.side; 2]);
        counted.iter_mut().zip(traced).for_each(|(counted, traced)| *counted &= traced);
        let second = halves.pop().ok_or("no reference")?;
        let first = halves.pop().ok_or("no reference")?;
        Ok(Truth { reference: Reference::new(first, second), counted })
    }
}

/// A view's reference, and which pixels count.
pub struct Truth {
    reference: Reference,
    counted: Vec<bool>,
}

impl Truth {
    /// rRMSE of a picture, free of the reference's noise.
    pub fn error(&self, rendered: &Rendered) -> f64 {
        error(self.reference.squared_error(&rendered.picture, &self.counted))
    }

    /// The same with how far it may be off.
    pub fn judged(&self, rendered: &Rendered) -> Judged {
        self.reference.judged(&rendered.picture, &self.counted)
    }

    /// The same after a Gaussian of six pixels: what is left of the error from afar.
    pub fn blurred_error(&self, rendered: &Rendered) -> f64 {
        error(self.reference.blurred_squared_error(&rendered.picture, &self.counted))
    }

    /// Mean radiance over the reference's.
    pub fn energy(&self, rendered: &Rendered) -> f64 {
        self.reference.energy(&rendered.picture, &self.counted)
    }

    /// rRMSE below which the reference can't tell pictures apart.
    pub fn resolution(&self) -> f64 {
        self.reference.resolution(&self.counted)
    }

    /// rRMSE of the reference itself.
    pub fn own_error(&self) -> f64 {
        self.reference.own_error(&self.counted)
    }
}

/// The views of the pages, the first five of which stand for the rest where time is short.
pub fn all(side: u32) -> Vec<View> {
    let view = |name, why, scene| View::new(name, why, scene, side);
    let cornell = || imported(&made::cornell());
    let corridor = || imported(&made::corridor());
    let office = || imported(&made::office());
    vec![
        view("cornell", "one light, soft shadows, colour bleeding", cornell()),
        view("office", "15,000 triangles, textures, gloss, narrow gaps", office()),
        view("corridor", "the light is two rooms away", corridor()),
        view("phong", "glossy boxes", imported(&made::phong_cornell())),
        view("lights", "100 small lights", with_lights(cornell(), 100)),
        view("white", "albedo .9: light bounces long", with_albedo(cornell(), 0.9)),
        view(
            "room",
            "10,000 triangles, a light of many",
            imported(&made::tessellated_room(10_000)),
        ),
        view(
            "desk",
            "what stands on a desk from near",
            seen_from(office(), Vec3::new(0.6, 1.5, 0.2), Vec3::new(0.4, 0.8, -1.6), 0.7),
        ),
        view(
            "contact",
            "a box on the floor from near",
            seen_from(cornell(), Vec3::new(0.8, 0.5, 2.2), Vec3::new(0.35, 0.25, 0.3), 0.5),
        ),
        view(
            "lobby",
            "the lit room with the dark corridor behind",
            seen_from(corridor(), Vec3::new(0.4, 1.6, 3.6), Vec3::new(4.0, 1.1, 1.6), 1.1),
        ),
        view("shade", "most light comes from the inside of a lampshade", imported(&made::shade())),
        view("blinds", "a window behind slats", imported(&made::blinds())),
        view("hall", "thirty lamps that shine to all sides", imported(&made::hall())),
        view("gallery", "metal balls, a mirror, a polished floor", imported(&made::gallery())),
        view("kitchen", "everything is a little polished", imported(&made::kitchen())),
    ]
}

/// The scene with another first camera.
fn seen_from(mut scene: Scene, eye: Vec3, target: Vec3, yfov: f32) -> Scene {
    scene.cameras.insert(0, Camera::look_at("view", eye, target, Vec3::Y, yfov));
    scene
}

/// The scene with all that does not shine in one grey.
pub fn with_albedo(mut scene: Scene, albedo: f32) -> Scene {
    for material in scene.materials.iter_mut().filter(|material| !material.emits()) {
        material.base_color = Rgb::splat(albedo);
    }
    scene
}

/// The scene with its light replaced by `count` small squares under the ceiling that together
/// shine as much.
pub fn with_lights(mut scene: Scene, count: usize) -> Scene {
    let (low, high) = scene.bounds().unwrap_or((Vec3::ZERO, Vec3::ONE));
    let mut power = Rgb::ZERO;
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.vertices.map(|v| scene.vertices[v as usize].position);
        let area = 0.5 * (b - a).cross(c - a).length();
        power += scene.materials[triangle.material as usize].emission * area;
    }
    for material in &mut scene.materials {
        material.emission = Rgb::ZERO;
    }
    let rows = (count as f32).sqrt().ceil() as usize;
    let step = (high - low) / rows as f32;
    let half = 0.15 * step.x.min(step.z);
    let emission = power / (count as f32 * 4.0 * half * half);
    let material = scene.materials.len() as u32;
    scene.materials.push(Material { emission, ..Material::lambertian("small light", Rgb::ZERO) });
    let height = high.y - 0.02 * (high.y - low.y);
    for light in 0..count {
        let (row, column) = ((light / rows) as f32 + 0.5, (light % rows) as f32 + 0.5);
        let center = Vec3::new(low.x + row * step.x, height, low.z + column * step.z);
        let first = scene.vertices.len() as u32;
        // Counter-clockwise seen from below.
        for (x, z) in [(-half, -half), (half, -half), (half, half), (-half, half)] {
            scene.vertices.push(Vertex::new(center + Vec3::new(x, 0.0, z), Vec3::NEG_Y));
        }
        for corners in [[0, 1, 2], [0, 2, 3]] {
            let vertices = corners.map(|corner| first + corner);
            scene.triangles.push(Triangle { vertices, material });
        }
    }
    scene
}
