// Who shoots: prefix sum over powers, picks, and a Shot from every pick (Antal eq. 4, §2.3,
// §2.4).
// After common.wgsl, reflection.wgsl and random.wgsl.

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

// The patch that power picks for share `at` of the total, a sum of powers.
fn picked_by_power(at: f32) -> u32 {
    let runs_start = settings.patches;
    let groups_start = runs_start + settings.runs;
    let group = pick(groups_start, groups_start + settings.groups, at);
    let run_start = runs_start + (group.index - groups_start) * SPAN;
    let run = pick(run_start, min(run_start + SPAN, groups_start), group.rest);
    let patch_start = (run.index - runs_start) * SPAN;
    return pick(patch_start, min(patch_start + SPAN, settings.patches), run.rest).index;
}

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
// directions, picked by reflected power and divided by that probability. Returns the importance
// of the power per area that it carries.
fn add_lobe(shot: ptr<function, Shot>, patch_index: u32, xi: f32) -> f32 {
    var total = 0.0;
    for (var k = 0u; k < settings.shots; k++) {
        total += lobe_weight(patch_index, k);
    }
    if total <= 0.0 {
        return 0.0;
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
    return total;
}

// hemicube::Face::hit_by, for a direction of the hemicube frame.
fn face_hit_by(d: vec3<f32>) -> u32 {
    if d.z >= abs(d.x) && d.z >= abs(d.y) {
        return 0u;
    }
    if abs(d.x) >= abs(d.y) {
        return select(2u, 1u, d.x > 0.0);
    }
    return select(4u, 3u, d.y > 0.0);
}

// Probabilities of the face that the mirror direction hits and of each other, as in settings.rs.
const MIRROR_FACE_PROBABILITY = 0.6;
const OTHER_FACE_PROBABILITY = 0.1;

// Weight of each face: 0 to leave it out, else the inverse of its probability. Takes one uniform
// number.
fn set_faces(shot: ptr<function, Shot>, highly_specular: bool, xi: f32) {
    var weights = array<f32, 5>(1.0, 1.0, 1.0, 1.0, 1.0);
    var heaviest = 1.0;
    let one_of_specular =
        settings.faces == SPECULAR_ONE_FACE || settings.faces == RANDOMISED_FACES;
    if highly_specular && one_of_specular {
        let axis = (*shot).lobe_axis;
        let mirror = vec3(
            dot((*shot).tangent, axis), dot((*shot).bitangent, axis), dot((*shot).normal, axis));
        var face = face_hit_by(mirror);
        heaviest = 1.0 / MIRROR_FACE_PROBABILITY;
        if xi >= MIRROR_FACE_PROBABILITY {
            let other = u32((xi - MIRROR_FACE_PROBABILITY) / OTHER_FACE_PROBABILITY);
            let other_face = min(other, FACES - 2u);
            face = other_face + select(0u, 1u, other_face >= face);
            heaviest = 1.0 / OTHER_FACE_PROBABILITY;
        }
        weights = array<f32, 5>();
        weights[face] = heaviest;
    } else if settings.faces == TOP_AND_SIDE || settings.faces == RANDOMISED_FACES {
        let sides = FACES - 1u;
        heaviest = f32(sides);
        weights = array<f32, 5>();
        weights[0] = 1.0;
        weights[1u + min(u32(xi * f32(sides)), sides - 1u)] = heaviest;
    }
    (*shot).face_weights = vec4(weights[0], weights[1], weights[2], weights[3]);
    (*shot).last_face_weight = weights[4];
    // Room for the heaviest, by a power of two so that nothing is rounded.
    (*shot).fixed_scale = 2147483648.0;
    while heaviest > 1.0 {
        (*shot).fixed_scale *= 0.5;
        heaviest *= 0.5;
    }
}

@compute @workgroup_size(64)
fn make_shots(@builtin(global_invocation_id) id: vec3<u32>) {
    let k = id.x;
    if k >= settings.shots {
        return;
    }
    var shot = Shot();
    let groups_start = settings.patches + settings.runs;
    let total = sum_of(groups_start, groups_start + settings.groups);
    // A number that is not finite compares false: then nothing is shot.
    if !(total > 0.0 && total < 3.0e38) {
        shots[k] = shot;
        return;
    }
    let counter = add_64(control.first_shot, k);
    // Systematic sampling picks from stratum k of K, independent picks from the one there is.
    let stratified = (settings.flags & STRATIFIED) != 0u;
    let stratum = select(0u, k, stratified);
    let strata = select(1u, settings.shots, stratified);
    let bits = uniform_bits(STREAM_SHOOTER, select(counter, control.iteration, vec2(stratified)));
    var i = 0u;
    var probability = 0.0;
    if (settings.flags & UNIFORM_SELECTION) != 0u {
        i = share_of(settings.patches, stratum, strata, bits);
        probability = 1.0 / f32(settings.patches);
    } else {
        i = picked_by_power((f32(stratum) + fraction(bits)) / f32(strata) * total);
        probability = power[i] / total;
    }

    let surface = patches[i];
    shot.patch_index = i;
    shot.position = surface.centroid;
    if (settings.flags & RANDOM_POINT) != 0u {
        let xi = vec2(
            uniform_number(STREAM_POINT_U, counter), uniform_number(STREAM_POINT_V, counter));
        shot.position = point_on_patch(i, xi);
    }
    shot.normal = surface.normal;
    shot.exponent = surface.exponent;
    shot.scale = surface.area / (probability * f32(settings.shots));
    shot.diffuse = surface.source + irradiance[i].xyz * surface.diffuse / PI;
    shot.known = surface.known;
    var expected_shots = settings.expected_shots;
    if (settings.flags & GROWING_SHOTS) != 0u {
        let so_far = add_64(control.first_shot, settings.shots);
        expected_shots = f32(so_far.y) * 4294967296.0 + f32(so_far.x);
    }
    shot.limit = 2.0 * expected_shots * probability;

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
    var carried = 0.0;
    if surface.glossy != NOT_GLOSSY {
        carried = add_lobe(&shot, i, uniform_number(STREAM_LOBE, counter));
    }
    let highly_specular = carried > importance(PI * shot.diffuse);
    set_faces(&shot, highly_specular, uniform_number(STREAM_FACE, counter));
    if surface.emits != 0u {
        atomicAdd(&control.light_shots, 1u);
    }
    shots[k] = shot;
}
