//! A lobe where a path leaves it: what it reflects of a light that is sampled, and how much counts of what rays by it
//! bring.

use crate::emitters::{AllUnoccluded, LobeAxis, ShadowSample};
use crate::radiometry::Rgb;
use crate::rays::Hit;
use crate::sampling::power_heuristic;
use crate::surface::{Differentials, Passage, Reflection, Scattered, Surface, Turn, World};
use crate::transport::hemilux::coarse::CoarseSolution;
use glam::Vec3;

/// Width of a distribution of microfacets below which rays by the lobe seldom find narrow lights.
const POLISHED: f32 = 0.1;
/// Exponent of a lobe that is taken to be about as wide, to pick narrow lights by.
const BLURRED_EXPONENT: f32 = 50.0;

/// How a path came to a surface.
#[derive(Clone, Copy)]
pub struct Way {
    /// Unit vector back along it.
    pub viewer: Vec3,
    /// Whether a map has what emitters bring along it, as long as its lobes are sharp: then it began
    /// at a diffuse reflection.
    pub is_mapped: bool,
    /// How it differs from those around, of a path from a camera where there are narrow lights that rays seldom find.
    pub differing: Option<Differentials>,
}

impl Way {
    /// The same after a surface has reflected it to another, which it met like this; `bent` are its differentials there
    /// if something clear was in between.
    pub fn on(
        self,
        world: &World,
        (surface, scattered): (&Surface, &Scattered),
        (sight, bent): (&Passage, Option<Differentials>),
    ) -> Self {
        let leaving = || self.leaving(world, surface, scattered);
        let differing = bent.or_else(|| leaving().map(|own| own.after(sight.way)));
        Self { viewer: -sight.direction, differing, ..self }
    }

    /// Its differentials where a surface has reflected it in a direction that was picked.
    pub fn leaving(
        &self,
        world: &World,
        surface: &Surface,
        scattered: &Scattered,
    ) -> Option<Differentials> {
        let between = [-self.viewer, scattered.direction];
        let turn = Turn::by_density(between, scattered.pdf);
        self.differing.map(|own| own.leaving(world, surface, turn))
    }

    /// Whether narrow lights are looked at over all that it stands for of a surface that it came to, one that is
    /// polished.
    pub fn looks_over(&self, surface: &Surface) -> bool {
        self.differing.is_some() && is_polished(surface)
    }
}

/// Whether any of a surface's lobes is so narrow that rays by it seldom find narrow lights.
fn is_polished(surface: &Surface) -> bool {
    let [base, coat] = surface.reflection().widths();
    base.min(coat) < POLISHED
}

/// How lights are sampled at a lobe of a path.
#[derive(Clone, Copy)]
pub enum LightsAt {
    /// By a shadow ray of its own, to a light that is picked for the lobe.
    Lobe,
    /// The same but for narrow lights, of which `Highlights` tell.
    Extended,
    /// By the shadow ray of the diffuse part, which was cast whether or not the lobe is followed: that
    /// is done with this probability.
    Diffuse(f32),
}

/// How lights are looked for at a lobe of a path.
#[derive(Clone, Copy)]
pub struct LobeLights {
    /// How they are sampled.
    pub at: LightsAt,
    /// Whether narrow lights are looked at over all that the path stands for; its rays do not look for them then.
    pub looks_over: bool,
}

impl From<LightsAt> for LobeLights {
    fn from(at: LightsAt) -> Self {
        Self { at, looks_over: false }
    }
}

impl LightsAt {
    /// The probability at which the lobe is followed, of those hits at which lights are sampled: there are
    /// so many rays by the lobe for each shadow ray.
    pub(super) fn chance(self) -> f32 {
        match self {
            Self::Lobe | Self::Extended => 1.0,
            Self::Diffuse(probability) => probability,
        }
    }
}

/// What a lobe reflects towards its viewer, as one path found it.
#[derive(Clone, Copy, Default)]
pub struct LobeRadiance {
    /// Radiance.
    pub radiance: Rgb,
    /// What of it is light of the sky that comes to the first lobe itself.
    pub sky: Rgb,
    /// What that would be if nothing were in the way, where that is asked for.
    pub open_sky: Rgb,
    /// What of the radiance is of narrow lights over all that the path stands for, which paths of the audit hardly find.
    pub mirrored: Rgb,
    /// 1 over the distance to what the path met first, 0 where that is nothing.
    pub nearness: f32,
}

impl LobeRadiance {
    /// Adds what else a path found, by what is carried to its first lobe: radiance, and what of it is mirrored.
    pub fn add(&mut self, other: &Self, carried: Rgb) {
        self.radiance += carried * other.radiance;
        self.mirrored += carried * other.mirrored;
    }
}

/// A lobe of a path: where light leaves it, and what lights are picked by there.
pub(super) struct LobeAt<'a> {
    coarse: &'a CoarseSolution,
    surface: Surface,
    way: Way,
    unoccluded: AllUnoccluded,
    /// Whether a map has what emitters bring to it.
    pub is_mapped: bool,
    /// How lights are looked for there.
    lights: LobeLights,
}

impl<'a> LobeAt<'a> {
    pub fn new(
        coarse: &'a CoarseSolution,
        surface: Surface,
        way: &Way,
        lights: LobeLights,
    ) -> Self {
        let reflection = surface.reflection();
        let (start, normal) = (surface.start(), surface.shading_normal);
        let axis = || {
            let exponent = reflection.widest_exponent();
            let of_narrow = if lights.looks_over { BLURRED_EXPONENT } else { exponent };
            LobeAxis { direction: surface.mirrored(way.viewer), exponent, of_narrow }
        };
        let unoccluded = match lights.at {
            LightsAt::Diffuse(_) => coarse.lights.unoccluded(start, normal),
            LightsAt::Lobe => coarse.lights.for_lobe(start, normal, axis()),
            LightsAt::Extended => coarse.lights.extended_for_lobe(start, normal, axis()),
        };
        let is_mapped = way.is_mapped && reflection.is_sharp();
        Self { coarse, surface, way: *way, unoccluded, is_mapped, lights }
    }

    /// Weight of what a ray by the lobe brings of a light, where these are the densities at which the lobe
    /// and the lights pick its direction.
    fn weight(&self, by_lobe: f32, by_lights: f32) -> f32 {
        power_heuristic(self.lights.at.chance() * by_lobe, by_lights)
    }

    /// What the lobe reflects of a light that is sampled.
    pub fn by_lights(&self, xi: Vec3) -> LobeRadiance {
        let mut found = LobeRadiance::default();
        if self.is_mapped || matches!(self.lights.at, LightsAt::Diffuse(_)) {
            return found;
        }
        let (start, normal) = (self.surface.start(), self.surface.shading_normal);
        let Some(light) = self.coarse.lights.sample(&self.unoccluded, start, normal, xi) else {
            return found;
        };
        let direction = (light.end - start).normalize_or_zero();
        if self.surface.normal.dot(direction) <= 0.0 {
            return found;
        }
        let lit = Lit { direction, density: light.density, is_narrow: light.narrow.is_some() };
        let value =
            lit.reflected(self.coarse, (&self.surface, self.lights.looks_over), (&self.way, 1.0));
        if value == Rgb::ZERO {
            return found;
        }
        let open = value * light.irradiance;
        found.radiance = open * self.coarse.world.visibility(start, light.end);
        if light.is_sky {
            (found.sky, found.open_sky) = (found.radiance, open);
        }
        if self.lights.looks_over && lit.is_narrow {
            found.mirrored = found.radiance;
        }
        found
    }

    /// What a ray of that density would bring of the sky if nothing were in its way.
    pub fn open_sky(&self, direction: Vec3, density: f32) -> Rgb {
        let normal = self.surface.shading_normal;
        let [(radiance, other), _] =
            self.coarse.lights.escaping(&self.unoccluded, normal, direction);
        radiance * self.weight(density, other)
    }

    /// What a ray of that density brings from where it left the scene; `bent` are its differentials if something clear
    /// was in between. The sun is found by rays that were bent only where the lobe is polished; others meet it too
    /// seldom.
    pub fn escaping(
        &self,
        (sight, bent): (&Passage, Option<Differentials>),
        density: f32,
    ) -> LobeRadiance {
        let normal = self.surface.shading_normal;
        let far = self.coarse.lights.escaping(&self.unoccluded, normal, sight.direction);
        let is_left = self.lights.looks_over || matches!(self.lights.at, LightsAt::Extended);
        let bent = bent.filter(|_| sight.is_bent);
        let surface = &self.surface;
        let finds_sun = !self.is_mapped
            && match sight.is_bent {
                true => surface.reflection().is_sharp() || bent.is_some() && is_polished(surface),
                false => !is_left,
            };
        let weighed = |(group, (radiance, other)): (usize, (Rgb, f32))| {
            let is_found = group == 0 || finds_sun;
            match radiance != Rgb::ZERO && is_found {
                true if sight.is_bent || self.is_mapped => radiance,
                true => radiance * self.weight(density, other),
                false => Rgb::ZERO,
            }
        };
        let [sky, mut sun] = far;
        if let (Some(bent), Some(of_scene)) = (bent, self.coarse.world.environment.sun) {
            sun.0 = of_scene.mean_over(sight.direction, bent.seen());
        }
        let [sky, sun] = [(0, sky), (1, sun)].map(|far| sight.left * weighed(far));
        let mirrored = if bent.is_some() { sun } else { Rgb::ZERO };
        LobeRadiance { radiance: sky + sun, sky, mirrored, ..LobeRadiance::default() }
    }

    /// What such a ray brings of the emission of what it met.
    pub fn emitted(&self, sight: &Passage, hit: &Hit, met: &Surface, density: f32) -> Rgb {
        if met.emission == Rgb::ZERO || self.is_mapped {
            return Rgb::ZERO;
        }
        if sight.is_bent {
            return sight.left * met.emission;
        }
        let place = (self.surface.start(), self.surface.shading_normal);
        let hit = hit.after(sight.way);
        let lights = &self.coarse.lights;
        let other = lights.density(&self.unoccluded, place, &hit, met.normal, sight.direction);
        sight.left * met.emission * self.weight(density, other)
    }
}

/// A direction that lights were sampled by.
struct Lit {
    /// Unit vector.
    direction: Vec3,
    /// Density per solid angle at which it was picked.
    density: f32,
    /// Whether it is that of a narrow light.
    is_narrow: bool,
}

impl Lit {
    /// Radiance over irradiance that a surface reflects from there back along a way, weighed against so many rays by
    /// its lobe that look for the same light; over all that the way stands for, if asked to.
    fn reflected(
        &self,
        coarse: &CoarseSolution,
        (surface, looks_over): (&Surface, bool),
        (way, chance): (&Way, f32),
    ) -> Rgb {
        let (viewer, source) = (way.viewer, self.direction);
        if let Some(differing) = way.differing.filter(|_| looks_over && self.is_narrow) {
            let changes = differing.slope_changes(&coarse.world, surface, [viewer, source]);
            let blurred = surface.blurred(differing.blur_of_slopes(&changes));
            let reflection = blurred.as_ref().unwrap_or(surface).reflection();
            return reflection.evaluate_over(viewer, source, &changes).both();
        }
        let (parts, by_lobe) = surface.reflection().evaluate_with_pdf(viewer, source, 0.0);
        parts.both() * power_heuristic(self.density, chance * by_lobe)
    }
}

/// What a lobe reflects back along a way of the light that the shadow ray of the diffuse part found, if lights are
/// sampled by that, and not by a map, as those of a sharp lobe may be.
pub(super) fn lit_with_diffuse(
    coarse: &CoarseSolution,
    lobe: &Surface,
    way: &Way,
    (sample, lights): (Option<&ShadowSample>, LobeLights),
) -> Rgb {
    let Some(sample) = sample.filter(|_| matches!(lights.at, LightsAt::Diffuse(_))) else {
        return Rgb::ZERO;
    };
    let arrived = sample.arrived();
    let is_below = lobe.normal.dot(sample.direction) <= 0.0;
    if arrived == Rgb::ZERO || is_below || (way.is_mapped && lobe.reflection().is_sharp()) {
        return Rgb::ZERO;
    }
    let ShadowSample { direction, density, is_narrow, .. } = *sample;
    let lit = Lit { direction, density, is_narrow };
    lit.reflected(coarse, (lobe, lights.looks_over), (way, lights.at.chance())) * arrived
}
