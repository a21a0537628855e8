// Random numbers and the 64-bit integers that they take; the twin of random.rs. 64-bit numbers are
// (low word, high word). Needs `settings`.

const STREAM_SHOOTER = 1u;
const STREAM_POINT_U = 2u;
const STREAM_POINT_V = 3u;
const STREAM_AZIMUTH = 4u;
const STREAM_JITTER_X = 5u;
const STREAM_JITTER_Y = 6u;
const STREAM_LOBE = 7u;
const STREAM_FACE = 8u;

fn pcg(input: u32) -> u32 {
    let state = input * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// The 24 bits of random::uniform.
fn uniform_bits(stream: u32, counter: vec2<u32>) -> u32 {
    var h = pcg(settings.seed.x ^ pcg(settings.seed.y ^ pcg(stream)));
    h = pcg(h ^ counter.y);
    h = pcg(h + pcg(counter.x));
    return h >> 8u;
}

fn fraction(bits: u32) -> f32 {
    return f32(bits) * (1.0 / 16777216.0);
}

// random::uniform.
fn uniform_number(stream: u32, counter: vec2<u32>) -> f32 {
    return fraction(uniform_bits(stream, counter));
}

fn add_64(a: vec2<u32>, b: u32) -> vec2<u32> {
    let low = a.x + b;
    return vec2(low, a.y + select(0u, 1u, low < b));
}

fn product_64(a: u32, b: u32) -> vec2<u32> {
    let low = (a & 0xffffu) * (b & 0xffffu);
    let cross_a = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    let cross_b = (a & 0xffffu) * (b >> 16u) + (cross_a & 0xffffu);
    return vec2((cross_b << 16u) | (low & 0xffffu),
        (a >> 16u) * (b >> 16u) + (cross_a >> 16u) + (cross_b >> 16u));
}

// Quotient that fits 32 bits: the divisor is greater than the dividend's high word.
fn quotient_64(dividend: vec2<u32>, divisor: u32) -> u32 {
    var rest = dividend.y;
    var quotient = 0u;
    for (var bit = 32u; bit > 0u; bit--) {
        let carry = rest >> 31u;
        rest = (rest << 1u) | ((dividend.x >> (bit - 1u)) & 1u);
        if carry != 0u || rest >= divisor {
            rest -= divisor;
            quotient |= 1u << (bit - 1u);
        }
    }
    return quotient;
}

// ⌊count·(stratum + ξ)/strata⌋ exactly, ξ of the given 24 bits.
fn share_of(count: u32, stratum: u32, strata: u32, bits: u32) -> u32 {
    let within = product_64(count, bits);
    let whole = (within.y << 8u) | (within.x >> 24u);
    return quotient_64(add_64(product_64(count, stratum), whole), strata);
}
