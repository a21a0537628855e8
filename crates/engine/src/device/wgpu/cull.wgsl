// Which facets each face of each hemicube draws, and which side of them it sees: a view matrix
// per face, a mark per facet, and from the marks compact index lists in facet order.
// After common.wgsl.

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<uniform> group: Pass;
@group(0) @binding(2) var<storage, read> shots: array<Shot>;
@group(0) @binding(3) var<storage, read_write> views: array<View>;
@group(0) @binding(4) var<storage, read> facets: array<Facet>;
// Four facets a word, per shot: bits 0-4 the faces that draw it, bit 5 its back is seen.
@group(0) @binding(5) var<storage, read_write> marks: array<u32>;
// Facets drawn per (shot, face, run), then where the run's list starts.
@group(0) @binding(6) var<storage, read_write> counts: array<u32>;
// Per (shot, face) room for three corners of every facet.
@group(0) @binding(7) var<storage, read_write> indices: array<u32>;
// Draw arguments per (shot, face).
@group(0) @binding(8) var<storage, read_write> draws: array<u32>;

const RUN = 32u;
const RUN_WORDS = 8u;
const BACK_SEEN = 32u;

// Relative rounding noise of the distance between eye and facet plane.
const PLANE_NOISE = 4e-7;

@compute @workgroup_size(64)
fn make_views(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= group.count * FACES {
        return;
    }
    let slot = id.x / FACES;
    let face = id.x % FACES;
    let shot = shots[group.first + slot];
    let axes = face_axes(face, shot.tangent, shot.bitangent, shot.normal);
    let step = 2.0 / f32(settings.resolution);
    var view = View();
    view.eye = shot.position;
    view.near = settings.near;
    // Moving all rays by the jitter moves the picture the other way. Rows grow with `up`, clip
    // space's y against it; a side shows only its upper half.
    view.clip_w = axes.axis;
    view.clip_x = axes.right - shot.jitter_x * step * axes.axis;
    if face == 0u {
        view.clip_y = shot.jitter_y * step * axes.axis - axes.up;
    } else {
        view.clip_y = (1.0 + 2.0 * shot.jitter_y * step) * axes.axis - 2.0 * axes.up;
    }
    view.weight = select(shot.last_face_weight, shot.face_weights[min(face, 3u)], face < 4u);
    views[slot * FACES + face] = view;
}

fn largest(v: vec3<f32>) -> f32 {
    return max(max(abs(v.x), abs(v.y)), abs(v.z));
}

// Bits of a corner's place in the hemicube frame.
const BELOW = 1u;
const X_LESS_Y = 2u;
const X_LESS_MINUS_Y = 4u;
const Z_LESS_X = 8u;
const Z_LESS_MINUS_X = 16u;
const Z_LESS_Y = 32u;
const Z_LESS_MINUS_Y = 64u;

fn place_of(v: vec3<f32>) -> u32 {
    return select(0u, BELOW, v.z < 0.0)
        | select(0u, X_LESS_Y, v.x < v.y)
        | select(0u, X_LESS_MINUS_Y, v.x < -v.y)
        | select(0u, Z_LESS_X, v.z < v.x)
        | select(0u, Z_LESS_MINUS_X, v.z < -v.x)
        | select(0u, Z_LESS_Y, v.z < v.y)
        | select(0u, Z_LESS_MINUS_Y, v.z < -v.y);
}

// Bit `face` where a facet has no corner on the inner side of one of the planes between faces.
// `all` is what the places of its corners share, `none` what none of them has. Jitter stays
// inside the pixel, so the rays stay inside these planes.
fn faces_outside(all: u32, none: u32) -> u32 {
    let outside_top = (all & (Z_LESS_X | Z_LESS_MINUS_X | Z_LESS_Y | Z_LESS_MINUS_Y)) != 0u;
    let outside_plus_t = (all & (X_LESS_Y | X_LESS_MINUS_Y)) != 0u || (none & Z_LESS_X) != 0u;
    let outside_minus_t = (none & (X_LESS_Y | X_LESS_MINUS_Y | Z_LESS_MINUS_X)) != 0u;
    let outside_plus_b =
        (all & X_LESS_MINUS_Y) != 0u || (none & (X_LESS_Y | Z_LESS_Y)) != 0u;
    let outside_minus_b =
        (all & X_LESS_Y) != 0u || (none & (X_LESS_MINUS_Y | Z_LESS_MINUS_Y)) != 0u;
    return select(0u, 1u, outside_top) | select(0u, 2u, outside_plus_t)
        | select(0u, 4u, outside_minus_t) | select(0u, 8u, outside_plus_b)
        | select(0u, 16u, outside_minus_b);
}

// Bit `face` of every face that is drawn at all.
fn drawn_faces(shot: Shot) -> u32 {
    let w = shot.face_weights;
    return select(0u, 1u, w.x > 0.0) | select(0u, 2u, w.y > 0.0) | select(0u, 4u, w.z > 0.0)
        | select(0u, 8u, w.w > 0.0) | select(0u, 16u, shot.last_face_weight > 0.0);
}

fn to_frame(shot: Shot, v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(shot.tangent, v), dot(shot.bitangent, v), dot(shot.normal, v));
}

fn mark_of(facet: Facet, shot: Shot, drawn: u32) -> u32 {
    let relative = facet.corner - shot.position;
    let a = to_frame(shot, relative);
    let b = to_frame(shot, relative + facet.edge_1);
    let c = to_frame(shot, relative + facet.edge_2);
    let places = vec3(place_of(a), place_of(b), place_of(c));
    let all_corners = places.x & places.y & places.z;
    if (all_corners & BELOW) != 0u {
        return 0u;
    }
    let plane = cross(facet.edge_1, facet.edge_2);
    let volume = dot(relative, plane);
    let noise = PLANE_NOISE * (largest(shot.position) + largest(a));
    // Squares would come below the smallest normal number in scenes of a micrometre, and many GPUs
    // take such numbers for zero.
    if abs(volume) <= noise * length(plane) {
        return 0u;
    }
    let back_seen = volume > 0.0;
    if back_seen && facet.back == CULLED_BACK {
        return 0u;
    }
    let mark = drawn & ~faces_outside(all_corners, ~(places.x | places.y | places.z));
    return select(0u, mark | select(0u, BACK_SEEN, back_seen), mark != 0u);
}

@compute @workgroup_size(64)
fn mark_facets(@builtin(global_invocation_id) id: vec3<u32>) {
    let run = id.x;
    let slot = id.y;
    if run >= settings.facet_runs {
        return;
    }
    let shot = shots[group.first + slot];
    let drawn = drawn_faces(shot);
    var seen = array<u32, 5>();
    for (var word = 0u; word < RUN_WORDS; word++) {
        var packed = 0u;
        for (var byte = 0u; byte < 4u; byte++) {
            let facet = run * RUN + word * 4u + byte;
            if facet >= settings.facets {
                break;
            }
            let mark = mark_of(facets[facet], shot, drawn);
            packed |= mark << (8u * byte);
            for (var face = 0u; face < FACES; face++) {
                seen[face] += (mark >> face) & 1u;
            }
        }
        marks[(slot * settings.facet_runs + run) * RUN_WORDS + word] = packed;
    }
    for (var face = 0u; face < FACES; face++) {
        counts[(slot * FACES + face) * settings.facet_runs + run] = seen[face];
    }
}

var<workgroup> partial: array<u32, 64>;

// Turns the counts of one (shot, face) into starts.
@compute @workgroup_size(64)
fn place_runs(
    @builtin(workgroup_id) id: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let base = id.x * settings.facet_runs;
    let share = (settings.facet_runs + 63u) / 64u;
    let start = min(thread * share, settings.facet_runs);
    let end = min(start + share, settings.facet_runs);
    var sum = 0u;
    for (var run = start; run < end; run++) {
        sum += counts[base + run];
    }
    partial[thread] = sum;
    workgroupBarrier();
    var before = 0u;
    for (var other = 0u; other < thread; other++) {
        before += partial[other];
    }
    for (var run = start; run < end; run++) {
        let count = counts[base + run];
        counts[base + run] = before;
        before += count;
    }
    if thread == 63u {
        let draw = id.x * 5u;
        draws[draw] = 3u * before;
        draws[draw + 1u] = 1u;
        draws[draw + 2u] = id.x * settings.facets * 3u;
        draws[draw + 3u] = 0u;
        draws[draw + 4u] = 0u;
    }
}

@compute @workgroup_size(64)
fn list_facets(@builtin(global_invocation_id) id: vec3<u32>) {
    let run = id.x;
    let slot = id.y;
    if run >= settings.facet_runs {
        return;
    }
    var next = array<u32, 5>();
    for (var face = 0u; face < FACES; face++) {
        let list = slot * FACES + face;
        next[face] =
            3u * (list * settings.facets + counts[list * settings.facet_runs + run]);
    }
    for (var word = 0u; word < RUN_WORDS; word++) {
        let packed = marks[(slot * settings.facet_runs + run) * RUN_WORDS + word];
        if packed == 0u {
            continue;
        }
        for (var byte = 0u; byte < 4u; byte++) {
            let mark = (packed >> (8u * byte)) & 255u;
            if mark == 0u {
                continue;
            }
            // Six corners a facet in the vertex buffer: three with the front's item code, three
            // with the back's.
            let facet = run * RUN + word * 4u + byte;
            let corner = facet * 6u + select(0u, 3u, (mark & BACK_SEEN) != 0u);
            for (var face = 0u; face < FACES; face++) {
                if ((mark >> face) & 1u) != 0u {
                    let at = next[face];
                    indices[at] = corner;
                    indices[at + 1u] = corner + 1u;
                    indices[at + 2u] = corner + 2u;
                    next[face] = at + 3u;
                }
            }
        }
    }
}
