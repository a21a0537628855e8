//! What polished surfaces mirror of narrow lights: bright parts of pixels, far smaller than these on metal balls, so
//! that places picked at random miss them or make them far too bright. Cells of a pixel are quartered where the light
//! may be mirrored, until a surface bends evenly over each; what a cell reflects is known in closed form then
//! ([`crate::surface::slopes`]).

use super::caster::Caster;
use super::lobe_here::LobeHere;
use crate::radiometry::Rgb;
use crate::surface::{SlopeChanges, Slopes};
use crate::transport::hemilux::fragments::Lobe;
use crate::transport::hemilux::fragments::cells::{Cell, CellView, PIXEL};
use glam::Vec3;
use std::f32::consts::PI;

/// Times that a pixel is quartered at most.
const MOST_DEPTH: u32 = 7;
/// Change of slope over a cell, in the width of the distribution of microfacets, up to which the distribution is about
/// the same all over it.
const EVEN_CHANGE: f32 = 0.3;
/// Side of a cell, in pixels, below which it is taken for even where it is not known how its surface bends.
const SMALL: f32 = 0.2;
/// Difference between a cell's radiance and the mean of its quarters, relative to that, with which these do.
const ALIKE: f32 = 0.003;
/// The same relative to what all cells and [`DARK`] show.
const NEGLIGIBLE: f32 = 2e-4;
/// Albedo of a surface that is dark beside others under the same light. Where a light is nowhere mirrored, what cells
/// show is faint, and with a normal map finer than they are would be asked for ever more finely.
const DARK: f32 = 0.06;
/// Places in a light's disk for each square of a lobe's width in it, and most of them.
const PER_WIDTH: f32 = 4.0;
const MOST_IN_DISK: f32 = 64.0;
/// The golden ratio, less 1.
const GOLDEN_RATIO: f32 = 0.618_034;

/// A polished lobe under one of the narrow lights.
pub struct Polished<'a> {
    pub caster: Caster<'a>,
    /// Which of those that the camera sees it is.
    pub lobe: &'a Lobe,
    /// Number of the light.
    pub light: usize,
}

/// What a part of the pixel shows of the light.
#[derive(Clone, Copy, Default)]
pub struct Mirrored {
    /// Mean radiance if nothing is in between, beside that by the fragment's diffuse albedo.
    pub radiance: Rgb,
    /// Σ squares of the differences of that between cells and their quarters, over the channels.
    pub squares: f32,
}

/// What a cell shows of it.
struct Shown {
    /// Mean radiance.
    radiance: Rgb,
    /// Whether some of the cell may show much more than the rest.
    is_uneven: bool,
}

impl Polished<'_> {
    /// What all of the pixel shows.
    pub fn look(&self) -> Mirrored {
        let Caster { world, visible, .. } = self.caster;
        let all = self.shown_by(&PIXEL);
        // By one cell nothing is known of what a map does to normals.
        if !all.is_uneven && !visible.has_normal_map(world, self.lobe) {
            return Mirrored { radiance: all.radiance, squares: 0.0 };
        }
        let cells = visible.cells(self.lobe);
        let shown: Vec<Shown> = cells.iter().map(|cell| self.shown_by(cell)).collect();
        let of_cell = |(cell, own): (&Cell, &Shown)| own.radiance.length() * cell.area();
        let about = cells.iter().zip(&shown).map(of_cell).sum::<f32>() + self.dark();
        let mut found = Mirrored::default();
        for (cell, own) in cells.iter().zip(&shown) {
            self.add((cell, own), (0, about), &mut found);
        }
        let share = visible.share(self.lobe);
        found.radiance /= share;
        found.squares /= share * share;
        found
    }

    /// Radiance of a dark matte surface that faces the light there, beside which differences are not seen.
    fn dark(&self) -> f32 {
        let Caster { world, lights, visible, .. } = self.caster;
        let surface = visible.surface(world, self.lobe, (0, 0));
        let light = lights.narrow(self.light, surface.start(), [0.0; 2]);
        light.map_or(0.0, |(_, irradiance)| DARK / PI * irradiance.length())
    }

    /// Adds a cell, quartered where it is uneven, by its area in pixels; all cells together show about so much.
    fn add(&self, (cell, shown): (&Cell, &Shown), (depth, about): (u32, f32), to: &mut Mirrored) {
        let area = cell.area();
        if !shown.is_uneven || depth == MOST_DEPTH {
            to.radiance += shown.radiance * area;
            return;
        }
        let quarters = cell.quarters();
        let all: [Shown; 4] = std::array::from_fn(|k| self.shown_by(&quarters[k]));
        let mean = all.iter().map(|own| own.radiance).sum::<Rgb>() / 4.0;
        let off = (mean - shown.radiance).length();
        let enough = ALIKE * mean.length() * area + NEGLIGIBLE * about;
        if depth > 0 && off * area <= enough {
            to.radiance += mean * area;
            to.squares += (off * area).powi(2);
            return;
        }
        for (quarter, own) in quarters.iter().zip(&all) {
            self.add((quarter, own), (depth + 1, about), to);
        }
    }

    /// What a cell shows of the light.
    fn shown_by(&self, cell: &Cell) -> Shown {
        let Caster { world, lights, visible, .. } = self.caster;
        let CellView { middle, beside } = visible.view_of_cell(world, self.lobe, cell);
        let towards = |point: Vec3, xi| lights.narrow(self.light, point, xi);
        let here = LobeHere::of(visible, middle);
        let start = here.surface.start();
        let Some((direction, irradiance)) = towards(start, [0.0; 2]) else {
            return Shown { radiance: Rgb::ZERO, is_uneven: false };
        };
        let reflection = here.surface.reflection();
        let slopes = reflection.slopes(here.viewer, direction);
        let along = beside.map(|beside| {
            let (step, surface) = beside?;
            let viewer = visible.frame.towards_eye(surface.spot.point);
            let (direction, _) = towards(surface.start(), [0.0; 2])?;
            let there = surface.reflection().slopes(viewer, direction);
            Some([0, 1].map(|lobe| (there[lobe] - slopes[lobe]) / step))
        });
        // Facets may be much smaller than a cell.
        let are_known = along.iter().all(Option::is_some) || cell.side < SMALL;
        let along = along.map(Option::unwrap_or_default);
        let mut changes: SlopeChanges = [0, 1].map(|lobe| along.map(|side| side[lobe]));
        let places = Places::new(
            &slopes,
            &mut changes,
            reflection.widths(),
            0.5 * lights.narrow_radius(self.light),
        );
        let reflects = |direction: Vec3| here.reflects_over((direction, irradiance), &changes);
        let radiance = match places.in_disk {
            0 | 1 => reflects(direction),
            count => {
                let of = |k: u32| {
                    let xi = [(k as f32 + 0.5) / count as f32, (k as f32 * GOLDEN_RATIO).fract()];
                    towards(start, xi).map_or(Rgb::ZERO, |(direction, _)| reflects(direction))
                };
                (0..count).map(of).sum::<Rgb>() / count as f32
            }
        };
        Shown { radiance, is_uneven: places.are_uneven || !are_known }
    }
}

/// How finely a cell and the light's disk have to be looked at.
struct Places {
    are_uneven: bool,
    /// Places in the disk.
    in_disk: u32,
}

impl Places {
    /// Where half vectors have these slopes in the middle of a cell, which change like this over it; the light's disk
    /// reaches so far, as a change of slope. Far from where the light is mirrored, the middle stands for all of the
    /// cell: the changes become none.
    fn new(slopes: &Slopes, changes: &mut SlopeChanges, widths: [f32; 2], radius: f32) -> Self {
        let (mut are_uneven, mut in_disk) = (false, 1.0f32);
        for ((slope, changes), width) in slopes.iter().zip(changes).zip(widths) {
            if !width.is_finite() {
                continue;
            }
            let change = changes[0].length() + changes[1].length();
            let far = slope.length();
            // Slopes go up without bound where the half vector comes near the horizon; angles do not.
            let turn = change / (1.0 + far * far);
            if far.atan() > 2.0 * (turn + radius + width) {
                *changes = [Vec3::ZERO; 2];
            } else {
                are_uneven |= change > EVEN_CHANGE * width;
            }
            let change = changes[0].length() + changes[1].length();
            if far < 2.0 * change + 6.0 * (radius + width) {
                let ratio = radius / width.max(0.5 * change);
                in_disk = in_disk.max(PER_WIDTH * ratio * ratio);
            }
        }
        Self { are_uneven, in_disk: in_disk.ceil().min(MOST_IN_DISK) as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::nth_of_pattern;
    use crate::radiometry::importance;
    use crate::random::Stream;
    use crate::sampling::Shifted;
    use crate::scene::{Camera, Layering, Layers, Material};
    use crate::transport::hemilux::fragments::VisibleSurfaces;
    use crate::transport::hemilux::specimen::{SEED, Specimen, mirrored_by_ball};

    const YFOV: f32 = 0.3;
    const FAR: f32 = 40.0;

    /// A ball of radius 1 under a sun, which a camera sees from afar.
    fn ball(material: Material, slices: u32, sun: Vec3) -> Specimen {
        let (mut scene, environment) = Specimen::sunlit_ball(material, slices, sun);
        scene.cameras = vec![Camera::look_at("camera", eye(), Vec3::ZERO, Vec3::Y, YFOV)];
        Specimen::of(scene, environment, 200)
    }

    fn eye() -> Vec3 {
        FAR * Vec3::new(0.2, 0.1, 1.0).normalize()
    }

    fn visible(specimen: &Specimen, side: u32) -> VisibleSurfaces {
        let camera = &specimen.world.scene.cameras[0];
        VisibleSurfaces::new(&specimen.world, specimen.cut.clone(), camera, [side; 2], 64)
    }

    fn caster<'a>(specimen: &'a Specimen, visible: &'a VisibleSurfaces) -> Caster<'a> {
        Caster { world: &specimen.world, lights: &specimen.lights, visible, seed: SEED }
    }

    fn looked<'a>(caster: Caster<'a>, lobe: &'a Lobe) -> Mirrored {
        Polished { caster, lobe, light: 0 }.look()
    }

    fn metal(roughness: f32) -> Material {
        Material { base_color: Rgb::ONE, metallic: 1.0, roughness, ..Material::default() }
    }

    /// What a lobe shows of the sun in the middle of a cell, as a single ray would find it.
    fn shown_at(
        specimen: &Specimen,
        visible: &VisibleSurfaces,
        lobe: &Lobe,
        (cell, xi): (&Cell, [f32; 2]),
    ) -> Rgb {
        let seen = visible.view_of_cell(&specimen.world, lobe, cell);
        let here = LobeHere::of(visible, seen.middle);
        let sun = specimen.lights.narrow(0, here.surface.start(), xi).expect("it shines");
        here.reflects_over(sun, &[[Vec3::ZERO; 2]; 2])
    }

    /// Share of what the ball mirrors that pixels of a square picture show, by what of them a lobe shows.
    fn share_shown((visible, sun): (&VisibleSurfaces, Vec3), of: impl Fn(&Lobe) -> Rgb) -> f64 {
        let shown = |lobe: &Lobe| f64::from(of(lobe).x * visible.share(lobe));
        let pixel = (2.0 * f64::from(YFOV / 2.0).tan() / f64::from(visible.width)).powi(2);
        visible.lobes.iter().map(shown).sum::<f64>() * pixel / mirrored_by_ball(sun, eye()).0
    }

    /// A ball that reflects everything, of eight pixels or more, mirrors what it should; single places miss that by far.
    #[test]
    fn a_ball_mirrors_the_sun() {
        let sun = Vec3::new(1.0, 0.7, 0.4);
        let specimen = ball(metal(0.0), 128, sun);
        for side in [50, 101, 300, 1000] {
            let visible = visible(&specimen, side);
            let caster = caster(&specimen, &visible);
            let found = share_shown((&visible, sun), |lobe| looked(caster, lobe).radiance);
            let single = |lobe: &Lobe| shown_at(&specimen, &visible, lobe, (&PIXEL, [0.0; 2]));
            let single = share_shown((&visible, sun), single);
            println!("{side}: {found:.4}, by single places {single:.4}");
            let most = if side > 100 { 0.01 } else { 0.25 };
            assert!((found - 1.0).abs() < most, "{side}: {found}");
            assert!((single - 1.0).abs() > 0.5, "{side}: {single}");
        }
    }

    /// The same of balls of one pixel to six, whose facets are far smaller: nearly all of the time.
    #[test]
    fn a_tiny_ball_mirrors_the_sun() {
        const SUNS: u32 = 24;
        for side in [9, 16, 35] {
            let of_sun = |k: u32| {
                let (sin, cos) = (2.4 * k as f32).sin_cos();
                let sun = Vec3::new(cos, 0.05 * k as f32 - 0.6, 0.6 + sin);
                let specimen = ball(metal(0.0), 128, sun);
                let visible = visible(&specimen, side);
                let caster = caster(&specimen, &visible);
                share_shown((&visible, sun), |lobe| looked(caster, lobe).radiance)
            };
            let all: Vec<f64> = (0..SUNS).map(of_sun).collect();
            let mean = all.iter().sum::<f64>() / f64::from(SUNS);
            let near = all.iter().filter(|found| (*found - 1.0).abs() < 0.2).count();
            println!("{side}: {mean:.3}, {near} of {SUNS} within a fifth");
            assert!((mean - 1.0).abs() < 0.15 && near >= 20, "{side}: {mean} {all:.2?}");
        }
    }

    /// What cells say of lobes that are wide enough is what very many places say, pixel by pixel: of bare metal, and of
    /// a coat over something rough.
    #[test]
    fn cells_say_what_very_many_places_say() {
        const PLACES: u32 = 1 << 15;
        let factors = Layers { coat: 1.0, coat_roughness: 0.2, ..Layers::NONE };
        let layering = Some(Box::new(Layering { factors, ..Layering::default() }));
        for material in [metal(0.2), Material { layering, ..metal(0.6) }] {
            let specimen = ball(material, 32, Vec3::new(1.0, 0.7, 0.4));
            let visible = visible(&specimen, 48);
            let caster = caster(&specimen, &visible);
            let (mut off, mut all) = (0.0, 0.0);
            let whole = (0..).zip(&visible.lobes).filter(|(_, lobe)| visible.share(lobe) == 1.0);
            for (number, lobe) in whole {
                let sequence = Shifted::new(SEED, Stream::Highlight, number);
                let of_place = |n: u32| {
                    let cell = Cell { middle: nth_of_pattern(PLACES, n), side: 1e-3 };
                    shown_at(&specimen, &visible, lobe, (&cell, sequence.at(n).pair()))
                };
                let places = (0..PLACES).map(of_place).sum::<Rgb>() / PLACES as f32;
                off += f64::from(importance(looked(caster, lobe).radiance - places)).powi(2);
                all += f64::from(importance(places)).powi(2);
            }
            let off = (off / all).sqrt();
            println!("off by {off:.4}");
            assert!(all > 0.0 && off < 0.03, "{off}");
        }
    }
}
