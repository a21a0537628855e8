// Draws facets into the item buffer of one face. After common.wgsl.

@group(0) @binding(0) var<uniform> view: View;

// Inverse depth of what gives way where depths tie: backs to coincident fronts, and facets that
// recede.
const GIVES_WAY = 1.0 - 2e-5;
// Bit of an item that marks a corner of a facet that recedes.
const RECEDES = 0x80000000u;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) item: u32,
}

@vertex
fn corner(@location(0) position: vec3<f32>, @location(1) item: u32) -> Corner {
    let relative = position - view.eye;
    // Item codes of backs are even.
    let depth = view.near * select(1.0, GIVES_WAY, (item & 1u) == 0u)
        * select(1.0, GIVES_WAY, (item & RECEDES) != 0u);
    return Corner(
        vec4(
            dot(view.clip_x, relative),
            dot(view.clip_y, relative),
            depth,
            dot(view.clip_w, relative),
        ),
        item & ~RECEDES,
    );
}

@fragment
fn pixel(@location(0) @interpolate(flat) item: u32) -> @location(0) u32 {
    return item;
}
