// Sums delta form factors per patch over the item buffers (Antal eq. 8). A thread takes a run of
// pixels of a row and adds to memory only where the patch changes. After common.wgsl and
// lobe.wgsl.

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<uniform> group: Pass;
@group(0) @binding(2) var<storage, read> shots: array<Shot>;
@group(0) @binding(3) var<storage, read> facets: array<Facet>;
// Delta form factors of the top and of one side.
@group(0) @binding(4) var<storage, read> delta: array<f32>;
// Fixed-point Σ ΔF per (shot, patch); with LOBES, Σ ΔF·cosⁿα behind it.
@group(0) @binding(5) var<storage, read_write> sums: array<atomic<u32>>;
@group(0) @binding(6) var atlas: texture_2d<u32>;

const RUN = 16u;

// patches::cell_index.
fn cell_index(n: u32, u: f32, v: f32) -> u32 {
    let fu = max(u * f32(n), 0.0);
    let fv = max(v * f32(n), 0.0);
    let i = min(u32(fu), n - 1u);
    let last = n - 1u - i;
    let j = min(u32(fv), last);
    let upper = (fu - f32(i)) + (fv - f32(j)) > 1.0 && j < last;
    return i * (2u * n - i) + 2u * j + select(0u, 1u, upper);
}

@compute @workgroup_size(64)
fn deposit(@builtin(global_invocation_id) id: vec3<u32>) {
    let resolution = settings.resolution;
    let runs = (resolution + RUN - 1u) / RUN;
    let row = id.x / runs;
    let slot = id.y;
    if row >= 3u * resolution {
        return;
    }
    let first_column = (id.x % runs) * RUN;
    let end_column = min(first_column + RUN, resolution);
    let tile = vec2(slot % settings.columns, slot / settings.columns)
        * vec2(resolution, 3u * resolution);

    let half_rows = resolution / 2u;
    let face = select(0u, 1u + (row - resolution) / half_rows, row >= resolution);
    let face_row = select(row, (row - resolution) % half_rows, row >= resolution);
    let delta_row = select(row, resolution + face_row, row >= resolution) * resolution;

    let shot = shots[group.first + slot];
    let weight = select(shot.last_face_weight, shot.face_weights[min(face, 3u)], face < 4u);
    if weight <= 0.0 {
        return;
    }
    let axes = face_axes(face, shot.tangent, shot.bitangent, shot.normal);
    let step = 2.0 / f32(resolution);
    let y = (f32(face_row) + 0.5 + shot.jitter_y) * step - select(0.0, 1.0, face == 0u);
    let row_direction = axes.axis + y * axes.up;
    let planes = select(1u, 2u, (settings.flags & LOBES) != 0u);
    let sums_start = slot * planes * settings.patches;

    var item = 0u;
    var current = NO_PATCH;
    var form_factor = 0.0;
    var lobe_factor = 0.0;
    // Of the present item: planes whose products with a direction give u, v and their divisor.
    var first = NO_PATCH;
    var divisions = 1u;
    var u_plane = vec3(0.0);
    var v_plane = vec3(0.0);
    var plane = vec3(0.0);

    for (var column = first_column; column < end_column; column++) {
        let code = textureLoad(atlas, tile + vec2(column, row), 0).x;
        let x = (f32(column) + 0.5 + shot.jitter_x) * step - 1.0;
        let direction = row_direction + x * axes.right;
        if code != item {
            item = code;
            first = NO_PATCH;
            if code != 0u {
                let facet = facets[(code - 1u) >> 1u];
                first = select(facet.front, facet.back, (code & 1u) == 0u);
                divisions = facet.divisions;
                let a = facet.corner - shot.position;
                plane = cross(facet.edge_1, facet.edge_2);
                u_plane = cross(facet.edge_2, a);
                v_plane = cross(a, facet.edge_1);
            }
        }
        var seen = first;
        if first < CULLED_BACK && divisions > 1u {
            let inverse = 1.0 / dot(direction, plane);
            seen += cell_index(divisions, dot(direction, u_plane) * inverse,
                dot(direction, v_plane) * inverse);
        }
        if seen != current {
            if current < CULLED_BACK {
                atomicAdd(&sums[sums_start + current],
                    u32(round(form_factor * shot.fixed_scale)));
                if shot.has_lobe != 0u {
                    atomicAdd(&sums[sums_start + settings.patches + current],
                        u32(round(lobe_factor * shot.fixed_scale)));
                }
            }
            current = seen;
            form_factor = 0.0;
            lobe_factor = 0.0;
        }
        let value = weight * delta[delta_row + column];
        form_factor += value;
        if shot.has_lobe != 0u {
            lobe_factor += value
                * lobe_power(normalize(direction), shot.lobe_axis, shot.exponent);
        }
    }
    if current < CULLED_BACK {
        atomicAdd(&sums[sums_start + current], u32(round(form_factor * shot.fixed_scale)));
        if shot.has_lobe != 0u {
            atomicAdd(&sums[sums_start + settings.patches + current],
                u32(round(lobe_factor * shot.fixed_scale)));
        }
    }
}
