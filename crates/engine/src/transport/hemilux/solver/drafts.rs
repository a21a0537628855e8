//! How a draft becomes the picture.

use super::super::balance::Balance;
use super::super::draft::{Draft, Full};
use super::super::fragments::VisibleSurfaces;
use super::Tiers;
use super::drawn::DrawnPicture;
use super::lighting::light_and_lobes;
use super::prospects::{PARTS, Prospects, Taken};
use crate::transport::run::Run;
use std::collections::BTreeMap;
use std::time::Instant;

impl Tiers {
    /// Goes over from a draft, once one iteration of it is done, to the best that fits into the rest of the
    /// time: the picture itself, a finer draft, or the surfaces that the pixels asked for see, to which
    /// its light goes. Another begins anew with the records and the coarse solution of the one before.
    pub(super) fn grow(&mut self, run: &mut Run<'_>) {
        let Some(draft) = self.draft.filter(|_| run.standing.tally.iterations == 1) else { return };
        let spent = |part: &str| {
            let of = |clock: &BTreeMap<&str, f64>| clock.get(part).copied().unwrap_or_default();
            of(&self.clock.spent) - of(&self.spent_before)
        };
        self.taken.push(Taken { shrink: draft.shrink, parts: PARTS.map(spent) });
        let drawn = self.look();
        let (losses, errors) = (drawn.losses, drawn.errors.unwrap_or_default());
        let [noise, bent, shadows, lobes, edges] = errors.by_cause;
        let scatter = noise.hypot(bent).hypot(shadows).hypot(lobes).hypot(errors.by_links);
        let left = run.seconds_left().unwrap_or(f64::INFINITY);
        let surfaces = self.full.is_none().then(|| Full::takes(&draft, &self.visible));
        let prospects = Prospects {
            draft,
            taken: &self.taken,
            surfaces,
            enlarging: self.enlarging_seconds(),
            losses,
            scatter,
            edges,
            samples: Full::edges(&self.visible),
            seconds: run.seconds() + left,
        };
        let next = prospects.best(left);
        if next.by_light && next.shrink > 1 && self.full.is_none() {
            self.find_surfaces(draft);
        }
        if next.shrink < draft.shrink {
            self.begin_anew(draft.with_pixels(next.shrink), run);
        }
    }

    /// Finds the surfaces that the pixels asked for see, which a draft's light goes to.
    fn find_surfaces(&mut self, draft: Draft) {
        self.clock.start();
        let began = Instant::now();
        let cut = self.coarse.mesh.cut.clone();
        self.full = Some(Full::new(&self.world, cut, &self.camera, draft.full_size()));
        // What is wrong with the draft is known still, but not how it looks.
        self.drawn.iterations = None;
        self.clock.lap("seconds_fragments");
        // None of it says how long those of another draft take.
        let spent = began.elapsed().as_secs_f64();
        *self.spent_before.entry("seconds_fragments").or_default() += spent;
    }

    /// Begins the picture anew with other pixels.
    fn begin_anew(&mut self, next: Draft, run: &mut Run<'_>) {
        self.spent_before = self.clock.spent.clone();
        self.clock.start();
        // Not in memory beside those of the picture itself.
        self.full = self.full.take().filter(|_| next.shrink > 1);
        let cut = self.coarse.mesh.cut.clone();
        let samples = self.options.samples;
        self.visible = VisibleSurfaces::new(&self.world, cut, &self.camera, next.size(), samples);
        self.clock.lap("seconds_fragments");
        self.draft = Some(next).filter(|next| next.shrink > 1);
        self.hasty = self.hasty_at_last || self.draft.is_some();
        let known = (&*self.world, &*self.lights);
        (self.direct, self.gloss) =
            light_and_lobes(known, &self.visible, &self.options, self.hasty);
        self.cache.change_camera(&self.visible, self.spacing(0));
        self.cache.reused = 0;
        // The audit's paths are of no pixels, and stay.
        (self.edges, self.textures, self.balance) = (None, None, Balance::default());
        self.drawn = DrawnPicture::default();
        self.pace.forget_iteration();
        self.picture_seconds = None;
        (run.standing.tally.iterations, self.done, self.next_check) = (0, 0, 1);
        self.clock.lap("seconds_light");
    }
}
