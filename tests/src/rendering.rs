//! Rendering as tests do it: on the processor, by whatever a request asks for.

use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::render::{RenderRequest, Rendered, Unobserved};
use hemilux_engine::transport::render;

/// What a request comes to, on every core of the processor.
///
/// # Panics
/// Where the request cannot be rendered.
pub fn rendered(request: &RenderRequest) -> Rendered {
    let mut device = CpuDevice::new(None).expect("threads");
    render(&mut device, request, &mut Unobserved).expect("the request is good")
}
