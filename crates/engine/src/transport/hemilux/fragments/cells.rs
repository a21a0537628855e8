//! Square cells that a glossy fragment's part of a pixel is cut into, and how its surface changes over each.

use super::{Fragment, Lobe, VisibleSurfaces};
use crate::hemicube::item;
use crate::patches::FacetIndex;
use crate::rays::RayOfPixel;
use crate::surface::{Surface, World};
use glam::Vec2;

/// How far beyond a cell's middle its surface is looked at, in its side: all it takes, or less where the facet has an
/// end before that.
const REACHES: [f32; 5] = [0.5, 0.125, 0.03, 0.008, 0.002];
/// By how much that may leave the facet, in barycentric coordinates: what these say holds beside it, too, on a smooth
/// surface.
const MOST_BESIDE: f32 = 1.0;

/// A square of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Its middle, from the pixel's.
    pub middle: Vec2,
    /// Its side, in pixels.
    pub side: f32,
}

/// All of a pixel.
pub const PIXEL: Cell = Cell { middle: Vec2::ZERO, side: 1.0 };

impl Cell {
    /// Its area, in pixels.
    pub fn area(&self) -> f32 {
        self.side * self.side
    }

    /// Its quarters.
    pub fn quarters(&self) -> [Self; 4] {
        let side = 0.5 * self.side;
        let quarter = |x: f32, y: f32| Self { middle: self.middle + side * Vec2::new(x, y), side };
        [quarter(-0.5, -0.5), quarter(0.5, -0.5), quarter(-0.5, 0.5), quarter(0.5, 0.5)]
    }
}

/// What a cell sees of a surface.
pub struct CellView {
    /// Its middle.
    pub middle: Surface,
    /// Places beside that, on the same facet, if there are: where, in the cell's side, to the right and down, and the
    /// surface there.
    pub beside: [Option<(f32, Surface)>; 2],
}

impl VisibleSurfaces {
    /// Whether a normal map tilts what a lobe's fragment shows.
    pub fn has_normal_map(&self, world: &World, lobe: &Lobe) -> bool {
        let (triangle, ..) = self.place_on_triangle(self.of_lobe(lobe), 0);
        let material = world.scene.triangle(triangle).material;
        world.scene.materials[material as usize].has_normal_map()
    }

    /// The cells of a lobe's fragment: the quarters of the pixel, or those of a grid whose middles have a sample of the
    /// fragment next to them, where it shares its pixel.
    pub fn cells(&self, lobe: &Lobe) -> Vec<Cell> {
        let fragment = self.of_lobe(lobe);
        if self.is_whole(fragment) {
            return PIXEL.quarters().to_vec();
        }
        let count = (self.samples.len() as f32).sqrt().ceil() as u32;
        let at = |k: u32| (k as f32 + 0.5) / count as f32 - 0.5;
        let side = 1.0 / count as f32;
        let cell = |k: u32| Cell { middle: Vec2::new(at(k % count), at(k / count)), side };
        let own = self.all_samples(fragment);
        let is_own = |cell: &Cell| own >> self.nearest_sample(u64::MAX, cell.middle) & 1 == 1;
        (0..count * count).map(cell).filter(is_own).collect()
    }

    /// The surface that a cell sees of a lobe's fragment.
    pub fn view_of_cell(&self, world: &World, lobe: &Lobe, cell: &Cell) -> CellView {
        let fragment = self.of_lobe(lobe);
        let code = self.code_near(fragment, cell.middle);
        let (facet, _) = item::decode(code).unwrap_or((0, false));
        let placed = self.placed(facet);
        let at = |place: Vec2| {
            let unbounded = self.unbounded(&placed, fragment.pixel, place);
            let is_near = is_beside(unbounded);
            let at = if is_near { unbounded } else { self.within(&placed, fragment.pixel, place) };
            self.surface_in(world, (code, &placed, at), (fragment.pixel, place), cell.side)
        };
        let middle = at(cell.middle);
        // What it reflects may take textures, and counts in the middle alone.
        let beside_at = |place: Vec2| {
            let at = self.unbounded(&placed, fragment.pixel, place);
            let source = self.cut.to_source(FacetIndex(facet), at);
            world.turned(&middle, source, placed.spot_on_front(at))
        };
        let beside = [Vec2::X, Vec2::Y].map(|axis| {
            let steps = REACHES.iter().flat_map(|reach| [*reach, -reach]);
            let is_near = |step: &f32| {
                is_beside(self.unbounded(
                    &placed,
                    fragment.pixel,
                    cell.middle + axis * *step * cell.side,
                ))
            };
            let step = steps.into_iter().find(is_near)?;
            Some((step, beside_at(cell.middle + axis * step * cell.side)))
        });
        CellView { middle, beside }
    }

    /// Code of the facet of a fragment at a place in its pixel: of the sample next to it, if that covers the place, or
    /// what a ray meets there.
    fn code_near(&self, fragment: &Fragment, place: Vec2) -> u32 {
        if fragment.has_one_facet() {
            return fragment.code;
        }
        let nearest = self.nearest_sample(self.all_samples(fragment), place);
        let code = self.code_of_sample(fragment, nearest);
        let covers =
            |(facet, _): (u32, bool)| self.is_on(&self.placed(facet), fragment.pixel, place);
        if item::decode(code).is_some_and(covers) {
            return code;
        }
        self.met_at(fragment, (code, place)).unwrap_or(code)
    }

    /// The sample, of those whose bits are set, that is next to a place.
    fn nearest_sample(&self, of: u64, place: Vec2) -> u32 {
        let off = |n: &u32| self.samples[*n as usize].distance_squared(place);
        let all = (0..self.samples.len() as u32).filter(|n| of >> n & 1 == 1);
        all.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
    }

    /// Code of the facet that a ray through a place in a fragment's pixel meets, if that is of the same material as
    /// that of `code` and on the same side. Of facets that are smaller than what is between samples most have none.
    fn met_at(&self, fragment: &Fragment, (code, place): (u32, Vec2)) -> Option<u32> {
        let (origin, direction) = self.ray(fragment.pixel, place);
        let ray = RayOfPixel { index: 0, pixel: fragment.pixel };
        let hit = self.placing.world.rays.closest_in_pixel(origin, direction, ray)?;
        let met = self.code_of(&hit)?;
        let scene = &self.placing.world.scene;
        let [seen, known] = [met, code].map(|code| {
            let (facet, back) = item::decode(code)?;
            Some((scene.triangle(self.cut.source(FacetIndex(facet))).material, back))
        });
        (seen == known).then_some(met)
    }
}

/// Whether barycentric coordinates are on a facet or next to it.
fn is_beside(at: Vec2) -> bool {
    at.min_element() > -MOST_BESIDE && at.element_sum() < 1.0 + MOST_BESIDE
}
