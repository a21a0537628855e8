// From sums of form factors to incoming light, and from that to the next powers
// (Antal eq. 3, 8, §2.4). After common.wgsl, reflection.wgsl and lobe.wgsl.

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<uniform> group: Pass;
@group(0) @binding(2) var<storage, read_write> control: Control;
@group(0) @binding(3) var<storage, read_write> power: array<f32>;
@group(0) @binding(4) var<storage, read> patches: array<Patch>;
// Per patch Σ_k E_k of this iteration, then per patch Σ over iterations; without known light.
@group(0) @binding(5) var<storage, read_write> irradiance: array<vec4<f32>>;
// Per shot of this iteration and glossy patch E_k, known light included; behind them, per glossy
// patch, Σ over iterations of the radiance that its lobe sends to the viewer.
@group(0) @binding(6) var<storage, read_write> incoming: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> shots: array<Shot>;
@group(0) @binding(8) var<storage, read_write> sums: array<u32>;

fn phong_lobe(normal: vec3<f32>, to_source: vec3<f32>, to_viewer: vec3<f32>, n: f32) -> f32 {
    let incidence = dot(normal, to_source);
    if incidence <= 0.0 || dot(normal, to_viewer) <= 0.0 {
        return 0.0;
    }
    let mirrored = 2.0 * incidence * normal - to_source;
    return (n + 2.0) / TAU * lobe_power(mirrored, to_viewer, n);
}

// Radiance that the lobe of a glossy patch sends to the viewer, and what it reflects in all.
struct Reflected {
    to_viewer: vec3<f32>,
    total: vec3<f32>,
}

fn reflected_by_lobe(i: u32, glossy: u32) -> Reflected {
    var result = Reflected(vec3(0.0), vec3(0.0));
    let centroid = patches[i].centroid;
    let exponent = patches[i].exponent;
    var to_viewer = settings.viewer;
    if (settings.flags & VIEWER_IS_POINT) != 0u {
        to_viewer = direction_or_zero(settings.viewer - centroid);
    }
    let has_viewer = (settings.flags & (VIEWER_IS_POINT | VIEWER_IS_DIRECTION)) != 0u;
    for (var k = 0u; k < settings.shots; k++) {
        let e = incoming[k * settings.glossy + glossy].xyz;
        if all(e == vec3(0.0)) {
            continue;
        }
        let to_source = direction_or_zero(shots[k].position - centroid);
        result.total += e * lobe_albedo(exponent, dot(patches[i].normal, to_source));
        if has_viewer {
            result.to_viewer +=
                e * phong_lobe(patches[i].shading_normal, to_source, to_viewer, exponent);
        }
    }
    result.total *= patches[i].specular;
    return result;
}

// Counts the iteration and keeps where its shots came from.
fn close_iteration() {
    control.iterations += 1u;
    for (var k = 0u; k < settings.shots; k++) {
        control.shots += select(0u, 1u, shots[k].scale > 0.0);
        control.sources[k] = vec4(shots[k].position, 0.0);
    }
    control.iteration.x += 1u;
    control.iteration.y += select(0u, 1u, control.iteration.x == 0u);
    control.first_shot.x += settings.shots;
    control.first_shot.y += select(0u, 1u, control.first_shot.x < settings.shots);
}

// What the sums of shot k at a patch are multiplied by (settings::VarianceReduction).
fn reduction(k: u32, form_factor: f32, area: f32) -> f32 {
    let shooter_area = patches[shots[k].patch_index].area;
    if min(form_factor * shooter_area / area, 1.0) <= shots[k].limit {
        return 1.0;
    }
    // A_j over the scale A_j/(p_j K).
    return select(0.0, shooter_area / shots[k].scale, settings.substitute == SUBSTITUTE_MEAN);
}

@compute @workgroup_size(64)
fn update(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= settings.patches {
        return;
    }
    let glossy = patches[i].glossy;
    let has_lobes = (settings.flags & LOBES) != 0u;
    let planes = select(1u, 2u, has_lobes);
    let area = patches[i].area;
    let per_area = PI / area;
    var e = vec3(0.0);
    if group.opens == 0u {
        e = irradiance[i].xyz;
    }
    for (var slot = 0u; slot < group.count; slot++) {
        let k = group.first + slot;
        let at = slot * planes * settings.patches + i;
        let fixed = sums[at];
        var e_k = vec3(0.0);
        if fixed != 0u {
            sums[at] = 0u;
            let unit = 1.0 / shots[k].fixed_scale;
            var form_factor = f32(fixed) * unit;
            var factor = 1.0;
            if settings.substitute != NO_SUBSTITUTE {
                factor = reduction(k, form_factor, area);
                form_factor *= factor;
            }
            var radiance = shots[k].diffuse * form_factor;
            if has_lobes {
                let lobe_factor = sums[at + settings.patches];
                if lobe_factor != 0u {
                    sums[at + settings.patches] = 0u;
                    radiance += shots[k].lobe * (f32(lobe_factor) * unit * factor);
                }
            }
            let scale = shots[k].scale * per_area;
            e_k = radiance * scale;
            e += e_k;
            if glossy != NOT_GLOSSY {
                // Lobes reflect the known light too.
                e_k += shots[k].known * (form_factor * scale);
            }
        }
        if glossy != NOT_GLOSSY {
            incoming[k * settings.glossy + glossy] = vec4(e_k, 0.0);
        }
    }
    irradiance[i] = vec4(e, 0.0);
    if group.closes == 0u {
        return;
    }
    irradiance[settings.patches + i] += vec4(e, 0.0);
    var reflected = patches[i].diffuse * e;
    if glossy != NOT_GLOSSY {
        let lobe = reflected_by_lobe(i, glossy);
        reflected += lobe.total;
        incoming[settings.shots * settings.glossy + glossy] += vec4(lobe.to_viewer, 0.0);
    }
    power[i] = importance(area * (PI * patches[i].source + reflected)) + patches[i].known_power;
    if i == 0u {
        close_iteration();
    }
}
