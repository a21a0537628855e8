//! Which fragments' lobes the shadow rays of direct light tell of, and what these show of narrow lights.

use super::caster::Caster;
use super::highlights::Highlights;
use super::shadows::DirectLighting;
use super::sums::ShadowSums;
use crate::radiometry::{Rgb, importance};
use crate::transport::hemilux::fragments::VisibleSurfaces;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Places at which a lobe is looked at in the first pass, and in each later one where these do not do.
const FIRST_PLACES: u32 = 8;
const MORE_PLACES: u32 = 4;
/// Standard error of the highlights over all direct light of their fragment with which places do.
const ENOUGH: f32 = 0.003;
/// Most places.
const MOST_PLACES: u32 = 1 << 16;

impl DirectLighting {
    /// Finds the highlights of these lobes, polished or not, too, of so many narrow lights.
    pub fn with_highlights(
        mut self,
        visible: &VisibleSurfaces,
        lobes: impl Iterator<Item = (u32, bool)>,
        count: usize,
    ) -> Self {
        for (lobe, is_polished) in lobes {
            let fragment = visible.lobes[lobe as usize].fragment as usize;
            self.sums[fragment].highlights =
                Some(Box::new(Highlights::new((lobe, is_polished), count)));
        }
        self
    }

    /// Looks at lobes that narrow lights shine on where that is not known well enough.
    pub(super) fn look_at_highlights(&mut self, caster: &Caster<'_>) {
        let fragments = caster.visible.fragments.par_iter();
        self.sums.par_iter_mut().zip(fragments).with_min_len(256).for_each(|(sums, fragment)| {
            let diffuse = fragment.diffuse * sums.known.unoccluded / PI;
            let is_dark = sums.is_dark();
            let Some(highlights) = sums.highlights.as_mut().filter(|_| !is_dark) else { return };
            let (open, variance) = highlights.open();
            let enough = ENOUGH * importance(open + diffuse).abs();
            match highlights.sums.places {
                0 if highlights.is_polished => highlights.look_at_cells(caster),
                0 => highlights.look(caster, FIRST_PLACES),
                places
                    if !highlights.is_polished
                        && variance > enough * enough
                        && places < MOST_PLACES =>
                {
                    highlights.look(caster, MORE_PLACES);
                }
                _ => {}
            }
        });
    }

    /// Radiance that a fragment's lobe reflects of narrow lights, and its variance; none where lobe rays find that.
    pub fn highlights(&self, index: usize) -> (Rgb, Rgb) {
        let sums = &self.sums[index];
        let all = if sums.known.rays > 0 { sums.known.share(true) } else { Rgb::ONE };
        let own = sums.highlights.as_ref();
        own.map_or_else(Default::default, |own| own.radiance(all.clamp(Rgb::ZERO, Rgb::ONE)))
    }

    /// Radiance of narrow lights that polished surfaces mirror, by pixel; empty where there are none.
    pub fn mirrored(&self, visible: &VisibleSurfaces) -> Vec<Rgb> {
        let is_polished = |sums: &ShadowSums| {
            sums.highlights.as_ref().is_some_and(|highlights| highlights.is_polished)
        };
        let mut mirrored = Vec::new();
        for (index, (sums, fragment)) in self.sums.iter().zip(&visible.fragments).enumerate() {
            if is_polished(sums) {
                mirrored.resize(visible.shine.len(), Rgb::ZERO);
                mirrored[fragment.pixel as usize] +=
                    fragment.share * self.highlights(index).0.max(Rgb::ZERO);
            }
        }
        mirrored
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::{Reader, Writer};
    use crate::sampling::Seed;
    use crate::scene::environment::{Environment, Sky, Sun};
    use crate::scene::{Camera, LightKind, Material, PunctualLight, Scene, Triangle, Vertex};
    use crate::surface::Reflection;
    use crate::transport::hemilux::gloss::Gloss;
    use crate::transport::hemilux::specimen::Specimen;
    use glam::Vec3;

    const SEEDS: u64 = 8;
    const PASSES: u32 = 6;
    const PLACES: u32 = 256;

    /// Its diffuse part loses nothing to the lobe.
    fn phong() -> Material {
        Material::phong("polished", Rgb::splat(0.3), 0.1, 20.0)
    }

    /// A polished ground under a sky, a sun and a bulb, and a roof that keeps some of the sun off.
    fn ground(polished: Material, has_bulb: bool) -> Specimen {
        let square = |half: f32, y: f32| {
            let corner =
                |x: f32, z: f32| Vertex::new(half * Vec3::new(x, 0.0, z) + y * Vec3::Y, Vec3::Y);
            [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]
        };
        let triangle = |(vertices, material)| Triangle { vertices, material };
        let bulb = PunctualLight {
            name: "bulb".into(),
            kind: LightKind::Point,
            position: Vec3::new(-3.0, 2.0, -3.0),
            direction: -Vec3::Y,
            intensity: Rgb::new(9.0, 6.0, 3.0),
            range: None,
        };
        let of = [([0, 1, 2], 0), ([0, 2, 3], 0), ([4, 5, 6], 1), ([4, 6, 7], 1)];
        let scene = Scene {
            vertices: [square(12.0, 0.0), square(2.0, 3.0)].concat(),
            triangles: of.map(triangle).to_vec(),
            materials: vec![polished, Material::lambertian("roof", Rgb::splat(0.2))],
            lights: if has_bulb { vec![bulb] } else { Vec::new() },
            cameras: vec![Camera::look_at(
                "camera",
                Vec3::new(0.0, 4.0, 9.0),
                Vec3::ZERO,
                Vec3::Y,
                0.9,
            )],
            ..Scene::default()
        };
        let sun = Sun::towards(Vec3::new(0.1, 1.0, -1.6), Rgb::splat(6.0), 0.005);
        let sky = Sky::Uniform(Rgb::splat(0.2));
        Specimen::of(scene, Environment { sky, sun: Some(sun), ..Environment::none() }, 1000)
    }

    fn lit(
        specimen: &Specimen,
        visible: &VisibleSurfaces,
        (seed, leaves_narrow): (u64, bool),
    ) -> (DirectLighting, Gloss) {
        let Specimen { world, lights, .. } = specimen;
        let seed = Seed { number: seed, well_spread: true };
        let mut direct = DirectLighting::new(lights, visible, true, false);
        let mut gloss = Gloss::new(world, visible, false);
        if leaves_narrow {
            gloss = gloss.without_narrow(world, visible, lights.narrow_up_to());
            direct = direct.with_highlights(visible, gloss.leaving_narrow(), lights.narrow_count());
        }
        for _ in 0..PASSES {
            direct.pass(&Caster { world, lights, visible, seed }, f64::INFINITY);
            gloss.pass(&specimen.coarse, visible, (seed, false), f64::INFINITY);
        }
        gloss.share(visible);
        (direct, gloss)
    }

    /// Importance of what each fragment's lobe shows.
    fn shown(visible: &VisibleSurfaces, (direct, gloss): &(DirectLighting, Gloss)) -> Vec<f64> {
        let of = |(index, (mean, _)): (usize, &(Rgb, Rgb))| {
            f64::from(importance(*mean + direct.highlights(index).0))
        };
        gloss.of_fragments(visible).iter().enumerate().map(of).collect()
    }

    /// Mean of the sum over fragments, its standard error, and the variance of fragments over seeds.
    fn over_seeds(all: &[Vec<f64>]) -> [f64; 3] {
        let count = all.len() as f64;
        let sums: Vec<f64> = all.iter().map(|one| one.iter().sum()).collect();
        let mean = sums.iter().sum::<f64>() / count;
        let scatter = sums.iter().map(|sum| (sum - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let of_fragment = |index: usize| {
            let mean = all.iter().map(|one| one[index]).sum::<f64>() / count;
            all.iter().map(|one| (one[index] - mean).powi(2)).sum::<f64>() / (count - 1.0)
        };
        [mean, (scatter / count).sqrt(), (0..all[0].len()).map(of_fragment).sum()]
    }

    /// Shadow rays and lobes say the same of narrow lights as lobe rays do, with a fraction of their noise.
    /// Light that is counted by both is noticed.
    #[test]
    fn highlights_are_those_that_lobe_rays_find() {
        let specimen = ground(phong(), true);
        let visible = specimen.visible();
        assert!(specimen.lights.narrow_count() == 2 && visible.lobes.len() > 200);
        let of = |leaves_narrow| -> Vec<Vec<f64>> {
            let seeds = 1..=SEEDS;
            let of_seed = |seed| lit(&specimen, &visible, (seed, leaves_narrow));
            seeds.map(|seed| shown(&visible, &of_seed(seed))).collect()
        };
        let [[by_rays, error, noise], [own, own_error, own_noise]] =
            [false, true].map(|leaves_narrow| over_seeds(&of(leaves_narrow)));
        let chance = error.hypot(own_error);
        assert!((own - by_rays).abs() < 3.5 * chance, "{own} {by_rays}, chance {chance}");
        assert!(own_noise < 0.2 * noise, "{own_noise} of {noise}");
        let (direct, _) = lit(&specimen, &visible, (1, true));
        let (_, gloss) = lit(&specimen, &visible, (1, false));
        let twice: f64 = shown(&visible, &(direct, gloss)).iter().sum();
        assert!((twice - by_rays).abs() > 10.0 * chance, "{twice} {by_rays}, chance {chance}");
    }

    /// How far highlights are said to be off by shadows is about how far they are, over seeds.
    #[test]
    fn what_they_are_off_is_known() {
        for has_bulb in [false, true] {
            let specimen = ground(phong(), has_bulb);
            let visible = specimen.visible();
            let mut all: Vec<DirectLighting> =
                (1..=SEEDS).map(|seed| lit(&specimen, &visible, (seed, true)).0).collect();
            // Places are the same with every seed.
            for sums in all.iter_mut().flat_map(|direct| &mut direct.sums) {
                if let Some(highlights) = &mut sums.highlights {
                    highlights.sums.squares = 0.0;
                }
            }
            let (mut said, mut scatter) = (0.0, 0.0);
            for index in 0..visible.fragments.len() {
                let own: Vec<(Rgb, Rgb)> =
                    all.iter().map(|direct| direct.highlights(index)).collect();
                let mean = own.iter().map(|(radiance, _)| *radiance).sum::<Rgb>() / SEEDS as f32;
                let off = own.iter().map(|(own, _)| own.distance_squared(mean)).sum::<f32>();
                scatter += off / (SEEDS - 1) as f32;
                said += own.iter().map(|(_, off)| off.element_sum()).sum::<f32>() / SEEDS as f32;
            }
            println!("bulb {has_bulb}: said {said}, is {scatter}");
            assert!((0.5..3.0).contains(&(said / scatter)), "bulb {has_bulb}: {said} {scatter}");
        }
    }

    /// Where a roof hides the sun, what its highlight would be at other places says nothing of the error.
    #[test]
    fn a_hidden_sun_adds_no_noise() {
        for has_bulb in [false, true] {
            let specimen = ground(phong(), has_bulb);
            let visible = specimen.visible();
            let (direct, _) = lit(&specimen, &visible, (1, true));
            let (mut hidden, mut said, mut open) = (0, 0.0, 0.0);
            for (index, sums) in direct.sums.iter().enumerate() {
                let Some(own) = sums.highlights.as_ref().filter(|own| own.hides(0)) else {
                    continue;
                };
                hidden += 1;
                open += own.open().1;
                said += direct.highlights(index).1.element_sum() / 3.0;
            }
            println!("bulb {has_bulb}: {hidden} fragments, open {open}, said {said}");
            assert!(hidden > 20 && open > 0.0, "{hidden} {open}");
            assert!(said <= if has_bulb { 0.3 * open } else { 0.0 }, "{said} of {open}");
        }
    }

    #[test]
    fn they_come_back() {
        let specimen = ground(phong(), true);
        let visible = specimen.visible();
        let (direct, gloss) = lit(&specimen, &visible, (1, true));
        let mut to = Writer::new(u64::MAX);
        direct.save(&mut to);
        let bytes = to.finish().expect("there is room");
        let empty = |count| {
            let all = DirectLighting::new(&specimen.lights, &visible, true, false);
            all.with_highlights(&visible, gloss.leaving_narrow(), count)
        };
        let mut again = empty(2);
        again.restore(&mut Reader::new(&bytes)).expect("sound");
        let all = || 0..visible.fragments.len();
        assert!(all().any(|index| direct.highlights(index).0 != Rgb::ZERO));
        assert!(all().all(|index| direct.highlights(index) == again.highlights(index)));
        assert!(empty(3).restore(&mut Reader::new(&bytes)).is_err(), "of other lights");
    }

    /// Of sunlight a surface reflects what its model says of that direction, Fresnel's loss of the diffuse part
    /// included. What the lobe takes from that part of light without direction is far off here.
    #[test]
    fn sunlight_is_reflected_by_the_model() {
        let plastic =
            Material { base_color: Rgb::splat(0.8), roughness: 0.4, ..Material::default() };
        let specimen = ground(plastic, false);
        let (visible, world) = (specimen.visible(), &specimen.world);
        let (mut direct, _) = lit(&specimen, &visible, (1, true));
        // At the same places as below.
        let seed = Seed { number: 1, well_spread: true };
        let caster = Caster { world, lights: &specimen.lights, visible: &visible, seed };
        for highlights in direct.sums.iter_mut().filter_map(|sums| sums.highlights.as_mut()) {
            highlights.look(&caster, PLACES - highlights.sums.places);
        }
        let (mut squares, mut count) = ([0.0; 2], 0);
        for lobe in &visible.lobes {
            let index = lobe.fragment as usize;
            let (known, fragment) = (&direct.sums[index].known, &visible.fragments[index]);
            if known.share(true) != Rgb::ONE || fragment.share < 1.0 {
                continue;
            }
            let even = fragment.diffuse / PI;
            let [mut model, mut split] = [0.0; 2];
            for place in 0..PLACES {
                let surface = visible.surface(world, lobe, (place, place));
                let viewer = visible.frame.towards_eye(surface.spot.point);
                // The middle of its disk.
                let sun = specimen.lights.narrow(0, surface.start(), [0.0; 2]);
                let (sun, irradiance) = sun.expect("it shines");
                let parts = surface.reflection().evaluate(viewer, sun);
                let of = |reflected: Rgb| importance(reflected * irradiance * sun.y);
                model += of(parts.both()) / PLACES as f32;
                split += of(even + parts.lobe * fragment.lobe_factor) / PLACES as f32;
            }
            let own = importance(even * known.unoccluded + direct.highlights(index).0);
            for (square, found) in squares.iter_mut().zip([own, split]) {
                *square += (found / model - 1.0).powi(2);
            }
            count += 1;
        }
        let [rms, by_lobe] = squares.map(|sum: f32| (sum / count as f32).sqrt());
        println!("{count} fragments: off by {rms:.4}; by the lobe {by_lobe:.4}");
        assert!(count > 100 && rms < 0.001, "{count} {rms}");
        assert!(by_lobe > 0.008, "{by_lobe}");
    }
}
