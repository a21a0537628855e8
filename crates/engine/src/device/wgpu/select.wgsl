// Who shoots: prefix sum over powers, systematic sampling, and a Shot from every pick
// (Antal eq. 4, §2.4). After common.wgsl and reflection.wgsl.

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read_write> control: Control;
// Power of every patch, then the sum of every run, then the sum of every group of runs.
@group(0) @binding(2) var<storage, read_write> power: array<f32>;
@group(0) @binding(3) var<storage, read> patches: array<Patch>;
@group(0) @binding(4) var<storage, read> irradiance: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> incoming: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> facets: array<Facet>;
@group(0) @binding(7) var<storage, read_write> shots: array<Shot>;

const SPAN = 64u;

// Adds entries of `power` from `start` to `end`.
fn sum_of(start: u32, end: u32) -> f32 {
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        sum += power[i];
    }
    return sum;
}

@compute @workgroup_size(64)
fn sum_runs(@builtin(global_invocation_id) id: vec3<u32>) {
    let run = id.x;
    if run < settings.runs {
        let start = run * SPAN;
        power[settings.patches + run] = sum_of(start, min(start + SPAN, settings.patches));
    }
}

@compute @workgroup_size(64)
fn sum_groups(@builtin(global_invocation_id) id: vec3<u32>) {
    let group = id.x;
    if group < settings.groups {
        let start = group * SPAN;
        let end = min(start + SPAN, settings.runs);
        let sum = sum_of(settings.patches + start, settings.patches + end);
        power[settings.patches + settings.runs + group] = sum;
    }
}

struct Pick {
    index: u32,
    // What is left of the sought sum at the start of the picked entry.
    rest: f32,
}

// The entry between `start` and `end` where the running sum passes `rest`; the last one that is
// not zero where rounding has left the sum short.
fn pick(start: u32, end: u32, rest: f32) -> Pick {
    var picked = Pick(start, rest);
    var left = rest;
    for (var i = start; i < end; i++) {
        let value = power[i];
        if value > 0.0 {
            picked = Pick(i, left);
            if left < value {
                break;
            }
            left -= value;
        }
    }
    return picked;
}

fn pcg(input: u32) -> u32 {
    let state = input * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// random::uniform.
fn uniform_number(stream: u32, counter: vec2<u32>) -> f32 {
    var h = pcg(settings.seed.x ^ pcg(settings.seed.y ^ pcg(stream)));
    h = pcg(h ^ counter.y);
    h = pcg(h + pcg(counter.x));
    return f32(h >> 8u) * (1.0 / 16777216.0);
}

const STREAM_SHOOTER = 1u;
const STREAM_POINT_U = 2u;
const STREAM_POINT_V = 3u;
const STREAM_AZIMUTH = 4u;
const STREAM_JITTER_X = 5u;
const STREAM_JITTER_Y = 6u;
const STREAM_LOBE = 7u;

// PatchedScene::point_on_patch.
fn point_on_patch(patch_index: u32, xi: vec2<f32>) -> vec3<f32> {
    let facet = facets[patches[patch_index].facet];
    let first = select(facet.front, facet.back,
        facet.back < CULLED_BACK && patch_index >= facet.back);
    let n = facet.divisions;
    let index = patch_index - first;
    // Columns of cells start at i(2n − i).
    var i = u32(max(f32(n) - ceil(sqrt(f32(n * n - index))), 0.0));
    while i > 0u && i * (2u * n - i) > index {
        i -= 1u;
    }
    while i + 1u < n && (i + 1u) * (2u * n - i - 1u) <= index {
        i += 1u;
    }
    let within = index - i * (2u * n - i);
    let low = vec2(f32(i), f32(within >> 1u));
    let high = low + 1.0;
    var a = low;
    var b = vec2(high.x, low.y);
    var c = vec2(low.x, high.y);
    if (within & 1u) == 1u {
        a = high;
        b = c;
        c = vec2(high.x, low.y);
    }
    let root = sqrt(xi.x);
    let at = (a * (1.0 - root) + b * (root * (1.0 - xi.y)) + c * (root * xi.y)) / f32(n);
    return facet.corner + facet.edge_1 * at.x + facet.edge_2 * at.y;
}

fn to_source(patch_index: u32, k: u32) -> vec3<f32> {
    return direction_or_zero(control.sources[k].xyz - patches[patch_index].centroid);
}

fn lobe_weight(patch_index: u32, k: u32) -> f32 {
    let e = incoming[k * settings.glossy + patches[patch_index].glossy].xyz;
    let cosine = dot(patches[patch_index].normal, to_source(patch_index, k));
    return importance(patches[patch_index].specular * e)
        * lobe_albedo(patches[patch_index].exponent, cosine);
}

// Peak radiance and axis of the lobe that a glossy patch sends: one of its K incoming
// directions, picked by reflected power and divided by that probability.
fn add_lobe(shot: ptr<function, Shot>, patch_index: u32, xi: f32) {
    var total = 0.0;
    for (var k = 0u; k < settings.shots; k++) {
        total += lobe_weight(patch_index, k);
    }
    if total <= 0.0 {
        return;
    }
    var left = xi * total;
    var picked = 0u;
    var picked_weight = 0.0;
    for (var k = 0u; k < settings.shots; k++) {
        let weight = lobe_weight(patch_index, k);
        if weight > 0.0 {
            picked = k;
            picked_weight = weight;
            if left < weight {
                break;
            }
        }
        left -= weight;
    }
    let normal = patches[patch_index].normal;
    let direction = to_source(patch_index, picked);
    let exponent = patches[patch_index].exponent;
    let e = incoming[picked * settings.glossy + patches[patch_index].glossy].xyz;
    let peak = (exponent + 2.0) / TAU * total / picked_weight;
    (*shot).lobe = patches[patch_index].specular * e * peak;
    (*shot).lobe_axis = 2.0 * dot(normal, direction) * normal - direction;
    (*shot).has_lobe = 1u;
}

@compute @workgroup_size(64)
fn make_shots(@builtin(global_invocation_id) id: vec3<u32>) {
    let k = id.x;
    if k >= settings.shots {
        return;
    }
    var shot = Shot();
    let runs_start = settings.patches;
    let groups_start = runs_start + settings.runs;
    let total = sum_of(groups_start, groups_start + settings.groups);
    // A number that is not finite compares false: then nothing is shot.
    if !(total > 0.0 && total < 3.0e38) {
        shots[k] = shot;
        return;
    }
    let offset = uniform_number(STREAM_SHOOTER, control.iteration);
    let at = (f32(k) + offset) / f32(settings.shots) * total;
    let group = pick(groups_start, groups_start + settings.groups, at);
    let run_start = runs_start + (group.index - groups_start) * SPAN;
    let run = pick(run_start, min(run_start + SPAN, groups_start), group.rest);
    let patch_start = (run.index - runs_start) * SPAN;
    let i = pick(patch_start, min(patch_start + SPAN, settings.patches), run.rest).index;
    let probability = power[i] / total;

    var counter = control.first_shot;
    counter.x += k;
    counter.y += select(0u, 1u, counter.x < k);

    let surface = patches[i];
    shot.patch_index = i;
    shot.position = point_on_patch(i,
        vec2(uniform_number(STREAM_POINT_U, counter), uniform_number(STREAM_POINT_V, counter)));
    shot.normal = surface.normal;
    shot.exponent = surface.exponent;
    shot.scale = surface.area / (probability * f32(settings.shots));
    shot.diffuse = surface.emission + irradiance[i].xyz * surface.diffuse / PI;
    shot.fixed_scale = 2147483648.0;
    shot.face_weights = vec4(1.0);
    shot.last_face_weight = vec4(1.0);

    // hemicube::frame.
    let n = surface.normal;
    let side = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (side + n.z);
    let b = n.x * n.y * a;
    let t = vec3(1.0 + side * n.x * n.x * a, side * b, -side * n.x);
    let s = vec3(b, side + n.y * n.y * a, -n.y);
    var azimuth = 0.0;
    if (settings.flags & RANDOM_AZIMUTH) != 0u {
        azimuth = TAU * uniform_number(STREAM_AZIMUTH, counter);
    }
    shot.tangent = t * cos(azimuth) + s * sin(azimuth);
    shot.bitangent = s * cos(azimuth) - t * sin(azimuth);
    if (settings.flags & JITTER) != 0u {
        shot.jitter_x = uniform_number(STREAM_JITTER_X, counter) - 0.5;
        shot.jitter_y = uniform_number(STREAM_JITTER_Y, counter) - 0.5;
    }
    if surface.glossy != NOT_GLOSSY {
        add_lobe(&shot, i, uniform_number(STREAM_LOBE, counter));
    }
    if max(max(surface.emission.x, surface.emission.y), surface.emission.z) > 0.0 {
        atomicAdd(&control.light_shots, 1u);
    }
    shots[k] = shot;
}
