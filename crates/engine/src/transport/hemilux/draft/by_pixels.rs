//! Drafts by their pixels: which size they have, and how they are shown linearly in between in the size
//! that was asked for.

use crate::image::Picture;
use crate::measurement::Frame;
use crate::radiometry::Rgb;
use crate::rays::Eye;
use crate::render::RenderRequest;
use crate::scene::Camera;
use crate::surface::World;
use glam::Vec2;
use rayon::prelude::*;

/// Jobs begin with a draft whose time budget is less than this for each pixel, seconds: the first
/// iteration may take as long.
const SECONDS_PER_PIXEL: f64 = 12e-6;
/// The same of those of which that share is over before the first pixel, if there are fewer triangles than
/// pixels: what triangles take a draft takes, too.
const LATE: f64 = 0.25;
/// Time budgets for each pixel, seconds, in which more than a first draft fits.
const ENOUGH_PER_PIXEL: f64 = 1.5e-6;
/// Sides of a first draft's pixels, in the picture's, where there is less time than that and more.
const FIRST_SHRINKS: [u32; 2] = [4, 8];
/// Columns and rows that one in the larger pixels has at least.
const LEAST_FIRST_SIDE: u32 = 32;
/// Pictures with a side below this have no drafts.
const LEAST_SIDE: u32 = 128;
/// Scenes of more triangles have none: what these take does not go by the pixels.
const MOST_TRIANGLES: usize = 400_000;
/// Share of the variance of white noise that smoothing over two pixels takes away.
const SMOOTHED_NOISE: f64 = 0.7;

/// A draft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draft {
    /// Size of the picture that was asked for.
    full: [u32; 2],
    /// Side of the draft's pixels, in the picture's.
    pub shrink: u32,
}

/// Where a full picture's pixels lie in a draft's: draft's columns or rows a pixel, and of the first edge.
#[derive(Clone, Copy)]
pub(super) struct Mapping {
    step: Vec2,
    first: Vec2,
}

impl Draft {
    /// That which a request's job begins with, if it had better, after so many seconds.
    pub fn of(request: &RenderRequest, spent: f64) -> Option<Self> {
        let seconds = request.limits.seconds.filter(|_| request.limits.iterations.is_none())?;
        let (width, height) = (request.width, request.height);
        let each = seconds / (f64::from(width) * f64::from(height));
        let is_large = width.min(height) >= LEAST_SIDE;
        let triangles = request.scene.triangle_count();
        let is_light = triangles <= MOST_TRIANGLES;
        let has_enough =
            each >= ENOUGH_PER_PIXEL && width.min(height) >= FIRST_SHRINKS[1] * LEAST_FIRST_SIDE;
        let shrink = FIRST_SHRINKS[usize::from(has_enough)];
        let draft = Self { full: [width, height], shrink };
        let is_late = spent > LATE * seconds && triangles < (width * height) as usize;
        let is_short = each < SECONDS_PER_PIXEL || is_late;
        (is_short && is_large && is_light).then_some(draft)
    }

    #[cfg(test)]
    pub fn of_size(full: [u32; 2], shrink: u32) -> Self {
        Self { full, shrink }
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.full.map(|side| side.div_ceil(self.shrink))
    }

    /// Another one of the same picture.
    pub fn with_pixels(&self, shrink: u32) -> Self {
        Self { shrink, ..*self }
    }

    /// Columns and rows of the picture that was asked for.
    pub fn full_size(&self) -> [u32; 2] {
        self.full
    }

    /// The draft's picture in the size that was asked for; `shine` is what it shows of emitters, whose
    /// edges are found anew by a ray for each pixel.
    pub fn enlarged(
        &self,
        picture: Picture,
        shine: &[Rgb],
        (world, camera): (&World, &Camera),
    ) -> Picture {
        let (from, [width, height]) = ([picture.width, picture.height], self.full);
        let mapping = Mapping::new(from, self.full);
        let dim: Vec<Rgb> =
            picture.pixels.iter().zip(shine).map(|(all, shine)| *all - *shine).collect();
        let mut pixels = mapping.resampled(&dim, from, self.full);
        let frame = Frame::new(&world.rays.camera(camera), width, height);
        let add_shine = |(index, pixel): (usize, &mut Rgb)| {
            let place = Vec2::new((index as u32 % width) as f32, (index as u32 / width) as f32);
            if mapping.around(place, from).iter().any(|(near, _)| shine[*near] != Rgb::ZERO) {
                let at = 2.0 * (place + 0.5) / Vec2::new(width as f32, height as f32) - 1.0;
                *pixel += shine_along(world, frame.ray(Vec2::new(at.x, -at.y)));
            }
        };
        pixels.par_iter_mut().enumerate().with_min_len(1024).for_each(add_shine);
        let alpha = picture.alpha.map(|alpha| {
            let alpha: Vec<Rgb> = alpha.into_iter().map(Rgb::splat).collect();
            let alpha = mapping.resampled(&alpha, from, self.full);
            alpha.into_iter().map(|all| all.x).collect()
        });
        Picture { alpha, ..Picture::new(width, height, pixels) }
    }
}

/// Relative error that larger pixels make, about, noise and all: that between a draft and the same in
/// pixels twice as large, brought back to its size. Edges have it grow by as much from this draft to the
/// picture. `shine`, and `mean` of the pixels that are `counted`, are of the draft.
pub fn loss(picture: &Picture, shine: &[Rgb], counted: &[bool], mean: f64) -> f64 {
    let from = [picture.width, picture.height];
    let dim: Vec<Rgb> =
        picture.pixels.iter().zip(shine).map(|(all, shine)| *all - *shine).collect();
    let (halved, size) = halved(&dim, from);
    let mapping = Mapping { step: Vec2::splat(0.5), first: Vec2::ZERO };
    let smooth = mapping.resampled(&halved, size, from);
    let (mut sum, mut count) = (0.0, 0.0);
    for ((own, smooth), counts) in dim.iter().zip(&smooth).zip(counted) {
        if *counts {
            sum += f64::from((*own - *smooth).length_squared());
            count += 3.0;
        }
    }
    (sum / f64::max(count, 1.0) / (mean * mean).max(f64::MIN_POSITIVE)).sqrt()
}

/// A loss without what of it is noise, of which a draft has so much.
pub fn without_noise(loss: f64, noise: f64) -> f64 {
    (loss * loss - SMOOTHED_NOISE * noise * noise).max(0.0).sqrt()
}

/// Radiance of the emitter that a ray of the camera meets first, if it does.
fn shine_along(world: &World, (origin, direction): (glam::Vec3, glam::Vec3)) -> Rgb {
    let hit = world.rays.closest(Eye::Camera, origin, direction);
    hit.map_or(Rgb::ZERO, |hit| world.shine(hit.triangle, Vec2::new(hit.u, hit.v)))
}

/// Means over squares of two by two pixels, with the number of columns and rows of these.
fn halved(pixels: &[Rgb], [width, height]: [u32; 2]) -> (Vec<Rgb>, [u32; 2]) {
    let size = [width.div_ceil(2), height.div_ceil(2)];
    let mut means = Vec::with_capacity((size[0] * size[1]) as usize);
    for row in 0..size[1] {
        for column in 0..size[0] {
            let (mut sum, mut count) = (Rgb::ZERO, 0.0);
            for y in 2 * row..(2 * row + 2).min(height) {
                for x in 2 * column..(2 * column + 2).min(width) {
                    sum += pixels[(y * width + x) as usize];
                    count += 1.0;
                }
            }
            means.push(sum / count);
        }
    }
    (means, size)
}

impl Mapping {
    /// Of a draft of some size and a picture of another, of the same camera: both are as high; the
    /// draft may be a little wider or narrower.
    pub fn new(from: [u32; 2], to: [u32; 2]) -> Self {
        let [from, to] = [from, to].map(|[width, height]| Vec2::new(width as f32, height as f32));
        let stretch = Vec2::new((to.x / to.y) / (from.x / from.y), 1.0);
        Self { step: stretch * from / to, first: 0.5 * (1.0 - stretch) * from }
    }

    /// The middle of a pixel, in a draft's pixels from the middle of its first.
    pub fn at(&self, pixel: Vec2) -> Vec2 {
        (pixel + 0.5) * self.step + self.first - 0.5
    }

    /// The four pixels of a draft around the middle of a pixel, with the weights of each there.
    fn around(&self, pixel: Vec2, [width, height]: [u32; 2]) -> [(usize, f32); 4] {
        let at = self.at(pixel);
        let low = at.floor();
        let part = at - low;
        let last = Vec2::new((width - 1) as f32, (height - 1) as f32);
        [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
            let place = (low + Vec2::new(x, y)).clamp(Vec2::ZERO, last);
            let along = |more: f32, part: f32| if more > 0.0 { part } else { 1.0 - part };
            let index = place.y as usize * width as usize + place.x as usize;
            (index, along(x, part.x) * along(y, part.y))
        })
    }

    /// Values of a draft in between, at the middles of the pixels of a picture.
    fn resampled(&self, values: &[Rgb], from: [u32; 2], to: [u32; 2]) -> Vec<Rgb> {
        let of = |index: u32| {
            let place = Vec2::new((index % to[0]) as f32, (index / to[0]) as f32);
            self.around(place, from).iter().map(|(near, weight)| values[*near] * *weight).sum()
        };
        (0..to[0] * to[1]).into_par_iter().with_min_len(1024).map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is linear along the picture comes out as it was, but at the rim.
    #[test]
    fn slopes_stay_where_they_are() {
        let draft = Draft { full: [203, 150], shrink: 4 };
        let [width, height] = draft.size();
        let aspect =
            |x: f32, [width, height]: [u32; 2]| (x + 0.5 - 0.5 * width as f32) / height as f32;
        let value = |x: f32, y: f32, size: [u32; 2]| {
            3.0 + aspect(x, size) + 0.5 * (y + 0.5) / size[1] as f32
        };
        let small: Vec<Rgb> = (0..width * height)
            .map(|i| Rgb::splat(value((i % width) as f32, (i / width) as f32, [width, height])))
            .collect();
        let mapping = Mapping::new([width, height], draft.full);
        let large = mapping.resampled(&small, [width, height], draft.full);
        for (index, found) in large.iter().enumerate() {
            let (x, y) = (index as u32 % 203, index as u32 / 203);
            let inside = (4..199).contains(&x) && (4..146).contains(&y);
            let expected = value(x as f32, y as f32, draft.full);
            assert!(!inside || (found.x - expected).abs() < 1e-3, "{found} {expected} at {x}, {y}");
        }
    }

    /// An even picture loses nothing, stripes lose all, and noise is not taken for either.
    #[test]
    fn edges_are_what_drafts_lose() {
        let (size, mean) = ([40, 40], 1.0);
        let of = |value: &dyn Fn(u32, u32) -> f32| {
            let pixels = (0..1600).map(|i| Rgb::splat(value(i % 40, i / 40))).collect();
            Picture::new(size[0], size[1], pixels)
        };
        let (shine, counted) = (vec![Rgb::ZERO; 1600], [true; 1600]);
        assert_eq!(loss(&of(&|_, _| 1.0), &shine, &counted, mean), 0.0);
        let stripes = of(&|x, _| if x % 2 == 0 { 0.5 } else { 1.5 });
        let all = loss(&stripes, &shine, &counted, mean);
        assert!((all - 0.5).abs() < 0.01, "{all}");
        let noisy =
            of(&|x, y| 1.0 + 0.1 * (crate::random::pcg(x + 40 * y) as f32 / 2f32.powi(31) - 1.0));
        let left = without_noise(loss(&noisy, &shine, &counted, mean), 0.1 / 3f64.sqrt());
        assert!(left < 0.02, "{left}");
    }

    /// Of a job of a second, a tenth of which is over, and three tenths.
    #[test]
    fn slow_scenes_begin_with_a_draft_unless_triangles_are_slow() {
        use crate::render::Limits;
        let begins = |triangles: usize, spent: f64| {
            let triangle = crate::scene::Triangle { vertices: [0, 1, 2], material: 0 };
            let scene =
                crate::scene::Scene { triangles: vec![triangle; triangles], ..Default::default() };
            let request = RenderRequest {
                limits: Limits::seconds(1.0),
                ..RenderRequest::new(std::sync::Arc::new(scene), "hemilux", [200; 2])
            };
            Draft::of(&request, spent).is_some()
        };
        assert!(!begins(1000, 0.1) && begins(1000, 0.3));
        assert!(!begins(50_000, 0.3), "more triangles than pixels");
    }
}
