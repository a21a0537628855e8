//! Multiple importance sampling (Veach and Guibas 1995): how much a sample counts that two ways
//! of sampling might have made.

/// Weight of a sample whose own density is `own` where the other way has density `other`: the power
/// heuristic with exponent 2.
pub fn power_heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    let ratio = other / own.max(f32::MIN_POSITIVE);
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_of_both_ways_add_up_to_one() {
        for (one, other) in [(1.0, 1.0), (0.1, 7.0), (1e-20, 1e10), (0.0, 1.0)] {
            let both = power_heuristic(one, other) + power_heuristic(other, one);
            assert!((both - 1.0).abs() < 1e-6, "{one} {other}: {both}");
        }
        assert_eq!(power_heuristic(f32::INFINITY, 3.0), 1.0, "a mirror has no other way");
        assert_eq!(power_heuristic(2.0, 0.0), 1.0);
    }
}
