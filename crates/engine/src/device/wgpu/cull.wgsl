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
    view.weight = select(shot.last_face_weight.x, shot.face_weights[min(face, 3u)], face < 4u);
    views[slot * FACES + face] = view;
}

fn largest(v: vec3<f32>) -> f32 {
    return max(max(abs(v.x), abs(v.y)), abs(v.z));
}

fn outside(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, plane: vec3<f32>) -> bool {
    return dot(a, plane) < 0.0 && dot(b, plane) < 0.0 && dot(c, plane) < 0.0;
}

fn mark_of(facet: Facet, shot: Shot, slot: u32) -> u32 {
    let a = facet.corner - shot.position;
    let b = a + facet.edge_1;
    let c = a + facet.edge_2;
    if outside(a, b, c, shot.normal) {
        return 0u;
    }
    let to_frame = transpose(mat3x3(shot.tangent, shot.bitangent, shot.normal));
    let plane = cross(facet.edge_1, facet.edge_2);
    let volume = dot(a, plane);
    let noise = PLANE_NOISE * (largest(shot.position) + largest(to_frame * a));
    if volume * volume <= noise * noise * dot(plane, plane) {
        return 0u;
    }
    let back_seen = volume > 0.0;
    if back_seen && facet.back == CULLED_BACK {
        return 0u;
    }
    var mark = 0u;
    for (var face = 0u; face < FACES; face++) {
        let view = views[slot * FACES + face];
        if view.weight > 0.0
            && !outside(a, b, c, view.clip_w)
            && !outside(a, b, c, view.clip_w - view.clip_x)
            && !outside(a, b, c, view.clip_w + view.clip_x)
            && !outside(a, b, c, view.clip_w - view.clip_y)
            && !outside(a, b, c, view.clip_w + view.clip_y) {
            mark |= 1u << face;
        }
    }
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
    var seen = array<u32, 5>();
    for (var word = 0u; word < RUN_WORDS; word++) {
        var packed = 0u;
        for (var byte = 0u; byte < 4u; byte++) {
            let facet = run * RUN + word * 4u + byte;
            if facet >= settings.facets {
                break;
            }
            let mark = mark_of(facets[facet], shot, slot);
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
