//! Textures of pixels that see one surface, read ever more finely.
//!
//! What is rasterised reads textures over squares of a pixel, 4 × 4 at most, each by a few places of a
//! smaller copy. What that blurs over the rims of squares and pixels is an error that no ray takes away.
//! So the squares are halved, all over the picture, once that error counts, and halved again. A few
//! pixels are always one step ahead: they say how far off the others are.

use super::band::{SeenPart, varies};
use super::edges::Edges;
use super::{Fragment, VisibleSurfaces};
use crate::hemicube::item;
use crate::patches::FacetIndex;
use crate::radiometry::Rgb;
use glam::Vec2;
use rayon::prelude::*;
use std::time::Instant;

/// Pixels that are a step ahead.
const AHEAD: usize = 512;
/// Error of textures over what half as long squares change: these leave half of it, mostly in the same pixels.
const STILL_OFF: f64 = 1.3;
/// How often squares are halved at most: then a pixel has 4,096 of them.
pub const MOST_HALVINGS: u32 = 4;
/// Albedo of lobes from which on what they show tells how much more they would show by another albedo.
const LEAST_ALBEDO: f32 = 1e-4;

/// The pixels whose textures are read more finely, and how finely.
pub struct Textures {
    /// The fragments that fill these.
    fragments: Vec<u32>,
    /// How often squares were halved.
    halvings: u32,
    /// Of some of the fragments, evenly spread.
    ahead: Vec<Ahead>,
    /// What reading one of their squares took.
    seconds_each: f64,
}

/// What squares half as long change of a fragment.
pub struct Ahead {
    /// Its index.
    pub fragment: usize,
    /// Change of its diffuse albedo.
    pub diffuse: Rgb,
    /// Change of the factor of its lobes times their albedo, over that albedo.
    pub lobe_factor: Rgb,
    /// Change of what comes through from its other side.
    pub passed: Rgb,
    /// Change of the radiance that it emits.
    pub shine: Rgb,
}

/// What is read over a pixel.
#[derive(Clone, Copy, Default)]
struct Reading {
    diffuse: Rgb,
    lobe_factor: Rgb,
    lobe_albedo: Rgb,
    passed: Rgb,
    shine: Rgb,
}

impl Textures {
    /// Those of a picture as rasterised, but at its edges, where rays read them.
    pub fn new(visible: &VisibleSurfaces, edges: &Edges) -> Self {
        let mut is_inside = vec![true; visible.shine.len()];
        edges.pixels().for_each(|pixel| is_inside[pixel as usize] = false);
        let of = |pixel: u32| {
            let filling = visible.filling(pixel).flatten()?;
            let is_one = is_inside[pixel as usize] && visible.has_textures(filling);
            is_one.then_some(visible.start[pixel as usize])
        };
        let pixels = (0..visible.shine.len() as u32).into_par_iter().with_min_len(1024);
        let fragments = pixels.filter_map(of).collect();
        let mut own = Self { fragments, halvings: 0, ahead: Vec::new(), seconds_each: 0.0 };
        own.look_ahead(visible);
        own
    }

    /// How often squares were halved.
    pub fn halvings(&self) -> u32 {
        self.halvings
    }

    /// Squares to be read if they are halved once more: 16 a pixel at first.
    pub fn next_squares(&self) -> f64 {
        self.squares_ahead() * self.fragments.len() as f64
    }

    /// Squares of a pixel that is a step ahead.
    fn squares_ahead(&self) -> f64 {
        16.0 * 4f64.powi(self.halvings as i32 + 1)
    }

    /// Seconds that these would take.
    pub fn next_seconds(&self) -> f64 {
        self.seconds_each * self.next_squares()
    }

    /// What halving the squares would change of some of the fragments, and what the square of that is to be
    /// multiplied by for the squared error of all: by how many each stands for, and for what half as long
    /// squares are off themselves.
    pub fn ahead(&self) -> (&[Ahead], f64) {
        let each = self.fragments.len() as f64 / self.ahead.len().max(1) as f64;
        (&self.ahead, STILL_OFF * STILL_OFF * each)
    }

    /// Halves the squares so often altogether.
    pub fn halve(&mut self, visible: &mut VisibleSurfaces, halvings: u32) {
        if halvings == self.halvings || self.fragments.is_empty() {
            return;
        }
        self.halvings = halvings;
        let known = &*visible;
        let read = |index: &u32| known.reading(*index as usize, halvings);
        let readings: Vec<Reading> = self.fragments.par_iter().with_min_len(64).map(read).collect();
        for (index, read) in self.fragments.iter().zip(readings) {
            let index = *index as usize;
            let beyond = visible.beyond(index);
            let fragment = &mut visible.fragments[index];
            (fragment.diffuse, fragment.lobe_factor) = (read.diffuse, read.lobe_factor);
            fragment.lobe_albedo = fragment.lobe_albedo.map(|_| read.lobe_albedo);
            visible.shine[fragment.pixel as usize] = read.shine;
            if let Some(beyond) = beyond {
                visible.fragments[beyond].diffuse = read.passed;
            }
        }
        self.look_ahead(visible);
    }

    /// Reads some pixels over squares half as long.
    fn look_ahead(&mut self, visible: &VisibleSurfaces) {
        let (began, step) = (Instant::now(), self.fragments.len().div_ceil(AHEAD).max(1));
        let ahead = |index: &u32| {
            let index = *index as usize;
            let read = visible.reading(index, self.halvings + 1);
            let fragment = &visible.fragments[index];
            let beyond = visible.beyond(index).map(|beyond| visible.fragments[beyond].diffuse);
            let albedo = fragment.lobe_albedo.unwrap_or(read.lobe_albedo);
            let times = ratio(read.lobe_albedo, albedo);
            Ahead {
                fragment: index,
                diffuse: read.diffuse - fragment.diffuse,
                lobe_factor: read.lobe_factor * times - fragment.lobe_factor,
                passed: beyond.map_or(Rgb::ZERO, |before| read.passed - before),
                shine: read.shine - visible.shine[fragment.pixel as usize],
            }
        };
        let some: Vec<u32> = self.fragments.iter().step_by(step).copied().collect();
        self.ahead = some.par_iter().with_min_len(16).map(ahead).collect();
        let squares = self.squares_ahead() * some.len().max(1) as f64;
        self.seconds_each = began.elapsed().as_secs_f64() / squares;
    }
}

/// What the radiance of lobes is multiplied by where their albedo becomes another one; where nothing was reflected
/// before, what they showed is no guide, and 1.
fn ratio(albedo: Rgb, before: Rgb) -> Rgb {
    Rgb::select(before.cmpgt(Rgb::splat(LEAST_ALBEDO)), albedo / before, Rgb::ONE)
}

impl VisibleSurfaces {
    /// Whether what a fragment reflects varies over it. What is clear is seen by rays.
    fn has_textures(&self, fragment: &Fragment) -> bool {
        let world = &*self.placing.world;
        let source = item::decode(fragment.code).map(|(facet, _)| FacetIndex(facet));
        let source = source.map(|facet| self.cut.source(facet));
        source.is_some_and(|source| varies(world, source) && !world.is_clear(source))
    }

    /// What is read over the pixel that a fragment fills, by squares that were halved so often.
    fn reading(&self, index: usize, halvings: u32) -> Reading {
        let world = &*self.placing.world;
        let fragment = &self.fragments[index];
        let at_first = self.squares_of(world, fragment.pixel, fragment.code).len();
        let along = (at_first as f32).sqrt().round() as u32 * (1 << halvings);
        let side = (along as f32).recip();
        let place = |at: u32| (at as f32 + 0.5) * side - 0.5;
        let is_translucent = self.has_beyond();
        let (mut sum, mut count) = (Reading::default(), 0.0);
        let mut facet = self.facet_of(fragment.code);
        for square in 0..along * along {
            let offset = Vec2::new(place(square % along), place(square / along));
            if !fragment.has_one_facet() {
                let Some(code) = self.covering(fragment, (fragment.code, offset)) else { continue };
                if facet.as_ref().is_none_or(|(known, ..)| *known != code) {
                    facet = self.facet_of(code);
                }
            }
            let Some((code, (number, back), placed)) = &facet else { continue };
            let own = (*number, *back, &**placed);
            let seen = || SeenPart::at(offset, side);
            let means = self.means(world, own, fragment.pixel, seen());
            sum.diffuse += means.diffuse;
            sum.lobe_factor += means.lobe_factor;
            sum.lobe_albedo += means.lobe_albedo;
            sum.shine += means.shine;
            if is_translucent {
                sum.passed += self.passed(world, fragment.pixel, *code, seen());
            }
            count += 1.0;
        }
        if count == 0.0 {
            let Fragment { diffuse, lobe_factor, pixel, .. } = *fragment;
            let lobe_albedo = fragment.lobe_albedo.unwrap_or_default();
            let passed = self.beyond(index).map(|beyond| self.fragments[beyond].diffuse);
            let (passed, shine) = (passed.unwrap_or_default(), self.shine[pixel as usize]);
            return Reading { diffuse, lobe_factor, lobe_albedo, passed, shine };
        }
        Reading {
            diffuse: sum.diffuse / count,
            lobe_factor: sum.lobe_factor / count,
            lobe_albedo: sum.lobe_albedo / count,
            passed: sum.passed / count,
            shine: sum.shine / count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rays::Eye;
    use crate::scene::environment::{Environment, Sky};
    use crate::scene::made;
    use crate::scene::part::Part;
    use crate::transport::hemilux::fragments::MOST_SAMPLES;
    use crate::transport::hemilux::specimen::Specimen;
    use glam::Vec3;

    /// Places along a pixel at which the texture is read for the exact mean.
    const POINTS: u32 = 256;

    /// The mean diffuse albedo that a pixel sees, by points.
    fn exact(visible: &VisibleSurfaces, fragment: usize) -> Rgb {
        let pixel = visible.fragments[fragment].pixel;
        let world = &visible.placing.world;
        let at = |at: u32| (at as f32 + 0.5) / POINTS as f32 - 0.5;
        let points = (0..POINTS * POINTS).map(|k| Vec2::new(at(k % POINTS), at(k / POINTS)));
        let albedo = |offset| {
            let (origin, direction) = visible.ray(pixel, offset);
            let hit = world.rays.closest(Eye::Camera, origin, direction).expect("a floor");
            let point = Part { at: Vec2::new(hit.u, hit.v), edges: [Vec2::ZERO; 2] };
            let place = (hit.triangle, &point);
            let parameters = world.parameters_over(&visible.pyramids, place, Vec3::Y, 1.0);
            parameters.diffuse_and_lobe_factor(Vec3::Y, -direction)[0]
        };
        points.map(albedo).sum::<Rgb>() / (POINTS * POINTS) as f32
    }

    fn root_mean_square(all: impl Iterator<Item = Rgb>) -> f32 {
        let (sum, count) = all.fold((0.0, 0), |(sum, n), own| (sum + own.length_squared(), n + 1));
        (sum / count as f32).sqrt()
    }

    /// Where the same texture says what is emitted, that changes as the albedo does.
    #[test]
    fn what_shines_is_foreseen_too() {
        let Specimen { world, .. } =
            Specimen::surrounded(&made::checker(4.0), Environment::studio(), 500);
        let mut scene = world.scene.as_ref().clone();
        for material in &mut scene.materials {
            material.emission = material.base_color;
            material.emission_texture = material.base_color_texture;
        }
        let Specimen { world, cut, .. } = Specimen::of(scene, Environment::studio(), 500);
        let camera = &world.scene.cameras[0];
        let visible = VisibleSurfaces::new(&world, cut, camera, [24, 20], MOST_SAMPLES);
        let textures = Textures::new(&visible, &Edges::new(&visible));
        let (ahead, _) = textures.ahead();
        let [shine, diffuse] = [|own: &Ahead| own.shine, |own: &Ahead| own.diffuse]
            .map(|of| root_mean_square(ahead.iter().map(of)));
        assert!(diffuse > 0.0 && (0.8..1.25).contains(&(shine / diffuse)), "{shine} {diffuse}");
    }

    /// Lobes that reflected nothing by coarse squares and something by fine ones do not make the error infinite.
    #[test]
    fn what_reflected_nothing_is_no_guide() {
        let times = ratio(Rgb::new(0.2, 0.2, 0.3), Rgb::new(0.1, 0.0, 0.6));
        assert!((times - Rgb::new(2.0, 1.0, 0.5)).length() < 1e-6, "{times}");
    }

    /// With squares half as long what is left is far less, and what is left is foreseen.
    #[test]
    fn smaller_squares_are_nearer_to_the_mean() {
        let surroundings = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
        let Specimen { world, cut, .. } =
            Specimen::surrounded(&made::checker(4.0), surroundings, 500);
        let camera = &world.scene.cameras[0];
        let mut visible = VisibleSurfaces::new(&world, cut, camera, [24, 20], MOST_SAMPLES);
        let edges = Edges::new(&visible);
        let mut textures = Textures::new(&visible, &edges);
        assert!(textures.fragments.len() > 150, "{}", textures.fragments.len());
        let of = |index: &u32| exact(&visible, *index as usize);
        let exact: Vec<Rgb> = textures.fragments.par_iter().map(of).collect();
        let mut left = Vec::new();
        for halvings in 0..3 {
            textures.halve(&mut visible, halvings);
            let own = textures.fragments.iter().zip(&exact);
            let off = own.map(|(index, exact)| visible.fragments[*index as usize].diffuse - *exact);
            let off = root_mean_square(off);
            let (ahead, factor) = textures.ahead();
            let factor = (factor * ahead.len() as f64 / exact.len() as f64).sqrt() as f32;
            let foreseen = factor * root_mean_square(ahead.iter().map(|own| own.diffuse));
            println!("{halvings}: {off} off, {foreseen} foreseen");
            assert!((0.7..1.4).contains(&(foreseen / off)), "{halvings}: {foreseen}, {off}");
            left.push(off);
        }
        assert!(left[1] < 0.6 * left[0] && left[2] < 0.6 * left[1], "{left:?}");
    }
}
