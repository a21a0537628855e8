//! Diffuse plus modified Phong: f_r = kd/π + ks (n+2)/(2π) cosⁿα (Phong 1975; reciprocal and of
//! bounded albedo since Lewis 1994; sampled as Lafortune and Willems 1994 do), α being the angle
//! between the source and the mirror direction of the viewer.

use super::reflection::{Parts, Reflection, direction_about};
use super::side::Side;
use crate::radiometry::{LobeAlbedo, Reflectance, Rgb, importance};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// The reflection of a side whose parameters are a [`Reflectance`].
#[derive(Clone, Copy, Debug)]
pub struct Phong {
    reflectance: Reflectance,
    side: Side,
}

impl Phong {
    /// Of a side that lies like this.
    #[inline]
    pub fn new(reflectance: Reflectance, side: Side) -> Self {
        Self { reflectance, side }
    }

    /// cosⁿα between the mirror of `viewer` and `source`; 0 where either is below the horizon.
    #[inline]
    fn lobe(&self, viewer: Vec3, source: Vec3) -> f32 {
        let normal = self.side.shading_normal;
        let (to_viewer, to_source) = (normal.dot(viewer), normal.dot(source));
        if to_viewer <= 0.0 || to_source <= 0.0 {
            return 0.0;
        }
        let cosine = 2.0 * to_viewer * to_source - viewer.dot(source);
        if cosine <= 0.0 { 0.0 } else { cosine.min(1.0).powf(self.reflectance.exponent) }
    }
}

impl Reflection for Phong {
    #[inline]
    fn side(&self) -> Side {
        self.side
    }

    #[inline]
    fn diffuse(&self, _viewer: Vec3) -> Rgb {
        self.reflectance.diffuse
    }

    #[inline]
    fn mean_diffuse(&self) -> Rgb {
        self.reflectance.diffuse
    }

    #[inline]
    fn specular(&self) -> Rgb {
        self.reflectance.specular
    }

    #[inline]
    fn exponent(&self) -> f32 {
        self.reflectance.exponent
    }

    #[inline]
    fn evaluate(&self, viewer: Vec3, source: Vec3) -> Parts {
        self.evaluate_with_pdf(viewer, source, 1.0).0
    }

    #[inline]
    fn pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> f32 {
        self.evaluate_with_pdf(viewer, source, diffuse_share).1
    }

    #[inline]
    fn evaluate_with_pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> (Parts, f32) {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        let cosine = self.side.shading_normal.dot(source).max(0.0);
        let mut value = Parts { diffuse: diffuse / PI, lobe: Rgb::ZERO };
        let mut pdf = diffuse_share * cosine / PI;
        if self.reflectance.is_glossy() {
            let power = self.lobe(viewer, source);
            value.lobe = specular * ((exponent + 2.0) / TAU * power);
            pdf += (1.0 - diffuse_share) * ((exponent + 1.0) / TAU * power);
        }
        (value, pdf)
    }

    /// By cosⁿα about the mirror direction.
    #[inline]
    fn lobe_direction(&self, viewer: Vec3, xi: [f32; 2]) -> Vec3 {
        let power = 1.0 / (self.reflectance.exponent + 1.0);
        let mirror = self.side.mirrored(viewer).normalize_or(self.side.shading_normal);
        direction_about(mirror, (1.0 - xi[0]).powf(power), xi[1])
    }

    #[inline]
    fn albedo(&self, viewer: Vec3) -> Rgb {
        let cosine = self.side.shading_normal.dot(viewer);
        if cosine > 0.0 { self.reflectance.albedo(cosine) } else { self.reflectance.diffuse }
    }

    #[inline]
    fn mean_albedo(&self) -> Rgb {
        self.reflectance.mean_albedo()
    }

    fn diffuse_share(&self, viewer: Vec3) -> f32 {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        let cosine = self.side.shading_normal.dot(viewer);
        if !self.reflectance.is_glossy() || cosine <= 0.0 {
            return 1.0;
        }
        let diffuse = importance(diffuse);
        let lobe = importance(specular) * LobeAlbedo::shared().at(exponent, cosine).max(1e-3);
        let both = diffuse + lobe;
        // Reflectances that are almost nothing may vanish in the products.
        if both > 0.0 { diffuse / both } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::laws::{Law, broken};

    /// Sides with their geometric normal for shading, and with another.
    fn sides() -> [Side; 2] {
        let normal = Vec3::new(0.3, -0.5, 0.8).normalize();
        let turned = (normal + 0.2 * Vec3::X).normalize();
        [normal, turned].map(|shading_normal| Side { normal, shading_normal, back: false })
    }

    fn reflectance(diffuse: f32, specular: f32, exponent: f32) -> Reflectance {
        let [diffuse, specular] = [diffuse, specular].map(|of| Rgb::new(of, 0.5 * of, 0.1 * of));
        Reflectance { diffuse, specular, exponent }
    }

    #[test]
    fn phong_keeps_the_laws_of_reflection() {
        for side in sides() {
            for (diffuse, specular) in [(0.7, 0.0), (0.4, 0.5), (0.0, 0.9)] {
                for exponent in [1.0, 20.0, 300.0] {
                    let phong = Phong::new(reflectance(diffuse, specular, exponent), side);
                    let found = broken(&phong);
                    assert!(found.is_empty(), "{phong:?}: {found:?}");
                }
            }
        }
    }

    /// Phong with a mistake of a few per cent in one of its operations.
    struct Mistaken {
        right: Phong,
        law: Law,
    }

    impl Reflection for Mistaken {
        fn side(&self) -> Side {
            self.right.side()
        }
        fn diffuse(&self, viewer: Vec3) -> Rgb {
            self.right.diffuse(viewer)
        }
        fn mean_diffuse(&self) -> Rgb {
            self.right.mean_diffuse()
        }
        fn specular(&self) -> Rgb {
            self.right.specular()
        }
        fn exponent(&self) -> f32 {
            self.right.exponent()
        }
        fn evaluate(&self, viewer: Vec3, source: Vec3) -> Parts {
            let weight = match self.law {
                Law::Reciprocity => 1.0 + 0.04 * self.side().normal.dot(viewer),
                _ => 1.0,
            };
            self.right.evaluate(viewer, source).times(Rgb::splat(weight))
        }
        fn pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> f32 {
            let pdf = self.right.pdf(viewer, source, diffuse_share);
            if self.law == Law::PdfIntegral { 1.05 * pdf } else { pdf }
        }
        fn evaluate_with_pdf(&self, viewer: Vec3, source: Vec3, share: f32) -> (Parts, f32) {
            let pdf = self.pdf(viewer, source, share);
            let off = if self.law == Law::SamplePdf { 1.02 } else { 1.0 };
            (self.evaluate(viewer, source), off * pdf)
        }
        fn lobe_direction(&self, viewer: Vec3, xi: [f32; 2]) -> Vec3 {
            self.right.lobe_direction(viewer, xi)
        }
        fn albedo(&self, viewer: Vec3) -> Rgb {
            let leans = self.right.side.normal != self.right.side.shading_normal;
            let off = match self.law {
                Law::Furnace if leans => 0.5,
                Law::Furnace => 1.05,
                _ => 1.0,
            };
            off * self.right.albedo(viewer)
        }
        fn mean_albedo(&self) -> Rgb {
            let off = if self.law == Law::MeanAlbedo { 1.05 } else { 1.0 };
            off * self.right.mean_albedo()
        }
        fn diffuse_share(&self, viewer: Vec3) -> f32 {
            self.right.diffuse_share(viewer)
        }
    }

    #[test]
    fn mistakes_break_the_laws_that_they_are_about() {
        let right = Phong::new(reflectance(0.4, 0.5, 20.0), sides()[0]);
        for law in Law::ALL {
            let found = broken(&Mistaken { right, law });
            assert!(found.contains(&law), "{law:?}: {found:?}");
        }
        let shading_normal = Vec3::new(0.1, 0.2, 1.0).normalize();
        let leaning = Side { shading_normal, ..sides()[0] };
        let right = Phong::new(reflectance(0.4, 0.5, 20.0), leaning);
        let found = broken(&Mistaken { right, law: Law::Furnace });
        assert!(found.contains(&Law::Furnace), "an albedo that is too small: {found:?}");
        assert!(!broken(&right).contains(&Law::Furnace));
    }
}
