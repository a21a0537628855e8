//! How much of each constituent lies between a point and the top of the atmosphere, for all heights
//! and directions: a table, because every step of every ray through the sky asks for it.
//!
//! Source: parameters of the table by Bruneton and Neyret (2008, §4; implementation of 2017), which
//! put its nodes where the columns change most: near the ground and near the horizon.

use super::atmosphere::{
    Atmosphere, GROUND_RADIUS, TOP_RADIUS, VisibleSun, densities, horizon_dip,
};
use super::spectrum::Spectrum;
use glam::DVec3;

/// Number of nodes in radius.
const RADII: usize = 64;
/// Number of nodes in direction.
const DIRECTIONS: usize = 128;
/// Steps of the integral along a ray.
const STEPS: usize = 64;

/// Columns of molecules, aerosols and ozone up to the atmosphere's top: km times relative density.
pub struct Columns {
    /// Row by row of one radius.
    nodes: Vec<DVec3>,
}

impl Columns {
    /// Integrates the densities along the rays of all nodes.
    pub fn new() -> Self {
        let node = |index: usize| {
            let (radius, cosine) = ray_of_node(index / DIRECTIONS, index % DIRECTIONS);
            if cosine >= 0.0 {
                return upward(radius, cosine);
            }
            // The ray falls to its lowest point and rises from there: twice the column above that
            // point, less the part that lies behind the ray's start.
            let lowest = (radius * (1.0 - cosine * cosine).sqrt()).max(GROUND_RADIUS);
            upward(lowest, 0.0) * 2.0 - upward(radius, -cosine)
        };
        Self { nodes: (0..RADII * DIRECTIONS).map(node).collect() }
    }

    /// Columns from a radius in km along a direction, given the cosine of its angle to the
    /// vertical. A direction below the horizon counts as the horizon.
    pub fn to_top(&self, radius: f64, cosine: f64) -> DVec3 {
        let radius = radius.clamp(GROUND_RADIUS, TOP_RADIUS);
        let to_horizon = (radius * radius - GROUND_RADIUS * GROUND_RADIUS).sqrt();
        let (least, most) = (TOP_RADIUS - radius, to_horizon + longest());
        let distance = distance_to_top(radius, cosine).clamp(least, most);
        let column = (distance - least) / (most - least) * (DIRECTIONS - 1) as f64;
        let row = to_horizon / longest() * (RADII - 1) as f64;
        let (i, j) = ((row as usize).min(RADII - 2), (column as usize).min(DIRECTIONS - 2));
        let (u, v) = (column - j as f64, row - i as f64);
        let at = |i: usize| {
            let row = &self.nodes[i * DIRECTIONS..(i + 1) * DIRECTIONS];
            row[j].lerp(row[j + 1], u)
        };
        at(i).lerp(at(i + 1), v)
    }

    /// Part of the sun's light that reaches a radius in km, given the sun's elevation there in
    /// radians; without the part of the disc that the planet hides.
    pub fn sunlight(&self, atmosphere: &Atmosphere, radius: f64, elevation: f64) -> Spectrum {
        let dip = horizon_dip(radius);
        let visible = VisibleSun::above_horizon(elevation + dip);
        if visible.fraction <= 0.0 {
            return Spectrum::ZERO;
        }
        let columns = self.to_top(radius, (visible.height - dip).sin());
        atmosphere.transmittance(columns) * visible.fraction as f32
    }
}

/// Distance in km from the horizon at the ground to the atmosphere's top.
fn longest() -> f64 {
    (TOP_RADIUS * TOP_RADIUS - GROUND_RADIUS * GROUND_RADIUS).sqrt()
}

/// Distance in km from a radius to the atmosphere's top along a direction.
pub fn distance_to_top(radius: f64, cosine: f64) -> f64 {
    let along = radius * cosine;
    let square = along * along + TOP_RADIUS * TOP_RADIUS - radius * radius;
    (square.max(0.0).sqrt() - along).max(0.0)
}

/// Radius and cosine of the ray of a node.
fn ray_of_node(row: usize, column: usize) -> (f64, f64) {
    let to_horizon = longest() * row as f64 / (RADII - 1) as f64;
    let radius = (GROUND_RADIUS * GROUND_RADIUS + to_horizon * to_horizon).sqrt();
    let (least, most) = (TOP_RADIUS - radius, to_horizon + longest());
    let distance = least + (most - least) * column as f64 / (DIRECTIONS - 1) as f64;
    let square = TOP_RADIUS * TOP_RADIUS - radius * radius - distance * distance;
    let cosine = if distance > 0.0 { square / (2.0 * radius * distance) } else { 1.0 };
    (radius, cosine.clamp(-1.0, 1.0))
}

/// Columns along a ray that rises, by the midpoint rule in the cube root of the distance, which
/// puts most steps where the air is densest.
fn upward(radius: f64, cosine: f64) -> DVec3 {
    let length = distance_to_top(radius, cosine);
    let step = |index: usize| {
        let s = (index as f64 + 0.5) / STEPS as f64;
        let distance = length * s * s * s;
        let square = radius * radius + distance * (distance + 2.0 * radius * cosine);
        densities(square.sqrt() - GROUND_RADIUS) * (3.0 * s * s * length / STEPS as f64)
    };
    (0..STEPS).map(step).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Straight up from the ground the columns are the heights of the layers: 8, 1.2 and 15 km.
    #[test]
    fn vertical_columns_have_closed_forms() {
        let found = Columns::new().to_top(GROUND_RADIUS, 1.0);
        let expected = DVec3::new(8.0 * (1.0 - (-12.5_f64).exp()), 1.2, 15.0);
        assert!(((found - expected) / expected).abs().max_element() < 3e-3, "{found}");
    }

    /// The same integral with 200,000 equal steps, for rays up, level, and down past the horizon.
    #[test]
    fn columns_agree_with_fine_integration() {
        let table = Columns::new();
        let rays = [(0.0, 0.0), (0.0, 0.05), (0.5, 0.3), (3.0, -0.01), (20.0, -0.07), (60.0, 0.7)];
        for (height, cosine) in rays {
            let radius = GROUND_RADIUS + height;
            let length = distance_to_top(radius, cosine);
            let steps = 200_000;
            let sum: DVec3 = (0..steps)
                .map(|step| {
                    let distance = length * (f64::from(step) + 0.5) / f64::from(steps);
                    let square = radius * radius + distance * (distance + 2.0 * radius * cosine);
                    densities(square.sqrt() - GROUND_RADIUS)
                })
                .sum();
            let expected = sum * (length / f64::from(steps));
            let error = ((table.to_top(radius, cosine) - expected) / (expected + 0.01)).abs();
            assert!(error.x < 0.02 && error.y < 0.06 && error.z < 0.02, "{height}: {error}");
        }
    }

    /// The published relative air mass at the horizon is 36 to 40 (Kasten and Young 1989: 38); an
    /// exponential atmosphere without refraction has √(πR/2H) = 35.3.
    #[test]
    fn air_mass_at_the_horizon() {
        let table = Columns::new();
        let column = |cosine: f64| table.to_top(GROUND_RADIUS, cosine).x;
        let mass = column(0.0) / column(1.0);
        assert!((mass - 35.3).abs() < 0.7, "{mass}");
        assert!((column(0.5) / column(1.0) - 2.0).abs() < 0.01);
    }

    /// The planet hides the sun below the horizon, which lies lower from a height.
    #[test]
    fn planet_hides_the_sun() {
        let (table, clear) = (Columns::new(), Atmosphere::clear());
        let at = |height: f64, degrees: f64| {
            table.sunlight(&clear, GROUND_RADIUS + height, degrees.to_radians())
        };
        assert_eq!(at(0.0, -0.3), Spectrum::ZERO);
        assert!(at(0.0, -0.2).0[15] > 0.0);
        assert!(at(20.0, -4.0).0[15] > 0.1);
        assert_eq!(at(20.0, -5.0), Spectrum::ZERO);
    }
}
