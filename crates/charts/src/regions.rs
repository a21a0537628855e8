//! Which pixels of a view count: emitters are left out, and pixels near an edge between surfaces
//! are told from the rest. Found with the engine's own camera: a copy of the scene in which every
//! triangle glows in a colour of its own is its item buffer.

use glam::{Mat4, Vec3};
use hemilux_engine::image::Picture;
use hemilux_engine::measurement::reconstruction::Smoothness;
use hemilux_engine::measurement::{Measurement, Solution};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::{Camera, Material, Projection, Scene};
use std::sync::Arc;

/// Surfaces that meet at a larger angle make an edge; curved bodies are made of smaller ones.
const EDGE_ANGLE_DEGREES: f32 = 40.0;
/// Surfaces further apart than this share of the distance to the eye make an edge.
const EDGE_GAP: f32 = 0.02;

/// The regions that errors are given for, in the order of [`Regions::masks`].
pub const REGIONS: [&str; 3] = ["all", "edges", "rest"];

/// Masks of a view's pixels, `true` where a pixel counts.
pub struct Regions {
    /// Everything but emitters; of that what is near an edge; of that the rest.
    pub masks: [Vec<bool>; 3],
}

impl Regions {
    /// Of a view of `width` × `height` pixels with `samples` sub-pixel samples each. A pixel is an
    /// emitter where any sample sees one; it is near an edge where one is at most `reach` pixels
    /// away.
    pub fn new(
        scene: &Scene,
        camera: &Camera,
        (width, height): (u32, u32),
        samples: u32,
        reach: u32,
    ) -> Self {
        let all = without_emitters(scene, camera, (width, height), samples);
        let edges = near(&edges(scene, camera, width, height), width as usize, reach as usize);
        let count = all.len();
        let near_edge = (0..count).map(|at| all[at] && edges[at]).collect();
        let rest = (0..count).map(|at| all[at] && !edges[at]).collect();
        Self { masks: [all, near_edge, rest] }
    }

    /// The same without the pixels next to an emitter: where one covers a thousandth of a pixel,
    /// no sample need see it, and yet it is most of the pixel's noise.
    pub fn beside_no_emitter(mut self, width: u32) -> Self {
        let emitters: Vec<bool> = self.masks[0].iter().map(|counted| !counted).collect();
        let beside = near(&emitters, width as usize, 1);
        for mask in &mut self.masks {
            mask.iter_mut().zip(&beside).for_each(|(counted, beside)| *counted &= !beside);
        }
        self
    }

    /// Share of the counted pixels that are near an edge.
    pub fn edge_share(&self) -> f64 {
        let count = |mask: &[bool]| mask.iter().filter(|counted| **counted).count() as f64;
        count(&self.masks[1]) / count(&self.masks[0])
    }
}

/// Which pixels of a view count: those of which none of `samples` sub-pixel samples sees an
/// emitter.
pub fn without_emitters(
    scene: &Scene,
    camera: &Camera,
    (width, height): (u32, u32),
    samples: u32,
) -> Vec<bool> {
    let mut emitting = scene.clone();
    emitting.textures.clear();
    for material in &mut emitting.materials {
        *material = Material {
            emission: Rgb::splat(f32::from(u8::from(material.emits()))),
            double_sided: material.double_sided,
            ..Material::lambertian("seen", Rgb::ZERO)
        };
    }
    let emitters = seen(emitting, camera, width, height, samples);
    emitters.pixels.iter().map(|pixel| pixel.x <= 0.0).collect()
}

/// The scene with every triangle black and glowing in the given colour.
fn glowing(scene: &Scene, color: impl Fn(usize) -> Rgb) -> Scene {
    let mut glowing = scene.flattened();
    glowing.materials.clear();
    for index in 0..glowing.triangles.len() {
        let triangle = glowing.triangles[index];
        let double_sided = scene.materials[triangle.material as usize].double_sided;
        glowing.triangles[index].material = index as u32;
        glowing.materials.push(Material {
            emission: color(index),
            double_sided,
            ..Material::lambertian("glowing", Rgb::ZERO)
        });
    }
    glowing
}

fn seen(scene: Scene, camera: &Camera, width: u32, height: u32, samples: u32) -> Picture {
    let patched = Arc::new(PatchedScene::new(Arc::new(scene), 1));
    let dark = Solution::dark(patched.patches.len());
    Measurement::new(patched, camera, [width, height], samples, Smoothness::Flat).picture(&dark)
}

/// Pixels beside a pixel that sees another surface.
fn edges(scene: &Scene, camera: &Camera, width: u32, height: u32) -> Vec<bool> {
    // Whole numbers up to 2^24 are exact in single precision.
    assert!(scene.triangle_count() < 1 << 24, "too many triangles to number them as colours");
    let numbered = glowing(scene, |index| Rgb::splat(index as f32 + 1.0));
    let picture = seen(numbered, camera, width, height, 1);
    let hits: Vec<Option<Hit>> = (picture.pixels.iter().enumerate())
        .map(|(at, pixel)| {
            let triangle = (pixel.x as usize).checked_sub(1)?;
            let (x, y) = (at as u32 % width, at as u32 / width);
            Hit::new(scene, camera, triangle, pixel_ray(camera, x, y, width, height))
        })
        .collect();
    let columns = width as usize;
    let mut found = vec![false; hits.len()];
    for at in 0..hits.len() {
        let right = (at % columns + 1 < columns).then_some(at + 1);
        let below = (at + columns < hits.len()).then_some(at + columns);
        for neighbour in [right, below].into_iter().flatten() {
            if differ(&hits[at], &hits[neighbour]) {
                found[at] = true;
                found[neighbour] = true;
            }
        }
    }
    found
}

/// What a pixel's centre sees.
struct Hit {
    point: Vec3,
    normal: Vec3,
    distance: f32,
}

impl Hit {
    fn new(
        scene: &Scene,
        camera: &Camera,
        triangle: usize,
        (eye, ray): (Vec3, Vec3),
    ) -> Option<Self> {
        let [a, b, c] = scene.corners(&scene.triangle(triangle as u32));
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let normal = if normal.dot(ray) > 0.0 { -normal } else { normal };
        let along = normal.dot(a - eye) / normal.dot(ray);
        let point = eye + along * ray;
        let distance = (point - camera.to_world.w_axis.truncate()).length();
        point.is_finite().then_some(Self { point, normal, distance })
    }
}

fn differ(a: &Option<Hit>, b: &Option<Hit>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => {
            let apart = b.point - a.point;
            let gap = a.normal.dot(apart).abs().min(b.normal.dot(apart).abs());
            a.normal.dot(b.normal) < EDGE_ANGLE_DEGREES.to_radians().cos()
                || gap > EDGE_GAP * a.distance.min(b.distance)
        }
        (None, None) => false,
        _ => true,
    }
}

/// Origin and direction of the ray through a pixel's centre.
fn pixel_ray(camera: &Camera, x: u32, y: u32, width: u32, height: u32) -> (Vec3, Vec3) {
    let aspect = width as f32 / height as f32;
    let right = (2.0 * (x as f32 + 0.5) / width as f32 - 1.0) * aspect;
    let up = 1.0 - 2.0 * (y as f32 + 0.5) / height as f32;
    let axes: &Mat4 = &camera.to_world;
    let (eye, back) = (axes.w_axis.truncate(), axes.z_axis.truncate());
    let offset = axes.x_axis.truncate() * right + axes.y_axis.truncate() * up;
    match camera.projection {
        Projection::Perspective { yfov } => (eye, offset * (0.5 * yfov).tan() - back),
        Projection::Orthographic { ymag } => (eye + offset * ymag, -back),
    }
}

/// Pixels at most `reach` columns and rows from a marked one.
fn near(marked: &[bool], width: usize, reach: usize) -> Vec<bool> {
    let height = marked.len() / width;
    let mut found = vec![false; marked.len()];
    for at in (0..marked.len()).filter(|at| marked[*at]) {
        let (x, y) = (at % width, at / width);
        for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            found[row * width..][x.saturating_sub(reach)..(x + reach + 1).min(width)].fill(true);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
    use hemilux_engine::scene::made;

    fn cornell_box() -> Scene {
        import(&made::cornell(), &Resources::new(), &ImportLimits::default()).expect("it loads")
    }

    #[test]
    fn marks_spread_by_the_reach_and_stop_at_borders() {
        let mut marked = vec![false; 30];
        marked[0] = true;
        let found = near(&marked, 6, 1);
        let expected: Vec<usize> = vec![0, 1, 6, 7];
        assert_eq!((0..30).filter(|at| found[*at]).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn the_cornell_box_has_its_light_and_its_edges() {
        let scene = cornell_box();
        let (camera, side) = (&scene.cameras[0], 100);
        let regions = Regions::new(&scene, camera, (side, side), 4, 0);
        let at = |x: u32, y: u32| (y * side + x) as usize;
        let [all, edges, rest] = &regions.masks;
        // The light is in the upper middle, the floor's middle is plain.
        assert!((10..20).any(|y| !all[at(50, y)]), "no light");
        assert!(rest[at(30, 95)] && !edges[at(30, 95)]);
        // The left wall meets the back wall in a vertical line left of the middle.
        let crossings = (5..40).filter(|x| edges[at(*x, 30)]).count();
        assert!((2..=4).contains(&crossings), "{crossings} pixels of edge");
        assert!(all.iter().zip(edges).zip(rest).all(|((all, e), r)| *all == (e ^ r)));
        let light = all.iter().filter(|counted| !**counted).count();
        let without = Regions::new(&scene, camera, (side, side), 4, 0).beside_no_emitter(side);
        let left_out = without.masks[0].iter().filter(|counted| !**counted).count();
        assert!(left_out > light + 40 && left_out < 3 * light, "{light} {left_out}");
        let wider = Regions::new(&scene, camera, (side, side), 4, 2);
        assert!(wider.edge_share() > 2.0 * regions.edge_share());
    }
}
