//! What lobes reflect of narrow lights: known without a ray but for what is in between, and that the shadow rays
//! of direct light find of each of them. Neighbours share none of it: most of it is known well. The diffuse part
//! is in the fragment's irradiance; but what Fresnel's term takes from it hangs on the direction, and as that is
//! known here, the difference counts as part of a highlight.

use super::caster::{Caster, MOST_RAYS_OF_ALL};
use super::lobe_here::LobeHere;
use super::polished::{Mirrored, Polished};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::sampling::Shifted;
use bytemuck::{Pod, Zeroable};

/// Share of the squared difference between what cells and their quarters say by which these are off.
const LEFT_OF_DIFFERENCE: f32 = 0.25;

/// The highlights of a lobe.
#[derive(Clone)]
pub struct Highlights {
    /// Which of those that the camera sees it is.
    lobe: u32,
    /// Whether it is polished: then cells of its pixel tell what it mirrors, once and for all, in place of places.
    pub is_polished: bool,
    /// What was found of all lights together.
    pub sums: PlaceSums,
    /// Of each narrow light.
    lights: Box<[Highlight]>,
}

/// Sums over the places at which a lobe was looked at.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PlaceSums {
    /// Σ squares of the radiance that it reflects if nothing is in between, over the channels; of a polished lobe
    /// [`Mirrored::squares`].
    pub squares: f32,
    /// Places so far; of a polished lobe 1 once it was looked at.
    pub places: u32,
}

/// Sums of what a lobe reflects of a narrow light. Checkpoints store them as they are: the order of the fields is
/// part of the format.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Highlight {
    /// Σ over places: radiance if nothing is in between, beside that by the fragment's diffuse albedo.
    open: Rgb,
    /// Σ squares of that, over the channels; of a polished lobe [`Mirrored::squares`].
    squares: f32,
    /// Σ over shadow rays: share that arrives.
    seen: Rgb,
    /// Shadow rays so far.
    rays: u32,
}

impl Highlight {
    /// Variance of the radiance if nothing is in between over so many places, the mean of the channels.
    fn scatter(&self, places: f32) -> f32 {
        variance_over(self.squares, self.open, places)
    }

    /// Share that arrives, and its variance; of a light without such a ray `all`. `rays_of_all`
    /// go to all narrow lights.
    fn share(&self, all: Rgb, rays_of_all: u32) -> (Rgb, Rgb) {
        if self.rays == 0 {
            return (all, (all * (Rgb::ONE - all)).max(Rgb::ZERO));
        }
        let rays = self.rays as f32;
        let share = self.seen / rays;
        let scatter = (share * (Rgb::ONE - share)).max(Rgb::ZERO);
        // Well-spread points, of which a few that are picked at random are as random as their picks.
        let picked = rays / rays_of_all as f32;
        let spread = picked / rays.sqrt() + (1.0 - picked);
        (share, scatter * spread / rays)
    }
}

/// Variance of one of so many values, of which these are the sums of squares, over the channels, and of themselves:
/// the mean of the channels.
fn variance_over(squares: f32, sum: Rgb, count: f32) -> f32 {
    (squares / count - (sum / count).length_squared()).max(0.0) / 3.0
}

impl Highlights {
    /// Those of a lobe, of so many narrow lights, without anything found yet.
    pub fn new((lobe, is_polished): (u32, bool), count: usize) -> Self {
        let lights = vec![Highlight::default(); count].into();
        Self { lobe, is_polished, sums: PlaceSums::default(), lights }
    }

    /// What was found, to be stored.
    pub fn save(all: &[&Self], to: &mut Writer) {
        to.slice(&all.iter().map(|own| own.sums).collect::<Vec<_>>());
        to.slice(&all.iter().flat_map(|own| &own.lights[..]).copied().collect::<Vec<Highlight>>());
    }

    /// Puts back what was stored of the same lobes.
    pub fn restore(all: Vec<&mut Self>, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        let sums: Vec<PlaceSums> = from.exactly(all.len())?;
        let count = all.iter().map(|own| own.lights.len()).sum();
        let lights: Vec<Highlight> = from.exactly(count)?;
        let are_possible = sums.iter().all(|own| own.places <= MOST_RAYS_OF_ALL)
            && lights.iter().all(|own| own.rays <= MOST_RAYS_OF_ALL);
        if !are_possible {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        let mut lights = lights.into_iter();
        for (own, stored) in all.into_iter().zip(sums) {
            own.sums = stored;
            own.lights.iter_mut().zip(&mut lights).for_each(|(own, stored)| *own = stored);
        }
        Ok(())
    }

    /// Whether a few shadow rays to a narrow light found nothing of it.
    #[cfg(test)]
    pub fn hides(&self, light: usize) -> bool {
        self.lights[light].rays >= 4 && self.lights[light].seen == Rgb::ZERO
    }

    /// Adds a shadow ray to a narrow light.
    pub fn add_ray(&mut self, light: u8, visibility: Rgb) {
        let own = &mut self.lights[usize::from(light)];
        own.seen += visibility;
        own.rays += 1;
    }

    /// The lobe at its n-th place.
    fn lobe_at(&self, caster: &Caster<'_>, n: u32) -> LobeHere {
        let Caster { world, visible, .. } = *caster;
        let lobe = &visible.lobes[self.lobe as usize];
        LobeHere::of(visible, visible.surface(world, lobe, (n, n)))
    }

    /// Looks at what a polished lobe mirrors of each light.
    pub fn look_at_cells(&mut self, caster: &Caster<'_>) {
        let lobe = &caster.visible.lobes[self.lobe as usize];
        self.sums = PlaceSums { squares: 0.0, places: 1 };
        for (light, own) in self.lights.iter_mut().enumerate() {
            let Mirrored { radiance, squares } = Polished { caster: *caster, lobe, light }.look();
            (own.open, own.squares) = (radiance, squares);
            self.sums.squares += own.squares;
        }
    }

    /// Looks at so many more places, without a ray.
    pub fn look(&mut self, caster: &Caster<'_>, count: u32) {
        let Caster { lights, visible, seed, .. } = *caster;
        let fragment = visible.lobes[self.lobe as usize].fragment;
        let pixel = visible.fragments[fragment as usize].pixel;
        let sequence = Shifted::new(seed, Stream::Highlight, u64::from(pixel));
        for n in self.sums.places..self.sums.places + count {
            let here = self.lobe_at(caster, n);
            let (start, xi) = (here.surface.start(), sequence.at(n).pair());
            let mut all = Rgb::ZERO;
            for (number, own) in self.lights.iter_mut().enumerate() {
                let light = lights.narrow(number, start, xi);
                let reflected = light.map_or(Rgb::ZERO, |light| here.reflects(light));
                own.open += reflected;
                own.squares += reflected.length_squared();
                all += reflected;
            }
            self.sums.squares += all.length_squared();
        }
        self.sums.places += count;
    }

    /// Mean radiance if nothing is in between, and the variance of that, the mean of the channels.
    pub fn open(&self) -> (Rgb, f32) {
        let count = self.sums.places.max(1) as f32;
        let mean = self.lights.iter().map(|own| own.open).sum::<Rgb>() / count;
        if self.is_polished {
            return (mean, LEFT_OF_DIFFERENCE * self.sums.squares / 3.0);
        }
        // Light varies smoothly over a square of the pixel, of which there are so many: variances of stratified
        // places go by the square of their number.
        (mean, variance_over(self.sums.squares, mean * count, count) / (count * count))
    }

    /// Radiance of all, and its variance; `all` is the share that arrives of any light.
    pub fn radiance(&self, all: Rgb) -> (Rgb, Rgb) {
        let (open, variance) = self.open();
        if open == Rgb::ZERO {
            return (Rgb::ZERO, Rgb::ZERO);
        }
        let count = self.sums.places.max(1) as f32;
        let (mut sum, mut by_shadows) = (Rgb::ZERO, Rgb::ZERO);
        // Where a light is hidden, places tell nothing of it.
        let (mut scatter, mut arrives) = (0.0, Rgb::ZERO);
        let rays = self.lights.iter().map(|own| own.rays).sum();
        for own in &self.lights {
            let (own_open, (share, chance)) = (own.open / count, own.share(all, rays));
            sum += own_open * share;
            by_shadows += own_open * own_open * chance;
            let own_scatter = if self.is_polished { own.squares } else { own.scatter(count) };
            scatter += own_scatter;
            arrives += own_scatter * share * share;
        }
        let by_places = if scatter > 0.0 { arrives / scatter } else { Rgb::ONE };
        (sum, variance * by_places + by_shadows)
    }
}
