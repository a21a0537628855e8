//! Radiance that a glossy lobe reflects: rays sampled by the lobe and rays sampled by the lights,
//! combined by the power heuristic (Veach and Guibas 1995), from lobe to lobe. Where such a ray
//! ends on a diffuse surface, direct light is found afresh, and bounced light is the coarse
//! solution's. The shadow ray that finds it lights the lobe of that surface, too, whether or not that is
//! followed (docs/decisions/0087).

use super::lobe_at::{LightsAt, LobeAt, LobeLights, LobeRadiance, Way, lit_with_diffuse};
use crate::patches::FacetPlace;
use crate::radiometry::Rgb;
use crate::rays::Hit;
use crate::sampling::{Afresh, Next, cosine_direction};
use crate::surface::{Passage, PassageEnd, Reflection, Surface};
use crate::transport::hemilux::coarse::{CoarseSolution, FoundAfresh};
use glam::Vec3;
use std::f32::consts::PI;

/// Probability at which a path goes on by the next lobe that it meets, as a multiple of that lobe's
/// albedo: most paths have a weight of a half then.
const SURVIVAL_PER_ALBEDO: f32 = 2.0;
/// Lower bound of that probability, so that what is seen in dark plastic is not left to rare paths.
const LEAST_SURVIVAL: f32 = 0.1;

/// Probability at which a gather ray follows a lobe that it meets, as a multiple of the lobe's
/// share of what the surface reflects.
const FOLLOWED_PER_SHARE: f32 = 2.0;
/// Lower bound of that probability: its inverse, 10, is the largest weight of such a path.
const LEAST_FOLLOWED: f32 = 0.1;
/// Probability at which a hit in the near field finds what lobes send to it, as a multiple of the share
/// of its light that comes from lobes.
const TRACED_PER_SHARE: f32 = 2.0;
/// Most lobes that a path follows one after the other.
const MOST_LOBES: u32 = 8;

/// Random numbers of a path from lobe to lobe, and what it is for.
pub struct LobePathNumbers {
    /// Its direction from the first.
    pub xi: [f32; 2],
    /// Numbers for the lights, and for what comes after.
    pub numbers: Afresh,
    /// Whether it is to say what an open sky would bring.
    pub tells_open_sky: bool,
    /// How lights are looked for at its first lobe.
    pub lights: LobeLights,
    /// Whether the mesh says what comes from where it ends.
    pub by_mesh: bool,
}

/// What a surface's lobe reflects back along the way of a path, by one ray, and by one to the
/// lights from each lobe on its way. Paths are traced one by one: many paths side by side took
/// 0.5 to 1.6 % longer.
pub fn radiance_by_lobe(
    coarse: &CoarseSolution,
    surface: Surface,
    mut way: Way,
    path_numbers: LobePathNumbers,
) -> LobeRadiance {
    let LobePathNumbers { mut xi, mut numbers, tells_open_sky, mut lights, by_mesh } = path_numbers;
    let (world, mut surface) = (&*coarse.world, surface.lobe_only());
    let (mut found, mut carried) = (LobeRadiance::default(), Rgb::ONE);
    for lobe in 1.. {
        let at = LobeAt::new(coarse, surface, &way, lights);
        way.is_mapped = at.is_mapped;
        let by_lights = at.by_lights(numbers.light);
        found.add(&by_lights, carried);
        if lobe == 1 {
            (found.sky, found.open_sky) = (by_lights.sky, by_lights.open_sky);
        }
        let Some(scattered) = surface.reflection().sample(way.viewer, 0.0, false, xi) else {
            break;
        };
        let leaving = || way.leaving(world, &surface, &scattered);
        let (sight, bent) = world.look_differing(surface.start(), scattered.direction, leaving);
        carried *= scattered.factor.both();
        if lobe == 1 && tells_open_sky {
            found.open_sky += carried * at.open_sky(scattered.direction, scattered.pdf);
        }
        if !at.is_mapped {
            found.radiance += carried * sight.shine;
        }
        let hit = match sight.end {
            PassageEnd::Met(hit) => hit,
            PassageEnd::Escaped => {
                let far = at.escaping((&sight, bent), scattered.pdf);
                found.add(&far, carried);
                found.sky += if lobe == 1 { carried * far.sky } else { Rgb::ZERO };
                break;
            }
            PassageEnd::Lost => break,
        };
        if lobe == 1 {
            found.nearness = 1.0 / sight.way.max(1e-3);
        }
        let Some(met) = world.surface(&hit) else { break };
        found.radiance += carried * at.emitted(&sight, &hit, &met, scattered.pdf);
        carried *= sight.left;
        let Some(next) = numbers.next.filter(|_| met.reflection().is_glossy() && lobe < MOST_LOBES)
        else {
            found.radiance += carried * at_the_end(coarse, (&met, &hit), numbers, by_mesh);
            break;
        };
        way = way.on(world, (&surface, &scattered), (&sight, bent));
        surface = met.lobe_only();
        let survival = survival(&surface, way.viewer);
        let beside;
        (beside, lights) = beside_lobe(coarse, (&met, &hit), &way, numbers, survival);
        found.radiance += carried * beside.radiance;
        found.mirrored += carried * beside.mirrored;
        if next.number() >= survival {
            break;
        }
        carried /= survival;
        numbers = Afresh { next: Some(next.after()), ..next.afresh() };
        xi = numbers.bounce;
    }
    found
}

/// Probability at which a path goes on by a surface's lobe.
fn survival(lobe: &Surface, viewer: Vec3) -> f32 {
    let albedo = lobe.reflection().albedo(viewer).max_element();
    (SURVIVAL_PER_ALBEDO * albedo).clamp(LEAST_SURVIVAL, 1.0)
}

/// What the hit at the end of a path reflects to all sides, by the mesh or found out afresh.
fn at_the_end(
    coarse: &CoarseSolution,
    (met, hit): (&Surface, &Hit),
    numbers: Afresh,
    by_mesh: bool,
) -> Rgb {
    let albedo = met.reflection().mean_albedo();
    match by_mesh {
        true => coarse.by_albedo(met, albedo, hit, None),
        false => by_albedo(coarse, (met, albedo), hit, numbers).radiance,
    }
}

/// What arrives along a ray, as it is found out afresh and as tier 1 says.
#[derive(Clone, Copy, Default)]
pub struct Arriving {
    /// Radiance, found out afresh if that was asked for.
    pub radiance: Rgb,
    /// The same by the coarse solution alone, which has less noise; where that is not to be asked, `radiance`.
    pub by_mesh: Rgb,
}

/// How a gather ray finds out afresh what light there is at its end.
#[derive(Clone, Copy)]
pub struct AtTheEnd {
    /// Random numbers for it.
    pub numbers: Afresh,
    /// Whether it is to say what the coarse solution makes of it, too.
    pub asks_mesh: bool,
}

/// Radiance that arrives at a diffuse surface along a ray that came to this, beside what is found as
/// direct light; if asked to, the light at its end is found out afresh.
pub fn arriving(coarse: &CoarseSolution, passage: &Passage, afresh: Option<AtTheEnd>) -> Arriving {
    let is_mapped = coarse.is_mapped();
    let reflected = passage.met().and_then(|met| Some((met, coarse.world.surface(&met)?)));
    let reflected = reflected.map_or(Arriving::default(), |(met, surface)| {
        let way = Way { viewer: -passage.direction, is_mapped, differing: None };
        let mut found = reflected_at(coarse, (&surface, &met), way, afresh);
        // What bent rays bring of emission comes below.
        if !passage.is_bent {
            let glow = coarse.glow(&surface);
            (found.radiance, found.by_mesh) = (found.radiance + glow, found.by_mesh + glow);
        }
        found
    });
    let bent = match passage.is_bent {
        true => passage.bent_light(&coarse.world, !is_mapped),
        false => Rgb::ZERO,
    };
    let [radiance, by_mesh] =
        [reflected.radiance, reflected.by_mesh].map(|own| passage.left * own + bent);
    Arriving { radiance, by_mesh }
}

/// Radiance that a hit reflects back along the way of the ray. If asked to, the
/// light there is found out afresh: the emitters' by a shadow ray, what a lobe reflects, at
/// times, by another ray, and, where the patch is so near that its mean will not do, what has
/// bounced by one more.
fn reflected_at(
    coarse: &CoarseSolution,
    (surface, hit): (&Surface, &Hit),
    way: Way,
    afresh: Option<AtTheEnd>,
) -> Arriving {
    let reflection = surface.reflection();
    let Some(AtTheEnd { numbers, asks_mesh }) = afresh else {
        let radiance = coarse.by_albedo(surface, reflection.mean_albedo(), hit, None);
        return Arriving { radiance, by_mesh: radiance };
    };
    let found = reflected_afresh(coarse, (surface, hit), way, numbers);
    let radiance = found.radiance;
    // What a mirror shows the mesh does not know.
    if !asks_mesh || reflection.is_sharp() {
        return Arriving { radiance, by_mesh: radiance };
    }
    let is_dark = reflection.diffuse(way.viewer) == Rgb::ZERO;
    let told_at = if is_dark { coarse.told_at(hit) } else { found.told_at };
    let told = |place| reflection.mean_albedo() * coarse.told(place) / PI;
    Arriving { radiance, by_mesh: told_at.map_or(radiance, told) }
}

/// What a hit reflects, found out afresh.
pub fn reflected_afresh(
    coarse: &CoarseSolution,
    (surface, hit): (&Surface, &Hit),
    way: Way,
    numbers: Afresh,
) -> FoundAfresh {
    let Some(next) = numbers.next.filter(|_| surface.reflection().is_glossy()) else {
        let albedo = surface.reflection().mean_albedo();
        return by_albedo(coarse, (surface, albedo), hit, numbers);
    };
    let probability = (FOLLOWED_PER_SHARE * (1.0 - surface.reflection().diffuse_share(way.viewer)))
        .clamp(LEAST_FOLLOWED, 1.0);
    let (mut found, lights) = beside_lobe(coarse, (surface, hit), &way, numbers, probability);
    if next.number() >= probability {
        return found;
    }
    let numbers = Afresh { next: Some(next.after()), ..next.afresh() };
    let path_numbers = LobePathNumbers {
        xi: numbers.bounce,
        numbers,
        tells_open_sky: false,
        lights,
        by_mesh: false,
    };
    let by_lobe = radiance_by_lobe(coarse, *surface, way, path_numbers);
    found.radiance += by_lobe.radiance / probability;
    found.mirrored += by_lobe.mirrored / probability;
    found
}

/// What a hit on a glossy surface reflects back along a way beside what is found by following its lobe, which is done
/// with that probability; and how lights are looked for at the lobe then.
fn beside_lobe(
    coarse: &CoarseSolution,
    (surface, hit): (&Surface, &Hit),
    way: &Way,
    numbers: Afresh,
    probability: f32,
) -> (FoundAfresh, LobeLights) {
    let albedo = surface.reflection().diffuse(way.viewer);
    let mut found = by_albedo(coarse, (surface, albedo), hit, numbers);
    let at = match found.by_shadow_ray.is_some() && coarse.lights.is_exact() {
        true => LightsAt::Diffuse(probability),
        false => LightsAt::Lobe,
    };
    let lights = LobeLights { at, looks_over: way.looks_over(surface) };
    let sample = (found.by_shadow_ray.as_ref(), lights);
    let is_narrow = found.by_shadow_ray.as_ref().is_some_and(|sample| sample.is_narrow);
    let lit = lit_with_diffuse(coarse, &surface.lobe_only(), way, sample);
    found.radiance += lit;
    if lights.looks_over && is_narrow {
        found.mirrored = lit;
    }
    (found, lights)
}

/// Radiance that a hit on a surface of that albedo reflects to all sides, found out afresh.
fn by_albedo(
    coarse: &CoarseSolution,
    (surface, albedo): (&Surface, Rgb),
    hit: &Hit,
    numbers: Afresh,
) -> FoundAfresh {
    let mut found = coarse.found_afresh(surface, albedo, hit, numbers);
    if let Some(place) = found.near_at {
        found.radiance += beyond_near_field(coarse, (surface, albedo), place, numbers);
    }
    found
}

/// Radiance that a hit in the near field reflects of what lobes send to it beyond what one more ray finds
/// there, which takes lobes to reflect to all sides alike. Found by a ray of its own, the more often
/// the more of the light comes from lobes.
fn beyond_near_field(
    coarse: &CoarseSolution,
    (surface, albedo): (&Surface, Rgb),
    place: FacetPlace,
    numbers: Afresh,
) -> Rgb {
    let Some(next) = numbers.next.map(Next::after) else { return Rgb::ZERO };
    let probability = (TRACED_PER_SHARE * coarse.share_by_lobes(place)).min(1.0);
    if albedo == Rgb::ZERO || next.number() >= probability {
        return Rgb::ZERO;
    }
    let direction = cosine_direction(surface.shading_normal, next.afresh().bounce);
    if surface.normal.dot(direction) <= 0.0 {
        return Rgb::ZERO;
    }
    let lacking = lacking(coarse, surface.start(), direction, next.after().afresh());
    albedo * lacking / probability
}

/// Radiance that comes from a lobe at the end of a ray beyond what links say, which take it to reflect
/// to all sides alike. Sharp lobes are left out: maps and rays that follow mirrors have what they send.
pub fn lacking(coarse: &CoarseSolution, start: Vec3, direction: Vec3, numbers: Afresh) -> Rgb {
    let sight = coarse.world.look(start, direction);
    let PassageEnd::Met(end) = sight.end else { return Rgb::ZERO };
    let Some(met) = coarse.world.surface(&end).filter(|_| !sight.is_bent) else {
        return Rgb::ZERO;
    };
    let is_followed = met.reflection().is_glossy() && !met.reflection().is_sharp();
    if !is_followed || coarse.world.is_translucent(met.triangle) {
        return Rgb::ZERO;
    }
    // One lobe: what comes behind it is taken from the links.
    let numbers = Afresh { next: None, ..numbers };
    let viewer = -sight.direction;
    let albedo = met.reflection().diffuse(viewer);
    let path_numbers = LobePathNumbers {
        xi: numbers.bounce,
        numbers,
        tells_open_sky: false,
        lights: LightsAt::Lobe.into(),
        by_mesh: true,
    };
    let way = Way { viewer, is_mapped: coarse.is_mapped(), differing: None };
    let by_lobe = radiance_by_lobe(coarse, met, way, path_numbers).radiance;
    let by_links = coarse.sent_by_links(&met, &end);
    let diffuse = coarse.by_albedo(&met, albedo, &end, None);
    sight.left * (diffuse + by_lobe - by_links)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;
    use crate::rays::Eye;
    use crate::sampling::Shifted;
    use crate::transport::hemilux::fragments::VisibleSurfaces;
    use crate::transport::hemilux::specimen::{SEED, Specimen};

    /// Numbers that each mean is taken over.
    const TIMES: u32 = 2000;

    /// Sums of means over random numbers, and of the squares of their standard errors.
    #[derive(Default)]
    struct Means {
        sum: f64,
        squares: f64,
        count: u64,
    }

    impl Means {
        /// Adds a mean over other numbers than those before.
        fn add(&mut self, radiance: impl Fn(Afresh) -> Rgb) {
            self.count += 1;
            let mut sequence = Shifted::new(SEED, Stream::Gather, self.count);
            let [mut sum, mut squares] = [0.0; 2];
            for _ in 0..TIMES {
                sequence.next_pair();
                let found = f64::from(radiance(sequence.afresh()).element_sum());
                (sum, squares) = (sum + found, squares + found * found);
            }
            let (count, mean) = (f64::from(TIMES), sum / f64::from(TIMES));
            self.sum += mean;
            self.squares += (squares / count - mean * mean).max(0.0) / count;
        }

        /// How far it is above another, in standard errors.
        fn above(&self, other: &Self) -> f64 {
            (self.sum - other.sum) / (self.squares + other.squares).sqrt()
        }
    }

    /// What a hit reflects where its lobe has a shadow ray of its own, and is always followed.
    fn with_own_shadow_ray(
        coarse: &CoarseSolution,
        (surface, hit): (&Surface, &Hit),
        way: Way,
        numbers: Afresh,
    ) -> Rgb {
        let next = numbers.next.expect("gather rays have more numbers").after();
        let path_numbers = LobePathNumbers {
            xi: next.afresh().bounce,
            numbers: Afresh { next: Some(next.after()), ..next.afresh() },
            tells_open_sky: false,
            lights: LightsAt::Lobe.into(),
            by_mesh: false,
        };
        let diffuse = surface.reflection().diffuse(way.viewer);
        by_albedo(coarse, (surface, diffuse), hit, numbers).radiance
            + radiance_by_lobe(coarse, *surface, way, path_numbers).radiance
    }

    /// The shadow ray of a hit lights its lobe, too, and that is as much on average as if the lobe had one
    /// of its own. Light that is counted by both ways is noticed.
    #[test]
    fn a_hits_shadow_ray_lights_its_lobe() {
        let specimen = Specimen::new(&crate::scene::made::kitchen(), 2000);
        let (world, coarse) = (&specimen.world, &specimen.coarse);
        let (camera, cut) = (&world.scene.cameras[0], specimen.cut.clone());
        let visible = VisibleSurfaces::new(world, cut, camera, [64, 64], 1);
        let [mut shared, mut own, mut doubled] = [(); 3].map(|()| Means::default());
        for lobe in visible.lobes.iter().step_by(41) {
            let (origin, direction) = visible.lobe_ray(lobe, 0);
            let hit = world.rays.closest(Eye::Camera, origin, direction);
            let Some((hit, surface)) = hit.and_then(|hit| Some((hit, world.surface(&hit)?))) else {
                continue;
            };
            let albedo = surface.reflection().diffuse(-direction);
            if albedo == Rgb::ZERO {
                continue;
            }
            let at = (&surface, &hit);
            let way = Way { viewer: -direction, is_mapped: false, differing: None };
            let reflected = |numbers| reflected_afresh(coarse, at, way, numbers).radiance;
            shared.add(reflected);
            own.add(|numbers| with_own_shadow_ray(coarse, at, way, numbers));
            doubled.add(|numbers| {
                let found = by_albedo(coarse, (&surface, albedo), &hit, numbers);
                let sample = (found.by_shadow_ray.as_ref(), LightsAt::Diffuse(0.0).into());
                let lit = lit_with_diffuse(coarse, &surface.lobe_only(), &way, sample);
                reflected(numbers) + lit
            });
        }
        assert!(shared.count >= 10, "{}", shared.count);
        assert!(shared.above(&own).abs() < 3.5, "{} of {}", shared.sum, own.sum);
        assert!(doubled.above(&own) > 6.0, "{} of {}", doubled.sum, own.sum);
    }
}
