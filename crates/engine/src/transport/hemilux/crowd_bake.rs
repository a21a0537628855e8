//! The solution of a crowd as a mesh with the light in its vertices. Each side of a triangle, or each
//! patch of one that is cut, is a triangle of the mesh. What has one material and faces the same way
//! around a place shares a vertex there, with the mean of its light.

use super::coarse::CoarseSolution;
use crate::patches::{Crowd, CrowdPatch, PatchIndex};
use crate::radiometry::Rgb;
use crate::scene::gltf::BakedMesh;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Cosine of the angle, 18°, by which the normals of what shares a vertex may differ there.
const SMOOTH_COSINE: f32 = 0.95;
/// Places are the same that differ by less than about this share of the scene's extent.
const SAME_PLACE: f32 = 1e-6;
/// Most corners at one place of which means are made: their number grows with its square.
const MOST_AROUND: usize = 64;
/// Places that a thread takes at a time.
const CHUNK: usize = 4096;
/// Bytes of a triangle in the mesh, at least: its indices, and half a vertex.
const LEAST_BYTES: u64 = 24;

/// A triangle of the mesh.
struct Leaf {
    /// Counter-clockwise seen from the side that sends the light.
    corners: [Vec3; 3],
    /// At the corners, smooth where the surface is.
    normals: [Vec3; 3],
    area: f32,
    /// What it sends.
    radiance: Rgb,
    emits: bool,
    material: u32,
}

/// Vertices of some places.
#[derive(Default)]
struct Vertices {
    own: Vec<(Vec3, Rgb)>,
    /// Which of them each corner of a leaf has.
    of_corner: Vec<(u32, u32)>,
    /// Most radiance of those that do not emit by themselves.
    brightest: f32,
}

/// The mesh of a solution; `None` where it would take more than so many bytes.
pub fn bake(coarse: &CoarseSolution, crowd: &Crowd, most_bytes: u64) -> Option<BakedMesh> {
    if LEAST_BYTES * crowd.scene.triangle_count() as u64 > most_bytes {
        return None;
    }
    let leaves = leaves(coarse, crowd);
    let corners = sorted_by_place(&leaves);
    let places: Vec<&[(u64, u32)]> = corners.chunk_by(|a, b| a.0 == b.0).collect();
    let of_chunk = |places: &[&[(u64, u32)]]| {
        let mut found = Vertices::default();
        places.iter().for_each(|place| found.add(&leaves, place));
        found
    };
    let chunks: Vec<Vertices> = places.par_chunks(CHUNK).map(of_chunk).collect();
    let mut mesh = BakedMesh { indices: vec![0; 3 * leaves.len()], ..BakedMesh::default() };
    for chunk in chunks {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(chunk.own.iter().map(|vertex| vertex.0));
        mesh.radiance.extend(chunk.own.iter().map(|vertex| vertex.1));
        for (corner, vertex) in chunk.of_corner {
            mesh.indices[corner as usize] = first + vertex;
        }
        mesh.brightest = mesh.brightest.max(chunk.brightest);
    }
    (mesh.size() <= most_bytes).then_some(mesh)
}

/// All triangles of the mesh, with what they send.
fn leaves(coarse: &CoarseSolution, crowd: &Crowd) -> Vec<Leaf> {
    let of_side = |(patch, own): (PatchIndex, CrowdPatch)| {
        let order = if own.back { [0, 2, 1] } else { [0, 1, 2] };
        let corners = crowd.corners(&own);
        let corners = order.map(|corner| corners[corner]);
        let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let area = 0.5 * across.length();
        let means = crowd.means(patch, &own);
        let irradiance = coarse.of_patch(patch).max(Rgb::ZERO);
        let radiance = means.albedo * irradiance / PI + means.emission;
        let is_sound = area > 0.0 && area.is_finite() && radiance.is_finite();
        let material = crowd.scene.triangle(own.triangle).material;
        let emits = means.emission != Rgb::ZERO;
        let (flat, side) = (across.normalize_or_zero(), if own.back { -1.0 } else { 1.0 });
        let normals = order
            .map(|corner| coarse.world.smooth_normal(own.triangle, own.at[corner], flat, side));
        is_sound.then_some(Leaf { corners, normals, area, radiance, emits, material })
    };
    crowd.all_sides().filter_map(of_side).collect()
}

/// Corners of all leaves, 3 i + k that of leaf i, sorted by their places' hashes.
fn sorted_by_place(leaves: &[Leaf]) -> Vec<(u64, u32)> {
    let all = leaves.iter().flat_map(|leaf| leaf.corners);
    let extent = all.fold(0.0f32, |most, place| most.max(place.abs().max_element()));
    let per_step = 1.0 / (SAME_PLACE * extent).max(f32::MIN_POSITIVE);
    let of_corner = |corner: usize| {
        let steps = (leaves[corner / 3].corners[corner % 3] * per_step).round();
        let mix = |hash: u64, step: f32| {
            (hash ^ (step as i64 as u64)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
        };
        (steps.to_array().into_iter().fold(0, mix), corner as u32)
    };
    let mut sorted: Vec<(u64, u32)> =
        (0..3 * leaves.len()).into_par_iter().map(of_corner).collect();
    sorted.par_sort_unstable();
    sorted
}

impl Vertices {
    /// Adds the vertices at a place.
    fn add(&mut self, leaves: &[Leaf], place: &[(u64, u32)]) {
        let first = self.own.len();
        for (_, corner) in place {
            let leaf = &leaves[*corner as usize / 3];
            let at = leaf.corners[*corner as usize % 3];
            let radiance = match place.len() > MOST_AROUND {
                true => leaf.radiance,
                false => mean_around(leaves, place, *corner),
            };
            // What the same leaves make the mean of is the same to the bit.
            let known =
                self.own[first..].iter().take(MOST_AROUND).position(|own| own.1 == radiance);
            let vertex = known.map_or(self.own.len(), |known| first + known);
            if known.is_none() {
                self.own.push((at, radiance));
            }
            if !leaf.emits {
                self.brightest = self.brightest.max(radiance.max_element());
            }
            self.of_corner.push((*corner, vertex as u32));
        }
    }
}

/// What the leaves at a place send that are like the one there with that corner.
fn mean_around(leaves: &[Leaf], place: &[(u64, u32)], corner: u32) -> Rgb {
    let of = |corner: u32| {
        let leaf = &leaves[corner as usize / 3];
        (leaf, leaf.normals[corner as usize % 3])
    };
    let (leaf, normal) = of(corner);
    let others = place.iter().map(|(_, corner)| of(*corner));
    let alike = others.filter(|(other, other_normal)| {
        other.material == leaf.material && other_normal.dot(normal) > SMOOTH_COSINE
    });
    let (sum, area) = alike.fold((Rgb::ZERO, 0.0), |(sum, area), (other, _)| {
        (sum + other.radiance * other.area, area + other.area)
    });
    sum / area
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::Cut;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use crate::transport::hemilux::specimen::{ALBEDO, EMISSION, Specimen, is_near};

    fn crowd(specimen: &Specimen) -> &Crowd {
        match &*specimen.cut {
            Cut::Crowd(crowd) => crowd,
            Cut::Listed(_) => unreachable!("it is a crowd"),
        }
    }

    /// In a furnace every vertex sends L^e/(1 − a).
    #[test]
    fn a_furnace_is_as_bright_everywhere() {
        let glb = made::furnace(Rgb::splat(ALBEDO), Rgb::splat(EMISSION));
        let specimen = Specimen::new(&glb, 2);
        let mesh = bake(&specimen.coarse, crowd(&specimen), u64::MAX).expect("it is small");
        assert_eq!(mesh.indices.len() / 3, specimen.cut.patches());
        let exact = EMISSION / (1.0 - ALBEDO);
        assert!(mesh.radiance.iter().all(|radiance| is_near(*radiance, exact, 0.02)));
        assert!(bake(&specimen.coarse, crowd(&specimen), mesh.size() - 1).is_none());
    }

    /// The file is valid and has the surfaces of the scene; corners of a wall's triangles share
    /// vertices.
    #[test]
    fn what_is_baked_of_a_crowd_can_be_read() {
        let specimen = Specimen::new(&made::tessellated_room(4000), 300);
        let mesh = bake(&specimen.coarse, crowd(&specimen), u64::MAX).expect("it is small");
        let (triangles, vertices) = (mesh.indices.len() / 3, mesh.positions.len());
        assert!(vertices < triangles, "{vertices} vertices of {triangles} triangles");
        let file = mesh.to_glb();
        gltf::Gltf::from_slice(&file).expect("the format's own checks");
        let read = import(&file, &Resources::new(), &ImportLimits::default()).expect("our own");
        let area = |corners: [Vec3; 3]| {
            f64::from(0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length())
        };
        let total: f64 = read.triangles.iter().map(|triangle| area(read.corners(triangle))).sum();
        let sides = crowd(&specimen).all_sides();
        let expected: f64 = sides
            .map(|(_, own)| area(crowd(&specimen).corners(&own)))
            .collect::<Vec<_>>()
            .iter()
            .sum();
        assert!((total / expected - 1.0).abs() < 1e-4, "{total} {expected}");
        let darkest =
            mesh.radiance.iter().map(|radiance| radiance.max_element()).fold(1e9, f32::min);
        assert!(darkest > 0.0 && darkest < 0.9 * mesh.brightest, "{darkest} {}", mesh.brightest);
    }

    /// A place where very many triangles meet takes no longer than any other.
    #[test]
    fn fans_have_their_own_light_at_the_hub() {
        let leaf = |radiance: f32| Leaf {
            corners: [Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: [Vec3::Z; 3],
            area: 0.5,
            radiance: Rgb::splat(radiance),
            emits: false,
            material: 0,
        };
        let few: Vec<Leaf> = [1.0, 3.0].map(leaf).into();
        let mut found = Vertices::default();
        found.add(&few, &[(0, 0), (0, 3)]);
        assert_eq!(found.own, [(Vec3::ZERO, Rgb::splat(2.0))]);
        assert_eq!((found.of_corner, found.brightest), (vec![(0, 0), (3, 0)], 2.0));
        let many: Vec<Leaf> = (0..200).map(|number| leaf(number as f32)).collect();
        let mut found = Vertices::default();
        let place: Vec<(u64, u32)> = (0..200).map(|number| (0, 3 * number)).collect();
        found.add(&many, &place);
        assert_eq!(found.own.len(), 200);
    }
}
