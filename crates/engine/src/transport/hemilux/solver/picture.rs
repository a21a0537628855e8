//! The picture after an iteration, and how far it may be off.

use super::super::audit::{Against, Corrected};
use super::super::draft::{Draft, Lit, loss, loss_of_light, noise_of_light, without_noise};
use super::super::estimate::{self, PictureInputs};
use super::Tiers;
use super::drawn::DrawnPicture;
use crate::image::Picture;
use std::time::Instant;

/// Seconds for each pixel that bringing a draft to the size that was asked for is assumed to take, until
/// it has been timed.
const ENLARGING_SECONDS: f64 = 1.2e-7;

impl Tiers {
    /// The present picture in the size that was asked for, drawn unless it is there already.
    pub(super) fn draw(&mut self) -> Picture {
        self.look();
        let Some(draft) = self.draft else { return self.drawn.picture.clone() };
        if self.drawn.enlarged.is_none() {
            self.clock.start();
            let began = Instant::now();
            self.drawn.enlarged = Some(self.enlarged(draft));
            self.enlarging_seconds = Some(began.elapsed().as_secs_f64());
            self.clock.lap("seconds_picture");
        }
        self.drawn.enlarged.clone().unwrap_or_default()
    }

    /// The present picture as large as the draft, where there is one, with its errors.
    pub(super) fn look(&mut self) -> &DrawnPicture {
        let iterations = self.done;
        if self.drawn.iterations == Some(iterations) {
            return &self.drawn;
        }
        self.clock.start();
        let began = Instant::now();
        let bounced = if self.options.gather {
            self.cache.smooth(&self.visible, self.options.gather_fit);
            self.cache.irradiance(&self.visible)
        } else {
            vec![None; self.visible.fragments.len()]
        };
        self.clock.lap("seconds_smooth");
        let known = PictureInputs {
            visible: &self.visible,
            lights: &self.lights,
            coarse: &self.coarse,
            bounced: &bounced,
            direct: &self.direct,
            gloss: &self.gloss,
            options: &self.options,
            link_variance: self.link_variance,
            textures: self.textures.as_ref(),
            coarse_error: estimate::coarse_error(&self.visible, &self.coarse, &bounced),
        };
        let (mut picture, mut errors) = estimate::measure(&known);
        let mut mirrored = self.direct.mirrored(&self.visible);
        self.gloss.add_mirrored(&self.visible, &mut mirrored);
        let against = Against { visible: &self.visible, seed: self.seed, mirrored: &mirrored };
        let mut corrected = Corrected::default();
        // Where a part is switched off for a study, what it lacks is to be seen.
        let is_whole = self.options.gather && self.options.light;
        if self.draft.is_none() && is_whole {
            corrected = self.audit.correct(against, &mut picture);
        }
        if let Some(errors) = &mut errors {
            let verdict = self.audit.judge(against, &picture);
            errors.audited(verdict, corrected);
        }
        let iterations = Some(iterations);
        let mut drawn = DrawnPicture { iterations, picture, errors, ..DrawnPicture::default() };
        if self.draft.is_some() {
            drawn.arriving = known.arriving();
            self.lose(&mut drawn);
        }
        self.clock.lap("seconds_picture");
        self.picture_seconds = Some(began.elapsed().as_secs_f64());
        self.drawn = drawn;
        &self.drawn
    }

    /// Seconds that it takes to bring a draft to the size that was asked for.
    pub(super) fn enlarging_seconds(&self) -> f64 {
        let Some(draft) = self.draft else { return 0.0 };
        let pixels = draft.full_size().map(f64::from).iter().product::<f64>();
        self.enlarging_seconds.unwrap_or(ENLARGING_SECONDS * pixels)
    }

    /// Takes into the errors of a draft what it loses in the size that was asked for.
    fn lose(&self, drawn: &mut DrawnPicture) {
        let Some(errors) = &mut drawn.errors else { return };
        let visible = &self.visible;
        let lit = Lit { visible, arriving: &drawn.arriving, coarse: &self.coarse };
        let counted = visible.counted(&drawn.picture.pixels);
        drawn.losses = [
            loss(&drawn.picture, &visible.shine, &counted, errors.mean),
            loss_of_light(&lit, &counted, errors.mean),
        ];
        let [by_pixels, by_light] = drawn.losses;
        match &self.full {
            Some(full) => {
                let by_light = without_noise(by_light, noise_of_light(errors));
                errors.with_edges(full.edge_factor(visible));
                errors.lost(by_light);
            }
            None => errors.lost(without_noise(by_pixels, errors.total)),
        }
    }

    /// The present draft in the size that was asked for.
    fn enlarged(&self, draft: Draft) -> Picture {
        let visible = &self.visible;
        match &self.full {
            Some(full) => {
                let arriving = &self.drawn.arriving;
                full.picture(&Lit { visible, arriving, coarse: &self.coarse })
            }
            None => {
                let picture = self.drawn.picture.clone();
                draft.enlarged(picture, &visible.shine, (&self.world, &self.camera))
            }
        }
    }
}
