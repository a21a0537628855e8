//! How a draft becomes the picture.

use super::super::audit::Audit;
use super::super::balance::Balance;
use super::super::direct::DirectLighting;
use super::super::fragments::VisibleSurfaces;
use super::super::gloss::Gloss;
use super::{DrawnPicture, Tiers};
use crate::transport::run::Run;
use std::collections::BTreeMap;

/// Parts of a first iteration, each with the power of the number of pixels by which its time grows:
/// records lie where the scene asks for them, with fewer rays in a draft, and small pictures have more
/// shadow rays for each pixel.
const GROWTH: [(&str, f64); 5] = [
    ("seconds_fragments", 0.62),
    ("seconds_light", 0.85),
    ("seconds_gloss", 0.9),
    ("seconds_gather", 0.35),
    ("seconds_smooth", 0.6),
];
/// All of that, and the picture, in the time that these parts are expected to take.
const WITH_PICTURE: f64 = 1.2;

impl Tiers {
    /// Goes over from a draft, once one iteration of it is done, to the finest picture that fits into
    /// the rest of the time, and begins anew with its records and its coarse solution.
    pub(super) fn grow(&mut self, run: &mut Run<'_>) {
        let Some(draft) = self.draft.filter(|_| run.standing.tally.iterations == 1) else { return };
        let left = run.seconds_left().unwrap_or(f64::INFINITY);
        let spent = |part| {
            let of = |clock: &BTreeMap<&str, f64>| clock.get(part).copied().unwrap_or_default();
            of(&self.clock.spent) - of(&self.spent_before)
        };
        let takes = |pixels: f64| {
            let parts = GROWTH.iter().map(|(part, power)| spent(part) * pixels.powf(*power));
            WITH_PICTURE * parts.sum::<f64>()
        };
        let Some(next) = draft.next(takes, left) else { return };
        self.spent_before = self.clock.spent.clone();
        self.clock.start();
        let cut = self.coarse.mesh.cut.clone();
        let samples = self.options.samples;
        self.visible = VisibleSurfaces::new(&self.world, cut, &self.camera, next.size(), samples);
        self.clock.lap("seconds_fragments");
        self.draft = Some(next).filter(|next| next.shrink > 1);
        self.hasty = self.hasty_at_last || self.draft.is_some();
        let (lights, options) = (&self.lights, &self.options);
        self.direct = DirectLighting::new(lights, &self.visible, options.adaptive, self.hasty);
        self.gloss = Gloss::new(&self.world, &self.visible);
        self.cache.change_camera(&self.visible, self.spacing(0));
        self.cache.reused = 0;
        (self.edges, self.audit, self.balance) = (None, Audit::default(), Balance::default());
        self.drawn = DrawnPicture::default();
        (self.iteration_seconds, self.picture_seconds) = (None, None);
        (run.standing.tally.iterations, self.done, self.next_check) = (0, 0, 1);
        self.clock.lap("seconds_light");
    }
}
