//! How the time of an iteration is shared out among the causes of the error.

use super::estimate::Errors;
use bytemuck::{Pod, Zeroable};

/// Most passes of lobe rays in an iteration.
const MOST_LOBE_PASSES: u32 = 12;
/// Most passes of shadow rays in an iteration.
const MOST_SHADOW_PASSES: u32 = 8;
/// How many times as long as those before the iterations after each of the first ones are: the first is as short
/// as the first picture asks for; later what an iteration does beside its rays, and records that get ever more of
/// them, had better be spread over more.
const LONGER: f64 = 1.4;
/// The first iterations.
const GROW_UNTIL: u64 = 3;
/// Time of a gather ray and of a shadow ray, in that of a lobe ray with its ray to the lights, as
/// measured in four scenes: .2 to .9, most often .7, and .2 to .3.
const RAY_COSTS: [f64; 2] = [0.7, 0.2];
/// How many times as much an error of records counts as one of single pixels: it is smooth, blotches as wide as
/// records are apart, which the eye sees and no denoiser takes away.
pub const SMOOTH_COUNTS: f64 = 2.0;
/// Most of the camera's rays in a pixel at an edge in an iteration.
const MOST_EDGE_RAYS: u32 = 128;
/// Error by edges, over that of all else, down to which rays are drawn there: 2 % of the square.
const EDGES_ASIDE: f64 = 0.15;
/// Share of an iteration's time that rays at edges may take, and time of one in that of a lobe ray.
pub const EDGE_TIME: f64 = 0.05;
const EDGE_COST: f64 = 0.2;
/// Error by textures, over that of all, down to which they are read more finely: 2 % of the square.
const TEXTURES_ASIDE: f64 = 0.15;
/// Time of reading a square of a pixel's textures in that of a lobe ray, and share of the time so far that
/// it may take.
const TEXTURE_COST: f64 = 0.3;
const TEXTURE_TIME: f64 = 0.1;
/// Most iterations from one in which records get more rays to the next.
const MOST_REFINE_EVERY: u32 = 32;
/// Share of the squared error from which interpolation between records asks for more records.
const REFILLED_FROM: f64 = 0.25;
/// Squared error by noise that new records may have, over that by interpolation.
const NOISE_OF_NEW: f64 = 0.3;
/// Fewest rays of a new record.
const LEAST_NEW_RAYS: f64 = 32.0;
/// Error by records and links, over that by lobes and edges, below which links are not doubled: 1 % of the square.
const LINKS_ASIDE: f64 = 0.1;
/// Iterations after which links that make no error are known to make none: they have been doubled twice.
const LINKS_KNOWN: u64 = 4;
/// How many times its usual share of the rays the audit gets where it has a suspicion: then more paths
/// either find what is wrong, and take it off, or find nothing.
const AUDIT_TIMES: u32 = 3;

/// What an iteration does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Balance {
    /// Passes of shadow rays.
    pub shadow_passes: u32,
    /// Passes of lobe rays; 0 where these are worth their time only now and then.
    pub lobe_passes: u32,
    /// The camera's rays in a pixel at an edge.
    pub edge_rays: u32,
    /// Records get more rays in every so-manieth iteration.
    pub refine_every: u32,
    /// Rays of new records, where the next iteration is to make some; 0 where not.
    pub new_rays: u32,
    /// How many times its usual share of the rays the audit gets.
    pub audit_times: u32,
    /// 1 where links stay as they are for the time being.
    pub links_wait: u32,
}

/// What has been done so far.
#[derive(Clone, Copy)]
pub struct WorkDone {
    /// Iterations.
    pub iterations: u64,
    /// Gather rays.
    pub gather_rays: u64,
    /// Passes of shadow rays, and these.
    pub shadows: (f64, u64),
    /// Passes of lobe rays for all lobes, and the time of these in that of one ray.
    pub lobes: (f64, f64),
    /// Mean number of rays of a record.
    pub rays_per_record: f64,
    /// At edges.
    pub edges: EdgeWork,
}

impl WorkDone {
    /// Times of gather rays, shadow rays and lobe rays, in that of one lobe ray.
    fn times(&self) -> [f64; 3] {
        let [gather, shadow] = RAY_COSTS;
        [gather * self.gather_rays as f64, shadow * self.shadows.1 as f64, self.lobes.1]
    }

    /// Whether so many squares had better be read of textures, whose error is then a fourth of the squared
    /// one: if that counts, in a small part of the time so far.
    pub fn allows_textures(&self, errors: &Errors, squares: f64) -> bool {
        let time: f64 = self.times().iter().sum();
        let counts = errors.by_textures > TEXTURES_ASIDE * errors.total;
        counts && TEXTURE_COST * squares < TEXTURE_TIME * time
    }
}

/// What has been done at edges.
#[derive(Clone, Copy)]
pub struct EdgeWork {
    /// Pixels.
    pub pixels: usize,
    /// Rasterised samples of each.
    pub samples: u32,
    /// Rays of each.
    pub rays: u32,
}

impl EdgeWork {
    /// How many more rays a pixel at an edge needs for edges to be a small part of the error: variances of
    /// well-spread samples go by the power 3/2 of their number.
    pub fn wanted(&self, errors: &Errors) -> f64 {
        let [noise, bent, shadows, lobes, edges] = errors.by_cause;
        let rest = noise.hypot(bent).hypot(shadows).hypot(lobes).hypot(errors.by_links);
        let [samples, rays] = [self.samples, self.rays].map(|count| f64::from(count).powf(1.5));
        let times = (edges / (EDGES_ASIDE * rest).max(f64::MIN_POSITIVE)).powi(2);
        let wanted = ((samples + rays) * times - samples).max(0.0).powf(2.0 / 3.0);
        (wanted - f64::from(self.rays)).max(0.0)
    }
}

impl Default for Balance {
    fn default() -> Self {
        Self {
            shadow_passes: 1,
            lobe_passes: 1,
            edge_rays: 0,
            refine_every: 1,
            new_rays: 0,
            audit_times: 1,
            links_wait: 0,
        }
    }
}

impl Balance {
    /// Whether to find it anew after so many iterations: 2, 3, 4, 6, 8, 12 and so on.
    pub fn is_due(iterations: u64) -> bool {
        let is_between = iterations.is_multiple_of(3) && (iterations / 3).is_power_of_two();
        iterations > 1 && (iterations.is_power_of_two() || is_between)
    }

    /// Shares time out so that it goes where it lowers the error most. Until it is found anew, gather
    /// rays, shadow rays and lobe rays get what brings the time t of each nearest to being in proportion
    /// to e√t, e the error that it leaves: where errors fall with the root of the time, that makes the
    /// sum of their squares least, with those of records counted more than once. Rays at edges are cheap: there
    /// are as many as make edges a small part of the error, in a small part of the time, or in theirs by the
    /// same rule; more rays for records where noise counts, and more records where interpolation does.
    pub fn of(errors: &Errors, done: WorkDone) -> Self {
        let [noise, bent, shadows, lobes, edges] = errors.by_cause;
        let [noise, bent] = [noise, bent].map(|smooth| SMOOTH_COUNTS * smooth);
        let least = f64::MIN_POSITIVE;
        let [gather, shadow_time, lobe_time] = done.times();
        let [shadow_passes, lobe_passes] = [done.shadows.0, done.lobes.0];
        let worth = |error: f64, time: f64| error * time.sqrt();
        let all_worth = worth(noise.hypot(bent), gather)
            + worth(shadows, shadow_time)
            + worth(lobes, lobe_time);
        let until = (done.iterations + 1..).find(|next| Self::is_due(*next)).unwrap_or(u64::MAX);
        let more = (until - done.iterations) as f64;
        let edge_cost = EDGE_COST * done.edges.pixels.max(1) as f64;
        let edge_time = edge_cost * f64::from(done.edges.samples + done.edges.rays);
        let edge_worth = worth(edges, edge_time);
        let by_rest = gather + shadow_time + lobe_time;
        let of_all = |time: f64| time * until as f64 / done.iterations as f64;
        let longer = if done.iterations <= GROW_UNTIL { LONGER } else { 1.0 };
        let time_then = longer * of_all(by_rest);
        let passes = |error: f64, passes: f64, time: f64| {
            let wanted = time_then * worth(error, time) / all_worth.max(least);
            ((wanted - time).max(0.0) / more * passes / time.max(least)).round() as u32
        };
        let squares = |causes: &[f64]| causes.iter().map(|cause| cause * cause).sum::<f64>();
        let time = by_rest / done.iterations as f64;
        let edge_share = edge_worth / (all_worth + edge_worth).max(least);
        // Where all light is emitted there is nothing else to take time from.
        let theirs = of_all(by_rest + edge_time) * edge_share - edge_time;
        let affordable = (EDGE_TIME * time).max(theirs / more) / edge_cost;
        let edge_rays = (done.edges.wanted(errors) / more).min(affordable);
        let but_noise = squares(&[bent, shadows, lobes, edges]);
        let refine_every = but_noise / (4.0 * noise * noise).max(least);
        let all = squares(&[noise, bent, shadows, lobes, edges]);
        let enough = done.rays_per_record * (noise / bent.max(least)).powi(2) / NOISE_OF_NEW;
        let links = errors.by_links;
        let by_links = [errors.by_cause[0], errors.by_cause[1], links];
        let are_known = links > 0.0 || done.iterations >= LINKS_KNOWN;
        let links_wait =
            are_known && squares(&by_links) < (LINKS_ASIDE * lobes.hypot(edges)).powi(2);
        let refills = bent * bent > REFILLED_FROM * all;
        Self {
            shadow_passes: passes(shadows, shadow_passes, shadow_time).clamp(1, MOST_SHADOW_PASSES),
            lobe_passes: passes(lobes, lobe_passes, lobe_time).min(MOST_LOBE_PASSES),
            edge_rays: (edge_rays.round() as u32).min(MOST_EDGE_RAYS),
            refine_every: (refine_every.round() as u32).clamp(1, MOST_REFINE_EVERY),
            new_rays: if refills { enough.max(LEAST_NEW_RAYS).round() as u32 } else { 0 },
            audit_times: if errors.is_suspect { AUDIT_TIMES } else { 1 },
            links_wait: u32::from(links_wait),
        }
    }

    /// The same within the bounds that [`Balance::of`] keeps, whatever a checkpoint says.
    pub fn bounded(self) -> Self {
        Self {
            shadow_passes: self.shadow_passes.clamp(1, MOST_SHADOW_PASSES),
            lobe_passes: self.lobe_passes.min(MOST_LOBE_PASSES),
            edge_rays: self.edge_rays.min(MOST_EDGE_RAYS),
            refine_every: self.refine_every.clamp(1, MOST_REFINE_EVERY),
            new_rays: self.new_rays,
            audit_times: self.audit_times.clamp(1, AUDIT_TIMES),
            links_wait: self.links_wait.min(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As much time for each.
    const DONE: WorkDone = WorkDone {
        iterations: 4,
        gather_rays: 1_000_000,
        shadows: (4.0, 3_500_000),
        lobes: (4.0, 700_000.0),
        rays_per_record: 200.0,
        edges: EdgeWork { pixels: 1000, samples: 16, rays: 0 },
    };

    fn balance(by_cause: [f64; 5]) -> Balance {
        Balance::of(&Errors { by_cause, ..Errors::default() }, DONE)
    }

    #[test]
    fn it_is_found_anew_ever_less_often() {
        let due: Vec<u64> = (0..50).filter(|count| Balance::is_due(*count)).collect();
        assert_eq!(due, [2, 3, 4, 6, 8, 12, 16, 24, 32, 48]);
    }

    #[test]
    fn work_goes_to_what_is_wrong() {
        // Noise alone: nothing else is worth its time.
        let noise = balance([0.02, 0.0, 0.0, 0.0, 0.0]);
        let least = Balance { lobe_passes: 0, ..Balance::default() };
        assert_eq!(noise, least);
        // What records lose between them: more of them, with fewer rays where noise is small.
        let bent = balance([0.002, 0.02, 0.0, 0.0, 0.0]);
        assert_eq!((bent.refine_every, bent.new_rays), (25, 32));
        assert_eq!(balance([0.02, 0.02, 0.0, 0.0, 0.0]).new_rays, 667);
        // Half of the squared error at edges: 44 times as much weight there as by the samples alone, in two
        // iterations; and where a twentieth of the time is not enough, no more than by their worth.
        let edges = balance([0.01, 0.0, 0.0, 0.0, 0.01]);
        assert_eq!((edges.edge_rays, edges.new_rays), (99, 0));
        let many = EdgeWork { pixels: 10_000, ..DONE.edges };
        let errors = Errors { by_cause: [0.01, 0.0, 0.0, 0.0, 0.01], ..Errors::default() };
        assert_eq!(Balance::of(&errors, WorkDone { edges: many, ..DONE }).edge_rays, 69);
        // Where nothing but edges takes time, as many again as there were samples, in two iterations.
        let nothing = WorkDone { gather_rays: 0, shadows: (4.0, 0), lobes: (0.0, 0.0), ..DONE };
        let errors = Errors { by_cause: [0.0, 0.0, 0.0, 0.0, 0.01], ..Errors::default() };
        assert_eq!(Balance::of(&errors, nothing).edge_rays, 4);
        // Lobes have a third of the time and are worth three quarters: all of what two iterations take.
        let lobes = balance([0.005, 0.0, 0.0, 0.03, 0.0]);
        assert_eq!((lobes.lobe_passes, lobes.shadow_passes, lobes.edge_rays), (5, 1, 0));
        let shadows = balance([0.015, 0.0, 0.03, 0.01, 0.0]);
        assert_eq!((shadows.shadow_passes, shadows.lobe_passes), (2, 0));
        // What costs a tenth is worth less, for the same error, but done more often.
        let cheap = WorkDone { shadows: (4.0, 350_000), ..DONE };
        let errors = Errors { by_cause: [0.015, 0.0, 0.03, 0.01, 0.0], ..Errors::default() };
        assert_eq!(Balance::of(&errors, cheap).shadow_passes, 8);
    }

    /// The time of another iteration is that of those so far, and after the first ones more.
    #[test]
    fn iterations_become_longer_at_first() {
        let errors = Errors { by_cause: [0.0, 0.0, 0.0, 0.03, 0.0], ..Errors::default() };
        let passes = |iterations| {
            let done = WorkDone { iterations, lobes: (2.0, 700_000.0), ..DONE };
            Balance::of(&errors, done).lobe_passes
        };
        // All of 2.1 million rays' time goes to lobes, of which a pass takes .35: for one more iteration
        // 1.4 · 4/3 · 2.1 altogether, for two 1.5 · 2.1, of which they have had .7.
        assert_eq!([3, 4].map(passes), [9, 4]);
    }

    #[test]
    fn links_wait_where_lobes_make_the_error() {
        let of = |by_cause, by_links| {
            Balance::of(&Errors { by_cause, by_links, ..Errors::default() }, DONE).links_wait
        };
        assert_eq!(of([0.005, 0.005, 0.01, 0.2, 0.01], 0.001), 1);
        assert_eq!(of([0.005, 0.005, 0.01, 0.01, 0.2], 0.001), 1);
        // Before links have doubled once nobody knows how far they are off.
        let lobes = Errors { by_cause: [0.005, 0.005, 0.01, 0.2, 0.01], ..Errors::default() };
        let early = WorkDone { iterations: 2, ..DONE };
        assert_eq!([early, DONE].map(|done| Balance::of(&lobes, done).links_wait), [0, 1]);
        assert_eq!(of([0.005, 0.005, 0.01, 0.2, 0.01], 0.02), 0);
        assert_eq!(of([0.005, 0.02, 0.01, 0.2, 0.01], 0.001), 0);
        assert_eq!(of([0.005, 0.005, 0.2, 0.01, 0.01], 0.001), 0);
    }

    #[test]
    fn all_of_it_is_bounded() {
        for errors in [[0.0; 5], [1.0; 5], [0.0, 0.0, 0.0, 1.0, 1.0], [1e-300; 5]] {
            let found = balance(errors);
            assert_eq!(found, found.bounded());
        }
        let wild = Balance {
            shadow_passes: 0,
            lobe_passes: 99,
            edge_rays: 999,
            refine_every: 0,
            new_rays: 7,
            audit_times: 99,
            links_wait: 7,
        };
        let bounded = Balance {
            shadow_passes: 1,
            lobe_passes: 12,
            edge_rays: 128,
            refine_every: 1,
            new_rays: 7,
            audit_times: 3,
            links_wait: 1,
        };
        assert_eq!(wild.bounded(), bounded);
    }
}
