//! What shadow rays are cast with.

use crate::emitters::DirectLights;
use crate::sampling::Seed;
use crate::surface::World;
use crate::transport::hemilux::fragments::VisibleSurfaces;

/// Bound on rays of a fragment read from a checkpoint: more than any run casts, so a larger number
/// means damage.
pub const MOST_RAYS_OF_ALL: u32 = 1 << 30;

/// A scene, its lights, and where shadow rays start.
#[derive(Clone, Copy)]
pub struct Caster<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its lights.
    pub lights: &'a DirectLights,
    /// From where.
    pub visible: &'a VisibleSurfaces,
    /// By which numbers.
    pub seed: Seed,
}
