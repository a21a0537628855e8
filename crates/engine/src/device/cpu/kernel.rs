//! Renders one shot and deposits it, compiled for the vectors that the processor has. The same
//! operations in the same order everywhere, so the bits are the same too.

use super::deposit::{FactorSums, deposit};
use super::raster::Raster;
use crate::hemicube::{DeltaFormFactors, Shot};
use crate::patches::PatchedScene;

/// Everything that one thread needs for a shot.
pub struct Job<'a> {
    pub scene: &'a PatchedScene,
    pub table: &'a DeltaFormFactors,
    pub shot: &'a Shot,
    pub raster: &'a mut Raster,
    pub form_factor: &'a mut [f32],
    pub lobe_factor: &'a mut [f32],
}

#[inline(always)]
fn run_generic(job: Job<'_>) {
    job.raster.render(job.scene, job.shot);
    let sums = FactorSums { form_factor: job.form_factor, lobe_factor: job.lobe_factor };
    deposit(job.scene, job.raster, job.table, job.shot, sums);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt,lzcnt")]
fn run_avx2(job: Job<'_>) {
    run_generic(job);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,popcnt,lzcnt")]
fn run_avx512(job: Job<'_>) {
    run_generic(job);
}

#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    has_avx2()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
}

#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("popcnt")
        && is_x86_feature_detected!("lzcnt")
}

/// Renders and deposits one shot.
pub fn run(job: Job<'_>) {
    #[cfg(target_arch = "x86_64")]
    {
        if has_avx512() {
            // SAFETY: the features were just detected.
            return unsafe { run_avx512(job) };
        }
        if has_avx2() {
            // SAFETY: the features were just detected.
            return unsafe { run_avx2(job) };
        }
    }
    run_generic(job);
}

/// Which of the versions runs here.
pub fn name() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if has_avx512() {
            return "AVX-512";
        }
        if has_avx2() {
            return "AVX2";
        }
    }
    "baseline"
}
