//! The directions through openings that a place sees.

use super::pane::Pane;
use super::rectangle::Rectangle;
use glam::Vec3;

/// Most openings that a place chooses from.
pub const MOST_SEEN: usize = 8;

/// The directions through the openings that a place sees: solid angles of rectangles.
#[derive(Clone, Copy, Debug)]
pub struct Lookout {
    panes: [Pane; MOST_SEEN],
    /// Probability that each is picked.
    probabilities: [f32; MOST_SEEN],
    count: usize,
    /// Whether any opening is known to be seen, with a pane or without.
    sees_any: bool,
}

impl Lookout {
    /// The openings as they look from a place; `None` where all are below the horizon or seen edge-on.
    pub fn new(seen: impl Iterator<Item = Rectangle>, point: Vec3, normal: Vec3) -> Option<Self> {
        let mut this = Self::without_panes(true);
        let mut all = 0.0;
        for rectangle in seen.take(MOST_SEEN) {
            let Some(pane) = Pane::new(&rectangle, point) else { continue };
            let worth = pane.worth(normal);
            if worth > 0.0 {
                this.panes[this.count] = pane;
                this.probabilities[this.count] = worth;
                this.count += 1;
                all += worth;
            }
        }
        for probability in &mut this.probabilities[..this.count] {
            *probability /= all;
        }
        (this.count > 0).then_some(this)
    }

    /// Of a dark place where no openings help: the sky's own directions have to do. Whether any
    /// opening is seen from there.
    pub fn without_panes(sees_any: bool) -> Self {
        Self { panes: [Pane::NONE; MOST_SEEN], probabilities: [0.0; MOST_SEEN], count: 0, sees_any }
    }

    /// Whether there are openings to draw directions through.
    pub fn has_panes(&self) -> bool {
        self.count > 0
    }

    /// Whether any opening is seen.
    pub fn sees_any(&self) -> bool {
        self.sees_any
    }

    /// A unit direction through one of the openings, by three uniform numbers.
    pub fn sample(&self, xi: Vec3) -> Vec3 {
        let mut sum = 0.0;
        let picked = self.probabilities[..self.count].iter().position(|probability| {
            sum += probability;
            xi.x < sum
        });
        self.panes[picked.unwrap_or(self.count - 1)].sample([xi.y, xi.z])
    }

    /// Density of [`Lookout::sample`], 1/sr, for a unit direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let panes = self.panes[..self.count].iter().zip(&self.probabilities);
        panes.map(|(pane, probability)| probability * pane.pdf(direction)).sum()
    }
}
