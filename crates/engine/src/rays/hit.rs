//! What rays meet, and who looks.

/// In place of the lane of a hit in a packet.
pub const IN_INSTANCE: u32 = u32::MAX;

/// Who looks along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eye {
    /// A camera: the backs of one-sided surfaces are invisible.
    Camera,
    /// Light: the backs of one-sided surfaces are black and opaque.
    Light,
}

/// What a ray met.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Its number; see [`crate::scene::Scene::triangle`].
    pub triangle: u32,
    /// Barycentric (u, v), as in [`crate::scene::Scene::interpolate`].
    pub u: f32,
    /// See [`Hit::u`].
    pub v: f32,
    /// Distance in ray units.
    pub distance: f32,
    /// Whether the back was met.
    pub back: bool,
    /// Which packet has it; of an instance's triangle, which instance.
    pub(super) packet: u32,
    /// Where in the packet; [`IN_INSTANCE`] of an instance's triangle.
    pub(super) lane: u32,
}

impl Hit {
    /// The same at the end of a way of that length, ray units.
    pub fn after(self, distance: f32) -> Self {
        Self { distance, ..self }
    }
}
