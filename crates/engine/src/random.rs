//! Counter-based random numbers: every number is a pure function of (seed, stream, counter), so
//! a resumed job continues the same sequence and WGSL kernels draw the same bits.

/// Purpose of a random number; each has its own stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stream {
    /// Which patch shoots.
    Shooter = 1,
    /// Where on the patch the hemicube stands, two numbers.
    PointU = 2,
    /// See [`Stream::PointU`].
    PointV = 3,
    /// Azimuth of the hemicube about the normal.
    Azimuth = 4,
    /// Sub-pixel offset of the hemicube rays, two numbers.
    JitterX = 5,
    /// See [`Stream::JitterX`].
    JitterY = 6,
    /// Which incoming direction's lobe a glossy shooter reflects.
    Lobe = 7,
    /// Which faces of the hemicube are shot through.
    Face = 8,
    /// Where first shots start from.
    FirstShot = 9,
    /// Whether a chain of bounces goes on.
    Roulette = 10,
    /// Walks of rays.
    Path = 11,
    /// Which cell of a pixel rays go through.
    Stratum = 12,
    /// Rays from the lights.
    LightRay = 13,
    /// Shifts of the well-spread points that rays from the lights start with.
    LightShift = 14,
    /// In which order a pixel's paths go through the cells of a choice that they make.
    PathStratum = 15,
    /// Points of a patch and of the lights that shine on it.
    PatchLight = 16,
    /// Directions that light is gathered from.
    Gather = 17,
    /// Points of the lights that shadow rays go to.
    Light = 18,
    /// Directions of a lobe.
    Gloss = 19,
    /// Where openings to the sky are looked for.
    Opening = 20,
    /// Directions of a lobe, along which nothing is in the way of the sky.
    OpenLobe = 21,
    /// Places of the camera's rays in pixels at edges.
    Edge = 22,
    /// Places of the picture and paths from there that the picture is held against.
    Audit = 23,
    /// Rays of elements that are aimed at bright ones.
    Aimed = 24,
    /// Rays of elements that find what lobes send.
    FollowedLobe = 25,
    /// Which pixels stand for all of a picture.
    SparsePixel = 26,
    /// Places of a pixel where its lobe is looked at, and of the sun.
    Highlight = 27,
    /// Places of lamps and of what they may light, and rays from these.
    OwnLight = 28,
}

/// PCG output permutation over a 32-bit state (Jarzynski and Olano 2020, "Hash functions for
/// GPU rendering"); integer operations only, so it is the same on every device.
pub fn pcg(input: u32) -> u32 {
    let state = input.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// 32 random bits for (seed, stream, counter).
pub fn bits(seed: u64, stream: Stream, counter: u64) -> u32 {
    let mut h = pcg(seed as u32 ^ pcg((seed >> 32) as u32 ^ pcg(stream as u32)));
    h = pcg(h ^ (counter >> 32) as u32);
    pcg(h.wrapping_add(pcg(counter as u32)))
}

/// Uniform number in [0, 1) with 24 bits.
pub fn uniform(seed: u64, stream: Stream, counter: u64) -> f32 {
    (bits(seed, stream, counter) >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// The random numbers of one walk, as many as it takes: each a pure function of (seed, stream,
/// walk, its place in the sequence). SplitMix64 (Steele, Lea, Flood 2014), for the processor only.
#[derive(Clone, Debug)]
pub struct Numbers {
    state: u64,
}

impl Numbers {
    /// The sequence of a walk.
    pub fn new(seed: u64, stream: Stream, walk: u64) -> Self {
        Self { state: mix(mix(mix(seed) ^ stream as u64) ^ walk) }
    }

    /// The next uniform number in [0, 1), with 24 bits.
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        (self.bits() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// The next uniform number in [0, 1), with 53 bits, for picks of small probability.
    #[inline]
    pub fn fine(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// The uniform number at a place of the sequence, 0 the next one, without going there.
    #[inline]
    pub fn ahead(&self, place: u64) -> f32 {
        let state = self.state.wrapping_add(GOLDEN.wrapping_mul(place));
        Self { state }.uniform()
    }

    #[inline]
    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }
}

/// 2⁶⁴ over the golden ratio, odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The output function of SplitMix64, a bijection that scatters neighbours.
#[inline]
fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_has_the_right_moments_and_no_serial_correlation() {
        let n = 100_000u64;
        let x: Vec<f64> = (0..n).map(|i| uniform(7, Stream::Shooter, i) as f64).collect();
        let mean = x.iter().sum::<f64>() / n as f64;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
        let serial = x.windows(2).map(|w| (w[0] - mean) * (w[1] - mean)).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 3.0 * (1.0 / 12.0 / n as f64).sqrt());
        assert!((variance - 1.0 / 12.0).abs() < 1e-3);
        assert!(serial.abs() < 3.0 * (1.0 / 12.0) / (n as f64).sqrt());
    }

    #[test]
    fn walks_are_uniform_along_and_across() {
        let n = 50_000u64;
        let mut walk = Numbers::new(7, Stream::Path, 3);
        let along: Vec<f64> = (0..n).map(|_| walk.uniform() as f64).collect();
        let first = |i| Numbers::new(7, Stream::Path, i).uniform() as f64;
        let across: Vec<f64> = (0..n).map(first).collect();
        for x in [&along, &across] {
            let mean = x.iter().sum::<f64>() / n as f64;
            let serial = x.windows(2).map(|w| (w[0] - mean) * (w[1] - mean)).sum::<f64>();
            assert!((mean - 0.5).abs() < 3.0 * (1.0 / 12.0 / n as f64).sqrt(), "{mean}");
            assert!((serial / n as f64).abs() < 3.0 / 12.0 / (n as f64).sqrt(), "{serial}");
        }
        let (mut walk, start) =
            (Numbers::new(7, Stream::Path, 3), Numbers::new(7, Stream::Path, 3));
        assert!((0..5).all(|place| start.ahead(place) == walk.uniform()));
        let other = Numbers::new(8, Stream::Path, 3).uniform();
        assert_ne!(Numbers::new(7, Stream::Path, 3).uniform(), other);
    }

    #[test]
    fn streams_and_seeds_differ() {
        assert_ne!(bits(1, Stream::Shooter, 0), bits(1, Stream::PointU, 0));
        assert_ne!(bits(1, Stream::Shooter, 0), bits(2, Stream::Shooter, 0));
        assert_ne!(bits(1, Stream::Shooter, 0), bits(1 << 32, Stream::Shooter, 0));
    }
}
