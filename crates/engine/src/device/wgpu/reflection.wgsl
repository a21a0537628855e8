// Importance and the modified-Phong lobe; the twin of radiometry.rs. Needs `settings`.

fn importance(x: vec3<f32>) -> f32 {
    return dot(vec3(0.2126, 0.7152, 0.0722), abs(x));
}

fn lobe_table(row: u32, column: u32) -> f32 {
    let index = row * 33u + column;
    return settings.lobe_albedo[index >> 2u][index & 3u];
}

// I_n(θ), the lobe's albedo for ks = 1.
fn lobe_albedo(exponent: f32, cos_incidence: f32) -> f32 {
    let row = min(2.0 * log2(max(exponent, 0.0) + 1.0), 33.999);
    let column = clamp(cos_incidence, 0.0, 1.0) * 32.0;
    let r = u32(row);
    let c = min(u32(column), 31u);
    let fr = row - f32(r);
    let fc = column - f32(c);
    let low = mix(lobe_table(r, c), lobe_table(r, c + 1u), fc);
    let high = mix(lobe_table(r + 1u, c), lobe_table(r + 1u, c + 1u), fc);
    return mix(low, high, fr);
}

fn direction_or_zero(v: vec3<f32>) -> vec3<f32> {
    let squared = dot(v, v);
    return select(vec3(0.0), v * inverseSqrt(squared), squared > 0.0);
}
