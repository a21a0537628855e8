//! Passes of rays, and how the time is used up that is left after the last iteration.

use super::super::balance::{EDGE_TIME, SMOOTH_COUNTS, WorkDone};
use super::super::direct::Caster;
use super::super::estimate::Errors;
use super::super::fragments::edges::Edges;
use super::super::fragments::textures::{MOST_HALVINGS, Textures};
use super::super::gather::Gathering;
use super::super::pace::{Kind, shared_out};
use super::{LEAST_REST, REFILL_ITERATIONS, Tiers};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use std::time::{Duration, Instant};

/// Most passes of a kind of ray after the last iteration.
const MOST_PASSES: u32 = 16;
/// Share of what is left of the time that reading textures more finely may take.
const TEXTURE_SHARE: f64 = 0.2;

impl Tiers {
    /// Traces more gather rays, `most` at most, for records that have not `enough`, or for some of them
    /// in turn.
    pub(super) fn refine(&mut self, gathering: Gathering, enough: u32, turn: usize, most: f64) {
        let (began, before) = (Instant::now(), self.cache.rays());
        self.cache.refine((&self.visible, &self.coarse), gathering, enough, turn, most);
        self.pace.measure(Kind::Gather, began, (self.cache.rays() - before) as f64);
    }

    /// Casts another pass of shadow rays, about `most` at most but for the first pass.
    pub(super) fn cast_shadows(&mut self, most: f64) {
        if self.direct.passes > 0 && most < 1.0 {
            return;
        }
        let Self { world, lights, visible, seed, .. } = self;
        let (began, before) = (Instant::now(), self.direct.rays);
        self.direct.pass(&Caster { world, lights, visible, seed: *seed }, most);
        self.pace.measure(Kind::Shadow, began, (self.direct.rays - before) as f64);
    }

    /// Traces another pass of lobe rays, about `most` at most but for the first pass.
    fn follow_lobes(&mut self, most: f64) {
        if self.gloss.passes > 0 && most < 1.0 {
            return;
        }
        let (began, before) = (Instant::now(), self.gloss.cost());
        let how = (self.seed, self.options.adaptive);
        self.gloss.pass(&self.coarse, &self.visible, how, most);
        self.pace.measure(Kind::Lobe, began, self.gloss.cost() - before);
    }

    /// Traces another pass of lobe rays, unless their error is far below that of the rest. The
    /// first iteration makes two: the second one sends rays where the first has found scatter.
    pub(super) fn trace_lobes(&mut self, iterations: u64) {
        let first = self.gloss.passes == 0;
        if first {
            self.follow_lobes(f64::INFINITY);
            self.gloss.brightness = self.brightness();
        }
        // Whatever those so far say, some more look out for what all of them have missed.
        let least = u32::from(iterations >= 4 && iterations.is_power_of_two());
        for _ in 0..self.balance.lobe_passes.max(least) {
            if (first && self.hasty) || !self.gloss.may_matter(&self.visible, iterations) {
                break;
            }
            self.follow_lobes(self.pace.rays_left(Kind::Lobe));
        }
        self.gloss.share(&self.visible);
    }

    /// Whether an iteration has more to do than most: more links, or more records.
    pub(super) fn is_longer(&self, number: u64) -> bool {
        (number + 1).is_power_of_two()
            || REFILL_ITERATIONS.contains(&number)
            || self.balance.new_rays > 0
            || self.cache.is_unfinished
    }

    /// Spends what is left of the time, too little for an iteration, where it lowers the error most.
    pub(super) fn use_rest(&mut self, iterations: u64) {
        let errors = match self.drawn.errors {
            Some(errors) => {
                self.use_rest_at_edges(&errors);
                let [noise, _, shadows, lobes, _] = errors.by_cause;
                [SMOOTH_COUNTS * noise, shadows, lobes]
            }
            None => [1.0; 3],
        };
        let spent =
            ["seconds_gather", "seconds_light", "seconds_gloss"].map(|part| self.clock.of(&[part]));
        let [gather, shadow, lobe] = shared_out(self.pace.left(), errors, spent);
        self.clock.start();
        // First what gets least: the others may take longer than they were thought to.
        if self.options.gather {
            self.spend(Kind::Gather, gather, iterations);
        }
        self.clock.lap("seconds_gather");
        if self.options.light {
            self.spend(Kind::Shadow, shadow, iterations);
        }
        self.clock.lap("seconds_light");
        if self.gloss.len() > 0 {
            self.spend(Kind::Lobe, lobe, iterations);
            self.gloss.share(&self.visible);
        }
        self.clock.lap("seconds_gloss");
        // It shows none of this yet.
        self.drawn.iterations = None;
    }

    /// Reads textures more finely, if it is worth that; finds out how far they are off at first.
    pub(super) fn read_textures(&mut self, errors: &Errors, done: &WorkDone) {
        if self.draft.is_some() || self.done < 2 {
            return;
        }
        self.clock.start();
        let Self { visible, edges, textures, drawn, pace, .. } = self;
        match textures {
            None => {
                let edges = edges.get_or_insert_with(|| Edges::new(visible));
                *textures = Some(Textures::new(visible, edges));
            }
            Some(own) => {
                let next = own.halvings() + 1;
                let is_worth_it = done.allows_textures(errors, own.next_squares());
                let fits = own.next_seconds() < TEXTURE_SHARE * pace.left();
                if next > MOST_HALVINGS || !is_worth_it || !fits {
                    return;
                }
                own.halve(visible, next);
                drawn.iterations = None;
            }
        }
        self.clock.lap("seconds_textures");
    }

    /// Writes how finely textures are read.
    pub(super) fn save_textures(&self, to: &mut Writer) {
        to.value(self.textures.as_ref().map_or(0, |own| 1 + own.halvings()));
    }

    /// Reads what [`Tiers::save_textures`] wrote, and the textures as finely.
    pub(super) fn restore_textures(
        &mut self,
        from: &mut Reader<'_>,
    ) -> Result<(), CheckpointError> {
        let Some(halvings) = from.value::<u32>()?.checked_sub(1) else { return Ok(()) };
        if halvings > MOST_HALVINGS {
            return Err(CheckpointError::damaged("textures can't be read so finely"));
        }
        let Self { visible, edges, textures, .. } = self;
        let edges = edges.get_or_insert_with(|| Edges::new(visible));
        textures.insert(Textures::new(visible, edges)).halve(visible, halvings);
        Ok(())
    }

    /// Draws rays at edges, if these are a large part of the error.
    fn use_rest_at_edges(&mut self, errors: &Errors) {
        self.clock.start();
        let work = self.edge_work();
        // About as fast as shadow rays.
        let most = self.pace.rays_in(Kind::Shadow, EDGE_TIME * self.pace.left());
        let most = most / work.pixels.max(1) as f64;
        if most.is_finite() {
            self.look_at_edges(work.wanted(errors).min(most) as u32);
        }
        self.clock.lap("seconds_edges");
    }

    /// Traces rays of a kind for so many seconds.
    fn spend(&mut self, kind: Kind, seconds: f64, iterations: u64) {
        let end = Instant::now() + Duration::from_secs_f64(seconds);
        for pass in 0..MOST_PASSES {
            let left = end.saturating_duration_since(Instant::now()).as_secs_f64();
            let left = left.min(self.pace.left());
            if left <= LEAST_REST * seconds {
                return;
            }
            let most = self.pace.rays_in(kind, left);
            match kind {
                Kind::Gather => {
                    let turn = (iterations + u64::from(pass)) as usize;
                    self.refine(self.gathering(iterations, 0), u32::MAX, turn, most);
                }
                Kind::Shadow => self.cast_shadows(most),
                Kind::Lobe => self.follow_lobes(most),
            }
        }
    }
}
