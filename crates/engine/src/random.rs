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
    fn streams_and_seeds_differ() {
        assert_ne!(bits(1, Stream::Shooter, 0), bits(1, Stream::PointU, 0));
        assert_ne!(bits(1, Stream::Shooter, 0), bits(2, Stream::Shooter, 0));
        assert_ne!(bits(1, Stream::Shooter, 0), bits(1 << 32, Stream::Shooter, 0));
    }
}
