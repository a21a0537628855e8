//! A surface of microfacets with layers on top: a clear [`Coat`] over [`Sheen`] over the [`Base`],
//! each of which dims what lies below it.

use super::base_lobe::{Base, BaseReflection};
use super::coat::Coat;
use super::ggx::{Microfacets, split};
use super::reflection::{Parts, Reflection, direction_about};
use super::sheen::Sheen;
use super::side::Side;
use super::slopes::SlopeChanges;
use crate::radiometry::{Rgb, importance};
use crate::scene::Layers;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Exponent of a Phong lobe about as wide as sheen.
const SHEEN_EXPONENT: f32 = 1.0;

/// Cosines at which albedos are asked for to find their mean over the hemisphere, and their weights:
/// Gauss's quadrature of order 8 on [0, 1], times twice the cosine.
const GAUSS: [[f32; 2]; 8] = [
    [0.019_855_1, 0.002_009_9],
    [0.101_666_8, 0.022_608_8],
    [0.237_233_8, 0.074_421_8],
    [0.408_282_7, 0.148_077_5],
    [0.591_717_3, 0.214_606_3],
    [0.762_766_2, 0.239_284_8],
    [0.898_333_2, 0.199_772_3],
    [0.980_144_9, 0.099_218_6],
];

/// What a side reflects that has layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layered {
    /// Below them.
    base: Base,
    coat: Coat,
    sheen: Sheen,
}

impl Layered {
    /// Of a surface with these layers.
    pub fn new(facets: Microfacets, layers: &Layers) -> Self {
        let base = Base::new(facets, layers);
        Self { base, coat: Coat::new(layers), sheen: Sheen::new(layers) }
    }

    /// The same where the coat has a normal of its own.
    pub fn with_coat_normal(mut self, normal: Vec3) -> Self {
        self.coat.normal = normal;
        self
    }

    /// The same where `along` says what vector of space one in the coordinates of tangent and
    /// bitangent is.
    pub fn brushed(mut self, along: impl Fn(Vec2) -> Vec3) -> Self {
        let in_tangents = self.base.brushing.in_tangents;
        if in_tangents != Vec2::ZERO {
            self.base.brushing.along = along(in_tangents);
        }
        self
    }

    /// The same without its diffuse part.
    pub fn lobe_only(mut self) -> Self {
        self.base.facets.diffuse = Rgb::ZERO;
        self
    }

    /// The same with distributions of microfacets that are wider by such a difference of slopes; `None` where all of
    /// them are that wide by themselves.
    #[cold]
    pub fn blurred(mut self, slopes: f32) -> Option<Self> {
        let base = self.base.facets.blurred(slopes);
        let is_blurred = base.is_some() | self.coat.blur(slopes);
        self.base.facets = base.unwrap_or(self.base.facets);
        is_blurred.then_some(self)
    }

    /// What is left of light from the base towards a viewer at an angle of that cosine to the shading
    /// normal, and of the other one to the coat's.
    fn left(&self, [cosine, to_coat]: [f32; 2]) -> f32 {
        self.sheen.left(cosine) * self.coat.left(to_coat)
    }

    /// What lies below the layers, and what these leave of light from there towards a viewer at an
    /// angle of that cosine, or on the mean over all.
    pub fn below(&self, cosine: Option<f32>) -> (Microfacets, f32) {
        let mean = || self.mean(|layered, cosine| Rgb::splat(layered.left([cosine; 2]))).x;
        (self.base.facets, cosine.map_or_else(mean, |cosine| self.left([cosine; 2])))
    }

    /// Albedo of the diffuse part towards a viewer at such angles.
    fn diffuse_albedo(&self, cosines: [f32; 2]) -> Rgb {
        self.base.diffuse_albedo(cosines[0]) * self.left(cosines)
    }

    /// Albedos of the lobes, of the base, of the sheen and of the coat, towards a viewer at such
    /// angles. A lobe that faces away reflects nothing.
    fn lobe_albedos(&self, [cosine, to_coat]: [f32; 2]) -> [Rgb; 3] {
        let mut albedos = [Rgb::ZERO; 3];
        if cosine > 0.0 {
            albedos[0] = self.base.lobe_albedo(cosine) * self.left([cosine, to_coat]);
            albedos[1] = self.sheen.albedo(cosine) * self.coat.left(to_coat);
        }
        if to_coat > 0.0 {
            albedos[2] = Rgb::splat(self.coat.albedo(to_coat));
        }
        albedos
    }

    fn lobe_albedo(&self, cosine: f32) -> Rgb {
        self.lobe_albedos([cosine; 2]).into_iter().sum()
    }

    /// The mean of an albedo over the hemisphere.
    fn mean(&self, albedo: impl Fn(&Self, f32) -> Rgb) -> Rgb {
        GAUSS.iter().map(|[cosine, weight]| albedo(self, *cosine) * *weight).sum()
    }

    /// Albedo of all of it for light that comes at an angle of that cosine.
    pub fn albedo(&self, cosine: f32) -> Rgb {
        self.diffuse_albedo([cosine; 2]) + self.lobe_albedo(cosine)
    }

    /// Mean albedo of diffuse part and lobes together.
    pub fn mean_albedo(&self) -> Rgb {
        self.mean(Self::albedo)
    }

    /// Diffuse albedo and factor of the lobes, towards a viewer in a unit direction, for light without
    /// directions: see [`split`]; `normal` is the shading normal.
    pub fn diffuse_and_lobe_factor(&self, normal: Vec3, viewer: Vec3) -> [Rgb; 2] {
        let cosines = [normal, self.coat.normal_or(normal)].map(|normal| normal.dot(viewer));
        let plain = self.base.plain_diffuse_albedo(cosines[0]) * self.left(cosines);
        let lobes = self.lobe_albedos(cosines).into_iter().sum();
        split([plain, self.diffuse_albedo(cosines)], lobes)
    }

    /// Exponents of the lobes that there are.
    fn exponents(&self) -> impl Iterator<Item = f32> {
        let base = self.base.facets.is_glossy().then(|| self.base.exponents());
        let sheen = self.sheen.is_there().then_some(SHEEN_EXPONENT);
        let coat = (self.coat.strength > 0.0).then(|| self.coat.facets().exponent());
        base.into_iter().flatten().chain(sheen).chain(coat)
    }
}

/// The reflection of a side that has layers.
#[derive(Clone, Copy, Debug)]
pub struct LayeredReflection {
    layered: Layered,
    side: Side,
}

impl LayeredReflection {
    /// Of a side that lies like this.
    pub fn new(layered: Layered, side: Side) -> Self {
        Self { layered, side }
    }

    /// The coat's unit normal.
    pub fn coat_normal(&self) -> Vec3 {
        self.layered.coat.normal_or(self.side.shading_normal)
    }

    /// Least widths of the distributions of microfacets, of base and coat; infinite where there is none.
    pub fn widths(&self) -> [f32; 2] {
        let Layered { base, coat, .. } = &self.layered;
        let base = if base.facets.is_glossy() { base.facets.alpha } else { f32::INFINITY };
        let coat = if coat.strength > 0.0 { coat.facets().alpha } else { f32::INFINITY };
        [base, coat]
    }

    /// f_r on the mean over a part of the surface, as far as the microfacets' distribution goes.
    pub fn evaluate_over(&self, viewer: Vec3, source: Vec3, changes: &SlopeChanges) -> Parts {
        let [base, coat] = *changes;
        let coat = self.layered.coat.reflection(self.side).gain_over(viewer, source, coat);
        let gains = [self.base().gain_over(viewer, source, base), coat];
        self.evaluate_times((viewer, source), 1.0, gains).0
    }

    /// f_r with the lobes of base and coat times such factors, and its density without them. What the coat sends is
    /// measured by the cosine to its own normal, so it is divided by the one to the shading normal, which callers
    /// multiply by.
    #[cold]
    #[inline(never)]
    fn evaluate_times(
        &self,
        (viewer, source): (Vec3, Vec3),
        diffuse_share: f32,
        [of_base, of_coat]: [f32; 2],
    ) -> (Parts, f32) {
        let Layered { coat, sheen, .. } = &self.layered;
        let (mut below, base_pdf) = self.base().evaluate_with_pdf(viewer, source);
        below.lobe *= of_base;
        let mut value = below.times(Rgb::splat(sheen.left(self.cosine(viewer))));
        value.lobe += self.sheen(viewer, source);
        let [base_share, sheen_share, coat_share] = self.shares(viewer);
        let cosine = self.cosine(source).max(0.0);
        let sheen_pdf = if cosine > 0.0 { Sheen::PDF } else { 0.0 };
        let mut lobe_pdf = base_share * base_pdf + sheen_share * sheen_pdf;
        if coat.strength > 0.0 {
            let normal = coat.normal_or(self.side.shading_normal);
            value = value.times(Rgb::splat(coat.left(normal.dot(viewer))));
            let (own, pdf) = coat.reflection(self.side).evaluate_with_pdf(viewer, source, 0.0);
            if cosine > 0.0 {
                value.lobe +=
                    own.lobe * (of_coat * coat.strength * normal.dot(source).max(0.0) / cosine);
            }
            lobe_pdf += coat_share * pdf;
        }
        (value, diffuse_share * cosine * FRAC_1_PI + (1.0 - diffuse_share) * lobe_pdf)
    }

    fn base(&self) -> BaseReflection {
        BaseReflection::new(self.layered.base, self.side)
    }

    fn cosine(&self, direction: Vec3) -> f32 {
        self.side.shading_normal.dot(direction)
    }

    /// To the shading normal and to the coat's.
    fn cosines(&self, direction: Vec3) -> [f32; 2] {
        [self.side.shading_normal, self.layered.coat.normal_or(self.side.shading_normal)]
            .map(|normal| normal.dot(direction))
    }

    /// Probabilities of the lobes: of the base, of the sheen and of the coat.
    fn shares(&self, viewer: Vec3) -> [f32; 3] {
        let albedos = self.layered.lobe_albedos(self.cosines(viewer)).map(importance);
        let sum: f32 = albedos.iter().sum();
        if sum > 0.0 { albedos.map(|albedo| albedo / sum) } else { [0.0, 0.0, 1.0] }
    }

    /// What the sheen sends below the coat.
    fn sheen(&self, viewer: Vec3, source: Vec3) -> Rgb {
        let cosines = [viewer, source].map(|direction| self.cosine(direction));
        if !self.layered.sheen.is_there() || cosines.iter().any(|cosine| *cosine <= 0.0) {
            return Rgb::ZERO;
        }
        let half = (viewer + source).normalize_or(self.side.shading_normal);
        self.layered.sheen.evaluate(cosines, self.cosine(half))
    }
}

/// Not inlined, so that scenes without layers have the code that they would have without this.
impl Reflection for LayeredReflection {
    #[cold]
    #[inline(never)]
    fn side(&self) -> Side {
        self.side
    }

    #[cold]
    #[inline(never)]
    fn diffuse(&self, viewer: Vec3) -> Rgb {
        self.layered.diffuse_albedo(self.cosines(viewer))
    }

    #[cold]
    #[inline(never)]
    fn mean_diffuse(&self) -> Rgb {
        self.layered.mean(|layered, cosine| layered.diffuse_albedo([cosine; 2]))
    }

    #[cold]
    #[inline(never)]
    fn specular(&self) -> Rgb {
        self.layered.lobe_albedo(1.0)
    }

    #[cold]
    #[inline(never)]
    fn exponent(&self) -> f32 {
        self.layered.exponents().fold(0.0, f32::max)
    }

    #[cold]
    #[inline(never)]
    fn widest_exponent(&self) -> f32 {
        self.layered.exponents().fold(f32::MAX, f32::min)
    }

    #[cold]
    #[inline(never)]
    fn evaluate(&self, viewer: Vec3, source: Vec3) -> Parts {
        self.evaluate_with_pdf(viewer, source, 1.0).0
    }

    #[cold]
    #[inline(never)]
    fn pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> f32 {
        self.evaluate_with_pdf(viewer, source, diffuse_share).1
    }

    #[cold]
    #[inline(never)]
    fn evaluate_with_pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> (Parts, f32) {
        self.evaluate_times((viewer, source), diffuse_share, [1.0; 2])
    }

    /// By the lobe that the first number picks.
    #[cold]
    #[inline(never)]
    fn lobe_direction(&self, viewer: Vec3, [mut x, y]: [f32; 2]) -> Vec3 {
        let [base, sheen, coat] = self.shares(viewer);
        let rest = |x: f32, share: f32| (x / share).clamp(0.0, 1.0 - f32::EPSILON);
        if x < base {
            return self.base().direction(viewer, [rest(x, base), y]);
        }
        x -= base;
        if x < sheen {
            return direction_about(self.side.shading_normal, rest(x, sheen), y);
        }
        let rest = if coat > 0.0 { rest(x - sheen, coat) } else { 0.5 };
        self.layered.coat.reflection(self.side).lobe_direction(viewer, [rest, y])
    }

    #[cold]
    #[inline(never)]
    fn albedo(&self, viewer: Vec3) -> Rgb {
        let cosines = self.cosines(viewer);
        let mut lobes = self.layered.lobe_albedos(cosines);
        if let Some(base) = self.base().lobe_albedo(viewer) {
            lobes[0] = base * self.layered.left(cosines);
        }
        self.layered.diffuse_albedo(cosines) + lobes.into_iter().sum::<Rgb>()
    }

    #[cold]
    #[inline(never)]
    fn mean_albedo(&self) -> Rgb {
        self.layered.mean_albedo()
    }

    #[cold]
    #[inline(never)]
    fn diffuse_share(&self, viewer: Vec3) -> f32 {
        let cosines = self.cosines(viewer);
        if cosines.iter().all(|cosine| *cosine <= 0.0) {
            return 1.0;
        }
        let diffuse = importance(self.layered.diffuse_albedo(cosines));
        let lobes = self.layered.lobe_albedos(cosines).into_iter().sum();
        let lobes = importance(lobes).max(1e-6);
        if diffuse > 0.0 { diffuse / (diffuse + lobes) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Layering, Material};
    use crate::surface::laws::{Law, broken, broken_within};
    use crate::surface::model::Parameters;
    use glam::DVec3;
    use std::f64::consts::PI;

    fn coated(below: Material, coat: f32, coat_roughness: f32, base: Rgb) -> Layered {
        covered(below, Layers { coat, coat_roughness, ..Layers::NONE }, base)
    }

    fn covered(below: Material, factors: Layers, base: Rgb) -> Layered {
        let layering = Some(Box::new(Layering { factors, ..Layering::default() }));
        let material = Material { layering, ..below };
        match Parameters::new(&material, &material.appearance(base)) {
            Parameters::Layered(layered) => layered,
            other => panic!("{other:?}"),
        }
    }

    fn side(shading_normal: Vec3) -> Side {
        Side { normal: Vec3::Z, shading_normal, back: false }
    }

    fn bases() -> Vec<Material> {
        let mut materials = vec![Material::lambertian("lambertian", Rgb::ONE)];
        for (metallic, roughness) in [(0.0, 0.7), (0.5, 0.3), (1.0, 0.2), (1.0, 1.0)] {
            materials.push(Material { metallic, roughness, ..Material::default() });
        }
        materials
    }

    /// Brushed along a slanting direction, and under films. Their mean is estimated, and of brushed
    /// ones the test knows one azimuth alone.
    #[test]
    fn brushed_and_filmed_surfaces_keep_the_laws_of_reflection() {
        let brushed = Layers { anisotropy: Vec2::new(0.5, -0.4), ..Layers::NONE };
        let film = Layers { film: 1.0, film_ior: 1.4, film_thickness: 350.0, ..Layers::NONE };
        let both = Layers { anisotropy: brushed.anisotropy, film: 0.7, ..film };
        let both = Layers { coat: 0.5, coat_roughness: 0.3, ..both };
        for shading_normal in [Vec3::Z, Vec3::new(0.1, 0.2, 1.0).normalize()] {
            for below in bases() {
                for layers in [brushed, film, both] {
                    let layered = covered(below.clone(), layers, Rgb::new(0.9, 0.5, 0.2));
                    let layered = layered.brushed(|along| Vec3::new(along.x, along.y, 0.1));
                    let reflection = LayeredReflection::new(layered, side(shading_normal));
                    let mut found = broken_within(&reflection, 0.02);
                    let is_exempt = |law: &Law| match law {
                        Law::MeanAlbedo => true,
                        Law::Reciprocity => layers.coat > 0.0,
                        _ => false,
                    };
                    found.retain(|law| !is_exempt(law));
                    assert!(found.is_empty(), "{reflection:?}: {found:?}");
                }
            }
        }
    }

    /// The anisotropic lobe of the extension's listing at one place, in double precision.
    #[test]
    fn brushed_values_are_those_of_the_extension() {
        let material = Material { metallic: 1.0, roughness: 0.5, ..Material::default() };
        let layers = Layers { anisotropy: Vec2::new(0.0, 0.6), ..Layers::NONE };
        let layered = covered(material, layers, Rgb::splat(0.8));
        let layered = layered.brushed(|along| along.extend(0.0));
        let reflection = LayeredReflection::new(layered, side(Vec3::Z));
        let (viewer, source) =
            (Vec3::new(0.3, 0.2, 0.8).normalize(), Vec3::new(-0.5, 0.4, 0.6).normalize());
        let [v, l] = [viewer, source].map(|direction| direction.as_dvec3());
        let h = (v + l).normalize();
        // Rougher along Y.
        let [at, ab] = [0.25 + 0.75 * 0.36, 0.25];
        let f = DVec3::new(ab * h.y, at * h.x, at * ab * h.z);
        let w = at * ab / f.length_squared();
        let d = at * ab * w * w / PI;
        let slant = |u: DVec3| DVec3::new(at * u.y, ab * u.x, u.z).length();
        let visible = 0.5 / (l.z * slant(v) + v.z * slant(l));
        let expected = (0.8 + 0.2 * (1.0 - v.dot(h)).powi(5)) * d * visible;
        let found = f64::from(reflection.evaluate(viewer, source).both().x);
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
        // Without tangents it is not brushed.
        let plain = LayeredReflection::new(layered.brushed(|_| Vec3::ZERO), side(Vec3::Z));
        assert!((f64::from(plain.evaluate(viewer, source).both().x) / found - 1.0).abs() > 0.1);
    }

    /// All but reciprocity, which the extension's formula has not.
    #[test]
    fn coats_keep_the_laws_of_reflection() {
        for shading_normal in [Vec3::Z, Vec3::new(0.1, 0.2, 1.0).normalize()] {
            for below in bases() {
                for (coat, roughness) in [(1.0, 0.15), (0.6, 0.5)] {
                    let base = Rgb::new(0.9, 0.5, 0.2);
                    let layered = coated(below.clone(), coat, roughness, base);
                    let reflection = LayeredReflection::new(layered, side(shading_normal));
                    assert_eq!(broken(&reflection), [Law::Reciprocity], "{reflection:?}");
                }
            }
        }
    }

    /// All but reciprocity, which the simpler one of the extension's formulas has not.
    #[test]
    fn sheen_keeps_the_laws_of_reflection() {
        for shading_normal in [Vec3::Z, Vec3::new(0.1, 0.2, 1.0).normalize()] {
            for below in bases() {
                for (sheen_roughness, coat) in [(0.3, 0.0), (0.8, 0.0), (0.5, 0.7)] {
                    let sheen_color = Rgb::new(0.9, 0.6, 0.3);
                    let sheen = Layers { sheen_color, sheen_roughness, ..Layers::NONE };
                    let layers = Layers { coat, coat_roughness: 0.3, ..sheen };
                    let layered = covered(below.clone(), layers, Rgb::new(0.9, 0.5, 0.2));
                    let reflection = LayeredReflection::new(layered, side(shading_normal));
                    assert_eq!(broken(&reflection), [Law::Reciprocity], "{reflection:?}");
                }
            }
        }
    }

    /// In a white furnace velvet sends no more than it gets, and something at every angle.
    #[test]
    fn white_surfaces_under_sheen_are_not_brighter_than_their_surroundings() {
        for sheen_roughness in [0.0, 0.2, 0.5, 1.0] {
            let layers = Layers { sheen_color: Rgb::ONE, sheen_roughness, ..Layers::NONE };
            let lambertian = Material::lambertian("lambertian", Rgb::ONE);
            let layered = covered(lambertian, layers, Rgb::ONE);
            let reflection = LayeredReflection::new(layered, side(Vec3::Z));
            for step in 1..=20 {
                let cosine = step as f32 / 20.0;
                let viewer = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
                let albedo = reflection.albedo(viewer).x;
                assert!((0.6..1.005).contains(&albedo), "{sheen_roughness} {cosine}: {albedo}");
            }
        }
    }

    /// The mean that hemicubes know is that of the table.
    #[test]
    fn patches_know_the_mean_of_sheen() {
        for sheen_roughness in [0.2, 0.4, 0.6, 0.8, 1.0] {
            let layers = Layers { sheen_color: Rgb::ONE, sheen_roughness, ..Layers::NONE };
            let layered = covered(Material::lambertian("black", Rgb::ZERO), layers, Rgb::ZERO);
            let below = crate::radiometry::Reflectance::lambertian(Rgb::ZERO);
            let off = layered.mean_albedo() - layers.over(below).specular;
            assert!(off.abs().max_element() < 0.01, "{sheen_roughness}: {off}");
        }
    }

    /// Where the coat's normal is another than that of what is below, only what the two cosines
    /// contradict is lost.
    #[test]
    fn coats_with_a_normal_of_their_own_are_sampled_as_they_are_evaluated() {
        let own = Vec3::new(-0.2, 0.1, 1.0).normalize();
        let shading_normal = Vec3::new(0.1, 0.2, 1.0).normalize();
        for below in bases() {
            let layered = coated(below, 1.0, 0.3, Rgb::splat(0.5)).with_coat_normal(own);
            let reflection = LayeredReflection::new(layered, side(shading_normal));
            let found = broken(&reflection);
            let lost = [Law::Reciprocity, Law::MeanAlbedo];
            assert!(found.iter().all(|law| lost.contains(law)), "{reflection:?}: {found:?}");
        }
    }

    /// In a white furnace nothing sends more than it gets.
    #[test]
    fn white_surfaces_under_coats_are_not_brighter_than_their_surroundings() {
        for below in bases() {
            for roughness in [0.0, 0.2, 0.5, 1.0] {
                let layered = coated(below.clone(), 1.0, roughness, Rgb::ONE);
                let reflection = LayeredReflection::new(layered, side(Vec3::Z));
                for step in 1..=20 {
                    let cosine = step as f32 / 20.0;
                    let viewer = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
                    let albedo = reflection.albedo(viewer);
                    // What is below is a little brighter by itself at grazing angles.
                    let base = layered.base.facets;
                    let base = base.diffuse_albedo(cosine) + base.lobe_albedo(cosine);
                    let most = base.max_element().max(1.0) + 0.01;
                    assert!(albedo.max_element() < most, "{layered:?} {cosine}: {albedo}");
                    assert!(albedo.min_element() > 0.2, "{layered:?} {cosine}: {albedo}");
                }
            }
        }
    }

    /// The extension's own formula, in double precision.
    #[test]
    fn values_are_those_of_the_extension() {
        let material = Material { metallic: 1.0, roughness: 0.5, ..Material::default() };
        let base = Rgb::new(0.8, 0.5, 0.2);
        let layered = coated(material, 0.7, 0.4, base);
        let reflection = LayeredReflection::new(layered, side(Vec3::Z));
        let (viewer, source) =
            (Vec3::new(0.7, 0.1, 0.4).normalize(), Vec3::new(-0.5, 0.4, 0.6).normalize());
        let [v, l] = [viewer, source].map(|direction| direction.as_dvec3());
        let h = (v + l).normalize();
        let lobe = |alpha: f64, f0: f64| {
            let square = alpha * alpha;
            let d = square / (PI * (h.z * h.z * (square - 1.0) + 1.0).powi(2));
            let slant = |z: f64| (square + (1.0 - square) * z * z).sqrt();
            let visible = 0.5 / (l.z * slant(v.z) + v.z * slant(l.z));
            (f0 + (1.0 - f0) * (1.0 - v.dot(h)).powi(5)) * d * visible
        };
        let kept = |direction: DVec3| 0.7 * (0.04 + 0.96 * (1.0 - direction.z).powi(5));
        let coat = 0.7 * lobe(0.16, 0.04);
        for (channel, base) in base.to_array().into_iter().map(f64::from).enumerate() {
            let expected = lobe(0.25, base) * (1.0 - kept(v)) + coat;
            let found = f64::from(reflection.evaluate(viewer, source).both()[channel]);
            assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
        }
    }

    /// What the split for light without directions says under light from all around is the albedo, also
    /// where the coat has a normal of its own, and nothing is less than black.
    #[test]
    fn diffuse_part_and_factor_of_the_lobes_make_the_albedo() {
        for below in bases() {
            let smooth = coated(below, 0.8, 0.3, Rgb::splat(0.7));
            let tilted = smooth.with_coat_normal(Vec3::new(-0.6, 0.0, 0.8));
            for (layered, cosine) in [smooth, tilted].into_iter().flat_map(|layered| {
                [-0.1, 0.0, 0.02, 0.15, 0.5, 1.0].map(|cosine| (layered, cosine))
            }) {
                let viewer = Vec3::new(f32::sqrt(1.0 - cosine * cosine), 0.0, cosine);
                let [diffuse, factor] = layered.diffuse_and_lobe_factor(Vec3::Z, viewer);
                assert!(diffuse.min(factor).min_element() >= 0.0, "{layered:?} {cosine}");
                let reflection = LayeredReflection::new(layered, side(Vec3::Z));
                let lobes: Rgb = layered.lobe_albedos(reflection.cosines(viewer)).into_iter().sum();
                let (split, whole) = (diffuse + lobes * factor, reflection.albedo(viewer));
                assert!(split.abs_diff_eq(whole, 1e-3), "{layered:?} {cosine}: {split} {whole}");
            }
        }
    }
}
