//! What the camera sees, found once for a picture: the sub-pixel samples of each pixel are
//! rasterised and grouped by surface into fragments.

mod band;
mod beyond;
mod borders;
pub mod cells;
pub mod edges;
mod lamps;
mod samples;
pub mod shine;
mod starts;
pub mod textures;

use self::borders::Borders;
pub use self::samples::MOST_SAMPLES;
use self::samples::{PixelSquare, squares};
use self::shine::ShineRange;
use super::instance_pixels::InstancePixels;
use super::places::FragmentPlaces;
use crate::hemicube::item;
use crate::measurement::{Frame, View, nth_of_pattern, sample_pattern};
use crate::patches::{Cut, FacetIndex, FacetPlace};
use crate::radiometry::{Rgb, importance};
use crate::raster::PixelPlane;
use crate::rays::{Eye, RayOfPixel, Spot, inset, unit_normal};
use crate::scene::Camera;
use crate::scene::part::Part;
use crate::scene::pyramid::Pyramids;
use crate::surface::{Surface, World};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;
use std::time::Instant;

/// Rows of pixels that are rasterised together, a parallel task.
const BAND: u32 = 16;
/// Of samples that belong to none.
const NO_FRAGMENT: usize = usize::MAX;
/// Squares along and across a pixel that sees one facet alone, over which textures are averaged: of one
/// that sees few texels, some, and many.
const SQUARES: [u32; 3] = [2, 3, 4];
/// Texels along a pixel, at most, for the first and second of [`SQUARES`].
const MOST_TEXELS: [f32; 2] = [1.0, 1.5];
/// Places in a sample's square that are looked at for one of a lobe that shares its pixel.
const EDGE_TRIES: u32 = 4;
/// Rays of a lobe that share its part of a pixel at first where textures say how it reflects. Later
/// ones stand for ever less: between metal and paint the mean of both is neither.
const FIRST_LOBE_RAYS: u32 = 4;
/// Cosine of the angle, 14°, by which the normals of facets in one fragment may differ.
const SMOOTH_COSINE: f32 = 0.97;
/// How far, in pixels, one may be in front of the other.
const STEP_PIXELS: f32 = 0.3;
/// By how much the diffuse albedos of facets in one fragment may differ, in any channel.
const ALIKE_DIFFUSE: f32 = 0.02;

/// A fragment: the part of a pixel that one smooth surface fills.
#[derive(Clone, Copy)]
pub struct Fragment {
    /// The pixel, row by row from the top.
    pub pixel: u32,
    /// Code of the facet and side that most of its samples see; see [`item`].
    pub code: u32,
    /// Samples that see that side of that facet, a bit each.
    pub mask: u64,
    /// Its samples by facet where there are several: [`VisibleSurfaces::groups`] from the first to
    /// before the second; empty where it has one facet.
    groups: [u32; 2],
    /// Share of the pixel's samples.
    pub share: f32,
    /// Mean place, ray units, off the surface by the rounding error.
    pub point: Vec3,
    /// Mean unit normal, between those of the vertices where surfaces are smooth.
    pub normal: Vec3,
    /// Mean unit shading normal: the same turned by the normal map, if there is one.
    pub shading_normal: Vec3,
    /// Mean diffuse albedo.
    pub diffuse: Rgb,
    /// Mean factor of what its lobes reflect to the camera: what the diffuse part loses there.
    pub lobe_factor: Rgb,
    /// Mean albedo of its lobes towards the camera, where it varies; elsewhere the lobes' rays tell.
    pub lobe_albedo: Option<Rgb>,
    /// Whether it reflects a lobe.
    pub glossy: bool,
    /// Whether it is the other side of another fragment of the pixel, which lets light through
    /// diffusely from there: then its diffuse albedo is what comes through.
    pub is_beyond: bool,
}

/// Steps of well-spread points of the square (Roberts 2018).
const SQUARE_STEP: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

impl Fragment {
    /// How much of its pixel's radiance its irradiance makes, but for the factor 1/π.
    pub fn weight(&self) -> f32 {
        self.share * importance(self.diffuse)
    }

    /// Whether its samples see one facet.
    fn has_one_facet(&self) -> bool {
        self.groups[0] == self.groups[1]
    }

    /// Whether it sends on any light.
    fn reflects(&self) -> bool {
        self.diffuse != Rgb::ZERO || self.glossy
    }
}

/// The lobe of a fragment that is glossy.
#[derive(Clone, Copy)]
pub struct Lobe {
    /// Index of the fragment.
    pub fragment: u32,
}

/// A facet with its barycentric coordinates as linear functions of the pixel.
#[derive(Clone)]
struct PictureFacet {
    /// The corners of the scene's triangle that it lies in: its own, rounded, are off the plane.
    whole: [Vec3; 3],
    /// Where its own lie in that.
    source: [Vec2; 3],
    planes: [PixelPlane; 3],
    normal: Vec3,
    inset: f32,
}

impl PictureFacet {
    /// A place on a side, off the surface by the rounding error, and that side's normal.
    fn spot(&self, back: bool, at: Vec2) -> (Vec3, Vec3) {
        let normal = if back { -self.normal } else { self.normal };
        (self.spot_on_front(at).off_surface(normal), normal)
    }

    fn spot_on_front(&self, at: Vec2) -> Spot {
        let [a, b, c] = self.source;
        let at = a * (1.0 - at.x - at.y) + b * at.x + c * at.y;
        Spot::new(self.whole, self.normal, at.x, at.y)
    }
}

/// How facets come into the picture.
struct Placing {
    world: Arc<World>,
    grid: View,
}

impl Placing {
    fn place(&self, cut: &Cut, facet: FacetIndex) -> PictureFacet {
        let corners = cut.corners(facet);
        let planes = self.grid.edges(corners);
        let inset = inset(corners.map(|corner| self.world.rays.place(corner)));
        let (whole, _) = self.world.rays.corners(&self.world.scene, cut.source(facet));
        let source = [Vec2::ZERO, Vec2::X, Vec2::Y].map(|at| cut.to_source(facet, at));
        PictureFacet { whole, source, planes, normal: unit_normal(whole), inset }
    }
}

/// Whether a camera is within a closed body that no light gets into, whose backs it sees then: black
/// ones, with nothing behind.
fn is_within_dark_body(world: &World, cut: &Cut, frame: &Frame) -> bool {
    let (eye, _) = frame.ray(Vec2::ZERO);
    let meets_back = |direction: &Vec3| {
        let hit = world.rays.closest(Eye::Camera, eye, *direction);
        hit.is_some_and(|hit| hit.back && cut.bounds_dark_body(hit.triangle, hit.u, hit.v))
    };
    // What else is in the body may be in the way of some.
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    [x, y, z, -x, -y, -z].iter().any(meets_back)
}

/// What a camera sees: all fragments and lobes of a picture.
pub struct VisibleSurfaces {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The camera's frame, ray units.
    pub frame: Frame,
    cut: Arc<Cut>,
    pyramids: Arc<Pyramids>,
    /// The facets; none of a crowd, whose facets are placed where they are needed.
    placed: Vec<PictureFacet>,
    placing: Placing,
    instance_pixels: InstancePixels,
    samples: Vec<Vec2>,
    /// The squares that a pixel is cut into: textures are averaged over these where all of it sees one
    /// facet, without gaps, and elsewhere over what is seen of it in each.
    squares: [Vec<PixelSquare>; 3],
    /// Fragments in the order of their pixels.
    pub fragments: Vec<Fragment>,
    /// Lobes in the order of their pixels.
    pub lobes: Vec<Lobe>,
    /// Samples of the fragments that have several facets, facet by facet.
    groups: Vec<SampleGroup>,
    /// Places and normals of the fragments.
    pub places: FragmentPlaces,
    /// Fragments of pixel p: `start[p]..start[p + 1]`.
    pub start: Vec<u32>,
    /// Emitted radiance that each pixel sees.
    pub shine: Vec<Rgb>,
    /// How much what it sees of that differs; empty where nothing is emitted.
    pub shines: Vec<ShineRange>,
    /// Radiance that each pixel sees beside the surfaces; empty where that is black.
    pub background: Vec<Rgb>,
    /// Pairs of samples next to each other in each pixel that see different things, and which pairs there are.
    crossed: Vec<u8>,
    borders: Borders,
    /// Share of each pixel that surfaces cover; empty where the picture shows no alpha.
    pub coverage: Vec<f32>,
    /// Radiance that each pixel sees on surfaces that are none of its fragments, as [`edges::Edges`] find
    /// them; empty where there are none.
    pub strays: Vec<Rgb>,
    /// One over this, times a constant, is the variance of a surface's share of a pixel: the power
    /// 3/2 of the number of samples, and of the number of rays of [`edges::Edges`], added up.
    pub edge_weight: f32,
    /// Seconds that rasterising took, and that it took to group what is seen by surfaces.
    pub seconds: [f64; 2],
}

impl VisibleSurfaces {
    /// Rasterises the scene for `samples` sub-pixel samples.
    pub fn new(
        world: &Arc<World>,
        cut: Arc<Cut>,
        camera: &Camera,
        [width, height]: [u32; 2],
        samples: u32,
    ) -> Self {
        let frame = Frame::new(&world.rays.camera(camera), width, height);
        let within = is_within_dark_body(world, &cut, &frame);
        let view = View::of_cut(&cut, camera, [width, height], within);
        let placing = Placing { world: world.clone(), grid: View::grid(camera, width, height) };
        let facets = match &*cut {
            Cut::Listed(_) => cut.facets() as u32,
            Cut::Crowd(_) => 0,
        };
        let place = |facet| placing.place(&cut, FacetIndex(facet));
        let placed = (0..facets).into_par_iter().with_min_len(1024).map(place).collect();
        let samples = sample_pattern(samples.clamp(1, MOST_SAMPLES));
        let mut visible = Self {
            width,
            height,
            frame,
            placed,
            placing,
            instance_pixels: InstancePixels::new(world, camera, [width, height]),
            squares: SQUARES.map(|count| squares(count, &samples)),
            borders: Borders::new(&samples),
            crossed: Vec::with_capacity((width * height) as usize),
            samples,
            pyramids: world.pyramids(),
            cut,
            fragments: Vec::new(),
            lobes: Vec::new(),
            groups: Vec::new(),
            places: FragmentPlaces::default(),
            start: vec![0],
            shine: Vec::with_capacity((width * height) as usize),
            shines: Vec::new(),
            background: Vec::new(),
            coverage: Vec::new(),
            strays: Vec::new(),
            edge_weight: 0.0,
            seconds: [0.0; 2],
        };
        visible.edge_weight = (visible.samples.len() as f32).powf(1.5);
        let began = Instant::now();
        let bands: Vec<_> = (0..height.div_ceil(BAND))
            .into_par_iter()
            .map(|band| visible.band(world, &view, band * BAND))
            .collect();
        visible.join(&bands, began.elapsed().as_secs_f64());
        visible
    }

    /// Whether a fragment takes the whole pixel.
    fn is_whole(&self, fragment: &Fragment) -> bool {
        self.count(fragment) as usize == self.samples.len()
    }

    /// A place for what comes n-th of a fragment, whose sample at `offset` had its turn: where it takes
    /// the whole pixel between all samples, which leaves no gaps, else in the sample's square.
    fn another_place(&self, fragment: &Fragment, offset: Vec2, n: u32) -> Vec2 {
        match self.is_whole(fragment) {
            true => nth_of_pattern(self.samples.len() as u32, n),
            false => self.beside(offset, n / self.count(fragment)),
        }
    }

    /// Another place in a sample's square, for each round after the first.
    fn beside(&self, offset: Vec2, round: u32) -> Vec2 {
        let side = (self.samples.len() as f32).sqrt().recip();
        offset + ((SQUARE_STEP * round as f32).fract() - 0.5) * side
    }

    /// Whether a facet covers a place in a pixel.
    fn is_on(&self, placed: &PictureFacet, pixel: u32, offset: Vec2) -> bool {
        let at = self.unbounded(placed, pixel, offset);
        at.min_element() > 0.0 && at.element_sum() < 1.0
    }

    /// The surface point of the sample that is nearest to the middle of a fragment's: what it
    /// sees, and near what it sees on average, even where a pixel looks along the surface.
    pub fn middle_point(&self, fragment: &Fragment) -> Vec3 {
        let samples = self.offsets(fragment.mask);
        let middle = samples.sum::<Vec2>() / fragment.mask.count_ones().max(1) as f32;
        let off = |offset: &Vec2| offset.distance_squared(middle);
        let nearest = self.offsets(fragment.mask).min_by(|a, b| off(a).total_cmp(&off(b)));
        let (Some(offset), Some((facet, back))) = (nearest, item::decode(fragment.code)) else {
            return fragment.point;
        };
        let placed = self.placed(facet);
        placed.spot(back, self.within(&placed, fragment.pixel, offset)).0
    }

    /// Facet, side and barycentric coordinates of a fragment's first sample.
    pub fn place_on_facet(&self, fragment: &Fragment) -> FacetPlace {
        let (facet, back) = item::decode(fragment.code).unwrap_or((0, false));
        let offset = self.samples[nth_bit(fragment.mask, 0) as usize];
        let at = self.barycentric(facet, fragment.pixel, offset);
        self.cut.with_patches(FacetPlace { facet: FacetIndex(facet), back, at })
    }

    /// Triangle, side and barycentric (u, v) of a fragment's n-th sample.
    pub fn place_on_triangle(&self, fragment: &Fragment, n: u32) -> (u32, bool, [f32; 2]) {
        let (code, offset) = self.nth_sample(fragment, n);
        let (facet, back) = item::decode(code).unwrap_or((0, false));
        let at = self.barycentric(facet, fragment.pixel, offset);
        let facet = FacetIndex(facet);
        (self.cut.source(facet), back, self.cut.to_source(facet, at).to_array())
    }

    /// Unit normal of the facet of a fragment, on the side that is seen.
    pub fn flat_normal(&self, fragment: &Fragment) -> Vec3 {
        let Some((facet, back)) = item::decode(fragment.code) else { return fragment.normal };
        let normal = self.placed(facet).normal;
        if back { -normal } else { normal }
    }

    /// How long the borders between surfaces in a pixel are, in those of straight lines.
    pub fn border_length(&self, pixel: usize) -> f32 {
        self.borders.length(self.crossed[pixel])
    }

    /// Sub-pixel samples of each pixel.
    pub fn samples(&self) -> usize {
        self.samples.len()
    }

    /// Share of the pixel's samples that a lobe has.
    pub fn share(&self, lobe: &Lobe) -> f32 {
        self.count(self.of_lobe(lobe)) as f32 / self.samples.len() as f32
    }

    fn of_lobe(&self, lobe: &Lobe) -> &Fragment {
        &self.fragments[lobe.fragment as usize]
    }

    /// A fragment's samples by facet, where it has several.
    fn groups(&self, fragment: &Fragment) -> &[SampleGroup] {
        let [first, end] = fragment.groups;
        &self.groups[first as usize..end as usize]
    }

    /// The samples of a fragment, a bit each.
    fn all_samples(&self, fragment: &Fragment) -> u64 {
        self.groups(fragment).iter().fold(fragment.mask, |all, group| all | group.mask)
    }

    /// Number of a fragment's samples, at least 1.
    pub fn count(&self, fragment: &Fragment) -> u32 {
        self.all_samples(fragment).count_ones().max(1)
    }

    /// Code of the facet and side that a fragment's n-th sample sees, and the sample's place. Samples
    /// that follow each other are well spread over the pixel.
    fn nth_sample(&self, fragment: &Fragment, n: u32) -> (u32, Vec2) {
        let bit = nth_bit(self.all_samples(fragment), n).min(self.samples.len() as u32 - 1);
        let code = self.code_of_sample(fragment, bit);
        (code, self.samples[bit as usize])
    }

    /// Code of the facet and side that one of a fragment's samples sees.
    fn code_of_sample(&self, fragment: &Fragment, bit: u32) -> u32 {
        let sees = |group: &&SampleGroup| group.mask >> bit & 1 == 1;
        match self.groups(fragment).iter().find(sees) {
            Some(group) if fragment.is_beyond => other_side(group.code),
            Some(group) => group.code,
            None => fragment.code,
        }
    }

    /// The surface at a lobe's n-th sample, of the part of it that a ray stands for which so many
    /// were `before`.
    pub fn surface(&self, world: &World, lobe: &Lobe, (n, before): (u32, u32)) -> Surface {
        let area = self.share(lobe) / (before + 1).max(FIRST_LOBE_RAYS) as f32;
        let (code, offset) = self.place_of_lobe(lobe, n);
        let (facet, _) = item::decode(code).unwrap_or((0, false));
        let pixel = self.of_lobe(lobe).pixel;
        let placed = self.placed(facet);
        let at = self.within(&placed, pixel, offset);
        self.surface_in(world, (code, &placed, at), (pixel, offset), area.sqrt())
    }

    /// The surface of the facet of a code at such barycentric coordinates, where a pixel sees it at a place, over a
    /// square of such a side.
    fn surface_in(
        &self,
        world: &World,
        (code, placed, at): (u32, &PictureFacet, Vec2),
        (pixel, place): (u32, Vec2),
        side: f32,
    ) -> Surface {
        let (facet, back) = item::decode(code).unwrap_or((0, false));
        let spot = placed.spot_on_front(at);
        let source = self.cut.source(FacetIndex(facet));
        let face = if back { -1.0 } else { 1.0 };
        if !world.varies(source) {
            let at = self.cut.to_source(FacetIndex(facet), at);
            return world.surface_at(source, at, spot, face);
        }
        let part = self.part((facet, placed), (pixel, place), side);
        world.surface_over(&self.pyramids, (source, &part), spot, face)
    }

    /// The part of the scene's triangle that a facet lies in that a square of a pixel sees, of
    /// so many pixels' side; `offset` is its middle.
    fn part(
        &self,
        (facet, placed): (u32, &PictureFacet),
        (pixel, offset): (u32, Vec2),
        side: f32,
    ) -> Part {
        let at = self.within(placed, pixel, offset);
        let planes = &placed.planes;
        let column = (pixel % self.width) as f32 + offset.x;
        let row = (pixel / self.width) as f32 + offset.y;
        let value =
            |plane: &PixelPlane| plane.constant + plane.per_column * column + plane.per_row * row;
        let sum: f32 = planes.iter().map(value).sum();
        // Of u = b/(a + b + c) and v = c/(a + b + c), which are linear each.
        let change = |of: &dyn Fn(&PixelPlane) -> f32| {
            let all: f32 = planes.iter().map(of).sum();
            let own = Vec2::new(of(&planes[1]), of(&planes[2]));
            let change = (own - at * all) / sum * side;
            // What is beyond the triangle does not belong to it.
            if change.is_finite() { change.clamp_length_max(1.0) } else { Vec2::ZERO }
        };
        let edges = [change(&|plane| plane.per_column), change(&|plane| plane.per_row)];
        let facet = FacetIndex(facet);
        let [a, b, c] = self.cut.source_uv(facet);
        let edges = edges.map(|edge| (b - a) * edge.x + (c - a) * edge.y);
        Part { at: self.cut.to_source(facet, at), edges }
    }

    /// Origin and unit direction of the camera's ray through a lobe's n-th sample.
    pub fn lobe_ray(&self, lobe: &Lobe, n: u32) -> (Vec3, Vec3) {
        self.ray(self.of_lobe(lobe).pixel, self.place_of_lobe(lobe, n).1)
    }

    /// Code of the facet, and place in the pixel, of a lobe's n-th sample; once all had their turn, of
    /// another place in that sample's square, since highlights may be finer than the squares.
    fn place_of_lobe(&self, lobe: &Lobe, n: u32) -> (u32, Vec2) {
        let fragment = self.of_lobe(lobe);
        let (code, offset) = self.nth_sample(fragment, n);
        let round = n / self.count(fragment);
        if round == 0 {
            return (code, offset);
        }
        if self.is_whole(fragment) {
            let other = self.another_place(fragment, offset, n);
            return self
                .covering(fragment, (code, other))
                .map_or((code, offset), |own| (own, other));
        }
        for attempt in 0..EDGE_TRIES {
            let attempt = round * EDGE_TRIES + attempt;
            let beside = self.beside(offset, attempt);
            if let Some(code) = self.seen_at(fragment, beside, attempt) {
                return (code, beside);
            }
        }
        (code, offset)
    }

    /// Code of the facet of a fragment that covers a place in its pixel: that of `code`, or another one.
    fn covering(&self, fragment: &Fragment, (code, place): (u32, Vec2)) -> Option<u32> {
        let covers = |code: &u32| {
            let facet = item::decode(*code);
            facet.is_some_and(|(facet, _)| self.is_on(&self.placed(facet), fragment.pixel, place))
        };
        let others = self.groups(fragment).iter().map(|group| match fragment.is_beyond {
            true => other_side(group.code),
            false => group.code,
        });
        std::iter::once(code).chain(others).find(covers)
    }

    /// Code of the facet that is seen at a place in a pixel, if that is the fragment's.
    fn seen_at(&self, fragment: &Fragment, place: Vec2, index: u32) -> Option<u32> {
        let (origin, direction) = self.ray(fragment.pixel, place);
        let rays = &self.placing.world.rays;
        let ray = RayOfPixel { index, pixel: fragment.pixel };
        let hit = rays.closest_in_pixel(origin, direction, ray)?;
        let code = self.code_of(&hit)?;
        self.has_facet(fragment, code).then_some(code)
    }

    /// Whether a fragment's samples see the side of a facet that has that code.
    fn has_facet(&self, fragment: &Fragment, code: u32) -> bool {
        code == fragment.code || self.groups(fragment).iter().any(|group| group.code == code)
    }

    /// The facet of a code, with that and its side.
    fn facet_of(&self, code: u32) -> Option<(u32, (u32, bool), Cow<'_, PictureFacet>)> {
        let (facet, back) = item::decode(code)?;
        Some((code, (facet, back), self.placed(facet)))
    }

    /// A facet for the picture.
    #[inline]
    fn placed(&self, facet: u32) -> Cow<'_, PictureFacet> {
        match self.placed.get(facet as usize) {
            Some(placed) => Cow::Borrowed(placed),
            None => Cow::Owned(self.placing.place(&self.cut, FacetIndex(facet))),
        }
    }

    /// Barycentric coordinates in a facet of a place in a pixel, drawn into the facet.
    fn barycentric(&self, facet: u32, pixel: u32, offset: Vec2) -> Vec2 {
        self.within(&self.placed(facet), pixel, offset)
    }

    fn within(&self, placed: &PictureFacet, pixel: u32, offset: Vec2) -> Vec2 {
        let at = self.unbounded(placed, pixel, offset);
        let u = at.x.clamp(0.0, 1.0);
        let v = at.y.clamp(0.0, 1.0 - u);
        // Edge-on facets may have none.
        let middle = Vec2::splat(1.0 / 3.0);
        if u.is_finite() && v.is_finite() {
            Vec2::new(u, v).lerp(middle, placed.inset)
        } else {
            middle
        }
    }

    /// The same wherever in the plane that is.
    fn unbounded(&self, placed: &PictureFacet, pixel: u32, offset: Vec2) -> Vec2 {
        let column = (pixel % self.width) as f32 + offset.x;
        let row = (pixel / self.width) as f32 + offset.y;
        let [a, b, c] = placed
            .planes
            .map(|plane| plane.constant + plane.per_column * column + plane.per_row * row);
        Vec2::new(b, c) / (a + b + c)
    }

    fn spot(&self, facet: u32, back: bool, at: Vec2) -> (Vec3, Vec3) {
        self.placed(facet).spot(back, at)
    }

    /// Offsets of some samples, by a bit each, in their pixel.
    fn offsets(&self, mask: u64) -> impl Iterator<Item = Vec2> + Clone + '_ {
        let rest = std::iter::successors(Some(mask), |mask| Some(mask & mask.wrapping_sub(1)));
        rest.take_while(|mask| *mask != 0).map(|mask| self.samples[mask.trailing_zeros() as usize])
    }
}

/// The code of the other side of a facet.
fn other_side(code: u32) -> u32 {
    item::decode(code).map_or(code, |(facet, back)| item::encode(facet, !back))
}

/// The place of a number's n-th set bit, counted round and round.
fn nth_bit(mut bits: u64, n: u32) -> u32 {
    for _ in 0..n % bits.count_ones().max(1) {
        bits &= bits - 1;
    }
    bits.trailing_zeros()
}

/// Samples of a pixel that see the same side of the same facet.
#[derive(Clone, Copy)]
struct SampleGroup {
    code: u32,
    mask: u64,
}

#[cfg(test)]
mod tests;
