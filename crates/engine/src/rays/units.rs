//! Numbers that hold for all rays.

/// The scene is scaled to between this and twice this many ray units.
pub const SIZE: f64 = 1_048_576.0;
/// Boxes are larger than what they hold by this share of the scene's size: more than what
/// rounding does to the distances to their planes.
pub const BOX_MARGIN: f32 = 1.0 / 524_288.0;
/// The black back of a one-sided surface counts as farther away by this share, so that a front at
/// the same place wins: walls that are modelled as two sheets.
pub const BACK_RECEDES: f32 = 1.0 / 65_536.0;
/// Triangles, or leaves of them, that a thread prepares at a time.
pub const CHUNK: usize = 1024;
