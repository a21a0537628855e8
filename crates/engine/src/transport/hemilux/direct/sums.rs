//! What the shadow rays of a fragment found, as sums.

use super::caster::MOST_RAYS_OF_ALL;
use super::highlights::Highlights;
use crate::checkpoint::CheckpointError;
use crate::emitters::AllUnoccluded;
use crate::radiometry::{Rgb, importance};
use bytemuck::{Pod, Zeroable};

/// Factor by which few well-spread points are taken to lower the variance of random ones where there is no
/// closed form.
const WELL_SPREAD_FACTOR: f32 = 0.5;
/// Rays from which on that factor falls with the root of their number, as measured in a room with a window.
const WELL_SPREAD_FROM: f32 = 96.0;
/// Squared difference between a neighbour's share of blocked rays and the fragment's own, in units
/// of its variance by chance, up to which the neighbour counts in full: 2.4 standard deviations.
const ALIKE_VARIANCES: f32 = 6.0;
/// The same from which it does not count, since a shadow's edge is in between: 4.9 standard
/// deviations.
const UNLIKE_VARIANCES: f32 = 24.0;
/// Shares of blocked light of two rays that differ by less count as the same: panes take a little
/// more of light that crosses them at another angle.
const SAME_SHARE: f32 = 0.02;

/// What rays of a fragment found, as checkpoints store it: without the closed form.
/// The order of the fields is part of the format.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct StoredShares {
    seen: Rgb,
    cast: Rgb,
    squares: f32,
    rays: u32,
    blocked: f32,
    first: f32,
    mixed: u32,
}

/// The rest of [`ShadowSums`], with the closed forms, which may be means over many places: of what is known, and
/// of the one light that is looked at by itself.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct StoredShadowSums {
    known: StoredShares,
    unoccluded: [Rgb; 2],
    places: u32,
    rays: u32,
    disputed: u32,
    apart: Rgb,
    apart_squares: f32,
    apart_rays: u32,
}

/// Sums over the shadow rays of a fragment.
#[derive(Clone, Default)]
pub struct ShadowSums {
    /// Of rays to light whose irradiance without occlusion is known.
    pub known: ShareSums,
    /// Of rays to the one light that is looked at by itself ([`AllUnoccluded::split`]). The sky where other
    /// light shines, too: in a sun's shadow all light is the sky's, of which few rays would tell anything if
    /// lights were picked by what they shine. And the sun in a room full of sky, for the lamps' sake. Then
    /// `known` is without it.
    pub by_itself: Option<Box<ShareSums>>,
    /// Light of the sky through openings, of the same rays, if it is seen so.
    pub apart: LightApart,
    /// What the fragment's lobe reflects of narrow lights, if that is found here.
    pub highlights: Option<Box<Highlights>>,
    /// How many places of the fragment the closed form of `known` is the mean of; 0 if that of its mean
    /// place stands for all.
    pub places: u32,
    /// How many each pass adds.
    pub more_places: u32,
    /// Rays so far, of all kinds.
    pub rays: u32,
    /// Whether rays here or in the neighbourhood disagreed when they were last compared.
    pub disputed: bool,
}

/// A kind of light in [`ShadowSums`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// [`ShadowSums::known`].
    Known,
    /// [`ShadowSums::by_itself`].
    ByItself,
    /// [`ShadowSums::apart`].
    Apart,
}

/// Sums over shadow rays to light whose irradiance without occlusion is known. Where lights are too many for
/// the closed form ([`crate::emitters::DirectLights::is_exact`]) the light points' irradiances are a
/// Monte-Carlo estimate themselves.
#[derive(Clone, Copy)]
pub struct ShareSums {
    /// Irradiance without occlusion in closed form; zero where lights are too many for that.
    pub unoccluded: Rgb,
    /// Σ irradiance that the unoccluded light points stand for.
    pub seen: Rgb,
    /// Σ irradiance that all light points stand for.
    pub cast: Rgb,
    /// Σ squared importance of the irradiance seen, where lights are too many for the closed form.
    pub squares: f32,
    /// Rays so far.
    pub rays: u32,
    /// Σ share of the light of each ray that something kept from arriving.
    pub blocked: f32,
    /// That share of the first ray; negative before that.
    pub first: f32,
    /// Whether that of another ray was another.
    pub mixed: bool,
}

impl Default for ShareSums {
    fn default() -> Self {
        let (unoccluded, seen, cast) = (Rgb::ZERO, Rgb::ZERO, Rgb::ZERO);
        Self {
            unoccluded,
            seen,
            cast,
            squares: 0.0,
            rays: 0,
            blocked: 0.0,
            first: -1.0,
            mixed: false,
        }
    }
}

/// Sums over the rays that went to light which is no part of the irradiance without occlusion.
#[derive(Clone, Copy, Default)]
pub struct LightApart {
    /// Whether there is such light.
    pub is_any: bool,
    /// Σ irradiance that arrives.
    seen: Rgb,
    /// Σ squared importance of it.
    squares: f32,
    /// Rays that went there.
    rays: u32,
}

impl StoredShares {
    /// The sums to be stored.
    pub fn of(sums: &ShareSums) -> Self {
        let ShareSums { seen, cast, squares, rays, blocked, first, mixed, .. } = *sums;
        Self { seen, cast, squares, rays, blocked, first, mixed: u32::from(mixed) }
    }

    /// Puts back what was stored.
    pub fn restore(&self, sums: &mut ShareSums) -> Result<(), CheckpointError> {
        if self.rays > MOST_RAYS_OF_ALL || !self.blocked.is_finite() {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        let Self { seen, cast, squares, rays, blocked, first, mixed } = *self;
        let (unoccluded, mixed) = (sums.unoccluded, mixed != 0);
        *sums = ShareSums { unoccluded, seen, cast, squares, rays, blocked, first, mixed };
        Ok(())
    }
}

impl StoredShadowSums {
    /// The sums to be stored, but for those of [`ShadowSums::by_itself`].
    pub fn of(sums: &ShadowSums) -> Self {
        let one = sums.by_itself.as_ref().map(|one| one.unoccluded);
        Self {
            known: StoredShares::of(&sums.known),
            unoccluded: [sums.known.unoccluded, one.unwrap_or_default()],
            places: sums.places,
            rays: sums.rays,
            disputed: u32::from(sums.disputed),
            apart: sums.apart.seen,
            apart_squares: sums.apart.squares,
            apart_rays: sums.apart.rays,
        }
    }

    /// Puts back what was stored.
    pub fn restore(&self, sums: &mut ShadowSums) -> Result<(), CheckpointError> {
        if self.rays > MOST_RAYS_OF_ALL || self.apart_rays > self.rays {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        if self.places > MOST_RAYS_OF_ALL || !self.unoccluded.iter().all(|light| light.is_finite())
        {
            return Err(CheckpointError::damaged("light is not finite, or of too many places"));
        }
        self.known.restore(&mut sums.known)?;
        sums.set_unoccluded(self.unoccluded);
        sums.places = self.places;
        (sums.rays, sums.disputed) = (self.rays, self.disputed != 0);
        (sums.apart.seen, sums.apart.squares) = (self.apart, self.apart_squares);
        sums.apart.rays = self.apart_rays;
        Ok(())
    }
}

impl LightApart {
    /// Adds what a ray found.
    pub fn add(&mut self, irradiance: Rgb) {
        self.seen += irradiance;
        self.squares += importance(irradiance).powi(2);
        self.rays += 1;
    }
}

impl ShareSums {
    /// No rays yet, to light that shines so much without occlusion.
    fn new(unoccluded: Rgb) -> Self {
        Self { unoccluded, ..Self::default() }
    }

    /// Estimated variance of the irradiance by the rays of the fragment alone.
    pub fn own_variance(&self, exact: bool) -> Rgb {
        if !exact {
            let (mean, all) = (self.seen / self.rays.max(1) as f32, importance(self.seen));
            if self.rays < 2 || all <= 0.0 {
                return mean * mean;
            }
            let scatter = self.squares * self.rays as f32 / (all * all) - 1.0;
            return mean * mean * (scatter.max(0.0) / (self.rays - 1) as f32 * WELL_SPREAD_FACTOR);
        }
        if !self.mixed {
            return Rgb::ZERO;
        }
        let share = self.blocked_share();
        // Well-spread points do better than random ones: the variance falls by about n^−1.5.
        let variance = share * (1.0 - share) / (self.rays as f32).powf(1.5);
        self.unoccluded * self.unoccluded * variance
    }

    /// Share of the light that arrives, `seen / cast`; where lights are too many for the closed form, the
    /// estimated irradiance.
    pub fn share(&self, exact: bool) -> Rgb {
        if !exact {
            return self.seen / self.rays as f32;
        }
        Rgb::select(self.cast.cmpgt(Rgb::ZERO), self.seen / self.cast, Rgb::ZERO)
    }

    /// Share of the light that was blocked.
    pub fn blocked_share(&self) -> f32 {
        self.blocked / self.rays.max(1) as f32
    }

    /// Variance of the share of blocked rays; where all agree, as if one half of a ray did not.
    fn chance(&self) -> f32 {
        let share = (self.blocked + 0.5) / (self.rays + 1) as f32;
        share * (1.0 - share) / self.rays.max(1) as f32
    }

    /// The same where the rays around say which share arrives: a few rays may agree by chance.
    pub fn chance_around(&self, arrives: f32) -> f32 {
        let share = arrives.clamp(0.0, 1.0);
        self.chance().max(share * (1.0 - share) / self.rays.max(1) as f32)
    }

    /// Weight of a neighbour, 0 to 1, by how likely chance alone explains the difference between
    /// the two shares of blocked rays.
    pub fn alike(&self, other: &Self) -> f32 {
        let off = self.blocked_share() - other.blocked_share();
        alike(off, self.chance() + other.chance())
    }

    /// Whether two fragments' rays say different things.
    pub fn differs_from(&self, other: &Self) -> bool {
        let off = self.blocked_share() - other.blocked_share();
        self.rays > 0 && other.rays > 0 && off.abs() > SAME_SHARE
    }

    /// Variance of what one ray says of the irradiance, importance; where all agree, as if one half of a ray
    /// did not.
    fn variance_of_one(&self) -> f32 {
        let share = (self.blocked + 0.5) / (self.rays + 1) as f32;
        importance(self.unoccluded).powi(2) * share * (1.0 - share)
    }

    /// Adds what a shadow ray found; `irradiance` is what its light point stands for.
    pub fn add_ray(&mut self, irradiance: Rgb, visibility: Rgb, exact: bool) {
        let blocked = 1.0 - importance(visibility);
        if self.first < 0.0 {
            self.first = blocked;
        }
        self.mixed |= (blocked - self.first).abs() > SAME_SHARE;
        self.blocked += blocked;
        self.seen += irradiance * visibility;
        if !exact {
            self.squares += importance(irradiance * visibility).powi(2);
        }
    }
}

impl ShadowSums {
    /// No rays yet, of a fragment on which that shines.
    pub fn new(all: &AllUnoccluded, exact: bool) -> Self {
        let apart = LightApart { is_any: all.looks_out(), ..LightApart::default() };
        let split = all.split().filter(|_| exact);
        let known = split.as_ref().map_or(all.irradiance, |split| split.others.irradiance);
        let by_itself = split.map(|split| Box::new(ShareSums::new(split.one.irradiance)));
        Self { known: ShareSums::new(known), by_itself, apart, ..Self::default() }
    }

    /// What shines at a place of the fragment without occlusion: of what is known, and of the one light that is
    /// looked at by itself. `None` where the place sees the sky in another way than the fragment as a whole.
    pub fn unoccluded(&self, all: &AllUnoccluded) -> Option<[Rgb; 2]> {
        let is_alike = all.looks_out() == self.apart.is_any;
        is_alike.then(|| match self.by_itself {
            Some(_) => all.in_parts(),
            None => [all.irradiance, Rgb::ZERO],
        })
    }

    /// Puts that in place of what shines without occlusion.
    pub fn set_unoccluded(&mut self, [known, one]: [Rgb; 2]) {
        self.known.unoccluded = known;
        if let Some(own) = &mut self.by_itself {
            own.unoccluded = one;
        }
    }

    /// The sums of a part that has shares.
    pub fn part(&self, part: Part) -> Option<&ShareSums> {
        match part {
            Part::Known => Some(&self.known),
            Part::ByItself => self.by_itself.as_deref(),
            Part::Apart => None,
        }
    }

    /// Counts a ray that is sent to a part of the light, to a point that stands for that irradiance.
    pub fn aim(&mut self, part: Part, irradiance: Rgb) {
        self.rays += 1;
        let shares = match (part, &mut self.by_itself) {
            (Part::Apart, _) => return,
            (Part::ByItself, Some(one)) => one,
            _ => &mut self.known,
        };
        shares.rays += 1;
        shares.cast += irradiance;
    }

    /// Adds what a ray to some light point found; `irradiance` is what the point stands for.
    pub fn add(&mut self, part: Part, irradiance: Rgb, visibility: Rgb, exact: bool) {
        match (part, &mut self.by_itself) {
            (Part::Apart, _) if exact => self.apart.add(irradiance * visibility),
            (Part::ByItself, Some(one)) => one.add_ray(irradiance, visibility, exact),
            _ => self.known.add_ray(irradiance, visibility, exact),
        }
    }

    /// Which parts beside the first the light is divided up into: one that is looked at by itself, and light apart.
    pub fn division(&self) -> [bool; 2] {
        [self.by_itself.is_some(), self.apart.is_any]
    }

    /// Whether its n-th ray goes to the one light that is looked at by itself: that and all others take turns.
    pub fn is_turn_of_one(&self, n: u32) -> bool {
        self.by_itself.is_some() && !n.is_multiple_of(2)
    }

    /// Rays that may have gone to light apart.
    pub fn rays_to_apart(&self) -> u32 {
        self.rays - if self.by_itself.is_some() { self.rays / 2 } else { 0 }
    }

    /// Rays that a fragment needs for each of its parts to have one.
    pub fn least_rays(&self) -> u32 {
        1 + u32::from(self.by_itself.is_some())
    }

    /// Whether rays here or around disagreed when they were last compared, or do so here since.
    pub fn is_disputed(&self) -> bool {
        self.disputed || self.known.mixed || self.by_itself.as_ref().is_some_and(|one| one.mixed)
    }

    /// Whether rays say different things than a neighbour's.
    pub fn differs_from(&self, other: &Self) -> bool {
        let ones = self.by_itself.as_ref().zip(other.by_itself.as_ref());
        self.known.differs_from(&other.known)
            || ones.is_some_and(|(mine, theirs)| mine.differs_from(theirs))
    }

    /// Whether its rays tell which share arrives of the light that `other` knows: any has gone to
    /// such light, and it is divided up alike.
    pub fn tells_share_of(&self, other: &Self, part: Part, exact: bool) -> bool {
        let shares = self.part(part).filter(|shares| shares.rays > 0);
        shares.is_some_and(|own| {
            !exact || self.division() == other.division() && own.cast != Rgb::ZERO
        })
    }

    /// Standard deviation of what one ray says of the irradiance, importance.
    pub fn deviation(&self) -> f32 {
        let apart = self.apart_scatter() / (self.rays_to_apart().max(2) - 1) as f32;
        // Where all rays agree, and those around with them, another one hardly says otherwise: in a room full
        // of sky, to suspect the sun everywhere would take nearly all rays from the edges of its patch.
        if !self.is_disputed() {
            return apart.sqrt();
        }
        let one = self.by_itself.as_ref().map_or(0.0, |one| one.variance_of_one());
        (self.known.variance_of_one() + one + apart).sqrt()
    }

    /// Whether more rays are worth while.
    pub fn is_uneven(&self) -> bool {
        self.disputed || self.apart.is_any
    }

    /// Whether nothing shines on the fragment.
    pub fn is_dark(&self) -> bool {
        self.known.unoccluded == Rgb::ZERO && self.by_itself.is_none() && !self.apart.is_any
    }

    /// Mean irradiance through openings.
    pub fn apart_mean(&self) -> Rgb {
        self.apart.seen / self.rays_to_apart().max(1) as f32
    }

    /// Σ squared difference of the rays' irradiances through openings from their mean, importance.
    pub fn apart_scatter(&self) -> f32 {
        let mean = importance(self.apart_mean());
        (self.apart.squares - mean * mean * self.rays_to_apart() as f32).max(0.0)
    }

    /// Variance of the mean irradiance through openings, by the fragment's rays alone.
    pub fn apart_variance(&self) -> Rgb {
        let (mean, rays) = (self.apart_mean(), self.rays_to_apart() as f32);
        let square = importance(mean).powi(2);
        if rays < 2.0 || square <= 0.0 {
            return mean * mean;
        }
        mean * mean * (self.apart_scatter() / (rays * (rays - 1.0) * square) * well_spread(rays))
    }
}

/// Variance of so many well-spread points together over that of random ones: the more they are, the better
/// they fill the places of a pixel and the directions that light comes from.
pub fn well_spread(rays: f32) -> f32 {
    WELL_SPREAD_FACTOR * (WELL_SPREAD_FROM / rays).sqrt().min(1.0)
}

/// Weight of a neighbour, 0 to 1, whose value is that far off, by the variance of the difference.
pub fn alike(off: f32, chance: f32) -> f32 {
    let variances = off * off / chance.max(f32::MIN_POSITIVE);
    ((UNLIKE_VARIANCES - variances) / (UNLIKE_VARIANCES - ALIKE_VARIANCES)).clamp(0.0, 1.0)
}
