//! An audit of the picture: a small sample of unbiased paths beside what the three tiers say.
//!
//! The predicted error ([`super::estimate`]) adds up scatter, and knows nothing of what all rays have
//! wrong together: a leak along a wall, a coarse mesh that is too coarse. Paths from the camera through
//! well-spread places of the picture have the right mean whatever the tiers do. They are few and noisy,
//! so single pixels say nothing, but the mean difference over wide areas does: what lies beyond the
//! noise of the paths is error that no cause has, and what lies below it bounds what may have been
//! missed. What is surely wrong over wide areas is taken off the picture ([`correction`]); apart from that
//! the paths do not become part of it.

mod correction;
mod grid;

use super::fragments::VisibleSurfaces;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::{DirectLights, SceneLights};
use crate::image::Picture;
use crate::radiometry::{Rgb, importance};
use crate::random::{Numbers, Stream};
use crate::sampling::{Seed, Shifted};
use crate::surface::World;
use crate::transport::ray_traced::{Caustics, Tracer, Walk};
use glam::Vec2;
use grid::Grid;
use rayon::prelude::*;

/// Rays of the audit, as a share of all other rays.
const SHARE: f64 = 0.05;
/// Paths that are traced at once: the audit has a multiple of it.
const BATCH: usize = 1024;
/// Most paths of a job, 12 bytes each; a multiple of [`BATCH`].
const MOST_PATHS: usize = 1 << 20;
/// Squares along a side of the finest grid that differences are averaged over; each other has half as
/// many.
const FINEST: usize = 8;
/// Grid by which is said what may have been missed, squares along its side.
const WIDE: usize = 4;
/// Standard deviations that bound what chance may hide.
const LIKELY: f64 = 2.0;
/// Most of what a pixel shows that may be mirrored light where it is held against paths.
const MOST_MIRRORED: f32 = 0.5;

/// The paths so far.
#[derive(Default)]
pub struct Audit {
    /// Found when the first path is traced.
    lights: Option<SceneLights>,
    /// What each path has brought, in their order.
    brought: Vec<Rgb>,
    /// Rays that they took.
    rays: u64,
}

/// What an audit says of a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Verdict {
    /// Squared difference of the radiance over wide areas that is no chance, the mean over channels; 0
    /// where there is none.
    pub found: f64,
    /// Squared difference over wide areas that chance may have hidden; `None` before there are paths
    /// enough to tell.
    pub hidden: Option<f64>,
}

/// What was taken off a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Corrected {
    /// Whether the picture differed from the paths by more than most right pictures do.
    pub is_suspect: bool,
    /// Expected squared error, the mean over channels, that is left of what was wrong; 0 where nothing was.
    pub left: f64,
}

/// What is audited.
pub struct Audited<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its lights as the tiers know them.
    pub known: &'a DirectLights,
    /// What the camera sees of it.
    pub visible: &'a VisibleSurfaces,
    /// The map of the caustics, where there is one: paths can't find those.
    pub caustics: Option<&'a dyn Caustics>,
    /// Random numbers.
    pub seed: Seed,
}

/// What paths are held against, beside the picture.
#[derive(Clone, Copy)]
pub struct Against<'a> {
    /// What the camera sees.
    pub visible: &'a VisibleSurfaces,
    /// The audit's random numbers.
    pub seed: Seed,
    /// Radiance of narrow lights that polished surfaces mirror, by pixel; empty where there is none. Paths find it so
    /// seldom that they would say it is not there.
    pub mirrored: &'a [Rgb],
}

impl Audit {
    /// Number of paths.
    pub fn paths(&self) -> usize {
        self.brought.len()
    }

    /// Traces paths until they have so many `times` their share of `rays`, those of everything else.
    pub fn follow(&mut self, audited: &Audited<'_>, (rays, times): (u64, u32)) {
        let share = SHARE * f64::from(times);
        while (self.rays as f64) < share * rays as f64 && self.paths() < MOST_PATHS {
            if self.lights.is_none() {
                self.lights = SceneLights::beside(audited.world, audited.known);
            }
            let Some(lights) = &self.lights else { return };
            let first = self.paths();
            let traced: Vec<(Rgb, u64)> = (first..first + BATCH)
                .into_par_iter()
                .with_min_len(64)
                .map(|number| audited.trace(lights, number))
                .collect();
            for (brought, rays) in traced {
                self.brought.push(brought);
                self.rays += rays;
            }
        }
    }

    /// Holds the paths against a picture. Pixels that see an emitter are left out, as in all errors.
    pub fn judge(&self, against: Against<'_>, picture: &Picture) -> Verdict {
        let mut grid = self.grid(against, picture);
        let mut verdict = Verdict::default();
        loop {
            if let Some(beyond) = grid.beyond_noise() {
                if beyond.is_sure() {
                    verdict.found = verdict.found.max(beyond.square);
                }
                if grid.side == WIDE {
                    verdict.hidden = Some(beyond.square.max(0.0) + LIKELY * beyond.deviation);
                }
            }
            if grid.side == 1 {
                return verdict;
            }
            grid = grid.coarser();
        }
    }

    /// Takes off the picture what is surely wrong with it over wide areas.
    pub fn correct(&self, against: Against<'_>, picture: &mut Picture) -> Corrected {
        let mut corrected = Corrected::default();
        let exact = exact(against);
        let mut finest = self.grid(against, picture);
        for side in correction::SIDES {
            let mut grid = finest.clone();
            while grid.side > side {
                grid = grid.coarser();
            }
            corrected.is_suspect |=
                grid.beyond_noise().is_some_and(|own| own.square > own.deviation);
            if let Some(correction) = correction::correction(&grid) {
                correction::apply(picture, &exact, &correction.factors);
                corrected.left += correction.left;
                finest = self.grid(against, picture);
            }
        }
        corrected
    }

    /// Differences of a picture from the paths.
    fn grid(&self, against: Against<'_>, picture: &Picture) -> Grid {
        let Against { visible, seed, mirrored } = against;
        let mut grid = Grid::new(FINEST);
        let mut counted = visible.counted(&picture.pixels);
        for (counts, (shown, mirrored)) in
            counted.iter_mut().zip(picture.pixels.iter().zip(mirrored))
        {
            *counts &= importance(*mirrored) <= MOST_MIRRORED * importance(*shown);
        }
        for (number, brought) in self.brought.iter().enumerate() {
            let at = place(seed, number);
            let (x, y) = pixel_at(at, visible);
            let pixel = (y * visible.width + x) as usize;
            if counted[pixel] {
                grid.add(at, picture.pixels[pixel], *brought);
            }
        }
        grid
    }

    /// Writes what the paths have brought.
    pub fn save(&self, to: &mut Writer) {
        to.value([self.rays, self.paths() as u64]);
        to.slice(&self.brought);
    }

    /// Reads what [`Audit::save`] wrote.
    pub fn restore(from: &mut Reader<'_>) -> Result<Self, CheckpointError> {
        let rays = from.value()?;
        let paths = from.count(MOST_PATHS as u64)? as usize;
        let brought: Vec<Rgb> = from.exactly(paths)?;
        match brought.iter().all(|brought| brought.is_finite()) {
            true => Ok(Self { lights: None, brought, rays }),
            false => Err(CheckpointError::damaged("there can't be such a path")),
        }
    }
}

/// Where in the picture a path begins, from 0 to 1 in columns and rows.
fn place(seed: Seed, number: usize) -> Vec2 {
    Vec2::from_array(Shifted::new(seed, Stream::Audit, 0).at(number as u32).pair())
}

/// Column and row of a place.
fn pixel_at(at: Vec2, visible: &VisibleSurfaces) -> (u32, u32) {
    let column = ((at.x * visible.width as f32) as u32).min(visible.width - 1);
    (column, ((at.y * visible.height as f32) as u32).min(visible.height - 1))
}

impl Audited<'_> {
    /// What a path brings, and its rays.
    fn trace(&self, lights: &SceneLights, number: usize) -> (Rgb, u64) {
        let Self { world, visible, caustics, seed, .. } = *self;
        let tracer = Tracer {
            world,
            lights,
            disks: None,
            reflections: u32::MAX,
            rays_per_pixel: 1,
            caustics,
        };
        let mut walk = Walk::new(Numbers::new(seed.number, Stream::Audit, 1 + number as u64));
        let at = 2.0 * place(seed, number) - 1.0;
        let (origin, direction) = visible.frame.ray(Vec2::new(at.x, -at.y));
        let brought = tracer.radiance(origin, direction, &mut walk);
        (if brought.is_finite() { brought } else { Rgb::ZERO }, walk.rays)
    }
}

/// What pixels see of emitters, of the background and of mirrored lights, which is right as it is.
fn exact(against: Against<'_>) -> Vec<Rgb> {
    let Against { visible, mirrored, .. } = against;
    let mut exact = visible.shine.clone();
    for more in [&visible.background[..], mirrored] {
        exact.iter_mut().zip(more).for_each(|(own, more)| *own += *more);
    }
    exact
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::{ALBEDO, EMISSION, SEED, Specimen};

    /// An audit by so many rays of its own in a furnace, and a picture of its one radiance times a factor for each
    /// half.
    fn furnace(rays: u64, [left, right]: [f32; 2]) -> (Audit, VisibleSurfaces, Picture) {
        let specimen = Specimen::furnace();
        let mut visible = specimen.visible();
        // All of a furnace shines; here it counts.
        visible.shine.iter_mut().for_each(|shine| *shine = Rgb::ZERO);
        let audited = Audited {
            world: &specimen.world,
            known: &specimen.lights,
            visible: &visible,
            caustics: None,
            seed: SEED,
        };
        let mut audit = Audit::default();
        audit.follow(&audited, ((rays as f64 / SHARE) as u64, 1));
        let radiance = EMISSION / (1.0 - ALBEDO);
        let (width, height) = (visible.width, visible.height);
        let pixel = |at: u32| if at % width < width / 2 { left } else { right };
        let pixels = (0..width * height).map(|at| Rgb::splat(radiance * pixel(at))).collect();
        let picture = Picture::new(width, height, pixels);
        (audit, visible, picture)
    }

    fn against(visible: &VisibleSurfaces) -> Against<'_> {
        Against { visible, seed: SEED, mirrored: &[] }
    }

    #[test]
    fn paths_get_their_share_of_rays() {
        let (audit, ..) = furnace(300_000, [1.0; 2]);
        let share = audit.rays as f64 / 300_000.0;
        assert!((share - 1.0).abs() < 0.2, "{share}");
        assert_eq!(audit.paths() % BATCH, 0);
    }

    /// A right picture passes, and what is said to be hidden falls with the number of paths; one that is
    /// too bright by a tenth, all over or on one side, does not.
    #[test]
    fn a_planted_error_is_found() {
        let radiance = f64::from(EMISSION / (1.0 - ALBEDO));
        let judged = |rays, halves| {
            let (audit, visible, picture) = furnace(rays, halves);
            audit.judge(against(&visible), &picture)
        };
        let (few, many) = (judged(30_000, [1.0; 2]), judged(600_000, [1.0; 2]));
        assert_eq!((few.found, many.found), (0.0, 0.0));
        let hidden = [few, many].map(|verdict| verdict.hidden.unwrap().sqrt() / radiance);
        assert!(hidden[1] < 0.7 * hidden[0] && hidden[1] < 0.03, "{hidden:?}");
        for halves in [[1.1, 1.1], [1.1, 0.9], [0.8, 1.0]] {
            let expected =
                (0.5 * halves.map(|f: f32| f64::from(f - 1.0).powi(2)).iter().sum::<f64>()).sqrt();
            let found = judged(600_000, halves).found.sqrt() / radiance;
            assert!((found / expected - 1.0).abs() < 0.2, "{found} {expected}");
        }
    }

    /// A light that some pixels mirror, and that no path has found, changes nothing.
    #[test]
    fn mirrored_lights_are_left_alone() {
        let (audit, visible, mut picture) = furnace(600_000, [1.0; 2]);
        let mut mirrored = vec![Rgb::ZERO; picture.pixels.len()];
        for pixel in (0..mirrored.len()).step_by(97) {
            mirrored[pixel] = Rgb::splat(40.0);
            picture.pixels[pixel] += mirrored[pixel];
        }
        let before = picture.pixels.clone();
        let known = Against { mirrored: &mirrored, ..against(&visible) };
        assert_eq!(audit.judge(known, &picture).found, 0.0);
        audit.correct(known, &mut picture);
        assert_eq!(picture.pixels, before);
        assert!(audit.judge(against(&visible), &picture).found > 0.0, "a planted error");
    }

    /// A picture that is wrong all over or on one side comes out right, and one that is right as it was.
    #[test]
    fn a_planted_error_is_taken_off() {
        for halves in [[1.0, 1.0], [1.06, 1.06], [1.05, 0.97], [0.95, 1.0]] {
            let (audit, visible, mut picture) = furnace(600_000, halves);
            let corrected = audit.correct(against(&visible), &mut picture);
            assert_eq!(corrected.left > 0.0, halves != [1.0; 2], "{halves:?}");
            assert!(corrected.is_suspect || halves == [1.0; 2], "{halves:?}");
            let radiance = EMISSION / (1.0 - ALBEDO);
            let (width, quarter) = (picture.width, picture.width / 4);
            for (index, pixel) in picture.pixels.iter().enumerate() {
                let off = (*pixel / radiance - 1.0).abs().max_element();
                // Between the halves factors are smooth.
                let column = index as u32 % width;
                let between = column.abs_diff(width / 2) < quarter / 2;
                assert!(off < if between { 0.06 } else { 0.012 }, "{halves:?} {index}: {off}");
            }
        }
    }

    #[test]
    fn too_few_paths_say_nothing() {
        let (audit, visible, picture) = furnace(0, [2.0; 2]);
        let verdict = audit.judge(against(&visible), &picture);
        assert_eq!((verdict.found, verdict.hidden), (0.0, None));
    }

    /// What noise alone looks like: of many grids of it few are taken for a difference, and the mean of
    /// what is beyond noise is 0.
    #[test]
    fn chance_is_no_difference() {
        const GRIDS: u64 = 2000;
        let skewed = |numbers: &mut Numbers| 1.0 / ((numbers.uniform() + 0.1) * 11f32.ln());
        // One path in 50 finds the light.
        let rare = |numbers: &mut Numbers| match numbers.uniform() < 0.02 {
            true => -50.0 * (1.0 - numbers.uniform()).ln(),
            false => 0.0,
        };
        let kinds: [&dyn Fn(&mut Numbers) -> f32; 2] = [&skewed, &rare];
        for (side, kind) in [1, 2, WIDE].into_iter().flat_map(|side| [(side, 0), (side, 1)]) {
            let (mut surely, mut sum) = (0, 0.0);
            for number in 0..GRIDS {
                let mut numbers = Numbers::new(number, Stream::Audit, 7);
                let mut grid = Grid::new(side);
                for _ in 0..(512 * side * side).min(2048) {
                    let at = Vec2::new(numbers.uniform(), numbers.uniform());
                    grid.add(at, Rgb::ONE, Rgb::splat(kinds[kind](&mut numbers)));
                }
                let beyond = grid.beyond_noise().unwrap();
                surely += u32::from(beyond.is_sure());
                sum += beyond.square / beyond.deviation / GRIDS as f64;
            }
            println!("{side} {kind}: sure {surely} times, mean {sum:.2}");
            assert!(surely <= 10, "{side} {kind}: {surely}");
            assert!((-0.6..0.15).contains(&sum), "{side} {kind}: {sum}");
        }
    }

    #[test]
    fn the_background_stays_as_it_is() {
        let (audit, mut visible, mut picture) = furnace(600_000, [1.1; 2]);
        visible.background = vec![Rgb::ZERO; picture.pixels.len()];
        let before = picture.pixels[0];
        visible.background[0] = before;
        audit.correct(against(&visible), &mut picture);
        assert_eq!(picture.pixels[0], before);
        assert!(picture.pixels[1].x < 0.97 * before.x, "nothing was taken off elsewhere");
    }

    #[test]
    fn it_is_kept_in_checkpoints() {
        let (audit, visible, picture) = furnace(60_000, [1.1; 2]);
        let mut writer = Writer::new(u64::MAX);
        audit.save(&mut writer);
        let bytes = writer.finish().unwrap();
        let again = Audit::restore(&mut Reader::new(&bytes)).unwrap();
        let [one, two] =
            [&audit, &again].map(|audit| audit.judge(against(&visible), &picture).found);
        assert_eq!((one, audit.rays), (two, again.rays));
    }
}
