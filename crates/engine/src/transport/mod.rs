//! Methods.

use crate::device::Device;
use crate::render::{Observer, RenderError, RenderRequest, Rendered};

/// Names of the methods.
pub const METHODS: &[&str] = &["auto", "stochastic"];
/// Names, defaults and meanings of the options.
pub const OPTIONS: &[(&str, &str, &str)] = &[];

/// Runs a request with the method that it names.
pub fn run(
    _d: &mut dyn Device,
    _r: &RenderRequest,
    _o: &mut dyn Observer,
) -> Result<Rendered, RenderError> {
    Err(RenderError::parameter("method", "not there yet"))
}
