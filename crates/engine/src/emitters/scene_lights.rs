//! All that lights a scene, for methods that trace paths: emissive triangles, the sky, the sun, and
//! lights without extent. Each is sampled by itself, and what a path meets by chance is weighed
//! against that.

use super::direct_lights::DirectLights;
use super::openings::{Lookout, Openings, sample_sky, sky_pdf};
use super::punctual::{PunctualLights, PunctualSample};
use super::sky::SkyLight;
use super::sun::SunLight;
use super::triangles::{LightSample, TriangleLights};
use crate::radiometry::Rgb;
use crate::random::Numbers;
use crate::surface::{Surface, World};
use glam::Vec3;
use std::sync::Arc;

/// The lights of a scene and its surroundings.
pub struct SceneLights {
    /// What emits.
    pub triangles: Option<TriangleLights>,
    sky: Option<SkyLight>,
    sun: Option<SunLight>,
    punctual: Option<PunctualLights>,
    /// Through which dark places see the sky, if there are any.
    openings: Option<Arc<Openings>>,
    /// Length of rays to what is infinitely far away, ray units.
    beyond: f32,
}

impl SceneLights {
    /// The lights of a world; `None` where nothing shines, and nothing shows itself without light.
    pub fn new(world: &World) -> Option<Self> {
        Self::with(world, || Openings::find(world).map(Arc::new))
    }

    /// The same, with the openings that other lights know of.
    pub fn beside(world: &World, lights: &DirectLights) -> Option<Self> {
        Self::with(world, || lights.openings())
    }

    fn with(world: &World, openings: impl FnOnce() -> Option<Arc<Openings>>) -> Option<Self> {
        let sky = SkyLight::new(&world.environment);
        let this = Self {
            triangles: TriangleLights::new(world),
            openings: sky.as_ref().and_then(|_| openings()),
            sky,
            sun: SunLight::new(&world.environment),
            punctual: PunctualLights::new(&world.scene, &world.environment, &world.rays),
            beyond: world.rays.beyond(),
        };
        let any = this.triangles.is_some() || this.has_others();
        (any || world.scene.has_unlit()).then_some(this)
    }

    /// Whether anything but emissive triangles shines.
    pub fn has_others(&self) -> bool {
        self.sky.is_some() || self.sun.is_some() || self.punctual.is_some()
    }

    /// A direction to the sky, well suited to a surface.
    pub fn sample_sky(
        &self,
        surface: &Surface,
        [x, y]: [f32; 2],
        numbers: &mut Numbers,
    ) -> Option<LightSample> {
        let sky = self.sky.as_ref()?;
        let normal = surface.shading_normal;
        let lookout = self.lookout(surface.start(), normal);
        // Numbers are drawn only where they are needed, for scenes without openings to keep theirs.
        let pick = lookout.map_or(0.0, |_| numbers.uniform());
        let (direction, density) = sample_sky(sky, lookout.as_ref(), normal, Vec3::new(pick, x, y));
        let radiance = sky.radiance(direction);
        let sample =
            LightSample { end: self.far(surface, direction), direction, radiance, density };
        (density > 0.0 && is_above(surface, direction)).then_some(sample)
    }

    /// A direction to the sun.
    pub fn sample_sun(&self, surface: &Surface, xi: [f32; 2]) -> Option<LightSample> {
        let sun = self.sun.as_ref()?;
        let direction = sun.sample(xi);
        let density = sun.pdf();
        // A sun without extent has an irradiance only.
        let radiance = if density.is_finite() { sun.radiance() } else { sun.irradiance() };
        let sample =
            LightSample { end: self.far(surface, direction), direction, radiance, density };
        is_above(surface, direction).then_some(sample)
    }

    /// One of the lights without extent: its `radiance` is the irradiance of a plane that faces it
    /// over the probability of the pick, its density infinite; of a soft one, a direction to it.
    pub fn sample_punctual(&self, surface: &Surface, numbers: &mut Numbers) -> Option<LightSample> {
        let mut xi = Vec3::new(numbers.uniform(), 0.0, 0.0);
        let lights = self.punctual.as_ref()?;
        if lights.are_soft() {
            (xi.y, xi.z) = (numbers.uniform(), numbers.uniform());
        }
        let picked = lights.pick(surface.start(), surface.shading_normal, xi, |_| 1.0);
        let (light, probability) = picked?;
        let sample = LightSample {
            end: light.end,
            direction: light.direction,
            radiance: light.irradiance / probability,
            density: f32::INFINITY,
        };
        is_above(surface, light.direction).then_some(sample)
    }

    /// A direction to the sun, by two uniform numbers, and its irradiance on a plane that faces it.
    pub fn sun_ray(&self, xi: [f32; 2]) -> Option<(Vec3, Rgb)> {
        self.sun.as_ref().map(|sun| (sun.sample(xi), sun.irradiance()))
    }

    /// Number of lights without extent.
    pub fn punctual_count(&self) -> usize {
        self.punctual.as_ref().map_or(0, PunctualLights::count)
    }

    /// The light of one of those at a point, by two uniform numbers where it is soft; `None` where it
    /// does not shine.
    pub fn punctual_at(&self, number: usize, point: Vec3, xi: [f32; 2]) -> Option<PunctualSample> {
        self.punctual.as_ref()?.nth(number, point, xi)
    }

    /// Whether the sun shines.
    pub fn has_sun(&self) -> bool {
        self.sun.is_some()
    }

    /// Where a surface sees the sky through openings.
    fn lookout(&self, point: Vec3, normal: Vec3) -> Option<Lookout> {
        self.openings.as_ref()?.seen_from(point, normal)
    }

    fn far(&self, surface: &Surface, direction: Vec3) -> Vec3 {
        surface.start() + direction * self.beyond
    }

    /// Radiance from infinitely far away along a unit `direction`, from sky and sun, each with the
    /// density per solid angle at which it is sampled for a surface, if it is `from` one: its place
    /// and unit normal.
    pub fn escaping(&self, from: Option<(Vec3, Vec3)>, direction: Vec3) -> [(Rgb, f32); 2] {
        let sky = self.sky.as_ref().map_or((Rgb::ZERO, 0.0), |sky| {
            let density = from.map_or(0.0, |(point, normal)| {
                sky_pdf(sky, self.lookout(point, normal).as_ref(), normal, direction)
            });
            (sky.radiance(direction), density)
        });
        let sun = self.sun.as_ref().filter(|sun| sun.covers(direction));
        let sun = sun.map_or((Rgb::ZERO, 0.0), |sun| (sun.radiance(), sun.pdf()));
        [sky, sun]
    }

    /// Density per solid angle at which the place of an emitter is sampled that a ray along the unit
    /// `direction` met at `distance`.
    pub fn density(&self, light: &Surface, direction: Vec3, distance: f32) -> f32 {
        let lights = self.triangles.as_ref();
        lights.map_or(0.0, |lights| lights.density(light, direction, distance))
    }
}

/// Whether a direction is above the horizons of both normals.
fn is_above(surface: &Surface, direction: Vec3) -> bool {
    surface.normal.dot(direction) > 0.0 && surface.shading_normal.dot(direction) > 0.0
}
