//! What the shadow rays of a fragment and of those around it say together.

use super::shadows::{DirectLighting, NEIGHBOUR_REACH, around};
use super::sums::{Part, ShadowSums, alike, well_spread};
use crate::emitters::DirectLights;
use crate::filter::{Center, Plane};
use crate::radiometry::{Rgb, importance};
use crate::transport::hemilux::fragments::VisibleSurfaces;

/// A fragment with at least so many rays takes those of adjacent pixels only.
const FEW_RAYS: u32 = 32;
/// Factor by which neighbours are taken to lower the variance where they are too few to measure it.
const NEIGHBOUR_VARIANCE_FACTOR: f32 = 0.15;
/// Factor on the variance by chance of two fragments' light through openings, before they are held to be unlike:
/// that variance is known from few rays.
const MORE_CHANCE: f32 = 2.0;
/// Variance of the rays of a fragment at a shadow's edge, in that which well-spread points would leave of
/// something smoother.
const EDGE_VARIANCE: f32 = 2.5;

impl DirectLighting {
    /// Direct irradiance of a fragment and its estimated variance; with the help of its neighbours' rays if
    /// `filtered`, as far as chance lets these say the same: however many there are, what they say of an even
    /// half-shadow has a third of the noise.
    pub fn irradiance(
        &self,
        lights: &DirectLights,
        visible: &VisibleSurfaces,
        index: usize,
        filtered: bool,
    ) -> (Rgb, Rgb) {
        let sums = &self.sums[index];
        if sums.rays == 0 {
            return (Rgb::ZERO, Rgb::ZERO);
        }
        let exact = lights.is_exact();
        let (mut light, mut variance) =
            self.by_share(Part::Known, exact, visible, (index, filtered));
        if sums.by_itself.is_some() {
            let (sky, other_variance) =
                self.by_share(Part::ByItself, exact, visible, (index, filtered));
            (light, variance) = (light + sky, variance + other_variance);
        }
        if sums.apart.is_any {
            let (apart, other_variance) = self.through_openings(visible, index, filtered);
            (light, variance) = (light + apart, variance + other_variance);
        }
        (light, variance)
    }

    /// Light of the sky that comes through openings, likewise: a plane through what arrives around, where
    /// chance lets that be the same, and the fragment's own as far as what is around is bent.
    fn through_openings(
        &self,
        visible: &VisibleSurfaces,
        index: usize,
        filtered: bool,
    ) -> (Rgb, Rgb) {
        let sums = &self.sums[index];
        let own = (sums.apart_mean(), sums.apart_variance());
        if !filtered {
            return own;
        }
        let reach = if sums.rays < FEW_RAYS { NEIGHBOUR_REACH } else { 1 };
        let mut others = Vec::with_capacity(24);
        around(visible, index, reach, |other, across, down| {
            let other = &self.sums[other];
            if other.rays > 0 && other.apart.is_any {
                others.push((other, across, down));
            }
        });
        // Of a ray; one fragment's rays are too few to tell.
        let all = others.iter().map(|(other, ..)| *other).chain([sums]);
        let (squares, rays) = all.fold((0.0, 0.0), |(squares, rays), sums| {
            (squares + sums.apart_scatter(), rays + (sums.rays_to_apart() as f32 - 1.0))
        });
        let of_one = squares / rays.max(1.0);
        let chance = |sums: &ShadowSums| {
            let rays = sums.rays_to_apart() as f32;
            of_one * well_spread(rays) / rays
        };
        let (mut plane, mut noise) = (Plane::new(), 0.0);
        for (other, across, down) in others.into_iter().chain([(sums, 0, 0)]) {
            let off = importance(other.apart_mean()) - importance(own.0);
            let both = MORE_CHANCE * (chance(sums) + chance(other));
            let weight = 1.0 / (1.0 + (across * across + down * down) as f32 * 0.5);
            let weight = weight * other.rays_to_apart() as f32 * alike(off, both);
            plane.add(across, down, other.apart_mean(), weight);
            noise += weight * chance(other);
        }
        // Of importance, as that of all channels together.
        let mean = plane.mean();
        let channels = (mean * mean).element_sum() / importance(mean).powi(2).max(1e-30);
        let noise = channels * noise / plane.weight();
        let Center { value, variance, .. } =
            plane.center_unless_bent((own.0, channels * chance(sums)), noise);
        let squares = value * value;
        let shares = match squares.element_sum() {
            sum if sum > 0.0 => squares / sum,
            _ => Rgb::splat(1.0 / 3.0),
        };
        (value, variance * shares)
    }

    /// Light of a part whose irradiance without occlusion is known, likewise: what a plane through the shares
    /// around says of it, where chance lets them be the same, and how far they are off that plane.
    fn by_share(
        &self,
        part: Part,
        exact: bool,
        visible: &VisibleSurfaces,
        (index, filtered): (usize, bool),
    ) -> (Rgb, Rgb) {
        let sums = &self.sums[index];
        let Some(own) = sums.part(part) else { return (Rgb::ZERO, Rgb::ZERO) };
        let factor = if exact { own.unoccluded } else { Rgb::ONE };
        if exact && own.cast == Rgb::ZERO && factor != Rgb::ZERO {
            return self.share_around(part, visible, index);
        }
        let share = own.share(exact);
        let rays = if sums.by_itself.is_some() { own.rays } else { sums.rays };
        if !(filtered && sums.is_disputed()) {
            return (factor * share, own.own_variance(exact));
        }
        let reach = if rays < FEW_RAYS { NEIGHBOUR_REACH } else { 1 };
        // Not by numbers of rays: these hang on what the first ones found, and whoever has seen more of the
        // light would count more.
        let mut plane = Plane::new();
        plane.add(0, 0, share, 1.0);
        around(visible, index, reach, |other, across, down| {
            let other = &self.sums[other];
            let weight = 1.0 / (1.0 + (across * across + down * down) as f32 * 0.5);
            let theirs = other.part(part).filter(|_| other.tells_share_of(sums, part, exact));
            if let Some(theirs) = theirs {
                let alike = if exact { own.alike(theirs) } else { 1.0 };
                let weight = weight * alike;
                plane.add(across, down, theirs.share(exact), weight);
            }
        });
        let own_share = share;
        let (share, variance) = plane.center();
        // Too few around are alike for a plane: this is a shadow's edge, of which they say nothing.
        if exact && own.mixed && variance.is_none() {
            return (factor * own_share, EDGE_VARIANCE * own.own_variance(exact));
        }
        let Some(variance) = variance else {
            return (factor * share, own.own_variance(exact) * NEIGHBOUR_VARIANCE_FACTOR);
        };
        // In half-shadow a few pixels wide no plane is as good as many rays.
        let chance = own.chance_around(importance(share));
        if exact && variance.element_sum() > 3.0 * chance {
            return (factor * own_share, factor * factor * chance);
        }
        (factor * share, factor * factor * variance)
    }

    /// The same where no ray of the fragment has found a place of such a light above its horizon, as of a lamp
    /// that this cuts: by the shares around, and as if nothing were in between where none is known.
    fn share_around(&self, part: Part, visible: &VisibleSurfaces, index: usize) -> (Rgb, Rgb) {
        let sums = &self.sums[index];
        let unoccluded = sums.part(part).map_or(Rgb::ZERO, |own| own.unoccluded);
        let (mut sum, mut rays) = (Rgb::ZERO, 0.0);
        around(visible, index, NEIGHBOUR_REACH, |other, _, _| {
            let other = &self.sums[other];
            let is_alike = other.by_itself.is_some() == sums.by_itself.is_some();
            let theirs = other.part(part).filter(|own| is_alike && own.cast != Rgb::ZERO);
            if let Some(theirs) = theirs {
                sum += theirs.share(true) * theirs.rays as f32;
                rays += theirs.rays as f32;
            }
        });
        let share = if rays > 0.0 { sum / rays } else { Rgb::ONE };
        let variance = share * (Rgb::ONE - share);
        (unoccluded * share, unoccluded * unoccluded * variance.max(Rgb::ZERO))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emitters::DirectLights;
    use crate::random::{Numbers, Stream};
    use crate::sampling::Seed;
    use crate::scene::environment::{Environment, Sky, Sun};
    use crate::scene::{Camera, Material, Scene, Triangle, Vertex};
    use crate::transport::hemilux::direct::caster::Caster;
    use crate::transport::hemilux::direct::sums::ShareSums;
    use crate::transport::hemilux::fragments::Fragment;
    use crate::transport::hemilux::specimen::Specimen;
    use glam::Vec3;
    use std::f32::consts::PI;

    /// A ground with a roof above it, and a sun so many times as bright as the sky.
    fn in_the_sun(brightness: f32) -> Specimen {
        let square = |half: f32, y: f32| {
            let corner =
                |x: f32, z: f32| Vertex::new(half * Vec3::new(x, 0.0, z) + y * Vec3::Y, Vec3::Y);
            [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]
        };
        let triangle = |vertices| Triangle { vertices, material: 0 };
        let eye = Vec3::new(0.0, 4.0, 9.0);
        let scene = Scene {
            vertices: [square(30.0, 0.0), square(8.0, 5.0)].concat(),
            triangles: [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]].map(triangle).to_vec(),
            materials: vec![Material::lambertian("grey", Rgb::splat(0.5))],
            cameras: vec![Camera::look_at("camera", eye, Vec3::ZERO, Vec3::Y, 0.9)],
            ..Scene::default()
        };
        let sky = Sky::Uniform(Rgb::ONE);
        let sun = Sun::towards(Vec3::new(0.2, 1.0, 0.1), Rgb::splat(brightness * PI), 0.005);
        Specimen::of(scene, Environment { sky, sun: Some(sun), ..Environment::none() }, 1000)
    }

    fn cast(
        specimen: &Specimen,
        visible: &VisibleSurfaces,
        (seed, passes): (u64, u32),
        prepare: impl Fn(&mut ShadowSums),
    ) -> DirectLighting {
        let Specimen { world, lights, .. } = specimen;
        let seed = Seed { number: seed, well_spread: true };
        let mut direct = DirectLighting::new(lights, visible, true, false);
        direct.sums.iter_mut().for_each(prepare);
        for _ in 0..passes {
            direct.pass(&Caster { world, lights, visible, seed }, f64::INFINITY);
        }
        direct
    }

    /// Squared error of the light on all fragments where the sun does not shine, nor around them, over what
    /// the sky would shine on them.
    fn error_in_shadow(
        (lights, visible): (&DirectLights, &VisibleSurfaces),
        [direct, exact]: [&DirectLighting; 2],
    ) -> f32 {
        let of = |direct: &DirectLighting, index| {
            importance(direct.irradiance(lights, visible, index, true).0)
        };
        let sky = |index: usize| {
            exact.sums[index].by_itself.as_ref().map_or(0.0, |sky| importance(sky.unoccluded))
        };
        let all = 0..visible.fragments.len();
        let sun = |index: usize| importance(exact.sums[index].known.share(true));
        let is_shaded = |index: usize| sky(index) > 0.0 && sun(index) < 1e-6;
        let shaded = all.filter(|index| {
            let mut all_around = is_shaded(*index);
            around(visible, *index, 3, |other, _, _| all_around &= is_shaded(other));
            all_around
        });
        let shaded: Vec<usize> = shaded.collect();
        assert!(shaded.len() > 10, "{} are in the shadow", shaded.len());
        let off = |index: usize| (of(direct, index) - of(exact, index)) / sky(index);
        shaded.iter().map(|index| off(*index).powi(2)).sum::<f32>() / shaded.len() as f32
    }

    /// In the sun's shadow all light is the sky's, which few rays would go to if it had no sums of its own.
    #[test]
    fn the_sky_shines_into_the_suns_shadow() {
        let specimen = in_the_sun(100.0);
        let (visible, lights) = (specimen.visible(), &*specimen.lights);
        let exact = cast(&specimen, &visible, (99, 200), |_| ());
        let [apart, together]: [f32; 2] = [0, 1].map(|kind| {
            let of = |seed| {
                let once = match kind {
                    0 => cast(&specimen, &visible, (seed, 1), |_| ()),
                    _ => cast(&specimen, &visible, (seed, 1), together),
                };
                error_in_shadow((lights, &visible), [&once, &exact])
            };
            (0..20).map(of).sum::<f32>() / 20.0
        });
        assert!(apart < 0.04, "{apart}: a fifth");
        assert!(together > 10.0 * apart, "{together} as one, {apart} by itself");
    }

    /// What thousands of rays say of an even half-shadow still has noise, which neighbours lower; where there is
    /// an edge that so many rays tell from chance, each keeps what its own say.
    #[test]
    fn neighbours_help_however_many_rays_there_are() {
        const RAYS: u32 = 8192;
        let specimen = Specimen::furnace();
        let (visible, lights) = (specimen.visible(), &*specimen.lights);
        let off = |share: &dyn Fn(u32) -> f32, filtered: bool| {
            let mut direct = DirectLighting::new(lights, &visible, true, false);
            let mut numbers = Numbers::new(5, Stream::Light, 0);
            for (sums, fragment) in direct.sums.iter_mut().zip(&visible.fragments) {
                let arrives = share(fragment.pixel);
                let seen = (0..RAYS).filter(|_| numbers.uniform() < arrives).count() as f32;
                let (rays, cast) = (RAYS, Rgb::splat(RAYS as f32));
                let known = ShareSums { seen: Rgb::splat(seen), cast, rays, ..sums.known };
                sums.known = ShareSums { blocked: RAYS as f32 - seen, mixed: true, ..known };
                (sums.rays, sums.disputed) = (rays, true);
            }
            let of = |(index, fragment): (usize, &Fragment)| {
                let (light, _) = direct.irradiance(lights, &visible, index, filtered);
                let all = importance(direct.sums[index].known.unoccluded);
                (importance(light) / all - share(fragment.pixel)).powi(2)
            };
            let all = visible.fragments.iter().enumerate().map(of);
            (all.sum::<f32>() / visible.fragments.len() as f32).sqrt()
        };
        let [own, together] = [false, true].map(|filtered| off(&|_| 0.3, filtered));
        assert!(together < 0.5 * own, "{together}, each by itself {own}");
        let edge = |pixel: u32| if pixel % visible.width < visible.width / 2 { 0.3 } else { 0.4 };
        let [own, together] = [false, true].map(|filtered| off(&edge, filtered));
        assert!(together < 0.6 * own, "{together}, each by itself {own}");
    }

    /// Light through openings has less noise with what those around found; where that is bent by more than
    /// chance explains, a fragment keeps what its own rays say.
    #[test]
    fn light_through_openings_is_shared_unless_it_is_bent() {
        const RAYS: u32 = 2000;
        let specimen = Specimen::furnace();
        let (visible, lights) = (specimen.visible(), &*specimen.lights);
        let off = |light: &dyn Fn(u32) -> f32, filtered: bool| {
            let mut direct = DirectLighting::new(lights, &visible, true, false);
            let mut numbers = Numbers::new(5, Stream::Light, 0);
            for (sums, fragment) in direct.sums.iter_mut().zip(&visible.fragments) {
                (sums.known, sums.rays) = (ShareSums::default(), RAYS);
                sums.apart.is_any = true;
                // In strata, as well-spread points are: a tenth of the deviation that random ones have.
                for ray in 0..RAYS {
                    let x = (ray as f32 + numbers.uniform()) / RAYS as f32;
                    let is_seen = (x * 97.0).fract() < 0.1 * light(fragment.pixel);
                    sums.apart.add(if is_seen { Rgb::splat(10.0) } else { Rgb::ZERO });
                }
            }
            let of = |(index, fragment): (usize, &Fragment)| {
                let (found, _) = direct.irradiance(lights, &visible, index, filtered);
                (importance(found) - light(fragment.pixel)).powi(2)
            };
            let all = visible.fragments.iter().enumerate().map(of);
            (all.sum::<f32>() / visible.fragments.len() as f32).sqrt()
        };
        let [own, together] = [false, true].map(|filtered| off(&|_| 1.0, filtered));
        assert!(together < 0.75 * own, "{together}, each by itself {own}");
        let stripes = |pixel: u32| if pixel.is_multiple_of(2) { 0.8 } else { 1.2 };
        let [own, together] = [false, true].map(|filtered| off(&stripes, filtered));
        assert!(together < 1.5 * own, "{together}, each by itself {own}");
    }

    /// In the mean over seeds few passes say what very many do.
    #[test]
    fn light_in_two_parts_has_the_right_mean() {
        let specimen = in_the_sun(3.0);
        let (visible, lights) = (specimen.visible(), &*specimen.lights);
        let sum = |direct: &DirectLighting| -> f64 {
            let light = |(index, fragment): (usize, &Fragment)| {
                let (light, _) = direct.irradiance(lights, &visible, index, false);
                f64::from(importance(light) * fragment.share)
            };
            visible.fragments.iter().enumerate().map(light).sum()
        };
        let exact = sum(&cast(&specimen, &visible, (99, 400), |_| ()));
        const SEEDS: u64 = 30;
        let mean = |passes: u32, prepare: &dyn Fn(&mut ShadowSums)| {
            let of = |seed| sum(&cast(&specimen, &visible, (seed, passes), prepare));
            (0..SEEDS).map(of).sum::<f64>() / SEEDS as f64 / exact
        };
        let [once, often] = [1, 16].map(|passes| mean(passes, &|_| ()));
        assert!((often - 1.0).abs() < 0.002, "{often}");
        // Few rays, which go by what others found, are off by more in one part.
        let in_one_part = mean(1, &together);
        assert!((once - 1.0).abs() < 0.015, "{once}");
        assert!((in_one_part - 1.0).abs() > 2.0 * (once - 1.0).abs(), "{in_one_part}, {once}");
    }

    /// Takes all light as one part.
    fn together(sums: &mut ShadowSums) {
        if let Some(sky) = sums.by_itself.take() {
            sums.known.unoccluded += sky.unoccluded;
        }
    }
}
