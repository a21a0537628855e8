//! Pilot rays, of the first records: what they find says how many rays all records get
//! (docs/decisions/0008), and whether these ask the coarse solution.

use super::record::Record;
use crate::radiometry::Rgb;

/// Rays of a record before that is known.
pub const PILOT_RAYS: u32 = 16;
/// Noise allowed in a record of the first iteration, relative to the mean irradiance; and where the
/// job is hasty.
const ALLOWED_NOISE: [f32; 2] = [0.07, 0.11];
/// Variance of corrections, over that of irradiances found afresh, from which on the coarse solution is asked.
const LEAST_CORRECTED: f32 = 0.3;

/// How pilot rays decide how many gather rays every record gets.
#[derive(Clone, Copy)]
pub struct PilotSampling<'a> {
    /// Whether the first picture had better come soon than be good: more noise is allowed then.
    pub hasty: bool,
    /// Direct irradiance of a fragment by its index: noise is judged beside all light.
    pub direct: &'a dyn Fn(usize) -> Rgb,
}

/// Rays of a record with which its noise is what is allowed relative to the mean irradiance, a
/// multiple of eight. `all_direct` is the sum of the direct irradiance at the records.
pub fn rays_for_noise(records: &[Record], all_direct: Rgb, hasty: bool) -> u32 {
    let allowed = ALLOWED_NOISE[usize::from(hasty)];
    let (mut light, mut noise) = (all_direct.element_sum(), 0.0);
    for record in records {
        light += record.irradiance().element_sum();
        noise += (record.noise() * record.noise()).element_sum() * record.rays as f32;
    }
    let mean = (light / (3.0 * records.len() as f32)).max(f32::MIN_POSITIVE);
    // Variance of a single ray.
    let noise = noise / (3.0 * records.len() as f32);
    (noise / (allowed * mean).powi(2) / 8.0).ceil().min(1e6) as u32 * 8
}

/// Whether much of the records' noise is in how light found afresh differs from the coarse solution.
pub fn is_corrected_noisily(records: &[Record]) -> bool {
    let [correction, all] = records.iter().fold([0.0; 2], |[correction, all], record| {
        let [_, noise] = record.correction();
        [correction + noise.length_squared(), all + record.noise().length_squared()]
    });
    correction > LEAST_CORRECTED * all
}
