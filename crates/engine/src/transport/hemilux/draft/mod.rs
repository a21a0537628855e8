//! Drafts: pictures of fewer and larger pixels, with which jobs of little time begin. A draft tells how
//! long a whole picture would take; if that fits, its records go on to it, and else the draft is what
//! there is when the time is up, brought to the size that was asked for: its light to the surfaces that
//! each pixel sees, where there is time to find these, or else its pixels.

mod by_light;
mod by_pixels;

pub use by_light::{Full, Lit, loss_of_light, noise_of_light};
pub use by_pixels::{Draft, loss, without_noise};
