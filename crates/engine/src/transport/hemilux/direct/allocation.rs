//! Where the next shadow rays go: to fragments where those so far disagree, and among them by how far one may
//! be off in the picture.

use super::shadows::{CHUNK, DirectLighting, NEIGHBOUR_REACH, SHARES_OF_MORE, around};
use super::sums::ShadowSums;
use crate::transport::hemilux::fragments::{Fragment, VisibleSurfaces};
use rayon::prelude::*;

/// Rays of a fragment and those around it, at least, for their agreement to tell anything: those of the first
/// pass at a corner of a wall. A surface that bends by more than a few degrees from pixel to pixel has none
/// around it that it could be compared with.
const ENOUGH_TO_AGREE: u32 = 9;

impl DirectLighting {
    /// Marks the fragments whose own or neighbouring rays disagree, or are too few to tell; and those whose light
    /// is divided up in another way than that of one beside them, as where a place begins that sees the sky
    /// through openings: neither says anything of what the other's rays found.
    pub(super) fn mark_disputed(&mut self, visible: &VisibleSurfaces) {
        let sums = &self.sums;
        let disputed: Vec<bool> = (0..sums.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|index| {
                let mine = &sums[index];
                if mine.is_disputed() {
                    return true;
                }
                let (mut disagrees, mut rays) = (false, mine.rays);
                around(visible, index, NEIGHBOUR_REACH, |other, _, _| {
                    let other = &sums[other];
                    disagrees |= mine.differs_from(other) || mine.division() != other.division();
                    rays = rays.saturating_add(other.rays);
                });
                // What is black or in the dark has none at all, and needs none.
                disagrees || mine.rays > 0 && rays < ENOUGH_TO_AGREE
            })
            .collect();
        self.sums.iter_mut().zip(disputed).for_each(|(sums, disputed)| sums.disputed = disputed);
    }

    /// What one more ray of each fragment may be off in the picture, in means over those where rays disagree; 0
    /// for the others. A reveal under the open sky is a hundred times as bright as the room. By what the rays of
    /// all pixels around found: few rays that happened to find little light would be sent no more, and stay
    /// dark, while others were put right.
    pub(super) fn worth_around(&self, visible: &VisibleSurfaces) -> Vec<f32> {
        let own: Vec<f32> = self.sums.par_iter().map(|sums| sums.deviation().powi(2)).collect();
        let worth = |index: usize| {
            if !self.sums[index].is_uneven() {
                return 0.0;
            }
            let (mut sum, mut count) = (own[index], 1.0f32);
            around(visible, index, NEIGHBOUR_REACH, |other, _, _| {
                sum += own[other];
                count += 1.0;
            });
            (sum / count).sqrt() * visible.fragments[index].weight()
        };
        let all: Vec<f32> =
            (0..self.sums.len()).into_par_iter().with_min_len(CHUNK).map(worth).collect();
        let count = self.sums.iter().filter(|sums| sums.is_uneven()).count();
        let sum: f64 = all.iter().map(|worth| f64::from(*worth)).sum();
        let mean = (sum as f32 / count.max(1) as f32).max(f32::MIN_POSITIVE);
        all.iter().map(|worth| (worth / mean).min(SHARES_OF_MORE[1])).collect()
    }

    /// Mean over the fragments where rays disagree of what one more ray of each may be off in the
    /// picture; positive.
    pub(super) fn mean_deviation(&self, visible: &VisibleSurfaces) -> f32 {
        let of = |(sums, fragment): (&ShadowSums, &Fragment)| {
            let deviation = f64::from(sums.deviation() * fragment.weight());
            if sums.is_uneven() { (deviation, 1.0) } else { (0.0, 0.0) }
        };
        // One after the other: sums in parallel would depend on the number of threads.
        let pairs = self.sums.iter().zip(&visible.fragments).map(of);
        let (sum, count) = pairs.fold((0.0, 0.0), |all, one| (all.0 + one.0, all.1 + one.1));
        ((sum / f64::max(count, 1.0)) as f32).max(f32::MIN_POSITIVE)
    }

    /// Factor by which the wanted rays of all fragments become no more than `most`, at most 1.
    pub(super) fn scale_to(
        &self,
        most: f64,
        visible: &VisibleSurfaces,
        wanted: &(impl Fn(&Fragment, &ShadowSums) -> f32 + Sync),
    ) -> f32 {
        if most.is_infinite() {
            return 1.0;
        }
        let pairs = visible.fragments.iter().zip(&self.sums);
        let all: f64 = pairs.map(|(fragment, sums)| f64::from(wanted(fragment, sums))).sum();
        (most / all.max(1.0)).min(1.0) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::{Rgb, importance};
    use crate::sampling::Seed;
    use crate::scene::environment::{Environment, Sky};
    use crate::scene::made::revolved::revolved;
    use crate::scene::{Camera, Material, Triangle, Vertex, made};
    use crate::transport::hemilux::direct::caster::Caster;
    use crate::transport::hemilux::specimen::Specimen;
    use glam::Vec3;
    use std::f32::consts::PI;

    /// A ball, eight pixels across, below a roof that hides some of the sky.
    fn ball_below_roof() -> Specimen {
        let place = |ring: u32| -> [f32; 2] {
            let (sin, cos) = (PI * ring as f32 / 24.0).sin_cos();
            [sin, -cos]
        };
        let profile: Vec<[f32; 2]> = (0..=24).map(place).collect();
        let mut scene = revolved(&profile, 48, Material::lambertian("grey", Rgb::splat(0.5)));
        for vertex in &mut scene.vertices {
            vertex.normal = vertex.position.normalize();
        }
        let first = scene.vertices.len() as u32;
        let corner = |x: f32, z: f32| Vertex::new(Vec3::new(x, 2.0, z), Vec3::Y);
        scene.vertices.extend([
            corner(-1.5, 1.5),
            corner(1.5, 1.5),
            corner(1.5, -1.5),
            corner(-1.5, -1.5),
        ]);
        let roof = [[0, 1, 2], [0, 2, 3]].map(|of: [u32; 3]| of.map(|corner| first + corner));
        scene.triangles.extend(roof.map(|vertices| Triangle { vertices, material: 0 }));
        let eye = Vec3::new(0.0, 0.5, 14.0);
        scene.cameras = vec![Camera::look_at("camera", eye, Vec3::ZERO, Vec3::Y, 0.35)];
        let environment = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
        Specimen::of(scene, environment, 1000)
    }

    /// Pixels that nothing around resembles get rays until these tell something, though the first ones agree.
    #[test]
    fn what_is_like_nothing_around_it_is_not_lit_by_one_ray() {
        let specimen = ball_below_roof();
        let Specimen { world, lights, .. } = &specimen;
        let visible = specimen.visible();
        let after = |passes: u32, adaptive: bool, number: u64| {
            let seed = Seed { number, well_spread: true };
            let mut direct = DirectLighting::new(lights, &visible, adaptive, false);
            let caster = Caster { world, lights, visible: &visible, seed };
            (0..passes).for_each(|_| direct.pass(&caster, f64::INFINITY));
            direct
        };
        let exact = after(400, false, 99);
        let alone: Vec<usize> = (0..visible.fragments.len())
            .filter(|index| {
                let mut others = 0;
                around(&visible, *index, NEIGHBOUR_REACH, |_, _, _| others += 1);
                others < 3 && !exact.sums[*index].is_dark()
            })
            .collect();
        assert!(alone.len() >= 20, "{} of {}", alone.len(), visible.fragments.len());
        let (mut squares, mut count) = (0.0, 0.0);
        for seed in 1..=10 {
            let once = after(1, true, seed);
            for index in &alone {
                assert!(once.sums[*index].rays >= ENOUGH_TO_AGREE, "{}", once.sums[*index].rays);
                let [own, exact] = [&once, &exact]
                    .map(|direct| importance(direct.irradiance(lights, &visible, *index, true).0));
                squares += ((own - exact) / PI).powi(2);
                count += 1.0;
            }
        }
        let off = f32::sqrt(squares / count);
        assert!(off < 0.1, "{off}");
    }

    /// Most rays go where the sky shines in, and the picture is as bright, in the mean over seeds, as it is with
    /// many rays everywhere.
    #[test]
    fn rays_by_need_leave_the_mean_as_it_is() {
        let mut house = made::real::wide_window();
        house.environment.sun = None;
        let specimen = Specimen::surrounded(&house.glb, house.environment, 1000);
        let Specimen { world, lights, .. } = &specimen;
        let visible = specimen.visible();
        let mean = |direct: &DirectLighting, filtered: bool| {
            let light = |(index, fragment): (usize, &Fragment)| {
                let (light, _) = direct.irradiance(lights, &visible, index, filtered);
                f64::from(importance(light) * fragment.weight())
            };
            visible.fragments.iter().enumerate().map(light).sum::<f64>()
        };
        let caster = |number| Caster {
            world,
            lights,
            visible: &visible,
            seed: Seed { number, well_spread: true },
        };
        let mut even = DirectLighting::new(lights, &visible, false, false);
        (0..400).for_each(|_| even.pass(&caster(0), f64::INFINITY));
        let exact = mean(&even, false);
        const SEEDS: u64 = 400;
        let all = (1..=SEEDS).into_par_iter().map(|seed| {
            let mut direct = DirectLighting::new(lights, &visible, true, false);
            direct.pass(&caster(seed), f64::INFINITY);
            [false, true].map(|filtered| mean(&direct, filtered) / exact)
        });
        let all: Vec<[f64; 2]> = all.collect();
        // Few rays are a little dark in any case, shared ones more so; by a pixel's own rays they would be .9 %.
        for (filtered, most) in [(0, 0.007), (1, 0.02)] {
            let count = SEEDS as f64;
            let mean = all.iter().map(|own| own[filtered]).sum::<f64>() / count;
            let squares = all.iter().map(|own| (own[filtered] - mean).powi(2)).sum::<f64>();
            let deviation = (squares / (count - 1.0) / count).sqrt();
            assert!(deviation < 0.001, "{deviation} tells nothing");
            assert!((mean - 1.0).abs() < most, "{filtered}: {mean} ± {deviation}");
        }
    }

    /// In a room full of sky, the edges of a patch of sun get many more rays than what the sun does not reach: what
    /// is looked for in the sky and not found there says nothing of the sun, and where all rays to it agree, the
    /// next one is expected to do so.
    #[test]
    fn the_edge_of_a_patch_of_sun_gets_most_rays() {
        let house = made::real::window();
        let specimen = Specimen::surrounded(&house.glb, house.environment, 1000);
        let Specimen { world, lights, cut, .. } = &specimen;
        let camera = &world.scene.cameras[0];
        let visible = VisibleSurfaces::new(world, cut.clone(), camera, [160, 120], 16);
        let seed = Seed { number: 1, well_spread: true };
        let caster = Caster { world, lights, visible: &visible, seed };
        let mut direct = DirectLighting::new(lights, &visible, true, false);
        (0..3).for_each(|_| direct.pass(&caster, f64::INFINITY));
        let (mut edges, mut others) = (Vec::new(), Vec::new());
        for sums in direct.sums.iter().filter(|sums| sums.apart.is_any && sums.known.rays > 0) {
            if sums.known.mixed {
                edges.push(f64::from(sums.rays));
                continue;
            }
            let off = sums.known.blocked_share() - sums.known.first;
            assert!(off.abs() < 1e-3, "{off} of the sun after {} rays", sums.known.rays);
            if !sums.disputed {
                others.push(f64::from(sums.rays));
            }
        }
        assert!(edges.len() >= 20 && others.len() >= 1000, "{} {}", edges.len(), others.len());
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
        assert!(mean(&edges) > 15.0 * mean(&others), "{} {}", mean(&edges), mean(&others));
    }

    /// A lamp lights what the sun does not reach at once, though without anything in between the sun would be most of
    /// the light everywhere: rays that find it hidden leave enough for the lamp.
    #[test]
    fn a_hidden_sun_leaves_rays_for_a_lamp() {
        let room = made::real::lamp_beside_window();
        let specimen = Specimen::surrounded(&room.glb, room.environment, 1000);
        let Specimen { world, lights, .. } = &specimen;
        let visible = specimen.visible();
        let after = |passes: u32, number: u64| {
            let seed = Seed { number, well_spread: true };
            let caster = Caster { world, lights, visible: &visible, seed };
            let mut direct = DirectLighting::new(lights, &visible, true, false);
            (0..passes).for_each(|_| direct.pass(&caster, f64::INFINITY));
            direct
        };
        let light = |direct: &DirectLighting, index| {
            f64::from(importance(direct.irradiance(lights, &visible, index, true).0))
        };
        let exact = after(100, 9);
        let all = 0..visible.fragments.len();
        let shaded: Vec<usize> = all
            .filter(|index| {
                let sums = &exact.sums[*index];
                sums.apart.is_any
                    && sums.by_itself.as_ref().is_some_and(|sun| sun.seen == Rgb::ZERO)
            })
            .collect();
        assert!(shaded.len() >= 300, "{} of {}", shaded.len(), visible.fragments.len());
        let (mut squares, mut sums, mut exact_sums) = (0.0, 0.0, 0.0);
        for seed in 1..=4 {
            let once = after(1, seed);
            for index in &shaded {
                let [own, right] = [&once, &exact].map(|direct| light(direct, *index));
                squares += (own - right).powi(2);
                (sums, exact_sums) = (sums + own, exact_sums + right);
            }
        }
        let count = 4.0 * shaded.len() as f64;
        let off = (squares / count).sqrt() / (exact_sums / count);
        assert!(off < 0.2, "{off}");
        assert!((sums / exact_sums - 1.0).abs() < 0.02, "{}", sums / exact_sums);
    }

    /// Rays of fragments that see the sky through openings say nothing of one that sees it as a whole, however many
    /// these are: a pixel of a window's sill may be the only one of its kind.
    #[test]
    fn rays_of_what_is_lit_in_another_way_do_not_agree_with_ones_own() {
        let specimen = Specimen::furnace();
        let (visible, lights) = (specimen.visible(), &specimen.lights);
        let is_disputed = |middle: usize, is_alone: bool| {
            let mut direct = DirectLighting::new(lights, &visible, true, false);
            for (index, sums) in direct.sums.iter_mut().enumerate() {
                sums.rays = 2;
                match is_alone && index != middle {
                    true => sums.apart.is_any = true,
                    false => (sums.known.rays, sums.known.first) = (2, 0.0),
                }
            }
            direct.mark_disputed(&visible);
            direct.sums[middle].disputed
        };
        let mut count = 0;
        for middle in (0..visible.fragments.len()).step_by(41) {
            let mut others = 0;
            around(&visible, middle, NEIGHBOUR_REACH, |_, _, _| others += 1);
            if others >= ENOUGH_TO_AGREE {
                assert!(is_disputed(middle, true) && !is_disputed(middle, false), "{middle}");
                count += 1;
            }
        }
        assert!(count >= 5, "{count} of {}", visible.fragments.len());
    }
}
