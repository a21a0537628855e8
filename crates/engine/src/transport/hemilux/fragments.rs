//! What the camera sees, found once for a picture: the sub-pixel samples of each pixel are
//! rasterised and grouped by surface into fragments.

use super::places::FragmentPlaces;
use crate::hemicube::item;
use crate::measurement::{Frame, View};
use crate::patches::{FacetIndex, FacetPlace, PatchedScene};
use crate::radiometry::Rgb;
use crate::raster::{PixelPlane, Target, fill};
use crate::rays::{Spot, inset, unit_normal};
use crate::scene::Camera;
use crate::surface::{Surface, World};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows of pixels that are rasterised together, a parallel task.
const BAND: u32 = 16;
/// Most sub-pixel samples: each has a bit of a fragment's mask.
pub const MOST_SAMPLES: u32 = 64;
/// Cosine of the angle, 14°, by which the normals of facets in one fragment may differ.
const SMOOTH_COSINE: f32 = 0.97;

/// A fragment: the part of a pixel that one smooth surface fills.
#[derive(Clone, Copy)]
pub struct Fragment {
    /// The pixel, row by row from the top.
    pub pixel: u32,
    /// Code of the facet and side that most of its samples see; see [`item`].
    pub code: u32,
    /// Samples that see that side of that facet, a bit each.
    pub mask: u64,
    /// Share of the pixel's samples.
    pub share: f32,
    /// Mean place, ray units, off the surface by the rounding error.
    pub point: Vec3,
    /// Mean unit normal.
    pub normal: Vec3,
    /// Mean diffuse albedo.
    pub diffuse: Rgb,
    /// Whether it reflects a lobe.
    pub glossy: bool,
}

/// Samples of a fragment on one facet that reflects a lobe. Facets that share a fragment have
/// lobes of their own: what a highlight shows turns by twice as much as the surface does.
#[derive(Clone, Copy)]
pub struct Lobe {
    /// Index of the fragment.
    pub fragment: u32,
    /// Facet and side; see [`item`].
    pub code: u32,
    /// Samples that see that side of that facet, a bit each.
    pub mask: u64,
}

/// A facet with its barycentric coordinates as linear functions of the pixel.
struct PictureFacet {
    corners: [Vec3; 3],
    planes: [PixelPlane; 3],
    normal: Vec3,
    inset: f32,
}

/// Sums over the samples of a pixel on one facet.
struct SampleSums {
    /// Of their places in the pixel.
    offset: Vec2,
    /// Of base colours.
    color: Rgb,
    /// Of emitted radiance.
    emission: Rgb,
}

/// What a camera sees: all fragments and lobes of a picture.
pub struct VisibleSurfaces {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The camera's frame, ray units.
    pub frame: Frame,
    scene: Arc<PatchedScene>,
    placed: Vec<PictureFacet>,
    samples: Vec<Vec2>,
    /// Fragments in the order of their pixels.
    pub fragments: Vec<Fragment>,
    /// Lobes in the order of their pixels.
    pub lobes: Vec<Lobe>,
    /// Places and normals of the fragments.
    pub places: FragmentPlaces,
    /// Fragments of pixel p: `start[p]..start[p + 1]`.
    pub start: Vec<u32>,
    /// Emitted radiance that each pixel sees.
    pub shine: Vec<Rgb>,
}

impl VisibleSurfaces {
    /// Rasterises the scene for `samples` sub-pixel samples.
    pub fn new(
        world: &World,
        scene: Arc<PatchedScene>,
        camera: &Camera,
        [width, height]: [u32; 2],
        samples: u32,
    ) -> Self {
        let view = View::new(&scene, camera, width, height);
        let place = |facet: &crate::patches::Facet| {
            let corners = facet.corners.map(|c| scene.positions[c as usize]);
            let planes = view.edges(corners);
            let corners = corners.map(|corner| world.rays.place(corner));
            let normal = unit_normal(corners);
            PictureFacet { corners, planes, normal, inset: inset(corners) }
        };
        let placed = scene.facets.par_iter().with_min_len(1024).map(place).collect();
        let mut visible = Self {
            width,
            height,
            frame: Frame::new(&world.rays.camera(camera), width, height),
            placed,
            samples: crate::measurement::sample_pattern(samples.clamp(1, MOST_SAMPLES)),
            scene: scene.clone(),
            fragments: Vec::new(),
            lobes: Vec::new(),
            places: FragmentPlaces::default(),
            start: vec![0],
            shine: Vec::with_capacity((width * height) as usize),
        };
        let bands: Vec<Band> = (0..height.div_ceil(BAND))
            .into_par_iter()
            .map(|band| visible.band(world, &view, band * BAND))
            .collect();
        let mut firsts = vec![0];
        for band in &bands {
            let first = firsts[firsts.len() - 1];
            visible.start.extend(band.ends.iter().map(|end| end + first as u32));
            visible.shine.extend(&band.shine);
            let own = band.lobes.iter();
            visible
                .lobes
                .extend(own.map(|lobe| Lobe { fragment: lobe.fragment + first as u32, ..*lobe }));
            firsts.push(first + band.fragments.len());
        }
        // By all threads, since most of the time goes into memory that is new.
        let fragment = |index: usize| {
            let band = firsts.partition_point(|first| *first <= index) - 1;
            bands[band].fragments[index - firsts[band]]
        };
        let total = firsts[bands.len()];
        visible.fragments = (0..total).into_par_iter().with_min_len(1024).map(fragment).collect();
        visible.places =
            FragmentPlaces::new(&visible.fragments, |fragment| (fragment.point, fragment.normal));
        visible
    }

    /// The surface point of a fragment's n-th sample, off the surface by the rounding error.
    pub fn sample_point(&self, fragment: &Fragment, n: u32) -> Vec3 {
        let offset = self.sample(fragment.mask, n);
        let Some((facet, back)) = item::decode(fragment.code) else { return fragment.point };
        let at = self.barycentric(facet, fragment.pixel, offset);
        self.spot(facet, back, at).0
    }

    /// The surface point of the sample that is nearest to the middle of a fragment's: what it
    /// sees, and near what it sees on average, even where a pixel looks along the surface.
    pub fn middle_point(&self, fragment: &Fragment) -> Vec3 {
        let visible = |fragment: &Fragment| {
            let mask = fragment.mask;
            let samples = self.samples.iter().enumerate();
            samples.filter(move |(bit, _)| mask >> bit & 1 == 1).map(|(_, offset)| *offset)
        };
        let middle = visible(fragment).sum::<Vec2>() / fragment.mask.count_ones().max(1) as f32;
        let off = |offset: &Vec2| offset.distance_squared(middle);
        let nearest = visible(fragment).min_by(|a, b| off(a).total_cmp(&off(b)));
        let (Some(offset), Some((facet, back))) = (nearest, item::decode(fragment.code)) else {
            return fragment.point;
        };
        self.spot(facet, back, self.barycentric(facet, fragment.pixel, offset)).0
    }

    /// Facet, side and barycentric coordinates of a fragment's first sample.
    pub fn place_on_facet(&self, fragment: &Fragment) -> FacetPlace {
        let (facet, back) = item::decode(fragment.code).unwrap_or((0, false));
        let offset = self.sample(fragment.mask, 0);
        let at = self.barycentric(facet, fragment.pixel, offset);
        FacetPlace { facet: FacetIndex(facet), back, at }
    }

    /// Share of the pixel's samples that a lobe has.
    pub fn share(&self, lobe: &Lobe) -> f32 {
        lobe.mask.count_ones() as f32 / self.samples.len() as f32
    }

    /// The surface at a lobe's n-th sample.
    pub fn surface(&self, world: &World, lobe: &Lobe, n: u32) -> Surface {
        let (facet, back) = item::decode(lobe.code).unwrap_or((0, false));
        let pixel = self.fragments[lobe.fragment as usize].pixel;
        let at = self.barycentric(facet, pixel, self.sample(lobe.mask, n));
        let placed = &self.placed[facet as usize];
        let spot = Spot::new(placed.corners, placed.normal, at.x, at.y);
        let piece = &self.scene.facets[facet as usize];
        let at = piece.to_source(at.x, at.y);
        let side = if back { -1.0 } else { 1.0 };
        world.surface_at(piece.source, at, spot, side)
    }

    fn sample(&self, mut mask: u64, n: u32) -> Vec2 {
        let bits = mask.count_ones();
        for _ in 0..n % bits.max(1) {
            mask &= mask - 1;
        }
        self.samples[mask.trailing_zeros().min(self.samples.len() as u32 - 1) as usize]
    }

    fn barycentric(&self, facet: u32, pixel: u32, offset: Vec2) -> Vec2 {
        let column = (pixel % self.width) as f32 + offset.x;
        let row = (pixel / self.width) as f32 + offset.y;
        let placed = &self.placed[facet as usize];
        let [a, b, c] = placed
            .planes
            .map(|plane| plane.constant + plane.per_column * column + plane.per_row * row);
        let sum = a + b + c;
        let u = (b / sum).clamp(0.0, 1.0);
        let v = (c / sum).clamp(0.0, 1.0 - u);
        // Edge-on facets may have no sum.
        let middle = Vec2::splat(1.0 / 3.0);
        if u.is_finite() && v.is_finite() {
            Vec2::new(u, v).lerp(middle, placed.inset)
        } else {
            middle
        }
    }

    fn spot(&self, facet: u32, back: bool, at: Vec2) -> (Vec3, Vec3) {
        let placed = &self.placed[facet as usize];
        let normal = if back { -placed.normal } else { placed.normal };
        (Spot::new(placed.corners, placed.normal, at.x, at.y).off_surface(normal), normal)
    }

    fn band(&self, world: &World, view: &View, first_row: u32) -> Band {
        let rows = BAND.min(self.height - first_row);
        let pixels = (rows * self.width) as usize;
        let count = self.samples.len();
        let mut items = vec![0u32; pixels * count];
        let mut depth = vec![0f32; pixels];
        let triangles = view.in_rows(first_row, first_row + rows);
        for (offset, items) in self.samples.iter().zip(items.chunks_mut(pixels)) {
            depth.fill(0.0);
            let mut target = Target { width: self.width, first_row, items, depth: &mut depth };
            for triangle in &triangles {
                fill(&mut target, &triangle.moved(*offset));
            }
        }
        let mut band = Band {
            fragments: Vec::with_capacity(pixels + pixels / 8),
            lobes: Vec::new(),
            ends: Vec::with_capacity(pixels),
            shine: Vec::with_capacity(pixels),
        };
        let mut groups: Vec<SampleGroup> = Vec::new();
        for pixel in 0..pixels {
            groups.clear();
            for sample in 0..count {
                let code = items[sample * pixels + pixel];
                if code == item::EMPTY {
                    continue;
                }
                let bit = 1u64 << sample;
                match groups.iter_mut().find(|group| group.code == code) {
                    Some(group) => group.mask |= bit,
                    None => groups.push(SampleGroup { code, mask: bit }),
                }
            }
            let pixel = first_row * self.width + pixel as u32;
            let shine = self.collect(world, pixel, &groups, &mut band);
            band.shine.push(shine);
            band.ends.push(band.fragments.len() as u32);
        }
        band
    }

    /// Appends the fragments and lobes of a pixel; returns the emitted radiance that it sees.
    fn collect(&self, world: &World, pixel: u32, groups: &[SampleGroup], band: &mut Band) -> Rgb {
        let Band { fragments, lobes, .. } = band;
        let mut shine = Rgb::ZERO;
        let first = fragments.len();
        for group in groups {
            let Some((one, own)) = self.fragment_of(world, pixel, group) else { continue };
            shine += own;
            if one.diffuse == Rgb::ZERO && !one.glossy {
                continue;
            }
            // Facets of a smooth surface share a fragment.
            let reach = 3.0 * self.frame.footprint(one.point, self.height);
            let near = fragments[first..].iter().position(|other| {
                other.glossy == one.glossy
                    && other.normal.dot(one.normal) > SMOOTH_COSINE
                    && other.normal.dot(other.point - one.point).abs() < reach
                    && (other.diffuse - one.diffuse).abs().max_element() < 0.02
            });
            let fragment = near.map_or(fragments.len(), |near| first + near);
            match fragments.get_mut(fragment) {
                Some(other) => other.merge(&one),
                None => fragments.push(one),
            }
            if one.glossy {
                lobes.push(Lobe { fragment: fragment as u32, code: group.code, mask: group.mask });
            }
        }
        for fragment in &mut fragments[first..] {
            fragment.normal = fragment.normal.normalize_or(Vec3::Z);
        }
        shine
    }

    /// A fragment of a group of samples, and the emitted radiance that it adds to the pixel.
    fn fragment_of(
        &self,
        world: &World,
        pixel: u32,
        group: &SampleGroup,
    ) -> Option<(Fragment, Rgb)> {
        let &SampleGroup { code, mask } = group;
        let (facet, back) = item::decode(code)?;
        let source = self.scene.facets[facet as usize].source;
        let finish = world.finish(source);
        let each = 1.0 / self.samples.len() as f32;
        let count = mask.count_ones() as f32;
        let share = count * each;
        let sums = self.sum_samples(world, pixel, facet, mask, finish.varies);
        let at = self.barycentric(facet, pixel, sums.offset / count);
        let point = self.spot(facet, back, at).0;
        let (diffuse, shine) = if finish.varies {
            // Of the mean colour, as what is diffuse is proportional to the colour, but for
            // surfaces that are in part metal.
            let mean = world.material(source).reflectance(sums.color / count);
            (mean.diffuse, sums.emission * each)
        } else {
            (finish.reflectance.diffuse, finish.emission * share)
        };
        let glossy = finish.reflectance.is_glossy();
        let placed = &self.placed[facet as usize];
        let normal = if back { -placed.normal } else { placed.normal };
        let fragment = Fragment { pixel, code, mask, share, point, normal, diffuse, glossy };
        Some((fragment, shine))
    }

    /// Sums over some samples of a facet: of their offsets and, where these vary, of colours.
    fn sum_samples(
        &self,
        world: &World,
        pixel: u32,
        facet: u32,
        mut mask: u64,
        varies: bool,
    ) -> SampleSums {
        let facet_of = &self.scene.facets[facet as usize];
        let mut sums = SampleSums { offset: Vec2::ZERO, color: Rgb::ZERO, emission: Rgb::ZERO };
        while mask != 0 {
            let offset = self.samples[mask.trailing_zeros() as usize];
            mask &= mask - 1;
            sums.offset += offset;
            if varies {
                let at = self.barycentric(facet, pixel, offset);
                let at = facet_of.to_source(at.x, at.y);
                let (color, emission) = world.colors_at(facet_of.source, at.x, at.y);
                sums.color += color;
                sums.emission += emission;
            }
        }
        sums
    }
}

impl Fragment {
    /// Takes in another facet of the same surface in the same pixel.
    fn merge(&mut self, other: &Fragment) {
        let share = self.share + other.share;
        let (mine, theirs) = (self.share / share, other.share / share);
        self.normal = (self.normal * mine + other.normal * theirs).normalize_or(self.normal);
        self.diffuse = self.diffuse * mine + other.diffuse * theirs;
        if other.mask.count_ones() > self.mask.count_ones() {
            (self.code, self.mask, self.point) = (other.code, other.mask, other.point);
        }
        self.share = share;
    }
}

/// Samples of a pixel that see the same side of the same facet.
struct SampleGroup {
    code: u32,
    mask: u64,
}

/// What a band of rows sees; indices of fragments begin at 0 in each band.
struct Band {
    fragments: Vec<Fragment>,
    lobes: Vec<Lobe>,
    ends: Vec<u32>,
    shine: Vec<Rgb>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::{EMISSION, Specimen};

    #[test]
    fn the_samples_of_a_pixel_are_shared_out() {
        let specimen = Specimen::furnace();
        let visible = specimen.visible();
        assert_eq!(visible.start.len(), (visible.width * visible.height) as usize + 1);
        for pixel in 0..(visible.width * visible.height) as usize {
            let own = &visible.fragments
                [visible.start[pixel] as usize..visible.start[pixel + 1] as usize];
            assert!(own.iter().all(|fragment| fragment.pixel as usize == pixel));
            let share: f32 = own.iter().map(|fragment| fragment.share).sum();
            assert!((share - 1.0).abs() < 1e-5, "pixel {pixel} of a closed room sees {share}");
            assert!((visible.shine[pixel] - Rgb::splat(EMISSION)).abs().max_element() < 1e-5);
        }
    }

    #[test]
    fn lobes_are_there_where_something_is_glossy() {
        let visible = Specimen::new(&made::phong_cornell(), 500).visible();
        let glossy = visible.fragments.iter().filter(|fragment| fragment.glossy).count();
        assert!(glossy > 0 && visible.lobes.len() >= glossy);
        assert!(visible.lobes.iter().all(|lobe| visible.fragments[lobe.fragment as usize].glossy));
        assert!(
            visible.lobes.is_sorted_by_key(|lobe| visible.fragments[lobe.fragment as usize].pixel)
        );
        assert!(Specimen::furnace().visible().lobes.is_empty());
    }
}
