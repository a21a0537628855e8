//! The three tiers at work: what an iteration does, and the picture after it.

mod drafts;
mod drawn;
mod lighting;
mod passes;
mod picture;
mod prospects;

use super::audit::{Audit, Audited};
use super::balance::{Balance, EdgeWork, WorkDone};
use super::clock::Clock;
use super::coarse::{CoarseSolution, PATCH_POINTS};
use super::crowd_bake;
use super::direct::DirectLighting;
use super::draft::{Draft, Full};
use super::estimate;
use super::fragments::edges::Edges;
use super::fragments::textures::Textures;
use super::fragments::{Fragment, VisibleSurfaces};
use super::gather::{Gathering, IrradianceCache, PilotSampling, Spacing, least_scale};
use super::gloss::{Gloss, PixelRay, lacking, of_camera};
use super::link_noise::LinkNoise;
use super::pace::{Kind, Pace};
use super::settings::HemiluxSettings;
use crate::checkpoint::{CheckpointError, Reader};
use crate::device::DeviceError;
use crate::emitters::DirectLights;
use crate::image::Picture;
use crate::patches::Cut;
use crate::radiometry::Rgb;
use crate::render::{ErrorBounds, RenderError, StopReason};
use crate::sampling::Seed;
use crate::scene::Camera;
use crate::scene::gltf::BakedMesh;
use crate::surface::World;
use crate::transport::bake::bake;
use crate::transport::checkpoints;
use crate::transport::ray_traced::Caustics;
use crate::transport::run::Run;
use crate::transport::solver::{Estimate, Solver};
use drawn::DrawnPicture;
use lighting::light_and_lobes;
use prospects::Taken;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::sync::Arc;
use std::time::Instant;

/// Name in checkpoints of a decision of the first iteration: gather rays of each record in it.
pub const FIRST_RAYS_DECISION: &str = "first_rays";
/// Iterations before which more records are made, with radii that are smaller by
/// [`REFILL_RADIUS_FACTOR`].
const REFILL_ITERATIONS: [u64; 4] = [1, 4, 12, 28];
/// Factor by which all radii shrink at each of [`REFILL_ITERATIONS`].
const REFILL_RADIUS_FACTOR: f32 = 0.85;
/// Most rays of an element in one round of links, as a multiple of those in the first round.
const MOST_ROUNDS: u32 = 64;
/// Rays of an element that find what lobes send to it, in a round of links.
const LOBE_RAYS: u32 = 16;
/// Most rays of a record that is made in a later iteration, as a multiple of `gather_rays`, the
/// most that a record gets in one iteration.
const MOST_CATCH_UP: u32 = 8;
/// Passes of shadow rays in each iteration of a second camera while it reuses links and records of
/// the first: only the shadows are new then.
const KNOWN_SCENE_SHADOW_PASSES: u32 = 2;
/// Time that drawing a picture is assumed to take, as a share of the first iteration, until one has
/// been drawn and timed.
const PICTURE_SHARE: f64 = 0.25;
/// The same of the time that there is, before the first iteration.
const LEAST_PICTURE_SHARE: f64 = 0.1;
/// Share of an iteration that must be left of the time for work to go on.
const LEAST_REST: f64 = 0.04;
/// Share of the rest of the time in which records are made where lobes follow.
const BESIDE_LOBES: f64 = 0.6;
/// Parts of an iteration that the one after it does not repeat: these say nothing of how long that takes.
const ONCE: [&str; 2] = ["seconds_links", "seconds_textures"];

/// Factor of the radii of all records in an iteration: they shrink at each of
/// [`REFILL_ITERATIONS`].
fn scale(iteration: u64) -> f32 {
    REFILL_RADIUS_FACTOR
        .powi(REFILL_ITERATIONS.iter().filter(|at| **at <= iteration).count() as i32)
}

/// The solver of a job: the state of the three tiers and of the lobes, and the last picture.
pub struct Tiers {
    world: Arc<World>,
    lights: Arc<DirectLights>,
    visible: VisibleSurfaces,
    camera: Camera,
    /// Where the picture has larger pixels than were asked for.
    draft: Option<Draft>,
    /// What those asked for see, once there is time to find it.
    full: Option<Full>,
    /// What each part had taken before the present draft or picture.
    spent_before: BTreeMap<&'static str, f64>,
    /// What the drafts so far took.
    taken: Vec<Taken>,
    coarse: CoarseSolution,
    /// Variance of the picture's radiance that the links' noise makes, the same over wide areas.
    link_variance: f64,
    cache: IrradianceCache,
    direct: DirectLighting,
    gloss: Gloss,
    /// Found when they are first asked for.
    edges: Option<Edges>,
    /// Found once it is to be known how far they are off.
    textures: Option<Textures>,
    audit: Audit,
    balance: Balance,
    options: HemiluxSettings,
    /// Whether the first picture had better come soon than be good, as that of a draft had.
    hasty: bool,
    /// The same of the picture that was asked for.
    hasty_at_last: bool,
    /// Rays of a record in the first iteration.
    first_rays: u32,
    seed: Seed,
    /// Iterations of another camera's picture that the coarse solution and the records are from.
    pub reused_iterations: u64,
    clock: Clock,
    drawn: DrawnPicture,
    /// What the last picture took, without bringing a draft to the size that was asked for.
    picture_seconds: Option<f64>,
    /// What that took.
    enlarging_seconds: Option<f64>,
    pace: Pace,
    /// After how many iterations a job with a target error estimates it next.
    next_check: u64,
    /// Iterations done.
    done: u64,
}

/// How a job's tiers work.
pub struct TierOptions {
    /// The settings.
    pub options: HemiluxSettings,
    /// Rays of a record in the first iteration.
    pub first_rays: u32,
    /// What random numbers are drawn by.
    pub seed: Seed,
    /// Whether the first picture had better come soon than be good.
    pub hasty: bool,
    /// The draft that it begins with, if it does.
    pub draft: Option<Draft>,
    /// Iterations that earlier attempts at the same job did.
    pub done: u64,
}

/// What a job's tiers work on: the scene, what the camera sees of it, and the coarse solution.
pub struct TierInputs {
    /// The scene as rays meet it.
    pub world: Arc<World>,
    /// Its emitters.
    pub lights: Arc<DirectLights>,
    /// What the camera sees.
    pub visible: VisibleSurfaces,
    /// The camera.
    pub camera: Camera,
    /// Tier 1.
    pub coarse: CoarseSolution,
}

impl Tiers {
    /// A solver without records or shadow rays; the coarse solution is as it comes in.
    pub fn new(inputs: TierInputs, tier_options: TierOptions, mut clock: Clock) -> Self {
        let TierInputs { world, lights, visible, camera, coarse } = inputs;
        let TierOptions { options, first_rays, seed, hasty, draft, done } = tier_options;
        let in_haste = hasty || draft.is_some();
        let (direct, gloss) = light_and_lobes((&world, &lights), &visible, &options, in_haste);
        clock.lap("seconds_light");
        Self {
            direct,
            gloss,
            edges: None,
            textures: None,
            audit: Audit::default(),
            balance: Balance::default(),
            link_variance: 0.0,
            world,
            lights,
            visible,
            camera,
            draft,
            full: None,
            spent_before: BTreeMap::new(),
            taken: Vec::new(),
            coarse,
            cache: IrradianceCache::default(),
            options,
            hasty: in_haste,
            hasty_at_last: hasty,
            first_rays,
            seed,
            reused_iterations: 0,
            clock,
            drawn: DrawnPicture::default(),
            picture_seconds: None,
            enlarging_seconds: None,
            pace: Pace::default(),
            next_check: 1,
            done,
        }
    }
}

impl Tiers {
    /// Gather rays of a record in an iteration: [`Tiers::first_rays`] more in each than in the one
    /// before, at most the setting `gather_rays`.
    fn gather_rays(&self, iteration: u64) -> u32 {
        let so_many = u64::from(self.first_rays) * (1 + iteration);
        so_many.min(self.options.gather_rays.into()) as u32
    }

    /// Gather rays that a record has had altogether after an iteration, at most [`MOST_CATCH_UP`]
    /// times those of one iteration: a record that is made late catches up to this.
    fn rays_after(&self, iteration: u64) -> u32 {
        let most = self.options.gather_rays.saturating_mul(MOST_CATCH_UP);
        // Enough iterations for the most, whatever the first one did.
        let counted = iteration.min(u64::from(most / self.first_rays.max(1)));
        (0..=counted).map(|number| self.gather_rays(number)).fold(0, u32::saturating_add).min(most)
    }

    /// How records are spaced after so many iterations.
    fn spacing(&self, iterations: u64) -> Spacing {
        let least = least_scale(&self.visible);
        Spacing { scale: scale(iterations).max(least), least, even: !self.options.adaptive }
    }

    /// Reads the rest of the checkpoint's section for any camera: links and records. The direct
    /// light of the elements, before them, was read when tier 1 was made.
    pub fn restore_shared(&mut self, mut from: Reader<'_>) -> Result<(), CheckpointError> {
        self.coarse.restore_links(&mut from)?;
        self.cache.restore(&mut from)?;
        from.count(0)?;
        from.exactly::<Rgb>(0)?;
        from.end()
    }

    /// Reads the checkpoint's section for this camera: shadow rays and lobes. Returns whether there was
    /// something in it: a draft leaves nothing.
    pub fn restore_bound(&mut self, mut from: Reader<'_>) -> Result<bool, CheckpointError> {
        if from.count(1)? == 0 {
            from.end()?;
            return Ok(false);
        }
        self.direct.restore(&mut from)?;
        self.gloss.restore(&self.visible, &mut from)?;
        self.balance = from.value::<Balance>()?.bounded();
        let variance = from.value::<f64>()?;
        self.link_variance = if variance.is_finite() { variance.max(0.0) } else { 0.0 };
        let mut edges = Edges::default();
        edges.restore(&mut self.visible, &mut from)?;
        self.edges = (edges.rays() > 0).then_some(edges);
        self.restore_textures(&mut from)?;
        self.audit = Audit::restore(&mut from)?;
        from.end()?;
        Ok(true)
    }

    /// Goes over to another camera, with the links and records that `iterations` have made.
    pub fn change_camera(&mut self, iterations: u64) {
        self.reused_iterations = iterations;
        self.cache.change_camera(&self.visible, self.spacing(iterations));
    }

    /// One iteration, which improves every tier; what it does depends on its number alone.
    fn iterate(&mut self, run: &mut Run<'_>) {
        let (began, number) = (Instant::now(), run.standing.tally.iterations);
        // Another camera's iterations have done links and records up to that number.
        let scene_is_known = number < self.reused_iterations;
        self.clock.start();
        if !scene_is_known {
            self.coarse.shed_caustics();
        }
        self.clock.lap("seconds_caustics");
        let links_wait = self.balance.links_wait > 0 || !self.has_time_for_links();
        if (number + 1).is_power_of_two() && !scene_is_known && !links_wait {
            self.link(number);
        }
        self.clock.lap("seconds_links");
        if self.options.light {
            // Only shadows are new where all else is known.
            let least = if scene_is_known { KNOWN_SCENE_SHADOW_PASSES } else { 1 };
            for _ in 0..self.balance.shadow_passes.max(least) {
                self.cast_shadows(self.pace.rays_left(Kind::Shadow));
            }
        }
        self.clock.lap("seconds_light");
        if self.options.gather
            && let Some(rays) = self.gather(number, scene_is_known)
        {
            self.first_rays = rays;
            run.owner.decide(FIRST_RAYS_DECISION, &rays);
        }
        self.clock.lap("seconds_gather");
        if self.gloss.len() > 0 {
            self.trace_lobes(number.max(self.reused_iterations));
        }
        self.clock.lap("seconds_gloss");
        self.look_at_edges(self.balance.edge_rays);
        self.clock.lap("seconds_edges");
        let by_light = self.coarse.caustics().map_or(0, |caustics| caustics.rays());
        let rays = self.coarse.links() as u64 + self.cache.rays() + self.direct.rays + by_light;
        let of_pixels = self.gloss.rays() + self.edges.as_ref().map_or(0, Edges::rays);
        self.hold_paths_against(rays + of_pixels);
        self.clock.lap("seconds_audit");
        let tally = &mut run.standing.tally;
        tally.iterations += 1;
        tally.shots = rays;
        tally.light_shots = self.direct.rays + by_light;
        self.done = tally.iterations;
        // With lobes the first picture says already whether they need most of the time or hardly any.
        let is_due = Balance::is_due(self.done) || self.done == 1 && self.gloss.len() > 0;
        let picture = PICTURE_SHARE * began.elapsed().as_secs_f64();
        if is_due && self.pace.left() > picture {
            self.share_out();
        }
    }

    /// Draws so many more of the camera's rays in each pixel at an edge.
    fn look_at_edges(&mut self, rays: u32) {
        if rays == 0 {
            return;
        }
        let Self { edges, visible, coarse, seed, .. } = self;
        let edges = edges.get_or_insert_with(|| Edges::new(visible));
        let (frame, height) = (visible.frame, visible.height);
        edges.pass(visible, *seed, rays, &|(hit, number), direction, numbers| {
            of_camera(coarse, (hit, PixelRay { frame, height, number }), direction, numbers)
        });
    }

    /// What has been done at edges.
    fn edge_work(&mut self) -> EdgeWork {
        let visible = &self.visible;
        let (pixels, rays) = self.edges.get_or_insert_with(|| Edges::new(visible)).done();
        EdgeWork { pixels, samples: visible.samples() as u32, rays }
    }

    /// Traces the audit's share of paths, by the number of all other rays.
    fn hold_paths_against(&mut self, rays: u64) {
        let caustics = self.coarse.caustics().map(|caustics| caustics.map() as &dyn Caustics);
        let (world, known) = (&*self.world, &*self.lights);
        let (visible, seed) = (&self.visible, self.seed);
        let times = self.balance.audit_times;
        self.audit.follow(&Audited { world, known, visible, caustics, seed }, (rays, times));
    }

    /// Finds how later iterations share out their time, by what is wrong with the present picture.
    fn share_out(&mut self) {
        let Some(errors) = self.look().errors else { return };
        let done = WorkDone {
            iterations: self.done,
            gather_rays: self.cache.rays(),
            shadows: (f64::from(self.direct.passes), self.direct.rays),
            lobes: (self.gloss.whole_passes(), self.gloss.cost()),
            rays_per_record: self.cache.rays() as f64 / self.cache.len().max(1) as f64,
            edges: self.edge_work(),
        };
        self.balance = Balance::of(&errors, done);
        self.read_textures(&errors, &done);
    }

    /// Whether more links leave time for what they are to improve.
    fn has_time_for_links(&self) -> bool {
        self.pace.allows_links(self.clock.of(&["seconds_links"]))
    }

    /// Doubles the number of links and solves for all of them. Iterations do so whenever their
    /// number has doubled, because the time to solve goes by all links, not by the new ones.
    fn link(&mut self, number: u64) {
        // The first ones may have come with the coarse solution.
        if number == 0 && self.coarse.links() > 0 {
            return;
        }
        let rounds = (number as u32).div_ceil(2).clamp(1, MOST_ROUNDS);
        // The first points there are already.
        let points = if number == 0 { 0 } else { PATCH_POINTS * rounds };
        let links = self.coarse.links();
        let before = (links > 0).then(|| LinkNoise::look(&self.coarse, &self.visible));
        self.coarse.link(self.seed, points, self.options.coarse_rays * rounds);
        if let Some(before) = before.filter(|_| self.coarse.links() > links) {
            let after = LinkNoise::look(&self.coarse, &self.visible);
            let found = after.variance(&before);
            // One difference says little: that of the links before, of which there were half as many,
            // counts, too.
            self.link_variance = match self.link_variance > 0.0 {
                true => 0.5 * (found + 0.5 * self.link_variance),
                false => found,
            };
        }
        // The first picture has no time for it.
        if number > 0 {
            self.coarse.follow_lobes(self.seed, LOBE_RAYS * rounds, lacking);
        }
    }

    /// Traces more rays for the records, and adds records in some iterations. Returns how many rays
    /// each record gets in the first iteration where that has just been found by pilot rays.
    fn gather(&mut self, number: u64, scene_is_known: bool) -> Option<u32> {
        let (options, first) = (self.options, number == 0);
        // New records catch up with those that are there: at once, or, where another camera's
        // picture left many, over some iterations, so that the first picture comes soon.
        let so_far = number.max(self.reused_iterations);
        let enough = self.rays_after(so_far);
        let asked = std::mem::take(&mut self.balance.new_rays);
        let is_asked = asked > 0 && !scene_is_known && options.adaptive;
        let new_rays = match (scene_is_known, is_asked) {
            (true, _) => enough.min(options.gather_rays),
            (false, true) => enough.min(asked),
            (false, false) => enough,
        };
        let gathering = self.gathering(so_far, new_rays);
        let every = if scene_is_known { 1 } else { u64::from(self.balance.refine_every) };
        if !first && number.is_multiple_of(every) {
            let enough = if scene_is_known { enough } else { u32::MAX };
            let most = self.pace.rays_left(Kind::Gather);
            self.refine(gathering, enough, (number / every) as usize, most);
        }
        let unfinished = self.cache.is_unfinished;
        let fills = is_asked || REFILL_ITERATIONS.contains(&number);
        if !(first || unfinished || fills && !scene_is_known) {
            return None;
        }
        self.cache.smooth(&self.visible, options.gather_fit);
        let (lights, visible) = (&*self.lights, &self.visible);
        let direct = |index| self.direct.irradiance(lights, visible, index, true).0;
        let follows = first && !scene_is_known && options.adaptive;
        let pilot = follows.then_some(PilotSampling { hasty: self.hasty, direct: &direct });
        let (began, before) = (Instant::now(), self.cache.rays());
        let rays = self.cache.fill(&self.coarse, visible, gathering, pilot);
        self.pace.measure(Kind::Gather, began, (self.cache.rays() - before) as f64);
        follows.then_some(rays)
    }

    /// How records are made and refined after so many iterations.
    fn gathering(&self, iterations: u64, new_rays: u32) -> Gathering {
        Gathering {
            seed: self.seed,
            rays: self.gather_rays(iterations),
            new_rays,
            afresh: self.options.gather_direct,
            spacing: self.spacing(iterations),
            until: self.pace.until(if self.gloss.len() > 0 { BESIDE_LOBES } else { 1.0 }),
        }
    }

    /// Mean radiance of the picture, by the direct light and the coarse solution.
    fn brightness(&self) -> f32 {
        let (visible, coarse, direct, lights) =
            (&self.visible, &self.coarse, &self.direct, &*self.lights);
        let of_fragment = |(index, fragment): (usize, &Fragment)| {
            let place = visible.place_on_facet(fragment);
            let (direct, _) = direct.irradiance(lights, visible, index, false);
            let irradiance = direct + coarse.bounced(place);
            (fragment.diffuse * irradiance).element_sum() * fragment.share / PI
        };
        let chunks = visible.fragments.par_chunks(1024).enumerate();
        let of_chunk = |(chunk, fragments): (usize, &[Fragment])| {
            let numbered = fragments.iter().enumerate();
            let numbered = numbered.map(|(index, fragment)| (1024 * chunk + index, fragment));
            numbered.map(|fragment| f64::from(of_fragment(fragment))).sum::<f64>()
        };
        let sums: Vec<f64> = chunks.map(of_chunk).collect();
        (sums.iter().sum::<f64>() / (3 * visible.shine.len()) as f64) as f32
    }
}

impl Solver for Tiers {
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        let began = Instant::now();
        self.grow(run);
        let number = run.standing.tally.iterations;
        let picture = run.standing.picture_seconds;
        self.pace.ends_in(run.seconds_left().map(|left| match self.pace.has_measured() {
            true => left - picture,
            false => left * (1.0 - LEAST_PICTURE_SHARE),
        }));
        if !self.pace.allows_iteration(self.is_longer(number)) {
            self.use_rest(number.max(self.reused_iterations));
            // Nothing more fits.
            run.standing.picture_seconds = run.seconds_left().unwrap_or(picture).max(picture);
            return Ok(None);
        }
        let before = self.clock.of(&ONCE);
        self.iterate(run);
        let once = self.clock.of(&ONCE) - before;
        let iteration = self.pace.measure_iteration(began, once);
        // The last picture, and the least that is worth while before it.
        let picture = self.picture_seconds.unwrap_or(PICTURE_SHARE * iteration);
        let picture = picture + self.enlarging_seconds();
        run.standing.picture_seconds = picture + LEAST_REST * iteration;
        Ok(None)
    }

    fn is_visible(&self) -> bool {
        true
    }

    fn checks_target(&mut self, iterations: u64) -> bool {
        let is_due = iterations >= self.next_check;
        if is_due {
            self.next_check = iterations + iterations.div_ceil(4);
        }
        is_due
    }

    fn estimate(&mut self) -> Estimate {
        let errors = self.look().errors;
        errors.map_or(Estimate::Never, |errors| Estimate::Error(errors.total))
    }

    fn error_bounds(&self) -> Option<ErrorBounds> {
        let drawn = self.drawn.errors.filter(|_| self.drawn.iterations == Some(self.done));
        drawn.and_then(|errors| errors.bounds)
    }

    fn picture(&mut self) -> Picture {
        self.draw()
    }

    /// The coarse solution and the records are for any camera; direct light and lobes are of the
    /// fragments that one camera sees.
    fn save(&mut self, parts: &mut checkpoints::Parts) -> Result<(), DeviceError> {
        let to = &mut parts.shared;
        to.value([self.done.max(self.reused_iterations), self.reused_iterations]);
        self.coarse.save(to);
        self.cache.save(to);
        // Where sums of hemicube shots were, while tier 1 could be solved by those.
        to.value(0u64);
        to.slice::<Rgb>(&[]);
        parts.bound.value(u64::from(self.draft.is_none()));
        if self.draft.is_some() {
            return Ok(());
        }
        self.direct.save(&mut parts.bound);
        self.gloss.save(&mut parts.bound);
        parts.bound.value(self.balance);
        parts.bound.value(self.link_variance);
        self.edges.as_ref().unwrap_or(&Edges::default()).save(&mut parts.bound);
        self.save_textures(&mut parts.bound);
        self.audit.save(&mut parts.bound);
        Ok(())
    }

    fn baked(&self, most_bytes: u64) -> Option<BakedMesh> {
        match &*self.coarse.mesh.cut {
            Cut::Listed(listed) => bake(listed, self.coarse.irradiances(), most_bytes),
            Cut::Crowd(crowd) => crowd_bake::bake(&self.coarse, crowd, most_bytes),
        }
    }

    fn diagnostics(&self, _run: &Run<'_>) -> BTreeMap<String, f64> {
        let mut figures: BTreeMap<String, f64> =
            self.clock.spent.iter().map(|(name, value)| ((*name).into(), *value)).collect();
        for (cause, error) in
            estimate::CAUSES.iter().zip(self.drawn.errors.unwrap_or_default().by_cause)
        {
            figures.insert(format!("error_{cause}"), error);
        }
        let errors = self.drawn.errors.unwrap_or_default();
        figures.insert("error_links".into(), errors.by_links);
        figures.insert("error_textures".into(), errors.by_textures);
        figures.insert("error_audit".into(), errors.by_audit);
        figures.insert("error_draft".into(), errors.by_draft);
        let shrink = self.draft.map_or(1, |draft| draft.shrink);
        figures.insert("draft".into(), f64::from(shrink));
        figures.insert("audit_paths".into(), self.audit.paths() as f64);
        figures.insert("records".into(), self.cache.len() as f64);
        figures.insert("records_reused".into(), self.cache.reused as f64);
        figures.insert("first_rays".into(), f64::from(self.first_rays));
        figures.insert("gather_rays".into(), self.cache.rays() as f64);
        figures.insert("shadow_rays".into(), self.direct.rays as f64);
        figures.insert("lobe_rays".into(), self.gloss.rays() as f64);
        let at_edges = self.edges.as_ref().map_or(0, Edges::rays);
        figures.insert("edge_rays".into(), at_edges as f64);
        figures.insert("links".into(), self.coarse.links() as f64);
        figures.insert("fragments".into(), self.visible.fragments.len() as f64);
        figures.insert("lights".into(), self.lights.count() as f64);
        figures
    }
}
