//! Shares of pixels at edges, found by ever more of the camera's rays.
//!
//! What is rasterised has a fixed number of samples in each pixel, in one pattern, so the shares of
//! surfaces that meet in a pixel keep an error. Rays through places that are new in every pass, and
//! other ones in every pixel, take it away. They find shares and colours only: the light of a
//! surface is that of its fragment.

use super::band::SeenPart;
use super::shine::ShineRange;
use super::{Fragment, MOST_SAMPLES, VisibleSurfaces};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::hemicube::item;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::rays::{Hit, RayOfPixel};
use crate::sampling::{Afresh, Seed, Shifted};
use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::ops::{Add, AddAssign, Mul};

/// Pixels of a parallel task.
const CHUNK: usize = 64;
/// Bound on rays of a pixel in a checkpoint: more than any run draws, so a larger number means
/// damage.
const MOST_DRAWN: u32 = 1 << 30;
/// Share of a pixel from which a fragment fills all of it.
const WHOLE: f32 = 1.0 - 1e-5;

/// How much 1 − cos of the angle between two normals counts beside differences of albedos: 5° as much
/// as .04, since what a lobe shows changes fast with the normal.
const PER_TURN: f32 = 10.0;

/// What a ray brings that meets a surface of which its pixel has no fragment, by hit, number of the ray in its pixel,
/// and direction.
pub type StrayLight<'a> = &'a (dyn Fn((&Hit, u32), Vec3, Afresh) -> Rgb + Sync);

/// All pixels at edges, and what rays have found in them.
#[derive(Default)]
pub struct Edges {
    pixels: Vec<EdgePixel>,
    /// Fragments of these pixels, pixel by pixel.
    fragments: Vec<EdgeFragment>,
    /// Rays so far in each pixel.
    drawn: u32,
}

/// A pixel at an edge: what it sees beside its fragments.
struct EdgePixel {
    pixel: u32,
    /// As rasterised, means over samples.
    rastered: Beside,
    /// Σ over rays.
    seen: Beside,
}

/// A fragment of a pixel at an edge.
struct EdgeFragment {
    /// As rasterised, means over samples.
    rastered: Part,
    /// Σ over rays.
    seen: Part,
}

/// What a pixel sees beside the light that its fragments reflect.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Beside {
    /// Emitted radiance.
    shine: Rgb,
    /// Radiance beside all surfaces.
    background: Rgb,
    /// Radiance of surfaces that are none of its fragments.
    stray: Rgb,
    /// Share that surfaces cover.
    covered: f32,
}

/// What a fragment has of its pixel.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Part {
    share: f32,
    /// Diffuse albedo times share.
    diffuse: Rgb,
    /// Factor of what its lobes reflect, times share.
    lobe_factor: Rgb,
    /// Albedo of its lobes, where it varies, times share.
    lobe_albedo: Rgb,
}

impl Edges {
    /// The edges of what is rasterised; no ray has been drawn.
    pub fn new(visible: &VisibleSurfaces) -> Self {
        let count = visible.width * visible.height;
        let at_edge = (0..count).into_par_iter().with_min_len(1024);
        let at_edge: Vec<u32> = at_edge.filter(|pixel| visible.is_at_edge(*pixel)).collect();
        let own = |pixel: u32| &visible.fragments[visible.of_pixel(pixel)];
        let of = |list: &[Rgb], pixel: u32| list.get(pixel as usize).copied().unwrap_or_default();
        let pixel = |pixel: u32| EdgePixel {
            pixel,
            rastered: Beside {
                shine: of(&visible.shine, pixel),
                background: of(&visible.background, pixel),
                stray: Rgb::ZERO,
                covered: visible.coverage.get(pixel as usize).copied().unwrap_or_default(),
            },
            seen: Beside::default(),
        };
        let fragment = |fragment: &Fragment| EdgeFragment {
            rastered: Part {
                share: fragment.share,
                diffuse: fragment.diffuse * fragment.share,
                lobe_factor: fragment.lobe_factor * fragment.share,
                lobe_albedo: fragment.lobe_albedo.unwrap_or_default() * fragment.share,
            },
            seen: Part::default(),
        };
        Self {
            fragments: at_edge.iter().flat_map(|pixel| own(*pixel)).map(fragment).collect(),
            pixels: at_edge.into_iter().map(pixel).collect(),
            drawn: 0,
        }
    }

    /// Number of these pixels, and of rays so far in each.
    pub fn done(&self) -> (usize, u32) {
        (self.pixels.len(), self.drawn)
    }

    /// These pixels.
    pub(super) fn pixels(&self) -> impl Iterator<Item = u32> + '_ {
        self.pixels.iter().map(|own| own.pixel)
    }

    /// Rays of all pixels.
    pub fn rays(&self) -> u64 {
        u64::from(self.drawn) * self.pixels.len() as u64
    }

    /// Draws so many more rays in each pixel at an edge; the shares in `visible` are then those of
    /// all samples and rays.
    pub fn pass(
        &mut self,
        visible: &mut VisibleSurfaces,
        seed: Seed,
        rays: u32,
        stray: StrayLight<'_>,
    ) {
        let first = self.drawn;
        let mut tasks = Vec::new();
        let mut rest = &mut self.fragments[..];
        for pixels in self.pixels.chunks_mut(CHUNK) {
            let count = pixels.iter().map(|own| visible.of_pixel(own.pixel).len()).sum();
            let (fragments, after) = rest.split_at_mut(count);
            rest = after;
            tasks.push((pixels, fragments));
        }
        let known = &*visible;
        tasks.into_par_iter().for_each(|(pixels, mut fragments)| {
            for own in pixels {
                let (mine, after) = fragments.split_at_mut(known.of_pixel(own.pixel).len());
                fragments = after;
                let mut places = Shifted::new(seed, Stream::Edge, own.pixel.into()).at(first);
                for number in first..first + rays {
                    let [u, v] = places.next_pair();
                    let place = Vec2::new(u, v) - 0.5;
                    own.look(known, (place, number), &places, (mine, stray));
                }
            }
        });
        self.drawn += rays;
        self.tell(visible);
    }

    /// Puts what is known of the edges into `visible`.
    fn tell(&self, visible: &mut VisibleSurfaces) {
        if self.drawn == 0 {
            return;
        }
        // Variances of well-spread samples go by the power 3/2 of their number.
        let [by_samples, by_rays] =
            [visible.samples.len() as f32, self.drawn as f32].map(|count| count.powf(1.5));
        visible.edge_weight = by_samples + by_rays;
        let of_samples = by_samples / visible.edge_weight;
        let of_each_ray = (1.0 - of_samples) / self.drawn as f32;
        if visible.strays.is_empty() {
            visible.strays = vec![Rgb::ZERO; visible.shine.len()];
        }
        let mut fragments = self.fragments.iter();
        for EdgePixel { pixel, rastered, seen } in &self.pixels {
            let beside = *rastered * of_samples + *seen * of_each_ray;
            let at = *pixel as usize;
            visible.shine[at] = beside.shine;
            visible.strays[at] = beside.stray;
            if let Some(background) = visible.background.get_mut(at) {
                *background = beside.background;
            }
            if let Some(coverage) = visible.coverage.get_mut(at) {
                *coverage = beside.covered;
            }
            for (index, EdgeFragment { rastered, seen }) in
                visible.of_pixel(*pixel).zip(fragments.by_ref())
            {
                let all = *rastered * of_samples + *seen * of_each_ray;
                let fragment = &mut visible.fragments[index];
                fragment.share = all.share;
                // Rasterised by one sample at least, so that its share is more than nothing.
                fragment.diffuse = all.diffuse / all.share;
                fragment.lobe_factor = all.lobe_factor / all.share;
                fragment.lobe_albedo = fragment.lobe_albedo.map(|_| all.lobe_albedo / all.share);
            }
        }
    }

    /// Writes what the rays have found.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.drawn);
        if self.drawn > 0 {
            to.slice(&self.pixels.iter().map(|own| own.seen).collect::<Vec<_>>());
            to.slice(&self.fragments.iter().map(|own| own.seen).collect::<Vec<_>>());
        }
    }

    /// Reads what [`Edges::save`] wrote, of the same picture.
    pub fn restore(
        &mut self,
        visible: &mut VisibleSurfaces,
        from: &mut Reader<'_>,
    ) -> Result<(), CheckpointError> {
        let drawn: u32 = from.value()?;
        if drawn == 0 {
            return Ok(());
        }
        *self = Self::new(visible);
        let pixels: Vec<Beside> = from.exactly(self.pixels.len())?;
        let fragments: Vec<Part> = from.exactly(self.fragments.len())?;
        let is_sound = pixels.iter().all(Beside::is_sound) && fragments.iter().all(Part::is_sound);
        if drawn > MOST_DRAWN || !is_sound {
            return Err(CheckpointError::damaged("there can't be such an edge"));
        }
        self.drawn = drawn;
        for (own, seen) in self.pixels.iter_mut().zip(pixels) {
            own.seen = seen;
        }
        for (own, seen) in self.fragments.iter_mut().zip(fragments) {
            own.seen = seen;
        }
        self.tell(visible);
        Ok(())
    }
}

impl EdgePixel {
    /// Looks along a ray through a place in the pixel, given from its middle; its number is that in the pixel.
    fn look(
        &mut self,
        visible: &VisibleSurfaces,
        (offset, number): (Vec2, u32),
        places: &Shifted,
        (fragments, stray): (&mut [EdgeFragment], StrayLight<'_>),
    ) {
        let world = &*visible.placing.world;
        let (origin, direction) = visible.ray(self.pixel, offset);
        let (index, pixel) = places.place();
        let ray = RayOfPixel { index, pixel };
        let Some(hit) = world.rays.closest_in_pixel(origin, direction, ray) else {
            self.seen.background += world.beside_surfaces(direction);
            return;
        };
        self.seen.covered += 1.0;
        let side = (MOST_SAMPLES as f32).sqrt().recip();
        let seen = SeenPart::at(offset, side);
        let one = visible
            .code_of(&hit)
            .and_then(|code| visible.fragment_of(world, self.pixel, code, seen));
        let Some((one, shine)) = one else { return };
        self.seen.shine += shine;
        if !one.reflects() && !world.is_translucent(hit.triangle) {
            return;
        }
        let own = &visible.fragments[visible.of_pixel(self.pixel)];
        match visible.alike(own, &one) {
            Some(index) => {
                let lobe_albedo = one.lobe_albedo.unwrap_or_default();
                let (diffuse, lobe_factor) = (one.diffuse, one.lobe_factor);
                fragments[index].seen += Part { share: 1.0, diffuse, lobe_factor, lobe_albedo };
                if let Some(beyond) = visible.beyond_in(own, index) {
                    let seen = SeenPart::at(offset, side);
                    let code = visible.code_of(&hit).unwrap_or(item::EMPTY);
                    let diffuse = visible.passed(world, self.pixel, code, seen);
                    let lobe_factor = own[beyond].lobe_factor;
                    let part = Part { share: 1.0, diffuse, lobe_factor, lobe_albedo: Rgb::ZERO };
                    fragments[beyond].seen += part;
                }
            }
            None => self.seen.stray += stray((&hit, number), direction, places.apart()),
        }
    }
}

impl VisibleSurfaces {
    /// Indices of a pixel's fragments.
    fn of_pixel(&self, pixel: u32) -> std::ops::Range<usize> {
        self.start[pixel as usize] as usize..self.start[pixel as usize + 1] as usize
    }

    /// Which of a pixel's fragments has the light of `one`: that of the same facet, or else, of those
    /// on the same surface, the one that is most alike in colour and normal.
    fn alike(&self, own: &[Fragment], one: &Fragment) -> Option<usize> {
        let by_code =
            own.iter().position(|other| !other.is_beyond && self.has_facet(other, one.code));
        let off = |index: &usize| {
            let other = &own[*index];
            let turned = 1.0 - other.shading_normal.dot(one.shading_normal);
            (other.diffuse - one.diffuse).abs().element_sum() + PER_TURN * turned
        };
        by_code.or_else(|| {
            let near = (0..own.len()).filter(|index| !own[*index].is_beyond);
            let same = near.filter(|index| self.is_same_surface(&own[*index], one));
            same.min_by(|a, b| off(a).total_cmp(&off(b)))
        })
    }

    /// Whether several surfaces may share a pixel: where its samples or its neighbours say so.
    fn is_at_edge(&self, pixel: u32) -> bool {
        let [column, row] = [pixel % self.width, pixel / self.width];
        let neighbours = [
            (column > 0).then(|| pixel - 1),
            (column + 1 < self.width).then(|| pixel + 1),
            (row > 0).then(|| pixel - self.width),
            (row + 1 < self.height).then(|| pixel + self.width),
        ];
        let Some(own) = self.filling(pixel) else { return true };
        // What reflects nothing may shine differently in one pixel.
        if own.is_none() && self.shines.get(pixel as usize).is_some_and(ShineRange::is_wide) {
            return true;
        }
        let differs = |other: u32| match (own, self.filling(other)) {
            (Some(one), Some(Some(other))) => !self.is_alike(one, other),
            (None, Some(None)) => {
                ShineRange::of([pixel, other].map(|at| self.shine[at as usize])).is_wide()
            }
            _ => true,
        };
        neighbours.into_iter().flatten().any(differs)
    }

    /// The fragment that fills all of a pixel, or `Some(None)` where it has none; `None` where
    /// several things share it.
    pub(super) fn filling(&self, pixel: u32) -> Option<Option<&Fragment>> {
        match &self.fragments[self.of_pixel(pixel)] {
            [] => Some(None),
            [one, rest @ ..] if one.share > WHOLE && rest.iter().all(|own| own.is_beyond) => {
                Some(Some(one))
            }
            _ => None,
        }
    }

    /// Whether neighbouring pixels filled by these see no edge.
    fn is_alike(&self, one: &Fragment, other: &Fragment) -> bool {
        let is_one_material = || {
            let material = |code| {
                let (facet, _) = item::decode(code)?;
                let source = self.cut.source(crate::patches::FacetIndex(facet));
                Some(self.placing.world.scene.triangle(source).material)
            };
            one.code == other.code || material(one.code) == material(other.code)
        };
        self.is_same_surface(one, other) && is_one_material()
    }
}

impl Beside {
    fn is_sound(&self) -> bool {
        let light = [self.shine, self.background, self.stray];
        light.iter().all(|own| own.is_finite()) && self.covered >= 0.0 && self.covered.is_finite()
    }
}

impl Part {
    fn is_sound(&self) -> bool {
        let colours = [self.diffuse, self.lobe_factor, self.lobe_albedo];
        let share = self.share >= 0.0 && self.share.is_finite();
        share && colours.iter().all(|own| own.is_finite())
    }
}

impl Mul<f32> for Beside {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            shine: self.shine * factor,
            background: self.background * factor,
            stray: self.stray * factor,
            covered: self.covered * factor,
        }
    }
}

impl Add for Beside {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            shine: self.shine + other.shine,
            background: self.background + other.background,
            stray: self.stray + other.stray,
            covered: self.covered + other.covered,
        }
    }
}

impl Mul<f32> for Part {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            share: self.share * factor,
            diffuse: self.diffuse * factor,
            lobe_factor: self.lobe_factor * factor,
            lobe_albedo: self.lobe_albedo * factor,
        }
    }
}

impl Add for Part {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            share: self.share + other.share,
            diffuse: self.diffuse + other.diffuse,
            lobe_factor: self.lobe_factor + other.lobe_factor,
            lobe_albedo: self.lobe_albedo + other.lobe_albedo,
        }
    }
}

impl AddAssign for Part {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Environment, made};
    use crate::transport::hemilux::specimen::{EMISSION, SEED, Specimen};

    const NO_STRAYS: StrayLight<'static> = &|_, _, _| Rgb::ZERO;

    fn specimen() -> Specimen {
        Specimen::new(&made::cornell(), 200)
    }

    fn shares(visible: &VisibleSurfaces) -> Vec<f32> {
        visible.fragments.iter().map(|fragment| fragment.share).collect()
    }

    /// Root mean square of the differences.
    fn apart(one: &[f32], other: &[f32]) -> f32 {
        let squares = one.iter().zip(other).map(|(a, b)| (a - b) * (a - b));
        (squares.sum::<f32>() / one.len() as f32).sqrt()
    }

    /// Each facet that a fragment's samples see is the fragment's, and a facet that none has seen is that
    /// one's which faces its way.
    #[test]
    fn facets_find_to_their_fragments() {
        let visible = Specimen::new(&made::tessellated_room(20_000), 500).visible();
        let mut several = 0;
        for pixel in 0..visible.width * visible.height {
            let own = &visible.fragments[visible.of_pixel(pixel)];
            for (index, fragment) in own.iter().enumerate() {
                for group in visible.groups(fragment) {
                    let one = Fragment { code: group.code, ..own[0] };
                    assert_eq!(visible.alike(own, &one), Some(index), "pixel {pixel}");
                    several += 1;
                }
                let unseen = Fragment { code: item::EMPTY, ..*fragment };
                assert_eq!(visible.alike(own, &unseen), Some(index), "pixel {pixel}");
            }
        }
        assert!(several > 100, "facets are small");
    }

    /// Shares come nearer to the true ones with every ray, without a floor: two that are found by
    /// other rays differ by their number to the power −3/4 or so.
    #[test]
    fn shares_find_to_the_true_ones() {
        let specimen = specimen();
        let [many, others] = [SEED, Seed { number: 8, ..SEED }].map(|seed| {
            let (mut visible, mut off) = (specimen.visible(), Vec::new());
            let mut edges = Edges::new(&visible);
            for rays in [64, 960] {
                edges.pass(&mut visible, seed, rays, NO_STRAYS);
                off.push(shares(&visible));
            }
            off
        });
        let rastered = shares(&specimen.visible());
        let first = apart(&many[0], &others[0]);
        let (second, by_raster) = (apart(&many[1], &others[1]), apart(&rastered, &many[1]));
        assert!(first < by_raster, "{first} {by_raster}");
        assert!(second < 0.35 * first, "{second} {first}");
    }

    /// What only shows itself has edges, too, where its colours differ.
    #[test]
    fn what_reflects_nothing_has_edges() {
        let mut scene = specimen().world.scene.as_ref().clone();
        scene.materials.iter_mut().for_each(|material| material.unlit = true);
        let specimen = Specimen::of(scene, Environment::none(), 200);
        let [rastered, one, other] =
            [None, Some(SEED), Some(Seed { number: 8, ..SEED })].map(|seed| {
                let mut visible = specimen.visible();
                assert!(visible.fragments.is_empty());
                let mut edges = Edges::new(&visible);
                let (count, all) = (edges.pixels.len(), visible.shine.len());
                assert!(count > 20 && count < all * 3 / 4, "{count} of {all}");
                if let Some(seed) = seed {
                    edges.pass(&mut visible, seed, 256, NO_STRAYS);
                }
                visible.shine.iter().map(|shine| shine.x).collect::<Vec<_>>()
            });
        let (by_raster, by_rays) = (apart(&rastered, &one), apart(&one, &other));
        assert!(by_rays < 0.3 * by_raster, "{by_rays} {by_raster}");
    }

    /// In a closed scene all of a pixel is fragments or strays, and here all of it shines.
    #[test]
    fn nothing_of_a_pixel_is_lost() {
        let specimen = Specimen::furnace();
        let mut visible = specimen.visible();
        let mut edges = Edges::new(&visible);
        edges.pass(&mut visible, SEED, 32, &|_, _, _| Rgb::ONE);
        assert!(edges.rays() > 0);
        for pixel in 0..visible.width * visible.height {
            let own = &visible.fragments[visible.of_pixel(pixel)];
            let seen: f32 = own.iter().map(|fragment| fragment.share).sum();
            let all = seen + visible.strays[pixel as usize].x;
            assert!((all - 1.0).abs() < 1e-4, "{pixel}: {all}");
            let shine = visible.shine[pixel as usize].x;
            assert!((shine - EMISSION).abs() < 1e-3 * EMISSION, "{pixel}: {shine}");
        }
    }

    #[test]
    fn what_was_seen_comes_back() {
        let specimen = specimen();
        let mut visible = specimen.visible();
        let mut edges = Edges::new(&visible);
        edges.pass(&mut visible, SEED, 16, NO_STRAYS);
        let mut to = Writer::new(u64::MAX);
        edges.save(&mut to);
        let bytes = to.finish().expect("there is room");
        let (mut again, mut read) = (specimen.visible(), Edges::default());
        read.restore(&mut again, &mut Reader::new(&bytes)).expect("sound");
        assert_eq!(shares(&again), shares(&visible));
        edges.pass(&mut visible, SEED, 16, NO_STRAYS);
        read.pass(&mut again, SEED, 16, NO_STRAYS);
        assert_eq!(shares(&again), shares(&visible));
        // Damage is refused.
        edges.pixels[0].seen.covered = f32::NAN;
        let mut to = Writer::new(u64::MAX);
        edges.save(&mut to);
        let bytes = to.finish().expect("there is room");
        assert!(Edges::default().restore(&mut again, &mut Reader::new(&bytes)).is_err());
    }
}
