//! Glow: what many faint surfaces emit. Real files let whole objects shine a little, by textures over
//! thousands of triangles. As lights these are many, each of little worth, and most of them shine on their
//! own neighbours; a ray over the hemisphere meets them as often as it meets what reflects light, and
//! they are as bright as that. So they are no lights: rays that look for reflected light find theirs, too
//! (docs/decisions/0096).

use super::cells::EmissionCells;
use super::from_triangles::untextured;
use crate::radiometry::{Rgb, importance};
use crate::scene::Scene;
use crate::surface::{Surface, World};
use glam::Vec3;
use rayon::prelude::*;

/// With no more lights than this nothing glows: each of them is known in closed form at little cost.
pub const FEW_LIGHTS: usize = 128;
/// A material glows that is at most so many times as bright as all light is in the mean: what covers a
/// quarter of what is seen, and is the only light, does.
const MOST_BRIGHTNESS: f64 = 4.0;
/// Triangles that a thread adds up together.
const CHUNK: usize = 4096;

/// The materials that glow.
pub struct Glow {
    /// Of each material, whether it does.
    of_material: Vec<bool>,
}

/// Sums over all that a material emits.
#[derive(Clone, Copy, Default)]
struct Emitted {
    /// Σ radiance × area.
    sum: f64,
    /// Σ radiance² × area.
    squares: f64,
    /// Σ radiance × area × mean radiance that arrives from outside the scene.
    outside: f64,
    /// Whether light passes some of it: rays go on behind that, and leave what it emits to lights.
    is_clear: bool,
}

impl Emitted {
    fn add(&mut self, radiance: Rgb, (area, two_sided): (f32, bool), outside: f64) {
        let radiance = f64::from(importance(radiance));
        let area = f64::from(area) * if two_sided { 2.0 } else { 1.0 };
        self.sum += radiance * area;
        self.squares += radiance * radiance * area;
        self.outside += radiance * area * outside;
    }

    /// Mean radiance, by what it sends: a few bright spots on a faint surface make it bright, since rays
    /// that meet them by chance scatter.
    fn brightness(&self) -> f64 {
        self.squares / self.sum
    }

    /// Mean radiance that arrives where it emits from outside the scene.
    fn surroundings(&self) -> f64 {
        self.outside / self.sum
    }
}

impl Glow {
    /// What glows in a world whose emissive textures have those cells; `None` where nothing does. `surroundings` is
    /// the mean radiance that arrives from outside at a point of a surface with such a unit normal.
    pub fn find(
        world: &World,
        cells: &EmissionCells,
        surroundings: impl Fn(Vec3, Vec3) -> f64,
    ) -> Option<Self> {
        let (scene, rays) = (&*world.scene, &world.rays);
        let outside = |triangle: u32| {
            let Surface { spot, normal, .. } = world.at(triangle, [1.0 / 3.0; 2], false);
            surroundings(spot.off_surface(normal), normal)
        };
        let mut of_material = vec![Emitted::default(); scene.materials.len()];
        for emitter in untextured(scene, rays) {
            let [a, b, c] = emitter.corners;
            let area = 0.5 * (b - a).cross(c - a).length();
            let own = &mut of_material[scene.triangle(emitter.triangle).material as usize];
            let outside = outside(emitter.triangle);
            own.add(emitter.radiance, (area, emitter.two_sided), outside);
            own.is_clear |= world.is_clear(emitter.triangle);
        }
        for cell in &cells.cells {
            let area = cell.share * rays.corners(scene, cell.triangle).1;
            let material = scene.triangle(cell.triangle).material as usize;
            let two_sided = scene.materials[material].double_sided;
            of_material[material].add(cell.radiance, (area, two_sided), outside(cell.triangle));
            of_material[material].is_clear |= world.is_clear(cell.triangle);
        }
        let area = shown_area(world);
        let mean = of_material.iter().map(|own| own.sum).sum::<f64>() / area;
        let is_faint =
            |own: &Emitted| own.brightness() <= MOST_BRIGHTNESS * (mean + own.surroundings());
        let glows = |own: &Emitted| own.sum > 0.0 && !own.is_clear && is_faint(own);
        let of_material: Vec<bool> = of_material.iter().map(glows).collect();
        of_material.contains(&true).then_some(Self { of_material })
    }

    /// Whether a triangle glows.
    pub fn covers(&self, scene: &Scene, triangle: u32) -> bool {
        self.of_material[scene.triangle(triangle).material as usize]
    }

    /// Radiance of a surface's glow.
    pub fn of(&self, scene: &Scene, surface: &Surface) -> Rgb {
        let shines = surface.emission != Rgb::ZERO && self.covers(scene, surface.triangle);
        if shines { surface.emission } else { Rgb::ZERO }
    }
}

/// Area of all sides of a scene's surfaces that are seen, square ray units.
fn shown_area(world: &World) -> f64 {
    let scene = &*world.scene;
    let of = |triangle: usize| {
        let triangle = triangle as u32;
        let sides = if scene.material_of(triangle).double_sided { 2.0 } else { 1.0 };
        f64::from(world.rays.corners(scene, triangle).1) * sides
    };
    (0..scene.triangle_count()).into_par_iter().with_min_len(CHUNK).map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emitters::DirectLights;
    use crate::scene::environment::Environment;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made::real::{RealScene, wide_window};
    use crate::scene::made::revolved::revolved;
    use crate::scene::{Material, Triangle, Vertex};
    use std::sync::Arc;

    /// A vase, seen from outside, of which every eighth triangle shines so much, in turn of two materials.
    fn vase(radiance: f32, transmission: f32) -> Scene {
        let profile = |ring: u32| [1.0 + 0.1 * (0.5 * ring as f32).sin(), 0.1 * ring as f32];
        let profile: Vec<[f32; 2]> = (0..16).map(profile).collect();
        let mut scene = revolved(&profile, 40, Material::lambertian("dull", Rgb::splat(0.5)));
        let emission = Rgb::splat(radiance);
        let lamp = Material { emission, transmission, ..scene.materials[0].clone() };
        scene.materials.extend([lamp.clone(), lamp]);
        for (number, triangle) in scene.triangles.iter_mut().step_by(8).enumerate() {
            triangle.material = 1 + number as u32 % 2;
        }
        scene
    }

    fn lights(radiance: f32, transmission: f32, environment: Environment) -> DirectLights {
        let scene = vase(radiance, transmission);
        let world = World::surrounded(Arc::new(scene), Arc::new(environment));
        DirectLights::new(&world).expect("it shines")
    }

    /// What is far brighter than the rest are lights, however many; what is faint beside the light from
    /// outside is none.
    #[test]
    fn what_is_faint_glows() {
        assert!(!lights(0.5, 0.0, Environment::none()).has_glow());
        assert!(!lights(500.0, 0.0, Environment::studio()).has_glow());
        assert!(!lights(0.1, 0.9, Environment::studio()).has_glow(), "rays go on behind it");
        let faint = lights(0.1, 0.0, Environment::studio());
        assert!(faint.has_glow() && faint.count() == 1, "the sky alone: {}", faint.count());
    }

    /// What is faint beside the light from outside is a light where that light hardly comes: in a room with a window,
    /// but not beside the house.
    #[test]
    fn what_is_faint_outside_is_bright_inside() {
        let glows = |z: f32| {
            let RealScene { glb, environment, .. } = wide_window();
            let room = import(&glb, &Resources::default(), &ImportLimits::default());
            let (mut scene, vase) = (room.expect("valid"), vase(20.0, 0.0));
            let [vertices, materials] = [scene.vertices.len(), scene.materials.len()];
            let place = |position| 0.3 * position + Vec3::new(2.0, 1.0, z);
            let moved = vase
                .vertices
                .into_iter()
                .map(|vertex| Vertex { position: place(vertex.position), ..vertex });
            scene.vertices.extend(moved);
            scene.materials.extend(vase.materials);
            scene.triangles.extend(vase.triangles.into_iter().map(|triangle| Triangle {
                vertices: triangle.vertices.map(|vertex| vertex + vertices as u32),
                material: triangle.material + materials as u32,
            }));
            let world = World::surrounded(Arc::new(scene), Arc::new(environment));
            let lights = DirectLights::new(&world).expect("it shines");
            assert!(lights.openings().is_some(), "the window is found");
            lights.has_glow()
        };
        assert!(!glows(1.5), "inside");
        assert!(glows(-2.0), "beside the house");
    }
}
