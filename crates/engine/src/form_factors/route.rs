//! The interface of every route to form factors.

use super::polygon::Polygon;
use super::unsuitable::Unsuitable;

/// A way to find form factors.
pub trait Route {
    /// Its name with its settings.
    fn name(&self) -> String;

    /// F_{from→to} with `blockers` in between, which stop light from both sides.
    ///
    /// # Errors
    /// [`Unsuitable`] where the route can't.
    fn form_factor(
        &self,
        from: &Polygon,
        to: &Polygon,
        blockers: &[Polygon],
    ) -> Result<f64, Unsuitable>;
}
