//! How much of what each patch sees are patches: V_i = Σ_j F_ij.

use super::raster::Raster;
use crate::hemicube::{DeltaFormFactors, Shot, item};
use crate::patches::PatchedScene;
use crate::sampling::frame;
use rayon::prelude::*;

/// V_i of every patch, in [0, 1]: 1 in a closed room, less where the patch sees outside or the
/// black backs of one-sided surfaces. By one hemicube of the given (even) resolution at each
/// centroid.
pub fn visible_share(scene: &PatchedScene, resolution: u32) -> Vec<f32> {
    let patches = &scene.patches;
    let table = DeltaFormFactors::new(resolution);
    (0..patches.len())
        .into_par_iter()
        .map_init(
            || Raster::new(resolution, scene),
            |raster, i| {
                let normal = patches.normal[i];
                let (tangent, bitangent) = frame(normal, 0.0);
                let position = patches.centroid[i];
                raster.render(
                    scene,
                    &Shot { position, tangent, bitangent, normal, ..Shot::default() },
                );
                let seen = raster.items.iter().zip(&table.values).filter(|(code, _)| {
                    item::decode(**code).is_some_and(|(facet, back)| {
                        scene.facets[facet as usize].first_patch(back).is_some()
                    })
                });
                seen.map(|(_, delta)| delta).sum::<f32>().min(1.0)
            },
        )
        .collect()
}
