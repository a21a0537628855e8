//! What hits of rays reflect, by the coarse solution: by the mesh alone, or with light found out afresh.

use super::guide::{Met, aims_of, balanced};
use super::solution::CoarseSolution;
use crate::emitters::ShadowSample;
use crate::patches::FacetPlace;
use crate::radiometry::Rgb;
use crate::rays::{Eye, Hit};
use crate::sampling::{Afresh, Next, cosine_direction};
use crate::surface::{Passage, Reflection, Surface, mirrored_share};
use glam::Vec3;
use std::f32::consts::PI;

/// Share of the near field's further rays that are aimed at bright patches, where there are such.
const AIMED_BOUNCES: f32 = 0.3;

/// What a hit reflects, found out afresh.
#[derive(Clone, Copy, Default)]
pub struct FoundAfresh {
    /// Radiance.
    pub radiance: Rgb,
    /// Where the mesh tells what arrives; `None` so near to where the ray started that the mesh is too
    /// coarse, where light comes through from the other side, and where nothing is reflected diffusely.
    pub told_at: Option<FacetPlace>,
    /// Where it is, if it is so near that one more ray found what has bounced.
    pub near_at: Option<FacetPlace>,
    /// The shadow ray by which the emitters' light was found; `None` where nothing is reflected diffusely.
    pub by_shadow_ray: Option<ShadowSample>,
    /// What of the radiance is of narrow lights by way of polished surfaces, which paths hardly find.
    pub mirrored: Rgb,
}

impl CoarseSolution {
    /// Radiance that a hit on a surface reflects, as if all of it were reflected diffusely by that albedo,
    /// and what comes through it diffusely from its other side. With random numbers the light there is
    /// found out afresh: the emitters' by a shadow ray and, where the patch is so near that its mean
    /// will not do, what has bounced by one more.
    pub fn by_albedo(
        &self,
        surface: &Surface,
        albedo: Rgb,
        hit: &Hit,
        afresh: Option<Afresh>,
    ) -> Rgb {
        let Some(afresh) = afresh else { return self.by_mesh(surface, albedo, hit) };
        self.found_afresh(surface, albedo, hit, afresh).radiance
    }

    /// The same by the mesh alone.
    fn by_mesh(&self, surface: &Surface, albedo: Rgb, hit: &Hit) -> Rgb {
        let of_side = |albedo: Rgb, hit: &Hit| {
            let place = self.mesh.place_of(hit).filter(|_| albedo != Rgb::ZERO);
            place.map_or(Rgb::ZERO, |place| albedo * self.mesh.value(&self.total, place) / PI)
        };
        let own = of_side(albedo, hit);
        if !self.world.is_translucent(surface.triangle) {
            return own;
        }
        let (_, share) = self.world.far_side_on_the_mean(surface);
        own + of_side(share, &behind(hit))
    }

    /// The same found out afresh, beside what the mesh says.
    pub fn found_afresh(
        &self,
        surface: &Surface,
        albedo: Rgb,
        hit: &Hit,
        afresh: Afresh,
    ) -> FoundAfresh {
        let own = self.of_side(surface, albedo, hit, afresh);
        if !self.world.is_translucent(surface.triangle) {
            return own;
        }
        let (far, share) = self.world.far_side_on_the_mean(surface);
        let beyond = self.of_side(&far, share, &behind(hit), afresh);
        FoundAfresh { radiance: own.radiance + beyond.radiance, told_at: None, ..own }
    }

    /// Irradiance by the mesh alone.
    pub fn told(&self, place: FacetPlace) -> Rgb {
        self.mesh.value(&self.total, place)
    }

    /// Where the mesh tells what arrives at a hit; `None` so near to where the ray started that the mesh is
    /// too coarse.
    pub fn told_at(&self, hit: &Hit) -> Option<FacetPlace> {
        self.mesh.place_of(hit).filter(|place| !self.mesh.is_near(*place, hit.distance))
    }

    /// What a side of a surface with that albedo reflects.
    fn of_side(&self, surface: &Surface, albedo: Rgb, hit: &Hit, afresh: Afresh) -> FoundAfresh {
        let place = self.mesh.place_of(hit).filter(|_| albedo != Rgb::ZERO);
        let Some(place) = place else { return FoundAfresh::default() };
        let (start, normal) = (surface.start(), surface.shading_normal);
        let sample = self.lights.sample_by_shadow_ray(&self.world, start, normal, afresh.light);
        let direct = sample.irradiance(self.share(place));
        let next = afresh.next.filter(|_| self.mesh.is_near(place, hit.distance));
        let (bounced, told_at, near_at) = match next {
            Some(next) => (self.bounced_by_ray(surface, afresh.bounce, next), None, Some(place)),
            None => (self.mesh.value(&self.indirect, place), Some(place), None),
        };
        let caustics = self.caustics.as_ref();
        let by_caustics = caustics.map_or(Rgb::ZERO, |caustics| caustics.irradiance(surface));
        let radiance = albedo * (bounced + direct + by_caustics) / PI;
        let mirrored = Rgb::ZERO;
        FoundAfresh { radiance, told_at, near_at, by_shadow_ray: Some(sample), mirrored }
    }

    /// Irradiance that has bounced, by one ray: some of them are aimed at bright patches (balance
    /// heuristic, Veach 1997).
    fn bounced_by_ray(&self, surface: &Surface, xi: [f32; 2], next: Next) -> Rgb {
        let (start, normal) = (surface.start(), surface.shading_normal);
        let aimed_share = if self.guide.is_some() { AIMED_BOUNCES } else { 0.0 };
        let guide = self.guide.as_deref();
        let aim = match guide.filter(|_| next.number() < aimed_share) {
            // Other numbers than those that light is found by behind it.
            Some(guide) => match guide.aim(start, normal, next.after().afresh().light) {
                Some(aim) => Some(aim),
                None => return Rgb::ZERO,
            },
            None => None,
        };
        let direction =
            aim.as_ref().map_or_else(|| cosine_direction(normal, xi), |aim| aim.direction);
        if normal != surface.normal && surface.normal.dot(direction) <= 0.0 {
            return Rgb::ZERO;
        }
        let Some(hit) = self.world.rays.closest(Eye::Light, start, direction) else {
            return Rgb::ZERO;
        };
        let aim = aim.map(|aim| aim.patch);
        let straight = aim.is_some_and(|aim| self.mesh.patch_at(&hit) != Some(aim));
        let Some(passage) = self.world.reach(hit, direction, straight) else {
            return Rgb::ZERO;
        };
        let mut weight = 1.0;
        if let Some(guide) = guide {
            let aims = aims_of(&self.world, &self.mesh, (&hit, direction), &passage);
            let density = |met: &Met| guide.density(start, normal, met);
            let shares = [1.0 - aimed_share, aimed_share];
            let Some(balanced) = balanced((aim, &aims), density, normal.dot(direction), shares)
            else {
                return Rgb::ZERO;
            };
            weight = balanced;
        }
        weight * PI * self.arriving_as_diffuse(hit, passage, next)
    }

    /// Radiance that a surface reflects, as if all of it were reflected diffusely, but for what is followed
    /// where it mirrors sharply.
    fn reflected_beside_mirrors(
        &self,
        (surface, hit): (&Surface, &Hit),
        direction: Vec3,
        next: Next,
    ) -> Rgb {
        let reflection = surface.reflection();
        let mut albedo = reflection.mean_albedo();
        if self.follows_mirrors && reflection.is_sharp() {
            albedo = reflection.diffuse(-direction) / (1.0 - mirrored_share(surface, -direction));
        }
        self.by_albedo(surface, albedo, hit, Some(next.afresh()))
    }

    /// Radiance that arrives along a ray that met this at first and came to that, if need be by way of
    /// mirrors.
    fn arriving_as_diffuse(&self, hit: Hit, mut passage: Passage, next: Next) -> Rgb {
        let is_mirror = self.follows_mirrors && self.world.may_mirror(hit.triangle);
        if !self.world.is_clear(hit.triangle) && !is_mirror {
            let Some(surface) = self.world.surface(&hit) else { return Rgb::ZERO };
            let albedo = surface.reflection().mean_albedo();
            let reflected = self.by_albedo(&surface, albedo, &hit, Some(next.afresh()));
            return reflected + self.glow(&surface);
        }
        if self.follows_mirrors {
            passage = self.world.follow_mirrors(passage);
        }
        let met = passage.met().and_then(|met| Some((met, self.world.surface(&met)?)));
        let reflected = met.map_or(Rgb::ZERO, |(met, surface)| {
            let reflected =
                self.reflected_beside_mirrors((&surface, &met), passage.direction, next);
            // What bent rays bring of emission comes below.
            let glow = if passage.is_bent { Rgb::ZERO } else { self.glow(&surface) };
            passage.left * (reflected + glow)
        });
        match passage.is_bent {
            true => reflected + passage.bent_light(&self.world, !self.is_mapped()),
            false => reflected,
        }
    }
}

/// A hit on the other side of the same surface.
fn behind(hit: &Hit) -> Hit {
    let mut behind = *hit;
    behind.back = !hit.back;
    behind
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;
    use crate::sampling::Shifted;
    use crate::scene::made::revolved::hollow_ball;
    use crate::scene::{Environment, Material, Triangle, Vertex};
    use crate::transport::hemilux::specimen::{ALBEDO, EMISSION, SEED, Specimen, is_near};

    /// A ray of the near field that goes through a pane finds what glows behind it, too: in a ball whose
    /// wall glows, what is left of L^e/(1 − a).
    #[test]
    fn what_glows_behind_a_pane_is_found() {
        let wall = Material::lambertian("wall", Rgb::splat(ALBEDO));
        let mut ball = hollow_ball(24, Material { emission: Rgb::splat(EMISSION), ..wall });
        let pane = Material { roughness: 0.0, ..Material::lambertian("pane", Rgb::splat(0.5)) };
        ball.materials.push(Material { transmission: 1.0, double_sided: true, ..pane });
        let first = ball.vertices.len() as u32;
        for at in [[-0.1, 0.3, -0.1], [0.2, 0.3, -0.1], [-0.1, 0.3, 0.2]] {
            ball.vertices.push(Vertex::new(Vec3::from(at), Vec3::Y));
        }
        ball.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material: 1 });
        let Specimen { world, lights, coarse, .. } = &Specimen::of(ball, Environment::none(), 1000);
        assert!(lights.has_glow() && lights.count() == 0);
        let middle = world.rays.place(Vec3::ZERO);
        let mut sequence = Shifted::new(SEED, Stream::Gather, 0);
        for _ in 0..16 {
            let [u, v] = sequence.next_pair();
            let direction = Vec3::new(0.1 * u - 0.05, 0.3, 0.1 * v - 0.05).normalize();
            let hit = world.rays.closest(Eye::Light, middle, direction).expect("it is closed");
            assert!(world.is_clear(hit.triangle), "the pane is before the wall");
            let passage = world.reach(hit, direction, true).expect("the wall is behind it");
            let left = passage.left.x;
            assert!((0.4..0.6).contains(&left), "{left}");
            let next = sequence.afresh().next.expect("there is one");
            let found = coarse.arriving_as_diffuse(hit, passage, next);
            assert!(is_near(found, left * EMISSION / (1.0 - ALBEDO), 0.05), "{found} of {left}");
        }
    }
}
