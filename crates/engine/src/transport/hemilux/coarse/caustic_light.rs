//! Caustics of tier 1: where clear bodies or mirrors of metal are in a scene, light rays carry what
//! emitters, the sun and points send by way of them into a map on the diffuse surfaces
//! ([`crate::transport::caustics`]). The camera and the ends of rays read the map; elements have the
//! mean of what landed on them. All other rays of the method leave that light out.

use super::elements::ElementIndex;
use super::mesh::CoarseMesh;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::SceneLights;
use crate::patches::FacetPlace;
use crate::radiometry::{Rgb, importance};
use crate::scene::{Material, PunctualLight};
use crate::surface::{Surface, World};
use crate::transport::caustics::{Casters, Lit, Maker, Map, PowerDeposit};

/// What a material must mirror for its caustics to be worth a map.
const LEAST_MIRRORED: f32 = 0.3;
/// Cells of the map.
const CELLS: u64 = 1 << 19;
/// Light rays of an iteration.
const RAYS: u64 = 1 << 18;
/// The same where the first picture had better come soon than be good.
const HASTY_RAYS: u64 = RAYS / 4;
/// Most triangles of a scene whose caustics are mapped: each takes memory.
pub const MOST_TRIANGLES: usize = 100_000;

/// The caustics of a scene.
pub struct CausticLight {
    lights: SceneLights,
    maker: Maker,
    /// Σ over the showers of the power that landed on each element, W.
    power: Vec<Rgb>,
}

impl CausticLight {
    /// Nothing yet of the caustics of a scene of so many elements; `None` where nothing in it
    /// makes caustics worth a map.
    pub fn new(world: &World, elements: usize, seed: u64, hasty: bool) -> Option<Self> {
        if !is_mapped(world) || !is_cast(world) {
            return None;
        }
        let lights = SceneLights::new(world)?;
        let lit = Lit { world, lights: &lights };
        let casters = Casters::new(world).filter(|_| lit.casts())?;
        let rays = if hasty { HASTY_RAYS } else { RAYS };
        let maker = Maker::new(lit, casters, rays, CELLS, seed);
        Some(Self { maker, lights, power: vec![Rgb::ZERO; elements] })
    }

    /// Shoots another shower.
    pub fn advance(&mut self, world: &World, mesh: &CoarseMesh) {
        let deposits = self.maker.shower(Lit { world, lights: &self.lights });
        for PowerDeposit { triangle, back, at: [u, v], power } in deposits {
            let Some((facet, at)) = mesh.cut.place_on_triangle(triangle, u, v) else { continue };
            if let Some(element) = mesh.element_on(FacetPlace { facet, back, at }) {
                let part = mesh.elements.part_at(world, element, || {
                    let surface = world.at(triangle, [u, v], back);
                    (surface.start(), surface.normal)
                });
                self.power[part.at()] += power;
            }
        }
    }

    /// Mean irradiance of an element.
    pub fn of_element(&self, mesh: &CoarseMesh, element: ElementIndex) -> Rgb {
        let showers = self.maker.map.showers().max(1) as f32;
        self.power[element.at()] / (mesh.elements.own_area(element).max(1e-30) * showers)
    }

    /// Irradiance at a point of a surface.
    pub fn irradiance(&self, surface: &Surface) -> Rgb {
        self.map().at(surface.triangle, surface.back, surface.at).irradiance
    }

    /// The map.
    pub fn map(&self) -> &Map {
        &self.maker.map
    }

    /// Light rays so far.
    pub fn rays(&self) -> u64 {
        self.maker.rays
    }

    /// Writes it.
    pub fn save(&self, to: &mut Writer) {
        to.slice(&self.power);
        self.maker.save(to);
    }

    /// Takes what [`CausticLight::save`] wrote of the same elements.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.power = from.exactly(self.power.len())?;
        self.maker.restore(from, false)
    }
}

/// Whether caustics of a scene are mapped, if there is light that makes some: something in it is clear
/// or a mirror of metal, and it is not too large.
fn is_mapped(world: &World) -> bool {
    let casts = world.has_clear() || has_mirrors(world);
    casts && world.scene.triangle_count() <= MOST_TRIANGLES
}

/// Whether anything mirrors most of the light sharply.
pub fn has_mirrors(world: &World) -> bool {
    let is_mirror = |material: &Material| {
        let whole = material.reflectance(&material.typical(material.base_color));
        whole.is_sharp() && importance(whole.specular) > LEAST_MIRRORED
    };
    let materials = world.scene.materials.iter().zip(world.scene.used_materials());
    materials.filter(|(_, used)| *used).any(|(material, _)| is_mirror(material))
}

/// Whether light shines that maps have: of emitters, the sun or points.
pub fn is_cast(world: &World) -> bool {
    let scene = &world.scene;
    world.environment.sun.is_some()
        || scene.emissive_triangles() > 0
        || scene.lights.iter().any(PunctualLight::shines)
}

#[cfg(test)]
mod tests {
    use crate::radiometry::Rgb;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::{SEED, Specimen};

    /// What elements hold together is what landed, and where the map has light there is some.
    #[test]
    fn elements_have_what_is_in_the_map() {
        assert!(Specimen::furnace().coarse.caustics().is_none());
        let mut specimen = Specimen::new(&made::glass(), 2000);
        for _ in 0..3 {
            specimen.coarse.shed_caustics();
            specimen.coarse.link(SEED, 0, 4);
        }
        let coarse = &specimen.coarse;
        let caustics = coarse.caustics().expect("there is glass");
        let elements = &coarse.mesh.elements;
        let own = |element| caustics.of_element(&coarse.mesh, element) * elements.own_area(element);
        let held: Rgb = elements.all().map(own).sum();
        let flux = caustics.map().flux().mapped;
        assert!(flux.x > 0.0);
        assert!((f64::from(held.x) / flux.x - 1.0).abs() < 0.01, "{held} {flux}");
    }
}
