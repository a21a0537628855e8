//! Clear surfaces: what Fresnel's equations let through a dielectric goes on, bent at the surface of
//! a body and straight through a sheet; the rest is mirrored. Rough ones do so by the microfacets
//! that the viewer sees (Walter et al. 2007, "Microfacet models for refraction through rough
//! surfaces"); what a sheet lets through is then the mirrored lobe on its other side, as glTF's
//! KHR_materials_transmission has it.
//!
//! Walks carry radiance over n², which refraction does not change, so that walks from the camera
//! and from the light weigh alike.

use super::distribution::{masked_beyond, masked_further, visible_normal};
use super::side::Side;
use crate::radiometry::Rgb;
use crate::sampling::frame;
use crate::scene::{Appearance, Material, Volume};
use glam::Vec3;

/// Smaller widths of the distribution of microfacets, roughness², count as polished.
const POLISHED: f32 = 1e-3;

/// The least that a colour leaves of light when it becomes an absorption coefficient.
const LEAST_LEFT: f32 = 1e-30;

/// What a clear surface does.
#[derive(Clone, Copy, Debug)]
pub struct Clear {
    /// The share of light that meets it as a clear surface, in (0, 1]; for the rest it is opaque.
    pub share: f32,
    /// Index of refraction, of green; below 1 it mirrors everything.
    ior: f32,
    /// How much larger that of blue is, and how much smaller that of red; 0 where all colours are bent
    /// alike.
    half_spread: f32,
    /// What a crossing leaves of each channel.
    tint: Rgb,
    /// Width of the distribution of microfacets, roughness²; 0 where it is polished.
    alpha: f32,
    /// What it bounds; `None` of a sheet.
    inside: Option<Inside>,
}

/// The inside of a clear body.
#[derive(Clone, Copy, Debug)]
pub struct Inside {
    /// Absorption coefficient, per ray unit.
    absorption: Rgb,
    /// Index of refraction.
    ior: f32,
}

/// A microfacet as a viewer sees it.
struct Facet {
    /// Unit normal.
    normal: Vec3,
    /// Of the angle between that and the direction to the viewer.
    cosine: f32,
    /// Index of refraction beyond over the one before.
    index: f32,
    /// The share of light that it mirrors.
    mirrored: f32,
    /// Cosine of the angle beyond; 0 where all is mirrored.
    below: f32,
}

/// The direction in which a ray leaves an interface, by reflection or through it.
pub struct ExitDirection {
    /// Unit direction away from the surface.
    pub direction: Vec3,
    /// What is left of each channel.
    pub tint: Rgb,
    /// Whether it went through.
    pub through: bool,
    /// What it is in from there on, if it went through.
    pub inside: Option<Inside>,
}

impl Inside {
    fn new(volume: &Volume, ior: f32, metre: f64) -> Self {
        let left = volume.attenuation_color.max(Rgb::splat(LEAST_LEFT));
        let per_metre = left.map(|left| -left.ln()) / volume.attenuation_distance;
        Self { absorption: per_metre / metre as f32, ior }
    }

    /// What is left of each channel after a way, in ray units.
    pub fn left_after(&self, way: f32) -> Rgb {
        (self.absorption * -way).exp()
    }

    /// Its index of refraction squared: radiance there is that many times what walks carry. Of a body
    /// that mirrors everything, 1.
    pub fn density_of_light(&self) -> f32 {
        self.ior.max(1.0).powi(2)
    }
}

impl Clear {
    /// What a material says; `None` of an opaque one. A metre is that many ray units.
    pub fn new(material: &Material, metre: f64) -> Option<Self> {
        let share = material.clear_share();
        let inside = material.volume.map(|volume| Inside::new(&volume, material.ior, metre));
        // A sheet bends nothing. By the Abbe number V, n_F − n_C = (n_d − 1)/V.
        let spread = (material.ior - 1.0).max(0.0) * material.dispersion / 20.0;
        let half_spread = if inside.is_some() { 0.5 * spread } else { 0.0 };
        (share > 0.0).then_some(Self {
            share,
            ior: material.ior,
            half_spread,
            tint: material.base_color,
            alpha: width(material.roughness),
            inside,
        })
    }

    /// The same where the material looks like this; `None` where that is opaque.
    pub fn looking(self, at: &Appearance) -> Option<Self> {
        let share = at.transmission.clamp(0.0, 1.0) * (1.0 - at.metallic.clamp(0.0, 1.0));
        let alpha = width(at.roughness);
        (share > 0.0).then_some(Self { share, tint: at.base_color, alpha, ..self })
    }

    /// Whether what it lets through goes on along the same line.
    pub fn is_straight(&self) -> bool {
        self.inside.is_none() && self.alpha == 0.0
    }

    /// Index of refraction of what lies beyond, from that side, over that of what lies before; 1 of a sheet, which
    /// bends nothing.
    pub fn index(&self, back: bool) -> f32 {
        match self.inside {
            Some(_) if back => 1.0 / self.ior.max(1.0),
            Some(_) => self.ior.max(1.0),
            None => 1.0,
        }
    }

    /// Width of its distribution of microfacets; 0 where it is polished.
    pub fn alpha(&self) -> f32 {
        self.alpha
    }

    /// What it bounds; `None` of a sheet.
    pub fn inside(&self) -> Option<Inside> {
        self.inside
    }

    /// Whether it bends colours by different angles; then a ray is to be [`Clear::split`].
    #[inline]
    pub fn disperses(&self) -> bool {
        self.half_spread > 0.0
    }

    /// The surface as one colour meets it (KHR_materials_dispersion), which a uniform number picks of
    /// those that a ray carries, and what becomes of the ray's channels: of one it is all, of the others
    /// nothing, and on the mean over the numbers nothing changes.
    pub fn split(self, carried: Rgb, xi: f32) -> (Self, Rgb) {
        let weights = carried.abs().to_array();
        let sum: f32 = weights.iter().sum();
        let Some(last) = weights.iter().rposition(|weight| *weight > 0.0) else {
            return (self, Rgb::ONE);
        };
        let (mut channel, mut rest) = (0, xi * sum);
        while channel < last && rest >= weights[channel] {
            rest -= weights[channel];
            channel += 1;
        }
        let ior = (self.ior + (channel as f32 - 1.0) * self.half_spread).max(1.0);
        let mut factor = Rgb::ZERO;
        factor[channel] = sum / weights[channel];
        (Self { ior, half_spread: 0.0, ..self }, factor)
    }

    /// Exponent of a Phong lobe about as wide as what it lets through.
    pub fn exponent(&self) -> f32 {
        let alpha = self.alpha.max(POLISHED);
        (0.5 * (1.0 / (alpha * alpha) - 1.0)).clamp(0.0, 1e5)
    }

    /// What goes on along the same line of light that meets a straight one with that cosine to its
    /// normal.
    pub fn straight(&self, cosine: f32) -> Rgb {
        let cosine = cosine.abs();
        let [mirrored, _] = self.mirrored(cosine, self.ior);
        self.tint * (self.share * (1.0 - mirrored))
    }

    /// What is mirrored at that cosine, and the cosine beyond; `index` is the index of refraction
    /// beyond over the one before.
    fn mirrored(&self, cosine: f32, index: f32) -> [f32; 2] {
        let square = 1.0 - (1.0 - cosine * cosine).max(0.0) / (index * index);
        if self.ior < 1.0 || square <= 0.0 {
            return [1.0, 0.0];
        }
        let below = square.sqrt();
        [fresnel(cosine, below, index), below]
    }

    /// Where light goes on that is met from `viewer`, mirrored or let through, by three uniform
    /// numbers, of which the first says whether it is let through; `None` where shading and
    /// geometric normals contradict each other, and where microfacets hide what is beyond.
    pub fn pass(&self, surface: Side, viewer: Vec3, xi: [f32; 3]) -> Option<ExitDirection> {
        if surface.shading_normal.dot(viewer) <= 0.0 {
            return None;
        }
        let facet = self.facet(surface, viewer, [xi[1], xi[2]]);
        self.leave(surface, viewer, &facet, xi[0] >= facet.mirrored)
    }

    /// Both ways in which it goes on, mirrored and let through, each with its share.
    pub fn pass_both(
        &self,
        surface: Side,
        viewer: Vec3,
        xi: [f32; 2],
    ) -> [(f32, Option<ExitDirection>); 2] {
        if surface.shading_normal.dot(viewer) <= 0.0 {
            return [(0.0, None), (0.0, None)];
        }
        let facet = self.facet(surface, viewer, xi);
        let shares = [(facet.mirrored, false), (1.0 - facet.mirrored, true)];
        shares.map(|(share, through)| (share, self.leave(surface, viewer, &facet, through)))
    }

    /// How light that a microfacet mirrors or lets through goes on.
    fn leave(
        &self,
        surface: Side,
        viewer: Vec3,
        facet: &Facet,
        through: bool,
    ) -> Option<ExitDirection> {
        let normal = surface.shading_normal;
        let Facet { normal: own, cosine, index, below, .. } = *facet;
        let reflection = (2.0 * cosine * own - viewer).normalize();
        let direction = match self.inside {
            _ if !through => reflection,
            Some(_) => ((cosine / index - below) * own - viewer / index).normalize(),
            None if self.alpha == 0.0 => -viewer,
            None => reflection - 2.0 * reflection.dot(normal) * normal,
        };
        let inside = if through && !surface.back { self.inside } else { None };
        let tint = if through { self.tint } else { Rgb::ONE };
        let tint = tint * self.unmasked(normal, viewer, direction, through);
        let goes_on = surface.normal.dot(direction) * if through { -1.0 } else { 1.0 } > 0.0;
        (goes_on && tint != Rgb::ZERO).then_some(ExitDirection { direction, tint, through, inside })
    }

    /// A microfacet that the viewer sees, by two uniform numbers.
    fn facet(&self, surface: Side, viewer: Vec3, xi: [f32; 2]) -> Facet {
        let normal = self.facet_normal(surface.shading_normal, viewer, xi);
        let cosine = normal.dot(viewer).clamp(f32::MIN_POSITIVE, 1.0);
        let index = match self.inside {
            Some(_) if surface.back => 1.0 / self.ior,
            _ => self.ior,
        };
        let [mirrored, below] = self.mirrored(cosine, index);
        Facet { normal, cosine, index, mirrored, below }
    }

    /// The unit normal of a microfacet that the viewer sees.
    fn facet_normal(&self, normal: Vec3, viewer: Vec3, xi: [f32; 2]) -> Vec3 {
        if self.alpha == 0.0 {
            return normal;
        }
        let (tangent, bitangent) = frame(normal, 0.0);
        let local = Vec3::new(tangent.dot(viewer), bitangent.dot(viewer), normal.dot(viewer));
        let facet = visible_normal(self.alpha, local, xi);
        (tangent * facet.x + bitangent * facet.y + normal * facet.z).normalize_or(normal)
    }

    /// The share of light in that direction that no microfacet is in the way of, of what the facets
    /// send there that the viewer sees.
    fn unmasked(&self, normal: Vec3, viewer: Vec3, direction: Vec3, through: bool) -> f32 {
        if self.alpha == 0.0 {
            return 1.0;
        }
        let beyond = normal.dot(direction) * if through { -1.0 } else { 1.0 };
        match self.inside {
            _ if beyond <= 0.0 => 0.0,
            Some(_) if through => masked_beyond(self.alpha, beyond),
            _ => masked_further(self.alpha, [normal.dot(viewer), beyond]),
        }
    }
}

/// Width of the distribution of microfacets; 0 where they are too fine to tell.
fn width(roughness: f32) -> f32 {
    let alpha = roughness.clamp(0.0, 1.0).powi(2);
    if alpha > POLISHED { alpha } else { 0.0 }
}

impl ExitDirection {
    /// The change of power of light that comes from `source` and goes on in this direction
    /// ([`Side::power_factor`]). A sheet bends nothing.
    pub fn power_factor(&self, surface: Side, source: Vec3) -> f32 {
        if self.through && self.direction == -source {
            return 1.0;
        }
        surface.power_factor(self.direction, source)
    }
}

/// Unpolarised reflectance of an interface: cosines on both sides, and the index beyond over the
/// index before.
fn fresnel(before: f32, beyond: f32, index: f32) -> f32 {
    let across = (before - index * beyond) / (before + index * beyond);
    let along = (index * before - beyond) / (index * before + beyond);
    0.5 * (across * across + along * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers by which everything goes through that can.
    const THROUGH: [f32; 3] = [0.999_999, 0.5, 0.5];

    fn surface(back: bool) -> Side {
        let normal = if back { -Vec3::Z } else { Vec3::Z };
        Side { normal, shading_normal: normal, back }
    }

    fn glass(ior: f32) -> Clear {
        Clear::new(&Material::glass("glass", ior), 1.0).expect("it is clear")
    }

    #[test]
    fn fresnel_is_what_textbooks_print() {
        assert!((fresnel(1.0, 1.0, 1.5) - 0.04).abs() < 1e-6);
        // Brewster's angle, tan θ = n, reflects half of (cos²θ − sin²θ)².
        let cosine = (1.0f32 + 1.5 * 1.5).sqrt().recip();
        let sine = (1.0 - cosine * cosine).sqrt();
        let expected = 0.5 * (cosine * cosine - sine * sine).powi(2);
        assert!((fresnel(cosine, sine, 1.5) - expected).abs() < 1e-6);
    }

    #[test]
    fn light_is_bent_by_snells_law_and_there_and_back_again() {
        for sine in [0.0f32, 0.2, 0.5, 0.9, 0.999] {
            let viewer = Vec3::new(sine, 0.0, (1.0 - sine * sine).sqrt());
            let front = surface(false);
            let passed = glass(1.5).pass(front, viewer, THROUGH).expect("it goes through");
            assert!(passed.through && passed.inside.is_some());
            assert!((passed.direction.x + sine / 1.5).abs() < 1e-6, "{}", passed.direction);
            assert!((passed.power_factor(front, viewer) - 1.0).abs() < 1e-5);
            // From inside along the way it came: out along the way that it came.
            let out = glass(1.5).pass(surface(true), passed.direction, THROUGH);
            let out = out.expect("it comes out");
            assert!(out.inside.is_none());
            assert!((out.direction - viewer).length() < 1e-3, "{} {viewer}", out.direction);
        }
    }

    /// Colours are picked by what a ray carries of them, without a change on the mean, and blue is bent
    /// more than red by as much as the Abbe number says.
    #[test]
    fn dispersion_bends_colours_by_the_abbe_number() {
        let material = Material { dispersion: 0.5, ..Material::glass("flint", 1.6) };
        let clear = Clear::new(&material, 1.0).expect("it is clear");
        assert!(clear.disperses() && !glass(1.6).disperses());
        let carried = Rgb::new(0.2, 0.5, 0.3);
        let (mut mean, mut indices) = (Rgb::ZERO, [0.0; 3]);
        for k in 0..1000 {
            let (one, factor) = clear.split(carried, (k as f32 + 0.5) / 1000.0);
            mean += factor / 1000.0;
            let channel = factor.to_array().iter().position(|part| *part > 0.0).unwrap();
            let viewer = Vec3::new(0.6, 0.0, 0.8);
            let passed = one.pass(surface(false), viewer, THROUGH).expect("it goes through");
            indices[channel] = -0.6 / passed.direction.x;
            // What is one colour stays so.
            let (again, factor) = clear.split(carried * factor, 0.7);
            assert!(factor.abs_diff_eq(Rgb::AXES[channel], 1e-6), "{factor}");
            assert_eq!(again.ior, one.ior);
        }
        assert!(mean.abs_diff_eq(Rgb::ONE, 5e-3), "{mean}");
        let [red, green, blue] = indices;
        assert!((green - 1.6).abs() < 1e-4, "{green}");
        // V = 20/0.5.
        assert!(((1.6 - 1.0) / (blue - red) - 40.0).abs() < 0.5, "{red} {blue}");
    }

    #[test]
    fn beyond_the_critical_angle_everything_is_mirrored() {
        let viewer = Vec3::new(0.7, 0.0, -(1.0f32 - 0.49).sqrt());
        let passed = glass(1.5).pass(surface(true), viewer, THROUGH).expect("it is mirrored");
        assert!(!passed.through);
        assert!((passed.direction - Vec3::new(-0.7, 0.0, viewer.z)).length() < 1e-6);
    }

    #[test]
    fn absorption_is_what_the_colour_says_at_its_distance() {
        let volume =
            Volume { attenuation_color: Rgb::new(0.5, 1.0, 0.0), attenuation_distance: 2.0 };
        let left = Inside::new(&volume, 1.5, 8.0).left_after(16.0);
        assert!((left - Rgb::new(0.5, 1.0, 0.0)).length() < 1e-6, "{left}");
        assert_eq!(Inside::new(&volume, 1.5, 8.0).left_after(0.0), Rgb::ONE);
        assert_eq!(Inside::new(&Volume::default(), 1.5, 8.0).left_after(1e6), Rgb::ONE);
    }

    /// Means of what goes on, mirrored and through, over numbers on a grid.
    fn shares(clear: &Clear, back: bool, viewer: Vec3) -> [f32; 2] {
        const SIDE: usize = 24;
        let mut sums = [0.0; 2];
        for k in 0..SIDE * SIDE * SIDE {
            let place = [k % SIDE, k / SIDE % SIDE, k / SIDE / SIDE];
            let xi = place.map(|i| (i as f32 + 0.5) / SIDE as f32);
            if let Some(passed) = clear.pass(surface(back), viewer, xi) {
                sums[usize::from(passed.through)] += passed.tint.x;
            }
        }
        sums.map(|sum| sum / (SIDE * SIDE * SIDE) as f32)
    }

    /// Rough glass loses what its microfacets mask and nothing else: next to nothing where it is
    /// smooth, and no more than a rough white metal does, which at this angle and a roughness of .5
    /// and .8 reflects .897 and .571 (a million samples in double precision).
    #[test]
    fn rough_glass_loses_what_is_masked() {
        let viewer = Vec3::new(0.6, 0.0, 0.8);
        for (roughness, least) in [(0.0, 0.999), (0.2, 0.99), (0.5, 0.88), (0.8, 0.55)] {
            for is_sheet in [false, true] {
                let mut material = Material { roughness, ..Material::glass("frosted", 1.5) };
                if is_sheet {
                    material.volume = None;
                }
                let clear = Clear::new(&material, 1.0).expect("it is clear");
                assert_eq!(clear.is_straight(), is_sheet && roughness == 0.0);
                let [mirrored, through] = shares(&clear, false, viewer);
                let both = mirrored + through;
                assert!((least..1.0 + 1e-4).contains(&both), "{roughness} {is_sheet}: {both}");
                assert!(mirrored > 0.01 && through > 0.5, "{mirrored} {through}");
            }
        }
    }

    /// What goes straight through a sheet is what Fresnel's equations leave of its colour.
    #[test]
    fn a_straight_sheet_is_passed_by_what_walks_find_on_average() {
        let tint = Rgb::new(0.9, 0.5, 0.1);
        let material = Material { base_color: tint, volume: None, ..Material::glass("pane", 1.5) };
        let clear = Clear::new(&material, 1.0).expect("it is clear");
        for sine in [0.0f32, 0.5, 0.9] {
            let viewer = Vec3::new(sine, 0.0, (1.0 - sine * sine).sqrt());
            let [_, through] = shares(&clear, false, viewer);
            let straight = clear.straight(viewer.z);
            assert!((straight.x - through).abs() < 0.03, "{straight} {through}");
            assert!((straight / straight.x * tint.x - tint).length() < 1e-5);
        }
        assert!((clear.straight(1.0).x - 0.9 * 0.96).abs() < 1e-6);
    }
}
