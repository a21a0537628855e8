//! Settings of the methods: what a setting is, what is in force in a job, and the settings that
//! several methods share. Each method defines its own in its `settings` file.

mod hemicube;
mod in_force;
mod mesh;
mod setting;
mod values;

pub(in crate::transport) use hemicube::{HEMICUBE_RESOLUTION, SHOTS_PER_ITERATION};
pub use in_force::Settings;
pub(in crate::transport) use in_force::check;
pub(in crate::transport) use mesh::{MESH, MeshSettings};
pub use setting::{AnySetting, Audience, Entry, Preset, Scope, Setting};
pub use values::{Choice, Even, Form, Kind, Number, Switch, Values, Whole, WholeOr};
