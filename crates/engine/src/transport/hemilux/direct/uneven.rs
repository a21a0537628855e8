//! Light without occlusion where it differs within a pixel, as on a ceiling above a lamp: the mean over many
//! places of it.

use super::shadows::{CHUNK, DirectLighting, IN_PLANE};
use super::sums::ShadowSums;
use crate::emitters::DirectLights;
use crate::radiometry::{Rgb, importance};
use crate::transport::hemilux::fragments::{Fragment, VisibleSurfaces};
use rayon::prelude::*;

/// Where the light without occlusion of adjacent pixels differs by more than this share, it is the mean over
/// so many places at first; in a hasty job, over as many as the first of these says.
const PLACES: [(f32, u32); 2] = [(0.1, 16), (0.5, 64)];
/// Each pass looks at a quarter as many places more, since lamps may be so near that no number is enough.
const PLACES_PER_MORE: u32 = 4;

impl DirectLighting {
    /// Takes the mean over a fragment's places as its light without occlusion where that differs much from
    /// pixel to pixel, as on a ceiling above a lamp, or where a map tilts the normals: its middle does not stand
    /// for all of it there.
    pub(super) fn average_where_uneven(
        &mut self,
        lights: &DirectLights,
        visible: &VisibleSurfaces,
        hasty: bool,
    ) {
        // Light of which the sky is no part is no measure of light of which it is.
        let of = |sums: &ShadowSums| (importance(sums.known.unoccluded), sums.division());
        let light: Vec<(f32, [bool; 2])> = self.sums.iter().map(of).collect();
        let one = |(index, sums): (usize, &mut ShadowSums)| {
            let (own, division) = light[index];
            let mut most = 0.0f32;
            beside(visible, index, |other| {
                let (theirs, other_division) = light[other];
                if division == other_division {
                    most = most.max((theirs - own).abs());
                }
            });
            let fragment = &visible.fragments[index];
            let wanted = PLACES.iter().rev().find(|(from, _)| most > from * own);
            let by_map = || visible.is_mapped(fragment).then_some(PLACES[0].1);
            let Some(wanted) = wanted.map(|(_, wanted)| *wanted).or_else(by_map) else { return };
            let first = if hasty { PLACES[0].1 } else { wanted };
            // The first of a pixel's places are spread about its middle; those of a part of it need not be.
            let first =
                if fragment.share < 1.0 { visible.count(fragment).max(first) } else { first };
            look_at_places(sums, (lights, visible), fragment, first);
            // A lamp may be near one end of it, though not of its neighbours' middles.
            let [_, (much, many)] = PLACES;
            let off = (importance(sums.known.unoccluded) - own).abs();
            sums.more_places = if off > much * own { many } else { wanted } / PLACES_PER_MORE;
        };
        self.sums.par_iter_mut().enumerate().with_min_len(CHUNK).for_each(one);
    }

    /// Looks at the light without occlusion at more places of the fragments where it is not the same everywhere.
    pub(super) fn look_at_more_places(&mut self, lights: &DirectLights, visible: &VisibleSurfaces) {
        let all = self.sums.par_iter_mut().zip(&visible.fragments).with_min_len(CHUNK);
        let uneven = all.filter(|(sums, _)| sums.more_places > 0);
        uneven.for_each(|(sums, fragment)| {
            look_at_places(sums, (lights, visible), fragment, sums.more_places);
        });
    }
}

/// Takes `count` more places of a fragment into the mean that is its light without occlusion.
fn look_at_places(
    sums: &mut ShadowSums,
    (lights, visible): (&DirectLights, &VisibleSurfaces),
    fragment: &Fragment,
    count: u32,
) {
    let at = |n| {
        let (point, normal) = visible.start_of_ray(fragment, n);
        sums.unoccluded(&lights.unoccluded(point, normal))
    };
    let end = sums.places + count;
    let alike: Vec<[Rgb; 2]> = (sums.places..end).filter_map(at).collect();
    if !alike.is_empty() {
        let new = count as f32 / end as f32;
        let one = sums.by_itself.as_ref().map(|one| one.unoccluded);
        let before = [sums.known.unoccluded, one.unwrap_or_default()];
        let mean = |part: usize| {
            let mean = alike.iter().map(|own| own[part]).sum::<Rgb>() / alike.len() as f32;
            before[part] + (mean - before[part]) * new
        };
        let means = [mean(0), mean(1)];
        sums.set_unoccluded(means);
    }
    sums.places = end;
}

/// Calls `each` with the fragments of the four adjacent pixels that lie in the plane of fragment
/// `index`.
fn beside(visible: &VisibleSurfaces, index: usize, mut each: impl FnMut(usize)) {
    let mine = &visible.fragments[index];
    let (pixel, width) = (mine.pixel as usize, visible.width as usize);
    let near = [
        (pixel % width > 0).then(|| pixel - 1),
        (pixel % width + 1 < width).then_some(pixel + 1),
        pixel.checked_sub(width),
        Some(pixel + width).filter(|below| below + 1 < visible.start.len()),
    ];
    for near in near.into_iter().flatten() {
        for other in visible.start[near] as usize..visible.start[near + 1] as usize {
            if visible.fragments[other].normal.dot(mine.normal) > IN_PLANE {
                each(other);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};
    use crate::scene::environment::{PlacedMap, Sky, Sun};
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use crate::scene::sky_map::SkyMap;
    use crate::scene::{Camera, Environment, Material, NormalMap, Scene};
    use crate::scene::{Texture, TextureSlot, Triangle, Vertex};
    use crate::transport::hemilux::direct::caster::Caster;
    use crate::transport::hemilux::specimen::{SEED, Specimen};
    use glam::{Vec2, Vec3, Vec4};
    use std::f32::consts::{FRAC_1_SQRT_2, PI};
    use std::sync::Arc;

    /// Near a lamp, where the light differs from one end of a pixel to the other.
    #[test]
    fn light_without_occlusion_is_that_of_all_of_a_pixel() {
        let specimen = Specimen::new(&crate::scene::made::cornell(), 300);
        let (visible, lights) = (specimen.visible(), &specimen.lights);
        let direct = DirectLighting::new(lights, &visible, true, false);
        let (mut uneven, mut squares, mut sum) = (0, [0.0f32; 2], 0.0);
        for (sums, fragment) in direct.sums.iter().zip(&visible.fragments) {
            let light = |point| lights.unoccluded(point, fragment.shading_normal).irradiance;
            const PLACES: u32 = 256;
            let all = (0..PLACES).map(|n| light(visible.sample_point(fragment, n)));
            let mean = importance(all.sum::<Rgb>() / PLACES as f32);
            let off = [light(visible.middle_point(fragment)), sums.known.unoccluded]
                .map(|own| importance(own) / mean - 1.0);
            if off[0].abs() > 0.05 {
                uneven += 1;
                (0..2).for_each(|k| squares[k] += off[k] * off[k]);
                sum += off[1];
            }
        }
        assert!(uneven >= 50, "{uneven}");
        assert!(squares[1] < 0.1 * squares[0], "{squares:?}");
        // Places that are not spread about the pixel's middle make a whole picture too dark.
        let mean = sum / uneven as f32;
        let chance = (squares[1] / uneven as f32).sqrt() / (uneven as f32).sqrt();
        assert!(mean.abs() < 2.0 * chance, "{mean}, {chance} by chance");
    }

    /// So near to a lamp that no number of places is enough at first: the more passes, the nearer.
    #[test]
    fn every_pass_looks_at_more_places() {
        let specimen = Specimen::new(&crate::scene::made::hall(), 300);
        let (visible, lights) = (specimen.visible(), &specimen.lights);
        let mut direct = DirectLighting::new(lights, &visible, true, false);
        const PLACES: u32 = 4096;
        let mean = |fragment: &Fragment| {
            let light = |n| {
                let point = visible.sample_point(fragment, n);
                importance(lights.unoccluded(point, fragment.shading_normal).irradiance)
            };
            (0..PLACES).map(light).sum::<f32>() / PLACES as f32
        };
        let uneven =
            (0..visible.fragments.len()).filter(|index| direct.sums[*index].more_places > 4);
        let uneven: Vec<usize> = uneven.take(400).collect();
        let exact: Vec<f32> = uneven.iter().map(|index| mean(&visible.fragments[*index])).collect();
        let off = |direct: &DirectLighting| {
            let off = |(index, exact): (&usize, &f32)| {
                (importance(direct.sums[*index].known.unoccluded) / exact - 1.0).powi(2)
            };
            uneven.iter().zip(&exact).map(off).sum::<f32>() / uneven.len() as f32
        };
        let first = off(&direct);
        (0..32).for_each(|_| direct.look_at_more_places(lights, &visible));
        let last = off(&direct);
        assert!(uneven.len() > 100 && first > 0.0, "{} fragments, {first}", uneven.len());
        assert!(last < 0.2 * first, "{first} before, {last} after");
    }

    /// A map that tilts normals by 45° to the left and to the right.
    fn ribs() -> (Texture, NormalMap) {
        let (width, height, texels) = (2, 1, vec![[218, 128, 218, 255], [37, 128, 218, 255]]);
        let slot = TextureSlot { nearest: true, ..TextureSlot::data(0) };
        (Texture { width, height, texels }, NormalMap { slot, scale: 1.0 })
    }

    /// A vertex of a ground with many such ribs in each pixel.
    fn on_ribs(position: Vec3) -> Vertex {
        Vertex {
            uv: [Vec2::new(position.x, position.z) * 4.0 / 3.0; 2],
            tangent: Vec4::new(1.0, 0.0, 0.0, 1.0),
            ..Vertex::new(position, Vec3::Y)
        }
    }

    /// A ribbed ground under a sky of radiance 1 + sinθ, θ the height above the horizon.
    fn ribbed(sun: Option<Sun>) -> Specimen {
        let corner = |x: f32, z: f32| on_ribs(30.0 * Vec3::new(x, 0.0, z));
        let (texture, ribs) = ribs();
        let grey = Material::lambertian("grey", Rgb::splat(0.5));
        let eye = Vec3::new(0.0, 9.0, 9.0);
        let scene = Scene {
            vertices: vec![
                corner(-1.0, 1.0),
                corner(1.0, 1.0),
                corner(1.0, -1.0),
                corner(-1.0, -1.0),
            ],
            triangles: [[0, 1, 2], [0, 2, 3]]
                .map(|vertices| Triangle { vertices, material: 0 })
                .to_vec(),
            materials: vec![Material { normal_map: Some(ribs), ..grey }],
            textures: vec![texture],
            cameras: vec![Camera::look_at("camera", eye, Vec3::ZERO, Vec3::Y, 0.9)],
            ..Scene::default()
        };
        let map = SkyMap::from_fn(64, 32, |direction| Rgb::splat(1.0 + direction.y));
        let map = Arc::new(map.expect("it shines"));
        let sky = Sky::Map(PlacedMap { map, rotation: 0.0, scale: Rgb::ONE });
        Specimen::of(scene, Environment { sky, sun, ..Environment::default() }, 300)
    }

    /// Light of these fragments, summed: what was found, and what single rays see arrive.
    fn found_and_arrived(
        direct: &DirectLighting,
        &Caster { world, lights, visible, .. }: &Caster<'_>,
        fragments: &[usize],
    ) -> [f32; 2] {
        let mut random = Numbers::new(5, Stream::Light, 0);
        let (mut found, mut arrived) = (0.0, 0.0);
        const RAYS: u32 = 512;
        for index in fragments {
            found += importance(direct.irradiance(lights, visible, *index, true).0);
            for n in 0..RAYS {
                let (point, normal) = visible.start_of_ray(&visible.fragments[*index], n);
                let xi = Vec3::from_array([0; 3].map(|_| random.uniform()));
                let sample = lights.sample_by_shadow_ray(world, point, normal, xi);
                arrived += importance(sample.arrived()) / RAYS as f32;
            }
        }
        [found, arrived]
    }

    /// A sun that is above the horizon of every other rib shines on half of them, under an open sky as in a room with
    /// a lamp that it hardly reaches.
    #[test]
    fn ribs_turn_away_from_the_sun() {
        let sun = Sun::towards(Vec3::new(0.8, 0.6, 0.0), Rgb::splat(9.0), 0.005);
        let room = made::real::lamp_beside_window();
        let mut scene = import(&room.glb, &Resources::default(), &ImportLimits::default()).unwrap();
        let floor = scene.materials.iter().position(|material| material.name == "floor").unwrap();
        let (texture, mut ribs) = ribs();
        ribs.slot.texture = scene.textures.len() as u32;
        scene.textures.push(texture);
        scene.materials[floor].normal_map = Some(ribs);
        for triangle in scene.triangles.iter().filter(|own| own.material == floor as u32) {
            for vertex in triangle.vertices {
                let own = &mut scene.vertices[vertex as usize];
                *own = on_ribs(own.position);
            }
        }
        let inside = Specimen::of(scene, room.environment, 1000);
        for (specimen, is_room) in [(ribbed(Some(sun)), false), (inside, true)] {
            let (visible, lights, world) = (specimen.visible(), &*specimen.lights, &specimen.world);
            let mut direct = DirectLighting::new(lights, &visible, true, false);
            let caster = Caster { world, lights, visible: &visible, seed: SEED };
            (0..24).for_each(|_| direct.pass(&caster, f64::INFINITY));
            let ribbed = (0..visible.fragments.len()).filter(|index| {
                visible.is_mapped(&visible.fragments[*index])
                    && direct.sums[*index].division() == [true, is_room]
            });
            let ribbed: Vec<usize> = ribbed.collect();
            assert!(ribbed.len() >= 50, "{}", ribbed.len());
            let [found, arrived] = found_and_arrived(&direct, &caster, &ribbed);
            assert!((found / arrived - 1.0).abs() < 0.02, "{is_room}: {found} {arrived}");
        }
    }

    /// Where a map tilts the normals within a pixel, its light is the mean over them, not that of their mean:
    /// E(n) = π + 2π/3 n_y without occlusion, and what of it is above the ground arrives.
    #[test]
    fn tilted_normals_have_light_of_their_own() {
        let specimen = ribbed(None);
        let (visible, lights, world) = (specimen.visible(), &*specimen.lights, &specimen.world);
        let mut direct = DirectLighting::new(lights, &visible, true, false);
        let caster = Caster { world, lights, visible: &visible, seed: SEED };
        (0..24).for_each(|_| direct.pass(&caster, f64::INFINITY));
        let all: Vec<usize> = (0..visible.fragments.len()).collect();
        let known = |index: &usize| importance(direct.sums[*index].known.unoccluded);
        let unoccluded: f32 = all.iter().map(known).sum();
        let [found, arrived] = found_and_arrived(&direct, &caster, &all);
        let count = visible.fragments.len() as f32;
        let exact = PI + 2.0 * PI / 3.0 * FRAC_1_SQRT_2;
        assert!((unoccluded / count / exact - 1.0).abs() < 0.01, "{} {exact}", unoccluded / count);
        let of_mean = PI + 2.0 * PI / 3.0;
        assert!(of_mean > 1.1 * exact, "the mean normal gets more");
        assert!((found / arrived - 1.0).abs() < 0.01, "{found} {arrived}");
    }
}
