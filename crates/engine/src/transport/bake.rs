//! The solution on the patches as a mesh with the light in its vertices.

use super::known::albedo;
use crate::measurement::reconstruction::{Reconstruction, Smoothness};
use crate::patches::{Facet, PatchedScene, cell_index};
use crate::radiometry::Rgb;
use crate::scene::gltf::BakedMesh;
use std::f32::consts::PI;

/// The mesh of a scene whose patches have these irradiances: every corner of a patch is a vertex,
/// smooth over surfaces, with lobes as if they were diffuse. `None` where it would take more than so
/// many bytes.
pub fn bake(scene: &PatchedScene, irradiance: &[Rgb], most_bytes: u64) -> Option<BakedMesh> {
    if baked_bytes(scene) > most_bytes {
        return None;
    }
    let reconstruction = Reconstruction::new(scene, Smoothness::Smooth);
    let at_vertices = reconstruction.apply(irradiance);
    let mut mesh = BakedMesh::default();
    // What the patches around a vertex reflect and emit, and how many there are.
    let mut finish: Vec<(Rgb, Rgb, f32)> = Vec::new();
    for (index, facet) in scene.facets.iter().enumerate() {
        let n = facet.divisions;
        let corners = facet.corners.map(|corner| scene.positions[corner as usize]);
        for back in [false, true] {
            let Some(first) = facet.first_patch(back) else { continue };
            let base = mesh.positions.len() as u32;
            let vertex = |i: u32, j: u32| i * (2 * n + 3 - i) / 2 + j;
            finish.clear();
            finish.resize(vertex(n, 0) as usize + 1, (Rgb::ZERO, Rgb::ZERO, 0.0));
            let mut cell = |points: [(u32, u32); 3]| {
                let middle = |along: fn(&(u32, u32)) -> u32| {
                    points.iter().map(|point| along(point) as f32).sum::<f32>() / (3 * n) as f32
                };
                let (u, v) = (middle(|point| point.0), middle(|point| point.1));
                let patch = (first + cell_index(n, u, v)) as usize;
                let (albedo, emission) = (albedo(scene, patch), scene.patches.emission[patch]);
                let vertices = points.map(|(i, j)| vertex(i, j));
                for vertex in vertices {
                    let sum = &mut finish[vertex as usize];
                    *sum = (sum.0 + albedo, sum.1 + emission, sum.2 + 1.0);
                }
                let [a, b, c] = vertices.map(|vertex| base + vertex);
                mesh.indices.extend(if back { [a, c, b] } else { [a, b, c] });
            };
            for i in 0..n {
                for j in 0..n - i {
                    cell([(i, j), (i + 1, j), (i, j + 1)]);
                    if i + j + 1 < n {
                        cell([(i + 1, j), (i + 1, j + 1), (i, j + 1)]);
                    }
                }
            }
            for i in 0..=n {
                for j in 0..=n - i {
                    let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
                    let around = reconstruction.corners(index, back, facet, u, v);
                    let irradiance: Rgb = (around.iter().flatten())
                        .map(|(vertex, weight)| at_vertices[*vertex as usize] * *weight)
                        .sum();
                    let (albedo, emission, count) = finish[vertex(i, j) as usize];
                    let reflected = albedo / count * irradiance.max(Rgb::ZERO) / PI;
                    mesh.positions
                        .push(corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v);
                    mesh.radiance.push(reflected + emission / count);
                    if emission == Rgb::ZERO && reflected.is_finite() {
                        mesh.brightest = mesh.brightest.max(reflected.max_element());
                    }
                }
            }
        }
    }
    Some(mesh)
}

/// Bytes of the file, nearly, before anything is made.
fn baked_bytes(scene: &PatchedScene) -> u64 {
    let bytes = |facet: &Facet| {
        let n = u64::from(facet.divisions);
        let sides = [false, true].into_iter().filter_map(|back| facet.first_patch(back)).count();
        sides as u64 * (24 * (n + 1) * (n + 2) / 2 + 12 * n * n)
    };
    scene.facets.iter().map(bytes).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use std::sync::Arc;

    /// The file is valid, is read as it was written, and its surfaces are those of the scene.
    #[test]
    fn what_is_baked_can_be_read() {
        let imported = |bytes: &[u8]| import(bytes, &Resources::new(), &ImportLimits::default());
        let scene = Arc::new(imported(&made::corridor()).expect("valid"));
        let patched = PatchedScene::new(scene, 3000);
        let irradiance: Vec<Rgb> =
            (0..patched.patches.len()).map(|patch| Rgb::splat((patch % 7) as f32)).collect();
        let mesh = bake(&patched, &irradiance, u64::MAX).expect("it may be as large");
        let file = mesh.to_glb();
        assert!(file.len() as u64 <= mesh.size() && baked_bytes(&patched) <= mesh.size());
        gltf::Gltf::from_slice(&file).expect("the format's own checks");
        let read = imported(&file).expect("our own");
        assert_eq!(read.triangles.len(), mesh.indices.len() / 3);
        assert_eq!(read.triangles.len(), patched.patches.len(), "a triangle is a patch");
        for (triangle, indices) in read.triangles.iter().zip(mesh.indices.chunks(3)) {
            let corners = read.corners(triangle);
            for (corner, index) in corners.iter().zip(indices) {
                assert_eq!(*corner, mesh.positions[*index as usize]);
            }
        }
        let area = |corners: [glam::Vec3; 3]| {
            let [a, b, c] = corners;
            f64::from(0.5 * (b - a).cross(c - a).length())
        };
        let total: f64 = read.triangles.iter().map(|triangle| area(read.corners(triangle))).sum();
        let patches: f64 = patched.patches.area.iter().map(|area| f64::from(*area)).sum();
        assert!((total / patches - 1.0).abs() < 1e-4, "{total} {patches}");
        let nothing =
            bake(&PatchedScene::new(Arc::default(), 1), &[], u64::MAX).expect("small").to_glb();
        assert!(bake(&patched, &irradiance, mesh.size() / 2).is_none());
        gltf::Gltf::from_slice(&nothing).expect("an empty file is one, too");
    }

    /// An even light on an even wall is an even colour.
    #[test]
    fn even_light_has_no_seams() {
        let bytes = made::furnace(Rgb::splat(0.5), Rgb::ZERO);
        let scene = import(&bytes, &Resources::new(), &ImportLimits::default()).expect("valid");
        let patched = PatchedScene::new(Arc::new(scene), 500);
        let irradiance = vec![Rgb::splat(PI); patched.patches.len()];
        let mesh = bake(&patched, &irradiance, u64::MAX).expect("it may be as large");
        for radiance in &mesh.radiance {
            assert!((*radiance - Rgb::splat(0.5)).abs().max_element() < 1e-4, "{radiance}");
        }
        assert!((mesh.brightest - 0.5).abs() < 1e-4);
    }
}
