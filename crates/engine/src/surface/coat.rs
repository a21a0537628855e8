//! A clear coat on a surface, as KHR_materials_clearcoat has it: a lobe of microfacets with Schlick's
//! Fresnel term F for the index 1.5, over what lies below, which is dimmed by 1 − F(v) for the direction v
//! to the viewer.
//!
//! The extension's formula is not reciprocal: it does not dim light on its way in. So light that comes
//! from low on a bright surface is reflected too well, and hemicubes and maps, which follow light from
//! its source, see a little less or more of it than paths from the eye.

use super::ggx::{Ggx, Microfacets};
use super::side::Side;
use crate::scene::{COAT_F0, Layers};
use glam::Vec3;

/// A clear coat where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Its strength, in [0, 1].
    pub strength: f32,
    /// Width of its distribution of microfacets, roughness².
    alpha: f32,
    /// Its unit normal; 0 where it is the shading normal.
    pub normal: Vec3,
}

impl Coat {
    /// Of these layers.
    pub fn new(layers: &Layers) -> Self {
        let strength = layers.coat.clamp(0.0, 1.0);
        Self { strength, alpha: layers.coat_alpha(), normal: Vec3::ZERO }
    }

    /// Makes its distribution wider by such a difference of slopes, if it is not that wide by itself; whether it was.
    pub fn blur(&mut self, slopes: f32) -> bool {
        let is_narrow = self.strength > 0.0 && self.alpha < slopes;
        if is_narrow {
            self.alpha = self.alpha.hypot(slopes);
        }
        is_narrow
    }

    /// Its lobe, at full strength.
    pub fn facets(&self) -> Microfacets {
        Microfacets::coat(COAT_F0, self.alpha)
    }

    /// Its own unit normal, or the shading normal, which is given.
    pub fn normal_or(&self, shading_normal: Vec3) -> Vec3 {
        if self.normal == Vec3::ZERO { shading_normal } else { self.normal }
    }

    /// How its lobe reflects, at full strength.
    pub fn reflection(&self, side: Side) -> Ggx {
        Ggx::new(
            self.facets(),
            Side { shading_normal: self.normal_or(side.shading_normal), ..side },
        )
    }

    /// Albedo of its lobe.
    pub fn albedo(&self, cosine: f32) -> f32 {
        if self.strength == 0.0 { 0.0 } else { self.strength * self.facets().lobe_albedo(cosine).x }
    }

    /// What is left of light from below towards a viewer at an angle of that cosine: 1 − F of Schlick's
    /// Fresnel term.
    pub fn left(&self, cosine: f32) -> f32 {
        let grazing = (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        1.0 - self.strength * (COAT_F0 + (1.0 - COAT_F0) * grazing)
    }
}
