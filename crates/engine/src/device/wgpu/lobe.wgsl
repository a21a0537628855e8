// cosⁿα between two unit vectors. Large exponents see only angles so small that the cosine
// rounds to 1, so it is taken from the difference of the vectors: 1 − cosα = |a − b|²/2.
fn lobe_power(a: vec3<f32>, b: vec3<f32>, exponent: f32) -> f32 {
    let difference = a - b;
    let y = 0.5 * dot(difference, difference);
    if y >= 1.0 {
        return 0.0;
    }
    // ln(1 − y)
    let series = -y * (1.0 + y * (1.0 / 2.0 + y * (1.0 / 3.0 + y * (1.0 / 4.0
        + y * (1.0 / 5.0 + y * (1.0 / 6.0))))));
    let logarithm = select(log(1.0 - y), series, y < 0.1);
    return exp(exponent * logarithm);
}
