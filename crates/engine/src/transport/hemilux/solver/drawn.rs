//! The last picture that was drawn.

use super::super::estimate::{Arriving, Errors};
use crate::image::Picture;

/// The last picture that was drawn, kept until another iteration is done.
#[derive(Default)]
pub struct DrawnPicture {
    /// After how many iterations.
    pub iterations: Option<u64>,
    /// As large as the draft, where there is one.
    pub picture: Picture,
    /// Its estimated error.
    pub errors: Option<Errors>,
    /// Of a draft: what arrives at its fragments.
    pub arriving: Vec<Arriving>,
    /// Of a draft: relative errors that its pixels make where they are shown in the size that was asked
    /// for, and that its light makes, noise and all.
    pub losses: [f64; 2],
    /// A draft in the size that was asked for.
    pub enlarged: Option<Picture>,
}
