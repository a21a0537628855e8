//! Openings through which dark places of a scene see the sky, as the window of a room: a direction
//! to the sky that is drawn by its light alone ends at a wall 99 times of a hundred there, one
//! towards an opening seldom does.
//!
//! `search` finds them by rays, `fitting` puts rectangles into them, `places` tells which of them a
//! place sees, and [`Lookout`] draws directions through those.

mod fitting;
mod lookout;
mod pane;
mod places;
mod rectangle;
mod search;

use super::sky::SkyLight;
use crate::radiometry::importance;
use crate::surface::World;
use fitting::Fitted;
use glam::Vec3;
pub use lookout::Lookout;
use places::{Places, Seen, THROUGH_OPENINGS};
use rectangle::Rectangle;

/// The openings of a scene.
pub struct Openings {
    openings: Vec<Rectangle>,
    places: Places,
}

impl Openings {
    /// Finds the openings of a world; `None` where no place is dark, or where directions through
    /// openings would find the sky little better than others.
    ///
    /// It takes 33 to 200 thousand rays in a scene without dark places and some 300 thousand in others.
    pub fn find(world: &World) -> Option<Self> {
        let sites = search::look_around(world)?;
        let views = search::views_of_shaded(world, &sites);
        let fitted = Fitted::new(world, &sites, &views, &search::balls(&views));
        let places = Places::new(world, &sites, &views, &fitted)?;
        Some(Self { openings: fitted.openings, places })
    }

    /// The directions through openings from a surface at `point` with unit `normal` that sees hardly
    /// anything of the sky; `None` of others.
    pub fn seen_from(&self, point: Vec3, normal: Vec3) -> Option<Lookout> {
        let Seen { openings, helps } = self.places.seen_at(point, normal)?;
        let seen = openings.iter().map(|index| self.openings[usize::from(*index)]);
        let panes = if helps { Lookout::new(seen, point, normal) } else { None };
        Some(panes.unwrap_or_else(|| Lookout::without_panes(!openings.is_empty())))
    }

    /// Number of openings.
    #[cfg(test)]
    fn count(&self) -> usize {
        self.openings.len()
    }
}

/// A direction to the sky for a surface with unit `normal`, through one of the openings that it sees
/// for the most part, and its density, 1/sr.
pub fn sample_sky(
    sky: &SkyLight,
    lookout: Option<&Lookout>,
    normal: Vec3,
    xi: Vec3,
) -> (Vec3, f32) {
    let Some(lookout) = lookout.filter(|lookout| lookout.has_panes()) else {
        return sky.sample(normal, [xi.y, xi.z]);
    };
    let direction = match xi.x < THROUGH_OPENINGS {
        true => lookout.sample(Vec3::new(xi.x / THROUGH_OPENINGS, xi.y, xi.z)),
        false => sky.sample(normal, [xi.y, xi.z]).0,
    };
    (direction, sky_pdf(sky, Some(lookout), normal, direction))
}

/// The same by two directions through openings at once, one of which is picked by what the sky shines through
/// each (resampled importance sampling: Talbot, Cline, Egbert 2005): bright and dark parts of the sky
/// behind a window get rays by their light. `lookout` has openings to draw directions through; `pick` is
/// uniform. What arrives from the direction over the density has the mean of all that arrives, but the density
/// hangs on both draws and is none of other ways to find a direction.
pub fn sample_sky_of_two(
    sky: &SkyLight,
    lookout: &Lookout,
    normal: Vec3,
    (xi, pick): ([Vec3; 2], f32),
) -> (Vec3, f32) {
    // What either way finds counts by how many directions it draws (the balance heuristic), so that
    // a sun in the map is the sky's own draws'.
    let density = |direction| {
        2.0 * THROUGH_OPENINGS * lookout.pdf(direction)
            + (1.0 - THROUGH_OPENINGS) * sky.pdf(normal, direction)
    };
    if xi[0].x >= THROUGH_OPENINGS {
        let direction = sky.sample(normal, [xi[0].y, xi[0].z]).0;
        return (direction, density(direction));
    }
    let drawn = [0, 1].map(|k| {
        let x = 0.5 * (k as f32 + xi[0].x / THROUGH_OPENINGS);
        let direction = lookout.sample(Vec3::new(x, xi[k].y, xi[k].z));
        let density = density(direction);
        let shines = importance(sky.radiance(direction)) * normal.dot(direction).max(0.0);
        (direction, density, if density > 0.0 { shines / density } else { 0.0 })
    });
    let [first, second] = drawn.map(|(.., worth)| worth);
    let is_second = second > 0.0 && pick * (first + second) >= first;
    let (direction, density, worth) = drawn[usize::from(is_second)];
    let both = first + second;
    (direction, if both > 0.0 { density * worth / both } else { 0.0 })
}

/// Density of [`sample_sky`], 1/sr, for a unit direction.
pub fn sky_pdf(sky: &SkyLight, lookout: Option<&Lookout>, normal: Vec3, direction: Vec3) -> f32 {
    let by_light = sky.pdf(normal, direction);
    lookout.filter(|lookout| lookout.has_panes()).map_or(by_light, |lookout| {
        THROUGH_OPENINGS * lookout.pdf(direction) + (1.0 - THROUGH_OPENINGS) * by_light
    })
}

#[cfg(test)]
mod tests;
