//! Crevices: the parts of elements over which something lies close, as of a ceiling over a lamp or of a
//! floor under a cupboard. What lights them is not what lights the rest, and they are hardly seen from the
//! room, so that they are elements of their own (docs/decisions/0085).

use super::elements::{Crevices, ElementIndex, Elements, Hidden};
use super::mesh::CoarseMesh;
use crate::patches::Cut;
use crate::radiometry::Rgb;
use crate::sampling::Next;
use crate::surface::World;
use crate::transport::patch_points::{LitPoint, PatchPoints};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// A place lies in a crevice if something is straight above it, nearer than this share of its element's side.
const REACH: f32 = 0.25;
/// Places of an element at which that is asked at first.
const FEW_PROBES: u32 = 8;
/// Places at which it is asked where one of those lies in a crevice, or one of an element beside.
const PROBES: u32 = 64;
/// By how many times fewer they are in a hasty job.
const FEWER_IN_HASTE: u32 = 4;
/// Steps from one of these places to the next, by the plastic number.
const STEPS: [f32; 2] = [0.754_877_7, 0.569_840_3];
/// Most places that are tried for one of the part of an element that is wanted.
const TRIES: u32 = 512;
/// Elements that a thread looks at together.
const CHUNK: usize = 64;

impl CoarseMesh {
    /// The same where crevices in elements of one patch each are elements of their own; looked for at
    /// fewer places in a hasty job.
    pub fn with_crevices(mut self, world: &World, hasty: bool) -> Self {
        let mesh = &self;
        let fewer = if hasty { FEWER_IN_HASTE } else { 1 };
        let all = || (0..mesh.elements.len() as u32).into_par_iter().with_min_len(CHUNK);
        let look = |element, probes| hidden(world, mesh, ElementIndex(element), probes);
        let found: Vec<f32> =
            all().map(|element| look(element, FEW_PROBES / fewer).share).collect();
        let beside = mesh.ranges_beside(&found);
        let look_again = |element: u32| {
            let own = found[element as usize];
            let beside = beside[element as usize].map_or(0.0, |[_, most]| most);
            if own.max(beside) > 0.0 { look(element, PROBES / fewer) } else { Hidden::default() }
        };
        let hidden: Vec<Hidden> = all().map(look_again).collect();
        self.elements.part(Crevices::new(&hidden));
        self
    }
}

impl Elements {
    /// The part of an element that a place above it belongs to, with the geometric normal there.
    pub fn part_at(
        &self,
        world: &World,
        element: ElementIndex,
        place: impl FnOnce() -> (Vec3, Vec3),
    ) -> ElementIndex {
        let Some(crevice) = self.crevices.of(element) else { return element };
        let (start, normal) = place();
        match is_hidden(world, self.side(world, element), start, normal) {
            true => crevice,
            false => element,
        }
    }

    /// A point of an element among those of one of its patches: the one for two uniform numbers or, where that is
    /// of another part of the patch, one by further numbers.
    pub fn lit_point(
        &self,
        world: &World,
        element: ElementIndex,
        points: &PatchPoints,
        xi: [f32; 2],
        mut next: Next,
    ) -> LitPoint {
        let mut lit = points.lit_point(world, xi);
        if !self.is_part(element) {
            return lit;
        }
        let whole = self.crevices.whole(element);
        for _ in 0..TRIES {
            if self.part_at(world, whole, || (lit.start, lit.normal)) == element {
                break;
            }
            lit = points.lit_point(world, next.afresh().bounce);
            next = next.after();
        }
        lit
    }

    /// Whether an element is a crevice or has one.
    pub fn is_part(&self, element: ElementIndex) -> bool {
        self.crevices.whole(element) != element || self.crevices.of(element).is_some()
    }

    /// From the centroid of an element's patch to that of the places whose light it stands for, those beside
    /// its crevice, in sides of the patch along the edges of its facet.
    pub fn center(&self, element: ElementIndex) -> Vec2 {
        self.crevices.center_beside(element)
    }

    /// Whether an element is one patch, which is one plane.
    pub fn is_one_patch(&self, cut: &Cut, element: ElementIndex) -> bool {
        let members = self.members(element);
        members.len() == 1 && !cut.is_cluster(members[0])
    }

    /// Area of an element without its crevice, or of a crevice, m².
    pub fn own_area(&self, element: ElementIndex) -> f32 {
        self.area[element.at()] * self.crevices.share(element)
    }

    /// Side of an element with its crevice, ray units.
    pub fn side(&self, world: &World, element: ElementIndex) -> f32 {
        self.area[element.at()].sqrt() * world.rays.scale() as f32
    }
}

/// Whether something is close above a place of an element with that side, ray units.
pub fn is_hidden(world: &World, side: f32, start: Vec3, normal: Vec3) -> bool {
    world.rays.blocked(start, start + REACH * side * normal, |_| false)
}

/// Over which part of an element something is close, by so many places of it.
fn hidden(world: &World, mesh: &CoarseMesh, element: ElementIndex, probes: u32) -> Hidden {
    let CoarseMesh { cut, elements, .. } = mesh;
    if !elements.is_one_patch(cut, element) || elements.albedo[element.at()] == Rgb::ZERO {
        return Hidden::default();
    }
    let points = elements.points(world, cut, element, 0.5);
    let side = elements.side(world, element);
    let place = |probe: u32| STEPS.map(|step| (step * (probe as f32 + 0.5)).fract());
    let is_open = |xi: &[f32; 2]| {
        let (start, normal) = points.point(*xi);
        !is_hidden(world, side, start, normal)
    };
    let open = (0..probes).map(place).filter(is_open);
    let (count, sum) =
        open.fold((0.0, Vec2::ZERO), |(count, sum), xi| (count + 1.0, sum + points.offset(xi)));
    let center_beside = if count > 0.0 { sum / count } else { Vec2::ZERO };
    Hidden { share: 1.0 - count / probes as f32, center_beside }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;
    use crate::sampling::Shifted;
    use crate::scene::made;
    use crate::transport::hemilux::coarse::CoarseSolution;
    use crate::transport::hemilux::specimen::{DRAWING, SEED, Specimen};
    use std::f32::consts::PI;

    /// Whether one of the boxes is straight above or below a place.
    fn is_over_or_under(world: &World, boxes: &[[Vec3; 2]], at: Vec3) -> bool {
        boxes.iter().any(|corners| {
            let [low, high] = corners.map(|corner| world.rays.place(corner));
            (low.x..high.x).contains(&at.x) && (low.z..high.z).contains(&at.z)
        })
    }

    /// Crevices are just what lies under the lamp's footprint, above it and on the ceiling, and points of
    /// elements are of their part.
    #[test]
    fn what_lies_over_a_lamp_is_a_crevice() {
        let made::CeilingLamps { glb, boxes, .. } = made::ceiling_lamps(0.01);
        let Specimen { world, coarse, .. } = Specimen::new(&glb, 4000);
        let (elements, cut) = (&coarse.mesh.elements, &coarse.mesh.cut);
        let whole = |element: &ElementIndex| elements.crevices.whole(*element);
        let counted: f32 = elements.counted.iter().sum();
        let area: f32 = elements
            .all()
            .filter(|element| whole(element) == *element)
            .map(|element| elements.area[element.at()])
            .sum();
        assert!(
            (counted / area - 1.0).abs() < 1e-4,
            "every place is of one part: {counted} {area}"
        );
        let (mut points_of_parts, mut wrong) = (0, 0);
        for element in elements.all().filter(|element| elements.is_part(*element)) {
            let sequence = Shifted::new(SEED, Stream::PatchLight, u64::from(element.0));
            let is_crevice = whole(&element) != element;
            for number in 0..20 {
                let numbers = sequence.at(number);
                let points = elements.points(&world, cut, element, 0.5);
                let lit =
                    elements.lit_point(&world, element, &points, numbers.pair(), numbers.beside());
                let at = lit.start;
                let is_covered = is_over_or_under(&world, &boxes, at);
                points_of_parts += 1;
                wrong += usize::from(is_covered != is_crevice);
            }
        }
        // Of a part that is too small for its places to be found, others are taken.
        assert!(points_of_parts > 1000, "{points_of_parts}");
        assert!(100 * wrong < points_of_parts, "{wrong} of {points_of_parts}");
    }

    /// What an element's light is the mean of lies beside the lamp, and so does its centre.
    #[test]
    fn the_rest_of_an_element_has_a_centre_of_its_own() {
        let made::CeilingLamps { glb, boxes, .. } = made::ceiling_lamps(0.01);
        let Specimen { world, coarse, .. } = Specimen::new(&glb, 4000);
        let (elements, cut) = (&coarse.mesh.elements, &coarse.mesh.cut);
        let (mut parts, mut off, mut all) = (0, 0.0, 0.0);
        for element in elements.all().filter(|element| elements.crevices.of(*element).is_some()) {
            let points = elements.points(&world, cut, element, 0.5);
            let is_beside = |xi: &[f32; 2]| !is_over_or_under(&world, &boxes, points.point(*xi).0);
            let grid = (0..4096).map(|n| [(n % 64) as f32 + 0.5, (n / 64) as f32 + 0.5]);
            let beside = grid.map(|at| at.map(|x| x / 64.0)).filter(is_beside);
            let (sum, count) = beside
                .fold((Vec2::ZERO, 0.0), |(sum, count), xi| (sum + points.offset(xi), count + 1.0));
            if count > 1024.0 {
                let (center, exact) = (elements.center(element), sum / count);
                assert!(center.distance(exact) < 0.15, "{center} instead of {exact}");
                parts += 1;
                off += center.distance_squared(exact);
                all += exact.length_squared();
            }
        }
        assert!(parts > 20 && off < 0.2 * all, "{parts} parts, {off} off of {all}");
    }

    /// Σ (1 − a) E A of all surfaces, what ends in them, over the power of the lamps.
    fn what_ends(coarse: &CoarseSolution, lamps: &made::CeilingLamps) -> f32 {
        let (links, albedo, sources) = coarse.parts();
        let elements = &coarse.mesh.elements;
        let ends = |element: ElementIndex| {
            let element = element.at();
            let arriving = sources.direct[element].irradiance + links.bounced[element];
            ((Rgb::ONE - albedo[element]) * arriving).x * elements.counted[element]
        };
        elements.all().map(ends).sum::<f32>() / (PI * lamps.emission * lamps.area)
    }

    /// What lamps send ends in surfaces, wherever they hang.
    #[test]
    fn light_beside_crevices_is_neither_lost_nor_made() {
        for gap in [0.0, 0.002, 0.01, 0.3] {
            let lamps = made::ceiling_lamps(gap);
            let mut specimen = Specimen::new(&lamps.glb, 4000);
            specimen.coarse.link(SEED, 16, 256);
            let ends = what_ends(&specimen.coarse, &lamps);
            assert!((ends - 1.0).abs() < 0.01, "{gap}: {ends}");
            if gap > 0.0 && gap < 0.1 {
                let Specimen { world, lights, cut, .. } = specimen;
                let mesh = CoarseMesh::new(&world.rays, cut.clone(), Elements::new(&cut, 4000));
                let mut whole = CoarseSolution::new(world, lights, mesh, DRAWING, None);
                whole.link(SEED, 16, 256);
                let ends = what_ends(&whole, &lamps);
                assert!((ends - 1.0).abs() > 0.03, "{gap}: as well without: {ends}");
            }
        }
    }
}
