//! What lies below all layers: the microfacets of [`super::ggx`], which may be brushed
//! (KHR_materials_anisotropy) and may have a thin film (KHR_materials_iridescence) in place of bare
//! metal or glass.
//!
//! Brushed microfacets have two widths: α along the brushing is α + (1 − α) strength², across it α.

use super::distribution::visible_normal_of;
use super::film::{Film, Filmed};
use super::ggx::{Ggx, Microfacets};
use super::reflection::{Parts, Reflection, direction_about};
use super::side::Side;
use super::slopes::gain_over;
use crate::radiometry::Rgb;
use crate::sampling::frame;
use crate::scene::Layers;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, PI};

/// Samples by which the albedo of brushed microfacets is found.
const SAMPLES: u32 = 48;
/// Directions to sources by which what a film leaves is found, in height and around.
const SOURCES: [u32; 2] = [4, 2];

/// The direction in which a surface is brushed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brushing {
    /// In coordinates of tangent and bitangent; its length is the strength, in [0, 1].
    pub in_tangents: Vec2,
    /// The same as a vector of space; 0 where the surface has no tangents, and then it is not brushed.
    pub along: Vec3,
}

/// Microfacets, brushed and under a film or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base {
    /// As they are by themselves.
    pub facets: Microfacets,
    /// How they are brushed.
    pub brushing: Brushing,
    /// The film on them.
    pub film: Film,
}

impl Base {
    /// Of a surface with these layers.
    pub fn new(facets: Microfacets, layers: &Layers) -> Self {
        let brushing = Brushing { in_tangents: layers.anisotropy, along: Vec3::ZERO };
        Self { facets, brushing, film: Film::new(layers) }
    }

    /// Width of the distribution along the brushing.
    fn alpha_along(&self) -> f32 {
        let strength = self.brushing.in_tangents.length_squared().min(1.0);
        self.facets.alpha + (1.0 - self.facets.alpha) * strength
    }

    /// Exponents of Phong lobes about as wide across and along.
    pub fn exponents(&self) -> [f32; 2] {
        let along = Microfacets { alpha: self.alpha_along(), ..self.facets };
        [self.facets.exponent(), along.exponent()]
    }

    /// What is lost to the diffuse part; the largest of its channels counts.
    fn loss(&self) -> Fresnel {
        let [f0, f90] = self.facets.dielectric;
        self.fresnel(Rgb::splat(f0), f90)
    }

    /// What the facets reflect.
    fn reflectance(&self) -> Fresnel {
        self.fresnel(self.facets.f0, self.facets.f90)
    }

    fn fresnel(&self, f0: Rgb, f90: f32) -> Fresnel {
        let Film { strength, .. } = self.film;
        Fresnel { f0, f90, film: self.film.is_there().then(|| (self.film.on(f0), strength)) }
    }

    /// Albedo of the diffuse part towards a viewer at an angle of that cosine.
    pub fn diffuse_albedo(&self, cosine: f32) -> Rgb {
        if !self.film.is_there() || self.facets.diffuse == Rgb::ZERO {
            return self.facets.diffuse_albedo(cosine);
        }
        let viewer = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine.max(0.0));
        let (fresnel, mut loss) = (self.loss(), 0.0);
        for k in 0..SOURCES[0] * SOURCES[1] {
            let [row, column] = [k / SOURCES[1], k % SOURCES[1]];
            let height = ((row as f32 + 0.5) / SOURCES[0] as f32).sqrt();
            let (sin, cos) = (PI * (column as f32 + 0.5) / SOURCES[1] as f32).sin_cos();
            let across = (1.0 - height * height).sqrt();
            let half = viewer + Vec3::new(across * cos, across * sin, height);
            loss += fresnel.at(viewer.dot(half.normalize_or(Vec3::Z))).max_element();
        }
        self.facets.diffuse * (1.0 - loss / (SOURCES[0] * SOURCES[1]) as f32)
    }

    /// Albedo of the diffuse part under light from above.
    pub fn plain_diffuse_albedo(&self, cosine: f32) -> Rgb {
        if self.film.is_there() {
            return self.diffuse_albedo(cosine);
        }
        self.facets.plain_diffuse_albedo()
    }

    /// About the albedo of the lobe, whatever the direction of brushing.
    pub fn lobe_albedo(&self, cosine: f32) -> Rgb {
        let along = Microfacets { alpha: self.alpha_along(), ..self.facets };
        if !self.film.is_there() {
            let across = self.facets.lobe_albedo(cosine);
            return if along.alpha == self.facets.alpha {
                across
            } else {
                0.5 * (across + along.lobe_albedo(cosine))
            };
        }
        let white = |facets: Microfacets| {
            Microfacets { f0: Rgb::ONE, f90: 1.0, ..facets }.lobe_albedo(cosine)
        };
        self.reflectance().at(cosine) * 0.5 * (white(self.facets) + white(along))
    }
}

/// Fresnel's terms of facets, under a film or not.
struct Fresnel {
    f0: Rgb,
    f90: f32,
    /// The film on them, and its strength.
    film: Option<(Filmed, f32)>,
}

impl Fresnel {
    /// Reflectance at an angle of that cosine.
    fn at(&self, cosine: f32) -> Rgb {
        let grazing = (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        let bare = self.f0 + (Rgb::splat(self.f90) - self.f0) * grazing;
        let under = |(film, strength): &(Filmed, f32)| {
            bare.lerp(film.reflectance(cosine) * self.f90, *strength)
        };
        self.film.as_ref().map_or(bare, under)
    }
}

/// The reflection of a side below all layers.
#[derive(Clone, Copy, Debug)]
pub struct BaseReflection {
    base: Base,
    side: Side,
}

/// A side's coordinates: along the brushing, across, and the shading normal.
struct Axes([Vec3; 3]);

impl Axes {
    fn local(&self, direction: Vec3) -> Vec3 {
        Vec3::from_array(self.0.map(|axis| axis.dot(direction)))
    }

    fn outside(&self, local: Vec3) -> Vec3 {
        self.0[0] * local.x + self.0[1] * local.y + self.0[2] * local.z
    }
}

impl BaseReflection {
    /// Of a side that lies like this.
    pub fn new(base: Base, side: Side) -> Self {
        Self { base, side }
    }

    /// The plain model, where neither brushing nor film changes anything.
    fn plain(&self) -> Option<Ggx> {
        let is_plain = self.base.brushing.along == Vec3::ZERO && !self.base.film.is_there();
        is_plain.then(|| Ggx::new(self.base.facets, self.side))
    }

    fn axes(&self) -> (Axes, [f32; 2]) {
        let normal = self.side.shading_normal;
        let along = self.base.brushing.along;
        let tangent = (along - normal * normal.dot(along)).normalize_or_zero();
        let alpha = self.base.facets.alpha;
        if tangent == Vec3::ZERO {
            let (tangent, bitangent) = frame(normal, 0.0);
            return (Axes([tangent, bitangent, normal]), [alpha; 2]);
        }
        let axes = Axes([tangent, normal.cross(tangent), normal]);
        (axes, [self.base.alpha_along(), alpha])
    }

    /// f_r and the density of sources that are picked by [`BaseReflection::direction`].
    pub fn evaluate_with_pdf(&self, viewer: Vec3, source: Vec3) -> (Parts, f32) {
        if let Some(ggx) = self.plain() {
            return ggx.evaluate_with_pdf(viewer, source, 0.0);
        }
        let half = (viewer + source).normalize_or(self.side.shading_normal);
        let cosine = viewer.dot(half);
        let mut diffuse = self.base.facets.diffuse;
        if diffuse != Rgb::ZERO {
            diffuse *= (1.0 - self.base.loss().at(cosine).max_element()) * FRAC_1_PI;
        }
        let (axes, widths) = self.axes();
        let [v, l, h] = [viewer, source, half].map(|direction| axes.local(direction));
        if v.z <= 0.0 || l.z <= 0.0 || !self.base.facets.is_glossy() {
            return (Parts { diffuse, lobe: Rgb::ZERO }, 0.0);
        }
        let spread = (h.x / widths[0]).powi(2) + (h.y / widths[1]).powi(2) + h.z * h.z;
        let distribution = FRAC_1_PI / (widths[0] * widths[1] * spread * spread);
        let slants = [v, l].map(|direction| slant(widths, direction));
        let visibility = 0.5 / (l.z * slants[0] + v.z * slants[1]).max(f32::MIN_POSITIVE);
        let pdf = distribution / (2.0 * (v.z + slants[0]));
        (
            Parts {
                diffuse,
                lobe: self.base.reflectance().at(cosine) * (distribution * visibility),
            },
            pdf,
        )
    }

    /// By how much more its lobe reflects on the mean over a part of the surface than at its middle.
    pub fn gain_over(&self, viewer: Vec3, source: Vec3, sides: [Vec3; 2]) -> f32 {
        let (axes, widths) = self.axes();
        gain_over((widths, axes.0), (viewer, source), sides)
    }

    /// A direction by the microfacets that the viewer sees.
    pub fn direction(&self, viewer: Vec3, xi: [f32; 2]) -> Vec3 {
        if let Some(ggx) = self.plain() {
            return ggx.lobe_direction(viewer, xi);
        }
        let (axes, widths) = self.axes();
        let local = axes.local(viewer);
        if local.z <= 0.0 {
            return direction_about(self.side.shading_normal, (1.0 - xi[0]).sqrt(), xi[1]);
        }
        let half = visible_normal_of(widths, local, xi);
        let to = 2.0 * local.dot(half) * half - local;
        axes.outside(to).normalize_or(self.side.shading_normal)
    }

    /// Albedo of the lobe towards a viewer where [`Base::lobe_albedo`] is not it: by sampling, since
    /// it depends on too many numbers for a table.
    pub fn lobe_albedo(&self, viewer: Vec3) -> Option<Rgb> {
        let (axes, widths) = self.axes();
        let local = axes.local(viewer);
        if self.plain().is_some() || local.z <= 0.0 {
            return None;
        }
        let (fresnel, mut sum) = (self.base.reflectance(), Rgb::ZERO);
        for k in 0..SAMPLES {
            // A rank-1 lattice.
            let xi = [(k as f32 + 0.5) / SAMPLES as f32, (k as f32 * 0.618_034 + 0.25).fract()];
            let half = visible_normal_of(widths, local, xi);
            let source = 2.0 * local.dot(half) * half - local;
            if source.z > 0.0 {
                let slants = [local, source].map(|direction| slant(widths, direction));
                let both = source.z * slants[0] + local.z * slants[1];
                let left = source.z * (local.z + slants[0]) / both.max(f32::MIN_POSITIVE);
                sum += fresnel.at(local.dot(half)) * left;
            }
        }
        Some(sum / SAMPLES as f32)
    }
}

/// √(α_x² x² + α_y² y² + z²), of which Smith's masking is made.
fn slant(widths: [f32; 2], direction: Vec3) -> f32 {
    Vec3::new(widths[0] * direction.x, widths[1] * direction.y, direction.z).length()
}
