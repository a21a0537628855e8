//! All that lights a scene directly, for methods that know light without occlusion: polygons in
//! closed form, the sky, the sun, and lights without extent. A shadow ray goes to one of these
//! groups, picked in proportion to what each shines on the surface.

use super::all_unoccluded::{AllUnoccluded, GROUPS};
use super::glow::{FEW_LIGHTS, Glow};
use super::openings::{Lookout, Openings, sample_sky, sample_sky_of_two, sky_pdf};
use super::polygons::{LightPoint, PolygonLights, ShadowSample};
use super::punctual::PunctualLights;
use super::sky::SkyLight;
use super::sun::SunLight;
use super::unoccluded::{LobeAxis, Unoccluded};
use crate::radiometry::{Rgb, importance};
use crate::rays::Hit;
use crate::surface::{Surface, World};
use glam::Vec3;
use std::f64::consts::PI;
use std::sync::Arc;

/// Lower bound of the share that a lobe is taken to reflect of a light in one direction, so that
/// none is left out.
const LEAST_LOBE_SHARE: f32 = 0.02;

/// A lobe of exponent n, which fills about 2π/(n + 1) sr, is sampled by directions to the sky with a
/// probability of this over n + 1 at most: skies are seldom as narrow as .3 sr in brightness, and
/// then a sample of theirs says little that the lobe's own do not.
const SKY_SOLID_ANGLE: f32 = 20.0;

/// The lights of a scene and its surroundings.
pub struct DirectLights {
    polygons: Option<PolygonLights>,
    /// What shines and is none of the lights, if anything is.
    glow: Option<Glow>,
    sky: Option<SkyLight>,
    pub(super) sun: Option<SunLight>,
    pub(super) punctual: Option<PunctualLights>,
    /// Through which dark places see the sky, if there are any.
    openings: Option<Arc<Openings>>,
    /// Length of rays to what is infinitely far away, ray units.
    beyond: f32,
}

impl DirectLights {
    /// All lights of a world; `None` where nothing shines, and nothing shows itself without light.
    pub fn new(world: &World) -> Option<Self> {
        let (scene, rays) = (&world.scene, &world.rays);
        let cells = PolygonLights::cells(world);
        let polygons = PolygonLights::new(scene, rays, cells.clone(), None);
        let mut this = Self::beside(world, polygons);
        if this.polygons.as_ref().is_some_and(|lights| lights.count() > FEW_LIGHTS) {
            let everywhere = this.surroundings();
            let open = |point, normal| this.lookout(point, normal).is_none();
            let there = |point, normal| if open(point, normal) { everywhere } else { 0.0 };
            this.glow = Glow::find(world, &cells, there);
            if let Some(glow) = &this.glow {
                this.polygons = PolygonLights::new(scene, rays, cells, Some(glow));
            }
        }
        this.unless_dark(world)
    }

    /// The lights of a world that no surface of it emits: the sky, the sun, and lights without
    /// extent; `None` where there are none.
    pub fn without_surfaces(world: &World) -> Option<Self> {
        Self::beside(world, None).unless_dark(world)
    }

    /// Those polygons, and all that shines beside surfaces.
    fn beside(world: &World, polygons: Option<PolygonLights>) -> Self {
        let (scene, rays) = (&world.scene, &world.rays);
        let sky = SkyLight::new(&world.environment);
        Self {
            polygons,
            glow: None,
            openings: sky.as_ref().and_then(|_| Openings::find(world)).map(Arc::new),
            sky,
            sun: SunLight::new(&world.environment),
            punctual: PunctualLights::new(scene, &world.environment, rays),
            beyond: rays.beyond(),
        }
    }

    fn unless_dark(self, world: &World) -> Option<Self> {
        let any = self.polygons.is_some() || self.glow.is_some();
        let any = any || self.surrounds() || self.punctual.is_some();
        (any || world.scene.has_unlit()).then_some(self)
    }

    /// Mean radiance that arrives from sky and sun where nothing is in between.
    fn surroundings(&self) -> f64 {
        let irradiance = |normal: Vec3| {
            let sky = self.sky.as_ref().map_or(Rgb::ZERO, |sky| sky.unoccluded(normal));
            sky + self.sun.as_ref().map_or(Rgb::ZERO, |sun| sun.unoccluded(normal))
        };
        let sides = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| irradiance(axis) + irradiance(-axis));
        f64::from(importance(sides.iter().sum::<Rgb>())) / (6.0 * PI)
    }

    /// Whether anything shines that is none of the lights.
    pub fn has_glow(&self) -> bool {
        self.glow.is_some()
    }

    /// Radiance that a surface emits without being one of the lights: what finds reflected light
    /// finds it, too.
    pub fn glow(&self, world: &World, surface: &Surface) -> Rgb {
        self.glow.as_ref().map_or(Rgb::ZERO, |glow| glow.of(&world.scene, surface))
    }

    /// The same, to whom no opening is known.
    #[cfg(test)]
    pub fn without_openings(self) -> Self {
        Self { openings: None, ..self }
    }

    /// Where the sky is seen through openings, if it is.
    pub fn openings(&self) -> Option<Arc<Openings>> {
        self.openings.clone()
    }

    /// Whether light comes from infinitely far away.
    fn surrounds(&self) -> bool {
        self.sky.is_some() || self.sun.is_some()
    }

    /// Whether there is a sky that shines.
    pub fn has_sky(&self) -> bool {
        self.sky.is_some()
    }

    /// A unit direction of the sky, about in proportion to what it gives to a surface of that unit
    /// normal, for two uniform numbers; `None` without a sky.
    pub fn sky_direction(&self, normal: Vec3, xi: [f32; 2]) -> Option<Vec3> {
        let (direction, density) = self.sky.as_ref()?.sample(normal, xi);
        (density > 0.0).then_some(direction)
    }

    /// Radiance of the sky from a unit direction, and the density, 1/sr, at which
    /// [`DirectLights::sky_direction`] picks it.
    pub fn sky(&self, normal: Vec3, direction: Vec3) -> (Rgb, f32) {
        let Some(sky) = &self.sky else { return (Rgb::ZERO, 0.0) };
        (sky.radiance(direction), sky.pdf(normal, direction))
    }

    /// Whether there are but polygons: then each step is theirs alone.
    fn has_only_polygons(&self) -> bool {
        !self.surrounds() && self.punctual.is_none()
    }

    /// Number of lights.
    pub fn count(&self) -> usize {
        self.polygons.as_ref().map_or(0, PolygonLights::count)
            + self.punctual.as_ref().map_or(0, PunctualLights::count)
            + usize::from(self.sky.is_some())
            + usize::from(self.sun.is_some())
    }

    /// Whether the light without occlusion is known exactly.
    pub fn is_exact(&self) -> bool {
        self.polygons.as_ref().is_none_or(PolygonLights::is_exact)
    }

    /// What all lights shine on a surface at `point` with unit `normal` without occlusion; without
    /// the polygons where those are too many for the closed form.
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> AllUnoccluded {
        let polygons = self.polygons.as_ref();
        let polygons =
            polygons.map_or_else(Unoccluded::none, |lights| lights.unoccluded(point, normal));
        let mut all = AllUnoccluded {
            irradiance: polygons.irradiance,
            polygons,
            shares: [1.0, 0.0, 0.0, 0.0],
            lobe: None,
            lookout: self.lookout(point, normal),
            sky: Rgb::ZERO,
            sun: Rgb::ZERO,
        };
        if self.has_only_polygons() {
            return all;
        }
        let others = [
            self.sky.as_ref().map_or(Rgb::ZERO, |sky| sky.unoccluded(normal)),
            self.sun.as_ref().map_or(Rgb::ZERO, |sun| sun.unoccluded(normal)),
            self.punctual.as_ref().map_or(Rgb::ZERO, |lights| lights.unoccluded(point, normal)),
        ];
        let known = if all.looks_out() { &others[1..] } else { &others };
        all.irradiance += known.iter().sum::<Rgb>();
        (all.sky, all.sun) = (others[0], others[1]);
        let [sky, sun, punctual] = others.map(importance);
        all.shares = self.shares([importance(polygons.irradiance), sky, sun, punctual]);
        all.give_half_to_sky();
        all
    }

    /// Where a surface sees the sky through openings.
    fn lookout(&self, point: Vec3, normal: Vec3) -> Option<Lookout> {
        self.openings.as_ref()?.seen_from(point, normal)
    }

    /// The same for a lobe: only to pick lights by, without an irradiance.
    pub fn for_lobe(&self, point: Vec3, normal: Vec3, axis: LobeAxis) -> AllUnoccluded {
        let polygons = self.polygons.as_ref();
        let polygons =
            polygons.map_or_else(Unoccluded::none, |lights| lights.for_lobe(point, normal, axis));
        let mut all = AllUnoccluded {
            irradiance: Rgb::ZERO,
            polygons,
            shares: [1.0, 0.0, 0.0, 0.0],
            lobe: Some(axis),
            lookout: self.lookout(point, normal),
            sky: Rgb::ZERO,
            sun: Rgb::ZERO,
        };
        if self.has_only_polygons() {
            return all;
        }
        let sun = self.sun.as_ref().map_or(0.0, |sun| {
            importance(sun.unoccluded(normal)) * lobe_share(axis, sun.direction())
        });
        let sky = self.sky.as_ref().map_or(0.0, |sky| importance(sky.unoccluded(normal)));
        let punctual = self.punctual.as_ref().map_or(0.0, |lights| {
            lights.worth(point, normal, |direction| lobe_share(axis, direction))
        });
        all.shares = self.shares([polygons.importance(), sky, sun, punctual]);
        all.give_half_to_sky();
        // A sharp lobe finds the sky by itself.
        all.shares[1] *= (SKY_SOLID_ANGLE * (axis.exponent + 1.0).recip()).min(1.0);
        all
    }

    /// Probabilities in proportion to what each group shines; polygons of which that is unknown get
    /// half.
    fn shares(&self, mut worth: [f32; GROUPS]) -> [f32; GROUPS] {
        let others: f32 = worth[1..].iter().sum();
        if !self.is_exact() {
            worth[0] = if others > 0.0 { others } else { 1.0 };
        }
        let total = worth[0] + others;
        if total > 0.0 { worth.map(|own| own / total) } else { [1.0, 0.0, 0.0, 0.0] }
    }

    /// Samples a point of the lights for a surface at `point`, by three uniform numbers. `None`
    /// where it shines nothing on the surface.
    pub fn sample(
        &self,
        all: &AllUnoccluded,
        point: Vec3,
        normal: Vec3,
        xi: Vec3,
    ) -> Option<LightPoint> {
        if self.has_only_polygons() {
            return self.polygons.as_ref()?.sample(&all.polygons, point, normal, xi);
        }
        let (group, x) = all.group(xi.x)?;
        let share = all.shares[group];
        let light = match group {
            0 => {
                let xi = Vec3::new(x, xi.y, xi.z);
                self.polygons.as_ref()?.sample(&all.polygons, point, normal, xi)?
            }
            1 => {
                let sky = self.sky.as_ref()?;
                let xi = Vec3::new(x, xi.y, xi.z);
                let (direction, density) = sample_sky(sky, all.lookout.as_ref(), normal, xi);
                let light = self.far(sky.radiance(direction), point, (normal, direction), density);
                LightPoint { is_apart: all.looks_out(), ..light? }
            }
            2 => {
                let sun = self.sun.as_ref()?;
                let direction = sun.sample([xi.y, xi.z]);
                let cosine = normal.dot(direction);
                let light = LightPoint {
                    end: point + direction * self.beyond,
                    irradiance: sun.irradiance() * cosine,
                    density: sun.pdf(),
                    is_apart: false,
                    is_sky: false,
                    narrow: Some(0),
                };
                (cosine > 0.0).then_some(light)?
            }
            _ => {
                let weight = |direction| all.lobe.map_or(1.0, |axis| lobe_share(axis, direction));
                let xi = Vec3::new(x, xi.y, xi.z);
                let (light, probability) =
                    self.punctual.as_ref()?.pick(point, normal, xi, weight)?;
                // A part of a soft light may be below the horizon.
                let cosine = normal.dot(light.direction).max(0.0);
                let irradiance = light.irradiance * cosine / probability;
                LightPoint {
                    end: light.end,
                    irradiance,
                    density: f32::INFINITY,
                    is_apart: false,
                    is_sky: false,
                    narrow: self.number_of_point(light.number),
                }
            }
        };
        Some(LightPoint {
            irradiance: light.irradiance / share,
            density: light.density * share,
            ..light
        })
    }

    /// The same where the sky is seen through openings, by two of its points, of which one is picked by what
    /// they shine; `pick` is uniform. Its density is none to weigh other ways to find the point by.
    pub fn sample_of_two(
        &self,
        all: &AllUnoccluded,
        (point, normal): (Vec3, Vec3),
        (xi, pick): ([Vec3; 2], f32),
    ) -> Option<LightPoint> {
        let (group, x) = all.group(xi[0].x)?;
        let lookout = all.lookout.as_ref().filter(|lookout| lookout.has_panes() && group == 1);
        let (Some(sky), Some(lookout)) = (&self.sky, lookout) else {
            return self.sample(all, point, normal, xi[0]);
        };
        let xi = [Vec3 { x, ..xi[0] }, xi[1]];
        let (direction, density) = sample_sky_of_two(sky, lookout, normal, (xi, pick));
        let density = density * all.shares[group];
        let light = self.far(sky.radiance(direction), point, (normal, direction), density);
        Some(LightPoint { is_apart: true, ..light? })
    }

    /// Numbers for the n-th of few samples of one place by [`DirectLights::sample_by_shadow_ray`]: where a sky is
    /// seen through openings, that and all other lights take turns. Whether any other light is seen at all is
    /// not left to chance then: of two samples by plain numbers both may be the sky's, and what lamps shine
    /// would count as blocked.
    pub fn in_turn(&self, xi: Vec3, n: u32) -> Vec3 {
        if self.openings.is_none() {
            return xi;
        }
        let stratum = [0.0, 2.0, 1.0, 3.0][n as usize % 4];
        Vec3 { x: 0.25 * (xi.x + stratum), ..xi }
    }

    /// A point of the sky.
    fn far(
        &self,
        radiance: Rgb,
        point: Vec3,
        (normal, direction): (Vec3, Vec3),
        density: f32,
    ) -> Option<LightPoint> {
        let cosine = normal.dot(direction);
        (cosine > 0.0 && density > 0.0).then(|| LightPoint {
            end: point + direction * self.beyond,
            irradiance: radiance * (cosine / density),
            density,
            is_apart: false,
            is_sky: true,
            narrow: None,
        })
    }

    /// Samples one of many lights: returns where a shadow ray to it ends, and its irradiance over
    /// the probability of the pick. `None` where it shines nothing.
    pub fn one_of_many(&self, point: Vec3, normal: Vec3, xi: Vec3) -> Option<(Vec3, Rgb)> {
        let polygons = self.polygons.as_ref();
        if self.has_only_polygons() {
            return polygons?.one_of_many(point, normal, xi);
        }
        let all = self.unoccluded(point, normal);
        let (group, x) = all.group(xi.x)?;
        if group > 0 {
            let light = self.sample(&all, point, normal, xi)?;
            return Some((light.end, light.irradiance));
        }
        let (end, irradiance) = polygons?.one_of_many(point, normal, Vec3::new(x, xi.y, xi.z))?;
        Some((end, irradiance / all.shares[0]))
    }

    /// Samples the direct light on a surface by one shadow ray.
    pub fn sample_by_shadow_ray(
        &self,
        world: &World,
        point: Vec3,
        normal: Vec3,
        xi: Vec3,
    ) -> ShadowSample {
        if !self.is_exact() {
            let Some((end, irradiance)) = self.one_of_many(point, normal, xi) else {
                return ShadowSample::default();
            };
            let visibility = world.visibility(point, end);
            let (unoccluded, cast, apart) = (irradiance, irradiance, Rgb::ZERO);
            let direction = (end - point).normalize_or_zero();
            let own = ShadowSample::default();
            return ShadowSample { unoccluded, cast, visibility, apart, direction, ..own };
        }
        let all = self.unoccluded(point, normal);
        // Lamps and a sun in a room full of sky have no share of all light in common.
        let is_all_apart = all.looks_out() && all.is_split();
        let unoccluded = if is_all_apart { Rgb::ZERO } else { all.irradiance };
        let mut sample = ShadowSample { unoccluded, ..ShadowSample::default() };
        let any = all.irradiance != Rgb::ZERO || all.looks_out();
        if let Some(light) = any.then(|| self.sample(&all, point, normal, xi)).flatten() {
            let visibility = world.visibility(point, light.end);
            sample.direction = (light.end - point).normalize_or_zero();
            (sample.density, sample.is_narrow) = (light.density, light.narrow.is_some());
            match light.is_apart || is_all_apart {
                true => sample.apart = light.irradiance * visibility,
                false => (sample.cast, sample.visibility) = (light.irradiance, visibility),
            }
        }
        sample
    }

    /// Density per solid angle at which [`DirectLights::sample`] picks the place of a light that a
    /// ray along the unit `direction` from the surface met; `normal` is the light's there.
    pub fn density(
        &self,
        all: &AllUnoccluded,
        start: (Vec3, Vec3),
        hit: &Hit,
        normal: Vec3,
        direction: Vec3,
    ) -> f32 {
        let Some(polygons) = &self.polygons else { return 0.0 };
        all.shares[0] * polygons.density(&all.polygons, start, hit, normal, direction)
    }

    /// Radiance from infinitely far away along the unit `direction`, sky and sun each with the
    /// density per solid angle at which [`DirectLights::sample`] picks it for a surface with that
    /// unit `normal`.
    pub fn escaping(&self, all: &AllUnoccluded, normal: Vec3, direction: Vec3) -> [(Rgb, f32); 2] {
        let sky = self.sky.as_ref().map_or((Rgb::ZERO, 0.0), |sky| {
            let density = match all.shares[1] > 0.0 {
                true => all.shares[1] * sky_pdf(sky, all.lookout.as_ref(), normal, direction),
                false => 0.0,
            };
            (sky.radiance(direction), density)
        });
        let sun = self.sun.as_ref().filter(|sun| sun.covers(direction));
        let sun = sun.map_or((Rgb::ZERO, 0.0), |sun| (sun.radiance(), all.shares[2] * sun.pdf()));
        [sky, sun]
    }
}

/// What a lobe is taken to reflect of a narrow light from a direction, of what it reflects at most.
fn lobe_share(axis: LobeAxis, direction: Vec3) -> f32 {
    let cosine = axis.direction.dot(direction).clamp(0.0, 1.0);
    cosine.powf(axis.of_narrow).max(LEAST_LOBE_SHARE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::{Environment, LightKind, PunctualLight, Sky, Sun, made};
    use std::sync::Arc;

    /// The Cornell box, whose ceiling lamp has a sky, a sun and a bulb for company.
    fn world() -> World {
        let glb = made::cornell();
        let mut scene = import(&glb, &Resources::default(), &ImportLimits::default()).unwrap();
        scene.lights.push(PunctualLight {
            name: "bulb".into(),
            kind: LightKind::Point,
            position: Vec3::new(0.1, 0.9, 0.2),
            direction: -Vec3::Y,
            intensity: Rgb::new(1.0, 2.0, 3.0),
            range: None,
        });
        let environment = Environment {
            sky: Sky::Uniform(Rgb::new(2.0, 1.0, 0.5)),
            sun: Some(Sun {
                direction: Vec3::new(0.2, 0.9, 0.3).normalize(),
                irradiance: Rgb::splat(4.0),
                angular_radius: 0.1,
            }),
            light_radius: 0.2,
        };
        World::surrounded(Arc::new(scene), Arc::new(environment))
    }

    /// The mean of what sampled points stand for is the irradiance without occlusion.
    #[test]
    fn samples_add_up_to_what_is_known() {
        let world = world();
        // In the box the sky is hardly seen, and then apart.
        let lights = DirectLights::new(&world).expect("there is light").without_openings();
        assert!(lights.is_exact() && lights.count() >= 4);
        let mut numbers = Numbers::new(3, Stream::Light, 0);
        for normal in [Vec3::Y, Vec3::new(0.6, 0.0, 0.8)] {
            let point = world.rays.place(Vec3::new(0.3, 0.4, 0.5));
            let all = lights.unoccluded(point, normal);
            const SAMPLES: u32 = 60_000;
            let mut sum = Rgb::ZERO;
            for _ in 0..SAMPLES {
                let xi = Vec3::new(numbers.uniform(), numbers.uniform(), numbers.uniform());
                let light = lights.sample(&all, point, normal, xi);
                sum += light.map_or(Rgb::ZERO, |light| light.irradiance);
            }
            let off = (sum / SAMPLES as f32 / all.irradiance - Rgb::ONE).abs().max_element();
            assert!(off < 0.02, "{normal}: {} {}", sum / SAMPLES as f32, all.irradiance);
        }
    }

    /// Lobes find the same light by the lights' samples as by directions all around, weighed
    /// against each other.
    #[test]
    fn densities_of_what_escapes_are_those_of_samples() {
        let world = world();
        let lights = DirectLights::new(&world).expect("there is light");
        let (point, normal) = (world.rays.place(Vec3::new(0.3, 0.4, 0.5)), Vec3::Y);
        let axis = LobeAxis { direction: Vec3::new(0.0, 0.8, 0.6), exponent: 5.0, of_narrow: 5.0 };
        let all = lights.for_lobe(point, normal, axis);
        let mut numbers = Numbers::new(4, Stream::Light, 0);
        // The densities' integral over all directions, of which an opening may have some below the
        // horizon, is the probability of either group.
        const SAMPLES: u32 = 200_000;
        let mut sums = [0.0f64; 2];
        for _ in 0..SAMPLES {
            let xi = [numbers.uniform(), numbers.uniform()];
            let height = 2.0 * xi[0] - 1.0;
            let (sin, cos) = (std::f32::consts::TAU * xi[1]).sin_cos();
            let across = (1.0 - height * height).sqrt();
            let direction = Vec3::new(across * cos, height, across * sin);
            for (sum, (_, density)) in sums.iter_mut().zip(lights.escaping(&all, normal, direction))
            {
                *sum += f64::from(density) * 2.0 * std::f64::consts::TAU / f64::from(SAMPLES);
            }
        }
        for (group, sum) in sums.into_iter().enumerate() {
            let share = f64::from(all.shares[1 + group]);
            assert!((sum / share - 1.0).abs() < 0.05, "group {group}: {sum} {share}");
        }
    }
}
