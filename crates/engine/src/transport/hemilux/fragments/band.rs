//! How bands of rows are rasterised and their samples grouped into fragments.

use super::borders::BESIDE;
use super::samples::PixelSquare;
use super::shine::ShineRange;
use super::{
    ALIKE_DIFFUSE, BAND, Fragment, Lobe, MOST_SAMPLES, MOST_TEXELS, NO_FRAGMENT, PictureFacet,
    SMOOTH_COSINE, STEP_PIXELS, SampleGroup, VisibleSurfaces,
};
use crate::hemicube::item;
use crate::measurement::{BoxOffset, View};
use crate::patches::{Cut, FacetIndex};
use crate::radiometry::Rgb;
use crate::raster::{Target, fill};
use crate::rays::{Hit, RayOfPixel};
use crate::surface::World;
use crate::transport::hemilux::places::FragmentPlaces;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::iter::{Once, once};
use std::time::Instant;

/// Share of a pixel from which on textures are read at each sample of a facet: there its rim counts.
const BY_SAMPLE: f32 = 0.25;
/// Cosine of the angle between normal and viewer below which the albedo of a lobe, which changes fast
/// there, is read at places all over what a pixel sees, rather than where the lobe's rays begin.
const GRAZING_COSINE: f32 = 0.4;

impl VisibleSurfaces {
    pub(super) fn band(&self, world: &World, view: &View, first_row: u32) -> Band {
        let began = Instant::now();
        let items = self.items(view, first_row);
        let count = self.samples.len();
        let pixels = items.len() / count;
        let rasterised = Instant::now();
        let mut band = Band {
            fragments: Vec::with_capacity(pixels + pixels / 8),
            lobes: Vec::new(),
            groups: Vec::new(),
            ends: Vec::with_capacity(pixels),
            shine: Vec::with_capacity(pixels),
            shines: Vec::new(),
            crossed: Vec::with_capacity(pixels),
            background: Vec::new(),
            coverage: Vec::new(),
            seconds: [(rasterised - began).as_secs_f64(), 0.0],
        };
        let shows_background = !world.background.is_black(&world.environment);
        let shows_alpha = world.background.is_transparent();
        let emits = world.scene.emissive_triangles() > 0 || world.scene.has_unlit();
        let mut groups: Vec<SampleGroup> = Vec::new();
        for pixel in 0..pixels {
            groups.clear();
            let mut empty = 0u64;
            for sample in 0..count {
                let raster = items[sample * pixels + pixel];
                let code = self.seen(world, first_row * self.width + pixel as u32, sample, raster);
                let bit = 1u64 << sample;
                if code == item::EMPTY {
                    empty |= bit;
                    continue;
                }
                match groups.iter_mut().find(|group| group.code == code) {
                    Some(group) => group.mask |= bit,
                    None => groups.push(SampleGroup { code, mask: bit }),
                }
            }
            let pixel = first_row * self.width + pixel as u32;
            if shows_background {
                band.background.push(self.background(world, pixel, empty));
            }
            if shows_alpha {
                band.coverage.push(1.0 - empty.count_ones() as f32 / count as f32);
            }
            let (shine, mut shines) = self.collect(world, pixel, &groups, &mut band);
            band.shine.push(shine);
            if emits {
                if empty != 0 {
                    shines.add(Rgb::ZERO);
                }
                band.shines.push(shines);
            }
            band.ends.push(band.fragments.len() as u32);
        }
        band.seconds[1] = rasterised.elapsed().as_secs_f64();
        band
    }

    /// Codes of what the samples of a band's pixels see, sample after sample.
    fn items(&self, view: &View, first_row: u32) -> Vec<u32> {
        let rows = BAND.min(self.height - first_row);
        let pixels = (rows * self.width) as usize;
        let mut items = vec![0u32; pixels * self.samples.len()];
        let mut depth = vec![0f32; pixels];
        let triangles = view.boxed_in_rows(first_row, first_row + rows);
        for (offset, items) in self.samples.iter().zip(items.chunks_mut(pixels)) {
            depth.fill(0.0);
            let mut target = Target { width: self.width, first_row, items, depth: &mut depth };
            let units = BoxOffset::new(*offset);
            for (pixels, triangle) in &triangles {
                if pixels.is_met(units) {
                    fill(&mut target, &pixels.narrow(triangle.moved(*offset), units));
                }
            }
        }
        items
    }

    /// Joins what all bands see, which took so many seconds.
    pub(super) fn join(&mut self, bands: &[Band], seconds: f64) {
        self.seconds = shares(seconds, bands);
        let mut firsts = vec![[0, 0]];
        for band in bands {
            let [first, _] = firsts[firsts.len() - 1];
            self.start.extend(band.ends.iter().map(|end| end + first as u32));
            self.shine.extend(&band.shine);
            self.shines.extend(&band.shines);
            self.crossed.extend(&band.crossed);
            self.background.extend(&band.background);
            self.coverage.extend(&band.coverage);
            self.lobes.extend(
                band.lobes.iter().map(|lobe| Lobe { fragment: lobe.fragment + first as u32 }),
            );
            self.groups.extend(&band.groups);
            firsts.push([first + band.fragments.len(), self.groups.len()]);
        }
        // By all threads, since most of the time goes into memory that is new.
        let fragment = |index: usize| {
            let band = firsts.partition_point(|[first, _]| *first <= index) - 1;
            let [first, groups] = firsts[band];
            let own = bands[band].fragments[index - first];
            Fragment { groups: own.groups.map(|at| at + groups as u32), ..own }
        };
        let [total, _] = firsts[bands.len()];
        self.fragments = (0..total).into_par_iter().with_min_len(1024).map(fragment).collect();
        self.places =
            FragmentPlaces::new(&self.fragments, |fragment| (fragment.point, fragment.normal));
    }

    /// Code of what a sample of a pixel sees, whose code as rasterised is given.
    #[inline]
    fn seen(&self, world: &World, pixel: u32, sample: usize, mut code: u32) -> u32 {
        if self.instance_pixels.may_be_in(pixel) {
            code = self.before(world, pixel, sample, code);
        }
        if self.may_pass(world, code) {
            code = self.behind_holes(world, pixel, sample);
        }
        code
    }

    /// Whether a sample that sees this may see what is behind it instead.
    fn may_pass(&self, world: &World, code: u32) -> bool {
        let facet = item::decode(code);
        facet.is_some_and(|(facet, _)| world.rays.has_holes(self.cut.source(FacetIndex(facet))))
    }

    /// Code of what a sample of a pixel sees through holes.
    fn behind_holes(&self, world: &World, pixel: u32, sample: usize) -> u32 {
        let (origin, direction) = self.ray(pixel, self.samples[sample]);
        let ray = RayOfPixel { index: sample as u32, pixel };
        let hit = world.rays.closest_in_pixel(origin, direction, ray);
        hit.and_then(|hit| self.code_of(&hit)).unwrap_or(item::EMPTY)
    }

    /// Code of the facet and side that a ray has met; see [`item`].
    pub(super) fn code_of(&self, hit: &Hit) -> Option<u32> {
        let facet = match &*self.cut {
            Cut::Listed(listed) => listed.place_on_triangle(hit.triangle, hit.u, hit.v)?.0.0,
            Cut::Crowd(_) => hit.triangle,
        };
        Some(item::encode(facet, hit.back))
    }

    /// Code of what a sample of a pixel sees: `code`, or the triangle of an instance before it.
    fn before(&self, world: &World, pixel: u32, sample: usize, code: u32) -> u32 {
        let (origin, direction) = self.ray(pixel, self.samples[sample]);
        let ray = RayOfPixel { index: sample as u32, pixel };
        let hit = world.rays.closest_in_pixel(origin, direction, ray);
        match hit {
            Some(hit) if hit.triangle as usize >= world.scene.triangles.len() => {
                item::encode(hit.triangle, hit.back)
            }
            _ => code,
        }
    }

    /// Origin and unit direction of the ray through a place in a pixel.
    pub fn ray(&self, pixel: u32, offset: Vec2) -> (Vec3, Vec3) {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let corner = Vec2::new((pixel % self.width) as f32, (pixel / self.width) as f32);
        // Offsets are from a pixel's middle.
        let at = 2.0 * (corner + 0.5 + offset) / size - 1.0;
        self.frame.ray(Vec2::new(at.x, -at.y))
    }

    /// What some samples of a pixel, by a bit each, see beside the surfaces.
    fn background(&self, world: &World, pixel: u32, samples: u64) -> Rgb {
        let of = |offset| world.beside_surfaces(self.ray(pixel, offset).1);
        self.offsets(samples).map(of).sum::<Rgb>() / self.samples.len() as f32
    }

    /// Appends the fragments and lobes of a pixel; returns the emitted radiance that it sees, and how
    /// much that differs.
    fn collect(
        &self,
        world: &World,
        pixel: u32,
        groups: &[SampleGroup],
        band: &mut Band,
    ) -> (Rgb, ShineRange) {
        let Band { fragments, lobes, groups: of_several, .. } = band;
        let mut fragment_of_group = [NO_FRAGMENT; MOST_SAMPLES as usize];
        let (mut shine, mut shines) = (Rgb::ZERO, ShineRange::default());
        let first = fragments.len();
        for (number, group) in groups.iter().enumerate() {
            let seen = self.part_of(world, pixel, group);
            let Some((one, own)) = self.fragment_of(world, pixel, group.code, seen) else {
                continue;
            };
            let one = Fragment { mask: group.mask, ..one };
            shine += own * one.share;
            shines.add(own);
            if !one.reflects() && !self.is_translucent(world, group.code) {
                continue;
            }
            // Facets of a smooth surface share a fragment.
            let near = fragments[first..].iter().position(|other| {
                self.is_same_surface(other, &one)
                    && other.shading_normal.dot(one.shading_normal) > SMOOTH_COSINE
                    && (other.diffuse - one.diffuse).abs().max_element() < ALIKE_DIFFUSE
            });
            let fragment = near.map_or(fragments.len(), |near| first + near);
            match fragments.get_mut(fragment) {
                Some(other) => other.merge(&one),
                None => fragments.push(one),
            }
            fragment_of_group[number] = fragment;
        }
        for (fragment, own) in fragments.iter_mut().enumerate().skip(first) {
            if own.glossy {
                lobes.push(Lobe { fragment: fragment as u32 });
            }
            if fragment_of_group[..groups.len()].iter().filter(|of| **of == fragment).count() > 1 {
                let begin = of_several.len() as u32;
                let mine = groups.iter().zip(fragment_of_group);
                of_several.extend(mine.filter(|(_, of)| *of == fragment).map(|(group, _)| *group));
                own.groups = [begin, of_several.len() as u32];
            }
        }
        for fragment in &mut fragments[first..] {
            fragment.normal = fragment.normal.normalize_or(Vec3::Z);
            fragment.shading_normal = fragment.shading_normal.normalize_or(fragment.normal);
        }
        if world.has_translucent() {
            self.look_beyond(world, groups, &fragment_of_group, (fragments, first));
        }
        band.crossed.push(self.borders_between(groups, &fragment_of_group));
        (shine, shines)
    }

    /// Pairs of samples next to each other that see different things: fragments, or what has none.
    fn borders_between(&self, groups: &[SampleGroup], fragment_of_group: &[usize]) -> u8 {
        let is_one = |group: &SampleGroup| group.mask.count_ones() as usize == self.samples.len();
        if groups.is_empty() || groups.iter().any(is_one) {
            return 0;
        }
        let mut things = [BESIDE; MOST_SAMPLES as usize];
        for (number, group) in groups.iter().enumerate() {
            // The first group of the same fragment stands for all of them.
            let is_same = |other: &usize| *other == fragment_of_group[number];
            let first = fragment_of_group.iter().position(is_same).unwrap_or(number);
            let thing = if fragment_of_group[number] == NO_FRAGMENT { number } else { first };
            let mut rest = group.mask;
            while rest != 0 {
                things[rest.trailing_zeros() as usize] = thing as u8;
                rest &= rest - 1;
            }
        }
        self.borders.crossed(&things)
    }

    /// Whether two fragments that are near each other in the picture lie on one smooth surface, by
    /// place and normal: the chord of an arc is across the mean of the normals at its ends. What is
    /// parallel, but behind, has other shadows.
    pub fn is_same_surface(&self, one: &Fragment, other: &Fragment) -> bool {
        let reach = STEP_PIXELS * self.frame.footprint(other.point, self.height);
        let between = 0.5 * (one.normal + other.normal);
        one.glossy == other.glossy
            && one.normal.dot(other.normal) > SMOOTH_COSINE
            && between.dot(one.point - other.point).abs() < reach
    }

    /// The squares over which textures are averaged in a pixel that sees a facet: more of them where it
    /// sees more texels.
    pub(super) fn squares_of(&self, world: &World, pixel: u32, code: u32) -> &[PixelSquare] {
        let Some((facet, _)) = item::decode(code) else { return &self.squares[0] };
        let source = self.cut.source(FacetIndex(facet));
        if !varies(world, source) {
            return &self.squares[0];
        }
        let facet = (facet, &*self.placed(facet));
        let texels = world.texels_along(source, &self.part(facet, (pixel, Vec2::ZERO), 1.0));
        // Not a number is as many as can be.
        let enough = MOST_TEXELS.iter().position(|most| texels <= *most);
        &self.squares[enough.unwrap_or(MOST_TEXELS.len())]
    }

    /// What is seen of a group.
    pub(super) fn part_of(
        &self,
        world: &World,
        pixel: u32,
        group: &SampleGroup,
    ) -> SeenPart<impl Iterator<Item = SeenPlace>> {
        let (mask, all) = (group.mask, self.samples.len() as u32);
        let count = mask.count_ones();
        let share = count as f32 / all as f32;
        let (squares, samples) = match share >= BY_SAMPLE && count < all {
            true => (&[][..], mask),
            false => (self.squares_of(world, pixel, group.code), 0),
        };
        let in_square = move |square: &PixelSquare| {
            if count == all {
                let weight = (squares.len() as f32).recip();
                return Some(SeenPlace { offset: square.middle, side: weight.sqrt(), weight });
            }
            // As large as what is seen in the square, and in the middle of that.
            let own = mask & square.samples;
            let seen = own.count_ones() as f32;
            let offset = self.offsets(own).sum::<Vec2>() / seen;
            let (side, weight) = ((seen / all as f32).sqrt(), seen / count as f32);
            (own != 0).then_some(SeenPlace { offset, side, weight })
        };
        let (side, weight) = ((all as f32).sqrt().recip(), (count as f32).recip());
        let of_sample = move |offset| SeenPlace { offset, side, weight };
        SeenPart {
            share,
            middle: self.offsets(mask).sum::<Vec2>() / count as f32,
            places: squares
                .iter()
                .filter_map(in_square)
                .chain(self.offsets(samples).map(of_sample)),
            is_place: false,
        }
    }

    /// A fragment of what is seen of a facet in a pixel, without its mask, and the mean of the
    /// radiance that it emits.
    pub(super) fn fragment_of(
        &self,
        world: &World,
        pixel: u32,
        code: u32,
        seen: SeenPart<impl Iterator<Item = SeenPlace>>,
    ) -> Option<(Fragment, Rgb)> {
        let (facet, back) = item::decode(code)?;
        let source = self.cut.source(FacetIndex(facet));
        let finish = world.finish(source);
        let (share, middle) = (seen.share, seen.middle);
        let placed = self.placed(facet);
        let at = self.within(&placed, pixel, middle);
        let (point, flat) = placed.spot(back, at);
        let source_at = self.cut.to_source(FacetIndex(facet), at);
        let side = if back { -1.0 } else { 1.0 };
        let normal = world.smooth_normal(source, source_at, flat, side);
        let (is_clear, parameters) = (world.is_clear(source), &finish.parameters);
        let viewer = self.frame.towards_eye(point);
        let is_bent =
            parameters.is_glossy() && (seen.is_place || normal.dot(viewer) < GRAZING_COSINE);
        let has_means = varies(world, source) || is_bent;
        let means = match has_means {
            true => self.means(world, (facet, back, &*placed), pixel, seen),
            false => {
                let [diffuse, lobe_factor] = parameters.diffuse_and_lobe_factor(normal, viewer);
                let shine = world.shine(source, source_at);
                SampleMeans { diffuse, lobe_factor, shine, normal, ..SampleMeans::default() }
            }
        };
        // What is clear is seen by rays, with all that it reflects.
        let (diffuse, lobe_factor) = match is_clear {
            true => (Rgb::ZERO, Rgb::ONE),
            false => (means.diffuse, means.lobe_factor),
        };
        let glossy = is_clear || parameters.is_glossy();
        let fragment = Fragment {
            pixel,
            code,
            mask: 0,
            groups: [0; 2],
            share,
            point,
            normal,
            shading_normal: means.normal.normalize_or(normal),
            diffuse,
            lobe_factor,
            lobe_albedo: (has_means && !is_clear).then_some(means.lobe_albedo),
            glossy,
            is_beyond: false,
        };
        Some((fragment, means.shine))
    }

    /// Means over what is seen of a facet on which something varies, or that bends away.
    pub(super) fn means(
        &self,
        world: &World,
        (facet, back, placed): (u32, bool, &PictureFacet),
        pixel: u32,
        seen: SeenPart<impl Iterator<Item = SeenPlace>>,
    ) -> SampleMeans {
        let source = self.cut.source(FacetIndex(facet));
        let side = if back { -1.0 } else { 1.0 };
        let mut means = SampleMeans::default();
        for SeenPlace { offset, side: width, weight } in seen.places {
            let at = self.within(placed, pixel, offset);
            let (point, flat) = placed.spot(back, at);
            let viewer = self.frame.towards_eye(point);
            let (normal, parameters, shine) = match varies(world, source) {
                true => {
                    let part = self.part((facet, placed), (pixel, offset), width);
                    let (pyramids, seen) = (&self.pyramids, (source, &part));
                    (
                        world.shading_normal_over(pyramids, seen, flat, side),
                        world.parameters_over(pyramids, seen, flat, side),
                        world.shine_over(pyramids, source, &part),
                    )
                }
                false => {
                    let at = self.cut.to_source(FacetIndex(facet), at);
                    let normal = world.smooth_normal(source, at, flat, side);
                    (normal, world.finish(source).parameters, world.shine(source, at))
                }
            };
            let [diffuse, lobe_factor] = parameters.diffuse_and_lobe_factor(normal, viewer);
            means.diffuse += diffuse * weight;
            means.lobe_factor += lobe_factor * weight;
            means.lobe_albedo += parameters.lobe_albedo([flat, normal], viewer) * weight;
            means.shine += shine * weight;
            means.normal += normal * weight;
        }
        means
    }
}

/// Seconds that all bands took together, shared out by what each of their two parts took.
fn shares(seconds: f64, bands: &[Band]) -> [f64; 2] {
    let parts = [0, 1].map(|k| bands.iter().map(|band| band.seconds[k]).sum::<f64>());
    let all = (parts[0] + parts[1]).max(f64::MIN_POSITIVE);
    parts.map(|part| seconds * part / all)
}

/// Whether anything that a fragment shows varies over a triangle.
pub(super) fn varies(world: &World, source: u32) -> bool {
    world.varies(source) || world.material(source).has_normal_map()
}

/// Means over the samples of a pixel on one facet on which something varies.
#[derive(Default)]
pub(super) struct SampleMeans {
    /// Diffuse albedo.
    pub diffuse: Rgb,
    /// Factor of lobes.
    pub lobe_factor: Rgb,
    /// Albedo of lobes.
    pub lobe_albedo: Rgb,
    /// What they show by themselves.
    pub shine: Rgb,
    /// Shading normal, not normalised.
    pub normal: Vec3,
}

/// What is seen of a facet in a pixel.
pub(super) struct SeenPart<I> {
    /// Share of the pixel.
    pub share: f32,
    /// Its middle, from the pixel's.
    pub middle: Vec2,
    /// Places of it.
    pub places: I,
    /// Whether it is what one ray has met.
    pub is_place: bool,
}

impl SeenPart<Once<SeenPlace>> {
    /// A square, as if it were all of the pixel.
    pub fn at(offset: Vec2, side: f32) -> Self {
        let place = SeenPlace { offset, side, weight: 1.0 };
        Self { share: 1.0, middle: offset, places: once(place), is_place: true }
    }
}

/// A place of what is seen of a facet in a pixel.
#[derive(Clone, Copy)]
pub(super) struct SeenPlace {
    /// From the pixel's middle.
    pub offset: Vec2,
    /// Side, in pixels, of the square that it stands for.
    pub side: f32,
    /// Share of what is seen of the facet; all together 1.
    pub weight: f32,
}

impl Fragment {
    /// Takes in another facet of the same surface in the same pixel.
    fn merge(&mut self, other: &Fragment) {
        let share = self.share + other.share;
        let (mine, theirs) = (self.share / share, other.share / share);
        self.normal = (self.normal * mine + other.normal * theirs).normalize_or(self.normal);
        let shading = self.shading_normal * mine + other.shading_normal * theirs;
        self.shading_normal = shading.normalize_or(self.shading_normal);
        self.diffuse = self.diffuse * mine + other.diffuse * theirs;
        self.lobe_factor = self.lobe_factor * mine + other.lobe_factor * theirs;
        let albedos = self.lobe_albedo.zip(other.lobe_albedo);
        self.lobe_albedo = albedos.map(|(own, other)| own * mine + other * theirs);
        // Not that of the larger part: light changes by percents within a pixel.
        self.point = self.point * mine + other.point * theirs;
        if other.mask.count_ones() > self.mask.count_ones() {
            (self.code, self.mask) = (other.code, other.mask);
        }
        self.share = share;
    }
}

/// What a band of rows sees; indices of fragments begin at 0 in each band.
pub(super) struct Band {
    pub fragments: Vec<Fragment>,
    pub lobes: Vec<Lobe>,
    pub groups: Vec<SampleGroup>,
    pub ends: Vec<u32>,
    pub shine: Vec<Rgb>,
    /// Empty where nothing is emitted.
    pub shines: Vec<ShineRange>,
    pub crossed: Vec<u8>,
    /// Empty where the background is black.
    pub background: Vec<Rgb>,
    /// Empty where the picture shows no alpha.
    pub coverage: Vec<f32>,
    /// Seconds that rasterising took, and grouping by surfaces.
    pub seconds: [f64; 2],
}
